"""Mobility of a closed mechanism from the rank of its closure equations, all joints included.

The position closures of a robot say nothing about orientations: a "Delta" whose first axes are all vertical
looks right there and has four degrees of freedom. So the closures of the complete legs decide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.write import Record
from ocptip.parallel.analysis.singularity import singular_everywhere
from ocptip.parallel.kinematics.closures import LegClosure
from ocptip.parallel.kinematics.leg_solver import LegSolver
from ocptip.parallel.kinematics.platform import Kinematics

_RANK = 1e-8
_POSES = 3
_STEP = 0.02
_SEED = 5


@dataclass(frozen=True, eq=False)
class Mobility(Record):
    """Degrees of freedom of a robot, computed numerically near its home pose.

    Attributes:
        dof: of the whole mechanism: joints and platform minus the rank of the closures.
        platform_dof: dimension of the platform's possible twists.
        internal_dof: motions of the legs with the platform at rest, idle freedoms not counted.
        idle: idle freedoms of the legs.
        coordinates: number of coordinates the description has.
        motors: number of motors.
        over_constraints: closure rows that are redundant.
        gap: smallest singular value counted divided by the largest one not counted.
        poses: number of checked poses; the numbers are those of the pose with minimum mobility.
        problems: what makes the robot unusable, in words; empty if nothing.
    """

    dof: int
    platform_dof: int
    internal_dof: int
    idle: int
    coordinates: int
    motors: int
    over_constraints: int
    gap: float
    poses: int
    problems: tuple[str, ...]

    @property
    def consistent(self) -> bool:
        """True if the mobility is that of the description: no problems."""
        return not self.problems


def mobility(kinematics: Kinematics) -> Mobility:
    """Count the degrees of freedom in the home pose and in poses near it.

    Problems are: a free coordinate that the complete legs do not allow, a pose nearby that they do not reach,
    a mobility that differs from the number of coordinates, motions of legs that nothing holds, few motors,
    and if there are none of these: that no pose is regular.

    Raises:
        InputError: not even the home pose can be assembled with all joints.
    """
    description = kinematics.description
    rng = np.random.default_rng(_SEED)
    results: list[tuple[int, int, int, int, float]] = []
    problems: list[str] = []
    worst = np.zeros(len(kinematics.legs))
    home = [leg.home for leg in kinematics.legs]
    for k in range(_POSES):
        try:
            z, q = _near(kinematics, home, rng.uniform(-1, 1, kinematics.m) if k else np.zeros(kinematics.m))
        except InputError as error:
            problems.append(f"no pose near home can be assembled with all joints: {error}")
            continue
        results.append(_counts(kinematics, z, q))
        motion = kinematics.motion(z, np.zeros(kinematics.m), q, complete=True)
        worst = np.maximum(worst, [leg.mismatch for leg in motion.legs])
    if not results:
        raise InputError(f"{description.name}: {problems[0]}")
    dof, platform, internal, surplus, gap = min(results)
    m, motors, idle = description.m, len(description.actuated), sum(leg.idle for leg in kinematics.legs)
    dof, internal = dof - idle, internal - idle
    blocked = np.flatnonzero(worst > 1e-6)
    if blocked.size:
        numbers, coordinates = ", ".join(str(i + 1) for i in blocked), description.platform.coordinates
        problems.append(
            f"leg {numbers} does not allow all of {', '.join(coordinates)}; name coordinates that the legs "
            f"force to move along as `dependent`{_at_home(kinematics.legs[blocked[0]])}"
        )
    if dof != m:
        problems.append(f"the mechanism has mobility {dof}, but {m} coordinates are described")
    if internal > len(description.redundant):
        problems.append(
            f"{internal} motions of the legs leave the platform at rest, but {len(description.redundant)} "
            "redundant joints are described; a leg that spins about itself says `idle = 1`"
        )
    problems += _driven_idlers(kinematics)
    if motors < dof:
        problems.append(f"{motors} motors cannot hold {dof} degrees of freedom")
    if not problems and (reason := singular_everywhere(kinematics)):
        problems.append(reason)
    return Mobility(
        dof, platform, internal, idle, m, motors, surplus, gap, len(results), tuple(dict.fromkeys(problems))
    )


def require_mobility(kinematics: Kinematics) -> Mobility:
    """Mobility of a robot, which must be that of its description.

    Raises:
        InputError: it does not; the message says why.
    """
    result = mobility(kinematics)
    if not result.consistent:
        raise InputError(f"{kinematics.description.name}: {'; '.join(result.problems)}")
    return result


def stacked_closures(legs: Sequence[LegClosure], q: Sequence[np.ndarray], R: np.ndarray) -> np.ndarray:
    """(rows, joints + 6) Jacobian of all closures with respect to joint rates and platform twist.

    Args:
        legs: of the robot.
        q: joint positions per leg.
        R: (3, 3) rotation of the platform.
    """
    blocks, starts = [], np.concatenate([[0], np.cumsum([leg.n for leg in legs])])
    for i, leg in enumerate(legs):
        J, _ = leg.jacobian(q[i])
        block = np.zeros((len(J), starts[-1] + 6))
        block[:, starts[i] : starts[i + 1]] = J
        block[:, -6:] = -leg.platform_side(R)
        blocks.append(block)
    return np.vstack(blocks)


def _driven_idlers(kinematics: Kinematics) -> list[str]:
    """Legs whose idle freedoms move one of their motors: that motor would not move the platform alone."""
    problems = []
    for leg in kinematics.legs:
        driven = [joint for leg_number, joint in kinematics.description.actuated if leg_number == leg.number]
        if leg.idle and np.abs(leg.idle_motions(leg.home)[driven]).max(initial=0.0) > 1e-6:
            problems.append(f"the idle freedom of leg {leg.number + 1} moves its motor")
    return problems


def _at_home(solver: LegSolver) -> str:
    """Another possible cause: angles of coupling joints that nobody gave."""
    leg = solver.leg
    given = not leg.serial or leg.couplings[0][1] is not None or len(leg.guess) == solver.n
    if given or not 1 <= solver.n - solver.point <= 2:
        return ""
    return (
        ", or give `end_rotation` or a `guess` of all joints: without them it is assumed how the joints "
        "behind the coupling points stand at home, and with that how they hold the platform"
    )


def _near(
    kinematics: Kinematics, home: list[np.ndarray], direction: np.ndarray
) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """A pose off home that the legs reach: home may lie close to the end of the workspace."""
    step = _STEP
    while True:
        z = kinematics.description.home + step * direction
        try:
            return z, kinematics.joints(z, home).q
        except InputError:
            step /= 4
            if step < _STEP / 1000:
                raise


def _counts(
    kinematics: Kinematics, z: np.ndarray, q: tuple[np.ndarray, ...]
) -> tuple[int, int, int, int, float]:
    """dof, platform dof, internal dof, redundant rows, gap of the singular values."""
    matrix = stacked_closures(kinematics.legs, q, kinematics.pose(z, q)[1])
    _, values, right = np.linalg.svd(matrix)
    rank, gap = _rank(values)
    dof = matrix.shape[1] - rank
    twists = right[rank:, -6:]
    platform, _ = _rank(np.linalg.svd(twists, compute_uv=False), 1.0) if dof else (0, np.inf)
    return dof, platform, dof - platform, matrix.shape[0] - rank, gap


def _rank(values: np.ndarray, scale: float | None = None) -> tuple[int, float]:
    threshold = _RANK * (values[0] if scale is None else scale)
    rank = int(np.sum(values > threshold))
    rest = values[rank:]
    gap = values[rank - 1] / rest[0] if rank and len(rest) and rest[0] > 0 else np.inf
    return rank, float(gap)
