"""Collision geometry of URDFs against Pinocchio, meshes against their parts, pairs that are left out."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from ocptip.basics.errors import InputError
from ocptip.robots.collision.model import ShapeCollisions, link_frames_function
from ocptip.robots.collision.parts import MOST, convex_parts
from ocptip.robots.collision.shapes import ArmGeometry, Ball, BodyShape, Box, Capsule
from ocptip.robots.geometry import CollisionModel, Pillar, Solid, Wall, floor, spheres_along_links
from ocptip.robots.urdf.arm import arm_from_urdf
from ocptip.robots.urdf.collision import geometry_from_urdf, missing_meshes
from tests.places import UR5
from tests.quick import examples
from tests.robots.collision.collision_urdf import box, elbow, with_collision

pin = pytest.importorskip("pinocchio")
ENDS = {"base_link": "base_link", "tool_frame": "tool0"}


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    path = with_collision(tmp_path_factory.mktemp("arm"))
    arm = arm_from_urdf(path, **ENDS)
    geometry = geometry_from_urdf(path, arm)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    return path, replace(arm, geometry=geometry).mounted([0.1, 0.2, 0.7], turn)


def test_distances_are_those_of_pinocchio(arm):
    """Of the parts that are convex in the file."""
    path, model = arm
    robot = pin.buildModelFromUrdf(str(path))
    geometry = pin.buildGeomFromUrdf(
        robot, str(path), pin.GeometryType.COLLISION, package_dirs=[str(path.parent)]
    )
    convex = [i for i, g in enumerate(geometry.geometryObjects) if not g.meshPath.endswith(".stl")]
    names = [robot.frames[g.parentFrame].name for g in geometry.geometryObjects]
    for a in convex:
        for b in convex:
            if a < b:
                geometry.addCollisionPair(pin.CollisionPair(a, b))
    data, of_geometry = robot.createData(), geometry.createData()
    collision, rng = ShapeCollisions(model), np.random.default_rng(3)
    by_name = {frozenset((x.first, x.second)): k for k, x in enumerate(collision.labels)}
    compared = 0
    for q in rng.uniform(-2, 2, (20, 6)):
        gaps = collision.gaps(q)
        pin.computeDistances(robot, data, geometry, of_geometry, q)
        for pair, result in zip(geometry.collisionPairs, of_geometry.distanceResults, strict=True):
            label = frozenset((names[pair.first], names[pair.second]))
            if label in by_name and result.min_distance > 0:
                # our cylinders are prisms about those of the file
                assert result.min_distance - 1.2e-3 <= gaps[by_name[label]] <= result.min_distance + 2e-6
                compared += 1
    assert compared > 30


def test_all_solids_contain_their_meshes(arm):
    path, model = arm
    q = np.zeros(6)
    robot = pin.buildModelFromUrdf(str(path))
    data = robot.createData()
    pin.framesForwardKinematics(robot, data, q)
    frames = np.array(link_frames_function(model)(q)).reshape(-1, 12)
    for link, length, beside in (("upper_arm_link", 0.425, 0.12), ("forearm_link", 0.392, -0.01)):
        pose = data.oMf[robot.getFrameId(link)]
        points = elbow(length, beside)[0] @ pose.rotation.T + pose.translation
        points = points @ np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]).T + [0.1, 0.2, 0.7]
        own = [s for s in model.geometry.shapes if s.name == link]
        assert 1 < len(own) <= MOST
        inside = np.zeros(len(points), dtype=bool)
        for s in own:
            turn, origin = frames[s.body - 1, :9].reshape(3, 3), frames[s.body - 1, 9:]
            faces = ConvexHull(origin + s.shape.outline() @ turn.T).equations
            inside |= (points @ faces[:, :3].T + faces[:, 3] <= 1e-6).all(axis=1)
        assert inside.all()


@examples(10)
@given(seed=st.integers(0, 10**6))
def test_parts_contain_the_body_and_less_than_its_hull(seed):
    rng = np.random.default_rng(seed)
    points, triangles = elbow(rng.uniform(0.3, 0.6), 0.0)
    points = points * rng.uniform(0.5, 2.0, 3)
    solids = [points[i : i + 8] for i in (0, 8, 16)]
    parts = convex_parts(points, triangles)
    for solid in solids:
        low, high = solid.min(axis=0), solid.max(axis=0)
        samples = rng.uniform(low, high, (300, 3))
        inside = np.zeros(len(samples), dtype=bool)
        for part in parts:
            faces = ConvexHull(part).equations
            inside |= (samples @ faces[:, :3].T + faces[:, 3] <= 1e-9).all(axis=1)
        assert inside.all()
    volumes = [ConvexHull(part).volume for part in parts]
    assert sum(volumes) < 0.95 * ConvexHull(points).volume


def test_a_convex_mesh_stays_whole():
    points, triangles = box((0.0, 0, 0), (1.0, 2, 3))
    assert len(convex_parts(points, triangles)) == 1


def test_meshes_are_found_or_named(tmp_path, monkeypatch):
    path = with_collision(tmp_path, meshes="package://my_arm/links")
    arm = arm_from_urdf(path, **ENDS)

    def read(**options):
        return geometry_from_urdf(path, arm, **options)

    with pytest.raises(
        InputError, match=r"no mesh file 'package://my_arm/links/upper_arm_link.stl'"
    ) as error:
        read()
    assert "package_dirs" in str(error.value)
    assert "collision = false" in str(error.value)
    assert "\n" not in str(error.value)
    assert missing_meshes(path) == [
        f"package://my_arm/links/{name}_link.stl" for name in ("upper_arm", "forearm")
    ]
    (tmp_path / "arm_meshes").rename(tmp_path / "my_arm")
    above = tmp_path / "ws"
    above.mkdir()
    (tmp_path / "my_arm").rename(above / "my_arm")
    for folders in ([above], [above / "my_arm"]):
        assert len(read(package_dirs=folders).shapes) > 6
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"/nowhere:{above}")
    assert len(read().shapes) > 6
    monkeypatch.delenv("ROS_PACKAGE_PATH")
    (tmp_path / "install" / "share").mkdir(parents=True)
    (above / "my_arm").rename(tmp_path / "install" / "share" / "my_arm")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "install"))
    assert len(read().shapes) > 6
    here = tmp_path / "install/share/my_arm/links/forearm_link.stl"
    text = path.read_text().replace("package://my_arm/links/forearm", str(here.parent) + "/forearm")
    path.write_text(text)
    assert len(read().shapes) > 6
    path.write_text(text.replace("package://my_arm/links/upper_arm_link.stl", "x.stl"))
    with pytest.raises(InputError, match=r"no mesh file 'x\.stl'; names are relative to"):
        read()
    assert missing_meshes(path) == ["x.stl"]
    assert missing_meshes(UR5) is None


def test_spheres_among_balls_need_no_solids(arm):
    """The formulas for balls of the base and of the world agree with the solids; a capsule is no ball."""
    model = replace(arm[1], geometry=None)
    model = model.with_spheres(spheres_along_links(model, 0.06))
    places = {"deck": [0.45, 0.3, 0.6], "foot": [0.1, 0.2, 0.7]}
    base = [BodyShape(name, 0, Ball(0.3, position=place)) for name, place in places.items()]
    around = [Solid(Ball(0.15, position=[0.4, 0.3, 0.5]), "ball"), floor(-0.3)]
    exact, solids = CollisionModel(model, around, base), ShapeCollisions(model, around, base)
    q = np.random.default_rng(3).uniform(-3, 3, (20, model.n))
    by_pair = []
    for collision in (exact, solids):
        found: dict = {}
        for label, gap in zip(collision.labels, collision.gaps(q).T, strict=True):
            if label.second in ("deck", "foot", "ball", "floor"):
                found[f"{label}"] = np.minimum(found.get(f"{label}", np.inf), gap)
        by_pair.append(found)
    assert set(by_pair[0]) == set(by_pair[1])
    assert any("deck" in pair for pair in by_pair[0])
    for pair, gap in by_pair[0].items():
        np.testing.assert_allclose(by_pair[1][pair], gap, atol=1e-7)
    left = [{p: why for p, why in c.apart.items() if p & {"deck", "foot"}} for c in (exact, solids)]
    assert left[0] == left[1] != {}
    with pytest.raises(InputError, match="obstacles: expected Wall"):
        CollisionModel(model, [Solid(Capsule(0.1, 0.3))])


def test_pairs_and_what_is_left_out(arm, tmp_path):
    path, model = arm
    collision = ShapeCollisions(model)
    names = {frozenset((x.first, x.second)) for x in collision.labels}
    assert frozenset(("forearm_link", "upper_arm_link")) not in names
    assert collision.apart[frozenset(("forearm_link", "upper_arm_link"))] == "neighbours"
    srdf = tmp_path / "a.srdf"
    srdf.write_text(
        '<robot name="a"><disable_collisions link1="shoulder_link" link2="wrist_1_link" reason="Never"/>'
        "</robot>"
    )
    other = geometry_from_urdf(path, model, srdf=srdf)
    assert other.apart == {frozenset(("shoulder_link", "wrist_1_link")): "SRDF: Never"}
    srdf.write_text("<robot>")
    with pytest.raises(InputError, match="not a readable SRDF"):
        geometry_from_urdf(path, model, srdf=srdf)
    own = model.geometry.shapes
    stuck = BodyShape("bracket", 3, Ball(2.0))
    crowded = ShapeCollisions(replace(model, geometry=ArmGeometry((*own, stuck))))
    assert crowded.apart[frozenset(("bracket", "wrist_3_link"))] == "never part"
    assert all("bracket" not in (x.first, x.second) for x in crowded.labels)


def test_base_payload_and_obstacles(arm):
    _, model = arm
    held = BodyShape("payload", 6, Box([0.05, 0.05, 0.2], position=[0.0, 0.0, 0.25]), carried=True)
    geometry = replace(model.geometry, shapes=(*model.geometry.shapes, held))
    around = [
        floor(0.0),
        Wall(np.array([1.0, 0, 0]), 2.0),
        Pillar([1.0, 1, 0], 0.1),
        Solid(Ball(0.1), "ball"),
    ]
    deck = BodyShape("deck", 0, Box([1.0, 1.0, 0.1], position=[0.0, 0, 0.6]))
    collision = ShapeCollisions(replace(model, geometry=geometry), around, [deck])
    names = {(x.first, x.second) for x in collision.labels}
    assert ("wrist_2_link", "payload") in names
    assert ("wrist_3_link", "payload") not in names
    links = ("upper_arm_link", "forearm_link", "wrist_1_link", "payload")
    assert all((link, "deck") in names for link in links)
    assert ("shoulder_link", "deck") not in names
    assert all((link, o.name) in names for link in ("shoulder_link", *links) for o in around)


@pytest.mark.parametrize("slides", [[], [1, 3]], ids=["turning", "sliding"])
def test_no_pair_comes_nearer_than_moved_joints_can_bring_it(arm, slides):
    _, model = arm
    model = replace(model, prismatic=np.isin(np.arange(6), slides))
    model = model.with_limits(angle_min=np.full(6, -1.0), angle_max=np.full(6, 1.0))
    deck = BodyShape("deck", 0, Box([1.0, 1.0, 0.1], position=[0.0, 0, 0.6]))
    collision = ShapeCollisions(model, [floor(0.0), Solid(Ball(0.1), "ball")], [deck])
    rng, worst = np.random.default_rng(7), 0.0
    q, moved = rng.uniform(-0.9, 0.9, (30, 6)), rng.uniform(-0.1, 0.1, (30, 6))
    bound = collision.approach(moved)
    for share in (np.ones((30, 6)), rng.random((30, 6)), np.eye(6)[np.arange(30) % 6]):
        nearer = collision.gaps(q) - collision.gaps(q + share * moved)
        apart = collision.gaps(q + share * moved) > 0  # depths of overlap are no distances
        assert np.all((nearer <= bound + 1e-6) | ~apart)
        worst = max(worst, np.max(np.where(apart, nearer / bound, 0.0)))
    assert worst > 0.5


def test_spheres_as_solids_have_the_distances_of_the_formulas(arm):
    """Of floor, wall, pillar and each other."""
    _, model = arm
    model = replace(model, geometry=None)
    sets = [replace(s, name=f"part {s.link}") for s in spheres_along_links(model, 0.03)]
    model = model.with_spheres(sets)
    around = [floor(0.0), Wall(np.array([0.6, 0, 0.8]), 1.5), Pillar([0.9, 0.3, 0], 0.1, [0.0, 0.6, 0.8])]
    exact, solids = CollisionModel(model, around), ShapeCollisions(model, around)
    q = np.random.default_rng(5).uniform(-2, 2, (10, 6))

    def smallest(collision):
        names = np.array([str(label) for label in collision.labels])
        gaps = collision.gaps(q)
        return {name: gaps[:, names == name].min(axis=1) for name in sorted(set(names))}

    by_formula, by_coal = smallest(exact), smallest(solids)
    assert by_formula.keys() == by_coal.keys()
    for name, gaps in by_formula.items():
        np.testing.assert_allclose(by_coal[name], gaps, atol=1e-6)


def test_nothing_known_is_none(tmp_path):
    from tests.places import UR5

    arm = arm_from_urdf(UR5, **ENDS)
    assert geometry_from_urdf(UR5, arm) is None


def test_packages_are_found_behind_three_slashes(tmp_path):
    """Some files write package:///NAME/..., which other readers take, too."""
    assert missing_meshes(with_collision(tmp_path, meshes="package:///arm_meshes/links")) == []


