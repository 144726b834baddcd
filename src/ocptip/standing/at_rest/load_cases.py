"""Load cases at rest: poses of an arm, each with more payload, on tilted floors, pushed at the TCP.

No load case moves; the loads of a motion (`MotionLoads`) serve its robustness. Directions of tilt and push
are checked all around, in combination, and then ever closer about those with the maximum friction used and
with the minimum tipping margin.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any, Protocol

import numpy as np

from ocptip.basics.errors import finite_array
from ocptip.contact.states import ContactStates
from ocptip.numerics.bisection import borders
from ocptip.reserves.equal_compliance import reported_normal_forces
from ocptip.robots.dynamics import evaluate_dynamics
from ocptip.robots.kinematics import gripper_batch
from ocptip.robots.payload import Payload
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.directions import NO_DIRECTION, around, pushes, slopes, tilted
from ocptip.standing.at_rest.slope import MOST_TILT
from ocptip.standing.footing import Footing
from ocptip.standing.objects import carrier_motions
from ocptip.trajectories.trajectory import Trajectory

HALVINGS = 20
AT_ONCE = 16  # states of which slip is solved before half spaces are made anew


@dataclass(frozen=True, eq=False)
class LoadCaseGrid:
    """Which load cases.

    Attributes:
        poses: joint angles (n,), rad (m), by name.
        payloads: kg, point masses at the TCP beyond what it holds.
        tilts: rad, of the floor, downhill in any direction.
        pushes: N, at the TCP, in any direction.
        acting: force and moment (6,) in a pose, by its name, of a process that varies; elsewhere each of
            its rows acts.
    """

    poses: Mapping[str, np.ndarray]
    payloads: Sequence[float] = (0.0, 0.5)
    tilts: Sequence[float] = (0.0, np.radians(1.0), np.radians(3.0))
    pushes: Sequence[float] = (0.0, 20.0)
    acting: Mapping[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class LoadCase:
    """One load case in its worst direction.

    Attributes:
        pose: its name.
        payload, tilt, push: kg, rad, N.
        GN, GT: published indices of it and of the friction used; 1 and more, or NaN: a contact is lost.
        least_force: N, the minimum normal force of a contact; rigid feet as if equally compliant.
        stands: no contact is lost in any direction.
        downhill, towards: of the floor and of the push, in base axes, where it is worst; zero without.
        tipping_margin: N m, minimum moment about a tipping axis, negative where the base tips; None where it
            cannot.
    """

    pose: str
    payload: float
    tilt: float
    push: float
    GN: float
    GT: float
    least_force: float
    stands: bool
    downhill: tuple[float, ...]
    towards: tuple[float, ...]
    tipping_margin: float | None

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON, the tilt in degrees."""
        data = dict(vars(self))
        margin = data.pop("tipping_margin")
        return {**data, "tilt": float(np.degrees(self.tilt)), "tipping_margin_Nm": margin}


class RestLoads:
    """Wrenches on the base of an arm at rest, by what they are linear in.

    Args:
        robot: on its base.
        q: (N, n) postures.
        acting: (N, k) what acts there, see `StandingMechanism.acting`.

    Attributes:
        per_gravity: (N, 6, 3) per component of gravity, N per m/s^2.
        process: (N, 6) of what acts on the gripper besides, and of the motion of the base.
        tool: (N, 3) gripper from the base's centre of mass, m.
    """

    def __init__(self, robot: Robot, q: np.ndarray, acting: np.ndarray | None = None) -> None:
        self.robot, still, about = robot, np.zeros_like(q), robot.support.center_of_mass
        process, self.base_motion = robot.acts.split(acting)
        given = {"about": about, "base_motion": self.base_motion}
        self.process, *weights = (
            robot.pushed(robot.arm, q, still, still, process, gravity=g, **given).wrench
            for g in (np.zeros(3), *np.eye(3))
        )
        self.per_gravity = np.stack(weights, axis=2) - self.process[:, :, None]
        if self.base_motion is not None:
            self.process = self.process + self.base_motion.inertial_wrench(robot.support)
        self.per_gravity[:, :3] += robot.support.mass * np.eye(3)
        self.tool = gripper_batch(robot.arm)(q)[0] - about

    def at_tool(self, forces: np.ndarray) -> np.ndarray:
        """(N, 6): of forces (N, 3) at the TCP, N."""
        forces = np.broadcast_to(forces, self.tool.shape)
        return np.hstack([forces, np.cross(self.tool, forces)])

    def wrenches(
        self, gravity: np.ndarray, payload: float | np.ndarray = 0.0, push: np.ndarray | None = None
    ) -> np.ndarray:
        """(N, 6) with gravity (3,), m/s^2, more payload, kg (or one each, (N, 1)), and a push (3,), N."""
        force = payload * gravity + (0.0 if push is None else push)
        return self.per_gravity @ gravity + self.process + self.at_tool(force)


