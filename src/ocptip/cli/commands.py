"""Everything that can be typed: the commands of all groups, in the order of the help.

A new command is an entry in `commands.py` of its group, and a module of its name beside it with
`run(options) -> Report`. Only that module loads numerics.
"""

from __future__ import annotations

from ocptip.cli.machine.commands import COMMANDS as MACHINE_COMMANDS
from ocptip.cli.place.commands import COMMANDS as PLACE_COMMANDS
from ocptip.cli.plan.commands import COMMANDS as PLAN_COMMANDS
from ocptip.cli.poses_and_closed_chains.commands import COMMANDS as CLOSED_COMMANDS
from ocptip.cli.start.commands import COMMANDS as START_COMMANDS
from ocptip.cli.verify.commands import COMMANDS as VERIFY_COMMANDS

COMMANDS = (
    *START_COMMANDS,
    *PLAN_COMMANDS,
    *VERIFY_COMMANDS,
    *PLACE_COMMANDS,
    *MACHINE_COMMANDS,
    *CLOSED_COMMANDS,
)
