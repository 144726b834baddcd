"""Random robots on the branch they were built on, and the same robot in Pinocchio as a reference."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin

from ocptip.parallel.description.branched import BranchedLeg, LegEnd
from ocptip.parallel.description.platform import BodyInertia, elementary_rotation, value_of
from ocptip.parallel.description.ready_made import delta, delta_end_rotation
from ocptip.parallel.description.robot_description import PRISMATIC, REVOLUTE, MDHRow, RobotDescription
from ocptip.parallel.robot import ParallelRobot
from tests.parallel.parallel_cases import golden, random_state


def on_branch(description: RobotDescription, q: np.ndarray) -> RobotDescription:
    """The same robot, assembled near joint values q (n, N)."""
    legs = tuple(
        dataclasses.replace(leg, guess=tuple(values))
        for leg, values in zip(description.legs, q.T, strict=True)
    )
    return dataclasses.replace(description, legs=legs)


def random_robot(kind: str, seed: int, convention: str = "xyz"):
    """A random robot and its state: (robot, z, zd, zdd)."""
    state = random_state(kind, seed, convention)
    rng = np.random.default_rng(1000 + seed)
    zd, zdd = rng.uniform(-1, 1, (2, len(state.z)))
    return ParallelRobot(on_branch(state.robot, state.q)), state.z, zd, 5 * zdd


def golden_robot(kind: str):
    """The robot of a golden case and the case."""
    case = golden(kind)
    return ParallelRobot(on_branch(case.robot, case.q)), case


def relative(value: object, reference: object) -> float:
    """Largest difference relative to the largest reference value."""
    reference = np.asarray(reference, dtype=float)
    return float(np.abs(np.asarray(value, dtype=float) - reference).max() / np.abs(reference).max())


def rod_delta(half_width: float = 0.06) -> RobotDescription:
    """The ready-made Delta with two real rods per leg, each with half of the lumped rod's inertia."""
    lumped = delta()
    legs = []
    for leg in lumped.legs:
        l1, l2 = leg.rows[1].d, leg.rows[3].d
        half = BodyInertia.from_vector(leg.bodies[2].vector / 2)
        rows, parents, bodies, ends = [leg.rows[0]], [-1], [leg.bodies[0]], []
        axis = leg.base_matrix[:, 2]
        for side in (half_width, -half_width):
            start = len(rows)
            rows += [
                MDHRow(b=side, d=l1),
                MDHRow(alpha=np.pi / 2),
                MDHRow(d=l2),
                MDHRow(alpha=np.pi / 2),
            ]
            parents += [0, start, start + 1, start + 2]
            bodies += [BodyInertia(), half, BodyInertia(), BodyInertia()]
            point = leg.coupling_point + side * axis
            ends.append(LegEnd(start + 3, tuple(point), delta_end_rotation(leg.base_matrix)))
        legs.append(
            BranchedLeg(
                tuple(rows),
                tuple(parents),
                tuple(ends),
                tuple(bodies),
                base_rotation=leg.base_rotation,
                base_position=leg.base_position,
                guess=(1.85, 2.04, 0.0, 0.0, 3.9, 2.04, 0.0, 0.0, 3.9),
            )
        )
    return dataclasses.replace(lumped, name="Delta with rods", legs=tuple(legs))


