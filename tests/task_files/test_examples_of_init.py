"""The base and the motion that `ocptip init` writes: those of the URDF where it has them, else examples."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from jsonschema import Draft202012Validator

from ocptip.basics.errors import InputError
from ocptip.motion.task import refusals
from ocptip.robots.urdf.arm import arm_from_urdf
from ocptip.robots.urdf.file import read_urdf
from ocptip.robots.urdf.resting import resting_body
from ocptip.task_files import example
from ocptip.task_files.example import example_base
from ocptip.task_files.motion import load_task
from ocptip.task_files.reference import json_schema
from ocptip.task_files.task_scene import ROBOT_BASE
from ocptip.task_files.template import MARK, _payload, task_template
from tests.quick import some

LINK = """<link name="{0}"><inertial><origin xyz="{2}"/><mass value="{1}"/>
  <inertia ixx="0.05" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.05"/></inertial>{3}</link>"""
SOLID = '<collision><origin xyz="{0}" rpy="{1}"/><geometry>{2}</geometry></collision>'
JOINT = """<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="{4}"/>
  <axis xyz="{5}"/><limit lower="-2.5" upper="2.5" effort="100" velocity="2"/></joint>"""


def link(name, mass=1.0, centre="0 0 0", solid=""):
    return LINK.format(name, mass, centre, solid)


def box(size, at="0 0 0"):
    return SOLID.format(at, "0 0 0", f'<box size="{size}"/>')


def folded_arm(base="base"):
    """Three links of 0.3 m that form a triangle at zero: the third ends in the first."""
    along = box("0.26 0.06 0.06", "0.15 0 0")
    turned = 'xyz="0.3 0 0" rpy="0 0 2.0944"/>'
    joints = [
        JOINT.format("joint_1", "revolute", base, "link_1", "0 0 0.3", "0 0 1"),
        JOINT.format("joint_2", "revolute", "link_1", "link_2", "0.3 0 0", "0 0 1"),
        JOINT.format("joint_3", "revolute", "link_2", "link_3", "0.3 0 0", "0 0 1"),
    ]
    return [
        *(link(f"link_{k}", 1.0, "0.15 0 0", along) for k in (1, 2, 3)),
        link("tool0", 0.1),
        *(joint.replace('xyz="0.3 0 0"/>', turned) for joint in joints),
        '<joint name="flange" type="fixed"><parent link="link_3"/><child link="tool0"/>'
        '<origin xyz="0.3 0 0"/></joint>',
    ]


def written(folder, *parts, name="robot"):
    path = folder / f"{name}.urdf"
    path.write_text(f'<robot name="{name}">{"".join(parts)}</robot>', encoding="utf-8")
    return path


def unmarked(folder, urdf, **names):
    template = task_template(urdf, folder, **names)
    path = folder / "task.toml"
    path.write_text(template.text.replace(f"{MARK} ", ""), encoding="utf-8")
    return template, load_task(path)


def collides(urdf: Path, q) -> bool:
    """By Pinocchio alone: all pairs of links that are no neighbours."""
    model = pin.buildModelFromUrdf(str(urdf))
    geometry = pin.buildGeomFromUrdf(model, str(urdf), pin.GeometryType.COLLISION)
    for a in range(len(geometry.geometryObjects)):
        for b in range(a):
            parents = [geometry.geometryObjects[k].parentJoint for k in (a, b)]
            if abs(parents[0] - parents[1]) > 1:
                geometry.addCollisionPair(pin.CollisionPair(b, a))
    return pin.computeCollisions(
        model, model.createData(), geometry, geometry.createData(), np.array(q), True
    )


def test_the_example_motion_is_free_of_collisions_where_zero_is_not(tmp_path):
    urdf = written(tmp_path, link("base"), *folded_arm())
    assert collides(urdf, np.zeros(3))
    template, task = unmarked(tmp_path, urdf)
    for share in np.linspace(0, 1, 41):
        assert not collides(urdf, task.start + share * (task.goal - task.start))
    assert np.abs(task.goal - task.start).min() > np.deg2rad(10)
    assert "mm clear of arm and ground" in template.example


