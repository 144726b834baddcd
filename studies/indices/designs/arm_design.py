"""Pose-independent indices of arms: best poses, statistics, characteristic length, isotropic axes.

An index over all poses compares arms: by its largest value (for 1/CDN_OE: fix the ellipsoid from the task and
prefer the arm with the largest maximum), or by mean and percentiles over the joint space. The maxima come
from Ipopt with matrix inequalities, exact also where eigenvalues meet, from the best of many samples; that is
a search, no proof of global optimality. Source: [Naw07] 3.1 (definition 3.1) and 3.4.1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as cs
import numpy as np
from scipy.optimize import least_squares

from ocptip.basics.errors import InputError, SolverError, whole_number
from ocptip.basics.write import Record
from ocptip.indices.arms.axes import arm_pose
from ocptip.indices.arms.operation import operation_indices
from ocptip.indices.arms.values import DEFAULT_ELLIPSOID, index_values
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.reviewed import inv_cdn_cl
from ocptip.numerics.ipopt import SOLVED, nlpsol
from ocptip.numerics.threads import one_thread
from ocptip.robots.model import ArmModel
from studies.indices.designs.arm_forms import DesignArm
from studies.indices.designs.encodings import psd_constraint

MAXIMISED = ("inv_cdn_oe", "pi_oe", "manipulability")
"""Indices with a largest value; DM_inf and DM_2 are infinite in some pose of every arm."""

_SAMPLES = 2000
_AGREEMENT = 1e-4
_IPOPT = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False, "ipopt.max_iter": 500}
_LOG_LENGTH_RANGE = np.log(1e3)
_LEAST_EIGENVALUE = 1e-12
_ISOTROPY_DEFECT = 1e-9


@dataclass(frozen=True, eq=False)
class BestArmPose(Record):
    """The largest value of an index that a search found.

    Attributes:
        name: of the index.
        value: its value at `q`, evaluated anew.
        q: (n,), rad, within the joint limits.
        sampled: largest value among the random samples, where the search started.
        starts: number of optimisations.
        agreeing: starts that came within 1e-4 (relative) of the value: one of many is little evidence.
        seed: of the samples.
    """

    name: str
    value: float
    q: np.ndarray
    sampled: float
    starts: int
    agreeing: int
    seed: int


@one_thread
def best_arm_pose(
    model: ArmModel,
    name: str,
    *,
    ellipsoid: OperationEllipsoid | None = None,
    starts: int = 12,
    seed: int = 0,
) -> BestArmPose:
    """Search the pose within the joint limits in which an index is largest.

    Args:
        model: arm of six axes (n >= 6 for "inv_cdn_oe").
        name: one of `MAXIMISED`.
        ellipsoid: operation ellipsoid in the gripper frame; default as in `rate_arm`.
        starts: optimisations, from the best of 2000 random poses.
        seed: of these.

    Raises:
        InputError: unknown name, or an arm the index is not defined for.
        SolverError: no optimisation improved on the samples.
    """
    if name not in MAXIMISED:
        raise InputError(f"name: can maximise {', '.join(MAXIMISED)}, got {name!r}")
    ellipsoid = DEFAULT_ELLIPSOID if ellipsoid is None else ellipsoid
    samples = random_poses(model, _SAMPLES, seed)
    values = index_values(model, samples, ellipsoid=ellipsoid, names=[name])[name]
    order = np.argsort(values)[::-1][: whole_number("starts", starts, 1)]
    arm, found, searches = DesignArm.of(model), [], {}
    for start in samples[order]:
        aspect = arm.sign_at(start) if name == "manipulability" else 0
        if aspect not in searches:
            searches[aspect] = _search(arm, name, ellipsoid, aspect)
        q = searches[aspect].run(start)
        if q is not None:
            found.append((float(index_values(model, q, ellipsoid=ellipsoid, names=[name])[name]), q))
    sampled = float(values[order[0]])
    if not found or max(value for value, _ in found) < sampled:
        raise SolverError(
            f"best pose: none of {len(order)} starts improved on the samples' {name} = {sampled:.6g}"
        )
    value, q = max(found, key=lambda pair: pair[0])
    agreeing = sum(other >= value * (1 - _AGREEMENT) for other, _ in found)
    return BestArmPose(name, value, q, sampled, len(order), agreeing, seed)


@dataclass(frozen=True, eq=False)
class CharacteristicLength(Record):
    """The length and the pose in which the condition number about an operation point is smallest.

    Attributes:
        length: CL, m; the operation sphere of radius CL sqrt(3/2) is its geometric meaning.
        inv_cdn_cl: 1/CDN_CL at `q` with this length.
        q: (n,), rad.
        starts, agreeing, seed: as in `BestArmPose`.
    """

    length: float
    inv_cdn_cl: float
    q: np.ndarray
    starts: int
    agreeing: int
    seed: int


@one_thread
def characteristic_length(
    model: ArmModel, *, point: object = (0.0, 0.0, 0.0), starts: int = 12, seed: int = 0
) -> CharacteristicLength:
    """The classical characteristic length of an arm: minimise CDN_CL over poses and length (definition 3.1).

    The new reading asks for no search: choose the operation sphere, and take its
    `OperationEllipsoid.characteristic_length`.

    Args:
        model: arm of n >= 6 axes.
        point: (3,), m: operation point in the gripper frame.
        starts, seed: as in :func:`best_arm_pose`.

    Raises:
        InputError: bad point or arm.
        SolverError: no optimisation converged.
    """
    samples = random_poses(model, _SAMPLES, seed)
    poses = arm_pose(model, samples)
    reach = float(np.linalg.norm(poses.position - poses.position.mean(axis=0), axis=1).max())
    sphere = OperationEllipsoid.sphere(reach / 3.0, point)
    values = index_values(model, samples, ellipsoid=sphere, names=["inv_cdn_oe"])["inv_cdn_oe"]
    order = np.argsort(values)[::-1][: whole_number("starts", starts, 1)]
    arm, logarithm = DesignArm.of(model), cs.SX.sym("log_radius")
    radius = float(sphere.half_axes[0]) * cs.exp(logarithm)
    speeds = cs.vertcat(2 * radius, 2 * radius, 2 * radius, *[np.sqrt(6.0)] * 3)
    lower, upper = joint_range(model)
    search = _eigenvalue_search(
        cs.vertcat(arm.q, logarithm),
        _normalised(arm.velocities(sphere, speeds)),
        np.append(lower, -_LOG_LENGTH_RANGE),
        np.append(upper, _LOG_LENGTH_RANGE),
        ceiling=True,
    )
    found = []
    for start in samples[order]:
        full = search.run(np.append(start, 0.0))
        if full is None:
            continue
        q, length = full[: model.n], float(sphere.characteristic_length * np.exp(full[model.n]))
        pose = arm_pose(model, q)
        center = pose.rotation @ sphere.center + pose.position
        found.append((float(inv_cdn_cl(pose.jacobian, center, length)), q, length))
    if not found:
        raise SolverError(f"characteristic length: none of {len(order)} starts converged")
    value, q, length = max(found, key=lambda entry: entry[0])
    agreeing = sum(entry[0] >= value * (1 - _AGREEMENT) for entry in found)
    return CharacteristicLength(length, value, q, len(order), agreeing, seed)


@dataclass(frozen=True, eq=False)
class WorkspaceIndex(Record):
    """An index over random poses, uniform in the joint angles within their limits.

    Attributes:
        name: of the index.
        minimum, mean, median, maximum: over the samples.
        percentiles: percent to value.
        best, worst: (n,), rad, poses of maximum and minimum.
        samples, seed: number and seed of the poses.
    """

    name: str
    minimum: float
    mean: float
    median: float
    maximum: float
    percentiles: dict[float, float]
    best: np.ndarray
    worst: np.ndarray
    samples: int
    seed: int

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        percentiles = {f"{key:g}": value for key, value in self.percentiles.items()}
        return {**super().to_dict(), "percentiles": percentiles}


@one_thread
def workspace_index(
    model: ArmModel,
    name: str,
    *,
    ellipsoid: OperationEllipsoid | None = None,
    samples: int = 10_000,
    percentiles: Sequence[float] = (5, 25, 75, 95),
    seed: int = 0,
) -> WorkspaceIndex:
    """Minimum, mean and percentiles of an index over the joint space (section 10).

    Args:
        model: the arm; joints without limits turn once.
        name: one of `ARM_INDICES` but sigma.
        ellipsoid: as in `rate_arm`.
        samples: number of random poses.
        percentiles: percent.
        seed: of the poses.

    Raises:
        InputError: unknown name, or the index is not defined for this arm.
    """
    poses = random_poses(model, whole_number("samples", samples, 1), seed)
    values = index_values(model, poses, ellipsoid=ellipsoid, names=[name])[name]
    if np.isnan(values).any():
        raise InputError(f"name: {name} is not defined for {model.name}; `rate_arm` says why")
    levels = {float(p): float(np.percentile(values, p)) for p in percentiles}
    return WorkspaceIndex(
        name,
        float(values.min()),
        float(values.mean()),
        float(np.median(values)),
        float(values.max()),
        levels,
        poses[np.argmax(values)],
        poses[np.argmin(values)],
        samples,
        seed,
    )


def isotropic_axes(ellipsoid: OperationEllipsoid, *, seed: int = 0, tries: int = 20) -> np.ndarray:
    """Six axes that are isotropic with respect to an ellipsoid: 1/CDN_OE = PI_OE = 1.

    This is one of infinitely many solutions of Z = c identity, picked by a random start. Any order of the
    axes is isotropic, too; `arm_from_spears` makes an arm of them.

    Args:
        ellipsoid: in the base frame, here the pose of the end-effector.
        seed: of the random starts; other seeds give other arms.
        tries: random starts at most.

    Returns:
        (6, 6), rows are spears.

    Raises:
        SolverError: no try was isotropic to 1e-9.
    """
    rng = np.random.default_rng(seed)
    factor = ellipsoid.factor()
    # trace(J J') over the directions is 6 and J J' = c inv(W): this fixes c.
    constant = 6.0 / np.trace(np.linalg.inv(factor.T @ factor)[:3, :3])
    size = float(np.sqrt(ellipsoid.half_axes @ ellipsoid.half_axes / 3.0))
    upper = np.triu_indices(6)

    def spears(x: np.ndarray) -> np.ndarray:
        points, directions = np.split(x.reshape(6, 6), 2, axis=1)
        unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        return np.hstack([unit, np.cross(ellipsoid.center + size * points, unit)])

    def residual(x: np.ndarray) -> np.ndarray:
        velocities = factor @ spears(x).T
        return (velocities @ velocities.T / constant - np.eye(6))[upper]

    for _ in range(tries):
        found = least_squares(residual, rng.normal(size=36), xtol=1e-15, ftol=1e-15, gtol=1e-15)
        lines = spears(found.x)
        if 1.0 - operation_indices(lines.T, ellipsoid).inv_cdn_oe < _ISOTROPY_DEFECT:
            return lines
    raise SolverError(f"isotropic axes: no solution from {tries} starts; try another seed")


@dataclass(frozen=True, eq=False)
class _Search:
    """A maximisation over joint angles and further variables, to be run from many starts.

    Attributes:
        solver: Ipopt on the program.
        start: start values of all variables from those kept.
        kept: how many leading variables are results: joint angles, and what was added to them.
        bounds: lbx, ubx, lbg, ubg.
    """

    solver: cs.Function
    start: Callable[[np.ndarray], np.ndarray]
    kept: int
    bounds: dict[str, np.ndarray]

    def run(self, kept: np.ndarray) -> np.ndarray | None:
        """A local maximum near the given start, or None if Ipopt did not converge."""
        result = self.solver(x0=self.start(kept), **self.bounds)
        if self.solver.stats()["return_status"] not in SOLVED:
            return None
        return np.clip(np.array(result["x"]).ravel(), self.bounds["lbx"], self.bounds["ubx"])[: self.kept]


def _search(arm: DesignArm, name: str, ellipsoid: OperationEllipsoid, aspect: int) -> _Search:
    lower, upper = joint_range(arm.model)
    if name == "manipulability":
        objective = aspect * arm.determinant
        solver = nlpsol({"x": arm.q, "f": -objective}, _IPOPT)
        return _Search(solver, lambda start: start, arm.model.n, {"lbx": lower, "ubx": upper})
    velocities = arm.velocities(ellipsoid)
    if name == "pi_oe":
        matrix = velocities.T @ velocities / arm.design_constant(ellipsoid)
        return _eigenvalue_search(arm.q, matrix, lower, upper, ceiling=False)
    return _eigenvalue_search(arm.q, _normalised(velocities), lower, upper, ceiling=True)


def _normalised(velocities: cs.SX) -> cs.SX:
    return velocities @ velocities.T / (cs.sumsqr(velocities) / 6.0)


def _eigenvalue_search(
    variables: cs.SX, matrix: cs.SX, lower: np.ndarray, upper: np.ndarray, *, ceiling: bool
) -> _Search:
    """Maximise the smallest eigenvalue, or its ratio to the largest one, of a matrix of some variables."""
    unit = cs.SX(cs.DM.eye(6))
    levels = cs.SX.sym("log_levels", 2 if ceiling else 1)
    blocks = [psd_constraint(matrix - cs.exp(levels[0]) * unit, name="low")]
    if ceiling:
        blocks.append(psd_constraint(cs.exp(levels[1]) * unit - matrix, name="high"))
    numeric = cs.Function("matrix", [variables], [cs.densify(matrix)])

    def start(kept: np.ndarray) -> np.ndarray:
        value = np.array(numeric(kept))
        values = np.linalg.eigvalsh(value)
        ends = [0.99 * values[0], 1.01 * values[-1]] if ceiling else [0.99 * values[0]]
        guesses = [blocks[0].guess(value - ends[0] * np.eye(6))]
        if ceiling:
            guesses.append(blocks[1].guess(ends[1] * np.eye(6) - value))
        return np.concatenate([kept, np.log(np.maximum(ends, _LEAST_EIGENVALUE)), *guesses])

    auxiliary = cs.vertcat(*[block.variables for block in blocks])
    free = np.full(auxiliary.numel(), np.inf)
    range_of_levels = np.full(levels.numel(), -np.log(_LEAST_EIGENVALUE))
    objective = levels[0] - levels[1] if ceiling else levels[0]
    problem = {
        "x": cs.vertcat(variables, levels, auxiliary),
        "f": -objective,
        "g": cs.vertcat(*[block.g for block in blocks]),
    }
    bounds = {
        "lbx": np.concatenate([lower, -range_of_levels, -free]),
        "ubx": np.concatenate([upper, range_of_levels, free]),
        "lbg": np.concatenate([block.lower for block in blocks]),
        "ubg": np.concatenate([block.upper for block in blocks]),
    }
    return _Search(nlpsol(problem, _IPOPT), start, variables.numel(), bounds)


def joint_range(model: ArmModel) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper joint angles (n,), rad; one turn for joints without limits."""
    limits = model.limits
    endless = ~(np.isfinite(limits.angle_min) & np.isfinite(limits.angle_max))
    return np.where(endless, -np.pi, limits.angle_min), np.where(endless, np.pi, limits.angle_max)


def random_poses(model: ArmModel, count: int, seed: int) -> np.ndarray:
    """(count, n), rad, uniform within the joint limits."""
    return np.random.default_rng(seed).uniform(*joint_range(model), (count, model.n))
