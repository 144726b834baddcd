"""Closed-form inverse kinematics of the five well-known leg types, up to the coupling point.

A leg is recognised by the structure of its table. Branch signs (`Leg.branch`) choose among the solutions:

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

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.parallel.description.robot_description import (
    PRISMATIC,
    REVOLUTE,
    Leg,
    MDHRow,
    Parameter,
    right_angles,
    value_of,
)

_ROUNDING = 1e-14

SIGNS = {"RRR": 1, "RPR": 1, "PRRR": 1, "RUU": 2, "UPS": 2}
"""Number of branch signs by leg type."""


def leg_type(leg: Leg) -> str | None:
    """Name of the leg's type, or None if its table has no closed form here."""
    if not isinstance(leg, Leg):
        return None
    shape = tuple(_row_shape(row) for row in leg.rows[: leg.n + 1])
    return _TYPES.get(shape)


def closed_form(leg: Leg, target: np.ndarray, branch: Sequence[int] = ()) -> np.ndarray | None:
    """Joint values that put the coupling point at a target.

    Args:
        leg: the leg.
        target: (3,), m, leg base axes, from the base frame's origin.
        branch: signs; empty: those of the leg, or all positive.

    Returns:
        (n,), or None if there is no closed form or the target is out of reach.

    Raises:
        InputError: wrong number of branch signs.
    """
    kind = leg_type(leg)
    if kind is None:
        return None
    signs = tuple(branch) or leg.branch or (1,) * SIGNS[kind]
    if len(signs) != SIGNS[kind]:
        raise InputError(f"branch: a leg of type {kind} has {SIGNS[kind]} branch signs, got {signs!r}")
    q = _SOLVERS[kind](leg, target, signs)
    return None if q is None else np.array(q)


def nearest_branch(leg: Leg, target: np.ndarray, q: np.ndarray) -> tuple[int, ...]:
    """Branch signs of the closed-form solution nearest to given joint values (n,); angles modulo 2 pi.

    Raises:
        InputError: there is no closed form, or the target is out of reach.
    """
    kind = leg_type(leg)
    found: list[tuple[float, tuple[int, ...]]] = []
    for signs in itertools.product((1, -1), repeat=SIGNS.get(kind, 0)):
        solution = closed_form(leg, target, signs)
        if solution is not None:
            turns = [row.sigma == REVOLUTE for row in leg.rows[: leg.n]]
            error = np.where(turns, np.remainder(solution - q + np.pi, 2 * np.pi) - np.pi, solution - q)
            found.append((float(np.abs(error).max()), signs))
    if not found:
        raise InputError(f"branch: no closed-form solution for the target {np.asarray(target).tolist()}")
    return min(found)[1]


def _rrr(leg: Leg, target: np.ndarray, signs: tuple[int, ...]) -> list[float] | None:
    return _two_links(target[0], target[1], _length(leg, 1), _length(leg, 2), signs[0])


def _prrr(leg: Leg, target: np.ndarray, signs: tuple[int, ...]) -> list[float] | None:
    arm = _two_links(target[0], target[1], _length(leg, 2), _length(leg, 3), signs[0])
    return None if arm is None else [target[2], *arm]


def _rpr(leg: Leg, target: np.ndarray, signs: tuple[int, ...]) -> list[float] | None:
    r = signs[0] * math.hypot(target[0], target[1])
    return None if r == 0 else [math.atan2(target[0] / r, -target[1] / r), r]


def _ups(leg: Leg, target: np.ndarray, signs: tuple[int, ...]) -> list[float] | None:
    r = signs[0] * float(np.linalg.norm(target))
    if r == 0:
        return None
    u = target / r
    s2 = signs[1] * math.hypot(u[0], u[1])
    q1 = math.atan2(u[1] / s2, u[0] / s2) if s2 else 0.0
    return [q1, math.atan2(s2, -u[2]), r]


def _ruu(leg: Leg, target: np.ndarray, signs: tuple[int, ...]) -> list[float] | None:
    s3 = target[2] / _length(leg, 3)
    if abs(s3) > 1 + _ROUNDING:
        return None
    s3 = max(-1.0, min(1.0, s3))
    q3 = math.asin(s3) if signs[0] > 0 else math.pi - math.asin(s3)
    arm = _two_links(target[0], target[1], _length(leg, 1), _length(leg, 3) * math.cos(q3), signs[1])
    return None if arm is None else [*arm, q3]


def _two_links(x: float, y: float, l1: float, l2: float, sign: int) -> list[float] | None:
    cosine = (x * x + y * y - l1 * l1 - l2 * l2) / (2 * l1 * l2) if l1 * l2 else math.inf
    if abs(cosine) > 1 + _ROUNDING:
        return None
    cosine = max(-1.0, min(1.0, cosine))
    q2 = sign * math.acos(cosine)
    q1 = math.atan2(y, x) - math.atan2(l2 * math.sin(q2), l1 + l2 * cosine)
    return [math.remainder(q1, 2 * math.pi), q2]


def _length(leg: Leg, row: int) -> float:
    return value_of(leg.rows[row].d)


def _row_shape(row: MDHRow) -> tuple[int, int, bool] | None:
    """Joint type, quarter turns of alpha and whether there is a d; None if anything else is not zero."""
    others = (row.gamma, row.b, row.theta, row.r)
    if any(isinstance(v, Parameter) or v != 0 for v in others) or right_angles(row.alpha) is None:
        return None
    return row.sigma, right_angles(row.alpha), isinstance(row.d, Parameter) or row.d != 0


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
_SOLVERS: dict[str, Callable[[Leg, np.ndarray, tuple[int, ...]], list[float] | None]] = {
    "RRR": _rrr,
    "RPR": _rpr,
    "PRRR": _prrr,
    "RUU": _ruu,
    "UPS": _ups,
}