@pytest.mark.slow
def test_where_large_steps_collide_the_example_is_small(tmp_path, monkeypatch):
    """Two walls beside the base leave no way for steps from limit to limit."""
    monkeypatch.setattr(example, "_SHARES", ((30.0,), (0.1,)))
    walls = "".join(box("0.02 2 0.2", f"{x} 0 0.3") for x in (-0.35, 0.35))
    urdf = written(tmp_path, link("base", solid=walls), *folded_arm())
    template, task = unmarked(tmp_path, urdf)
    assert "mm clear of arm and ground" in template.example
    np.testing.assert_allclose(np.abs(task.goal - task.start), np.deg2rad(3), atol=1e-4)
    for share in np.linspace(0, 1, 21):
        assert not collides(urdf, task.start + share * (task.goal - task.start))


def test_where_no_posture_is_free_zero_stays_and_the_file_says_so(tmp_path):
    huge = box("2 2 2")
    arm = [part.replace(box("0.26 0.06 0.06", "0.15 0 0"), huge) for part in folded_arm()]
    urdf = written(tmp_path, link("base", solid=box("0.1 0.1 0.1", "5 0 0")), *arm)
    template = task_template(urdf, tmp_path)
    assert "links overlap" in template.example
    assert "start_deg = [0, 0, 0]" in template.text


def cart():
    """A chassis of 40 kg with four wheels of 2 kg, radius 0.1 m, width 0.04 m."""
    wheel = SOLID.format("0 0 0", "1.57079633 0 0", '<cylinder radius="0.1" length="0.04"/>')
    parts = [link("chassis", 40.0, "0.05 0 0.1", box("0.8 0.5 0.1", "0 0 0.1"))]
    for name, x, y in (("fl", 0.3, 0.25), ("fr", 0.3, -0.25), ("bl", -0.3, 0.25), ("br", -0.3, -0.25)):
        parts.append(link(f"wheel_{name}", 2.0, "0 0 0", wheel))
        parts.append(
            JOINT.format(f"roll_{name}", "continuous", "chassis", f"wheel_{name}", f"{x} {y} 0", "0 1 0")
        )
    return parts


def test_a_base_in_the_urdf_gives_mass_centre_inertia_and_contacts(tmp_path):
    urdf = written(tmp_path, *cart(), *folded_arm("chassis"))
    template, task = unmarked(tmp_path, urdf)
    assert template.to_fill == ["friction"]  # all else stands in the URDF
    support = task.robot.support
    assert support.mass == pytest.approx(48.0)  # by hand: 40 + 4 * 2
    np.testing.assert_allclose(support.center_of_mass, [40 * 0.05 / 48, 0, 0.1 + 40 * 0.1 / 48], atol=1e-6)
    total = sum(body.mass for body in pin.buildModelFromUrdf(str(urdf)).inertias)
    assert support.mass + task.robot.arm.masses.sum() == pytest.approx(total, rel=1e-9)
    # By hand, about the common centre: five links of 0.05 kg m^2 and where their masses are.
    parts = [(40.0, (0.05, 0.0, 0.1)), *((2.0, (x, y, 0.0)) for x in (-0.3, 0.3) for y in (-0.25, 0.25))]
    middle = sum(m * np.array(at) for m, at in parts) / 48
    inertia = 5 * 0.05 * np.eye(3)
    for m, at in parts:
        r = np.array(at) - middle
        inertia += m * (r @ r * np.eye(3) - np.outer(r, r))
    np.testing.assert_allclose(support.inertia, inertia, rtol=1e-5, atol=1e-6)
    contacts = np.array([contact.position for contact in support.contacts])
    np.testing.assert_allclose(np.abs(contacts), np.tile([0.3, 0.25, 0.0], (4, 1)), atol=1e-9)
    assert "wheel_fl: wheel, radius 0.1 m, axle (0, 1, 0)" in template.text
    assert "it stands on 4 wheels of its geometry" in template.base.source


