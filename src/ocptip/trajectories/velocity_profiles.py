"""Velocity profiles of all joints of an arm, and those of non-optimised joints (5.12 to 5.19).

Only some joints, those near the base, are optimised. Each of the others gets one trapezoidal velocity profile
from start to goal and ends with the motion. Angles in rad, times in s, start of the motion at t = 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array, naming, number_from, positive_number
from ocptip.basics.frozen import settle
from ocptip.trajectories.pieces import Pieces
from ocptip.trajectories.ramps import JointRamps, RampCommand


def s_curve(ramps: JointRamps, rise_time: float) -> Pieces:
    """Return the cubics of one joint whose profile has accelerations that take `rise_time` (s) to change.

    Raises:
        InputError: the rise time is not > 0.
    """
    tau, edges, goal = positive_number("rise_time", rise_time), ramps.times, ramps.angles[-1:]
    if ramps.end == 0:
        return Pieces(edges[:1], np.empty((4, 0, 1)), goal)
    t = np.unique(np.concatenate([edges, edges + tau]))
    edge_times, middles = np.stack([t, t - tau]), 0.5 * (t[1:] + t[:-1])
    angles, speeds, _ = ramps.states(edge_times)
    accelerations = ramps.pieces.at(np.stack([middles, middles - tau]), range(2, 3))[0][..., 0]
    phi = -np.diff(_integral(ramps, edge_times), axis=0)[0] / tau
    w, a, jerks = ((now - before) / tau for now, before in (angles, speeds, accelerations))
    phi[0], w[0], a[0] = ramps.phi_start, 0.0, 0.0
    return Pieces(t, np.stack([phi[:-1], w[:-1], a[:-1], jerks])[..., None], goal)


def _integral(ramps: JointRamps, times: np.ndarray) -> np.ndarray:
    """Integral of the angle from t = 0 to each time, rad s; the joint rests before and after."""
    lengths, angles, speeds = ramps.durations, ramps.angles[:-1], ramps.speeds[:-1]
    pieces = lengths * (angles + lengths * (speeds / 2 + lengths * ramps.accelerations / 6))
    at_edges = np.concatenate([[0.0], np.cumsum(pieces)])
    piece = np.clip(np.searchsorted(ramps.times, times, side="right") - 1, 0, len(lengths) - 1)
    t = np.clip(times, 0, ramps.end) - ramps.times[piece]
    inside = angles[piece] + t * (speeds[piece] / 2 + t * ramps.accelerations[piece] / 6)
    rest = np.minimum(times, 0) * ramps.phi_start + np.maximum(times - ramps.end, 0) * ramps.phi_end
    return at_edges[piece] + t * inside + rest


SHORTEST_RISE = 1e-4
"""Minimum rise time, s: far above the time within which switching times are one."""
_COMMAND_KEYS = ("phi_e", "speed", "acceleration")


def earliest_end(way: ArrayLike, speed_limit: ArrayLike, acceleration_limit: ArrayLike) -> np.ndarray:
    """Return the minimum duration (s) from rest to rest over `way` (rad), (5.13), (5.14); broadcasts.

    Args:
        way: angle to go, either sign, rad.
        speed_limit: > 0, rad/s.
        acceleration_limit: > 0, rad/s^2.
    """
    way, v, a = np.abs(way), np.asarray(speed_limit), np.asarray(acceleration_limit)
    return np.where(a * way <= v**2, 2 * np.sqrt(way / a), way / v + v / a)


def passive_command(
    phi_start: float, phi_goal: float, end: float, speed_limit: float, acceleration_limit: float
) -> RampCommand:
    """Return the one command that moves a non-optimised joint from rest to rest in exactly `end` seconds.

    The profile reaches the speed limit if it can, with the lowest acceleration that still ends in time
    (5.16): `t' = end - |way| / v_lim`; else it is a symmetric triangle, t' = end / 2 (5.17). The command's
    speed is v_lim in both. A joint that has nowhere to go does not move.

    Args:
        phi_start: rad.
        phi_goal: rad.
        end: when it is to end, s; at least :func:`earliest_end`.
        speed_limit: v_lim, rad/s.
        acceleration_limit: rad/s^2.

    Raises:
        InputError: the joint cannot be there so early, or a limit is not > 0.
    """
    way = abs(number_from("phi_goal", phi_goal) - number_from("phi_start", phi_start))
    v = positive_number("speed_limit", speed_limit)
    a_limit = positive_number("acceleration_limit", acceleration_limit)
    if way == 0:
        return RampCommand(phi_goal, v, a_limit)
    earliest = float(earliest_end(way, v, a_limit))
    if not number_from("end", end) >= earliest * (1 - 1e-12):
        raise InputError(f"end: must be >= {earliest:.6g} s at the joint's limits, got {end:.9g}")
    acceleration = v / (end - way / v) if way > 0.5 * v * end else 4 * way / end**2
    return RampCommand(phi_goal, v, min(acceleration, a_limit))  # above it by rounding only


@dataclass(frozen=True, eq=False)
class VelocityProfiles:
    """Commands to the drives of n joints: each has trapezoidal velocity profiles, from rest at t = 0.

    With rise times the joints move in S-curves, see `ocptip.trajectories.velocity_profiles`.

    Attributes:
        joints: the joints' profiles, base first.
        rise_times: (n,), s, of the joints' accelerations; empty: none, there are acceleration steps.
    """

    joints: tuple[JointRamps, ...]
    rise_times: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Raise InputError if there is no joint, or a rise time is below 0."""
        settle(self, joints=tuple(self.joints))
        if not self.joints:
            raise InputError("joints: at least one is needed, got none")
        settle(self, rise_times=checked_rise_times(self.rise_times, len(self.joints)))

    @classmethod
    def from_commands(
        cls,
        start: ArrayLike,
        commands: Sequence[Sequence[RampCommand]],
        rise_times: ArrayLike = (),
    ) -> VelocityProfiles:
        """Return the profiles from rest at angles `start` ((n,), rad) under each joint's commands.

        Args:
            start: (n,), rad.
            commands: per joint.
            rise_times: s, of the accelerations: one for all joints, (n,), or none.

        Raises:
            InputError: numbers of joints differ, or a joint has no command; names the joint, counted from 1.
        """
        start = finite_array("start", start, (len(commands),))
        joints = []
        for number, (phi, of_joint) in enumerate(zip(start, commands, strict=True), 1):
            with naming(f"joint {number}"):
                joints.append(JointRamps.from_commands(phi, of_joint))
        return cls(tuple(joints), checked_rise_times(rise_times, len(joints)))

    def with_rise_times(self, rise_times: ArrayLike) -> VelocityProfiles:
        """Return the same commands with accelerations that rise within this time, s: one for all, or (n,).

        0: trapezoidal velocity profiles.

        Raises:
            InputError: a rise time is below 0, or their number is wrong.
        """
        return VelocityProfiles(self.joints, checked_rise_times(rise_times, len(self.joints)))

    @cached_property
    def pieces(self) -> tuple[Pieces, ...]:
        """The polynomial pieces of each joint."""
        rises = self.rise_times or (0.0,) * len(self.joints)
        pairs = zip(self.joints, rises, strict=True)
        return tuple(s_curve(ramps, rise) if rise > 0 else ramps.pieces for ramps, rise in pairs)

    @classmethod
    def ending_together(
        cls,
        start: ArrayLike,
        goal: ArrayLike,
        commands: Sequence[Sequence[RampCommand] | None],
        speed_limits: ArrayLike,
        acceleration_limits: ArrayLike,
    ) -> VelocityProfiles:
        """Return profiles with which the joints without commands end with the others (5.12 to 5.19).

        The end is that of the last joint with commands, or the earliest possible end of the slowest
        non-optimised joint if that is later (5.15).

        Args:
            start, goal: angles, (n,), rad; the goal is read for non-optimised joints only.
            commands: per joint its commands, or None if it is not optimised.
            speed_limits: (n,), rad/s, read for non-optimised joints only.
            acceleration_limits: (n,), rad/s^2, likewise.

        Raises:
            InputError: see :meth:`from_commands`; a limit of a non-optimised joint is not > 0; shapes do not
                fit.
        """
        n = len(commands)
        start, goal = finite_array("start", start, (n,)), finite_array("goal", goal, (n,))
        v = finite_array("speed_limits", speed_limits, (n,))
        a = finite_array("acceleration_limits", acceleration_limits, (n,))
        passive = [j for j in range(n) if commands[j] is None]
        for j in passive:
            positive_number(f"speed_limits of joint {j + 1}", v[j])
            positive_number(f"acceleration_limits of joint {j + 1}", a[j])
        ends = earliest_end((goal - start)[passive], v[passive], a[passive]).tolist()
        joints = dict[int, JointRamps]()
        for j, of_joint in enumerate(commands):
            if of_joint is not None:
                with naming(f"joint {j + 1}"):
                    joints[j] = JointRamps.from_commands(start[j], of_joint)
        end = max([*ends, *(ramps.end for ramps in joints.values())], default=0.0)
        for j in passive:
            command = passive_command(start[j], goal[j], end, v[j], a[j])
            joints[j] = JointRamps.from_commands(start[j], [command])
        return cls(tuple(joints[j] for j in range(n)))

    @property
    def _start(self) -> list[float]:
        """Angles before the motion, rad."""
        return [joint.phi_start for joint in self.joints]

    def time_scaled(self, factor: float) -> VelocityProfiles:
        """Return the same path with all times multiplied by `factor` > 0 (below 1: faster)."""
        factor = positive_number("factor", factor)
        scaled = [
            [RampCommand(c.phi_e, c.speed / factor, c.acceleration / factor**2) for c in joint.commands]
            for joint in self.joints
        ]
        return VelocityProfiles.from_commands(self._start, scaled, factor * np.array(self.rise_times))

    def slowed(self, factor: float) -> VelocityProfiles:
        """Return profiles that take `factor` > 0 times as long, with the same rise times."""
        return self.with_rise_times(0.0).time_scaled(factor).with_rise_times(self.rise_times)

    def to_dict(self, units: Sequence[str] = ()) -> dict[str, Any]:
        """Return `start` (degrees) and `commands`, per joint a list of commands in degrees and seconds.

        S-curves also have `rise_time_s`, one for all joints or a list.

        Args:
            units: of the joints, "rad" or "m"; where one is "m", start and commands of that joint are in
                metres and seconds, and `units`, "deg" or "m" per joint, is added.
        """
        lengths = [unit == "m" for unit in units] or [False] * len(self.joints)
        commands = [
            [_command_dict(command, length) for command in joint.commands]
            for joint, length in zip(self.joints, lengths, strict=True)
        ]
        start = [v if length else np.rad2deg(v) for v, length in zip(self._start, lengths, strict=True)]
        named = {"units": ["m" if length else "deg" for length in lengths]} if any(lengths) else {}
        rises: dict[str, Any] = {}
        if self.rise_times:
            same = len(set(self.rise_times)) == 1
            rises = {"rise_time_s": self.rise_times[0] if same else list(self.rise_times)}
        return {**named, "start": start, "commands": commands, **rises}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> VelocityProfiles:
        """Return the profiles written by :meth:`to_dict`; keys that it does not write are ignored.

        Raises:
            InputError: a key is missing or unknown, or a value cannot be used; names joint and command.
        """
        if not isinstance(data, Mapping):
            raise InputError(f"motion: expected a table with start and commands, got {data!r}")
        if missing := [key for key in ("start", "commands") if key not in data]:
            raise InputError(f"motion: {missing[0]} is missing")
        joints = data["commands"]
        if not _is_list(joints) or not all(map(_is_list, joints)):
            raise InputError("commands: expected one list of commands per joint")
        units = data.get("units", ["deg"] * len(joints))
        if not _is_list(units) or len(units) != len(joints) or not set(units) <= {"deg", "m"}:
            raise InputError(f"units: expected deg or m per joint, got {units!r}")
        lengths = [unit == "m" for unit in units]
        commands = [
            [_command_from(entry, f"joint {j}, command {k}", length) for k, entry in enumerate(joint, 1)]
            for j, (joint, length) in enumerate(zip(joints, lengths, strict=True), 1)
        ]
        start = finite_array("start", data["start"], (len(joints),))
        rise_times = checked_rise_times(data.get("rise_time_s", ()), len(joints), "rise_time_s")
        return cls.from_commands(np.where(lengths, start, np.deg2rad(start)), commands, rise_times)


