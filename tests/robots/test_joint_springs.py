"""Springs beside drives: less torque, the same wrench on the base; against Pinocchio's external forces."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from ocptip.basics.errors import InputError
from ocptip.certificate.checks import certified
from ocptip.certificate.describe import tolerance_data, tolerance_words
from ocptip.certificate.trusted.described import TORQUES
from ocptip.cli.motion_summary import notes
from ocptip.motion.check import check_motion
from ocptip.parallel.code.lean_arm import lean_arm
from ocptip.published.tasks import experiment_task
from ocptip.robots.dynamics import evaluate_dynamics
from ocptip.standing.arm import Robot
from ocptip.standing.simulation.mjcf import to_mjcf
from ocptip.standing.tolerance import WORKSHOP, Uncertainty
from ocptip.standing.within.torques import maximum_torques
from ocptip.task_files.tables.arm import arm_of_file
from tests.quick import some
from tests.robots.pinocchio_twin import twin
from tests.robots.sample_arms import random_arm

GRAVITY = np.array([0.5, -1.0, -9.7])


def sprung(seed, joints=4):
    """A random arm, one joint of it sliding, with springs at all joints but the first."""
    rng = np.random.default_rng(seed)
    bare = dataclasses.replace(random_arm(seed, joints), prismatic=np.arange(joints) == 2)
    torque, stiffness = rng.normal(size=joints) * 10, rng.uniform(0, 30, joints)
    torque[0] = stiffness[0] = 0.0
    return bare, dataclasses.replace(bare, spring_torque=torque, spring_stiffness=stiffness)


@pytest.mark.parametrize("seed", range(3))
def test_drives_need_less_and_the_base_feels_nothing(seed):
    """Pinocchio gets both ends of each spring as external forces, and knows nothing of springs."""
    bare, arm = sprung(seed)
    rng = np.random.default_rng(seed)
    q, qd, qdd = rng.uniform(-1, 1, (3, arm.n))
    found = evaluate_dynamics(arm, q, qd, qdd, gravity=GRAVITY)
    robot = twin(bare)
    data = robot.createData()
    robot.gravity.linear = GRAVITY
    pin.forwardKinematics(robot, data, q)
    external = [pin.Force.Zero() for _ in range(robot.njoints)]
    for j in range(arm.n):
        push = np.zeros(6)
        push[2 if arm.prismatic[j] else 5] = arm.spring_torque[j] - arm.spring_stiffness[j] * q[j]
        ahead = pin.Force(push)
        external[j + 1] += ahead
        external[j] -= data.liMi[j + 1].act(ahead)
    forces = pin.StdVec_Force()
    forces.extend(external)
    torque = pin.rnea(robot, data, q, qd, qdd, forces)
    np.testing.assert_allclose(found.torque, torque, atol=1e-10)
    on_base = data.oMi[1].act(data.f[1]) - external[0]  # by the first joint, and by the spring beside it
    np.testing.assert_allclose(found.wrench, np.concatenate([-on_base.linear, -on_base.angular]), atol=1e-10)
    np.testing.assert_array_equal(found.wrench, evaluate_dynamics(bare, q, qd, qdd, gravity=GRAVITY).wrench)


def test_a_spring_that_balances_gravity_leaves_the_drive_nothing():
    """By hand: a lift of 3 kg with a gas spring of 3 g."""
    bare = random_arm(0, 1)
    up = {"rotations": np.eye(3)[None], "mount_rotation": np.eye(3), "prismatic": np.array([True])}
    lift = dataclasses.replace(bare, **up, masses=np.array([3.0]), armature=np.zeros(1))
    arm = dataclasses.replace(lift, spring_torque=np.array([3 * 9.81]))
    found = evaluate_dynamics(arm, [0.2], [0.0], [0.0])
    assert found.torque == pytest.approx([0.0], abs=1e-12)
    assert found.wrench[2] == pytest.approx(-3 * 9.81)


def test_the_largest_torques_within_an_uncertainty_have_the_springs():
    task = experiment_task("A")
    arm = task.robot.arm
    one = dataclasses.replace(arm, spring_torque=np.arange(6.0), spring_stiffness=np.full(6, 3.0))
    robot = Robot(one, task.robot.support, task.robot.motors)
    rng = np.random.default_rng(1)
    q, qd, qdd = rng.uniform(-1, 1, (3, 40, 6))
    none = np.empty((40, 0))
    bound = maximum_torques(robot, WORKSHOP, q, qd, qdd, none)
    nominal = evaluate_dynamics(one, q, qd, qdd, gravity=task.robot.support.gravity).torque
    assert np.all(bound >= np.abs(nominal))
    # Uncertain masses do not change a spring: the bound moves by no more than the spring's torque.
    before = maximum_torques(task.robot, WORKSHOP, q, qd, qdd, none)
    spring = one.spring_torque - one.spring_stiffness * q
    assert np.all(np.abs(bound - before) <= np.abs(spring) + 1e-9)
    assert np.max(np.abs(bound - before)) > 1.0


@pytest.mark.slow
def test_uncertain_springs_ask_more_of_the_drives_and_nothing_of_the_contacts():
    """By hand: the bound grows by the share of the spring's torque; no draw of springs exceeds it."""
    task = experiment_task("A")
    arm = task.robot.arm
    own = {"spring_torque": np.arange(6.0), "spring_stiffness": np.full(6, 3.0)}
    robot = task.robot.varied(arm=dataclasses.replace(arm, **own))
    rng = np.random.default_rng(2)
    states, none = rng.uniform(-1, 1, (3, 40, 6)), np.empty((40, 0))
    loose = dataclasses.replace(WORKSHOP, springs=0.2)
    exact, bound = (maximum_torques(robot, one, *states, none) for one in (WORKSHOP, loose))
    np.testing.assert_allclose(bound - exact, 0.2 * np.abs(own["spring_torque"] - 3.0 * states[0]), atol=1e-9)
    for _ in range(20):
        factors = rng.uniform(0.8, 1.2, 6)
        drawn = dataclasses.replace(arm, **{name: factors * value for name, value in own.items()})
        torques = evaluate_dynamics(drawn, *states, gravity=task.robot.support.gravity).torque
        assert np.all(np.abs(torques) <= bound + 1e-9)
    data = tolerance_data(loose, robot.support)
    assert data["springs"] == 0.2
    assert "springs +-20 %" in tolerance_words(data)
    assert "springs" not in tolerance_data(WORKSHOP, robot.support)