def caster(name, at, shape='<sphere radius="0.05"/>', kind="fixed"):
    solid = SOLID.format("0 0 0", "0 0 0", shape)
    joint = f'<joint name="j_{name}" type="{kind}"><parent link="chassis"/><child link="{name}"/>'
    return [link(name, 0.2, solid=solid), f'{joint}<origin xyz="{at}"/><axis xyz="0 0 1"/></joint>']


def two_wheels():
    """The chassis on its two front wheels alone."""
    return [part for part in cart() if not ("wheel_b" in part or "roll_b" in part)]


def base_of(folder, *parts):
    """Kinds and places of the contacts of a base with an arm, and their reasons."""
    urdf = written(folder, *parts, *folded_arm("chassis"))
    base = example_base(read_urdf(urdf), arm_from_urdf(urdf, tool_frame="tool0"))
    kinds = [(contact.kind, *np.round(contact.position, 3)) for contact in base.contacts]
    return base, kinds, " ".join(contact.reason for contact in base.contacts)


WHEELS = [("wheel", 0.3, 0.25, 0.0), ("wheel", 0.3, -0.25, 0.0)]


@pytest.mark.slow
def test_casters_are_known_by_name_and_have_no_friction(tmp_path):
    urdf = written(tmp_path, *two_wheels(), *caster("rear_caster", "-0.4 0 -0.05"), *folded_arm("chassis"))
    template, task = unmarked(tmp_path, urdf)
    assert [contact.kind for contact in template.base.contacts] == ["wheel", "wheel", "caster"]
    assert [contact.friction for contact in task.robot.support.contacts] == [0.5, 0.5, 0.0]
    assert "rear_caster: caster by its name" in template.text


def test_a_wheel_that_swivels_beside_its_axle_is_a_caster(tmp_path):
    fork = JOINT.format("swivel", "continuous", "chassis", "fork", "-0.4 0 0.05", "0 0 1")
    axle = JOINT.format("axle", "continuous", "fork", "rear", "-0.04 0 -0.1", "0 1 0")
    solid = SOLID.format("0 0 0", "1.57079633 0 0", '<cylinder radius="0.05" length="0.03"/>')
    parts = [link("fork", 0.5), link("rear", 0.3, solid=solid), fork, axle]
    _, kinds, reasons = base_of(tmp_path, *two_wheels(), *parts)
    assert kinds == [*WHEELS, ("caster", -0.44, 0.0, 0.0)]
    assert "rear: caster that swivels freely, 40 mm behind its swivel, radius 0.05 m" in reasons


def test_a_caster_of_two_links_is_one_contact_and_a_wheeled_base_is_no_wheel(tmp_path):
    low = SOLID.format("0 0 0", "0 0 0", '<box size="0.2 0.2 0.2"/>')
    frame = [link("wheeled_base", 1.0, solid=low)]
    frame.append(JOINT.format("wheeled_base_joint", "fixed", "chassis", "wheeled_base", "0 0 0", "0 0 1"))
    rear = [*caster("rear_caster_1", "-0.4 0 -0.05"), *caster("rear_caster_2", "-0.4 0 -0.05")]
    _, kinds, reasons = base_of(tmp_path, *two_wheels(), *rear, *frame)
    assert [kind for kind, *_ in kinds] == ["wheel", "wheel", "caster"]
    assert "wheeled_base" not in reasons


def test_wheels_that_are_all_called_casters_are_driven(tmp_path):
    _, kinds, _ = base_of(tmp_path, *(part.replace("wheel_", "caster_") for part in cart()))
    assert [kind for kind, *_ in kinds] == 4 * ["wheel"]


def test_a_base_that_its_wheels_do_not_carry_stands_on_its_lowest_points(tmp_path):
    _, kinds, reasons = base_of(tmp_path, *two_wheels())
    assert kinds[:2] == WHEELS
    assert sorted(kinds[2:]) == [("caster", x, y, 0.0) for x in (-0.4, 0.4) for y in (-0.25, 0.25)]
    assert "150 mm above that of the wheels, for the wheels alone do not carry the base" in reasons


