"""A Delta and a hexapod on a cart: what they do to it, and motions planned and checked for them."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.motion.check import check_motion
from ocptip.motion.files.output import joint_trajectory, plan_to_dict, sample_motion, write_motion_csv
from ocptip.motion.plan import plan_motion
from ocptip.motion.planner.formulation import Formulation
from ocptip.motion.planner.node_physics import NodePhysics
from ocptip.motion.planner.random_start import random_start
from ocptip.motion.task import MotionTask, refusals
from ocptip.parallel.description.ready_made import delta, rrr3, ups6
from ocptip.parallel.robot import ParallelRobot
from ocptip.robots.motors import DCMotors
from ocptip.robots.payload import Payload
from ocptip.standing.limits import Limits
from ocptip.standing.platform import PlatformLimits, StandingParallelRobot
from ocptip.task_files.motion import load_task
from ocptip.trajectories.controllers import controller_points
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from studies.baselines.penalty import MotionPenalty
from tests.motion.planner.node_derivatives import all_slopes, bends
from tests.oracles.numeric_platform import numeric_loads
from tests.places import EXAMPLES
from tests.quick import some

TASK = EXAMPLES / "tasks" / "delta_cart.toml"
TURNED = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])


def dc_motors(n, coulomb=0.5):
    return DCMotors(np.full(n, 4.0), np.full(n, coulomb), np.full(n, 0.05), np.full(n, 15.0))


def cart():
    angles = np.deg2rad([90.0, 210.0, 330.0])
    feet = [
        UnilateralContact(position=(0.25 * np.cos(a), 0.25 * np.sin(a), 0.0), friction=0.3, facets=12)
        for a in angles
    ]
    return Support(feet, mass=6.0, center_of_mass=(0.02, 0.0, 0.35))


def hexapod_limits():
    return PlatformLimits(
        lower=[-0.15, -0.15, 0.5, -0.3, -0.3, -0.3],
        upper=[0.15, 0.15, 0.7, 0.3, 0.3, 0.3],
        speed=2.0,
        acceleration=20.0,
        motor_force=400.0,
        singularity=0.02,
    )


@pytest.fixture(scope="module")
def task():
    return load_task(TASK)


@pytest.fixture(scope="module")
def standing(task):
    """Two robots with everything different from zero, and a pose each."""
    delta_limits = replace(task.robot.platform_limits, motor_speed=np.array([9.0, np.inf, 8.0]))
    robots = {}
    for name, description, limits in (
        ("delta", delta().with_payload(Payload(1.0)), delta_limits),
        ("hexapod", ups6(), hexapod_limits()),
    ):
        robot = ParallelRobot(description)
        robots[name] = StandingParallelRobot(
            robot, cart(), dc_motors(robot.m), limits, position=(0.05, -0.02, 0.9), rotation=TURNED
        )
    return robots


def states(robot, count, seed, reach=0.06):
    rng = np.random.default_rng(seed)
    m = robot.n
    z = robot.robot.description.home + rng.uniform(-reach, reach, (count, m))
    return z, rng.normal(size=(count, m)), 8 * rng.normal(size=(count, m))


def test_sticks_of_the_legs_end_at_the_platform(task):
    *bodies, platform = task.robot.sticks(task.start)
    ends = np.array([line[-1] for line in bodies])
    for corner in platform:
        assert np.linalg.norm(ends - corner, axis=1).min() < 1e-8


@pytest.mark.parametrize("name", some(1, ["delta", "hexapod"]))
def test_loads_are_those_of_the_numeric_robot(standing, name):
    """Motor forces of the inverse dynamics, wrench of the mounted robot, speeds by J_a: other code."""
    robot = standing[name]
    support, parallel = robot.support, robot.robot
    z, zd, zdd = states(robot, 6, 1)
    forces, wrenches = robot.loads(z, zd, zdd)
    speeds = robot.motor_speeds(z, zd)
    for k in range(len(z)):
        gravity = robot.rotation.T @ support.gravity
        expected = parallel.inverse_dynamics(z[k], zd[k], zdd[k], gravity=gravity).motors
        np.testing.assert_allclose(forces[k], expected, rtol=1e-9, atol=1e-9)
        expected = numeric_loads(robot, z[k : k + 1], zd[k : k + 1], zdd[k : k + 1])[1]
        np.testing.assert_allclose(wrenches[k], expected[0], rtol=1e-9, atol=1e-8)
        s, _ = parallel.kinematics.quasi(z[k], zd[k], zdd[k])
        np.testing.assert_allclose(speeds[k], parallel.jacobian(z[k]) @ s, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize(
    ("name", "coulomb"), some(1, [("delta", 0.5), ("hexapod", 0.0), ("delta", 0.0), ("hexapod", 0.5)])
)
def test_power_and_wrench_have_exact_derivatives(standing, name, coulomb):
    """First and second derivatives of all node quantities against central differences."""
    robot = standing[name]
    robot = StandingParallelRobot(
        robot.robot, robot.support, dc_motors(robot.n, coulomb), robot.platform_limits, position=(0, 0, 0.9)
    )
    physics = NodePhysics(robot)
    assert physics.smooth
    s = np.hstack(states(robot, 3, 2)).T
    rounding = np.full((robot.n, 3), 0.5)
    at = physics.jacobian(s, rounding)
    np.testing.assert_array_equal(at.y, physics.values(s, rounding))
    weights = np.random.default_rng(3).normal(size=at.y.shape)
    hessian, slopes = bends(physics.hessian(at, weights)), all_slopes(at)
    h = 1e-5
    for j in range(3 * robot.n):
        step = h * (np.arange(3 * robot.n) == j)[:, None]
        up, down = physics.jacobian(s + step, rounding), physics.jacobian(s - step, rounding)
        scale = np.abs(slopes).max()
        np.testing.assert_allclose((up.y - down.y) / (2 * h), slopes[:, :, j], rtol=1e-5, atol=1e-7 * scale)
        expected = np.einsum("ny,nys->ns", weights, (all_slopes(up) - all_slopes(down)) / (2 * h))
        np.testing.assert_allclose(hessian[:, j], expected, rtol=1e-5, atol=2e-7 * np.abs(hessian).max())


def test_power_is_that_of_the_motors(standing):
    """Away from the rounded jump the sum over motors of the model, at motor forces and motor speeds."""
    robot = standing["delta"]
    z, zd, zdd = states(robot, 200, 4)
    speeds = robot.motor_speeds(z, zd)
    away = (np.abs(speeds) > 0.1).all(axis=1)
    assert away.sum() > 50
    power = NodePhysics(robot).values(np.hstack([z, zd, zdd]).T, np.full(z.T.shape, 0.1))[:, 0]
    exact = robot.motors.power(robot.loads(z, zd, zdd)[0], speeds).sum(axis=1)
    # the expression rounds the kink of the regeneration: at most half of its smoothing per motor
    assert np.all((power - exact)[away] >= -1e-9)
    assert np.all((power - exact)[away] <= 0.5 * robot.n * robot.motors.smoothing)


@pytest.mark.parametrize("program_of", ["smooth", "ordered"])
def test_program_derivatives_with_all_rows(task, program_of):
    """Gradient, rows' Jacobian and Hessian of a program, singularity and motor speed rows included."""
    from ocptip.motion.planner.event_order import order_of

    formulation = Formulation(task.robot, task.start, task.goal, task.optimised, task.commands)
    rng = np.random.default_rng(5)
    motion = random_start(task.robot, task.start, task.goal, (0, 1, 2), 3, task.limits, rng)
    x = formulation.variables(motion)
    if program_of == "smooth":
        program = formulation.coarse_program(task.limits, x[formulation.layout.end], nodes=12)
    else:
        order, x = order_of(formulation, x)
        program = formulation.ordered_program(task.limits, order, x, [])
    rows = program.no_rows()
    rows["further"][::3] = True
    rows["torque"][1::4] = True
    rows["tip-over"][::5] = True
    program = program.with_rows(rows)
    further = task.robot.further_limits
    lower, _ = program.bounds()
    assert len(lower) == len(program.values(x)[1])
    assert further.count == 10
    lam = rng.normal(size=len(lower))
    J, g, H = program.jacobian(x), program.gradient(x), program.hessian(x, 1.0, lam)
    h = 1e-6
    for j in rng.choice(len(x) - 1, 6, replace=False):
        step = h * (np.arange(len(x)) == j)
        (f1, r1), (f0, r0) = program.values(x + step), program.values(x - step)
        np.testing.assert_allclose((f1 - f0) / (2 * h), g[j], rtol=1e-4, atol=1e-6)
        np.testing.assert_allclose((r1 - r0) / (2 * h), J[:, j], rtol=1e-4, atol=1e-5 * np.abs(J).max())
        up = program.gradient(x + step) + lam @ program.jacobian(x + step)
        down = program.gradient(x - step) + lam @ program.jacobian(x - step)
        np.testing.assert_allclose((up - down) / (2 * h), H[j], rtol=1e-4, atol=1e-5 * np.abs(H).max())


