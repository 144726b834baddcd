"""Half spaces of wrenches that are held, against the slip reserve itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.contact.bindings.clamps import ForceConstantHalfRigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.resting import solve_resting
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Support
from ocptip.contact.verdict import stability
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipMap, TipOver
from ocptip.reserves.wrench_cone import TOLERANCE, ConeMap
from tests.quick import examples, some

SHARE = 0.8


def feet(count: int, *, tilt: float = 0.0, friction: float = 0.5) -> Support:
    angles = 2 * np.pi * (np.arange(count) + 0.3) / count
    contacts = [
        UnilateralContact(
            position=[0.3 * np.cos(a), 0.2 * np.sin(a), -0.4],
            normal=[tilt * np.cos(a), tilt * np.sin(a), 1.0],
            friction=friction * (1 + 0.2 * k),
        )
        for k, a in enumerate(angles)
    ]
    return Support(contacts, mass=50.0)


def test_objects_of_one_shape_share_their_facets_wherever_they_stand():
    def rows(place: float, friction: float) -> np.ndarray:
        corners = [(x + place, y + place / 3, 0.1) for x in (-0.03, 0.03) for y in (-0.03, 0.03)]
        own = [UnilateralContact(position=corner, friction=friction) for corner in corners]
        center = (place, place / 3, 0.2)
        found = Slip(Support(own, mass=0.4, center_of_mass=center)).half_spaces(SHARE)
        assert found is not None
        return found

    first, moved, other = rows(0.0, 0.3), rows(0.7 / 3, 0.3), rows(0.0, 0.3 + 1e-9)
    np.testing.assert_allclose(moved, first, rtol=1e-12)
    assert other.shape != first.shape or np.abs(other - first).max() > 1e-10


@pytest.mark.parametrize(("count", "tilt"), some(2, [(3, 0.0), (4, 0.0), (5, 0.0), (4, -0.2)]))
def test_inside_and_nearly_all(count, tilt):
    support = feet(count, tilt=tilt)
    slip = Slip(support)
    rows = slip.half_spaces(SHARE)
    rng = np.random.default_rng(count)
    loads = rng.normal(size=(300, 6)) * [120, 120, 50, 30, 30, 40] + support.weight
    states = solve_many(support, loads)
    reserve = slip.evaluate(states, derivatives=False)
    known = reserve.solved & states.persistent  # of several solutions the solver's may be one that slides
    inside = np.max(loads @ rows.T, axis=1) <= 0
    assert 30 < np.sum(inside[known]) < np.sum(known) - 10
    assert np.max(reserve.GT[known & inside]) <= SHARE * (1 + 1e-7)
    surely = known & (reserve.GT <= SHARE * (1 - TOLERANCE) * (1 - 1e-6))
    assert np.all(inside[surely])


def test_none_where_the_set_is_no_cone():
    ordinary = [UnilateralContact(position=[x, 0.2, 0.0], friction=0.5) for x in (-0.2, 0.2)]
    clamp = ForceConstantHalfRigidClamp(
        position=[0.0, -0.2, 0.0], friction_upper=0.4, friction_lower=0.4, clamp_force=50.0
    )
    assert Slip(Support([*ordinary, clamp], mass=10.0)).half_spaces(SHARE) is None
    assert Slip(feet(4), "tangential").half_spaces(SHARE) is None
    assert Slip(Support(ordinary, mass=10.0)).half_spaces(SHARE) is None


def test_the_smooth_map_keeps_the_cone_and_its_derivatives_are_finite_differences():
    slip, unit = Slip(feet(4)), 200.0
    rng = np.random.default_rng(5)
    wrenches = rng.normal(size=(200, 6)) * [120, 120, 50, 30, 30, 40] + slip.support.weight
    rows = slip.half_spaces(SHARE)
    smooth = ConeMap(rows, unit)
    values, slopes, bends = smooth(wrenches)
    greatest = 1 + np.max(wrenches @ rows.T, axis=1) / unit
    assert np.all(values >= greatest)
    assert np.all(values <= greatest + 0.01)
    assert 20 < np.sum(values <= 1) < 180
    h = 1e-3  # N, N m; the maximum is soft over 0.2 N
    for k in range(6):
        side = h * np.eye(6)[k]
        (up, more, _), (down, less, _) = smooth(wrenches + side), smooth(wrenches - side)
        np.testing.assert_allclose(slopes[:, k], (up - down) / (2 * h), atol=1e-4 * np.abs(slopes).max())
        np.testing.assert_allclose(bends[:, k], (more - less) / (2 * h), atol=1e-3 * np.abs(bends).max())


@pytest.mark.parametrize("count", some(1, [3, 4]))
def test_programs_stop_where_contacts_hold_for_sure(count):
    """Pyramids of 12 facets let go at 96 % of a round cone; normal forces of four feet are redistributed."""
    support = feet(count, friction=0.2)
    slip = Slip(support)
    smooth, most = slip.within(0.999)
    rng = np.random.default_rng(count)
    wrenches = rng.normal(size=(2000, 6)) * [50, 50, 50, 10, 10, 15] + support.weight
    wrenches = wrenches[np.min(TipMap(TipOver(support))(wrenches)[0], axis=1) > 0]
    values = smooth(wrenches)[0]
    near = wrenches[(values <= most) & (values > 0.9 * most)]
    assert len(near) > 20
    states = solve_many(support, near)
    assert np.all(states.solved)
    sliding = ~states.persistent  # of several solutions the solver's may be one that slides
    assert not (count == 3 and sliding.any())
    assert all(stability(support, wrench).verdict != "none" for wrench in near[sliding][:10])
    assert np.max(slip.evaluate(states, derivatives=False).GT[~sliding]) <= slip.sure * (1 + 1e-7)


@examples(8)
@given(seed=st.integers(0, 10**6), count=st.sampled_from([3, 4, 5]), size=st.floats(0.05, 1.0))
def test_the_greatest_reserves_are_exact_and_all_others_are_below(seed, count, size):
    """Whether wrenches hold the base or not."""
    slip = Slip(support := feet(count))
    loads = np.random.default_rng(seed).normal(size=(50, 6)) * size * np.array([60, 60, 50, 15, 15, 20])
    loads += support.weight
    exact = slip.evaluate(solve_resting(support, loads)).GT
    stands, most = exact < 1, exact.max()  # a base that moves may do so in several ways
    found, large = slip.greatest(loads), exact >= 0.95 * min(most, 1.0)
    np.testing.assert_allclose(found[large & stands], exact[large & stands], rtol=0, atol=1e-9)
    assert np.all((found >= exact - 1e-9) | (~stands & (found >= 1)))
    assert np.all(found[~large] <= 0.95 * min(most, 1.0) + 1e-9)
    for least in (0.3, 0.8):
        found = slip.above(loads, least)
        assert np.all((found >= 1) == ~stands)
        same = np.abs(found - exact) <= 1e-9
        assert np.all(same | ~stands | ((exact <= least) & (found == least)))
