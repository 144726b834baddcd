"""All criteria and constraints of many candidate placements, in NumPy: the fast model, and the final check.

Searches and maps rank candidates with it; every placement returned is checked by it. The nonlinear program
has separate expressions and derivatives; in common are the moments about the tipping axes (`TipMap`) and the
definitions of indices and motor power.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from ocptip.contact.states import ContactStates
from ocptip.placement.estimates import ROUNDS, LeastSlip, edge_moments, friction_shares
from ocptip.placement.limits.arm import Clearance
from ocptip.placement.limits.base import Ground
from ocptip.placement.limits.contact import TipOverLimit
from ocptip.placement.limits.kinds import BASE_LIMITS, TASK_LIMITS
from ocptip.placement.limits.limit import ConstraintRows, PlacedBase, PlacementLimit, TaskEvaluation
from ocptip.placement.problem import CRITERIA, PlacementProblem
from ocptip.placement.stand import Stand, Stood
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipMap
from ocptip.robots.dynamics import dynamics_batch
from ocptip.standing.footing import Footing

_PARALLEL = 1e-9

_Kind = TypeVar("_Kind", bound=PlacementLimit)


class Evaluator:
    """Evaluates candidates of a problem.

    Args:
        problem: see :class:`PlacementProblem`.

    Attributes:
        fast_slip: friction utilisation with the contact solver's normal forces; where normals differ that is
            too rough, and it is that of the robot.
        limits: those of tasks, and `Ground` with those of the base alone.
    """

    def __init__(self, problem: PlacementProblem) -> None:
        self.problem = problem
        robot = problem.robot
        self.arm, self.support = robot.arm, problem.footing.support
        normals = self.support.frames[:, :, 0]
        self._same_normals = float(np.ptp(normals, axis=0).max()) <= _PARALLEL
        self.fast_slip = Slip(self.support, "tangential") if self._same_normals else problem.footing.slip
        self._dynamics = dynamics_batch(self.arm)
        self._ground = Ground(problem, BASE_LIMITS)
        self.limits: tuple[PlacementLimit, ...] = (*(kind(problem) for kind in TASK_LIMITS), self._ground)
        self.tip_over = self.limit(TipOverLimit)
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

    def ground(self, patch: int, parameters: np.ndarray) -> tuple[ConstraintRows, ...]:
        """Constraints on the base alone: bounds, contacts inside the patch, obstacles and keep-out zones."""
        parameters = np.atleast_2d(parameters)
        stood = self.problem.stands[patch].at(parameters)
        standing = PlacedBase(**vars(stood), terrain=self.problem.terrain[patch], parameters=parameters)
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
            contacts: solve the contacts for GN, GT and whether they are maintained; else GN comes from the
                moments alone (exact on a plane as long as the base stands) and GT is NaN.
            clearances: check collisions.
            fast: friction utilisation only with the contact solver's normal forces, which is an upper bound
                where they may be redistributed (four or more contacts with the same normal); where feet
                conform to the ground estimates of GN and GT (`ocptip.placement.estimates`).
        """
        problem, cases, N = self.problem, self.cases[task], len(q)
        stand = problem.stands[patch]
        stood = stand.at(parameters)
        back = stood.base.transpose(0, 2, 1)
        gravity = back @ problem.gravity
        torques, wrenches = np.empty((N, len(cases), self.arm.n)), np.empty((N, len(cases), 6))
        still, about = np.zeros(self.arm.n), self.support.center_of_mass
        for c, case in enumerate(cases):
            torques[:, c], wrenches[:, c] = self._dynamics(
                q, still, still, gravity, back @ case.force, back @ case.moment, about
            )
        wrenches[:, :, :3] += self.support.mass * gravity[:, None]
        added = np.einsum("kwg,ng->nkw", np.array([c.per_gravity for c in problem.corners]), gravity)
        reserves = self._reserves(stand, stood, wrenches, added, contacts, fast)
        task_evaluation = TaskEvaluation(
            **vars(stood),
            terrain=problem.terrain[patch],
            parameters=parameters,
            task=task,
            cases=cases,
            q=q,
            torques=torques,
            wrenches=wrenches,
            **reserves,
            GK=self._force_space(cases, torques),
            GE=np.stack([problem.energy.values(torques[:, c]) for c in range(len(cases))], axis=1),
        )
        rows = [
            margin
            for limit in self.limits
            if limit is not self._ground and (clearances or not isinstance(limit, Clearance))
            for margin in limit.margins(task_evaluation)
        ]
        return replace(task_evaluation, rows=tuple(rows))

    def criteria(self, evaluations: list[TaskEvaluation]) -> np.ndarray:
        """GN, GT, GK, GE of placements, (N, 4): the worst counting case, for GE the mean over them."""
        columns = []
        for name in CRITERIA:
            values = np.concatenate([getattr(e, name)[:, e.counting] for e in evaluations], axis=1)
            columns.append(np.mean(values, axis=1) if name == "GE" else np.max(values, axis=1))
        return np.column_stack(columns)

    def least_criteria(self, evaluations: list[TaskEvaluation]) -> np.ndarray:
        """Lower bounds (N, 4) of the criteria of placements whose contacts were not solved."""
        least = [self.least_slip(e) for e in evaluations]
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

    def _reserves(
        self, stand: Stand, stood: Stood, nominal: np.ndarray, added: np.ndarray, contacts: bool, fast: bool
    ) -> dict[str, Any]:
        """The entries of `TaskEvaluation` about the contacts.

        Args:
            nominal: (N, C, 6), wrenches on the nominal base.
            added: (N, K, 6), their changes at the corners of the tolerance.
        """
        if not contacts or (stand.conforms and fast):
            return self._rough_reserves(stand, stood, nominal, added, contacts)
        cornered, states = nominal[:, :, None] + added[:, None], None
        shape, wrenches = cornered.shape[:3], cornered.reshape(len(nominal), -1, 6)
        if not stand.conforms:
            footing, flat = self.problem.footing, wrenches.reshape(-1, 6)
            states = footing.contact_states(flat, warm_start=False)
            moments = self.tip_over.moments(flat)[0]
            GN, GT = self._solved(footing, self.fast_slip if fast else footing.slip, states)
            standing = states.persistent
        else:
            moments, GN, GT, standing = self._on_rough_ground(stand, stood, wrenches)
        moments = moments.reshape(*shape, -1)
        GN, GT, standing = (values.reshape(shape) for values in (GN, GT, standing))
        return {
            "cornered": cornered,
            "moments": moments,
            "GN": np.max(GN, axis=2),
            "GT": np.max(GT, axis=2),
            "standing": np.all(standing, axis=2),
            "states": states,
            "worst": {
                "tip-over": np.argmin(np.min(moments, axis=3, initial=np.inf), axis=2),
                "GN": np.argmax(GN, axis=2),
                "GT": np.argmax(GT, axis=2),
                "persistence": np.argmin(standing, axis=2),
            },
        }

    def _rough_reserves(
        self, stand: Stand, stood: Stood, nominal: np.ndarray, added: np.ndarray, contacts: bool
    ) -> dict[str, Any]:
        """The same without solving contacts, from moments about the axes, each the minimum over all corners.

        With `contacts` GT is also estimated, at the corner that a first round takes for the worst.
        """
        tip, GT, standing = self.problem.footing.tip_over, np.full(nominal.shape[:2], np.nan), None
        if stand.conforms:
            moments, changes = (self._edge_moments(stood, w) for w in (nominal, added))
            moments = moments + np.min(changes, axis=1, keepdims=True)
        elif tip.affine_moments is not None:
            slope, offset = tip.affine_moments
            moments = nominal @ slope.T + offset + np.min(added @ slope.T, axis=1, keepdims=True)
        else:
            cornered = nominal[:, :, None] + added[:, None]
            moments = self.tip_over.moments(cornered.reshape(-1, 6))[0]
            moments = np.min(moments.reshape(*cornered.shape[:3], -1), axis=2)
        if contacts:
            cornered = nominal[:, :, None] + added[:, None]
            if cornered.shape[2] > 1:
                rough = self.fast_usage(stand, stood, cornered.reshape(len(nominal), -1, 6), rounds=1)
                worst = np.argmax(rough.reshape(cornered.shape[:3]), axis=2)
                cornered = np.take_along_axis(cornered, worst[:, :, None, None], axis=2)
            GT = self.fast_usage(stand, stood, cornered[:, :, 0])
            standing = (GT < 1) & np.all(moments > 0, axis=2)
        return {
            "cornered": nominal[:, :, None],
            "moments": moments[:, :, None],
            "GN": self.tip_over.ratio(moments),
            "GT": GT,
            "standing": standing,
            "states": None,
            "worst": {},
        }

    def _edge_moments(self, stood: Stood, wrenches: np.ndarray) -> np.ndarray:
        return edge_moments(wrenches, stood.contacts, self.tip_over.pairs, self.support.center_of_mass)

    @staticmethod
    def _solved(footing: Footing, slip: Slip, states: ContactStates) -> tuple[np.ndarray, np.ndarray]:
        """GN and GT of states."""
        reserve = slip.evaluate(states, derivatives=False)
        known = reserve.solved | states.persistent  # what holds the base bounds GT from above
        return footing.tip_over.evaluate(states).GN, np.where(known, reserve.GT, np.nan)

    def _on_rough_ground(
        self, stand: Stand, stood: Stood, wrenches: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Moments (N, M, axes), GN, GT and whether contacts are maintained (N, M), under wrenches (N,
        M, 6).
        """
        moments, results = [], []
        for wrench, places, frames in zip(wrenches, stood.contacts, stood.frames, strict=True):
            footing = stand.feet.at(places, frames)
            states = footing.contact_states(wrench, warm_start=False)
            moments.append(TipMap(footing.tip_over)(wrench)[0])
            results.append((*self._solved(footing, footing.slip, states), states.persistent))
        most = max((m.shape[1] for m in moments), default=0)
        moments = [np.pad(m, ((0, 0), (0, most - m.shape[1])), constant_values=np.inf) for m in moments]
        GN, GT, standing = (np.array([r[i] for r in results]) for i in range(3))
        return np.array(moments), GN, GT, standing

    def fast_usage(
        self, stand: Stand, stood: Stood, wrenches: np.ndarray, rounds: int = ROUNDS
    ) -> np.ndarray:
        """Upper bounds (N, M) of GT under wrenches (N, M, 6); rounds: see `friction_shares`."""
        if stand.conforms:
            return friction_shares(wrenches, stood.contacts, stood.frames, self.support, rounds)
        states = self.problem.footing.contact_states(wrenches.reshape(-1, 6), warm_start=False)
        return self.fast_slip.evaluate(states, derivatives=False).GT.reshape(wrenches.shape[:2])

    @cached_property
    def _least(self) -> LeastSlip | None:
        conforming = any(stand.conforms for stand in self.problem.stands)
        return None if conforming else LeastSlip(self.support)

    def least_slip(self, evaluation: TaskEvaluation) -> np.ndarray:
        """(N, C) lower bounds of GT of the cases that count, the worst corner of each; else zero."""
        wrenches = evaluation.wrenches[:, evaluation.counting]
        if self._least is None:
            return np.zeros(wrenches.shape[:2])
        gravity = evaluation.base.transpose(0, 2, 1) @ self.problem.gravity
        corners = [wrenches + (gravity @ corner.per_gravity.T)[:, None] for corner in self.problem.corners]
        bounds = [
            self._least(wrenches_of_corner.reshape(-1, 6)).reshape(wrenches.shape[:2])
            for wrenches_of_corner in corners
        ]
        return np.max(bounds, axis=0)

    def _force_space(self, cases: list, torques: np.ndarray) -> np.ndarray:
        """GK (N, C): largest share of its torque margin in the load's direction that a joint uses (4.19)."""
        most, limited_joints = self.problem.most_torque, self.problem.limited_joints
        result = np.zeros(torques.shape[:2])
        if not len(limited_joints):
            return result
        torque = torques[:, 0, limited_joints]
        for c, case in enumerate(cases):
            if case.load < 0:
                continue
            change = torques[:, c, limited_joints] - torque
            left = np.where(change > 0, most[limited_joints] - torque, most[limited_joints] + torque)
            with np.errstate(divide="ignore", invalid="ignore"):
                share = np.where(np.abs(change) > 0, np.abs(change) / left, 0.0)
            result[:, c] = np.max(np.where(left > 0, share, np.inf), axis=1)
        return result
