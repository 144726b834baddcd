"""Exported models: real bodies, the library's masses, and the same wrench on the base for any motion."""

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.clamps import (
    ForceConstantTwoSidedClamp,
    ForceVariableHalfRigidClamp,
    RigidClamp,
)
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.bindings.wheel import FreeWheel
from ocptip.published.tasks import experiment_task
from ocptip.robots.bodies import exists, real_bodies
from ocptip.robots.payload import Payload
from ocptip.standing.simulation.mjcf import joint_offsets, joint_order, to_mjcf
from ocptip.standing.simulation.urdf import to_urdf
from ocptip.task_files.motion import load_task
from tests.places import EXAMPLES
from tests.quick import examples


def holding(robot, payload):
    return robot.varied(arm=robot.arm.with_payload(payload))


BOX = Payload.box(1.5, [0.1, 0.2, 0.05], [0.01, 0.02, 0.06])
ROBOTS = {
    "A": experiment_task("A").robot,
    "E": experiment_task("E").robot,
    "G holds a box": holding(experiment_task("G").robot, BOX),
    "UR5 holds a point": holding(load_task(EXAMPLES / "tasks/ur5_cart.toml").robot, Payload(2.0)),
}
MODELS = {name: mujoco.MjModel.from_xml_string(to_mjcf(robot)) for name, robot in ROBOTS.items()}
TREES = {
    name: pin.buildModelFromXML(to_urdf(robot), pin.JointModelFreeFlyer()) for name, robot in ROBOTS.items()
}


def states(robot, seed):
    return np.random.default_rng(seed).uniform(-2, 2, (3, robot.n))


@pytest.mark.parametrize("name", ROBOTS)
@examples(10)
@given(seed=st.integers(0, 10**6))
def test_base_feels_the_same_in_mujoco(name, seed):
    robot, model = ROBOTS[name], MODELS[name]
    data, bodies = mujoco.MjData(model), real_bodies(robot.arm)
    q, qd, qdd = states(robot, seed)
    data.qpos[:3] = robot.support.center_of_mass
    data.qpos[7:] = joint_order(robot, bodies, q) + joint_offsets(robot, bodies)
    data.qvel[6:] = joint_order(robot, bodies, qd)
    for step in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_crb, mujoco.mj_comVel):
        step(model, data)
    data.qacc[:], forces = 0.0, np.zeros(model.nv)
    data.qacc[6:] = joint_order(robot, bodies, qdd)
    mujoco.mj_rne(model, data, 1, forces)
    wrench = robot.loads(q[None], qd[None], qdd[None])[1][0]
    assert np.allclose(forces[:6], -wrench, atol=1e-7 * np.abs(wrench).max())


@pytest.mark.parametrize("name", ROBOTS)
def test_base_feels_the_same_in_a_tree_read_from_urdf(name):
    robot, model = ROBOTS[name], TREES[name]
    bodies, data = real_bodies(robot.arm), model.createData()
    ratios = {f"{robot.names[rotor.joint]} rotor": (rotor.joint, rotor.ratio) for rotor in bodies.rotors}
    ratios |= {joint: (k, 1.0) for k, joint in enumerate(robot.names)}
    for seed in range(5):
        vectors = []
        for values in states(robot, seed):
            found = np.zeros(model.nv)
            for joint, (k, ratio) in ratios.items():
                own = model.joints[model.getJointId(joint)]
                found[own.idx_v] = ratio * values[k]
            vectors.append(found)
        model.gravity.linear = robot.support.gravity
        q = pin.integrate(model, pin.neutral(model), vectors[0])
        forces = pin.rnea(model, data, q, vectors[1], vectors[2])[:6]  # about the base axes' origin
        wrench = robot.loads(*(values[None] for values in states(robot, seed)))[1][0]
        moment = wrench[3:] + np.cross(robot.support.center_of_mass, wrench[:3])
        assert np.allclose(forces, -np.append(wrench[:3], moment), atol=1e-7 * np.abs(wrench).max())


@pytest.mark.parametrize("name", ROBOTS)
def test_masses_are_those_of_the_task(name):
    robot, model = ROBOTS[name], MODELS[name]
    assert model.body_mass.sum() == pytest.approx(robot.mass, rel=1e-12)
    assert model.body("base").mass[0] == robot.support.mass
    assert sum(inertia.mass for inertia in TREES[name].inertias) == pytest.approx(robot.mass, rel=1e-9)


def test_links_that_exist_are_left_alone():
    arm = ROBOTS["UR5 holds a point"].arm
    bodies = real_bodies(arm)
    assert not bodies.rotors
    assert all(
        link[0] == mass for link, mass in zip(bodies.links, arm.with_payload(None).masses, strict=True)
    )


@pytest.mark.parametrize("name", ["A", "E"])
def test_links_that_do_not_exist_become_bodies_with_rotors(name):
    arm = ROBOTS[name].arm
    bodies = real_bodies(arm)
    assert np.linalg.eigvalsh(arm.inertias).min() < 0
    assert all(exists(link) for link in bodies.links)
    assert all(rotor.axial > 0 and 1 <= abs(rotor.ratio) <= 100.1 for rotor in bodies.rotors)
    spin = sum(rotor.axial * abs(rotor.ratio) for rotor in bodies.rotors)
    assert 0 < spin < 0.02  # kg m^2; the drives' own axial moments are of 0.01


