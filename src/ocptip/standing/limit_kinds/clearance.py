"""Limits of distances: of the motion, and with delayed joints within an uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import replace

import numpy as np

from ocptip.basics.text import some
from ocptip.robots.collision.gaps import GapLabel
from ocptip.robots.geometry import FLOOR
from ocptip.standing.instants import Instants
from ocptip.standing.limit_kinds.limit import LATE, AskedLimit, InstantAt, StateLimit, Worst
from ocptip.standing.limit_kinds.rows import Curvature, NodeRows, RowNodes
from ocptip.standing.limit_kinds.worst_case import WithinLimit
from ocptip.standing.limits import CLEARANCE_WITHIN, Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.within.in_motion import WithinTolerance

GAP_SCALE = 10.0  # rows of distances are in 0.1 m
FAR = 0.1  # m beyond the clearance: how far a pair may be so that its distance is computed exactly
CLOSE = 0.02  # m: the same of a pair with joints that are late; farther ones are where slopes say
_MOST = 4  # pairs in a text, the nearest
_FLOOR_HINT = "; other floor: [[obstacle]] of kind 'floor'; none: floor = false in [base]"
_PARTS_HINT = "; convex solids nearer to the meshes: mesh_parts = 16 or more in [arm]"
BESIDE = 0.03  # m: the same, beyond what joints that are late can bring it nearer
CHOICES = 2  # how often it is chosen, by slopes, which joints are late


class ClearanceLimit(AskedLimit):
    """Signed distances of what may collide; programs look only at pairs that are near."""

    name, result, setting = "clearance", "clearance_m", "clearance"
    least = of_place = True
    largest_step = 1e-3  # m
    reach = 0.1

    def __init__(self, robot: StandingMechanism, asked: Limits, joints: tuple[int, ...]) -> None:
        super().__init__(robot, asked, joints)
        self.width = len(robot.collision.labels)

    def inner(self, asked: Limits) -> Limits:
        return replace(asked, **{self.setting: self.number + 1e-5})

    def tightened(self, asked: Limits, excess: float) -> Limits:
        return replace(asked, **{self.setting: getattr(asked, self.setting) + min(excess, self.largest_step)})

    def measure(self, instants: Instants) -> np.ndarray:
        return -self.robot.collision.least(instants.angles)[:, None]

    def detail(self, instant_at: InstantAt, time: float) -> str:
        label = self.robot.collision.worst(instant_at(time).angles)[1]
        return "" if label is None else str(label)

    def refusals(self, instants: Instants) -> list[str]:
        reason = self.too_near({"": (self.robot, instants.angles[0])})
        return [reason] if reason else []

    def too_near(self, postures: Mapping[str, tuple[StandingMechanism, np.ndarray]]) -> str:
        """All pairs that overlap or are nearer than allowed, in one sentence; empty if there are none.

        Args:
            postures: mechanism and angles (n,) by words that precede its pairs.
        """
        texts, pairs, hints = [], [], []
        for where, (robot, q) in postures.items():
            near = self._near_pairs(robot, q)
            if not near:
                continue
            overlaps, apart = [], []
            for name, (label, gap) in near.items():
                meshes = robot.collision.on_meshes(q, label)
                text = f"overlap by {-1e3 * gap:.1f} mm" if gap < 0 else f"are {1e3 * gap:.1f} mm apart"
                (overlaps if gap < 0 else apart).append(f"{name} {text}{_of_meshes(meshes)}")
                if robot.collision.links | {FLOOR} >= {label.first, label.second}:
                    pairs.append(f'["{label.first}", "{label.second}"]')
                if label.second.startswith(FLOOR):
                    hints.append(_FLOOR_HINT)
                if meshes and meshes >= self.number:
                    hints.append(_PARTS_HINT)
            parts = [f"collision: {some(overlaps, _MOST)}"] if overlaps else []
            parts += [f"{some(apart, _MOST)}, must be >= {1e3 * self.number:.1f} mm"] if apart else []
            texts.append(f"{where}{', '.join(parts)}")
            least = min(gap for _, gap in near.values())
            if apart:
                usual = robot.usual_clearance
                less = "for less give clearance in [limits]"
                if not overlaps and usual <= least:
                    less = f"leave clearance in [limits] out: then {1e3 * usual:.1f} mm count"
                hints.insert(0, f"; {less}")
        if not texts:
            return ""
        pairs = list(dict.fromkeys(pairs))[:_MOST]
        if pairs:
            hints.append(f"; where that is meant: excluded_links = [{', '.join(pairs)}] in [arm]")
        else:  # only links may be excluded
            hints.append("; change the postures, or place and size of the solids")
        return f"{'; '.join(texts)}{''.join(dict.fromkeys(hints))}"

    def _near_pairs(self, robot: StandingMechanism, q: np.ndarray) -> dict[str, tuple[GapLabel, float]]:
        """Pairs nearer than allowed at q (n,) with the distance (m), by their names; the nearest first."""
        near_pairs: dict[str, tuple[GapLabel, float]] = {}
        gaps, labels = robot.collision.gaps(q, self.number), robot.collision.labels
        for k in np.argsort(gaps):
            if gaps[k] < self.number:
                near_pairs.setdefault(f"{labels[k]}", (labels[k], float(gaps[k])))
        return near_pairs

    def path_excess(self, instants: Instants) -> float:
        return float(np.max(GAP_SCALE * (self.number - self._smallest(instants))))

    def uses(self, instants: Instants) -> np.ndarray:
        return 1 + GAP_SCALE * (self.number - self._gaps(instants))

    def _gaps(self, instants: Instants) -> np.ndarray:
        """(N, width), m, right as far as they matter."""
        return instants.gaps(self.number + FAR)

    def _smallest(self, instants: Instants) -> np.ndarray:
        """(N,), m; infinite where there is nothing to hit."""
        return np.min(self._gaps(instants), axis=1, initial=np.inf)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.full(self.width, self.number * GAP_SCALE), np.full(self.width, np.inf)

    def rows_at(self, row_nodes: RowNodes, i: np.ndarray, k: np.ndarray) -> NodeRows:
        gaps, slopes = self.robot.collision.slopes(row_nodes.angles, i, k)
        return NodeRows(row_nodes, i, k, GAP_SCALE * gaps, GAP_SCALE * slopes)

    def jacobian(self, rows: NodeRows) -> np.ndarray:
        size = rows.at.s.shape[1]
        return rows.at.by_states(rows.nodes, np.pad(rows.slopes, ((0, 0), (0, size - self.robot.n))))

    def add_hessian(self, rows: NodeRows, on: np.ndarray, H: Curvature, on_s: np.ndarray) -> None:
        scaled, every = GAP_SCALE * on, np.arange(len(rows.at.s))
        H.add(every, self.robot.collision.curvature(rows.at.angles, rows.nodes, rows.places, scaled))
        np.add.at(on_s[:, : self.robot.n], rows.nodes, on[:, None] * rows.slopes)


def _of_meshes(apart: float | None) -> str:
    """Distance, m, of the surfaces of meshes, in words that follow that of the convex solids about them."""
    if apart is None:
        return ""
    text = f"the surfaces of their meshes: {1e3 * apart:.1f} mm apart" if apart > 0 else "their meshes touch"
    return f" ({text})"


class LateClearanceLimit(StateLimit, WithinLimit, ClearanceLimit):
    """The minimum distance with joints that are delayed independently.

    Programs evaluate joints with the whole delay or none, whichever brings a pair nearer, at positions
    extrapolated from their present speeds and accelerations. Values at instants are not measured one by one,
    see `standing.within.in_motion`.
    """

    name, scenario = "clearance within tolerance", LATE
    result, setting = f"{CLEARANCE_WITHIN}_m", CLEARANCE_WITHIN
    of_place, rows_first = False, True

    def __init__(self, robot: StandingMechanism, asked: Limits, joints: tuple[int, ...]) -> None:
        super().__init__(robot, asked, joints)
        late = asked.tolerance.late
        self._steps = np.array([0.0, -late, 0.5 * late**2])
        self._is_late: np.ndarray | None = None  # (N, width, n) of the nodes of a program

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        return asked.tolerance.late > 0 and bool(robot.collision.labels)

    def measure(self, instants: Instants) -> np.ndarray:
        return np.empty((len(instants), 0))

    def within(self, within_tolerance: WithinTolerance) -> list[Worst]:
        gap = within_tolerance.gap
        return [] if gap is None else [self.worst_value(gap.value, gap.time, gap.between)]

    def kept(self, instants: Instants) -> bool:
        return bool(np.all(self._smallest(instants) >= self.number))

    def refusals(self, instants: Instants) -> list[str]:
        return []  # what rests is not late

    def path_excess(self, instants: Instants) -> float:
        return -np.inf

    def _gaps(self, instants: Instants) -> np.ndarray:
        values = super()._gaps(instants).copy()
        i, k, _, gaps = self._latest(instants)
        values[i, k] = np.minimum(values[i, k], gaps)
        return values

    def chosen(self, instants: Instants) -> LateClearanceLimit:
        """With the delayed joints of each pair there."""
        other, (i, k, late, _) = copy(self), self._latest(instants)
        other._is_late = np.zeros((len(instants), self.width, self.robot.n), dtype=bool)
        other._is_late[i, k] = late
        return other

    def _latest(self, instants: Instants) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Near pairs: node, number (r,), which joints are delayed (r, n), the distance (r,), m."""
        states = np.stack(instants.motion_states, axis=1)  # (N, 3, n)
        steps = np.einsum("a,raj->rj", self._steps, states)
        reached = self.robot.collision.approach(steps)
        i, k = np.nonzero(super()._gaps(instants) < self.number + np.minimum(reached + BESIDE, FAR))
        places, moved = states[i, 0], steps[i]
        gaps, slopes = self.robot.collision.slopes(states[:, 0], i, k, once=True)
        late = slopes * moved < 0
        gaps = gaps + np.sum(np.minimum(slopes * moved, 0.0), axis=1)
        near = np.flatnonzero(gaps < self.number + CLOSE)
        for turn in range(CHOICES):
            if turn:  # only where the slopes there choose other joints
                near = near[np.any((slopes[near] * moved[near] < 0) != late[near], axis=1)]
            late[near] = slopes[near] * moved[near] < 0
            delayed = places[near] + late[near] * moved[near]
            gaps[near], slopes[near] = self._at(delayed, k[near], once=True)
        return i, k, late, gaps

    def _at(self, q: np.ndarray, pairs: np.ndarray, *, once: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Distances (r,) and slopes (r, n) of pairs (r,) at angles (r, n)."""
        return self.robot.collision.slopes(q, np.arange(len(q)), pairs, once=once)

    def rows_at(self, row_nodes: RowNodes, i: np.ndarray, k: np.ndarray) -> NodeRows:
        late = np.zeros((len(i), self.robot.n)) if self._is_late is None else 1.0 * self._is_late[i, k]
        parts = self._steps[:, None] * late[:, None]
        parts[:, 0] = 1.0
        q = np.einsum("raj,raj->rj", parts, np.stack(row_nodes.motion_states, axis=1)[i])
        gaps, curvature_rows = self._at(q, k)
        slopes = np.zeros((len(i), row_nodes.s.shape[1]))
        slopes[:, : 3 * self.robot.n] = (GAP_SCALE * curvature_rows[:, None] * parts).reshape(len(i), -1)
        return NodeRows(row_nodes, i, k, GAP_SCALE * gaps, slopes, chosen=(q, parts))

    def curvature(self, rows: NodeRows, on: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        q, parts = rows.chosen
        count, n = q.shape
        gap_curvature = self.robot.collision.curvature(q, np.arange(count), rows.places, GAP_SCALE * on)
        size = rows.at.s.shape[1]
        bends = np.zeros((count, size, size))
        bent = np.einsum("raj,rjk,rbk->rajbk", parts, gap_curvature, parts)
        bends[:, : 3 * n, : 3 * n] = bent.reshape(count, 3 * n, 3 * n)
        return np.arange(count), bends
