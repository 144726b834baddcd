"""An arm on a free base in MuJoCo, driven by the law of a controller that is cancelled.

The model is written here from the arm's link data, and the feed-forward torques come from Pinocchio. Nothing
of the package's own exporter or dynamics is used. Feet are small spheres on a plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import pinocchio as pin

from ocptip.standing.arm import Robot
from ocptip.trajectories.trajectory import Trajectory

STEP = 5e-4  # s
STIFF = 2e-3  # s: time constant of the contacts, critically damped
SOLIMP = "0.98 0.999 0.0002"
FOOT = 0.01  # m, radius of a foot
DRIVE = 2 * np.pi * 30  # rad/s of each joint's position loop, critically damped
BEFORE, AFTER = 0.06, 0.05  # s of the motion before a cancel, and of rest after the stop
LOST = 3e-3  # s without a force on any foot beside an edge: the base turns about it
_BAD = [mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC]


@dataclass(frozen=True)
class Replay:
    """What becomes of the base when the motion is cancelled.

    Attributes:
        tips: for `LOST` no foot beside some tipping axis carries load.
        longest: s, longest such time.
        predicted: s, longest time with a negative moment about some tipping axis, by the package's own
            dynamics of the commands.
        lift: m, how far a foot rises above where it stood before the cancel.
        slide: m, how far a foot moves sideways.
    """

    tips: bool
    longest: float
    predicted: float
    lift: float
    slide: float


def _quat(R: np.ndarray) -> str:
    q = np.empty(4)
    mujoco.mju_mat2Quat(q, np.ascontiguousarray(R, dtype=float).ravel())
    return " ".join(f"{x:.17g}" for x in q)


def _text(values: np.ndarray) -> str:
    return " ".join(f"{x:.17g}" for x in np.ravel(values))


def _inertial(mass: float, centre: np.ndarray, inertia: np.ndarray) -> str:
    values = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    return f'<inertial mass="{mass:.17g}" pos="{_text(centre)}" fullinertia="{_text(values)}"/>'


def model_text(robot: Robot, step: float = STEP, stiff: float = STIFF) -> str:
    """MJCF of the arm on its base."""
    arm, support, links = robot.arm, robot.support, ""
    for i in reversed(range(arm.n)):
        place = arm.mount_position if i == 0 else arm.offsets[i - 1]
        turn = arm.mount_rotation @ arm.rotations[0] if i == 0 else arm.rotations[i]
        kind = "slide" if arm.prismatic[i] else "hinge"
        links = (
            f'<body pos="{_text(place)}" quat="{_quat(turn)}">'
            f'<joint name="j{i}" type="{kind}" axis="0 0 1" armature="{arm.armature[i]:.17g}"/>'
            f"{_inertial(arm.masses[i], arm.centres[i], arm.inertias[i])}{links}</body>"
        )
    feet = sensors = drives = ""
    for k, contact in enumerate(support.contacts):
        at = _text(np.add(contact.position, [0.0, 0.0, FOOT]))
        feet += (
            f'<geom name="f{k}" type="sphere" size="{FOOT}" pos="{at}" friction="{contact.friction} 0 0" '
            f'mass="0"/><site name="f{k}" type="sphere" size="{1.5 * FOOT}" pos="{at}"/>'
        )
        sensors += f'<touch site="f{k}"/>'
    for i in range(arm.n):
        drives += f'<motor joint="j{i}" ctrllimited="false"/>'
    return (
        f'<mujoco><compiler inertiafromgeom="false" boundmass="1e-9" boundinertia="1e-9"/>'
        f'<option timestep="{step}" gravity="{_text(support.gravity)}" cone="elliptic" impratio="10" '
        f'integrator="implicitfast" tolerance="1e-10"/>'
        f'<default><geom solref="{stiff} 1" solimp="{SOLIMP}" contype="0" conaffinity="1"/></default>'
        f'<worldbody><geom type="plane" size="5 5 1" contype="1" conaffinity="0" friction="0 0 0"/>'
        f'<body name="base"><freejoint/>{_inertial(support.mass, support.center_of_mass, support.inertia)}'
        f"{feet}{links}</body></worldbody>"
        f"<actuator>{drives}</actuator><sensor>{sensors}</sensor></mujoco>"
    )


def pinocchio_model(robot: Robot) -> pin.Model:
    """The arm on a base at rest."""
    arm, model, parent = robot.arm, pin.Model(), 0
    for i in range(arm.n):
        place = arm.mount_position if i == 0 else arm.offsets[i - 1]
        turn = arm.mount_rotation @ arm.rotations[0] if i == 0 else arm.rotations[i]
        kind = pin.JointModelPZ if arm.prismatic[i] else pin.JointModelRZ
        parent = model.addJoint(parent, kind(), pin.SE3(np.array(turn), np.array(place)), f"j{i}")
        body = pin.Inertia(float(arm.masses[i]), np.array(arm.centres[i]), np.eye(3))
        body.inertia = np.array(arm.inertias[i])
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    model.armature = np.array(arm.armature)
    model.gravity.linear = robot.support.gravity
    return model


class World:
    """Replays cancels of motions of one robot.

    Args:
        robot: an arm without a process on ordinary contacts in a horizontal plane.
        step, stiff: s, of the simulation, and time constant of the contacts.
        drive: rad/s of each joint's position loop.
    """

    def __init__(self, robot: Robot, step: float = STEP, stiff: float = STIFF, drive: float = DRIVE) -> None:
        self._robot, self._step, self._drive = robot, step, drive
        self._model = mujoco.MjModel.from_xml_string(model_text(robot, step, stiff))
        self._data, self._pin = mujoco.MjData(self._model), pinocchio_model(robot)
        self._pin_data = self._pin.createData()
        count = len(robot.support.contacts)
        self._beside = [[k for k in range(count) if k not in axis.contacts] for axis in robot.tip_over.axes]

    def commands(
        self, motion: Trajectory, begun: float, rates: np.ndarray, together: bool
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        """Angles, speeds, accelerations (K, n) at all steps, and the number of the step of the cancel."""
        before = round(min(BEFORE, begun) / self._step)
        q0, qd0, _ = (part[0] for part in motion.states(np.array([begun])))
        stop = np.abs(qd0) / rates
        if together:
            rates = np.abs(qd0) / stop.max()
            stop = np.full(len(qd0), stop.max())
        times = self._step * np.arange(int(np.ceil((stop.max() + AFTER) / self._step)))[:, None]
        sign, moves = np.sign(qd0), times < stop
        own = np.minimum(times, stop)
        cancelled = (
            q0 + qd0 * own - 0.5 * sign * rates * own**2,
            np.where(moves, qd0 - sign * rates * times, 0.0),
            np.where(moves, -sign * rates, 0.0),
        )
        path = motion.states(begun - self._step * np.arange(before, 0, -1))
        q, qd, qdd = (np.vstack(pair) for pair in zip(path, cancelled, strict=True))
        return q, qd, qdd, before

    def cancelled(self, motion: Trajectory, begun: float, rates: np.ndarray, together: bool) -> Replay:
        """A motion that is cancelled at a time, s, with decelerations (n,).

        Joints stop each by itself, or together: then only the leading one decelerates at its rate.
        """
        q, qd, qdd, before = self.commands(motion, begun, rates, together)
        model, data, n = self._model, self._data, q.shape[1]
        mujoco.mj_resetData(model, data)
        data.qpos[7:], data.qvel[6:] = q[0], qd[0]
        # Of each joint alone, with the others free: gains for its own row of the matrix would be unstable.
        inertia = 1 / np.diag(np.linalg.inv(pin.crba(self._pin, self._pin_data, q[before])))
        kp, kd = self._drive**2 * inertia, 2 * self._drive * inertia
        forces, heights, places = [], [], []
        feet = np.arange(1, 1 + len(self._robot.support.contacts))
        for k in range(len(q)):
            torque = pin.rnea(self._pin, self._pin_data, q[k], qd[k], qdd[k])
            data.ctrl[:] = torque + kp * (q[k] - data.qpos[7:]) + kd * (qd[k] - data.qvel[6:])
            mujoco.mj_step(model, data)
            if k >= before - 1:
                forces.append(data.sensordata.copy())
                heights.append(data.geom_xpos[feet, 2].copy())
                places.append(data.geom_xpos[feet, :2].copy())
        if n != model.nu or any(data.warning[k].number for k in _BAD):
            raise RuntimeError(f"the simulation of a cancel at {begun:.4f} s is unstable")
        carried, heights, places = np.array(forces), np.array(heights), np.array(places)
        slope, offset = self._robot.tip_over.affine_moments
        commanded = self._robot.loads(q[before:], qd[before:], qdd[before:])[1] @ slope.T + offset
        unloaded = (~np.any(carried[:, beside] > 0, axis=1) for beside in self._beside)
        longest = max(_longest(some, self._step) for some in unloaded)
        return Replay(
            tips=longest >= LOST * (1 - 1e-9),
            longest=longest,
            predicted=_longest(np.min(commanded, axis=1) < 0, self._step),
            lift=float(np.max(heights - heights[0])),
            slide=float(np.max(np.linalg.norm(places - places[0], axis=2))),
        )


def _longest(true: np.ndarray, step: float) -> float:
    """s, for which it is true without a break."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], true.astype(int), [0]])))
    return step * float(np.max(edges[1::2] - edges[::2], initial=0))
