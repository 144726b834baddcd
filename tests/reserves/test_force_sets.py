import numpy as np
import pytest

from ocptip.contact.bindings.clamps import RigidClamp
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Support
from ocptip.reserves.force_sets import ForceSets, force_scale
from tests.reserves.reserve_scenes import CLAMPS, clamp, clamped, corners, feet


def limit_of(kind, normal_force):
    sets = ForceSets(Support([clamp(kind, (0.0, 0.0, 0.0))]))
    return sets.limits(np.array([[normal_force]]), np.array([1.0])).value[0, 0]


def test_ends_of_normal_forces():
    supports = {kind.kind: ForceSets(Support([clamp(kind, (0.0, 0.0, 0.0))])) for kind in CLAMPS}
    ends = {kind: (float(sets.lower[0]), float(sets.upper[0])) for kind, sets in supports.items()}
    assert ends == {
        "rigid-clamp": (-np.inf, np.inf),
        "force-variable-half-rigid-clamp": (-np.inf, np.inf),
        "force-variable-two-sided-clamp": (-np.inf, np.inf),
        "force-constant-half-rigid-clamp": (-150.0, np.inf),
        "force-constant-two-sided-clamp": (pytest.approx(-345.0), pytest.approx(150 * (1 + 1 / 1.3))),
    }
    ordinary = ForceSets(feet(corners(3)))
    np.testing.assert_array_equal(ordinary.lower, 0)
    np.testing.assert_array_equal(ordinary.upper, np.inf)


@pytest.mark.parametrize(
    ("kind", "normal_force", "limit"),
    [
        ("rigid-clamp", 100.0, 50.0),
        ("rigid-clamp", -100.0, 40.0),
        ("force-variable-half-rigid-clamp", 100.0, 0.4 * 150 + 0.5 * 250),
        ("force-variable-half-rigid-clamp", -200.0, 0.4 * 200),
        ("force-constant-half-rigid-clamp", -50.0, 0.4 * 150 + 0.5 * 100),
        ("force-variable-two-sided-clamp", 10.0, 0.9 * 150 + (0.5 - 1.3 * 0.4) / 2.3 * 10),
        ("force-variable-two-sided-clamp", 1000.0, 500.0),
        ("force-variable-two-sided-clamp", -1000.0, 400.0),
        ("force-constant-two-sided-clamp", -345.0, 0.4 * 345),
    ],
)
def test_limits_of_spec_section_5(kind, normal_force, limit):
    by_name = {c.kind: c for c in CLAMPS}
    assert limit_of(by_name[kind], normal_force) == pytest.approx(limit, rel=1e-12)


@pytest.mark.parametrize("kind", CLAMPS)
def test_limits_are_continuous_between_pieces(kind):
    forces = np.linspace(-600, 600, 24001)[:, None]
    sets = ForceSets(Support([clamp(kind, (0.0, 0.0, 0.0))]))
    inside = (forces >= sets.lower) & (forces <= sets.upper)
    limits = sets.limits(forces, np.ones(len(forces))).value[inside]
    assert np.max(np.abs(np.diff(limits))) <= 0.5 * 0.05 + 1e-9
    assert np.all(limits >= 0)


def test_a_rounding_error_outside_an_end_counts_as_the_end():
    sets = ForceSets(feet(corners(3)))
    limits = sets.limits(np.array([[-1e-9, 0.0, 100.0]]), np.array([100.0]))
    np.testing.assert_allclose(limits.value, [[0.0, 0.0, 50.0]])


def test_scales_of_a_state_without_forces():
    support = clamped(RigidClamp)
    states = solve_many(support, np.zeros((1, 6)))
    assert force_scale(states)[0] > 0
    assert states.rest_limit[0] == 0
