"""All criteria and constraints of many candidate placements, in NumPy: the fast model, and the judge.

Searches and maps rank candidates with it; every placement returned is judged by it. The nonlinear program has
its own expressions and derivatives; in common are the moments about the tipping axes (`TipMap`) and the
definitions of indices and motor power.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve_many
from ocptip.contact.states import ContactStates
from ocptip.numerics.batch import BatchFunction
from ocptip.placement.manipulability import MEASURES, index_of, measures
from ocptip.placement.problem import PlacementProblem
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipMap
from ocptip.robots.dynamics import dynamics_batch
from ocptip.robots.geometry import Floor, Pillar, Wall, sphere_centres
from ocptip.robots.kinematics import gripper_pose

POSE_TOLERANCE = 1e-6
"""Largest error of the gripper's position (m) and orientation (rad)."""

LENGTH_UNIT = 0.1  # m: gaps and bounds are compared with violations of other constraints in these units
ANGLE_UNIT = 0.2  # rad
LOG_UNIT = np.log(2.0)  # of condition numbers
SMALLEST_INDEX = 1e-12


@dataclass(frozen=True, eq=False)
class Rows:
    """Constraints of one kind at N candidates.

    Attributes:
        kind: of the base alone "bounds", "contact area", "terrain" or "base clearance"; of a task "reach",
            "joint angle", "torque", "tip-over", "GN", "GT", "persistence", "manipulability" or "clearance".
        labels: m names.
        values: (N, m) in `unit`.
        limits: (m,).
        upper: values must be <= limits; else >=.
        unit: for people.
        margins: (N, m) >= 0 where kept, in comparable units (0.1 m, 0.2 rad, the limit itself).
    """

    kind: str
    labels: tuple[str, ...]
    values: np.ndarray
    limits: np.ndarray
    upper: bool
    unit: str
    margins: np.ndarray


@dataclass(frozen=True, eq=False)
class TaskEvaluation:
    """One task at N candidates; C load cases of the task.

    Attributes:
        torques: (N, C, n), N m.
        wrenches: (N, C, 6), N and N m, base axes: on the base about its centre of mass, weight included.
        GN, GT: (N, C); NaN where not asked for.
        GK: (N, C): use of the force space (4.19), 0 without process load.
        GE: (N, C): holding power, W, or torque cost.
        rows: constraints by kind.
        states: contact states, N C of them, or None.
    """

    torques: np.ndarray
    wrenches: np.ndarray
    GN: np.ndarray
    GT: np.ndarray
    GK: np.ndarray
    GE: np.ndarray
    rows: tuple[Rows, ...]
    states: ContactStates | None

    def margin(self) -> np.ndarray:
        """(N,) smallest margin; NaN counts as broken."""
        return smallest_margin(self.rows, len(self.torques))


def smallest_margin(rows: tuple[Rows, ...], count: int) -> np.ndarray:
    """(N,) smallest margin of all rows; minus infinity where one is NaN."""
    result = np.full(count, np.inf)
    for r in rows:
        if r.margins.shape[1]:
            result = np.minimum(result, np.min(np.nan_to_num(r.margins, nan=-np.inf), axis=1))
    return result


