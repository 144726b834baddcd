"""A machine that is not the library: MuJoCo with elastic joints, wrong masses, friction, delays and noise.

The base stands on its feet; the motors do what is commanded, the links hang on springs behind them. Sensors
are MuJoCo's own: interaction forces between bodies. Their noise is white.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ocptip.measured.recording import Recording, Signal
from ocptip.robots.bodies import ArmBodies, real_bodies
from ocptip.standing.arm import Robot
from ocptip.standing.simulation.mjcf import BASE, joint_offsets, joint_order, to_mjcf
from ocptip.standing.simulation.replay import library_mujoco, prescribed
from ocptip.trajectories.trajectory import Trajectory

STEP, PERIOD = 1e-4, 1e-3  # s
BEFORE, AFTER, SETTLED = 0.15, 0.3, 0.05  # s
RANGE = 0.5, 99.5  # %, of samples
NOISE = {
    "q": 2e-4,
    "tau": 0.1,
    "f": 0.2,
    "m": 0.04,
    "power": 2.0,
    "gripper": 1e-4,
    "base": 2e-5,
    "turn": 1e-4,
}
"""Standard deviations: rad, N m, N, N m, W, m, m, rad."""

STILL = 1e-6  # rad/s: a joint that is slower rests
TURNS = {"x": "roll", "y": "pitch", "z": "yaw"}
SENSORS = ("FORCE", "TORQUE", "FRAMEANGACC", "FRAMEXAXIS", "FRAMEYAXIS", "FRAMEZAXIS")


@dataclass(frozen=True)
class Faults:
    """How the machine differs from what is described; numbers of links and joints from 0.

    Attributes:
        masses: factor by link.
        coulomb: N m by joint.
        stiffness: N m/rad by joint, with a damping of 5 %; the others are stiff.
        delays: s by joint.
        sensor_delay: s, of the force-torque sensor.
        zeros: by signal, SI.
        noisy: factor by signal.
        clip: share of its range, that of 99 % of the samples, by signal, above which it is cut off.
        missing: signals without samples in a fifth of the time.
    """

    masses: dict[int, float] = field(default_factory=dict)
    coulomb: dict[int, float] = field(default_factory=dict)
    stiffness: dict[int, float] = field(default_factory=dict)
    delays: dict[int, float] = field(default_factory=dict)
    sensor_delay: float = 0.0
    zeros: dict[str, float] = field(default_factory=dict)
    noisy: dict[str, float] = field(default_factory=dict)
    clip: dict[str, float] = field(default_factory=dict)
    missing: tuple[str, ...] = ()


def record(
    robot: Robot, motion: Trajectory, faults: Faults, rng: np.random.Generator, *, feet: bool = False
) -> Recording:
    """A recording, at 1 kHz, whose clock starts anywhere; bolted down, or on its feet."""
    return sampled(simulated(robot, motion, faults, feet), faults, rng)


def sampled(
    simulation: tuple[np.ndarray, dict[str, np.ndarray]], faults: Faults, rng: np.random.Generator
) -> Recording:
    """A recording of what was simulated, with noise and a clock of its own."""
    times, seen = simulation
    begin = BEFORE - SETTLED + rng.uniform(0.0, PERIOD)
    own = np.arange(SETTLED + 1e-6, times[-1] + BEFORE - 2 * PERIOD, PERIOD) - SETTLED  # of the recording
    signals = []
    for name, values in seen.items():
        late = faults.sensor_delay if name[0] in "fm" else 0.0
        y = np.interp(own - begin - late, times, values)
        y = y + faults.zeros.get(name, 0.0)
        y += faults.noisy.get(name, 1.0) * _noise(name) * rng.normal(size=len(y))
        if name in faults.clip:
            low, high = np.percentile(y, RANGE)  # single spikes are no range
            y = np.minimum(y, low + faults.clip[name] * (high - low))
        if name in faults.missing:
            first = int(rng.uniform(0.1, 0.7) * len(y))
            y[first : first + len(y) // 5] = np.nan
        signals.append(Signal(name, *_kind(name), y))
    return Recording(rng.uniform(0, 100) + own, tuple(signals))


def _noise(name: str) -> float:
    for key, value in NOISE.items():
        if name.startswith(key):
            return NOISE["turn"] if name in ("base_roll", "base_pitch", "base_yaw") else value
    raise KeyError(name)


def _kind(name: str) -> tuple[str, int]:
    places = ("x", "y", "z", "roll", "pitch", "yaw")
    if name.startswith("tau"):
        return "torques", int(name[3:]) - 1
    if name.startswith("q"):
        return "angles", int(name[1:]) - 1
    if name in ("fx", "fy", "fz", "mx", "my", "mz"):
        return "sensor", ("fx", "fy", "fz", "mx", "my", "mz").index(name)
    if name == "power":
        return "power", 0
    return name.split("_")[0], places.index(name.split("_")[1])


def simulated(
    robot: Robot, motion: Trajectory, faults: Faults, feet: bool = False
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times, s of the motion, and what sensors would show without noise."""
    mujoco = library_mujoco()
    robot = _as_built(robot, faults)
    bodies = real_bodies(robot.arm)
    model, springs = _model(robot, motion, faults, bodies, feet)
    late = np.array([faults.delays.get(j, 0.0) for j in range(robot.n)])
    count = int(np.ceil((BEFORE + motion.end + AFTER) / STEP))
    times = STEP * np.arange(count + 1) - BEFORE
    speeds = joint_order(robot, bodies, _speeds(motion, times, late))
    controls = np.diff(speeds, axis=0) / STEP
    data = mujoco.MjData(model)
    if feet:
        data.qpos[:3] = robot.support.center_of_mass
    first = joint_order(robot, bodies, motion.start) + joint_offsets(robot, bodies)
    driven = [j for j in range(int(feet), model.njnt) if model.joint(j).name not in springs]
    data.qpos[[model.jnt_qposadr[j] for j in driven]] = first
    still = np.zeros((1, robot.n))
    torques = robot.loads(motion.start[None], still, still)[0][0]
    for name, (joint, stiffness) in springs.items():
        data.joint(name).qpos[0] = -torques[joint] / stiffness
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    states, sensed = mujoco.rollout.rollout(model, [data], state[None], controls[None])
    middle = times[:-1] + 0.5 * STEP
    return middle, _sensors(robot, model, faults, bodies, springs, sensed[0], states[0])


