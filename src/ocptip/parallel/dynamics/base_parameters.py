"""Base parameters of a parallel robot: leg by leg in closed form, and those of the whole robot by numbers.

Leg by leg by the rules of Gautier and Khalil: what a joint cannot tell apart moves to the body before it. Of
a revolute joint that is a body of revolution about its axis, of a prismatic joint the whole inertia tensor.

Of the whole robot the regressor of the generalised force is stacked over closed configurations of the robot;
its rank is the number of base parameters. Equal legs show one parameter less than leg by leg: a point mass at
the end of all legs cannot be separated from platform mass.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import casadi as cs
import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, SolverError, finite_array, positive_number
from ocptip.parallel.analysis.singularity import characteristic_length, require_regular
from ocptip.parallel.description.frames import moved_inertia, row_frame
from ocptip.parallel.description.platform import BodyInertia
from ocptip.parallel.description.robot_description import FIXED, PRISMATIC, REVOLUTE, MDHRow, RobotDescription
from ocptip.parallel.dynamics.terms import regressor
from ocptip.parallel.kinematics.platform import Kinematics
from ocptip.parallel.symbolic.leg_dynamics import LegPlan
from ocptip.parallel.symbolic.projection import Arguments, Projection
from ocptip.parallel.symbolic.symbols import InertiaLayout, geometry_symbols, inertia_layout, inertia_values

_XX, _YY, _MZ, _M = 0, 3, 8, 9


@dataclass(frozen=True, eq=False)
class LegBaseParameters:
    """Base parameters by the leg-wise closed form, in the order of the inertia layout.

    Attributes:
        kept: of all parameters of the layout, which are base parameters.
        names: of those kept, each the name of the parameter into which others were grouped.
        values: of those kept.
        full: (layout.size,) the same values with zeros where eliminated: a DynPar 2 vector with equal motor
            forces.
    """

    kept: tuple[bool, ...]
    names: tuple[str, ...]
    values: np.ndarray
    full: np.ndarray


def leg_base_parameters(description: RobotDescription) -> LegBaseParameters:
    """Group the parameters of every leg from its coupling point to the base, in closed form.

    Raises:
        InputError: a robot without the coupling form.
    """
    layout = inertia_layout(description)
    values = inertia_values(description)
    kept = np.zeros(layout.size, dtype=bool)
    for group in layout.groups:
        leg = description.legs[group[0]]
        section = layout.leg_slice(group[0])
        table = values[section].reshape(leg.n, 10)
        sliding = [row.sigma == PRISMATIC for row in leg.rows[: leg.n]]
        keep = regroup(table, sliding, lambda j, body, rows=leg.rows: transform_inertia(rows[j]) @ body)
        values[section], kept[section] = table.ravel(), keep.ravel()
    kept[layout.platform_slice] = True
    kept &= _effective(description, layout, kept)
    names = np.array(layout.names())
    full = np.where(kept, values, 0.0)
    return LegBaseParameters(tuple(kept.tolist()), tuple(names[kept].tolist()), values[kept], full)


def regroup(
    table: np.ndarray, sliding: Sequence[bool], move: Callable[[int, np.ndarray], np.ndarray], last: int = 0
) -> np.ndarray:
    """Move what joints cannot tell apart to the body before, in place; which entries (n, 10) are left.

    Args:
        table: (n, 10), XX .. M of the bodies of a chain about their frames.
        sliding: per joint.
        move: (j, parameters) -> those of a body given in frame j, expressed in the frame before.
        last: joint up to which bodies give something away; that of joint 0 is lost.
    """
    keep = np.ones(table.shape, dtype=bool)
    for j in range(len(table) - 1, last - 1, -1):
        moved = np.zeros(10)
        if sliding[j]:
            moved[:6] = table[j, :6]
            keep[j, :6] = False
        else:
            # A body of revolution about the joint's axis looks the same at every angle.
            moved[[_XX, _YY]] = table[j, _YY]
            moved[[_MZ, _M]] = table[j, [_MZ, _M]]
            keep[j, [_YY, _MZ, _M]] = False
        table[j] -= moved
        if j:
            table[j - 1] += move(j, moved)
    return keep


def transform_inertia(row: MDHRow) -> np.ndarray:
    """(10, 10) parameters of a body given in frame j, expressed in frame a(j), at joint variable zero."""
    still = replace(row, sigma=FIXED, r=0.0 if row.sigma == PRISMATIC else row.r)
    frame = row_frame(still)
    moved = (moved_inertia(BodyInertia.from_vector(unit), frame).vector for unit in np.eye(10))
    return np.column_stack(list(moved))


def _effective(description: RobotDescription, layout: InertiaLayout, kept: np.ndarray) -> np.ndarray:
    """Which parameters occur in the generalised force at all."""
    m, n, legs = description.platform.m, layout.bodies, len(description.legs)
    inertia = cs.SX.sym("inertia", layout.size)
    state, q, gravity = cs.SX.sym("z", m, 3), cs.SX.sym("q", n, legs), cs.SX.sym("gravity", 3)
    full = cs.vertcat(*(inertia[k] if kept[k] else cs.SX(0.0) for k in range(layout.size)))
    geometry = geometry_symbols(description)
    pose, rates, accelerations = cs.horzsplit(state)
    arguments = Arguments(pose, rates, accelerations, q, full, gravity, geometry=geometry)
    force = cs.SX()
    for frame in range(n, 0, -1):
        try:
            projection = Projection(description, layout, [LegPlan(frame, n)] * legs, arguments)
        except InputError:
            if frame == 1:
                raise
            continue
        force = projection.generalized_force()
        break
    return np.array(cs.which_depends(force, inertia, 1, False))


@dataclass(frozen=True, eq=False)
class NumericBaseParameters:
    """Base parameters of the whole robot from a stacked regressor, p_base = p_1 + K p_2.

    Attributes:
        names: of p_1, each the name of the parameter into which others were grouped.
        independent: indices (in the inertia layout) of p_1.
        dependent: indices of p_2, whose columns are combinations of those of p_1.
        without_effect: indices of columns that are zero.
        grouping: K, (len(independent), len(dependent)).
        singular_values: of the scaled regressor, largest first.
        gap: decades between the smallest singular value that counts and the largest that does not.
        residual: largest relative difference between W p and W_1 p_base over the stacked rows.
    """

    names: tuple[str, ...]
    independent: tuple[int, ...]
    dependent: tuple[int, ...]
    without_effect: tuple[int, ...]
    grouping: np.ndarray
    singular_values: np.ndarray
    gap: float
    residual: float

    @property
    def rank(self) -> int:
        """Number of base parameters."""
        return len(self.independent)

    @property
    def size(self) -> int:
        """Number of all parameters (DynPar 2)."""
        return self.rank + len(self.dependent) + len(self.without_effect)

    @property
    def matrix(self) -> np.ndarray:
        """(rank, size): p_base = matrix p, from DynPar 2 to the whole robot's DynPar 3."""
        matrix = np.zeros((self.rank, self.size))
        matrix[:, list(self.independent)] = np.eye(self.rank)
        matrix[:, list(self.dependent)] = self.grouping
        return matrix

    def values(self, parameters: ArrayLike) -> np.ndarray:
        """(rank,) base parameters of a parameter vector in the order of the layout."""
        return self.matrix @ finite_array("parameters", parameters, (self.size,))

    def function(self) -> cs.Function:
        """`base_parameters`: `p` (size,) to `p_base` (rank,), for C code beside generated functions."""
        p = cs.SX.sym("p", self.size)
        return cs.Function("base_parameters", [p], [cs.sparsify(cs.DM(self.matrix)) @ p], ["p"], ["p_base"])


