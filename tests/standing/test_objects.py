"""Objects that only contacts hold: wrenches by the load on the base, margins by hand and cone programs."""

import dataclasses
from functools import partial
from types import SimpleNamespace

import casadi as cs
import clarabel
import numpy as np
import pytest

import ocptip
from ocptip.basics.errors import InputError
from ocptip.certificate.result import Certificate
from ocptip.certificate.trusted.checker import Verdict
from ocptip.cli.motion_summary import notes
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.motion.check import check_motion
from ocptip.motion.files.execution import execute, slower_to_prove
from ocptip.motion.margins import motion_margins
from ocptip.motion.motion_plan import MotionPlan
from ocptip.motion.objective import TIME
from ocptip.motion.provable import DEARER, proved_slower
from ocptip.motion.stops.cancels import safe_decelerations
from ocptip.motion.stops.check import check_stops
from ocptip.motion.stops.rules import StopRules
from ocptip.motion.task import MotionTask
from ocptip.motion.tolerated import tolerated
from ocptip.numerics.cone_program import quiet_settings, solve_cones
from ocptip.reserves.tipping import moment_at
from ocptip.retiming.among import no_worse_than_line
from ocptip.retiming.retime import retime
from ocptip.robots.base_motion import BaseMotion
from ocptip.robots.dynamics import evaluate_dynamics
from ocptip.robots.kinematics import link_frames
from ocptip.robots.motors import DCMotors
from ocptip.standing.arm import Robot
from ocptip.standing.contact_margins import Margin
from ocptip.standing.instants import Instants
from ocptip.standing.limit_kinds.kinds import limits_of
from ocptip.standing.limit_kinds.limit import tightened
from ocptip.standing.limits import Limits
from ocptip.standing.objects import Object, carrier_expressions, carrier_motions, cup
from ocptip.standing.stops.along_path import Path, PathStops, StopPoints, stop_slopes
from ocptip.standing.stops.by_brakes import BrakeCheck, Brakes, closing_of
from ocptip.standing.stops.by_cancel import Cancel, cancel_slopes, cancelled_motion
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.worst_case import worst_case_of
from ocptip.task_files.motion import load_task
from ocptip.trajectories.path import JointPath
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from tests.places import EXAMPLES
from tests.robots.sample_arms import random_arm, random_rotation

G = 9.81
UR5 = EXAMPLES / "tasks" / "ur5_cart.toml"
BOX = Object.box("box", 2.0, (0.1, 0.1, 0.3), friction=0.6)
GLASS = Object.cylinder("glass", 0.4, (0.035, 0.14), friction=0.35)
PLATE = Object.box("plate", 0.5, (0.16, 0.12, 0.03), friction=0.4, position=(0.1, 0.02, 0.01))
CUP = Object.box("cup", 0.2, (0.06, 0.05, 0.1), friction=0.3, on="plate", position=(0.02, 0.0, 0.0))
SLIPPERY = Object.box("low", 1.0, (0.1, 0.1, 0.02), friction=0.2)
TIPS = G * 0.05 * (1 - 0.1 * (1 / 0.9 - 1)) / 0.15  # m/s^2 at which GN of the box is 0.9
CRATE = Object.box("crate", 3.0, (0.2, 0.2, 0.6), friction=0.5, on="base", position=(-0.1, 0.0, 0.5))


def robot_of(arm, objects) -> Robot:
    corners = [(x, y, 0.0) for x in (-0.5, 0.5) for y in (-0.5, 0.5)]
    feet = [UnilateralContact(position=corner, friction=0.9) for corner in corners]
    support = Support(feet, mass=200.0, center_of_mass=(0, 0, 0.2))
    arm = arm.with_limits(
        torque=np.full(arm.n, 1e3), speed=np.full(arm.n, 2.0), acceleration=np.full(arm.n, 20.0)
    )
    return Robot(arm, support, DCMotors.estimated(arm), floor=False).carrying(objects)


def on_a_slide(objects) -> Robot:
    """An arm that slides along x; its gripper has the axes of the base."""
    turn = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # z of the joint along x
    arm = dataclasses.replace(
        random_arm(0, 1),
        rotations=turn[None],
        tool_rotation=turn.T,
        prismatic=np.array([True]),
        mount_rotation=np.eye(3),
        mount_position=np.array([0.0, 0, 0.7]),
    )
    return robot_of(arm, objects)


def state_of(robot: Robot, acceleration: float) -> Instants:
    still = np.zeros((1, 1))
    return Instants.of_states(robot, still, still, np.full((1, 1), acceleration))


