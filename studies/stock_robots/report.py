"""The table of the study."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import Any

from studies.common import table

COMMANDS = ("init", "plan", "check", "retime", "simulate", "report")


def markdown(rows: Sequence[dict[str, Any]]) -> str:
    """A line per robot with outcome, CPU seconds and memory of each command; then reasons of refusals."""
    robots: dict[str, dict[str, dict[str, Any]]] = {}
    for row in rows:
        commands = robots.setdefault(row["urdf"], {})
        if row["command"] == "init":
            commands.clear()  # a later run of the robot replaces the earlier one
        commands["init" if row["command"].startswith("init") else row["command"]] = row
    lines = table(
        ["robot", *(f"`{name}`" for name in COMMANDS)],
        (
            [short(urdf), *(cell(commands.get(name)) for name in COMMANDS)]
            for urdf, commands in sorted(robots.items())
        ),
        left=7,
    )
    totals = Counter(row["outcome"] for commands in robots.values() for row in commands.values())
    counts = ", ".join(f"{count} {outcome}" for outcome, count in totals.most_common())
    reasons: dict[str, list[str]] = {}
    for urdf, commands in sorted(robots.items()):
        for name, row in commands.items():
            if row["outcome"] not in ("proved", "checked", "yes"):
                reasons.setdefault(f"`{name}`, {row['outcome']}: {general(row['reason'])}", []).append(
                    short(urdf)
                )
    listed = [f"- {reason}: {', '.join(names)}" for reason, names in sorted(reasons.items())]
    return "\n".join([f"{len(robots)} robots: {counts}.", "", *lines, "", *listed]) + "\n"


def general(reason: str) -> str:
    """A reason without names and folders of files, so that robots with the same one stand in one line."""
    reason = re.sub(r"(task\.toml: arm\.urdf: )?\S*\.urdf: |task\.toml: ", "", reason)
    reason = re.sub(r"'[^']*'", "'...'", reason)
    reason = re.sub(r"(, '\.\.\.')* and \d+ more", "", reason)
    return "; ".join(dict.fromkeys(reason.split("; ")))


def short(urdf: str) -> str:
    """Package and file."""
    package, *folders, file = urdf.split("/")
    name = file.removesuffix(".urdf")
    if name in ("model", "robot_description"):
        name = next(folder for folder in reversed(folders) if folder != "urdf")
    return f"{package}: {name}"


def cell(row: dict[str, Any] | None) -> str:
    """Outcome, CPU seconds, MB."""
    return "-" if row is None else f"{row['outcome']} {row['cpu']:.0f} s {row['memory']:.0f} MB"
