import numpy as np
import pytest

from ocptip.basics.errors import InputError, SolverError
from ocptip.indices.platforms.controllability import control_number
from ocptip.indices.platforms.platform import StewartPlatform
from ocptip.indices.platforms.reviewed import manipulability, rigidity_rate
from studies.indices.designs.flight_simulator import OPTIMAL_CTN, FlightSimulator
from studies.indices.designs.optimal_platforms import example_main
from studies.indices.designs.platform_search import best_pose, quality_index


def ctn(pose):
    return control_number(pose).value


@pytest.mark.slow
def test_search_finds_the_published_optimum():
    design = FlightSimulator.optimal()
    best = best_pose(
        design.platform, ctn, position=[0.1, -0.05, 0.6], half_range=[0.3, 0.3, 0.4], half_angle=0.0, starts=3
    )
    assert best.value == pytest.approx(OPTIMAL_CTN, abs=1e-7)
    np.testing.assert_allclose(best.position, design.position, atol=1e-5)
    np.testing.assert_array_equal(best.rotation_vector, 0)
    assert ctn(best.pose) == best.value
    assert (np.diff(best.found) <= 0).all()
    assert best.evaluations > 100


@pytest.mark.slow
def test_search_finds_control_number_one_in_six_dimensions():
    pose = example_main().pose
    best = best_pose(
        StewartPlatform(pose.base, pose.platform),
        ctn,
        position=[0.05, 0.04, -0.05],
        half_range=[0.2] * 3,
        half_angle=0.3,
        starts=1,
    )
    assert best.value > 0.999


@pytest.mark.slow
def test_search_stays_in_its_box():
    design = FlightSimulator.optimal()
    best = best_pose(
        design.platform, ctn, position=[0.3, 0, 0.8], half_range=[0.1, 0, 0.1], half_angle=0.0, starts=2
    )
    assert best.position[0] == pytest.approx(0.2, abs=1e-6)
    assert best.position[1] == 0.0
    assert best.position[2] == pytest.approx(0.7, abs=1e-6)


@pytest.mark.slow
def test_quality_index():
    design = FlightSimulator.optimal()
    box = {"half_range": [0.1, 0.1, 0.3], "half_angle": 0.0, "starts": 2}
    index = quality_index(design.platform, design.position, **box)
    assert 0.9 < index.value < 1.0
    assert index.largest == index.best.value
    assert index.manipulability == pytest.approx(manipulability(design.platform.at(design.position)))
    at_best = quality_index(design.platform, index.best.position, **box)
    assert at_best.value == pytest.approx(1.0, abs=1e-9)


def test_any_index_of_a_pose_can_be_searched():
    design = FlightSimulator.optimal()
    best = best_pose(
        design.platform,
        lambda pose: rigidity_rate(pose).angle,
        position=[0.1, 0.1, 0.4],
        half_range=[0.2, 0.2, 0.1],
        half_angle=0.0,
        starts=1,
    )
    assert best.value <= np.pi / 2


def test_bad_arguments_are_refused():
    design = FlightSimulator.optimal()
    box = {"position": [0, 0, 1], "half_range": [1, 1, 1], "half_angle": 1.0}
    with pytest.raises(InputError, match="starts: must be a whole number >= 1"):
        best_pose(design.platform, ctn, **box, starts=0)
    with pytest.raises(InputError, match="half_range, half_angle: must be >= 0"):
        best_pose(design.platform, ctn, **box | {"half_range": [-1, 1, 1]})
    with pytest.raises(InputError, match="angle at most pi"):
        best_pose(design.platform, ctn, **box | {"half_angle": 4.0})
    base = np.random.default_rng(0).normal(size=(6, 3))
    point = {"half_range": [0, 0, 0], "half_angle": 0.0, "starts": 1}
    with pytest.raises(SolverError, match="exists in no start"):
        best_pose(StewartPlatform(base, base), ctn, position=[0, 0, 0], **point)
    with pytest.raises(SolverError, match="every pose found is singular"):
        quality_index(StewartPlatform(base, base), [0, 0, 1], **point)
