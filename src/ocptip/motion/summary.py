"""The summary of a motion on 80 columns: duration and energy, margins with their limits, robustness."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from ocptip.basics.text import WIDTH, quantity, table, wrapped
from ocptip.motion.check import MotionCheck, broken_in_stops
from ocptip.motion.cycles.check import CycleCheck
from ocptip.motion.cycles.task import Task
from ocptip.motion.margins import FOOT_FORCE, MotionMargin, critical, motion_margins
from ocptip.motion.proof import Proof
from ocptip.motion.stops.check import Stops
from ocptip.motion.stops.rules import SCENARIOS
from ocptip.motion.task import MotionTask
from ocptip.motion.tolerated import Tolerated
from ocptip.motion.violations import RESULT_TITLES, broken_words
from ocptip.standing.at_rest.loss_search import SLIPS_ALIKE
from ocptip.standing.at_rest.sensitivity import Sensitivity
from ocptip.standing.contact_margins import Margin
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.trajectory import Trajectory

TITLES = {
    "tipping_margin_Nm": "Tipping margin",
    "friction_used": "Friction used",
    "foot_force_N": "Min foot force",
    "zero_moment_point_to_edge_m": "ZMP to edge",
    "torque_used": "Joint torque",
    "clearance_m": "Clearance",
    "tcp_speed_m_s": "TCP speed",
    "point_speed_m_s": "Speed of a point",
}
_UNITS = {"tipping_margin_Nm": "N m", "foot_force_N": "N", "tcp_speed_m_s": "m/s", "point_speed_m_s": "m/s"}
_IF_REACHED = {
    "speed_ratio": ("Joint speed", "%", 100.0),
    "acceleration_ratio": ("Acceleration", "%", 100.0),
    "jerk_ratio": ("Jerk", "%", 100.0),
    "angle_margin_deg": ("Angle margin", "deg", 1.0),
    "position_margin_m": ("Position margin", "mm", 1e3),
    "angle_margin_deg_cancel": ("Angle, cancelled", "deg", 1.0),
    "position_margin_m_cancel": ("Position, cancelled", "mm", 1e3),
    "duration_s": ("Duration", "s", 1.0),
    "duration_s_cancel": ("Duration, cancelled", "s", 1.0),
}
"""Titles and units of limits that have a row only where they are broken or, of drives, reached."""
_OF_SEGMENTS = {
    "tipping_margin_Nm": "tipping",
    "friction_used": "friction",
    "torque_used": "torque",
    "clearance_m": "clearance",
}
"""Margins of each segment of a cycle, and their titles there."""
STOPS = "stops"
"""Name of the checks of stops among those that were left out."""
_REACHED = {"speed_ratio": 0.995, "acceleration_ratio": 0.995, "jerk_ratio": 0.995}
_LENGTHS = ("zero_moment_point_to_edge_m", "clearance_m")
_ALWAYS = "foot_force_N", "zero_moment_point_to_edge_m"  # have no limit of their own: positive is enough


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class CheckedMotion:
    """The summary of a motion, or a cycle: of a plan, or of the check of one.

    Attributes:
        task: the robot and the limits; of a plan with the start and goal that were chosen.
        checked: the check by segments; a motion has one.
        robustness: deviations, one at a time, that lose no contact.
        stops: what becomes of the base when the motion is stopped, by the name of the segment, "" for a
            motion; empty: not asked for.
        sensitivities: what changes would do; empty: not asked for.
        left_out: names of the checks that were not made because the time was up.
    """

    task: Task
    checked: CycleCheck
    robustness: tuple[Tolerated, ...] = ()
    stops: Mapping[str, Stops] = field(default_factory=dict)
    sensitivities: tuple[Sensitivity, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def check(self) -> MotionCheck:
        """The check; of a cycle the worst of all segments."""
        return self.checked.whole

    @property
    def unproved(self) -> str:
        """What a proof lacks, where, by how much, and what helps; empty where it is proved or limits are
        broken.
        """
        return self.check.unproved

    @property
    def margins(self) -> tuple[MotionMargin, ...]:
        """The margins in N m, N, m and shares: nominal, in the worst case, and the limits."""
        return motion_margins(self.task.robot, self.check)

    @property
    def certificate(self) -> Proof | None:
        """The certificate; None where a limit is violated, or accelerations are estimates."""
        return self.check.certificate

    @property
    def energy(self) -> float:
        """Electric energy, J."""
        return self.check.energy

    @property
    def duration(self) -> float:
        """Duration, s."""
        return self.check.duration

    @property
    def verified(self) -> bool:
        """The motion keeps all limits, stops included where they are asked for."""
        kept = self.check.verified and all(stops.verified for stops in self.stops.values())
        return kept and STOPS not in self.left_out

    @property
    def robustness_lines(self) -> list[str]:
        """See `robustness_lines`."""
        return robustness_lines(self.robustness, [segment.task for segment in self.task.segments])

    @property
    def headline(self) -> str:
        """The verdict of the motion and of its stops, in capital letters, and what it is about."""
        text = self.check.headline
        if STOPS in self.left_out and self.check.verified:
            return f"{text}; stops NOT CHECKED, the time was up"
        if not self.stops or not self.check.verified:
            return text
        if self.verified:
            kinds = {scenario for stops in self.stops.values() for scenario in SCENARIOS[stops.kinds]}
            others = kinds != {"cancel"}
            sampled = f"CHECKED at samples{' in the nominal model' if self.check.within and others else ''}"
            slips = any(stops.slips_alike for stops in self.stops.values())
            but = ", BUT equally compliant feet may slip in stops" * slips
            if self.certificate is None or not self.certificate.cancels:
                return f"{text}; stops {sampled}{but}"
            base, sampled_too = (" of the base", "objects, ") if self.check.objects else ("", "")
            kept, rest = "", "clearance and torques"
            if self.certificate.cancel_torques:
                on_time = " (joints on time)" if self.check.within else ""
                kept, rest = f" and to keep torque limits{on_time}", "clearance"
            text += f"; cancels PROVED to lose no contact{base}{kept}, their {sampled_too}{rest} "
            text += "CHECKED at samples"
            return (f"{text}; other stops {sampled}" if others else text) + but
        if any(stops.unknown for stops in self.stops.values()) and not self.broken:
            return f"NOT KNOWN in stops by brakes (give brake torques); the motion itself is {text}"
        return broken_in_stops(text)

    @property
    def broken(self) -> tuple[str, ...]:
        """The limits that are broken, stops included, one sentence each."""
        of_stops = (broken for one in self.stops.values() for broken in one.violations)
        return tuple(broken_words(self.task.robot, (*self.check.violations, *of_stops)))


def brief(title: str, checked_motion: CheckedMotion) -> str:
    """Verdict, duration and energy, broken limits, margins, robustness."""
    checked = checked_motion.check
    missing = [f"Missing {checked_motion.unproved}"] if checked_motion.unproved else []
    rows = [
        f"{title}   {checked_motion.headline}",
        motion_line(checked),
        *missing,
        *(f"Broken  {text}" for text in checked_motion.broken),
        "",
    ]
    rows += [*margin_table(checked_motion.task.robot, checked), *proof_lines(checked)]
    return "\n".join([*rows, "", *checked_motion.robustness_lines])


_NEAR = 0.5  # share of a limit in use from which it is called critical


def margin_table(robot: StandingMechanism, checked: MotionCheck) -> list[str]:
    """Lines of `margin_rows`."""
    rows = margin_rows(robot, checked)
    return table(rows, left=tuple(range(len(rows[0]))))


def margin_rows(robot: StandingMechanism, checked: MotionCheck) -> list[list[str]]:
    """Titles, then margins: nominal, in the worst case, their limits, the critical one marked."""
    margins = motion_margins(robot, checked)
    decisive = critical(margins)
    within = checked.within is not None
    rows = [["", "nominal", *(["worst case"] if within else []), "limit", ""]]
    for row in margins:
        values = [row.nominal, *([row.worst_case] if within else [])]
        mark = (
            "BROKEN" if row.used > 1 + 1e-9 else "<- critical" if row is decisive and row.used > _NEAR else ""
        )
        rows.append([_title(row), *(at_text(row, value) for value in values), _limit(row, within), mark])
    # A kind of limit that no table knows has a row by the name of its result.
    others = {
        name: (name, "", 1.0) for name in checked.worst if name not in RESULT_TITLES and "[" not in name
    }
    for name, (title, unit, scale) in {**_IF_REACHED, **others}.items():
        worst = checked.worst.get(name)
        shown = name in others or (worst and (worst.broken or worst.value >= _REACHED.get(name, math.inf)))
        if worst is None or not shown:
            continue
        same = worst.broken and f"{worst.value:.3g}" == f"{worst.limit:.3g}"
        value = quantity(scale * worst.value, unit, 6 if same else 3).rstrip()
        value += f" @{worst.time:.3f}s" if math.isfinite(worst.time) else f" {worst.detail}".rstrip()
        limit = f"{'>=' if worst.least else '<='} {scale * worst.limit:.3g}"
        mark = "BROKEN" if worst.broken else "reached" * (name in _IF_REACHED)
        rows.append([title, value, *(["-"] if within else []), limit, mark])
    return rows


def _title(row: MotionMargin) -> str:
    """The quantity, and of which object it is."""
    if not row.object:
        return TITLES[row.name]
    return f"{'Min normal force' if row.name == FOOT_FORCE else TITLES[row.name]}, {row.object}"


def at_text(row: MotionMargin, instant: Margin | None) -> str:
    """A value and when it occurs."""
    text = value_text(row, instant)
    if instant is None or instant.time is None or math.isinf(instant.value):
        return text
    return f"{text} @{max(instant.time, 0.0):.3f}s"


def value_text(row: MotionMargin, instant: Margin | None) -> str:
    """A value with its unit."""
    if instant is None:
        return "-"
    if math.isinf(instant.value):  # no friction holds what tips; without solids no clearance is limited
        return "none holds" if row.name == "friction_used" else "unlimited"
    text = _value(row.name, instant.value)
    # Rounded to the limit, a value could contradict the verdict.
    if row.limit is not None and text == _value(row.name, row.limit) and instant.value != row.limit:
        text = _value(row.name, instant.value, 6)
    return text


def _limit(row: MotionMargin, within: bool) -> str:
    """The limit, in the unit of the values; both where those of nominal and worst case differ."""
    if row.limit is None:
        return "equal compliance" if row.name == FOOT_FORCE else "-"
    if row.name in _ALWAYS:
        return "> 0"
    scale = 1.0 if row.name in _UNITS else 1e3 if row.name in _LENGTHS else 100.0
    given = (row.limit, row.limit_worst_case if within else None)
    limits = dict.fromkeys(f"{scale * value:.3g}" for value in given if value is not None)
    return f"{'>=' if row.minimum else '<='} {' / '.join(limits)}"


def _value(name: str, value: float, digits: int = 3) -> str:
    if name in _UNITS:
        return quantity(value, _UNITS[name], digits)
    return quantity(1e3 * value, "mm", digits) if name in _LENGTHS else quantity(100 * value, "%", digits)


def segment_rows(task: Task, check: CycleCheck) -> list[list[str]]:
    """Titles, a row per segment (what it holds, energy, duration, rest, worst values), and one of all."""
    rows = [["segment", "holds", "energy", "time", "rest", *_OF_SEGMENTS.values(), ""]]
    for k, (name, segment) in enumerate(zip(check.names, check.segments, strict=True)):
        robot = task.segments[k].task.robot
        payload = robot.payload
        pause, energy = check.pauses[k], check.rest_energies[k]
        rest = f"{quantity(pause, 's')}, {quantity(energy, 'J')}" if pause else "-"
        rows.append(
            [
                f"{k + 1} {name}",
                quantity(payload.mass, "kg") if payload else "nothing",
                quantity(segment.energy, "J"),
                f"{segment.duration:.3f} s",
                rest,
                *_values(robot, segment),
                "" if segment.verified else "BROKEN",
            ]
        )
    whole = check.whole
    rest = f"{quantity(sum(check.pauses), 's')}, {quantity(sum(check.rest_energies), 'J')}"
    total = [quantity(whole.energy, "J"), f"{whole.duration:.3f} s", rest if any(check.pauses) else "-"]
    rows.append(["in all", "", *total, *_values(task.robot, whole), "" if whole.verified else "BROKEN"])
    return rows


def _values(robot: StandingMechanism, check: MotionCheck) -> list[str]:
    """Margins in the nominal model, without those of objects."""
    rows = {row.name: row for row in motion_margins(robot, check) if not row.object}
    return [value_text(rows[name], rows[name].nominal) if name in rows else "-" for name in _OF_SEGMENTS]


def proof_lines(checked: MotionCheck) -> list[str]:
    """The proved bounds, for the table has values at samples; nothing without a proof."""
    if not checked.proved_while_moving:
        return []
    return ["", *wrapped("Proof", [f"{checked.certificate}; the table has values at samples"])]


def motion_line(
    checked: MotionCheck, motions: Sequence[Trajectory] = (), reference: float | None = None
) -> str:
    """Duration, energy (beside that of a reference, J), and the rise of accelerations of one motion."""
    energy = quantity(checked.energy, "J")
    if reference:
        energy += f" ({100 * (checked.energy / reference - 1):+.0f} % vs reference)"
    parts = [f"{checked.duration:.3f} s", energy]
    parts += [rise for motion in motions if len(motions) == 1 and (rise := rises(motion))]
    return f"Motion  {'   '.join(parts)}"


def robustness_lines(tolerated: Sequence[Tolerated], tasks: Iterable[MotionTask] = ()) -> list[str]:
    """The largest deviation of each quantity alone that loses no contact, and what that leaves out; tasks may
    have declared springs.
    """
    if not tolerated:
        return []
    lost = next(
        (one for one in tolerated if one.quantity == "tilt" and one.value == 0 and not one.at_most), None
    )
    if lost is not None:
        loss = lost.how.rpartition(", ")[2]  # without the direction of a tilt that is zero
        text = f"Robust to nothing: the nominal model loses a contact ({loss}, {lost.time:.3f} s)."
        return textwrap.wrap(text, WIDTH, subsequent_indent=" " * 8)
    title = "Robust to (one at a time): "
    lines, width = [], WIDTH - len(title)
    for part in (one.short for one in tolerated):
        if lines and len(lines[-1]) + len(part) + 3 <= width:
            lines[-1] += f" | {part}"
        else:
            lines.append(part)
    capped = [one for one in tolerated if one.at_most and one.quantity not in ("friction", "foot_stiffness")]
    slips = ", or equally compliant feet slip" if any(SLIPS_ALIKE in one.how for one in tolerated) else ""
    springs = [task for task in tasks if task.robot.support.elastic is not None]
    counted = bool(springs) and not any(task.limits.foot_lift for task in springs)
    slips += ", or lifts on its declared springs" if counted else ""
    until = f"until a contact is lost{slips}{'; >= : not searched further' if capped else ''};"
    lines += textwrap.wrap(until, width)
    if any(one.quantity == "foot_stiffness" for one in tolerated):
        lines.append("foot stiffness: on equal feet of it none lifts;")
    torques = "other torques" if any(one.drives is not None for one in tolerated) else "torques"
    if springs:
        vibrate = counted and all(task.robot.swings for task in springs)
        torques += f", {'vibration' if counted else 'lifts'} on the declared springs"
        torques += " except for payload and speed" if vibrate else ""
    lines += textwrap.wrap(f"not included: clearance, joint limits, {torques}", width)
    return [title + lines[0], *(" " * len(title) + line for line in lines[1:])]


def rises(motion: Trajectory) -> str:
    """How accelerations rise: "accelerations rise within 20 ms"; "trapezoidal profiles"; empty for others."""
    if not motion.rise_times:
        return "trapezoidal profiles" if motion.profiles is not None else ""
    ends = sorted(
        {f"{1e3 * rise:.4g}" for rise in (min(motion.rise_times), max(motion.rise_times))}, key=float
    )
    return f"accelerations rise within {' to '.join(ends)} ms"
