"""Files that options name: load cases of a report (docs/report.md), and columns of a CSV file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from ocptip.basics import schema
from ocptip.basics.schema import Keys
from ocptip.basics.toml import Table
from ocptip.robots.model import ArmModel
from ocptip.standing.at_rest.load_cases import LoadCaseGrid
from ocptip.task_files.tables.joints import joint_values

_POSE = Keys(
    "posture of a report",
    "A posture beside start, goal and the critical ones.",
    {
        "name": schema.text("Title."),
        "angles_deg": schema.by_joint(
            "Values of turning joints.", "deg", single=False, otherwise="none turns"
        ),
        "positions_m": schema.by_joint(
            "Values of sliding joints.", "m", single=False, otherwise="none slides"
        ),
    },
)
LOAD_CASES = Keys(
    "load cases",
    "Load cases at rest: `ocptip report --cases`.",
    {
        "payload_kg": schema.vector(
            "Point masses at the TCP, beyond what it holds.", "kg", otherwise="usual"
        ),
        "tilt_deg": schema.vector("Tilts of the floor, in any direction.", "deg", otherwise="usual"),
        "push_N": schema.vector("Forces at the TCP, in any direction.", "N", otherwise="usual"),
        "pose": schema.tables(_POSE),
    },
)
COLUMNS_FILE = Keys(
    "columns file",
    "What the columns of a CSV file are: `--columns`.",
    {
        "columns": schema.table(
            Keys(
                "columns",
                "Columns by their names in motion.csv.",
                others=schema.anything(
                    "Title, or number from 1.", "text or whole number", {"type": ["string", "integer"]}
                ),
            )
        )
    },
)
_FIELDS = {"payload_kg": "payloads", "tilt_deg": "tilts", "push_N": "pushes"}


def load_asked(path: str | os.PathLike[str], arm: ArmModel, poses: Mapping[str, np.ndarray]) -> LoadCaseGrid:
    """Load cases of a TOML file; what it does not say is as by default.

    Args:
        path: of the file.
        arm: whose joints the poses are of.
        poses: those that are always checked, (n,) each.
    """
    with Table.read(Path(path), LOAD_CASES) as data:
        given = {}
        for key, name in _FIELDS.items():
            if (values := data[key]) is not None:
                if not len(values) or np.any(values < 0):
                    raise data.error(f"expected numbers >= 0, at least one, got {data.value(key)}", key)
                given[name] = tuple(values.tolist())
        more = {table["name"]: _pose(table, arm) for table in data.tables("pose")}
    return replace(LoadCaseGrid({**poses, **more}), **given)


def _pose(table: Table, arm: ArmModel) -> np.ndarray:
    q = np.full(arm.n, np.nan)
    slides = np.array(arm.prismatic)
    for key, joints in (("angles_deg", ~slides), ("positions_m", slides)):
        if not joints.any():
            continue
        table.require(key, "of the joints that " + ("turn" if key == "angles_deg" else "slide"))
        values = joint_values(table, key, arm, slides=key == "positions_m")
        if values is not None:
            if np.isnan(values).any():
                raise table.error("needs a value for every joint", key)
            q[joints] = values
    return q


def read_columns(path: str | os.PathLike[str] | None) -> dict[str, str | int] | None:
    """Titles or numbers of the columns of a CSV file, by their names in motion.csv; None without a file.

    Raises:
        InputError: the file cannot be read, or holds no columns; names the place.
    """
    if path is None:
        return None
    with Table.read(path, COLUMNS_FILE) as data:
        data.close(early=True)
        table = data.table("columns")
        results = {name: table.value(name) for name in table}
        for name, place in results.items():
            if isinstance(place, bool) or not isinstance(place, str | int):
                raise table.error(f"expected the title or the number of a column, got {place!r}", name)
        return results
