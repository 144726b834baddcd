"""Joints that follow others, against Pinocchio's mimic joints, the chain of all joints, and energy."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.indices.arms.values import rate_arm
from ocptip.robots.coupling import Coupling
from ocptip.robots.dynamics import evaluate_dynamics
from ocptip.robots.inverse.inverse_kinematics import solve_inverse_kinematics
from ocptip.robots.kinematics import gripper_pose, jacobian, link_frames
from ocptip.robots.model import ArmModel, JointLimits
from ocptip.robots.payload import Payload
from ocptip.robots.urdf.arm import arm_from_urdf
from ocptip.robots.urdf.collision import geometry_from_urdf
from tests.quick import examples
from tests.robots.pinocchio_twin import dynamics, twin

pytestmark = pytest.mark.filterwarnings("ignore::ocptip.basics.errors.InputWarning")  # odd masses
GRAVITY = [0.3, -0.2, -9.7]
ABOUT = [0.1, -0.3, 0.2]


def urdf_of(seed: int, slides: list[bool], mimics: dict[int, tuple[int, float, float]], collision="") -> str:
    """A chain of random bodies; joint i (from 1) mimics `mimics[i]`: joint, multiplier, offset."""
    rng = np.random.default_rng(seed)

    def three():
        return " ".join(f"{x:.17g}" for x in rng.normal(size=3))

    text = '<robot name="chain"><link name="l0"/>'
    for i, slide in enumerate(slides, 1):
        root = rng.normal(size=(3, 3))
        J = root @ root.T + np.eye(3)
        entries = {
            "ixx": J[0, 0],
            "ixy": J[0, 1],
            "ixz": J[0, 2],
            "iyy": J[1, 1],
            "iyz": J[1, 2],
            "izz": J[2, 2],
        }
        inertia = " ".join(f'{name}="{value:.17g}"' for name, value in entries.items())
        tag = '<mimic joint="j{}" multiplier="{}" offset="{}"/>'.format(*mimics[i]) if i in mimics else ""
        text += f'''<link name="l{i}"><inertial><origin xyz="{three()}" rpy="{three()}"/>
            <mass value="{rng.uniform(1, 3)}"/><inertia {inertia}/></inertial>{collision}</link>
            <joint name="j{i}" type="{"prismatic" if slide else "revolute"}">
            <parent link="l{i - 1}"/><child link="l{i}"/><origin xyz="{three()}" rpy="{three()}"/>
            <axis xyz="{three()}"/><limit lower="-3" upper="3" velocity="2" effort="50"/>{tag}</joint>'''
    return text + "</robot>"


def arm_of(folder, *arguments, **options) -> ArmModel:
    path = folder / "chain.urdf"
    path.write_text(urdf_of(*arguments, **options), encoding="utf-8")
    return arm_from_urdf(path, accept_inertia=True)


def uncoupled(arm: ArmModel) -> ArmModel:
    """All joints of the chain, each for itself."""
    count = arm.links
    return dataclasses.replace(
        arm,
        joint_names=arm.chain_names,
        prismatic=arm.slides,
        limits=JointLimits.unlimited(count),
        armature=np.zeros(count),
        spring_torque=np.zeros(count),
        spring_stiffness=np.zeros(count),
        coupling=None,
    )


@st.composite
def chains(draw, forwards: bool):
    slides = draw(st.lists(st.booleans(), min_size=2, max_size=6))
    numbers = range(1, len(slides) + 1)
    mimics = {}
    for i in numbers:
        others = [k for k in numbers if k not in mimics and (k < i if forwards else k != i)]
        followed = i in {m[0] for m in mimics.values()}
        if others and not followed and draw(st.booleans()):
            ratio = draw(st.sampled_from([1.0, -1.0, 0.5, -2.25]))
            mimics[i] = (draw(st.sampled_from(others)), ratio, draw(st.sampled_from([0.0, 0.3, -0.7])))
    assume(mimics)
    return draw(st.integers(0, 2**31 - 1)), slides, mimics


@examples(25)
@given(chain=chains(forwards=True))
def test_it_agrees_with_the_mimic_joints_of_pinocchio(chain, tmp_path_factory):
    folder = tmp_path_factory.mktemp("chain")
    arm = arm_of(folder, *chain)
    robot = pin.buildModelFromUrdf(str(folder / "chain.urdf"), True)
    robot.gravity.linear = np.array(GRAVITY)
    assert arm.n == robot.nv == len(chain[1]) - len(chain[2])
    data, rng = robot.createData(), np.random.default_rng(chain[0])
    q, qd, qdd = rng.uniform(-1, 1, (3, arm.n))
    pin.framesForwardKinematics(robot, data, q)
    torque = pin.rnea(robot, data, q, qd, qdd)
    found = evaluate_dynamics(arm, q, qd, qdd, gravity=GRAVITY, about=ABOUT)
    size = max(1.0, np.abs(torque).max())
    np.testing.assert_allclose(found.torque, torque, rtol=1e-12, atol=1e-12 * size)
    on_base = data.oMi[1].act(data.f[1])
    wrench = -np.concatenate([on_base.linear, on_base.angular - np.cross(ABOUT, on_base.linear)])
    np.testing.assert_allclose(found.wrench, wrench, rtol=1e-12, atol=1e-12 * size)
    frame = robot.getFrameId(f"l{len(chain[1])}", pin.FrameType.BODY)
    position, rotation = gripper_pose(arm, q)
    np.testing.assert_allclose(position, data.oMf[frame].translation, atol=1e-12)
    np.testing.assert_allclose(rotation, data.oMf[frame].rotation, atol=1e-12)


@examples(25)
@given(chain=chains(forwards=False))
def test_it_is_the_projection_of_the_chain_of_all_joints(chain, tmp_path_factory):
    """Torques are G' tau, in whatever order joints follow each other; tau by Pinocchio."""
    arm = arm_of(tmp_path_factory.mktemp("chain"), *chain).with_payload(Payload(2.0, [0.1, 0.2, 0.3]))
    coupling, rng = arm.coupling, np.random.default_rng(chain[0])
    arm = dataclasses.replace(arm, armature=rng.uniform(0, 2, arm.n))
    G = coupling.matrix
    q, qd, qdd = rng.uniform(-1, 1, (3, arm.n))
    force, moment = rng.normal(size=(2, 3))
    every = uncoupled(arm)
    torque, wrench = dynamics(
        twin(every), G @ q + coupling.offsets, G @ qd, G @ qdd, GRAVITY, force, moment, ABOUT
    )
    load = {"gravity": GRAVITY, "force": force, "moment": moment, "about": ABOUT}
    found = evaluate_dynamics(arm, q, qd, qdd, **load)
    size = max(1.0, np.abs(torque).max())
    np.testing.assert_allclose(found.torque, G.T @ torque + arm.armature * qdd, rtol=1e-12, atol=1e-12 * size)
    np.testing.assert_allclose(found.wrench, wrench, rtol=1e-12, atol=1e-12 * size)
    np.testing.assert_allclose(jacobian(arm, q), jacobian(every, G @ q + coupling.offsets) @ G, atol=1e-12)
    for name, (leader, ratio, offset) in chain[2].items():
        row = arm.chain_names.index(f"j{name}")
        assert arm.joint_names[coupling.leaders[row]] not in {f"j{k}" for k in chain[2]}
        if leader not in chain[2]:
            assert (coupling.ratios[row], coupling.offsets[row]) == (ratio, offset)


