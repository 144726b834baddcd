"""Claims about the nominal motion: contacts, limits and distances over intervals.

Torques, distances and speeds of points within an uncertainty are also checked here: they need no contact
forces.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.certificate.trusted.arm import Arm, Driven, Turns, driven, inertial, skew
from ocptip.certificate.trusted.contacts import Contacts
from ocptip.certificate.trusted.distances import Directions, Frame, distances
from ocptip.certificate.trusted.drives import Drives
from ocptip.certificate.trusted.forms import Form, U, dot, joined, known, linear, polynomial, stack
from ocptip.certificate.trusted.late import Late
from ocptip.certificate.trusted.plain import POINTS, VELOCITIES
from ocptip.certificate.trusted.program import run

TORQUES = "torque_ratio_worst_case"
"""Claim: within the tolerance no drive needs more than this share of its limit."""
CLEARANCE = "clearance_worst_case"
"""Claim: minimum distance, m, of what may collide, for all delays of joints within the tolerance."""
SPEED_OF_POINTS = "point_speed_ratio"
"""Claim: no point of `POINTS` is faster than this share of its limit."""
SPEED_OF_POINTS_WITHIN = "point_speed_ratio_worst_case"
"""Claim: likewise for all delays of joints and speed factors within the tolerance."""
RELATIVE = 1e-5  # of themselves: by so much may speeds and accelerations exceed their limits: rounded times
ANGLE = 1e-7  # rad or m, likewise


class Intervals:
    """Coordinates, speeds and accelerations of a motion over intervals, forms (n, N); ends (2, N), s; how the
    base drives, or None.

    Args:
        motion: of a certificate.
        piece: (N,) of which piece.
        start, end: (N,) ends of the intervals in u.
    """

    def __init__(
        self, motion: Mapping[str, Any], piece: np.ndarray, start: np.ndarray, end: np.ndarray
    ) -> None:
        times = np.array(motion["times"], dtype=float)[piece]
        middle = 0.5 * (start + end)
        u = Form.of(middle, 0.5 * (end - start) * (1 + U) + U)  # a little further than both ends
        half_time = 0.5 * (times[:, 1] - times[:, 0])
        rate = np.where(half_time > 0, 1 / np.where(half_time > 0, half_time, 1.0), 0.0)

        def derivatives(key: str, orders: int) -> list[Form]:
            c, values = np.moveaxis(np.array(motion[key], dtype=float)[piece], 0, 2), []  # (n, degrees, N)
            for order in range(orders):
                values.append(polynomial(c, u) * rate**order)
                c = c[:, 1:] * np.arange(1, c.shape[1])[:, None] if c.shape[1] > 1 else 0.0 * c
            return values

        self.q, self.qd, self.qdd = derivatives("angles", 3)
        self.driven = driven(*derivatives(VELOCITIES, 2)) if VELOCITIES in motion else None
        self.times = 0.5 * (times[:, 0] + times[:, 1]) + middle * half_time
        half = 0.5 * (end - start) * half_time
        self.ends = np.stack([self.times - half, self.times + half])


@dataclass(frozen=True, eq=False)
class Loads:
    """Over N intervals.

    Attributes:
        torques: (n, N), N m or N.
        wrench: (6, N) on the base.
        frames: of an arm with anything that may collide, see `Arm.frames`.
        late: (n, N) coordinates of delayed joints, see `Late.places`; None where nothing is claimed of them.
        late_turns: `Arm.turns` of these.
        speeds: (N,) by claim: the largest share of their limits that speeds of points reach.
        further: (k, N): of a parallel robot distances from singular poses and motor speeds.
    """

    torques: Form
    wrench: Form
    frames: list[Frame]
    late: Form | None
    late_turns: Turns
    speeds: dict[str, np.ndarray]
    further: Form | None


class Checker:
    """The claims about a motion, interval by interval.

    Args:
        model, bounds: of a certificate.
        tolerance: of it, for what is claimed of drives and distances; None where that is nothing.
        motion: of it, for distances with delayed joints.

    Attributes:
        contacts: with what is asked of them.
    """

    def __init__(
        self,
        model: Mapping[str, Any],
        bounds: Mapping[str, float],
        tolerance: Mapping[str, Any] | None = None,
        motion: Mapping[str, Any] | None = None,
    ) -> None:
        self.bounds, base = bounds, model["base"]
        gravity, about = (np.array(base[key], dtype=float) for key in ("gravity", "center_of_mass"))
        self.contacts = Contacts(model, bounds["GN"])
        self._base = base
        self.weight = np.concatenate([base["mass"] * gravity, np.zeros(3)])
        self.arm = None if model["arm"] is None else Arm(model["arm"], gravity, about)
        self.program = None if self.arm else model["program"]
        self._drives = None if tolerance is None or TORQUES not in bounds else Drives(model, tolerance)
        self._late = None
        if tolerance is not None and motion is not None and {CLEARANCE, SPEED_OF_POINTS_WITHIN} & set(bounds):
            self._late = Late(motion, tolerance["delay"] * (1 + tolerance["speed"]), 0.0)
            self._fastest = 1 + tolerance["speed"]
        self._points = model.get(POINTS, [])
        self.bodies, self.pairs = model["bodies"], np.array(model["pairs"], dtype=int).reshape(-1, 2)
        self._limits = limits_of(model)

    @np.errstate(invalid="ignore", over="ignore", divide="ignore")
    def loads(self, intervals: Intervals) -> Loads:
        """Torques and the wrench that the contacts have to hold, and what goes with the kind of robot."""
        frames, further, late_turns, speeds = [], None, [], {}
        late, late_speeds = self._late_states(intervals)
        if self.arm is not None:
            turns = self.arm.turns(intervals.q)
            torques, wrench = self.arm.loads(
                intervals.q, turns, intervals.qd, intervals.qdd, intervals.ends, intervals.driven
            )
            if len(self.pairs):
                frames = self.arm.frames(turns)
            if self._points:
                speeds[SPEED_OF_POINTS] = self._point_speeds(turns, intervals.qd)
            if late is not None:
                late_turns = self.arm.turns(late)
            if late_speeds is not None and SPEED_OF_POINTS_WITHIN in self.bounds:
                share = self._point_speeds(late_turns, late_speeds)
                speeds[SPEED_OF_POINTS_WITHIN] = self._fastest * share * (1 + U)
        else:
            assert self.program is not None  # of a robot that is no arm
            n = len(intervals.q.r)
            result = run(
                self.program,
                [form[k] for form in (intervals.q, intervals.qd, intervals.qdd) for k in range(n)],
            )
            torques, wrench = stack(*result[:n]), stack(*result[n : n + 6])
            further = stack(*result[n + 6 :]) if result[n + 6 :] else None
        wrench = wrench + self.weight[:, None]
        if intervals.driven is not None:
            wrench = wrench - self._base_inertia(intervals.driven)
        return Loads(torques, wrench, frames, late, late_turns, speeds, further)

    @np.errstate(invalid="ignore", over="ignore", divide="ignore")
    def margins(
        self, intervals: Intervals, loads: Loads, forces: np.ndarray, directions: Directions
    ) -> dict[str, np.ndarray]:
        """By how much each claim is kept, (N,) each: proved where >= 0; -inf where nothing is known.

        Args:
            at: N intervals.
            loads: of them.
            forces: (2, 1 + couples, contacts, 3, N) at their ends, see `Contacts.held`.
            directions: see `distances`.
        """
        limits, bounds = self._limits, self.bounds
        result = self.contact_margins(loads.wrench, forces)
        result["torque"] = 1 - _share(loads.torques, bounds["torque_ratio"] * limits["torque"])
        if self._drives is not None:
            most = (
                self._drives.greatest(
                    intervals.q, intervals.qd, intervals.qdd, intervals.ends, intervals.driven
                )
                / limits["torque"][:, None]
            )
            result["torque within tolerance"] = 1 - np.max(most, axis=0) / bounds[TORQUES] * (1 + U)
        result["speed"] = 1 + RELATIVE - _share(intervals.qd, limits["speed"])
        result["acceleration"] = 1 + RELATIVE - _share(intervals.qdd, limits["acceleration"])
        result["angle"] = angle_margins(intervals.q, limits) + ANGLE
        if len(self.pairs):
            asked = bounds["clearance"]
            gaps = distances(loads.frames, self.bodies, self.pairs, asked, directions)
            result["clearance"] = np.min(gaps, axis=0) - asked
        if self._late is not None and CLEARANCE in bounds:
            result["clearance within tolerance"] = self._late_gaps(loads.late_turns, directions)
        for name, share in loads.speeds.items():
            result[CLAIMS_OF_POINTS[name]] = 1 - share / bounds[name] * (1 + U)
        if loads.further is not None:
            assert self.program is not None
            low, high = loads.further.range
            least, most = (
                np.array([none if x is None else x for x in self.program[key]])[:, None]
                for key, none in (("lower", -np.inf), ("upper", np.inf))
            )
            slack = np.minimum(low - least + RELATIVE * np.abs(least), most - high + RELATIVE * np.abs(most))
            result["singularity, motor speed"] = np.min(slack, axis=0)
        return {name: known(value) for name, value in result.items()}

    def _base_inertia(self, driven: Driven) -> Form:
        """(6, N): what the motion of the base needs, about its centre of mass."""
        place, inertia = (np.array(self._base[key], dtype=float) for key in ("center_of_mass", "inertia"))
        force, moment = inertial(float(self._base["mass"]), place, inertia, driven[1])
        return joined(force, moment - linear(skew(place), force))

    def _late_states(self, intervals: Intervals) -> tuple[Form, Form] | tuple[None, None]:
        if self._late is None:
            return None, None
        if not self._late.delay:
            return intervals.q, intervals.qd
        blur = U * (1 + np.abs(intervals.ends).sum(axis=0))  # times are rounded
        q, qd = self._late.places(intervals.ends[0] - blur, intervals.ends[1] + blur)
        return q[: len(intervals.q.r)], qd[
            : len(intervals.q.r)
        ]  # of a base that drives nothing is asked here

    def _point_speeds(self, turns: Turns, qd: Form) -> np.ndarray:
        """The largest share of their limits that speeds of points reach, (N,), from above."""
        assert self.arm is not None  # programs have no points
        moved, point_speeds = self.arm.velocities(turns, qd), []
        for point in self._points:
            v, omega = moved[point["link"] - 1]
            v = v + linear(-skew(np.array(point["place"], dtype=float)), omega)
            point_speeds.append(np.sqrt(dot(v, v).range[1]) / point["speed"])
        return np.max(point_speeds, axis=0) * (1 + U)

    def _late_gaps(self, turns: Turns, directions: Directions) -> np.ndarray:
        """Distances beyond what is claimed for delayed joints, (N,), m; directions of their pairs have
        numbers after those of all pairs.
        """
        assert self.arm is not None  # programs have no bodies
        frames, count = self.arm.frames(turns), len(self.pairs)
        asked = self.bounds[CLEARANCE]

        def of_late(intervals: np.ndarray, pairs: np.ndarray) -> np.ndarray:
            return directions(intervals, pairs + count)

        return np.min(distances(frames, self.bodies, self.pairs, asked, of_late), axis=0) - asked

    @np.errstate(invalid="ignore", over="ignore")
    def contact_margins(self, wrench: Form, forces: np.ndarray) -> dict[str, np.ndarray]:
        """Those of `margins` that are about the contacts; wrench (6, N) on the base."""
        held = self.contacts.held(wrench, forces[:, 0], self.bounds["GT"])
        return {
            "contacts": known(held),
            "tip-over": known(self.contacts.upright(wrench, forces[:, 1:])),
        }


CLAIMS_OF_POINTS = {
    SPEED_OF_POINTS: "speed of points",
    SPEED_OF_POINTS_WITHIN: "speed of points within tolerance",
}
_UPPER = ("angle_max", "speed", "acceleration", "torque")


def limits_of(model: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Limits of joints (n,), infinite where there is none."""
    return {
        key: np.array([none if x is None else x for x in model["limits"][key]], dtype=float)
        for key, none in (("angle_min", -np.inf), *((key, np.inf) for key in _UPPER))
    }


def angle_margins(q: Form, limits: Mapping[str, np.ndarray]) -> np.ndarray:
    """How far coordinates (n, N) are inside their limits, (N,), rad or m."""
    low, high = q.range
    slack = np.minimum(low - limits["angle_min"][:, None], limits["angle_max"][:, None] - high)
    return np.min(slack, axis=0)


def _share(values: Form, limits: np.ndarray) -> np.ndarray:
    """Maximum share of limits (n,) that values (n, N) use."""
    low, high = values.range
    return np.max(np.maximum(high, -low) / limits[:, None], axis=0) * (1 + U)
