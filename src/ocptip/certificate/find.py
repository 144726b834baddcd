"""Find a certificate: bounds near the sampled worst values, forces of the contact solver, bisection.

Nothing here has to be trusted: `checker` checks the result.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import count, product
from typing import Any

import numpy as np

from ocptip.basics.text import percent, silent
from ocptip.certificate.claimed import LOSS, bounds_near, goal_within, kept, lost_as_sampled, why_none
from ocptip.certificate.describe import (
    Separations,
    model_data,
    motion_data,
    states_at,
    tolerance_data,
    unlike,
)
from ocptip.certificate.find_cancels import cancel_claims, proved_of_cancels
from ocptip.certificate.find_objects import object_claims
from ocptip.certificate.find_within import HIGHEST, SearchWithin
from ocptip.certificate.interior import Interior
from ocptip.certificate.result import LATE, Certificate, Undecided, every_of_cancels
from ocptip.certificate.trusted.checker import (
    CLAIMS_WITHIN,
    FORMAT,
    Verdict,
    check_certificate,
    digest,
)
from ocptip.certificate.trusted.described import (
    CLAIMS_OF_POINTS,
    CLEARANCE,
    SPEED_OF_POINTS,
    SPEED_OF_POINTS_WITHIN,
    TORQUES,
    Checker,
    Intervals,
)
from ocptip.certificate.trusted.plain import OBJECTS
from ocptip.numerics.threads import one_thread
from ocptip.standing.arm import Robot
from ocptip.standing.limit_kinds.limit import Worst
from ocptip.standing.limits import SLIP_WITHIN, TIP_WITHIN, Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.stops.by_cancel import Cancel
from ocptip.standing.within.worst_case import worst_case_of
from ocptip.trajectories.trajectory import Trajectory

_LONGEST = 0.01  # s, of the first intervals
_MOST, _MOST_OFF_A_PLANE = 15, 4  # times as many intervals as at first are tried
_ASIDE = 1e-6  # s beside a step of a base's acceleration
_SHORTEST = 1e-5  # s: what is shorter is not divided
_LOWER_AFTER = 2  # halvings of intervals that do not prove the clearance of delayed joints
_HIGHER = 3  # times GT within a tolerance is claimed higher
_ON_TIME = {"delay": 0.0, "overshoot": 0.0}
_LATE_CLEARANCE = "clearance within tolerance"
_COVERED = {
    "GN",
    "GT",
    "torque_ratio",
    "clearance_m",
    "speed_ratio",
    "acceleration_ratio",
    "jerk_ratio",
    "angle_margin_deg",
    "position_margin_m",
    "duration_s",
    "duration_s_cancel",  # like the duration exact by the motion itself; the headline claims contacts only
}


@one_thread
def certify(
    robot: StandingMechanism,
    motion: Trajectory,
    limits: Limits,
    worst: Mapping[str, Worst],
    say: Callable[[str], None] = silent,
) -> Certificate:
    """Prove that a motion keeps all limits at every instant, as far as that can be done.

    Args:
        robot: the arm on its support.
        motion: of its joints.
        limits: that were asked for.
        worst: the sampled worst values, from `check_motion`; claims stay near them.
        say: called with what is proved, and how much of it.
    """
    began = time.perf_counter()
    if reason := why_none(robot, worst):
        return Certificate(None, Verdict(False, (), {}, 0), reason=reason)
    robot = robot.during(motion)
    within = limits.tolerance.given and any(name in worst for name in CLAIMS_WITHIN)
    tolerance = tolerance_data(limits.tolerance, robot.support) if within else None
    bounds = bounds_near(limits, worst, bool(robot.collision.labels))
    if within and SPEED_OF_POINTS in bounds:
        bounds[SPEED_OF_POINTS_WITHIN] = 1.0  # until the largest share is known, see `run`
    least = {CLEARANCE: getattr(limits, CLEARANCE)}
    # The checker knows joints that decelerate each by itself.
    cancel = None if limits.cancel is None or limits.cancel.together else limits.cancel
    search = _ProofSearch(robot, motion, bounds, tolerance, least, cancel, say)
    if reason := unlike(motion, search.motion):
        return Certificate(None, Verdict(False, (), {}, 0), reason=reason)
    search.run()
    sampled = _sampled(robot, motion, worst)
    if tolerance is not None:
        sampled += search.run_within(limits, worst, tolerance)
    if cancel is not None and robot.arm is not None:
        search.run_cancels(limits, worst)
    if robot.carried:
        search.run_objects(limits, worst)
    proved = proved_of_cancels(search.bounds).union(name for name in search.bounds if "[" in name)
    sampled = tuple(name for name in sampled if name not in proved)
    data, verdict = search.checked()
    return Certificate(
        data,
        verdict,
        kept(limits, data["bounds"]),
        search.undecided(),
        sampled,
        seconds=time.perf_counter() - began,
        speeds_within=verdict.holds and data["bounds"].get(SPEED_OF_POINTS_WITHIN, np.inf) <= 1,
        cancels=verdict.holds
        and proved.issuperset(every_of_cancels(tolerance is not None))
        and not robot.carried,  # what cancels do to objects is only sampled
        worst={name: one.value for name, one in worst.items()},
    )


def _sampled(robot: StandingMechanism, motion: Trajectory, worst: Mapping[str, Worst]) -> tuple[str, ...]:
    """Names of worst values that the proof says nothing of; on springs it is of rigid feet."""
    rigid = () if robot.support.elastic is None else ("GT",)
    covered = {*_COVERED, *CLAIMS_WITHIN, TORQUES, f"{CLEARANCE}_m", *robot.further_limits.names}
    covered -= {"jerk_ratio"} if motion.jerk_source else set()
    return (*rigid, *(name for name in worst if name not in covered))


@dataclass
class _Batch:
    """Piece, ends in u, forces there (2, rules, contacts, 3, N), directions by (interval, pair)."""

    piece: np.ndarray
    start: np.ndarray
    end: np.ndarray
    forces: np.ndarray
    directions: dict[tuple[int, int], np.ndarray] = field(default_factory=dict)

    def select(self, rows: np.ndarray) -> _Batch:
        place = {int(row): k for k, row in enumerate(rows)}
        kept = {(place[i], pair): d for (i, pair), d in self.directions.items() if i in place}
        return _Batch(self.piece[rows], self.start[rows], self.end[rows], self.forces[..., rows], kept)


class _ProofSearch:
    def __init__(
        self,
        robot: StandingMechanism,
        motion: Trajectory,
        bounds: dict[str, float],
        tolerance: Mapping[str, Any] | None,
        least: Mapping[str, float],
        cancel: Cancel | None,
        say: Callable[[str], None],
    ) -> None:
        self.robot, self.bounds, self._least, self._fastest = robot, bounds, least, 0.0
        self._say = say
        self.motion = motion_data(motion, robot.acts.drive_profile)
        self.model = model_data(robot, self.motion["times"][-1][1], cancel)
        self._covers_of_cancels: dict[str, Any] = {}
        self._objects: list[dict[str, Any]] = []
        varying = robot.varying
        self.knots = np.empty(0) if varying is None else np.asarray(varying.knots)
        self.checker = Checker(self.model, bounds, tolerance, self.motion)
        self._separations = Separations(Robot.of(robot), self.model) if robot.arm is not None else None
        self._interior = Interior(robot.support)
        self._done: list[_Batch] = []
        self._open: list[tuple[_Batch, dict[str, np.ndarray]]] = []
        self._tolerance: dict[str, Any] | None = None
        self._cover_within: dict[str, Any] | None = None
        self._short: list[Undecided] = []

    def run(self) -> None:
        """Bisect until all is proved, or more intervals than promised were tried."""
        piece, start, end = [], [], []
        for k, (a, b) in enumerate(self.motion["times"]):
            ends = np.linspace(-1, 1, max(1, int(np.ceil((b - a) / _LONGEST))) + 1)
            knots = self.knots[(self.knots > a + _SHORTEST) & (self.knots < b - _SHORTEST)]
            ends = np.union1d(ends, 2 * (knots - a) / ((b - a) or 1.0) - 1)
            piece += [k] * (len(ends) - 1)
            start.append(ends[:-1])
            end.append(ends[1:])
        todo = np.array(piece), np.concatenate(start), np.concatenate(end)
        most = _MOST if self.checker.contacts.flat else _MOST_OFF_A_PLANE
        left, times = most * len(piece), np.array(self.motion["times"])
        for halvings in count():
            if not len(todo[0]):
                break
            lasts = 0.5 * (times[todo[0], 1] - times[todo[0], 0]) * (todo[2] - todo[1])
            self._say(f"proving the nominal motion: {percent(1 - np.sum(lasts) / times[-1, 1])} of it ...")
            batch, margins = self._checked(*todo)
            fastest = 1 - margins.pop(CLAIMS_OF_POINTS[SPEED_OF_POINTS_WITHIN], np.ones(len(batch.piece)))
            if halvings >= _LOWER_AFTER:
                self._lower(margins)
            proved = np.all([margin >= 0 for margin in margins.values()], axis=0)
            self._done.append(batch.select(np.flatnonzero(proved)))
            left -= len(proved)
            rows = np.flatnonzero(~proved & ((lasts > _SHORTEST) & (left > 0)))
            self._fastest = max(self._fastest, np.max(np.delete(fastest, rows), initial=0.0))
            if len(given_up := np.setdiff1d(np.flatnonzero(~proved), rows)):
                lacking = {name: margin[given_up] for name, margin in margins.items()}
                self._open.append((batch.select(given_up), lacking))
            piece, start, end = batch.piece[rows], batch.start[rows], batch.end[rows]
            middle = 0.5 * (start + end)
            todo = np.r_[piece, piece], np.r_[start, middle], np.r_[middle, end]
        if SPEED_OF_POINTS_WITHIN in self.bounds:
            self.bounds[SPEED_OF_POINTS_WITHIN] = self._fastest + LOSS * max(self._fastest, 0.1)

    def _lower(self, margins: dict[str, np.ndarray]) -> None:
        """Claim the clearance of delayed joints that is proved, if that keeps the limit.

        What one direction cannot separate for all delays does not become less in shorter intervals.
        """
        short = 1e-9 - float(np.min(margins.get(_LATE_CLEARANCE, np.inf)))
        if 0 < short <= self.bounds.get(CLEARANCE, -np.inf) - self._least[CLEARANCE]:
            self.bounds[CLEARANCE] -= short
            margins[_LATE_CLEARANCE] = margins[_LATE_CLEARANCE] + short

    def run_within(
        self, limits: Limits, worst: Mapping[str, Worst], whole: dict[str, Any]
    ) -> tuple[str, ...]:
        """Prove the contacts within the tolerance, else at least with all joints on time; what is missing."""
        weakest = worst_case_of(self.robot, limits.tolerance).footing
        goals = {name: goal_within(limits, worst, name) for name in CLAIMS_WITHIN}
        on_time, self._short = {**whole, **_ON_TIME}, lost_as_sampled(worst)
        worlds = () if self._short else (whole, on_time) if whole != on_time else (whole,)
        for tolerance, (short, most_short) in product(worlds, self._goals(goals)):
            given = self.model, self.motion, tolerance, short, self.knots
            search = SearchWithin(weakest, *given, say=self._say)
            result = search.claims(most_short)
            if result is None:
                continue
            if not self._short:
                self._short = [Undecided(*one) for one in result.short]
            if not result.short:
                self._tolerance, self._cover_within = tolerance, result.cover
                self.bounds.update(result.bounds)
                break
        if self._tolerance is whole:
            return ()
        self.bounds.pop(SPEED_OF_POINTS_WITHIN, None)
        lost = [CLEARANCE] if self._tolerance else [CLEARANCE, TORQUES]
        lost = [name for name in lost if self.bounds.pop(name, None) is not None]
        if self._tolerance is not None:
            return (*LATE, *lost)
        return (*CLAIMS_WITHIN, *lost)

    def run_cancels(self, limits: Limits, worst: Mapping[str, Worst]) -> None:
        """Prove that no cancel loses a contact, unless one does as sampled."""
        given = Robot.of(self.robot), self.model, self.motion, self._tolerance
        result = cancel_claims(*given, limits, worst, self.knots, self._say)
        self.bounds |= result.bounds
        self._covers_of_cancels = result.cover
        self._short += [Undecided(*one) for one in result.short]

    def run_objects(self, limits: Limits, worst: Mapping[str, Worst]) -> None:
        """Prove the contacts of objects, each by itself; of those without a proof nothing is claimed."""
        found_objects = object_claims(
            Robot.of(self.robot), self.model, self.motion, self._tolerance, limits, worst, self.knots
        )
        self.bounds |= found_objects.bounds
        self._objects, self._short = (
            found_objects.proofs,
            [*self._short, *(Undecided(*one) for one in found_objects.short)],
        )
        if found_objects.model:
            self.model[OBJECTS] = found_objects.model

    def _goals(self, goals: dict[str, float]) -> list[tuple[dict[str, float], float]]:
        """Goals one after the other, and the share of intervals that may be short of them at first.

        Off a plane one rule has to share both the wrench and the moments that are left, so that these are
        proved with a margin only: all, half, or nearly none of them.
        """
        if self.checker.contacts.flat:
            return [(goals, 1.0)]
        GN = goals[TIP_WITHIN]
        half = min(GN / (0.5 + 0.5 * GN), HIGHEST)  # half of what is left
        return [
            ({**goals, TIP_WITHIN: most}, some) for most, some in ((GN, 0.2), (half, 0.5), (HIGHEST, 1.0))
        ]

    def _checked(
        self, piece: np.ndarray, start: np.ndarray, end: np.ndarray
    ) -> tuple[_Batch, dict[str, np.ndarray]]:
        ends = np.concatenate([np.column_stack([piece, start]), np.column_stack([piece, end])])
        unique, where = np.unique(ends, axis=0, return_inverse=True)
        by_rule = [
            np.stack(np.split(forces[..., where.reshape(-1)], 2, axis=-1))
            for forces in self._forces(unique[:, 0].astype(int), unique[:, 1])
        ]
        batch, time_intervals = (
            _Batch(piece, start, end, by_rule[0]),
            Intervals(self.motion, piece, start, end),
        )
        loads, count = self.checker.loads(time_intervals), len(self.model["pairs"])
        middles = [form.c[0].T for form in (time_intervals.q, loads.late) if form is not None]

        def directions(intervals: np.ndarray, pairs: np.ndarray) -> np.ndarray:
            assert self._separations is not None  # who asks has bodies
            middle = middles[np.max(pairs) // count]  # of joints on time, or late
            towards = self._separations(middle[intervals], pairs % count)
            asked = zip(intervals.tolist(), pairs.tolist(), strict=True)
            batch.directions.update(zip(asked, towards, strict=True))
            return towards

        margins = self.checker.margins(time_intervals, loads, by_rule[0], directions)
        short = (margins["contacts"] < 0) | (margins["tip-over"] < 0)
        loaded = np.any(by_rule[1] != 0, axis=3)  # (2, rules, contacts, N)
        rows = np.flatnonzero(
            short & np.all(loaded[0] == loaded[1], axis=(0, 1)) & ~np.all(loaded, axis=(0, 1, 2))
        )
        if len(rows):
            for name, margin in self.checker.contact_margins(
                loads.wrench[:, rows], by_rule[1][..., rows]
            ).items():
                margins[name][rows] = margin
            batch.forces[..., rows] = by_rule[1][..., rows]
        return batch, margins

    def _forces(self, piece: np.ndarray, u: np.ndarray) -> list[np.ndarray]:
        """(rules, contacts, 3, N) that hold the wrench, and the wrench with each couple, by two rules."""
        left, right = np.array(self.motion["times"])[piece].T
        times = 0.5 * (left + right) + 0.5 * (right - left) * u
        if self.robot.acts.end:  # where its acceleration steps, that of the piece
            far = np.where(piece == 0, -_ASIDE, np.where(right > left, 0.0, _ASIDE))
            near = np.minimum(_ASIDE, 0.25 * (right - left))
            times = np.clip(times, left + near, right - near) + far
        acting = self.robot.acting(times)
        wrenches = self.robot.loads(*states_at(self.motion, piece, u), acting)[1]
        every = np.concatenate([wrenches, *(wrenches + couple for couple in self.checker.contacts.couples)])
        slip = self.robot.slip.evaluate(
            self.robot.contact_states(every), derivatives=False, least=0.5 * self.bounds["GT"]
        )
        forces = slip.forces
        share = np.where(np.arange(len(every)) < len(wrenches), self.bounds["GT"], 1.0)  # couples take all
        by_rule = self._interior.between(forces, every, share), self._interior.without(forces, every)
        return [np.moveaxis(way.reshape(-1, len(u), *way.shape[1:]), 1, -1) for way in by_rule]

    def undecided(self) -> tuple[Undecided, ...]:
        """The intervals that remain undecided, with neighbours merged."""
        results, times = [], np.array(self.motion["times"])
        for batch, margins in self._open:
            a, b = times[batch.piece].T
            start, end = (a + 0.5 * (u + 1) * (b - a) for u in (batch.start, batch.end))
            for name, margin in margins.items():
                for k in np.flatnonzero(~(margin >= 0)):
                    results.append(
                        Undecided(float(start[k]), float(end[k]), name, float(min(-margin[k], 1e9)))
                    )
        return _joined([*results, *self._short])

    def checked(self) -> tuple[dict[str, Any], Verdict]:
        """The certificate, and what the checker says of it.

        Whether friction is shown to be enough for a claim of GT does not follow from a lower one: rows may
        be short at that of all rows. Then it is claimed a little higher.
        """
        data = self.data()
        verdict = check_certificate(data)
        for _ in range(_HIGHER if self._cover_within and not self._open else 0):
            if verdict.holds:
                break
            higher = self.bounds[SLIP_WITHIN] * (1 + 2 * LOSS)
            data["bounds"] = self.bounds = {**self.bounds, SLIP_WITHIN: min(higher, HIGHEST)}
            verdict = check_certificate(data)
        return data, verdict

    def data(self) -> dict[str, Any]:
        """The certificate."""
        batches = [*self._done, *(batch for batch, _ in self._open)]
        cover: list[list[tuple[float, _Batch, int]]] = [[] for _ in self.motion["times"]]
        towards: dict[tuple[int, int], list[tuple[int, np.ndarray]]] = {}
        for number, batch in enumerate(batches):
            for k in range(len(batch.piece)):
                cover[batch.piece[k]].append((float(batch.start[k]), batch, k))
            for (k, pair), d in batch.directions.items():
                towards.setdefault((number, k), []).append((pair, d))
        numbers = {id(batch): number for number, batch in enumerate(batches)}
        parts, known = [], len(self.model["pairs"]) * (1 + (CLEARANCE in self.bounds))  # late ones if claimed
        for part in cover:
            part.sort(key=lambda entry: entry[0])
            _, last, k = part[-1]
            parts.append(
                {
                    "ends": [*(start for start, _, _ in part), float(last.end[k])],
                    "forces": [batch.forces[..., i].tolist() for _, batch, i in part],
                    "directions": [
                        [n, pair, *d.tolist()]
                        for n, (_, batch, i) in enumerate(part)
                        for pair, d in towards.get((numbers[id(batch)], i), [])
                        if pair < known
                    ],
                }
            )
        return {
            "format": FORMAT,
            "model": self.model,
            "motion": self.motion,
            "tolerance": self._tolerance,
            "bounds": self.bounds,
            "cover": parts,
            "cover_within": self._cover_within,
            **self._covers_of_cancels,
            **({OBJECTS: self._objects} if self._objects else {}),
            "sha256": {
                "model": digest(self.model),
                "motion": digest(self.motion),
                "tolerance": digest(self._tolerance),
            },
        }


def _joined(parts: list[Undecided]) -> tuple[Undecided, ...]:
    """Neighbours as one."""
    undecideds: list[Undecided] = []
    for one in sorted(parts, key=lambda one: (one.claim, one.start)):
        last = undecideds[-1] if undecideds else None
        if last and last.claim == one.claim and one.start <= last.end + 1e-9:
            end, short = max(last.end, one.end), max(last.short, one.short)
            undecideds[-1] = Undecided(last.start, end, one.claim, short)
        else:
            undecideds.append(one)
    return tuple(undecideds)
