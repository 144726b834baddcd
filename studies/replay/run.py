"""Plans within a tolerance, replayed in MuJoCo from their exported models in worlds within that tolerance.

Corners and random points of the tolerance, half of each, on stiff feet and on feet of 1e6 N/m with 5 %
damping: no foot should get more than 0.05 mm high, none slide by more than 0.5 mm. And with everything
exaggerated by 10 % the world that is named the worst should lose a contact: then the bounds are not idle.

    python -m studies.replay.run --out results [--plans FOLDER] [--worlds 500] [--only NAME ...] [--seconds S]

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
from ocptip.standing.arm import StandingRobot
from ocptip.standing.simulation.replay import LIFTED, SLID, Replay, Simulator
from ocptip.standing.tolerance import Tolerance
from ocptip.trajectories.arm_motion import ArmMotion
from studies.common import PLANNING, RowFile, ended, number, say, software, source_state, state_notes, table
from studies.replay.tasks import planned, tasks
from studies.replay.worlds import random_world, worst_worlds

STEP = 2e-4  # s
CHUNK = 20  # worlds
BEYOND = 1.1
WORST = ("tips", "slips")
FEET: dict[str, dict[str, float]] = {"stiff": {}, "1e6": {"stiffness": 1e6, "damping": 0.05}}


def chunk(
    robot: StandingRobot, motion: ArmMotion, tolerance: Tolerance, feet: str, number: int
) -> dict[str, Any]:
    """What happens in some worlds; seeded by their number."""
    rng = np.random.default_rng(number)
    worlds = [random_world(robot, tolerance, rng, corner=k % 2 == 0) for k in range(CHUNK)]
    began = time.process_time()
    replays = Simulator(robot, motion, step=STEP).run_many([replace(w, **FEET[feet]) for w in worlds])
    return {
        "lifts_m": [replay.lift for replay in replays],
        "slides_m": [replay.slide for replay in replays],
        "falls": sum(replay.falls for replay in replays),
        "cpu_s": time.process_time() - began,
    }


def beyond(robot: StandingRobot, motion: ArmMotion, tolerance: Tolerance) -> dict[str, Any]:
    """The named worst worlds, exaggerated, on both kinds of feet, and whether they lose a contact here."""
    found: dict[str, Any] = {}
    for what, (world, words, value) in worst_worlds(robot, motion, tolerance.scaled(BEYOND)).items():
        entry: dict[str, Any] = {
            "world": words,
            "value": value,
            "lost": value < 0 if what == "tips" else value > 1,
        }
        for name, feet in FEET.items():
            replay = Simulator(robot, motion, step=STEP).run(replace(world, **feet))
            least = least_force(replay)
            entry[name] = {"least_N": least, "lift_m": replay.lift, "slide_m": replay.slide}
        found[what] = entry
    return found


def least_force(replay: Replay) -> float:
    """Least normal force, N, outside of steps with an event, from the start of the motion to its end."""
    inside = (replay.times > 0) & (replay.times < replay.end) & replay.quiet
    return float(replay.forces[inside].min())


def lost(row: dict[str, Any], feet: str) -> bool:
    """In one of the worlds a foot carries nothing for a while, or slides."""
    seen = [row[what][feet] for what in WORST]
    return any(one["least_N"] <= 0 or one["slide_m"] > SLID for one in seen)


def markdown(rows: Sequence[dict[str, Any]], refused: dict[str, str], notes: list[str]) -> str:
    """A row per plan."""
    lines, kept, outside = [], [], []
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
            kept.append(bool(good.all()) and len(good) > 0)
        worst = next((row for row in own if row["feet"] == "beyond"), None)
        if worst is not None:
            gone = [any(worst[what]["lost"] for what in WORST), *(lost(worst, feet) for feet in FEET)]
            outside.append(gone)
            cells += [number(worst["tips"]["value"], 2), number(worst["slips"]["value"], 2)]
            cells += ["yes" if x else "no" for x in gone]
        else:
            cells += ["-"] * 5
        lines.append(cells)
    head = ["plan"]
    for feet in ("stiff", "1e6 N/m"):
        head += [f"worlds, {feet}", "highest mm", "farthest mm", "too much"]
    head += ["+10 %: moment N m", "GT", "loses a contact", "so in MuJoCo, stiff", "1e6 N/m"]
    text = ["# Replays of plans within a tolerance", "", *notes, "", *table(head, lines), ""]
    for k, feet in enumerate(("stiff feet", "feet of 1e6 N/m")):
        text.append(f"- On {feet} {sum(kept[k::2])} of {len(lines)} plans: none too high, none too far.")
        binding = [gone for gone in outside if gone[0]]
        count, others = sum(gone[1 + k] for gone in binding), [gone for gone in outside if not gone[0]]
        text.append(
            f"- Of {len(binding)} plans whose worst, exaggerated by 10 %, loses a contact in the check, "
            f"{count} lose one there; of the {len(others)} others {sum(gone[1 + k] for gone in others)}."
        )
    text += [f"- {name}: no plan ({why})" for name, why in refused.items()]
    return "\n".join(text) + "\n"


def run(out: Path, plans: Path, worlds: int, names: Sequence[str] | None, starts: int, seconds: float) -> str:
    """Compute what is missing, chunk by chunk through all plans, and write the table."""
    out.mkdir(parents=True, exist_ok=True)
    plans.mkdir(parents=True, exist_ok=True)
    state = source_state(*PLANNING)
    options = {"step_s": STEP, "worlds": CHUNK}
    file = RowFile(out / "replay.json", options, ("task", "feet", "chunk"), state)
    found: dict[str, tuple[MotionTask, ArmMotion]] = {}
    refused = {}
    for name in names or tasks():
        answer = planned(name, plans, starts)
        if isinstance(answer, str):
            refused[name] = answer
        else:
            found[name] = answer
    began = time.monotonic()
    for number_of in range(-1, -(-worlds // CHUNK)):
        for name, (task, motion) in found.items():
            robot, tolerance = task.robot, task.limits.tolerance
            assert isinstance(robot, StandingRobot)
            if time.monotonic() - began > seconds:
                break
            seed = zlib.crc32(name.encode()) + number_of
            if number_of < 0:
                if file.find(task=name, feet="beyond", chunk=-1) is None:
                    say(f"{name}, beyond")
                    file.put(
                        {"task": name, "feet": "beyond", "chunk": -1, **beyond(robot, motion, tolerance)}
                    )
                continue
            for feet in FEET:
                if file.find(task=name, feet=feet, chunk=number_of) is None:
                    say(f"{name}, {feet}, {number_of}")
                    entry = chunk(robot, motion, tolerance, feet, seed)
                    file.put({"task": name, "feet": feet, "chunk": number_of, **entry})
    rows = file.own
    notes = [
        f"{software(versions(('numpy', 'mujoco')))}; plans of {starts} starts, seed 0; steps of "
        f"{1e3 * STEP:g} ms; half of the worlds are corners of the tolerance. Too much: higher than 0.05 mm, "
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
    parser.add_argument("--only", nargs="+", help="only these tasks")
    parser.add_argument("--starts", type=int, default=2, help="of every plan")
    parser.add_argument("--seconds", type=float, default=np.inf, help="begin no chunk after so long")
    given = parser.parse_args(argv)
    plans = given.plans or given.out / "replay_plans"
    return ended(
        "replay",
        lambda: run(given.out, plans, given.worlds, given.only, given.starts, given.seconds),
        "finished chunks are kept.",
    )


if __name__ == "__main__":
    sys.exit(main())
