"""URDFs out of MuJoCo models and xacro files, against MuJoCo's own kinematics and dynamics."""

import json
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from ocptip.basics.errors import InputError
from ocptip.cli.main import main
from ocptip.robots.dynamics import evaluate_dynamics
from ocptip.robots.urdf.conversion import converted
from ocptip.task_files.motion import load_task
from tests.task_files.test_examples_of_init import cart, folded_arm, written

mujoco = pytest.importorskip("mujoco")

MJCF = """<mujoco model="cart"><compiler angle="radian"/>
<asset><mesh name="wedge" vertex="0 0 0  0.1 0 0  0 0.1 0  0 0 0.1"/></asset>
<worldbody>
 <geom type="plane" size="5 5 0.1"/>
 <body name="chassis" pos="0 0 0.2"><freejoint name="root"/>
  <inertial pos="0.02 0 0.1" mass="40" diaginertia="2 3 4"/>
  <geom type="box" size="0.4 0.25 0.05"/>
  {wheels}
  <body name="upper" pos="0.1 0 0.3" quat="0.9 0.1 0.3 0.2">
   <joint name="turn" type="hinge" axis="0 0.6 0.8" pos="0.02 -0.01 0.03" range="-2 2"/>
   <joint name="slide" type="slide" axis="1 0 0" pos="0.1 0 0" range="0 0.3"/>
   <inertial pos="0.1 0.05 0" quat="0.8 0.2 0.1 0.5" mass="3" diaginertia="0.02 0.03 0.04"/>
   <geom type="capsule" size="0.03 0.1" pos="0.2 0 0"/>
   <body name="lower" pos="0.3 0 0.1"><joint name="bend" type="hinge" axis="0 1 0" range="-2 2"/>
    <inertial pos="0.1 0 0" mass="2" diaginertia="0.01 0.01 0.01"/>
    <geom type="mesh" mesh="wedge"/>
    <body name="tool0" pos="0.2 0.1 0" quat="0.7 0 0.7 0"/>
   </body></body></body></worldbody>
<actuator><motor joint="turn" gear="20" forcelimited="true" forcerange="-3 3"/></actuator></mujoco>"""
WHEEL = """<body name="wheel_{0}" pos="{1} {2} -0.1"><joint name="roll_{0}" axis="0 1 0"/>
 <geom type="cylinder" size="0.1 0.02" quat="0.70710678 0.70710678 0 0" mass="2"/></body>"""


@pytest.fixture
def model_file(tmp_path):
    places = {"fl": (0.3, 0.25), "fr": (0.3, -0.25), "bl": (-0.3, 0.25), "br": (-0.3, -0.25)}
    wheels = "".join(WHEEL.format(name, *place) for name, place in places.items())
    path = tmp_path / "cart.xml"
    path.write_text(MJCF.replace("{wheels}", wheels), encoding="utf-8")
    return path