def _as_built(robot: Robot, faults: Faults) -> Robot:
    """With the masses that it has."""
    factors = np.array([faults.masses.get(k, 1.0) for k in range(robot.arm.links)])
    arm = replace(
        robot.arm, masses=factors * robot.arm.masses, inertias=factors[:, None, None] * robot.arm.inertias,
        payload=None, bare_link=None,
    )  # fmt: skip
    return robot.varied(arm=arm)


def _model(
    robot: Robot, motion: Trajectory, faults: Faults, bodies: ArmBodies, feet: bool
) -> tuple[Any, dict[str, tuple[int, float]]]:
    """The model, and by the names of its springs joint and stiffness."""
    mujoco = library_mujoco()
    spec = mujoco.MjSpec.from_string(to_mjcf(robot, motion))
    for what in (*spec.actuators, *spec.equalities, *spec.keys):
        spec.delete(what)
    if not feet:
        spec.delete(spec.joint(BASE))
    still = np.zeros((1, robot.n))
    bias = robot.loads(motion.start[None], still, still)[0][0]
    springs = {}
    for k, name in enumerate(robot.arm.chain_names):
        body = spec.body(f"link {k + 1}")
        site = f"flange {k + 1}"
        body.add_site(name=site)
        for kind in SENSORS:
            spec.add_sensor(
                name=f"{kind} {k + 1}", type=getattr(mujoco.mjtSensor, f"mjSENS_{kind}"), objname=site,
                objtype=mujoco.mjtObj.mjOBJ_SITE,
            )  # fmt: skip
        if k in faults.stiffness:
            unit = np.eye(robot.n)[k]
            inertia = (robot.loads(motion.start[None], still, unit[None])[0][0] - bias)[k]
            stiffness = faults.stiffness[k]
            springs[f"{name} spring"] = (k, stiffness)
            body.add_joint(
                name=f"{name} spring", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1],
                stiffness=stiffness, damping=2 * 0.05 * np.sqrt(stiffness * abs(inertia)),
            )  # fmt: skip
    spec.add_sensor(
        name="gripper", type=mujoco.mjtSensor.mjSENS_FRAMEPOS, objname="gripper",
        objtype=mujoco.mjtObj.mjOBJ_SITE,
    )  # fmt: skip
    model = prescribed(spec.to_xml(), STEP).compile()
    return model, springs


