"""Elements of URDF files and MuJoCo models: bodies with inertia, rotations, joints, contacts of soles."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.numerics.inertia import RigidBody

SOLE = 1e-3  # m: radius of the sphere that touches the ground
SENSOR = 2.5e-3  # m: so far below a sole is what measures its force, not that of an opposite jaw
STEP = 1e-4  # s
RIGID = {"solref": [5 * STEP, 1.0], "solimp": [0.9, 0.9, 1e-3, 0.5, 2.0]}
"""Contact of a stiff foot: 0.5 ms, critically damped. Much stiffer contacts chatter, softer ones swing."""


def inertial(element: ET.Element, body: RigidBody) -> None:
    """The mass, centre of mass and inertia of a body."""
    mass, centre, values, turn = principal(body)
    add(
        element, "inertial", mass=text(mass), pos=text(centre), diaginertia=text(values), quat=text(turn),
    )  # fmt: skip


def principal(body: RigidBody) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """Mass, centre, principal moments (3,) and the quaternion (4,) of their axes, scalar first."""
    mass, centre, inertia = body
    values, axes = np.linalg.eigh(inertia)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    values[2] = min(values[2], values[0] + values[1])
    return mass, centre, values, quaternion(axes)


def upright(normal: np.ndarray) -> np.ndarray:
    """Quaternion of a plane whose z axis is this normal."""
    return np.roll(Rotation.align_vectors([normal], [[0.0, 0.0, 1.0]])[0].as_quat(), 1)


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """(4,) scalar first."""
    return np.roll(Rotation.from_matrix(rotation).as_quat(), 1)


def add(parent: ET.Element, tag: str, **attributes: str) -> ET.Element:
    """A new element in another."""
    return ET.SubElement(parent, tag, attributes)


def text(values: object) -> str:
    """Numbers that come back to the last bit."""
    return " ".join(repr(float(x) + 0.0) for x in np.atleast_1d(np.asarray(values, dtype=float)))


def urdf_link(root: ET.Element, name: str, body: RigidBody | None = None) -> ET.Element:
    """A link of a URDF, without inertia where there is no body."""
    link = add(root, "link", name=name)
    if body is not None:
        mass, centre, inertia = body
        inertial = add(link, "inertial")
        add(inertial, "origin", xyz=text(centre), rpy="0 0 0")
        add(inertial, "mass", value=text(mass))
        names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
        add(inertial, "inertia", **{key: text(inertia[entry]) for key, entry in names.items()})
    return link


def urdf_joint(
    root: ET.Element, name: str, kind: str, parent: str, child: str, place: np.ndarray, rotation: np.ndarray
) -> ET.Element:
    """A joint of a URDF, the child's place (3,), m, and axes (3, 3) in the parent's frame."""
    joint = add(root, "joint", name=name, type=kind)
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[2, 1], rotation[2, 2]))
    roll, yaw = np.arctan2(rotation[2, 1], rotation[2, 2]), np.arctan2(rotation[1, 0], rotation[0, 0])
    if np.hypot(rotation[2, 1], rotation[2, 2]) < 1e-9:  # only roll -+ yaw is definite
        roll, yaw = 0.0, np.arctan2(-rotation[0, 1], rotation[1, 1])
    add(joint, "origin", xyz=text(place), rpy=text([roll, pitch, yaw]))
    add(joint, "parent", link=parent)
    add(joint, "child", link=child)
    return joint
