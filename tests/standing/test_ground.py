"""The floor that a base stands on: planes by hand, distances by MuJoCo and by Pinocchio, verdicts, proofs."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError
from ocptip.certificate.checks import certified
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.motion.check import NO_FLOOR, check_motion
from ocptip.motion.task import refusals, require_plannable
from ocptip.published.tasks import experiment_task
from ocptip.robots.geometry import Wall, floor
from ocptip.standing.ground import floors_under
from ocptip.task_files.motion import load_task
from ocptip.task_files.placement import load_placement
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from tests.quick import examples

pin = pytest.importorskip("pinocchio")
SEEDS = st.integers(0, 10**6)

URDF = """<robot name="two_bars">
<link name="base"><collision><geometry><box size="0.2 0.2 0.6"/></geometry></collision></link>
<link name="a"><inertial><origin xyz="0 0 0.2"/><mass value="3"/>
<inertia ixx="0.05" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.02"/></inertial>
<collision><origin xyz="0 0 0.2"/><geometry><box size="0.06 0.06 0.3"/></geometry></collision></link>
<link name="b"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
<inertia ixx="0.03" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.01"/></inertial>
<collision><origin xyz="0 0 0.25"/><geometry><box size="0.05 0.05 0.3"/></geometry></collision></link>
<link name="tool0"><collision><geometry><sphere radius="0.04"/></geometry></collision></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0 0 -0.15"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="60" velocity="2"/></joint>
<joint name="j2" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 0.4"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="30" velocity="2"/></joint>
<joint name="t" type="fixed"><parent link="b"/><child link="tool0"/><origin xyz="0 0 0.45"/></joint>
</robot>
"""
BASE = """[base]
mass = 60.0
center_of_mass = [0.0, 0.0, 0.2]
feet = [[0.5, 0.4, 0.0], [0.5, -0.4, 0.0], [-0.5, -0.4, 0.0], [-0.5, 0.4, 0.0]]
friction = 0.5
"""
TASK = f"""{BASE}[arm]
urdf = "bars.urdf"
mount_position = [0.0, 0.0, 0.3]
[motors]
kind = "estimated"
[motion]
start_deg = [60, 40]
goal_deg = [60, 110]
"""
DOWN = np.deg2rad([[60.0, 40.0], [60.0, 110.0]])


def support(places, normals, **arguments):
    """On contacts at these places, with these normals."""
    pairs = zip(places, normals, strict=True)
    contacts = [UnilateralContact(position=p, normal=n, friction=0.5) for p, n in pairs]
    return Support(contacts, mass=10.0, center_of_mass=[0.0, 0.0, 1.0], **arguments)


def above(found, points):
    """(N,) heights, m, of points (N, 3) above the highest of floors."""
    return np.min([f.distance - points @ f.normal for f in found], axis=0)


@examples(30)
@given(SEEDS)
def test_contacts_in_a_plane_have_that_floor(seed):
    rng = np.random.default_rng(seed)
    turn = Rotation.from_rotvec(0.3 * rng.normal(size=3)).as_matrix()
    assume(turn[2, 2] >= 0.5)  # steeper than 60 degrees it is a wall, no floor
    flat = np.column_stack([rng.uniform(-1, 1, (5, 2)), np.zeros(5)])
    places = flat @ turn.T + rng.normal(size=3)
    found = floors_under(support(places, np.tile(turn[:, 2], (5, 1))))
    assert [f.name for f in found] == ["floor"]
    points = rng.normal(size=(20, 3))
    heights = (points - places[0]) @ np.cross(places[1] - places[0], places[2] - places[0])
    across = np.cross(places[1] - places[0], places[2] - places[0])
    heights *= np.sign(across @ turn[:, 2]) / np.linalg.norm(across)
    np.testing.assert_allclose(above(found, points), heights, atol=1e-9)


@examples(30)
@given(SEEDS)
def test_uneven_contacts_have_the_highest_of_their_planes(seed):
    """Nothing that is free lies below a contact's tangent plane, and what lies above all of them is free."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 7))
    places = np.column_stack([rng.uniform(-1, 1, (count, 2)), 0.1 * rng.uniform(-1, 1, count)])
    normals = np.column_stack([0.2 * rng.normal(size=(count, 2)), np.ones(count)])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    points = rng.normal(size=(200, 3))
    tangent = np.min([(points - p) @ n for p, n in zip(places, normals, strict=True)], axis=0)
    if count == 3:  # three contacts are always in one plane
        across = np.cross(places[1] - places[0], places[2] - places[0])
        across *= np.sign(across[2]) / np.linalg.norm(across)
        tangent = np.minimum(tangent, (points - places[0]) @ across)
    np.testing.assert_allclose(above(floors_under(support(places, normals)), points), tangent, atol=1e-9)


