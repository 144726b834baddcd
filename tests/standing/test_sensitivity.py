"""Sensitivities: against rebuilt robots and scenes, and slopes against differences of the exact solver."""

from dataclasses import replace

import numpy as np
import pytest

from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Load, Support
from ocptip.published.tasks import experiment_task
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver
from ocptip.robots.payload import Payload
from ocptip.standing import sensitivity
from ocptip.standing.arm import StandingRobot
from ocptip.standing.sensitivity import motion_sensitivities, scene_sensitivities

FEET = [[0.4, 0.3, 0.0], [-0.4, 0.35, 0.0], [0.0, -0.5, 0.0]]
LOADS = (Load(force=[20.0, 5.0, -30.0], point=[0.1, 0.05, 0.9]),)


def support_of(mass=20.0, center=(0.02, 0.01, 0.4), feet=FEET, friction=0.6):
    contacts = [UnilateralContact(position=place, friction=friction) for place in feet]
    return Support(contacts, mass=mass, center_of_mass=center)


def reserves(support, wrenches, reference=None):
    states = solve_many(support, wrenches)
    tip = TipOver(support, reference).evaluate(states)
    GT = Slip(support).evaluate(states, derivatives=False).GT
    return np.array([tip.GN.max(), GT.max(), tip.normal_reserves.min()])


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
        gripping = StandingRobot(bare.with_payload(Payload(0.1)), own, robot.motors)
        after["gripper_mass"] = worst_of(gripping, states)
    else:
        more = Payload(1.1 * held.mass, held.center_of_mass, 1.1 * held.inertia)
        after["payload_mass"] = worst_of(robot.varied(arm=bare.with_payload(more)), states)
    for name, expected in after.items():
        np.testing.assert_allclose(values(found[name].after), expected, rtol=1e-6, err_msg=name)
        np.testing.assert_allclose(values(found[name].before), worst_of(robot, states), rtol=1e-9)


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
        np.testing.assert_allclose(slope, expected, rtol=2e-3, atol=2e-3 * np.abs(expected).max() + 1e-6)


def test_what_is_said(case):
    robot, states = case
    found = motion_sensitivities(robot, *states)
    assert str(found[0]).startswith("1 kg more base mass: GN ")
    assert "least foot force" in str(found[0])
    data = found[0].to_dict()
    assert data["quantity"] == "base_mass"
    assert data["exact"] is True
    assert set(data["slopes_per_unit"]) == {"GN", "GT", "least_normal_force_N"}
