"""Replays in MuJoCo beside the library: forces, lifts, slides."""

import json
from dataclasses import replace

import numpy as np
import pytest
from mujoco import MjModel

from ocptip.contact.bindings.clamps import (
    ForceConstantTwoSidedClamp,
    ForceVariableHalfRigidClamp,
    ForceVariableTwoSidedClamp,
    RigidClamp,
)
from ocptip.published.tasks import experiment_task
from ocptip.robots.payload import Payload
from ocptip.standing.parts import Part
from ocptip.standing.simulation.mjcf import to_mjcf
from ocptip.standing.simulation.replay import PrescribedModel, Simulator, compared
from ocptip.standing.simulation.world import World
from ocptip.trajectories.trajectory import Trajectory
from tests.places import ROOT
from tests.quick import some


def plan_of(name):
    """Robot and verified motion of a published case, as "A-effective"."""
    case, base = name.split("-")
    path = ROOT / f"studies/results/plans/{name}/plan.json"
    return experiment_task(case, base).robot, Trajectory.from_dict(json.loads(path.read_text()))


@pytest.fixture(scope="module")
def plan():
    return plan_of("A-effective")


@pytest.fixture(scope="module")
def simulator(plan):
    return Simulator((Part(*plan),))


def test_forces_are_the_librarys(plan, simulator):
    replay = simulator.run()
    beside = compared((Part(*plan),), replay)
    assert replay.stands
    assert beside.stands
    assert beside.rms_least < 1.0  # N
    assert beside.rms < 1.0
    assert beside.least.min() == pytest.approx(9.75, abs=0.01)  # README
    moving = (replay.times > 0) & (replay.times < replay.end) & replay.quiet
    assert moving.mean() > 0.7  # what is compared is nearly all of it


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "A-effective",
        "B-effective",
        "D-effective",
        "E-effective",
        "G-effective",
        "H-effective",
        "A-printed",
        "D-printed",
    ],
)
def test_least_foot_forces_of_eight_plans(name):
    robot, motion = plan_of(name)
    parts = (Part(robot, motion),)
    replay = Simulator(parts).run()
    beside = compared(parts, replay)
    assert replay.stands
    assert beside.rms_least < 1.0  # N
    assert beside.rms < 1.0


def test_events_close_together_are_keyframes_of_their_own():
    robot, motion = plan_of("D-printed")
    assert np.diff(motion.event_times).min() < 2e-4
    assert to_mjcf(robot, motion).count("<key ") == to_mjcf(robot, motion).count('name="key ') + 1
    Simulator((Part(robot, motion.time_scaled(0.01)),)).run()  # MuJoCo takes it


def test_feet_that_give_lift_as_the_library_says(plan, simulator):
    world = World(stiffness=1e6, damping=0.05)
    replay = simulator.run(world)
    beside = compared((Part(*plan),), replay)
    assert replay.lift == pytest.approx(68e-6, rel=0.1)  # studies/results/elastic_feet.md
    assert beside.rms < 3.0
    assert not replay.stands
    assert not beside.stands


@pytest.mark.parametrize(
    ("world", "stands"),
    some(
        3,
        [
            (World(tilt=np.radians(2.0), downhill=np.radians(-120)), True),  # README: tolerates 2.94 deg
            (World(tilt=np.radians(4.5), downhill=np.radians(-120)), False),
            (World(payload=1.5), True),  # 1.78 kg
            (World(payload=2.6), False),
            (World(friction=0.8), True),  # x 0.72
            (World(friction=0.4), False),
            (World(speed=1.1), True),  # 15.1 %
            (World(speed=1.4), False),
        ],
    ),
    ids=str,
)
def test_worlds_that_are_tolerated_and_not(simulator, world, stands):
    assert simulator.run(world).stands is stands


def test_masses_change_forces(plan, simulator):
    robot = plan[0]
    heavier = simulator.run(World(masses=(1.05,) * (1 + robot.arm.links)))
    same = simulator.run()
    rest = same.times < 0
    assert heavier.forces[rest].sum(axis=1).mean() == pytest.approx(1.05 * robot.mass * 9.81, rel=1e-3)
    assert same.forces[rest].sum(axis=1).mean() == pytest.approx(robot.mass * 9.81, rel=1e-3)


def test_late_joints_are_late(plan, simulator):
    robot, motion = plan
    late = simulator.run(World(late=(0.05,) * robot.n))
    on_time = simulator.run()
    shift = round(0.05 / late.step)
    moving = slice(500, 8000)
    away = late.forces[shift:][moving] - on_time.forces[moving]
    assert np.sqrt(np.mean(away**2)) < 1.0
    assert late.end == pytest.approx(motion.end + 0.05)