def test_steps_have_the_highest_as_floor_and_walls_are_none():
    places, up = [[0.5, 0.4, 0.0], [0.5, -0.4, 0.1], [-0.5, -0.4, 0.02], [-0.5, 0.4, 0.0]], [0.0, 0.0, 1.0]
    (found,) = floors_under(support(places, [up] * 4))
    assert (found.name, *found.normal, found.distance) == ("floor", 0.0, 0.0, -1.0, pytest.approx(-0.1))
    leaning = support([*places, [1.0, 0.0, 0.9]], [*[up] * 4, [-1.0, 0.0, 0.0]])
    assert above(floors_under(leaning), np.array([[3.0, 0, 0.2]])) == pytest.approx(0.1)
    hanging = support(places, [[0.0, 1.0, 0.0]] * 4)
    assert floors_under(hanging) == ()
    assert floors_under(support(places, [up] * 4, gravity=[0.0, 9.81, 0.0])) == ()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("floor")
    (path / "bars.urdf").write_text(URDF)
    return path


def written(folder, text, name="task.toml"):
    (folder / name).write_text(text)
    return folder / name


@pytest.fixture(scope="module")
def task(folder):
    return load_task(written(folder, TASK))


def floor_gaps(robot, q):
    """(N,), m: smallest distances of what moves from the floor."""
    own = [k for k, label in enumerate(robot.collision.labels) if label.second == "floor"]
    assert {robot.collision.labels[k].first for k in own} == {"a", "b", "tool0"}  # the base stands on it
    return robot.collision.gaps(q)[:, own].min(axis=1)


def test_distances_from_the_floor_are_those_of_mujoco_and_pinocchio(task, folder):
    q = np.random.default_rng(0).uniform(-2.5, 2.5, (60, 2))
    found = floor_gaps(task.robot, q)
    model = pin.buildModelFromUrdf(str(folder / "bars.urdf"))
    geometry = pin.buildGeomFromUrdf(model, str(folder / "bars.urdf"), pin.GeometryType.COLLISION)
    data, of_geometry = model.createData(), geometry.createData()
    corners = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
    spec = mujoco.MjSpec.from_file(str(folder / "bars.urdf"))
    plane = {"type": mujoco.mjtGeom.mjGEOM_PLANE, "size": [5, 5, 0.1], "pos": [0, 0, -0.3]}
    spec.worldbody.add_geom(name="floor", margin=2.0, **plane)
    mj = spec.compile()
    ground = mj.geom("floor").id
    state, lowest, by_mujoco = mujoco.MjData(mj), [], []
    for row in q:
        pin.updateGeometryPlacements(model, data, geometry, of_geometry, row)
        heights = []
        for item, pose in zip(geometry.geometryObjects, of_geometry.oMg, strict=True):
            if item.parentJoint:
                own = item.geometry
                ball = hasattr(own, "radius")
                low = pose.translation[2] - own.radius if ball else (
                    pose.translation + corners * own.halfSide @ pose.rotation.T
                )[:, 2].min()  # fmt: skip
                heights.append(low + 0.3)  # of the mount above the floor
        lowest.append(min(heights))
        state.qpos[:] = row
        mujoco.mj_forward(mj, state)
        near = [c.dist for c in state.contact if ground in c.geom]
        by_mujoco.append(min(near))
    np.testing.assert_allclose(found, lowest, atol=1e-9)
    np.testing.assert_allclose(found, by_mujoco, atol=1e-9)