@pytest.fixture(scope="module")
def plan(task):
    return plan_motion(task, starts=1, seed=0, jobs=1)


@pytest.mark.slow
def test_delta_on_a_cart_is_planned_and_checked(task, plan):
    """At the limit of the reserves, cheaper than straight ramps as fast as they stand."""
    assert plan.verified
    worst = plan.check.worst
    assert max(worst["GN"].value, worst["GT"].value) > 0.88
    assert worst["singularity"].value > task.robot.platform_limits.singularity
    assert worst["motor_speed"].value < 9.0
    np.testing.assert_allclose(plan.motion.goal, task.goal, atol=1e-9)
    straight = straight_motion(task)
    assert check_motion(task.robot, straight, task.limits).verified
    assert plan.energy < 0.97 * task.robot.energy(straight)


def straight_motion(task):
    """All coordinates in one ramp each, in proportion, slowed down until the check holds."""
    way = task.goal - task.start
    largest = np.abs(way).max()

    def at(duration):
        commands = []
        for goal, share in zip(task.goal, np.abs(way) / largest, strict=True):
            a = 4 * max(share, 1e-9) * largest / duration**2
            commands.append([RampCommand(goal, 10.0 * max(share, 1e-9), a)])
        return Trajectory.from_profiles(task.start, commands)

    fast, slow = 0.1, 4.0
    for _ in range(14):
        middle = 0.5 * (fast + slow)
        verified = check_motion(task.robot, at(middle), task.limits, step=0.02).verified
        fast, slow = (fast, middle) if verified else (middle, slow)
    return at(slow)


