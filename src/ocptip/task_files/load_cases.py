"""Load cases of a report; format: docs/report.md."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from ocptip.basics.toml import Table
from ocptip.motion.load_cases import Asked
from ocptip.robots.model import ArmModel
from ocptip.task_files.joint_values import joint_values

_KEYS = (("payload_kg", "payloads", 1.0), ("tilt_deg", "tilts", np.pi / 180), ("push_N", "pushes", 1.0))


def load_asked(path: str | os.PathLike[str], arm: ArmModel, poses: Mapping[str, np.ndarray]) -> Asked:
    """Load cases of a TOML file; what it does not say is as by default.

    Args:
        path: of the file.
        arm: whose joints the poses are of.
        poses: those that are always looked at, (n,) each.

    Raises:
        InputError: a value is unknown or cannot be used; names its place.
    """
    with Table.read(Path(path)) as data:
        given = {}
        for key, name, scale in _KEYS:
            if (values := data.vector(key, None, None, scale=scale)) is not None:
                if not len(values) or np.any(values < 0):
                    raise data.error(f"expected numbers >= 0, at least one, got {data.value(key)}", key)
                given[name] = tuple(values.tolist())
        more = {table.text("name"): _pose(table, arm) for table in data.tables("pose")}
    return replace(Asked({**poses, **more}), **given)


def _pose(table: Table, arm: ArmModel) -> np.ndarray:
    q = np.full(arm.n, np.nan)
    slides = np.array(arm.prismatic)
    for key, own, scale in (("angles_deg", ~slides, np.pi / 180), ("positions_m", slides, 1.0)):
        if not own.any():
            continue
        table.require(key, "of the joints that " + ("turn" if scale != 1.0 else "slide"))
        values = joint_values(table, key, arm, slides=scale == 1.0, scale=scale, together=False)
        if values is not None:
            if np.isnan(values).any():
                raise table.error("needs a value for every joint", key)
            q[own] = values
    return q
