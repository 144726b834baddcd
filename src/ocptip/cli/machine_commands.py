"""Commands about placements, mobile bases, recordings, poses and closed chains, see `commands`."""

from __future__ import annotations

from ocptip.cli.arguments import (
    BASE_LINK,
    COLUMNS,
    COST_PER_SECOND,
    JOBS,
    OUT,
    SCHEDULER,
    SEED,
    TOLERANCE,
    TOOL_FRAME,
    TOPICS,
    UNIT,
    argument,
    group,
    is_index,
    is_range,
    objective,
)
from ocptip.cli.command import CLOSED, MACHINE, PLACE, VERIFY, Command

FOR_PLANS = ("ocptip.motion.plan", "ocptip.certificate.checks", "ocptip.motion.planner.kernels")
"""Modules that are loaded by processes which plan."""

MACHINE_COMMANDS = (
    Command(
        "place",
        PLACE,
        "find base placements for tool poses and process forces",
        "Finds the best placements of the base for a task file, with all constraints checked.",
        "0 a verified placement, 1 no placement keeps all constraints",
        (
            argument("task", "TASK.toml", "a task, or several", nargs="+"),
            argument("--starts", "N", "initial placements (default: 5)", type=int, default=5),
            argument("--jobs", "N", "processes for several tasks (default: one per core)", type=int),
            SCHEDULER,
            TOLERANCE,
            SEED,
            OUT,
        ),
    ),
    Command(
        "cell",
        PLACE,
        "find base placements for a whole cycle, and plan its motions",
        "Finds placements of the base, plans the cycle on the best, and ranks them by energy or time.",
        "0 a placement with a verified plan, 1 none",
        (
            argument("task", "TASK.toml", "the cell"),
            argument("--places", "K", "placements to plan on (default: 3)", type=int, default=3),
            argument(
                "--starts",
                "N",
                "random initial motions per segment and placement (default: 2)",
                type=int,
                default=2,
            ),
            SEED,
            JOBS,
            objective("as in the task, or energy"),
            COST_PER_SECOND,
            TOLERANCE,
            OUT,
        ),
        preload=FOR_PLANS,
    ),
    Command(
        "drive",
        VERIFY,
        "drive envelope: how hard a mobile base may accelerate, brake and turn",
        "Computes the largest acceleration of the base by direction with the arm at rest in a posture, the "
        "largest braking on level ground and slopes, turning speeds and emergency stops. Writes text, JSON, "
        "CSV, a figure and parameters for Nav2. Of a plan: at the worst instants of its motion.",
        "0 computed, 1 the base cannot accelerate in some direction",
        (
            argument("task", "TASK.toml|PLAN_DIR", "task file of an arm on a mobile base; folder of a plan"),
            argument(
                "--posture",
                "Q1,Q2,...|start|goal|SEGMENT|stow",
                "posture of the arm: joint values as in the file (degrees, prismatic joints m), or the name "
                "of a start or goal (default: start); stow: search the posture in which the base may "
                "accelerate hardest",
            ),
            TOLERANCE,
            argument("--directions", "N", "directions of acceleration (default: 36)", type=int, default=36),
            argument("--speed", "V", "forward speed of turns and stops, m/s (1)", type=float, default=1.0),
            argument("--turning", "W", "turning speed of stops, rad/s (0.5)", type=float, default=0.5),
            argument("--slope", "DEG", "slope on which it brakes, degrees (5)", type=float, default=5.0),
            argument(
                "--deceleration",
                "A",
                "deceleration of the stop whose largest speed is computed, m/s^2 (default: 80 %% of the "
                "largest)",
                type=float,
            ),
            argument("--payload", "KG", "payload, kg (default: that of the task)", type=float),
            argument("--samples", "N", "postures drawn for stow (4000)", type=int, default=4000),
            SEED,
            argument("--holonomic", None, "the base also moves sideways", action="store_true"),
            OUT,
        ),
    ),
    Command(
        "compare",
        MACHINE,
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
        MACHINE,
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
        MACHINE,
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
    Command(
        "rate",
        CLOSED,
        "performance indices of a pose of an arm, a platform or a parallel robot",
        "Prints the performance indices of a pose: value, range, meaning.",
        "0 a regular pose, 1 a singular one (--along, --workspace: one of the poses, or none is reached)",
        (
            argument(
                "robot",
                "ROBOT",
                "FP1W2F, FSFS, W1P1P2W2, IRB2000, a URDF, 3RRR, 3RPR, Delta, 4PRRR, 6UPS, or a .toml with "
                "[arm], a platform or a parallel robot",
            ),
            argument(
                "pose",
                "POSE",
                "arm: joint angles, degrees; platform: x y z in m and rotation vector in degrees; parallel "
                "robot: its coordinates, m and degrees (default: home pose)",
                nargs="*",
                type=float,
            ),
            group(
                "many poses",
                argument(
                    "--along",
                    "MOTION.csv",
                    "rate every row (columns q1_deg, q2_m, ... as in plans; platforms: position and rotation "
                    "vector, q1_m to q6_deg)",
                ),
                argument(
                    "--workspace",
                    "NAME=LOW:HIGH",
                    "rate a grid over one to three coordinates, the others as in POSE: coordinates of a "
                    "parallel robot (x=-0.3:0.3 phi1=-40:40), else x y z of the TCP or platform, m, and "
                    "rx ry rz, a rotation vector in base axes relative to POSE, degrees",
                    nargs="+",
                    accepts=is_range,
                ),
                argument("--cells", "N", "cells of the grid per coordinate (default: 40)", type=int),
                argument(
                    "--range",
                    ("JOINT", "LOW", "HIGH"),
                    "range of a joint in all legs of a parallel robot (degrees, m)",
                    nargs=3,
                    type=float,
                    action="append",
                ),
                argument(
                    "--index",
                    "NAME",
                    "rate these indices only, such as dm_2 ctn",
                    nargs="+",
                    accepts=is_index,
                ),
                argument(
                    "--plot",
                    "FILE",
                    "draw the indices into a .png, .pdf or .svg file; with --along also an animation of the "
                    "bodies: .gif, .html, or .mp4 by ffmpeg",
                ),
            ),
            group(
                "what is rated",
                argument("--rates", "W", "joint rates of a motion to rate, any unit", nargs="+", type=float),
                argument(
                    "--ellipsoid",
                    ("A", "B", "C"),
                    "half-axes of the operation ellipsoid along the axes of the TCP or platform frame, m "
                    "(default for arms: sphere of 0.1)",
                    nargs=3,
                    type=float,
                ),
                argument(
                    "--center",
                    ("X", "Y", "Z"),
                    "its centre in that frame, m (0 0 0)",
                    nargs=3,
                    type=float,
                ),
                argument(
                    "--payload",
                    "KG",
                    "mass at the TCP for the indices that weigh masses, kg; or KG X Y Z with its position in "
                    "the TCP frame, m",
                    nargs="+",
                    type=float,
                ),
            ),
            group(
                "URDF",
                BASE_LINK,
                TOOL_FRAME,
                argument(
                    "--lock",
                    "JOINT=DEG",
                    "lock a joint, or several (finger_*), at this angle (prismatic: JOINT=0.2m); repeatable",
                    action="append",
                    default=[],
                ),
            ),
        ),
        files=("plot",),
    ),
    Command(
        "parallel",
        CLOSED,
        "mobility, assembly modes, workspace and code of a parallel robot",
        "Checks the mobility of a parallel robot, counts the operations of its inverse dynamics and writes "
        "them as C code (also of a serial arm). Writes URDF and MJCF.",
        "0 the robot moves as its description says, 1 it does not",
        (
            argument(
                "robot",
                "NAME|FILE",
                "3RRR, 3RPR, Delta, 4PRRR or 6UPS, or a robot file; an arm (code only): FP1W2F, FSFS, "
                "W1P1P2W2, a URDF, or a .toml with [arm]",
            ),
            group(
                "kinematics",
                argument(
                    "--modes",
                    "QA",
                    "all assembly modes for these motor positions (degrees, m; default: home pose)",
                    nargs="*",
                    type=float,
                ),
                argument(
                    "--workspace",
                    "NAME=LOW:HIGH",
                    "reachable poses over one to three coordinates (x=-0.3:0.3 phi1=-40:40; m, degrees)",
                    nargs="+",
                    accepts=is_range,
                ),
                argument(
                    "--at",
                    "Z",
                    "other coordinates (m, degrees; default: home pose)",
                    nargs="+",
                    type=float,
                ),
                argument(
                    "--cells",
                    "N",
                    "cells per coordinate (default: 40)",
                    type=int,
                    default=40,
                ),
                argument(
                    "--range",
                    ("JOINT", "LOW", "HIGH"),
                    "range of a joint in all legs, also unactuated (degrees, m); files give it per row",
                    nargs=3,
                    type=float,
                    action="append",
                ),
                argument("--plot", "FILE", "draw the workspace into a .png, .pdf or .svg file"),
            ),
            group(
                "code and models",
                argument("--c", "FILE", "write C source (also MEX and S-function), and a header beside it"),
                argument("--matlab", "FILE", "write a Matlab file, text that needs no compiler"),
                argument("--latex", "FILE", "write the equations as LaTeX (.tex)"),
                argument("--urdf", "FILE", "write the robot as URDF (a tree, loops cut)"),
                argument("--mjcf", "FILE", "write the robot as a MuJoCo model with its loops"),
                argument(
                    "--dynpar",
                    None,
                    "inertia parameters: 1 about centres of mass, 2 about frame origins, 3 base parameters "
                    "(default)",
                    type=int,
                    choices=(1, 2, 3),
                ),
                argument(
                    "--form",
                    None,
                    "accelerations and forces: S s'' and tau_s, X z'' and tau_s, Z z'' and tau_z, A s'' and "
                    "motor forces (default), AA q_a'' and motor forces",
                    choices=("S", "X", "Z", "A", "AA"),
                ),
            ),
        ),
        files=("c", "matlab", "latex", "urdf", "mjcf", "plot"),
    ),
)