@pytest.mark.slow
def test_the_plan_holds_for_the_numeric_robot(task, plan):
    """Reserves, motor forces and regularity along the plan by the routes that know no CasADi expression."""
    robot, parallel = task.robot, task.robot.robot
    times = np.linspace(1e-6, plan.duration - 1e-6, 60)
    z, zd, zdd = plan.motion.states(times)
    assert parallel.crossings(z) == ()
    reached = robot.contact_states(numeric_loads(robot, z, zd, zdd)[1])
    assert reached.persistent.all()
    assert robot.tip_over.evaluate(reached).GN.max() <= task.limits.GN + 1e-7
    assert robot.slip.evaluate(reached, derivatives=False).GT.max() <= task.limits.GT + 1e-7
    forces = np.array([parallel.inverse_dynamics(*s).motors for s in zip(z, zd, zdd, strict=True)])
    assert np.all(np.abs(forces) <= robot.limits.torque)


@pytest.mark.slow
def test_energy_is_the_integral_of_the_power(task, plan):
    """Against a sum of short steps; the motors' changes of direction are interval ends.

    The sum is off by at most half a step times all jumps of the power, some 200 W: 0.2 mJ.
    """
    times = (np.arange(200_000) + 0.5) / 200_000 * plan.duration
    z, zd, zdd = plan.motion.states(times)
    power = task.robot.motors.power(task.robot.loads(z, zd, zdd)[0], task.robot.motor_speeds(z, zd))
    expected = power.sum(axis=1).mean() * plan.duration
    # not split at the kinks of the regeneration, as for arms
    assert plan.energy == pytest.approx(expected, rel=2e-3)
    without = replace(task.robot.motors, regeneration=1.0)
    robot = StandingParallelRobot(
        task.robot.robot, task.robot.support, without, task.robot.platform_limits, position=(0, 0, 0.9)
    )
    power = without.power(robot.loads(z, zd, zdd)[0], robot.motor_speeds(z, zd))
    assert robot.energy(plan.motion) == pytest.approx(power.sum(axis=1).mean() * plan.duration, rel=2e-5)