_ROWS_PER_COLUMN = 3
_PATIENCE = 20
Block = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Regressor (m, size) of tau_s at z, s', s''."""

_SPREADS = tuple(0.3 / 2**k for k in range(6))


def numeric_base_parameters(
    description: RobotDescription,
    *,
    seed: int = 0,
    spread: float | None = None,
    tolerance: float = 1e-9,
) -> NumericBaseParameters:
    """Base parameters of the robot from random closed configurations around its home pose.

    Args:
        description: the robot.
        seed: of the configurations.
        spread: their half width around home: rotations in rad, translations relative to the characteristic
            length. Default 0.3, halved until most of the poses are reached and regular.
        tolerance: see :func:`rank_parameters`.

    Raises:
        SolverError: too few of the configurations can be reached or are regular.
    """
    regressor = stacked_regressor(description, seed=seed, spread=spread)
    complete = has_complete_regressor(description)
    values = inertia_values(description, complete=complete)
    return rank_parameters(
        regressor, values, inertia_layout(description, complete=complete), tolerance=tolerance
    )


def has_complete_regressor(description: RobotDescription) -> bool:
    """True if bodies behind the coupling points take part."""
    tails = [body for leg in description.legs if leg.serial for body in leg.bodies[leg.n :]]
    return not description.coupling_form or not all(body.massless for body in tails)


