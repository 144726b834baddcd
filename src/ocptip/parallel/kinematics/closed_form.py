"""Closed-form inverse kinematics of the five well-known leg types, up to the coupling point.

The formulas are written once, for scalars: numbers or CasADi expressions. A target out of reach is refused in
numbers. In expressions it is no error, so that an optimiser may step there and return: the cosine or sine
concerned is cut near +-1, and the leg's measures, which are not cut, are negative there.

A leg is recognised by the structure of its table. Signs (`SerialLeg.branch`) choose an IK solution:

===== =========================================== ======================================
leg   joints                                      signs
===== =========================================== ======================================
RRR   two-link arm in the plane                   sign of q2 (elbow)
RPR   polar coordinates                           sign of q2
PRRR  height, then two-link arm                   sign of q3 (elbow)
RUU   out-of-plane angle, then two-link arm       sign of cos q3, sign of q2 (elbow)
UPS   spherical coordinates                       sign of q3, sign of q2
===== =========================================== ======================================
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError
from ocptip.numerics.vectors import nearest_turn
from ocptip.parallel.description.platform import Entry, Parameter, right_angles, value_of
from ocptip.parallel.description.robot_description import PRISMATIC, REVOLUTE, LegBase, MDHRow

Scalar = Any

_ROUNDING = 1e-14
_CUT = 1.0 - 1e-7
_SMALL = 1e-14  # m^2: keeps square roots differentiable at the origin

SIGNS = {"RRR": 1, "RPR": 1, "PRRR": 1, "RUU": 2, "UPS": 2}
"""Number of signs by leg type."""


def leg_type(leg: LegBase) -> str | None:
    """Name of the leg's type, or None if its table has no closed form here."""
    if not leg.serial:
        return None
    shape = tuple(_row_shape(row) for row in leg.rows[: leg.point_joints + 1])
    return _TYPES.get(shape)


@dataclass(frozen=True, eq=False)
class LegSolution:
    """Joint values of a leg, and how far it is from its singular poses (type I).

    Attributes:
        q: (n,) joint values.
        measures: squared sines of angles by name, at most 1: 0 in a singular pose, negative out of reach.
            RRR, PRRR: between the links ("elbow"); RUU: likewise, and between the rod and the normal of the
            arm's plane ("rod"); UPS: between the leg and its first axis ("swing"); RPR: none.
        lengths: (k,), m: of prismatic legs, 0 in a singular pose.
    """

    q: list[Scalar]
    measures: dict[str, Scalar]
    lengths: list[Scalar]


def leg_solution(
    leg: LegBase,
    target: Sequence[Scalar],
    branch: Sequence[int] = (),
    length_of: Callable[[Entry], Scalar] = value_of,
) -> LegSolution:
    """Joint values that put the coupling point at a target.

    Args:
        leg: the leg.
        target: three numbers or CasADi scalars, m, leg base axes, from the base frame's origin.
        branch: signs; empty: those of the leg, or all positive.
        length_of: what an entry of the table stands for; default its number.

    Raises:
        InputError: there is no closed form, the number of signs is wrong, or a numeric target is out of
            reach.
    """
    kind = leg_type(leg)
    if kind is None:
        raise InputError(f"leg: its table has no closed-form inverse kinematics ({', '.join(SIGNS)} have)")
    signs = tuple(branch) or leg.branch or (1,) * SIGNS[kind]
    if len(signs) != SIGNS[kind]:
        raise InputError(f"branch: a leg of type {kind} has {SIGNS[kind]} signs, got {signs!r}")
    return _SOLVERS[kind]([length_of(row.d) for row in leg.rows], target, signs)


def closed_form(leg: LegBase, target: np.ndarray, branch: Sequence[int] = ()) -> np.ndarray | None:
    """Joint values (n,) of :func:`leg_solution`; None without a closed form or for a target out of reach.

    Raises:
        InputError: wrong number of signs.
    """
    if leg_type(leg) is None:
        return None
    try:
        return np.array(leg_solution(leg, target.tolist(), branch).q)
    except _OutOfReachError:
        return None


def nearest_branch(leg: LegBase, target: np.ndarray, q: np.ndarray) -> tuple[int, ...]:
    """Signs of the closed-form solution nearest to given joint values (n,); angles modulo 2 pi.

    Raises:
        InputError: there is no closed form, or the target is out of reach.
    """
    kind = leg_type(leg)
    results: list[tuple[float, tuple[int, ...]]] = []
    for signs in itertools.product((1, -1), repeat=SIGNS.get(kind or "", 0)):
        solution = closed_form(leg, target, signs)
        if solution is not None:
            turns = [row.sigma == REVOLUTE for row in leg.rows[: leg.point_joints]]
            error = np.where(turns, nearest_turn(solution - q), solution - q)
            results.append((float(np.abs(error).max()), signs))
    if not results:
        raise InputError(f"branch: no closed-form solution for the target {np.asarray(target).tolist()}")
    return min(results)[1]


def _rrr(d: Sequence[Scalar], target: Sequence[Scalar], signs: tuple[int, ...]) -> LegSolution:
    q, bend = _two_links(target[0], target[1], d[1], d[2], signs[0])
    return LegSolution(q, {"elbow": bend}, [])