def _sensors(
    robot: Robot,
    model: Any,
    faults: Faults,
    bodies: ArmBodies,
    springs: dict[str, tuple[int, float]],
    sensed: np.ndarray,
    states: np.ndarray,
) -> dict[str, np.ndarray]:
    """Signals without noise, SI."""

    def read(name: str) -> np.ndarray:
        sensor = model.sensor(name)
        return sensed[:, sensor.adr[0] : sensor.adr[0] + sensor.dim[0]]

    found = {}
    count = len(sensed)
    # the state after a step is that of the next sensors
    qpos = np.vstack([np.full(model.nq, np.nan), states[:-1, 1 : 1 + model.nq]])
    qvel = np.vstack([np.zeros(model.nv), states[:-1, 1 + model.nq : 1 + model.nq + model.nv]])
    drives, own = np.zeros((count, robot.n)), np.zeros((count, robot.n))
    for k, name in enumerate(robot.arm.chain_names):
        joint = model.joint(name)
        q, qd = qpos[:, joint.qposadr[0]], qvel[:, joint.dofadr[0]]
        drives[:, k] = qd
        if f"{name} spring" in springs:
            spring = model.joint(f"{name} spring")
            q = q + qpos[:, spring.qposadr[0]]
        q[0] = q[1]
        found[f"q{k + 1}"] = q
        own[:, k] = read(f"TORQUE {k + 1}")[:, 2]
        turning = np.sum(read(f"FRAMEANGACC {k + 1}") * read(f"FRAMEZAXIS {k + 1}"), axis=1)
        # what a drive's rotor needs is not in the interaction of the links
        own[:, k] += sum(r.ratio * r.axial for r in bodies.rotors if r.joint == k) * turning
    for k in range(robot.n):
        own[:, k] += faults.coulomb.get(k, 0.0) * np.sign(
            np.where(np.abs(drives[:, k]) > STILL, drives[:, k], 0)
        )
        found[f"tau{k + 1}"] = own[:, k]
    frame = np.stack([read(f"FRAME{axis}AXIS 1") for axis in "XYZ"], axis=-1)
    # the base turns by less than a thousandth: its axes are taken as those of the world
    force = -np.einsum("nij,nj->ni", frame, read("FORCE 1"))
    moment = -np.einsum("nij,nj->ni", frame, read("TORQUE 1"))
    for axis, f, m in zip("xyz", force.T, moment.T, strict=True):
        found[f"f{axis}"], found[f"m{axis}"] = f, m
    direction = np.where(drives < -STILL, -1.0, 1.0)  # maps jump where a speed changes sign
    found["power"] = robot.motors.power(own, drives, direction).sum(axis=1)
    place = read("gripper")
    for axis, values in zip("xyz", place.T, strict=True):
        found[f"gripper_{axis}"] = values
    if model.joint(0).name != BASE:
        return found
    base = qpos[:, :7].copy()
    base[0] = base[1]
    for axis, values, turn in zip(
        "xyz", (base[:, :3] - robot.support.center_of_mass).T, base[:, 4:].T, strict=True
    ):
        found[f"base_{axis}"] = values
        found[f"base_{TURNS[axis]}"] = 2 * turn
    return found


def _speeds(motion: Trajectory, times: np.ndarray, late: np.ndarray) -> np.ndarray:
    """(T, n) of the motors, each late by its time."""
    found = np.empty((len(times), len(late)))
    for j, delay in enumerate(late):
        own = times - delay
        speeds = motion.states(np.clip(own, 0.0, motion.end))[1][:, j]
        found[:, j] = np.where((own <= 0) | (own >= motion.end), 0.0, speeds)
    return found
