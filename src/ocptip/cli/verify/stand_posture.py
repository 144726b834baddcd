"""`ocptip stand TASK.toml --posture`: the scene of a robot that rests in a posture."""

from __future__ import annotations

from argparse import Namespace

import numpy as np

from ocptip.api.inputs.postures import RestingPosture, resting_posture, rests_of, task_at_rest
from ocptip.basics.errors import InputError, doubt_degrees
from ocptip.basics.text import did_you_mean
from ocptip.robots.base_motion import BaseMotion
from ocptip.standing.mechanism import StandingMechanism

_ELSEWHERE = {"gn_reference": "reference_moment in [limits]"}


def read_posture(options: Namespace) -> RestingPosture:
    """The robot of a task file in the posture that is asked for.

    Raises:
        InputError: no such posture, the task cannot be read, or options that robots do not have here.
    """
    for name, instead in _ELSEWHERE.items():
        if getattr(options, name):
            raise InputError(f"--{name.replace('_', '-')}: not with --posture; use {instead}")
    posture, motion = posture_of(options.scene, options.posture), base_motion_of(options)
    return posture if motion is None else posture.driving(motion)


def posture_of(file: str, asked: str) -> RestingPosture:
    """The robot of a task file or plan in a posture: joint values in units of task files, or a name in it."""
    task = task_at_rest(file)
    rests = rests_of(task)
    return resting_posture(task, asked if asked in rests else _values(rests["start"][0], asked, list(rests)))


def base_motion_of(options: Namespace) -> BaseMotion | None:
    """The motion of the base that options ask for; None: it rests."""
    a, turning = (
        _numbers(name, getattr(options, name.replace("-", "_")), counts)
        for name, counts in (("base-acceleration", (2,)), ("base-turning", (1, 2)))
    )
    if a is None and turning is None:
        return None
    w, al = [*(turning or ()), 0.0, 0.0][:2]
    return BaseMotion((*(a or (0.0, 0.0)), 0.0), (0.0, 0.0, w), (0.0, 0.0, al))


def _numbers(name: str, text: str | None, counts: tuple[int, ...]) -> tuple[float, ...] | None:
    if text is None:
        return None
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) not in counts or not np.isfinite(values).all():
        wanted = " or ".join(map(str, counts))
        raise InputError(f"--{name}: expected {wanted} finite numbers with a comma between, got {text!r}")
    return values


def _values(robot: StandingMechanism, text: str, names: list[str]) -> np.ndarray:
    """Joint values (n,), rad and m, from text in the units of task files."""
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        raise InputError(
            f"--posture: expected {robot.n} numbers with commas, or one of {', '.join(names)}; got {text!r}"
            f"{did_you_mean(text, names)}"
        ) from None
    if len(values) != robot.n or not np.isfinite(values).all():
        raise InputError(
            f"--posture: expected {robot.n} finite numbers ({', '.join(robot.names)}), got {text!r}"
        )
    in_degrees = (robot.arm is not None) & (np.array(robot.units) == "rad")
    doubt_degrees("--posture", values[in_degrees].tolist())
    return np.where(in_degrees, np.deg2rad(values), values)