def test_a_mujoco_model_becomes_a_urdf_of_the_same_kinematics_and_dynamics(model_file):
    files = converted(model_file, model_file.parent).files
    for file, text in files.items():
        file.parent.mkdir(exist_ok=True)
        file.write_text(text)
    urdf = next(iter(files))
    robot = pin.buildModelFromUrdf(str(urdf))
    model = mujoco.MjModel.from_xml_path(str(model_file))
    state, data = mujoco.MjData(model), robot.createData()
    rng = np.random.default_rng(0)
    for _ in range(5):
        q, qd, qdd = (
            pin.randomConfiguration(robot, -np.ones(robot.nq), np.ones(robot.nq)),
            *rng.normal(size=(2, robot.nv)),
        )
        for name in list(robot.names)[1:]:
            j, joint = robot.joints[robot.getJointId(name)], model.joint(name)
            values = q[j.idx_q : j.idx_q + j.nq]
            if j.nv == 6:  # MuJoCo: w first, linear velocity in world axes, from the world's origin
                turn = pin.Quaternion(values[3:]).matrix()
                state.joint(name).qpos = [*(values[:3] + np.array([0, 0, 0.2])), values[6], *values[3:6]]
                twist, rate = (own[j.idx_v : j.idx_v + 6] for own in (qd, qdd))
                state.joint(name).qvel = [*(turn @ twist[:3]), *twist[3:]]
                turning = np.cross(twist[3:], twist[:3])  # of a point whose velocity turns with the body
                state.qacc[joint.dofadr[0] :][:6] = [*(turn @ (rate[:3] + turning)), *rate[3:]]
                continue
            state.joint(name).qpos = values if j.nq == 1 else np.arctan2(values[1], values[0])
            state.joint(name).qvel = qd[j.idx_v]
            state.qacc[joint.dofadr[0]] = qdd[j.idx_v]
        wanted = state.qacc.copy()
        mujoco.mj_forward(model, state)
        state.qacc[:] = wanted
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        mujoco.mj_inverse(model, state)
        torque = pin.rnea(robot, data, q, qd, qdd)
        pin.framesForwardKinematics(robot, data, q)
        place = data.oMf[robot.getFrameId("tool0")]
        np.testing.assert_allclose(place.translation, state.body("tool0").xpos, atol=1e-9)
        np.testing.assert_allclose(place.rotation.ravel(), state.body("tool0").xmat, atol=1e-9)
        for name in ("turn", "slide", "bend", "roll_fl"):
            j = robot.joints[robot.getJointId(name)]
            expected = state.qfrc_inverse[model.joint(name).dofadr[0]]
            assert torque[j.idx_v] == pytest.approx(expected, abs=1e-5), name
    assert robot.upperEffortLimit[robot.joints[robot.getJointId("turn")].idx_v] == 60


def test_init_reads_wheels_and_masses_of_a_mujoco_model(model_file, monkeypatch, capsys):
    monkeypatch.chdir(model_file.parent)
    assert main(["init", "cart.xml", "--out", "t.toml"]) == 0
    assert "speed_deg_s" in capsys.readouterr().out  # MuJoCo has no limits of speed
    text = Path("t.toml").read_text().replace("#> ", "")
    Path("t.toml").write_text(text)
    support = load_task("t.toml").robot.support
    assert support.mass == pytest.approx(48, rel=1e-6)
    np.testing.assert_allclose(
        np.abs([contact.position for contact in support.contacts]), np.tile([0.3, 0.25, 0], (4, 1)), atol=1e-4
    )
    assert main(["init", "cart.xml", "--out", "u.toml"]) == 2
    assert "cart.urdf: exists; give another place by --out, or --overwrite" in capsys.readouterr().err


_SLIDES = '<joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>'
_UP = '<joint name="z" type="slide" axis="0 0 1"/>'
_YAW = '<joint name="yaw" type="hinge" axis="0 0 1"/>'


