"""Arms out of URDF files: chains with all kinds of joints and branches, against Pinocchio's own numbers."""

import numpy as np
import pinocchio as pin
import pytest

from ocptip.basics.errors import InputError
from ocptip.robots.dynamics import evaluate_dynamics
from ocptip.robots.kinematics import gripper_pose
from ocptip.robots.urdf.arm import arm_from_pinocchio, arm_from_urdf
from ocptip.robots.urdf.file import like_tools, read_urdf
from tests.places import UR5
from tests.robots.pinocchio_twin import dynamics, twin


def link(name: str, mass: float = 1.0) -> str:
    return f"""<link name="{name}"><inertial><origin xyz="0.1 0.02 -0.03" rpy="0.3 0.1 0.2"/>
      <mass value="{mass}"/>
      <inertia ixx="0.02" ixy="0.001" ixz="0.002" iyy="0.03" iyz="-0.001" izz="0.04"/></inertial></link>"""


def joint(name: str, kind: str, parent: str, child: str, axis: str = "0 0 1", limit: str = "") -> str:
    return f"""<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
      <origin xyz="0.1 0.2 0.3" rpy="0.4 -0.5 0.6"/><axis xyz="{axis}"/>{limit}</joint>"""


LIMIT = '<limit lower="-2" upper="1.5" velocity="3" effort="40"/>'
SERVICE_ROBOT = "".join(
    [
        '<robot name="service">',
        *(link(n) for n in ("cart", "torso", "head", "upper", "middle", "lower", "hand", "finger")),
        joint("lift", "prismatic", "cart", "torso", "0 0 1", LIMIT),
        joint("neck", "revolute", "torso", "head", "0 1 0", LIMIT),
        joint("shoulder", "continuous", "torso", "upper", "0 -1 0"),
        joint("elbow", "revolute", "upper", "middle", "0.6 0 -0.8", LIMIT),
        joint("roll", "revolute", "middle", "lower", "-1 0 0", LIMIT),
        joint("wrist", "continuous", "lower", "hand", "0.36 0.48 0.8"),
        joint("grip", "prismatic", "hand", "finger", "0 1 0", LIMIT),
        '<link name="tool"/><joint name="flange" type="fixed"><parent link="hand"/><child link="tool"/>',
        '<origin xyz="0 0 0.1" rpy="1 0 0.5"/></joint>',
        "</robot>",
    ]
)
NAMES = {"base_link": "cart", "tool_frame": "tool"}
LOCKED = {"lift": 0.15, "grip": 0.01}


@pytest.fixture
def service_robot(tmp_path):
    file = tmp_path / "service.urdf"
    file.write_text(SERVICE_ROBOT, encoding="utf-8")
    return file


def test_arm_on_a_lift_agrees_with_pinocchio(service_robot):
    model = arm_from_urdf(service_robot, **NAMES, locked_joints=LOCKED)
    assert model.joint_names == ("shoulder", "elbow", "roll", "wrist")
    whole = pin.buildModelFromUrdf(str(service_robot))
    data = whole.createData()
    robot = twin(model)
    rng = np.random.default_rng(0)
    for q, qd, qdd in rng.uniform(-1.4, 1.4, (10, 3, 4)):
        full = pin.neutral(whole)
        for name, angle in {**dict(zip(model.joint_names, q, strict=True)), **LOCKED}.items():
            moved = whole.joints[whole.getJointId(name)]
            full[moved.idx_q : moved.idx_q + moved.nq] = (
                angle if moved.nq == 1 else (np.cos(angle), np.sin(angle))
            )
        order = [whole.joints[whole.getJointId(name)].idx_v for name in model.joint_names]
        velocity, acceleration = np.zeros((2, whole.nv))
        velocity[order], acceleration[order] = qd, qdd
        whole.gravity.linear = np.array([1.0, -2.0, -9.0])
        torque = pin.rnea(whole, data, full, velocity, acceleration)[order]
        pin.framesForwardKinematics(whole, data, full)
        tool = data.oMf[whole.getFrameId("tool")]
        position, rotation = gripper_pose(model, q)
        np.testing.assert_allclose(position, tool.translation, atol=1e-13)
        np.testing.assert_allclose(rotation, tool.rotation, atol=1e-13)
        ours = evaluate_dynamics(model, q, qd, qdd, gravity=[1.0, -2.0, -9.0])
        np.testing.assert_allclose(ours.torque, torque, rtol=1e-10, atol=1e-11)
        # The wrench at the shoulder, from the whole robot's coupling force there.
        f = data.oMi[whole.getJointId("shoulder")].act(data.f[whole.getJointId("shoulder")])
        np.testing.assert_allclose(
            ours.wrench, -np.concatenate([f.linear, f.angular]), rtol=1e-10, atol=1e-10
        )
        np.testing.assert_allclose(
            ours.torque, dynamics(robot, q, qd, qdd, [1.0, -2.0, -9.0], *np.zeros((3, 3)))[0], atol=1e-11
        )


