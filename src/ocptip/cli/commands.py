"""Everything that can be typed: the commands and their arguments.

A new command is an entry here and a module of its name with `run(options) -> Report`. Only that module loads
numerics.
"""

from __future__ import annotations

from ocptip.cli.command import Argument, Command, argument, either

LIMITS = tuple(
    argument(option, unit, f"{text} (default: that of the task, or {default})", type=float)
    for option, unit, text, default in (
        ("--gn", "X", "largest tip-over value GN", 0.9),
        ("--gt", "X", "largest slip value GT", 0.9),
        ("--torque-ratio", "X", "largest torque / limit of any joint", 1),
        ("--clearance", "M", "minimum distance of what may collide, m", 0.01),
        ("--foot-lift", "M", "largest height of a foot that gives above the ground, m", 0),
    )
)
TOLERANCE = argument(
    "--tolerance",
    "T",
    "how far the world may be off: none, workshop (plan, retime, place without [tolerance]), site or a file",
)
SCHEDULER = argument(
    "--scheduler", "ADDRESS", "run on the workers of a Dask cluster (docs/motion-planner.md)"
)
SEED = argument("--seed", "N", "of the starts (default: 0)", type=int, default=0)
FILES = (
    argument("--out", "DIR", "where files go (default: ocptip-COMMAND-NAME); of several tasks: DIR/NAME"),
    argument("--overwrite", None, "replace files there that ocptip did not write", action="store_true"),
    argument("--no-figures", None, "write no figures", action="store_true"),
)


SENSITIVITIES = argument(
    "--sensitivities", None, "what would help, and by how much (docs/sensitivities.md)", action="store_true"
)
OF_MOTION = (
    either(
        argument("--case", "A..H", "a printed case (default: the one the motion names)"),
        argument("--task", "TASK.toml", "robot, support and limits of a task file (plan's folder: its)"),
    ),
    argument("--base", "SET", "base data of a case: printed or effective (default)"),
)


PRICE = argument("--price-per-second", "W", "energy + W J per second is least", type=float)
RATE = argument(
    "--rate",
    "HZ",
    "points per second for controllers (100; linear: updates of the controller, 500)",
    type=float,
)
EFFORT = argument("--effort", None, "write torques into trajectory.json, too", action="store_true")


def _objective(default: str) -> Argument:
    text = f"what is least (default: {default})"
    return argument("--objective", None, text, choices=("energy", "time", "both"))


def _time_scale(text: str) -> Argument:
    return argument("--time-scale", "F", text, type=float, nargs="+", default=[])


def _rise_time(text: str) -> Argument:
    return argument("--rise-time", "S", text, type=float)


COLUMNS = argument(
    "--columns",
    "FILE.toml",
    "what the columns of a CSV file are: [columns] with names as in motion.csv = title or number",
)
OF_FILE = (
    COLUMNS,
    argument(
        "--rate",
        "HZ",
        "updates of the controller, for points with positions only: a corner lasts one (500)",
        type=float,
    ),
    argument("--unit", None, "of angles in CSV columns that do not say it", choices=("deg", "rad")),
    _rise_time("of the accelerations, for ramp commands (default: that of the motion or the task)"),
)

_OF_PLANS = (
    "ocptip.motion.plan",
    "ocptip.pictures.plan",
    *("matplotlib.collections", "matplotlib.figure", "matplotlib.backends.backend_agg", "PIL.PngImagePlugin"),
)
"""What processes need that plan and draw."""