def dipping(task, lowest):
    """A motion whose second joint ends where the tool is so high, m, above the floor."""
    angles = np.linspace(DOWN[0, 1], DOWN[1, 1] + 1.0, 20_001)
    heights = floor_gaps(task.robot, np.column_stack([np.full_like(angles, DOWN[0, 0]), angles]))
    end = angles[np.flatnonzero(heights < lowest)[0]]
    limits = task.robot.limits
    commands = [None, [RampCommand(float(end), 0.5, 1.0)]]
    return Trajectory.ending_together(DOWN[0], [DOWN[0, 0], end], commands, limits.speed, limits.acceleration)


def test_a_motion_into_the_floor_is_refused_and_not_proved(task, folder):
    assert task.limits.clearance == 0.01
    below = dipping(task, -0.093)
    reasons = refusals(replace(task, start=below.start, goal=below.goal))
    (reason,) = (r for r in reasons if "floor" in r)
    assert "tool0 and floor overlap by 93.0 mm" in reason
    assert "floor = false in [base]" in reason
    checked = check_motion(task.robot, below, task.limits)
    assert not checked.verified
    assert checked.worst["clearance_m"].value == pytest.approx(-0.093, abs=1e-4)
    assert not certified(task.robot, below, checked, task.limits).certified
    free = load_task(written(folder, TASK.replace("[arm]", "floor = false\n[arm]"), "free.toml"))
    unseen = certified(free.robot, below, check_motion(free.robot, below, free.limits), free.limits)
    assert unseen.certified
    assert unseen.headline == f"PROVED for the nominal model only (no uncertainty){NO_FLOOR}"
    assert "; no floor" in unseen.collision_text
    assert json.loads(json.dumps(unseen.to_dict()))["collision"]["floor"] == []


def test_a_proof_covers_the_floor(task):
    near = dipping(task, 0.03)
    proved = certified(task.robot, near, check_motion(task.robot, near, task.limits), task.limits)
    assert proved.certified
    assert proved.headline == "PROVED for the nominal model only (no uncertainty)"
    assert 0.029 < proved.certificate.verdict.bounds["clearance"] <= 0.03
    assert "floor at z = 0.000 m" in proved.collision_text
    (plane,) = proved.to_dict()["collision"]["floor"]
    assert plane == {"name": "floor", "normal": [0.0, 0.0, 1.0], "level_m": 0.0}


def test_start_and_goal_are_refused_in_one_line_before_contacts_are_solved(task, monkeypatch):
    monkeypatch.setattr("ocptip.motion.task.refusals", None)  # solves contacts
    both = replace(task, start=dipping(task, -0.093).goal, goal=dipping(task, 0.004).goal)
    with pytest.raises(InputError) as raised:
        require_plannable(both)
    reason = str(raised.value)
    assert re.search(r"start: collision: .*tool0 and floor overlap by 93.0 mm", reason)
    assert re.search(r"goal: .*tool0 and floor are 4.0 mm apart, must be >= 10.0 mm; for less give", reason)
    assert reason.endswith('excluded_links = [["tool0", "floor"], ["b", "floor"]] in [arm]')
    assert reason.count("floor = false in [base]") == 1
    out = replace(both, goal=both.goal + 10.0)
    with pytest.raises(InputError, match=r"start: collision: .*; goal: j1 at"):
        require_plannable(out)


def test_nearer_than_10_mm_is_refused_with_the_key(task, folder):
    near = dipping(task, 0.004)
    reasons = refusals(replace(task, start=near.start, goal=near.goal))
    (reason,) = (r for r in reasons if "floor" in r)
    assert "goal: tool0 and floor are 4.0 mm apart, must be >= 10.0 mm; for less give clearance in" in reason
    closer = load_task(written(folder, f"{TASK}[limits]\nclearance = 0.003\n", "closer.toml"))
    assert not refusals(replace(closer, start=near.start, goal=near.goal))