def stacked_regressor(
    description: RobotDescription, *, seed: int = 0, spread: float | None = None
) -> np.ndarray:
    """(rows, layout.size) regressor of tau_s over random closed configurations, each scaled to norm 1.

    Args, raises: see :func:`numeric_base_parameters`.
    """
    kinematics = Kinematics(description)
    block, size = _block(kinematics)
    if spread is not None:
        return _stacked(kinematics, block, size, seed, positive_number("spread", spread))
    for width in _SPREADS[:-1]:
        with suppress(SolverError):
            return _stacked(kinematics, block, size, seed, width)
    return _stacked(kinematics, block, size, seed, _SPREADS[-1])


def _block(kinematics: Kinematics) -> tuple[Block, int]:
    """Regressor of any robot, in numbers; columns of legs that share parameters are added."""
    description = kinematics.description
    complete = has_complete_regressor(description)
    layout = inertia_layout(description, complete=complete)
    start = [leg.home for leg in kinematics.legs]
    find = partial(kinematics.joints, guess=start, search=False) if complete else kinematics.point_joints
    columns: list[int] = []  # of the layout, and which of the numeric regressor they get
    taken: list[int] = []
    bodies = 0
    for i, leg in enumerate(description.legs):
        count = 10 * (len(leg.bodies) if complete else min(len(leg.bodies), layout.bodies))
        first = layout.leg_slice(i).start
        columns += range(first, first + count)
        taken += range(bodies, bodies + count)
        bodies += 10 * len(leg.bodies)
    columns += range(layout.size - 10, layout.size)
    taken += range(bodies, bodies + 10)

    def block(z: np.ndarray, rates: np.ndarray, accelerations: np.ndarray) -> np.ndarray:
        q = find(z).q
        require_regular(kinematics, z, q, complete=complete, legs_only=True)
        motion = kinematics.motion(z, rates, q, complete=complete)
        W = np.zeros((kinematics.m, layout.size))
        given = regressor(kinematics, motion, accelerations, description.gravity)
        np.add.at(W.T, columns, given.T[taken])
        return W

    return block, layout.size


