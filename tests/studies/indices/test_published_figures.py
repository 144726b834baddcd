"""The arrays behind lost figures of the theses: printed numbers, differences, the optimum."""

import numpy as np
import pytest

from studies.indices import published_figures
from studies.indices.designs.flight_simulator import FlightSimulator


def test_stationary_pose_and_curvatures_are_the_printed_ones():
    angles, curvatures = published_figures.stationary_pose()
    np.testing.assert_allclose(angles, [0.88638, -0.19062], atol=6e-6)
    np.testing.assert_allclose(1e9 * curvatures.values, [-1.55817e9, -7.38491e8, -5.21468e8], rtol=4e-6)
    for printed, known in zip(
        ([0.45754, 0.88919], [0.88919, -0.45754]), curvatures.directions[[0, 2]], strict=True
    ):
        assert abs(np.dot(printed, known[:2])) == pytest.approx(1.0, abs=1e-5)


def test_field_is_the_steepest_descent_of_the_manipulability():
    rng, step = np.random.default_rng(0), 1e-6
    at = rng.uniform([-1.9, -1.0], [1.7, 1.0], (20, 2))
    _, downhill = published_figures.descent(*at.T)
    for axis in range(2):
        ahead, behind = (published_figures.descent(*(at + s * step * np.eye(2)[axis]).T)[0] for s in (1, -1))
        np.testing.assert_allclose(downhill[:, axis], -(abs(ahead) - abs(behind)) / (2 * step), atol=1e-7)


def test_design_maps_have_the_tested_samples_and_the_optimum():
    alphas, heights = np.array([0.0, 0.2, 0.4]), np.array([0.2, 0.4, 0.8])
    maps = published_figures.design_maps(alphas, heights)
    np.testing.assert_allclose(maps["volume"][:, 0], [1.438109, 4.071215, 3.184165], atol=6e-7)
    np.testing.assert_allclose(maps["sigma_r"][1], [0.937043, 1.285465, 0.715965], atol=6e-7)
    np.testing.assert_allclose(maps["relative"].max(axis=0), 1.0)
    best = FlightSimulator.optimal()
    near = best.alpha + np.linspace(-0.02, 0.02, 5), best.height + np.linspace(-0.05, 0.05, 5)
    ctn = published_figures.design_maps(*near)["ctn"]
    assert np.unravel_index(np.argmax(ctn), ctn.shape) == (2, 2)


def test_power_map_has_the_printed_symmetry_step_and_generator():
    """Thesis M, 6.1.2: P(M, w) = P(-M, -w) (6.8), a step at rest, negative powers; c1 at 24 V."""
    loads, speeds, powers = published_figures.power_map(41)
    np.testing.assert_allclose(powers, powers[::-1, ::-1], atol=1e-9)
    at_rest = powers[41]
    assert at_rest[20] == pytest.approx(24 * 4.869e-1, abs=1e-4)
    assert np.abs(powers[41] - powers[40]).max() > 5.0
    against = powers[-1, 0]  # load and speed of opposite signs: maximum power
    assert against == powers.max()
    assert loads[0] < 0 < speeds[-1]
    assert powers.min() < -10.0


@pytest.mark.slow
def test_figures_are_written(tmp_path):
    assert published_figures.main(["--out", str(tmp_path), "--grid", "7"]) == 0
    for name in ("power_map", "gradient_field", "design_maps"):
        assert (tmp_path / f"published_{name}.png").stat().st_size > 20_000
