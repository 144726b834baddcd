"""What is missing where a base tips or slides, against equilibrium with it and a linear program."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import linprog

from ocptip.contact.solver import solve_many
from ocptip.contact.support import Load
from ocptip.contact.verdict import equilibrium
from ocptip.reserves.friction_needed import FrictionDemand, missing_force
from ocptip.reserves.tipping import TipOver, moment_at
from tests.quick import examples
from tests.reserves.reserve_scenes import FRICTION, GRAVITY, HEIGHT, MASS, corners, feet
from tests.reserves.test_general_position import uneven

seeds = st.integers(0, 10**6)


def margins(support, wrench):
    tip_over = TipOver(support)
    return tip_over, tip_over.evaluate(solve_many(support, wrench[None])).margins[0]


@pytest.mark.parametrize("push", [150.0, 400.0])
def test_the_moment_that_is_missing_is_the_sum_of_moments_about_the_edge(push):
    support = feet(corners(4, turn=np.pi / 4), friction=2.0)
    wrench = support.wrench([Load(force=[push, 0, 0], point=[0, 0, HEIGHT])])
    edge = corners(4, turn=np.pi / 4)[0, 0]
    expected = MASS * GRAVITY * edge - push * HEIGHT
    tip_over, found = margins(support, wrench)
    assert np.min(found) == pytest.approx(expected)
    ratio = float(tip_over.ratio(np.min(found)))
    assert moment_at(ratio, tip_over.reference_moment) == pytest.approx(expected)


@examples(20)
@given(seed=seeds, n=st.integers(3, 5), flat=st.booleans())
def test_the_missing_moment_added_as_a_couple_just_holds(seed, n, flat):
    rng = np.random.default_rng(seed)
    support = feet(corners(n, turn=rng.uniform(0, 6)), friction=3.0) if flat else uneven(rng, n)
    while True:
        wrench = support.wrench([Load(force=rng.normal(size=3) * 250, point=rng.normal(size=3) * 0.5)])
        tip_over, found = margins(support, wrench)
        if np.count_nonzero(found < 0) == 1:  # most loads tip about no axis, or about two
            break
    couple = np.r_[np.zeros(3), found.min() * tip_over.axes[int(np.argmin(found))].direction]
    assume(equilibrium(support, wrench + (1 + 1e-4) * couple).stands)  # else friction ends first
    assert equilibrium(support, wrench + (1 + 1e-5) * couple).stands
    assert not equilibrium(support, wrench + 0.999 * couple).stands


def by_linear_program(support, wrench, sides=64):
    """The missing force with pyramids around and within the cones, lower and upper bound."""
    turn = 2 * np.pi * np.arange(sides) / sides
    rays = np.column_stack([np.cos(turn), np.sin(turn)])
    n, bounds = support.n_contacts, []
    for scale in (1 / np.cos(np.pi / sides), 1.0):
        columns, cost = [], []
        for contact, k in zip(support.contacts, range(n), strict=True):
            W = support.wrench_matrix[:, 3 * k : 3 * k + 3]
            columns += [W @ np.r_[1.0, scale * contact.friction * ray] for ray in rays]
            columns += [W @ np.r_[0.0, ray] for ray in rays]
            cost += [0.0] * sides + [1 / scale] * sides
        found = linprog(cost, A_eq=np.array(columns).T, b_eq=-wrench, method="highs")
        bounds.append(found.fun if found.success else np.inf)
    return bounds


@examples(15)
@given(seed=seeds, n=st.integers(3, 5))
def test_the_missing_force_is_that_of_a_linear_program(seed, n):
    rng = np.random.default_rng(seed)
    support = uneven(rng, n)
    wrench = support.wrench([Load(force=rng.normal(size=3) * 250, point=rng.normal(size=3) * 0.2)])
    low, high = by_linear_program(support, wrench)
    assume(np.isfinite(low) == np.isfinite(high))  # at the border of tipping pyramids do not decide
    missing = missing_force(support, wrench)
    assert low - 1e-5 * MASS * GRAVITY <= missing <= high + 1e-5 * MASS * GRAVITY or missing == low


def test_missing_forces_of_a_push_and_of_a_turn():
    support = feet(corners(4), friction=FRICTION)
    weight = MASS * GRAVITY
    push = support.wrench([Load(force=[400, 0, 0], point=[0, 0, 0])])
    demand = FrictionDemand.of(support, push)
    assert demand.missing == pytest.approx(400 - FRICTION * weight, rel=1e-6)
    assert demand.factor == pytest.approx(400 / (FRICTION * weight), rel=1e-6)
    assert (
        demand.used == f"{100 * demand.factor:.0f} %: {demand.missing:.3g} N of tangential force are missing"
    )
    radius = float(np.linalg.norm(corners(4)[0]))
    turn = support.wrench([Load(moment=[0, 0, 200])])
    expected = 200 / radius - FRICTION * weight
    assert missing_force(support, turn) == pytest.approx(expected, rel=1e-6)
    assert missing_force(support, support.wrench([])) == pytest.approx(0, abs=1e-6)
