"""A base with a moving mechanism on compliant feet, drives behind elastic joints, to first order in both.

With the d small motions u (the base's twist, of its centre of mass, base axes, zero where feet are slack; and
springs of gears) and the loads w(t) of the mechanism on base and springs that stay as they are,

    M u'' + (B + C) u' + (K + G) u = w(t):

M is the inertia of base and links, B what the joints' speeds add, K and C are springs and dampers of feet and
gears. G turns weight and spring forces with the base, and moves the links with the springs; without it a high
mechanism would be too stiff. The drives do what the motion says, whatever the links do: Spong's model with
the rotors' motion given. On rigid feet only the springs of gears move. In steps within which the joints turn
by a negligible angle, all matrices are constant and w is a cubic in time: the step is then a matrix
exponential.

A foot presses until spring and damper would have to pull. It then carries nothing, its sole, which has
no mass, relaxes with the time c / k, and it comes down where base and sole meet the ground again, its
tangential springs slack. Friction does not limit the tangential springs. A clamp with a yielding jaw is a
foot that lets go at minus its preload, which pulls its sole from then on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy  # subpackages load on first use

from ocptip.contact.elastic import ElasticFeet
from ocptip.numerics.threads import one_thread
from ocptip.numerics.vectors import skew
from ocptip.standing.elastic.steps import (
    Modes,
    ends_of_steps,
    exponentials,
    oscillations,
    powers,
    states_within,
)
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.trajectory import INSIDE, Trajectory

LONGEST = 0.01  # s: steps of constant inertia
TURN = 0.05  # rad or m by which a joint moves in a step, at most
PER_PERIOD = 24  # instants per period of the highest frequency
_AT_ONCE = 20_000  # instants: memory does not grow with the length of a motion
MOST_SWITCHES = 500  # feet that lift and land
FALLEN = 0.02  # m: a foot that moves farther has left what is linear
FASTEST = 500.0  # Hz: gears with faster springs (drive and other joints held) count as such that do not give
_SHARES = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
_CUBIC = np.linalg.pinv(np.vander(_SHARES, 4, increasing=True)) * np.array([[1], [1], [2], [6]])
_SECANTS = 4


class Ride:
    """The excitation of base and gears by a motion, step by step, independent of the support.

    Args:
        robot: that `knows_inertia`.
        motion: of its joints.
        rest: s, how long to look on after the end.

    Attributes:
        lengths: (S,), s, of the steps.
        begins: (S,), s.
        inertia: (S, d, d), M.
        turning: (S, d, d), B.
        loads: (S, 4, d): w and its derivatives at the beginning of each step.
        middle: (S, 6): the wrench in the middle.
        stiffening: (S, d, d): what of G is known without feet.
        start_inertia: (d, d).
        start_load: (d,).
        springs, dampers: (m,) of gears, N m/rad and N m s/rad; of some that are too fast infinite.
    """

    def __init__(self, robot: StandingMechanism, motion: Trajectory, rest: float = 0.0) -> None:
        self.robot = robot
        fastest = float(np.max(motion.speed_peaks, initial=0.0))
        step = min(LONGEST, TURN / fastest if fastest > 0 else LONGEST)
        pieces = robot.acts.pieces(motion)
        cuts = [np.linspace(a, b, max(1, int(np.ceil((b - a) / step))) + 1) for a, b in pieces if b > a]
        self.begins = np.concatenate([cut[:-1] for cut in cuts]) if cuts else np.empty(0)
        self.lengths = np.concatenate([np.diff(cut) for cut in cuts]) if cuts else np.empty(0)
        inside = np.minimum(INSIDE, 0.25 * self.lengths)
        times = self.begins[:, None] + self.lengths[:, None] * _SHARES
        times[:, 0] += inside
        times[:, -1] -= inside
        states = motion.states(times.ravel())
        loads = robot.swing_loads(*states, robot.acting(times.ravel()))
        loads = loads.reshape(-1, len(_SHARES), loads.shape[1])
        powers = self.lengths[:, None] ** np.arange(4)
        self.loads = np.einsum("ij,sjv->siv", _CUBIC, loads) / powers[:, :, None]
        self.middle = loads[:, 2, :6]
        q, qd, qdd = (values[2 :: len(_SHARES)] for values in states)
        if rest > 0:
            still = motion.goal[None]
            load = robot.swing_loads(still, 0 * still, 0 * still, robot.acting(np.array([motion.end])))
            self.begins, self.lengths = np.append(self.begins, motion.end), np.append(self.lengths, rest)
            self.loads = np.concatenate([self.loads, np.pad(load[None], ((0, 0), (0, 3), (0, 0)))])
            self.middle = np.vstack([self.middle, load[:, :6]])
            q, qd, qdd = np.vstack([q, still]), np.vstack([qd, 0 * still]), np.vstack([qdd, 0 * still])
        self.inertia, self.turning, self.stiffening = self._matrices(q, qd, qdd)
        begin = motion.start[None]
        self.start_inertia = self._matrices(begin, 0 * begin, 0 * begin)[0][0]
        self.start_load = robot.swing_loads(begin, 0 * begin, 0 * begin, robot.acting(np.zeros(1)))[0]
        self.springs, self.dampers = self._gears()

    def _matrices(self, *states: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Inertia, turning, stiffening, (N, d, d) each."""
        inertia, turning, stiffening = self.robot.small_motions(*states)
        none = np.zeros((*turning.shape[:2], 3))
        leaning = -inertia[:, :, :3] @ skew(self.robot.support.gravity)
        return (
            inertia,
            np.concatenate([none, turning], axis=2),
            np.concatenate([none, leaning, stiffening], axis=2),
        )

    def _gears(self) -> tuple[np.ndarray, np.ndarray]:
        """Springs and dampers; those much faster than the simulated motion are rigid."""
        chain = self.robot.chain
        if chain is None:
            return np.empty(0), np.empty(0)
        gear_inertia = np.diagonal(self.start_inertia)[6:]
        springs = chain.gears.stiffness[chain.gears.elastic]
        fast = springs > gear_inertia * (2 * np.pi * FASTEST) ** 2
        return np.where(fast, np.inf, springs), chain.gears.dampers(gear_inertia)

    def free(self, elastic: ElasticFeet | None) -> np.ndarray:
        """Numbers of the motions that are possible on these feet; None: they do not give."""
        gears = 6 + np.flatnonzero(np.isfinite(self.springs))
        return gears if elastic is None else np.concatenate([np.arange(6), gears])

    def at_rest(self, q: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Loads (N, d) of postures (N, n) at rest, and `stiffening` there."""
        still = 0 * q
        return self.robot.swing_loads(q, still, still, self.robot.acting(times)), self._matrices(
            q, still, still
        )[2]

    def leaning(
        self, elastic: ElasticFeet | None, stiffening: np.ndarray, wrenches: np.ndarray
    ) -> np.ndarray:
        """G (N, d, d): with the feet's forces under wrenches (N, 6 or more), which turn with the base."""
        if elastic is None:
            return stiffening
        G, support = stiffening.copy(), self.robot.support
        forces = np.nan_to_num(elastic.share(wrenches[:, :6]).forces)
        forces = np.einsum("kij,skj->ski", support.frames, forces)
        turned = skew(forces)  # a force seen from the turned base: f x theta
        G[:, :3, 3:6] -= turned.sum(axis=1)
        G[:, 3:6, 3:6] -= np.einsum("kij,skjl->sil", skew(support.arms), turned)
        return G


@dataclass(frozen=True, eq=False)
class Course:
    """The motion of base and springs of gears, at T instants.

    Attributes:
        times: (T,), s.
        twists, rates: (T, 6), m and rad, m/s and rad/s; of a base on rigid feet zero.
        bends: (T, m), rad (m), of springs of gears.
        forces: (T, n, 3), N, contact axes, on the base; empty where feet do not give.
        gaps: (T, n), m, of soles that are lifted; else 0.
        wrenches: (T, 6), N and N m: on a base on rigid feet, its weight included; else empty.
        lost: contact (from 0) and time of every foot that let go, also of those that came down at once.
        falls: the computation ended early, where a foot had moved by more than `FALLEN`.
    """

    times: np.ndarray
    twists: np.ndarray
    rates: np.ndarray
    bends: np.ndarray
    forces: np.ndarray
    gaps: np.ndarray
    wrenches: np.ndarray
    lost: tuple[tuple[int, float], ...]
    falls: bool


class Simulation:
    """Base, feet and gears as piecewise linear systems of the d motions that are possible.

    Args:
        ride: what moves them.
        elastic: the feet; None: they do not give.
        modes: of both; None without such feet.
        one_sided: False: feet may pull, which is the linear theory.
    """

    def __init__(
        self, ride: Ride, elastic: ElasticFeet | None, modes: Modes | None, one_sided: bool = True
    ) -> None:
        self.ride, self._elastic, self._one_sided = ride, elastic, one_sided
        self._free = free = ride.free(elastic)
        self.d = d = len(free)
        self._bends = free[free >= 6]
        springs = np.ix_(np.arange(len(ride.begins)), free, free)
        self._W, self._D, self._delays = np.zeros((d, 0, 3)), np.empty((0, 3)), np.empty(0)
        self._highest, self._lowest = 0.0, np.empty(0)
        if elastic is not None and modes is not None:
            self._W = np.concatenate([elastic.W, np.zeros((d - 6, *elastic.W.shape[1:]))])
            self._D, self._delays, self._highest = elastic.stiffness, modes.delays, modes.highest
            self._lowest = elastic.lowest
        gears = self._bends - 6
        self._springs, self._dampers = (
            np.diag(np.concatenate([np.zeros(d - len(gears)), values[gears]]))
            for values in (ride.springs, ride.dampers)
        )
        self._inertia, self._turning = ride.inertia[springs], ride.turning[springs]
        leaning = ride.leaning(elastic, ride.stiffening, ride.middle)
        self._leaning, self._loads = leaning[springs], ride.loads[:, :, free]
        self._inverse = np.linalg.inv(self._inertia)
        n = len(self._D)
        self._pressing: np.ndarray = np.ones(n, dtype=bool)
        self._anchors, self._soles, self._lifted = np.zeros((n, 3)), np.zeros(n), np.zeros(n)
        self._switches, self._lost, self._falls = 0, list[tuple[int, float]](), False
        start = None if elastic is None else elastic.share(ride.start_load[None, :6])
        self._start_pressing = self._pressing if start is None else start.pressing[0].copy()
        if len(gears):
            both = self.stiffness(), ride.start_inertia[np.ix_(free, free)]
            fastest = float(np.sqrt(scipy.linalg.eigh(*both, eigvals_only=True)[-1]))
            self._highest = max(self._highest, fastest / (2 * np.pi))
        self._every = self._systems(slice(None), self._pressing, np.zeros((n, 3)))
        down = np.concatenate([self._W[:, :, 0], self._W[:, :, 0] * self._delays], axis=0)
        self._normal = -self._D[:, :1] * down.T  # (n, 2 d): normal forces, if all press

    def stiffness(self, pressing: np.ndarray | None = None) -> np.ndarray:
        """K (d, d) while these feet press; default all."""
        D = self._D if pressing is None else self._D * pressing[:, None]
        return np.einsum("vkc,kc,wkc->vw", self._W, D, self._W) + self._springs

    def damping(self, pressing: np.ndarray | None = None) -> np.ndarray:
        """C (d, d) while these feet press; default all."""
        D = self._D * self._delays[:, None]
        D = D if pressing is None else D * pressing[:, None]
        return np.einsum("vkc,kc,wkc->vw", self._W, D, self._W) + self._dampers

    def modes(self, step: int) -> np.ndarray:
        """(k, 2): natural frequencies, Hz, and damping ratios of what rings in a step, all feet pressing."""
        result = oscillations(
            self._inertia[step], self.damping() + self._turning[step], self.stiffness() + self._leaning[step]
        )
        return result[result[:, 1] < 1 - 1e-9][::2]

    def sags(self, q: np.ndarray, times: np.ndarray) -> np.ndarray:
        """(N, 6 + m): all motions, also those not possible, at rest in postures (N, n), all feet pressing."""
        ride, free = self.ride, self._free
        loads, stiffening = ride.at_rest(q, times)
        G = ride.leaning(self._elastic, stiffening, loads)[np.ix_(np.arange(len(q)), free, free)]
        values = np.zeros_like(loads)
        values[:, free] = np.linalg.solve(self.stiffness() + G, loads[:, free, None])[:, :, 0]
        return values

    @one_thread
    def run(self, to_first_pull: bool = False) -> Course:
        """From rest at the start to the end of the ride, or to the step in which a foot pulls."""
        times, states, forces, gaps, wrenches = (
            np.concatenate(values) for values in zip(*self._parts(to_first_pull), strict=True)
        )
        whole = np.zeros((len(times), 2, self.ride.inertia.shape[1]))
        whole[:, :, self._free] = states.reshape(len(times), 2, self.d)
        twists, rates, bends = whole[:, 0, :6], whole[:, 1, :6], whole[:, 0, 6:]
        return Course(times, twists, rates, bends, forces, gaps, wrenches, tuple(self._lost), self._falls)

    @one_thread
    def least(self, to_first_pull: bool = False) -> tuple[np.ndarray, np.ndarray, bool]:
        """Minimum normal forces, N, and when, s, (n,) each, of the same; and whether a foot goes far."""
        least, when = np.full(len(self._D), np.inf), np.zeros(len(self._D))
        for times, _, forces, *_ in self._parts(to_first_pull):
            normal = np.where(np.isnan(forces[:, :, 0]), np.inf, forces[:, :, 0])
            less = (result := np.min(normal, axis=0)) < least
            least[less], when[less] = result[less], times[np.argmin(normal, axis=0)][less]
        return least, when, self._falls

    def _parts(self, to_first_pull: bool) -> Iterator[tuple[np.ndarray, ...]]:
        """The motion, part by part; at the end `_falls` says whether a foot goes far."""
        ride, n, d = self.ride, len(self._D), self.d
        self._counts = np.maximum(1, np.ceil(ride.lengths * self._highest * PER_PERIOD)).astype(int)
        self._steps = self._over(ride.lengths / self._counts, self._every)
        self._pressing = self._start_pressing.copy()
        self._anchors, self._soles, self._lifted = np.zeros((n, 3)), self._drawn(), np.zeros(n)
        self._switches, self._lost, self._falls = 0, [], False
        K = self.stiffness(self._pressing) + self._leaning[0]
        z = np.zeros(2 * d + 4)
        load = ride.start_load[self._free] + self._pulls(self._pressing)
        z[:d] = np.linalg.lstsq(K, load, rcond=1e-12)[0]
        z[2 * d] = 1.0
        if self._one_sided or not len(self._D) or not self._pressing.all():
            yield from self._run_on(z, to_first_pull)
        else:
            yield from self._run_linearly(z, to_first_pull)

    def _over(self, times: np.ndarray, systems: np.ndarray) -> np.ndarray:
        """(S, 2 d + 4, 2 d + 4): what systems (S, ...) make of states in times (S,), s."""
        fast = 2.0 ** np.round(np.log2(max(2 * np.pi * self._highest, 1.0)))
        scale = np.repeat([1.0, fast, 1.0], [self.d, self.d, 4])
        return exponentials(systems * times[:, None, None], scale, 2 * self.d)

    def _run_on(self, z: np.ndarray, to_first_pull: bool) -> Iterator[tuple[np.ndarray, ...]]:
        """The motion, part by part; feet lift off and land."""
        yield (part := self._seen(0, np.zeros(1), z[None]))
        for i, begin in enumerate(self.ride.begins):
            z[2 * self.d :] = 1.0, 0.0, 0.0, 0.0
            for X in self._step(i, z):
                yield (part := self._seen(i, begin + X[:, -3], X))
                z = X[-1].copy()
            self._falls = self._far(z) or self._switches > MOST_SWITCHES
            if self._falls or (to_first_pull and np.min(part[2][:, :, 0]) < 0):
                break

    def _run_linearly(self, z: np.ndarray, to_first_pull: bool) -> Iterator[tuple[np.ndarray, ...]]:
        """The motion of feet that may pull, many steps at once."""
        yield self._seen(0, np.zeros(1), z[None])
        ends = ends_of_steps(self._steps, self._counts, z, 2 * self.d)
        moved = np.abs(np.einsum("vkc,sv->skc", self._W, ends[1:, : self.d]))
        far = ~(np.max(moved, axis=(1, 2), initial=0.0) <= FALLEN)
        count = int(np.argmax(far)) + 1 if far.any() else len(far)
        self._falls = bool(far[:count].any())
        groups = np.cumsum(self._counts[:count]) // _AT_ONCE
        for indices in np.split(np.arange(count), np.flatnonzero(np.diff(groups)) + 1):
            X, owner = states_within(self._steps[indices], self._counts[indices], ends[indices[0] :])
            seen = self._seen(0, self.ride.begins[indices[owner]] + X[:, -3], X)
            pulls = np.min(seen[2][:, :, 0], axis=1) < 0
            if to_first_pull and pulls.any():
                last = owner[np.argmax(pulls)]
                self._falls = bool(far[: indices[last] + 1].any())
                yield tuple(part[owner <= last] for part in seen)
                return
            yield seen

    def _seen(self, i: int, times: np.ndarray, states: np.ndarray) -> tuple[np.ndarray, ...]:
        gaps = np.zeros((len(times), len(self._D)))
        if not self._pressing.all():
            gaps = np.where(self._pressing, gaps, np.maximum(self._gaps(states, times), 0.0))
        return times, states[:, : 2 * self.d], self._forces(states), gaps, self._wrenches(i, states)

    def _wrenches(self, i: int, states: np.ndarray) -> np.ndarray:
        """(T, 6) on a base whose feet do not give; else (T, 0)."""
        if len(self._D):
            return np.empty((len(states), 0))
        ride, d, free = self.ride, self.d, self._free
        changes = states @ self._every[i, d : 2 * d].T
        taken = changes @ ride.inertia[i][:6, free].T
        taken += states[:, d : 2 * d] @ ride.turning[i][:6, free].T
        taken += states[:, :d] @ ride.stiffening[i][:6, free].T
        return states[:, 2 * d :] @ ride.loads[i, :, :6] - taken

    def _step(self, i: int, z: np.ndarray) -> Iterator[np.ndarray]:
        """States (T, 2 d + 4) until the step ends, in pieces of the same feet; or until a foot goes far."""
        begin, length = self.ride.begins[i], self.ride.lengths[i]
        if self._pressing.all() and not self._anchors.any():
            X = powers(self._steps[i], z, self._counts[i])
            if not self._one_sided or np.all(X[:, :-4] @ self._normal.T >= self._lowest):
                yield X[1:]
                return
        while length - z[-3] > 1e-12 and self._switches <= MOST_SWITCHES and not self._far(z):
            system = self._systems(i, self._pressing, self._anchors)
            count = max(1, int(np.ceil((length - z[-3]) * self._highest * PER_PERIOD)))
            dt = (length - z[-3]) / count
            X = powers(self._over(np.array([dt]), system[None])[0], z, count)
            wrong = self._wrong(X, begin)
            hits = np.flatnonzero(np.any(wrong > 0, axis=1)[1:])
            if not len(hits):
                yield X[1:]
                return
            last = int(hits[0])
            k = int(np.argmax(wrong[last + 1]))
            z = self._crossing(system, X[last], dt, k, begin)
            yield np.vstack([X[1 : last + 1], z])
            self._switch(k, z, begin + z[-3])

    def _wrong(self, states: np.ndarray, begin: float) -> np.ndarray:
        """(T, n): by how much, N, feet pull that press, or soles press that are lifted."""
        below = -self._D[:, 0] * self._gaps(states, begin + states[:, -3])
        return np.where(self._pressing, self._lowest - states[:, :-4] @ self._normal.T, below)

    def _gaps(self, states: np.ndarray, times: np.ndarray) -> np.ndarray:
        """(T, n), m, between soles and ground, of feet that are lifted."""
        since = (times[:, None] - self._lifted) / np.maximum(self._delays, 1e-12)
        soles = self._drawn() + (self._soles - self._drawn()) * np.exp(-np.maximum(since, 0.0))
        return states[:, : self.d] @ self._W[:, :, 0] - soles

    def _crossing(self, system: np.ndarray, z: np.ndarray, dt: float, k: int, begin: float) -> np.ndarray:
        """The first state within dt at which foot k lets go or comes down, by false position."""

        def state_at(time: float) -> tuple[np.ndarray, float]:
            moved = self._over(np.array([time]), system[None])[0] @ z
            return moved, float(self._wrong(moved[None], begin)[0, k])

        low, below, high = 0.0, float(self._wrong(z[None], begin)[0, k]), dt
        state, above = state_at(dt)
        for _ in range(_SECANTS):
            share = below / (below - above) if below < 0 < above else 0.5
            time = low + np.clip(share, 0.05, 0.95) * (high - low)
            result, value = state_at(time)
            if value < 0:
                low, below = time, value
            else:
                high, above, state = time, value, result
        return state

    def _switch(self, k: int, z: np.ndarray, time: float) -> None:
        """Foot k lets go, or comes down."""
        self._switches += 1
        self._pressing[k] ^= True
        self._anchors[k] = 0.0
        if self._pressing[k]:
            self._anchors[k, 1:] = z[: self.d] @ self._W[:, k, 1:]
        else:
            self._soles[k], self._lifted[k] = z[: self.d] @ self._W[:, k, 0], time
            self._lost.append((k, time))

    def _far(self, z: np.ndarray) -> bool:
        moved = np.einsum("vkc,v->kc", self._W, z[: self.d])
        return bool(np.max(np.abs(moved), initial=0.0) > FALLEN)

    def _forces(self, states: np.ndarray) -> np.ndarray:
        """(T, n, 3), N."""
        damped = np.concatenate([self._W, self._W * self._delays[:, None]]).reshape(2 * self.d, self._D.size)
        stretch = (states[:, : 2 * self.d] @ damped).reshape(len(states), *self._D.shape) - self._anchors
        forces = -self._D * self._pressing[:, None] * stretch
        forces[:, :, 0] += np.where(self._pressing, 0.0, self._lowest)
        if self._one_sided:
            forces[:, :, 0] = np.maximum(forces[:, :, 0], self._lowest)
        return forces

    def _drawn(self) -> np.ndarray:
        """(n,), m: by how much yielding jaws draw the soles of contacts that have let go."""
        return np.where(self._pressing, 0.0, -self._lowest) / self._D[:, 0]

    def _pulls(self, pressing: np.ndarray) -> np.ndarray:
        """(d,): loads of the contacts that have let go."""
        return self._W[:, ~pressing, 0] @ self._lowest[~pressing]

    def _systems(self, steps: int | slice, pressing: np.ndarray, anchors: np.ndarray) -> np.ndarray:
        """(..., 2 d + 4, 2 d + 4): derivatives of u, u', and 1, t, t^2 / 2, t^3 / 6."""
        d, inverse = self.d, self._inverse[steps]
        A = np.zeros((*inverse.shape[:-2], 2 * d + 4, 2 * d + 4))
        K = self.stiffness(pressing) + self._leaning[steps]
        C = self.damping(pressing) + self._turning[steps]
        A[..., :d, d : 2 * d] = np.eye(d)
        A[..., d : 2 * d, :d], A[..., d : 2 * d, d : 2 * d] = -inverse @ K, -inverse @ C
        loads = np.moveaxis(self._loads[steps], -2, -1).copy()
        loads[..., 0] += np.einsum("vkc,kc->v", self._W, self._D * anchors * pressing[:, None])
        loads[..., 0] += self._pulls(pressing)
        A[..., d : 2 * d, 2 * d :] = inverse @ loads
        A[..., [-3, -2, -1], [-4, -3, -2]] = 1.0
        return A
