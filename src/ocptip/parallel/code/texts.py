"""Generated functions as text that needs no compiler: a Matlab file, and equations in LaTeX."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.write import MARK
from ocptip.parallel.code.codegen import described
from ocptip.parallel.code.lean import LeanFunction

_MATLAB = {
    cs.OP_ADD: "{} + {}",
    cs.OP_SUB: "{} - {}",
    cs.OP_MUL: "{} * {}",
    cs.OP_DIV: "{} / {}",
    cs.OP_NEG: "-{}",
    cs.OP_TWICE: "2 * {}",
    cs.OP_SQ: "{0} * {0}",
    cs.OP_INV: "1 / {}",
    cs.OP_SIN: "sin({})",
    cs.OP_COS: "cos({})",
    cs.OP_TAN: "tan({})",
    cs.OP_ASIN: "asin({})",
    cs.OP_ACOS: "acos({})",
    cs.OP_ATAN: "atan({})",
    cs.OP_SQRT: "sqrt({})",
    cs.OP_FABS: "abs({})",
    cs.OP_SIGN: "sign({})",
    cs.OP_ATAN2: "atan2({}, {})",
    cs.OP_FMAX: "max({}, {})",
    cs.OP_FMIN: "min({}, {})",
}

# A text and how loosely its last operation binds; 0 binds most. Operands that bind more loosely than their
# place allows are put in parentheses.
_ATOM, _PRODUCT, _SUM = range(3)
_LATEX = {
    cs.OP_ADD: ("{} + {}", (_SUM, _PRODUCT), _SUM),
    cs.OP_SUB: ("{} - {}", (_SUM, _PRODUCT), _SUM),
    cs.OP_MUL: (r"{} \, {}", (_PRODUCT, _PRODUCT), _PRODUCT),
    cs.OP_DIV: (r"\frac{{{}}}{{{}}}", (_SUM, _SUM), _PRODUCT),
    cs.OP_NEG: ("-{}", (_PRODUCT,), _SUM),
    cs.OP_TWICE: (r"2 \, {}", (_PRODUCT,), _PRODUCT),
    cs.OP_SQ: ("{}^{{2}}", (_ATOM,), _PRODUCT),
    cs.OP_INV: (r"\frac{{1}}{{{}}}", (_SUM,), _PRODUCT),
    cs.OP_SIN: (r"\sin\left({}\right)", (_SUM,), _PRODUCT),
    cs.OP_COS: (r"\cos\left({}\right)", (_SUM,), _PRODUCT),
    cs.OP_TAN: (r"\tan\left({}\right)", (_SUM,), _PRODUCT),
    cs.OP_ASIN: (r"\arcsin\left({}\right)", (_SUM,), _PRODUCT),
    cs.OP_ACOS: (r"\arccos\left({}\right)", (_SUM,), _PRODUCT),
    cs.OP_ATAN: (r"\arctan\left({}\right)", (_SUM,), _PRODUCT),
    cs.OP_SQRT: (r"\sqrt{{{}}}", (_SUM,), _ATOM),
    cs.OP_FABS: (r"\left|{}\right|", (_SUM,), _ATOM),
    cs.OP_SIGN: (r"\operatorname{{sign}}\left({}\right)", (_SUM,), _PRODUCT),
    cs.OP_ATAN2: (r"\operatorname{{atan2}}\left({}, {}\right)", (_SUM, _SUM), _PRODUCT),
    cs.OP_FMAX: (r"\max\left({}, {}\right)", (_SUM, _SUM), _PRODUCT),
    cs.OP_FMIN: (r"\min\left({}, {}\right)", (_SUM, _SUM), _PRODUCT),
}
_LONGEST = 70  # characters of LaTeX in a term without a name, so that equations fit a line
_DOTS = {"sd": r"\dot{s}", "sdd": r"\ddot{s}", "zd": r"\dot{z}", "zdd": r"\ddot{z}", "tau": r"\tau"}

Functions = Sequence[LeanFunction | cs.Function]


def matlab_text(functions: Functions, name: str) -> str:
    """A Matlab file whose first argument names the function, as for the MEX file of `write_c`.

    Args:
        functions: of different names.
        name: of the file, without .m.

    Raises:
        InputError: a function has an operation that this text has not.
    """
    plain = [_expanded(one) for one in functions]
    lines = [f"function varargout = {name}(name, varargin)", f"% {MARK}."]
    lines += [f"% {line}" for one in functions for line in described(one)]
    lines.append("switch name")
    for one in plain:
        lines += [
            f"case '{one.name()}'",
            f"  [varargout{{1:max(1, nargout)}}] = {one.name()}(varargin{{:}});",
        ]
    known = ", ".join(one.name() for one in plain)
    lines += ["otherwise", f"  error('there is no %s; there are {known}', name);", "end", "end"]
    return "\n".join([*lines, *(line for one in plain for line in _matlab(one))]) + "\n"


def latex_text(functions: Functions) -> str:
    r"""Equations of functions in LaTeX, for `\input` (package amsmath); terms used again have names t.

    Raises:
        InputError: a function has an operation that this text has not.
    """
    lines = [f"% {MARK}. Needs amsmath; \\allowdisplaybreaks lets long lists continue on the next page."]
    for one in functions:
        lines += ["", *(f"% {line}" for line in described(one)), r"\begin{align*}"]
        lines += [",\\\\\n".join(_latex(_expanded(one), LeanFunction.of(one).entries)) + ".", r"\end{align*}"]
    return "\n".join(lines) + "\n"


def _expanded(given: LeanFunction | cs.Function) -> cs.Function:
    """The function as a list of scalar operations."""
    function = LeanFunction.of(given).function
    return function if function.is_a("SXFunction") else function.expand()


def _operations(function: cs.Function) -> Iterator[tuple[int, int, list[int], list[int]]]:
    """Number, code, output and inputs of each operation."""
    for k in range(function.n_instructions()):
        yield k, function.instruction_id(k), function.instruction_output(k), function.instruction_input(k)


def _matlab(function: cs.Function) -> list[str]:
    """The lines of one function; every value has one name."""
    inputs, outputs = function.name_in(), function.name_out()
    shapes = [function.size_out(k) for k in range(len(outputs))]
    lines = ["", f"function [{', '.join(outputs)}] = {function.name()}({', '.join(inputs)})"]
    lines += [
        f"{out} = zeros({rows}, {columns});" for out, (rows, columns) in zip(outputs, shapes, strict=True)
    ]
    values: dict[int, str] = {}
    for k, code, to, given in _operations(function):
        if code == cs.OP_CONST:
            constant = float(function.instruction_constant(k))
            values[to[0]] = repr(constant) if constant >= 0 else f"({constant!r})"
        elif code == cs.OP_INPUT:
            row, column = _place(function.sparsity_in(given[0]), given[1])
            values[to[0]] = f"{inputs[given[0]]}({row + column * function.size1_in(given[0]) + 1})"
        elif code == cs.OP_OUTPUT:
            row, column = _place(function.sparsity_out(to[0]), to[1])
            place = row + column * function.size1_out(to[0]) + 1
            lines.append(f"{outputs[to[0]]}({place}) = {values[given[0]]};")
        else:
            lines.append(f"t{k} = {_known(_MATLAB, function, code).format(*(values[j] for j in given))};")
            values[to[0]] = f"t{k}"
    return [*lines, "end"]


def _latex(function: cs.Function, names: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """The equations of one function."""
    uses = _uses(function)
    values: dict[int, tuple[str, int]] = {}
    terms = 0
    for k, code, to, given in _operations(function):
        if code == cs.OP_CONST:
            values[to[0]] = _number(float(function.instruction_constant(k)))
        elif code == cs.OP_INPUT:
            name = function.name_in(given[0])
            values[to[0]] = _entry(name, function.sparsity_in(given[0]), given[1], names.get(name, ())), _ATOM
        elif code == cs.OP_OUTPUT:
            name = function.name_out(to[0])
            yield f"{_entry(name, function.sparsity_out(to[0]), to[1])} &= {values[given[0]][0]}"
        else:
            template, allowed, binds = _known(_LATEX, function, code)
            operands = [_within(*values[j], loosest) for j, loosest in zip(given, allowed, strict=False)]
            text = template.format(*operands)
            if uses[k] > 1 or len(text) > _LONGEST:
                terms += 1
                yield f"t_{{{terms}}} &= {text}"
                text, binds = f"t_{{{terms}}}", _ATOM
            values[to[0]] = text, binds


def _uses(function: cs.Function) -> Counter[int]:
    """How often the result of each operation is used; places of results are used again by others."""
    owner: dict[int, int] = {}
    uses: Counter[int] = Counter()
    for k, code, to, given in _operations(function):
        if code not in (cs.OP_CONST, cs.OP_INPUT):
            uses.update(owner[j] for j in given)
        if code != cs.OP_OUTPUT:
            owner[to[0]] = k
    return uses


def _within(text: str, binds: int, loosest: int) -> str:
    return text if binds <= loosest else rf"\left({text}\right)"


def _number(value: float) -> tuple[str, int]:
    """In LaTeX, and how loosely it binds."""
    digits, _, power = repr(value).partition("e")
    digits = digits.removesuffix(".0")
    text = rf"{digits} \cdot 10^{{{int(power)}}}" if power else digits
    return text, _SUM if value < 0 else _PRODUCT if power else _ATOM


def _entry(name: str, sparsity: cs.Sparsity, number: int, names: Sequence[str] = ()) -> str:
    """An entry of a matrix in LaTeX."""
    if names:
        return rf"\mathit{{{names[number]}}}".replace("_", r"\_")
    row, column = _place(sparsity, number)
    base, _, below = name.partition("_")
    places = [row + 1, column + 1] if sparsity.size2() > 1 else [row + 1] if sparsity.size1() > 1 else []
    low = ",".join([*([below] if below else []), *map(str, places)])
    symbol = _DOTS.get(base, base if len(base) == 1 else rf"\mathit{{{base}}}")
    return f"{symbol}_{{{low}}}" if low else symbol


def _known(texts: dict, function: cs.Function, code: int):
    if code not in texts:
        raise InputError(f"{function.name()}: operation {code} of CasADi has no text")
    return texts[code]


def _place(sparsity: cs.Sparsity, number: int) -> tuple[int, int]:
    """Row and column of an entry that is not always zero."""
    rows, columns = (np.array(indices) for indices in sparsity.get_triplet())
    return int(rows[number]), int(columns[number])