def test_impossible_links_are_refused():
    arm = ROBOTS["UR5 holds a point"].arm
    inertias = np.array(arm.inertias)
    inertias[-1] = -np.eye(3)
    with pytest.raises(InputError, match="no model of it for a simulator"):
        real_bodies(type(arm)(**{**vars(arm), "inertias": inertias, "bare_link": None, "payload": None}))


def test_feet_that_give_have_their_mass_from_the_base():
    robot = ROBOTS["A"]
    own = robot.support
    feet = [
        UnilateralContact(position=c.position, friction=0.3, stiffness=1e6, damping_ratio=0.1)
        for c in own.contacts
    ]
    soft = own.varied(feet)
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot.varied(support=soft)))
    assert model.body_mass.sum() == pytest.approx(robot.mass, rel=1e-12)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    stiff = MODELS["A"]
    other = mujoco.MjData(stiff)
    mujoco.mj_resetDataKeyframe(stiff, other, 0)
    mujoco.mj_forward(stiff, other)
    bias = data.qfrc_bias[:6], other.qfrc_bias[:6]
    assert np.allclose(*bias, atol=1e-9)  # same weight and first moments
    rigid, given_way = (np.zeros((m.nv, m.nv)) for m in (stiff, model))
    mujoco.mj_fullM(stiff, other, rigid)
    mujoco.mj_fullM(model, data, given_way)
    assert np.allclose(rigid[:6, :6], given_way[:6, :6], atol=1e-9)


def test_clamps_have_two_jaws_and_springs_need_a_stiffness():
    robot = ROBOTS["A"]
    own = robot.support
    clamp = RigidClamp(position=own.contacts[0].position, friction_upper=0.2, friction_lower=0.3)
    support = own.varied([clamp, *own.contacts[1:]])
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot.varied(support=support)))
    assert model.npair == 4
    assert sorted(model.pair_friction[:, 0]) == [0.2, 0.2, 0.2, 0.3]
    spring = ForceVariableHalfRigidClamp(
        position=own.contacts[0].position, friction_upper=0.2, friction_lower=0.3, clamp_force=9.0
    )
    with pytest.raises(InputError, match="contact 1: a force-variable-half-rigid-clamp keeps its preload by"):
        to_mjcf(robot.varied(support=own.varied([spring, *own.contacts[1:]])))
    soft = [replace(contact, stiffness=1e6) for contact in (spring, *own.contacts[1:])]
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot.varied(support=own.varied(soft))))
    jaw = model.joint("jaw1_lower")
    assert (jaw.stiffness[0], jaw.stiffness[0] * model.qpos_spring[jaw.qposadr[0]]) == pytest.approx(
        (1e6, 9.0)
    )
    wheel = FreeWheel(position=own.contacts[0].position, friction=0.5)
    with pytest.raises(InputError, match="contact 1: a free-wheel has no model for a simulator"):
        to_mjcf(robot.varied(support=own.varied([wheel, *own.contacts[1:]])))


@pytest.mark.parametrize("ratio", [0.5, 2.0])
def test_jaws_on_a_lever_share_its_force(ratio):
    """i / (1 + i) F_o + F_u / (1 + i) = F, whatever pulls at the clamp (A.5)."""
    robot = experiment_task("C").robot
    own = robot.support.contacts
    jaws = {"position": own[2].position, "friction_upper": 0.2, "friction_lower": 0.3}
    clamp = ForceConstantTwoSidedClamp(**jaws, clamp_force=100.0, lever_ratio=ratio)
    held = robot.varied(support=robot.support.varied([*own[:2], clamp]))
    model = mujoco.MjModel.from_xml_string(to_mjcf(held))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(3000):
        mujoco.mj_step(model, data)
    upper, lower = (data.sensor(f"foot3{side}_force").data[0] for side in ("", "_lower"))
    assert (ratio * upper + lower) / (1 + ratio) == pytest.approx(100.0, rel=1e-3)
    still = np.zeros((1, robot.n))
    expected = held.contact_states(held.loads(still, still, still)[1]).contact_forces[0, 2, 0]
    assert upper - lower == pytest.approx(expected, abs=0.2)
    assert lower > 10


def test_jaw_of_constant_force_presses_with_it_wherever_it_is():
    robot = experiment_task("C").robot
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot))
    data = mujoco.MjData(model)
    jaw = model.joint("jaw3_lower")
    assert model.npair == 4
    assert model.body_mass.sum() == pytest.approx(robot.mass + 0.03 * robot.support.mass, rel=1e-12)
    for travel in (0.0, 0.02):
        data.qpos[jaw.qposadr] = travel
        mujoco.mj_forward(model, data)
        force = data.qfrc_passive - data.qfrc_bias  # gravity and its compensation
        assert force[jaw.dofadr] == pytest.approx(29.33, abs=1e-6)
        assert data.xaxis[jaw.id] == pytest.approx([0, 0, -1])  # downwards onto the base
    assert "jaws of clamps" in to_urdf(robot)


def test_parallel_robots_are_refused():
    robot = load_task(EXAMPLES / "tasks/delta_cart.toml").robot
    with pytest.raises(InputError, match="only arms are exported"):
        to_mjcf(robot)
