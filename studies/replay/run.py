"""Plans within a tolerance, replayed in MuJoCo from their exported models in worlds within that tolerance.

Corners and random points of the tolerance, half of each, on stiff feet and on feet of 1e6 N/m with 5 %
damping: no foot should get more than 0.05 mm high, none slide by more than 0.5 mm. Random instants with
random deviations within the tolerance are solved exactly, too: none should lose a contact. And with all
exaggerated by 10 % the world that is named the worst should: then the bounds are not idle.

    python -m studies.replay.run --out results [--plans FOLDER] [--worlds 500] [--samples 5000]
        [--only NAME ...] [--seconds S]

Goes on: finished chunks of worlds are kept, and plans where the folder of plans has them.
"""

from __future__ import annotations

import argparse
import sys
import time
import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.write import versions, write_text
from ocptip.motion.task import MotionTask
from ocptip.standing.arm import Robot
from ocptip.standing.parts import Part
from ocptip.standing.simulation.objects import LIFTED, SLID
from ocptip.standing.simulation.replay import Replay, Simulator
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.in_motion import worst_within
from ocptip.trajectories.trajectory import Trajectory
from studies.common import PLANNING, RowFile, ended, number, say, software, source_state, state_notes, table
from studies.replay.tasks import planned, tasks
from studies.replay.worlds import INSTANTS, random_world, worst_worlds
from studies.tolerance.samples import lost as lost_samples

STEP = {
    "stiff": 4e-4,
    "1e6": 2e-4,
}  # s; shorter ones slide less, by microns
BINDS = 0.97  # GN or GT within the tolerance from which the contacts decide
CHUNK = 20  # worlds
BEYOND = 1.1
WORST = ("tips", "slips")
FEET: dict[str, dict[str, float]] = {"stiff": {}, "1e6": {"stiffness": 1e6, "damping": 0.05}}


def chunk(robot: Robot, motion: Trajectory, tolerance: Uncertainty, feet: str, number: int) -> dict[str, Any]:
    """What happens in some worlds; seeded by their number."""
    rng = np.random.default_rng(number)
    worlds = [random_world(robot, tolerance, rng, corner=k % 2 == 0) for k in range(CHUNK)]
    began = time.process_time()
    replays = Simulator((Part(robot, motion),), step=STEP[feet]).run_many(
        [replace(w, **FEET[feet]) for w in worlds]
    )
    return {
        "lifts_m": [replay.lift for replay in replays],
        "slides_m": [replay.slide for replay in replays],
        "falls": sum(replay.falls for replay in replays),
        "cpu_s": time.process_time() - began,
    }


def beyond(robot: Robot, motion: Trajectory, tolerance: Uncertainty) -> dict[str, Any]:
    """The worst, and its worlds, exaggerated, on both kinds of feet: is a contact lost, here and there?"""
    times = np.linspace(0, motion.end, INSTANTS)
    within = worst_within(robot, motion, tolerance, times)
    found: dict[str, Any] = {"GN": within.tip.value if within.tip else 0.0, "GT": within.slip.value}
    for what, (world, words, value) in worst_worlds(robot, motion, tolerance.scaled(BEYOND)).items():
        entry: dict[str, Any] = {
            "world": words,
            "value": value,
            "lost": value < 0 if what == "tips" else value > 1,
        }
        for name, feet in FEET.items():
            replay = Simulator((Part(robot, motion),), step=STEP[name]).run(replace(world, **feet))
            least = least_force(replay)
            entry[name] = {"least_N": least, "lift_m": replay.lift, "slide_m": replay.slide}
        found[what] = entry
    return found


def least_force(replay: Replay) -> float:
    """Minimum normal force, N, outside of steps with an event, from the start of the motion to its end."""
    inside = (replay.times > 0) & (replay.times < replay.end) & replay.quiet
    return float(replay.forces[inside].min())


def lost(row: dict[str, Any], feet: str) -> bool:
    """In one of the worlds a foot carries nothing for a while, or slides."""
    seen = [row[what][feet] for what in WORST]
    return any(one["least_N"] <= 0 or one["slide_m"] > SLID for one in seen)


