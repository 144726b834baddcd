import math

import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError
from ocptip.indices.platforms.controllability import singular_motion
from ocptip.indices.platforms.platform import PlatformPose
from studies.indices.designs.flight_simulator import FlightSimulator
from tests.indices.sample_platforms import SEEDS, flat_pose, moved, random_motion, random_pose
from tests.quick import examples


@pytest.mark.parametrize(
    ("epsilon", "pitch", "kernel"),
    [(0.1, -0.722425, -0.722490), (0.01, -0.780109, -0.780109), (0.001, -0.785550, -0.785550)],
)
def test_pitch_near_the_singular_turn(epsilon, pitch, kernel):
    """[Naw07] 6.3.3: the platform of 6.4 turned about z by pi/2 - epsilon."""
    design = FlightSimulator.optimal()
    turned = Rotation.from_euler("z", math.pi / 2 - epsilon).as_matrix()
    pose = design.platform.at(design.position, turned)
    diagnosis = singular_motion(pose)
    assert diagnosis.motion.pitch == pytest.approx(pitch, abs=6e-7)
    least = np.linalg.svd(pose.jacobian)[2][-1]
    assert least[:3] @ least[3:] / (least[:3] @ least[:3]) == pytest.approx(kernel, abs=6e-7)
    assert diagnosis.kind == "complex"
    assert diagnosis.type == "regular"
    np.testing.assert_allclose(np.abs(diagnosis.motion.direction), [0, 0, 1], atol=1e-9)


@examples(30)
@given(SEEDS)
def test_screw_near_a_singularity_converges_to_the_self_motion(seed):
    """Legs nearly path normals of a random screw."""
    rng = np.random.default_rng(seed)
    screw, platform = rng.normal(size=6), rng.normal(size=(6, 3))
    v = screw[3:] + np.cross(screw[:3], platform)
    legs = np.cross(v, rng.normal(size=(6, 3)))
    legs /= np.linalg.norm(legs, axis=1)[:, None]
    noise = rng.normal(size=(6, 3))
    errors = []
    for epsilon in (1e-4, 1e-6, 0.0):
        pose = PlatformPose(platform - legs - epsilon * noise, platform)
        if singular_motion(pose).screws.shape[1] > 1:
            return
        q = singular_motion(pose).screw
        cosine = abs(q @ screw) / np.linalg.norm(q) / np.linalg.norm(screw)
        errors.append(math.sqrt(max(1 - min(cosine, 1.0) ** 2, 0.0)))
    if errors[0] < 1e-2:
        assert errors[1] < 1e-3
    assert errors[2] < 1e-5
    exact = singular_motion(PlatformPose(platform - legs, platform))
    assert exact.control.value <= 1e-12
    np.testing.assert_allclose(exact.motion.pitch, screw[:3] @ screw[3:] / (screw[:3] @ screw[:3]), rtol=1e-4)


@examples(20)
@given(SEEDS)
def test_lines_through_one_axis_give_a_rotation(seed):
    rng = np.random.default_rng(seed)
    base, axis = rng.normal(size=(6, 3)), np.array([0.0, 0.0, 1.0])
    ends = np.outer(rng.uniform(-1, 1, 6), axis)
    pose = moved(PlatformPose(base, base + 0.7 * (ends - base)), *random_motion(rng))
    diagnosis = singular_motion(pose)
    assert diagnosis.control.value <= 1e-12
    assert (diagnosis.kind, diagnosis.type) == ("complex", "singular")
    assert diagnosis.lines == "lines that meet one line"
    assert abs(diagnosis.motion.pitch) < 1e-6
    moments = pose.spears[:, :3] @ diagnosis.motion.axis[3:] + pose.spears[:, 3:] @ diagnosis.motion.axis[:3]
    np.testing.assert_allclose(moments, 0, atol=1e-7)


def test_legs_across_one_direction_give_a_translation():
    rng = np.random.default_rng(3)
    base, legs = rng.normal(size=(6, 3)), rng.normal(size=(6, 3))
    legs[:, 2] = 0.0
    diagnosis = singular_motion(PlatformPose(base, base + legs))
    assert diagnosis.motion.is_translation
    assert diagnosis.lines == "lines orthogonal to one direction"
    np.testing.assert_allclose(np.abs(diagnosis.motion.direction), [0, 0, 1], atol=1e-9)


def test_two_axes_give_a_hyperbolic_pencil_and_a_plane_a_bundle():
    rng = np.random.default_rng(5)
    first = np.column_stack([rng.uniform(-1, 1, 6), np.zeros(6), np.zeros(6)])
    second = np.column_stack([np.zeros(6), rng.uniform(-1, 1, 6), np.ones(6)])
    diagnosis = singular_motion(PlatformPose(first, 0.8 * second + 0.2 * first))
    assert (diagnosis.kind, diagnosis.type) == ("pencil", "hyperbolic")
    flat = singular_motion(flat_pose(rng))
    assert (flat.kind, flat.type) == ("bundle", "degenerate")
    assert flat.screws.shape == (6, 3)


def test_parallel_legs():
    rng = np.random.default_rng(6)
    base = rng.normal(size=(6, 3))
    diagnosis = singular_motion(PlatformPose(base, base + np.array([0.0, 0.2, 1.0])))
    assert diagnosis.control.indeterminate
    assert diagnosis.screws.shape[1] == 3
    assert diagnosis.type == "degenerate"
    line = np.outer(np.arange(6.0), [1.0, 2.0, 3.0])
    assert singular_motion(PlatformPose(line, line + np.array([0.5, 1.0, 1.5]))).kind == "more"


def test_near_a_singularity_of_two_motions_both_are_found():
    rng = np.random.default_rng(5)
    first = np.column_stack([rng.uniform(-1, 1, 6), np.zeros(6), np.zeros(6)])
    second = np.column_stack([np.zeros(6), rng.uniform(-1, 1, 6), np.ones(6)])
    noise = 1e-6 * rng.normal(size=(2, 6, 3))
    pose = PlatformPose(first + noise[0], 0.8 * second + 0.2 * first + noise[1])
    diagnosis = singular_motion(pose, closeness=0.02)
    assert 0 < diagnosis.control.value < 1e-5
    assert (diagnosis.kind, diagnosis.type) == ("pencil", "hyperbolic")


def test_far_from_singularities_no_lines_are_named():
    design = FlightSimulator.optimal()
    diagnosis = singular_motion(design.platform.at(design.position))
    assert (diagnosis.kind, diagnosis.type) == ("none", "none")
    assert diagnosis.lines == "none: the pose is far from a singularity"
    assert diagnosis.screws.shape == (6, 1)


def test_arguments_are_checked_and_data_is_plain():
    pose = random_pose(np.random.default_rng(0))
    with pytest.raises(InputError, match="closeness: expected 0 < closeness <= 1"):
        singular_motion(pose, closeness=0.0)
    with pytest.raises(InputError, match="expected a PlatformPose"):
        singular_motion("pose")
    data = singular_motion(pose).to_dict()
    assert data["motion"]["pitch"] == pytest.approx(singular_motion(pose).motion.pitch)
    assert len(data["screw"]) == 6
