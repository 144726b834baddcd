"""Attacks on what certificates claim: are there worlds inside a tolerance that are worse than proved?

    python -m studies.certificates.attack --out OUT [--parts arms changes swings] [--worlds 20000] [--seed 0]

Swings of the eight cases, slower ones where need be, are certified within `workshop`. Then worlds are drawn
at random: every joint by itself late, or overshooting the sum of its last steps where it jumps; all masses,
centres, tilt, pushes and pace at ends of their intervals or where a moment or the slip grows fastest, by the
exact contact solver. From the worst ones instants and delays are moved on, as long as that makes it worse.
The certificate must claim no less. Besides: functionals of the wrench of random arms against ball arithmetic,
and changed certificates (`tests/certificate/test_within_in_balls.py`, `test_mutations.py`). Writes
OUT/certificates_attacked.json and .md, part by part, swing by swing; swings that are there already, of as
many worlds and the same seed, are kept.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.write import plain, versions, write_text
from ocptip.certificate.find import certify
from ocptip.certificate.trusted.checker import CLAIMS_WITHIN
from ocptip.motion.check import check_motion
from ocptip.motion.violations import sentence
from ocptip.published.tasks import BASES, experiment_task
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import WORKSHOP, Uncertainty
from ocptip.standing.within.worst_case import worst_case_of
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from studies.common import RESULTS, machine, progress, software, source_state, table
from tests.certificate.test_mutations import broken
from tests.certificate.test_within_in_balls import check_random_arms
from tests.oracles.world_in_balls import LateJoints

_NAME = "certificates_attacked"
_STATE = ("certificate", "contact", "motion", "reserves", "robots", "standing", "trajectories")
_ROUNDS, _KEPT = 30, 200
_PARTS = ("arms", "changes", "swings")
_SLOWER = (1.0, 2.0, 4.0)  # times of swings, until one is certified
_INTERVALS, _EACH = 10, 2  # of an arm, worlds of each
_NO_DELAY = {"delay": 0.0, "damping": None}
_HEAD = ("case", "base", "time x", "claim", "worlds", "GN found", "GN proved", "GT found", "GT proved")

Badness = Callable[[np.ndarray], np.ndarray]


def swing(case: str, base: str) -> tuple[Any, Trajectory]:
    """A robot, and a swing of its joints by two fifths of the way of its task."""
    task = experiment_task(case, base)
    commands = [
        [RampCommand(a + 0.4 * w, 0.25 * v, 0.8)]
        for a, w, v in zip(task.start, task.goal - task.start, task.robot.limits.speed, strict=True)
    ]
    return task, Trajectory.from_profiles(task.start, commands)


def attack(
    task: Any, motion: Trajectory, tolerance: Uncertainty, data: Mapping[str, Any], worlds: int, seed: int
) -> tuple[float, float]:
    """Greatest GN and GT that are found in worlds with late joints."""
    rng, late = np.random.default_rng(seed), LateJoints(data["motion"], data["tolerance"])
    cases = worst_case_of(task.robot, replace(tolerance, **_NO_DELAY))
    drawn = [late.draw(float(rng.uniform(0, late.end)), rng) for _ in range(worlds)]

    def tipping(states: np.ndarray) -> np.ndarray:
        if not cases.axes:
            return np.zeros(len(states))
        return np.max(cases.tip_ratio(cases.all_moments(states)), axis=1)

    def slipping(states: np.ndarray) -> np.ndarray:
        return cases.slip(states, 2).values

    return _climbed(late, drawn, tipping, tipping, rng), _climbed(
        late, drawn, cases.estimated_slip, slipping, rng
    )


def _climbed(
    late: LateJoints, drawn: Sequence[Any], first: Any, exact: Any, rng: np.random.Generator
) -> float:
    states = np.array([late.state(choice).ravel() for choice in drawn])
    values = np.concatenate([first(part) for part in np.array_split(states, max(1, len(states) // 5000))])
    best = [drawn[k] for k in np.argsort(-values)[:_KEPT]]
    found = exact(np.array([late.state(choice).ravel() for choice in best]))
    for k in range(_ROUNDS):
        others = [late.moved(choice, 0.8**k, rng) for choice in best]
        new = exact(np.array([late.state(choice).ravel() for choice in others]))
        best = [b if y > x else a for a, b, x, y in zip(best, others, found, new, strict=True)]
        found = np.maximum(found, new)
    return float(np.max(found))


def _swings(worlds: int, seed: int, done: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    kept = {
        (own["case"], own["base"])
        for own in done
        if (own["worlds"], own["seed"]) == (worlds, seed) and "proved" in own
    }
    asked = [(case, base) for case in "GBDHACEF" for base in BASES if (case, base) not in kept]
    for k, (case, base) in enumerate(asked):
        progress(k, len(asked), f"{case} {base}")
        task, motion = swing(case, base)
        limits = Limits(tolerance=WORKSHOP)
        row: dict[str, Any] = {"case": case, "base": base, "worlds": worlds, "seed": seed}
        for slower in _SLOWER:
            own = motion.time_scaled(slower)
            checked = check_motion(task.robot, own, limits)
            found = certify(task.robot, own, limits, checked.worst)
            row |= {"slower": slower, "not_kept": [*map(sentence, checked.violations)]}
            if found.data is not None and found.holds and not found.sampled:
                row["found"] = attack(task, own, WORKSHOP, found.data, worlds, seed)
                row["proved"] = [found.verdict.bounds[name] for name in CLAIMS_WITHIN]
                break
        yield row
    progress(len(asked), len(asked), "")


def _markdown(data: Mapping[str, Any]) -> str:
    lines = ["# Certificates attacked", ""]
    if own := data.get("arms"):
        lines += [
            f"{own['arms']} random arms within random tolerances, {_INTERVALS} random intervals and 3",
            f"functionals of the wrench each, {_EACH} worlds each in ball arithmetic: none is below what is",
            f"proved. The nearest is {own['nearest']:.2g} of the functional's size above it,",
            f"{own['median']:.2g} in the median of the arms. {_made(own)}",
            "",
        ]
    if own := data.get("changes"):
        lines += [
            f"{own['changes']} certificates with one thing changed: {own['accepted']} are accepted, "
            f"{len(own['wrong'])} of these claim what is not so. {_made(own)}",
            *(f"- {text}" for text in own["wrong"]),
            "",
        ]
    if rows := data.get("swings"):
        sources = ", ".join(sorted({row["source"] for row in rows}))
        lines += [
            f"Swings of the cases within `workshop`. The {_KEPT} worst worlds were moved on {_ROUNDS} times.",
            f"Source {sources}.",
            "",
            *table(_HEAD, map(_cells, rows), left=4),
            "",
        ]
    return "\n".join([*lines, f"{machine()}; {software(versions())}."]) + "\n"


def _made(own: Mapping[str, Any]) -> str:
    return f"Seed {own['seed']}, {own['seconds']:.0f} s of CPU, source {own['source']}."


def _cells(row: Mapping[str, Any]) -> list[str]:
    if "found" not in row:
        return [
            row["case"],
            row["base"],
            "",
            f"none made: {[*row['not_kept'], 'not proved'][0]}",
            *[""] * 5,
        ]
    pairs = list(zip(row["found"], row["proved"], strict=True))
    word = "holds" if all(found <= proved + 1e-9 for found, proved in pairs) else "BROKEN"
    return [
        row["case"],
        row["base"],
        f"{row.get('slower', 1.0):g}",
        word,
        f"{row['worlds']}",
        *(f"{x:.5f}" for pair in pairs for x in pair),
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Attack, and write what came of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--out", type=Path, default=RESULTS)
    parser.add_argument("--parts", nargs="+", default=_PARTS, choices=_PARTS)
    parser.add_argument("--worlds", type=int, default=20_000)
    parser.add_argument("--arms", type=int, default=100)
    parser.add_argument("--changes", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    for part in options.parts:
        if part == "swings":
            _swing_on(options)
            continue
        began, own = time.process_time(), {"seed": options.seed, part: getattr(options, part)}
        if part == "arms":
            nearest = check_random_arms(options.arms, _INTERVALS, _EACH, options.seed)
            own |= {"nearest": min(nearest), "median": float(np.median(nearest))}
        else:
            own["wrong"], own["accepted"] = broken(options.changes, options.seed, samples=20)
        own |= {"seconds": time.process_time() - began, "source": source_state(*_STATE)}
        _write(options.out, lambda data, part=part, own=own: {**data, part: own})


def _swing_on(options: argparse.Namespace) -> None:
    for row in _swings(options.worlds, options.seed, _read(options.out).get("swings", [])):
        row["source"] = source_state(*_STATE)
        others = {"case": row["case"], "base": row["base"]}.items()

        def added(data: dict[str, Any], row: Any = row, others: Any = others) -> dict[str, Any]:
            kept = [own for own in data.get("swings", []) if not others <= own.items()]
            return {**data, "swings": sorted([*kept, row], key=lambda own: (own["case"], own["base"]))}

        _write(options.out, added)


def _read(out: Path) -> dict[str, Any]:
    path = out / f"{_NAME}.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def _write(out: Path, change: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
    """The results with a part made anew: others stay."""
    data = change(_read(out))
    write_text(out / f"{_NAME}.json", json.dumps(plain(data), indent=1) + "\n")
    write_text(out / f"{_NAME}.md", _markdown(data))


if __name__ == "__main__":
    main()
