"""MuJoCo's rigid bodies on springs and dampers, from a robot's export: given motion of the drives, free base.

Nothing is linearised: the base turns, and its feet's forces are in world axes; links hang on their drives by
springs that may bend as far as they like. Soles have no mass: a foot
whose spring and damper would have to pull is let go, its sole relaxes, and presses again where it meets the
ground.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.robots.bodies import real_bodies
from ocptip.standing.arm import Robot
from ocptip.standing.simulation.mjcf import joint_order, to_mjcf

INSIDE = 1.5e-7


def stiff(robot: Robot) -> Robot:
    """The robot on feet that do not give: here they are not the model's."""
    own = robot.support
    feet = [UnilateralContact(position=c.position, normal=c.normal, friction=1.0) for c in own.contacts]
    return robot.varied(support=own.varied(feet))


@dataclass
class Simulated:
    """At T instants: times (T,), normal forces (T, n), N, gaps below lifted soles (T, n), m, gripper (T, 3),
    m, base axes at the start; wrench on a bolted base about its centre of mass (T, 6), N and N m.
    """

    times: np.ndarray
    forces: np.ndarray
    gaps: np.ndarray
    gripper: np.ndarray
    wrenches: np.ndarray


class FeetSimulation:
    """A robot on feet of one stiffness; `delay` is damping over stiffness, s, in all directions.

    `gears`, by the numbers of joints, from 0: stiffness, N m/rad, and damping, N m s/rad. Without a
    stiffness of the feet the base is bolted down.
    """

    def __init__(self, robot, motion, stiffness=None, tangential=None, delay=0.0, gears=None):
        self.motion, self.support, self.bolted = motion, robot.support, stiffness is None
        alone, gears = stiff(robot), gears or {}
        spec = mujoco.MjSpec.from_string(to_mjcf(alone))
        for what in (*spec.actuators, *spec.equalities, *spec.keys):
            spec.delete(what)
        names = robot.arm.chain_names
        for k in gears:
            spec.joint(
                names[k]
            ).armature = 1.0  # else two joints in line have a singular inertia; drives obey
            kinds = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
            kind = kinds[0] if robot.arm.slides[k] else kinds[1]
            spec.body(f"link {k + 1}").add_joint(name=f"{names[k]} spring", type=kind, axis=[0, 0, 1])
        self.model = spec.compile()
        own = [self.model.joint(f"{names[k]} spring").dofadr[0] - 6 for k in gears]
        self.springs = np.array(own, dtype=int)
        self.values = np.array(list(gears.values())).reshape(-1, 2)
        rigid = np.setdiff1d(np.arange(self.model.nv - 6), self.springs)
        self.joints = np.zeros((self.model.nv - 6, robot.n))  # rotors turn with the drives
        self.joints[rigid] = joint_order(alone, real_bodies(robot.arm), np.eye(robot.n)).T
        self.bend = np.zeros((self.model.nv - 6, len(gears)))
        self.bend[self.springs] = np.eye(len(gears))
        self.weight = robot.mass * 9.81
        self.data = mujoco.MjData(self.model)
        self.k, self.kt, self.delay = stiffness or 1.0, tangential or 1.0, delay
        n = len(self.support.arms)
        self.anchors, self.pressing = np.zeros((n, 2)), np.full(n, not self.bolted)
        self.soles, self.lifted = np.zeros(n), np.zeros(n)

    def inertia_and_bias(self, y, q, qd):
        """Mass matrix of base and joints, and bias forces on the base, at base state y and joint states."""
        M, bias = self.mass_and_bias(y, q, qd)
        return np.hstack([M[:6, :6], M[:6, 6:] @ self.joints]), bias[:6]

    def mass_and_bias(self, y, q, qd):
        """Mass matrix and bias forces of MuJoCo's degrees of freedom, at state y and drive states."""
        model, data, m = self.model, self.data, len(self.springs)
        data.qpos[:7], data.qpos[7:] = y[:7], self.joints @ q + self.bend @ y[13 : 13 + m]
        data.qvel[:6], data.qvel[6:] = y[7:13], self.joints @ qd + self.bend @ y[13 + m :]
        for step in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_crb, mujoco.mj_comVel):
            step(model, data)
        bias, M = np.zeros(model.nv), np.zeros((model.nv, model.nv))
        mujoco.mj_rne(model, data, 0, bias)
        try:
            mujoco.mj_fullM(model, data, M)
        except TypeError:  # before MuJoCo 4
            mujoco.mj_fullM(model, M, data.qM)
        return M, bias

    def feet(self, y):
        """Forces, as springs and dampers have them, places and speeds of the feet, (n, 3), contact axes."""
        R = Rotation.from_quat(np.roll(y[3:7], -1)).as_matrix()
        support, frames = self.support, self.support.frames
        moved = y[:3] + support.arms @ R.T - support.arms - support.center_of_mass
        speed = y[7:10] + np.cross(y[10:13], support.arms) @ R.T
        u, v = (np.einsum("kij,ki->kj", frames, x) for x in (moved, speed))
        force = -np.array([self.k, self.kt, self.kt]) * (u + self.delay * v)
        force[:, 1:] += self.kt * self.anchors
        return force, u, R

    def accelerations(self, y, q, qd, qdd):
        """Of base and springs, and the wrench that a bolted base exerts on its bolts."""
        M, bias = self.mass_and_bias(y, q, qd)
        m, free = len(self.springs), np.append(np.arange(0 if self.bolted else 6), 6 + self.springs)
        force, _, R = self.feet(y)
        force = np.einsum(
            "kij,kj->ki", self.support.frames, force * (self.pressing & (force[:, 0] > 0))[:, None]
        )
        load = np.zeros(self.model.nv)
        load[:3], load[3:6] = force.sum(axis=0), R.T @ np.cross(self.support.arms @ R.T, force).sum(axis=0)
        load[6 + self.springs] = -self.values[:, 0] * y[13 : 13 + m] - self.values[:, 1] * y[13 + m :]
        rest = load - bias - M[:, 6:] @ (self.joints @ qdd)
        found = np.zeros(self.model.nv)
        found[free] = np.linalg.solve(M[np.ix_(free, free)], rest[free])
        return found, (rest - M @ found)[:6]

    def derivative(self, y, q, qd, qdd):
        found, _ = self.accelerations(y, q, qd, qdd)
        w, (x, yy, z), (a, b, c) = y[3], y[4:7], y[10:13]
        turn = 0.5 * np.array(
            [-x * a - yy * b - z * c, w * a + yy * c - z * b, w * b + z * a - x * c, w * c + x * b - yy * a]
        )
        m = len(self.springs)
        return np.concatenate([y[7:10], turn, found[:6], y[13 + m :], found[6 + self.springs]])

    def rest(self, q=None):
        """State at rest at these drive values; default: at the start."""
        q = self.motion.start if q is None else q
        still, m = np.zeros(len(q)), len(self.springs)

        def state(e):
            y = np.zeros(13 + 2 * m)
            y[:3] = self.support.center_of_mass + 1e-3 * e[:3]
            y[3:7] = np.roll(Rotation.from_rotvec(1e-3 * e[3:6]).as_quat(), 1)
            y[13 : 13 + m] = 1e-3 * e[6:]
            return y

        def left(e):
            found, _ = self.accelerations(state(e), q, still, still)
            return np.concatenate([e[:6] if self.bolted else found[:6], found[6 + self.springs]])

        guess = np.zeros(6 + m)
        guess[2] = 0.0 if self.bolted else -1e3 * self.weight / (len(self.soles) * self.k)
        found = root(left, guess, tol=1e-13)
        assert np.abs(found.fun).max() < 1e-6
        return state(found.x)

    def sag(self, q):
        """Where the gripper is at rest, (3,), m, at these drive values."""
        self.mass_and_bias(self.rest(q), q, 0 * q)
        return self.data.site("gripper").xpos.copy()

    def run(self, step, after=0.0):
        """Runge-Kutta steps of at most this length, s, through the whole motion and so long after it."""
        y, parts = self.rest(), []
        end = self.motion.end
        for a, b in [*self.motion.intervals, (end, end + after)] if after else self.motion.intervals:
            count = max(1, int(np.ceil((b - a) / step)))
            h = (b - a) / count
            times = np.clip(np.linspace(a, b, 2 * count + 1), a + INSIDE, b - INSIDE)
            states = np.stack(self.motion.states(times), axis=1)
            for i in range(count):
                s1, s2, s3 = states[2 * i : 2 * i + 3]
                k1 = self.derivative(y, *s1)
                k2 = self.derivative(y + h / 2 * k1, *s2)
                k3 = self.derivative(y + h / 2 * k2, *s2)
                y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + self.derivative(y + h * k3, *s3))
                y[3:7] /= np.linalg.norm(y[3:7])
                parts.append(self.seen(y, a + (i + 1) * h, s3))
        return Simulated(*(np.array(values) for values in zip(*parts, strict=True)))

    def seen(self, y, time, states):
        """What there is of a state; feet that lift or come down in this step do so now."""
        force, u, _ = self.feet(y)
        gaps = u[:, 0] - self.soles * np.exp(-(time - self.lifted) / max(self.delay, 1e-12))
        press = np.where(self.pressing, force[:, 0] > 0, gaps <= 0) & (not self.bolted)
        off, on = self.pressing & ~press, press & ~self.pressing
        self.soles[off], self.lifted[off] = u[off, 0], time
        self.anchors[on] = u[on, 1:]
        self.pressing = press
        _, wrench = self.accelerations(y, *states)
        shown = np.where(press, np.maximum(force[:, 0], 0), 0.0)
        place = self.data.site("gripper").xpos.copy()
        return time, shown, np.where(press | off, 0.0, gaps), place, wrench