def test_a_floor_of_the_file_replaces_that_of_the_contacts(task, folder):
    lower = '[[obstacle]]\nkind = "floor"\nheight = -0.7\n'
    pit = load_task(written(folder, TASK + lower, "pit.toml"))
    q = np.random.default_rng(1).uniform(-2, 2, (20, 2))
    np.testing.assert_allclose(floor_gaps(pit.robot, q), floor_gaps(task.robot, q) + 0.7, atol=1e-9)
    wall = task.robot.varied(obstacles=[Wall(np.array([1.0, 0, 0]), 2.0)])
    np.testing.assert_array_equal(floor_gaps(wall, q), floor_gaps(task.robot, q))
    assert task.robot.varied(obstacles=[floor(-1.0)]).around[0].distance == 1.0
    apart = TASK.replace("mount_position", 'excluded_links = [["tool0", "floor"]]\nmount_position')
    meant = load_task(written(folder, apart, "meant.toml")).robot.collision
    assert {label.first for label in meant.labels if label.second == "floor"} == {"a", "b"}
    assert {"pair": ["floor", "tool0"], "reason": "excluded"} in meant.to_dict()["left_out"]
    wrong = TASK.replace("mount_position", 'excluded_links = [["floor", "floor"]]\nmount_position')
    with pytest.raises(InputError, match=r"excluded_links: expected two of the links .*, or one and 'floor'"):
        load_task(written(folder, wrong, "wrong.toml"))
    with pytest.raises(InputError, match=r"base\.floor: expected true or false"):
        load_task(written(folder, TASK.replace("[arm]", "floor = 0.1\n[arm]"), "number.toml"))


def test_links_that_cannot_part_lower_the_default(folder):
    """A link that turns 4 mm above the floor wherever it stands: half of that is asked for, and said."""
    low = URDF.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 0 1"/>').replace("0 0 -0.15", "0.3 0 -0.241")
    (folder / "low.urdf").write_text(low.replace('"0.06 0.06 0.3"', '"0.06 0.06 0.51"'))
    task = load_task(written(folder, TASK.replace("bars", "low"), "low.toml"))
    assert floor_gaps(task.robot, np.zeros((1, 2)))[0] == pytest.approx(0.004, abs=1e-9)
    assert task.limits.clearance == pytest.approx(0.002, abs=1e-9)
    assert any("a and floor are never farther apart than 4.0 mm" in note for note in task.robot.notes)
    asked = load_task(written(folder, f"{TASK.replace('bars', 'low')}[limits]\nclearance = 0.01\n", "a.toml"))
    assert asked.limits.clearance == 0.01


def test_placements_have_the_floor_and_say_where_they_have_none(folder):
    pose = "[[task]]\nposition = [1.0, 0.0, {}]\norientation = 'free'\n"
    text = TASK[: TASK.index("[motion]")] + "{}" + pose
    limits = "[[terrain]]\nx = [-1.0, 3.0]\ny = [-1.0, 1.0]\n"
    problem = load_placement(written(folder, text.format(limits, 0.4), "place.toml")).problem
    assert problem.limits.clearance == 0.01
    assert [plane["name"] for plane in problem.collision["floor"]] == ["floor"]
    (folder / "off.toml").write_text(text.format(limits, 0.4).replace("[arm]", "floor = false\n[arm]"))
    assert load_placement(folder / "off.toml").problem.collision["floor"] == []


def test_printed_cases_keep_the_floor_and_the_distance_of_their_source():
    task = experiment_task("A")
    assert task.limits.clearance == 0.0
    assert [(f.name, f.distance) for f in task.robot.around] == [("floor", 0.14)]
    checked = check_motion(task.robot, task.reference, task.limits)
    assert checked.worst["clearance_m"].limit == 0.0
