"""A world inside the tolerance of a certificate, drawn at random and evaluated from its data alone.

What the checker encloses is evaluated here at one time, for one choice of everything that may be off, in ball
arithmetic (`arm_in_balls`), body by body: no forms, no closed forms, no code of the checker.
"""

from dataclasses import dataclass

import numpy as np
from flint import arb

from tests.oracles import arm_in_balls as balls

_PROCESS = ("process_in_base", "process_on_link")
_NO_JUMP = 1e-5  # of the largest: a smaller step is none


@dataclass
class World:
    """What is off: of one number for each, or (3,)."""

    links: np.ndarray
    payload: float
    shift: np.ndarray
    extra: float
    base: float
    centre: np.ndarray
    pace: float
    gravity: np.ndarray
    push: np.ndarray
    base_push: np.ndarray


def described(model):
    """The world as described."""
    zero, gravity = np.zeros(3), np.array(model["base"]["gravity"], dtype=float)
    links = np.ones(len(model["arm"]["masses"]))
    return World(links, 1.0, zero, 0.0, 1.0, zero, 1.0, gravity, zero, zero)


def random_world(model, tolerance, rng, ends=0.5):
    """One inside the tolerance; this share of its numbers at an end."""

    def number(low, high):
        return float(rng.choice([low, high]) if rng.random() < ends else rng.uniform(low, high))

    def within(half):
        return np.array([number(-abs(h), abs(h)) for h in half])

    def turned(gravity, angle):
        size, down = np.linalg.norm(gravity), gravity / max(np.linalg.norm(gravity), 1e-300)
        side = np.cross(down, rng.normal(size=3))
        side /= max(np.linalg.norm(side), 1e-300)
        return size * (np.cos(angle) * down + np.sin(angle) * side)

    def ball(size):
        v = rng.normal(size=3)
        return number(0.0, size) * v / np.linalg.norm(v)

    own, e, h, s = tolerance, tolerance["arm_mass"], tolerance["payload_mass"], tolerance["speed"]
    gravity = turned(np.array(model["base"]["gravity"], dtype=float), number(0.0, own["tilt"]))
    return World(
        np.array([number(1 - e, 1 + e) for _ in model["arm"]["masses"]]),
        number(1 - h, 1 + h),
        within(own["payload_center"]),
        number(0.0, own["extra_mass"]),
        1 + number(*own["base_mass"]),
        within(own["center_of_mass"]),
        number(1 - s, 1 + s),
        gravity,
        ball(own["push"]),
        ball(own["base_push"]),
    )


class LateJoints:
    """What joints may be doing that are late by themselves, or overshoot where they jump.

    A choice is a time and, of each joint, how late it is; or an event and None, before its jump; or an event
    and another one, since which it overshoots the sum of its jumps after it (-1: not at all).
    """

    def __init__(self, motion, tolerance):
        self.times, self.c = np.array(motion["times"], dtype=float), np.array(motion["angles"], dtype=float)
        self.delay = tolerance["delay"] * (1 + tolerance["speed"])
        self.more, self.n = tolerance["overshoot"], self.c.shape[1]
        self.events = self.times[:-1, 1]
        self.end = self.events[-1] + self.delay
        before, after = (
            np.array([[self._at(k + i, e, j)[2] for j in range(self.n)] for k, e in enumerate(self.events)])
            for i in (0, 1)
        )
        self.steps = after - before
        self.jumps = np.abs(self.steps) > _NO_JUMP * np.max(np.abs(self.steps), axis=0, initial=1e-300)

    def draw(self, t, rng):
        """A choice at a time."""
        return t, [self._draw(t, j, rng) for j in range(self.n)]

    def _draw(self, t, joint, rng):
        at = self.events[self.jumps[:, joint]]
        inside = np.flatnonzero(self.jumps[:, joint])[(t - self.delay <= at) & (at <= t)]
        if not len(inside) or rng.random() < 0.3:
            return rng.choice([0.0, self.delay]) if rng.random() < 0.5 else rng.uniform(0, self.delay)
        event = int(rng.choice(inside))
        if rng.random() < 0.3:
            return event, None
        return event, int(rng.choice([-1, *inside[inside <= event]]))

    def moved(self, choice, scale, rng):
        """A choice nearby."""
        t, own = choice
        t = t + scale * rng.normal() * max(self.delay, 1e-3)
        for how in own:
            if isinstance(how, tuple):
                first = how[0] if how[1] in (None, -1) else how[1]
                t = min(max(t, self.events[how[0]]), self.events[first] + self.delay)
        moved = [
            how
            if isinstance(how, tuple)
            else float(np.clip(how + scale * rng.normal() * self.delay, 0.0, self.delay))
            for how in own
        ]
        return float(np.clip(t, 0.0, self.end)), moved

    def state(self, choice):
        """(3, n): coordinates, speeds and accelerations."""
        t, own = choice
        found = np.empty((3, self.n))
        for j, how in enumerate(own):
            if isinstance(how, tuple):
                event, first = how
                found[:, j] = self._at(event + (first is not None), self.events[event], j)
                if first is not None and first >= 0:
                    jumps = self.steps[first : event + 1, j] * self.jumps[first : event + 1, j]
                    found[2, j] += self.more * np.sum(jumps)
            else:
                T = min(max(t - how, 0.0), self.events[-1])
                piece = int(np.clip(np.searchsorted(self.events, t - how), 0, len(self.times) - 1))
                found[:, j] = self._at(piece, T, j)
        return found

    def _at(self, piece, t, joint):
        return at(self.times, self.c, piece, t, joint)


