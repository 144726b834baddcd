"""The summary of a motion on 80 columns: verdict, energy, margins, robustness, what to do next."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ocptip.basics.text import quantity, some
from ocptip.cli.layout import named, rises, segment_table, stop_table, table

if TYPE_CHECKING:  # they take long to load
    from ocptip.api.check import Check
    from ocptip.api.plan import Plan
    from ocptip.motion.check import MotionCheck
    from ocptip.motion.margins import At, MotionMargin
    from ocptip.motion.stops import Stops
    from ocptip.motion.tolerated import Tolerated
    from ocptip.standing.mechanism import StandingMechanism
    from ocptip.trajectories.trajectory import Trajectory

WIDTH = 80
_TITLES = {
    "tipping_margin_Nm": "Tipping margin",
    "friction_used": "Friction used",
    "foot_force_N": "Min foot force",
    "zero_moment_point_to_edge_m": "ZMP to edge",
    "torque_used": "Joint torque",
    "clearance_m": "Clearance",
}
_UNITS = {"tipping_margin_Nm": "N m", "foot_force_N": "N"}
_LENGTHS = ("zero_moment_point_to_edge_m", "clearance_m")
_ALWAYS = "foot_force_N", "zero_moment_point_to_edge_m"  # have no limit of their own: positive is enough
_NAMED = 3  # names of files in the last lines


def margin_table(robot: StandingMechanism, checked: MotionCheck) -> list[str]:
    """Margins: nominal, in the worst case, their limits, the critical one marked."""
    from ocptip.motion.margins import critical, motion_margins

    margins = motion_margins(robot, checked)
    decisive = critical(margins)
    within = checked.within is not None
    rows = [["", "nominal", *(["worst case"] if within else []), "limit", ""]]
    for row in margins:
        values = [row.nominal, *([row.worst_case] if within else [])]
        mark = "BROKEN" if row.used > 1 + 1e-9 else "<- critical" if row is decisive else ""
        rows.append([_TITLES[row.name], *(_at(row, value) for value in values), _limit(row, within), mark])
    return table(rows, left=tuple(range(len(rows[0]))))


def _at(row: MotionMargin, at: At | None) -> str:
    """A value and when it occurs."""
    if at is None:
        return "-"
    text = _value(row.name, at.value)
    if (
        text == _value(row.name, row.limit) and at.value != row.limit
    ):  # rounded, it may contradict the verdict
        text = _value(row.name, at.value, 6)
    return text + (f" @{max(at.time, 0.0):.3f}s" if at.time is not None else "")


def _limit(row: MotionMargin, within: bool) -> str:
    """The limit, in the unit of the values; both where those of nominal and worst case differ."""
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


def robustness_lines(tolerated: Sequence[Tolerated]) -> list[str]:
    """The largest deviation of each quantity alone that loses no contact."""
    if not tolerated:
        return []
    lost = next(
        (one for one in tolerated if one.quantity == "tilt" and one.value == 0 and not one.at_most), None
    )
    if lost is not None:
        return [f"Robust to nothing: the nominal model loses a contact ({lost.how}, {lost.time:.3f} s)."]
    title = "Robust to (one at a time): "
    lines, room = [], WIDTH - len(title)
    for part in (one.short for one in tolerated):
        if lines and len(lines[-1]) + len(part) + 3 <= room:
            lines[-1] += f" | {part}"
        else:
            lines.append(part)
    return [title + lines[0], *(" " * len(title) + line for line in lines[1:])]


def notes(checked: MotionCheck) -> list[str]:
    """What limits the answer: assumptions about shared forces, and what was not checked."""
    contacts, collision, found = checked.contacts, checked.collision, []
    if not contacts.unique and contacts.force:
        found.append(
            "rigid feet can share the load in several ways; foot forces are of equally compliant feet"
        )
    if contacts.alike and contacts.alike.value < 0:
        found.append(f"an equally compliant foot lifts {contacts.alike}; the other feet hold the base")
    if contacts.weak:
        found.append(
            f"weakly stable at {contacts.weak} instants, first at {contacts.first_weak:.3f} s: the contact "
            "laws also allow sliding or tipping"
        )
    if not collision["checked"]:
        found.append("collisions are not checked: no collision geometry")
    elif unseen := [" and ".join(pair) for pair in collision["unseen"]]:
        found.append(f"collisions are not checked for {some(unseen, 3)}, whose solids always overlap")
    if checked.within and "foot_force_N" in checked.worst:
        found.append("compliant feet are checked in the nominal model only")
    if checked.within and "GN_gears" in checked.worst:
        found.append("vibration of elastic joints is checked in the nominal model only")
    return found


def wrapped(name: str, texts: Iterable[str]) -> list[str]:
    """Texts with a name before the first, broken at 80 columns."""
    lines = []
    for text in texts:
        first = f"{name:<8}" if not lines else " " * 8
        lines += textwrap.wrap(
            text, WIDTH, initial_indent=first, subsequent_indent=" " * 8, break_on_hyphens=False
        )
    return lines


def motion_text(
    found: Plan | Check,
    head: Sequence[str],
    *,
    scaled: Iterable[tuple[float, MotionCheck]] = (),
    more: Sequence[str] = (),
    details: Sequence[tuple[str, str]] = (),
    tables: Sequence[Sequence[str]] = (),
    written: Sequence[Path] = (),
) -> str:
    """What is known about a motion, or a cycle: the answer of `plan`, `retime`, `check` and `cell`.

    Args:
        found: its check, with robustness, stops and sensitivities.
        head: lines of the verdict and of the motion.
        scaled: checks of the motion with all times multiplied by a factor.
        more: notes.
        details: names and texts, of `-v`.
        tables: the same, each of some lines.
        written: files; an answer that is printed before they are written has none and is the beginning.
    """
    checked, robot = found.check, found.task.robot
    broken = (*checked.violations, *(text for stops in found.stops.values() for text in stops.violations))
    parts = [
        [*head, *wrapped("Broken", broken)],
        segment_table(found.task, found.checked) if found.task.is_cycle else [],
        margin_table(robot, checked),
        robustness_lines(found.robustness),
        wrapped("Helps", [f"{one}" for one in found.sensitivities]),
        *(_stops(name, stops) for name, stops in found.stops.items()),
        [line for factor, own in scaled for line in _scaled(factor, own)],
        [
            *wrapped("Note", [*notes(checked), *more]),
            *wrapped("Assumed", [*robot.notes, *(text for s in found.stops.values() for text in s.assumed)]),
        ],
        *tables,
        named(details) if details else [],
    ]
    text = "\n\n".join("\n".join(part) for part in parts if part)
    if not written:
        return text
    folder = written[0].parent
    names = [*dict.fromkeys(path.relative_to(folder).parts[0] for path in written)]
    others = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    next_line = f"Next    ocptip view {folder}, ocptip check {folder} --stops path"
    return "\n".join([text, "", f"Files   {folder}{os.sep}: {', '.join(names[:_NAMED])}{others}", next_line])


def _stops(segment: str, stops: Stops) -> list[str]:
    """The worst of each category of stops, and the table of safe speeds."""
    title = f"Stops of segment {segment}" if segment else "Stops"
    return [title, *(f"  {line}" for line in stops.found), *(f"  {line}" for line in stop_table(stops))]


def _scaled(factor: float, checked: MotionCheck) -> list[str]:
    """What becomes of a motion that is run faster or slower."""
    moving = f"{checked.energy:.1f} J in {checked.duration:.3f} s"
    if checked.verified:
        return [f"Times x {factor:g}: all limits kept, {moving}"]
    return [f"Times x {factor:g}: {checked.headline}, {moving}", *wrapped("", checked.violations)]
