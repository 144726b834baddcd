"""Stops in which every joint stops by itself, so that the arm leaves its path: what they do to the base.

The scenarios `by_brakes` and `by_cancel` say which states such stops go through. Here are the worst values of
all these states, of many stops at once. Half spaces of wrenches that friction can carry tell where slip needs
no closer check.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ocptip.reserves.tipping import TipMap
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.alike_friction import AlikeFriction
from ocptip.trajectories.trajectory import Trajectory

POSTURES = 300  # checked for collisions, at most
SLOW = 1e-6  # rad/s (m/s): joints that are slower rest
CHUNK = 10_000  # wrenches multiplied with half spaces at once


@dataclass(frozen=True, eq=False)
class JointStops:
    """Worst values of stops from N states of a motion.

    Attributes:
        GN, GT: (N,), during the stop.
        after: (N,), s, since the stop began: when the larger of the two is met.
        wrenches: (N, 6), N and N m, on the base or an object then.
        torques: (N, n), N m (sliding joints: N), then: of brakes, or of the drives.
        drives: (N,), largest share of a torque limit that a drive needs; zero where the drives are off.
        rests: (N,), s, until all joints rest; infinite if they do not.
        displacements: (N, n), rad (sliding joints: m): how far a joint gets at most.
        outside: (N, n), rad (m): how far angles are beyond their limits at most; positive where they are.
        clearances: (N,), m, smallest distance of what may collide in `postures` postures; infinite if not
            known.
        nearest: (N,), number of the pair in `Collisions.labels` that this distance is between.
        nearest_after: (N,), s, since the stop began: when that is.
        postures: number of postures of all stops.
        alike: share of the friction that equally compliant feet use in some stop, at least; NaN: see
            `AlikeFriction.slides`.
    """

    GN: np.ndarray
    GT: np.ndarray
    after: np.ndarray
    wrenches: np.ndarray
    torques: np.ndarray
    drives: np.ndarray
    rests: np.ndarray
    displacements: np.ndarray
    outside: np.ndarray
    clearances: np.ndarray
    nearest: np.ndarray
    nearest_after: np.ndarray
    postures: int
    alike: float

    @property
    def clearance(self) -> float:
        """The smallest distance of all stops, m; infinite if none is known."""
        return float(np.min(self.clearances, initial=np.inf))

    @property
    def farthest(self) -> tuple[float, int]:
        """How far an angle is beyond its limits in all stops at most, rad (m), and the joint, 0-based."""
        joint = int(np.argmax(np.max(self.outside, axis=0)))
        return float(np.max(self.outside[:, joint])), joint

    def collision_words(self, robot: Robot, times: np.ndarray) -> str:
        """The bodies that the smallest distance is between, and when; times (N,) of the stops, s."""
        i = int(np.argmin(self.clearances))
        after = f"{self.nearest_after[i]:.3f} s after a stop begun at {times[i]:.4f} s"
        return f"between {robot.collision.labels[self.nearest[i]]} {after}"

    def joined(self, other: JointStops) -> JointStops:
        """Both."""
        pairs = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in _BY_STOP}
        alike = float(np.fmax(self.alike, other.alike))
        return JointStops(**pairs, postures=self.postures + other.postures, alike=alike)

    def some(self, rows: np.ndarray) -> JointStops:
        """Those of some rows."""
        return replace(self, **{name: getattr(self, name)[rows] for name in _BY_STOP})


_BY_STOP = (
    *("GN", "GT", "after", "wrenches", "torques", "drives", "rests", "displacements"),
    *("outside", "clearances", "nearest", "nearest_after"),
)


class StopCheck:
    """Checks stops of an arm in which every joint stops by itself.

    Args:
        robot: the arm on its support.
        GN, GT: what stops have to keep; a greater GT need not be exact.
        exact: so is GT where half spaces tell that it is kept; else it may be zero there.
        interface: of the robot's `interfaces`, whose contacts are checked; 0: the base. Collisions are
            checked with those of the base.
    """

    def __init__(self, robot: Robot, GN: float, GT: float, exact: bool = True, interface: int = 0) -> None:
        self._robot, self._GN, self._GT, self._exact = robot, GN, GT, exact
        self._interface, self._footing = interface, robot.interfaces[interface]
        self._map, self._alike = TipMap(self._footing.tip_over), AlikeFriction(self._footing)
        half_spaces = self._footing.slip.half_spaces(GT)
        self._kept_inside = None if half_spaces is None else half_spaces.T.copy()

    def _worst(
        self,
        begun: np.ndarray,
        owner: np.ndarray,
        after: np.ndarray,
        loads: tuple[np.ndarray, np.ndarray],
        reached: tuple[np.ndarray, np.ndarray],
        postures: tuple[np.ndarray, ...],
    ) -> JointStops:
        """Worst values of M states during the stops.

        Args:
            begun: (N, n) angles where the stops begin.
            owner: (M,) stop of each state.
            after: (M,), s.
            loads: wrenches (M, c, 6) that may act in each state, and torques (M, c, n) that belong to them.
            reached: (K, R, n) angles, and which of the stops (R,) they are of.
            postures: (P, n), of which at most `POSTURES` are checked for collisions, their stops (P,), and
                when, (P,), s.
        """
        count, n = begun.shape
        wrenches, torques = loads
        row, time = np.repeat(owner, wrenches.shape[1]), np.repeat(after, wrenches.shape[1])
        GN, GT = self._reserves(wrenches.reshape(-1, 6), row)
        worst = [np.zeros(count), np.zeros(count)]
        for result, values in zip(worst, (GN, GT), strict=True):
            np.maximum.at(result, row, values)
        scalars, greatest = np.full(count, -1), np.maximum(*worst)
        hit = np.flatnonzero(np.maximum(GN, GT) == greatest[row])[::-1]
        scalars[row[hit]] = hit
        known = scalars >= 0
        displacements, (angles, stop) = np.zeros((count, n)), reached
        np.maximum.at(displacements, stop, np.max(np.abs(angles - begun[stop]), axis=0))
        limits = self._robot.limits
        outside = np.full((count, n), -np.inf)
        beyond = np.maximum(limits.angle_min - angles, angles - limits.angle_max)
        np.maximum.at(outside, stop, np.max(beyond, axis=0))
        some = slice(None, None, max(1, -(-len(postures[0]) // POSTURES)))
        q, stop, when = (part[some] for part in postures)
        return JointStops(
            *worst,
            after=np.where(known, time[scalars], 0.0),
            wrenches=wrenches.reshape(-1, 6)[scalars],
            torques=np.where(known[:, None], torques.reshape(-1, n)[scalars], 0.0),
            drives=np.zeros(count),
            rests=np.zeros(count),
            displacements=displacements,
            outside=outside,
            **self._nearest(q, stop, when, count),
            postures=len(q),
            alike=self._alike.most(wrenches.reshape(-1, 6)),
        )

    def _nearest(
        self, q: np.ndarray, stop: np.ndarray, when: np.ndarray, count: int
    ) -> dict[str, np.ndarray]:
        """The smallest distance of each of `count` stops in postures q (P, n), between what, and when."""
        clearances, pairs, after = np.full(count, np.inf), np.zeros(count, dtype=int), np.zeros(count)
        if self._robot.collision.labels and not self._interface:
            result = self._robot.collision.nearest(q)
            order = np.argsort(-result.distances, kind="stable")  # the nearest is written last
            clearances[stop[order]] = result.distances[order]
            pairs[stop[order]], after[stop[order]] = result.pairs[order], when[order]
        return {"clearances": clearances, "nearest": pairs, "nearest_after": after}

    def _reserves(self, wrenches: np.ndarray, owner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """GN and GT (M,) at wrenches (M, 6) of stops `owner` (M,).

        GT is exact at its maximum in a stop, so far as half spaces tell (if it has to be), and wherever
        they do not show that it is kept, as long as the stop has kept it; elsewhere zero.
        """
        footing, rows = self._footing, self._kept_inside
        if rows is None or not self._map.count:
            states = footing.contact_states(wrenches)
            GN = footing.tip_over.evaluate(states).GN
            return _large(GN), _large(footing.slip.evaluate(states, derivatives=False).GT)
        GN = footing.tip_over.ratio(np.min(self._map(wrenches)[0], axis=1))
        GT = np.zeros(len(wrenches))
        out = np.concatenate([np.max(part @ rows, axis=1) for part in _parts(wrenches)])
        order = np.lexsort((-out, owner))
        todo = order[np.unique(owner[order], return_index=True)[1]]
        todo = todo if self._exact else todo[out[todo] > 0]
        while len(todo):
            states = footing.contact_states(wrenches[todo])
            GT[todo] = _large(footing.slip.evaluate(states, derivatives=False).GT)
            out[todo] = -np.inf
            broken = np.zeros(len(out), dtype=bool)
            broken[owner[todo[~(GT[todo] <= self._GT)]]] = True
            todo = np.flatnonzero((out > 0) & ~broken[owner])
        return GN, GT


def instants_of(motion: Trajectory, spacing: float) -> np.ndarray:
    """Instants of a motion at which stops begin, s, at most `spacing` apart and at all switching times."""
    count = max(2, int(np.ceil(motion.end / spacing)))
    return np.unique([*np.linspace(0, motion.end, count + 1)[1:-1], *motion.event_times[1:-1]])


def without_creep(qd: np.ndarray) -> np.ndarray:
    """Speeds; joints that are very slow rest."""
    return np.where(np.abs(qd) < SLOW, 0.0, qd)


def of_owner(process: np.ndarray | None, owner: np.ndarray) -> np.ndarray | None:
    """(M, 6) of a process that varies, of stops `owner` (M,)."""
    return None if process is None else process[owner]


def _parts(wrenches: np.ndarray) -> list[np.ndarray]:
    """In pieces whose products with half spaces fit into memory; one at least."""
    return np.array_split(wrenches, 1 + len(wrenches) // CHUNK)


def _large(values: np.ndarray) -> np.ndarray:
    """The values with infinity for those that are not known (NaN)."""
    return np.where(np.isnan(values), np.inf, values)
