"""Margins of single states against the margins, contact states and geometry that they are made of."""

import json

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.clamps import RigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.published.cases import motion_case
from ocptip.published.tasks import experiment_robot
from ocptip.reserves.equal_compliance import equal_sharing
from ocptip.standing.arm import Robot
from ocptip.task_files.motion import load_task
from tests.places import EXAMPLES


@pytest.fixture(scope="module")
def cart():
    return load_task(EXAMPLES / "tasks" / "ur5_cart.toml").robot


@pytest.fixture(scope="module")
def states():
    rng = np.random.default_rng(0)
    return rng.uniform(-1.5, 1.5, (40, 6)), rng.normal(size=(40, 6)), 8 * rng.normal(size=(40, 6))


def test_they_are_the_margins_of_the_samples_of_a_motion(cart, states):
    margins = cart.margins(*states)
    samples = cart.samples_of(np.arange(40.0), *states)
    np.testing.assert_array_equal(margins.stable, samples.states.persistent)
    np.testing.assert_allclose(margins.GN, samples.tip.GN, rtol=1e-9)
    np.testing.assert_allclose(margins.GT, samples.slip.GT, atol=1e-6)
    assert 0 < np.count_nonzero(margins.stable) < 40
    np.testing.assert_array_equal(margins.stable, ~(margins.tips | margins.slips))
    stable = margins.stable
    equal = equal_sharing(samples.states)
    np.testing.assert_allclose(margins.normal_forces[stable], equal.normal_forces[stable], atol=1e-6)
    np.testing.assert_allclose(margins.friction_used[stable], equal.usage[stable], atol=1e-6)
    assert "equally compliant" in margins.note


def test_the_tipping_margin_is_the_moment_that_tips(cart, states):
    margins = cart.margins(*states)
    wrenches, stable = cart.loads(*states)[1], np.flatnonzero(margins.stable)
    assert np.all(margins.tipping_moment[margins.tips] < 0)
    places = np.array([contact.position for contact in cart.support.contacts])
    for k in stable[:5]:
        first, second = margins.tipping_contacts[k] - 1
        along = (places[second] - places[first]) / np.linalg.norm(places[second] - places[first])
        outward = along if np.sum(np.cross(along, places.mean(axis=0) - places[first])[2]) > 0 else -along
        for factor, stands in ((0.99, True), (1.01, False)):
            moment = factor * margins.tipping_moment[k] * outward
            wrench = wrenches[k] + np.r_[np.zeros(3), moment]
            tip = cart.tip_over.evaluate(cart.contact_states(wrench[None]))
            assert (tip.GN[0] < 1) == stands


def test_one_state_has_the_numbers_of_the_row(cart, states):
    many = cart.margins(*states)
    one = cart.margins(states[0][3], states[1][3], states[2][3])
    for name, value in one.to_dict().items():
        row = many[3].to_dict()[name]
        assert value == (row if isinstance(row, str) else pytest.approx(row, abs=1e-6, nan_ok=True)), name
    at_rest = cart.margins(states[0][3])
    assert pytest.approx(0.0, abs=1e-9) == at_rest.GT
    assert at_rest.min_foot_force == np.min(at_rest.normal_forces)
    json.dumps(at_rest.to_dict())


def test_their_repr_says_verdict_margins_units_and_the_worst_state(cart, states):
    text = repr(cart.margins(np.zeros(6)))
    for part in (
        "<Margins stable: tipping margin",
        "N m about contacts 3 and 4",
        "friction used 0 %",
        " N (",
    ):
        assert part in text
    many = cart.margins(*states)
    worst = int(np.argmax(np.maximum(many.GN, many.GT)))
    assert f"<Margins of 40 states, {np.count_nonzero(many.stable)} stable; worst is [{worst}]: " in repr(
        many
    )
    assert repr(many[:0]) == "<Margins of no states>"


def test_three_feet_share_their_load_in_one_way():
    robot = experiment_robot(motion_case("A"))
    margins = robot.margins(motion_case("A").start)
    assert margins.note == ""
    assert margins.normal_forces.sum() == pytest.approx(robot.mass * 9.81)


def test_what_cannot_tip_has_an_infinite_margin_and_one_line_none(cart):
    places = [0.2, 0.2, 0], [0.2, -0.2, 0], [-0.2, 0.2, 0], [-0.2, -0.2, 0]
    clamps = [RigidClamp(position=p, friction_upper=0.5, friction_lower=0.5) for p in places]
    clamped = Robot(cart.arm, Support(clamps, mass=35.0), cart.motors, reference_moment=1.0)
    fixed = clamped.margins(np.zeros(6))
    assert fixed.stable
    assert fixed.tipping_moment == np.inf
    assert fixed.tipping_contacts.tolist() == [0, 0]
    assert "one of them" in fixed.note
    line = [UnilateralContact(position=[x, 0, 0], friction=0.5) for x in (-0.2, 0.2)]
    assert Robot(cart.arm, Support(line, mass=35.0), cart.motors).margins(np.zeros(6)).tipping_moment == 0.0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((np.zeros(5),), "q: expected shape 6"),
        ((np.zeros((2, 6)), np.zeros((3, 6))), "q, qd, qdd: expected as many states of each, got 2, 3 and 2"),
        ((np.zeros(6), np.full(6, np.nan)), "qd: contains NaN"),
    ],
)
def test_shapes_that_do_not_fit_are_named(cart, given, message):
    with pytest.raises(InputError, match=message):
        cart.margins(*given)