@pytest.mark.parametrize("springs", some(1, [0.0, 0.1]))
def test_a_motion_is_checked_and_proved_with_uncertain_springs(springs):
    task = experiment_task("A", "effective")
    arm = task.robot.arm
    torque, stiffness = 8.0 * (np.arange(6) == 1), 3.0 * (np.arange(6) == 1)
    robot = task.robot.varied(arm=dataclasses.replace(arm, spring_torque=torque, spring_stiffness=stiffness))
    limits = dataclasses.replace(task.limits, tolerance=Uncertainty(tilt=1e-3, springs=springs))
    checked = check_motion(robot, task.reference, limits)
    assert checked.within.exact_springs == (springs == 0)
    assert ("counterbalance springs count as exact" in " ".join(notes(checked))) == (springs == 0)
    worst = checked.worst["torque_ratio_worst_case"].value
    proved = certified(robot, task.reference, checked, limits).certificate
    assert proved.holds
    assert worst <= proved.verdict.bounds[TORQUES] <= 1
    if springs:
        exact = dataclasses.replace(limits, tolerance=Uncertainty(tilt=1e-3))
        assert worst > check_motion(robot, task.reference, exact).worst["torque_ratio_worst_case"].value


def test_mujoco_has_the_same_springs():
    mujoco = pytest.importorskip("mujoco")
    task = experiment_task("A")
    torque, stiffness = np.array([0.0, 5.0, -2.0, 0.0, 1.0, 0.0]), np.array([0.0, 20.0, 0.0, 4.0, 0.0, 0.0])
    arm = dataclasses.replace(task.robot.arm, spring_torque=torque, spring_stiffness=stiffness)
    model = mujoco.MjModel.from_xml_string(to_mjcf(Robot(arm, task.robot.support, task.robot.motors)))
    data = mujoco.MjData(model)
    numbers = [model.joint(name).id for name in arm.joint_names]
    q = np.linspace(-0.5, 0.6, 6)
    data.qpos[model.jnt_qposadr[numbers]] = q
    mujoco.mj_forward(model, data)
    found = data.qfrc_spring[model.jnt_dofadr[numbers]]
    np.testing.assert_allclose(found, torque - stiffness * q, atol=1e-6)


TABLE = """\
[arm]
dh = "standard"
mount_position = [0, 0, 0]
[[arm.joint]]
name = "lift"
slides = true
mass = 2
[[arm.joint]]
name = "turn"
a = 0.4
mass = 1
[arm.springs.lift]
torque = 30
[arm.springs.{}]
stiffness = 4
"""


def test_files_name_the_joints(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(TABLE.format("turn"))
    arm = arm_of_file(path)
    np.testing.assert_array_equal(arm.spring_torque, [30, 0])
    np.testing.assert_array_equal(arm.spring_stiffness, [0, 4])
    with pytest.raises(InputError, match="lean code knows no springs"):
        lean_arm(arm)
    path.write_text(TABLE.format("turm"))
    with pytest.raises(InputError, match=r"arm\.springs\.turm: no joint 'turm'; there are lift, turn"):
        arm_of_file(path)
    path.write_text(TABLE.format("turn").replace("= 4", "= -4"))
    with pytest.raises(InputError, match=r"arm\.springs\.turn\.stiffness: must be >= 0"):
        arm_of_file(path)