@pytest.mark.parametrize("seed", [0, 1])
def test_the_wrench_on_an_object_is_what_it_adds_to_the_load_of_the_arm(seed):
    rng, arm = np.random.default_rng(seed), random_arm(seed, 4)
    tilted = dataclasses.replace(
        GLASS, on="gripper", position=(0.1, -0.2, 0.3), rotation=random_rotation(rng)
    )
    robot, count = robot_of(arm, [tilted]), 5
    q, qd, qdd = rng.normal(size=(3, count, 4))
    drives = BaseMotion(*rng.normal(size=(3, count, 3)))
    found = robot.object_wrenches(q, qd, qdd, drives)[0]
    given = {"gravity": robot.support.gravity, "base_motion": drives}
    with_it, without = (evaluate_dynamics(own, q, qd, qdd, **given).wrench for own in (robot.arm, arm))
    for k in range(count):
        frames = link_frames(robot.arm, q[k])
        turn = frames.rotations[-1]
        centre = frames.origins[-1] + turn @ robot.interfaces[1].support.center_of_mass
        force = turn @ found[k, :3]
        moment = turn @ found[k, 3:] + np.cross(centre, force)
        np.testing.assert_allclose(np.r_[force, moment], (with_it - without)[k], rtol=1e-9, atol=1e-9)


def test_a_motion_tolerates_what_its_box_does_by_hand():
    """Accelerated by a, a box tips where a and the tilt ask for more than its width, a slide lets it slip."""
    a, wide, high = 2.0, 0.05, 0.15
    motion = Trajectory.from_profiles([0.0], [[RampCommand(0.5, 1.0, a)]])
    found = {one.quantity: one for one in tolerated(on_a_slide([BOX]), motion)}
    tilt = np.degrees(np.arctan2(wide, high) - np.arcsin(a * high / (G * np.hypot(wide, high))))
    for name, value in {
        "faster": 100 * (np.sqrt(G * wide / (high * a)) - 1),
        "friction": a / (BOX.friction * G),
        "tilt": tilt,
    }.items():
        assert found[name].value == pytest.approx(value, rel=5e-3)
        assert found[name].how.startswith("box ")
    assert found["delay"].at_most
    alone = {one.quantity: one for one in tolerated(on_a_slide([]), motion)}
    assert alone["faster"].value > 2 * found["faster"].value
    assert found["extra_mass"].value < alone["extra_mass"].value  # the box loads the arm


@pytest.mark.parametrize("drives", [True, False])
def test_expressions_of_the_motion_of_gripper_and_base_are_those_of_numbers(drives):
    rng, arm = np.random.default_rng(4), random_arm(4, 3)
    q, qd, qdd, gravity, *base = rng.normal(size=(7, 3))
    known = carrier_motions(arm, gravity, q[None], qd[None], qdd[None], BaseMotion(*base) if drives else None)
    found = carrier_expressions(
        arm, gravity, *map(cs.SX, (q, qd, qdd)), [cs.SX(own) for own in base] * drives
    )
    for name, motion in known.items():
        np.testing.assert_allclose(cs.DM(cs.vertcat(*found[name])).full().T, motion.rows(1), atol=1e-12)


def test_a_box_on_a_slide_tips_at_half_its_length_over_the_height_of_its_centre_and_slides_at_its_friction():
    robot, a = on_a_slide([BOX]), 2.0
    at = state_of(robot, a).interfaces[1]
    np.testing.assert_allclose(at.tip.margins.min(), 2.0 * (G * 0.05 - a * 0.15), rtol=1e-9)
    np.testing.assert_allclose(at.slip.GT, [a / (0.6 * G)], rtol=1e-6)
    assert state_of(robot, 0.999 * G / 3).interfaces[1].states.persistent.all()
    assert not state_of(robot, 1.001 * G / 3).interfaces[1].states.persistent.any()


def test_a_cup_holds_by_its_force_peels_at_its_rim_and_slides_at_its_friction():
    rim, a, force = 0.02, 3.0, 30.0
    held = dataclasses.replace(BOX, contacts=cup((0, 0, 0), rim, force, 0.6), friction=None)
    at = state_of(on_a_slide([held]), a).interfaces[1]
    peel = (2.0 * (G * rim - a * 0.15) + force * rim) * np.cos(np.pi / 8)
    assert at.tip.margins.min() == pytest.approx(peel, rel=1e-9)
    assert at.slip.GT[0] == pytest.approx(2.0 * a / (0.6 * (2.0 * G + force)), rel=1e-4)
    upside_down = np.diag([1.0, -1.0, -1.0])
    for share, holds in ((0.98, False), (1.02, True)):
        contacts = cup((0, 0, 0), rim, share * 2.0 * (G + 1.0), 0.6)
        hanging = dataclasses.replace(held, contacts=contacts, rotation=upside_down)
        robot = on_a_slide([hanging])
        rises = BaseMotion(acceleration=(0.0, 0.0, 1.0))
        still = np.zeros((1, 1))
        states = Instants.of_states(robot, still, still, still, base_motion=rises).interfaces[1].states
        assert states.persistent[0] == holds


