"""Values per joint in task files: one number, a list, or a table by names and patterns such as "wrist_*"."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

import numpy as np

from ocptip.basics.text import did_you_mean
from ocptip.basics.toml import Table
from ocptip.robots.model import ArmModel


def joint_values(table: Table, key: str, arm: ArmModel, *, slides: bool) -> np.ndarray | None:
    """Values of the turning or of the sliding joints, in their order.

    Args:
        table: that may hold the key.
        key: of a number, a list or a table; a name in it goes before a pattern.
        arm: whose joints.
        slides: of the sliding joints; else of the turning ones.

    Returns:
        (k,), NaN for joints that a table does not name; None if there is no such key.

    Raises:
        InputError: no such joint, a wrong number of them, or a value that cannot be used.
    """
    names = [name for name, own in zip(arm.joint_names, arm.prismatic, strict=True) if own == slides]
    value = table.value(key)
    if value is None:
        return None
    if not names:
        raise table.error(f"no joint of the arm {'slides' if slides else 'turns'}", key)
    if isinstance(value, dict):
        return _by_name(table.table(key), names)
    if isinstance(value, list) and len(value) != len(names) < arm.n:
        raise table.error(f"expected {len(names)} numbers ({', '.join(names)}), got {len(value)}", key)
    return table.get(key, size=len(names))


def _by_name(table: Table, names: Sequence[str]) -> np.ndarray:
    found = np.full(len(names), np.nan)
    for pattern in sorted(table, key=lambda own: own in names):
        value = table[pattern]
        fitting = [index for index, name in enumerate(names) if fnmatchcase(name, pattern)]
        if not fitting:
            raise table.error(
                f"no such joint; there are {', '.join(names)}{did_you_mean(pattern, names)}", pattern
            )
        found[fitting] = value
    return found
