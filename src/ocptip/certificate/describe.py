"""A robot on its support, and a motion, as the plain data of a certificate."""

from __future__ import annotations

from collections.abc import Mapping
from math import factorial
from typing import Any

import casadi as cs
import numpy as np
from numpy.polynomial import chebyshev

from ocptip.certificate.trusted.arm import PROCESS, SPRINGS, TIMES
from ocptip.certificate.trusted.plain import DECELERATIONS, DRIVE_SPEED, POINTS, SPRING_SHARE, VELOCITIES
from ocptip.contact.support import Support
from ocptip.numerics.jit.tape import instruction_name
from ocptip.robots.collision.gaps import Collisions
from ocptip.robots.collision.model import ShapeCollisions
from ocptip.robots.collision.shapes import HalfSpace, Shape
from ocptip.robots.dynamics import process_parts
from ocptip.robots.geometry import CollisionModel, Floor, sphere_centres
from ocptip.robots.kinematics import TCP, joint_names, link_frames
from ocptip.standing.arm import Robot
from ocptip.standing.footing import Footing
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.stops.by_cancel import Cancel
from ocptip.standing.tolerance import Uncertainty
from ocptip.trajectories.drive_profile import DriveProfile
from ocptip.trajectories.pieces import MERGE
from ocptip.trajectories.trajectory import Trajectory

_ALIKE = 1e-6  # of accelerations
_STILL = 1e-13  # m/s or rad/s: less is rounding
_HALVED, _MOST = 6, 4000  # times pieces are halved that bend too much; pieces of a motion
_ARM = "rotations offsets masses centres inertias slides armature mount_position mount_rotation"
_LIMITS = "angle_min angle_max speed acceleration torque"


def motion_data(motion: Trajectory, profile: DriveProfile | None = None) -> dict[str, Any]:
    """Pieces of a motion: between its switching times, and the rest before and after it.

    Of each piece `times`, (2,), s, and `angles`, (n, 6): coefficients of 1, u, u^2 ... with u from -1 to 1
    over the piece, rad or m. They are those of the motion, moved to the middle of the piece: exact up to
    rounding for polynomials of degree 5. Pieces of higher degree are cut until they are as near to such ones
    as `unlike` wants them, if few halvings are enough. Switching times within 0.1 us are one, so a joint's
    polynomial may end as much before its piece. While the base drives a profile, pieces end where those of
    its velocities do, and the motion ends when both rest.
    """
    ends = motion.intervals if profile is None else _cut(motion, profile)
    angles, off = _polynomials(motion, ends)
    for _ in range(_HALVED):
        short = off > _least_difference(motion)
        if not short.any() or len(ends) + np.count_nonzero(short) > _MOST:
            break
        middle = ends[short].mean(axis=1)
        left, right = np.append(ends[:, 0], middle), np.append(ends[:, 1], middle)
        ends = np.column_stack([np.sort(left), np.sort(right)])
        angles, off = _polynomials(motion, ends)
    rest = np.zeros((2, *angles.shape[1:]))
    rest[:, :, 0] = motion.start, motion.goal
    outside = np.array([[0.0, 0.0], [ends[-1, 1], ends[-1, 1]]])
    return {
        **({} if profile is None else {VELOCITIES: _velocities(profile, ends).tolist()}),
        "times": np.concatenate([outside[:1], ends, outside[1:]]).tolist(),
        "angles": np.concatenate([rest[:1], angles, rest[1:]]).tolist(),
    }


def _cut(motion: Trajectory, profile: DriveProfile) -> np.ndarray:
    """(pieces, 2), s: intervals of a motion, cut where pieces of a profile end, to the end of both."""
    breaks, end = profile.velocities.breaks, max(motion.end, profile.end)
    every = np.unique(np.concatenate([np.ravel(motion.intervals), [0.0, end], breaks]))
    every = every[np.append(True, np.diff(every) > MERGE)]
    every[-1] = end  # the last of those that are merged
    return np.column_stack([every[:-1], every[1:]])


