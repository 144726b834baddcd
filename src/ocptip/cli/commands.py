"""Everything that can be typed: the commands of all groups.

A new command is an entry in `commands.py` of its group, and a module of its name beside it with
`run(options) -> Report`. Only that module loads numerics.
"""

from __future__ import annotations

from dataclasses import replace

from ocptip.cli.machine.commands import COMMANDS as MACHINE
from ocptip.cli.place.commands import COMMANDS as PLACE
from ocptip.cli.plan.commands import COMMANDS as PLAN
from ocptip.cli.poses_and_closed_chains.commands import COMMANDS as CLOSED
from ocptip.cli.start.commands import COMMANDS as START
from ocptip.cli.verify.commands import COMMANDS as VERIFY

GROUPS = {
    "start": START,
    "plan": PLAN,
    "verify": VERIFY,
    "place": PLACE,
    "machine": MACHINE,
    "poses and closed chains": CLOSED,
}
"""Commands by group, in the order of the help; each group has a folder of its name."""
COMMANDS = tuple(replace(command, group=group) for group, every in GROUPS.items() for command in every)