def test_the_interface_under_a_stack_carries_all_that_stand_on_it():
    robot, a = on_a_slide([CUP, PLATE]), 1.5
    base, plate, cup = robot.interfaces
    assert [own.name for own in robot.interfaces] == ["base", "plate", "cup"]
    assert base is robot
    assert plate.support.mass == pytest.approx(0.7)
    assert cup.support.mass == pytest.approx(0.2)
    assert robot.payload.mass == pytest.approx(0.7)
    np.testing.assert_allclose(cup.support.center_of_mass, [0.12, 0.02, 0.01 + 0.03 + 0.05])
    margin = state_of(robot, a).interfaces[1].tip.margins.min()
    # About the rear edge of the plate: the weight of both there, less the inertia at their heights.
    weight, inertia = G * (0.5 * 0.08 + 0.2 * 0.1), a * (0.5 * 0.015 + 0.2 * 0.08)
    assert margin == pytest.approx(min(weight - inertia, G * 0.7 * 0.06), rel=1e-9)


def test_an_object_on_the_deck_feels_the_base_and_loads_it():
    robot = load_task(UR5).robot.carrying([CRATE])
    assert robot.support.mass == pytest.approx(38.0)
    assert robot.payload is None
    q = np.zeros((1, robot.n))
    wrench = robot.object_wrenches(q, q, q, BaseMotion(acceleration=(1.0, 0.0, 0.0)))[0]
    np.testing.assert_allclose(wrench[0], [-3.0, 0, -3 * G, 0, 0, 0], atol=1e-12)


def shared_optimally(support, wrench) -> float:
    """Least share of the friction with which contact forces balance a wrench: bisection, cone programs."""
    n, W, mu = support.n_contacts, support.wrench_matrix, support.contacts[0].friction
    unit = np.abs(wrench[:3]).max()
    A = np.vstack([W, np.zeros((3 * n, 3 * n))])
    cones = [clarabel.ZeroConeT(6), *[clarabel.SecondOrderConeT(3)] * n]
    b = np.r_[-wrench / unit, np.zeros(3 * n)]
    low, high = 0.0, 4.0
    for _ in range(26):
        share = 0.5 * (low + high)
        for k in range(n):
            A[6 + 3 * k : 9 + 3 * k, 3 * k : 3 * k + 3] = -np.diag([share * mu, 1.0, 1.0])
        holds = solve_cones(np.zeros(3 * n), A, b, cones, quiet_settings(1e-9)).status
        low, high = (low, share) if str(holds) == "Solved" else (share, high)
    return high


def test_random_states_have_the_margins_of_cone_programs_and_of_moments_about_the_edges():
    rng = np.random.default_rng(3)
    robot = robot_of(dataclasses.replace(random_arm(2, 4), tool_rotation=np.eye(3)), [GLASS, PLATE, CUP])
    seen = 0
    for own in robot.interfaces[1:]:
        support = own.support
        wrenches = np.tile(support.weight, (5, 1)) + 0.15 * support.mass * rng.normal(size=(5, 6)) * [
            G, G, G, 0.03 * G, 0.03 * G, 0.03 * G
        ]  # fmt: skip
        states = own.contact_states(wrenches)
        GT = own.slip.evaluate(states, derivatives=False).GT
        margins = own.tip_over.evaluate(states).margins.min(axis=1)
        points = np.array([contact.position for contact in support.contacts]) - support.center_of_mass
        for k in np.flatnonzero(states.persistent):
            seen += 1
            assert GT[k] == pytest.approx(shared_optimally(support, wrenches[k]), abs=1e-6)
            edges = zip(points, np.roll(points, -1, axis=0), strict=True)
            by_hand = []
            for a, b in edges:
                e = (b - a) / np.linalg.norm(b - a)
                by_hand.append(-e @ (wrenches[k, 3:] - np.cross(a, wrenches[k, :3])))
            assert margins[k] == pytest.approx(min(by_hand), rel=1e-9)
    assert seen > 8


