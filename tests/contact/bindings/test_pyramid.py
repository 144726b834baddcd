"""The friction pyramid against its published errors and its geometry."""

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.contact.bindings import pyramid
from ocptip.contact.bindings.unilateral import UnilateralContact

PUBLISHED_PERCENT = {6: 7.18, 8: 3.96, 10: 2.51, 12: 1.73, 14: 1.27, 16: 0.97, 18: 0.77}
ALL_FACETS = range(3, 33)


@pytest.mark.parametrize(("facets", "percent"), list(PUBLISHED_PERCENT.items()))
def test_radius_error_is_the_published_one(facets, percent):
    assert round(100 * pyramid.radius_error(facets), 2) == percent


@pytest.mark.parametrize("facets", ALL_FACETS)
def test_pyramid_errs_as_much_inside_as_outside_the_cone(facets):
    mu = 0.7
    k = pyramid.edges(mu, facets)
    edge_radius = np.linalg.norm(k[:, 1:], axis=1) / k[:, 0]
    face_radius = pyramid.corrected_friction(mu, facets)
    error = pyramid.radius_error(facets)
    np.testing.assert_allclose(edge_radius, mu * (1 + error), rtol=1e-13)
    assert face_radius == pytest.approx(mu * (1 - error), rel=1e-13)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("facets", ALL_FACETS)
def test_face_h_lies_between_the_edges_before_and_after_it(facets, side):
    k = pyramid.edges(0.4, facets, side)
    s = pyramid.face_directions(facets)
    slope = pyramid.corrected_friction(0.4, facets)
    reach = k[:, 1:] @ s.T  # (edge, face)
    limit = slope * side * k[:, 0]
    for h in range(facets):
        np.testing.assert_allclose(reach[[h - 1, h], h], limit[[h - 1, h]], rtol=1e-13)
    assert np.all(reach <= limit[:, None] + 1e-14)


@pytest.mark.parametrize("facets", ALL_FACETS)
def test_edges_and_face_directions_are_unit_vectors_and_the_first_face_looks_along_t1(facets):
    np.testing.assert_allclose(np.linalg.norm(pyramid.edges(0.9, facets), axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(pyramid.face_directions(facets), axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(pyramid.face_directions(facets)[0], [1.0, 0.0], atol=1e-15)


def test_edges_follow_the_published_formulas():
    """(3.12) and (3.13) written out."""
    mu, S = 0.5, 6
    c = np.cos(np.pi / S)
    mu_S = mu * 2 * c / (1 + c)
    kn, kt = c / np.sqrt(c**2 + mu_S**2), mu_S / np.sqrt(c**2 + mu_S**2)
    for h, edge in enumerate(pyramid.edges(mu, S), start=1):
        angle = 2 * np.pi * (h - 0.5) / S
        np.testing.assert_allclose(edge, [kn, kt * np.cos(angle), kt * np.sin(angle)], atol=1e-15)


def test_planar_edges_span_the_exact_cone():
    k1, k2 = pyramid.planar_edges(0.5)
    assert k1[1] / k1[0] == pytest.approx(0.5)
    assert k2[1] / k2[0] == pytest.approx(-0.5)
    np.testing.assert_allclose(pyramid.planar_edges(0.5, -1.0) @ [[-1, 0], [0, 1]], [k1, k2])


def test_many_facets_converge_to_the_cone():
    assert pyramid.corrected_friction(0.5, 10_000) == pytest.approx(0.5, rel=1e-7)


@pytest.mark.parametrize("facets", [2, 0, -4, 3.0, 8.5, True, "8", None, float("nan")])
def test_bad_facet_counts_are_refused_by_name(facets):
    with pytest.raises(InputError, match=r"^facets: must be an integer"):
        UnilateralContact(position=[0, 0, 0], friction=0.5, facets=facets)


def test_numpy_integers_are_facet_counts():
    assert UnilateralContact(position=[0, 0, 0], friction=0.5, facets=np.int64(5)).facets == 5
