"""The contact laws as a check: right states pass, every single breach is seen in its size."""

import numpy as np
import pytest

from ocptip.contact.bindings import laws
from ocptip.contact.bindings.clamps import ForceConstantHalfRigidClamp, RigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from tests.contact.contact_cases import KINDS, TWO_SIDED, binding, corners_of_polygon, kind_name

MASS, UNIT = 2.0, 10.0


def violation(contact, force, acceleration):
    force, acceleration = np.array([force], dtype=float), np.array([acceleration], dtype=float)
    return float(laws.law_violation(contact, force, acceleration, UNIT, MASS)[0])


FOOT = binding(UnilateralContact, planar=True)  # friction 0.6


@pytest.mark.parametrize(
    ("force", "acceleration"),
    [
        ([0.0, 0.0], [0.0, 0.0]),
        ([10.0, 5.9], [0.0, 0.0]),
        ([10.0, -6.0], [0.0, 3.0]),
        ([10.0, 6.0], [0.0, -3.0]),
        ([0.0, 0.0], [4.0, -2.0]),
    ],
)
def test_standing_sliding_and_lifting_states_obey_the_laws(force, acceleration):
    assert violation(FOOT, force, acceleration) < 1e-15


@pytest.mark.parametrize(
    ("what", "force", "acceleration", "size"),
    [
        ("adhesion", [-1.0, 0.0], [0.0, 0.0], 0.1),
        ("force outside the cone", [10.0, 7.0], [0.0, 0.0], 0.1),
        ("penetration", [10.0, 0.0], [-1.0, 0.0], 0.2),
        ("lifting under load", [10.0, 0.0], [5.0, 0.0], 1.0),
        ("sliding without friction", [10.0, 0.0], [0.0, 5.0], 0.6),
        ("sliding along the friction", [10.0, 6.0], [0.0, 5.0], 1.2),
        ("friction without normal force", [0.0, 1.0], [1.0, 0.0], 0.1),
    ],
)
def test_every_breach_has_its_size(what, force, acceleration, size):
    assert violation(FOOT, force, acceleration) == pytest.approx(size), what


def test_lower_end_is_where_a_half_rigid_clamp_opens():
    clamp = binding(ForceConstantHalfRigidClamp, planar=True)  # F = 120 N, both jaws 0.7 and 0.4
    assert violation(clamp, [-120.0, 0.4 * 120], [1.0, -1.0]) < 1e-14
    assert violation(clamp, [-119.0, 0.0], [1.0, 0.0]) == pytest.approx(0.1)
    assert violation(clamp, [-121.0, 0.0], [1.0, 0.0]) == pytest.approx(0.1)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rigid_clamp_never_moves_along_its_normal(sign):
    clamp = binding(RigidClamp, planar=True)
    assert violation(clamp, [30.0, 0.0], [sign * 1.0, 0.0]) == pytest.approx(0.2)


@pytest.mark.parametrize("kind", KINDS, ids=kind_name)
@pytest.mark.parametrize("facets", [3, 4, 7, 12])
def test_polygon_is_the_cross_section_of_the_pyramid(kind, facets):
    contact = binding(kind, facets=facets)
    faces, corners = laws.polygon(contact)
    np.testing.assert_allclose(corners, corners_of_polygon(contact), atol=1e-14)
    reach = corners @ faces.T
    assert np.max(reach) == pytest.approx(1.0, rel=1e-13)
    assert np.all(np.sum(np.isclose(reach, 1.0), axis=1) == 2)


@pytest.mark.parametrize("kind", KINDS, ids=kind_name)
def test_friction_limit_is_continuous(kind):
    contact = binding(kind)
    low, high = laws.normal_range(contact)
    normal = np.linspace(max(low, -600), min(high, 600), 20_001)
    limit = laws.friction_limit(contact, normal)
    assert np.all(limit >= 0)
    assert np.max(np.abs(np.diff(limit))) < 1.0 * (normal[1] - normal[0])


@pytest.mark.parametrize("kind", KINDS, ids=kind_name)
def test_normal_range_says_where_a_contact_can_give_way(kind):
    low, high = laws.normal_range(binding(kind))
    names = binding(kind).columns.names
    assert np.isfinite(low) == ("gn" in names or "gn+" in names)
    assert np.isfinite(high) == ("gn-" in names)


@pytest.mark.parametrize("kind", TWO_SIDED, ids=kind_name)
def test_jaws_of_a_two_sided_clamp_press_with_their_levers(kind):
    clamp = binding(kind, clamp_force=100.0, lever_ratio=4.0)
    assert clamp.lower_force == pytest.approx(500.0)
    assert clamp.upper_force == pytest.approx(125.0)
    ends = {piece.normal_min for piece in clamp.force_pieces()}
    assert -500.0 in ends