def test_a_motion_that_is_too_fast_for_an_object_breaks_its_limits_and_names_it():
    robot = on_a_slide([BOX, dataclasses.replace(GLASS, position=(0.0, 0.3, 0.0), friction=0.6)])
    names = ["GN[box]", "GT[box]", "GN[glass]", "GT[glass]"]
    for a, broken in ((1.5, set()), (4.0, {"GN[box]"})):
        motion = Trajectory.from_profiles([0.0], [(RampCommand(0.4, 1.0, a),)])
        checked = check_motion(robot, motion)
        assert {name for name in names if checked.worst[name].broken} - {"GT[box]"} == broken
        assert checked.verified == checked.stands == (not broken)
        assert checked.objects["box"].moment.value == pytest.approx(2.0 * (G * 0.05 - a * 0.15), rel=1e-6)
        glass = checked.objects["glass"]
        pulls = any("equally compliant contact of glass lifts" in note for note in notes(checked))
        assert pulls == (glass.alike.value < 0)
        lifting = dataclasses.replace(glass, alike=Margin(-0.156, 0.181, (2,)))
        found = notes(dataclasses.replace(checked, objects={"glass": lifting}))
        assert any(
            note.startswith("an equally compliant contact of glass lifts (contact 2") for note in found
        )
        moment = 0.4 * (G * 0.035 - a * 0.07) * np.cos(np.pi / 8)  # about an edge of the polygon in its foot
        assert glass.moment.value == pytest.approx(moment, rel=1e-6)
        assert glass.friction.value == pytest.approx(a / (0.6 * G), rel=1e-5)
        rows = {(row.object, row.name): row for row in motion_margins(robot, checked)}
        assert rows["glass", "tipping_margin_Nm"].nominal.value == glass.moment.value
        assert rows["glass", "friction_used"].used == pytest.approx(a / (0.6 * G) / 0.9, rel=1e-5)
    assert any("of box slips or lifts off" in broken.detail for broken in checked.violations)


@pytest.mark.slow
def test_a_plan_is_as_fast_as_the_object_allows_and_is_proved():
    robot = on_a_slide([SLIPPERY])
    task = MotionTask("slide", robot, np.zeros(1), np.array([0.5]), objective=TIME, rise_times=0.0)
    found = ocptip.plan(task, starts=1, jobs=1)
    assert found.verified
    shortest = 2 * np.sqrt(0.5 / (0.9 * 0.2 * G))
    assert shortest < found.duration < 1.02 * shortest
    assert found.headline.startswith("PROVED for the nominal model")
    assert found.certificate.data["model"]["objects"][0]["name"] == "low"
    assert found.check.worst["GT[low]"].value == pytest.approx(0.9, abs=0.02)
    [outcome] = found.require("friction used <= 50 %")
    assert not outcome.met
    assert "nominal of low" in str(outcome)
    with pytest.raises(InputError, match="object: require tilt does not take objects"):
        found.require("tilt >= 1 deg")


def stand_in_proof(robot, motion, checked, limits):
    """Its bound of the friction utilisation is 1.2 % above the samples, as bounds of many contacts are."""
    bound = 1.012 * checked.worst["GT[low]"].value
    verdict = Verdict(True, (), {"GT[low]": bound}, 1, moments={})
    return dataclasses.replace(checked, certificate=Certificate({}, verdict, kept=bound <= limits.GT))


@pytest.mark.slow
def test_a_timing_is_as_much_slower_as_the_proof_of_its_object_asks_for():
    robot, path = on_a_slide([SLIPPERY]), JointPath(np.array([0.0, 1.0]), np.array([[[0.5]], [[0.0]]]))
    limits = Limits(GT=0.875)
    timed = retime(robot, path)
    faster = execute(robot, timed.motion, limits, "cubic")
    proof = partial(stand_in_proof, robot)
    run = dataclasses.replace(faster, check=proof(faster.motion, faster.check, limits))
    ((limit, short, times),) = run.check.not_proved(limits_of(robot, limits)[:4])
    assert (limit.name, short) == ("slip of low", pytest.approx(0.012 * limits.GT, rel=0.05))
    assert times == [run.check.worst["GT[low]"].time]
    slower = slower_to_prove(robot, timed.motion, limits, run, stand_in_proof)
    assert slower.check.certified
    assert 1.012**0.5 - 1e-3 < slower.motion.end / run.motion.end < DEARER
    coarse = dataclasses.replace(run.check.certificate.verdict, bounds={"GT[low]": 0.97})
    unproved = dataclasses.replace(run.check.certificate, verdict=coarse)
    run = dataclasses.replace(run, check=dataclasses.replace(run.check, certificate=unproved))
    assert slower_to_prove(robot, timed.motion, limits, run, stand_in_proof) is run  # costs too much


