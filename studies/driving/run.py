"""When bases of other people lift their wheels: the drive envelope against MuJoCo with hinge wheels.

    python -m studies.driving.run --folder TASKS [--postures N] [--seed N] [--out FILE.json]

Every TASKS/NAME/task.toml, such as `studies.mobile_manipulators.run` writes, gives a robot on its base. Its
contacts with friction become wheels with hinges, those without casters. The base brakes, accelerates and
drives curves harder and harder until only the two wheels of an axis press on the ground. The envelope, which
knows nothing of the simulation, says when that is. Postures are the start of the task and random ones that
stand.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.api.chart import halton_postures
from ocptip.basics.write import versions
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.drive_envelope import largest_manoeuvres
from ocptip.standing.at_rest.manoeuvres import Manoeuvres
from ocptip.task_files.motion import load_task
from studies.common import json_text, table
from studies.driving.wheels import RADIUS, ROUGH, driven, on_wheels, tips_at

SEED, BEND, RATE, LEAST, MOST = 0, 3.0, 0.15, 0.3, 10.0
"""Seed; radius of curves, m; how fast the speed grows in them, m/s^2; limits that are simulated."""

ON_AXIS = 1e-3  # m

SLOPES = {"brake": (-1, 0.0), "accelerate": (1, 0.0), "brake downhill": (-1, 0.05)}


def rough(robot: Robot, gravity: np.ndarray) -> Robot:
    """The robot with tyres that hardly slide, in another gravity."""
    contacts = [
        dataclasses.replace(contact, friction=ROUGH if wheel else 0.0)
        for contact, wheel in zip(robot.support.contacts, driven(robot), strict=True)
    ]
    support = robot.support.varied(contacts, gravity=gravity)
    return robot.varied(support=support, reference_moment=1.0)


def straight(robot: Robot, q: np.ndarray, sign: int, slope: float) -> tuple[float, float] | None:
    """Acceleration, m/s^2, at which it tips, predicted and simulated; None: it slides first, or the
    limit is not one that is simulated.
    """
    gravity = 9.81 * np.array([np.sin(slope), 0, -np.cos(slope)])
    kind = Manoeuvres.accelerations(np.array([[float(sign), 0, 0]]), gravity)
    own = rough(robot, gravity)
    limit = _predicted(own, q, kind)
    if limit is None:
        return None
    predicted, axis = limit
    # From standstill, so that braking is driving backwards: bases with casters behind spin at high speed.
    rate = predicted / 4
    model = on_wheels(own, q, np.tile([0.0, 1, 0], (len(own.support.contacts), 1)))
    count = int(np.sum(driven(own)))

    def speeds(t: float) -> np.ndarray:
        return np.full(count, sign * rate * t**2 / 2 / RADIUS)

    return predicted, rate * tips_at(model, speeds, (0.0, 0.0), 1.15 * predicted / rate, axis)


def curve(robot: Robot, q: np.ndarray, side: int) -> tuple[float, float] | None:
    """Speed, m/s, at which it tips in a curve to the right (1) or left; wheels are steered to its centre."""
    steady, linear, square = np.zeros((3, 1, 9))
    steady[0, [0, 8]] = RATE, -side * RATE / BEND
    square[0, 1], linear[0, 5] = -side / BEND, -side / BEND
    own = rough(robot, np.array([0, 0, -9.81]))
    limit = _predicted(own, q, Manoeuvres(steady, linear, square, own.support.gravity[None]))
    if limit is None:
        return None
    predicted, axis = limit
    begin = max(predicted - 4 * RATE, 0.5 * predicted)
    spokes = np.array([np.add(contact.position, [0, side * BEND, 0]) for contact in own.support.contacts])
    away = np.linalg.norm(spokes, axis=1)
    model, wheels = on_wheels(own, q, side * spokes / away[:, None]), driven(own)

    def speeds(t: float) -> np.ndarray:
        return (begin + RATE * t) * away[wheels] / BEND / RADIUS

    time = tips_at(model, speeds, (begin, -side * begin / BEND), 1.2 * (predicted - begin) / RATE, axis)
    return predicted, begin + RATE * time


def _predicted(robot: Robot, q: np.ndarray, kind: Manoeuvres) -> tuple[float, np.ndarray] | None:
    """The limit, and the contacts on its axis, from 1: of twin wheels more than two."""
    found = largest_manoeuvres(robot, q, kind)
    if not LEAST < found.tip[0] < MOST or found.slip[0] < found.tip[0]:
        return None
    places = np.array([contact.position for contact in robot.support.contacts])
    first, second = places[found.contacts[0] - 1]
    along = (second - first) / np.linalg.norm(second - first)
    away = np.linalg.norm(np.cross(places - first, along), axis=1)
    return float(found.tip[0]), 1 + np.flatnonzero(away < ON_AXIS)


def rows_of(path: Path, postures: int, seed: int) -> Iterator[dict[str, Any]]:
    """Results of a task file: the start, and random postures that stand."""
    task = load_task(path)
    robot = task.robot
    if not isinstance(robot, Robot):
        return
    drawn = [task.start, *halton_postures(robot, task.limits, 50 * postures, seed)]
    moments = [robot.margins(q).tipping_moment for q in drawn]
    stands = [q for q, moment in zip(drawn, moments, strict=True) if moment > 0][: 1 + postures]
    for number, q in enumerate(stands):
        kinds = {name: straight(robot, q, *how) for name, how in SLOPES.items()}
        kinds |= {"curve right": curve(robot, q, 1), "curve left": curve(robot, q, -1)}
        for name, found in kinds.items():
            row = {"robot": path.parent.name, "posture": number, "case": name}
            if found is None:
                yield {**row, "predicted": None}
            else:
                yield {**row, "predicted": found[0], "simulated": found[1], "off": found[1] / found[0] - 1}


def main(arguments: list[str] | None = None) -> int:
    """Print the table; 1 if a wheel lifts more than 2 % from where the envelope says."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--postures", type=int, default=2, help="random postures per robot")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args(arguments)
    paths = sorted(given.folder.glob("*/task.toml"))
    rows = [row for path in paths for row in rows_of(path, given.postures, given.seed)]
    shown = []
    for name in dict.fromkeys(row["robot"] for row in rows):
        own = [row for row in rows if row["robot"] == name]
        known = [row for row in own if row["predicted"] is not None]
        off = [abs(row["off"]) for row in known]
        limits = [row["predicted"] for row in known]
        ends = f"{min(limits):.2f} to {max(limits):.2f}" if limits else "-"
        worst = f"{100 * max(off):.2f} %" if off else "-"
        shown.append([name, f"{len(known)}", f"{len(own) - len(known)}", ends, worst])
    head = [
        "robot",
        "simulated",
        "other limits",
        "limits [m/s^2, m/s]",
        "largest difference",
    ]
    print("\n".join(table(head, shown)))
    if given.out:
        given.out.write_text(json_text({"seed": given.seed, "rows": rows, "versions": versions()}))
    return int(any(abs(row.get("off", 0.0)) > 0.02 for row in rows))


if __name__ == "__main__":
    sys.exit(main())
