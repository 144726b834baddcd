"""Recordings by MuJoCo with faults that are known: which does `compare` name, what does it name besides?

    python -m studies.recordings.run --out results [--recordings 20] [--only NAME ...]

Goes on: rows that are there stay.

Each recording is of one of six plans, of a machine that is bolted down (one kind: that stands on MuJoCo's
feet, which give a little), with noise and a clock of its own. Faults are drawn by the number of
the recording: one of each alone, and all of elastic joints, a joint delayed by 4 ms, a link 5 % too heavy
and dry friction together. A fault counts as named if it is a finding; rivals of findings are counted by
themselves.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.write import versions, write_text
from ocptip.measured.compare import LEVEL, compare
from ocptip.measured.comparison import Comparison
from ocptip.measured.prediction import Predictor
from ocptip.published.tasks import experiment_task
from ocptip.standing.arm import Robot
from ocptip.standing.simulation.mjcf import require_exportable
from ocptip.task_files.motion import load_task
from ocptip.trajectories.trajectory import Trajectory
from studies.common import EXAMPLES, RESULTS, percent, say, software, source_state, table
from studies.recordings.machine import Faults, record

PLANS = (*"ABDEG", "UR5")
DELAY, HEAVIER, ELASTIC = 4e-3, 1.05, (5e3, 2e4)  # s, factor, N m/rad
LEAST = 0.5  # kg: links that may be too heavy
KINDS = (
    "clean", "clean on feet", "mass", "friction", "elasticity", "delay", "sensor delay", "shifted",
    "clipped", "noisy", "missing", "together",
)  # fmt: skip
LOADS = ("fx", "fy", "fz", "mx", "my", "mz", "tau1", "tau2", "tau3")


@cache
def machine(name: str) -> tuple[Robot, Trajectory]:
    """Robot and plan."""
    task = (
        load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
        if name == "UR5"
        else experiment_task(name, "effective")
    )
    robot = require_exportable(task.robot)
    if name == "UR5":
        data = json.loads((RESULTS / "replay_plans" / "UR5_on_a_cart_0_kg_workshop.json").read_text())
        return robot.varied(arm=robot.arm.with_payload(None)), Trajectory.from_dict(data["motion"])
    data = json.loads((RESULTS / "plans" / f"{name}-effective" / "plan.json").read_text())
    return robot, Trajectory.from_dict(data)


def drawn(kind: str, robot: Robot, motion: Trajectory, rng: np.random.Generator) -> tuple[Faults, list[str]]:
    """Faults, and the names by which they should be found."""
    times = np.linspace(0, motion.end, 200)
    q, qd, qdd = motion.states(times)
    torques = robot.loads(q, qd, qdd)[0]
    turning = [j for j in range(robot.n) if np.ptp(q[:, j]) > np.radians(10)]
    together = kind == "together"
    given: dict[str, Any] = {}
    names = []
    if kind == "mass" or together:
        k = int(rng.choice(np.flatnonzero(robot.arm.masses > LEAST)))
        given["masses"] = {k: HEAVIER}
        names.append(f"mass of link {k + 1}")
    if kind == "friction" or together:
        j = int(rng.choice(turning))
        given["coulomb"] = {j: 0.05 * float(robot.limits.torque[j])}
        names.append(f"Coulomb friction of {robot.names[j]}")
    if kind == "elasticity" or together:
        for j in rng.choice(3, size=1 + together, replace=False).tolist():
            given.setdefault("stiffness", {})[j] = float(rng.uniform(*ELASTIC))
            names.append(f"elasticity of {robot.names[j]}")
    if kind == "delay" or together:
        j = int(rng.choice(turning))
        given["delays"] = {j: DELAY}
        names.append(f"delay of {robot.names[j]}")
    if kind == "sensor delay":
        given["sensor_delay"] = DELAY
        names.append("delay of force-torque sensor")
    which = str(rng.choice(LOADS))
    size = float(np.abs(torques[:, int(which[3:]) - 1]).max()) if which.startswith("tau") else 20.0
    if kind == "shifted":
        given["zeros"] = {which: 0.05 * size}
    if kind == "noisy":
        which = str(rng.choice([name for name in LOADS if name.startswith("tau")]))
        given["noisy"] = {which: 10.0}
    if kind == "clipped":
        given["clip"] = {which: 0.9}
    if kind == "missing":
        given["missing"] = (which,)
    if kind in ("shifted", "clipped", "noisy", "missing"):
        names.append(f"{which} {kind}")
    return Faults(**given), names


def row(kind: str, number: int) -> dict[str, Any]:
    """One recording and what is found in it."""
    rng = np.random.default_rng([KINDS.index(kind), number])
    name = PLANS[number % len(PLANS)]
    robot, motion = machine(name)
    faults, names = drawn(kind, robot, motion, rng)
    recording = record(robot, motion, faults, rng, feet=kind == "clean on feet")
    began = time.process_time()
    seen = compare(recording, Predictor(robot, motion))
    return {
        "kind": kind,
        "number": number,
        "plan": name,
        **judged(seen, names),
        "cpu_s": time.process_time() - began,
    }


def judged(seen: Comparison, names: list[str]) -> dict[str, Any]:
    """Which faults are named, which only as rivals, and what is named besides."""
    found = [one.name for one in seen.findings]
    rivals = {rival for one in seen.findings for rival in one.rivals}
    return {
        "faults": names,
        "named": [name for name in names if name in found],
        "rivals": [name for name in names if name not in found and name in rivals],
        "besides": [name for name in found if name not in names],
    }


def lines(rows: list[dict[str, Any]], level: float) -> list[str]:
    """Tables as Markdown."""
    found = []
    for kind in KINDS:
        own = [r for r in rows if r["kind"] == kind]
        if not own:
            continue
        by: Counter[str] = Counter()
        total: Counter[str] = Counter()
        rival: Counter[str] = Counter()
        for r in own:
            total.update(_sort(name) for name in r["faults"])
            by.update(_sort(name) for name in r["named"])
            rival.update(_sort(name) for name in r["rivals"])
        many = sum(bool(r["besides"]) for r in own)
        for what in sorted(total) or ["-"]:
            found.append([
                kind, f"{len(own)}", what, f"{by[what]} of {total[what]}" if total else "-",
                f"{rival[what]}" if total else "-", f"{many}",
                f"{np.median([r['cpu_s'] for r in own]):.2f}",
            ])  # fmt: skip
    head = [
        "recordings with",
        "number",
        "fault",
        "named",
        "as a rival",
        "recordings in which more is named",
        "CPU s",
    ]
    return [
        f"Probability of a finding where nothing is: {percent(level, 1)} per recording.",
        "",
        *table(head, found),
    ]


def _sort(name: str) -> str:
    """Kind of a fault."""
    return next((k for k in ("mass", "friction", "elasticity", "delay") if k in name), name.split()[-1])


def main() -> int:
    """Run the study."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--recordings", type=int, default=20)
    parser.add_argument("--only", nargs="+", choices=KINDS, default=KINDS)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    state = source_state("measured", "robots", "standing", "trajectories")
    kept = options.out / "recordings.jsonl"
    rows = [json.loads(line) for line in kept.read_text().splitlines()] if kept.is_file() else []
    done = {(r["kind"], r["number"]) for r in rows}
    for kind, number in product(options.only, range(options.recordings)):
        if (kind, number) not in done:
            say(f"{kind} {number}")
            rows.append({**row(kind, number), "source": state})
            with kept.open("a") as stream:
                stream.write(json.dumps(rows[-1]) + "\n")
    made = software(versions(("numpy", "scipy", "mujoco")))
    states = ", ".join(sorted({r["source"] for r in rows}))
    text = "\n".join(
        ["# Faults found in recordings", "", *lines(rows, LEVEL), "", f"{made}; source {states}", ""]
    )
    write_text(options.out / "recordings.md", text)
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
