"""The eight printed motions in our model: energy, worst reserves, and whether they keep the limits 0.9.

Both sets of base data, both readings of the measured power maps. These figures are the reference for
planned motions: same arm, same data.

    python -m studies.plan_cases.reference_motions --out results
"""

from __future__ import annotations

import argparse
from pathlib import Path

from ocptip.basics.write import versions, write_json, write_text
from ocptip.motion.check import check_motion
from ocptip.published.arms import modular_motors
from ocptip.published.cases import motion_cases
from ocptip.published.tasks import BASES, experiment_robot
from ocptip.standing.arm import Robot
from studies.common import table


def rows() -> list[dict]:
    """One row per case and base."""
    found = []
    for base in BASES:
        for case in motion_cases().values():
            robot = experiment_robot(case, base)
            limits = robot.arm.limits
            motion = case.reference_motion(limits.speed, limits.acceleration)
            checked = check_motion(robot, motion)
            literal = Robot(
                robot.arm, robot.support, modular_motors(torque_reading="drive"), reference_moment=1.0
            )
            found.append(
                {
                    "base": base,
                    "case": case.name,
                    "arm": case.arm,
                    "triangle_m": case.triangle_side,
                    "clamp": case.clamped,
                    "energy_J": checked.energy,
                    "energy_drive_reading_J": literal.energy(motion),
                    "duration_s": checked.duration,
                    "GN": checked.worst["GN"].value,
                    "GT": checked.worst["GT"].value,
                    "torque_ratio": checked.worst["torque_ratio"].value,
                    "speed_ratio": checked.worst["speed_ratio"].value,
                    "clearance_m": checked.worst["clearance_m"].value,
                    "keeps_0.9": checked.verified,
                }
            )
    return found


COLUMNS = {
    "base": lambda r: r["base"],
    "case": lambda r: r["case"],
    "arm": lambda r: r["arm"],
    "triangle": lambda r: f"{1000 * r['triangle_m']:.0f} mm",
    "clamp": lambda r: "yes" if r["clamp"] else "no",
    "energy [J]": lambda r: f"{r['energy_J']:.1f}",
    "drive reading [J]": lambda r: f"{r['energy_drive_reading_J']:.1f}",
    "duration [s]": lambda r: f"{r['duration_s']:.3f}",
    "GN": lambda r: f"{r['GN']:.3f}",
    "GT": lambda r: f"{r['GT']:.3f}",
    "torque": lambda r: f"{r['torque_ratio']:.2f}",
    "speed": lambda r: f"{r['speed_ratio']:.2f}",
    "clearance [mm]": lambda r: f"{1000 * r['clearance_m']:.1f}",
    "keeps 0.9": lambda r: "yes" if r["keeps_0.9"] else "no",
}


def markdown(found: list[dict]) -> str:
    """The rows as a Markdown table."""
    cells = [[column(row) for column in COLUMNS.values()] for row in found]
    return "\n".join(table(list(COLUMNS), cells, left=3)) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    found = rows()
    result = {"versions": versions(("numpy", "casadi")), "rows": found}
    write_json(options.out / "reference_motions.json", result, indent=1)
    write_text(options.out / "reference_motions.md", markdown(found))
    print(markdown(found), end="")


if __name__ == "__main__":
    main()
