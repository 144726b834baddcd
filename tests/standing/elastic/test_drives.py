"""Elastic joints, against MuJoCo's rigid bodies on springs, which linearise nothing, and by hand."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.cli.layout import gear_rows
from ocptip.cli.main import main
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.motion.check import check_motion
from ocptip.robots.dynamics import evaluate_dynamics, small_motions
from ocptip.robots.gears import Gears
from ocptip.robots.model import ArmModel, JointLimits
from ocptip.robots.motors import DCMotors
from ocptip.robots.process import ProcessWrench
from ocptip.robots.spring_chain import spring_chain
from ocptip.standing.arm import Robot
from ocptip.standing.elastic.drives import on_its_drives, with_rise
from ocptip.standing.elastic.feet import on_its_feet
from ocptip.standing.elastic.springs import Ride
from ocptip.task_files.motion import load_task
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from studies.elastic_drives.run import simulated
from tests.places import EXAMPLES
from tests.quick import examples, some
from tests.standing.elastic.test_feet import plan_of, softened

STIFFNESS = np.array([2e4, 2e4, 1e4, np.inf, np.inf, np.inf])


def geared(robot, stiffness=STIFFNESS, **damping):
    """The same robot with elastic joints."""
    return robot.varied(arm=robot.arm.with_gears(Gears(stiffness, **damping)))


def pendulum(stiffness, ratio=0.0, inertia=0.5):
    """One vertical axis with a beam whose tip is 1 m away, on a heavy base."""
    arm = ArmModel(
        "beam", ("turn",), np.eye(3)[None], np.array([[1.0, 0.0, 0.0]]), np.array([1.0]), np.zeros((1, 3)),
        np.diag([0.4, inertia, inertia])[None], JointLimits.unlimited(1),
    ).with_gears(Gears([stiffness], damping_ratio=ratio))  # fmt: skip
    corners = [(0.5, 0.5, 0), (-0.5, 0.5, 0), (-0.5, -0.5, 0), (0.5, -0.5, 0)]
    feet = [UnilateralContact(position=place, friction=0.5) for place in corners]
    motors = DCMotors(np.ones(1), np.zeros(1), np.zeros(1), np.zeros(1))
    return Robot(arm, Support(feet, mass=100.0, center_of_mass=(0, 0, 0.3)), motors)


def ramp(angle=1.0, speed=1.0, acceleration=4.0):
    return Trajectory.from_profiles([0.0], [[RampCommand(angle, speed, acceleration)]])


ARM = plan_of("A")[0].arm
CHAIN = spring_chain(ARM.with_gears(Gears(STIFFNESS)))


@examples(20)
@given(st.integers(0, 2**32 - 1))
def test_springs_that_do_not_bend_change_nothing(seed):
    """Neither the wrench on the base nor the torques, though rotors and links are parted."""
    chain = CHAIN
    states = np.random.default_rng(seed).normal(size=(3, 4, ARM.n))
    one, other = evaluate_dynamics(ARM, *states), evaluate_dynamics(chain.arm, *map(chain.spread, states))
    assert np.allclose(one.wrench, other.wrench, atol=1e-6)
    assert np.allclose(one.torque, other.torque[:, chain.drives], atol=1e-6)


def test_small_motions_are_slopes_of_the_dynamics():
    robot = geared(plan_of("A")[0])
    chain, rng = robot.chain, np.random.default_rng(3)
    q, qd, qdd = rng.normal(size=(3, 1, chain.arm.n))
    gravity, about = robot.support.gravity, robot.support.center_of_mass
    found = small_motions(chain.arm, tuple(chain.springs))(q, qd, qdd, gravity, about)
    inertia, gyration, stiffening = (values[0] for values in found)
    assert np.allclose(inertia, inertia.T, atol=1e-9)

    def taken(states):
        dynamics = evaluate_dynamics(chain.arm, *states, gravity=gravity, about=about)
        return np.concatenate([-dynamics.wrench[0], dynamics.torque[0, chain.springs]])

    for k, joint in enumerate(chain.springs):
        for slopes, which in ((stiffening[:, k], 0), (gyration[:, 3 + k], 1), (inertia[:, 6 + k], 2)):
            sides = []
            for size in (1e-5, -1e-5):
                states = [q.copy(), qd.copy(), qdd.copy()]
                states[which][0, joint] += size
                sides.append(taken(states))
            assert np.allclose((sides[0] - sides[1]) / 2e-5, slopes, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("soft", some(1, [True, False]))
def test_vibration_is_that_of_a_simulation(soft):
    robot, motion = plan_of("A")
    robot = geared(robot, np.array([4e3, 4e3, 2e3, np.inf, np.inf, np.inf]))
    robot = softened(robot, 1e6, damping_ratio=0.1) if soft else robot
    found, theirs = on_its_drives(robot, motion), simulated(robot, motion, 1e-3, 0.1)
    assert found.peak.value == pytest.approx(theirs.peak, rel=0.02)
    assert found.after == pytest.approx(theirs.after, rel=0.02)
    if not soft:
        course = found.course
        own = np.interp(theirs.times, course.times, course.wrenches[:, 2])
        assert np.sqrt(np.mean((own - theirs.wrenches[:, 2]) ** 2)) < 2.0  # N, of 150


def test_one_joint_rings_as_by_hand():
    """A ramp bends the spring by I a / k; without damping it overshoots by as much."""
    stiffness, inertia, acceleration = 800.0, 0.5, 4.0
    robot, motion = pendulum(stiffness, inertia=inertia), ramp(acceleration=acceleration)
    found, omega = on_its_drives(robot, motion), np.sqrt(stiffness / inertia)
    mode = found.modes[0]
    assert (mode.least, mode.most) == pytest.approx((omega / (2 * np.pi),) * 2, rel=1e-6)
    assert mode.damping == pytest.approx((0.0, 0.0), abs=1e-9)
    bend = inertia * acceleration / stiffness
    phase = np.exp(1j * omega * np.array(motion.event_times))
    rest = bend * abs(np.array([1, -1, -1, 1]) @ phase)  # four jumps
    assert found.after == pytest.approx(rest, rel=0.01)
    assert 2 * bend <= found.peak.value * (1 + 1e-3) <= 4.1 * bend
    damped = on_its_drives(pendulum(stiffness, 0.1, inertia), motion)
    assert damped.modes[0].damping == pytest.approx((0.1, 0.1))


@pytest.mark.slow
@pytest.mark.parametrize("detuned", some(1, [1.0, 0.5, 2.0]))
def test_ripple_of_a_drive_excites_what_it_moves(detuned):
    """A recorded drive that ripples: r^2 / (1 - r^2 + 2 i zeta r) times the ripple, r = w / w_0."""
    stiffness, inertia, zeta, size = 800.0, 0.5, 0.05, 1e-3
    omega = np.sqrt(stiffness / inertia)
    times = np.linspace(0.0, 4.0, 8001)
    at = detuned * omega * times
    rise = 1 - np.exp(-times / 0.2)  # from rest
    q = size * np.sin(at) * rise
    found = on_its_drives(pendulum(stiffness, zeta, inertia), Trajectory.from_points(times, q[:, None]))
    late = (found.course.times > 3.0) & (found.course.times < 4.0)
    expected = size * detuned**2 / abs(1 - detuned**2 + 2j * zeta * detuned)
    assert np.max(np.abs(found.course.bends[late, 0])) == pytest.approx(expected, rel=0.02)


def test_a_rise_time_of_one_period_leaves_nothing():
    stiffness, inertia = 800.0, 0.5
    robot, motion = pendulum(stiffness, inertia=inertia), ramp(speed=0.93)
    found = with_rise(robot, motion)
    period = 2 * np.pi * np.sqrt(inertia / stiffness)
    assert found.rise.rise_time == pytest.approx(period, rel=1e-6)
    assert found.rise.after < 1e-3 * found.after
    again = on_its_drives(robot, motion.with_rise_times(found.rise.rise_time))
    assert (again.peak.value, again.after) == (found.rise.peak, found.rise.after)
    other = on_its_drives(robot, motion.with_rise_times(1.5 * period))
    assert other.after > 100 * again.after
    slow = on_its_drives(robot, motion.time_scaled(10.0))
    assert slow.peak.value < 0.1 * found.peak.value


def test_a_check_is_not_verified_where_ringing_loses_a_contact():
    robot, motion = plan_of("A")
    assert check_motion(robot, motion).drives is None
    checked = check_motion(geared(robot), motion)
    assert not checked.verified
    assert checked.worst["GN"].value < 0.9
    assert checked.worst["GN_gears"].value > 1
    assert checked.violations[0].name == "GN_gears"
    text = "\n".join(checked.drive_lines)
    assert "gripper vibrates by up to 0.2" in text
    assert "minimum normal force 0 N" in text
    assert "9.75 N with stiff gears" in text
    assert ", 4.22 N m with stiff gears" in text
    smooth = check_motion(geared(robot), motion.with_rise_times(0.0371))
    assert smooth.verified
    data = json.loads(json.dumps(smooth.to_dict()["drives"]))
    assert data["GN"]["value"] < 0.6
    assert data["modes"][0]["least_Hz"] == pytest.approx(27, rel=0.02)
    rise = with_rise(geared(robot), motion).rise
    assert rise.GN < 0.6
    assert rise.peak < 0.8 * checked.drives.peak.value


@pytest.mark.slow
def test_stiff_gears_change_little_and_too_fast_ones_nothing():
    robot, motion = plan_of("B")
    robot, motion = softened(robot, 2e5, damping_ratio=0.1), motion.time_scaled(1.6)
    rigid = on_its_feet(robot, motion)
    for stiffness, close in ((1e6, 0.03), (1e9, 1e-9)):
        found = on_its_feet(geared(robot, np.full(6, stiffness)), motion)
        assert found.shift.value == pytest.approx(rigid.shift.value, rel=close)
        assert found.frequency == pytest.approx(rigid.frequency)
    ride = Ride(geared(robot, np.full(6, 1e9)), motion)
    assert np.isinf(ride.springs).all()


def test_gears_that_are_too_soft_are_no_verdict():
    """Weight bends them without end: nothing of the theory of small motions holds."""
    robot, motion = plan_of("A")
    soft = geared(robot, np.array([10.0, 10.0, 5.0, np.inf, np.inf, np.inf]))
    found = on_its_drives(soft, motion)
    assert found.too_far
    assert (found.GN.value, found.GT.value) == (np.inf, np.inf)
    assert "the gears are too soft" in found.lines(check_motion(robot, motion).contacts)[0]
    assert found.modes[0].damping[0] < 0  # grows


@pytest.mark.slow
def test_no_rise_time_is_named_where_nothing_rings():
    robot, motion = plan_of("A")
    found = with_rise(geared(robot), motion.time_scaled(20.0))
    assert found.rise is None
    assert found.peak.value < 1e-5
    stiff = with_rise(geared(robot, np.full(6, 1e12)), motion)
    assert (stiff.modes, stiff.rise, stiff.peak.value) == ((), None, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("speeds", some(1, [False, True]))
def test_samples_ring_as_the_ramps_do(speeds):
    robot, motion = plan_of("A")
    times = np.linspace(0, motion.end, 400)
    q, qd, _ = motion.states(times)
    found = on_its_drives(geared(robot), Trajectory.from_points(times, q, qd if speeds else None))
    own = on_its_drives(geared(robot), motion)
    assert found.peak.value == pytest.approx(own.peak.value, rel=0.02)
    assert found.GN.value == pytest.approx(own.GN.value, rel=0.02)


def test_gears_of_a_file(tmp_path):
    text = (EXAMPLES / "tasks/ur5_cart.toml").read_text()
    urdf = (EXAMPLES / "tasks/ur5.urdf").read_text()
    (tmp_path / "ur5.urdf").write_text(urdf)

    def task(motors):
        head, tail = text.split("[motors]", 1) if "[motors]" in text else (text, "\n")
        path = tmp_path / "task.toml"
        path.write_text(f"{head}\n[motors]\n{motors}{tail}")
        return load_task(path)

    found = task('gear_stiffness = { "shoulder_*" = 1e4, elbow_joint = 8e3 }\n')
    assert found.robot.arm.gears.stiffness.tolist() == [1e4, 1e4, 8e3, *[np.inf] * 3]
    assert found.limits.overshoot == pytest.approx(np.exp(-0.05 * np.pi / np.sqrt(1 - 0.0025)))
    assert task("gear_stiffness = 1e4\ngear_damping = 2\n").limits.overshoot == 1.0
    for motors, message in (
        ("gear_damping = 2\n", "motors.gear_damping: needs gear_stiffness"),
        ("gear_stiffness = -1\n", "motors.gear_stiffness: must be > 0"),
        ("gear_stiffness = 1e4\ngear_damping_ratio = 1\n", "motors.gear_damping_ratio: must be below 1"),
        ("gear_stiffness = { elbow = 1e4 }\n", "motors.gear_stiffness.elbow: no such joint"),
        ("gear_stiffness = 1e4\ngear_damping = { elbow_joint = 1 }\n", "no value for shoulder_pan_joint"),
    ):
        with pytest.raises(InputError, match=message.replace(".", r"\.")):
            task(motors)


def test_gears_are_refused():
    arm = plan_of("A")[0].arm
    for gears, message in (
        ((np.full(6, np.inf),), "infinite of all joints"),
        ((np.zeros(6),), "must be > 0"),
        ((np.full(6, 1.0), np.full(6, -1.0)), "gear_damping: must be >= 0"),
        ((np.full(6, 1.0), None, 1.0), "below 1"),
    ):
        with pytest.raises(InputError, match=message):
            Gears(*gears)
    with pytest.raises(InputError, match="expected 6 joints, got 2"):
        arm.with_gears(Gears(np.ones(2)))


def test_an_arm_that_cannot_have_springs_is_refused():
    arm = plan_of("A")[0].arm
    wrong = replace(arm, inertias=-arm.inertias).with_gears(Gears(np.full(6, 1e4)))
    with pytest.raises(InputError, match="link inertias are such as no bodies have"):
        spring_chain(wrong)


@pytest.mark.parametrize("gears", some(1, [False, True]))
def test_a_process_over_time_acts_on_springs_as_one_that_stays(gears):
    robot, motion = plan_of("A")
    robot, motion = softened(robot, 1e6, damping_ratio=0.1), motion.time_scaled(1.5)
    robot = geared(robot) if gears else robot
    force, moment = [2.0, 0.0, -4.0], [0.1, 0.0, 0.0]
    stays = ProcessWrench(force, moment, axes="base")
    over = ProcessWrench([force, force], [moment, moment], axes="base", over="time", knots=[0.0, 0.7])
    one, other = (
        on_its_feet(varied, motion)
        for varied in (robot.varied(arm=robot.arm.with_process(own)) for own in (stays, over))
    )
    assert one.shift.value == pytest.approx(other.shift.value, rel=0.01)
    forces = [[margin.value for margin in found.least] for found in (one, other, on_its_feet(robot, motion))]
    assert forces[0] == pytest.approx(forces[1], abs=0.1)
    assert np.max(np.abs(np.subtract(forces[0], forces[2]))) > 0.5


def test_segments_of_a_cycle_say_how_they_ring():
    robot, motion = plan_of("A")
    checks = [check_motion(geared(robot), motion), check_motion(robot, motion)]
    rows = gear_rows(SimpleNamespace(names=("to", "back"), segments=checks))
    assert rows[0][0] == "elastic joints"
    assert rows[0][1].startswith("to: gripper vibrates by up to ")
    assert len(rows) == len(checks[0].drive_lines)


@pytest.mark.slow
def test_plans_say_which_rise_time_would_help(tmp_path, capsys):
    path = tmp_path / "geared.toml"
    path.write_text('case = "A"\n[motors]\ngear_stiffness = 2e4\n[tolerance]\npreset = "none"\n')
    out = str(tmp_path / "out")
    assert main(["plan", str(path), "--starts", "1", "--no-figures", "-v", "--out", out]) == 0
    lines = capsys.readouterr().out
    assert re.search(r"^elastic joints +gripper vibrates by up to", lines, re.MULTILINE)
    assert "--rise-time 0.0" in lines
    assert json.loads((tmp_path / "out" / "plan.json").read_text())["drives"]["rise"]
