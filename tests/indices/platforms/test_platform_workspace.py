import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError
from ocptip.indices.platforms.controllability import control_number, control_numbers
from ocptip.indices.platforms.platform import StewartPlatform
from studies.indices.designs.flight_simulator import OPTIMAL_CTN, FlightSimulator
from tests.indices.sample_platforms import LEGS, SEEDS
from tests.quick import examples


def ctn(pose):
    return control_number(pose).value


@examples(15)
@given(SEEDS, LEGS)
def test_many_poses_at_once_as_one_by_one(seed, n):
    rng = np.random.default_rng(seed)
    platform = StewartPlatform(rng.normal(size=(n, 3)), rng.normal(size=(n, 3)))
    positions = rng.normal(size=(5, 3)) + np.array([0, 0, 2.0])
    rotations = Rotation.random(5, random_state=rng).as_matrix()
    values = control_numbers(platform, positions, rotations)
    single = [ctn(platform.at(t, R)) for t, R in zip(positions, rotations, strict=True)]
    np.testing.assert_allclose(values, single, rtol=1e-8)
    fixed = control_numbers(platform, positions[0], rotations)
    np.testing.assert_allclose(fixed[1], ctn(platform.at(positions[0], rotations[1])), rtol=1e-8)


def test_singular_and_impossible_poses_in_a_batch():
    design = FlightSimulator.optimal()
    turn = Rotation.from_rotvec([[0, 0, 0], [0, 0, np.pi / 2]]).as_matrix()
    values = control_numbers(design.platform, design.position, turn)
    assert values[0] == pytest.approx(OPTIMAL_CTN)
    assert values[1] == 0.0
    rng = np.random.default_rng(0)
    base = rng.normal(size=(6, 3))
    values = control_numbers(StewartPlatform(base, base), [[0, 0, 0], [0, 0, 1.0]], np.eye(3))
    assert np.isnan(values[0])
    assert values[1] == 0.0


def test_bad_arguments_are_refused():
    design = FlightSimulator.optimal()
    with pytest.raises(InputError, match="rotations: expected 2 as positions, got 3"):
        control_numbers(design.platform, np.ones((2, 3)), np.tile(np.eye(3), (3, 1, 1)))
    with pytest.raises(InputError, match="rotations: no rotation matrices"):
        control_numbers(design.platform, np.ones((2, 3)), 2 * np.eye(3))
    with pytest.raises(InputError, match="positions: expected shape"):
        control_numbers(design.platform, np.ones((2, 2)), np.eye(3))