def test_wheels_without_solids_touch_where_the_footprint_is(tmp_path):
    parts = [part.replace(part[part.find("<collision>") : part.rfind("</link>")], "") for part in cart()]
    foot = '<link name="base_footprint"/>' + (
        '<joint name="up" type="fixed"><parent link="base_footprint"/><child link="chassis"/>'
        '<origin xyz="0 0 0.12"/></joint>'
    )
    base, _, reasons = base_of(tmp_path, foot, *parts)
    assert reasons.count("radius 0.12 m") == 4
    assert base.height == 0.0


def test_an_endless_joint_of_an_idle_arm_is_no_wheel(tmp_path):
    """Its link reaches the ground, but it is not round about its joint."""
    rod = SOLID.format("0 0 -0.3", "0 0 0", '<cylinder radius="0.02" length="0.6"/>')
    joint = JOINT.format("elbow", "continuous", "chassis", "idle", "0.6 0 0.5", "0 1 0")
    _, kinds, _ = base_of(tmp_path, *cart(), link("idle", solid=rod), joint)
    assert len(kinds) == 4


def test_what_is_invented_is_said_at_each_number(tmp_path):
    urdf = written(tmp_path, link("base", 0.5), *folded_arm())
    template = task_template(urdf, tmp_path)
    assert template.base.source.startswith("mass, centre of mass, feet and height are invented")
    lines = template.text.splitlines()
    for key in ("mass", "center_of_mass", "feet", "friction"):
        (line,) = [line for line in lines if line.startswith(f"{MARK} {key} =")]
        assert "invented" in line
        declared = ROBOT_BASE.keys[key]
        assert f"{declared.unit}: {declared.meaning[:-1]}".removeprefix(": ") in line
    assert "has to include 0.5 kg of links of the URDF" in template.text
    filled = tomllib.loads(template.text.replace(f"{MARK} ", ""))
    Draft202012Validator(json_schema()).validate(filled)


@pytest.mark.parametrize(
    ("links", "expected"),
    some(1, [("massless", "chassis"), ("heavy", "world")]),
)
def test_joints_that_drive_a_base_are_no_joints_of_the_arm(tmp_path, links, expected):
    between = [
        f'<link name="{name}"/>' if links == "massless" else link(name, 5.0)
        for name in ("slide_x", "slide_y")
    ]
    root = '<link name="world"/>' if links == "massless" else link("world")
    drive = [
        JOINT.format("x", "prismatic", "world", "slide_x", "0 0 0", "1 0 0"),
        JOINT.format("y", "prismatic", "slide_x", "slide_y", "0 0 0", "0 1 0"),
        JOINT.format("turn", "continuous", "slide_y", "chassis", "0 0 0", "0 0 1"),
    ]
    urdf = written(tmp_path, root, *between, *drive, *cart(), *folded_arm("chassis"))
    assert read_urdf(urdf).base_link(None) == expected  # a gantry has masses
    template, task = unmarked(tmp_path, urdf)
    assert template.base_link == expected
    assert task.robot.n == (3 if links == "massless" else 6)


@pytest.mark.parametrize("kind", some(1, ["planar", "floating"]))
@pytest.mark.parametrize("between", [False, True])
def test_a_planar_or_floating_base_stands(tmp_path, kind, between):
    drive = f'<joint name="drive" type="{kind}"><parent link="world"/><child link="chassis"/></joint>'
    if between:  # as on many robots: a frame without mass on the ground
        drive = drive.replace("chassis", "base_footprint") + (
            '<link name="base_footprint"/><joint name="up" type="fixed"><parent link="base_footprint"/>'
            '<child link="chassis"/></joint>'
        )
    urdf = written(tmp_path, '<link name="world"/>', drive, *cart(), *folded_arm("chassis"))
    template, task = unmarked(tmp_path, urdf)
    assert template.base_link == "chassis"
    assert task.robot.names == ("joint_1", "joint_2", "joint_3")


