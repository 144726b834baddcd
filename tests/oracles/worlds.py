"""Many worlds within the uncertainty of a certificate at once, in plain NumPy, and the worst of them.

The model is that of the certificate's data, body by body: places, speeds and accelerations of centres of mass
in base axes, Newton and Euler's equations of each body about one point. No code of the checker or of ocptip.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np


@dataclass(frozen=True)
class Worlds:
    """What is off in N worlds.

    Attributes:
        links: (N, n) factors of the links' masses.
        payload: (N,) factor of its mass.
        shift: (N, 3), m, of its centre, gripper axes.
        extra: (N,), kg, at the TCP.
        base: (N,) factor of the base's mass.
        centre: (N, 3), m, shift of the base's centre of mass.
        pace: (N,) factor of the speed.
        rush: (N,) factor of the speed of the base.
        gravity: (N, 3), m/s^2.
        push, base_push: (N, 3), N, at the TCP and at the base's centre of mass.
    """

    links: np.ndarray
    payload: np.ndarray
    shift: np.ndarray
    extra: np.ndarray
    base: np.ndarray
    centre: np.ndarray
    pace: np.ndarray
    rush: np.ndarray
    gravity: np.ndarray
    push: np.ndarray
    base_push: np.ndarray

    def some(self, rows):
        """Those of some rows."""
        return Worlds(*(getattr(self, field.name)[rows] for field in fields(self)))

    def where(self, chosen, other):
        """These where chosen (N,), else the others."""
        pairs = ((getattr(self, field.name), getattr(other, field.name)) for field in fields(self))
        return Worlds(*(np.where(chosen.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in pairs))


class ArmOnBase:
    """The wrench on the base.

    Args:
        model, tolerance: of a certificate.
    """

    def __init__(self, model, tolerance):
        self.model, self.tolerance = model, tolerance
        self.arm = {key: np.array(value, dtype=float) for key, value in model["arm"].items()}
        self.base = {
            key: np.array(model["base"][key], dtype=float) for key in ("mass", "center_of_mass", "gravity")
        }
        self.base["inertia"] = np.array(model["base"].get("inertia", np.zeros((3, 3))))
        self.links = len(self.arm["masses"])
        held = model["payload"]
        self.held = (
            None if held is None else {key: np.array(value, dtype=float) for key, value in held.items()}
        )
        low, high = tolerance["base_mass"]
        link, load, pace = (tolerance[key] for key in ("arm_mass", "payload_mass", "speed"))
        self.ends = {
            "links": (np.full(self.links, 1 - link), np.full(self.links, 1 + link)),
            "payload": (1 - load, 1 + load),
            "shift": (-np.array(tolerance["payload_center"]), np.array(tolerance["payload_center"])),
            "extra": (0.0, tolerance["extra_mass"]),
            "base": (1 + low, 1 + high),
            "centre": (-np.array(tolerance["center_of_mass"]), np.array(tolerance["center_of_mass"])),
            "pace": (1 - pace, 1 + pace),
            "rush": (1 - tolerance.get("drive_speed", 0.0), 1 + tolerance.get("drive_speed", 0.0)),
        }

    # --- worlds -------------------------------------------------------------------------------------------

    def nominal(self, count):
        """The nominal world, N times."""
        one, three = np.ones(count), np.zeros((count, 3))
        gravity = np.tile(self.base["gravity"], (count, 1))
        links = np.ones((count, self.links))
        return Worlds(links, one, three, 0 * one, one, three, one, one, gravity, three, three)

    def corners(self, count, rng):
        """Random corners: everything at an end at once, tilt and pushes full, in any direction."""
        found = {}
        for name, (low, high) in self.ends.items():
            shape = (count, *np.shape(low))
            found[name] = np.where(rng.random(shape) < 0.5, low, high)
        g = self.base["gravity"]
        side = np.cross(g, rng.normal(size=(count, 3)))
        side *= np.linalg.norm(g) / np.linalg.norm(side, axis=1, keepdims=True)
        angle = self.tolerance["tilt"]
        found["gravity"] = np.cos(angle) * g + np.sin(angle) * side
        for name in ("push", "base_push"):
            v = rng.normal(size=(count, 3))
            found[name] = self.tolerance[name] * v / np.linalg.norm(v, axis=1, keepdims=True)
        return Worlds(**found)

    def inside(self, count, rng):
        """Random worlds anywhere inside."""
        corner, share = self.corners(count, rng), {}
        for name, (low, high) in self.ends.items():
            shape = (count, *np.shape(low))
            share[name] = low + (np.asarray(high) - low) * rng.random(shape)
        part = rng.random((3, count, 1))
        g = self.base["gravity"] + part[0] * (corner.gravity - self.base["gravity"])
        g *= np.linalg.norm(self.base["gravity"]) / np.linalg.norm(g, axis=1, keepdims=True)
        return replace(
            corner, **share, gravity=g, push=part[1] * corner.push, base_push=part[2] * corner.base_push
        )

    # --- physics ------------------------------------------------------------------------------------------

    def driven(self, q, qd, qdd, velocities, rates):
        """`moved` in some worlds, on a base with velocities and their rates of change (N, 3) in its axes."""

        def moved(worlds):
            pace, rush = worlds.pace[:, None], worlds.rush[:, None]
            return self.moved(q, pace * qd, pace**2 * qdd, rush * velocities, rush**2 * rates)

        return moved

    def moved(self, q, qd, qdd, velocities=None, rates=None):
        """Of each link R (N, 3, 3), place, angular velocity and its change, acceleration of its origin; first
        of the base where it drives, with velocities and their rates of change (N, 3)."""
        arm, count = self.arm, len(q)
        value, rate, change = (x @ arm["ratios"].T for x in (q, qd, qdd))
        value = value + arm["shift"]
        R = np.broadcast_to(arm["mount_rotation"], (count, 3, 3))
        p = np.broadcast_to(arm["mount_position"], (count, 3))
        omega = domega = accel = np.zeros((count, 3))
        found = []
        if velocities is not None:
            none, (x, y, w) = np.zeros(count), velocities.T
            omega, domega = (np.stack([none, none, v[:, 2]], axis=1) for v in (velocities, rates))
            accel = np.stack([rates[:, 0] - w * y, rates[:, 1] + w * x, none], axis=1)
            still = np.broadcast_to(np.eye(3), (count, 3, 3))
            found.append((still, np.zeros((count, 3)), omega, domega, accel))
            accel = accel + np.cross(domega, p) + np.cross(omega, np.cross(omega, p))
        for i in range(self.links):
            lever = R @ arm["offsets"][i - 1] if i else np.zeros((count, 3))
            R = R @ arm["rotations"][i]
            z = R[:, :, 2]
            if arm["slides"][i]:
                lever = lever + z * value[:, i, None]
            accel = accel + np.cross(domega, lever) + np.cross(omega, np.cross(omega, lever))
            p = p + lever
            if arm["slides"][i]:
                accel = accel + 2 * np.cross(omega, z) * rate[:, i, None] + z * change[:, i, None]
            else:
                domega = domega + np.cross(omega, z) * rate[:, i, None] + z * change[:, i, None]
                omega = omega + z * rate[:, i, None]
                cosine, sine = np.cos(value[:, i]), np.sin(value[:, i])
                turn = np.zeros((count, 3, 3))
                turn[:, 0, 0], turn[:, 1, 1], turn[:, 2, 2] = cosine, cosine, 1.0
                turn[:, 1, 0], turn[:, 0, 1] = sine, -sine
                R = R @ turn
            found.append((R, p, omega, domega, accel))
        return found

    def tool(self, moved):
        """(N, 3): the gripper point, base frame."""
        R, p, *_ = (moved(self.nominal(self.count)) if callable(moved) else moved)[-1]
        return p + R @ self.arm["offsets"][-1]

    def wrench(self, worlds, moved, acting):
        """(N, 6) on the base about its nominal centre of mass.

        Args:
            worlds: N of them.
            moved: of the links, at the nominal pace.
            acting: (N, 12) of what acts on the gripper, about it: in base axes, in those of the last link.
        """
        about, arm, fast = self.base["center_of_mass"], self.arm, worlds.pace[:, None] ** 2
        driven, self.count = callable(moved), len(worlds.pace)
        if driven:
            moved, fast = moved(worlds), np.ones((self.count, 1))
            of_base, *moved = moved
        force, moment = np.zeros((2, *worlds.gravity.shape))

        def body(link, weight, centre, inertia):
            nonlocal force, moment
            R, p, omega, domega, accel = moved[link]
            arm_ = np.einsum("nij,nj->ni", R, np.broadcast_to(centre, p.shape))
            a = accel + np.cross(domega, arm_) + np.cross(omega, np.cross(omega, arm_))
            f = weight[:, None] * (worlds.gravity - fast * a)
            force = force + f
            moment = moment + np.cross(p + arm_ - about, f)
            if inertia is not None:
                factor, own = inertia
                turned = R @ own @ R.transpose(0, 2, 1)
                gyro = np.cross(omega, np.einsum("nij,nj->ni", turned, omega))
                change = np.einsum("nij,nj->ni", turned, domega) + gyro
                moment = moment - factor[:, None] * fast * change

        if driven:
            links, moved = moved, [of_base]
            inertia = worlds.base, self.base["inertia"]
            body(0, worlds.base * self.base["mass"], about + worlds.centre, inertia)
            weight = (worlds.base * self.base["mass"])[:, None] * worlds.gravity  # counted again below
            force, moment = force - weight, moment - np.cross(worlds.centre, weight)
            moved = links
        for k in range(self.links):
            factor = worlds.links[:, k]
            body(k, factor * arm["masses"][k], arm["centres"][k], (factor, arm["inertias"][k]))
        if (held := self.held) is not None:
            out = -worlds.links[:, -1]
            body(self.links - 1, out * held["mass"], held["center"], (out, held["inertia"]))
            centre = held["center"] + worlds.shift @ held["axes"].T
            own = worlds.payload, held["inertia"]
            body(self.links - 1, worlds.payload * held["mass"], centre, own)
        body(self.links - 1, worlds.extra, arm["offsets"][-1], None)
        R, tool = moved[-1][0], self.tool(moved) - about
        acts = acting[:, :3] + np.einsum("nij,nj->ni", R, acting[:, 6:9])
        twists = acting[:, 3:6] + np.einsum("nij,nj->ni", R, acting[:, 9:])
        at_tool = acts + worlds.push
        at_base = (worlds.base * self.base["mass"])[:, None] * worlds.gravity + worlds.base_push
        force = force + at_tool + at_base
        moment = moment + twists + np.cross(tool, at_tool) + np.cross(worlds.centre, at_base)
        return np.hstack([force, moment])

    def on_object(self, carried, worlds, moved, shares, shifts):
        """(N, 6) on an object of the model about its reference point, in axes of its link.

        Args:
            carried: the object.
            worlds, moved: as of `wrench`.
            shares: (N, k) factors of the masses of its bodies.
            shifts: (N, k, 3), m, of their centres of mass along the object's box.
        """
        fast = worlds.pace[:, None] ** 2
        if callable(moved):
            links, fast = moved(worlds), np.ones(fast.shape)
        else:
            none = np.zeros(worlds.gravity.shape)
            still = np.broadcast_to(np.eye(3), (len(none), 3, 3))
            links = [(still, none, none, none, none), *moved]
        R, _, *motion = links[carried["link"]]
        omega, domega, accel, gravity = (np.einsum("nji,nj->ni", R, v) for v in (*motion, worlds.gravity))
        about, axes = np.array(carried["base"]["center_of_mass"]), np.array(carried["axes"])
        force, moment = np.zeros((2, *omega.shape))
        for k, body in enumerate(carried["bodies"]):
            place, inertia = np.array(body["center"]) + shifts[:, k] @ axes.T, np.array(body["inertia"])
            a = accel + np.cross(domega, place) + np.cross(omega, np.cross(omega, place))
            f = (shares[:, k] * body["mass"])[:, None] * (gravity - fast * a)
            turns = domega @ inertia.T + np.cross(omega, omega @ inertia.T)
            force = force + f
            moment = moment + np.cross(place - about, f) - shares[:, k, None] * fast * turns
        return np.hstack([force, moment])

    # --- the worst ----------------------------------------------------------------------------------------

    def least(self, h, worlds, moved, acting, rounds=3):
        """Worlds at which functionals h (N, 6) of the wrench are small: one quantity after the other at its
        worst, from these worlds on; and the values (N,)."""
        about, size = self.base["center_of_mass"], np.linalg.norm(self.base["gravity"])

        def value(some):
            return np.sum(h * self.wrench(some, moved, acting), axis=1)

        best = value(worlds)
        for _ in range(rounds):
            before = best
            for name, (low, high) in self.ends.items():
                for index in np.ndindex(np.shape(low)):
                    for end in (np.asarray(low)[index], np.asarray(high)[index]):
                        changed = getattr(worlds, name).copy()
                        changed[(slice(None), *index)] = end
                        other = replace(worlds, **{name: changed})
                        new = value(other)
                        worlds, best = other.where(new <= best, worlds), np.minimum(new, best)
            still = value(replace(worlds, gravity=0 * worlds.gravity))
            b = np.stack(
                [value(replace(worlds, gravity=np.tile(e, (len(h), 1)))) - still for e in np.eye(3)], axis=1
            )
            other = replace(worlds, gravity=self._under_cap(b, size))
            new = value(other)
            worlds, best = other.where(new <= best, worlds), np.minimum(new, best)
            for name, place in (("push", self.tool(moved) - about), ("base_push", worlds.centre)):
                slope = h[:, :3] + np.cross(h[:, 3:], place)
                unit = slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-300)
                worlds = replace(worlds, **{name: -self.tolerance[name] * unit})
            best = value(worlds)
            if np.all(best >= before - 1e-12 * np.abs(before)):
                break
        return worlds, best

    def _under_cap(self, b, size):
        """Gravity (N, 3) within the tilt at which b . gravity is least."""
        down = self.base["gravity"] / size
        wanted = -b / np.maximum(np.linalg.norm(b, axis=1, keepdims=True), 1e-300)
        along = wanted @ down
        side = wanted - along[:, None] * down
        across = np.linalg.norm(side, axis=1)
        angle = np.minimum(np.arctan2(across, along), self.tolerance["tilt"])[:, None]
        return size * (np.cos(angle) * down + np.sin(angle) * side / np.maximum(across, 1e-300)[:, None])