def at(times, c, piece, t, joint):
    """Coordinate, speed and acceleration of a piece at a time."""
    half = 0.5 * (times[piece, 1] - times[piece, 0])
    if half <= 0:
        return np.array([c[piece, joint, 0], 0.0, 0.0])
    p = np.polynomial.Polynomial(c[piece, joint])
    u = (t - 0.5 * times[piece].sum()) / half
    return np.array([p(u), p.deriv()(u) / half, p.deriv(2)(u) / half**2])


def loads(model, world, state):
    """Torques and wrench on the base about its centre of mass as described, arb; state (3, n), anything that
    becomes arb."""
    arm, base = model["arm"], model["base"]
    about = np.array(base["center_of_mass"], dtype=float)
    n, pace = len(arm["masses"]), arb(float(world.pace))
    q, qd, qdd = ([x if isinstance(x, arb) else arb(float(x)) for x in row] for row in state)
    qd, qdd = [pace * x for x in qd], [pace * pace * x for x in qdd]

    process = {key: np.array(arm.get(key, np.zeros(6)), dtype=float) for key in _PROCESS}

    def own(k, mass, centre, inertia):
        """With one body alone; None: with the process on the gripper alone."""
        data = {key: np.array(value, dtype=float) for key, value in arm.items()}
        data["rotations"][0] = data["mount_rotation"] @ data["rotations"][0]  # rounded once, as it is read
        data["mount_rotation"] = np.eye(3)
        for key in ("armature", "spring_torque", "spring_stiffness"):  # counted once, below
            data[key] = np.zeros(len(data["armature"]))
        data |= process if mass is None else dict.fromkeys(process, np.zeros(6))
        for key, value in (("masses", mass or 0.0), ("centres", centre), ("inertias", inertia)):
            data[key] = np.zeros(data[key].shape)
            data[key][k] = value
        return balls.loads(data, q, qd, qdd, world.gravity, about)

    found = [
        (float(world.links[k]), own(k, arm["masses"][k], arm["centres"][k], arm["inertias"][k]))
        for k in range(n)
    ]
    if (held := model["payload"]) is not None:
        place = np.array(held["center"]), np.array(held["inertia"])
        found.append((-float(world.links[-1]), own(n - 1, held["mass"], *place)))
        moved = place[0] + np.array(held["axes"]) @ world.shift
        found.append((float(world.payload), own(n - 1, held["mass"], moved, place[1])))
    at_tool = own(n - 1, 1.0, np.array(arm["offsets"][-1]), np.zeros((3, 3)))
    found += [(float(world.extra), at_tool), (1.0, own(n - 1, None, np.zeros(3), np.zeros((3, 3))))]
    torques = [sum((w * part[0][k] for w, part in found), arb(0)) for k in range(len(qd))]
    torques = [x + arb(float(a)) * y for x, a, y in zip(torques, arm["armature"], qdd, strict=True)]
    none = [0.0] * len(torques)
    springs = zip(q, arm.get("spring_torque", none), arm.get("spring_stiffness", none), strict=True)
    held = [arb(float(at_zero)) - arb(float(stiffness)) * y for y, at_zero, stiffness in springs]
    torques = [x - y for x, y in zip(torques, held, strict=True)]
    wrench = [sum((w * part[1][k] for w, part in found), arb(0)) for k in range(6)]
    weight = [arb(float(base["mass"])) * arb(float(world.base)) * arb(float(g)) for g in world.gravity]
    lever = [arb(float(x)) for x in world.centre]
    place = tool(model, q, about)
    push, other = ([arb(float(x)) for x in v] for v in (world.push, world.base_push))
    moment = balls.cross(lever, [a + b for a, b in zip(weight, other, strict=True)])
    turned = balls.cross(place, push)
    force = [w + a + b + c for w, a, b, c in zip(wrench[:3], weight, push, other, strict=True)]
    return torques, [*force, *(w + a + b for w, a, b in zip(wrench[3:], moment, turned, strict=True))]


def tool(model, q, about):
    """Place of the gripper from the base's centre of mass: by moments of a unit mass."""
    arm = {key: np.array(value, dtype=float) for key, value in model["arm"].items()}
    n = len(arm["masses"])
    arm |= dict.fromkeys(_PROCESS, np.zeros(6))
    arm["rotations"][0] = arm["mount_rotation"] @ arm["rotations"][0]
    arm["mount_rotation"] = np.eye(3)
    arm["masses"], arm["centres"], arm["inertias"] = np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3))
    arm["masses"][-1], arm["centres"][-1] = 1.0, arm["offsets"][-1]
    still = [arb(0)] * len(q)
    x = balls.loads(arm, q, still, still, np.array([0.0, 0.0, 1.0]), about)[1]  # (y, -x, 0)
    y = balls.loads(arm, q, still, still, np.array([1.0, 0.0, 0.0]), about)[1]  # (0, z, -y)
    return [-x[4], x[3], y[4]]
