"""The summary of a motion or a cycle, on 80 columns: the answer of `plan`, `retime`, `check`, `cell`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from ocptip.basics.text import percent, some, table, wrapped
from ocptip.cli.layout import (
    brief_notes,
    changes_table,
    files_lines,
    headlines,
    stop_table,
    under,
)
from ocptip.motion.check import MotionCheck
from ocptip.motion.stops.cancels import SafeDecelerations, in_all
from ocptip.motion.stops.check import Stops
from ocptip.motion.summary import (
    CheckedMotion,
    margin_table,
    proof_lines,
    rises,
    segment_rows,
)
from ocptip.motion.violations import broken_words
from ocptip.standing.contact_margins import of_friction
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.tolerance import overshoot_of_rise, overshoot_of_rises
from ocptip.trajectories.trajectory import Trajectory


def notes(checked: MotionCheck) -> list[str]:
    """Remarks that limit the answer: assumptions about shared forces, and what was not checked."""
    contacts, collision, results = checked.contacts, checked.collision, []
    if not contacts.unique and contacts.force:
        text = "rigid feet can share the load differently; foot forces are of equally compliant feet"
        equal, worst = contacts.equal_friction, checked.within and checked.within.alike_friction
        if equal and equal.value < 1:
            case = f", {of_friction(worst.value)} in the worst case" if worst else ""
            text += f", which use {of_friction(equal.value)}{case}"
        results.append(text)
    if contacts.alike and contacts.alike.value < 0:
        results.append(
            f"an equally compliant foot lifts {contacts.alike}; the other feet hold the base. "
            "Declare `stiffness` of the contacts to plan with their springs"
        )
    elif checked.within and checked.within.alike and checked.within.alike.value < 0:
        results.append(
            f"within the uncertainty an equally compliant foot may lift {checked.within.alike}. What helps: "
            "accelerations that rise more slowly (plan --rise-time, retime --jerk), or `stiffness` of the "
            "contacts where known"
        )
    for name, held in checked.objects.items():
        if held.alike and held.alike.value < 0:
            results.append(
                f"an equally compliant contact of {name} lifts {held.alike}; its tipping margin says whether "
                "the others hold it"
            )
    if contacts.equal_friction and contacts.equal_friction.value >= 1:
        results.append(
            "friction used is for the best sharing of the load; equally compliant feet would need "
            f"{of_friction(contacts.equal_friction.value)} {contacts.equal_friction}. Declare `stiffness` of "
            "the contacts to check their springs"
        )
    every = {"the base": contacts, **checked.objects}
    sliding = [name for name, held in every.items() if held.friction and held.friction.value > 1]
    if sliding:
        results.append(
            f"{some(sliding, 3)} slides: its tipping margin and forces are those of the sliding state, whose "
            "acceleration changes them"
        )
    if contacts.weak:
        text = (
            f"how rigid contacts share the load is open at {contacts.weak} sampled instants, first at "
            f"{contacts.first_weak:.3f} s, as is usual with casters"
        )
        if contacts.equal_friction and contacts.equal_friction.value < 1:
            text += ": equally compliant ones hold the base, `stiffness` of the contacts declares others"
        else:
            text += ": forces hold the base, with another sharing it might move. Declare `stiffness` of the "
            text += "contacts to decide"
        results.append(text)
    if not collision["checked"]:
        results.append("collisions are not checked: no collision geometry")
    elif unseen := [" and ".join(pair) for pair in collision["unseen"]]:
        results.append(f"collisions are not checked for {some(unseen, 3)}, whose solids mostly overlap")
    if checked.within and checked.within.exact_springs:
        results.append("counterbalance springs count as exact: `springs` in [tolerance] is their share")
    if checked.within and "foot_force_N" in checked.worst:
        results.append("compliant feet are checked in the nominal model only")
    if checked.within and "GN_gears" in checked.worst:
        results.append("vibration of elastic joints is checked in the nominal model only")
    return results


def required_lines(outcomes: Iterable[object]) -> list[str]:
    """The requirements and whether they are met, below an empty line; nothing without any."""
    lines = wrapped("Require", map(str, outcomes))
    return ["", *lines] if lines else []


def motion_text(
    checked_motion: CheckedMotion,
    head: Sequence[str],
    *,
    scaled: Iterable[tuple[float, MotionCheck]] = (),
    more: Sequence[str] = (),
    assumed: Sequence[str] = (),
    details: Sequence[tuple[str, str]] = (),
    tables: Sequence[Sequence[str]] = (),
    cancels: Mapping[str, SafeDecelerations] | None = None,
    required: Sequence[str] = (),
    written: Sequence[Path] = (),
) -> str:
    """The summary of a motion, or a cycle: the answer of `plan`, `retime`, `check` and `cell`.

    Args:
        checked_motion: its check, with robustness, stops and sensitivities.
        head: lines of the verdict and of the motion.
        scaled: checks of the motion with all times multiplied by a factor.
        more: notes.
        assumed: what the file does not say of the motion.
        details: names and texts, of `-v`.
        tables: the same, each of some lines.
        cancels: safe decelerations of a cancelled controller by the name of the segment.
        required: lines of requirements.
        written: files; an answer that is printed before they are written has none and is the beginning.
    """
    checked, robot = checked_motion.check, checked_motion.task.robot
    segments = [
        *(cancels or {}).values(),
        *(s.decelerations for s in checked_motion.stops.values() if s.decelerations),
    ]
    moves = checked.worst["speed_ratio"].value > 0  # else a posture is held
    profile = robot.acts.drive_profile if moves else None
    widest = max((len(name) for name, _ in details), default=0) + 2
    parts = [
        [
            *headlines(head[0]),
            *head[1:],
            *wrapped("Missing", filter(None, [checked_motion.unproved])),
            *wrapped("Broken", checked_motion.broken),
        ],
        table(segment_rows(checked_motion.task, checked_motion.checked), left=(0, 1))
        if checked_motion.task.is_cycle
        else [],
        [*margin_table(robot, checked), *proof_lines(checked)],
        checked_motion.robustness_lines,
        changes_table(checked_motion.sensitivities, "What if"),
        *(_stops(name, stops) for name, stops in checked_motion.stops.items()),
        [line for name, item in (cancels or {}).items() for line in cancel_lines(item, name)],
        wrapped("Cancel", [in_all(segments)]) if len(segments) > 1 else [],
        [line for factor, item in scaled for line in _scaled(robot, factor, item)],
        [
            *wrapped("Note", [*notes(checked), *more]),
            *wrapped(
                "Assumed",
                [
                    *brief_notes(robot.notes, bool(details)),
                    *(profile.while_moving(checked.duration) if profile else ()),
                    *assumed,
                    *(text for s in checked_motion.stops.values() for text in s.assumed),
                ],
            ),
        ],
        *tables,
        [line for name, text in details for line in wrapped(name, [text], widest)],
    ]
    text = "\n\n".join("\n".join(part) for part in parts if part)
    following = "ocptip check {0}" if robot.acts.end else _following()  # stops: of a base that stands
    if len(checked_motion.checked.segments) < len(
        checked_motion.task.segments
    ):  # an incomplete plan cannot be checked
        following = "plan again with more --seconds"
    return "\n".join([text, *required, *files_lines(written, following)])


def _following() -> str:
    """Commands for the folder "{0}" of a plan; of a missing package the command that installs it."""
    if find_spec("viser"):
        return "ocptip view {0}, ocptip check {0} --stops path"
    return "ocptip check {0} --stops path; pip install 'ocptip[view]' for ocptip view {0}"


def _stops(segment: str, stops: Stops) -> list[str]:
    """The worst of each category of stops, and the table of safe speeds."""
    title = f"Stops of segment {segment}" if segment else "Stops"
    lines = [title, *wrapped("", stops.summary, 2), *(f"  {line}" for line in stop_table(stops))]
    return [*lines, *(cancel_lines(stops.decelerations, segment, yaml=True) if stops.decelerations else [])]


def cancel_lines(
    safe_decelerations: SafeDecelerations, segment: str = "", *, yaml: bool = False
) -> list[str]:
    """Safe decelerations of a cancelled controller, and the line for ros2_control, to be copied."""
    of = f"segment {segment}: " if segment else ""
    units = (
        ""
        if safe_decelerations.together
        else f"  # {' and '.join(f'{unit}/s^2' for unit in dict.fromkeys(safe_decelerations.robot.units))}"
    )
    return [
        *wrapped("Cancel", [f"{of}{safe_decelerations.verdict if segment else safe_decelerations.text}"]),
        *([f"{safe_decelerations.yaml}{units}"] if yaml and safe_decelerations.yaml else []),
    ]


def _scaled(robot: StandingMechanism, factor: float, checked: MotionCheck) -> list[str]:
    """Lines about the motion with its times scaled."""
    moving = f"{checked.energy:.1f} J in {checked.duration:.3f} s"
    if checked.verified:
        return [f"Times x {factor:g}: all limits kept, {moving}"]
    return [
        f"Times x {factor:g}: {checked.headline}, {moving}",
        *wrapped("", broken_words(robot, checked.violations)),
    ]


def rise_rows(motion: Trajectory, checked: MotionCheck) -> list[tuple[str, str]]:
    """How accelerations rise, and what is neglected by counting no acceleration step; nothing for trapezoidal
    profiles.
    """
    if not motion.rise_times:
        return []
    texts, within = [rises(motion)], checked.within and checked.within.tolerance
    shortest = min(rise for rise in motion.rise_times if rise)
    if within and within.damping is not None:
        periods = [checked.feet.frequency * shortest] if checked.feet else []
        half, *feet = map(percent, overshoot_of_rise(within.damping, np.array([0.5, *periods])))
        text = f"counted as smooth: feet and structure of {1 / shortest:.3g} Hz and more overshoot by up to "
        text += f"{percent(overshoot_of_rises(within.damping))} of a change, of {0.5 / shortest:.3g} Hz "
        text += f"by {half}, {f'these feet by {feet[0]}, ' if feet else ''}after an acceleration step by "
        texts.append(text + percent(within.overshoot))
    return under("S-curves", texts)
