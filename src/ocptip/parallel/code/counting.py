"""Operation counts of straight-line code, weighted as in the published tables.

Rule (fixed, so that counts can be compared over time): additions, subtractions, negations and doublings weigh
1, multiplications and squares 1, divisions and reciprocals 4, sines and cosines 10, assignments 1. An
assignment is every operation whose value is used more than once, and every output entry that is not a
constant.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs

from ocptip.basics.write import Record

_KINDS = {
    cs.OP_ADD: "additions",
    cs.OP_SUB: "additions",
    cs.OP_NEG: "additions",
    cs.OP_TWICE: "additions",
    cs.OP_MUL: "multiplications",
    cs.OP_SQ: "multiplications",
    cs.OP_DIV: "divisions",
    cs.OP_INV: "divisions",
    cs.OP_SIN: "trigonometric",
    cs.OP_COS: "trigonometric",
}
_FREE = {cs.OP_INPUT, cs.OP_CONST, cs.OP_OUTPUT, cs.OP_PARAMETER}


@dataclass(frozen=True)
class OperationCount(Record):
    """Operations of one function.

    Attributes:
        additions: sums, differences, negations, doublings (weight 1).
        multiplications: products and squares (weight 1).
        divisions: quotients and reciprocals (weight 4).
        trigonometric: sines and cosines (weight 10).
        assignments: values used more than once, and output entries (weight 1).
        others: whatever else (sign, absolute value, square root; weight 10).
    """

    additions: int
    multiplications: int
    divisions: int
    trigonometric: int
    assignments: int
    others: int = 0

    @property
    def arithmetic(self) -> int:
        """Weighted sum without the assignments."""
        transcendental = self.trigonometric + self.others
        return self.additions + self.multiplications + 4 * self.divisions + 10 * transcendental

    @property
    def weighted(self) -> int:
        """Weighted sum."""
        return self.arithmetic + self.assignments

    def __add__(self, other: OperationCount) -> OperationCount:
        return OperationCount(
            self.additions + other.additions,
            self.multiplications + other.multiplications,
            self.divisions + other.divisions,
            self.trigonometric + other.trigonometric,
            self.assignments + other.assignments,
            self.others + other.others,
        )

    def to_dict(self) -> dict[str, int]:
        """Plain data."""
        return {**super().to_dict(), "arithmetic": self.arithmetic, "weighted": self.weighted}


def count_operations(function: cs.Function) -> OperationCount:
    """Count the operations of an SX function by the rule of this module.

    Args:
        function: built from SX; a call of another function counts as one operation of the kind "others".
    """
    numbers = dict.fromkeys((*_KINDS.values(), "others"), 0)
    writer: dict[int, int] = {}
    uses: dict[int, int] = {}
    counted: set[int] = set()
    outputs = 0
    for k in range(function.n_instructions()):
        code = function.instruction_id(k)
        if code == cs.OP_OUTPUT:
            source = writer[function.instruction_input(k)[0]]
            outputs += function.instruction_id(source) != cs.OP_CONST
            uses[source] = uses.get(source, 0) + 1
            continue
        if code not in _FREE:
            numbers[_KINDS.get(code, "others")] += 1
            counted.add(k)
            # The two operands of a square written as a product are one use of the value.
            for source in {writer[i] for i in function.instruction_input(k)}:
                uses[source] = uses.get(source, 0) + 1
        writer[function.instruction_output(k)[0]] = k
    shared = sum(uses.get(k, 0) > 1 for k in counted)
    return OperationCount(**numbers, assignments=shared + outputs)