def markdown(rows: Sequence[dict[str, Any]], refused: dict[str, str], notes: list[str]) -> str:
    """A row per plan."""
    lines, kept, outside, samples = [], [], [], []
    for name in dict.fromkeys(row["task"] for row in rows):
        own = [row for row in rows if row["task"] == name]
        cells = [name]
        for feet in FEET:
            some = [row for row in own if row["feet"] == feet]
            lifts = np.array([x for row in some for x in row["lifts_m"]])
            slides = np.array([x for row in some for x in row["slides_m"]])
            good = (lifts <= LIFTED) & (slides <= SLID)
            top, far = (1e3 * x.max() if len(x) else None for x in (lifts, slides))
            cells += [f"{len(lifts)}", number(top, 4), number(far, 3), f"{int((~good).sum())}"]
            kept.append(bool(good.all()) if len(good) else None)
        worst = next((row for row in own if row["feet"] == "beyond"), None)
        sampled = next((row for row in own if row["feet"] == "samples"), None)
        if sampled is not None:
            samples.append((sampled["lost"], sampled["count"]))
        cells.append("-" if sampled is None else f"{sampled['lost']}")
        if worst is not None:
            gone = [any(worst[what]["lost"] for what in WORST), *(lost(worst, feet) for feet in FEET)]
            outside.append([max(worst["GN"], worst["GT"]) >= BINDS, *gone])
            cells += [number(worst[key], 3) for key in ("GN", "GT")]
            cells += [number(worst["tips"]["value"], 2), number(worst["slips"]["value"], 2)]
            cells += ["yes" if x else "no" for x in gone]
        else:
            cells += ["-"] * 7
        lines.append(cells)
    head = ["plan"]
    for feet in ("stiff", "1e6 N/m"):
        head += [f"worlds, {feet}", "highest mm", "farthest mm", "too much"]
    head += ["samples lost", "GN within", "GT within", "+10 %: moment N m", "GT", "loses a contact"]
    head += ["so in MuJoCo, stiff", "1e6 N/m"]
    text = ["# Replays of plans within a tolerance", "", *notes, "", *table(head, lines), ""]
    if samples:
        gone, count = np.sum(samples, axis=0)
        what = f"{count} random instants within the tolerances of {len(samples)} plans"
        text.append(f"- Of {what} {gone} lose a contact.")
    binding, others = ([one for one in outside if one[0] == binds] for binds in (True, False))
    for k, where in enumerate(("the exact check", "MuJoCo on stiff feet", "MuJoCo on feet of 1e6 N/m")):
        counts = [sum(one[1 + k] for one in some) for some in (binding, others)]
        own = f"{counts[0]} of {len(binding)} plans that bind (GN or GT within at least {BINDS:g})"
        rest = f"{counts[1]} of {len(others)} others"
        text.append(f"- All exaggerated by 10 %, {where} loses a contact in {own}, {rest}.")
    for k, feet in enumerate(("stiff feet", "feet of 1e6 N/m")):
        seen = [one for one in kept[k::2] if one is not None]
        if seen:
            text.append(f"- On {feet} {sum(seen)} of {len(seen)} plans: none too high, none too far.")
    text += [f"- {name}: no plan ({why})" for name, why in refused.items()]
    return "\n".join(text) + "\n"


def run(
    out: Path,
    plans: Path,
    worlds: int,
    names: Sequence[str] | None,
    starts: int,
    seconds: float,
    samples: int,
) -> str:
    """Compute what is missing, chunk by chunk through all plans, and write the table."""
    out.mkdir(parents=True, exist_ok=True)
    plans.mkdir(parents=True, exist_ok=True)
    state = source_state(*PLANNING)
    options = {"steps_s": STEP, "worlds": CHUNK, "samples": samples}
    file = RowFile(out / "replay.json", options, ("task", "feet", "chunk"), state)
    found: dict[str, tuple[MotionTask, Trajectory]] = {}
    refused: dict[str, str] = {}
    began = time.monotonic()

    def put(name: str, feet: str, chunk_of: int) -> None:
        if time.monotonic() - began > seconds or file.find(task=name, feet=feet, chunk=chunk_of) is not None:
            return
        say(f"{name}, {feet}, {chunk_of}")
        task, motion = found[name]
        robot, tolerance = task.robot, task.limits.tolerance
        assert isinstance(robot, Robot)
        if robot.support.elastic is not None and feet == "stiff":
            return  # they are declared to give
        seed = zlib.crc32(name.encode())
        if feet == "beyond":
            entry = beyond(robot, motion, tolerance)
        elif feet == "samples":
            gone = lost_samples(robot, motion, tolerance, np.random.default_rng(seed), samples)
            entry = {"lost": gone, "count": samples}
        else:
            entry = chunk(robot, motion, tolerance, feet, seed + chunk_of)
        file.put({"task": name, "feet": feet, "chunk": chunk_of, **entry})

    for name in names or tasks():
        if time.monotonic() - began > seconds:
            break
        answer = planned(name, plans, starts)
        if isinstance(answer, str):
            refused[name] = answer
        else:
            found[name] = answer
            put(name, "beyond", -1)
            put(name, "samples", -1)
    for number_of in range(-(-worlds // CHUNK)):
        for name in found:
            for feet in FEET:
                put(name, feet, number_of)
    rows = file.own
    steps = ", ".join(f"{1e3 * step:g} ms ({feet})" for feet, step in STEP.items())
    notes = [
        f"{software(versions(('numpy', 'mujoco')))}; plans of {starts} starts, seed 0; steps of "
        f"{steps}; half of the worlds are corners of the tolerance. Too much: higher than 0.05 mm, "
        "or farther than 0.5 mm."
    ]
    told = state_notes([r.get("state") for r in rows], state)
    text = markdown(rows, refused, notes) + "\n".join(told) + "\n"
    write_text(out / "replay.md", text)
    return text


def main(argv: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for results")
    parser.add_argument("--plans", type=Path, help="folder of plans (default: replay_plans in --out)")
    parser.add_argument("--worlds", type=int, default=500, help="per plan and kind of feet")
    parser.add_argument("--samples", type=int, default=5000, help="random instants per plan")
    parser.add_argument("--only", nargs="+", help="only these tasks")
    parser.add_argument("--starts", type=int, default=2, help="of every plan")
    parser.add_argument("--seconds", type=float, default=np.inf, help="begin no chunk after so long")
    given = parser.parse_args(argv)
    plans = given.plans or given.out / "replay_plans"
    return ended(
        "replay",
        lambda: run(
            *(given.out, plans, given.worlds, given.only, given.starts, given.seconds, given.samples)
        ),
        "finished chunks are kept.",
    )


if __name__ == "__main__":
    sys.exit(main())
