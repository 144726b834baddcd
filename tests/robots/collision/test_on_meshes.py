"""Where convex solids are in the way and the meshes that they enclose are not; by coal on the meshes."""

from __future__ import annotations

import re
from dataclasses import replace

import coal
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from ocptip.basics.errors import InputError
from ocptip.motion.task import refusals
from ocptip.robots.collision.parts import MOST, convex_parts
from ocptip.task_files.motion import load_task
from tests.robots.collision.collision_urdf import box, write_stl

URDF = """<robot name="elbow">
<link name="torso"><collision><geometry><mesh filename="torso.stl"/></geometry></collision></link>
<link name="a"><inertial><origin xyz="0 0 0"/><mass value="3"/>
<inertia ixx="0.05" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.02"/></inertial></link>
<link name="b"><inertial><origin xyz="0 0 -0.2"/><mass value="2"/>
<inertia ixx="0.03" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.01"/></inertial>
<collision><origin xyz="0 0 -0.6"/><geometry><sphere radius="0.02"/></geometry></collision></link>
<link name="tool0"/>
<joint name="j1" type="revolute"><parent link="torso"/><child link="a"/><origin xyz="0.24 0 0.9"/>
<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="60" velocity="2"/></joint>
<joint name="j2" type="revolute"><parent link="a"/><child link="b"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="30" velocity="2"/></joint>
<joint name="t" type="fixed"><parent link="b"/><child link="tool0"/><origin xyz="0 0 -0.6"/></joint>
</robot>
"""
TASK = """[base]
mass = 60.0
center_of_mass = [0.0, 0.0, 0.2]
feet = [[0.5, 0.4, 0.0], [0.5, -0.4, 0.0], [-0.5, -0.4, 0.0], [-0.5, 0.4, 0.0]]
friction = 0.5
[arm]
urdf = "elbow.urdf"
mount_position = [0.0, 0.0, 0.1]
[motors]
kind = "estimated"
[motion]
start_deg = [0, 0]
goal_deg = [30, -40]
"""


def torso():
    """A column on a plinth that stands out by 6 cm: cut off, it saves 7 % of the hull's volume at most."""
    parts = [box((-0.2, -0.2, 0.0), (0.2, 0.2, 1.0)), box((-0.2, -0.2, 0.0), (0.26, 0.2, 0.05))]
    return np.vstack([p for p, _ in parts]), np.vstack([parts[0][1], parts[1][1] + 8])


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "elbow.urdf").write_text(URDF)
    write_stl(tmp_path / "torso.stl", *torso())
    return tmp_path


def load(folder, text=TASK):
    (folder / "task.toml").write_text(text)
    return load_task(folder / "task.toml")


def on_meshes(folder, q):
    """Distance, m, of the ball from the torso's triangles."""
    mesh = coal.MeshLoader().load(str(folder / "torso.stl"))
    turn, lever = np.array([[np.cos(q[0]), -np.sin(q[0])], [np.sin(q[0]), np.cos(q[0])]]), -0.6 * np.sin(q[1])
    x, y = turn @ [lever, 0.0]
    at = np.array([0.24 + x, y, 0.9 - 0.6 * np.cos(q[1])])
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    place = coal.Transform3s(np.eye(3), at)
    return coal.distance(mesh, coal.Transform3s(), coal.Sphere(0.02), place, request, result)


def test_room_beside_a_large_body_is_not_filled(folder):
    points, triangles = torso()
    whole = ConvexHull(points).volume
    parts = convex_parts(points, triangles)
    assert 1 < len(parts) <= MOST
    solid = 0.4 * 0.4 * 1.0 + 0.06 * 0.4 * 0.05
    assert 0.93 * whole < solid  # 7 % of the hull are nowhere to be saved
    task = load(folder)
    assert refusals(task) == ()
    collision, q = task.robot.collision, np.random.default_rng(0).uniform([-1, -1.5], [1, 0.0], (40, 2))
    (label,) = {x for x in map(str, collision.labels) if x == "torso and b"}
    own = [k for k, x in enumerate(collision.labels) if str(x) == label]
    solids = collision.gaps(q)[:, own].min(axis=1)
    meshes = np.array([on_meshes(folder, row) for row in q])
    assert (solids <= meshes + 1e-6).all()  # they enclose
    assert on_meshes(folder, task.start) == pytest.approx(0.02, abs=1e-6)
    assert collision.gaps(task.start)[own].min() > 0.01