def checked_rise_times(rise_times: Any, n: int, name: str = "rise_time") -> tuple[float, ...]:
    """Return one rise time, none or (n,), s, as a tuple of n; empty if all are 0.

    Raises:
        InputError: one is not a number or below 0, or too short to differ from none, or there are not n.
    """
    given = (
        list(rise_times) if _is_list(rise_times) or isinstance(rise_times, np.ndarray) else [rise_times] * n
    )
    if not given:
        return ()
    if len(given) != n:
        raise InputError(f"{name}: expected one, or one for each of {n} joints, got {len(given)}")
    result = tuple(positive_number(name, one, zero_allowed=True) for one in given)
    if any(0 < one < SHORTEST_RISE for one in result):
        raise InputError(
            f"{name}: must be 0 or at least {SHORTEST_RISE} s, got {min(filter(None, result))!r}"
        )
    return result if any(result) else ()


def _is_list(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _command_dict(command: RampCommand, length: bool) -> dict[str, float]:
    values = {key: getattr(command, key) for key in _COMMAND_KEYS}
    return values if length else {key: math.degrees(value) for key, value in values.items()}


def _command_from(entry: Any, where: str, length: bool) -> RampCommand:
    """Read {"phi_e": deg, "speed": deg/s, "acceleration": deg/s^2}, or the same in m."""
    if not isinstance(entry, Mapping) or set(entry) != set(_COMMAND_KEYS):
        raise InputError(f"{where}: expected exactly the keys {', '.join(_COMMAND_KEYS)}, got {entry!r}")
    with naming(where):
        checks = {"phi_e": number_from, "speed": positive_number, "acceleration": positive_number}
        values = [checks[key](key, entry[key]) for key in _COMMAND_KEYS]
        return RampCommand(*(values if length else map(math.radians, values)))
