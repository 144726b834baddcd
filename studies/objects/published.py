"""Arrangements of objects that others have published, timed and proved.

    python -m studies.objects.published --out studies/results

Sizes, masses, places and friction are those of the repositories utiasDSL/upright (A. Heins and A. Schoellig:
Keep it upright, RA-L 2023) and roahmlab/waitr-dev (Z. Brei et al.: Serving time, IROS 2024). As in the first,
contacts are 5 mm inside the edges of what stands on the tray, and friction may be 10 % lower. The motion is
that of the example `ur5_waiter` on its UR5: their robots are a UR10 on a driving base and a Kinova Gen3.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.write import versions, write_text
from ocptip.certificate.find import certify
from ocptip.retiming.retime import retime
from ocptip.standing.arm import Robot
from ocptip.standing.objects import ROUND, Object
from ocptip.standing.parts import Part
from ocptip.standing.simulation.objects import predicted_objects
from ocptip.standing.tolerance import Uncertainty
from ocptip.task_files.motion import load_task
from ocptip.task_files.path import load_path
from studies.common import EXAMPLES, software, table

UNCERTAINTY = Uncertainty(
    friction=0.1, payload_mass=0.05, payload_center=(2e-3,) * 3, tilt=np.radians(0.5), speed=0.02
)
INSET, NODES = 0.005, 50  # m; intervals of a timing
UPRIGHT = np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])  # the gripper points forward, up is against its x
WITHIN = {"GN_worst_case": 0.93, "GT_worst_case": 0.93}  # of timings: a proof needs some room below 1
TRAY = 0.16  # m, gripper axes: its middle
HEAD = (
    "scene", "objects", "friction", "without regard [s]", "lost", "timed [s]", "critical",
    "friction used, proved [%]", "objects proved", "timing, proof [CPU s]",
)  # fmt: skip


def on_tray(x: float, y: float) -> dict[str, Any]:
    """Where an object stands whose place on the tray is x forward, y to the left, m."""
    return {"rotation": UPRIGHT, "position": (-0.01, y, TRAY + x)}


def box(name: str, mass: float, size: tuple[float, float, float], friction: float, **place: Any) -> Object:
    """A box whose contacts are inside its edges."""
    half = np.array(size[:2]) / 2 - INSET
    corners = [(sx * half[0], sy * half[1], 0.0) for sx, sy in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    return Object.box(name, mass, size, contacts=corners, friction=friction, **place)


def cylinder(name: str, mass: float, radius: float, height: float, friction: float, **place: Any) -> Object:
    """A cylinder whose contacts are inside its edge."""
    turns = 2 * np.pi * np.arange(ROUND) / ROUND
    edge = (radius - INSET) * np.column_stack([np.cos(turns), np.sin(turns), 0 * turns])
    return Object.cylinder(name, mass, (radius, height), contacts=edge, friction=friction, **place)


def scenes() -> dict[str, list[Object]]:
    """Objects by scene."""
    cups = [(-0.1075, -0.0925), (-0.0075, -0.0925), (0.0925, -0.0925), (0.0925, 0.0), (0.0875, 0.0925),
            (-0.0075, 0.0925), (-0.1075, 0.0925)]  # fmt: skip
    die = (0.065, 0.065, 0.065)
    waitr = Object(
        name="cup", mass=0.592, inertia=(0.00033005074, 0.00033005074, 0.00042925501), friction=0.609382421,
        center_of_mass=(0.0, 0.0, 0.0291), top=0.0582, **on_tray(0.0, 0.0),
        contacts=[(0.029 * np.cos(a), 0.029 * np.sin(a), 0.0) for a in 2 * np.pi * np.arange(ROUND) / ROUND],
    )  # fmt: skip
    return {
        "upright: bottle": [cylinder("bottle", 0.827, 0.035, 0.255, 0.26, **on_tray(0.035, -0.035))],
        "upright: seven cups": [
            cylinder(f"cup{k}", 0.2, 0.025, 0.08, 0.28, **on_tray(*place)) for k, place in enumerate(cups, 1)
        ],
        "upright: two foam dice": [
            box("lower", 0.02, die, 0.54, **on_tray(0.0325, 0.0)),
            box("upper", 0.02, die, 0.71, on="lower"),
        ],
        "upright: box of the simulations": [box("box", 0.5, (0.06, 0.06, 0.2), 0.2, **on_tray(0.0, 0.0))],
        "upright: bottle on a white box": [
            box("box", 0.115, (0.11, 0.11, 0.275), 0.3, **on_tray(0.055, 0.0)),
            cylinder("bottle", 0.827, 0.035, 0.255, 0.2, on="box"),
        ],
        "upright: bottle on a brown box": [
            box("box", 0.11, (0.15, 0.15, 0.275), 0.3, **on_tray(0.065, 0.0)),
            cylinder("bottle", 0.827, 0.035, 0.255, 0.2, on="box"),
        ],
        "WAITR: cup": [waitr],
    }


def rows(names: list[str]) -> Iterator[list[str]]:
    """A row per scene."""
    task = load_task(EXAMPLES / "tasks" / "ur5_waiter.toml", UNCERTAINTY)
    path = load_path(EXAMPLES / "paths" / "ur5_waiter.toml", task).paths[0].path
    arm = task.robot
    assert isinstance(arm, Robot)
    nominal = replace(task.limits, tolerance=Uncertainty())
    for name, objects in scenes().items():
        if names and name not in names:
            continue
        robot = arm.without_objects().carrying(objects)
        free = retime(robot.varied(objects=()), path, nominal, nodes=NODES)
        kept = predicted_objects((Part(robot, free.motion),))
        began = time.process_time()
        found = retime(robot, path, replace(task.limits, **WITHIN), nodes=NODES)
        took, began = time.process_time() - began, time.process_time()
        worst, within = found.check.worst, found.check.within
        assert found.check.verified, found.check.violations
        assert within is not None
        proof = certify(robot, found.motion, task.limits, worst)
        bounds = {one.name: proof.verdict.bounds.get(f"GT_worst_case[{one.name}]") for one in objects}
        known = [bound for bound in bounds.values() if bound is not None]
        used = {one: slip.most for one, part in within.objects.items() if (slip := part["slip"])}
        critical = max(used, key=used.__getitem__)
        yield [
            name,
            str(len(objects)),
            ", ".join(sorted({f"{one.friction:.3g}" for one in objects})),
            f"{free.motion.end:.3f}",
            f"{sum(not stays for stays in kept.values())} of {len(kept)}",
            f"{found.motion.end:.3f}",
            critical,
            f"{100 * max(known):.1f}" if known else "-",
            f"{len(known)} of {len(objects)}",
            f"{took:.0f}, {time.process_time() - began:.0f}",
        ]


def main(arguments: list[str] | None = None) -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--out", type=Path, default=Path("studies/results"))
    parser.add_argument("--scenes", nargs="*", default=[])
    options = parser.parse_args(arguments)
    lines = [
        "# Published arrangements of objects", "",
        f"`studies.objects.published`; {software(versions(('numpy',)))}; {UNCERTAINTY}. "
        f"Timings keep GN and GT below {WITHIN['GT_worst_case']:g} within it. \"Without regard\" is timed "
        "with the masses of the objects but not their contacts, in the nominal model; \"lost\" counts the "
        "objects that lose a contact then. The arch of upright leans on two blocks and is refused.", "",
        *table(HEAD, rows(options.scenes)),
    ]  # fmt: skip
    write_text(options.out / "objects_published.md", "\n".join(lines) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
