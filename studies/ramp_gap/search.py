"""Search for free-form motions: continuation in the power maps, refinement of the grid, check of the result.

Limits the motion does not come near (slip, torque, collision pairs) are left out until the check on a dense
grid finds them broken; GN and GT are tightened where they are broken between nodes.

The power maps jump where a joint turns. First they are blended over speeds of +-eps with tanh(speed / eps),
eps falling (continuation); then every joint gets a fixed sign of speed in every interval, those of the
blended solution, and the exact maps hold throughout. A joint at rest may take the cheaper side of its map: it
creeps in that direction, by less than 0.01 degrees per second.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ocptip.contact.solver import solve_many
from ocptip.standing.arm import Robot
from ocptip.trajectories.trajectory import Trajectory
from studies.ramp_gap.free_form import LIMIT, NODES, WEIGHTS, FreeForm, tipping_moments
from studies.ramp_gap.free_motion import FreeMotion, minimum_jerk, sampled, via_motion, with_triangles

SMOOTHING = (0.2, 0.05, 0.0125)  # eps, rad/s
DENSE_STEP = 1e-3  # s
MARGIN = 1e-5  # of GN and GT at the nodes, for Ipopt's tolerance
ROUNDS = 6  # of solve, check, add what is broken


def exact_energy(robot: Robot, motion: FreeMotion, resting: float = 0.0) -> float:
    """Electric energy, J: exact power maps, eight Gauss nodes between interval ends and turning points.

    Args:
        robot: with the power maps.
        motion: of its arm.
        resting: rad/s; a slower joint counts as at rest, where the maps are read for positive direction.
    """
    ends = motion.h * np.arange(len(motion.middles) + 1)
    edges = np.unique(np.concatenate([ends, motion.turning_points()]))
    x, w = np.polynomial.legendre.leggauss(8)
    half, middle = np.diff(edges) / 2, (edges[1:] + edges[:-1]) / 2
    times = (middle[:, None] + half[:, None] * x).ravel()
    _, v, _ = states = motion.states(times)
    torques, _ = robot.loads(*states)
    direction = np.where(v < -resting, -1.0, 1.0)
    return float((half[:, None] * w).ravel() @ robot.motors.power(torques, v, direction).sum(axis=1))


@dataclass(frozen=True)
class Worst:
    """Worst values of a motion on a dense grid, both ends of every interval included.

    Attributes:
        GN, GT: reserves.
        moment: smallest moment about a tipping axis, as share of M0; negative: it tips.
        torque, speed, acceleration: as shares of their limits.
        clearance: m.
        touched: labels of collision pairs that meet.
        standing: all contact states are solved and persist.
    """

    GN: float
    GT: float
    moment: float
    torque: float
    speed: float
    acceleration: float
    clearance: float
    touched: tuple[str, ...]
    standing: bool

    @property
    def kept(self) -> bool:
        """All limits hold, to 1e-6."""
        ratios = max(self.GN / LIMIT, self.GT / LIMIT, self.torque, self.speed, self.acceleration)
        return self.standing and ratios <= 1 + 1e-6 and self.clearance >= -1e-6


def dense_check(robot: Robot, motion: FreeMotion, step: float = DENSE_STEP) -> Worst:
    """Evaluate a motion every `step` seconds with the library's own functions."""
    x = np.linspace(0, 1, max(2, int(np.ceil(motion.h / step)) + 1))
    q, v, a = (values.reshape(-1, robot.arm.n) for values in motion.inside(x))
    torques, wrenches = robot.loads(q, v, a)
    states = solve_many(robot.support, wrenches)
    slip = robot.slip.evaluate(states, derivatives=False)
    gaps = robot.collision.gaps(q)
    limits = robot.arm.limits
    A, b = tipping_moments(robot)
    touched = [str(robot.collision.labels[k]) for k in np.flatnonzero((gaps < 0).any(axis=0))]
    return Worst(
        GN=float(np.nan_to_num(robot.tip_over.evaluate(states).GN, nan=np.inf).max()),
        GT=float(np.nan_to_num(slip.GT, nan=np.inf).max()),
        moment=float(np.min(wrenches @ A.T + b) / robot.tip_over.reference_moment),
        torque=float(np.max(np.abs(torques) / limits.torque)),
        speed=float(np.max(np.abs(v) / limits.speed)),
        acceleration=float(np.max(np.abs(a) / limits.acceleration)),
        clearance=float(gaps.min(initial=np.inf)),
        touched=tuple(touched),
        standing=bool(np.all(states.persistent & states.solved & slip.solved)),
    )