def test_rigid_clamps_pull(plan):
    """A base whose centre of mass is far outside its feet hangs in a clamp."""
    robot, motion = plan
    places = [[0.3, 0.0, -0.298], [0.5, 0.2, -0.298], [0.5, -0.2, -0.298]]
    clamps = [RigidClamp(position=p, friction_upper=0.9, friction_lower=0.9) for p in places]
    replay = Simulator((Part(robot.varied(support=robot.support.varied(clamps)), motion),)).run()
    assert not replay.falls
    assert replay.slide < 1e-3
    assert replay.forces.min() < -50  # N
    rest = replay.times < 0
    assert replay.forces[rest].sum(axis=1).mean() == pytest.approx(robot.mass * 9.81, rel=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["C", pytest.param("F", marks=pytest.mark.slow)])
def test_clamp_of_constant_force_holds_and_slips_as_the_library_says(case):
    """K3 of cases C and F is pressed with 29.33 N: forces, and the friction with which the base slips."""
    robot, motion = plan_of(f"{case}-effective")
    part = Part(robot, motion)
    worst = json.loads((ROOT / f"studies/results/plans/{case}-effective/plan.json").read_text())["worst"]
    simulator, GT = Simulator((part,)), worst["GT"]["value"]
    enough, too_little = (simulator.run(World(friction=f * GT)) for f in (1.05, 0.85))
    beside = compared((part,), enough)
    assert enough.stands
    assert beside.stands
    assert beside.rms < 1.0  # N
    assert -29.34 < enough.forces[:, 2].min() == pytest.approx(beside.least[2], abs=2.0)
    assert enough.slide < 0.02e-3 < 0.05e-3 < too_little.slide  # m


@pytest.mark.slow
def test_clamp_lets_go_beyond_its_force():
    """A base that would tip without its clamp: the pressed foot lifts where the pull exceeds the force."""
    robot, motion = plan_of("C-effective")
    weaker = replace(robot.support.contacts[2], clamp_force=10.0)
    support = robot.support.varied([*robot.support.contacts[:2], weaker])
    replay = Simulator((Part(robot.varied(support=support), motion),)).run()
    lifted = replay.heights[:, 2] > 0.5e-3
    assert np.median(replay.forces[lifted, 2]) == pytest.approx(-10.0, abs=1.0)  # and the jaw's inertia
    assert not replay.stands
    assert replay.lift > 0.5e-3


@pytest.mark.parametrize(
    ("kind", "options", "stiffness"),
    some(
        1,
        [
            (ForceConstantTwoSidedClamp, {"lever_ratio": 1.5}, None),
            (ForceVariableTwoSidedClamp, {"lever_ratio": 1.5}, 1e6),
            (ForceVariableHalfRigidClamp, {}, 1e6),
        ],
    ),
)
def test_clamps_on_springs_and_levers_hold_as_the_library_says(kind, options, stiffness):
    """Case C, slower, with other clamps in its third contact."""
    robot, motion = plan_of("C-effective")
    own = robot.support.contacts
    jaws = {"position": own[2].position, "friction_upper": 0.2, "friction_lower": 0.2}
    contacts = [*own[:2], kind(**jaws, clamp_force=100.0, **options)]
    held = robot.support.varied([replace(contact, stiffness=stiffness) for contact in contacts])
    part = Part(robot.varied(support=held), motion.time_scaled(1.6))
    replay = Simulator((part,)).run()
    beside = compared((part,), replay)
    assert replay.stands
    assert beside.stands
    assert beside.rms < 1.5  # N
    assert beside.least[2] < -1
    if stiffness:  # rigid jaws ring in the simulator
        assert replay.forces[:, 2].min() == pytest.approx(beside.least[2], abs=0.5)


def test_jaws_on_a_lever_yield_at_their_force():
    """The pull at which the lower jaw of a lever yields is (1 + i) F."""
    robot, motion = plan_of("C-effective")
    own = robot.support.contacts
    jaws = {"position": own[2].position, "friction_upper": 0.2, "friction_lower": 0.2}
    weak = ForceConstantTwoSidedClamp(**jaws, clamp_force=8.0, lever_ratio=0.1)
    part = Part(robot.varied(support=robot.support.varied([*own[:2], weak])), motion)
    replay = Simulator((part,)).run()
    up = (replay.times < 0.8) & (replay.heights[:, 2] > 0.5e-3) & (replay.forces[:, 2] < 0)
    assert np.median(replay.forces[up, 2]) == pytest.approx(-8.8, abs=0.3)
    assert not replay.stands


