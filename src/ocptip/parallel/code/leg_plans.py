"""Operation counts of straight-line code, weighted as in the published tables; leg plans with the fewest."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import casadi as cs

from ocptip.basics.errors import InputError
from ocptip.basics.write import Record
from ocptip.parallel.code.tidy import tidy
from ocptip.parallel.description.robot_description import RobotDescription
from ocptip.parallel.symbolic.leg_dynamics import CouplingLeg, LegModel, LegPlan, can_inject, leg_jacobian
from ocptip.parallel.symbolic.projection import Projection, robot_arguments
from ocptip.parallel.symbolic.symbols import InertiaLayout, geometry_symbols, inertia_layout, leg_model

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


Purpose = Literal["motors", "tau_s", "rows"]

_FOUND: dict[tuple[str, str], LegPlan] = {}
"""Plans by purpose and structure of the leg: the search takes longer than the code it is for."""


def choose_plans(
    description: RobotDescription, layout: InertiaLayout, kept: Sequence[bool], purpose: Purpose
) -> tuple[LegPlan, ...]:
    """The plan of every leg; legs of equal structure are searched once.

    Args:
        description: the robot.
        layout: of its inertia parameters.
        kept: which parameters are not eliminated.
        purpose: what is wanted: motor forces, tau_s, or nothing but the rows of J_a.

    Raises:
        InputError: a planar leg whose plane is in no link frame a coordinate plane.
    """
    plans = []
    geometry = geometry_symbols(description)
    n = layout.bodies
    for index in range(len(description.legs)):
        leg_joints = range(*layout.leg_slice(index).indices(layout.size))
        inertia = cs.vertcat(
            *(cs.SX.sym(f"p{k}") if kept[i] else cs.SX(0.0) for k, i in enumerate(leg_joints))
        )
        joints = cs.SX.sym("q", n)
        leg = leg_model(description, index, joints, geometry, inertia, cs.SX.zeros(3, n))
        key = (purpose, _structure(description, index, leg_joints, kept))
        if key not in _FOUND:
            _FOUND[key] = _search(leg, purpose)
        plans.append(_FOUND[key])
    return tuple(plans)


def robot_projection(
    description: RobotDescription, purpose: Purpose, state: Sequence[cs.SX], q: cs.SX, **how: Any
) -> Projection:
    """The equations with the numbers of the robot; see :func:`robot_arguments`."""
    layout = inertia_layout(description)
    plans = choose_plans(description, layout, [True] * layout.size, purpose)
    return Projection(description, layout, plans, robot_arguments(description, state, q, **how))


def _structure(description: RobotDescription, index: int, joints: Sequence[int], kept: Sequence[bool]) -> str:
    leg = description.legs[index]
    shape = [
        (row.sigma, *(entry if isinstance(entry, float) else "?" for entry in row.entries))
        for row in leg.rows[: leg.n + 1]
    ]
    base = [(axis, angle if isinstance(angle, float) else "?") for axis, angle in leg.base_rotation]
    driven = [joint for owner, joint in description.actuated if owner == index]
    return repr((shape, base, driven, description.position_rows, [bool(kept[i]) for i in joints]))


def _search(leg: LegModel, purpose: Purpose) -> LegPlan:
    """Best frame, then best change from base to coupling point, then the rest, each by counting."""
    known: dict[LegPlan, int] = {}

    def cost(plan: LegPlan) -> int:
        if plan not in known:
            known[plan] = _cost(leg, plan, purpose)
        return known[plan]

    frames = [frame for frame in range(1, leg.size + 1) if _fits(leg, frame)]
    if not frames:
        leg_jacobian(leg, leg.size)
    best = min((LegPlan(frame, leg.size) for frame in frames), key=cost)
    tips = [dataclasses.replace(best, tip=tip) for tip in range(1, leg.size + 2)]
    best = min(tips, key=cost)
    best = min((dataclasses.replace(best, frame=frame) for frame in frames), key=cost)
    if purpose == "motors" and can_inject(leg):
        best = min(best, dataclasses.replace(best, inject=True), key=cost)
    return best


def _fits(leg: LegModel, frame: int) -> bool:
    try:
        leg_jacobian(leg, frame)
    except InputError:
        return False
    return True


def _cost(leg: LegModel, plan: LegPlan, purpose: Purpose) -> int:
    velocity, acceleration, gravity = cs.SX.sym("v", 3), cs.SX.sym("a", 3), cs.SX.sym("g", 3)
    moved = [[one[k] if k in leg.axes else cs.SX(0.0) for k in range(3)] for one in (velocity, acceleration)]
    coupled = CouplingLeg(leg, plan)
    coupled.move(moved[0], moved[1], [gravity[k] for k in range(3)])
    if purpose == "rows":
        rows = [coupled.row(joint) for joint in leg.actuated]
        out = [row[k] for row in rows for k in leg.axes] or [cs.SX(0.0)]
    elif purpose == "motors" and len(leg.actuated) == 1:
        driven = coupled.driven()
        vectors = (driven.force, driven.direction)
        out = [v[k] for v in vectors for k in leg.axes] + [driven.effort, driven.lever]
    else:
        out = [coupled.force()[k] for k in leg.axes]
    expression = cs.vertcat(*out)
    return count_operations(tidy(cs.Function("leg", cs.symvar(expression), [expression]))).weighted
