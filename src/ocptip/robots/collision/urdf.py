"""Collision geometry of a URDF, read by Pinocchio: primitives and meshes, these as a few convex solids."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.robots.collision.parts import convex_parts
from ocptip.robots.collision.shapes import ArmGeometry, Ball, BodyShape, Box, Capsule, Cylinder, Hull, Shape
from ocptip.robots.kinematics import link_frames
from ocptip.robots.model import ArmModel
from ocptip.robots.pinocchio import load_coal, load_pinocchio
from ocptip.robots.urdf_file import parse_urdf

if TYPE_CHECKING:
    import pinocchio as pin

_PACKAGE, _FILE = "package://", "file://"


def geometry_from_urdf(
    path: str | os.PathLike[str],
    arm: ArmModel,
    *,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
    srdf: str | os.PathLike[str] | None = None,
) -> ArmGeometry | None:
    """The collision geometry of an arm that was read from a URDF; None if the file has none.

    What hangs on the arm's base link, or on joints that rest before the first moving one, is part of it as
    body 0.

    Args:
        path: the URDF file.
        arm: of :func:`ocptip.robots.urdf.arm_from_urdf`, not mounted.
        package_dirs: folders with packages, or packages themselves; then those of ROS_PACKAGE_PATH and
            AMENT_PREFIX_PATH and the folders above the URDF are looked at.
        srdf: file whose `disable_collisions` are pairs of links that are left out.

    Raises:
        InputError: a mesh is not found or cannot be read, or the SRDF cannot be read; one line.
    """
    file, pin = Path(path), load_pinocchio()
    tree = parse_urdf(file)
    if tree.find(".//collision/geometry/*") is None:
        return None
    folders = _folders(file, package_dirs)
    for mesh in tree.iterfind(".//collision/geometry/mesh"):
        mesh.set("filename", str(find_mesh(mesh.get("filename", ""), file, folders)))
    robot = pin.buildModelFromUrdf(str(file))
    try:
        text = ET.tostring(tree, encoding="unicode")
        geometry = pin.buildGeomFromUrdfString(robot, text, pin.GeometryType.COLLISION)
    except (ValueError, RuntimeError) as error:
        raise InputError(f"{file}: collision geometry: {' '.join(str(error).split())}") from None
    shapes = tuple(_shapes(robot, geometry, arm))
    return ArmGeometry(shapes, _disabled(srdf), f"collision geometry of {file.name}")


def find_mesh(name: str, urdf: Path, folders: Iterable[Path]) -> Path:
    """The file of a mesh as a URDF names it.

    Raises:
        InputError: there is none; says where was looked.
    """
    if name.startswith(_PACKAGE):
        rest = Path(name.removeprefix(_PACKAGE))
        own = rest.parts[0] if rest.parts else ""
        candidates = [folder / rest for folder in folders]
        candidates += [folder / Path(*rest.parts[1:]) for folder in folders if folder.name == own]
    else:
        candidates = [urdf.parent / name.removeprefix(_FILE)]
    for candidate in candidates:
        if candidate.is_file():
            return candidate.resolve()
    hint = (
        "give its package's folder as package_dirs" if name.startswith(_PACKAGE) else "it is relative to it"
    )
    raise InputError(f"{urdf.name}: no mesh file {name!r}; {hint}, or collision = false to go on without")


def read_mesh(path: Path, scale: Sequence[float] = (1.0, 1.0, 1.0)) -> list[Shape]:
    """Solids that contain a mesh (STL, OBJ, DAE and others), its lengths in m times `scale`.

    Raises:
        InputError: it cannot be read.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        model = load_coal().MeshLoader().load(str(path), np.asarray(scale, dtype=float))
    except (ValueError, RuntimeError) as error:
        raise InputError(f"{path}: not a readable mesh: {' '.join(str(error).split())}") from None
    return _solids(model)


def _folders(file: Path, given: Sequence[str | os.PathLike[str]]) -> list[Path]:
    """Folders in which packages are looked for, first those given."""
    paths = [Path(folder) for folder in given]
    for variable, below in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")):
        paths += [Path(p) / below for p in os.environ.get(variable, "").split(os.pathsep) if p]
    return [*paths, *file.resolve().parents]


def _shapes(robot: pin.Model, geometry: Any, arm: ArmModel) -> Iterator[BodyShape]:
    """Solids in the frames of the arm's links; those before the first one in its mount frame."""
    pin = load_pinocchio()
    data, q = robot.createData(), pin.neutral(robot)
    for name, value in arm.resting.items():
        joint = robot.joints[robot.getJointId(name)]
        angle = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
        q[joint.idx_q : joint.idx_q + joint.nq] = angle
    pin.framesForwardKinematics(robot, data, q)
    to_base = data.oMf[robot.getFrameId(arm.base_link, pin.FrameType.BODY)].inverse()
    frames = link_frames(arm, np.zeros(arm.n))
    numbers = {robot.getJointId(name): i + 1 for i, name in enumerate(arm.joint_names)}
    for item in geometry.geometryObjects:
        joint = item.parentJoint
        body = max((numbers.get(above, 0) for above in robot.supports[joint]), default=0)
        pose = to_base * data.oMi[joint] * item.placement
        if body:
            axes, origin = frames.rotations[body - 1], frames.origins[body - 1]
        else:
            axes, origin = arm.mount_rotation, arm.mount_position
        rotation, position = axes.T @ pose.rotation, axes.T @ (pose.translation - origin)
        name = robot.frames[item.parentFrame].name
        for shape in _solids(item.geometry):
            yield BodyShape(name, body, shape.placed(rotation, position))


def _solids(geometry: Any) -> list[Shape]:
    coal = load_coal()
    if isinstance(geometry, coal.Box):
        return [Box(2 * np.asarray(geometry.halfSide))]
    if isinstance(geometry, coal.Sphere):
        return [Ball(geometry.radius)]
    if isinstance(geometry, coal.Cylinder | coal.Capsule):
        kind = Cylinder if isinstance(geometry, coal.Cylinder) else Capsule
        return [kind(geometry.radius, 2 * geometry.halfLength)]
    triangles = [geometry.tri_indices(i) for i in range(geometry.num_tris)]
    corners = np.array([[triangle[i] for i in range(3)] for triangle in triangles], dtype=int)
    return [Hull(points) for points in convex_parts(np.array(geometry.vertices()), corners)]


def _disabled(srdf: str | os.PathLike[str] | None) -> dict[frozenset[str], str]:
    if srdf is None:
        return {}
    try:
        tree = ET.fromstring(Path(srdf).read_bytes())
    except (OSError, ET.ParseError) as error:
        raise InputError(f"srdf: {srdf}: not a readable SRDF: {error}") from None
    return {
        frozenset((pair.get("link1", ""), pair.get("link2", ""))): f"SRDF: {pair.get('reason', 'disabled')}"
        for pair in tree.iterfind("disable_collisions")
    }
