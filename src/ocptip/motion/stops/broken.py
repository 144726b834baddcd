"""Which limits are broken by stops in which every joint stops by itself; `violations` has the sentences."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from ocptip.standing.arm import Robot
from ocptip.standing.footing import Footing
from ocptip.standing.limit_kinds.limit import Worst
from ocptip.standing.limits import WITHIN_OF, Limits
from ocptip.standing.stops.by_brakes import Brakes
from ocptip.standing.stops.by_cancel import Cancel
from ocptip.standing.stops.joint_stops import JointStops
from ocptip.standing.within.in_motion import WorstInstant

CLOSE = 1e-9
BRAKES, CANCEL = "stop by brakes", "cancel"
"""What is begun, as sentences say it."""
CLEARANCE = "clearance"


def broken_contacts(
    footing: Footing, times: np.ndarray, stops: JointStops, rule: Brakes | Cancel, scenario: str
) -> list[Worst]:
    """Limits of the contacts of the base or an object; times (N,), s, when the stops begin."""
    worst = []
    for name, limit in (("GN", rule.GN), ("GT", rule.GT)):
        k = int(np.argmax(values := getattr(stops, name)))
        if not values[k] <= limit:
            how = "", float(values[k]) - limit, False, scenario, "", float(np.mean(~(values <= limit)))
            worst.append(Worst(footing.result(name), float(values[k]), float(times[k]), limit, *how))
    return worst


def broken_postures(
    robot: Robot, times: np.ndarray, stops: JointStops, limits: Limits, scenario: str
) -> list[Worst]:
    """The range of a joint, and the clearance."""
    worst, (over, joint) = [], stops.farthest
    if over > CLOSE:
        turns = robot.units[joint] == "rad"
        name, off = ("angle_margin_deg", np.degrees(over)) if turns else ("position_margin_m", over)
        share = float(np.mean(np.any(stops.outside > CLOSE, axis=1)))
        how = f" ({robot.names[joint]})", float(off), True, scenario, "", share
        worst.append(Worst(name, -float(off), np.nan, 0.0, *how))
    if stops.clearance < limits.clearance:
        share = float(np.mean(stops.clearances < limits.clearance))
        gap, asked = 1e3 * stops.clearance, 1e3 * limits.clearance
        how = f", {stops.collision_words(robot, times)}", asked - gap, True, scenario, "mm", share
        worst.append(Worst(CLEARANCE, round(gap, 1), np.nan, round(asked, 1), *how))
    return worst


def broken_drives(times: np.ndarray, stops: JointStops) -> list[Worst]:
    """The torque limit of a drive in cancels."""
    k = int(np.argmax(stops.drives))
    used, time, share = float(stops.drives[k]), float(times[k]), float(np.mean(stops.drives > 1 + CLOSE))
    how = 1.0, "", used - 1, False, CANCEL, "", share
    return [Worst("torque_ratio", used, time, *how)] if share else []


def broken_duration(times: np.ndarray, stops: JointStops, cancel: Cancel) -> list[Worst]:
    """How long a cancel may take until everything rests."""
    k = int(np.argmax(stops.rests))
    longest, time, most = float(stops.rests[k]) + cancel.reaction, float(times[k]), cancel.longest
    how = most, "", longest - most, False, CANCEL, "s", float(np.mean(stops.rests + cancel.reaction > most))
    return [Worst("duration", longest, time, *how)] if longest > most else []


def broken_within(instants: Mapping[str, WorstInstant], limits: Limits) -> Iterable[Worst]:
    """Limits of the contacts in cancels within an uncertainty, by the names of results."""
    for name, instant in instants.items():
        limit = getattr(limits, WITHIN_OF[name[:2]])
        if instant.most > limit:
            how = f" within the uncertainty ({instant.how})", instant.most - limit, False, CANCEL
            yield Worst(name, instant.most, instant.time, limit, *how)
