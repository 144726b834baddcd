"""A load chart against single calls of `stand`: its payloads reach the limit that decides.

python -m studies.cost.chart_against_stand [COUNT]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import ocptip
from ocptip.api.inputs.postures import RestingPosture
from ocptip.robots.payload import Payload

TASK = Path(ocptip.__file__).parent / "examples/tasks/kit_arm.toml"


def main(count: int) -> None:
    """Print the largest difference of tip-over index and torque from their limits, relative."""
    found = ocptip.chart(TASK, samples=4 * count, uncertainty="none", levels=[0.0])
    robot, limits, largest = found.robot, found.limits, found.largest
    names = np.array(largest.names)[largest.limits]
    rows = [k for k, name in enumerate(names) if name.startswith(("tipping", "torque"))][:count]
    differences = []
    for k in rows:
        arm = robot.arm.with_payload(Payload(largest.levels[k], robot.payload.center_of_mass))
        posture = RestingPosture.of("robot", "given", robot.varied(arm=arm), found.q[k], limits)
        if names[k].startswith("tipping"):
            GN = float(ocptip.stand(posture, uncertainty="none").tip.GN[0])
            differences.append(abs(GN / limits.GN - 1))
        else:
            use = np.max(np.abs(posture.instant.torques[0]) / robot.limits.torque)
            differences.append(abs(use / limits.torque_ratio - 1))
    print(f"{len(rows)} postures: at most {max(differences):.1e} from the limit")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
