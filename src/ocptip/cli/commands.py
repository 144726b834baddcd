"""Everything that can be typed: the commands and their arguments.

A new command is an entry here and a module of its name with `run(options) -> Report`. Only that module loads
numerics.
"""

from __future__ import annotations

from ocptip.cli.arguments import (
    BAG,
    BASE_DESIGN,
    BASE_LIMITS,
    BASE_LINK,
    CANCEL,
    COLUMNS,
    COST_PER_SECOND,
    DESIGN,
    EFFORT,
    FILE_OF_MOTION,
    GATE,
    JOBS,
    LIMITS,
    MAX_DURATION,
    MOTION_OF,
    OUT,
    RATE,
    SCHEDULER,
    SEED,
    SENSITIVITIES,
    TOLERANCE,
    TOOL_FRAME,
    TOPIC,
    UNIT,
    argument,
    drive_profile,
    group,
    objective,
    stops,
    time_scale,
)
from ocptip.cli.command import PLAN, START, VERIFY, Command
from ocptip.cli.machine_commands import FOR_PLANS, MACHINE_COMMANDS

COMMANDS = (
    Command(
        "init",
        START,
        "write a task file for the arm of a URDF",
        "Writes a task file with all that the URDF tells. Fill in the lines marked #>, then plan.",
        "0 written",
        (
            argument("robot", "ROBOT.urdf", "the robot; also a xacro file or a MuJoCo model"),
            BASE_LINK,
            TOOL_FRAME,
            argument("--xacro", "NAME:=VALUE", "arguments of a xacro file", nargs="+", default=[]),
            argument("--joint-limits", "YAML", "joint_limits.yaml of MoveIt"),
            argument("--srdf", "SRDF", "SRDF of MoveIt: pairs that may touch, named states"),
            argument("--package-dirs", "DIR", "folders with ROS packages, for meshes", nargs="+", default=[]),
            argument("--out", "FILE", "the task file (default: ROBOT.toml)"),
            argument("--overwrite", None, "replace the task file, filled in or not", action="store_true"),
        ),
    ),
    Command(
        "examples",
        START,
        "copy the example files into a folder",
        "Copies scenes, tasks, platforms and robots. Never replaces a file that differs.",
        "0 all of them are there",
        (argument("directory", "DIR", "the folder; created if it does not exist"),),
    ),
    Command(
        "schema",
        START,
        "print the JSON Schema of all files, for editors",
        "Prints the keys of all files as a JSON Schema: ocptip schema > task.schema.json.",
        "0 printed",
        (argument("--page", None, "print them as a page for people instead", action="store_true"),),
    ),
    Command(
        "view",
        START,
        "show a plan, a scene or a placement in 3D in a browser",
        "Shows robot, base, obstacles, contact forces, friction cones, the nearest tipping axis and the "
        "zero-moment point (needs: pip install 'ocptip[view]').",
        "0 shown or written",
        (
            argument("what", "PLAN_DIR|SCENE.toml|PLACE_DIR", "folder of a plan or a placement, or a scene"),
            argument("second", "PLAN_DIR", "a second plan, shown beside the first as a ghost", nargs="?"),
            argument("--html", "FILE", "write one self-contained page (default: serve it locally)"),
            argument("--movie", "FILE", "write an animation of one or two plans: .gif, or .mp4 by ffmpeg"),
            argument("--task", "TASK.toml", "task file of a placement"),
        ),
        files=("html", "movie"),
    ),
    Command(
        "studio",
        START,
        "try postures, payloads, floors and pushes with sliders, in a browser",
        "Shows the arm of a task at rest with sliders for joints, TCP, payload, friction, tilt, push and base"
        " acceleration. Margins, forces and robustness follow. Saves poses as start or goal, plans and plays "
        "(needs: pip install 'ocptip[view]').",
        "0 shown",
        (
            argument("task", "A..H|TASK.toml", "a published case, or the task file of an arm"),
            argument("--out", "DIR", "folder for saved poses and the plan (default: ocptip-studio-NAME)"),
            argument("--overwrite", None, "replace files that ocptip did not write", action="store_true"),
        ),
    ),
    Command(
        "completion",
        START,
        "print a script that completes commands and files in a shell",
        "Prints a completion script (needs: pip install 'ocptip[completion]'). For bash: "
        'eval "$(ocptip completion bash)"',
        "0 printed",
        (argument("shell", None, "the shell", choices=("bash", "zsh", "tcsh")),),
    ),
    Command(
        "plan",
        PLAN,
        "plan the arm motion with minimum energy or time that keeps all contacts",
        "Plans trapezoidal velocity profiles (or S-curves) with minimum electric energy, or time, that keep "
        "all contacts and limits within the uncertainty. Checks the motion and proves it.",
        "0 a verified plan, 1 no verified plan",
        (
            argument("task", "A..H|TASK.toml", "published cases, or task files", nargs="+"),
            argument(
                "--base",
                None,
                "base data of the published cases (default: effective, which makes contacts critical)",
                choices=("printed", "effective"),
            ),
            group(
                "motion",
                objective("as in the task, or energy"),
                COST_PER_SECOND,
                MAX_DURATION,
                argument("--duration", "S", "exact duration of the motion, s", type=float),
                argument(
                    "--rise-time",
                    "S",
                    "rise time of accelerations (S-curves), s; 0: trapezoidal profiles (default: as in the "
                    "task, else the cheapest within the uncertainty; quintic: 0.02)",
                    type=float,
                ),
                stops(
                    "--stop-safe",
                    "keep the contacts in stops begun at any instant: path-maintaining, by brakes (category "
                    "0), both (default: by brakes if the task has their torques), by a cancelled controller, "
                    "or all",
                    "given",
                ),
                *CANCEL,
            ),
            group(
                "controller",
                argument(
                    "--controller",
                    None,
                    "what executes the motion: drives that run the profiles (`ramps`, default), or a "
                    "controller that interpolates points",
                    choices=("ramps", "linear", "cubic", "quintic"),
                    default="ramps",
                ),
                RATE,
                EFFORT,
            ),
            LIMITS,
            group(
                "search",
                argument(
                    "--method",
                    None,
                    "direct: velocity profiles from start to goal; path: a path among obstacles, then its "
                    "timing (needs: pip install 'ocptip[paths]'); smooth: also of the smoothed path, and the "
                    "better one (default: what suits the task; with --seconds paths are smoothed)",
                    choices=("direct", "path", "smooth"),
                ),
                argument(
                    "--seconds",
                    "S",
                    "time after which the best verified motion so far is the plan, s",
                    type=float,
                ),
                argument("--starts", "N", "random initial motions (default: 8)", type=int, default=8),
                SEED,
                JOBS,
                SCHEDULER,
            ),
            group(
                "further answers",
                SENSITIVITIES,
                argument(
                    "--largest-tolerance",
                    None,
                    "if no motion is robust enough: search the largest uncertainty with a plan",
                    action="store_true",
                ),
                time_scale("also check the plan with all times multiplied by F (0.95: faster)"),
                BAG,
            ),
            GATE,
            OUT,
        ),
        preload=FOR_PLANS,
        files=("junit",),
    ),
    Command(
        "retime",
        PLAN,
        "time a given path so that all contacts are kept, as fast or cheap as possible",
        "Replaces the timing of a path by the fastest, or cheapest, that keeps all contacts and limits, and "
        "checks it.",
        "0 a verified timing, 1 none",
        (
            argument(
                "motion",
                "PATH",
                "a file of waypoints (TOML), or a motion as for check without its times",
            ),
            *MOTION_OF,
            group(
                "timing",
                objective("time"),
                COST_PER_SECOND,
                MAX_DURATION,
                argument(
                    "--jerk",
                    "J",
                    "maximum jerk of every joint, deg/s^3 (prismatic joints m/s^3): no acceleration steps",
                    type=float,
                ),
                argument(
                    "--path-tolerance",
                    "X",
                    "maximum deviation from the given path, degrees (prismatic joints, tool lines: mm): "
                    "blends corners, smooths noise",
                    type=float,
                ),
            ),
            group(
                "controller",
                argument(
                    "--controller",
                    None,
                    "how the controller interpolates points: cubic (default), linear, or quintic with --jerk",
                    choices=("cubic", "linear", "quintic"),
                    default="cubic",
                ),
                RATE,
                EFFORT,
            ),
            LIMITS,
            group("a base that drives", drive_profile(), BASE_LIMITS),
            group("format of the path", UNIT, COLUMNS, TOPIC),
            GATE,
            OUT,
        ),
        files=("junit",),
    ),
    Command(
        "stand",
        VERIFY,
        "is a standing base stable? verdict, margins, contact forces",
        "Is the base of a scene file stable, or a robot task in a posture? Prints verdict, contact forces "
        "and margins.",
        "0 stable, 1 not stable, no verified answer, or the arm cannot rest there (torque, angle, clearance)",
        (
            argument("scene", "SCENE.toml", "a scene, or with --posture a robot task"),
            argument(
                "--posture",
                "Q1,Q2,...|start|goal|SEGMENT",
                "posture of a robot task at rest: joint values as in the file (degrees, prismatic joints m; "
                "--posture=-90,0,... if the first is negative), or the name of a start or goal",
            ),
            argument(
                "--base-acceleration",
                "AX,AY",
                "with --posture: acceleration of the base, m/s^2, its axes (--base-acceleration=-2,0 brakes)",
            ),
            argument(
                "--base-turning",
                "W[,AL]",
                "with --posture: angular velocity and acceleration of the base about z, rad/s and rad/s^2",
            ),
            TOLERANCE,
            SENSITIVITIES,
            DESIGN,
            argument(
                "--gn-reference",
                "NM",
                "reference moment M0 of GN, N m (default: a tenth of the largest moment margin at rest)",
                type=float,
            ),
            argument("--plot", "FILE", "draw the scene into a .png, .pdf or .svg file"),
            GATE,
        ),
        files=("plot", "junit"),
    ),
    Command(
        "check",
        VERIFY,
        "does a given motion keep all contacts and limits?",
        "Checks a motion at every instant of a dense grid: contacts, torques, clearance, speeds, "
        "accelerations, angles. Says what it violates, and when.",
        "0 the motion keeps all limits, 1 it does not",
        (
            argument(
                "motion",
                "MOTION",
                "folder of a plan or a file of it, profile commands, a joint trajectory (JSON, YAML), "
                "samples (CSV), or a bag of ROS",
            ),
            *MOTION_OF,
            LIMITS,
            FILE_OF_MOTION,
            group("a base that drives", drive_profile("; MOTION may then be a posture (start, goal)")),
            group(
                "further answers",
                stops(
                    "--stops",
                    "also check stops begun at any instant: path-maintaining, by brakes (category 0), both "
                    "(default), by a cancelled controller, or all",
                    "both",
                ),
                *CANCEL,
                DESIGN,
                SENSITIVITIES,
                time_scale("also check with all times multiplied by F"),
                argument("--step", "S", "initial spacing of the grid, s (0.01)", type=float, default=0.01),
                argument("--plot", "FILE", "draw the contacts over time into a .png, .pdf or .svg file"),
                BAG,
            ),
            GATE,
        ),
        files=("plot", "junit"),
    ),
    Command(
        "certify",
        VERIFY,
        "prove that a motion keeps all limits at every instant, or check a proof",
        "Proves that a motion loses no contact and keeps all limits at every instant, not only at samples. "
        "Or checks a certificate from its data alone.",
        "0 proved (a certificate: it holds), 1 not proved",
        (
            argument("motion", "MOTION|CERTIFICATE", "as for check; or a certificate.json"),
            *MOTION_OF,
            LIMITS,
            FILE_OF_MOTION,
            argument("--out", "FILE", "write the certificate (JSON)"),
        ),
        files=("out",),
    ),
    Command(
        "simulate",
        VERIFY,
        "replay a plan in MuJoCo on a free base",
        "Replays a plan on a free base in MuJoCo and compares the contact forces (needs: "
        "pip install 'ocptip[simulate]').",
        "0 no foot lifts or slides, 1 one does",
        (
            argument("plan", "PLAN_DIR", "folder of a plan"),
            argument("--stiffness", "N/M", "stiffness of all feet (default: as in the task)", type=float),
            argument("--damping", "ZETA", "damping ratio of such feet (default: 0.05)", type=float),
            argument(
                "--tilt",
                "DEG",
                "tilt of the floor; a second number is the downhill direction from x to y (default: 0)",
                nargs="+",
                type=float,
            ),
            argument("--payload", "KG", "additional mass at the TCP", type=float),
            argument("--friction", "F", "factor of all friction coefficients", type=float),
            argument("--speed", "F", "speed override: the motion F times as fast", type=float),
            argument("--step", "S", "time step of the simulator (default: 0.0001)", type=float, default=1e-4),
        ),
    ),
    Command(
        "chart",
        VERIFY,
        "load charts: the largest payload over reach, height and azimuth",
        "Samples postures at rest and computes the largest payload in each, so that no contact is lost and "
        "joints hold it. Writes load charts as cranes have them: text, JSON, CSV and a figure. Motion is not "
        "covered.",
        "0 charted, 1 no sampled posture keeps the limits without payload",
        (
            argument("task", "A..H|TASK.toml", "a published case, or the task file of an arm"),
            argument("--samples", "N", "postures that are drawn (default: 10000)", type=int, default=10_000),
            SEED,
            TOLERANCE,
            argument(
                "--payloads",
                "KG",
                "payloads of the reaches, kg (default: the task's, and what 90 to 10 %% of postures hold)",
                nargs="+",
                type=float,
            ),
            argument("--sectors", "N", "sectors of the azimuth (default: 8)", type=int, default=8),
            argument("--cell", "M", "size of the cells of reach and height, m", type=float),
            argument(
                "--most",
                "KG",
                "largest payload that is tried (default: ten times the task's, else the robot's mass)",
                type=float,
            ),
            BASE_DESIGN,
            OUT,
        ),
    ),
    Command(
        "report",
        VERIFY,
        "write one document: robot, assumptions, load cases, worst cases, robustness",
        "Checks a plan, or the poses of a task, and writes one HTML page (or PDF) for the safety file.",
        "0 written, and stable; 1 not stable",
        (
            argument("plan", "PLAN_DIR|TASK.toml", "folder of a plan; a task: its poses at rest"),
            argument("--cases", "FILE.toml", "load cases: poses, payloads, tilts and pushes"),
            argument("--out", "FILE", ".html or .pdf (default: ocptip-report-NAME.html)"),
        ),
        files=("out",),
    ),
    *MACHINE_COMMANDS,
)