@pytest.mark.parametrize(
    ("joints", "drives"),
    [
        ('<freejoint name="root"/>', True),
        (_SLIDES, True),
        (_SLIDES + _YAW, True),
        (_SLIDES + _UP, True),
        ((_SLIDES + _YAW).replace("/>", ' range="-9 9"/>'), True),
        ((_SLIDES + _UP).replace("/>", ' range="-1 1"/>'), False),
    ],
)
def test_joints_that_place_a_base_are_no_joints_of_the_arm(model_file, monkeypatch, capsys, joints, drives):
    """As planar and floating roots of a URDF; what else is in the world is no part of the robot."""
    monkeypatch.chdir(model_file.parent)
    text = model_file.read_text().replace('<freejoint name="root"/>', joints)
    table = '<body name="table" pos="2 0 0.2"><geom type="box" size="0.2 0.2 0.2" mass="2000"/></body>'
    cube = '<body name="cube" pos="2 0 0.5"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="1"/></body>'
    model_file.write_text(text.replace("<worldbody>", f"<worldbody>{table}{cube}"))
    assert main(["init", "cart.xml", "--tool-frame", "tool0", "--out", "t.toml", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["joints"] == ["turn", "slide", "bend"]) == drives
    assert answer["base_link"] == ("chassis" if drives else "world")
    if drives:
        assert answer["base"]["mass"] == pytest.approx(48, rel=1e-6)
        assert [contact["kind"] for contact in answer["base"]["contacts"]] == ["wheel"] * 4
        left = "bodies that are no part of the robot (see [[obstacle]]): table, cube"
        assert f"left out of the MuJoCo model: {left}" in answer["assumed"]


@pytest.mark.slow
def test_rotors_come_along_and_what_is_left_out_is_named(model_file, monkeypatch, capsys):
    """MuJoCo has the rotors on the diagonal of its mass matrix; tendons, springs, losses are noted."""
    monkeypatch.chdir(model_file.parent)
    text = model_file.read_text().replace('name="turn"', 'name="turn" armature="0.5"')
    text = text.replace('name="slide"', 'name="slide" armature="2" stiffness="30" frictionloss="1"')
    text = text.replace('name="bend"', 'name="bend" damping="3"')
    belt = '<joint joint="turn" coef="1"/><joint joint="bend" coef="2"/>'
    tendon = f'<tendon><fixed name="belt">{belt}</fixed></tendon>'
    equality = '<equality><joint joint1="turn" joint2="bend"/></equality>'
    model_file.write_text(text.replace("<actuator>", f"{tendon}{equality}<actuator>"))
    assert main(["init", "cart.xml", "--out", "t.toml"]) == 0
    said = capsys.readouterr().out
    losses = "damping and friction of joints (see [motors]): slide, bend"
    springs = "springs of joints (see [arm.springs]): slide"
    for words in ("tendons: belt", "equalities: equality_0", springs, losses):
        assert words in " ".join(said.split())
    Path("t.toml").write_text(Path("t.toml").read_text().replace("#> ", ""))
    arm = load_task("t.toml").robot.arm
    armature = dict(zip(arm.joint_names, arm.armature, strict=True))
    assert armature == {"turn": 0.5, "slide": 2.0, "bend": 0.0}
    model = mujoco.MjModel.from_xml_path(str(model_file))
    data = mujoco.MjData(model)
    for name, own in zip(arm.joint_names, range(arm.n), strict=True):
        data.joint(name).qpos = 0.1 * own
    mujoco.mj_forward(model, data)
    whole = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, whole)
    dofs = [model.joint(name).dofadr[0] for name in arm.joint_names]
    q = 0.1 * np.arange(arm.n)
    rest = evaluate_dynamics(arm, q, 0 * q, 0 * q).torque
    ours = np.column_stack([evaluate_dynamics(arm, q, 0 * q, own).torque - rest for own in np.eye(arm.n)])
    np.testing.assert_allclose(ours, whole[np.ix_(dofs, dofs)], rtol=1e-5, atol=1e-6)


XACRO = """import sys
if "bad:=1" in sys.argv: sys.exit("no such thing")
print(open(sys.argv[1]).read().replace("${mass}", "7").replace("${prefix}", sys.argv[2].split(":=")[1]))
"""


@pytest.fixture
def xacro(tmp_path, monkeypatch):
    """A program that replaces two names, in the place of the true one."""
    program = tmp_path / "bin" / "xacro"
    program.parent.mkdir()
    program.write_text(f"#!{sys.executable}\n{XACRO}")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}:{Path(sys.executable).parent}")
    monkeypatch.chdir(tmp_path)
    source = written(tmp_path, *cart(), *folded_arm("chassis")).read_text()
    Path("robot.urdf").unlink()
    source = source.replace('"40.0"', '"${mass}"').replace('"joint_1"', '"${prefix}joint_1"')
    Path("robot.urdf.xacro").write_text(source)


@pytest.mark.usefixtures("xacro")
def test_init_expands_a_xacro_file(capsys):
    assert main(["init", "robot.urdf.xacro", "--xacro", "prefix:=left_"]) == 0
    assert "left_joint_1" in capsys.readouterr().out
    assert 'value="7"' in Path("robot.urdf").read_text()
    assert "mass = 15 " in Path("robot.toml").read_text()  # 7 + 4 * 2


@pytest.mark.usefixtures("xacro")
def test_what_xacro_refuses_is_said(monkeypatch):
    with pytest.raises(InputError, match="xacro refuses it: no such thing"):
        converted(Path("robot.urdf.xacro"), Path(), ["bad:=1"])
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(InputError, match="install xacro"):
        converted(Path("robot.urdf.xacro"), Path())
