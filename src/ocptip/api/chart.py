"""`ocptip.chart`: load, tilt and push charts of a robot on its base, as crane makers hand them out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import scipy  # subpackages load on first use: that of the sequence takes a second

from ocptip.api.inputs.postures import rests_of
from ocptip.api.results.chart import LoadChart
from ocptip.api.tasks import TaskLike, load_task
from ocptip.basics.errors import InputError, finite_array, positive_number, whole_number
from ocptip.contact.support import Support
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.joint_box import JointBox
from ocptip.standing.at_rest.largest_level import largest_levels_kept
from ocptip.standing.at_rest.levels import LargestLevels
from ocptip.standing.at_rest.raised import Raised, RaisedPayload, RaisedPush, RaisedTilt
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.design import BALLAST, FOOT_WIDTH, SPEED, DesignLevels, ballasted, widened

SAMPLES, SECTORS = 10_000, 8
KINDS = ("payload", "tilt", "push")
_BLOCK = 2_000  # postures between two reports of progress
_QUANTILES = (0.1, 0.3, 0.6, 0.9)
"""Levels of the reaches, as shares of the postures that do not keep them."""


def chart(
    task: TaskLike,
    *,
    of: str = "payload",
    push_height: float | None = None,
    joint_speed: float = 0.0,
    joint_acceleration: float = 0.0,
    uncertainty: Uncertainty | str | None = None,
    samples: int = SAMPLES,
    seed: int = 0,
    levels: Sequence[float] | None = None,
    sectors: int = SECTORS,
    cell: float | None = None,
    most: float | None = None,
    ballast: Sequence[float] = (),
    foot_width: Sequence[float] = (),
    speed_override: Sequence[float] = (),
    progress: Callable[[int, int, None], None] | None = None,
) -> LoadChart:
    """Return the largest payload, tilt of the floor or push over reach, height and azimuth of the TCP.

    Example::

        found = ocptip.chart("examples/tasks/kit_arm.toml", samples=2000)
        print(found)
        found.save("chart")

    Args:
        task: a task of an arm, its file, or a published case.
        of: "payload", kg; "tilt" of the floor in any direction, deg; or "push" along the floor in any
            direction, N. Tilts and pushes are those with the task's payload.
        push_height: m above the lowest contact, in line with the centre of the contacts, of the push;
            default: at the TCP.
        joint_speed: share of its limit, 0 to 1 and more, up to which every joint moves in any direction.
        joint_acceleration: share of its limit, up to which every joint accelerates in any direction.
        uncertainty: what the limits hold within, an object, a preset ("workshop", "none") or a TOML file with
            a table `[tolerance]`. Default: that of the task, else "workshop".
        samples: postures that are drawn within the joint limits (a Halton sequence); what collides is
            dropped.
        seed: of the sequence.
        levels: kg, deg or N, of the reaches by azimuth; default: none, the task's payload, and what 90, 70,
            40 and 10 % of the postures keep, rounded.
        sectors: of the azimuth.
        cell: m, size of the cells of reach and height; default: at most 8 of each.
        most: kg, deg or N, the largest level that is tried; default: ten times the task's payload, else the
            mass of robot and base; 60 deg; twice the weight of the base.
        ballast: kg at the centre of mass of the base, for each of which levels are also computed.
        foot_width: factors on the horizontal distances of the contacts from their middle, likewise.
        speed_override: factors on the joint speeds; accelerations by their squares, likewise.
        progress: called as progress(done, postures, None).

    Raises:
        InputError: the robot is no arm, or a value cannot be used.
    """
    for name, value, least in (("samples", samples, 1), ("seed", seed, 0), ("sectors", sectors, 1)):
        whole_number(name, value, least)
    shares = {"joint_speed": joint_speed, "joint_acceleration": joint_acceleration}
    if push_height is not None:
        shares["push_height"] = push_height
    for name, value in (*shares.items(), *(("ballast", size) for size in ballast)):
        positive_number(name, value, zero_allowed=True)
    for name, value in (
        *(("foot_width", size) for size in foot_width),
        *(("speed_override", share) for share in speed_override),
        *([("cell", cell)] if cell is not None else []),
    ):
        positive_number(name, value)
    if of not in KINDS:
        raise InputError(f"of: must be one of {', '.join(KINDS)}, got {of!r}")
    if push_height is not None and of != "push":
        raise InputError(f"push_height: needs a chart of a push, this is one of a {of}")
    if speed_override and not joint_speed + joint_acceleration:
        raise InputError("speed_override: needs joint_speed or joint_acceleration")
    result = load_task(task, uncertainty=uncertainty)
    robot, _, limits = rests_of(result)["start"]
    robot.require_no_objects("chart")
    robot = Robot.of(robot, "task: load charts are for arms; this robot is a parallel one")
    drawn = halton_postures(robot, limits, samples, seed)
    gaps = robot.collision.gaps(drawn, limits.clearance)
    q = drawn[np.all(gaps >= limits.clearance, axis=1)]

    total, ready = len(q) * (1 + len(ballast) + len(foot_width) + len(speed_override)), 0

    def kept(standing: Robot, override: float = 1.0) -> LargestLevels:
        nonlocal ready
        box, parts = _box(robot, limits, shares, override), []
        raised = _raised(of, standing.if_alike or standing, push_height)
        top = raised.most if most is None else positive_number("most", most) / raised.scale
        for begin in range(0, max(len(q), 1), _BLOCK):
            block = q[begin : begin + _BLOCK]
            parts.append(largest_levels_kept(raised, limits, block, top, box))
            ready += len(block)
            if progress is not None:
                progress(ready, total, None)
        return LargestLevels.joined(parts)

    def on(support: Support) -> LargestLevels:
        return kept(robot.varied(support=support))

    support, raised = robot.support, _raised(of, robot, push_height)
    largest = kept(robot)
    rated = robot.payload.mass if robot.payload and of == "payload" else None
    tried = raised.most * raised.scale if most is None else most
    wanted = (
        _different(raised.scale * largest.levels[largest.kept_at_zero], rated)
        if levels is None
        else np.unique(finite_array("levels", levels, (None,)))
    )
    if not len(wanted) or np.any(wanted < 0):
        raise InputError(f"levels: must be one or more >= 0 {raised.unit}, got {wanted.tolist()}")
    about = result.name, robot, raised, limits, q, largest
    made = LoadChart(*about, (samples, seed), sectors, cell, wanted, tried, shares)
    others = [(BALLAST, size, on(ballasted(support, support.mass + size))) for size in ballast]
    others += [(FOOT_WIDTH, size, on(widened(support, size))) for size in foot_width]
    others += [(SPEED, share, kept(robot, share)) for share in speed_override]
    return replace(
        made, designs=tuple(DesignLevels(what, size, made.within(one)) for what, size, one in others)
    )


def _raised(of: str, robot: Robot, height: float | None) -> Raised:
    if of == "push":
        return RaisedPush(robot, height)
    return RaisedTilt(robot) if of == "tilt" else RaisedPayload(robot)


def _box(robot: Robot, limits: Limits, shares: dict[str, float], override: float) -> JointBox | None:
    """Speeds and accelerations of the joints within the shares; None at rest."""
    ends = []
    for name, power in (("speed", 1), ("acceleration", 2)):
        # What runs faster within the uncertainty does both.
        factor = shares[f"joint_{name}"] * (override * (1 + limits.tolerance.speed)) ** power
        end = np.zeros(robot.n) if factor == 0 else factor * getattr(robot.limits, name)
        if not np.all(np.isfinite(end)):
            joint = robot.names[int(np.argmax(~np.isfinite(end)))]
            raise InputError(f"joint_{name}: joint {joint} has no limit of its {name}")
        ends.append(end)
    return JointBox(*ends) if np.any(ends) else None


def _different(levels: np.ndarray, rated: float | None) -> np.ndarray:
    """Levels, ascending, whose reaches differ: those that most, some and few postures keep."""
    result = np.quantile(levels, _QUANTILES) if len(levels) else np.empty(0)
    return np.unique([0.0, *([rated] if rated else []), *(float(f"{level:.2g}") for level in result)])


def halton_postures(robot: Robot, limits: Limits, samples: int, seed: int) -> np.ndarray:
    """(N, n) postures within the joint limits; a joint without limits turns once, or slides 1 m."""
    (low, high), turns = robot.arm.angle_range(limits.angle_margin), ~robot.arm.prismatic
    usual = np.where(turns, np.pi, 0.5)
    low, high = np.where(np.isfinite(low), low, -usual), np.where(np.isfinite(high), high, usual)
    # A whole turn is enough: beyond it postures repeat.
    middle = (low + high) / 2
    half = np.where(turns, np.minimum((high - low) / 2, np.pi), (high - low) / 2)
    unit = scipy.stats.qmc.Halton(robot.n, rng=np.random.default_rng(seed)).random(samples)
    return middle + (2 * unit - 1) * half
