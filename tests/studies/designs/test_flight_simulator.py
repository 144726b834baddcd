import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.indices.platforms.controllability import control_number
from ocptip.indices.platforms.reviewed import best_complex, manipulability, rigidity_rate
from studies.indices.designs.flight_simulator import LARGEST_ALPHA, OPTIMAL_CTN, FlightSimulator
from tests.quick import examples


def middle(design):
    return design.platform.at(design.position)


def test_published_optimum():
    design = FlightSimulator.optimal()
    control = control_number(middle(design))
    assert control.value == pytest.approx(0.687121499445, abs=1e-12)
    assert control.value == pytest.approx(OPTIMAL_CTN, abs=1e-14)
    assert design.alpha == pytest.approx(0.071320328447, abs=1e-12)
    assert math.degrees(design.alpha) == pytest.approx(4.086353814, abs=1e-9)
    assert design.height == pytest.approx(0.393075688879, abs=1e-12)
    small, large = 4 / math.sqrt(5), 2 + 4 / math.sqrt(5)
    np.testing.assert_allclose(control.lambdas, [small] * 2 + [large] * 4, rtol=1e-12)


def test_no_other_design_or_height_is_better():
    best, rng = FlightSimulator.optimal(), np.random.default_rng(0)
    for _ in range(100):
        alpha = np.clip(best.alpha + rng.normal() * 0.02, 0, LARGEST_ALPHA - 1e-6)
        other = FlightSimulator(float(alpha), best.height * float(np.exp(rng.normal() * 0.05)))
        assert control_number(middle(other)).value < OPTIMAL_CTN


@examples(40)
@given(st.floats(0, LARGEST_ALPHA - 1e-3), st.floats(0.01, 10), st.floats(0.1, 10))
def test_closed_form_of_the_eigenvalues(alpha, height, radius):
    design = FlightSimulator(alpha, height * radius, radius)
    np.testing.assert_allclose(control_number(middle(design)).lambdas, design.lambdas(), rtol=1e-7)


@pytest.mark.parametrize(
    ("alpha", "height", "volume", "sigma_r", "sigma_s"),
    [
        (0.0, 0.2, 1.438109, 0.557086, 0.909718),
        (0.0, 0.4, 4.071215, 0.937043, 1.352504),
        (0.0, 0.8, 3.184165, 1.124298, 0.917985),
        (0.2, 0.2, 4.212651, 0.874303, 1.304140),
        (0.2, 0.4, 5.319311, 1.285465, 1.077825),
        (0.2, 0.8, 1.861115, 0.857802, 0.639763),
        (0.4, 0.2, 4.703659, 1.275534, 0.908872),
        (0.4, 0.4, 1.176860, 0.715965, 0.510156),
        (0.4, 0.8, 0.180007, 0.370230, 0.263804),
    ],
)
def test_samples_of_the_reviewed_indices(alpha, height, volume, sigma_r, sigma_s):
    pose = middle(FlightSimulator(alpha, height))
    complexes = best_complex(pose)
    assert manipulability(pose) == pytest.approx(volume, abs=6e-7)
    assert complexes.sigma_r == pytest.approx(sigma_r, abs=6e-7)
    assert complexes.sigma_s == pytest.approx(sigma_s, abs=6e-7)


def test_manipulability_is_largest_next_to_a_singularity():
    """Supremum 27/4 in the singular corner alpha = pi/6, h = 0, approached along h = pi/6 - alpha."""
    volumes = []
    for delta in (0.3, 0.1, 0.01, 1e-3):
        design = FlightSimulator(LARGEST_ALPHA - delta, delta)
        volumes.append(manipulability(middle(design)))
    assert np.all(np.diff(volumes) > 0)
    assert volumes[-1] == pytest.approx(27 / 4, rel=1e-5)
    assert manipulability(middle(FlightSimulator.optimal())) < volumes[1]


@examples(30)
@given(st.floats(0, LARGEST_ALPHA - 1e-2), st.floats(0.05, 5))
def test_rigidity_rate_does_not_tell_the_middle_poses_apart(alpha, height):
    assert rigidity_rate(middle(FlightSimulator(alpha, height))).angle == pytest.approx(math.pi / 2, abs=1e-9)


def test_scales_with_the_radius():
    small, large = FlightSimulator.optimal(), FlightSimulator.optimal(radius=2.5)
    np.testing.assert_allclose(large.platform.base, 2.5 * small.platform.base, atol=1e-15)
    np.testing.assert_allclose(large.position, 2.5 * small.position)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((LARGEST_ALPHA, 0.3), "alpha: expected 0 <= alpha < pi/6"),
        ((-0.1, 0.3), "alpha"),
        ((0.1, 0.0), "height: must be > 0"),
        ((0.1, 0.3, -1.0), "radius: must be > 0"),
        ((math.nan, 0.3), "alpha: must be finite"),
    ],
)
def test_bad_arguments_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        FlightSimulator(*arguments)
