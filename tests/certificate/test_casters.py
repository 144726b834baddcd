"""Contacts without friction in proofs: they bear no tangential force, exactly, and nothing else is asked."""

from dataclasses import replace

import numpy as np
import pytest

from ocptip.certificate.checks import certified
from ocptip.certificate.trusted.contacts import Contacts
from ocptip.certificate.trusted.forms import Form
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.resting import solve_resting
from ocptip.contact.support import Support
from ocptip.motion.check import check_motion
from ocptip.reserves.slip import Slip
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import WORKSHOP
from tests.certificate.test_by_hand import _model
from tests.certificate.test_find import _swing
from tests.quick import some

_WHEELS = [(0.0, 0.19), (0.0, -0.19)]
_CASTERS = [(0.17, 0.15), (0.17, -0.15), (-0.17, -0.15), (-0.17, 0.15)]


def _amid_casters(friction):
    places = np.array(_WHEELS + _CASTERS)
    return [
        UnilateralContact(position=[*place, 0.0], friction=0.8 if k < 2 else friction)
        for k, place in enumerate(places)
    ]


def _held(support, wrench, forces, share):
    """By how much the trusted rule shows that contact forces hold a constant wrench."""
    model = _model()
    model["base"].update(mass=support.mass, center_of_mass=support.center_of_mass.tolist())
    model["contacts"] = {
        "positions": [list(contact.position) for contact in support.contacts],
        "frames": [frame.T.tolist() for frame in support.frames.swapaxes(1, 2)],
        "sets": [[[0.0, None, 0.0, contact.friction]] for contact in support.contacts],
    }
    contacts = Contacts(model, 0.9)
    np.testing.assert_allclose(contacts.grasp, support.wrench_matrix, atol=1e-12)
    ends = np.broadcast_to(forces[None, :, :, None], (2, *forces.shape, 1))
    return float(contacts.held(Form.of(wrench[:, None]), ends, share)[0])


def test_the_best_sharing_is_shown_and_no_better_one():
    support = Support(_amid_casters(0.0), mass=100.0, center_of_mass=[0.05, 0.0, 0.4])
    rng = np.random.default_rng(2)
    for wrench in support.wrench([]) + rng.normal(size=(20, 6)) * [5, 5, 0, 10, 10, 1]:
        slip = Slip(support).evaluate(solve_resting(support, wrench[None]))
        forces = np.maximum(slip.forces[0], [1e-3, -np.inf, -np.inf])  # the rule's correction balances them
        assert _held(support, wrench, forces, 1.02 * slip.GT[0] + 1e-4) >= 0
        assert _held(support, wrench, forces, 0.98 * slip.GT[0]) < 0


def test_a_caster_that_is_named_with_a_tangential_force_bears_none():
    contacts = [replace(contact, friction=0.0) for contact in _amid_casters(0.0)]
    support = Support(contacts, mass=100.0, center_of_mass=[0.0, 0.0, 0.4])
    wrench = support.wrench([]) + np.array([50.0, 0, 0, 0, 0, 0])
    forces = -(np.linalg.pinv(support.wrench_matrix) @ wrench).reshape(6, 3)
    assert _held(support, wrench, forces, 1.0) < 0
    rough = Support(_amid_casters(0.8), mass=100.0, center_of_mass=[0.0, 0.0, 0.4])
    rough = rough.varied([replace(contact, friction=0.8) for contact in contacts])
    assert _held(rough, wrench, forces, 1.0) > 0


def _bounds(friction, more, limits):
    """What is proved of a swing on two feet with friction and a caster, or on three feet and two casters."""
    task, motion = _swing("B")
    support = task.robot.support
    height = support.contacts[0].position[2]
    contacts = [*support.contacts[:2], replace(support.contacts[2], friction=friction)]
    if more:
        casters = [UnilateralContact(position=[*p, height], friction=friction) for p in _CASTERS[:2]]
        contacts = [*support.contacts, *casters]
    robot = task.robot.varied(support=support.varied(contacts))
    checked = certified(robot, motion, check_motion(robot, motion, limits), limits)
    assert checked.certified, checked.violations or f"{checked.certificate}"
    return checked.certificate.verdict.bounds


@pytest.mark.slow
@pytest.mark.parametrize("more", some(1, [True, False]))
def test_motions_on_casters_are_proved_as_with_a_little_friction(more):
    """Before, rounding errors at the casters decided."""
    none, little = (_bounds(friction, more, Limits()) for friction in (0.0, 1e-3))
    assert none["GT"] == pytest.approx(little["GT"], rel=0.02)


@pytest.mark.slow
def test_motions_on_casters_are_proved_within_a_tolerance():
    none, little = (_bounds(friction, False, Limits(tolerance=WORKSHOP)) for friction in (0.0, 1e-3))
    assert none["GT_worst_case"] == pytest.approx(little["GT_worst_case"], rel=0.02)