def _stacked(kinematics: Kinematics, make: Block, size: int, seed: int, spread: float) -> np.ndarray:
    description = kinematics.description
    rng = np.random.default_rng(seed)
    m = description.m
    length = characteristic_length(kinematics)
    lengths = [name.startswith("phi") for name in description.platform.coordinates]
    lengths += [
        description.legs[leg].joint_rows[joint].sigma == REVOLUTE for leg, joint in description.redundant
    ]
    width = spread * np.where(lengths, 1.0, length)
    wanted = -(-_ROWS_PER_COLUMN * size // m)
    blocks: list[np.ndarray] = []
    missed = 0
    while len(blocks) < wanted and missed < _PATIENCE + 5 * len(blocks):
        z = description.home + width * rng.uniform(-1, 1, m)
        rates, accelerations = rng.uniform(-2, 2, (2, m))
        try:
            block = make(z, rates, 5 * accelerations)
        except (InputError, SolverError):
            missed += 1
            continue
        blocks.append(block / np.linalg.norm(block))
    if len(blocks) < wanted:
        raise SolverError(
            f"{description.name}: only {len(blocks)} of {wanted} random poses within {spread:.2g} of home can"
            " be reached and are regular; reduce the spread"
        )
    return np.vstack(blocks)


def rank_parameters(
    regressor: ArrayLike, parameters: ArrayLike, layout: InertiaLayout, *, tolerance: float = 1e-9
) -> NumericBaseParameters:
    """Base parameters from a regressor stacked over closed configurations.

    Args:
        regressor: (rows, layout.size) with W p = forces; use many more rows than columns.
        parameters: (layout.size,) of the robot, for the residual.
        layout: order of the columns.
        tolerance: columns and singular values below it, relative to the largest, count as zero.

    Raises:
        InputError: wrong shape, or fewer rows than columns.
    """
    stacked = finite_array("regressor", regressor, (None, layout.size))
    p = finite_array("parameters", parameters, (layout.size,))
    if len(stacked) < layout.size:
        raise InputError(f"regressor: needs at least {layout.size} rows, got {len(stacked)}")
    norms = np.linalg.norm(stacked, axis=0)
    with_effect = np.flatnonzero(norms > tolerance * norms.max())
    scaled = stacked[:, with_effect] / norms[with_effect]
    singular = np.linalg.svd(scaled, compute_uv=False)
    rank = int(np.count_nonzero(singular > tolerance * singular[0]))
    independent = _preferred(scaled, with_effect, layout, rank, tolerance)
    dependent = [k for k in with_effect if k not in set(independent)]
    grouping = np.linalg.lstsq(stacked[:, independent], stacked[:, dependent], rcond=None)[0]
    grouping[np.abs(grouping) < 1e-10 * max(1.0, np.abs(grouping).max(initial=0.0))] = 0.0
    forces = stacked @ p
    base = p[independent] + grouping @ p[dependent]
    residual = np.abs(stacked[:, independent] @ base - forces).max() / max(np.abs(forces).max(), 1e-300)
    below = singular[rank] if rank < len(singular) else 0.0
    gap = float(np.log10(singular[rank - 1] / below)) if below > 0 else float("inf")
    without = tuple(int(k) for k in np.flatnonzero(norms <= tolerance * norms.max()))
    names = layout.names()
    return NumericBaseParameters(
        tuple(names[k] for k in independent),
        tuple(int(k) for k in independent),
        tuple(int(k) for k in dependent),
        without,
        grouping,
        singular,
        gap,
        residual,
    )


def _preferred(
    scaled: np.ndarray, columns: np.ndarray, layout: InertiaLayout, rank: int, tolerance: float
) -> list[int]:
    """Independent columns, greedily: platform first, then masses and first moments, then bodies far along the
    leg.
    """
    order = sorted(range(len(columns)), key=lambda k: _preference(int(columns[k]), layout))
    basis = np.zeros((len(scaled), 0))
    chosen: list[int] = []
    for k in order:
        rest = scaled[:, k] - basis @ (basis.T @ scaled[:, k])
        rest -= basis @ (basis.T @ rest)
        norm = np.linalg.norm(rest)
        if norm > np.sqrt(tolerance) and len(chosen) < rank:
            basis = np.column_stack([basis, rest / norm])
            chosen.append(k)
    if len(chosen) < rank:
        chosen = list(np.asarray(scipy.linalg.qr(scaled, mode="economic", pivoting=True)[-1])[:rank])
    return sorted(int(columns[k]) for k in chosen)


def _preference(index: int, layout: InertiaLayout) -> tuple[int, int, int]:
    on_platform = index >= layout.size - 10
    body = layout.bodies if on_platform else index // 10 % layout.bodies
    return 0 if on_platform else 1, 0 if index % 10 >= 6 else 1, -body
