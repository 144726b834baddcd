"""What can be typed under `verify`: the commands and their arguments."""

from __future__ import annotations

from ocptip.cli.arguments import (
    BAG,
    BASE_DESIGN,
    CANCEL,
    DESIGN,
    FILE_OF_MOTION,
    GATE,
    LIMITS,
    MOTION_OF,
    OUT,
    SEED,
    SENSITIVITIES,
    TOLERANCE,
    argument,
    drive_profile,
    group,
    stops,
    time_scale,
)
from ocptip.cli.command import Command

COMMANDS = (
    Command(
        "stand",
        "is a standing base stable? verdict, margins, contact forces",
        "Is the base of a scene file stable, or a robot task in a posture? Prints verdict, contact forces "
        "and margins.",
        "0 stable, 1 not stable, no verified answer, or the arm cannot rest there (torque, angle, clearance)",
        (
            argument("scene", "SCENE.toml", "a scene; with --posture a robot task or the folder of a plan"),
            argument(
                "--posture",
                "Q1,Q2,...|start|goal|SEGMENT",
                "posture of a robot task at rest: joint values as in the file (degrees, prismatic joints m; "
                "--posture=-90,0,... if the first is negative), or the name of a start or goal; of a plan "
                "those of its motion",
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
                argument(
                    "--base-deceleration",
                    "A",
                    "deceleration of a driving base while a cancelled arm stops, m/s^2 (default: as in the "
                    "task, or it drives on)",
                    type=float,
                ),
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
        "load, tilt and push charts over reach, height and azimuth",
        "Samples postures and computes in each the largest payload, tilt of the floor or push that keeps all "
        "contacts and limits, at rest or with joints that move. Writes charts as cranes have them: text, "
        "JSON, CSV and a figure.",
        "0 charted, 1 no sampled posture keeps the limits at zero",
        (
            argument("task", "A..H|TASK.toml", "a published case, or the task file of an arm"),
            argument(
                "--of",
                None,
                "what is charted: payload, tilt of the floor or push along it, any direction "
                "(default: payload)",
                choices=("payload", "tilt", "push"),
                default="payload",
            ),
            argument(
                "--push-height",
                "M",
                "the push acts at this height above the lowest contact, m (default: at the TCP)",
                type=float,
            ),
            argument(
                "--joint-speed",
                "X",
                "every joint moves in any direction at up to X times its speed limit (default: 0)",
                type=float,
                default=0.0,
            ),
            argument(
                "--joint-acceleration",
                "X",
                "every joint accelerates in any direction at up to X times its limit (default: 0)",
                type=float,
                default=0.0,
            ),
            argument("--samples", "N", "postures that are drawn (default: 10000)", type=int, default=10_000),
            SEED,
            TOLERANCE,
            argument(
                "--levels",
                "L",
                "values whose largest reach is charted by azimuth, kg, deg or N (default: zero, the task's "
                "payload, and what 90 to 10 %% of postures keep)",
                nargs="+",
                type=float,
            ),
            argument("--sectors", "N", "sectors of the azimuth (default: 8)", type=int, default=8),
            argument(
                "--cell",
                "M",
                "size of the cells of reach and height, m (default: at most 8 of each)",
                type=float,
            ),
            argument(
                "--most",
                "L",
                "largest value that is tried, kg, deg or N (default: ten times the task's payload, else the "
                "robot's mass; 60 deg; twice the base's weight)",
                type=float,
            ),
            BASE_DESIGN,
            OUT,
        ),
    ),
    Command(
        "report",
        "write one document: robot, assumptions, load cases, worst cases, robustness",
        "Checks a plan, or the poses of a task, and writes one HTML page (or PDF) for the safety file.",
        "0 written, and stable; 1 not stable",
        (
            argument("plan", "PLAN_DIR|TASK.toml", "folder of a plan; a task: its poses at rest"),
            argument("--cases", "FILE.toml", "load cases: poses, payloads, tilts and pushes"),
            argument("--serial", "TEXT", "serial number of the machine, for the title block"),
            argument("--author", "TEXT", "who answers for the document, for the title block"),
            argument("--out", "FILE", ".html or .pdf (default: ocptip-report-NAME.html)"),
        ),
        files=("out",),
    ),
    Command(
        "drive",
        "drive envelope: how hard a mobile base may accelerate, brake and turn",
        "Computes the largest acceleration of the base by direction with the arm at rest in a posture, the "
        "largest braking on level ground and slopes, turning speeds and emergency stops. Writes text, JSON, "
        "CSV, a figure and parameters for Nav2. Of a plan: at the worst instants of its motion.",
        "0 computed, 1 the base or the arm cannot rest there",
        (
            argument("task", "TASK.toml|PLAN_DIR", "task file of an arm on a mobile base; folder of a plan"),
            argument(
                "--posture",
                "Q1,Q2,...|start|goal|SEGMENT|stow",
                "posture of the arm: joint values as in the file (degrees, prismatic joints m), or the name "
                "of a start or goal (default: start, of a plan its motion); stow: search the posture in "
                "which the base may accelerate hardest",
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
)