def test_base_in_the_middle_needs_no_lift(service_robot):
    high = arm_from_urdf(service_robot, base_link="torso", tool_frame="tool", locked_joints={"grip": 0.01})
    low = arm_from_urdf(service_robot, **NAMES, locked_joints=LOCKED)
    q = np.array([0.1, 0.2, 0.3, 0.4])
    zero = np.zeros(4)
    np.testing.assert_allclose(high.offsets, low.offsets, atol=1e-14)
    still = {"gravity": (0.0, 0.0, 0.0)}
    np.testing.assert_allclose(
        evaluate_dynamics(high, q, q, zero, **still).torque,
        evaluate_dynamics(low, q, q, zero, **still).torque,
    )


def test_limits(service_robot):
    model = arm_from_urdf(service_robot, **NAMES, locked_joints=LOCKED, acceleration=np.full(4, 5.0))
    np.testing.assert_array_equal(model.limits.angle_min, [-np.inf, -2, -2, -np.inf])
    np.testing.assert_array_equal(model.limits.angle_max, [np.inf, 1.5, 1.5, np.inf])
    np.testing.assert_array_equal(model.limits.speed, [np.inf, 3, 3, np.inf])
    np.testing.assert_array_equal(model.limits.torque, [np.inf, 40, 40, np.inf])
    np.testing.assert_array_equal(model.limits.acceleration, 5)


@pytest.mark.parametrize("version", ["", ' version="1.2"'])
def test_limits_without_effort_or_velocity_are_none(tmp_path, version):
    """Makers leave them out, of wheels for instance; the parser of older versions would refuse the file."""
    head = SERVICE_ROBOT.replace('<robot name="service">', f'<robot name="service"{version}>')
    missing = head.replace(' effort="40"', "", 1).replace(' velocity="3"', "", 2)
    zero = head.replace(' effort="40"', ' effort="0"', 1).replace(' velocity="3"', ' velocity="0"', 2)
    arms = []
    for text in (missing, zero):
        (tmp_path / "robot.urdf").write_text(text)
        arms.append(arm_from_urdf(tmp_path / "robot.urdf", base_link="cart", tool_frame="tool"))
    found, wanted = arms
    for name in ("angle_min", "angle_max", "speed", "torque"):
        np.testing.assert_array_equal(getattr(found.limits, name), getattr(wanted.limits, name))
    assert np.isinf(found.limits.torque[0])
    assert np.isinf(found.limits.speed[0])


def test_ur5_reach_and_weight():
    model = arm_from_urdf(UR5, base_link="base_link", tool_frame="tool0")
    assert model.n == 6
    position, _ = gripper_pose(model, np.zeros(6))
    # Stretched out along -x: both arm lengths; then the wrist's offsets.
    np.testing.assert_allclose(position, [-0.81725, -0.10915 - 0.0823, 0.089159 - 0.09465], atol=1e-9)
    torque = evaluate_dynamics(model, np.zeros(6), np.zeros(6), np.zeros(6)).torque
    assert abs(torque[0]) < 1e-12
    assert 40 < abs(torque[1]) < 80
    weight = evaluate_dynamics(model, np.zeros(6), np.zeros(6), np.zeros(6)).wrench[2]
    assert weight == pytest.approx(-9.81 * 17.0489)


def test_sample_arm_of_pinocchio_with_armature():
    robot = pin.buildSampleModelManipulator()
    robot.armature = np.arange(6) / 10
    model = arm_from_pinocchio(robot, base_link="universe", tool_frame="effector_body")
    np.testing.assert_array_equal(model.armature, np.arange(6) / 10)
    other = arm_from_pinocchio(robot, base_link="universe", tool_frame="effector_body", armature=np.ones(6))
    np.testing.assert_array_equal(other.armature, 1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"base_link": "kart"}, "base_link: no 'kart'; candidates: cart, torso, .*; did you mean 'cart'"),
        ({"tool_frame": "tcp"}, "tool_frame: no 'tcp'; candidates: head, hand, tool"),
        ({"base_link": "hand", "tool_frame": "head"}, "'head' is not behind base_link 'hand'"),
        ({"base_link": "hand"}, "no free joint between 'hand' and 'tool'"),
        (
            {"locked_joints": {"lft": 0.1}},
            "locked_joints: no 'lft'; there are .*elbow.*; did you mean 'lift'",
        ),
        ({"locked_joints": LOCKED | {"roll": np.nan}}, r"locked_joints\['roll'\]: must be finite"),
        ({"armature": np.zeros(3)}, "armature: expected shape 4, got 3"),
    ],
)
def test_errors_list_what_exists(service_robot, change, message):
    arguments = NAMES | {"locked_joints": LOCKED} | change
    with pytest.raises(InputError, match=message):
        arm_from_urdf(service_robot, **arguments)


