"""What ramps do to compliant feet, what keeps the feet on the ground, and what that costs.

Three plans of every published case without clamps: as it is (GN and GT at most 0.9), with jumps counted with
their overshoot at 5 % damping, and on feet of 1e6 N/m with that damping, all of which have to stay pressed
(the planner then keeps every foot's force, and the check lets the base swing). Each is run on feet of 1e5,
1e6 and 1e7 N/m. And the swinging base itself against a simulation of the rigid bodies by MuJoCo (plans A, B
and G as committed).

    python -m studies.elastic_feet.run --out results
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import PlanningError
from ocptip.basics.write import versions, write_json, write_text
from ocptip.certificate.checks import certified
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.motion.plan import plan_motion
from ocptip.published.tasks import experiment_task
from ocptip.standing.arm import Robot
from ocptip.standing.elastic.feet import on_its_feet
from ocptip.standing.elastic.springs import Ride, Simulation
from ocptip.standing.elastic.steps import Modes
from ocptip.standing.limits import Limits
from ocptip.trajectories.trajectory import Trajectory
from studies.common import RESULTS, number, percent, software, table
from studies.elastic_feet.rigid_bodies import FeetSimulation

CASES = ("A", "B", "D", "E", "G", "H")
FEET = (1e5, 1e6, 1e7)
DAMPING = 0.05
STEPS = {1e5: 1e-3, 1e6: 5e-4, 1e7: 2e-4}


def softened(robot: Robot, stiffness: float, damping: float = DAMPING) -> Robot:
    """The same robot on compliant feet."""
    own = robot.support
    feet = [
        replace(c, stiffness=stiffness, damping_ratio=damping)
        for c in own.contacts
        if isinstance(c, UnilateralContact)
    ]
    return robot.varied(support=own.varied(feet))


def on_feet(robot: Robot, motion: Trajectory) -> list[dict[str, float]]:
    """Heights, and least forces of feet that could pull, by stiffness."""
    found = []
    for stiffness in FEET:
        soft = softened(robot, stiffness)
        lifted = on_its_feet(soft, motion)
        elastic, ride = soft.support.elastic, Ride(soft, motion)
        assert lifted is not None
        assert elastic is not None
        modes = Modes.of(elastic, ride.start_inertia)
        least = Simulation(ride, elastic, modes, one_sided=False).run().forces[:, :, 0].min()
        found.append(
            {
                "stiffness_N_m": stiffness,
                "lift_m": lifted.lift,
                "falls": lifted.falls,
                "least_force_N": float(least),
                "frequency_Hz": lifted.frequency,
            }
        )
    return found


def planned(case: str, starts: int, seed: int) -> list[dict[str, Any]]:
    """The three plans of a case."""
    nominal = experiment_task(case)
    counted = replace(nominal, limits=Limits(damping=DAMPING))
    pressed = replace(counted, robot=softened(nominal.robot, 1e6))
    rows: list[dict[str, Any]] = []
    for name, task in (("nominal", nominal), ("overshoot", counted), ("pressed", pressed)):
        row: dict[str, Any] = {"case": case, "plan": name}
        try:
            plan = plan_motion(task, starts=starts, seed=seed, jobs=1, prove=certified)
        except PlanningError as error:
            rows.append({**row, "energy_J": None, "duration_s": None, "feet": [], "why": str(error)})
            continue
        row |= {"energy_J": plan.energy, "duration_s": plan.duration, "seconds": plan.seconds}
        rows.append({**row, "feet": on_feet(nominal.robot, plan.motion)})
    return rows


def compared(case: str, stiffness: float, damping: float) -> dict[str, Any]:
    """The committed plan of a case on its feet, computed and simulated."""
    path = RESULTS / f"plans/{case}-effective/plan.json"
    motion = Trajectory.from_dict(json.loads(path.read_text()))
    robot = softened(experiment_task(case).robot, stiffness, damping)
    found, elastic = on_its_feet(robot, motion), robot.support.elastic
    assert found is not None
    assert elastic is not None
    start = motion.start[None]
    delay = Modes.of(elastic, robot.inertia(start, 0 * start)[0][0]).delays[0]
    theirs = FeetSimulation(robot, motion, stiffness, elastic.stiffness[0, 1], delay).run(STEPS[stiffness])
    ours, kept = found.course, theirs.times < found.course.times[-1]
    forces = np.stack([np.interp(theirs.times[kept], ours.times, f) for f in ours.forces[:, :, 0].T], axis=1)
    return {
        "case": case,
        "stiffness_N_m": stiffness,
        "damping": damping,
        "lift_m": found.lift,
        "simulated_lift_m": float(theirs.gaps.max()),
        "falls_at_s": float(ours.times[-1]) if found.falls else None,
        "greatest_N": float(forces.max()),
        "simulated_greatest_N": float(theirs.forces[kept].max()),
        "rms_N": float(np.sqrt(np.mean((forces - theirs.forces[kept]) ** 2))),
    }


def markdown(result: dict[str, Any]) -> str:
    """Both tables."""
    base = {row["case"]: row for row in result["plans"] if row["plan"] == "nominal"}
    rows = []
    for row in result["plans"]:
        share: list[float | None] = [None, None]
        if row["energy_J"] and base[row["case"]]["energy_J"]:
            share = [row[key] / base[row["case"]][key] - 1 for key in ("energy_J", "duration_s")]
        lifts = [
            "falls" if f["falls"] else "-" if f["lift_m"] == 0 else f"{1e3 * f['lift_m']:.3f}"
            for f in row["feet"]
        ]
        forces = [number(f["least_force_N"], 1) for f in row["feet"]]
        cells = [number(row["energy_J"], 1), percent(share[0], 1), number(row["duration_s"])]
        cells += [percent(share[1], 1), *(lifts or ["-"] * 3), *(forces or ["-"] * 3)]
        rows.append([row["case"], row["plan"], *cells])
    feet = [f"{k:.0e} N/m" for k in FEET]
    head = ["case", "plan", "energy [J]", "more", "duration [s]", "longer"]
    head += [f"lift at {k} [mm]" for k in feet] + [f"least force at {k} [N]" for k in feet]
    seen = [
        [
            row["case"],
            f"{row['stiffness_N_m']:.0e}",
            percent(row["damping"]),
            "falls" if row["falls_at_s"] else f"{1e3 * row['lift_m']:.3f}",
            f"{1e3 * row['simulated_lift_m']:.3f}",
            number(row["greatest_N"], 1),
            number(row["simulated_greatest_N"], 1),
            number(row["rms_N"], 2),
        ]
        for row in result["compared"]
    ]
    options = result["options"]
    lines = [
        "# Compliant feet",
        "",
        f"{software(result['versions'])}; {options['starts']} starts, seed {options['seed']}; effective "
        f"base; {100 * DAMPING:.0f} % damping of the lowest mode.",
        "",
        "Three plans per case: *nominal*; *overshoot*: jumps counted with their overshoot; *pressed*: "
        "planned on feet of 1e6 N/m, all of which have to stay on the ground. A dash: no foot lifts. Least "
        "force: of feet that could pull; below zero one lifts.",
        "",
        *table(head, rows, left=2),
        "",
        "The committed nominal plans on their feet, computed here and by MuJoCo: greatest height of a foot, "
        "greatest force, and the root mean square of the difference of all normal forces (until the base "
        "falls, if it does).",
        "",
        *table(
            ["case", "N/m", "damping", "lift [mm]", "MuJoCo", "greatest [N]", "MuJoCo", "rms [N]"],
            seen,
            left=3,
        ),
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--starts", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cases", default="".join(CASES), help="letters of the cases to plan")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    plans = [row for case in options.cases for row in planned(case, options.starts, options.seed)]
    seen = [compared(case, k, zeta) for case in "ABG" for k in FEET for zeta in (0.05, 0.2)]
    used = {"starts": options.starts, "seed": options.seed, "cases": options.cases}
    software_used = versions(("numpy", "scipy", "casadi", "mujoco"))
    result = {"versions": software_used, "options": used, "plans": plans, "compared": seen}
    write_json(options.out / "elastic_feet.json", result, indent=1)
    write_text(options.out / "elastic_feet.md", markdown(result))
    print(markdown(result), end="")


if __name__ == "__main__":
    main()
