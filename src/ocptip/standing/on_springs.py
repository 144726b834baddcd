"""A base with a moving mechanism on feet that give, to first order in the base's own motion.

With the twist xi of the base (of its centre of mass, base axes; zero where the springs are slack) and the
wrench w(t) of the mechanism on a base that rests,

    M xi'' + (B + C) xi' + (K + G) xi = w(t):

M is the inertia of base and mechanism, B what the joints' speeds add when the base turns, K and C are springs
and dampers of the feet, and G turns weight and spring forces with the base (without it a high mechanism
would stand too stiffly). In steps within which the joints hardly turn, all matrices are constant and w is a
cubic in time: the step is then a matrix exponential.

A foot presses until spring and damper would have to pull. It then carries nothing, its sole, which has
no mass, relaxes with the time c / k, and it comes down where base and sole meet the ground again, its
tangential springs slack. Friction does not limit the tangential springs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, expm

from ocptip.contact.elastic import ElasticFeet
from ocptip.numerics.vectors import skew
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.arm_motion import INSIDE
from ocptip.trajectories.sampled import Motion

LONGEST = 0.01  # s: steps of constant inertia
TURN = 0.05  # rad or m by which a joint moves in a step, at most
PER_PERIOD = 24  # instants per period of the highest frequency
MOST_SWITCHES = 500  # feet that lift and land
FALLEN = 0.02  # m: a foot that moves farther has left what is linear
_SHARES = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
_CUBIC = np.linalg.pinv(np.vander(_SHARES, 4, increasing=True)) * np.array([[1], [1], [2], [6]])
_SECANTS = 4


class Ride:
    """What a base feels of a motion, step by step, whatever it stands on.

    Args:
        robot: that `knows_inertia`.
        motion: of its joints.
        rest: s, how long to look on after the end.

    Attributes:
        lengths: (S,), s, of the steps.
        begins: (S,), s.
        inertia: (S, 6, 6), M.
        turning: (S, 6, 6), B.
        loads: (S, 4, 6): w and its derivatives at the beginning of each step.
        middle: (S, 6): w in the middle.
        start_inertia: (6, 6).
        events: (S,) True for steps that begin with an event.
    """

    def __init__(self, robot: StandingMechanism, motion: Motion, rest: float = 0.0) -> None:
        self.robot = robot
        fastest = float(np.max(motion.speed_peaks, initial=0.0))
        step = min(LONGEST, TURN / fastest if fastest > 0 else LONGEST)
        cuts = [
            np.linspace(a, b, max(1, int(np.ceil((b - a) / step))) + 1) for a, b in motion.intervals if b > a
        ]
        self.begins = np.concatenate([cut[:-1] for cut in cuts]) if cuts else np.empty(0)
        self.lengths = np.concatenate([np.diff(cut) for cut in cuts]) if cuts else np.empty(0)
        inside = np.minimum(INSIDE, 0.25 * self.lengths)
        times = self.begins[:, None] + self.lengths[:, None] * _SHARES
        times[:, 0] += inside
        times[:, -1] -= inside
        states = motion.states(times.ravel())
        wrenches = robot.loads(*states)[1].reshape(-1, len(_SHARES), 6)
        powers = self.lengths[:, None] ** np.arange(4)
        self.loads = np.einsum("ij,sjv->siv", _CUBIC, wrenches) / powers[:, :, None]
        self.middle = wrenches[:, 2]
        q, qd, _ = (values[2 :: len(_SHARES)] for values in states)
        if rest > 0:
            still = motion.goal[None]
            load = robot.loads(still, 0 * still, 0 * still)[1]
            self.begins, self.lengths = np.append(self.begins, motion.end), np.append(self.lengths, rest)
            self.loads = np.concatenate([self.loads, np.pad(load[None], ((0, 0), (0, 3), (0, 0)))])
            self.middle = np.vstack([self.middle, load])
            q, qd = np.vstack([q, still]), np.vstack([qd, 0 * still])
        self.inertia, turning = robot.inertia(q, qd)
        self.turning = np.concatenate([np.zeros_like(turning), turning], axis=2)
        begin = motion.start[None]
        self.start_inertia = robot.inertia(begin, 0 * begin)[0][0]
        self.start_load = robot.loads(begin, 0 * begin, 0 * begin)[1][0]

    def leaning(self, elastic: ElasticFeet) -> np.ndarray:
        """G (S, 6, 6): weight and spring forces that turn with the base."""
        support = self.robot.support
        forces = np.nan_to_num(elastic.share(self.middle).forces)
        forces = np.einsum("kij,skj->ski", support.frames, forces)
        G = np.zeros_like(self.inertia)
        G[:, :, 3:] = -self.inertia[:, :, :3] @ skew(support.gravity)
        turned = skew(forces)  # a force seen from the turned base: f x theta
        G[:, :3, 3:] -= turned.sum(axis=1)
        G[:, 3:, 3:] -= np.einsum("kij,skjl->sil", skew(support.arms), turned)
        return G


@dataclass(frozen=True, eq=False)
class Modes:
    """Of base and mechanism at the start, all feet pressing.

    Attributes:
        lowest, highest: natural frequencies, Hz.
        damping: ratio of the lowest mode.
        delays: (n,), s: damping over stiffness of each foot.
    """

    lowest: float
    highest: float
    damping: float
    delays: np.ndarray

    @classmethod
    def of(cls, elastic: ElasticFeet, inertia: np.ndarray) -> Modes:
        """With the inertia (6, 6) at the start."""
        squares = eigh(elastic.matrix(), inertia, eigvals_only=True)
        moving = squares[squares > 1e-9 * squares[-1]]
        low, high = np.sqrt(moving[0]), np.sqrt(moving[-1])
        delays = np.array([spring.delay + 2 * spring.ratio / low for spring in elastic.springs])
        inverse = np.linalg.inv(inertia)
        A = np.zeros((12, 12))
        A[:6, 6:] = np.eye(6)
        A[6:, :6], A[6:, 6:] = -inverse @ elastic.matrix(), -inverse @ elastic.matrix(factors=delays)
        roots = np.linalg.eigvals(A)
        roots = roots[np.abs(roots) > 1e-3 * low]
        slowest = roots[np.argmin(np.abs(np.abs(roots) - low))]
        return cls(low / (2 * np.pi), high / (2 * np.pi), float(-slowest.real / np.abs(slowest)), delays)


@dataclass(frozen=True, eq=False)
class Course:
    """How the base moves on its feet, at T instants.

    Attributes:
        times: (T,), s.
        twists, rates: (T, 6), m and rad, m/s and rad/s.
        forces: (T, n, 3), N, contact axes, on the base.
        gaps: (T, n), m, of soles that are lifted; else 0.
        lost: contact (from 0) and time of every foot that let go, also of those that came down at once.
        falls: the computation ended early, where a foot had moved by more than `FALLEN`.
    """

    times: np.ndarray
    twists: np.ndarray
    rates: np.ndarray
    forces: np.ndarray
    gaps: np.ndarray
    lost: tuple[tuple[int, float], ...]
    falls: bool


class Simulation:
    """Base and feet as piecewise linear systems.

    Args:
        ride: what moves it.
        elastic: the feet.
        modes: of both.
        one_sided: False: feet may pull, which is the linear theory.
    """

    def __init__(self, ride: Ride, elastic: ElasticFeet, modes: Modes, one_sided: bool = True) -> None:
        self._ride, self._elastic, self._modes, self._one_sided = ride, elastic, modes, one_sided
        n = len(modes.delays)
        self._W, self._D = elastic.W, elastic.stiffness
        self._leaning = ride.leaning(elastic)
        self._inverse = np.linalg.inv(ride.inertia)
        pressing, none = np.ones(n, dtype=bool), np.zeros((n, 3))
        systems = self._systems(slice(None), pressing, none)
        self._counts = np.maximum(1, np.ceil(ride.lengths * modes.highest * PER_PERIOD)).astype(int)
        self._steps = expm(systems * (ride.lengths / self._counts)[:, None, None])
        down = np.concatenate([self._W[:, :, 0], self._W[:, :, 0] * modes.delays], axis=0)
        self._normal = -self._D[:, :1] * down.T  # (n, 12): normal forces, if all press

    def run(self) -> Course:
        """From rest at the start to the end of the ride."""
        ride, n = self._ride, len(self._D)
        self._pressing: np.ndarray = self._elastic.share(ride.start_load[None]).pressing[0].copy()
        self._anchors, self._soles, self._lifted = np.zeros((n, 3)), np.zeros(n), np.zeros(n)
        self._switches, self._lost = 0, list[tuple[int, float]]()
        K = self._elastic.matrix(self._pressing) + self._leaning[0]
        z = np.zeros(16)
        z[:6] = np.linalg.lstsq(K, ride.start_load, rcond=1e-12)[0]
        parts, falls = [self._seen(np.zeros(1), z[None])], False
        for i, begin in enumerate(ride.begins):
            z[12:] = 1.0, 0.0, 0.0, 0.0
            for X in self._step(i, z):
                parts.append(self._seen(begin + X[:, 13], X))
                z = X[-1].copy()
            falls = self._far(z) or self._switches > MOST_SWITCHES
            if falls:
                break
        times, states, forces, gaps = (np.concatenate(values) for values in zip(*parts, strict=True))
        return Course(times, states[:, :6], states[:, 6:], forces, gaps, tuple(self._lost), falls)

    def _seen(self, times: np.ndarray, states: np.ndarray) -> tuple[np.ndarray, ...]:
        gaps = np.where(self._pressing, 0.0, np.maximum(self._gaps(states, times), 0.0))
        return times, states[:, :12], self._forces(states), gaps

    def _step(self, i: int, z: np.ndarray) -> Iterator[np.ndarray]:
        """States (T, 16) until the step ends, piece by piece, each with the same feet; or a foot goes far."""
        begin, length = self._ride.begins[i], self._ride.lengths[i]
        if self._pressing.all() and not self._anchors.any():
            X = _powers(self._steps[i], z, self._counts[i])
            if not self._one_sided or np.min(X[:, :12] @ self._normal.T) >= 0:
                yield X[1:]
                return
        while length - z[13] > 1e-12 and self._switches <= MOST_SWITCHES and not self._far(z):
            system = self._systems(i, self._pressing, self._anchors)
            count = max(1, int(np.ceil((length - z[13]) * self._modes.highest * PER_PERIOD)))
            dt = (length - z[13]) / count
            X = _powers(expm(system * dt), z, count)
            wrong = self._wrong(X, begin)
            hits = np.flatnonzero(np.any(wrong > 0, axis=1)[1:])
            if not len(hits):
                yield X[1:]
                return
            last = int(hits[0])
            k = int(np.argmax(wrong[last + 1]))
            z = self._crossing(system, X[last], dt, k, begin)
            yield np.vstack([X[1 : last + 1], z])
            self._switch(k, z, begin + z[13])

    def _wrong(self, states: np.ndarray, begin: float) -> np.ndarray:
        """(T, n): by how much, N, feet pull that press, or soles press that are lifted."""
        below = -self._D[:, 0] * self._gaps(states, begin + states[:, 13])
        return np.where(self._pressing, -states[:, :12] @ self._normal.T, below)

    def _gaps(self, states: np.ndarray, times: np.ndarray) -> np.ndarray:
        """(T, n), m, between soles and ground, of feet that are lifted."""
        since = (times[:, None] - self._lifted) / np.maximum(self._modes.delays, 1e-12)
        return states[:, :6] @ self._W[:, :, 0] - self._soles * np.exp(-np.maximum(since, 0.0))

    def _crossing(self, system: np.ndarray, z: np.ndarray, dt: float, k: int, begin: float) -> np.ndarray:
        """The first state within dt at which foot k lets go or comes down, by false position."""

        def look(time: float) -> tuple[np.ndarray, float]:
            at = expm(system * time) @ z
            return at, float(self._wrong(at[None], begin)[0, k])

        low, below, high = 0.0, float(self._wrong(z[None], begin)[0, k]), dt
        at, above = look(dt)
        for _ in range(_SECANTS):
            share = below / (below - above) if below < 0 < above else 0.5
            time = low + np.clip(share, 0.05, 0.95) * (high - low)
            found, value = look(time)
            if value < 0:
                low, below = time, value
            else:
                high, above, at = time, value, found
        return at

    def _switch(self, k: int, z: np.ndarray, time: float) -> None:
        """Foot k lets go, or comes down."""
        self._switches += 1
        self._pressing[k] ^= True
        self._anchors[k] = 0.0
        if self._pressing[k]:
            self._anchors[k, 1:] = z[:6] @ self._W[:, k, 1:]
        else:
            self._soles[k], self._lifted[k] = z[:6] @ self._W[:, k, 0], time
            self._lost.append((k, time))

    def _far(self, z: np.ndarray) -> bool:
        return bool(np.max(np.abs(np.einsum("vkc,v->kc", self._W, z[:6]))) > FALLEN)

    def _forces(self, states: np.ndarray) -> np.ndarray:
        """(T, n, 3), N."""
        stretch = np.einsum("vkc,sv->skc", self._W, states[:, :6])
        stretch += self._modes.delays[:, None] * np.einsum("vkc,sv->skc", self._W, states[:, 6:12])
        forces = -self._D * (stretch - self._anchors) * self._pressing[:, None]
        if self._one_sided:
            forces[:, :, 0] = np.maximum(forces[:, :, 0], 0.0)
        return forces

    def _systems(self, steps: int | slice, pressing: np.ndarray, anchors: np.ndarray) -> np.ndarray:
        """(..., 16, 16): derivatives of twist, its rate, and 1, t, t^2 / 2, t^3 / 6."""
        ride, inverse = self._ride, self._inverse[steps]
        A = np.zeros((*inverse.shape[:-2], 16, 16))
        K = self._elastic.matrix(pressing) + self._leaning[steps]
        C = self._elastic.matrix(pressing, self._modes.delays) + ride.turning[steps]
        A[..., :6, 6:12] = np.eye(6)
        A[..., 6:12, :6], A[..., 6:12, 6:12] = -inverse @ K, -inverse @ C
        loads = np.moveaxis(ride.loads[steps], -2, -1).copy()
        loads[..., 0] += np.einsum("vkc,kc->v", self._W, self._D * anchors * pressing[:, None])
        A[..., 6:12, 12:] = inverse @ loads
        A[..., [13, 14, 15], [12, 13, 14]] = 1.0
        return A


def _powers(E: np.ndarray, z: np.ndarray, count: int) -> np.ndarray:
    """(count + 1, 16): z, E z, E^2 z, ..."""
    X = z[:, None]
    while X.shape[1] <= count:
        X = np.hstack([X, E @ X])
        E = E @ E
    return X[:, : count + 1].T