def test_negative_inertias_that_are_meant_are_taken_as_they_are(service_robot):
    # A rotor split between two links is written so, and the parser does not object.
    service_robot.write_text(SERVICE_ROBOT.replace('izz="0.04"', 'izz="-0.04"'), encoding="utf-8")
    model = arm_from_urdf(service_robot, **NAMES, locked_joints=LOCKED, accept_inertia=True)
    assert np.linalg.eigvalsh(model.inertias[0]).min() == pytest.approx(-0.04, abs=1e-3)


def test_unreadable_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        arm_from_urdf(tmp_path / "none.urdf", **NAMES)
    broken = tmp_path / "broken.urdf"
    broken.write_text("<robot>", encoding="utf-8")
    with pytest.raises(InputError, match=r"broken\.urdf: broken XML: no element found: line 1"):
        arm_from_urdf(broken, **NAMES)


def test_joints_off_the_way_are_locked_at_zero_or_at_the_limit_next_to_it(service_robot):
    asked = arm_from_urdf(service_robot, **NAMES, locked_joints={"neck": 0.0, "grip": 0.3})
    assert asked.notes == ()
    service_robot.write_text(
        SERVICE_ROBOT.replace('lower="-2" upper="1.5"', 'lower="0.3" upper="1.5"'), encoding="utf-8"
    )
    model = arm_from_urdf(service_robot, **NAMES)
    assert model.joint_names == ("lift", "shoulder", "elbow", "roll", "wrist")
    assert model.prismatic.tolist() == [True, False, False, False, False]
    assert model.notes == ("locked, not in the chain to the tool: neck, grip at 0.3 (rad, sliding joints m)",)
    zero = np.zeros((2, 5))
    q = np.array([0.4, 0.1, 0.5, 0.7, 0.2])
    own = evaluate_dynamics(arm_from_urdf(service_robot, **NAMES, locked_joints={"neck": 0.3}), q, *zero)
    np.testing.assert_array_equal(evaluate_dynamics(model, q, *zero).torque, own.torque)
    assert evaluate_dynamics(asked, q, *zero).torque[0] == pytest.approx(
        own.torque[0]
    )  # a lift carries weight


def test_a_lift_that_moves_agrees_with_pinocchio(service_robot):
    model, whole = arm_from_urdf(service_robot, **NAMES), pin.buildModelFromUrdf(str(service_robot))
    data = whole.createData()
    q, qd, qdd = np.random.default_rng(3).uniform(-1.4, 1.4, (3, 5))
    full, velocity, acceleration = pin.neutral(whole), np.zeros(whole.nv), np.zeros(whole.nv)
    for name, angle, speed, change in zip(model.joint_names, q, qd, qdd, strict=True):
        joint = whole.joints[whole.getJointId(name)]
        full[joint.idx_q : joint.idx_q + joint.nq] = (
            angle if joint.nq == 1 else (np.cos(angle), np.sin(angle))
        )
        velocity[joint.idx_v], acceleration[joint.idx_v] = speed, change
    torque = pin.rnea(whole, data, full, velocity, acceleration)
    order = [whole.joints[whole.getJointId(name)].idx_v for name in model.joint_names]
    ours = evaluate_dynamics(model, q, qd, qdd)
    np.testing.assert_allclose(ours.torque, torque[order], rtol=1e-12, atol=1e-11)
    np.testing.assert_allclose(np.linalg.norm(ours.wrench[:3]), np.linalg.norm(data.f[1].linear), rtol=1e-12)


def with_fingers(mimic: str) -> str:
    """The service robot with a second finger that mimics something."""
    finger = link("finger 2") + joint("grip 2", "prismatic", "hand", "finger 2", "0 -1 0", LIMIT + mimic)
    heavy = SERVICE_ROBOT.replace('<mass value="1.0"/>', '<mass value="3.0"/>')
    return heavy.replace("</robot>", finger + "</robot>")