def test_check_names_singularity_and_motor_speed(task, plan):
    """Limits just beyond what the plan uses are violations with value, instant and place."""
    used = {name: plan.check.worst[name] for name in ("singularity", "motor_speed")}
    limits = replace(
        task.robot.platform_limits,
        singularity=used["singularity"].value + 1e-3,
        motor_speed=used["motor_speed"].value - 1e-3,
    )
    robot = StandingParallelRobot(
        task.robot.robot, task.robot.support, task.robot.motors, limits, position=(0, 0, 0.9)
    )
    checked = check_motion(robot, plan.motion, task.limits)
    assert not checked.verified
    assert len(checked.violations) == 2
    for name, least in (("singularity", True), ("motor_speed", False)):
        (broken,) = [v for v in checked.violations if v.name == name]
        assert broken.least == least
        assert used[name].detail in broken.detail
        assert checked.worst[name].value == pytest.approx(used[name].value, rel=1e-6)


@pytest.mark.slow
def test_a_motion_through_a_singular_pose_is_not_checked(task):
    """Straight through the arm's stretched pose and back: out of reach on the way, finite, refused."""
    limits = replace(task.robot.platform_limits, lower=[-0.9, -0.9, -0.9], upper=[0.9, 0.9, -0.3])
    robot = StandingParallelRobot(
        task.robot.robot, task.robot.support, task.robot.motors, limits, position=(0, 0, 0.9)
    )
    commands = [
        [RampCommand(0.75, 0.5, 1.0), RampCommand(0.0, 0.5, 1.0)],
        [RampCommand(0.0, 0.5, 1.0)],
        [RampCommand(-0.5, 0.5, 1.0)],
    ]
    checked = check_motion(robot, Trajectory.from_profiles([0.0, 0.0, -0.5], commands), task.limits)
    assert not checked.verified
    assert checked.worst["singularity"].value < 0
    assert any(v.name == "singularity" for v in checked.violations)
    far = MotionTask("far", robot, [0.0, 0.0, -0.5], [0.85, 0.0, -0.5])
    assert any("singularity of leg" in reason for reason in refusals(far))


@pytest.mark.slow
def test_motor_speed_limit_shapes_the_plan(task, plan):
    """Half the motor speed of the free plan: the new plan keeps it and is slower."""
    limits = replace(task.robot.platform_limits, motor_speed=0.5 * plan.check.worst["motor_speed"].value)
    robot = StandingParallelRobot(
        task.robot.robot, task.robot.support, task.robot.motors, limits, position=(0, 0, 0.9)
    )
    slower = plan_motion(replace(task, robot=robot), starts=1, jobs=1)
    assert slower.verified
    assert slower.check.worst["motor_speed"].value <= limits.motor_speed + 1e-9
    assert slower.duration > plan.duration


def test_a_restored_robot_is_the_same(standing):
    for robot in standing.values():
        again = pickle.loads(pickle.dumps(robot))
        z, zd, zdd = states(robot, 3, 6)
        for ours, theirs in zip(robot.loads(z, zd, zdd), again.loads(z, zd, zdd), strict=True):
            np.testing.assert_array_equal(ours, theirs)
        assert again.tip_over.reference_moment == robot.tip_over.reference_moment