def test_a_second_try_counts_what_the_first_one_gained():
    """Half of the friction is needed at rest already."""
    robot = on_a_slide([SLIPPERY])
    limit = next(limit for limit in limits_of(robot, Limits()) if limit.name == "slip of low")
    tried = list[float]()

    def again(factor):
        tried.append(factor)
        short = 0.5 + 0.408 / factor**2 - limit.number
        faults = [(limit, short, [0.1])] if short > 0 else []
        known = {"proved_while_moving": not faults, "lacks_cancels": False, "worst": {}}
        return SimpleNamespace(check=SimpleNamespace(**known, not_proved=lambda asked: faults))

    found = proved_slower(again(1.0), again, [limit])
    assert found.check.proved_while_moving
    assert len(tried) == 3
    assert (0.408 / 0.4) ** 0.5 < tried[-1] < 1.012


def test_a_number_that_three_objects_share_is_tightened_once():
    robot, limits = on_a_slide([SLIPPERY, GLASS, dataclasses.replace(GLASS, name="other")]), Limits()
    of_objects = [limit for limit in limits_of(robot, limits) if limit.name.startswith("slip of ")]
    assert len(of_objects) == 3
    changed = tightened(limits, zip(of_objects, (1e-3, 4e-3, 2e-3), strict=True))
    assert (pytest.approx(limits.GT - 4e-3), limits.GN) == (changed.GT, changed.GN)


@pytest.mark.slow
def test_a_plan_whose_glass_needs_all_friction_is_a_little_slower_and_proved():
    """The proof of the fastest motion found lacks 1.2 %: its friction is shared by a rule."""
    task = ocptip.load_task(EXAMPLES / "tasks" / "ur5_waiter.toml", uncertainty="none")
    glass = task.robot.objects[2]
    task = dataclasses.replace(task, robot=task.robot.without_objects().carrying([glass]))
    found = ocptip.plan(task, starts=2, jobs=1)
    assert found.headline.startswith("PROVED for the nominal model")
    assert found.check.certificate.verdict.bounds[f"GT[{glass.name}]"] <= 0.9 * (1 + 1e-5)


@pytest.mark.parametrize("slower", [1.0, 1.5])
def test_a_plan_that_costs_more_than_the_timed_straight_line_is_replaced_by_it(slower):
    robot, goal = on_a_slide([SLIPPERY]), np.array([0.5])
    task = MotionTask("slide", robot, np.zeros(1), goal, objective=TIME)
    a = 0.895 * 0.2 * G
    motion = Trajectory.from_profiles([0.0], [[RampCommand(0.5, 2.0, a)]]).time_scaled(slower)
    how = {"starts": (), "best": 0, "seed": 0, "seconds": 0.0, "interrupted": False, "options": {}}
    plan = MotionPlan(task=task, motion=motion, check=check_motion(robot, motion, task.limits), **how)
    found = no_worse_than_line(plan)
    assert found.check.verified
    if slower == 1.0:
        assert found.motion is motion
    else:
        assert found.duration == pytest.approx(2 * np.sqrt(0.5 / (0.9 * 0.2 * G)), rel=0.02)
        np.testing.assert_allclose([found.motion.start[0], found.motion.goal[0]], [0.0, 0.5], atol=1e-9)


@pytest.mark.parametrize(("one", "most"), [(BOX, TIPS), (SLIPPERY, 0.9 * 0.2 * G)])
def test_the_fastest_timing_of_a_path_is_that_at_which_the_object_reaches_its_limit(one, most):
    path = JointPath(np.array([0.0, 1.0]), np.array([[[0.5]], [[0.0]]]))
    found = retime(on_a_slide([one]), path)
    assert found.check.verified, found.check.violations
    shortest = 2 * np.sqrt(0.5 / most)
    # Half spaces of friction leave up to 1.9 % of it unused.
    assert shortest * (1 - 1e-6) < found.motion.end < shortest * 1.015
    assert set(found.active) <= {f"tip-over of {one.name}", f"slip of {one.name}"}


WIDE = Uncertainty(
    tilt=0.02, payload_mass=0.1, payload_center=(2e-3, 3e-3, 5e-3), friction=0.2, speed=0.03, delay=0.01
)


