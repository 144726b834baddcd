"""The reports of `ocptip plan` and `ocptip retime`: on a motion, and on a cycle."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from ocptip.api.results.plan import Plan
from ocptip.cli.layout import check_rows, gear_rows, masses, price_line, under
from ocptip.cli.motion_summary import motion_text, required_lines, rise_rows
from ocptip.cli.options import GatedReport
from ocptip.motion.cycles.task import CycleTask, freed_offset
from ocptip.motion.motion_plan import TIME_IS_UP, MotionPlan
from ocptip.motion.planner.attempt import LEFT_OUT
from ocptip.motion.summary import motion_line
from ocptip.retiming.among import SLOW
from ocptip.robots.inverse.pose_target import AXES


@dataclass
class PlanReport(GatedReport):
    """A plan.

    Attributes:
        plan: with all that is known about it.
        directory: where files go.
        figures: whether figures are among them.
        effort: whether trajectory.json has torques.
        digest: of all that the plan depends on; None: it is not written.
        bag: folder that the motion was written to; None: not asked for.
    """

    early = True
    plan: Plan
    directory: Path = Path()
    figures: bool = True
    effort: bool = False
    digest: str | None = ""
    bag: str | None = None

    @property
    def kept(self) -> bool:
        """True if what is written is verified, stops included where they are asked for."""
        return self.plan.verified

    @property
    def broken(self) -> Sequence[str]:
        """The broken limits, stops included."""
        return self.plan.broken

    @property
    def headline(self) -> str:
        """Name of the task and verdict."""
        return f"{self.plan.task.name}   {self.verdict}"

    def entries(self) -> dict[str, Any]:
        """The entries that the command adds to plan.json."""
        known = {} if self.digest is None else {"digest": self.digest}
        return {**known, "warnings": self.warnings}

    def to_dict(self) -> dict[str, Any]:
        """The content of plan.json and the list `written`."""
        return {**self.plan.to_dict(), **self.entries(), **self.gate_to_dict(), "written": self.written}

    def write(self) -> Iterator[Path]:
        """Write plan.json, tables and figures."""
        how = {"figures": self.figures, "effort": self.effort, "extra": self.entries()}
        yield from self.plan.write(self.directory, **how)
        yield from super().write()

    def to_text(self) -> str:
        """Verdict, margins, robustness; with -v details of the search. ASCII only, but for names."""
        plan, motion = self.plan, self.plan.planned
        more = [self._interrupted()] if motion.interrupted and SLOW not in motion.options else []
        slow = zip(plan.task.segments, motion.parts, strict=False)
        more += [f"{_slowly(part)}{_of(segment.name)}" for segment, part in slow if SLOW in part.options]
        more += (
            [f"not complete, the time was up or it was interrupted: {', '.join(plan.left_out)}"]
            if plan.left_out
            else []
        )
        parts = zip(plan.task.segments, motion.parts, strict=False)
        more += [f"{_path(item)}{_of(s.name)}" for s, item in parts if "path" in item.options]
        parts = zip(plan.task.segments, motion.parts, strict=False)
        more += [f"{_slower(item)}{_of(s.name)}" for s, item in parts if item.slower > 1]
        more += [] if all(run.controller == "ramps" for run in plan.executions) else [self._controller()]
        pairs = zip(plan.task.segments, plan.executions, strict=False)
        more += [f"{run.trajectory_text}{_of(s.name)}" for s, run in pairs if run.trajectory_text]
        more += price_line(plan.price)
        more += [f"trajectory and margins over time are in the bag {self.bag}"] if self.bag else []
        details = []
        if self.verbose:
            details += [*self.details(), *check_rows(plan.task.robot, plan.check, plan.robustness)]
            details += (
                gear_rows(plan.checked) if plan.task.is_cycle else [("masses", masses(plan.task.robot))]
            )
        scaled = [(factor, item.whole) for factor, item in plan.time_scale]
        known = {"scaled": scaled, "more": more, "details": details, "cancels": plan.cancels}
        required = required_lines(self.outcomes)
        return motion_text(plan, self.head(), **known, required=required, written=self.written)

    def head(self) -> list[str]:
        """Name and verdict; duration, energy and rise of accelerations."""
        task, checked = self.plan.task, self.plan.check
        reference = task.segments[0].task.reference
        motions = [part.motion for part in self.plan.planned.parts]
        energy = None if reference is None or task.is_cycle else task.robot.energy(reference)
        return [self.headline, motion_line(checked, motions, energy)]

    @property
    def verdict(self) -> str:
        """In capital letters, and what it is about."""
        plan, whole = self.plan.planned, self.plan.check
        if not plan.complete:
            return f"INCOMPLETE ({len(plan.parts)} of {len(plan.task.segments)} segments){whole.scope}"
        if whole.verified and not all(run.verified for run in self.plan.executions):
            return "LIMITS BROKEN in trajectory.json"
        return self.plan.headline

    def details(self) -> list[tuple[str, str]]:
        """Details of the search for the motions."""
        plan = self.plan.planned
        lines = [("starts", self._starts())] if plan.starts else []
        lines += [("", f"start {one.number} {one.status}") for one in plan.lost]
        if not plan.task.is_cycle:
            lines += rise_rows(plan.parts[0].motion, plan.parts[0].check)
        if "choices" in plan.options:
            lines.append(("postures", _postures(plan.options["choices"])))
        return lines + under("freed", list(_freed_texts(plan))) if plan.task.is_cycle else lines

    def _interrupted(self) -> str:
        plan = self.plan.planned
        why = "the time was up" if TIME_IS_UP in plan.options else "interrupted"
        if plan.complete:
            return f"{why}: this is the best of the starts that had finished"
        left = ", ".join(s.name for s in plan.task.segments[len(plan.parts) :])
        missing = plan.options.get(TIME_IS_UP, "")
        return "; ".join(filter(None, [f"{why}, without a plan: {left}", missing, "no trajectory.json"]))

    def _controller(self) -> str:
        runs = [run for run in self.plan.executions if run.controller != "ramps"]
        slower = max(run.slower for run in runs)
        how = {
            "linear": f"straight lines between points every {1000 * runs[0].step:g} ms",
            "cubic": "cubics between points",
            "quintic": "quintics between points",
        }[runs[0].controller]
        slowed = f", slowed down by {100 * (slower - 1):.2f} %" if slower > 1 else ""
        return f"executed by {how}{slowed}; all numbers are of that motion"

    def _starts(self) -> str:
        plan = self.plan.planned
        starts = plan.starts
        verified, iterations = sum(s.verified for s in starts), sum(s.iterations for s in starts)
        out = sum(start.status == LEFT_OUT for start in starts)
        left = f" ({out} less promising ones left out)" if out else ""
        hops = sum(start.hops for start in starts)
        changed = f", {hops} hops from the best" if hops else ""
        return (
            f"{verified} of {len(starts) - out} verified{left}{changed}, {iterations} iterations, "
            f"{plan.seconds:.1f} s, seed {plan.seed}"
        )


def _path(plan: MotionPlan) -> str:
    """How a motion along a path was made, and why that of the smoothed path is the plan or not."""
    path = plan.options["path"]
    text = f"method: path ({path['made_of']}), then its timing"
    if "smoothed" not in path:
        return text
    if (more := path.get("smoothed_costs_more")) is None:
        return f"{text}; no motion along the smoothed path keeps all limits in the given time"
    if path["smoothed"]:
        return f"{text}; of the smoothed path, which costs {-100 * more:.1f} % less"
    why = f"costs {100 * more:.1f} % more" if more >= 0 else "is not proved"
    return f"{text}; not of the smoothed path, which {why}"


def _slower(plan: MotionPlan) -> str:
    return f"{100 * (plan.slower - 1):.2g} % slower than planned, so that its proof is complete"


def _slowly(plan: MotionPlan) -> str:
    """Why a slow motion of all joints in step is the plan."""
    why = "was interrupted before it had a" if plan.stopped else "gave no"
    return f"a slow motion of all joints in step: the search {why} better one that keeps all limits"


def _of(segment: str) -> str:
    return f" (segment {segment})" if segment else ""


def _postures(chosen: dict[str, Any]) -> str:
    """Between which postures plans were made; of a cycle those of its ends."""
    if "pairs" in chosen:
        return f"{chosen['planned']} of {chosen['pairs']} pairs of start and goal planned"
    counts = ", ".join(map(str, chosen["postures"]))
    return f"{counts} stable ones at start and goals; {chosen['ways']} combinations planned"


def _freed_texts(plan: MotionPlan) -> Iterator[str]:
    """Where poses that are free within a range are."""
    if not plan.parts:
        return
    motions = [part.motion for part in plan.parts]
    postures = [motions[0].start, *(motion.goal for motion in motions)]
    for (name, _, target), q in zip(cast(CycleTask, plan.task).ends, postures, strict=False):
        for axis, motion in freed_offset(target, plan.task.robot, q).items():
            assert target is not None
            low, high = 1e3 * target.free[AXES.index(axis)]
            yield f"{axis} {1e3 * motion:+.4g} mm ({low:g} to {high:g}), {name}"
