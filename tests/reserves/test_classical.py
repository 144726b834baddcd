"""Classical measures against closed forms of statics, and against the published construction step by step."""

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.reserves.classical import ClassicalMeasures
from ocptip.reserves.tipping import TipOver

FEET = np.array([[0.3, 0.2, 0], [0.3, -0.2, 0], [-0.3, -0.2, 0], [-0.3, 0.2, 0]])


def cart(feet=FEET, center=(0.05, -0.04, 0.5)):
    contacts = [UnilateralContact(position=p, friction=0.6) for p in feet]
    return Support(contacts, mass=40.0, center_of_mass=center, inertia=[2.0, 3.0, 4.0])


def measured(support, wrenches, forces=None):
    forces = np.ones((len(wrenches), len(FEET))) if forces is None else forces
    return ClassicalMeasures.under(np.asarray(wrenches, dtype=float), TipOver(support), forces)


def test_of_weight_they_are_those_of_statics():
    support = cart()
    one = measured(support, [support.weight])[0]
    weight = np.linalg.norm(support.weight[:3])
    distance = 0.2 - 0.04  # to the edge at y = -0.2
    angle = np.arctan(distance / 0.5)
    assert one.zero_moment_point == pytest.approx(distance)
    assert one.static_angle == pytest.approx(angle)
    edges = np.array([0.25, 0.16, 0.35, 0.24])  # at x = 0.3, y = -0.2, x = -0.3, y = 0.2
    np.testing.assert_allclose(sorted(one.static_angles), sorted(np.arctan(edges / 0.5)))
    assert one.force_angle == pytest.approx(angle * weight * distance)
    assert one.moment_height == pytest.approx(weight * distance * (2.0 + 40 * (distance**2 + 0.25)))


def by_the_paper(points, center, force, torque):
    """Minimum of theta |d| |f| over the edges, points counterclockwise seen from above [PR00]."""
    values = []
    for p, q in zip(points, np.roll(points, -1, axis=0), strict=True):
        axis = (q - p) / np.linalg.norm(q - p)
        across = np.eye(3) - np.outer(axis, axis)
        normal = across @ (q - center)
        unit = normal / np.linalg.norm(normal)
        couple = np.cross(unit, np.outer(axis, axis) @ torque) / np.linalg.norm(normal)
        acting = across @ force + couple
        direction = acting / np.linalg.norm(acting)
        sign = np.sign(np.cross(unit, direction) @ axis)
        arm = -normal + (normal @ direction) * direction
        angle = sign * np.arccos(np.clip(direction @ unit, -1, 1))
        values.append(angle * np.linalg.norm(arm) * np.linalg.norm(acting))
    return min(values)


def test_force_angle_is_that_of_the_paper():
    rng = np.random.default_rng(0)
    support = cart()
    counterclockwise = FEET[[2, 1, 0, 3]]
    wrenches = support.weight + rng.normal(scale=[60, 60, 80, 40, 40, 40], size=(200, 6))
    found = measured(support, wrenches)
    expected = [by_the_paper(counterclockwise, support.center_of_mass, w[:3], w[3:]) for w in wrenches]
    np.testing.assert_allclose(found.force_angle, expected, rtol=1e-9)
    assert 20 < np.count_nonzero(found.force_angle < 0) < 180
    for values in (found.zero_moment_point, found.static_angle, found.moment_height):
        np.testing.assert_array_equal(np.sign(values), np.sign(found.force_angle))


def test_load_transfer_is_one_where_a_side_carries_nothing():
    support = cart()
    forces = np.array([[100.0, 0, 0, 100], [50, 50, 50, 50], [0, 30, 0, 10], [0, 0, 0, 0]])
    found = measured(support, np.tile(support.weight, (4, 1)), forces)
    np.testing.assert_allclose(found.load_transfer[:3], [[0, 1], [0, 0], [0.5, -0.5]])
    assert np.isnan(found.load_transfer[3]).all()


def test_contacts_off_one_plane_are_refused():
    raised = FEET + np.array([[0, 0, 0.05], [0, 0, 0], [0, 0, 0], [0, 0, 0]])
    with pytest.raises(InputError, match="ordinary contacts on one plane"):
        measured(cart(raised), [cart().weight])
