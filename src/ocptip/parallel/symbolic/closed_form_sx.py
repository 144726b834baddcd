"""Closed-form inverse kinematics of :mod:`ocptip.parallel.kinematics.closed_form` as CasADi expressions.

Here a target that is out of reach is no error, so that an optimiser may step there and find its way back: the
cosine or sine concerned is cut near +-1, and the leg's measures, which are not cut, are negative there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as cs

from ocptip.basics.errors import InputError
from ocptip.parallel.description.robot_description import Leg, value_of
from ocptip.parallel.kinematics.closed_form import SIGNS, leg_type

_CUT = 1.0 - 1e-7
_SMALL = 1e-14  # m^2: keeps square roots differentiable at the origin


@dataclass(frozen=True, eq=False)
class LegExpression:
    """Joint values of a leg, and how far it is from its singular poses (type I).

    Attributes:
        q: (n,) joint values.
        measures: squared sines of angles by name, at most 1: 0 in a singular pose, negative out of reach.
            RRR, PRRR: between the links ("elbow"); RUU: likewise, and between the rod and the normal of the
            arm's plane ("rod"); UPS: between the leg and its first axis ("swing"); RPR: none.
        lengths: (k,), m: of prismatic legs, 0 in a singular pose.
    """

    q: list[cs.SX]
    measures: dict[str, cs.SX]
    lengths: list[cs.SX]


def closed_form_expression(leg: Leg, target: Sequence[cs.SX], branch: Sequence[int] = ()) -> LegExpression:
    """Joint values that put the coupling point at a target.

    Args:
        leg: the leg.
        target: three scalars, m, leg base axes, from the base frame's origin.
        branch: signs; empty: those of the leg, or all positive.

    Raises:
        InputError: there is no closed form, or the number of branch signs is wrong.
    """
    kind = leg_type(leg)
    if kind is None:
        raise InputError(f"leg: its table has no closed-form inverse kinematics ({', '.join(SIGNS)} have)")
    signs = tuple(branch) or leg.branch or (1,) * SIGNS[kind]
    if len(signs) != SIGNS[kind]:
        raise InputError(f"branch: a leg of type {kind} has {SIGNS[kind]} branch signs, got {signs!r}")
    return _SOLVERS[kind](leg, target, signs)


def _rrr(leg: Leg, target: Sequence[cs.SX], signs: tuple[int, ...]) -> LegExpression:
    q, bend = _two_links(target[0], target[1], _length(leg, 1), _length(leg, 2), signs[0])
    return LegExpression(q, {"elbow": bend}, [])


def _prrr(leg: Leg, target: Sequence[cs.SX], signs: tuple[int, ...]) -> LegExpression:
    q, bend = _two_links(target[0], target[1], _length(leg, 2), _length(leg, 3), signs[0])
    return LegExpression([target[2], *q], {"elbow": bend}, [])


def _rpr(_: Leg, target: Sequence[cs.SX], signs: tuple[int, ...]) -> LegExpression:
    length = cs.sqrt(target[0] ** 2 + target[1] ** 2 + _SMALL)
    r = signs[0] * length
    return LegExpression([cs.atan2(target[0] / r, -target[1] / r), r], {}, [length])


def _ups(_: Leg, target: Sequence[cs.SX], signs: tuple[int, ...]) -> LegExpression:
    length = cs.sqrt(target[0] ** 2 + target[1] ** 2 + target[2] ** 2 + _SMALL)
    r = signs[0] * length
    x, y, z = (value / r for value in target)
    tilt = x**2 + y**2
    s2 = signs[1] * cs.sqrt(tilt + _SMALL)
    return LegExpression([cs.atan2(y / s2, x / s2), cs.atan2(s2, -z), r], {"swing": tilt}, [length])


def _ruu(leg: Leg, target: Sequence[cs.SX], signs: tuple[int, ...]) -> LegExpression:
    rod = _length(leg, 3)
    s3 = target[2] / rod
    cut = _cut(s3)
    q3 = cs.asin(cut) if signs[0] > 0 else cs.pi - cs.asin(cut)
    across = signs[0] * rod * cs.sqrt(1 - cut**2)
    q, bend = _two_links(target[0], target[1], _length(leg, 1), across, signs[1])
    return LegExpression([*q, q3], {"elbow": bend, "rod": 1 - s3**2}, [])


def _two_links(x: cs.SX, y: cs.SX, l1: float, l2: cs.SX | float, sign: int) -> tuple[list[cs.SX], cs.SX]:
    """q1, q2, and sin(q2)^2."""
    cosine = (x * x + y * y - l1 * l1 - l2 * l2) / (2 * l1 * l2)
    cut = _cut(cosine)
    q2 = sign * cs.acos(cut)
    across = sign * l2 * cs.sqrt(1 - cut**2)
    return [cs.atan2(y, x) - cs.atan2(across, l1 + l2 * cut), q2], 1 - cosine**2


def _cut(value: cs.SX) -> cs.SX:
    return cs.fmin(cs.fmax(value, -_CUT), _CUT)


def _length(leg: Leg, row: int) -> float:
    return value_of(leg.rows[row].d)


_SOLVERS: dict[str, Callable[[Leg, Sequence[cs.SX], tuple[int, ...]], LegExpression]] = {
    "RRR": _rrr,
    "RPR": _rpr,
    "PRRR": _prrr,
    "RUU": _ruu,
    "UPS": _ups,
}
