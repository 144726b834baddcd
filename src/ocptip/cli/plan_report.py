"""What `ocptip plan` and `ocptip retime` answer: of a motion, and of a cycle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ocptip.api.plan import Plan
from ocptip.cli.command import Report
from ocptip.cli.layout import (
    check_rows,
    gear_rows,
    masses,
    price_line,
    rise_rows,
    segment_table,
    stop_table,
    summary,
    under,
    use_of_reserves,
)
from ocptip.motion.check import MotionCheck
from ocptip.motion.cycles.plan import CyclePlan
from ocptip.motion.cycles.task import freed_offset
from ocptip.motion.execution import Execution
from ocptip.motion.planner.attempt import LEFT_OUT
from ocptip.robots.inverse.pose_target import AXES
from ocptip.trajectories.trajectory import Trajectory


@dataclass
class PlanReport(Report):
    """A plan.

    Attributes:
        plan: with all that is known about it.
        directory: where files go.
        figures: whether figures are among them.
        effort: whether trajectory.json has torques.
        digest: of all that the plan depends on; None: it is not written.
    """

    early = True
    plan: Plan
    directory: Path = Path()
    figures: bool = True
    effort: bool = False
    digest: str | None = ""

    @property
    def good(self) -> bool:
        """True if what is written is verified, stops included where they are asked for."""
        return self.plan.verified

    def entries(self) -> dict[str, Any]:
        """What the command adds to plan.json."""
        known = {} if self.digest is None else {"digest": self.digest}
        return {**known, "warnings": self.warnings}

    def to_dict(self) -> dict[str, Any]:
        """The content of plan.json and the list `written`."""
        return {**self.plan.to_dict(), **self.entries(), "written": self.written}

    def write(self) -> Iterator[Path]:
        """Write plan.json, tables and figures."""
        how = {"figures": self.figures, "effort": self.effort, "extra": self.entries()}
        yield from self.plan.write(self.directory, **how)

    def to_text(self) -> str:
        """The summary in one line, then starts, time scales and files. ASCII only, but for names."""
        lines = self.found()
        plan, (run,) = self.plan, self.plan.executions
        if run.controller != "ramps":
            lines.append(("controller", self._controller(run)))
        if run.trajectory_text:
            lines.append(("points", run.trajectory_text))
        more = {"sensitivities": plan.sensitivities, "stops": plan.stops}
        lines += check_rows(plan.check, plan.robustness, **more)
        for stops in plan.stops.values():
            lines += under("stopped", [*price_line(plan.price), *stop_table(stops)])
        lines += [(f"time x {factor:g}", _scale_text(checked.whole)) for factor, checked in plan.time_scale]
        lines.append(("masses", masses(plan.task.robot)))
        lines += under("assumed", plan.task.robot.notes)
        return summary(self.headline(), lines, self.written)

    def found(self) -> list[tuple[str, str]]:
        """How the motion was found."""
        plan = self.plan.planned
        lines = [("starts", self._starts())]
        lines += [("", f"start {one.number} {one.status}") for one in plan.lost]
        if isinstance(plan.motion, Trajectory):
            lines += rise_rows(plan.motion, plan.check)
        if "choices" in plan.options:
            pairs = plan.options["choices"]
            lines.append(
                ("postures", f"{pairs['planned']} of {pairs['pairs']} pairs of start and goal planned")
            )
        if plan.interrupted:
            lines.append(("interrupted", "this is the best of the starts that had finished"))
        return lines

    def headline(self) -> str:
        """Status, energy, duration, use of the reserves, ratio to the reference."""
        task, checked = self.plan.task, self.plan.check
        verdict = checked.headline if self.good else "NOT VERIFIED"
        parts = [
            f"{task.name}: {verdict}. {checked.energy:.1f} J in {checked.duration:.3f} s",
            use_of_reserves(checked),
        ]
        if task.reference is not None:
            energy = task.robot.energy(task.reference)
            parts.append(f"{checked.energy / energy:.3f} of the reference's {energy:.1f} J")
        of_stops = (text for stops in self.plan.stops.values() for text in stops.violations)
        said = (*checked.violations, *of_stops)
        broken = f" Broken: {'; '.join(said)}." if said else ""
        return ", ".join(parts) + "." + broken

    def _controller(self, execution: Execution) -> str:
        step = 1000 * execution.step
        how = {
            "linear": f"straight lines between points every {step:g} ms",
            "cubic": "cubics between points",
            "quintic": "quintics between points",
        }[execution.controller]
        slower = f", slowed down by {100 * (execution.slower - 1):.2f} %" if execution.slower > 1 else ""
        return f"{execution.controller}: {how}{slower}; all numbers are of that motion"

    def _starts(self) -> str:
        starts = self.plan.planned.starts
        verified = sum(start.verified for start in starts)
        iterations = sum(start.iterations for start in starts)
        out = sum(start.status == LEFT_OUT for start in starts)
        left = f" ({out} that promised less left out)" if out else ""
        hops = sum(start.hops for start in starts)
        changed = f", the best {hops} times changed at random" if hops else ""
        return (
            f"{verified} of {len(starts) - out} verified{left}{changed}, {iterations} iterations, "
            f"{self.plan.planned.seconds:.1f} s, seed {self.plan.planned.seed}"
        )


class CycleReport(PlanReport):
    """A plan of a cycle."""

    def to_text(self) -> str:
        """The summary in one line, a table of the segments, then what else is known."""
        whole, plan = self.plan.check, self.plan
        lines = self.found()
        if plan.executions[0].controller != "ramps":
            lines.append(("controller", self._slowed()))
        pairs = zip(plan.task.segments, plan.executions, strict=False)
        texts = [f"{e.trajectory_text} (segment {s.name})" for s, e in pairs if e.trajectory_text]
        lines += under("points", texts)
        if plan.planned.interrupted:
            lines.append(("interrupted", self._interrupted()))
        lines += [*check_rows(whole, plan.robustness, stops=plan.stops), *gear_rows(plan.checked)]
        tables = [["", f"segment {name}", *stop_table(own)] for name, own in plan.stops.items()]
        lines += under("stopped", [*price_line(plan.price), *(line for own in tables for line in own)])
        lines += [(f"time x {f:g}", _cycle_scale_text(checked.whole)) for f, checked in plan.time_scale]
        lines += under("assumed", plan.task.robot.notes)
        head = "\n".join([self.headline(), "", *segment_table(plan.task, plan.checked), ""])
        return summary(head, lines, self.written)

    def found(self) -> list[tuple[str, str]]:
        """How the motions were found."""
        plan = self.plan.planned
        lines = [("starts", self._starts())]
        lines += [("", f"start {one.number} {one.status}") for part in plan.parts for one in part.lost]
        if "choices" in plan.options:
            chosen = plan.options["choices"]
            counts = ", ".join(map(str, chosen["postures"]))
            lines.append(
                ("postures", f"{counts} that stand at start and goals; {chosen['ways']} ways planned")
            )
        return lines + under("freed", list(_freed_texts(plan)))

    def headline(self) -> str:
        """Status, energy, duration, use of the reserves."""
        whole, plan = self.plan.check, self.plan.planned
        verdict = whole.headline
        if not plan.complete:
            parts = f"{len(plan.parts)} of {len(plan.task.segments)} segments"
            verdict = f"INCOMPLETE ({parts}){whole.scope}"
        broken = "" if whole.verified else f" Broken: {'; '.join(whole.violations)}."
        return (
            f"{plan.task.name}: {verdict}. {whole.energy:.1f} J in {whole.duration:.3f} s, "
            f"{use_of_reserves(whole)}.{broken}"
        )

    def _starts(self) -> str:
        plan = self.plan.planned
        found = [start for part in plan.parts for start in part.starts]
        verified, iterations = sum(s.verified for s in found), sum(s.iterations for s in found)
        return (
            f"{verified} of {len(found)} verified, {iterations} iterations, {plan.seconds:.1f} s, "
            f"seed {plan.seed}"
        )

    def _interrupted(self) -> str:
        plan = self.plan.planned
        if plan.complete:
            return "this is the best of the starts that had finished"
        left = ", ".join(s.name for s in plan.task.segments[len(plan.parts) :])
        return f"without a plan: {left}; no trajectory.json"

    def _slowed(self) -> str:
        executions = self.plan.executions
        slower = max(run.slower for run in executions)
        how = f", ramps slowed down by up to {100 * (slower - 1):.2f} %" if slower > 1 else ""
        return f"{executions[0].controller}{how}; all numbers are of that motion"


def _freed_texts(plan: CyclePlan) -> Iterator[str]:
    """Where poses that are free within a range are."""
    if not plan.parts:
        return
    motions = [part.motion for part in plan.parts]
    postures = [motions[0].start, *(own.goal for own in motions)]
    for (name, _, target), q in zip(plan.task.ends, postures, strict=False):
        for axis, own in freed_offset(target, plan.task.robot, q).items():
            assert target is not None
            low, high = 1e3 * target.free[AXES.index(axis)]
            yield f"{axis} {1e3 * own:+.4g} mm ({low:g} to {high:g}), {name}"


def _scale_text(checked: MotionCheck) -> str:
    if checked.verified:
        values = ", ".join(f"{name} {checked.worst[name].value:.3f}" for name in ("GN", "GT"))
        return f"stands, all limits kept: {values}, {checked.energy:.1f} J in {checked.duration:.3f} s"
    verdict = "stands, but breaks limits" if checked.stands else "LOSES A CONTACT"
    return f"{verdict}: {'; '.join(checked.violations)}"


def _cycle_scale_text(whole: MotionCheck) -> str:
    if whole.verified:
        return f"stands, all limits kept: {whole.energy:.1f} J in {whole.duration:.3f} s"
    return _scale_text(whole)