@pytest.mark.slow
@pytest.mark.parametrize("rise", some(1, [0.02, 0.08]))
def test_s_curves_are_replayed_as_planned(plan, rise):
    """The ramps of plan A with accelerations that rise: slower, and forces without jumps."""
    robot, ramps = plan
    motion = ramps.with_rise_times(rise).time_scaled(1.2)
    assert motion.rise_times == pytest.approx([1.2 * rise] * robot.n)
    assert len(motion.event_times) > len(ramps.event_times)
    parts = (Part(robot, motion),)
    replay = Simulator(parts).run()
    beside = compared(parts, replay)
    assert replay.stands
    assert beside.rms < 0.5  # N
    model = MjModel.from_xml_string(to_mjcf(robot, motion))
    times = model.key_time
    np.testing.assert_allclose(model.key_ctrl, motion.states(times)[0], atol=1e-9)


def cycle(plan, rest=0.3):
    """Out with nothing, a rest, and back with 1 kg, so slowly that it may."""
    robot, motion = plan
    laden = robot.varied(arm=robot.arm.with_payload(Payload(1.0, [0.02, 0.0, 0.03])))
    none, own = [None] * robot.n, robot.limits
    back = Trajectory.ending_together(motion.goal, motion.start, none, own.speed / 3, own.acceleration / 6)
    return Part(robot, motion, "out", 0.0, rest), Part(laden, back, "back", motion.end + rest)


@pytest.mark.slow
def test_a_cycle_goes_on_with_the_state_and_what_is_held(plan):
    parts = cycle(plan)
    replay = Simulator(parts).run()
    beside = compared(parts, replay)
    assert replay.stands
    assert beside.stands
    assert beside.rms < 0.5  # N; the weight of what is held is 9.81 N
    held = [
        replay.forces[abs(replay.times - t) < 0.005].sum(axis=1).mean() for t in (-0.01, parts[-1].end + 0.1)
    ]
    assert held[1] - held[0] == pytest.approx(9.81, abs=0.02)
    moving = (replay.times > parts[1].begin) & (replay.times < parts[1].end)
    assert replay.forces[moving].sum(axis=1).mean() == pytest.approx(held[1], rel=0.02)
    faster = Simulator(parts, step=4e-4).run(World(speed=2.0))
    assert faster.end == pytest.approx(0.5 * parts[-1].end)
    assert not compared(parts, faster).stands


@pytest.mark.parametrize("feet", some(1, [{}, {"stiffness": 1e6, "damping": 0.05}]))
def test_models_of_worlds_are_those_of_the_robot_there(plan, feet):
    """One model serves all worlds with such feet; here it is compared with the export of each by itself."""
    robot, motion = plan
    simulator = Simulator((Part(robot, motion),), step=4e-4)
    simulator.run(World(payload=0.02, **feet))  # another world before
    world = World(tilt=0.01, downhill=2.0, payload=0.4, friction=0.7, masses=(1.05,), **feet)
    model = simulator._model(0, world)
    there = world.robot(robot)
    own = PrescribedModel(there, motion, 4e-4).compiled(World(masses=world.masses), Payload(0.4))
    np.testing.assert_allclose(model.opt.gravity, there.support.gravity)
    np.testing.assert_allclose(model.pair_friction, own.pair_friction)
    np.testing.assert_allclose(model.body("payload").mass, 0.4)
    np.testing.assert_allclose(model.body("payload").ipos, own.body("payload").ipos)
    np.testing.assert_allclose(model.body_mass, own.body_mass, atol=0.02)  # how links are split is free
    assert np.sum(model.body_mass) == pytest.approx(np.sum(own.body_mass), rel=1e-6)
    np.testing.assert_allclose(model.dof_damping, own.dof_damping, rtol=0.02)  # of the first world's payload


@pytest.mark.slow
def test_casters_that_give_are_no_joints(plan):
    """A caster has no spring across its normal: there its foot moves with the base."""
    robot, motion = plan
    wheels = [replace(c, stiffness=1e6, damping=300.0) for c in robot.support.contacts]
    caster = replace(wheels[0], friction=0.0)
    robot = robot.varied(support=robot.support.varied([*wheels, caster]))
    parts = (Part(robot, motion.time_scaled(2.0)),)
    replay = Simulator(parts).run()
    beside = compared(parts, replay)
    assert replay.stands
    assert beside.rms < 1.0  # N, against springs without MuJoCo
    assert np.isnan(replay.slides[3])  # it holds nothing across its normal, so its slide says nothing
    assert np.all(np.isfinite(replay.slides[:3]))
    model = PrescribedModel(robot, motion, 1e-4).compiled(World(), None)
    feet = [name for k in range(model.njnt) if (name := model.joint(k).name).startswith("foot")]
    assert feet[-3:] == ["foot3_s", "foot3_t", "foot4_n"]
    assert not {model.actuator(k).name for k in range(model.nu)} & set(feet)