def cheaper_signs(robot: Robot, motion: FreeMotion) -> np.ndarray:
    """Signs of speed (N, n): those of the motion, and where a joint nearly rests the one that costs less."""
    q, v, a = motion.inside(NODES)
    shape, n = q.shape, robot.arm.n
    torque, _ = robot.loads(*(x.reshape(-1, n) for x in (q, v, a)))
    rest, ones = np.zeros_like(torque), np.ones_like(torque)
    costs = [
        np.einsum("k,ikj->ij", WEIGHTS, robot.motors.power(torque, rest, side * ones).reshape(shape))
        for side in (1.0, -1.0)
    ]
    rests = np.abs(np.diff(motion.angles, axis=0)) < SMOOTHING[-1] * motion.h
    return np.where(rests, np.where(costs[0] <= costs[1], 1.0, -1.0), motion.signs)


class Search:
    """Free-form motions of one case on one base, from several starts and on finer and finer grids.

    Args:
        robot: arm, base, limits.
        start, goal: (n,), rad.
        passive: joints on passive ramps.
        iterations: of Ipopt, at most, per solve.
        active: limits to include from the beginning, see `FreeForm`; grows as limits turn out to be broken.
    """

    def __init__(
        self,
        robot: Robot,
        start: np.ndarray,
        goal: np.ndarray,
        *,
        passive: tuple[int, ...] = (),
        iterations: int = 250,
        active: frozenset[str] = frozenset(),
    ) -> None:
        self.robot, self.start, self.goal, self.passive = robot, start, goal, passive
        self.iterations, self.active = iterations, active
        self._problems: dict[tuple[int, frozenset[str]], FreeForm] = {}

    def problem(self, intervals: int) -> FreeForm:
        """The problem on a grid with the limits found active so far."""
        key = intervals, self.active
        if key not in self._problems:
            self._problems[key] = FreeForm(
                self.robot, self.start, self.goal, intervals, self.active, self.passive, self.iterations
            )
        return self._problems[key]

    def from_guess(self, guess: FreeMotion) -> Found | None:
        """Continuation in eps, then signs fixed; None without success."""
        motion = with_triangles(guess, self.passive)
        for eps in SMOOTHING:
            motion, _ = self.problem(len(motion.middles)).solve(motion, eps=eps)
        return self._exact(motion)

    def refine(self, found: Found) -> Found | None:
        """The optimum on twice as many intervals: the better of the old signs and of newly blended ones."""
        finer = found.motion.refined()
        kept = self._exact(finer, np.repeat(found.signs, 2, axis=0))
        blended, _ = self.problem(len(finer.middles)).solve(finer, eps=SMOOTHING[-1])
        both = [candidate for candidate in (kept, self._exact(blended)) if candidate]
        return min(both, key=lambda candidate: candidate.energy, default=None)

    def _exact(self, guess: FreeMotion, signs: np.ndarray | None = None) -> Found | None:
        """Solve with fixed signs until the dense check is passed and signs at rest are the cheaper ones."""
        best, GN, GT = None, LIMIT - MARGIN, LIMIT - MARGIN
        signs = cheaper_signs(self.robot, guess) if signs is None else signs
        motion = guess
        for _ in range(ROUNDS):
            problem = self.problem(len(guess.middles))
            motion, report = problem.solve(motion, signs=signs, GN=GN, GT=GT)
            if not report["success"]:
                break
            worst = dense_check(self.robot, motion)
            if not worst.kept:
                self.active |= broken(worst)
                if worst.GN > LIMIT:
                    GN = 1 / (1 / GN + 1.2 * (1 / LIMIT - 1 - worst.moment) + 1e-3)
                if problem.slips:
                    GT -= 1.2 * max(0.0, worst.GT - LIMIT + MARGIN)
                continue
            energy = exact_energy(self.robot, motion)
            if best is None or energy < best.energy - 1e-3:
                best = Found(motion, signs, energy, worst)
            better = cheaper_signs(self.robot, motion)
            if np.array_equal(better, signs):
                break
            signs = better
        return best


