"""Friction for all twists, against least friction by a convex program."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from ocptip.certificate.trusted.twists import FrictionLimits, Twists
from tests.quick import some


def _scene(rng, contacts):
    """Grasp matrix of contacts on a tilted plane, limits that depend on the wrench, and a wrench."""
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    places = np.column_stack([rng.uniform(-0.5, 0.5, (contacts, 2)), np.full(contacts, -0.4)]) @ frame.T
    columns = [[*axis, *np.cross(r, axis)] for r in places for axis in frame[:, [2, 0, 1]].T]
    wrench = np.concatenate([rng.normal(size=3), 0.5 * rng.normal(size=3)])
    return np.array(columns).T, wrench


def _least_share(grasp, wrench, limits):
    """The share of the limits that friction needs: for twists with a given ratio, in a fan, by search."""
    tangential = np.delete(grasp, np.s_[::3], axis=1)
    basis = np.zeros((6, 3))
    basis[:3, :2], basis[3:, 2] = grasp[:3, 1:3], grasp[:3, 0]

    def need(y):
        v = (tangential.T @ (y @ basis.T).T).reshape(len(limits), 2, -1)
        return -(y @ basis.T) @ wrench / (limits @ np.linalg.norm(v, axis=1))

    def twist(angle, slope):
        return np.array([np.cos(angle) * np.cos(slope), np.sin(angle) * np.cos(slope), 3 * np.sin(slope)])

    def best_slope(angle):
        slopes = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 181)
        k = int(np.argmax(need(np.array([twist(angle, slope) for slope in slopes]))))
        found = minimize_scalar(
            lambda slope: -need(twist(angle, slope)[None])[0],
            bounds=(slopes[max(k - 1, 0)], slopes[min(k + 1, 180)]),
            method="bounded",
        )
        return -found.fun

    angles = np.linspace(0, 2 * np.pi, 181)
    k = int(np.argmax([best_slope(angle) for angle in angles]))
    found = minimize_scalar(
        lambda angle: -best_slope(angle), bounds=(angles[k] - 0.04, angles[k] + 0.04), method="bounded"
    )
    return -found.fun


def _room(grasp, wrench, limits, half):
    """With limits that do not depend on the wrench, known exactly but for a box round it."""
    m = len(limits)
    own = FrictionLimits(np.zeros((1, m, 6)), np.tile(limits, (2, 1, 1)), np.zeros((1, m)))
    twists = Twists(grasp, 1e-16 * np.abs(grasp), wrench[:, None], np.full((6, 1), half), own)

    def least(rows, h, ends, closely):
        found = np.einsum("aik,i->ak", h, wrench) - half * np.abs(h).sum(axis=1)
        return np.min(ends, axis=0) + found

    return float(twists.slack(least, patient=True)[0])


@pytest.mark.parametrize("seed", some(2, range(6)))
def test_friction_is_enough_just_where_the_least_share_of_it_says_so(seed):
    rng = np.random.default_rng(seed)
    grasp, wrench = _scene(rng, 3 + seed % 3)
    limits = rng.uniform(0.05, 2.0, 3 + seed % 3)
    need = _least_share(grasp, wrench, limits)
    assert _room(grasp, wrench, 1.003 * need * limits, 0.0) >= 0
    assert _room(grasp, wrench, 0.999 * need * limits, 0.0) < 0


def test_limits_within_a_box_hold_all_its_wrenches():
    rng = np.random.default_rng(3)
    grasp, wrench = _scene(rng, 3)
    limits = np.array([0.3, 1.2, 0.8])
    half = 0.1
    need = max(_least_share(grasp, wrench + half * rng.choice([-1.0, 1.0], 6), limits) for _ in range(3))
    assert _room(grasp, wrench, 0.99 * need * limits, half) < 0


def test_a_contact_that_bears_nothing_counts_for_nothing():
    rng = np.random.default_rng(1)
    grasp, wrench = _scene(rng, 4)
    limits = np.array([1.0, 0.7, 0.0, 1.3])
    share = _least_share(grasp[:, [0, 1, 2, 3, 4, 5, 9, 10, 11]], wrench, limits[[0, 1, 3]])
    assert _room(grasp, wrench, 1.003 * share * limits, 0.0) >= 0
    assert _room(grasp, wrench, 0.999 * share * limits, 0.0) < 0