def test_output_has_units(task, plan, tmp_path):
    """Metres in plan.json, read back exactly; one column per quantity in the table."""
    data = plan_to_dict(plan)
    assert data["units"] == ["m"] * 3
    np.testing.assert_allclose(data["goal"], task.goal, atol=1e-9)
    again = Trajectory.from_dict(data)
    np.testing.assert_array_equal(again.goal, plan.motion.goal)
    assert again.end == plan.motion.end
    samples = sample_motion(task.robot, plan.motion, 0.02)
    write_motion_csv(tmp_path / "motion.csv", samples)
    header, *lines = (tmp_path / "motion.csv").read_text().splitlines()
    names = header.split(",")
    assert len(set(names)) == len(names)
    table = np.array([[float(v) for v in line.split(",")] for line in lines])
    for name, values in (
        ("q1_m", samples.angles[:, 0]),
        ("qd3_m_s", samples.speeds[:, 2]),
        ("tau2_Nm", samples.torques[:, 1]),
        ("power1_W", samples.powers[:, 0]),
        ("singularity_platform", samples.further[:, 6]),
        ("motor_speed_motor_3", samples.further[:, 9]),
    ):
        np.testing.assert_allclose(table[:, names.index(name)], values, rtol=1e-10, atol=1e-10)
    points = controller_points(plan.motion, "cubic").points
    assert joint_trajectory(plan.task.robot, points)["joint_names"] == ["x", "y", "z"]


def test_units_of_mixed_coordinates(standing):
    robot = standing["hexapod"]
    assert robot.units == ("m", "m", "m", "rad", "rad", "rad")
    assert robot.motor_units == ("N",) * 6
    motion = Trajectory.from_profiles(np.full(6, 0.1), [[RampCommand(0.2, 1.0, 2.0)]] * 6)
    data = motion.to_dict(robot.units)
    assert data["start"] == pytest.approx([0.1] * 3 + [np.rad2deg(0.1)] * 3)
    assert data["commands"][3][0]["speed"] == pytest.approx(np.rad2deg(1.0))
    assert data["commands"][2][0]["speed"] == 1.0
    np.testing.assert_allclose(Trajectory.from_dict(data).goal, motion.goal, rtol=1e-15)


@pytest.mark.filterwarnings("ignore:.*are they radians")
@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('parallel = "Delta"', 'parallel = "Dolta"', "robot.parallel"),
        ("mass = 1.0 ", "mass = -1.0 ", "payload.mass"),
        ("motor_force = 20.0", "motor_torque = 20.0", "robot.limits.motor_torque"),
        ("motor_force = 20.0", "motor_force = [20.0, 20.0]", "robot.limits.motor_force"),
        ("singularity = 0.1", "singularity = 1.5", "singularity"),
        ("upper = [0.25, 0.25, -0.35]", "upper = [0.25, 0.25, -0.65]", "lower: must be below upper"),
        ('kind = "dc"', 'kind = "estimated"', "motors.kind"),
        ("start = [-0.15, 0.0, -0.5]", "start_deg = [-0.15, 0.0, -0.5]", "motion.start_deg"),
        ("start = [-0.15, 0.0, -0.5]", "start = [-0.15, 0.0]", "motion.start"),
        ("commands = 3", 'optimised = ["x", "phi1"]', "phi1"),
        ("[motors]", '[arm]\nname = "FP1W2F"\n[motors]', "arm"),
    ],
)
def test_task_files_are_refused_with_the_place(tmp_path, old, new, said):
    text = TASK.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path = tmp_path / "task.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=f"task.toml: .*{said}"):
        load_task(path)


def test_start_that_cannot_be_held_is_refused(task):
    low = replace(task, start=np.array([0.3, 0.0, -0.5]))
    assert any("joint 1 at 0.3000 m is outside its limits -0.2500 to 0.2500" in r for r in refusals(low))
    weak = replace(task.robot.platform_limits, motor_force=1.0)
    robot = StandingParallelRobot(
        task.robot.robot, task.robot.support, task.robot.motors, weak, position=(0, 0, 0.9)
    )
    assert any("N m to hold the robot" in reason for reason in refusals(replace(task, robot=robot)))


def test_robots_without_minimal_form_are_refused(task):
    description = task.robot.robot.description
    leg = description.legs[0]
    rough = replace(description, legs=(replace(leg, coulomb=(0.1,) * len(leg.rows)), *description.legs[1:]))
    with pytest.raises(InputError, match="friction"):
        StandingParallelRobot(
            ParallelRobot(rough), task.robot.support, task.robot.motors, task.robot.platform_limits
        )
    with pytest.raises(InputError, match="motors: the robot has 3"):
        StandingParallelRobot(task.robot.robot, task.robot.support, dc_motors(2), task.robot.platform_limits)
    with pytest.raises(InputError, match="motion: has 2 joints, the robot has 3"):
        check_motion(task.robot, Trajectory.from_profiles([0, 0], [[RampCommand(1, 1, 1)]] * 2))
    with pytest.raises(InputError, match="that of an arm"):
        MotionPenalty(task)