@dataclass(frozen=True, eq=False)
class Found:
    """A verified motion, the signs of its speeds (N, n), its exact energy (J) and worst values."""

    motion: FreeMotion
    signs: np.ndarray
    energy: float
    worst: Worst


def broken(worst: Worst) -> frozenset[str]:
    """Names of limits to include because a motion breaks them."""
    names = {"slip": worst.GT > LIMIT, "torque": worst.torque > 1}
    return frozenset(name for name, is_broken in names.items() if is_broken) | frozenset(worst.touched)


@dataclass(frozen=True)
class Options:
    """What a result depends on, besides versions and the ramp plan.

    Attributes:
        grids: numbers of intervals, each twice the one before.
        randoms: number of random detours among the starts.
        seed: of these.
        iterations: of Ipopt, at most, per solve.
        wrists: whether the problem with passive joints 4 to 6 is solved, too.
    """

    grids: tuple[int, ...] = (20, 40, 80)
    randoms: int = 3
    seed: int = 0
    iterations: int = 250
    wrists: bool = True


def starts_of(
    reference: Trajectory, plan: Trajectory | None, goal: np.ndarray, options: Options
) -> dict[str, FreeMotion]:
    """Guesses on the coarsest grid by name."""
    N, start, T = options.grids[0], reference.start, reference.end
    rng = np.random.default_rng(options.seed)
    guesses = {} if plan is None else {"ramp plan": sampled(plan, N)}
    guesses["reference"] = sampled(reference, N)
    for factor in (0.8, 1.5):
        guesses[f"minimum jerk {factor:g} T"] = minimum_jerk(start, goal, factor * T, N)
    for count in range(1, options.randoms + 1):
        detour = rng.uniform(-0.6, 0.6, len(start))
        guesses[f"random {count}"] = via_motion(start, goal, detour, rng.uniform(0.7, 2.0) * T, N)
    return guesses


def climb(
    search: Search, guesses: dict[str, FreeMotion], options: Options, say: Callable[[str], None]
) -> tuple[list[dict], Found | None, Found | None]:
    """Solve from all guesses, and go on with the better half on each finer grid.

    Returns:
        One record per start and grid, the best motion, the best on the coarsest grid.
    """
    records: list[dict] = []
    going: dict[str, Found | None] = dict.fromkeys(guesses)
    best, coarse = None, None
    for N in options.grids:
        results: dict[str, Found] = {}
        for name, before in going.items():
            begin = time.process_time()
            found = search.from_guess(guesses[name]) if before is None else search.refine(before)
            record = {"start": name, "intervals": N, "cpu_s": time.process_time() - begin}
            record["energy_J"] = found.energy if found else None
            record["duration_s"] = found.motion.duration if found else None
            records.append(record)
            say(f"grid {N}, {name}: " + (f"{found.energy:.2f} J" if found else "no solution"))
            if found:
                results[name] = found
        ranking = sorted(results, key=lambda name: results[name].energy)
        if ranking and (best is None or results[ranking[0]].energy < best.energy):
            best = results[ranking[0]]
        coarse = coarse or best
        going = {name: results[name] for name in ranking[: max(1, len(guesses) // 2)]}
        guesses = {name: guesses[name] for name in going}
    return records, best, coarse
