"""What can be typed under `machine`: the commands and their arguments."""

from __future__ import annotations

from ocptip.cli.arguments import COLUMNS, SEED, TOPICS, UNIT, argument
from ocptip.cli.command import Command

COMMANDS = (
    Command(
        "compare",
        "compare a recording of the machine with its plan",
        "Compares joints, TCP, torques, force-torque sensor, power and base of a recording with the plan. "
        "Reports masses, frictions, delays, elasticities or signals that deviate from the model.",
        "0 the recording agrees with the model, 1 it deviates",
        (
            argument("recording", "RECORDING", "the recording: a CSV file, or a bag of ROS"),
            argument("plan", "PLAN_DIR", "folder of the plan that was run"),
            UNIT,
            COLUMNS,
            TOPICS,
            argument(
                "--same-clock",
                None,
                "time 0 of the recording is the start of the motion (default: aligned by the joints)",
                action="store_true",
            ),
            argument(
                "--level",
                "P",
                "probability of any false alarm if the model is right (default: 0.001)",
                type=float,
            ),
            argument("--plot", "FILE", "draw both into a .png, .pdf or .svg file"),
        ),
        files=("plot",),
    ),
    Command(
        "identify",
        "identify masses, centres of mass, friction or power maps from recordings",
        "Identifies parameters from the recording of a plan that the machine ran. Writes them as tables of a "
        "task file, with the [tolerance] that follows from their errors.",
        "0 identified (parameters that the recording does not determine are named)",
        (
            argument(
                "what",
                None,
                "what is identified",
                choices=("payload", "base", "bodies", "arm", "power", "motion"),
            ),
            argument("recording", "RECORDING.csv", "the recording, CSV or bag; for motion: TASK.toml"),
            argument("plan", "PLAN_DIR", "folder of the plan that was run (power: not needed)", nargs="?"),
            UNIT,
            COLUMNS,
            TOPICS,
            argument("--tared", None, "the sensor was set to zero under load", action="store_true"),
            argument(
                "--bandwidth",
                "HZ",
                "cutoff of the low-pass filter of torques, sensor or feet (inf: none; default: estimated)",
                type=float,
            ),
            argument("--sigmas", "K", "uncertainty in standard errors (default: 3)", type=float),
            argument("--task", "TASK.toml", "PLAN_DIR is the file of a motion of this task"),
            SEED,
            argument("--out", "FILE", "write the tables of a task file (.toml); motion: its samples (.csv)"),
        ),
        files=("out",),
    ),
    Command(
        "export",
        "export a plan's robot and motion for simulators (MJCF, URDF)",
        "Writes arm, base, feet, payload and rotors of a plan as bodies with the masses of its task, and its "
        "motion as keyframes.",
        "0 written",
        (
            argument("plan", "PLAN_DIR", "folder of a plan"),
            argument("--mjcf", "FILE", "write a MuJoCo model with feet, friction and motion"),
            argument("--urdf", "FILE", "write a URDF: bodies and joints only"),
        ),
        files=("mjcf", "urdf"),
    ),
)