def deviated(robot: Robot, shares: np.ndarray, shifts: np.ndarray, gravity: np.ndarray) -> Robot:
    """A robot whose objects really have other masses, centres of mass, and gravity."""
    support = robot.support.varied(gravity=gravity)
    others = [
        dataclasses.replace(
            one,
            mass=(1 + share) * one.mass,
            inertia=(1 + share) * np.asarray(one.body.inertia),
            center_of_mass=one.body.center_of_mass + shift,
        )
        for one, share, shift in zip(robot.objects, shares, shifts, strict=True)
    ]
    return robot.varied(arm=robot.arm.with_payload(None), support=support, objects=()).carrying(others)


def moved(robot: Robot, other: Robot, wrenches: tuple[np.ndarray, ...]) -> list[np.ndarray]:
    """Wrenches on the objects of another robot about the centres of mass of this one's."""
    found = []
    for one, two, wrench in zip(robot.interfaces[1:], other.interfaces[1:], wrenches, strict=True):
        lever = two.support.center_of_mass - one.support.center_of_mass
        found.append(np.hstack([wrench[:, :3], wrench[:, 3:] + np.cross(lever, wrench[:, :3])]))
    return found


def test_deviations_of_a_stack_are_those_of_other_objects_on_another_slope():
    rng, robot = np.random.default_rng(5), robot_of(random_arm(5, 3), [PLATE, CUP])
    own = worst_case_of(robot, WIDE, 1).deviations
    q, qd, qdd = rng.normal(size=(3, 1, 3))
    theta = np.zeros((1, own.size))
    shares, shifts = 0.1 * rng.uniform(-1, 1, 2), 3e-3 * rng.uniform(-1, 1, (2, 3))
    tilt, pace, late = 0.2 * rng.normal(size=3), 0.06, 0.01 * rng.uniform(size=3)
    parts = {"payload_mass": shares, "payload_center": shifts.ravel(), "gravity": tilt, "speed": [pace]}
    for name, values in (parts | {"delay": late}).items():
        theta[0, own.places[name]] = values
    found = own.wrench(np.hstack([q, qd, qdd]), theta)[0]
    q, qd = q - late * qd + late**2 / 2 * qdd, qd - late * qdd
    other = deviated(robot, shares, shifts, robot.support.gravity + tilt)
    real = moved(robot, other, other.object_wrenches(q, np.sqrt(1 + pace) * qd, (1 + pace) * qdd))[0]
    np.testing.assert_allclose(found, real, rtol=1e-9, atol=1e-12)
    assert set(own.words(theta[0]).split()) >= {"plate", "cup"}


@pytest.mark.slow
def test_no_sampled_corner_of_the_uncertainty_is_worse_than_the_worst_case_of_a_motion():
    robot = on_a_slide([PLATE, CUP])
    motion = Trajectory.from_profiles([0.0], [(RampCommand(0.4, 1.0, 1.2),)])
    tolerance = dataclasses.replace(WIDE, delay=0.0)
    checked = check_motion(robot, motion, Limits(tolerance=tolerance))
    assert checked.verified, checked.violations
    low, high, rng = np.inf, 0.0, np.random.default_rng(6)
    weak = robot.interfaces[1].weakest(tolerance)
    a = np.array([[1.2], [-1.2]]) * 1.03**2
    for side in np.linspace(0, 2 * np.pi, 8, endpoint=False):
        down = G * np.array([np.sin(0.02) * np.cos(side), np.sin(0.02) * np.sin(side), -np.cos(0.02)])
        for _ in range(5):
            shares, signs = 0.1 * rng.choice([-1, 1], 2), rng.choice([-1, 1], (2, 3))
            other = deviated(robot, shares, signs * WIDE.payload_center, down)
            states = weak.contact_states(moved(robot, other, other.object_wrenches(0 * a, 0 * a, a))[0])
            assert states.persistent.all()
            low = min(low, float(weak.tip_over.evaluate(states).margins.min()))
            high = max(high, float(weak.slip.evaluate(states, derivatives=False).GT.max()))
    within, reference = checked.within.objects["plate"], robot.interfaces[1].tip_over.reference_moment
    worst = moment_at(within["tip"].value, reference)
    assert worst - 1e-9 <= low < 1.05 * worst
    assert within["slip"].value + 1e-6 >= high > 0.95 * within["slip"].value
    rows = {(row.object, row.name): row for row in motion_margins(robot, checked)}
    assert rows["plate", "tipping_margin_Nm"].worst_case.value == pytest.approx(worst, rel=0.02)
    assert rows["plate", "friction_used"].worst_case.value == within["slip"].value


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass": 0.0}, "mass: must be > 0"),
        ({"friction": -0.1}, "friction: must be"),
        ({"name": "a b"}, "name: expected letters"),
        ({"inertia": (0.0, 0.0, 0.0)}, "inertia: must not be zero"),
    ],
)
def test_what_no_object_can_be_is_refused(change, message):
    given = {"name": "x", "mass": 1.0, "friction": 0.3, **change}
    with pytest.raises(InputError, match=message):
        Object.box(size=(0.1, 0.1, 0.1), **given)


