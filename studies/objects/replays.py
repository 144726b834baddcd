"""Fastest timings with objects within an uncertainty, replayed in MuJoCo with the objects as free bodies.

    python -m studies.objects.replays --out results [--plans 20] [--worlds 20] [--seconds S]

A UR5 on a cart carries a tall box, a stack, two glasses, a plate on a suction cup, or a plate with a cup and
a glass beside it, along random lines in joint space on which the gripper stays level. Each timing is the
fastest within the uncertainty below. Half of the worlds are corners of the uncertainty. No object should lift
more than 0.05 mm or slide more than 0.5 mm. Then the worst world of each object that binds is replayed with
all accelerations 10 % and 20 % larger: there the object should lift or slide. Finished plans are kept.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.write import versions, write_text
from ocptip.motion.task import MotionTask
from ocptip.retiming.retime import Retimed, retime
from ocptip.standing.arm import Robot
from ocptip.standing.objects import Object, cup
from ocptip.standing.parts import Part
from ocptip.standing.simulation.objects import Moved
from ocptip.standing.simulation.replay import Replay, Simulator
from ocptip.standing.simulation.world import World
from ocptip.standing.tolerance import Uncertainty
from ocptip.task_files.motion import load_task
from ocptip.trajectories.path import JointPath
from studies.common import EXAMPLES, PLANNING, RowFile, ended, say, software, source_state, state_notes, table
from studies.objects.run import UPRIGHT, waiter
from studies.replay.worlds import random_world, worst_worlds

UNCERTAINTY = Uncertainty(
    tilt=np.radians(0.5),
    payload_mass=0.05,
    payload_center=(3e-3,) * 3,
    friction=0.1,
    speed=0.03,
    arm_mass=0.05,
)
STEP, FINER = 4e-4, 1e-4  # s; the shorter one where an object seems to move: friction creeps less then
NODES, INSTANTS, EXACT = 50, 60, 10  # intervals of a timing; instants of worst worlds
BINDS, BEYOND = 0.95, (1.1, 1.2)  # GN or GT of an object that decides; factors on all accelerations
OF = {"tips": "tip", "slips": "slip"}
HEAD = (
    "objects", "plans", "duration [s]", "worlds", "highest lift [mm]", "longest slide [mm]", "too much",
    "binding", "lost at +10 %", "at +20 %",
)  # fmt: skip


def arrangements() -> dict[str, list[Object]]:
    """Objects on or below a gripper that points down."""
    up: dict[str, Any] = {"rotation": UPRIGHT, "position": (0.1, 0.0, -0.05)}
    glasses = [
        Object.cylinder(
            f"glass_{side}", 0.35, (0.03, 0.12), friction=0.3, rotation=UPRIGHT, position=(0.1, y, 0)
        )
        for side, y in (("left", -0.08), ("right", 0.08))
    ]
    plate = Object(
        name="plate", mass=0.3, inertia=(1e-3, 1e-3, 2e-3), contacts=cup((0, 0, 0), 0.05, 6.0, 0.5),
        center_of_mass=(0.0, 0.0, 0.02), position=(0.1, 0.0, 0.02),
    )  # fmt: skip
    low = Object.box("low", 0.5, (0.1, 0.1, 0.03), friction=0.2, **up)
    top = Object.cylinder("top", 0.1, (0.03, 0.04), friction=0.5, on="low", position=(0.01, 0.0, 0.0))
    return {
        "tall box": [Object.box("tall", 0.5, (0.06, 0.06, 0.18), friction=0.9, **up)],
        "stack of two": [low, top],
        "two glasses": glasses,
        "plate on a suction cup": [plate],
        "plate with cup, glass": list(waiter()[0].objects),
    }


def line(task: MotionTask, seed: int) -> JointPath:
    """A line in joint space; the second to the fourth joint are parallel and keep the gripper level."""
    rng = np.random.default_rng(seed)
    turn, shoulder, elbow = rng.choice([-1, 1]) * rng.uniform(0.5, 1.1), *rng.uniform(-0.25, 0.25, 2)
    change = np.array([turn, shoulder, elbow, -shoulder - elbow, 0.0, 0.0])
    return JointPath(np.array([0.0, 1.0]), np.array([change[None], task.start[None]]))


def seen(replay: Replay) -> dict[str, Any]:
    """The largest lift and slide of all objects, and what the base did."""
    moved = replay.objects.values()
    of_objects = {"lift_m": max(own.lift for own in moved), "slide_m": max(own.slide for own in moved)}
    return {**of_objects, "base_lift_m": replay.lift, "base_slide_m": replay.slide, "falls": replay.falls}


def beyond(found: Retimed, simulator: Simulator) -> list[dict[str, Any]]:
    """Objects that bind, in their worst worlds with larger accelerations."""
    robot, rows, within = found.robot, [], found.check.within
    assert isinstance(robot, Robot)
    assert within is not None
    for number, footing in enumerate(robot.interfaces[1:], 1):
        worst = within.objects[footing.name]
        names = [name for name, key in OF.items() if (own := worst[key]) and own.most >= BINDS]
        if not names:
            continue
        worlds = worst_worlds(robot, found.motion, UNCERTAINTY, number, INSTANTS, EXACT)
        for name in names:
            world = worlds[name][0]
            row: dict[str, Any] = {"object": footing.name, "how": name, "world": worlds[name][1]}
            for factor in (1.0, *BEYOND):
                faster = replace(world, speed=world.speed * np.sqrt(factor))
                moved = simulator.run(faster).objects[footing.name]
                row[f"{factor:g}"] = {"lift_m": moved.lift, "slide_m": moved.slide, "stays": moved.stays}
            rows.append(row)
    return rows


def replayed(robot: Robot, task: MotionTask, seed: int, worlds: int) -> dict[str, Any]:
    """A timing and its replays."""
    began = time.process_time()
    limits = replace(task.limits, tolerance=UNCERTAINTY)
    found = retime(robot, line(task, seed), limits, nodes=NODES)
    row: dict[str, Any] = {"duration_s": found.motion.end, "verified": found.check.verified}
    row["cpu_s"] = time.process_time() - began
    part, rng = (Part(robot, found.motion),), np.random.default_rng(seed)
    simulator, finer = Simulator(part, step=STEP), Simulator(part, step=FINER)
    some = [World(), *(random_world(robot, UNCERTAINTY, rng, corner=k % 2 == 0) for k in range(worlds - 1))]
    replays = [(world, simulator.run(world)) for world in some]
    row["worlds_seen"] = [
        seen(replay) if replay.stands else {**seen(finer.run(world)), "coarse": seen(replay)}
        for world, replay in replays
    ]
    return {**row, "beyond": beyond(found, simulator), "all_cpu_s": time.process_time() - began}


def text_of(rows: Sequence[dict[str, Any]], notes: Sequence[str]) -> str:
    """A line per arrangement, and the sums."""
    lines, sums = [], np.zeros(6, dtype=int)
    for name in arrangements():
        own = [row for row in rows if row["objects"] == name and "refused" not in row]
        if not own:
            continue
        worlds = [one for row in own for one in row["worlds_seen"]]
        bad = sum(not Moved(one["lift_m"], one["slide_m"]).stays for one in worlds)
        binding = [one for row in own for one in row["beyond"]]
        lost = [sum(not one[f"{factor:g}"]["stays"] for one in binding) for factor in BEYOND]
        ends = [row["duration_s"] for row in own]
        counts = len(own), len(worlds), bad, len(binding), *lost
        sums += counts
        lift, slide = (f"{1e3 * max(one[key] for one in worlds):.4f}" for key in ("lift_m", "slide_m"))
        lines.append(
            [name, f"{len(own)}", f"{min(ends):.2f} to {max(ends):.2f}", f"{len(worlds)}", lift, slide]
            + [f"{count}" for count in counts[2:]]
        )
    plans, worlds, bad, binding, *lost = sums.tolist()
    again = sum("coarse" in one for row in rows for one in row.get("worlds_seen", []))
    summary = (
        f"Of {worlds} worlds of {plans} plans {bad} have an object that lifts more than 0.05 mm or slides "
        f"more than 0.5 mm; {again} did with steps of {1e3 * STEP:g} ms, and were replayed with steps of "
        f"{1e3 * FINER:g} ms. Of {binding} worst worlds of objects that bind (GN or GT at least {BINDS:g}), "
        f"{lost[0]} lose the object with accelerations 10 % larger, {lost[1]} with 20 %."
    )
    refused = [f"- {row['plan']}: no plan ({row['refused']})" for row in rows if "refused" in row]
    head = ["# Replays of timings with objects within an uncertainty", "", *notes, ""]
    return "\n".join([*head, *table(HEAD, lines), "", summary, *refused]) + "\n"


def run(out: Path, plans: int, worlds: int, seconds: float) -> str:
    """Compute what is missing, plan by plan, and write the table."""
    out.mkdir(parents=True, exist_ok=True)
    state = source_state(*PLANNING)
    options = {"step_s": STEP, "worlds": worlds, "uncertainty": UNCERTAINTY.to_dict()}
    file = RowFile(out / "objects_replays.json", options, ("plan",), state)
    task = load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
    assert isinstance(task.robot, Robot)
    kinds, began = arrangements(), time.monotonic()
    for seed in range(plans):
        name = list(kinds)[seed % len(kinds)]
        plan = f"{name}, seed {seed}"
        if file.find(plan=plan) is not None or time.monotonic() - began > seconds:
            continue
        say(plan)
        try:
            row = replayed(task.robot.carrying(kinds[name]), task, seed, worlds)
        except InputError as error:
            row = {"refused": f"{error}"}
        file.put({"plan": plan, "objects": name, **row})
    rows = file.own
    note = (
        f"{software(versions(('numpy', 'mujoco')))}; steps of {1e3 * STEP:g} ms; {UNCERTAINTY}. Joints are "
        "not delayed and steps do not overshoot."
    )
    text = text_of(rows, [note]) + "\n".join(state_notes([row.get("state") for row in rows], state)) + "\n"
    write_text(out / "objects_replays.md", text)
    return text


def main(argv: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for results")
    parser.add_argument("--plans", type=int, default=20)
    parser.add_argument("--worlds", type=int, default=20, help="per plan")
    parser.add_argument("--seconds", type=float, default=np.inf, help="begin no plan after so long")
    given = parser.parse_args(argv)
    return ended(
        "replays",
        lambda: run(given.out, given.plans, given.worlds, given.seconds),
        "finished plans are kept.",
    )


if __name__ == "__main__":
    sys.exit(main())
