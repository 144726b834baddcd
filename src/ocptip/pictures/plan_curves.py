"""The numbers of a plan as its figures draw them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ocptip.motion.check import MotionCheck
from ocptip.motion.cycles.check import CycleCheck
from ocptip.motion.cycles.task import Task
from ocptip.motion.files.output import sample_motion
from ocptip.motion.files.plan_files import samples_joined
from ocptip.motion.margins import MotionMargin, motion_margins
from ocptip.pictures.style import MEMBERS, NOMINAL
from ocptip.reserves.equal_compliance import reported_normal_forces
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.samples import MotionSamples
from ocptip.trajectories.trajectory import Trajectory

_SIDES = 1e-6  # s: both sides of a step are nearer to each other


@dataclass(frozen=True)
class _Task:
    """The attributes of a task that figures read."""

    name: str
    robot: StandingMechanism
    limits: Limits
    reference: None = None


@dataclass(frozen=True, eq=False)
class _Plan:
    """The attributes of a plan that figures read.

    Attributes:
        task, motion, check: of the whole.
        segments: begin and end of each motion, s, and what to call it.
        segment_limits: of each.
    """

    task: Any
    motion: Trajectory
    check: MotionCheck
    segments: tuple[tuple[float, float, str], ...] = ()
    segment_limits: tuple[Limits, ...] = ()


def seen_plan(task: Task, motion: Trajectory, check: CycleCheck) -> Any:
    """The plan that figures draw: of a motion, of a cycle, or of its first segments."""
    if not task.is_cycle:
        return _Plan(task, motion.segments[0], check.whole)
    rows = []
    for segment, segment_motion, begin in zip(task.segments, motion.segments, motion.begins, strict=False):
        payload = segment.task.robot.payload
        name = f"{segment.name}, {payload.mass:.4g} kg" if payload else segment.name
        rows.append((float(begin), float(begin) + segment_motion.end, name))
    seen = _Task(task.name, task.robot, task.limits)
    limits = tuple(segment.task.limits for segment in task.segments[: len(rows)])
    return _Plan(seen, motion, check.whole, tuple(rows), limits)


_POINTS = 400  # of curves of the worst case
_STEP = 1e-5  # s
_DRIVEN = 0.01  # s, between instants at which a base drives on


@dataclass(frozen=True)
class PlanCurves:
    """The numbers of a plan as they are drawn.

    Attributes:
        plan: that is drawn.
        samples: of its motion, with the rests.
        reference: samples of the reference motion, if there is one.
    """

    plan: Any  # a MotionPlan, or what `ocptip.pictures.plan_curves` makes of a cycle
    samples: MotionSamples
    reference: MotionSamples | None = None

    @classmethod
    def of(cls, plan: Any, samples: MotionSamples | None = None) -> PlanCurves:
        """The curves of a plan whose motion may have been sampled before."""
        robot, other = plan.task.robot, plan.task.reference
        samples = samples or sample_motion(robot, plan.motion)
        reference = None if other is None else _with_rests(robot, other, sample_motion(robot, other))
        return cls(plan, _with_rests(robot, plan.motion, samples), reference)

    @property
    def events(self) -> np.ndarray:
        """Switching times of velocity profiles, (S,), s; timings of paths, and samples, have none."""
        motion: Trajectory = self.plan.motion
        parts = zip(motion.begins, motion.segments, strict=True)
        results = [
            begin + segment_motion.event_times
            for begin, segment_motion in parts
            if segment_motion.profiles is not None
        ]
        return np.concatenate([[], *results])

    @property
    def times(self) -> np.ndarray:
        """(N,), s."""
        return self.samples.times

    @property
    def joint_names(self) -> list[str]:
        """Number and name, or just the name if that is but the number."""
        names = self.plan.task.robot.names
        return [n if n == f"joint {j}" else f"{j}: {n}" for j, n in enumerate(names, 1)]

    def limit(self, name: str) -> np.ndarray:
        """(N,) a limit of the task, or of the segment, up to the end of the rest after it, at each time."""
        segments = getattr(self.plan, "segments", ())
        if not segments:
            return np.full(len(self.times), getattr(self.plan.task.limits, name))
        values = np.array([getattr(limits, name) for limits in self.plan.segment_limits])
        begins = [begin for begin, _, _ in segments]
        return values[np.maximum(np.searchsorted(begins, self.times, "right") - 1, 0)]

    @property
    def units(self) -> list[str]:
        """Per joint deg, or m for a straight coordinate."""
        return ["m" if unit == "m" else "deg" for unit in self.plan.task.robot.units]

    @property
    def scales(self) -> np.ndarray:
        """(n,) factors from SI units to `units`."""
        return np.array([1.0 if unit == "m" else 180 / np.pi for unit in self.units])

    @cached_property
    def normal_range(self) -> np.ndarray:
        """(n, 2) minimum and maximum normal force each contact can bear, N; infinite for none."""
        pieces = [contact.force_pieces() for contact in self.plan.task.robot.support.contacts]
        return np.array(
            [[min(p.normal_min for p in piece), max(p.normal_max for p in piece)] for piece in pieces]
        )

    @property
    def normal_forces(self) -> np.ndarray:
        """(N, n), N; of equally compliant feet where rigid ones leave them open."""
        return reported_normal_forces(self.samples.states)

    def forces_at(self, time: float) -> np.ndarray:
        """(n, 3), N, base axes: of the contacts at a time; of a step the side with the minimum force."""
        near = np.flatnonzero(np.abs(self.times - time) <= np.abs(self.times - time).min() + _SIDES)
        k = near[np.argmin(self.normal_forces[near].min(axis=1))]
        forces = self.samples.states.contact_forces[k].copy()
        forces[:, 0] = self.normal_forces[k]
        return np.einsum("kij,kj->ki", self.plan.task.robot.support.frames, np.nan_to_num(forces))

    @property
    def motion_text(self) -> str:
        """Name, duration and energy."""
        checked = self.plan.check
        return f"{self.plan.task.name}, {checked.duration:.3f} s, {checked.energy:.1f} J"

    @cached_property
    def margins(self) -> dict[str, MotionMargin]:
        """Of base and arm by name, see `motion.margins`."""
        return {
            row.name: row for row in motion_margins(self.plan.task.robot, self.plan.check) if not row.object
        }

    def moments(self, samples: MotionSamples) -> np.ndarray:
        """(N,), N m: minimum moment about a tipping axis; 0 where the base tips."""
        return np.maximum(samples.tip.moments.min(axis=1), 0.0)

    def friction(self, samples: MotionSamples) -> np.ndarray:
        """(N,): largest share of a contact's friction in use; contacts without load have none."""
        return np.fmax.reduce(samples.slip.usage, axis=1)

    @cached_property
    def worst_moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (K,), s, and the minimum moments there in the worst case, N m; none without uncertainty.

        Of states at nearly one instant, such as those of delayed joints, the worst.
        """
        within = self.plan.check.within
        times, moments = (np.empty(0), np.empty(0)) if within is None else within.course
        if not len(times):
            return times, moments
        grid = np.linspace(times.min(), times.max(), _POINTS)
        cell = np.clip(np.searchsorted(grid, times), 1, _POINTS - 1)
        least = np.full(_POINTS, np.inf)
        np.minimum.at(least, cell, moments)
        known = np.isfinite(least)
        return (grid[known] + grid[np.flatnonzero(known) - 1]) / 2, np.maximum(least[known], 0.0)

    @property
    def zero_moment_points(self) -> np.ndarray | None:
        """(N, 2), m: where the resultant of the normal forces is; None if contacts are not on one plane."""
        if not self.plan.task.robot.tip_over.on_polygon:
            return None
        normal = self.samples.states.contact_forces[:, :, 0]
        places = np.array([c.position for c in self.plan.task.robot.support.contacts])[:, :2]
        total = normal.sum(axis=1, keepdims=True)
        return np.divide(normal @ places, total, out=np.full((len(total), 2), np.nan), where=total > 0)

    @cached_property
    def has_tcp(self) -> bool:
        """There is a gripper whose place is known."""
        return bool(self.samples.gripper.size)

    @property
    def tcp(self) -> np.ndarray:
        """(N, 3), m, base frame."""
        return self.samples.gripper[:, :3]

    @property
    def tcp_speed(self) -> np.ndarray:
        """(N,), m/s: central differences of its place along the speeds of the joints."""
        q, step = self.samples.angles, _STEP * self.samples.speeds
        robot = self.plan.task.robot
        return np.linalg.norm(robot.tool(q + step) - robot.tool(q - step), axis=1) / (2 * _STEP)

    def energy(self, samples: MotionSamples) -> np.ndarray:
        """Since the start, (N,), J, by the trapezoidal rule."""
        power = samples.total_power
        return np.concatenate([[0.0], np.cumsum(0.5 * np.diff(samples.times) * (power[1:] + power[:-1]))])


def _with_rests(robot: StandingMechanism, motion: Trajectory, samples: MotionSamples) -> MotionSamples:
    """With the rest before and after the motion, where torques and margins may be at their worst.

    Cycles have rests between their segments as it is. A base may drive on while its arm rests.
    """
    if motion.parts:
        return samples
    later = np.arange(motion.end, robot.acts.end, _DRIVEN)
    knots = robot.acts.knots[robot.acts.knots > motion.end]
    times = [np.zeros(1), np.unique(np.concatenate([[motion.end], later, knots - _STEP, knots + _STEP]))]
    angles, during = motion.states(np.array([0.0, motion.end]))[0], robot.during(motion)
    before, after = (
        during.samples_of(time, np.tile(q, (len(time), 1)), *np.zeros((2, len(time), robot.n)))
        for time, q in zip(times, angles, strict=True)
    )
    return samples_joined([before, samples, after])


_REST = "#7a7a7a"
_DISTANCES = 80  # instants at which the distance to the surroundings is drawn
_SHOWN = len(MEMBERS)  # pairs with colours of their own; the others are one


def nearest_pairs(robot: StandingMechanism, samples: MotionSamples) -> tuple[np.ndarray, list[str]]:
    """Numbers (N,) of the nearest pairs at all instants, and their names, those nearest for longest first."""
    result = robot.collision.nearest(samples.angles)
    names = np.array([str(label) for label in robot.collision.labels])[result.pairs]
    unique, first, counts = np.unique(names, return_index=True, return_counts=True)
    order = np.lexsort((first, -counts))
    rank = np.empty(len(order), dtype=int)
    rank[order] = np.arange(len(order))
    return rank[np.searchsorted(unique, names)], [str(name) for name in unique[order]]


def draw_clearance(ax: Any, robot: StandingMechanism, samples: MotionSamples) -> bool:
    """Minimum distances, mm, in the colour of the pair; False, and a note, where nothing was checked."""
    if not np.isfinite(samples.clearances).any():
        ax.text(0.5, 0.5, "collision not checked", ha="center", va="bottom", transform=ax.transAxes)
        return False
    which, names = nearest_pairs(robot, samples)
    gaps = 1e3 * samples.clearances
    for k, name in enumerate([*names[:_SHOWN], "other pairs"]):
        chosen = which == k if k < _SHOWN and k < len(names) else which >= _SHOWN
        if name == "other pairs" and not chosen.any():
            continue
        ends = chosen | np.roll(chosen, 1) & (np.arange(len(chosen)) > 0)  # up to where the next pair begins
        color = _REST if name == "other pairs" else MEMBERS[k]
        line_style = {
            **NOMINAL,
            "color": color,
            "label": name if name == "other pairs" else f"between {name}",
            "gid": f"clearance-{k + 1}",
        }
        ax.plot(samples.times, np.where(ends, gaps, np.nan), **line_style)
    _draw_surroundings(ax, robot, samples)
    return True


def _draw_surroundings(ax: Any, robot: StandingMechanism, samples: MotionSamples) -> None:
    """Minimum distance to base, floor and obstacles, mm: neighbours in the arm may hide it, always alike."""
    collision = robot.collision
    within = collision.links | {label.first for label in collision.labels}
    others = [k for k, label in enumerate(collision.labels) if label.second not in within]
    if not collision.links or not others:
        return
    some = np.unique(np.linspace(0, len(samples.times) - 1, _DISTANCES).astype(int))
    gaps = 1e3 * collision.gaps(samples.angles[some])[:, others].min(axis=1)
    label = "to base and surroundings"
    ax.plot(samples.times[some], gaps, color=_REST, ls=":", label=label, gid="clearance-surroundings")
