"""What commands say about stops, and about what would help."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import numpy as np

from ocptip.cli.layout import table
from ocptip.motion.check import MotionCheck
from ocptip.motion.cycles.check import CycleCheck
from ocptip.motion.cycles.plan import CyclePlan
from ocptip.motion.cycles.task import CycleTask
from ocptip.motion.plan import MotionPlan
from ocptip.motion.stop_rules import Kinds
from ocptip.motion.stops import Stops, check_stops
from ocptip.motion.task import MotionTask
from ocptip.standing.sensitivity import Sensitivity, motion_sensitivities
from ocptip.trajectories.trajectory import Trajectory

SPACING = 0.01  # s, between instants of sensitivities


def with_safe_stops(task: MotionTask, asked: str | None) -> MotionTask:
    """The task whose plans keep the reserves in stops of the kinds asked for; "given": those of the task."""
    if not asked:
        return task
    kinds = None if asked == "given" else cast(Kinds, asked)
    return replace(task, limits=task.stops.safe(task.limits, task.robot, kinds))


def stops_of(
    task: MotionTask, motion: Trajectory, checked: MotionCheck, kinds: Kinds | None = None
) -> Stops | None:
    """Stops of the kinds asked for, or else of those that the task's limits ask for; else None."""
    limits = task.limits
    if kinds is None:
        if not limits.stoppable:
            return None
        kinds = "path" if limits.brakes is None else "brakes" if limits.stops is None else "both"
    if limits.stops is None and kinds != "brakes":
        limits = task.stops.asked(limits)
    return check_stops(task.robot, motion, limits, task.stops, checked, kinds)


def with_path_stops(task: MotionTask, kinds: Kinds | None) -> MotionTask:
    """The task whose checks look at stops along the path, too, if they are asked for."""
    return task if kinds in (None, "brakes") else replace(task, limits=task.stops.asked(task.limits))


def cycle_with_path_stops(task: CycleTask, kinds: Kinds | None) -> CycleTask:
    """The same of all segments."""
    return task.each(lambda own: with_path_stops(own, kinds))


def stops_of_cycle(
    task: CycleTask, motion: Trajectory, checked: CycleCheck, kinds: Kinds | None
) -> dict[str, Stops]:
    """Stops in each segment, by its name, in its own time; empty if they are not asked for."""
    rows = zip(task.segments, motion.segments, checked.segments, strict=True)
    found = {segment.name: stops_of(segment.task, own, check, kinds) for segment, own, check in rows}
    return {name: stops for name, stops in found.items() if stops}


def stops_to_dict(stops: Mapping[str, Stops]) -> dict[str, Any]:
    """An entry for JSON: of the motion, or one by segment; none if they were not asked for."""
    if not stops:
        return {}
    rows = [{"segment": name, **own.to_dict()} for name, own in stops.items()]
    return {"stops": stops[""].to_dict() if "" in stops else rows}


def price_of_stops(plan: MotionPlan | CyclePlan, without: MotionPlan | CyclePlan | None) -> dict[str, Any]:
    """What it costs that a plan may be stopped; without: the plan that need not, None: none was found."""
    if without is None:
        return {}
    costs = {"energy_J": without.energy, "duration_s": without.duration}
    more = round(plan.energy / without.energy - 1, 6) + 0.0
    return {"without_stops": costs, "energy_more": more}


def price_line(price: dict[str, Any]) -> list[str]:
    """The same in words."""
    if not price:
        return []
    costs, more = price["without_stops"], 100 * price["energy_more"]
    than = f"the plan without, {costs['energy_J']:.1f} J in {costs['duration_s']:.3f} s"
    return [f"price: {round(more, 1) + 0.0:+.1f} % energy against {than}"]


def sensitivities_of(task: MotionTask, motion: Trajectory) -> tuple[Sensitivity, ...]:
    """What changes of the robot and its base would do to the worst reserves of a motion."""
    return motion_sensitivities(task.robot, *motion.states(motion.both_sides(SPACING)))


def stop_table(stops: Stops) -> list[str]:
    """Largest safe share of the planned speed over time, and how long stops take."""
    columns = [
        ("along the path", stops.path_speeds, "{:.2f}"),
        ("stop takes", stops.path_times, "{:.3f} s"),
        ("by brakes", stops.brake_speeds, "{:.2f}"),
        ("stop takes", stops.brake_times, "{:.3f} s"),
    ]
    known = [(title, values, form) for title, values, form in columns if values is not None]
    rows = [["stopped at", *(title for title, _, _ in known)]]
    for i, time in enumerate(stops.times):
        cells = [
            form.format(values[i]) if np.isfinite(values[i]) else "never rests" for _, values, form in known
        ]
        rows.append([f"{time:.3f} s", *cells])
    return ["largest safe share of the planned speed, at most 1", *table(rows, left=())]