class LinearLoads(Protocol):
    """Wrenches on a base or an object at instants (N,) of a motion, by what they are linear in.

    Attributes:
        robot: on its base.
        per_gravity: (N, 6, 3) per component of gravity, N per m/s^2, in base axes.
        process: (N, 6) of what acts besides.
        inertial, crossed: (N, 6), in proportion to the square of the arm's speed, and to it.
    """

    robot: Robot
    per_gravity: np.ndarray
    process: np.ndarray
    inertial: np.ndarray
    crossed: np.ndarray

    def total(self, gravity: np.ndarray | None = None, speed: float = 1.0) -> np.ndarray:
        """Wrenches (N, 6) with gravity (3,), m/s^2, and the arm's speed times `speed`."""
        gravity = self.robot.support.gravity if gravity is None else gravity
        moving = speed**2 * self.inertial + speed * self.crossed
        return self.per_gravity @ gravity + self.process + moving


class ObjectLoads(LinearLoads):
    """Wrenches on the object of that number, about its centre of mass, in axes of what carries it."""

    def __init__(self, robot: Robot, motion: Trajectory, times: np.ndarray, number: int) -> None:
        q, qd, qdd = motion.states(times)
        base_motion, held = robot.acts.split(robot.acting(times))[1], robot.carried[number]

        def wrench(share: float, gravity: np.ndarray) -> np.ndarray:
            states = q, share * qd, share**2 * qdd
            motions = carrier_motions(robot.arm, gravity, *states, base_motion)
            return np.broadcast_to(motions[held.carrier].inertial_wrench(held.footing.support), (len(q), 6))

        self.robot, self.process = robot, wrench(0.0, np.zeros(3))
        weights = [wrench(0.0, axis) for axis in np.eye(3)]
        self.per_gravity = np.stack(weights, axis=2) - self.process[:, :, None]
        forth, back = (wrench(share, np.zeros(3)) for share in (1.0, -1.0))
        self.inertial, self.crossed = 0.5 * (forth + back) - self.process, 0.5 * (forth - back)


class MotionLoads(RestLoads, LinearLoads):
    """Wrenches on the base of an arm at instants (N,) of a motion, by what they are linear in."""

    def __init__(self, robot: Robot, motion: Trajectory, times: np.ndarray) -> None:
        self.times = times
        q, qd, qdd = motion.states(times)
        super().__init__(robot, q, robot.acting(times))
        arm, about = robot.arm.without_process, robot.support.center_of_mass
        bare = arm.with_payload(None)
        one = bare.with_payload(Payload(1.0))  # loads are linear in what is held

        def loads(model: Any, rates: Sequence[np.ndarray], gravity: np.ndarray) -> Any:
            given = {"gravity": gravity, "about": about, "base_motion": self.base_motion}
            return evaluate_dynamics(model, q, *rates, **given)

        def wrench(model: Any, rates: Sequence[np.ndarray], gravity: np.ndarray) -> np.ndarray:
            return loads(model, rates, gravity).wrench

        moving = (qd, qdd)
        self.inertial, self.crossed = wrench(arm, moving, np.zeros(3)), np.zeros((len(q), 6))
        if self.base_motion is not None:  # the speeds of arm and base meet in Coriolis forces
            back = wrench(arm, (-qd, qdd), np.zeros(3))
            self.crossed = 0.5 * (self.inertial - back)
            self.inertial = 0.5 * (self.inertial + back) - wrench(arm, (0 * qd, 0 * qdd), np.zeros(3))
        with_it, without = (loads(model, moving, robot.support.gravity) for model in (one, bare))
        self.extra, self._extra_torques = with_it.wrench - without.wrench, with_it.torque - without.torque

    def held_by_drives(self, robot: Robot, motion: Trajectory) -> float | None:
        """kg: the largest point mass at the TCP that the drives can move; None: not limited."""
        states, per_kilogram = motion.states(self.times), self._extra_torques
        torques = robot.loads(*states, robot.acting(self.times))[0]
        limit = robot.limits.torque
        unused = np.where(per_kilogram > 0, limit - torques, limit + torques)
        with np.errstate(divide="ignore", invalid="ignore"):
            masses = np.where(per_kilogram != 0, unused / np.abs(per_kilogram), np.inf)
        least = max(float(np.min(masses)), 0.0)
        return least if np.isfinite(least) else None


