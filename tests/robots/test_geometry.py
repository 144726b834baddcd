"""Signed distances against plain geometry."""

from dataclasses import replace

import casadi as cs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.published.arms import arm_names, load_arm, start_and_goal
from ocptip.robots.collision.shapes import Ball, BodyShape
from ocptip.robots.geometry import CollisionModel, Pillar, Solid, Wall, floor, spheres_along_links
from ocptip.robots.kinematics import link_frames
from ocptip.robots.model import SphereSet
from tests.quick import examples, some
from tests.robots.sample_arms import random_arm

TURN = np.array([0.6, 0.0, 0.8])


def centres(model, q):
    """Sphere centres by name, from link frames only."""
    frames = link_frames(model, q)
    result = {}
    for s in model.sphere_sets:
        if s.link == 0:
            result[s.name] = model.mount_position + s.centres @ model.mount_rotation.T
        else:
            result[s.name] = frames.origins[s.link - 1] + s.centres @ frames.rotations[s.link - 1].T
    return result


@pytest.mark.parametrize("name", arm_names())
@examples(15)
@given(angles=st.lists(st.floats(-3, 3), min_size=6, max_size=6))
def test_all_gaps_by_plain_geometry(name, angles):
    model = load_arm(name).mounted([0.02, 0.03, 0.1])
    post = Pillar([0.4, 0.1, 0.0], 0.05)
    collision = CollisionModel(model, [floor(-0.04), Wall(TURN, 0.5), post])
    q = np.array(angles)
    at, radii = centres(model, q), {s.name: s.radii for s in model.sphere_sets}
    expected = [at[n][:, 2] - radii[n] + 0.04 for n in model.floor_sets]
    expected += [0.5 - at[n] @ TURN - radii[n] for n in model.obstacle_sets]
    expected += [
        np.hypot(at[n][:, 0] - 0.4, at[n][:, 1] - 0.1) - radii[n] - 0.05 for n in model.obstacle_sets
    ]
    for first, second in model.collision_pairs:
        apart = np.linalg.norm(at[first][:, None] - at[second][None], axis=2)
        expected.append((apart - radii[first][:, None] - radii[second]).ravel())
    gaps = collision.gaps(q)
    np.testing.assert_allclose(gaps, np.concatenate(expected), atol=1e-12)
    assert len(collision.labels) == len(gaps)
    worst, label, state = collision.worst(np.array([q, q]))
    assert worst == gaps.min()
    assert label == collision.labels[int(np.argmin(gaps))]
    assert state == 0


@pytest.mark.parametrize("name", arm_names())
def test_start_and_goal_of_the_experiment_are_free(name):
    collision = CollisionModel(load_arm(name), [floor(-0.14)])
    assert collision.worst(np.array(start_and_goal(name)))[0] > 0.005


def test_folded_arm_collides_and_says_where():
    collision = CollisionModel(load_arm("FP1W2F"), [floor(-0.14)])
    gap, label, _ = collision.worst(np.deg2rad([0, 150, 0, 0, 0, 0]))
    assert gap < 0
    assert str(label) in {str(label) for label in collision.labels}
    assert " and " in str(label)


def test_derivatives_are_finite_even_where_centres_coincide():
    model = random_arm(0, 3).with_spheres(
        [SphereSet("a", 1, np.zeros((1, 3)), [0.1]), SphereSet("b", 1, np.zeros((1, 3)), [0.2])]
    )
    collision = CollisionModel(
        type(model)(
            **{f: getattr(model, f) for f in model.__dataclass_fields__} | {"collision_pairs": (("a", "b"),)}
        )
    )
    q = cs.SX.sym("q", 3)
    slope = cs.Function("slope", [q], [cs.jacobian(collision.function(q), q)])
    assert np.isfinite(np.array(slope(np.ones(3)))).all()
    assert collision.gaps(np.ones(3))[0] == pytest.approx(-0.3)


def test_nothing_to_collide_with():
    collision = CollisionModel(load_arm("FSFS"))
    assert collision.labels == ()
    assert collision.gaps(np.zeros((4, 6))).shape == (4, 0)
    assert collision.worst(np.zeros(6)) == (np.inf, None, 0)


def test_tubes_along_links_cover_them():
    model = load_arm("FP1W2F")
    sets = spheres_along_links(model, 0.06)
    assert [s.link for s in sets] == [1, 2, 3, 4, 6]
    for s in sets:
        np.testing.assert_allclose(s.centres[[0, -1]], [np.zeros(3), model.offsets[s.link - 1]])
        steps = np.linalg.norm(np.diff(s.centres, axis=0), axis=1)
        assert steps.max() <= 0.06 + 1e-12
    with pytest.raises(InputError, match=r"links: must be 1\.\.6, got 7"):
        spheres_along_links(model, 0.06, links=[7])
    with pytest.raises(InputError, match=r"radius: more than 1000 spheres on link 1, 0\.\d+ m long"):
        spheres_along_links(model, 1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Wall([1.0, 1.0, 0.0], 0.1), "wall: normal must have length 1"),
        (lambda: Wall([1.0, 0.0, 0.0], np.nan), "wall: distance: must be finite"),
        (lambda: Pillar([0.0, 0.0, 0.0], -1.0), "pillar: radius: must be > 0"),
        (lambda: Pillar([0.0, 0.0], 1.0), "pillar: point: expected shape 3"),
        (lambda: CollisionModel(load_arm("FSFS"), ["wall"]), "obstacles: expected Wall"),
    ],
)
def test_bad_obstacles_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize("seed", some(2, range(8)))
def test_each_pair_in_a_posture_of_its_own_is_what_all_pairs_are_with_the_slopes_of_differences(seed):
    rng = np.random.default_rng(seed)
    joints, h = 5, 1e-6
    slides = rng.random(joints) < 0.3
    arm = replace(random_arm(seed, joints), prismatic=slides).with_spheres(
        SphereSet(f"s{k}", k, rng.normal(size=(2, 3)), rng.uniform(0.01, 0.1, 2)) for k in (0, 1, 3, 5)
    )
    pairs = ("s0", "s3"), ("s5", "s1"), ("s1", "s3"), ("s5", "s0")
    arm = replace(arm, collision_pairs=pairs, floor_sets=("s5",), obstacle_sets=("s1", "s3", "s5"))
    post = Solid(Ball(0.2, position=rng.normal(size=3)), "post")
    around = [floor(-0.5), Wall(TURN, 4.0), Pillar([3.0, 0.1, 0.0], 0.05), post]
    base = [BodyShape("base", 0, Ball(0.3, position=rng.normal(size=3)))]
    collision = CollisionModel(arm, around, base)
    q = rng.normal(size=(400, joints))
    states, chosen = rng.integers(0, 400, 900), rng.integers(0, len(collision.labels), 900)
    gaps, slopes = collision.slopes(q, states, chosen, once=True)
    np.testing.assert_allclose(gaps, collision.gaps(q)[states, chosen], atol=1e-12)
    for j, step in enumerate(h * np.eye(joints)):
        ahead, behind = (collision.gaps(q + sign * step)[states, chosen] for sign in (1, -1))
        np.testing.assert_allclose(slopes[:, j], (ahead - behind) / (2 * h), atol=1e-7)