COMMANDS = (
    Command(
        "stand",
        "verdict, reserves and contact forces of a scene",
        "Does the base of a scene file stand? Prints verdict, contact forces and reserves.",
        "0 it stands, 1 it does not (or no verified answer)",
        (
            argument("scene", "SCENE.toml", "the scene (format: see docs/scenes.md)"),
            argument(
                "--posture",
                "Q1,Q2,...|start|goal|SEGMENT",
                "the file is a robot task (docs/motion-planner.md), the robot rests in this posture: joint "
                "values as in the file (degrees, sliding joints m; --posture=-90,0,... where the first is "
                "negative), or the name of a start or goal",
            ),
            argument("--plot", "FILE", "draw the scene into a .png, .pdf or .svg file"),
            TOLERANCE,
            SENSITIVITIES,
            argument(
                "--gn-reference",
                "NM",
                "reference moment M0 of GN, N m (default: a tenth of the largest moment reserve at rest)",
                type=float,
            ),
        ),
        files=("plot",),
    ),
    Command(
        "plan",
        "the cheapest or fastest arm motion that loses no contact",
        "Plans the ramp motion of least electric energy, or time, that keeps all contacts, and checks it.",
        "0 a verified plan, 1 none was found",
        (
            argument(
                "task",
                "A..H|TASK.toml",
                "published cases, or task files (see docs/motion-planner.md)",
                nargs="+",
            ),
            argument(
                "--base",
                None,
                "base data of the cases (default: effective, there contacts bind)",
                choices=("printed", "effective"),
            ),
            argument("--starts", "N", "random starts (default: 8)", type=int, default=8),
            SEED,
            argument("--jobs", "N", "processes (default: one per core)", type=int),
            SCHEDULER,
            _objective("that of the task, or energy"),
            PRICE,
            argument(
                "--controller",
                None,
                "who runs it: drives with ramps (default), or a controller that interpolates points",
                choices=("ramps", "linear", "cubic", "quintic"),
                default="ramps",
            ),
            RATE,
            _rise_time(
                "plan S-curves: accelerations rise within S, 0: ramps (default: that of the task, else what "
                "costs less within the tolerance; quintic: 0.02)"
            ),
            EFFORT,
            argument("--max-duration", "S", "the motion takes at most so long, s", type=float),
            argument("--duration", "S", "the motion takes just so long, s", type=float),
            argument(
                "--stop-safe",
                None,
                "stops begun at any instant keep the reserves, too: on its path, by the joints' brakes, or "
                "both (default: by brakes if the task has their torques; see docs/stops.md)",
                nargs="?",
                const="given",
                choices=("path", "brakes", "both"),
            ),
            SENSITIVITIES,
            *LIMITS,
            TOLERANCE,
            argument(
                "--largest-tolerance",
                None,
                "where no motion has the tolerance: plan a few times more, for the largest that one has",
                action="store_true",
            ),
            _time_scale("check the plan with all times multiplied by F, too (0.95: faster)"),
            *FILES,
        ),
        _OF_PLANS,
    ),
    Command(
        "place",
        "where should the base stand for given gripper poses and process forces?",
        "Finds the best places for the base of a task file, with all constraints checked.",
        "0 found and verified, 1 no placement keeps all constraints",
        (
            argument("task", "TASK.toml", "the task, or several (format: see docs/placement.md)", nargs="+"),
            argument("--starts", "N", "starts (default: 5)", type=int, default=5),
            argument("--jobs", "N", "of several tasks: processes (default: one per core)", type=int),
            SCHEDULER,
            TOLERANCE,
            SEED,
            *FILES,
        ),
    ),
    Command(
        "cell",
        "where should the base stand, and how should the arm move, for a whole cycle?",
        "Finds places for the base, plans the cycle on the best ones, and ranks them by energy or time.",
        "0 a place with a verified plan, 1 none was found",
        (
            argument("task", "TASK.toml", "the cell (format: see docs/cell.md)"),
            argument("--places", "K", "places to plan on, at most (default: 3)", type=int, default=3),
            argument(
                "--starts", "N", "random starts per segment and place (default: 2)", type=int, default=2
            ),
            SEED,
            argument("--jobs", "N", "processes (default: one per core)", type=int),
            _objective("that of the task, or energy"),
            PRICE,
            TOLERANCE,
            *FILES,
        ),
        _OF_PLANS,
    ),
    Command(
        "retime",
        "the fastest or cheapest timing of a given path that loses no contact",
        "Times a given path anew: as fast, or as cheaply, as all contacts and limits allow, and checks it.",
        "0 a verified timing, 1 none",
        (
            argument(
                "motion",
                "PATH",
                "a file of waypoints (TOML), or a motion as for check, whose times are forgotten",
            ),
            *OF_MOTION,
            _objective("time"),
            PRICE,
            argument("--max-duration", "S", "the motion takes at most so long, s", type=float),
            argument(
                "--jerk",
                "J",
                "largest jerk of every joint, deg/s^3 (sliding joints m/s^3): accelerations do not jump then",
                type=float,
            ),
            argument(
                "--path-tolerance",
                "X",
                "how far the path may be from what is given, degrees (sliding joints, tool lines: mm): "
                "corners are blended, noise is smoothed",
                type=float,
            ),
            argument(
                "--controller",
                None,
                "who runs it: a controller that interpolates points by cubics (default), straight lines, or, "
                "with --jerk, quintics",
                choices=("cubic", "linear", "quintic"),
                default="cubic",
            ),
            RATE,
            EFFORT,
            argument("--unit", None, "of angles in CSV columns that do not say it", choices=("deg", "rad")),
            COLUMNS,
            *LIMITS,
            TOLERANCE,
            *FILES,
        ),
    ),
    Command(
        "check",
        "does a given motion keep all limits at every instant?",
        "Checks a motion, or says what it violates and when: reserves, torques, clearance, speeds, "
        "accelerations, angles.",
        "0 the motion as given is verified, 1 it is not",
        (
            argument(
                "motion",
                "MOTION",
                "a plan's folder, or a file of it; other ramp commands, a joint trajectory (JSON, YAML), or "
                "samples as CSV",
            ),
            *OF_MOTION,
            argument(
                "--stops",
                None,
                "what if it is stopped at any instant: on its path, by the joints' brakes, or both (default)",
                nargs="?",
                const="both",
                choices=("path", "brakes", "both"),
            ),
            SENSITIVITIES,
            *LIMITS,
            TOLERANCE,
            *OF_FILE,
            _time_scale("check also with all times x F"),
            argument("--step", "S", "first spacing, s (0.01)", type=float, default=0.01),
        ),
    ),
    Command(
        "certify",
        "a proof that a motion keeps all limits at every instant, or the check of one",
        "Proves that a motion loses no contact and keeps all limits at every instant, not only where it was "
        "sampled; or checks a certificate, from its data alone.",
        "0 certified (a certificate: it holds), 1 not",
        (
            argument("motion", "MOTION|CERTIFICATE", "as for check; or a certificate.json"),
            *OF_MOTION,
            *LIMITS,
            TOLERANCE,
            *OF_FILE,
            argument("--out", "FILE", "write the certificate (JSON)"),
        ),
        files=("out",),
    ),
    Command(
        "view",
        "a plan, a scene or a placement in three dimensions, in a browser",
        "Shows robot, base, obstacles, contact forces, friction cones, the nearest tipping axis, the "
        "zero-moment point and what is left of the reserves (pip install 'ocptip[view]').",
        "0 shown or written",
        (
            argument("what", "PLAN_DIR|SCENE.toml|PLACE_DIR", "folder of a plan or a placement, or a scene"),
            argument("second", "PLAN_DIR", "of a plan that is shown beside the first, as a ghost", nargs="?"),
            argument("--html", "FILE", "write one file that needs nothing else (default: serve it here)"),
            argument("--task", "TASK.toml", "of a placement: its task file"),
        ),
        files=("html",),
    ),
    Command(
        "export",
        "a plan's robot on its base, and its motion, for simulators (MJCF, URDF)",
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
        "simulate",
        "a plan replayed by MuJoCo: does its base stand there, too?",
        "Replays a plan on a free base in MuJoCo (pip install 'ocptip[simulate]') and compares the feet's "
        "forces with the library's.",
        "0 no foot lifts or slides, 1 one does",
        (
            argument("plan", "PLAN_DIR", "folder of a plan"),
            argument("--stiffness", "N/M", "of all feet (default: as in the task, or stiff)", type=float),
            argument("--damping", "ZETA", "damping ratio of such feet (0.05)", type=float),
            argument(
                "--tilt",
                "DEG",
                "floor tilted by so much, downhill towards this angle from x to y (0)",
                nargs="+",
                type=float,
            ),
            argument("--payload", "KG", "so much more at the gripper point", type=float),
            argument("--friction", "F", "all coefficients x F", type=float),
            argument("--speed", "F", "the motion F times as fast", type=float),
            argument("--step", "S", "of the simulator (0.0001)", type=float, default=1e-4),
        ),
    ),
    Command(
        "compare",
        "a recording of a machine beside its plan: errors, and what would explain them",
        "Compares a recording with the plan that was run: joints, gripper, torques, force-torque sensor, "
        "power, base; finds which masses, frictions, delays, elasticities or signals are not as described.",
        "0 nothing was found that is not as described, 1 something was",
        (
            argument("recording", "RECORDING.csv", "what was measured (names of columns: docs/compare.md)"),
            argument("plan", "PLAN_DIR", "folder of the plan that was run"),
            argument("--unit", None, "of angles in columns that do not say it", choices=("deg", "rad")),
            COLUMNS,
            argument(
                "--same-clock",
                None,
                "time 0 of the recording is the begin of the motion (default: what most joints say)",
                action="store_true",
            ),
            argument(
                "--level", "P", "probability of any finding where all is as described (0.001)", type=float
            ),
            argument("--plot", "FILE", "draw both into a .png, .pdf or .svg file"),
        ),
        files=("plot",),
    ),
    Command(
        "identify",
        "masses, centres of mass, friction, power maps out of recordings, with their errors",
        "Identifies parameters of a machine from the recording of a plan that it ran, and writes them as "
        "tables of a task file, with the [tolerance] that their errors are (docs/identify.md).",
        "0 identified (what the recording does not tell is said)",
        (
            argument(
                "what",
                None,
                "what is looked for",
                choices=("payload", "base", "bodies", "arm", "power", "motion"),
            ),
            argument("recording", "RECORDING.csv", "what was measured (docs/identify.md); motion: TASK.toml"),
            argument("plan", "PLAN_DIR", "folder of the plan that was run (power: need not be)", nargs="?"),
            argument("--unit", None, "of angles in columns that do not say it", choices=("deg", "rad")),
            COLUMNS,
            argument("--tared", None, "the sensor was set to zero under load", action="store_true"),
            argument(
                "--bandwidth",
                "HZ",
                "arm: cutoff of the low-pass filter of the torques (inf: none; default: searched)",
                type=float,
            ),
            argument("--sigmas", "K", "standard errors on both sides that are tolerance (3)", type=float),
            argument("--task", "TASK.toml", "PLAN_DIR is a motion file, of this task"),
            SEED,
            argument("--out", "FILE", "write the tables of a task file (.toml); motion: its samples (.csv)"),
        ),
        files=("out",),
    ),
    Command(
        "report",
        "one document: machine, assumptions, load cases, worst cases, tolerated quantities",
        "Checks a plan, or the poses of a task, anew, and writes one HTML page (or PDF) for the safety file.",
        "0 written, and it stands; 1 it does not",
        (
            argument("plan", "PLAN_DIR|TASK.toml", "a plan's folder; a task: its poses at rest"),
            argument("--cases", "FILE.toml", "poses, payloads, tilts and pushes, see docs/report.md"),
            argument("--out", "FILE", ".html or .pdf (default: ocptip-report-NAME.html)"),
        ),
        files=("out",),
    ),
    Command(
        "rate",
        "how well conditioned is a pose of an arm or a platform?",
        "Prints the performance indices of a pose: value, range, meaning.",
        "0 a regular pose, 1 a singular one (--along, --workspace: among the poses, or none is reached)",
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
            argument(
                "--rates", "W", "joint rates (any unit) of a motion: rates it, too", nargs="+", type=float
            ),
            argument(
                "--ellipsoid",
                ("A", "B", "C"),
                "half-axes of the operation ellipsoid along the axes of the gripper or platform frame, m "
                "(default for arms: sphere of 0.1)",
                nargs=3,
                type=float,
            ),
            argument(
                "--along",
                "MOTION.csv",
                "rate every row (columns q1_deg, q2_m, ... as plans write them; platforms: position and "
                "rotation vector, q1_m to q6_deg)",
            ),
            argument(
                "--workspace",
                "NAME=LOW:HIGH",
                "rate a grid over one to three coordinates, the others as in POSE: of parallel robots their "
                "own (x=-0.3:0.3 phi1=-40:40), else x y z of the gripper or platform, m, and rx ry rz, a "
                "rotation vector in base axes that turns it from POSE, degrees",
                nargs="+",
            ),
            argument("--cells", "N", "with --workspace: per coordinate (40)", type=int),
            argument(
                "--range",
                ("JOINT", "LOW", "HIGH"),
                "with --workspace: range of a joint of all legs of a parallel robot (degrees, m)",
                nargs=3,
                type=float,
                action="append",
            ),
            argument(
                "--index", "NAME", "with --along and --workspace: these indices, such as dm_2 ctn", nargs="+"
            ),
            argument(
                "--plot",
                "FILE",
                "with --along and --workspace: draw the indices into a .png, .pdf or .svg file",
            ),
            argument("--center", ("X", "Y", "Z"), "its centre in that frame, m (0 0 0)", nargs=3, type=float),
            argument(
                "--payload",
                "KG",
                "arm: mass at the gripper point for the indices that weigh masses, kg; or KG X Y Z, its "
                "place in the gripper frame, m",
                nargs="+",
                type=float,
            ),
            argument("--base-link", "LINK", "URDF: link that rests (default: the root, or the driven base)"),
            argument("--tool-frame", "FRAME", "URDF: link of the end-effector (default: found by its name)"),
            argument(
                "--lock",
                "JOINT=DEG",
                "URDF: joint, or several (finger_*), at this angle (sliding: JOINT=0.2m); may be repeated",
                action="append",
                default=[],
            ),
        ),
        files=("plot",),
    ),
    Command(
        "init",
        "write a task file for the arm of a URDF",
        "Writes a task file with everything that a URDF knows; fill in the marked lines, then plan.",
        "0 written",
        (
            argument("robot", "ROBOT.urdf", "the robot"),
            argument("--base-link", "LINK", "link that rests (default: the root, or the driven base)"),
            argument("--tool-frame", "FRAME", "link of the end-effector (default: found by its name)"),
            argument("--out", "FILE", "where the file goes (default: ROBOT.toml)"),
        ),
    ),
    Command(
        "parallel",
        "mobility, assembly modes, cost and C code of a parallel robot; URDF, MJCF",
        "Checks a parallel robot's mobility, counts the operations of its inverse dynamics and writes them "
        "as C code (of a serial arm, too). Writes the robot for other programs.",
        "0 the robot moves as described, 1 it does not",
        (
            argument(
                "robot",
                "NAME|FILE",
                "3RRR, 3RPR, Delta, 4PRRR or 6UPS, or a robot file; an arm (its code only): FP1W2F, FSFS, "
                "W1P1P2W2, a URDF, or a .toml with [arm]",
            ),
            argument("--c", "FILE", "write C source, and a header beside it"),
            argument("--urdf", "FILE", "write the robot as URDF (a tree, loops cut)"),
            argument("--mjcf", "FILE", "write the robot as a MuJoCo model with its loops"),
            argument(
                "--modes",
                "QA",
                "all assembly modes for these motor positions (degrees, m; none: those of the home pose)",
                nargs="*",
                type=float,
            ),
            argument(
                "--workspace",
                "NAME=LOW:HIGH",
                "reachable poses over one to three coordinates, such as x=-0.3:0.3 phi1=-40:40 (m, degrees)",
                nargs="+",
            ),
            argument(
                "--at",
                "Z",
                "pose of the other coordinates (m, degrees; default: home)",
                nargs="+",
                type=float,
            ),
            argument("--cells", "N", "of the workspace, per coordinate (40)", type=int, default=40),
            argument(
                "--range",
                ("JOINT", "LOW", "HIGH"),
                "range of a joint of all legs, passive ones too (degrees, m); also in files, per row",
                nargs=3,
                type=float,
                action="append",
            ),
            argument("--plot", "FILE", "draw the workspace into a .png, .pdf or .svg file"),
            argument(
                "--dynpar",
                None,
                "inertia parameters: 1 about the centre of mass, 2 about the frames' origins, 3 base "
                "parameters (default)",
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
        files=("c", "urdf", "mjcf", "plot"),
    ),
    Command(
        "examples",
        "copy the example files into a directory",
        "Copies scenes, tasks, platforms and robots to begin with. Never replaces a file that differs.",
        "0 all of them are there",
        (argument("directory", "DIR", "where they go; made if it does not exist"),),
    ),
)
