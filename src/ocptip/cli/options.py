"""Options that several commands have: checked, and put to use."""

from __future__ import annotations

import dataclasses
import re
import tempfile
from argparse import Namespace
from pathlib import Path

from ocptip.basics.errors import InputError, positive_number, share_of_one
from ocptip.motion.task import MotionTask


def with_limits(task: MotionTask, options: Namespace) -> MotionTask:
    """The task with those limits replaced that are given; InputError names an option that cannot be."""
    given = {}
    for name, limit in (("gn", "GN"), ("gt", "GT"), ("torque_ratio",) * 2, ("clearance",) * 2):
        value, option = getattr(options, name), f"--{name.replace('_', '-')}"
        if value is not None and limit in ("GN", "GT"):
            given[limit] = share_of_one(option, value)
        elif value is not None:
            given[limit] = positive_number(option, value, zero_allowed=limit == "clearance")
    return dataclasses.replace(task, limits=dataclasses.replace(task.limits, **given)) if given else task


def require_least(options: Namespace, **least: int) -> None:
    """Raise InputError if an option that is given is below its least value; names it as it is typed."""
    for name, bound in least.items():
        value = getattr(options, name)
        if value is not None and value < bound:
            raise InputError(f"--{name}: must be >= {bound}, got {value}")


def output_directory(options: Namespace, name: str) -> Path:
    """Where files go; InputError before anything is computed if they cannot be written there."""
    path = Path(options.out or f"ocptip-{options.command}-" + re.sub(r"[^\w.-]+", "-", name))
    if path.exists() and not path.is_dir():
        raise InputError(f"--out: {path} is not a directory")
    if not path.parent.is_dir():
        raise InputError(f"--out: no such directory: {path.parent}")
    place = path if path.is_dir() else path.parent
    try:
        with tempfile.TemporaryDirectory(dir=place, prefix=".ocptip-"):
            pass
    except OSError as error:
        raise InputError(f"--out: cannot write into {place}: {error.strerror}") from None
    return path