def _prrr(d: Sequence[Scalar], target: Sequence[Scalar], signs: tuple[int, ...]) -> LegSolution:
    q, bend = _two_links(target[0], target[1], d[2], d[3], signs[0])
    return LegSolution([target[2], *q], {"elbow": bend}, [])


def _rpr(_: Sequence[Scalar], target: Sequence[Scalar], signs: tuple[int, ...]) -> LegSolution:
    length = _root(target[0] ** 2 + target[1] ** 2)
    _require_not_zero(length)
    r = signs[0] * length
    return LegSolution([_of(r).atan2(target[0] / r, -target[1] / r), r], {}, [length])


def _ups(_: Sequence[Scalar], target: Sequence[Scalar], signs: tuple[int, ...]) -> LegSolution:
    length = _root(target[0] ** 2 + target[1] ** 2 + target[2] ** 2)
    _require_not_zero(length)
    r = signs[0] * length
    x, y, z = (value / r for value in target)
    tilt = x**2 + y**2
    s2, lib = signs[1] * _root(tilt), _of(tilt)
    q1 = 0.0 if _is_zero(s2) else lib.atan2(y / s2, x / s2)
    return LegSolution([q1, lib.atan2(s2, -z), r], {"swing": tilt}, [length])


def _ruu(d: Sequence[Scalar], target: Sequence[Scalar], signs: tuple[int, ...]) -> LegSolution:
    rod = d[3]
    s3 = target[2] / rod
    cut = _cut(s3)
    q3 = _of(cut).asin(cut) if signs[0] > 0 else math.pi - _of(cut).asin(cut)
    across = signs[0] * rod * _other_leg(cut)
    q, bend = _two_links(target[0], target[1], d[1], across, signs[1])
    return LegSolution([*q, q3], {"elbow": bend, "rod": 1 - s3**2}, [])


def _two_links(x: Scalar, y: Scalar, l1: Scalar, l2: Scalar, sign: int) -> tuple[list[Scalar], Scalar]:
    """q1, q2, and sin(q2)^2."""
    _require_not_zero(l1 * l2)
    cosine = (x * x + y * y - l1 * l1 - l2 * l2) / (2 * l1 * l2)
    cut, lib = _cut(cosine), _of(cosine)
    q2 = sign * lib.acos(cut)
    q1 = lib.atan2(y, x) - lib.atan2(sign * l2 * _other_leg(cut), l1 + l2 * cut)
    return [q1 if lib is cs else math.remainder(q1, math.tau), q2], 1 - cosine**2


class _OutOfReachError(InputError):
    """Numbers only."""


def _of(value: Scalar) -> Any:
    """The library of a scalar's functions."""
    return cs if isinstance(value, cs.SX) else math


def _root(value: Scalar) -> Scalar:
    """Square root of m^2, differentiable at 0."""
    return cs.sqrt(value + _SMALL) if isinstance(value, cs.SX) else math.sqrt(value)


def _other_leg(ratio: Scalar) -> Scalar:
    """sqrt(1 - ratio^2): sine of a cosine's angle in 0..pi, cosine of a sine's in -pi/2..pi/2."""
    if isinstance(ratio, cs.SX):
        return cs.sqrt(1 - ratio**2)
    return math.sqrt((1 - ratio) * (1 + ratio))


def _cut(value: Scalar) -> Scalar:
    """A sine or cosine within its range."""
    if isinstance(value, cs.SX):
        return cs.fmin(cs.fmax(value, -_CUT), _CUT)
    if abs(value) > 1 + _ROUNDING:
        raise _OutOfReachError(f"target: out of reach, a sine or cosine is {value:.6g}")
    return max(-1.0, min(1.0, value))


def _is_zero(value: Scalar) -> bool:
    return not isinstance(value, cs.SX) and value == 0


def _require_not_zero(value: Scalar) -> None:
    if _is_zero(value):
        raise _OutOfReachError("target: out of reach, or in a place that fixes no direction")


def _row_shape(row: MDHRow) -> tuple[int, int, bool] | None:
    """Joint type, quarter turns of alpha and whether there is a d; None if anything else is not zero."""
    others = (row.gamma, row.b, row.theta, row.r)
    quarters = right_angles(row.alpha)
    if any(isinstance(v, Parameter) or v != 0 for v in others) or quarters is None:
        return None
    return row.sigma, quarters, isinstance(row.d, Parameter) or row.d != 0


_R, _RD, _RA = (REVOLUTE, 0, False), (REVOLUTE, 0, True), (REVOLUTE, 1, False)
_P, _PA = (PRISMATIC, 0, False), (PRISMATIC, 1, False)
_TYPES = {
    (_R, _RD, _RD): "RRR",
    (_R, _PA, _RA): "RPR",
    (_R, _PA, _R): "RPR",
    (_P, _R, _RD, _RD): "PRRR",
    (_R, _RD, _RA, _RD): "RUU",
    (_R, _RA, _PA, _R): "UPS",
}
_SOLVERS: dict[str, Callable[[Sequence[Scalar], Sequence[Scalar], tuple[int, ...]], LegSolution]] = {
    "RRR": _rrr,
    "RPR": _rpr,
    "PRRR": _prrr,
    "RUU": _ruu,
    "UPS": _ups,
}
