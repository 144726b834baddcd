"""What can be typed under `place`: the commands and their arguments."""

from __future__ import annotations

from ocptip.cli.arguments import COST_PER_SECOND, JOBS, OUT, SCHEDULER, SEED, TOLERANCE, argument, objective
from ocptip.cli.command import FOR_PLANS, Command

COMMANDS = (
    Command(
        "place",
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
)
