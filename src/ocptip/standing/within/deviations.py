"""The wrench on the base of an arm as a function of its state and of the deviations from the nominal model.

Deviations theta are numbers that are zero for the nominal model: masses, gravity (a tilted floor), delays of
the joints and so on. Most of them enter the wrench linearly. So what is worst for an affine functional of the
wrench is, up to products of small numbers, the sum of closed forms: an end of every interval, the edge of the
cap of gravity, the push along the gradient. Products count because the wrench is evaluated there, and the
choice repeated.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property, lru_cache

import casadi as cs
import numpy as np

from ocptip.basics.text import numbered, towards
from ocptip.numerics.batch import BatchFunction
from ocptip.robots.base_motion import acceleration_of, inertial_wrench_of
from ocptip.robots.dynamics import newton_euler
from ocptip.robots.kinematics import chain
from ocptip.standing.arm import Robot
from ocptip.standing.objects import carrier_expressions
from ocptip.standing.tolerance import Uncertainty

_NOTHING = 1e-12  # relative to the largest: slopes below this choose nothing


class Deviations:
    """The deviations theta of an arm on its base, or of what it carries, from the nominal data.

    Args:
        robot: on its base.
        tolerance: of it.
        interface: of the robot's `interfaces`, whose wrench it is; 0: the base. Every body of an object's
            interface is as uncertain as a payload.

    Attributes:
        low, high: (size,) ends of those that are intervals; zero for tilts and pushes.
        intervals: numbers of those that are intervals.
        places: slices of theta by name.
        carried: the object of an interface other than the base.
        tilt: rad, of the floor, one or of N states (N, 1).
    """

    def __init__(self, robot: Robot, tolerance: Uncertainty, interface: int = 0) -> None:
        self.robot, self.carried = robot, robot.carried[interface - 1] if interface else None
        self.places: dict[str, slice] = {}
        for name, (least, _) in self._ends(tolerance).items():
            self.places[name] = slice(self.size, self.size + len(least))
        self._set(tolerance)

    @property
    def size(self) -> int:
        """Number of deviations."""
        return max((place.stop for place in self.places.values()), default=0)

    def within(self, tolerance: Uncertainty) -> Deviations:
        """The deviations within another uncertainty, of at most these quantities; nothing is rebuilt."""
        other = copy(self)
        other._set(tolerance)
        return other

    def loaded(self, factors: np.ndarray) -> Deviations:
        """The same of N states whose payload has its mass times factors (N,), which is then nominal."""
        _ = self.wrench, self._first  # made once, they serve all copies
        other, place = copy(self), self.places["payload_mass"]
        other._nominal = np.zeros((len(factors), self.size))
        other._nominal[:, place] = factors[:, None] - 1
        ends = [np.tile(end, (len(factors), 1)) for end in (self.low, self.high)]
        for end in ends:
            end[:, place] = factors[:, None] * (1 + end[:, place]) - 1
        other.low, other.high = ends
        return other

    def on_slopes(self, gravity: np.ndarray) -> Deviations:
        """The same of N states of a base that drives, with gravity (N, 3), m/s^2, which is then nominal."""
        _ = self.wrench, self._first  # made once, they serve all copies
        other = copy(self)
        other._gravity, other._nominal = gravity, np.zeros((len(gravity), self.size))
        other._nominal[:, self.places["gravity"]] = gravity - self.robot.support.gravity
        return other

    def tilted(self, more: np.ndarray) -> Deviations:
        """The same of N states whose floor may have a further tilt (N,), rad."""
        _ = self.wrench, self._first  # made once, they serve all copies
        other = copy(self)
        other.tilt = self.tolerance.tilt + more[:, None]
        return other

    def some(self, rows: np.ndarray) -> Deviations:
        """The same of some of the N states of `loaded` or `moving`; nothing else is of certain states."""
        if self._nominal is None:
            return self
        other = copy(self)
        other._nominal = self._nominal[rows]
        if self.low.ndim > 1:
            other.low, other.high = self.low[rows], self.high[rows]
        if self._gravity.ndim > 1:
            other._gravity = self._gravity[rows]
        return other

    def nominal(self, count: int) -> np.ndarray:
        """Deviations (count, size) of nominal states: zero but for payloads and slopes."""
        return np.zeros((count, self.size)) if self._nominal is None else self._nominal.copy()

    def _set(self, tolerance: Uncertainty) -> None:
        held = self.carried or self.robot.payload
        self.tolerance, ends = tolerance.of(held), self._ends(tolerance)
        self._nominal: np.ndarray | None = None
        self._gravity: np.ndarray = self.robot.support.gravity
        self.tilt: np.ndarray = np.full((1, 1), self.tolerance.tilt)
        self.low, self.high = np.zeros(self.size), np.zeros(self.size)
        for name, place in self.places.items():
            if name in ends:
                self.low[place], self.high[place] = ends[name]
        intervals = [place for name, place in self.places.items() if name not in _FREE]
        self.intervals = np.array(
            [i for place in intervals for i in range(place.start, place.stop)], dtype=int
        )

    def _ends(self, uncertainty: Uncertainty) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Ends of the intervals of what is uncertain; zeros for tilts and pushes."""
        robot, payload = self.robot, self.robot.payload
        mass = np.array(uncertainty.masses(robot.support.mass)) / robot.support.mass - 1
        links, held = (
            np.full(len(robot.arm.masses), uncertainty.arm_mass),
            np.full(1, uncertainty.payload_mass),
        )
        base, inside = np.asarray(uncertainty.center_of_mass), np.asarray(uncertainty.payload_center)
        pace, late = (1 + np.array([-1, 1]) * uncertainty.speed) ** 2 - 1, uncertainty.late
        ends = {
            "base_mass": (mass[:1], mass[-1:]),
            "arm_mass": (-links, links),
            **({"payload_mass": (-held, held), "payload_center": (-inside, inside)} if payload else {}),
            "extra_mass": (np.zeros(1), np.full(1, uncertainty.extra_mass)),
            "center_of_mass": (-base, base),
            "speed": (pace[:1], pace[1:]),
            "delay": (np.zeros(robot.n), np.full(robot.n, late)),
        }
        if self.carried:
            count = len(self.carried.bodies)
            bodies, inside = np.full(count, uncertainty.payload_mass), np.tile(inside, count)
            ends = {"payload_mass": (-bodies, bodies), "payload_center": (-inside, inside)} | {
                name: ends[name] for name in ("speed", "delay")
            }
        if robot.drive_profile is not None:
            ends["drive_speed"] = tuple(
                np.array([(1 + k * uncertainty.drive_speed) ** 2 - 1]) for k in (-1, 1)
            )
        table = {
            name: pair
            for name, pair in ends.items()
            if np.any(pair) or name == "extra_mass" or (self.carried and name == "payload_mass")
        }  # one at least
        pushes = {} if self.carried else {"push": uncertainty.push, "base_push": uncertainty.base_push}
        sizes = {"gravity": uncertainty.tilt, **pushes}
        sizes["gravity"] += robot.drive_profile is not None  # see `on_slopes`
        return table | {name: (np.zeros(3), np.zeros(3)) for name, size in sizes.items() if size}

    # --- physics ------------------------------------------------------------------------------------------

    @cached_property
    def _expressions(self) -> tuple[cs.SX, cs.SX, cs.SX]:
        """State s (3 n,), with what acts (3 n + k,), deviations (size,), wrench (6,)."""
        robot, n = self.robot, self.robot.n
        size = 3 * n + robot.acts.size
        s, theta = cs.SX.sym("s", size), cs.SX.sym("theta", self.size)

        def part(name: str, size: int) -> cs.SX:
            return theta[self.places[name]] if name in self.places else cs.SX.zeros(size)

        support, gravity = robot.support, cs.SX(robot.support.gravity) + part("gravity", 3)
        q, qd, qdd, *acting = cs.vertsplit(s, sorted({0, n, 2 * n, 3 * n, size}))
        process, base = robot.acts.expressions(*acting or [None])
        rush = 1 + part("drive_speed", 1)  # speed of the base squared
        base = [part * scale for part, scale in zip(base, (rush, cs.sqrt(rush), rush), strict=bool(base))]
        late = part("delay", n)  # exact as long as the acceleration is constant
        q, qd = q - late * qd + late**2 / 2 * qdd, qd - late * qdd
        pace = 1 + part("speed", 1)  # speed squared
        qd, qdd = cs.sqrt(pace) * qd, pace * qdd
        if self.carried:
            motion = carrier_expressions(robot.arm, gravity, q, qd, qdd, base)[self.carried.carrier]
            count = len(self.carried.bodies)
            shares, shifts = part("payload_mass", count), part("payload_center", 3 * count)
            return s, theta, self.carried.deviated(motion, shares, shifts)
        arm = robot.arm.with_payload(None)
        bodies = []
        if (payload := robot.payload) is not None:
            factor, shift = 1 + part("payload_mass", 1), part("payload_center", 3)
            mass, centre, inertia = payload.seen_from(arm.tool_rotation, arm.offsets[-1])
            bodies.append((factor * mass, cs.SX(centre) + arm.tool_rotation @ shift, factor * cs.SX(inertia)))
        if "extra_mass" in self.places:
            bodies.append((part("extra_mass", 1), cs.SX(arm.offsets[-1]), np.zeros((3, 3))))
        arm, load = robot.acts.on_gripper_expressions(arm, q, process)
        pull = gravity - acceleration_of(base, cs.SX(arm.mount_position)) if base else gravity
        spin = dict(zip(("spin", "spin_change"), base[1:], strict=bool(base)))
        _, wrench = newton_euler(
            arm, q, qd, qdd, pull, *load, cs.SX(support.center_of_mass),
            scales=1 + part("arm_mass", len(arm.masses)), carried=bodies, **spin,
        )  # fmt: skip
        share, shift = 1 + part("base_mass", 1), part("center_of_mass", 3)
        # Both act at the base's centre of mass, wherever that is.
        force = support.mass * share * gravity + part("base_push", 3)
        wrench = wrench + cs.vertcat(force, cs.cross(shift, force))
        if base:
            wrench = wrench + inertial_wrench_of(base, support, share, shift)
        push, tool = part("push", 3), chain(arm, q)[1][-1] - cs.SX(support.center_of_mass)
        return s, theta, wrench + cs.vertcat(push, cs.cross(tool, push))

    @cached_property
    def wrench(self) -> BatchFunction:
        """Wrench (N, 6), N and N m about the centre of mass, of states and deviations (N, size)."""
        return BatchFunction(cs.Function("wrench", [*self._expressions[:2]], [self._expressions[2]]))

    def wrench_and_slopes(self, s: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The wrench (N, 6) of states and deviations, with slopes (N, 6, size) over the deviations."""
        wrenches, slopes = self._first(s, theta)
        return wrenches, slopes.reshape(len(s), 6, self.size)

    @cached_property
    def _first(self) -> BatchFunction:
        s, theta, w = self._expressions
        return BatchFunction(cs.Function("deviated", [s, theta], [w, cs.jacobian(w, theta)]))

    @cached_property
    def state_slopes(self) -> BatchFunction:
        """Slopes (N, 3 n) over the state of functionals a (N, 6) of the wrench: of states, deviations, a."""
        s, theta, w = self._expressions
        a = cs.SX.sym("a", 6)
        return BatchFunction(cs.Function("slopes", [s, theta, a], [cs.gradient(cs.dot(a, w), s)]))

    @cached_property
    def state_curvature(self) -> BatchFunction:
        """Second derivatives (N, 3 n, 3 n) of the same."""
        s, theta, w = self._expressions
        a = cs.SX.sym("a", 6)
        return BatchFunction(cs.Function("bend", [s, theta, a], [cs.hessian(cs.dot(a, w), s)[0]]))

    @cached_property
    def curvature(self) -> BatchFunction:
        """Second derivatives (N, size, size) of functionals a (N, 6) over the deviations."""
        s, theta, w = self._expressions
        a = cs.SX.sym("a", 6)
        return BatchFunction(cs.Function("products", [s, theta, a], [cs.hessian(cs.dot(a, w), theta)[0]]))

    # --- what is worst ------------------------------------------------------------------------------------

    def greatest(self, max_delay: np.ndarray | None) -> np.ndarray:
        """(size,) maximum deviations; (N, size) with (N, n), s, maximum delays of joints."""
        if max_delay is None or "delay" not in self.places:
            return self.high
        high = np.broadcast_to(self.high, (len(max_delay), self.size)).copy()
        high[:, self.places["delay"]] = max_delay
        return high

    def least(self, slopes: np.ndarray, max_delay: np.ndarray | None = None) -> np.ndarray:
        """Deviations (N, size) at which slopes (N, size) . theta is minimal; room as in `greatest`."""
        theta, intervals = self.nominal(len(slopes)), self.intervals
        low, high = self.low[..., intervals], self.greatest(max_delay)[..., intervals]
        size = np.maximum(np.abs(low - theta[:, intervals]), np.abs(high - theta[:, intervals]))
        change = np.abs(slopes[:, intervals]) * size
        # Deviations without influence stay nominal, so that reports name only those that matter.
        matters = change > _NOTHING * np.max(change, axis=1, initial=1e-300)[:, None]
        theta[:, intervals] = np.where(
            matters, np.where(slopes[:, intervals] > 0, low, high), theta[:, intervals]
        )
        for name, most in (("push", self.tolerance.push), ("base_push", self.tolerance.base_push)):
            if name in self.places:
                theta[:, self.places[name]] = -most * _unit(slopes[:, self.places[name]])
        if "gravity" in self.places:
            place = self.places["gravity"]
            theta[:, place] += least_tilt(slopes[:, place], self._gravity, self.tilt)
        return theta

    def missed(
        self, s: np.ndarray, theta: np.ndarray, a: np.ndarray, max_delay: np.ndarray | None = None
    ) -> np.ndarray:
        """(N,): by how much a . wrench may be less than at theta, at most, elsewhere within the tolerance.

        Zero where every slope at theta outweighs all products of deviations; these are taken up to second
        order. Of gravity and pushes along their edges what is of third order is left out.
        """
        slopes = np.einsum("nw,nwt->nt", a, self.wrench_and_slopes(s, theta)[1])
        bend = np.abs(self.curvature(s, theta, a)[0].reshape(len(s), self.size, self.size))
        span = np.broadcast_to(self.greatest(max_delay) - self.low, theta.shape).copy()
        for name, most in self.radii.items():
            span[:, self.places[name]] = 2 * most
        intervals = self.intervals
        inward = np.where(theta[:, intervals] <= self.low[intervals], 1.0, -1.0) * slopes[:, intervals]
        # Second derivatives over the whole span bound how much a slope can change, hence what another end may
        # gain.
        lost = 0.5 * np.einsum("nij,nj->ni", bend, span)
        rest = np.minimum(inward - lost[:, intervals], 0.0) * span[:, intervals]
        result = -np.sum(rest, axis=1)
        for name, most in self.radii.items():
            place = self.places[name]
            size = np.maximum(np.linalg.norm(slopes[:, place], axis=1), 1e-300)
            turn = np.linalg.norm(lost[:, place], axis=1)
            result += most * np.where(turn > 2 * size, 2 * (turn - size), turn**2 / (2 * size))
        return result

    @property
    def radii(self) -> dict[str, float]:
        tolerance, size = self.tolerance, float(np.linalg.norm(self.robot.support.gravity))
        radii = {"gravity": size * tolerance.tilt, "push": tolerance.push, "base_push": tolerance.base_push}
        return {name: most for name, most in radii.items() if name in self.places}

    @property
    def _bodies(self) -> tuple[str, ...]:
        """What is uncertain as a payload is, in words."""
        return tuple(self.carried.bodies) if self.carried else ("payload",)

    # --- words --------------------------------------------------------------------------------------------

    def words(self, theta: np.ndarray) -> str:
        """Deviations (size,) from a base at rest by name: "tilt 0.5 deg towards -y, payload +0.1 kg"."""
        results = []
        parts = {name: theta[place] for name, place in self.places.items()}
        if np.any(change := parts.get("gravity", np.zeros(3))):
            gravity = self.robot.support.gravity
            new = gravity + change
            angle = np.degrees(np.arctan2(np.linalg.norm(np.cross(gravity, new)), gravity @ new))
            down = gravity / np.linalg.norm(gravity)
            results.append(f"tilt {angle:.3g} deg {towards(change - (change @ down) * down)}")
        for name, word in _MASSES.items():
            shares = np.round(parts.get(name, np.zeros(0)), 9)
            for share in dict.fromkeys(shares[shares != 0].tolist()):
                off = np.flatnonzero(shares == share)
                which = numbered(word, off + 1) if len(shares) > 1 else word
                if name == "payload_mass":
                    which = ", ".join(self._bodies[k] for k in off)
                results.append(f"{which} {100 * share:+.3g} %")
        if np.any(mass := parts.get("extra_mass", np.zeros(1))):
            results.append(f"{float(mass[0]):.3g} kg more at the TCP")
        centers = {"base's": parts.get("center_of_mass", np.zeros(3))}
        shifts = parts.get("payload_center", np.zeros(3 * len(self._bodies))).reshape(-1, 3)
        centers |= {f"{name}'s": shift for name, shift in zip(self._bodies, shifts, strict=True)}
        for whose, shift in centers.items():
            moved = zip("xyz", shift, strict=True)
            results += [f"{whose} centre {1e3 * by:+.3g} mm in {axis}" for axis, by in moved if by]
        for name, who in (("speed", ""), ("drive_speed", "base ")):
            if np.any(pace := parts.get(name, np.zeros(1))):
                change = float(np.sqrt(1 + pace[0]) - 1)
                results.append(f"{who}{100 * abs(change):.3g} % {'faster' if change > 0 else 'slower'}")
        late = np.round(np.minimum(parts.get("delay", np.zeros(0)), self.tolerance.delay), 6)
        for delay in dict.fromkeys(late[late > 0].tolist()):
            joints = numbered("joint", np.flatnonzero(late == delay) + 1)
            results.append(f"{joints} delayed by {1e3 * delay:.3g} ms")
        for name, word in (("push", "gripper"), ("base_push", "base")):
            if np.any(force := parts.get(name, np.zeros(3))):
                results.append(f"push of {np.linalg.norm(force):.3g} N at the {word} {towards(force)}")
        if self.tolerance.friction:
            results.append(f"friction {-100 * self.tolerance.friction:.3g} %")
        return ", ".join(results)


_FREE = ("gravity", "push", "base_push")
_MASSES = {"base_mass": "base mass", "arm_mass": "link", "payload_mass": "payload"}


def least_tilt(b: np.ndarray, gravity: np.ndarray, tilt: float | np.ndarray) -> np.ndarray:
    """Changes (N, 3) of gravity (3,) or (N, 3) within a tilt, rad, or tilts (N, 1), that make
    b (N, 3) . gravity minimal."""
    size = np.linalg.norm(gravity, axis=-1, keepdims=True)
    down = gravity / np.maximum(size, 1e-300)
    wanted = -_unit(b)
    along = np.sum(wanted * down, axis=1)
    side = wanted - along[:, None] * down
    angle = np.minimum(np.arctan2(np.linalg.norm(side, axis=1), along)[:, None], tilt)
    return size * ((np.cos(angle) - 1) * down + np.sin(angle) * _unit(side))


def _unit(vectors: np.ndarray) -> np.ndarray:
    """(N, 3) of length one; zero where there is no direction."""
    size = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, size, out=np.zeros(vectors.shape), where=size > 0)


@lru_cache(maxsize=16)
def deviations_of(robot: Robot, tolerance: Uncertainty, interface: int = 0) -> Deviations:
    """Those of a robot, made once."""
    return Deviations(robot, tolerance, interface)
