"""The arm model refuses what is not an arm, and copies itself with changes."""

import dataclasses
import pickle

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.published.arms import load_arm
from ocptip.robots.kinematics import gripper_pose
from ocptip.robots.model import JointLimits, SphereSet
from tests.robots.sample_arms import random_arm


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"masses": [1.0, 2.0]}, "masses: expected shape 3, got 2"),
        ({"masses": [1.0, -2.0, 1.0]}, "masses: must be >= 0"),
        ({"offsets": np.full((3, 3), np.nan)}, "offsets: contains NaN"),
        ({"rotations": np.zeros((3, 3, 3))}, r"rotations\[0\]: not a rotation matrix"),
        ({"tool_rotation": np.diag([1, 1, -1])}, "tool_rotation: not a rotation matrix.*det -1"),
        ({"inertias": np.arange(27).reshape(3, 3, 3)}, "inertias: must be symmetric"),
        ({"joint_names": ()}, "at least one joint"),
        ({"limits": JointLimits.unlimited(2)}, "limits: expected 3 joints, got 2"),
        ({"floor_sets": ("hand",)}, "no sphere set 'hand'; there are none"),
        (
            {"sphere_sets": (SphereSet("a", 4, np.zeros((1, 3)), [1.0]),)},
            r"spheres 'a': link must be 0\.\.3, got 4",
        ),
    ],
)
def test_bad_models_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        dataclasses.replace(random_arm(0, 3), **change)


def test_bad_limits_and_spheres_are_refused():
    one = np.ones(2)
    with pytest.raises(InputError, match="joint 1: angle_min 1"):
        JointLimits(one, one, one, one, one)
    with pytest.raises(InputError, match=r"limits\.speed: must be > 0"):
        JointLimits(-one, one, -one, one, one)
    with pytest.raises(InputError, match="same length"):
        JointLimits(-one, one, one, one, np.ones(3))
    with pytest.raises(InputError, match=r"limits\.torque: expected n numbers"):
        JointLimits(-one, one, one, one, [np.nan, 1])
    with pytest.raises(InputError, match="radii must be > 0"):
        SphereSet("a", 1, np.zeros((1, 3)), [0.0])
    with pytest.raises(InputError, match="no 'angel_max'; there are angle_min"):
        load_arm("FSFS").with_limits(angel_max=one)


def test_arrays_cannot_be_changed_from_outside():
    masses = np.ones(3)
    model = dataclasses.replace(random_arm(0, 3), masses=masses)
    masses[0] = 7
    assert model.masses[0] == 1
    with pytest.raises(ValueError, match="read-only"):
        model.masses[0] = 2


def test_pickled_model_is_the_same_arm():
    model = load_arm("FSFS")
    again = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(gripper_pose(again, np.ones(6))[0], gripper_pose(model, np.ones(6))[0])


def test_with_spheres_pairs_all_but_neighbours_and_exceptions():
    sets = [SphereSet(str(link), link, np.zeros((1, 3)), [0.1]) for link in range(4)]
    model = random_arm(0, 3).with_spheres(sets, excluded_pairs=[("3", "0")])
    assert model.collision_pairs == (("0", "2"), ("1", "3"))
    assert model.floor_sets == model.obstacle_sets == ("1", "2", "3")
    with pytest.raises(InputError, match="excluded_pairs: no sphere set '9'; there are '0', '1'"):
        model.with_spheres(sets, excluded_pairs=[("9", "0")])