class Evaluator:
    """Evaluates candidates of a problem.

    Args:
        problem: see :class:`PlacementProblem`.

    Attributes:
        fast_slip: slip reserve with the contact solver's normal forces.
    """

    def __init__(self, problem: PlacementProblem) -> None:
        self.problem = problem
        robot = problem.robot
        self.arm, self.support = robot.arm, robot.support
        self.fast_slip = Slip(self.support) if robot.slip.redistribution == "full" else robot.slip
        self._dynamics = dynamics_batch(self.arm)
        self.tip_map = TipMap(robot.tip_over)
        limits = problem.limits
        reference = robot.tip_over.reference_moment
        self.moment_unit = 2 * (reference or 1.0)
        self.least_moment = 0.0 if reference is None else reference * (1 / (limits.GN or 1.0) - 1)
        self._spheres = BatchFunction(sphere_centres(self.arm)) if self.arm.sphere_sets else None
        self._checked = [self._spheres_against(obstacle) for obstacle in problem.obstacles]
        self.cases = [[c for c in problem.cases if c.task == t] for t in range(len(problem.tasks))]

    def _spheres_against(self, obstacle: Wall | Pillar) -> tuple[np.ndarray, np.ndarray, list[str]]:
        """Numbers, radii and names of the arm's spheres that are checked against an obstacle."""
        names = self.arm.floor_sets if isinstance(obstacle, Floor) else self.arm.obstacle_sets
        index, radii, labels, at = [], [], [], 0
        for spheres in self.arm.sphere_sets:
            for k, radius in enumerate(spheres.radii):
                if spheres.name in names:
                    index.append(at)
                    radii.append(radius)
                    labels.append(f"{spheres.name}[{k + 1}]")
                at += 1
        return np.array(index, dtype=int), np.array(radii), labels

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
        problem, terrain = self.problem, self.problem.terrain[patch]
        parameters = np.atleast_2d(parameters)
        origin, base = self.place(patch, parameters)
        rows = []
        for bound, upper, word in ((terrain.lower, False, "lower"), (terrain.upper, True, "upper")):
            for i in np.flatnonzero(np.isfinite(bound)):
                angle = terrain.angular[i]
                rows.append(
                    self._row(
                        "bounds",
                        [f"{terrain.parameters[i]}: {word} bound"],
                        parameters[:, [i]],
                        bound[[i]],
                        upper,
                        "rad" if angle else "m",
                        ANGLE_UNIT if angle else LENGTH_UNIT,
                    )
                )
        if terrain.contact_area is not None:
            contacts = np.array([c.position for c in self.support.contacts])
            world = origin[:, None] + contacts @ base.transpose(0, 2, 1)
            for axis, name in enumerate("xy"):
                for side, upper in ((0, False), (1, True)):
                    if np.isfinite(limit := terrain.contact_area[side, axis]):
                        labels = [f"contact {k + 1}: {name}" for k in range(len(contacts))]
                        bound = np.full(len(contacts), limit)
                        rows.append(
                            self._row(
                                "contact area", labels, world[:, :, axis], bound, upper, "m", LENGTH_UNIT
                            )
                        )
        if terrain.constraint_names:
            values = terrain.constraint_values(parameters)
            none = np.zeros(values.shape[1])
            rows.append(self._row("terrain", terrain.constraint_names, values, none, False, "", LENGTH_UNIT))
        spheres = problem.base_spheres
        world = origin[:, None] + spheres[:, :3] @ base.transpose(0, 2, 1)
        least = np.full(len(spheres), problem.limits.base_clearance)
        for obstacle in (*problem.obstacles, *problem.keep_out):
            if isinstance(obstacle, Floor):
                continue
            labels = [f"base[{k + 1}] and {obstacle.name}" for k in range(len(spheres))]
            gaps = obstacle_gaps(obstacle, world, spheres[:, 3])
            rows.append(self._row("base clearance", labels, gaps, least, False, "m", LENGTH_UNIT))
        return tuple(rows)

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
                bound where they may be redistributed (four or more contacts).
        """
        problem, arm, limits = self.problem, self.arm, self.problem.limits
        origin, base = self.place(patch, parameters)
        cases, N, n = self.cases[task], len(q), arm.n
        back = base.transpose(0, 2, 1)
        gravity = back @ problem.gravity
        torques, wrenches = np.empty((N, len(cases), n)), np.empty((N, len(cases), 6))
        still, about = np.zeros(n), self.support.center_of_mass
        for c, case in enumerate(cases):
            torques[:, c], wrenches[:, c] = self._dynamics(
                q, still, still, gravity, back @ case.force, back @ case.moment, about
            )
        wrenches[:, :, :3] += self.support.mass * gravity[:, None]
        kept = [c for c, case in enumerate(cases) if case.constrained]
        names = [cases[c].name for c in kept]
        rows = [self._pose_rows(task, origin, base, q), *self._arm_rows(q, torques, kept, names)]
        moments = self.tip_map(wrenches.reshape(-1, 6))[0].reshape(N, len(cases), self.tip_map.count)
        GN, GT = self._ratio(moments), np.full((N, len(cases)), np.nan)
        states = None
        if moments.shape[2] and not self.problem.robot.tip_over.free_rotation:
            least = np.full(len(kept), self.least_moment)
            rows.append(
                self._row(
                    "tip-over", names, np.min(moments[:, kept], axis=2), least, False, "N m", self.moment_unit
                )
            )
        if contacts:
            states, GN, GT = self._solve(wrenches, self.fast_slip if fast else self.problem.robot.slip)
            rows += self._contact_rows(states, GN, GT, kept, names)
        for k, name in enumerate(MEASURES):
            if (most := getattr(limits, name)) is not None:
                values = measures(arm, q, limits.jacobian_length)[:, [k]]
                label = name.replace("_", " ")
                margins = (np.log(most) - np.log(values)) / LOG_UNIT
                rows.append(Rows("manipulability", (label,), values, np.array([most]), True, "", margins))
        if limits.index is not None:
            values = np.maximum(index_of(arm, q, limits), SMALLEST_INDEX)[:, None]
            margins = (np.log(values) - np.log(limits.index_min)) / LOG_UNIT
            label, least = limits.index.replace("_", " "), np.array([limits.index_min])
            unit = {"dm_2": "rad", "manipulability": "m^3"}.get(limits.index, "")
            rows.append(Rows("manipulability", (label,), values, least, False, unit, margins))
        if clearances:
            rows += self._clearance_rows(origin, base, q)
        return TaskEvaluation(
            torques=torques,
            wrenches=wrenches,
            GN=GN,
            GT=GT,
            GK=self._force_space(cases, torques),
            GE=np.stack([problem.energy.values(torques[:, c]) for c in range(len(cases))], axis=1),
            rows=tuple(rows),
            states=states,
        )

    def criteria(self, evaluations: list[TaskEvaluation]) -> np.ndarray:
        """GN, GT, GK, GE of placements, (N, 4): the worst counting case, for GE the mean over them."""
        columns = []
        counts = [[i for i, c in enumerate(cases) if c.counts] for cases in self.cases]
        for name in ("GN", "GT", "GK", "GE"):
            values = np.concatenate(
                [getattr(e, name)[:, own] for e, own in zip(evaluations, counts, strict=True)], axis=1
            )
            columns.append(np.mean(values, axis=1) if name == "GE" else np.max(values, axis=1))
        return np.column_stack(columns)

    def totals(self, criteria: np.ndarray) -> np.ndarray:
        """(N,) weighted sum of normalised criteria (N, 4) (4.38); those with weight 0 may be NaN."""
        weights = self.problem.weights.array()
        references = np.array([self.problem.references[name] for name in ("GN", "GT", "GK", "GE")])
        used = weights > 0
        return (criteria[:, used] / references[used]) @ weights[used]

    # --- parts ---------------------------------------------------------------------------------------------

    @staticmethod
    def _row(
        kind: str,
        labels: list[str] | tuple[str, ...],
        values: np.ndarray,
        limits: np.ndarray,
        upper: bool,
        unit: str,
        scale: np.ndarray | float,
    ) -> Rows:
        margins = (limits - values if upper else values - limits) / scale
        return Rows(kind, tuple(labels), values, limits, upper, unit, margins)

    def _pose_rows(self, task: int, origin: np.ndarray, base: np.ndarray, q: np.ndarray) -> Rows:
        wanted = self.problem.tasks[task]
        at, turned = gripper_pose(self.arm, q)
        missed = np.linalg.norm(origin + (base @ at[:, :, None])[:, :, 0] - wanted.position, axis=1)
        world = base @ turned
        if wanted.orientation == "full":
            difference = wanted.rotation.T @ world
            sine = np.linalg.norm(difference - difference.transpose(0, 2, 1), axis=(1, 2)) / np.sqrt(8)
            cosine = (np.trace(difference, axis1=1, axis2=2) - 1) / 2
        else:
            axis, goal = world @ wanted.tool_axis, wanted.rotation @ wanted.tool_axis
            sine, cosine = np.linalg.norm(np.cross(axis, goal), axis=1), axis @ goal
        turn = np.arctan2(sine, cosine) if wanted.orientation != "free" else np.zeros(len(q))
        values = np.column_stack([missed, turn])
        limits = np.full(2, POSE_TOLERANCE)
        labels = ["gripper position", "gripper orientation"]
        return self._row("reach", labels, values, limits, True, "m, rad", np.array([LENGTH_UNIT, ANGLE_UNIT]))

    def _arm_rows(self, q: np.ndarray, torques: np.ndarray, kept: list[int], names: list[str]) -> list[Rows]:
        own, rows = self.arm.limits, []
        for limit, upper, word in ((own.angle_min, False, "lower"), (own.angle_max, True, "upper")):
            at = np.flatnonzero(np.isfinite(limit))
            labels = [f"joint {j + 1}: {word} angle limit" for j in at]
            rows.append(self._row("joint angle", labels, q[:, at], limit[at], upper, "rad", ANGLE_UNIT))
        most = self.problem.limits.torque_ratio * own.torque
        at = np.flatnonzero(np.isfinite(most))
        labels = [f"joint {j + 1} ({name})" for name in names for j in at]
        values = np.abs(torques[:, kept][:, :, at]).reshape(len(q), len(kept) * len(at))
        limits = np.tile(most[at], len(kept))
        return [*rows, self._row("torque", labels, values, limits, True, "N m", limits)]

    def _ratio(self, moments: np.ndarray) -> np.ndarray:
        """GN (N, C) from the moments (N, C, axes)."""
        tip = self.problem.robot.tip_over
        if tip.free_rotation:
            return np.ones(moments.shape[:2])
        if not moments.shape[2]:
            return np.zeros(moments.shape[:2])
        smallest = np.maximum(np.min(moments, axis=2), 0.0)
        return tip.reference_moment / (tip.reference_moment + smallest)

    def _solve(self, wrenches: np.ndarray, slip: Slip) -> tuple[ContactStates, np.ndarray, np.ndarray]:
        robot, shape = self.problem.robot, wrenches.shape[:2]
        states = solve_many(self.support, wrenches.reshape(-1, 6), warm_start=False)
        GN = robot.tip_over.evaluate(states).GN
        reserve = slip.evaluate(states, derivatives=False)
        GT = np.where(reserve.solved, reserve.GT, np.nan)
        return states, GN.reshape(shape), GT.reshape(shape)

    def _contact_rows(
        self, states: ContactStates, GN: np.ndarray, GT: np.ndarray, kept: list[int], names: list[str]
    ) -> list[Rows]:
        limits, rows = self.problem.limits, []
        for kind, values, most in (("GN", GN, limits.GN), ("GT", GT, limits.GT)):
            if most is not None:
                bound = np.full(len(kept), most)
                rows.append(self._row(kind, names, values[:, kept], bound, True, "", bound))
        standing = states.persistent.reshape(GN.shape)[:, kept].astype(float)
        bound = np.ones(len(kept))
        rows.append(Rows("persistence", tuple(names), standing, bound, False, "", standing - bound))
        return rows

    @cached_property
    def _friction(self) -> tuple[np.ndarray, float] | None:
        """Common normal (3,) and largest friction coefficient of ordinary contacts on a plane, or None."""
        contacts = self.support.contacts
        normals = self.support.frames[:, :, 0]
        if (
            not all(isinstance(c, UnilateralContact) for c in contacts)
            or np.ptp(normals, axis=0).max() > 1e-9
        ):
            return None
        return normals[0], max(float(c.friction) for c in contacts)

    def least_slip(self, wrenches: np.ndarray) -> np.ndarray:
        """Lower bound (...,) of GT under wrenches (..., 6): all friction used in one direction; else zero."""
        if self._friction is None:
            return np.zeros(wrenches.shape[:-1])
        normal, friction = self._friction
        force = wrenches[..., :3]
        pressed = -(force @ normal)
        along = np.linalg.norm(force + pressed[..., None] * normal, axis=-1)
        return np.where(pressed > 0, along / (friction * np.maximum(pressed, 1e-12)), 0.0)

    def _force_space(self, cases: list, torques: np.ndarray) -> np.ndarray:
        """GK (N, C): largest share of its torque reserve in the load's direction that a joint uses (4.19)."""
        most = self.problem.limits.torque_ratio * self.arm.limits.torque
        at = np.isfinite(most)
        result = np.zeros(torques.shape[:2])
        if not at.any():
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

    def _clearance_rows(self, origin: np.ndarray, base: np.ndarray, q: np.ndarray) -> list[Rows]:
        problem, rows = self.problem, []
        least = problem.limits.clearance
        collision = problem.robot.collision
        if collision.labels:
            gaps, labels = collision.gaps(q), [str(label) for label in collision.labels]
            bound = np.full(len(labels), least)
            rows.append(self._row("clearance", labels, gaps, bound, False, "m", LENGTH_UNIT))
        if self._spheres is None or not problem.obstacles:
            return rows
        centres = self._spheres(q)[0].transpose(0, 2, 1)
        world = origin[:, None] + centres @ base.transpose(0, 2, 1)
        for obstacle, (index, radii, names) in zip(problem.obstacles, self._checked, strict=True):
            gaps = obstacle_gaps(obstacle, world[:, index], radii)
            labels = [f"{name} and {obstacle.name}" for name in names]
            bound = np.full(len(labels), least)
            rows.append(self._row("clearance", labels, gaps, bound, False, "m", LENGTH_UNIT))
        return rows


def obstacle_gaps(obstacle: Wall | Pillar, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Signed distances (N, k), m, of spheres at centres (N, k, 3) from a wall or pillar in the same axes."""
    if isinstance(obstacle, Wall):
        return obstacle.distance - centres @ obstacle.normal - radii
    arms = centres - obstacle.point
    across = arms - (arms @ obstacle.axis)[..., None] * obstacle.axis
    return np.linalg.norm(across, axis=-1) - obstacle.radius - radii
