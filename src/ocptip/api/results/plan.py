"""The result of `ocptip.plan`: a motion as it is run, with all that is known about it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ocptip.api.inputs.motion_requirements import motion_outcomes
from ocptip.api.inputs.requirements import Outcome
from ocptip.api.methods import (
    FOR_PROOFS,
    Runner,
    better_smoothed,
    executed,
    proved_runs,
)
from ocptip.basics.outputs import remove_figures
from ocptip.basics.text import silent
from ocptip.basics.write import plain, write_files
from ocptip.certificate.checks import certified
from ocptip.motion.cycles.check import CycleCheck, check_cycle, cycle_check, with_rises
from ocptip.motion.files.execution import Execution
from ocptip.motion.files.plan_files import (
    planned_to_dict,
    run_by,
    samples_joined,
    save_bag,
    task_samples,
    write_plan,
)
from ocptip.motion.motion_plan import MotionPlan
from ocptip.motion.plan import proved_part
from ocptip.motion.stops.cancels import SafeDecelerations
from ocptip.motion.stops.check import (
    Stops,
    cancels_by_segment,
    cancels_to_dict,
    stops_by_segment,
    stops_to_dict,
)
from ocptip.motion.summary import STOPS, CheckedMotion, brief
from ocptip.motion.task import MotionTask
from ocptip.motion.tolerated import robustness
from ocptip.numerics.time_limit import TimeBudget
from ocptip.numerics.workers import calls_begun
from ocptip.pictures.frame import new_figure
from ocptip.pictures.plan import plan_pngs
from ocptip.pictures.plan_curves import seen_plan
from ocptip.pictures.stops import draw_stops
from ocptip.standing.at_rest.sensitivity import Reserves, Sensitivity, motion_sensitivities
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.samples import MotionSamples
from ocptip.standing.within.in_motion import worst_contacts
from ocptip.standing.within.worst_case import WorstCase
from ocptip.trajectories.trajectory import Trajectory

SPACING = 0.01
"""s, between the instants of sensitivities."""


@dataclass(frozen=True, eq=False, repr=False)
class Plan(CheckedMotion):
    """A planned motion, or cycle, as it is run, and all that is known about it.

    Attributes:
        planned: result of the search: commands, starts, seed. Of a cycle `parts` has one per segment.
        executions: what runs the motion of each segment; a motion has one segment.
        time_scale: factors with the checks of the plan run that much slower.
        price: what stops cost, plain data; empty: they cost nothing, or were not asked for.
        cancels: safe decelerations of a cancelled controller, by the name of the segment; empty: `stops` has
            them, or the robot is no arm.
        pngs: contents of the figures of `save` that were drawn meanwhile, by the names of the files.
    """

    command: ClassVar[str] = "plan"
    planned: MotionPlan
    executions: tuple[Execution, ...]
    time_scale: tuple[tuple[float, CycleCheck], ...] = ()
    price: Mapping[str, Any] = field(default_factory=dict)
    cancels: Mapping[str, SafeDecelerations] = field(default_factory=dict)
    pngs: Mapping[str, bytes] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        planned: MotionPlan,
        *,
        controller: Runner = "ramps",
        rate: float | None = None,
        rise_time: float | None = None,
        time_scale: Sequence[float] = (),
        sensitivities: bool = False,
        stage: Callable[[str], None] | None = None,
        budget: TimeBudget | None = None,
        smooth: bool = False,
        jobs: int | None = 1,
        executor: Executor | None = None,
        figures: bool = False,
    ) -> Plan:
        """Run, prove and check what was planned; arguments are those of :func:`plan`.

        A motion whose proof falls short of a limit is made a little slower, or solved again, tighter there;
        the proved one is the plan if it costs at most 2 % more. Where cancels are asked for, it is up to 5 %
        slower if that proves that they lose no contact.

        Args:
            smooth: smooth the path of a plan along one, and take the better of both motions.
            figures: as of :func:`plan`; needs more than one job, and no limit of time.
        """
        say, budget = stage or silent, budget or TimeBudget(None)
        known = {"controller": controller, "rate": rate, "rise_time": rise_time, "budget": budget}
        how = {"time_scale": time_scale, "sensitivities": sensitivities, "say": say, "budget": budget}
        with calls_begun(executor, 1 if budget.given else jobs, len(planned.parts) + 1) as begin:
            alone = begin is partial  # nothing runs beside this: what is begun is done when it is asked for
            first = alone and not budget.given  # in limited time proofs come before what is optional
            waiting = [] if smooth else _proofs_begun(planned, begin)
            say("checking what is run ...")
            run = partial(executed, **known, begin=begin)
            executions = run(planned)
            if smooth:
                say("proving it, then smoothing the path ...")

                def smoothed(plan: MotionPlan) -> list[Execution]:
                    return proved_runs(plan, run(plan), budget)

                executions = proved_runs(planned, executions, budget)
                planned, executions = better_smoothed(planned, executions, smoothed, budget)

            def checks(
                planned: MotionPlan, executions: list[Execution]
            ) -> tuple[Plan, Callable[[Plan], Plan]]:
                result, completed = cls._checked(planned, executions, begin, **how)
                return (completed(result), lambda plan: plan) if first else (result, completed)

            result, completed = checks(planned, executions)
            if figures and not alone:
                new_figure(1.0, 1.0)  # loads Matplotlib while other processes prove
            say("proving what is run ...")  # alone last, for a proof may take all the time that is left
            tried = list[MotionPlan | None]()
            for wait in waiting:
                share = FOR_PROOFS / (len(waiting) - len(tried))
                tried.append(budget.within(wait, None, share=share))
            proofs = [
                replace(part, check=replace(part.check, proof_out_of_time=True)) if proof is None else proof
                for proof, part in zip(tried, planned.parts, strict=False)
            ]
            pairs = list(zip(proofs, planned.parts, strict=False))
            if any(one.energy != other.energy for one, other in pairs):  # proofs asked for another motion
                before, renewed = len(budget.left_out), planned.with_parts(proofs)
                again = checks(renewed, run(renewed))
                if len(budget.left_out) == before:
                    planned, (result, completed) = renewed, again
                else:  # no time was left to check that motion
                    proofs = planned.parts
                    del budget.left_out[before:]
            proved = [
                replace(
                    one,
                    check=replace(
                        one.check,
                        certificate=part.check.certificate,
                        proof_out_of_time=part.check.proof_out_of_time,
                    ),
                )
                if one.controller == "ramps" and one.check.certificate is None
                else one
                for one, part in zip(result.executions, proofs or planned.parts, strict=True)
            ]
            planned = planned.with_parts(proofs or planned.parts)
            executions = proved_runs(planned, proved, budget)
            if any(one.slower != other.slower for one, other in zip(executions, proved, strict=True)):
                known, left_out = (result, completed), list(budget.left_out)
                result, completed = checks(planned, executions)
                if STOPS in budget.left_out and STOPS not in left_out:  # those of the faster motion are known
                    (result, completed), executions = known, proved
                    budget.left_out[:] = left_out
            checked = cycle_check(planned.finished, result.motion, [one.check for one in executions])
            result = replace(result, planned=planned, executions=tuple(executions), checked=checked)
            if figures and not alone:
                say("drawing figures ...")
                draw = partial(result._drawn, task_samples(result.task, result.motion))
                result = replace(result, pngs=budget.within(draw, {}))
            return replace(completed(result), left_out=tuple(budget.left_out))

    @classmethod
    def _checked(
        cls,
        planned: MotionPlan,
        executions: Sequence[Execution],
        begin: Callable[..., Callable[[], Any]],
        *,
        time_scale: Sequence[float],
        sensitivities: bool,
        say: Callable[[str], None],
        budget: TimeBudget,
    ) -> tuple[Plan, Callable[[Plan], Plan]]:
        """The check of what is run, and what adds the rest except proofs; `begin` as of `calls_begun`."""
        task, motion = planned.finished, run_by(planned, executions)
        safe_cancels, robust = begin(cancels_by_segment, task, motion), begin(robustness, task, motion)
        checked = with_rises(task, motion, cycle_check(task, motion, [run.check for run in executions]))
        executions = [
            replace(run, check=segment_check)
            for run, segment_check in zip(executions, checked.segments, strict=True)
        ]
        say("checking stops and cancels ...")
        stops = dict[str, Stops]()
        if any(segment.task.limits.stoppable for segment in task.segments):
            by_segment = partial(stops_by_segment, task, motion, checked, decelerations=not budget.given)
            stops = budget.within(by_segment, stops, STOPS, share=0.7)

        def completed(plan: Plan) -> Plan:
            say("finding which deviations lose no contact ...")
            known: dict[str, Any] = {"robustness": budget.within(robust, (), "robustness")}
            known["time_scale"] = budget.within(
                lambda: tuple((f, check_cycle(task, planned.motion.time_scaled(f))) for f in time_scale),
                (),
                "time scales" * bool(time_scale),
            )
            if STOPS not in budget.left_out and not any(
                segment_check.decelerations for segment_check in stops.values()
            ):
                known["cancels"] = budget.within(safe_cancels, {}, "safe decelerations of cancels")
            if sensitivities:
                compute = partial(sensitivities_of, task.segments[0].task, motion.segments[0])
                known["sensitivities"] = budget.within(compute, (), "sensitivities")
            return replace(plan, **known)

        return cls(planned, tuple(executions), task=planned.task, checked=checked, stops=stops), completed

    @property
    def motion(self) -> Trajectory:
        """The executed motion; of a cycle the motions of the segments and the rests between them."""
        return run_by(self.planned, self.executions)

    @property
    def verified(self) -> bool:
        """Everything is planned, and what is run keeps all limits, stops included where asked for."""
        run = all(one.verified for one in self.executions)
        return self.planned.complete and run and super().verified

    def require(self, text: str) -> tuple[Outcome, ...]:
        """Return which requirements the plan meets; see `ocptip.api.check.Check.require`."""
        return motion_outcomes(self, text)

    def save_bag(self, path: str | os.PathLike[str]) -> None:
        """Write the executed motion and its margins over time as a bag, see `motion.files.plan_files`."""
        save_bag(self.task, self.motion, path)

    def __repr__(self) -> str:
        """Verdict, duration and energy, margins, robustness."""
        return brief(self.task.name, self)

    def to_dict(self) -> dict[str, Any]:
        """The content of plan.json, plain data for strict JSON."""
        return {**planned_to_dict(self.planned, self.executions, self.checked), **plain(self._entries())}

    def _entries(self) -> dict[str, Any]:
        """The entries of plan.json beside the plan."""
        source = self.task.source
        base = source.data.get("base") if source and "case" in source.data else None
        rows = [{"factor": f, **checked.to_dict()} for f, checked in self.time_scale]
        changes = [one.to_dict() for one in self.sensitivities]
        stops = stops_to_dict(self.task, self.stops)
        if self.price and self.task.is_cycle:
            stops["price_of_stops"] = self.price
        elif self.price:
            stops["stops"]["price"] = self.price
        return {
            **({"base": base} if base else {}),
            "margins": [one.to_dict() for one in self.margins],
            "tolerated": [one.to_dict() for one in self.robustness],
            **({"time_scale": rows} if rows else {}),
            **stops,
            **cancels_to_dict(self.task, self.cancels),
            **({"sensitivities": changes} if changes else {}),
            **({"left_out": list(self.left_out)} if self.left_out else {}),
        }

    def save(
        self, folder: str | os.PathLike[str], *, figures: bool = True, effort: bool = False
    ) -> list[Path]:
        """Write plan.json, motion.csv, trajectory.json, certificates, the task, and figures into a folder.

        Args:
            folder: made if it does not exist; the one above it must. Files of an earlier plan are replaced.
            figures: also draw them.
            effort: write joint torques into trajectory.json.

        Returns:
            The paths.

        Raises:
            InputError: the folder holds files that ocptip did not write and would replace.
            OSError: a file cannot be written; names it.
        """
        return list(self.write(folder, figures=figures, effort=effort))

    def write(
        self,
        folder: str | os.PathLike[str],
        *,
        figures: bool = True,
        effort: bool = False,
        extra: Mapping[str, Any] | None = None,
    ) -> Iterator[Path]:
        """Write the files and yield each path when its file is complete; `extra` replaces entries of
        plan.json.
        """
        folder, motion = Path(folder), run_by(self.planned, self.executions)
        samples = task_samples(self.task, motion)
        entries = {**self._entries(), **(extra or {})}
        how = {"executions": self.executions, "samples": samples, "effort": effort, "extra": entries}
        yield from write_plan(folder, self.planned, **how)
        remove_figures(folder, self.command)
        if not figures:
            return
        yield from write_files(folder, self.pngs or self._drawn(samples))
        for stops in () if self.task.is_cycle else self.stops.values():
            yield from draw_stops(folder, stops)

    def _drawn(self, samples: Sequence[MotionSamples]) -> dict[str, bytes]:
        """Contents of all figures except those of stops, from samples of the motion by segment."""
        return plan_pngs(seen_plan(self.task, self.motion, self.checked), samples_joined(samples))


def sensitivities_of(task: MotionTask, motion: Trajectory) -> tuple[Sensitivity, ...]:
    """The effects of changes on the margins of a motion; within an uncertainty in its worst case."""
    times, tolerance = motion.both_sides(SPACING), task.limits.tolerance.of(task.robot.payload)

    def worst(robot: StandingMechanism, speed: float) -> Reserves:
        counts = tolerance.heavier(robot.support.mass - task.robot.support.mass)
        faster = motion.time_scaled(1 / speed)
        result = worst_contacts(WorstCase(robot, counts), faster, times / speed)
        tip, slip, force = result["tip"], result["slip"], result["alike"] or result["foot_force"]
        least, reference = force.value if force else np.nan, robot.tip_over.reference_moment
        return Reserves.of(tip.value if tip else 0.0, slip.value, least, reference, slip.factor)

    return motion_sensitivities(task.robot, *motion.states(times), worst if tolerance.given else None)


def _proofs_begun(
    planned: MotionPlan, begin: Callable[..., Callable[[], Any]]
) -> list[Callable[[], MotionPlan]]:
    """What waits for each segment with its certificate; empty after an interrupt by the user."""
    return [] if planned.stopped else [begin(proved_part, part, certified) for part in planned.parts]