def test_power_is_the_change_of_energy(tmp_path):
    """d/dt (T + V) = torque . qd along a motion, by central differences; T and V from the links' frames."""
    arm = arm_of(tmp_path, 5, [False, True, False, True, False], {2: (1, 0.5, 0.1), 3: (5, -1.5, 0.0)})
    every, coupling = uncoupled(arm), arm.coupling
    amplitude, phase = np.random.default_rng(1).normal(size=(2, arm.n))

    def state(t):
        return amplitude * np.sin(t + phase), amplitude * np.cos(t + phase), -amplitude * np.sin(t + phase)

    def energy(t, h=1e-4):
        frames = [link_frames(arm, state(t + s)[0]) for s in (-h, 0.0, h)]
        before, now, after = ((f.rotations[:-1], f.origins[:-1]) for f in frames)
        centres = [o + np.einsum("kij,kj->ki", r, arm.centres) for r, o in (before, now, after)]
        speed = (centres[2] - centres[0]) / (2 * h)
        spins = (after[0] - before[0]) / (2 * h) @ now[0].transpose(0, 2, 1)
        omega = np.stack([spins[:, 2, 1], spins[:, 0, 2], spins[:, 1, 0]], axis=1)
        inertia = now[0] @ arm.inertias @ now[0].transpose(0, 2, 1)
        kinetic = 0.5 * arm.masses @ np.sum(speed**2, axis=1)
        kinetic += 0.5 * np.einsum("ki,kij,kj->", omega, inertia, omega)
        return kinetic - arm.masses @ (centres[1] @ GRAVITY)

    for t in (0.3, 1.1, 2.0):
        q, qd, qdd = state(t)
        power = evaluate_dynamics(arm, q, qd, qdd, gravity=GRAVITY).torque @ qd
        assert power == pytest.approx((energy(t + 1e-3) - energy(t - 1e-3)) / 2e-3, rel=1e-5, abs=1e-4)
    np.testing.assert_allclose(
        link_frames(arm, q).origins, link_frames(every, coupling.matrix @ q + coupling.offsets).origins
    )


def test_limits_of_all_joints_hold_for_the_one_that_leads(tmp_path):
    arm = arm_of(tmp_path, 0, [False, False, True, True], {2: (1, -2.0, 0.5), 4: (3, 0.25, 2.9)})
    assert arm.joint_names == ("j1", "j3")
    np.testing.assert_allclose(arm.limits.angle_min, [-1.25, -3])  # -3 <= 0.5 - 2 q <= 3
    np.testing.assert_allclose(arm.limits.angle_max, [1.75, 0.4])
    np.testing.assert_allclose(arm.limits.speed, [1.0, 2.0])
    np.testing.assert_allclose(arm.limits.torque, [50.0, 50.0])
    assert arm.units == ("rad", "m")
    assert arm.periodic.tolist() == [False, False]
    said = "j2 follows j1 at -2 times its value + 0.5; j4 follows j3 at 0.25 times its value + 2.9"
    assert f"coupled: {said}" in arm.notes
    with pytest.raises(InputError, match="limits leave no way to 'j1', for j2 follows j1"):
        arm_of(tmp_path, 0, [False, False], {2: (1, 1.0, 7.0)})


