"""Which command a file is for, told by its tables."""

from __future__ import annotations

from ocptip.basics.toml import Table

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
        hint = "; for its robot at rest give --posture" if (other, command) == ("plan", "stand") else ""
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
