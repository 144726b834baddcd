"""All criteria and constraints of many candidate placements, in NumPy: the fast model, and the judge.

Searches and maps rank candidates with it; every placement returned is judged by it. The nonlinear program has
its own expressions and derivatives; in common are the moments about the tipping axes (`TipMap`) and the
definitions of indices and motor power.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve_many
from ocptip.contact.states import ContactStates
from ocptip.contact.support import Support
from ocptip.placement.limits.arm import Clearance
from ocptip.placement.limits.base import Ground
from ocptip.placement.limits.contact import TipOver
from ocptip.placement.limits.judged import Rows, Standing, TaskEvaluation
from ocptip.placement.limits.kinds import BASE_LIMITS, TASK_LIMITS
from ocptip.placement.limits.limit import Limit
from ocptip.placement.problem import CRITERIA, PlacementProblem
from ocptip.reserves.slip import Slip
from ocptip.robots.dynamics import dynamics_batch

_FRICTION = (1.0, 4.0, 16.0, 64.0, 256.0)  # times as much friction, to tell how much would do
_PARALLEL = 1e-9

_Kind = TypeVar("_Kind", bound=Limit)


class Evaluator:
    """Evaluates candidates of a problem.

    Args:
        problem: see :class:`PlacementProblem`.

    Attributes:
        fast_slip: slip reserve with the contact solver's normal forces; where normals differ these say too
            little about the reserve, and it is the robot's.
        limits: those of tasks, and `Ground` with those of the base alone.
    """

    def __init__(self, problem: PlacementProblem) -> None:
        self.problem = problem
        robot = problem.robot
        self.arm, self.support = robot.arm, robot.support
        normals = self.support.frames[:, :, 0]
        self._same_normals = float(np.ptp(normals, axis=0).max()) <= _PARALLEL
        self.fast_slip = Slip(self.support, "tangential") if self._same_normals else robot.slip
        self._dynamics = dynamics_batch(self.arm)
        self._ground = Ground(problem, BASE_LIMITS)
        self.limits: tuple[Limit, ...] = (*(kind(problem) for kind in TASK_LIMITS), self._ground)
        self.tip_over = self.limit(TipOver)
        self.cases = [[c for c in problem.cases if c.task == t] for t in range(len(problem.tasks))]

    def limit(self, kind: type[_Kind]) -> _Kind:
        """The limit of a kind."""
        return next(limit for limit in self.limits if isinstance(limit, kind))

    def place(self, patch: int, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Base origins (N, 3), m, and rotations base to world (N, 3, 3)."""
        return self.problem.base_pose(patch, np.atleast_2d(parameters))

    def targets(
        self, task: int, origin: np.ndarray, base: np.ndarray, rotation: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """The task's pose in base axes: positions (N, 3), m, rotations (N, 3, 3)."""
        wanted = self.problem.tasks[task]
        turn = wanted.rotation if rotation is None else rotation
        back = base.transpose(0, 2, 1)
        return (back @ (wanted.position - origin)[:, :, None])[:, :, 0], back @ turn

    def ground(self, patch: int, parameters: np.ndarray) -> tuple[Rows, ...]:
        """Constraints on the base alone: bounds, contacts inside the patch, obstacles and keep-out zones."""
        parameters = np.atleast_2d(parameters)
        standing = Standing(self.problem.terrain[patch], parameters, *self.place(patch, parameters))
        return tuple(self._ground.margins(standing))

    def task(
        self,
        task: int,
        patch: int,
        parameters: np.ndarray,
        q: np.ndarray,
        *,
        contacts: bool = True,
        clearances: bool = True,
        fast: bool = False,
    ) -> TaskEvaluation:
        """Criteria and constraints of one task at parameters (N, k) and joint angles (N, n), rad.

        Args:
            contacts: solve the contacts for GN, GT and persistence; else GN comes from the moments alone
                (exact on a plane as long as the base stands) and GT is NaN.
            clearances: look at collisions.
            fast: of the slip reserve only the part with the contact solver's normal forces, which is an upper
                bound where they may be redistributed (four or more contacts with the same normal).
        """
        problem, cases, N = self.problem, self.cases[task], len(q)
        origin, base = self.place(patch, parameters)
        back = base.transpose(0, 2, 1)
        gravity = back @ problem.gravity
        torques, wrenches = np.empty((N, len(cases), self.arm.n)), np.empty((N, len(cases), 6))
        still, about = np.zeros(self.arm.n), self.support.center_of_mass
        for c, case in enumerate(cases):
            torques[:, c], wrenches[:, c] = self._dynamics(
                q, still, still, gravity, back @ case.force, back @ case.moment, about
            )
        wrenches[:, :, :3] += self.support.mass * gravity[:, None]
        moments = self.tip_over.moments(wrenches.reshape(-1, 6))[0].reshape(N, len(cases), -1)
        states, GN, GT = None, self.tip_over.ratio(moments), np.full((N, len(cases)), np.nan)
        if contacts:
            states, GN, GT = self._solve(wrenches, self.fast_slip if fast else self.problem.robot.slip)
        found = TaskEvaluation(
            terrain=problem.terrain[patch],
            parameters=parameters,
            origin=origin,
            base=base,
            task=task,
            cases=cases,
            q=q,
            torques=torques,
            wrenches=wrenches,
            moments=moments,
            GN=GN,
            GT=GT,
            GK=self._force_space(cases, torques),
            GE=np.stack([problem.energy.values(torques[:, c]) for c in range(len(cases))], axis=1),
            states=states,
        )
        rows = [
            own
            for limit in self.limits
            if limit is not self._ground and (clearances or not isinstance(limit, Clearance))
            for own in limit.margins(found)
        ]
        return replace(found, rows=tuple(rows))

    def criteria(self, evaluations: list[TaskEvaluation]) -> np.ndarray:
        """GN, GT, GK, GE of placements, (N, 4): the worst counting case, for GE the mean over them."""
        columns = []
        for name in CRITERIA:
            values = np.concatenate([getattr(e, name)[:, e.counting] for e in evaluations], axis=1)
            columns.append(np.mean(values, axis=1) if name == "GE" else np.max(values, axis=1))
        return np.column_stack(columns)

    def least_criteria(self, evaluations: list[TaskEvaluation]) -> np.ndarray:
        """Lower bounds (N, 4) of the criteria of placements whose contacts were not solved."""
        least = [self.least_slip(e.wrenches[:, e.counting]) for e in evaluations]
        criteria = self.criteria(evaluations)
        criteria[:, CRITERIA.index("GT")] = np.max(np.concatenate(least, axis=1), axis=1, initial=0.0)
        return criteria

    def totals(self, criteria: np.ndarray) -> np.ndarray:
        """(N,) weighted sum of normalised criteria (N, 4) (4.38); those with weight 0 may be NaN."""
        weights = self.problem.weights.array()
        references = np.array([self.problem.references[name] for name in CRITERIA])
        used = weights > 0
        return (criteria[:, used] / references[used]) @ weights[used]

    # --- parts ---------------------------------------------------------------------------------------------

    def _solve(self, wrenches: np.ndarray, slip: Slip) -> tuple[ContactStates, np.ndarray, np.ndarray]:
        robot, shape = self.problem.robot, wrenches.shape[:2]
        states = solve_many(self.support, wrenches.reshape(-1, 6), warm_start=False)
        GN = robot.tip_over.evaluate(states).GN
        reserve = slip.evaluate(states, derivatives=False)
        GT = np.where(reserve.solved, reserve.GT, np.nan)
        return states, GN.reshape(shape), GT.reshape(shape)

    @cached_property
    def _friction(self) -> tuple[np.ndarray, float] | None:
        """Common normal (3,) and largest friction coefficient of ordinary contacts on a plane, or None."""
        contacts = self.support.contacts
        if not (self._same_normals and all(isinstance(c, UnilateralContact) for c in contacts)):
            return None
        return self.support.frames[0, :, 0], max(float(c.friction) for c in contacts)

    def least_slip(self, wrenches: np.ndarray) -> np.ndarray:
        """Lower bound (...,) of GT under wrenches (..., 6): all friction used in one direction; else zero."""
        if self._friction is None:
            return np.zeros(wrenches.shape[:-1])
        normal, friction = self._friction
        force = wrenches[..., :3]
        pressed = -(force @ normal)
        along = np.linalg.norm(force + pressed[..., None] * normal, axis=-1)
        return np.where(pressed > 0, along / (friction * np.maximum(pressed, 1e-12)), 0.0)

    def friction_needed(self, wrench: np.ndarray) -> float:
        """How many times the friction must be as large for the contacts to hold a wrench (6,), if all slip.

        Infinite where no friction holds it; NaN where contacts other than ordinary ones take part.
        """
        support, contacts = self.support, self.support.contacts
        if not all(isinstance(c, UnilateralContact) for c in contacts):
            return np.nan
        for times in _FRICTION:
            rough = [replace(c, friction=times * c.friction) for c in contacts]
            other = Support(rough, mass=support.mass, center_of_mass=support.center_of_mass)
            states = solve_many(other, wrench[None], warm_start=False)
            if states.persistent[0]:
                return times * float(Slip(other).evaluate(states, derivatives=False).GT[0])
        return np.inf

    def _force_space(self, cases: list, torques: np.ndarray) -> np.ndarray:
        """GK (N, C): largest share of its torque reserve in the load's direction that a joint uses (4.19)."""
        most, at = self.problem.most_torque, self.problem.limited_joints
        result = np.zeros(torques.shape[:2])
        if not len(at):
            return result
        own = torques[:, 0, at]
        for c, case in enumerate(cases):
            if case.load < 0:
                continue
            change = torques[:, c, at] - own
            room = np.where(change > 0, most[at] - own, most[at] + own)
            with np.errstate(divide="ignore", invalid="ignore"):
                share = np.where(np.abs(change) > 0, np.abs(change) / room, 0.0)
            result[:, c] = np.max(np.where(room > 0, share, np.inf), axis=1)
        return result
