"""Speeds of points of an arm: its TCP, and the origins of its joints' frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError, positive_number
from ocptip.basics.text import did_you_mean
from ocptip.numerics.batch import BatchFunction
from ocptip.robots.kinematics import chain
from ocptip.robots.model import ArmModel

TCP = "tcp"
_STILL = 1e-12  # (m/s)^2 below the root, so that a point at rest has derivatives


def checked_points(arm: ArmModel, limits: Mapping[str, float] | None) -> dict[str, float]:
    """Speed limits of points by name, m/s: `TCP`, or a joint, where its link begins.

    Raises:
        InputError: there is no such joint, or a value is not above 0.
    """
    found, joints = {}, joint_names(arm)
    for name, value in (limits or {}).items():
        if name not in (TCP, *joints):
            known = f"there are {', '.join(joints)}{did_you_mean(name, joints)}"
            raise InputError(f"no joint {name!r}; {known}", "speed_limits")
        found[name] = positive_number(f"speed_limits.{name}", value)
    return found


class PointSpeeds:
    """Speeds of some points of an arm.

    Args:
        arm: whose.
        points: names, see `checked_points`.
    """

    def __init__(self, arm: ArmModel, points: Iterable[str]) -> None:
        self._arm, self._points = arm, tuple(points)

    @cached_property
    def _function(self) -> BatchFunction:
        q, qd = cs.SX.sym("q", self._arm.n), cs.SX.sym("qd", self._arm.n)
        places = dict(zip((*joint_names(self._arm), TCP), chain(self._arm, q)[1], strict=True))
        velocities = [cs.jtimes(places[name], q, qd) for name in self._points]
        speeds = cs.vertcat(*(cs.sqrt(cs.sumsqr(velocity) + _STILL) for velocity in velocities))
        return BatchFunction(cs.Function("point_speeds", [q, qd], [speeds]))

    def __call__(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """(N, k), m/s, at joint values and speeds (N, n)."""
        return self._function(q, qd)[0] if self._points else np.empty((len(q), 0))

    def expressions(self, q: cs.SX, qd: cs.SX) -> cs.SX:
        """Speeds of the points as CasADi column (k,), m/s."""
        return self._function.function(q, qd) if self._points else cs.SX(0, 1)


def joint_names(arm: ArmModel) -> tuple[str, ...]:
    """Names of all joints, one per link."""
    return arm.joint_names if arm.coupling is None else arm.coupling.names
