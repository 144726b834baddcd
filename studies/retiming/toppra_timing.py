"""A path timed by toppra, with limits of speed and acceleration, and with rows of our limits if asked for."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import toppra
from toppra.constraint import DiscretizationType, JointAccelerationConstraint, JointVelocityConstraint
from toppra.constraint.linear_constraint import LinearConstraint, canlinear_colloc_to_interpolate

from ocptip.basics.errors import OcptipError
from ocptip.retiming.rows import Places, TimingLimits
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.path import JointPath
from ocptip.trajectories.trajectory import Trajectory

toppra.setup_logging("ERROR")


class Geometry(toppra.interpolator.AbstractGeometricPath):
    """A path as toppra takes it."""

    def __init__(self, path: JointPath) -> None:
        self._path = path

    def __call__(self, s: Any, order: int = 0) -> np.ndarray:
        return self._path.at(np.clip(s, 0.0, 1.0))[order]

    @property
    def dof(self) -> int:
        return self._path.joints

    @property
    def path_interval(self) -> np.ndarray:
        return np.array([0.0, 1.0])

    @property
    def waypoints(self) -> None:
        return None


class Rows(LinearConstraint):
    """Half planes alpha u + beta x <= gamma at the nodes: of limits; without, of motors' speeds alone."""

    def __init__(self, robot: StandingMechanism, path: JointPath, limits: Limits | None) -> None:
        super().__init__()
        self._own, self._timing = (robot, path), limits and TimingLimits(robot, limits)
        self.set_discretization_type(DiscretizationType.Interpolation)
        self.identical = False
        self.dof = path.joints

    def compute_constraint_params(self, path: Geometry, gridpoints: np.ndarray) -> Any:
        places = Places.of(*self._own, gridpoints, np.zeros(len(gridpoints), dtype=bool))
        one = np.ones((len(gridpoints), 1))
        alpha, beta, gamma = 0 * one, one / places.caps[:, None], one
        if self._timing:
            planes = self._timing.half_planes(places)
            parts = (planes.alpha, planes.beta, planes.gamma)
            alpha, beta, gamma = (np.hstack(pair) for pair in zip((alpha, beta, gamma), parts, strict=True))
        rows = alpha.shape[1]
        one = np.tile(np.eye(rows), (len(gridpoints), 1, 1))
        params = alpha, beta, -gamma, one, np.zeros((len(gridpoints), rows)), None, None
        return canlinear_colloc_to_interpolate(*params, gridpoints=gridpoints)


def by_toppra(
    robot: StandingMechanism, path: JointPath, nodes: np.ndarray, limits: Limits | None = None
) -> tuple[Trajectory, float]:
    """The timing and the seconds it took, set-up included; with rows of these limits, if there are any.

    Speeds of motors that are not at the joints are limited, too.
    """
    more = (Rows(robot, path, limits),) if limits or robot.further_limits.count else ()
    own, begun = robot.limits, time.perf_counter()
    speed = JointVelocityConstraint(np.column_stack([-own.speed, own.speed]))
    acceleration = JointAccelerationConstraint(
        np.column_stack([-own.acceleration, own.acceleration]),
        discretization_scheme=DiscretizationType.Interpolation,
    )
    solver = toppra.algorithm.TOPPRA(
        [speed, acceleration, *more], Geometry(path), gridpoints=nodes, solver_wrapper="seidel"
    )
    rates = solver.compute_parameterization(0.0, 0.0)[1]
    seconds = time.perf_counter() - begun
    if rates is None or not np.all(np.isfinite(rates)):
        raise OcptipError("toppra: no timing")
    return Trajectory.from_path(path, nodes, np.maximum(rates, 0.0) ** 2), seconds
