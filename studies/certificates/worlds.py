"""Worlds inside the uncertainty of proved motions: is one of them worse than proved?

    python -m studies.certificates.worlds --out OUT [--worlds 10000] [--seed 0] [--only NAME ...]

The committed plans of the eight cases on both bases, slower where need be, and ten new motions are proved
within every kind of uncertainty at once: workshop, and boxes of both centres of mass, pushes at gripper and
base. Each certificate is attacked from its data alone, with a model of the arm in NumPy
(`tests.oracles.worlds`), own lines of tipping and a cone program for contact forces
(`studies.certificates.margins`): random corners first, each joint late by itself or overshooting its jumps,
every tenth world inside; from the worst of them one quantity after the other goes to its worst, and times and
delays descend. Writes OUT/attacked_worlds.json and .md and keeps certificates in OUT/certificates. Goes on:
finished rows and certificates are kept.
"""

from __future__ import annotations

import argparse
import gzip
import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import OcptipError
from ocptip.basics.write import versions, write_text
from ocptip.certificate.find import certify
from ocptip.motion.check import check_motion
from ocptip.motion.violations import sentence
from ocptip.published.cases import motion_cases
from ocptip.published.tasks import BASES, experiment_task
from ocptip.standing.arm import Robot
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import WORKSHOP, Uncertainty
from ocptip.trajectories.read import load_motion
from ocptip.trajectories.trajectory import Trajectory
from studies.certificates.margins import ContactMargins
from studies.certificates.new_motions import new_motions
from studies.common import (
    RESULTS,
    RowFile,
    ended,
    number,
    progress,
    software,
    source_state,
    state_notes,
    table,
)
from tests.oracles.worlds import ArmOnBase, Worlds

_NAME = "attacked_worlds"
_STATE = ("certificate", "contact", "motion", "reserves", "robots", "standing", "trajectories")
EVERYTHING = replace(
    WORKSHOP,
    center_of_mass=(0.005, 0.005, 0.01),
    payload_center=(0.01, 0.01, 0.01),
    push=2.0,
    base_push=5.0,
)
_SHARES, _SLOWER = (1.0, 0.5, 0.2, 0.05), (1.0, 2.0, 4.0)  # of everything, and times, until one is proved
_INSIDE = 10  # every so many worlds is anywhere inside
_NEAR, _JUMPING = 0.7, 0.6  # shares of times near an event, of joints that are at a jump
_KEPT, _ROUNDS, _DESCENTS = 100, 3, 12
_SLIPS, _SLIP_ROUNDS = 40, 4  # wrenches whose contact forces are solved, so many times
_ROUNDING = 1e-7  # N m or N, relative to the base's weight