@pytest.mark.slow
def test_a_refusal_has_the_distance_of_the_meshes_too(folder):
    elsewhere = TASK.replace("start_deg = [0, 0]", "start_deg = [0, -80]")
    coarse = load(folder, elsewhere.replace("mount", "mesh_parts = 1\nmount", 1))
    (reason,) = refusals(replace(coarse, start=np.zeros(2)))
    found = re.search(
        r"start: collision: torso and b overlap by (\S+) mm \(the surfaces of their meshes: (\S+) mm apart\)",
        reason,
    )
    hull = coal.StdVec_Vec3s()
    for point in torso()[0]:
        hull.append(point)
    solid = coal.Convex.convexHull(hull, True, "Qt")
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.enable_signed_distance = True
    place = coal.Transform3s(np.eye(3), np.array([0.24, 0.0, 0.3]))
    depth = coal.distance(solid, coal.Transform3s(), coal.Sphere(0.02), place, request, result)
    assert float(found[1]) == pytest.approx(-1e3 * depth, abs=0.06)
    assert float(found[2]) == pytest.approx(20.0, abs=0.06)
    assert "mesh_parts = 16 or more in [arm]" in reason
    finer = load(folder, elsewhere.replace("mount", "mesh_parts = 16\nmount", 1))
    assert refusals(replace(finer, start=np.zeros(2))) == ()
    with pytest.raises(InputError, match=r"arm\.mesh_parts"):
        load(folder, TASK.replace("mount", "mesh_parts = 0\nmount", 1))


def test_nearer_than_asked_for_is_said_of_both_and_touching_meshes_need_no_more_parts(folder):
    near = load(folder, f"{TASK}[limits]\nclearance = 0.05\n")
    (reason,) = refusals(near)
    assert re.search(
        r"torso and b are \S+ mm apart \(the surfaces of their meshes: 20.0 mm apart\), must", reason
    )
    assert "mesh_parts" not in reason  # the meshes are too near as well


def grooved():
    """A column with a groove across its front, 6 cm high and 4 cm deep, half way up; its parts overlap."""
    bars = [((-0.2, 0.0), 0.47), ((-0.2, 0.53), 1.0)]
    parts = [box((-0.2, low[0], low[1]), (0.2, 0.2, high)) for low, high in bars]
    parts += [box((-0.2, -0.2, 0.0), (0.2, 0.2, 0.47)), box((-0.2, -0.2, 0.53), (0.2, 0.2, 1.0))]
    parts.append(box((-0.2, -0.2, 0.0), (0.16, 0.2, 1.0)))
    starts = np.cumsum([0, *(len(points) for points, _ in parts)])
    return np.vstack([p for p, _ in parts]), np.vstack(
        [t + s for (_, t), s in zip(parts, starts, strict=False)]
    )


@pytest.mark.slow
def test_a_start_within_a_groove_gets_more_solids(folder):
    """No single cut opens the groove, so few solids span it; those of the task's start do not."""
    write_stl(folder / "torso.stl", *grooved())
    urdf = URDF.replace("0.24 0 0.9", "0.186 0 1.1").replace('radius="0.02"', 'radius="0.012"')
    (folder / "elbow.urdf").write_text(urdf)
    task = load(folder)
    plain = load(folder, TASK.replace("start_deg = [0, 0]", "start_deg = [0, -80]"))
    (label,) = {x for x in plain.robot.collision.labels if str(x) == "torso and b"}
    apart = plain.robot.collision.on_meshes(task.start, label)
    assert 0.01 < apart < 0.02
    assert plain.robot.collision.worst(task.start[None])[0] < -0.01
    assert refusals(task) == ()
    assert 0.01 <= task.robot.collision.worst(task.start[None])[0] <= apart + 1e-6
    assert any(re.search(r"^convex solids .*: \d for torso$", note) for note in task.robot.notes)
    assert not any("convex solids" in note for note in plain.robot.notes)
    points = np.array(grooved()[0])
    triangles = grooved()[1]
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.ones(3), len(triangles) * 20)
    surface = np.einsum("sk,skx->sx", weights, points[np.repeat(triangles, 20, axis=0)])
    inside = np.zeros(len(surface), dtype=bool)
    for part in convex_parts(points, triangles, 32):
        faces = ConvexHull(part).equations
        inside |= (surface @ faces[:, :3].T + faces[:, 3] <= 1e-7).all(axis=1)
    assert inside.all()