def _velocities(profile: DriveProfile, ends: np.ndarray) -> np.ndarray:
    """(pieces + 2, 3, degrees): coefficients in u of the base's velocities, with those before and after."""
    middle, half = ends.mean(axis=1), 0.5 * np.diff(ends, axis=1)
    orders = range(len(profile.velocities.derivatives))
    values = profile.velocities.at(middle, orders)
    c = np.stack([value * half**k / factorial(k) for k, value in zip(orders, values, strict=True)], axis=-1)
    c[np.abs(c) < _STILL] = 0.0
    rest = np.zeros((2, *c.shape[1:]))
    for row, side in ((rest[0], 0.0), (rest[1], profile.end)):
        row[:, 0] = profile.velocities.at([side], range(1), "left" if side == 0.0 else "right")[0][0]
    return np.concatenate([rest[:1], c, rest[1:]])


def _polynomials(motion: Trajectory, intervals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients (pieces, n, 6) in these intervals (pieces, 2), s, and by how much accelerations are off.

    What is of higher degree than 5 is cut from the Chebyshev series of the accelerations, whose terms are at
    most their coefficients: their sum bounds the difference, (pieces,), rad/s^2 or m/s^2.
    """
    middle, half = intervals.mean(axis=1), 0.5 * np.diff(intervals, axis=1)
    orders = np.arange(max(len(part.derivatives) for part in motion.pieces))
    values = [motion(middle, k) * half**k / factorial(k) for k in range(len(orders))]
    c = np.zeros((*values[0].shape, max(len(orders), 6)))
    c[:, :, : len(orders)] = np.stack(values, axis=-1)
    if len(orders) <= 6:
        return c, np.zeros(len(c))
    factors = orders[2:] * (orders[2:] - 1.0)
    rows = [chebyshev.poly2cheb(row) for row in np.eye(len(factors))]  # of the powers, as series
    to_series = np.array([np.pad(row, (0, len(factors) - len(row))) for row in rows])
    series = (c[:, :, 2:] * factors) @ to_series
    off = np.sum(np.abs(series[:, :, 4:]), axis=2) / half**2
    c[:, :, 2:6] = series[:, :, :4] @ np.linalg.inv(to_series[:4, :4]) / factors[:4]
    return c[:, :, :6], np.max(off, axis=1)


def _least_difference(motion: Trajectory) -> float:
    """Accelerations of pieces that differ by less are those of the motion, rad/s^2 or m/s^2."""
    return _ALIKE * max(1.0, float(np.max(motion.acceleration_peaks)))


def unlike(motion: Trajectory, data: dict[str, Any]) -> str:
    """Why pieces of a motion do not say what it does; empty if they do."""
    ends = np.array(data["times"])[1:-1]
    off = _polynomials(motion, ends)[1]
    k = int(np.argmax(off))
    if off[k] <= _least_difference(motion):
        return ""
    return (
        f"the motion is no polynomial of time of degree 5 in {len(off)} pieces: by {off[k]:.2g} rad or m/s^2 "
        f"near {np.mean(ends[k]):.4g} s; what a controller runs of it can be proved"
    )


def states_at(
    motion: dict[str, Any], piece: np.ndarray, u: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coordinates, speeds and accelerations, (N, n) each, of such data at u (N,) of pieces (N,)."""
    c, times = np.array(motion["angles"])[piece], np.array(motion["times"])[piece]
    half = 0.5 * (times[:, 1] - times[:, 0])
    rate = np.where(half > 0, 1 / np.where(half > 0, half, 1.0), 0.0)[:, None]
    values = []
    for order in range(3):
        powers = u[:, None] ** np.arange(c.shape[2])
        values.append(np.einsum("Nnk,Nk->Nn", c, powers) * rate**order)
        c = c[:, :, 1:] * np.arange(1, c.shape[2])
    q, qd, qdd = values
    return q, qd, qdd


def model_data(
    robot: StandingMechanism, end: float | None = None, cancel: Cancel | None = None
) -> dict[str, Any]:
    """Arm or program, base, contacts, what may collide, limits; SI units, base axes.

    A process that varies has to vary over time, see `StandingMechanism.during`. Of a motion that ends, s, it
    is at rest before and after it what it is at its ends. `cancel` is how its controller stops, if cancels
    are proved.
    """
    support = robot.support
    if robot.arm is None:
        arm_data = {"arm": None, "program": _program_data(robot), "payload": None}
        bodies, pairs, points = [], [], []
    else:
        arm = Robot.of(robot)
        arm_data, (bodies, pairs), points = _arm_data(arm, end), _bodies(arm), _points(arm)
    held = contacts_data(robot)
    if robot.acts.end:
        held["base"]["inertia"] = support.inertia.tolist()
    return {
        **arm_data,
        **held,
        "limits": {key: [_finite(x) for x in getattr(robot.limits, key)] for key in _LIMITS.split()},
        "bodies": bodies,
        "pairs": pairs,
        **({POINTS: points} if points else {}),
        **({DECELERATIONS: list(cancel.decelerations)} if cancel else {}),
    }


def contacts_data(footing: Footing) -> dict[str, Any]:
    """What stands on contacts, the base or an object, and these, as parts of a model."""
    support = footing.support
    return {
        "base": {
            "mass": float(support.mass),
            "center_of_mass": support.center_of_mass.tolist(),
            "gravity": support.gravity.tolist(),
            "reference_moment": footing.tip_over.reference_moment,
        },
        "contacts": {
            "positions": (support.arms + support.center_of_mass).tolist(),
            "frames": support.frames.tolist(),
            "sets": [
                [
                    [*map(_finite, (p.normal_min, p.normal_max)), float(p.radius), float(p.slope)]
                    for p in pieces
                ]
                for pieces in (contact.force_pieces() for contact in support.contacts)
            ],
        },
    }


def _points(robot: Robot) -> list[dict[str, Any]]:
    """Points of an arm whose speeds are limited: link, place in its frame, limit in m/s."""
    names, none = joint_names(robot.arm), np.zeros(3)
    places = {name: (k + 1, none) for k, name in enumerate(names)}
    places[TCP] = len(names), robot.arm.offsets[-1]
    return [
        {"link": places[name][0], "place": places[name][1].tolist(), "speed": float(limit)}
        for name, limit in robot.speed_limits.items()
    ]


def _arm_data(robot: Robot, end: float | None) -> dict[str, Any]:
    arm = robot.arm
    coupling, held = arm.coupling, None
    if (payload := robot.payload) is not None:
        mass, center, inertia = payload.seen_from(arm.tool_rotation, arm.offsets[-1])
        parts = {"center": center, "inertia": inertia, "axes": arm.tool_rotation}
        held = {"mass": float(mass), **{key: np.asarray(part).tolist() for key, part in parts.items()}}
    data = {
        **{key: np.asarray(getattr(arm, key), dtype=float).tolist() for key in _ARM.split()},
        "ratios": (np.eye(arm.n) if coupling is None else coupling.matrix).tolist(),
        "shift": (np.zeros(arm.n) if coupling is None else coupling.offsets).tolist(),
    }
    if arm.has_springs:
        data.update({key: getattr(arm, key).tolist() for key in SPRINGS})
    if (varying := robot.varying) is None:
        parts = process_parts(arm)
    else:
        varying = varying if end is None else varying.between(0.0, end)
        times = np.asarray(varying.knots)
        none = np.zeros((len(times), 6))
        wrench_rows, turn = np.hstack([varying.force, varying.moment]), arm.tool_rotation.T
        on_link = np.hstack([part @ turn for part in np.hsplit(wrench_rows, 2)])
        parts = (none, on_link) if varying.turns_with_tool else (wrench_rows, none)
        data[TIMES] = times.tolist()
    data.update({key: part.tolist() for key, part in zip(PROCESS, parts, strict=True)})
    return {"arm": data, "payload": held}  # the payload is a part of the last link


def _program_data(robot: StandingMechanism) -> dict[str, Any]:
    """Motor forces, the wrench without the base's weight and further quantities, as instructions.

    CasADi's say in which places they find what they take; here they say the numbers of results.
    """
    state = [cs.SX.sym(name, robot.n) for name in ("q", "qd", "qdd")]
    forces, wrench = robot.load_expressions(*state)
    further = robot.further_expressions(*state[:2])
    outputs = [forces, wrench - cs.DM(robot.support.weight), further]
    function = cs.Function("program", [cs.vertcat(*state)], [cs.densify(cs.vertcat(*cs.cse(outputs)))])
    code: list[list[Any]] = []
    placing, results = {}, [0] * function.numel_out(0)
    for k in range(function.n_instructions()):
        name = instruction_name(function.instruction_id(k))
        taken, given = function.instruction_input(k), function.instruction_output(k)
        if name == "OUTPUT":
            results[given[1]] = placing[taken[0]]
            continue
        if name == "CONST":
            row = [float(function.instruction_constant(k)), 0]
        elif name == "INPUT":
            row = [taken[1], 0]
        else:
            row = [placing[taken[0]], placing[taken[-1]]]
        placing[given[0]] = len(code)
        code.append([name, *row])
    limits = robot.further_limits
    ends = {key: [_finite(x) for x in getattr(limits, key)] for key in ("lower", "upper")}
    return {"code": code, "outputs": results, **ends}


def tolerance_data(tolerance: Uncertainty, support: Support) -> dict[str, Any]:
    """How far the world may be off: SI units, masses relative."""
    mass = np.array(tolerance.masses(support.mass)) / support.mass - 1
    return {
        "base_mass": [float(mass[0]), float(mass[-1])],
        "center_of_mass": list(map(float, tolerance.center_of_mass)),
        "payload_center": list(map(float, tolerance.payload_center)),
        **{name: float(getattr(tolerance, name)) for name in _SHARES_AND_SIZES},
        **({SPRING_SHARE: float(tolerance.springs)} if tolerance.springs else {}),
        **({DRIVE_SPEED: float(tolerance.drive_speed)} if tolerance.drive_speed else {}),
    }


def drive_words(motion: Mapping[str, Any]) -> str:
    """How the base drives during the motion of a certificate, in words; "" where it rests."""
    if VELOCITIES not in motion:
        return ""
    times, c = np.array(motion["times"])[1:-1], np.array(motion[VELOCITIES])[1:-1]
    u = np.linspace(-1, 1, 21)[:, None] ** np.arange(c.shape[2])
    v, rate = (
        c @ u.T,
        (c[:, :, 1:] * np.arange(1, c.shape[2])) @ u[:, :-1].T / (0.5 * np.diff(times))[:, :, None],
    )
    most = [float(np.max(np.hypot(x[:, 0], x[:, 1]))) for x in (v, rate)]
    return (
        f"drives {times[-1, 1]:.4g} s, up to {most[0]:.3g} m/s and {np.max(np.abs(v[:, 2])):.3g} rad/s, "
        f"speeds change by up to {most[1]:.3g} m/s^2"
    )


def tolerance_words(data: Mapping[str, Any]) -> str:
    """The tolerance of a certificate in words."""
    low, high = data["base_mass"]
    even = abs(low + high) <= 1e-9 * (high - low)
    swing = np.log(data["overshoot"]) if data["overshoot"] else None
    uncertainty = Uncertainty(
        base_mass=float(high) if even else 0.0,
        center_of_mass=data["center_of_mass"],
        payload_center=data["payload_center"],
        damping=None if swing is None else float(-swing / np.hypot(np.pi, swing)),
        springs=data.get(SPRING_SHARE, 0.0),
        drive_speed=data.get(DRIVE_SPEED, 0.0),
        **{name: data[name] for name in _SHARES_AND_SIZES if name != "overshoot"},
    )
    uneven = [] if even else [f"base mass {100 * low:+.3g} to {100 * high:+.3g} %"]
    return ", ".join([*uneven, *uncertainty.lines()]) or "none"


_SHARES_AND_SIZES = (
    *("friction", "tilt", "arm_mass", "payload_mass", "extra_mass", "delay", "speed"),
    *("push", "base_push", "overshoot"),
)


class Separations:
    """Directions that separate pairs of bodies best.

    Args:
        collision: of the arm.
        model: made of it.
    """

    def __init__(self, robot: Robot, model: dict[str, Any]) -> None:
        self._collision, self._bodies, self._pairs = robot.collision, model["bodies"], model["pairs"]
        self._arm = robot.arm
        self._centres = sphere_centres(robot.arm) if isinstance(self._collision, CollisionModel) else None

    def __call__(self, q: np.ndarray, pairs: np.ndarray) -> np.ndarray:
        """(R, 4), from the first of each pair to the second, at q (R, n): 1 and in axes of the first's link,
        or, if both are balls or the second rests, 0 and in base axes."""
        every = link_frames(self._arm, q).rotations
        rest = {-1: np.eye(3), 0: self._arm.mount_rotation}
        links = [self._bodies[self._pairs[pair][0]]["link"] for pair in pairs]
        axes = [every[r, link - 1] if link > 0 else rest[link] for r, link in enumerate(links)]
        towards = self._towards(q, pairs)
        linked = np.array([self._linked(*self._pairs[pair]) for pair in pairs])
        turned = np.einsum("rab,ra->rb", np.array(axes), towards)
        return np.column_stack([linked, np.where(linked[:, None], turned, towards)])

    def _linked(self, first: int, second: int) -> bool:
        one, other = self._bodies[first], self._bodies[second]
        return other["link"] > 0 and len(one["points"]) + len(other["points"]) > 2

    def _towards(self, q: np.ndarray, pairs: np.ndarray) -> np.ndarray:
        """Directions (R, 3) from the first of each pair to the second, at q (R, n), base axes."""
        if isinstance(self._collision, ShapeCollisions):
            return self._collision.distances.at(q, np.arange(len(q)), pairs)[0].normals
        assert self._centres is not None  # the other kind
        places = np.array(self._centres.map(len(q))(q.T)).reshape(3, len(q), -1)
        values = np.empty((len(q), 3))
        for r, pair in enumerate(pairs):
            first, second = self._pairs[pair]
            here, body = places[:, r, first], self._bodies[second]
            if body["link"] >= 0:
                there = places[:, r, second]
            else:  # nearest point of a line, or of a single point
                ends = np.array(body["points"])
                way = ends[-1] - ends[0]
                share = way @ (here - ends[0]) / max(way @ way, 1e-30)
                there = ends[0] + np.clip(share, 0, 1) * way
            values[r] = there - here
        return values


def _bodies(robot: Robot) -> tuple[list[dict[str, Any]], list[list[int]]]:
    """Solids (thickened points on a link, 0: the mount, -1: the base; or half spaces), and pairs of them."""
    collision: Collisions = robot.collision
    if isinstance(collision, ShapeCollisions):
        bodies = [_body(body + 1 if body >= 0 else -1, shape) for _, body, shape in collision.solids]
        return bodies, [[int(a), int(b)] for a, b in collision.pairs]
    if not isinstance(collision, CollisionModel):
        return [], []
    bodies, number = [], {}
    for spheres in robot.arm.sphere_sets:
        number[spheres.name] = range(len(bodies), len(bodies) + len(spheres.radii))
        for centre, radius in zip(spheres.centres, spheres.radii, strict=True):
            bodies.append({"link": int(spheres.link), "points": [centre.tolist()], "radius": float(radius)})
    pairs = []
    for obstacle in robot.around:
        names = robot.arm.floor_sets if isinstance(obstacle, Floor) else robot.arm.obstacle_sets
        pairs += [[k, len(bodies)] for name in names for k in number[name]]
        bodies.append(_body(-1, obstacle.shape))
    pairs += [
        [a, b] for first, second in robot.arm.collision_pairs for a in number[first] for b in number[second]
    ]
    return bodies, pairs


def _body(link: int, shape: Shape) -> dict[str, Any]:
    if isinstance(shape, HalfSpace):
        return {"normal": np.asarray(shape.normal, dtype=float).tolist(), "level": float(shape.distance)}
    return {"link": int(link), "points": shape.outline().tolist(), "radius": float(shape.thickness)}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
