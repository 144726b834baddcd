"""Task files with collision geometry: what is read, refused, refuted and said."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.motion.check import NO_PAYLOAD, check_motion, scope_of
from ocptip.motion.plan import plan_motion
from ocptip.motion.task import refusals
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.search.physics import PatchPhysics
from ocptip.robots.geometry import Solid
from ocptip.robots.payload import Payload
from ocptip.task_files.motion import load_task
from ocptip.task_files.placement import load_placement
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from tests.places import EXAMPLES
from tests.robots.collision.collision_urdf import box, with_collision, write_stl

pin = pytest.importorskip("pinocchio")

DECK = """[[base.shape]]
kind = "box"
name = "deck"
size = [0.7, 0.6, 0.1]
position = [0.0, 0.0, 0.69]

[[contact]]"""
CART = (EXAMPLES / "tasks/ur5_cart.toml").read_text(encoding="utf-8")
CART = re.sub(r"sphere_radius.*\n", "", CART).replace("[[contact]]", DECK, 1)
HELD = '[payload]\nmass = 1.0\n[payload.shape]\nkind = "sphere"\n'
BLIND = "collision = false\n[arm.limits]"
FLOOR = re.search(r"\[\[obstacle\]\][^\[]*", CART)[0]
WALL = (EXAMPLES / "tasks/place_ur5_wall.toml").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("cart")
    with_collision(path)
    write_stl(path / "bench.stl", *box((0.0, 0.0, 0.0), (100.0, 50.0, 20.0)))
    return path


def written(folder, text, name="task.toml"):
    path = folder / name
    path.write_text(text.replace('"ur5.urdf"', '"ur5_with_collision.urdf"'), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def task(folder):
    return load_task(written(folder, CART.replace(FLOOR, "")))


def through_the_deck(task):
    """The elbow goes below the deck and comes up on the other side."""
    start = np.deg2rad([90.0, -60, 60, -90, -90, 0])
    goal = np.deg2rad([90.0, 30.0, 60.0, -90, -90, 0])
    return start, goal


def test_an_elbow_through_the_deck_is_refused_and_refuted(task):
    start, goal = through_the_deck(task)
    reasons = refusals(replace(task, start=start, goal=goal, targets=(None, None)))
    assert any(
        re.match(r"goal: collision: (upper_arm|forearm)_link and deck overlap by \d+", r) for r in reasons
    )
    limits = task.robot.limits
    commands = [None] * 6
    commands[1] = [RampCommand(goal[1], 0.5, 1.0)]
    motion = Trajectory.ending_together(start, goal, commands, limits.speed, limits.acceleration)
    checked = check_motion(task.robot, motion, task.limits)
    assert not checked.verified
    worst = checked.worst["clearance_m"]
    assert worst.value < -0.005
    assert re.fullmatch(r"\w+_link and deck", worst.detail)
    assert any(v.name == "clearance_m" and v.value < 0 and "and deck" in v.detail for v in checked.violations)
    least = checked.collision["least"]
    assert least["distance_m"] == pytest.approx(worst.value, abs=1e-9)
    gap = np.subtract(*least["points_m"])
    assert np.linalg.norm(gap) == pytest.approx(-worst.value, abs=1e-5)
    assert json.dumps(checked.to_dict())


def test_start_and_goal_are_free_and_say_what_is_checked(task):
    assert refusals(task) == ()
    data = task.robot.collision.to_dict(task.start)
    assert data["checked"]
    assert data["source"] == "collision geometry of ur5_with_collision.urdf"
    assert data["payload_unseen"] == (task.robot.payload is not None) == bool(scope_of(data))
    arm = task.robot.arm.with_payload(Payload(1.0, np.zeros(3)))
    data = task.robot.varied(arm=arm).collision.to_dict()
    assert scope_of(data) == NO_PAYLOAD
    assert data["pairs"] == len(task.robot.collision.labels) > 10
    assert {"pair": ["forearm_link", "upper_arm_link"], "reason": "neighbours"} in data["left_out"]


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("[0.7, 0.6, 0.1]", "[0.7, -0.6, 0.1]", r"base.shape\[1\].size: must be > 0"),
        (
            'kind = "box"',
            'kind = "bax"',
            r"base.shape\[1\].kind: expected one of box, cylinder, sphere, mesh",
        ),
        ('name = "deck"', "radius = 1", r"base.shape\[1\].radius: unknown key"),
        (FLOOR, '[[obstacle]]\nkind = "mesh"\nfile = "no.stl"\n', "obstacle.*: .*no.stl: no such file"),
        (FLOOR, '[[obstacle]]\nkind = "cylinder"\nradius = 0.1\n', "obstacle.*length: missing"),
        (
            FLOOR,
            f"{HELD}radius = 0\n",
            "payload.shape.radius: must be > 0",
        ),
        ("[arm.limits]", 'srdf = "no.srdf"\n[arm.limits]', "arm.srdf: .*not a readable SRDF"),
        ("[arm.limits]", "package_dirs = 3\n[arm.limits]", "arm.package_dirs: expected folders, got 3"),
        (
            "[arm.limits]",
            'excluded_links = [["a", "b"]]\n[arm.limits]',
            "arm.excluded_links: expected two of",
        ),
        (
            "[arm.limits]",
            "collision = false\n[arm.limits]",
            r"base\.shape: the arm has no collision geometry",
        ),
    ],
)
def test_mistakes_in_one_line(folder, old, new, problem):
    assert old in CART
    with pytest.raises(InputError, match=problem) as error:
        load_task(written(folder, CART.replace(old, new), "wrong.toml"))
    assert "\n" not in str(error.value)


def test_shapes_and_obstacles_of_a_file(folder):
    bench = '[[obstacle]]\nkind = "mesh"\nname = "bench"\nfile = "bench.stl"\nscale = [0.01, 0.01, 0.01]\n'
    bench += f"position = [1.0, 0.0, 0.0]\nrpy_deg = [0, 0, 90]\n{HELD}radius = 0.05\n"
    bench += 'position = [0.0, 0.0, 0.2]\n[[obstacle]]\nkind = "cylinder"\nradius = 0.1\nlength = 1.0\n'
    task = load_task(written(folder, CART.replace(FLOOR, bench), "shapes.toml"))
    mesh, cylinder = task.robot.obstacles
    assert isinstance(mesh, Solid)
    corners = mesh.shape.outline()
    np.testing.assert_allclose(
        [corners.min(axis=0), corners.max(axis=0)], [[0.5, 0, 0], [1.0, 1.0, 0.2]], atol=1e-9
    )
    assert cylinder.name == "cylinder"
    names = {str(label) for label in task.robot.collision.labels}
    assert {"payload and bench", "wrist_2_link and payload", "forearm_link and cylinder"} <= names
    held = next(s for s in task.robot.arm.geometry.shapes if s.name == "payload")
    np.testing.assert_allclose(
        held.shape.position,
        task.robot.arm.offsets[-1] + task.robot.arm.tool_rotation @ [0, 0, 0.2],
        atol=1e-12,
    )


def test_without_geometry_the_verdict_says_so(folder):
    text = CART.replace(FLOOR, "").replace(DECK, "[[contact]]").replace("[arm.limits]", BLIND)
    blind = load_task(written(folder, text, "blind.toml"))
    start, goal = through_the_deck(blind)
    limits = blind.robot.limits
    motion = Trajectory.ending_together(start, start, [None] * 6, limits.speed, limits.acceleration)
    checked = check_motion(blind.robot, motion, blind.limits)
    assert checked.collision == {"checked": False}
    assert checked.scope == " (contacts and drives; collision not checked)"
    assert checked.collision_text == "not checked: no collision geometry"
    del goal


@pytest.mark.slow
def test_a_plan_keeps_clear_by_an_independent_check(task, folder):
    """In steps of 1 ms, by Pinocchio on the file's own meshes and coal's box."""
    plan = plan_motion(task, starts=1, jobs=1)
    assert plan.verified
    file = folder / "ur5_with_collision.urdf"
    robot = pin.buildModelFromUrdf(str(file))
    geometry = pin.buildGeomFromUrdf(robot, str(file), pin.GeometryType.COLLISION, package_dirs=[str(folder)])
    import coal

    deck = pin.GeometryObject(
        "deck", 0, 0, pin.SE3(np.eye(3), np.array([0.0, 0, 0.69 - 0.75])), coal.Box(0.7, 0.6, 0.1)
    )
    geometry.addGeometryObject(deck)
    items = list(geometry.geometryObjects)
    for a, first in enumerate(items):
        for b in range(a + 1, len(items)):
            apart = abs(first.parentJoint - items[b].parentJoint) > 1
            if apart and {first.parentJoint, items[b].parentJoint} != {0, 1}:
                geometry.addCollisionPair(pin.CollisionPair(a, b))
    data, of_geometry = robot.createData(), geometry.createData()
    angles = plan.motion.states(np.arange(0, plan.duration, 1e-3))[0]
    least = np.inf
    for q in angles:
        assert not pin.computeCollisions(robot, data, geometry, of_geometry, q, True)
        pin.computeDistances(robot, data, geometry, of_geometry, q)
        least = min(least, *(d.min_distance for d in of_geometry.distanceResults))
    assert least >= task.limits.clearance - 1e-6
    assert plan.check.worst["clearance_m"].value <= least + 1.5e-3  # ours enclose


def placement_task(folder):
    bench = (
        '[[obstacle]]\nkind = "box"\nname = "bench"\nsize = [0.4, 0.6, 1.0]\nposition = [1.4, -0.5, 0.5]\n'
    )
    cart = '[[base.shape]]\nkind = "box"\nname = "cart"\nsize = [0.6, 0.5, 0.5]\nposition = [0.0, 0.0, 0.4]\n'
    text = re.sub(r"sphere_radius.*\n|shape = \[[^\n]*\n(    \{.*\n)*\]\n", "", WALL)
    text = text.replace("[[keep_out]]", bench + "\n[[keep_out]]", 1)
    return load_placement(
        written(folder, text.replace("[[contact]]", cart + "\n[[contact]]", 1), "place.toml")
    )


@pytest.mark.slow
def test_placements_judge_and_program_agree(folder):
    problem = placement_task(folder).problem
    evaluator, rng = Evaluator(problem), np.random.default_rng(1)
    physics = PatchPhysics(evaluator, 0)
    p = np.array([1.0, 0.1, 0.4])[: physics.k]
    q = np.array([0.3, -1.0, 1.2, -1.0, -1.2, 0.4])
    rows = [r for r in evaluator.task(0, 0, p[None], q[None], contacts=False).rows if r.kind == "clearance"]
    judged = dict(zip(rows[0].labels, rows[0].margins[0], strict=True))
    names = [label.name for label in physics.gaps.labels]
    assert {
        "forearm_link and bench",
        "cart and bench",
        "cart and cable strip",
        "forearm_link and column",
    } <= set(names)
    y = np.concatenate([p, q])
    values, slopes = physics.gaps.jacobian(y)
    np.testing.assert_allclose(values, physics.gaps.values(y), atol=1e-9)
    for name in set(names):
        least = min(v for v, other in zip(values, names, strict=True) if other == name)
        if least < 1.0:
            assert judged[name] == pytest.approx(least, abs=1e-6)
    lam, h = rng.uniform(0.1, 1, len(values)) * (values > 0.3), 1e-6
    ends = [[physics.gaps.jacobian(y + s * h * e) for s in (1, -1)] for e in np.eye(len(y))]
    changes = np.array([(up[0] - down[0]) / (2 * h) for up, down in ends]).T
    clear = values > 0.3
    np.testing.assert_allclose(changes[clear], slopes[clear], atol=1e-5)
    bends = np.array([(up[1] - down[1]).T @ lam / (2 * h) for up, down in ends])
    np.testing.assert_allclose(bends, physics.gaps.hessian(y, lam), atol=1e-2 * np.abs(bends).max())