@pytest.mark.slow
def test_hexapod_on_a_cart_is_planned_and_checked(standing):
    """Sideways, up and tilted: all six coordinates are optimised."""
    robot = standing["hexapod"]
    task = MotionTask(
        "hexapod",
        robot,
        [-0.08, 0.0, 0.58, 0.0, 0.1, 0.0],
        [0.08, 0.02, 0.62, 0.1, -0.1, 0.1],
        Limits(),
        optimised=tuple(range(6)),
        commands=2,
    )
    plan = plan_motion(task, starts=1, jobs=1)
    assert plan.verified
    assert robot.robot.crossings(plan.motion.states(np.linspace(0, plan.duration, 80))[0]) == ()


def test_the_task_file_can_name_a_robot_file(tmp_path):
    """A 3RRR lying in the portal, from a file beside the task file: loads of the ready-made one."""
    legs = [
        ("[0.0, 1.0, 0.0]", "3*pi/2", "[0.0, 0.3, 0.0]"),
        ("[-0.8660254037844387, -0.5, 0.0]", "pi/6", "[-0.2598076211353316, -0.15, 0.0]"),
        ("[0.8660254037844387, -0.5, 0.0]", "5*pi/6", "[0.2598076211353316, -0.15, 0.0]"),
    ]
    text = """name = "3RRR"
free = ["x", "y", "phi3"]
home = [0.0, 0.0, 0.0]
[platform]
mass = 2.0
inertia = [0.045, 0.045, 0.09]
[table.RRR]
joints_to_coupling = 2
rows = [{ joint = "revolute" }, { joint = "revolute", d = 0.6 }, { joint = "revolute", d = 0.6 }]
bodies = [
    { mass = 1.5, center = [0.3, 0.0, 0.0], inertia = [0.0003, 0.04515, 0.04515] },
    { mass = 1.2, center = [0.3, 0.0, 0.0], inertia = [0.00024, 0.03612, 0.03612] },
]
"""
    for position, angle, coupling in legs:
        text += f"""[[leg]]
table = "RRR"
base_position = {position}
base_rotation = [["z", "{angle}"]]
coupling = {coupling}
actuated = [1]
"""
    (tmp_path / "robot.toml").write_text(text)
    path = tmp_path / "task.toml"
    task_text = TASK.read_text(encoding="utf-8")
    for old, new in (
        ('parallel = "Delta"', 'parallel = "robot.toml"'),
        ("[payload]                           # on the platform\nmass = 1.0", "# none: 1.0"),
        ("lower = [-0.25, -0.25, -0.6]", "lower = [-0.25, -0.25, -0.5]"),
        ("upper = [0.25, 0.25, -0.35]", "upper = [0.25, 0.25, 0.5]"),
        ("start = [-0.15, 0.0, -0.5]", "start = [-0.1, 0.0, 0.0]"),
        ("goal = [0.15, 0.0, -0.45]", "goal = [0.1, 0.0, 0.2]"),
        ("commands = 3", 'optimised = ["x", "phi3"]'),
    ):
        assert task_text.count(old) == 1
        task_text = task_text.replace(old, new)
    path.write_text(task_text, encoding="utf-8")
    task = load_task(path)
    assert task.robot.units == ("m", "m", "rad")
    assert task.optimised == (0, 2)
    z, zd, zdd = states(task.robot, 3, 8)
    forces, _ = task.robot.loads(z, zd, zdd)
    built = ParallelRobot(rrr3())
    for k in range(3):
        expected = built.inverse_dynamics(z[k], zd[k], zdd[k], gravity=[0, 0, -9.81]).motors
        np.testing.assert_allclose(forces[k], expected, rtol=1e-9, atol=1e-9)