def test_objects_that_stand_on_nothing_or_twice_are_refused():
    for objects, message in (([CUP], "on: expected gripper"), ([GLASS, GLASS], "occurs 2 times")):
        with pytest.raises(InputError, match=message):
            on_a_slide(objects)


@pytest.mark.slow
def test_stops_of_a_slide_use_the_friction_of_the_object_that_their_decelerations_need():
    """Along the path all coordinates brake in 0.5 s; a cancel has its deceleration."""
    robot, a, v = on_a_slide([SLIPPERY, dataclasses.replace(BOX, position=(0.5, 0.0, 0.0))]), 0.2, 0.5
    motion = Trajectory.from_profiles([0.0], [[RampCommand(2.0, v, a)]])
    limits = Limits(stops=PathStops(time=0.5))
    checked = check_motion(robot, motion, limits)
    used = (v / 0.5 + a) / (0.2 * G)  # at the begin of braking
    assert checked.worst["GT_stop[low]"].value == pytest.approx(used, rel=2e-3)
    assert checked.verified
    stops = check_stops(robot, motion, limits, StopRules(), checked, "path")
    assert stops.verified
    assert np.all(stops.speeds["path"] == 1)
    assert "of objects low is critical: tipping margin >= " in stops.summary[0]
    for deceleration in (1.0, 2.5):
        cancel = Cancel((deceleration,))
        _, of_low = cancelled_motion(robot, motion, cancel, 1)
        _, of_box = cancelled_motion(robot, motion, cancel, 2)
        assert np.max(of_box.GT) == pytest.approx(deceleration / (0.6 * G), rel=1e-6)
        asked = dataclasses.replace(limits, stops=None, cancel=cancel)
        found = check_motion(robot, motion, asked)
        if deceleration == 1.0:
            assert np.max(of_low.GT) == pytest.approx(1.0 / (0.2 * G), rel=1e-6)
            assert found.verified
            asked = dataclasses.replace(asked, tolerance=Uncertainty(friction=0.1))
            within = check_motion(robot, motion, asked).worst["GT_cancel_worst_case[low]"]
            assert within.value == pytest.approx(1.0 / (0.9 * 0.2 * G), rel=1e-4)
        else:
            assert [broken.name for broken in found.violations] == ["GT_cancel[low]"]
            assert found.kept_while_moving
    safe = safe_decelerations(robot, motion, Limits(), Cancel((20.0,)))
    assert safe.maximum == pytest.approx(0.9 * 0.2 * G / 20.0, abs=0.006)
    assert safe.hardest.broken[0].name == "GT[low]"
    assert " low slips in a cancel begun at " in safe.text


@pytest.mark.slow
def test_stops_of_a_slide_by_brakes_use_the_friction_that_their_force_over_the_moved_mass_needs():
    """The largest force of the brake decides; while it brakes, the deceleration is constant."""
    robot = on_a_slide([SLIPPERY, dataclasses.replace(BOX, position=(0.5, 0.0, 0.0))])
    motion = Trajectory.from_profiles([0.0], [[RampCommand(2.0, 0.5, 0.2)]])
    rest, still = np.zeros((1, 1)), np.ones((1, 1))
    moved = float((robot.loads(rest, rest, still)[0] - robot.loads(rest, rest, rest)[0])[0, 0])
    deceleration = 1.9
    force = moved * deceleration
    limits = Limits(brakes=Brakes((0.8 * force,), (force,)))
    checked = check_motion(robot, motion, limits)
    assert checked.worst["GT_brakes[low]"].value == pytest.approx(deceleration / (0.2 * G), rel=1e-6)
    assert checked.worst["GT_brakes[box]"].value == pytest.approx(deceleration / (0.6 * G), rel=1e-6)
    assert [own.name for own in checked.violations] == ["GT_brakes[low]"]
    stops = check_stops(robot, motion, limits, StopRules(), checked, "brakes")
    assert stops.worst["brakes"]["objects"]["low"]["GT"] == checked.worst["GT_brakes[low]"].value


