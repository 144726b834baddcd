"""Leaner straight-line code from a CasADi SX function, without changing its value.

CasADi merges equal subexpressions only if they are written alike, and turns x (1/y) into a division each
time. Here a function is read into a graph in which signs are pulled outwards, sums and products do not depend
on the order of their operands, and a division is a product with a shared reciprocal; equal nodes meet there.
Sums of products are then factored (x a + x b = x (a + b)) where no shared value is lost. The graph is written
back with CasADi's simplification switched off, which would change it.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import casadi as cs

from ocptip.basics.errors import InputError

_UNARY = {
    cs.OP_SIN: cs.sin,
    cs.OP_COS: cs.cos,
    cs.OP_SQRT: cs.sqrt,
    cs.OP_TANH: cs.tanh,
    cs.OP_SIGN: cs.sign,
    cs.OP_FABS: cs.fabs,
}
_PASSES = 3  # how often sums are factored
_ODD = {cs.OP_SIN, cs.OP_TANH, cs.OP_SIGN}
_EVEN = {cs.OP_COS, cs.OP_FABS}

_expressions = threading.Lock()

Value = tuple[int, int]  # sign (+1, -1), node


@dataclass
class _Graph:
    """Nodes in topological order: ("in", k), ("const", c), ("add", a, b, sign of b), ("mul", a, b),
    ("inv", a), ("fun", code, a)."""

    nodes: list[tuple] = field(default_factory=list)
    _index: dict[tuple, int] = field(default_factory=dict)

    def node(self, *key: object) -> int:
        if key not in self._index:
            self._index[key] = len(self.nodes)
            self.nodes.append(key)
        return self._index[key]

    def constant(self, value: float) -> Value:
        return (-1 if value < 0 else 1), self.node("const", abs(value))

    def number(self, node: int) -> float | None:
        key = self.nodes[node]
        return key[1] if key[0] == "const" else None

    def add(self, a: Value, b: Value) -> Value:
        x, y = self.number(a[1]), self.number(b[1])
        if x is not None and y is not None:
            return self.constant(a[0] * x + b[0] * y)
        if x == 0:
            return b
        if y == 0:
            return a
        if a[1] == b[1]:
            return self.constant(0.0) if a[0] != b[0] else self.mul((a[0], a[1]), self.constant(2.0))
        if a[1] > b[1]:
            a, b = b, a
        return a[0], self.node("add", a[1], b[1], a[0] * b[0])

    def mul(self, a: Value, b: Value) -> Value:
        sign = a[0] * b[0]
        x, y = self.number(a[1]), self.number(b[1])
        if x is not None and y is not None:
            return self.constant(sign * x * y)
        if x == 0 or y == 0:
            return self.constant(0.0)
        if x == 1:
            return sign, b[1]
        if y == 1:
            return sign, a[1]
        low, high = sorted((a[1], b[1]))
        return sign, self.node("mul", low, high)

    def inverse(self, a: Value) -> Value:
        x = self.number(a[1])
        return self.constant(a[0] / x) if x else (a[0], self.node("inv", a[1]))

    def function(self, code: int, a: Value) -> Value:
        if code in _ODD:
            return a[0], self.node("fun", code, (1, a[1]))
        if code in _EVEN:
            return 1, self.node("fun", code, (1, a[1]))
        return 1, self.node("fun", code, a)

    def operands(self, node: int) -> tuple[int, ...]:
        key = self.nodes[node]
        if key[0] in ("add", "mul"):
            return key[1], key[2]
        if key[0] == "inv":
            return (key[1],)
        return (key[2][1],) if key[0] == "fun" else ()


def tidy(function: cs.Function) -> cs.Function:
    """The same function in fewer operations.

    Args:
        function: an SX function of scalar operations (no calls).

    Returns:
        A function of the same name, inputs and outputs; outputs keep their sparsity.

    Raises:
        InputError: an operation this module does not know.
    """
    graph, outputs = _read(function)
    for _ in range(_PASSES):
        graph, outputs = _factored(graph, outputs)
    return _written(function, graph, outputs)


def _read(function: cs.Function) -> tuple[_Graph, list[dict[int, Value]]]:
    graph = _Graph()
    work: dict[int, Value] = {}
    outputs: list[dict[int, Value]] = [{} for _ in range(function.n_out())]
    for k in range(function.n_instructions()):
        code = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if code == cs.OP_OUTPUT:
            outputs[target[0]][target[1]] = work[source[0]]
        elif code == cs.OP_INPUT:
            work[target[0]] = (1, graph.node("in", source[0], source[1]))
        elif code == cs.OP_CONST:
            work[target[0]] = graph.constant(function.instruction_constant(k))
        else:
            work[target[0]] = _operation(graph, code, [work[i] for i in source])
    return graph, outputs


def _operation(graph: _Graph, code: int, given: list[Value]) -> Value:
    a, b = given[0], given[-1]
    negative = (-b[0], b[1])
    if code == cs.OP_ADD:
        return graph.add(a, b)
    if code == cs.OP_SUB:
        return graph.add(a, negative)
    if code == cs.OP_MUL:
        return graph.mul(a, b)
    if code == cs.OP_DIV:
        return graph.mul(a, graph.inverse(b))
    if code == cs.OP_NEG:
        return -a[0], a[1]
    if code == cs.OP_SQ:
        return graph.mul(a, a)
    if code == cs.OP_TWICE:
        return graph.mul(a, graph.constant(2.0))
    if code == cs.OP_INV:
        return graph.inverse(a)
    if code in _UNARY:
        return graph.function(code, a)
    raise InputError(f"tidy: operation {code} of CasADi is not known here")


def _uses(graph: _Graph, outputs: list[dict[int, Value]]) -> list[int]:
    """How often each node is used by nodes that matter; zero: it does not matter."""
    uses = [0] * len(graph.nodes)
    for output in outputs:
        for _, node in output.values():
            uses[node] += 1
    for node in range(len(graph.nodes) - 1, -1, -1):
        if uses[node]:
            for operand in graph.operands(node):
                uses[operand] += 1
    return uses


def _factored(graph: _Graph, outputs: list[dict[int, Value]]) -> tuple[_Graph, list[dict[int, Value]]]:
    """One pass: sums and products are taken apart down to shared values, factored and written again."""
    uses = _uses(graph, outputs)
    inner: set[int] = set()
    for node, key in enumerate(graph.nodes):
        if uses[node] and key[0] in ("add", "mul"):
            for operand in key[1:3]:
                kind = graph.nodes[operand][0]
                if uses[operand] == 1 and (kind == "mul" or (kind == "add" and key[0] == "add")):
                    inner.add(operand)
    new = _Graph()
    known: dict[int, Value] = {}

    def factors(node: int) -> tuple[int, list[int]]:
        sign, results, open_ = 1, [], [node]
        while open_:
            one = open_.pop()
            if graph.nodes[one][0] == "mul" and (one == node or one in inner):
                open_ += [graph.nodes[one][2], graph.nodes[one][1]]
            else:
                sign *= known[one][0]
                results.append(known[one][1])
        return sign, results

    def terms(node: int) -> list[tuple[int, list[int]]]:
        results, open_ = [], [(1, node)]
        while open_:
            sign, one = open_.pop()
            key = graph.nodes[one]
            if key[0] == "add" and (one == node or one in inner):
                open_ += [(sign * key[3], key[2]), (sign, key[1])]
            elif one in inner:
                factors_here, product = factors(one)
                results.append((sign * factors_here, product))
            else:
                results.append((sign * known[one][0], [known[one][1]]))
        return results

    for node, key in enumerate(graph.nodes):
        if not uses[node] or node in inner:
            continue
        if key[0] == "in":
            known[node] = (1, new.node(*key))
        elif key[0] == "const":
            known[node] = new.constant(key[1])
        elif key[0] == "add":
            known[node] = _sum(new, terms(node))
        elif key[0] == "mul":
            known[node] = _product(new, *factors(node))
        elif key[0] == "inv":
            known[node] = new.inverse(known[key[1]])
        else:
            sign, argument = key[2]
            known[node] = new.function(key[1], (sign * known[argument][0], known[argument][1]))
    renamed = [{k: (s * known[n][0], known[n][1]) for k, (s, n) in out.items()} for out in outputs]
    return new, renamed


def _product(graph: _Graph, sign: int, nodes: list[int]) -> Value:
    value: Value = (sign, nodes[0])
    for node in nodes[1:]:
        value = graph.mul(value, (1, node))
    return value


def _sum(graph: _Graph, terms: list[tuple[int, list[int]]]) -> Value:
    """Sum of signed products; the factor that most terms share is taken out first."""
    while True:
        frequency = Counter(node for _, product in terms for node in set(product))
        shared = [(c, node) for node, c in frequency.items() if c > 1 and graph.number(node) != 1.0]
        if not shared:
            break
        _, best = max(shared, key=lambda item: (item[0], -item[1]))
        group, rest = [], []
        for sign, product in terms:
            if best in product:
                left = list(product)
                left.remove(best)
                group.append((sign, left or [graph.constant(1.0)[1]]))
            else:
                rest.append((sign, product))
        sign, inside = graph.mul((1, best), _sum(graph, group))
        terms = [*rest, (sign, [inside])]
    value = _product(graph, *terms[0])
    for sign, product in terms[1:]:
        value = graph.add(value, _product(graph, sign, product))
    return value


def _written(function: cs.Function, graph: _Graph, outputs: list[dict[int, Value]]) -> cs.Function:
    uses = _uses(graph, outputs)
    inputs = [cs.SX.sym(function.name_in(i), function.sparsity_in(i)) for i in range(function.n_in())]
    nonzeros = [one.nz[:] for one in inputs]
    flipped = _flipped(graph, outputs, uses)
    with expressions_as_written():
        values: dict[int, cs.SX] = {}
        for node, key in enumerate(graph.nodes):
            if uses[node]:
                values[node] = _expression(graph, node, key, values, uses, nonzeros, flipped)
        negative: dict[int, cs.SX] = {}
        results = []
        for index, output in enumerate(outputs):
            result = cs.SX(function.sparsity_out(index))
            entries = []
            for k in range(result.nnz()):
                sign, node = output[k]
                sign = -sign if node in flipped else sign
                if sign < 0 and node not in negative:
                    negative[node] = -values[node]
                entries.append(values[node] if sign > 0 else negative[node])
            results.append(cs.SX(function.sparsity_out(index), cs.vertcat(*entries)) if entries else result)
        return cs.Function(function.name(), inputs, results, function.name_in(), function.name_out())


def _flipped(graph: _Graph, outputs: list[dict[int, Value]], uses: list[int]) -> set[int]:
    """Nodes to be written with the opposite sign because an output wants -node and it costs nothing."""
    flipped: set[int] = set()
    for output in outputs:
        for sign, node in output.values():
            while sign < 0 and uses[node] == 1:
                key = graph.nodes[node]
                if key[0] == "add" and key[3] < 0:
                    flipped.add(node)
                    break
                if key[0] != "mul":
                    break
                sums = [n for n in key[1:3] if uses[n] == 1 and graph.nodes[n][0] == "add"]
                sums = [n for n in sums if graph.nodes[n][3] < 0]
                if not sums:
                    break
                flipped |= {node, sums[0]}
                break
    return flipped


def _expression(
    graph: _Graph,
    node: int,
    key: tuple,
    values: dict[int, cs.SX],
    uses: list[int],
    nonzeros: list[cs.SX],
    flipped: set[int],
) -> cs.SX:
    if key[0] == "in":
        return nonzeros[key[1]][key[2]]
    if key[0] == "const":
        return cs.SX(key[1])
    if key[0] == "add":
        a, b = values[key[1]], values[key[2]]
        if key[3] > 0:
            return a + b
        return b - a if node in flipped else a - b
    if key[0] == "mul":
        for this, other in ((key[1], key[2]), (key[2], key[1])):
            if graph.nodes[this][0] == "inv" and uses[this] == 1 and key[1] != key[2]:
                return values[other] / values[graph.nodes[this][1]]
        return values[key[1]] * values[key[2]]
    if key[0] == "inv":
        return 1 / values[key[1]]
    sign, argument = key[2]
    return _UNARY[key[1]](values[argument] if sign > 0 else -values[argument])


@contextmanager
def expressions_as_written() -> Iterator[None]:
    """CasADi keeps expressions as they are written, without simplifying them.

    Expressions that another thread builds meanwhile are not simplified either: longer, of the same value.
    """
    with _expressions:
        before = cs.GlobalOptions.getSimplificationOnTheFly()
        cs.GlobalOptions.setSimplificationOnTheFly(False)
        try:
            yield
        finally:
            cs.GlobalOptions.setSimplificationOnTheFly(before)
