"""MuJoCo's rigid bodies on springs and dampers, from a robot's export: given joint motion, free base.

Nothing is linearised: the base turns, and its feet's forces are in world axes. Soles have no mass: a foot
whose spring and damper would have to pull is let go, its sole relaxes, and presses again where it meets the
ground.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.standing.arm import StandingRobot
from ocptip.standing.simulation.bodies import real_bodies
from ocptip.standing.simulation.mjcf import joint_order, to_mjcf

INSIDE = 1.5e-7


def stiff(robot: StandingRobot) -> StandingRobot:
    """The robot on feet that do not give: here they are not the model's."""
    own = robot.support
    feet = [UnilateralContact(position=c.position, normal=c.normal, friction=1.0) for c in own.contacts]
    return robot.varied(support=own.varied(feet))


@dataclass
class Simulated:
    """At T instants: times (T,), normal forces (T, n), N, gaps below lifted soles (T, n), m."""

    times: np.ndarray
    forces: np.ndarray
    gaps: np.ndarray


class FeetSimulation:
    """A robot on feet of one stiffness; `delay` is damping over stiffness, s, in all directions."""

    def __init__(self, robot, motion, stiffness, tangential, delay):
        self.motion, self.support = motion, robot.support
        alone = stiff(robot)
        self.model = mujoco.MjModel.from_xml_string(to_mjcf(alone))
        self.joints = joint_order(alone, real_bodies(robot.arm), np.eye(robot.n)).T  # rotors turn with them
        self.weight = robot.mass * 9.81
        self.data = mujoco.MjData(self.model)
        self.k, self.kt, self.delay = stiffness, tangential, delay
        n = len(self.support.arms)
        self.anchors, self.pressing = np.zeros((n, 2)), np.ones(n, dtype=bool)
        self.soles, self.lifted = np.zeros(n), np.zeros(n)

    def inertia_and_bias(self, y, q, qd):
        """Mass matrix of base and joints, and bias forces on the base, at base state y and joint states."""
        model, data = self.model, self.data
        data.qpos[:7], data.qpos[7:] = y[:7], self.joints @ q
        data.qvel[:6], data.qvel[6:] = y[7:], self.joints @ qd
        for step in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_crb, mujoco.mj_comVel):
            step(model, data)
        bias, M = np.zeros(model.nv), np.zeros((model.nv, model.nv))
        mujoco.mj_rne(model, data, 0, bias)
        try:
            mujoco.mj_fullM(model, data, M)
        except TypeError:  # before MuJoCo 4
            mujoco.mj_fullM(model, M, data.qM)
        return np.hstack([M[:6, :6], M[:6, 6:] @ self.joints]), bias[:6]

    def feet(self, y):
        """Forces, as springs and dampers have them, places and speeds of the feet, (n, 3), contact axes."""
        R = Rotation.from_quat(np.roll(y[3:7], -1)).as_matrix()
        support, frames = self.support, self.support.frames
        moved = y[:3] + support.arms @ R.T - support.arms - support.center_of_mass
        speed = y[7:10] + np.cross(y[10:], support.arms) @ R.T
        u, v = (np.einsum("kij,ki->kj", frames, x) for x in (moved, speed))
        force = -np.array([self.k, self.kt, self.kt]) * (u + self.delay * v)
        force[:, 1:] += self.kt * self.anchors
        return force, u, R

    def derivative(self, y, q, qd, qdd):
        M, bias = self.inertia_and_bias(y, q, qd)
        force, _, R = self.feet(y)
        force = np.einsum(
            "kij,kj->ki", self.support.frames, force * (self.pressing & (force[:, 0] > 0))[:, None]
        )
        load = np.concatenate([force.sum(axis=0), R.T @ np.cross(self.support.arms @ R.T, force).sum(axis=0)])
        acceleration = np.linalg.solve(M[:, :6], load - bias - M[:, 6:] @ qdd)
        w, (x, yy, z), (a, b, c) = y[3], y[4:7], y[10:]
        turn = 0.5 * np.array(
            [-x * a - yy * b - z * c, w * a + yy * c - z * b, w * b + z * a - x * c, w * c + x * b - yy * a]
        )
        return np.concatenate([y[7:10], turn, acceleration])

    def rest(self):
        """State of the base at rest at the start."""
        q, still = self.motion.start, np.zeros(len(self.motion.start))

        def state(e):
            y = np.zeros(13)
            y[:3] = self.support.center_of_mass + 1e-3 * e[:3]
            y[3:7] = np.roll(Rotation.from_rotvec(1e-3 * e[3:]).as_quat(), 1)
            return y

        guess = np.zeros(6)
        guess[2] = -1e3 * self.weight / (len(self.soles) * self.k)
        found = root(lambda e: self.derivative(state(e), q, still, still)[7:], guess, tol=1e-13)
        assert np.abs(found.fun).max() < 1e-6
        return state(found.x)

    def run(self, step):
        """Runge-Kutta steps of at most this length, s, through the whole motion."""
        y, parts = self.rest(), []
        for a, b in self.motion.intervals:
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
                parts.append(self.seen(y, a + (i + 1) * h))
        return Simulated(*(np.array(values) for values in zip(*parts, strict=True)))

    def seen(self, y, time):
        """Time, forces and gaps; feet that lift or come down in this step do so now."""
        force, u, _ = self.feet(y)
        gaps = u[:, 0] - self.soles * np.exp(-(time - self.lifted) / self.delay)
        press = np.where(self.pressing, force[:, 0] > 0, gaps <= 0)
        off, on = self.pressing & ~press, press & ~self.pressing
        self.soles[off], self.lifted[off] = u[off, 0], time
        self.anchors[on] = u[on, 1:]
        self.pressing = press
        return time, np.where(press, np.maximum(force[:, 0], 0), 0.0), np.where(press | off, 0.0, gaps)
