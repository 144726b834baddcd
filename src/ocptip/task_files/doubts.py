"""Files for another command, which are refused, and suspicious values: units, masses, a goal at the start."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ocptip.basics.errors import LARGEST, doubt, doubt_degrees, doubt_metres
from ocptip.basics.toml import Table
from ocptip.contact.bindings.unilateral import UnilateralContact

if TYPE_CHECKING:
    from ocptip.standing.mechanism import StandingMechanism

_ANGLES = (  # judged together; inclinations and mounts may well be small
    r"(motion\.(start|goal)|segment\[\d+\]\.goal)_deg(\..+)?",
    r"arm\.limits\.angle_(min|max)_deg(\..+)?",
    r"arm\.locked_deg\..+",
    r"segment\[\d+\]\.locked_deg\..+",
    r"(task\[\d+\]|(motion|segment\[\d+\])\.(start|goal)_pose)\.(rpy|rotation_vector)_deg",
)
_LENGTHS = re.compile(  # of robot and base; the world may be large
    r"contact\[\d+\]\.position|base\.(center_of_mass|feet|ground)|(arm|robot)\.mount_position"
    r"|arm\.sphere_radius|(segment\[\d+\]\.)?payload\.(\w+\.)?(center_of_mass|box)"
    r"|(base|(segment\[\d+\]\.)?payload(\.\w+)?)\.shape(\[\d+\])?\.(position|size|radius|length)"
)

_IN_MM = 100.0  # m: no doubt
_LIGHTEST_BASE = 0.25  # of the arm's mass; the published experiments had 0.42


def doubt_units(data: Table) -> None:
    """Warn of angles of a file that seem to be radians, and of lengths that seem to be millimetres; refuse
    lengths that can be nothing else.

    To be called before the file is read: a wrong unit may well be why it is refused.
    """
    leaves = {place: list(_numbers(value)) for place, value in data.leaves()}
    for pattern in _ANGLES:
        table = {place: numbers for place, numbers in leaves.items() if re.fullmatch(pattern, place)}
        doubt_degrees(f"{data.file}: {', '.join(table)}", [x for numbers in table.values() for x in numbers])
    for place, numbers in leaves.items():
        if _LENGTHS.fullmatch(place) and (farthest := max(map(abs, numbers), default=0.0)) > _IN_MM:
            raise data.error(f"{farthest:.4g} m is too far for a robot; lengths are in m, not in mm", place)
        if _LENGTHS.fullmatch(place):
            doubt_metres(f"{data.file}: {place}", numbers)


def _numbers(value: Any) -> Iterator[float]:
    """The numbers in a value that may be anything; those that readers refuse are left out."""
    if isinstance(value, list):
        for item in value:
            yield from _numbers(item)
    elif isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST:
        yield float(value)


def doubt_masses(data: Table, robot: StandingMechanism) -> None:
    """Warn of a base without clamps that is lighter than its payload, or far lighter than its arm."""
    if not all(isinstance(contact, UnilateralContact) for contact in robot.support.contacts):
        return
    (_, base), *carried = robot.masses.items()
    for name, mass in carried:
        share, part = (1.0, "") if name == "payload" else (_LIGHTEST_BASE, "a quarter of ")
        if base < share * mass:
            doubt(f"{data.file}: base.mass: {base:.4g} kg is less than {part}the {name}'s {mass:.4g} kg")


def doubt_way(data: Table, start: np.ndarray, goal: np.ndarray) -> None:
    """Warn of a motion that ends where it starts."""
    if np.allclose(start, goal, rtol=0.0, atol=1e-9):
        doubt(f"{data.file}: motion: start and goal are the same, there is nothing to plan")


_KINDS = {
    "plan": "a motion task",
    "place": "a placement task",
    "cell": "a cell",
    "stand": "a scene",
    "parallel": "a parallel robot",
    "rate": "a platform",
    "retime": "a path",
}


def require_kind(data: Table, command: str) -> None:
    """Refuse a file that is clearly meant for another command, and name that.

    Raises:
        InputError: it is one.
    """
    if "robot" in data and command == "plan":
        for key in ("arm", "obstacle"):
            if key in data:
                raise data.error(
                    "not together with [robot]; the box of its coordinates keeps it off others", key
                )
    other = _command(data)
    if other not in ("", command):
        hint = "; for its robot at rest give --posture start" if (other, command) == ("plan", "stand") else ""
        raise data.error(f"is {_KINDS[other]} (ocptip {other}), not {_KINDS[command]}{hint}")


def _command(data: Table) -> str:
    """The command, "" if the file leaves it open."""
    if "segment" in data and "terrain" in data:
        return "cell"
    for key, command in (("motion", "plan"), ("case", "plan"), ("task", "place"), ("leg", "parallel")):
        if key in data:
            return command
    if "waypoint" in data or "between" in data:
        return "retime"
    if "contact" in data and "arm" not in data and "robot" not in data:
        return "stand"
    return "rate" if "platform" in data and "base" in data else ""