# --- joints that are late -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Choices:
    """What joints are doing in N worlds.

    Attributes:
        times: (N,), s, in the motion's own time.
        late: (N, n), s.
        event: (N, n) number of the event that a joint is at; -1: it is late.
        way: (N, n) at an event: 0 before its jump, 1 after it, 2 overshooting it, 3 and all jumps before.
    """

    times: np.ndarray
    late: np.ndarray
    event: np.ndarray
    way: np.ndarray

    def some(self, rows: np.ndarray) -> Choices:
        """Of some rows."""
        return Choices(self.times[rows], self.late[rows], self.event[rows], self.way[rows])

    def where(self, chosen: np.ndarray, other: Choices) -> Choices:
        """These where chosen (N,), else the others."""
        pairs = ((getattr(self, key), getattr(other, key)) for key in ("times", "late", "event", "way"))
        return Choices(*(np.where(chosen.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in pairs))


class LateMotion:
    """States of a motion whose joints are late, each by itself.

    Args:
        motion, tolerance: of a certificate.
    """

    def __init__(self, motion: Mapping[str, Any], tolerance: Mapping[str, Any]) -> None:
        self._times, self._c = np.array(motion["times"]), np.array(motion["angles"])
        self.n = self._c.shape[1]
        self.delay = tolerance["delay"] * (1 + tolerance["speed"])
        self._more = tolerance["overshoot"]
        self.events = self._times[:-1, 1]
        self.end = float(self.events[-1]) + self.delay
        joints = np.tile(np.arange(self.n), (len(self.events), 1))
        pieces, at = np.arange(len(self.events))[:, None] + 0 * joints, self.events[:, None] + 0.0 * joints
        step = self._piece(pieces + 1, at, joints)[2] - self._piece(pieces, at, joints)[2]
        small = np.abs(step) <= 1e-5 * np.max(np.abs(step), axis=0, initial=1e-300)
        self._steps = np.where(small, 0.0, step)  # (events, n)

    def draw(self, count: int, rng: np.random.Generator) -> Choices:
        """Random choices, most of them near events."""
        times = rng.uniform(0, self.end, count)
        near = rng.random(count) < _NEAR
        times[near] = rng.choice(self.events, near.sum()) + rng.uniform(0, self.delay, near.sum())
        ends = np.where(rng.random((count, self.n)) < 0.5, 0.0, self.delay)
        late = np.where(rng.random(ends.shape) < 0.6, ends, rng.uniform(0, 1, ends.shape) * self.delay)
        at_jump = rng.random(ends.shape) < _JUMPING
        event = np.where(at_jump, rng.integers(0, len(self.events), ends.shape), -1)
        first, last = (np.searchsorted(self.events, x, side) for x, side in self._window(times))
        inside = first[:, None] + np.floor(rng.random(ends.shape) * (last - first)[:, None]).astype(int)
        event = np.where(at_jump & (last > first)[:, None], inside, -1)
        return Choices(times, late, event, rng.integers(0, 4, ends.shape))

    def _window(self, times: np.ndarray) -> tuple[tuple[np.ndarray, str], tuple[np.ndarray, str]]:
        return (times - self.delay, "left"), (times, "right")

    def moved(self, own: Choices, scale: float, rng: np.random.Generator) -> Choices:
        """Choices nearby: times and delays moved, one joint in four drawn anew."""
        count = len(own.times)
        times = own.times + scale * rng.normal(size=count) * max(self.delay, 2e-3)
        # joints stay at their events
        at = self.events[np.maximum(own.event, 0)]
        times = np.clip(
            times,
            np.max(np.where(own.event >= 0, at, -np.inf), axis=1),
            np.min(np.where(own.event >= 0, at + self.delay, np.inf), axis=1),
        )
        times = np.clip(times, 0.0, self.end)
        late = np.clip(own.late + scale * rng.normal(size=own.late.shape) * self.delay, 0.0, self.delay)
        late = np.where(rng.random(late.shape) < 0.2, np.where(late > self.delay / 2, self.delay, 0.0), late)
        fresh = replace(self.draw(count, rng), times=times)
        first, last = (np.searchsorted(self.events, x, side) for x, side in self._window(times))
        inside = first[:, None] + np.floor(rng.random(late.shape) * (last - first)[:, None]).astype(int)
        event = np.where((fresh.event >= 0) & (last > first)[:, None], inside, -1)
        new = rng.random(late.shape) < 0.25
        return Choices(
            times,
            np.where(new, fresh.late, late),
            np.where(new, event, own.event),
            np.where(new, fresh.way, own.way),
        )

    def states(self, own: Choices) -> list[np.ndarray]:
        """Coordinates, speeds, accelerations, (N, n) each."""
        joints = np.tile(np.arange(self.n), (len(own.times), 1))
        T = own.times[:, None] - own.late
        piece = np.clip(np.searchsorted(self.events, T), 0, len(self._times) - 1)
        found = self._piece(piece, np.clip(T, 0.0, self.events[-1]), joints)
        event, rows = np.maximum(own.event, 0), own.event >= 0
        at = self._piece(event + (own.way > 0), self.events[event], joints)
        sums = self._sums(own, event, joints)
        more = np.where(own.way == 2, self._steps[event, joints], np.where(own.way == 3, sums, 0.0))
        at[2] = at[2] + self._more * more
        return [np.where(rows, a, b) for a, b in zip(at, found, strict=True)]

    def _sums(self, own: Choices, event: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """Of jumps since the delay began, or since the one that makes most of it, up to an event."""
        summed = np.concatenate([np.zeros((1, self.n)), np.cumsum(self._steps, axis=0)])
        first = np.searchsorted(self.events, own.times - self.delay)[:, None] + 0 * event
        return summed[event + 1, joints] - summed[np.minimum(first, event), joints]

    def _piece(self, piece: np.ndarray, t: np.ndarray, joints: np.ndarray) -> list[np.ndarray]:
        left, right = self._times[piece, 0], self._times[piece, 1]
        half = 0.5 * (right - left)
        rate = np.where(half > 0, 1 / np.where(half > 0, half, 1.0), 0.0)
        u, c, found = (t - 0.5 * (left + right)) * rate, self._c[piece, joints], []
        for order in range(3):
            powers = u[..., None] ** np.arange(c.shape[-1])
            found.append(np.sum(c * powers, axis=-1) * rate**order)
            c = c[..., 1:] * np.arange(1, c.shape[-1])
        return found


# --- the attack ---------------------------------------------------------------------------------------------


class Attack:
    """On one certificate.

    Args:
        data: the certificate.
        worlds: number of them.
        seed: of the random ones.
    """

    def __init__(self, data: Mapping[str, Any], worlds: int, seed: int) -> None:
        self._model, self._tolerance = data["model"], data["tolerance"]
        self._bounds, self._count = data["bounds"], worlds
        self._rng = np.random.default_rng(seed)
        self._arm = ArmOnBase(self._model, self._tolerance)
        self._late = LateMotion(data["motion"], self._tolerance)
        self.contacts = ContactMargins(self._model, 1 - self._tolerance["friction"])
        self.weight = float(np.linalg.norm(self._arm.base["gravity"]) * self._arm.base["mass"])
        drawn = self._late.draw(worlds, self._rng)
        inside = np.arange(worlds) % _INSIDE == _INSIDE - 1
        corners, within = self._arm.corners(worlds, self._rng), self._arm.inside(worlds, self._rng)
        self._first = within.where(inside, corners), drawn

    def run(self) -> dict[str, Any]:
        """Least moments and margins of contact forces that are found, beside what is proved."""
        unit = self._model["base"]["reference_moment"]
        share, most = self._bounds["GT_worst_case"], self._bounds["GN_worst_case"]
        wrenches = self._wrenches(*self._first)
        found: dict[str, Any] = {"flat": self.contacts.flat, "worlds": self._count}
        if self.contacts.flat:
            found["moment_proved"] = unit * (1 / most - 1)
            sampled, least = np.inf, np.inf
            for h, added in zip(self.contacts.axes, self.contacts.added, strict=True):
                values = wrenches @ h + added
                sampled = min(sampled, float(np.min(values)))
                least = min(least, self._descended(h, np.argsort(values)[:_KEPT]) + added)
            found |= {"moment_sampled": sampled, "moment_found": least}
        found |= self._slipped(wrenches, share)
        return found

    def _wrenches(self, worlds: Worlds, choices: Choices) -> np.ndarray:
        return self._arm.wrench(worlds, *self._moved(choices))

    def _moved(self, choices: Choices) -> tuple[Any, np.ndarray]:
        return self._arm.moved(*self._late.states(choices)), self._acting(choices.times)

    def _acting(self, times: np.ndarray) -> np.ndarray:
        """(N, 12): what acts on the gripper at these times."""
        own, found = self._arm.arm, np.zeros((len(times), 12))
        for k, key in enumerate(("process_in_base", "process_on_link")):
            values = own.get(key, np.zeros(6))
            if "process_times" in own:
                columns = [np.interp(times, own["process_times"], column) for column in values.T]
                found[:, 6 * k : 6 * k + 6] = np.array(columns).T
            else:
                found[:, 6 * k : 6 * k + 6] = values
        return found

    def _descended(self, h: np.ndarray, rows: np.ndarray) -> float:
        """Least h . wrench from some of the worlds on."""
        return float(np.min(self._improved(np.tile(h, (len(rows), 1)), *self._some(rows))[2]))

    def _some(self, rows: np.ndarray) -> tuple[Worlds, Choices]:
        worlds, choices = self._first
        return worlds.some(rows), choices.some(rows)

    def _improved(
        self, h: np.ndarray, worlds: Worlds, choices: Choices
    ) -> tuple[Worlds, Choices, np.ndarray]:
        """Worlds and choices at which functionals h (N, 6) are less, and the values."""
        best = np.sum(h * self._wrenches(worlds, choices), axis=1)
        for k in range(_ROUNDS):
            worlds, best = self._arm.least(h, worlds, *self._moved(choices), rounds=2)
            for step in range(_DESCENTS):
                other = self._late.moved(choices, 0.7 ** (step + k), self._rng)
                new = np.sum(h * self._wrenches(worlds, other), axis=1)
                choices, best = other.where(new < best, choices), np.minimum(new, best)
        return worlds, choices, best

    def _slipped(self, wrenches: np.ndarray, share: float) -> dict[str, Any]:
        """Least margins of contact forces at the share of friction that is proved to be enough."""
        rows = self._rng.choice(len(wrenches), min(_SLIPS, len(wrenches)), replace=False)
        worst, wrench = np.inf, wrenches[rows[0]]
        sampled = np.inf
        for _ in range(_SLIP_ROUNDS):
            found = [self.contacts.inside(w, share) for w in wrenches[rows]]
            values = np.array([value for value, _ in found])
            sampled = min(sampled, float(np.min(values)))
            slopes = np.array([slope for _, slope in found])
            slopes = slopes[np.argsort(values)[: _SLIPS // 2]]
            near = np.argmin(wrenches @ slopes.T, axis=0)  # of each slope the world that it says is worst
            worlds, choices, _ = self._improved(slopes, *self._some(near))
            own = self._wrenches(worlds, choices)
            margins = np.array([self.contacts.inside(w, share)[0] for w in own])
            k = int(np.argmin(margins))
            if margins[k] < worst:
                worst, wrench = float(margins[k]), own[k]
            rows = np.concatenate([near, self._rng.choice(len(wrenches), _SLIPS // 4)])
        low, high = 0.0, 1.0
        while high - low > 1e-5:
            middle = 0.5 * (low + high)
            enough = self.contacts.inside(wrench, middle)[0] >= -_ROUNDING * self.weight
            low, high = (low, middle) if enough else (middle, high)
        return {"force_sampled": sampled, "force_found": worst, "GT_found": high, "GT_proved": share}


def holds(row: Mapping[str, Any]) -> bool:
    """Nothing that was found is worse than proved, but for rounding."""
    room = _ROUNDING * row["weight"]
    return row["force_found"] >= -room and (
        not row["flat"] or row["moment_found"] >= row["moment_proved"] - room
    )


# --- motions ------------------------------------------------------------------------------------------------


def committed() -> Iterator[tuple[str, Robot, Trajectory, Uncertainty]]:
    """The plans of the cases."""
    for case in motion_cases():
        for base in BASES:
            task = experiment_task(case, base)
            yield (
                f"{case} {base}",
                task.robot,
                load_motion(RESULTS / "plans" / f"{case}-{base}" / "plan.json"),
                EVERYTHING,
            )


def proved(
    robot: Robot, motion: Trajectory, tolerance: Uncertainty
) -> tuple[Mapping[str, Any] | None, float, float, str]:
    """The certificate of a motion within as much as it can have of a tolerance, slower where need be.

    Returns the certificate, the share, how many times as long it takes, and else why there is none.
    """
    why = ""
    for share, slower in product(_SHARES, _SLOWER):
        own, limits = (
            motion.time_scaled(slower),
            Limits(tolerance=tolerance.scaled(share), clearance=0.0),
        )
        checked = check_motion(robot, own, limits)
        if checked.violations:
            why = why or f"not kept: {sentence(checked.violations[0]).split(' (')[0]}"
            continue
        found = certify(robot, own, limits, checked.worst)
        if found.certified:
            return found.data, share, slower, ""
        why = f"not proved: {found.undecided[0] if found.undecided else found}"
    return None, 0.0, 0.0, why


def _certificate(
    folder: Path, name: str, make: Callable[[], tuple[Mapping[str, Any] | None, float, float, str]]
) -> dict[str, Any]:
    path = folder / f"{name.replace(' ', '-')}.json.gz"
    if path.exists():
        return json.loads(gzip.decompress(path.read_bytes()))
    data, share, slower, why = make()
    found = {"data": data, "share": share, "slower": slower, "why": why, "source": source_state(*_STATE)}
    folder.mkdir(parents=True, exist_ok=True)
    path.write_bytes(gzip.compress(json.dumps(found).encode(), mtime=0))
    return found


def _row(name: str, kept: Mapping[str, Any], options: argparse.Namespace) -> dict[str, Any]:
    row: dict[str, Any] = {"name": name, **{key: kept[key] for key in ("share", "slower", "why")}}
    if kept["data"] is None:
        return row
    began = time.process_time()
    attack = Attack(kept["data"], options.worlds, options.seed)
    row |= attack.run() | {"weight": attack.weight}
    return row | {"seconds": time.process_time() - began, "holds": holds(row)}


def _markdown(rows: Sequence[Mapping[str, Any]], notes: Sequence[str], options: Mapping[str, Any]) -> str:
    moments = ["least moment sampled, N m", "found", "proved"]
    head = ["motion", "of everything", "times as long", *moments, "GT found", "proved", "CPU s", "claim"]
    lines = [
        "# Worlds against proofs",
        "",
        f"{options['worlds']} worlds each, seed {options['seed']}; of the worst ones all quantities, times",
        "and delays descend. Moments are what is left about the nearest tipping axis: sampled in the first",
        "worlds, found by descent, proved; contacts off one plane have no single one.",
        "",
        *table(head, map(_cells, rows), left=1),
        "",
    ]
    broken = [row["name"] for row in rows if not row.get("holds", True)]
    attacked = sum("holds" in row for row in rows)
    lines += [f"{attacked} proofs attacked; worlds worse than proved: {', '.join(broken) or 'none'}.", ""]
    return "\n".join([*lines, *notes, f"{software(versions())}."]) + "\n"


def _cells(row: Mapping[str, Any]) -> list[str]:
    if "holds" not in row:
        return [row["name"], *[""] * 8, row["why"]]
    keys = ("moment_sampled", "moment_found", "moment_proved")
    moments = [number(row.get(key)) for key in keys]
    ratios = [f"{row[key]:.4f}" for key in ("GT_found", "GT_proved")]
    claim = "holds" if row["holds"] else "BROKEN"
    return [
        row["name"],
        f"{100 * row['share']:g} %",
        f"{row['slower']:g}",
        *moments,
        *ratios,
        f"{row['seconds']:.0f}",
        claim,
    ]


def _study(options: argparse.Namespace) -> str:
    state = source_state(*_STATE)
    shared = {"worlds": options.worlds, "seed": options.seed}
    rows = RowFile(options.out / f"{_NAME}.json", shared, ("name",), state)
    every = [*committed(), *new_motions()]
    for k, (name, robot, motion, tolerance) in enumerate(every):
        if (options.only and name not in options.only) or rows.find(name=name) is not None:
            continue
        progress(k, len(every), name)
        try:
            kept = _certificate(
                options.out / "certificates",
                name,
                lambda robot=robot, motion=motion, tolerance=tolerance: proved(robot, motion, tolerance),
            )
        except OcptipError as error:
            kept = {"data": None, "share": 0.0, "slower": 0.0, "why": str(error)}
        rows.put(_row(name, kept, options))
    order = {name: k for k, (name, *_) in enumerate(every)}
    own = sorted(rows.own, key=lambda row: order.get(row["name"], len(order)))
    notes = state_notes([row.get("state") for row in own], state)
    text = _markdown(own, notes, shared)
    write_text(options.out / f"{_NAME}.md", text)
    return text


def main(arguments: Sequence[str] | None = None) -> int:
    """Attack, and write what came of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--worlds", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", default=())
    options = parser.parse_args(arguments)
    return ended("worlds", lambda: _study(options), "finished rows are kept.")


if __name__ == "__main__":
    sys.exit(main())