@pytest.mark.slow
def test_wrenches_on_objects_when_brakes_close_are_those_of_the_accelerations_then():
    rng = np.random.default_rng(10)
    robot = robot_of(random_arm(rng, 3), [PLATE, CUP, CRATE])
    q, qd, weights = *rng.normal(size=(2, 4, 3)), rng.normal(size=(4, 6))
    found, inverse = BrakeCheck.response(robot, q, qd, qd != 0)
    s = np.hstack([q, qd, 0 * q])
    for interface in (1, 2, 3):
        check, closing = (
            BrakeCheck(robot, Brakes((5.0,) * 3, (30.0,) * 3), interface),
            closing_of(robot, interface),
        )
        wrenches, torques = check.combinations(q, qd)
        for case in range(3):
            qdd = np.einsum("sij,sj->si", inverse, torques[:, case] - found.bias)
            there = robot.object_wrenches(q, qd, qdd)[interface - 1]
            np.testing.assert_allclose(wrenches[:, case], there, atol=1e-9)
            np.testing.assert_allclose(closing.wrenches(s, torques[:, case]), there, atol=1e-9)
        on, slopes = torques[:, 0], closing.gradient(s, torques[:, 0], weights)
        h = 1e-6
        for k in range(6):
            up, down = (
                np.sum(weights * closing.wrenches(s + d, on), axis=1)
                for d in (h * np.eye(9)[k], -h * np.eye(9)[k])
            )
            np.testing.assert_allclose(slopes[:, k], (up - down) / (2 * h), rtol=1e-4, atol=1e-4)


@pytest.mark.slow
def test_wrenches_on_objects_in_stops_are_those_of_the_states_that_stops_pass():
    rng = np.random.default_rng(8)
    robot = robot_of(random_arm(rng, 3), [PLATE, CUP, CRATE])
    states = tuple(rng.normal(size=(5, 3)) for _ in range(3))
    for interface in (1, 2, 3):
        points = StopPoints.of(Path.of(robot, states, 1.0, 0.3, interface=interface))
        q, qd, qdd = (part[points.owner] for part in states)
        x, u = points.x[:, None], points.u[:, None]
        then = robot.object_wrenches(q, qd * np.sqrt(x), qd * u + qdd * x)[interface - 1]
        np.testing.assert_allclose(points.wrenches, then, atol=1e-9)
        some = points.select(np.flatnonzero(points.first >= 0))
        s, on = np.hstack(states)[some.owner], rng.normal(size=(len(some.owner), 6))
        slopes, h = stop_slopes(robot, 0.3, interface).gradient(s, 1.0, some, on), 1e-6
        for k in range(9):
            ends = []
            for side in (-h, h):
                moved = np.hstack(states) + side * np.eye(9)[k]
                there = StopPoints.of(
                    Path.of(robot, np.split(moved, 3, axis=1), 1.0, 0.3, interface=interface)
                )
                ends.append(there.select(np.flatnonzero(points.first >= 0)).wrenches)
            np.testing.assert_allclose(
                slopes[:, k], np.sum(on * (ends[1] - ends[0]), axis=1) / (2 * h), rtol=1e-4, atol=1e-4
            )


def test_slopes_of_wrenches_on_objects_in_cancels_are_finite_differences():
    rng = np.random.default_rng(9)
    robot = robot_of(random_arm(rng, 3), [PLATE, CUP])
    s, sign = rng.normal(size=(4, 9)), np.empty((4, 3))
    sign[:] = np.sign(s[:, 3:6])
    chosen = sign, np.ones((4, 3)), np.tile([0.5, 0.0, 0.0], (4, 1))
    slopes, on, h = cancel_slopes(robot, (9.0, 8.0, 7.0), interface=2), rng.normal(size=(4, 6)), 1e-6
    exact = slopes.gradient(s, *chosen, on)
    for k in range(9):
        up, down = (slopes.wrenches(s + side * np.eye(9)[k], *chosen) for side in (h, -h))
        np.testing.assert_allclose(exact[:, k], np.sum(on * (up - down), axis=1) / (2 * h), atol=1e-5)


@pytest.mark.slow
def test_a_plan_that_may_be_stopped_keeps_the_object_in_stops_along_its_path():
    robot = on_a_slide([SLIPPERY])
    limits = Limits(stops=PathStops(time=0.5))
    task = MotionTask("slide", robot, np.zeros(1), np.array([0.5]), limits, objective=TIME, rise_times=0.0)
    free = ocptip.plan(dataclasses.replace(task, limits=Limits()), starts=1, jobs=1, method="direct")
    found = ocptip.plan(task, starts=1, jobs=1, method="direct")
    assert found.verified
    assert found.check.worst["GT_stop[low]"].value <= 0.9
    assert found.duration > 1.05 * free.duration