def test_what_leads_may_rest_and_what_follows_may_be_locked(tmp_path):
    path = tmp_path / "chain.urdf"
    path.write_text(urdf_of(0, [False] * 4, {2: (1, 0.5, 0.1), 4: (2, 2.0, 0.0)}), encoding="utf-8")
    options = {"accept_inertia": True}
    arm = arm_from_urdf(path, **options)
    np.testing.assert_allclose(arm.coupling.ratios, [1, 0.5, 1, 1.0])
    np.testing.assert_allclose(arm.coupling.offsets, [0, 0.1, 0, 0.2])
    rest = arm_from_urdf(path, locked_joints={"j1": 0.6}, **options)
    by_hand = arm_from_urdf(path, locked_joints={"j1": 0.6, "j2": 0.4, "j4": 0.8}, **options)
    assert rest.joint_names == by_hand.joint_names == ("j3",)
    np.testing.assert_array_equal(rest.offsets, by_hand.offsets)
    only = arm_from_urdf(path, locked_joints={"j2": 0.4}, **options)
    assert only.joint_names == ("j1", "j3")
    assert only.coupling is None
    path.write_text(urdf_of(0, [False] * 2, {2: (1, 0.0, 0.3)}), encoding="utf-8")
    assert arm_from_urdf(path, **options).joint_names == ("j1",)


@pytest.mark.parametrize(
    "mimics", [{1: (2, 1.0, 0.0), 2: (1, 1.0, 0.0)}, {1: (1, 1.0, 0.0)}, {2: (9, 1.0, 0.0)}]
)
def test_joints_that_follow_none_are_refused(tmp_path, mimics):
    with pytest.raises(InputError, match=r"joint 'j\d' mimics 'j\d', which is missing or mimics it as well"):
        arm_of(tmp_path, 0, [False, False, False], mimics)


def test_a_pose_is_reached(tmp_path):
    arm = arm_of(tmp_path, 3, [False] * 7, {3: (2, -1.5, 0.2)})
    q = np.array([0.3, -0.4, 0.5, 0.2, -0.6, 0.1])
    found = solve_inverse_kinematics(arm, *gripper_pose(arm, q))
    assert found.method == "search"
    assert np.abs(found.branches - q).max(axis=1).min() < 1e-6
    assert found.residuals.max() < 1e-9


def test_solids_move_with_their_links(tmp_path):
    ball = '<collision><origin xyz="0.1 0.2 0.3"/><geometry><sphere radius="0.05"/></geometry></collision>'
    arm = arm_of(tmp_path, 4, [False, True, False], {2: (1, 0.5, 0.3)}, collision=ball)
    path = tmp_path / "chain.urdf"
    geometry = geometry_from_urdf(path, arm)
    assert [(s.name, s.body) for s in geometry.shapes] == [("l1", 1), ("l2", 2), ("l3", 3)]
    robot = pin.buildModelFromUrdf(str(path), True)
    solids = pin.buildGeomFromUrdf(robot, str(path), pin.GeometryType.COLLISION)
    q = np.array([0.7, -0.4])
    data, placed = robot.createData(), solids.createData()
    pin.updateGeometryPlacements(robot, data, solids, placed, q)
    frames = link_frames(arm, q)
    for k, solid in enumerate(geometry.shapes):
        centre = frames.origins[k] + frames.rotations[k] @ solid.shape.position
        np.testing.assert_allclose(centre, placed.oMg[k].translation, atol=1e-12)


def test_indices_of_single_axes_refuse_it(tmp_path):
    arm = arm_of(tmp_path, 0, [False] * 7, {3: (2, 1.0, 0.0)})
    with pytest.raises(InputError, match="independent joints, but j3 follows j2 at 1 times its value"):
        rate_arm(arm, np.zeros(6))


@pytest.mark.parametrize(
    ("leaders", "ratios", "offsets", "leads"),
    [
        ([0, 0], [1, 0], [0, 0], [0]),
        ([1, 1], [1, 2], [0, 0], [0]),
        ([0, 0], [2, 2], [0, 0], [0]),
        ([0, 0], [1, 1], [0.1, 0.2], [0]),
        ([0, 0], [1, 1], [0, 0], [2]),
        ([0, 0], [1, 1], [0, 0], [0, 1]),
    ],
)
def test_couplings_without_a_joint_that_leads_are_refused(leaders, ratios, offsets, leads):
    with pytest.raises(InputError, match=r"leaders, ratios|leads"):
        Coupling(("a", "b"), np.zeros(2, bool), leaders, ratios, offsets, leads)
