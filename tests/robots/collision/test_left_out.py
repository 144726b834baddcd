"""Pairs of links that are left out: telescopes, and what convex solids hide of the meshes in them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ocptip.robots.collision.gaps import MEETING, POSTURES, UNSEEN, random_postures
from ocptip.robots.collision.model import ShapeCollisions
from ocptip.robots.collision.shapes import BodyShape, Box
from ocptip.robots.geometry import floor
from ocptip.robots.model import ArmModel
from ocptip.robots.urdf.arm import arm_from_urdf
from ocptip.robots.urdf.collision import geometry_from_urdf
from tests.robots.collision.collision_urdf import write_stl

MOMENTS = 'ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"'
INERTIAL = f'<inertial><mass value="2"/><inertia {MOMENTS}/></inertial>'
LIMIT = '<limit lower="{}" upper="{}" velocity="1" effort="90"/>'


def link(name: str, geometry: str) -> str:
    return f'<link name="{name}">{INERTIAL}<collision><geometry>{geometry}</geometry></collision></link>'


def joint(number: int, kind: str, axis: str, limits: tuple[float, float], at: str = "0 0 0") -> str:
    return (
        f'<joint name="j{number}" type="{kind}"><parent link="l{number - 1}"/><child link="l{number}"/>'
        f'<origin xyz="{at}"/><axis xyz="{axis}"/>{LIMIT.format(*limits)}</joint>'
    )


def read(folder, *parts: str) -> ArmModel:
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="arm">{"".join(parts)}</robot>', encoding="utf-8")
    arm = arm_from_urdf(path)
    return replace(arm, geometry=geometry_from_urdf(path, arm))


def tubes(folder, axis: str = "0 0 1") -> ArmModel:
    """Four boxes of 0.4 m within each other, each 0.3 m out of the one before at most."""
    sizes = (0.2, 0.16, 0.12, 0.08)
    links = [link(f"l{k}", f'<box size="{size} {size} 0.4"/>') for k, size in enumerate(sizes)]
    axes = ["0 0 1", axis, "0 0 -1"]
    joints = [joint(k, "prismatic", own, (0, 0.3) if k < 3 else (-0.3, 0)) for k, own in enumerate(axes, 1)]
    return read(folder, *links, *joints)


def test_tubes_of_a_telescope_are_left_out_and_listed(tmp_path):
    collisions = ShapeCollisions(tubes(tmp_path))
    assert not collisions.pairs
    for pair in ({"l0", "l2"}, {"l1", "l3"}, {"l0", "l3"}):
        why = collisions.apart[frozenset(pair)]
        assert why.startswith("telescope: all joints between them slide along one line (touching in ")


def test_slides_across_and_solids_of_the_base_are_no_telescope(tmp_path):
    across = ShapeCollisions(tubes(tmp_path, axis="0.6 0 0.8"))
    assert {frozenset(str(label).split(" and ")) for label in across.labels} >= {frozenset(("l0", "l2"))}
    arm = tubes(tmp_path)
    base = [BodyShape("deck", 0, Box([1.0, 1.0, 0.1], position=[0, 0, 0.3]))]
    assert {str(label) for label in ShapeCollisions(arm, base=base).labels} == {"l2 and deck", "l3 and deck"}


def prism(corners: np.ndarray, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Walls over a polygon (k, 2), without ends: points (2 k, 3) and triangles (2 k, 3)."""
    k = len(corners)
    points = np.vstack([np.column_stack([corners, np.full(k, z)]) for z in (-height / 2, height / 2)])
    a, b = np.arange(k), np.roll(np.arange(k), -1)
    return points, np.vstack([np.column_stack([a, b, a + k]), np.column_stack([b, b + k, a + k])])


@pytest.mark.parametrize(("width", "reason"), [(0.05, "their meshes never touch"), (0.19, UNSEEN)])
def test_what_turns_within_a_housing_is_judged_on_the_meshes(tmp_path, width, reason):
    """In a tube of four walls, edges towards x and y; the flat one within meets them at some angles."""
    turn = np.pi / 2 * np.arange(4)
    write_stl(tmp_path / "tube.stl", *prism(0.15 * np.column_stack([np.cos(turn), np.sin(turn)]), 0.5))
    housing, inner = '<mesh filename="tube.stl"/>', f'<box size="0.02 {2 * width / 1.5} 0.2"/>'
    arm = read(
        tmp_path,
        link("l0", housing),
        f'<link name="l1">{INERTIAL}</link>',
        link("l2", inner),
        *(joint(k, "revolute", "0 0 1", (-3, 3)) for k in (1, 2)),
    )
    pair = frozenset(("l0", "l2"))
    collisions = ShapeCollisions(arm)
    assert collisions.apart[pair].count(reason) == 1
    q = random_postures(arm, POSTURES).sum(axis=1)
    ends = np.array([[x, y] for x in (-0.01, 0.01) for y in (-width / 1.5, width / 1.5)])
    x = np.abs(np.cos(q)[:, None] * ends[:, 0] - np.sin(q)[:, None] * ends[:, 1])
    y = np.abs(np.sin(q)[:, None] * ends[:, 0] + np.cos(q)[:, None] * ends[:, 1])
    assert arm.geometry.on_meshes[pair] == ((x + y).max(axis=1) > 0.15).sum()  # corners beyond the walls
    with_floor = ShapeCollisions(arm, [floor(-3.0)])
    assert with_floor.to_dict()["unseen"] == ([["l0", "l2"]] if reason == UNSEEN else [])


@pytest.mark.filterwarnings("ignore::ocptip.basics.errors.InputWarning")
@pytest.mark.parametrize(
    ("second_joint", "bar", "left_out"),
    [("0 0 0", 0.19, True), ("0.02 0 0", 0.17, False), ("0 0 0", 0.3, False)],
    ids=["shoulder", "axes that pass", "apart"],
)
def test_links_over_two_joints_whose_axes_meet_may_overlap(tmp_path, second_joint, bar, left_out):
    """A ball beside the first axis, and a bar that begins within it in most postures, but not in all."""
    ball = '<origin xyz="-0.02 0 0"/><geometry><sphere radius="0.045"/></geometry>'
    solid = f'<origin xyz="{bar} 0 0"/><geometry><box size="0.3 0.02 0.02"/></geometry>'
    arm = read(
        tmp_path,
        f'<link name="l0">{INERTIAL}<collision>{ball}</collision></link>',
        f'<link name="l1">{INERTIAL}</link>',
        f'<link name="l2">{INERTIAL}<collision>{solid}</collision></link>',
        joint(1, "revolute", "0 0 1", (-2, 2)),
        joint(2, "revolute", "0 1 0", (-2, 2), second_joint),
    )
    collisions, pair = ShapeCollisions(arm), frozenset(("l0", "l2"))
    assert (pair in collisions.apart) == left_out
    if left_out:
        count = int(collisions.apart[pair].split("touching in ")[1].split()[0])
        assert POSTURES / 2 < count < POSTURES
        assert collisions.apart[pair].startswith(MEETING)
        assert ShapeCollisions(arm, [floor(-3.0)]).to_dict()["unseen"] == [["l0", "l2"]]