@pytest.mark.parametrize(("locked", "at"), [({"grip": 0.1}, 0.25), ({}, 0.05), ({"grip 2": 0.7}, 0.7)])
def test_a_joint_that_mimics_one_at_rest_follows_it(service_robot, locked, at):
    mimic = '<mimic joint="grip" multiplier="2" offset="0.05"/>'
    service_robot.write_text(with_fingers(mimic), encoding="utf-8")
    found = arm_from_urdf(service_robot, **NAMES, locked_joints=locked)
    by_hand = arm_from_urdf(service_robot, **NAMES, locked_joints={"grip": 0.0, **locked, "grip 2": at})
    np.testing.assert_array_equal(found.centres, by_hand.centres)
    tool = arm_from_urdf(service_robot, base_link="cart", tool_frame="finger 2", locked_joints=locked)
    assert "grip 2" not in tool.joint_names
    if "grip 2" not in locked:
        assert any(f"grip 2 at {at}" in note for note in found.notes)


def test_a_joint_beside_the_way_that_mimics_one_that_moves_is_refused_until_it_is_locked(service_robot):
    service_robot.write_text(with_fingers('<mimic joint="wrist"/>'), encoding="utf-8")
    names = {"base_link": "cart", "tool_frame": "tool"}
    with pytest.raises(
        InputError, match=r"'grip 2', beside the chain .*, mimics 'wrist', which moves; .* lock one"
    ):
        arm_from_urdf(service_robot, **names)
    assert "wrist" in arm_from_urdf(service_robot, **names, locked_joints={"grip 2": 0.1}).joint_names
    assert "wrist" not in arm_from_urdf(service_robot, **names, locked_joints={"wrist": 0.1}).joint_names


def test_joints_without_a_way_do_not_move(service_robot):
    text = SERVICE_ROBOT.replace('lower="-2" upper="1.5"', 'lower="0.3" upper="0.3"')
    service_robot.write_text(text, encoding="utf-8")
    model = arm_from_urdf(service_robot, **NAMES)
    assert model.joint_names == ("shoulder", "wrist")
    assert model.notes[0] == (
        "locked, their limits leave no range (others in [arm.limits], by name, free them): lift, elbow, roll "
        "at 0.3 (rad, sliding joints m)"
    )
    service_robot.write_text(SERVICE_ROBOT, encoding="utf-8")
    by_hand = arm_from_urdf(
        service_robot, **NAMES, locked_joints=dict.fromkeys(("lift", "elbow", "roll"), 0.3)
    )
    np.testing.assert_array_equal(model.offsets, by_hand.offsets)
    wheel = text.replace("continuous", "fixed")
    service_robot.write_text(wheel, encoding="utf-8")
    with pytest.raises(InputError, match=r"no free joint .* \(limits leave no way to lift, elbow, roll\)"):
        arm_from_urdf(service_robot, **NAMES)


def test_candidates_of_tools_begin_with_those_named_so_and_end_with_wheels_and_sensors():
    links = ["link_right_wheel", "link_aruco_wrist", "gripper_camera_lens", "head", "link_gripper_left"]
    links += ["knee", "link_grasp_center", "left_ee"]
    assert like_tools(links) == [
        *("link_grasp_center", "left_ee", "link_gripper_left", "head", "knee"),
        *("link_right_wheel", "link_aruco_wrist", "gripper_camera_lens"),
    ]


def test_names_may_be_left_out_where_there_is_no_choice(service_robot):
    model = arm_from_urdf(service_robot)
    named = arm_from_urdf(service_robot, **NAMES)
    np.testing.assert_array_equal(model.offsets, named.offsets)
    assert model.notes[0] == "base_link 'cart' and tool_frame 'tool', not given in the file"
    service_robot.write_text(SERVICE_ROBOT.replace('"tool"', '"tip"'), encoding="utf-8")
    with pytest.raises(InputError, match=r"tool_frame: is missing, candidates: hand, head, tip$"):
        arm_from_urdf(service_robot)
    service_robot.write_text(
        SERVICE_ROBOT.replace('"tool"', '"left_tcp"').replace('"finger"', '"right_tcp"'), encoding="utf-8"
    )
    with pytest.raises(InputError, match=r"tool_frame: is missing, candidates: right_tcp, left_tcp$"):
        arm_from_urdf(service_robot)


def test_a_joint_stands_for_the_link_behind_it(service_robot):
    named = arm_from_urdf(service_robot, base_link="lift", tool_frame="flange")
    np.testing.assert_array_equal(
        named.offsets, arm_from_urdf(service_robot, base_link="torso", tool_frame="tool").offsets
    )