def test_meshes_that_the_file_calls_convex_are_their_hulls(tmp_path):
    """Pinocchio's <collision_checking> makes one convex solid of a mesh."""
    urdf = with_collision(tmp_path, meshes="arm_meshes/links")
    text = urdf.read_text()
    start = text.index("<collision>", text.index('name="upper_arm_link"'))
    text = text[:start] + '<collision name="whole">' + text[start + len("<collision>") :]
    at = text.index("</link>", start)
    checking = '<collision_checking><convex name="whole"/></collision_checking>'
    urdf.write_text(text[:at] + checking + text[at:])
    arm = arm_from_urdf(urdf)
    shapes = [item.shape for item in geometry_from_urdf(urdf, arm).shapes if item.name == "upper_arm_link"]
    assert len(shapes) == 1
    points, _ = elbow(0.425, 0.12)
    assert ConvexHull(shapes[0].corners()).volume == pytest.approx(ConvexHull(points).volume, rel=1e-5)


@pytest.mark.parametrize(
    ("kind", "size"),
    [
        ("cylinder", {"radius": "0.1"}),
        ("box", {}),
        ("capsule", {"radius": "0.1", "height": "0.2"}),
        ("cone", {}),
    ],
)
def test_geometry_that_the_parser_leaves_out_is_refused(tmp_path, kind, size):
    """Pinocchio reads the file without it and says nothing; a proof would be about less than the robot."""
    urdf = with_collision(tmp_path)
    tree = ET.parse(urdf)
    collision = ET.SubElement(tree.find("./link[@name='forearm_link']"), "collision")
    ET.SubElement(ET.SubElement(collision, "geometry"), kind, size)
    tree.write(urdf)
    expected = (
        rf"collision geometry of link 'forearm_link' \(mesh, {kind}\) cannot be read: .*collision = false"
    )
    with pytest.raises(InputError, match=expected):
        geometry_from_urdf(urdf, arm_from_urdf(urdf))
