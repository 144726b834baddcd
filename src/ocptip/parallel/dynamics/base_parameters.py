"""Base parameters of a whole parallel robot, by numbers.

The regressor of the generalised force is stacked over closed configurations of the robot; its rank is the
number of base parameters. Equal legs show one parameter less than leg by leg: a point mass at the end of all
legs cannot be separated from platform mass.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, SolverError, finite_array, positive_number
from ocptip.numerics.batch import PointFunction
from ocptip.parallel.analysis.singularity import characteristic_length, require_regular
from ocptip.parallel.code.complete import complete_joints, newton_function
from ocptip.parallel.description.robot_description import REVOLUTE, RobotDescription
from ocptip.parallel.dynamics.terms import regressor
from ocptip.parallel.kinematics.leg_solver import CLOSURE_TOLERANCE
from ocptip.parallel.kinematics.platform import Kinematics
from ocptip.parallel.symbolic.base_parameters import NumericBaseParameters
from ocptip.parallel.symbolic.complete_legs import complete_obstacle
from ocptip.parallel.symbolic.symbols import InertiaLayout, inertia_layout, inertia_values

_ROWS_PER_COLUMN = 3
_NEWTON = 10  # steps from home to a random pose
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
    find = _joints_from_home(kinematics) if complete else lambda z: kinematics.point_joints(z).q
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
        q = find(z)
        require_regular(kinematics, z, q, complete=complete, legs_only=True)
        motion = kinematics.motion(z, rates, q, complete=complete)
        W = np.zeros((kinematics.m, layout.size))
        given = regressor(kinematics, motion, accelerations, description.gravity)
        np.add.at(W.T, columns, given.T[taken])
        return W

    return block, layout.size


def _joints_from_home(kinematics: Kinematics) -> Callable[[np.ndarray], Sequence[np.ndarray]]:
    """Joint positions in any assembly near home; InputError where the legs do not close."""
    start = [leg.home for leg in kinematics.legs]
    if complete_obstacle(kinematics.description):
        return lambda z: kinematics.joints(z, start).q
    newton = PointFunction(newton_function(kinematics, _NEWTON))
    home = complete_joints(kinematics, kinematics.description.home, start)
    ends = np.cumsum([leg.n for leg in kinematics.legs])

    def find(z: np.ndarray) -> Sequence[np.ndarray]:
        q, residual = newton(z, home)
        if not residual[0] < CLOSURE_TOLERANCE:
            raise InputError(f"pose: not reached from home: closure error {residual[0]:.2g}")
        return np.split(q, ends)[: len(ends)]

    return find


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