def test_a_link_goes_before_a_joint_of_the_same_name(service_robot):
    named_alike = SERVICE_ROBOT.replace('name="flange"', 'name="tool"').replace('name="lift"', 'name="cart"')
    service_robot.write_text(named_alike, encoding="utf-8")
    twice, q = arm_from_urdf(service_robot, **NAMES), np.linspace(0.1, 0.5, 5)
    service_robot.write_text(SERVICE_ROBOT, encoding="utf-8")
    for found, expected in zip(
        gripper_pose(twice, q), gripper_pose(arm_from_urdf(service_robot, **NAMES), q), strict=True
    ):
        np.testing.assert_allclose(found, expected, atol=1e-15)


def test_every_joint_can_be_locked_but_one(service_robot):
    locked = LOCKED | {"shoulder": 0.3, "elbow": 0.2, "wrist": -0.4}
    model = arm_from_urdf(service_robot, **NAMES, locked_joints=locked)
    whole = arm_from_urdf(service_robot, **NAMES, locked_joints=LOCKED)
    assert model.joint_names == ("roll",)
    position, rotation = gripper_pose(model, np.array([0.7]))
    expected = gripper_pose(whole, np.array([0.3, 0.2, 0.7, -0.4]))
    np.testing.assert_allclose(position, expected[0], atol=1e-13)
    np.testing.assert_allclose(rotation, expected[1], atol=1e-13)


HAND = """<robot name="with_a_hand">
  {links}
  <joint name="a" type="revolute"><parent link="base"/><child link="one"/><axis xyz="0 0 1"/>{limit}</joint>
  <joint name="b" type="revolute"><parent link="one"/><child link="two"/><axis xyz="0 1 0"/>{limit}</joint>
  <joint name="c" type="fixed"><parent link="two"/><child link="hand"/></joint>
  <joint name="f" type="prismatic"><parent link="hand"/><child link="left"/><axis xyz="0 1 0"/>{limit}</joint>
  <joint name="g" type="prismatic"><parent link="hand"/><child link="right"/><axis xyz="0 1 0"/>{limit}
    <mimic joint="f"/></joint>
  {more}
</robot>"""


def with_a_hand(folder, more="", links=()):
    inertial = (
        '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    )
    names = ("base", "one", "two", "hand", "left", "right", *links)
    described = "".join(f'<link name="{name}">{inertial}</link>' for name in names)
    path = folder / "hand.urdf"
    limit = '<limit lower="-1" upper="1" effort="9" velocity="1"/>'
    path.write_text(HAND.format(links=described, limit=limit, more=more), encoding="utf-8")
    return path


def test_the_link_that_carries_fingers_is_the_tool(tmp_path):
    arm = arm_from_urdf(with_a_hand(tmp_path))
    assert arm.joint_names == ("a", "b")
    assert "tool_frame 'hand'" in arm.notes[0]


def test_of_a_finger_that_another_mimics_the_hand_is_named(tmp_path):
    with pytest.raises(InputError, match=r"'g'.* mimics 'f'.* tool_frame before it, such as 'hand'$"):
        arm_from_urdf(with_a_hand(tmp_path), tool_frame="left")


def test_what_is_fixed_to_a_hand_stays_a_candidate(tmp_path):
    camera = '<joint name="d" type="fixed"><parent link="hand"/><child link="camera"/></joint>'
    file = read_urdf(with_a_hand(tmp_path, camera, ["camera"]))
    assert file.tips("base") == ["hand", "camera"]


def test_two_arms_are_no_hand(tmp_path):
    joint = (
        '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" effort="9" velocity="1"/></joint>'
    )
    more = joint.format("h", "revolute", "one", "other") + joint.format("i", "revolute", "other", "palm")
    file = read_urdf(with_a_hand(tmp_path, more, ["other", "palm"]))
    assert file.tips("base") == ["hand", "palm"]


@pytest.mark.parametrize(
    ("name", "tool"), [("gripper", "palm"), ("wrist_roll_of_gripper", "jaw"), ("f", "jaw")]
)
def test_the_link_that_carries_a_single_jaw_is_the_tool(tmp_path, name, tool):
    """As on the SO-100 and the Unitree Z1."""
    links = ["base", "one", "two", "palm", "jaw"]
    joints = "".join(
        f'<joint name="{joint}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        '<limit lower="-1" upper="1" effort="9" velocity="1"/></joint>'
        for joint, parent, child in zip(["a", "b", "c", name], links[:-1], links[1:], strict=True)
    )
    path = tmp_path / "jaw.urdf"
    path.write_text(f'<robot name="r">{"".join(f"""<link name="{k}"/>""" for k in links)}{joints}</robot>')
    assert read_urdf(path).tool_frame(None, "base") == tool
