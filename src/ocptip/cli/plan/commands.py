"""What can be typed under `plan`: the commands and their arguments."""

from __future__ import annotations

from ocptip.cli.arguments import (
    BAG,
    BASE_LIMITS,
    CANCEL,
    COLUMNS,
    COST_PER_SECOND,
    EFFORT,
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
    TOPIC,
    UNIT,
    argument,
    drive_profile,
    group,
    objective,
    stops,
    time_scale,
)
from ocptip.cli.command import FOR_PLANS, Command

COMMANDS = (
    Command(
        "plan",
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
            group("a base that drives", drive_profile()),
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
                    "time for search and checks, s; checks that it does not leave time for are named",
                    type=float,
                ),
                argument(
                    "--starts", "N", "random initial motions (default: 8; of a cycle 2 per segment)", type=int
                ),
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
        "time a given path so that all contacts are kept, as fast or cheap as possible",
        "Replaces the timing of a path by the fastest, or cheapest, that keeps all contacts and limits, and "
        "checks it.",
        "0 a verified timing, 1 none",
        (
            argument(
                "motion", "PATH", "a file of waypoints (TOML), or a motion as for check without its times"
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
            group(
                "time",
                argument(
                    "--seconds",
                    "S",
                    "time until proof, robustness and cancels are left out, s; so does Ctrl-C",
                    type=float,
                ),
            ),
            group("a base that drives", drive_profile(), BASE_LIMITS),
            group("format of the path", UNIT, COLUMNS, TOPIC),
            GATE,
            OUT,
        ),
        files=("junit",),
    ),
)