class Twin:
    """The complete legs and the free-flying platform in Pinocchio.

    Attributes:
        model: first the legs' joints, leg by leg, the platform's free joint last.
    """

    def __init__(self, robot: ParallelRobot) -> None:
        self.robot = robot
        self.model = pin.Model()
        self.model.gravity.linear = np.array(robot.description.gravity)
        self.ends: list[tuple[int, np.ndarray]] = []
        for leg in robot.kinematics.legs:
            self._add_leg(leg)
        platform = self.model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "platform")
        self.model.appendBodyToJoint(
            platform, _inertia(robot.description.platform.inertia), pin.SE3.Identity()
        )
        self.platform = platform
        self.data = self.model.createData()

    def _add_leg(self, leg) -> None:
        frames: list[int] = []
        bodies = leg.leg.bodies
        for k, (row, parent) in enumerate(zip(leg.topology.rows, leg.topology.parents, strict=True)):
            R = elementary_rotation("z", row.gamma) @ elementary_rotation("x", row.alpha)
            p = elementary_rotation("z", row.gamma) @ [value_of(row.d), 0, 0] + [0, 0, value_of(row.b)]
            fixed = pin.SE3(R, p)
            if row.sigma == REVOLUTE:
                fixed = fixed * pin.SE3(np.eye(3), np.array([0.0, 0.0, value_of(row.r)]))
                joint = pin.JointModelRZ()
            else:
                assert row.sigma == PRISMATIC
                fixed = fixed * pin.SE3(elementary_rotation("z", row.theta), np.zeros(3))
                joint = pin.JointModelPZ()
            if parent < 0:
                fixed = pin.SE3(leg.base, leg.origin) * fixed
            mother = 0 if parent < 0 else frames[parent]
            frames.append(self.model.addJoint(mother, joint, fixed, f"leg{leg.number}_{k}"))
            if k < len(bodies) and not bodies[k].massless:
                self.model.appendBodyToJoint(frames[-1], _inertia(bodies[k]), pin.SE3.Identity())
        ends = zip(leg.topology.ends, leg.couplings, strict=False)
        self.ends += [(frames[end], kappa) for end, kappa in ends]

    def state(self, rates, z, zd, zdd):
        """q, v, a of the twin from joint rates of the robot."""
        kinematics = self.robot.kinematics
        s, sd = kinematics.quasi(z, zd, zdd)
        motion = kinematics.motion(z, s, rates.q, complete=True)
        t, td = motion.t, motion.T @ sd + motion.T_drift
        R = motion.R
        q = np.concatenate([*rates.q, motion.r, pin.Quaternion(R).coeffs()])
        v = np.concatenate([*rates.qd, R.T @ t[:3], R.T @ t[3:]])
        # A free joint's acceleration is that of its velocity in moving axes.
        a = np.concatenate([*rates.qdd, R.T @ (td[:3] - np.cross(t[3:], t[:3])), R.T @ td[3:]])
        return q, v, a

    def closures(self, q):
        """Jacobian of all 6D closures, world axes at the coupling points."""
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        at = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        M = self.data.oMi[self.platform]
        base = pin.getJointJacobian(self.model, self.data, self.platform, at)
        rows = []
        for joint, kappa in self.ends:
            J = base.copy()
            J[:3] -= pin.skew(M.rotation @ kappa) @ base[3:]
            rows.append(pin.getJointJacobian(self.model, self.data, joint, at) - J)
        return np.vstack(rows)

    def motor_forces(self, z, zd, zdd):
        """Motor forces with multipliers, and the relative residual."""
        rates = self.robot.passive(z, zd, zdd)
        q, v, a = self.state(rates, z, zd, zdd)
        right = pin.rnea(self.model, self.data, q, v, a)
        J = self.closures(q)
        starts = np.concatenate([[0], np.cumsum([leg.n for leg in self.robot.kinematics.legs])])
        S = np.zeros((self.model.nv, len(self.robot.description.actuated)))
        for k, (leg, joint) in enumerate(self.robot.description.actuated):
            S[starts[leg] + joint, k] = 1
        matrix = np.hstack([S, J.T])
        solution = np.linalg.lstsq(matrix, right, rcond=1e-11)[0]
        residual = np.abs(matrix @ solution - right).max() / np.abs(right).max()
        return solution[: S.shape[1]], residual, np.abs(J @ v).max()

    def base_wrench(self, z, zd, zdd):
        """Wrench on the base about the world origin from the change of the whole momentum."""
        q, v, a = self.state(self.robot.passive(z, zd, zdd), z, zd, zdd)
        pin.computeCentroidalMomentumTimeVariation(self.model, self.data, q, v, a)
        rate = self.data.dhg
        com, mass = self.data.com[0], pin.computeTotalMass(self.model)
        force = rate.linear - mass * self.model.gravity.linear
        return -np.concatenate([force, rate.angular + np.cross(com, force)])


def _inertia(body: BodyInertia) -> pin.Inertia:
    center = body.first_moment / body.mass
    about = body.inertia - body.mass * (center @ center * np.eye(3) - np.outer(center, center))
    return pin.Inertia(body.mass, center, about)
