"""Contacts of bases that URDFs describe as their makers like: without collision geometry, with capsules."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from ocptip.basics.errors import InputError
from ocptip.robots.urdf.arm import arm_from_urdf
from ocptip.robots.urdf.collision import geometry_from_urdf
from ocptip.robots.urdf.document import xml_of
from ocptip.robots.urdf.file import read_urdf
from ocptip.robots.urdf.ground_contacts import ground_contacts
from ocptip.task_files.example import example_base

INERTIAL = """<inertial><mass value="{}"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>
  </inertial>"""
CAPSULE = """<collision><origin xyz="0.1 0.2 0.3" rpy="0.4 -0.5 0.6"/>
  <geometry><capsule radius="0.05" length="0.3"/></geometry></collision>"""
WHEEL = """<collision><origin rpy="1.5707963 0 0"/>
  <geometry><cylinder radius="0.1" length="0.04"/></geometry></collision>"""


def link(name, mass, more=""):
    return f'<link name="{name}">{INERTIAL.format(mass)}{more}</link>'


def ball(radius, at):
    return f'<visual><origin xyz="{at}"/><geometry><sphere radius="{radius}"/></geometry></visual>'


def wheel(side):
    return link(f"wheel_{side}", 1.0, WHEEL) + (
        f'<joint name="axle_{side}" type="continuous"><parent link="base"/><child link="wheel_{side}"/>'
        f'<origin xyz="0.2 {side}0.3 0.1"/><axis xyz="0 1 0"/><limit velocity="9"/></joint>'
    )


def robot(folder, seen, more=""):
    """A base with two driven wheels, whose rear end stands on what is only drawn, and an arm of one joint."""
    text = (
        f'<robot name="r">{link("base", 50.0, seen)}{wheel("+")}{wheel("-")}{link("arm", 2.0, more)}'
        '<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.5"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="10"/></joint></robot>'
    )
    path = folder / "r.urdf"
    path.write_text(text)
    return path, arm_from_urdf(path, base_link="base", tool_frame="arm")


@pytest.mark.parametrize("drawn", [True, False])
def test_a_base_that_its_wheels_do_not_carry_stands_on_what_is_drawn(tmp_path, drawn):
    seen = ball(0.03, "-0.3 0.1 0.03") + ball(0.03, "-0.3 -0.1 0.03") if drawn else ""
    path, arm = robot(tmp_path, seen)
    found = ground_contacts(read_urdf(path), arm, np.array([0.0, 0.0, 0.2]))
    wheels = [contact.position for contact in found if contact.kind == "wheel"]
    np.testing.assert_allclose(sorted(p[1] for p in wheels), [-0.3, 0.3], atol=1e-9)
    np.testing.assert_allclose([p[0] for p in wheels], 0.2)
    rest = [contact for contact in found if contact.kind == "caster"]
    assert bool(rest) == drawn
    if drawn:
        np.testing.assert_allclose([c.position[0] for c in rest], -0.3, atol=1e-9)
        np.testing.assert_allclose(sorted({round(c.position[1], 9) for c in rest}), [-0.1, 0.1])
        assert all("the wheels alone do not carry the base" in c.reason for c in rest)


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_two_wheels_on_a_rocker_are_one_contact_at_its_pivot(tmp_path, kind):
    path, _ = robot(tmp_path, ball(0.03, "-0.3 0.1 0.03") + ball(0.03, "-0.3 -0.1 0.03"))
    pivot = (
        '<link name="axle"/><joint name="rocker" type="'
        + kind
        + '"><parent link="base"/><child link="axle"/>'
        '<origin xyz="0 0.05 0"/><axis xyz="1 0.5 0"/>'
        '<limit lower="-0.1" upper="0.1" velocity="0" effort="0"/></joint></robot>'
    )
    text = path.read_text().replace("</robot>", pivot)
    path.write_text(
        text.replace('<parent link="base"/><child link="wheel_', '<parent link="axle"/><child link="wheel_')
    )
    arm = arm_from_urdf(path, base_link="base", tool_frame="arm")
    file = read_urdf(path)
    found = ground_contacts(file, arm, np.array([0.0, 0.0, 0.2]))
    wheels = [contact for contact in found if contact.kind == "wheel"]
    source = example_base(file, arm).source
    if kind == "prismatic":  # a suspension
        assert [contact.rocker for contact in wheels] == ["rocker", "rocker"]
        assert all("on rocker, which counts as fixed" in contact.reason for contact in wheels)
        assert source.count("rocker moves in the URDF and counts as fixed") == 1
    else:
        np.testing.assert_allclose([contact.position for contact in wheels], [[0.2, 0.15, 0.0]], atol=1e-9)
        assert "pivot on which wheel_+ and wheel_- rock" in wheels[0].reason
        assert "stands on 1 rocker and 2 casters" in source
        assert "rocker lets two wheels rock: one contact at its pivot stands for both" in source


def test_a_capsule_is_a_cylinder_with_a_ball_at_either_end(tmp_path):
    """Places are those of Pinocchio, which turns the cylinder's axis."""
    path, arm = robot(tmp_path, "", CAPSULE)
    text = xml_of(path)[1]
    model = pin.buildModelFromXML(text)
    parts = pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION).geometryObjects
    own = [part for part in parts if model.frames[part.parentFrame].name == "arm"]
    (stem,) = [part for part in own if type(part.geometry).__name__ == "Cylinder"]
    balls = [part for part in own if type(part.geometry).__name__ == "Sphere"]
    assert stem.geometry.radius == 0.05
    assert stem.geometry.halfLength == 0.15
    assert [part.geometry.radius for part in balls] == [0.05, 0.05]
    ends = [stem.placement.act(np.array([0, 0, z])) for z in (-0.15, 0.15)]
    np.testing.assert_allclose([part.placement.translation for part in balls], ends, atol=1e-12)
    assert len([shape for shape in geometry_from_urdf(path, arm).shapes if shape.name == "arm"]) == 3


def test_a_capsule_without_numbers_is_refused_as_before(tmp_path):
    path, arm = robot(tmp_path, "", CAPSULE.replace('length="0.3"', 'length="long"'))
    with pytest.raises(InputError, match=r"collision geometry of link 'arm' \(capsule\) cannot be read"):
        geometry_from_urdf(path, arm)