def test_links_with_impossible_inertia_are_marked_instead_of_refused(tmp_path):
    parts = [
        part.replace(
            link("link_2", 1.0, "0.15 0 0", box("0.26 0.06 0.06", "0.15 0 0")), '<link name="link_2"/>'
        )
        for part in folded_arm()
    ]
    urdf = written(tmp_path, link("base"), *parts)
    template, task = unmarked(tmp_path, urdf)
    assert "accept_inertia" in template.to_fill
    assert "link_2: moves, but has no mass" in template.text
    np.testing.assert_allclose(task.robot.arm.masses, [1.0, 0.0, 1.1])


def test_geometry_without_size_names_its_link_and_is_marked(tmp_path):
    point = SOLID.format("0 0 0", "0 0 0", '<sphere radius="0"/>')
    parts = [part.replace(link("tool0", 0.1), link("tool0", 0.1, solid=point)) for part in folded_arm()]
    urdf = written(tmp_path, link("base"), *parts)
    template = task_template(urdf, tmp_path)
    assert "collision" in template.to_fill
    assert "collision geometry of link 'tool0': radius: must be > 0, got 0.0" in template.text
    (tmp_path / "task.toml").write_text(
        template.text.replace(f"{MARK} collision", "# collision").replace(f"{MARK} ", ""), encoding="utf-8"
    )
    with pytest.raises(
        InputError, match=r"robot\.urdf: collision geometry of link 'tool0': radius: must be > 0"
    ):
        load_task(tmp_path / "task.toml")


def test_a_single_heavy_link_is_the_foot_of_the_arm_and_no_base(tmp_path):
    urdf = written(tmp_path, link("base", 6.0, solid=box("0.2 0.2 0.1")), *folded_arm())
    template = task_template(urdf, tmp_path)
    assert template.base.source.startswith("mass, centre of mass, feet and height are invented")
    assert "has to include 6 kg of links of the URDF" in template.text
    assert re.search(r"6 kg, centre \[.*\] m in the axes of base_link", template.text)
    added = "".join(f"{line.removeprefix('# ')}\n" for line in template.text.splitlines())
    (part,) = tomllib.loads(added[added.index("[[base.added]]") : added.index("Solid of base")])["base"][
        "added"
    ]
    assert part["mass"] == 6.0
    body, mounted = resting_body(urdf, template.arm), [0.0, 0.0, template.base.height]
    np.testing.assert_allclose(part["center_of_mass"], body[1] + mounted, atol=1e-6)


def test_drives_hold_the_example_and_the_base_stands_in_it(tmp_path):
    """Zero is stretched out: 2 kg at the tip need more than the first drive has, and tip a narrow base."""
    along = box("0.2 0.05 0.05", "0.15 0 0")
    arm = [link(f"link_{k}", 2.0, "0.15 0 0", along) for k in (1, 2, 3)]
    places = ("base", "0 0 0.8"), ("link_1", "0.3 0 0"), ("link_2", "0.3 0 0")
    for k, (parent, at) in enumerate(places, 1):
        arm.append(JOINT.format(f"joint_{k}", "revolute", parent, f"link_{k}", at, "0 1 0"))
    weak = "".join(arm).replace('effort="100"', 'effort="22"')
    urdf = written(tmp_path, link("base"), weak)
    model = pin.buildModelFromUrdf(str(urdf))
    data = model.createData()
    assert np.abs(pin.rnea(model, data, np.zeros(3), np.zeros(3), np.zeros(3))).max() > 22
    _, task = unmarked(tmp_path, urdf)
    support = task.robot.support
    for share in (0.0, 0.5, 1.0):
        q = task.start + share * (task.goal - task.start)
        assert np.abs(pin.rnea(model, data, q, np.zeros(3), np.zeros(3))).max() < 22
        carried = pin.centerOfMass(model, data, q)[:2] * data.mass[0]
        whole = (carried + support.mass * support.center_of_mass[:2]) / (data.mass[0] + support.mass)
        assert np.all(np.abs(whole) < np.max([contact.position[:2] for contact in support.contacts], axis=0))
    assert refusals(task) == ()


