"""A motion with elastic joints: how the gripper vibrates, what the base feels of it, which modes ring.

The drives do what the motion says. Vibration is where the gripper is, less where it would sag to at rest in
the same posture under the same loads: what accelerations bend, and what rings, base and feet included.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from ocptip.basics.text import percent, quantity
from ocptip.numerics.vectors import cross
from ocptip.reserves.tipping import TipMap
from ocptip.standing.contact_margins import ContactMargins, Margin
from ocptip.standing.elastic.springs import Course, Ride, Simulation
from ocptip.standing.elastic.steps import Modes
from ocptip.standing.instants import Loaded
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.trajectory import Trajectory

SETTLED = 1e-4  # m: the gripper is at rest when it stays as near to its last place
_DECAYS = 6.0  # time constants of the slowest mode for which is looked on after the end
_AFTER = 0.2, 5.0  # s: at least and at most
_SHOWN = 3  # modes
_ROUNDED = 1e-6
_INSTANTS = 400  # of a motion whose modes are looked at, and, five times as many, whose contacts are
_NEAREST = 4  # worst instants around which all are looked at
BENT = 0.1  # rad or m: a gear that bends farther has left what is linear
_WORTH = 0.8  # of the vibration: a rise time that leaves more is not worth a word


@lru_cache(maxsize=4)
def ridden(robot: StandingMechanism, motion: Trajectory) -> tuple[Simulation, Course]:
    """Base, feet and gears through a motion and after it, as long as something rings."""
    elastic = robot.support.elastic if robot.swings else None
    ride = Ride(robot, motion, rest=1.0)
    modes = None if elastic is None else Modes.of(elastic, ride.start_inertia[:6, :6])
    simulation = Simulation(ride, elastic, modes)
    if robot.chain is None and modes is not None:
        rate = 2 * np.pi * modes.lowest * max(modes.damping, 1e-9)
    else:
        ringing = simulation.modes(len(ride.begins) - 1)
        rate = np.min(2 * np.pi * np.prod(ringing, axis=1), initial=np.inf)
    ride.lengths[-1] = np.clip(_DECAYS / max(rate, 1e-9), *_AFTER)
    return simulation, simulation.run()


def shifts(robot: StandingMechanism, q: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """(T, 3), m: by how much feet and gears shift the gripper.

    Args:
        robot: whose.
        q: (T, n) drives.
        moved: (T, 6 + m) twists of the base and springs of gears.
    """
    bent = robot.tool(q, moved[:, 6:])
    arms = bent - robot.support.center_of_mass
    return bent - robot.tool(q) + moved[:, :3] + cross(moved[:, 3:6], arms)


def course_shifts(robot: StandingMechanism, motion: Trajectory, course: Course) -> np.ndarray:
    """Shifts of the gripper (T, 3), m, over a course."""
    q = motion.states(np.minimum(course.times, motion.end))[0]
    return shifts(robot, q, np.hstack([course.twists, course.bends]))


def settling(course: Course, end: float, away: np.ndarray) -> float:
    """s after the end until shifts (T, 3) stay within `SETTLED` of the last; infinite: that was not seen."""
    far = np.linalg.norm(away - away[-1], axis=1) > SETTLED
    late = np.flatnonzero(far & (course.times > end))
    if course.falls or (len(late) and late[-1] >= len(far) - len(far) // 50):
        return np.inf
    return float(course.times[late[-1]] - end) if len(late) else 0.0


@dataclass(frozen=True)
class RingingMode:
    """One of the lowest modes over a motion, all feet pressing.

    Attributes:
        least, most: natural frequency, Hz.
        last: the same at rest after the motion.
        damping: minimum and maximum ratio.
    """

    least: float
    most: float
    last: float
    damping: tuple[float, float]

    def __str__(self) -> str:
        """Frequencies and damping."""
        ends = sorted({f"{f:.3g}" for f in (self.least, self.most)}, key=float)
        ratios = [percent(ratio) for ratio in sorted({round(ratio, 2) + 0.0 for ratio in self.damping})]
        return f"{' to '.join(ends)} Hz (damping {' to '.join(ratios)})"


@dataclass(frozen=True)
class RiseTime:
    """A rise time of the accelerations that takes a mode's vibration away, and what it does, computed.

    Attributes:
        rise_time: s; the motion takes as much longer.
        frequency: of the mode, Hz.
        peak, after: m, vibration as in `DriveMotion`.
        settling: s.
        GN, GT: maximum, see `DriveMotion`; NaN on compliant feet.
    """

    rise_time: float
    frequency: float
    peak: float
    after: float
    settling: float
    GN: float
    GT: float


@dataclass(frozen=True, eq=False)
class DriveMotion:
    """The vibration of gripper and base due to elastic joints.

    Attributes:
        course: of base, feet and springs.
        vibration: (T,), m, of the gripper, at the times of the course.
        end: of the motion, s.
        peak: maximum vibration of the gripper during the motion, m.
        rms: over the motion, m.
        after: maximum vibration after the end, m.
        settling: s after the end until the gripper stays within `SETTLED` of its last place; infinite if that
            was not seen.
        modes: the lowest ones.
        contacts: how near contacts come to being lost while the drives ring; None on compliant feet, see
            `FeetMotion`.
        GN, GT: maximum while the drives ring, at most 1 where no contact is lost; NaN likewise; infinite
            where a gear bends by more than `BENT`.
        bend: maximum of a spring, rad or m, when, and which (counted from 1, of the elastic joints).
        rise: a rise time that reduces the vibration; None: none does, or the motion has no velocity profiles.
    """

    course: Course
    vibration: np.ndarray
    end: float
    peak: Margin
    rms: float
    after: float
    settling: float
    modes: tuple[RingingMode, ...]
    contacts: ContactMargins | None
    GN: Margin
    GT: Margin
    bend: Margin
    rise: RiseTime | None

    @property
    def too_far(self) -> bool:
        """A gear bends so far that the numbers say little more than that."""
        return self.bend.value > BENT

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        rise = None
        if self.rise is not None:
            rise = {
                "rise_time_s": self.rise.rise_time,
                "frequency_Hz": self.rise.frequency,
                "peak_m": self.rise.peak,
                "after_m": self.rise.after,
                "settling_s": self.rise.settling,
                "GN": self.rise.GN,
                "GT": self.rise.GT,
            }
        return {
            "vibration_peak_m": self.peak.value,
            "vibration_peak_time_s": self.peak.time,
            "vibration_rms_m": self.rms,
            "vibration_after_m": self.after,
            "settling_s": self.settling,
            "settled_within_m": SETTLED,
            "modes": [
                {"least_Hz": m.least, "most_Hz": m.most, "last_Hz": m.last, "damping": list(m.damping)}
                for m in self.modes
            ],
            "contacts": self.contacts.to_dict() if self.contacts else None,
            "GN": self.GN.to_dict(),
            "GT": self.GT.to_dict(),
            "bend": self.bend.to_dict(),
            "rise": rise,
        }

    def lines(self, rigid: ContactMargins) -> list[str]:
        """In words, beside the contacts with gears that do not give."""
        results = []
        if self.course.falls:
            results.append("a foot moves too far: not followed to the end")
        if self.too_far:
            far = f"a gear bends by {self.bend.value:.2g} (rad or m)"
            results.append(
                f"{far}, more than {BENT:g}: nothing here is small any more, the gears are too soft"
            )
        peak, rms = (quantity(1e3 * value, "mm", 3) for value in (self.peak.value, self.rms))
        results.append(f"gripper vibrates by up to {peak} {self.peak}, {rms} rms")
        band = f"within {1e3 * SETTLED:.1f} mm of rest"
        rest = f"{band} {self.settling:.2f} s after the end"
        if not np.isfinite(self.settling):
            rest = f"not {band} {self.course.times[-1] - self.end:.2g} s after the end"
        results.append(f"{quantity(1e3 * self.after, 'mm', 3)} after the end; {rest}")
        if self.contacts:
            results += self._contact_lines(self.contacts, rigid)
        if self.modes:
            results.append(f"modes {', '.join(map(str, self.modes))}")
        if self.rise is not None:
            results.append(self._rise_line(self.rise))
        return results

    @staticmethod
    def _contact_lines(margins: ContactMargins, rigid: ContactMargins) -> list[str]:
        """Forces where these are unique, and moments, beside those with stiff gears."""
        contact_lines = []
        if margins.unique and margins.force and rigid.force:
            least = f"minimum normal force {quantity(margins.force.value, 'N', 3)} {margins.force}"
            contact_lines.append(f"{least}, {quantity(rigid.force.value, 'N', 3)} with stiff gears")
        if margins.moment and rigid.moment:
            left = f"{quantity(margins.moment.value, 'N m', 3)} left about a tipping axis {margins.moment}"
            contact_lines.append(f"{left}, {quantity(rigid.moment.value, 'N m', 3)} with stiff gears")
        return contact_lines

    def _rise_line(self, rise: RiseTime) -> str:
        def change(before: float, now: float) -> str:
            return f"{1e3 * before:.2g} -> {1e3 * now:.2g} mm"

        line = f"--rise-time {rise.rise_time:.3g} cancels the mode of {rise.frequency:.3g} Hz: peak "
        line += f"{change(self.peak.value, rise.peak)}, after the end {change(self.after, rise.after)}"
        if not np.isnan(rise.GN):
            pairs = (("GN", self.GN.value, rise.GN), ("GT", self.GT.value, rise.GT))
            line += "".join(f", {name} {_reserve(one)} -> {_reserve(now)}" for name, one, now in pairs)
        return line + f", {1e3 * rise.rise_time:.0f} ms longer"


@lru_cache(maxsize=8)
def on_its_drives(robot: StandingMechanism, motion: Trajectory) -> DriveMotion | None:
    """A motion with elastic joints, without a rise time; None where they do not."""
    return None if robot.chain is None else _found(robot, motion)


def with_rise(robot: StandingMechanism, motion: Trajectory) -> DriveMotion | None:
    """The vibration, with the rise time (one period of a mode) that leaves minimum vibration after the end.

    It is computed for each of the lowest modes, as long as that is at rest after the end.
    """
    drive_motion = on_its_drives(robot, motion)
    if drive_motion is None or motion.profiles is None:
        return drive_motion
    return replace(drive_motion, rise=_best_rise(robot, motion, drive_motion))


def _found(robot: StandingMechanism, motion: Trajectory) -> DriveMotion:
    simulation, course = ridden(robot, motion)
    vibrations = course_shifts(robot, motion, course) - _sag(robot, motion, simulation, course)
    sizes = np.linalg.norm(vibrations, axis=1)
    moving = course.times <= motion.end
    k = int(np.argmax(np.where(moving, sizes, 0.0)))
    steps = np.diff(course.times[moving], prepend=0.0)
    rms = float(np.sqrt(steps @ sizes[moving] ** 2 / max(motion.end, 1e-9)))
    contacts, GN, GT = None, Margin(np.nan, np.nan), Margin(np.nan, np.nan)
    bends = np.abs(course.bends)
    row, which = np.unravel_index(np.argmax(bends), bends.shape)
    bend = Margin(float(bends[row, which]), float(course.times[row]), (int(which) + 1,))
    if course.wrenches.shape[1]:
        contacts, GN, GT = _on_base(robot, course)
        if bend.value > BENT:
            GN, GT = (replace(margin, value=np.inf) for margin in (GN, GT))
    return DriveMotion(
        course=course,
        vibration=sizes,
        end=motion.end,
        peak=Margin(float(sizes[k]), float(course.times[k])),
        rms=rms,
        after=float(np.max(sizes[~moving], initial=0.0)),
        settling=settling(course, motion.end, vibrations),
        modes=_modes(simulation),
        contacts=contacts,
        GN=GN,
        GT=GT,
        bend=bend,
        rise=None,
    )


def _sag(robot: StandingMechanism, motion: Trajectory, simulation: Simulation, course: Course) -> np.ndarray:
    """(T, 3), m: by how much feet and gears would shift the gripper at rest in the same postures."""
    ride = simulation.ride
    times = np.append(ride.begins[:-1], [motion.end, course.times[-1] + 1e-9])
    q = motion.states(np.minimum(times, motion.end))[0]
    result = shifts(robot, q, simulation.sags(q, np.minimum(times, motion.end)))
    return np.stack([np.interp(course.times, times, shift) for shift in result.T], axis=1)


def _modes(simulation: Simulation) -> tuple[RingingMode, ...]:
    """The lowest ones, ordered at every instant."""
    count = len(simulation.ride.begins)
    steps = np.unique(np.linspace(0, count - 1, min(count, _INSTANTS)).astype(int))
    seen = [simulation.modes(step)[:_SHOWN] for step in steps]
    shown = min(map(len, seen))
    values = np.array([mode_values[:shown] for mode_values in seen])
    values[np.abs(values) < _ROUNDED] = 0.0  # of what is not damped
    return tuple(
        RingingMode(f.min(), f.max(), f[-1], (zeta.min(), zeta.max()))
        for f, zeta in values.transpose(1, 2, 0).astype(object)
    )


def _on_base(robot: StandingMechanism, course: Course) -> tuple[ContactMargins, Margin, Margin]:
    """Contacts, GN and GT at their worst: at every few instants, then at all near the worst of these."""
    count = len(course.times)
    every = max(1, count // (5 * _INSTANTS))
    rows = np.arange(0, count, every)
    contacts, reserves = _evaluated(robot, course, rows)
    near = np.concatenate([rows[np.argsort(values)[-_NEAREST:]] for values in reserves.T])
    fresh = np.unique(np.clip(np.add.outer(near, np.arange(-every, every + 1)), 0, count - 1))
    more, others = _evaluated(robot, course, fresh)
    rows, reserves = np.concatenate([rows, fresh]), np.vstack([reserves, others])
    GN, GT = (
        Margin(float(values[k]), float(course.times[rows[k]]))
        for k, values in zip(np.argmax(reserves, axis=0), reserves.T, strict=True)
    )
    return contacts.worse(more), GN, GT


def _evaluated(
    robot: StandingMechanism, course: Course, rows: np.ndarray
) -> tuple[ContactMargins, np.ndarray]:
    """Contacts at their worst, and GN and GT (k, 2), infinite where they are not known, at these instants."""
    loaded = Loaded(robot, course.wrenches[rows])
    values = np.column_stack([_tip(loaded), loaded.largest_slip.GT])
    values[np.isnan(values)] = np.inf
    return ContactMargins.of(loaded, course.times[rows]), values


def _tip(loaded: Loaded) -> np.ndarray:
    """(N,) GN, where the accelerations of contacts are not known."""
    moments = TipMap(loaded.footing.tip_over)(loaded.wrenches)[0]
    return loaded.footing.tip_over.ratio(np.min(moments, axis=1)) if moments.shape[1] else loaded.tip.GN


def _reserve(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else "lost"


def _best_rise(robot: StandingMechanism, motion: Trajectory, drive_motion: DriveMotion) -> RiseTime | None:
    before = max(drive_motion.peak.value, drive_motion.after)
    if before < SETTLED and not _loses(drive_motion):
        return None
    good: list[tuple[bool, float, RiseTime]] = []
    for mode in drive_motion.modes:
        rise = 1 / (mode.last * np.sqrt(1 - mode.damping[0] ** 2))
        if rise <= max(motion.rise_times, default=0.0) or rise > motion.end:
            continue
        course = _found(robot, motion.with_rise_times(rise))
        peak, after = course.peak.value, course.after
        if max(peak, after) < _WORTH * before:
            one = RiseTime(
                float(rise), mode.last, peak, after, course.settling, course.GN.value, course.GT.value
            )
            good.append((_loses(course), after, one))
    return min(good, key=lambda one: one[:2])[2] if good else None


def _loses(drive_motion: DriveMotion) -> bool:
    """A contact, on rigid feet; no contact on others, of which is not known here."""
    return drive_motion.GN.value > 1 or drive_motion.GT.value > 1
