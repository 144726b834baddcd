"""Worlds within a tolerance: random ones, corners, and those that are named the worst."""

from __future__ import annotations

import numpy as np

from ocptip.standing.arm import Robot
from ocptip.standing.simulation.world import World
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.deviations import Deviations
from ocptip.standing.within.late_joints import jump_states, on_time
from ocptip.standing.within.worst_case import worst_case_of
from ocptip.trajectories.trajectory import Trajectory

INSTANTS = 400
EXACT = 60  # instants that are looked at exactly, those with the least estimated moments
JUST = 1e-5  # s


def random_world(robot: Robot, tolerance: Uncertainty, rng: np.random.Generator, corner: bool) -> World:
    """A world within a tolerance without pushes; of a corner everything is at an end."""

    def share(size: tuple[int, ...] = ()) -> np.ndarray:
        """-1 to 1."""
        return rng.choice([-1.0, 1.0], size) if corner else rng.uniform(-1, 1, size)

    factors = [1 + tolerance.arm_mass * share() for _ in range(robot.arm.links)]
    low, high = tolerance.masses(robot.support.mass)[0], tolerance.masses(robot.support.mass)[-1]
    base = (low + high + (high - low) * share()) / 2 / robot.support.mass
    loads = bool(robot.without_objects().payload) + len(robot.carried)
    held = [1 + tolerance.payload_mass * share() for _ in range(loads)]
    shifts = [np.array(tolerance.payload_center) * share((3,)) for _ in robot.carried]
    return World(
        tilt=float(tolerance.tilt * (1 if corner else rng.random())),
        downhill=float(rng.uniform(-np.pi, np.pi)),
        payload=float(tolerance.extra_mass * (1 + share()) / 2),
        friction=float(1 - tolerance.friction * (1 + share()) / 2),
        speed=float(1 + tolerance.speed * share()),
        masses=tuple(float(f) for f in (base, *factors, *held)),
        late=tuple(float(x) for x in tolerance.delay * (1 + share((robot.n,))) / 2),
        shifts=tuple(map(tuple, np.array(shifts).tolist())),
    )


def worst_worlds(
    robot: Robot,
    motion: Trajectory,
    tolerance: Uncertainty,
    interface: int = 0,
    instants: int = INSTANTS,
    exact: int = EXACT,
) -> dict[str, tuple[World, str, float]]:
    """The worlds of the least moment about a tipping axis, N m, and of the greatest GT; name and value.

    Without pushes, of one of the robot's `interfaces`.
    """
    cases = worst_case_of(robot, tolerance, interface)
    looked = on_time(motion, tolerance, np.linspace(0, motion.end, instants))
    looked = looked.joined(jump_states(motion, tolerance))
    s, times, max_delay = looked.s, looked.times, looked.max_delay
    estimated = cases.estimated_moments(s, max_delay)
    rows, axes = np.unravel_index(np.argsort(estimated, axis=None)[:exact], estimated.shape)
    tip = cases.moments(s[rows], axes, max_delay=max_delay[rows])
    k = int(np.argmin(tip.values))
    found = {"tips": (rows[k], tip.theta[k], tip.values[k])}
    rows = np.argsort(-cases.estimated_slip(s, max_delay))[:exact]
    slip = cases.slip(s[rows], max_delay=max_delay[rows])
    k = int(np.argmax(slip.values))
    found["slips"] = (rows[k], slip.theta[k], slip.values[k])
    worlds = {}
    for name, (row, theta, value) in found.items():
        time = float(times[row])
        words = f"{cases.deviations.words(theta)}, at {time:.3f} s"
        worlds[name] = _world(cases.deviations, motion, s[row], time, theta), words, float(value)
    return worlds


def _world(own: Deviations, motion: Trajectory, state: np.ndarray, time: float, theta: np.ndarray) -> World:
    """Deviations as a world; joints that have not jumped yet at a state near an event are late."""
    robot, tolerance, n = own.robot, own.tolerance, own.robot.n
    before, after = (motion.states(np.array([time + side]))[2][0] for side in (-JUST, JUST))
    jumped = np.abs(after - before) > 1e-6
    late = jumped & (np.abs(state[2 * n :] - before) < np.abs(state[2 * n :] - after))
    part = {name: theta[at] for name, at in own.places.items()}
    late |= part.get("delay", np.zeros(n)) > 0
    gravity, change = robot.support.gravity, part.get("gravity", np.zeros(3))
    down, tilted = (x / np.linalg.norm(x) for x in (gravity, gravity + change))
    factors = [1 + part.get("base_mass", np.zeros(1)), 1 + part.get("arm_mass", np.zeros(robot.arm.links))]
    shares, shifts = part.get("payload_mass", np.zeros(1)), np.zeros((len(robot.carried), 3))
    if (carried := own.carried) is None:  # the base takes objects on the gripper as a part of the payload
        factors.append(1 + np.full(bool(robot.without_objects().payload) + len(robot.carried), shares[0]))
    else:
        of_object = dict(zip(carried.bodies, 1 + shares, strict=True))
        names = [one.object.name for one in robot.carried]
        factors.append(np.ones(int(bool(robot.without_objects().payload))))
        factors.append(np.array([of_object.get(name, 1.0) for name in names]))
        rows = [names.index(name) for name in carried.bodies]
        shifts[rows] = part.get("payload_center", np.zeros(3 * len(rows))).reshape(-1, 3)
    return World(
        tilt=float(np.arctan2(np.linalg.norm(np.cross(down, tilted)), down @ tilted)),
        downhill=float(np.arctan2(change[1], change[0])),
        payload=float(part.get("extra_mass", np.zeros(1))[0]),
        friction=1 - tolerance.friction,
        speed=float(np.sqrt(1 + part.get("speed", np.zeros(1))[0])),
        masses=tuple(np.concatenate(factors).tolist()),
        late=tuple(np.where(late, tolerance.delay, 0.0).tolist()),
        shifts=tuple(map(tuple, shifts.tolist())),
    )