def test_examples_beside_a_limit_are_inside_of_it_in_the_file(tmp_path):
    """A limit of 25 degrees has more digits than the file."""
    narrow = [
        part.replace('lower="-2.5" upper="2.5"', 'lower="-0.4363" upper="0.05"') for part in folded_arm()
    ]
    urdf = written(tmp_path, link("base"), *narrow)
    _, task = unmarked(tmp_path, urdf)
    assert not [reason for reason in refusals(task) if "outside its limits" in reason]


def test_links_that_are_always_near_need_no_clearance_in_the_file(tmp_path):
    """The third link turns about an axis along itself, 4 mm beside a fin of the first."""
    fin = box("0.02 0.02 0.1", "0.3 0.054 0") + box("0.2 0.04 0.04", "0.1 0 0")
    arm = [
        link("link_1", solid=fin),
        link("link_2"),
        link(
            "link_3",
            solid=SOLID.format("0.05 0 0", "0 1.57079633 0", '<cylinder radius="0.04" length="0.2"/>'),
        ),
        JOINT.format("joint_1", "revolute", "base", "link_1", "0 0 0.3", "0 0 1"),
        JOINT.format("joint_2", "revolute", "link_1", "link_2", "0.3 0 0", "1 0 0"),
        JOINT.format("joint_3", "revolute", "link_2", "link_3", "0 0 0", "1 0 0"),
    ]
    template, task = unmarked(tmp_path, written(tmp_path, link("base"), *arm))
    assert "clearance" not in template.to_fill
    assert "# clearance = 0.01  # without this line 2.0 mm" in template.text
    assert "brings link_1 and link_3 farther apart than 4.0 mm" in template.text
    assert task.limits.clearance == pytest.approx(0.002, abs=1e-4)
    assert refusals(task) == ()
    task = replace(task, limits=replace(task.limits, clearance=0.01))
    assert "leave clearance in [limits] out: then 2.0 mm count" in refusals(task)[0]


def test_a_base_that_would_fall_over_by_itself_is_no_base(tmp_path):
    """A torso beside the plate that it is bolted to: its centre of mass is not above the plate."""
    plate = link("base", 5.0, "0 0 0", box("0.2 0.2 0.02"))
    torso = link("torso", 40.0, "0.6 0 0.3")
    bolts = '<joint name="bolts" type="fixed"><parent link="base"/><child link="torso"/></joint>'
    template = task_template(written(tmp_path, plate, torso, bolts, *folded_arm("torso")), tmp_path)
    assert template.base.source.startswith("mass, centre of mass, feet and height are invented")


def test_without_pairs_that_can_collide_no_distance_is_told(tmp_path):
    arm = [part.replace(box("0.26 0.06 0.06", "0.15 0 0"), "") for part in folded_arm()]
    urdf = written(tmp_path, link("base", solid=box("0.1 0.1 0.1")), *arm)
    template = task_template(urdf, tmp_path)
    assert template.example.startswith("start and goal are an example; no two solids can collide")


@pytest.mark.parametrize(
    ("tool", "rotation", "centre", "size"),
    [
        ([0.05, 0.0, 0.0], np.eye(3), "[0.1, 0.0, 0.0]", "[0.2, 0.1, 0.1]"),
        ([0.0, -0.1, 0.02], np.eye(3), "[0.0, -0.1, 0.0]", "[0.1, 0.2, 0.1]"),
        (
            [0.05, 0.0, 0.0],
            np.eye(3)[[2, 1, 0]],
            "[0.0, 0.0, 0.1]",
            "[0.1, 0.1, 0.2]",
        ),
        ([0.0, 0.0, 0.0], np.eye(3), "[0.0, 0.0, 0.1]", "[0.1, 0.1, 0.2]"),
    ],
)
def test_the_payload_of_the_example_is_in_front_of_the_tool(tool, rotation, centre, size):
    """As seen from the last joint, in tool axes; along z where the tool frame is in that joint."""
    lines = list(_payload(SimpleNamespace(tool_rotation=rotation, offsets=np.array([tool]))))
    assert any(line.startswith(f"# center_of_mass = {centre}") for line in lines)
    assert any(line.startswith(f"# position = {centre}") for line in lines)
    assert f"# size = {size}  # m" in lines