def load_cases(robot: Robot, asked: LoadCaseGrid) -> list[LoadCase]:
    """All combinations of what was asked for, each in its worst direction.

    Raises:
        InputError: a pose does not fit the arm, or a number is not finite.
    """
    results = []
    for name, angles in asked.poses.items():
        loads = _in_pose(robot, finite_array(name, angles, (robot.n,)), asked.acting.get(name))
        for payload, tilt, push in product(asked.payloads, asked.tilts, asked.pushes):
            results.append(_case(robot, loads, name, payload, tilt, push))
    return results


def _in_pose(robot: Robot, q: np.ndarray, acting: np.ndarray | None) -> RestLoads:
    """In q (n,), once for each row of a process that varies, if its value (6,) is not given."""
    robot = robot.driving(None)
    if robot.varying is None:
        return RestLoads(robot, q[None])
    rows = np.hstack([robot.varying.force, robot.varying.moment]) if acting is None else acting[None, :6]
    rows = np.unique(rows, axis=0)
    return RestLoads(robot, np.tile(q, (len(rows), 1)), rows)


def tilt_by_direction(
    robot: Robot, q: np.ndarray, count: int = 72, acting: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """By how much the floor may tilt before a contact is lost, at rest.

    Args:
        robot: on its base.
        q: (n,) posture.
        count: number of directions.
        acting: (6,) of a process that varies, see `LoadCaseGrid`.

    Returns:
        Directions downhill (count, 3), base axes, and tilts (count,), rad, at most `MOST_TILT`; 0 where it
        does not stand on level ground.
    """
    loads, gravity = _in_pose(robot, q, acting), robot.support.gravity
    sides, keeps_contacts = around(gravity, count), contact_test(robot)

    def stands(tilt: np.ndarray) -> np.ndarray:
        good = keeps_contacts(np.vstack([loads.wrenches(g) for g in tilted(gravity, sides, tilt)]))
        return np.all(good.reshape(count, -1), axis=1)

    return sides, largest_levels(stands, np.full(count, MOST_TILT))


def largest_payload(robot: Robot, q: np.ndarray, process: np.ndarray | None = None) -> np.ndarray:
    """(N,) kg: the largest point mass at the TCP beyond what it holds, at rest in postures q (N, n).

    At most the mass of the robot; what the drives can hold is not checked. A process that varies
    needs its values, (N, 6). A base that drives rests.
    """
    loads, gravity, keeps_contacts = (
        RestLoads(robot.driving(None), q, process),
        robot.support.gravity,
        contact_test(robot),
    )

    def stands(payload: np.ndarray) -> np.ndarray:
        return keeps_contacts(loads.wrenches(gravity, payload[:, None]))

    return largest_levels(stands, np.full(len(q), robot.mass))


def _case(robot: Robot, loads: RestLoads, name: str, payload: float, tilt: float, push: float) -> LoadCase:
    gravity = robot.support.gravity

    def measured(sides: np.ndarray) -> np.ndarray:
        """Of directions downhill and of the push (P, 6): GN, GT, minus minimum force and margin (P, 4)."""
        gravities = tilted(gravity, sides[:, :3], np.full(len(sides), tilt))
        forces = push * sides[:, 3:]
        each = [loads.wrenches(g, payload, p) for g, p in zip(gravities, forces, strict=True)]
        states = robot.contact_states(np.vstack(each))
        tip, least = robot.tip_over.evaluate(states), np.min(reported_normal_forces(states), axis=1)
        margin = np.min(tip.margins, axis=1, initial=np.inf)
        values = np.column_stack([tip.GN, _slips(robot, states), -least, -margin])
        return np.max(values.reshape(len(sides), -1, 4), axis=1)

    def add(others: np.ndarray) -> np.ndarray:
        nonlocal sides, result
        sides, result = np.vstack([sides, others]), np.vstack([result, measured(others)])
        return sides[np.argmax(result[:, what])]

    downhill, forces = slopes(gravity) if tilt else NO_DIRECTION, pushes(gravity) if push else NO_DIRECTION
    directions = downhill.with_each(forces)
    sides, result = directions.sides, measured(directions.sides)
    for what in (0, 1) if tilt or push else ():
        directions.search(add, sides[np.argmax(result[:, what])])
    GN, GT, force, margin = np.max(result, axis=0)
    use = np.fmax(*np.nan_to_num(result[:, :2], nan=np.inf).T)
    worst = sides[int(np.argmax(use))].tolist()
    tips = robot.tip_over.reference_moment is not None
    return LoadCase(
        name, float(payload), float(tilt), float(push), float(GN), float(GT), float(-force),
        bool(np.all(use < 1)), tuple(worst[:3]), tuple(worst[3:]), float(-margin) if tips else None,
    )  # fmt: skip


def contact_test(footing: Footing) -> Callable[[np.ndarray], np.ndarray]:
    """Says of wrenches (N, 6) whether no contact is lost, (N,); what half spaces prove is not solved."""
    held = footing.slip.half_spaces(1.0)

    def stands(wrenches: np.ndarray) -> np.ndarray:
        states = footing.contact_states(wrenches)
        good = footing.tip_over.evaluate(states).GN < 1
        left = np.flatnonzero(good if held is None else good & ~_inside(held, states))
        good[left] = footing.slip.evaluate(states.select(left), derivatives=False).GT < 1
        return good

    return stands


def _slips(robot: Robot, states: ContactStates) -> np.ndarray:
    """(N,) GT; -inf of states of which half spaces prove that it is below the largest."""
    scalars = np.full(len(states), -np.inf)

    def solve(rows: np.ndarray) -> None:
        scalars[rows] = robot.slip.evaluate(states.select(rows), derivatives=False).GT

    first = ~states.persistent
    first[np.argmax(np.where(first, -np.inf, _steepness(robot, states.wrenches)))] = True
    solve(np.flatnonzero(first))
    for most in (AT_ONCE, len(states)):
        held = robot.slip.half_spaces(float(np.max(scalars[states.persistent], initial=0.0)))
        left = np.isneginf(scalars)
        if held is None:
            solve(np.flatnonzero(left))
            break
        left &= ~_inside(held, states)
        worst = np.argsort(-np.where(left, np.max(states.wrenches @ held.T, axis=1), -np.inf))
        solve(worst[: min(most, int(left.sum()))])
    return scalars


def _inside(held: np.ndarray, states: ContactStates) -> np.ndarray:
    """(N,) True of states that stand, and well inside these half spaces (m, 6)."""
    return states.persistent & np.all(states.wrenches @ held.T < 0, axis=1)


def _steepness(robot: Robot, wrenches: np.ndarray) -> np.ndarray:
    """(N,) tangent of the force's angle to the mean normal of the contacts."""
    normal = robot.support.frames[:, :, 0].mean(axis=0)
    normal = normal / max(float(np.linalg.norm(normal)), 1e-300)
    down = -wrenches[:, :3] @ normal
    across = np.linalg.norm(wrenches[:, :3] + down[:, None] * normal, axis=1)
    return across / np.maximum(down, 1e-300)


def largest_levels(stands: Callable[[np.ndarray], np.ndarray], most: np.ndarray) -> np.ndarray:
    """The largest levels (N,) up to `most` below which all stand, by bisection; 0 where nothing stands."""
    low, _ = borders(stands, np.zeros_like(most), most, HALVINGS)
    low = np.where(stands(most), most, low)
    return np.where(stands(np.zeros_like(most)), low, 0.0)
