"""Sensitivities: against rebuilt robots and scenes, and slopes against differences of the exact solver."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ocptip.api.inputs.postures import resting_posture
from ocptip.api.results.plan import sensitivities_of
from ocptip.api.stand import stand
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.resting import solve_resting
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Load, Support
from ocptip.published.tasks import experiment_task
from ocptip.reserves.equal_compliance import equal_normal_map
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver, moment_at
from ocptip.robots.payload import Payload
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest import sensitivity
from ocptip.standing.at_rest.sensitivity import Reserves, motion_sensitivities, scene_sensitivities
from ocptip.standing.tolerance import WORKSHOP
from ocptip.standing.within.in_motion import worst_within
from ocptip.task_files.scene import Scene
from tests.quick import examples

FEET = [[0.4, 0.3, 0.0], [-0.4, 0.35, 0.0], [0.0, -0.5, 0.0]]
LOADS = (Load(force=[20.0, 5.0, -30.0], point=[0.1, 0.05, 0.9]),)


def support_of(mass=20.0, center=(0.02, 0.01, 0.4), feet=FEET, friction=0.6):
    contacts = [UnilateralContact(position=place, friction=friction) for place in feet]
    return Support(contacts, mass=mass, center_of_mass=center)


def reserves(support, wrenches, reference=None):
    states = solve_many(support, wrenches)
    tip = TipOver(support, reference).evaluate(states)
    GT = Slip(support).evaluate(states, derivatives=False).GT
    return np.array([tip.GN.max(), GT.max(), foot_force(support, wrenches, tip)])


def foot_force(support, wrenches, tip):
    """Of equally compliant feet, where the sharing is open."""
    shares = equal_normal_map(support)
    return (tip.normal_reserves if shares is None else wrenches @ shares.T).min()


def values(one):
    return np.array([one.GN, one.GT, one.force])


@pytest.mark.parametrize("reference", [None, 15.0])
def test_scenes_are_solved_anew(reference):
    found = {one.quantity: one for one in scene_sensitivities(support_of(), LOADS, reference)}
    wider = np.array(FEET) + 0.01 * (np.array(FEET) - np.mean(FEET, axis=0)) / np.linalg.norm(
        np.array(FEET) - np.mean(FEET, axis=0), axis=1, keepdims=True
    )
    one_out = np.where(np.arange(3)[:, None] == 1, wider, FEET)
    others = {
        "base_mass": support_of(mass=21.0),
        "feet_outwards": support_of(feet=wider),
        "contact_2_outwards": support_of(feet=one_out),
        "friction": support_of(friction=0.66),
        "center_of_mass_down": support_of(center=(0.02, 0.01, 0.39)),
    }
    before = reserves(support_of(), support_of().wrench(LOADS)[None], reference)
    for name, other in others.items():
        np.testing.assert_allclose(values(found[name].before), before, rtol=1e-9)
        after = reserves(other, other.wrench(LOADS)[None], reference)
        np.testing.assert_allclose(values(found[name].after), after, rtol=1e-7, err_msg=name)
    sideways = found["center_of_mass_sideways"]
    assert sideways.after.GN < sideways.before.GN


@pytest.fixture(scope="module", params=["B", "G"])
def case(request):
    task = experiment_task(request.param, "effective")
    if request.param == "G":
        arm = task.robot.arm.with_payload(Payload.box(0.1, [0.1, 0.1, 0.1], [0.0, 0.0, 0.05]))
        task = replace(task, robot=task.robot.varied(arm=arm))
    return task.robot, task.reference.states(task.reference.both_sides(0.02))


def worst_of(robot, states):
    return reserves(robot.support, robot.loads(*states)[1], robot.tip_over.reference_moment)


@pytest.mark.slow
def test_motions_are_solved_anew(case):
    robot, states = case
    found = {one.quantity: one for one in motion_sensitivities(robot, *states)}
    own = robot.support
    heavier = robot.varied(support=own.varied(mass=own.mass + 1))
    q, qd, qdd = states
    bare, held = robot.arm.with_payload(None), robot.arm.payload
    after = {
        "base_mass": worst_of(heavier, states),
        "speed": worst_of(robot, (q, 1.01 * qd, 1.01**2 * qdd)),
    }
    if held is None:
        gripping = Robot(bare.with_payload(Payload(0.1)), own, robot.motors)
        after["gripper_mass"] = worst_of(gripping, states)
    else:
        more = Payload(1.1 * held.mass, held.center_of_mass, 1.1 * held.inertia)
        after["payload_mass"] = worst_of(robot.varied(arm=bare.with_payload(more)), states)
    for name, expected in after.items():
        np.testing.assert_allclose(values(found[name].after), expected, rtol=1e-6, err_msg=name)
        np.testing.assert_allclose(values(found[name].before), worst_of(robot, states), rtol=1e-9)


@pytest.mark.slow
def test_exact_slopes_are_those_of_differences(case, monkeypatch):
    """A step so small that the worst instants stay: (after - before) / step."""
    robot, states = case
    slopes = {one.quantity: values(one.slopes) for one in motion_sensitivities(robot, *states)}
    for name in ("KILOGRAM", "MILLIMETRES", "FRICTION", "SPEED", "GRIPPER"):
        monkeypatch.setattr(sensitivity, name, 1e-6)
    for one in motion_sensitivities(robot, *states):
        step = one.step
        if one.quantity == "payload_mass":  # a step of its own
            continue
        slope = (values(one.after) - values(one.before)) / step
        expected = slopes[one.quantity]
        if one.before.GN > 1 and one.quantity in (
            "base_mass",
            "center_of_mass_sideways",
            "center_of_mass_down",
        ):
            slope, expected = slope[1:], expected[1:]  # slopes leave out that the base itself accelerates
        np.testing.assert_allclose(slope, expected, rtol=2e-3, atol=2e-3 * np.abs(expected).max() + 1e-6)


@pytest.mark.slow
def test_the_worst_case_of_a_motion_is_that_of_a_robot_built_anew():
    """Its values begin at those of the check, and change to those of the check of the changed robot."""
    task = experiment_task("B", "effective")
    counts, motion = WORKSHOP.only("base_mass", "tilt", "friction"), task.reference.time_scaled(1.5)
    task = replace(task, limits=replace(task.limits, tolerance=counts))
    found = {one.quantity: one for one in sensitivities_of(task, motion)}
    times, support = motion.both_sides(0.01), task.robot.support
    heavier = task.robot.varied(support=support.varied(mass=support.mass + 1.0))
    for robot, values in ((task.robot, found["base_mass"].before), (heavier, found["base_mass"].after)):
        within = worst_within(robot, motion, counts, times)
        margin = moment_at(within.tip.value, robot.tip_over.reference_moment)
        assert (values.moment, values.GT) == pytest.approx((margin, within.slip.value), rel=1e-6)
        assert values.force == pytest.approx(within.foot_force.value, rel=1e-6)
    assert found["base_mass"].worst_case
    assert found["friction"].after.GT < found["friction"].before.GT
    assert found["center_of_mass_sideways"].after.moment > found["base_mass"].before.moment


@pytest.mark.slow
def test_at_rest_the_worst_case_is_that_of_the_posture():
    task = experiment_task("A", "effective")
    found = {one.quantity: one for one in resting_posture(task, "start").sensitivities(WORKSHOP)}
    support = task.robot.support
    rough = [replace(c, friction=1.1 * c.friction) for c in support.contacts]
    others = {"base_mass": support.varied(mass=support.mass + 1.0), "friction": support.varied(rough)}
    for name, other in others.items():
        changed = resting_posture(task.robot.varied(support=other), task.start)
        within = changed.within(WORKSHOP)
        margin = within.tipping_margin(changed.robot.tip_over.reference_moment)
        assert found[name].after.moment == pytest.approx(margin, rel=1e-9)
        assert pytest.approx(within.GT, rel=1e-9) == found[name].after.GT
    assert found["base_mass"].before.cells()[2] == "-"


@pytest.mark.slow
def test_a_base_that_tips_says_what_is_missing():
    """A load that tips: the margin is negative, less so with more mass, and more so in the worst case."""
    load = (Load(force=[60.0, 0.0, -30.0], point=[0.1, 0.05, 0.9]),)
    nominal = scene_sensitivities(support_of(), load)[0]
    scene = Scene("pushed", support_of(), load, support_of().wrench(load), WORKSHOP)
    worst = stand(scene, sensitivities=True).sensitivities[0]
    assert worst.before.moment < nominal.before.moment < 0
    assert nominal.after.moment > nominal.before.moment
    assert float(worst.before.cells()[0]) < 0
    assert Reserves.of(1.5, 2.0, np.nan, 10.0, np.inf).cells() == ["-5", "none holds", "-"]


def test_what_is_said(case):
    robot, states = case
    found = motion_sensitivities(robot, *states)
    assert str(found[0]).startswith("1 kg more base mass: tipping [N m] ")
    assert "foot [N]" in str(found[0])
    before, reference = found[0].before, robot.tip_over.reference_moment
    assert reference / (reference + max(before.moment, 0.0)) == pytest.approx(min(before.GN, 1.0))
    data = found[0].to_dict()
    assert data["quantity"] == "base_mass"
    assert data["exact"] is True
    assert set(data["slopes_per_unit"]) == {"GN", "GT", "least_normal_force_N"}


def compared(one, value, step):
    """Slopes against central differences of value(h), (3,), where both one-sided ones agree; how many do."""
    ahead, here, behind = (value(h) for h in (step, 0.0, -step))
    slopes = (ahead - behind) / (2 * step)
    kink = np.abs(ahead - 2 * here + behind) / step
    smooth = np.isfinite(slopes) & (kink <= 1e-3 * (1 + np.abs(slopes)))
    expected, own = slopes[smooth], values(one.slopes)[smooth]
    np.testing.assert_allclose(own, expected, rtol=2e-3, atol=2e-3, err_msg=one.quantity)
    return int(smooth.sum())


def outwards(feet, which):
    away = feet - feet.mean(axis=0)
    return which[:, None] * away / np.linalg.norm(away, axis=1, keepdims=True)


@pytest.mark.slow
@examples(6)
@given(seed=st.integers(0, 10**6), own_reference=st.booleans())
def test_slopes_of_scenes_are_those_of_scenes_built_anew(seed, own_reference):
    rng = np.random.default_rng(seed)
    n, reference = int(rng.integers(3, 6)), 12.0 if own_reference else None
    angles = 2 * np.pi * (np.arange(n) + rng.uniform(-0.3, 0.3, n)) / n
    feet = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(n)]) * rng.uniform(0.3, 0.6, (n, 1))
    mass, center = rng.uniform(10, 40), np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.1, 0.5)])
    friction = rng.uniform(0.4, 0.9, n)
    force, point = np.array([*rng.uniform(-15, 15, 2), rng.uniform(-30, 10)]), rng.uniform(-0.2, 0.9, 3)
    loads = (Load(force=force, point=point),)

    def value(mass=mass, center=center, feet=feet, friction=friction):
        contacts = [UnilateralContact(position=p, friction=f) for p, f in zip(feet, friction, strict=True)]
        support = Support(contacts, mass=mass, center_of_mass=center)
        states = solve_resting(support, support.wrench(loads)[None])
        tip = TipOver(support, reference).evaluate(states)
        GT = Slip(support).evaluate(states, derivatives=False).GT
        return np.array([tip.GN[0], GT[0], foot_force(support, support.wrench(loads)[None], tip)])

    assume(np.all(value()[:2] < 0.95))
    contacts = [UnilateralContact(position=p, friction=f) for p, f in zip(feet, friction, strict=True)]
    support = Support(contacts, mass=mass, center_of_mass=center)
    found = {one.quantity: one for one in scene_sensitivities(support, loads, reference)}
    down, every = np.array([0.0, 0.0, -1.0]), np.ones(n)
    count = compared(found["base_mass"], lambda h: value(mass=mass + h), 1e-4)
    count += compared(found["friction"], lambda h: value(friction=friction * (1 + h)), 1e-5)
    count += compared(found["center_of_mass_down"], lambda h: value(center=center + h * down), 1e-5)
    count += compared(found["feet_outwards"], lambda h: value(feet=feet + h * outwards(feet, every)), 1e-5)
    for k, one in enumerate(np.eye(n)):
        own = found[f"contact_{k + 1}_outwards"]
        count += compared(own, lambda h, one=one: value(feet=feet + h * outwards(feet, one)), 1e-5)
    assert count >= 2 * (4 + n)  # GN and GT are smooth nearly everywhere
    steepest = [
        (value(center=center + 1e-5 * axis) - value(center=center - 1e-5 * axis))[0] / 2e-5
        for axis in np.eye(3)[:2]
    ]
    sideways = found["center_of_mass_sideways"].slopes.GN
    assert sideways == pytest.approx(-np.linalg.norm(steepest), rel=1e-3)


@pytest.mark.slow
@examples(3)
@given(seed=st.integers(0, 10**6), case=st.sampled_from(["A", "B", "D", "G", "H"]))
def test_slopes_of_motions_are_those_of_robots_built_anew(seed, case):
    """At one instant of a slower reference, holding a payload."""
    rng = np.random.default_rng(seed)
    task = experiment_task(case, "effective")
    held = Payload.box(rng.uniform(0.05, 0.15), [0.1, 0.08, 0.05], rng.uniform(-0.05, 0.05, 3))
    bare, own = task.robot.arm.with_payload(None), task.robot.support
    robot = task.robot.varied(arm=bare.with_payload(held))
    motion = task.reference.time_scaled(1.3)
    q, qd, qdd = motion.states(rng.uniform(0, motion.end, 1))

    def value(speed=0.0, mass=0.0, payload=0.0, gripper=0.0):
        more = (1 + payload) * held.mass, held.center_of_mass, (1 + payload) * held.inertia
        arm = bare.with_payload(Payload(*more) if gripper == 0 else with_point_mass(held, gripper))
        other = robot.varied(arm=arm, support=own.varied(mass=own.mass + mass))
        return worst_of(other, (q, (1 + speed) * qd, (1 + speed) ** 2 * qdd))

    assume(np.all(value()[:2] < 0.95))
    found = {one.quantity: one for one in motion_sensitivities(robot, q, qd, qdd)}
    counts = [
        compared(found["speed"], lambda h: value(speed=h), 1e-5),
        compared(found["base_mass"], lambda h: value(mass=h), 1e-4),
        compared(found["payload_mass"], lambda h: value(payload=h), 1e-4),
        compared(found["gripper_mass"], lambda h: value(gripper=h), 1e-5),
    ]
    assert sum(counts) >= 8


def with_point_mass(held, mass):
    """A payload and a point mass (of either sign) at the TCP; inertias about its axes add."""

    def spread(m, c):
        return m * (np.dot(c, c) * np.eye(3) - np.outer(c, c))

    total = held.mass + mass
    center = held.mass * np.array(held.center_of_mass) / total
    about_gripper = held.inertia + spread(held.mass, np.array(held.center_of_mass))
    return Payload(total, center, about_gripper - spread(total, center))
