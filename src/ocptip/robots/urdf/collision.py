"""Collision geometry of a URDF, read by Pinocchio: primitives and meshes, these as a few convex solids."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from ocptip.basics.errors import InputError, naming
from ocptip.basics.read import parse_xml, read_xml_text, require_readable
from ocptip.basics.text import some
from ocptip.robots.collision.parts import Raw, convex_parts, touches_on_meshes, with_few_neighbours
from ocptip.robots.collision.shapes import (
    ArmGeometry,
    Ball,
    BodyShape,
    Box,
    Capsule,
    Cylinder,
    Hull,
    MeshFile,
    Shape,
)
from ocptip.robots.kinematics import link_frames
from ocptip.robots.model import ArmModel
from ocptip.robots.pinocchio import PinocchioModel, load_coal, load_pinocchio
from ocptip.robots.urdf.document import parse_urdf
from ocptip.robots.urdf.parser import load_mesh, pinocchio_model, printed
from ocptip.robots.urdf.resting import resting_configuration

PACKAGE = "package://"
"""Begins names of files in ROS packages."""

_FILE = "file://"
_UPRIGHT = 1e-3  # sine of the angle below which a cylinder stands upright
_MESHES = ".//collision/geometry/mesh"


def geometry_from_urdf(
    path: str | os.PathLike[str],
    arm: ArmModel,
    *,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
    srdf: str | os.PathLike[str] | None = None,
    mesh_parts: int | None = None,
) -> ArmGeometry | None:
    """The collision geometry of an arm that was read from a URDF; None if the file has none.

    What hangs on the arm's base link, or on joints that rest before the first moving one, is part of it as
    body 0.

    Args:
        path: the URDF file.
        arm: of :func:`ocptip.robots.urdf.arm.arm_from_urdf`, not mounted.
        package_dirs: folders with packages, or packages themselves; then those of ROS_PACKAGE_PATH and
            AMENT_PREFIX_PATH and the folders above the URDF are searched.
        srdf: file whose `disable_collisions` are pairs of links that are left out.
        mesh_parts: convex solids of each mesh at most; default: up to 8 where that saves much volume.

    Raises:
        InputError: a mesh is missing or cannot be read, or the SRDF cannot be read; one line.
    """
    file = Path(path)
    meshes = collision_meshes(file, package_dirs)
    if meshes is None:
        return None
    if missing := [name for name, result in meshes.items() if result is None]:
        hint = f"package_dirs has to name a folder that contains {package_folder(missing)}"
        if not any(name.startswith(PACKAGE) for name in missing):
            hint = f"names are relative to {file.name}"
        names = some([repr(name) for name in missing], 2)
        raise InputError(f"{file.name}: no mesh file {names}; {hint}, or collision = false to go on without")
    tree = parse_urdf(file)
    for mesh in tree.iterfind(_MESHES):
        mesh.set("filename", str(meshes[mesh.get("filename", "")]))
    for mesh in meshes.values():
        if mesh is not None:
            require_readable(mesh)
    robot = pinocchio_model(file)
    geometry = _pinocchio_geometry(file, robot, tree)
    _require_all(file, tree, Counter(robot.frames[i.parentFrame].name for i in geometry.geometryObjects))
    raw, shapes = list(_raw(robot, geometry, arm)), []
    for item in raw:
        with naming(f"{file.name}: collision geometry of link {item.name!r}"):
            solids = _solids(item.geometry, mesh_parts)
        shapes += [BodyShape(item.name, item.body, s.placed(item.rotation, item.position)) for s in solids]
    files = tuple(item.mesh for item in raw if item.mesh is not None)
    source = f"collision geometry of {file.name}"
    result = ArmGeometry(tuple(shapes), _disabled(srdf), source, meshes=files)
    return replace(result, on_meshes=touches_on_meshes(arm, result, raw))


def _pinocchio_geometry(file: Path, robot: PinocchioModel, tree: ET.Element) -> Any:
    """The collision geometry of a URDF whose meshes have their paths as names."""
    pin, text = load_pinocchio(), ET.tostring(tree, encoding="unicode")
    lines: list[str] = []
    try:
        with printed() as lines:
            return pin.buildGeomFromUrdfString(robot, text, pin.GeometryType.COLLISION)
    except (ValueError, RuntimeError) as error:
        problem = " ".join([*lines[:2], *str(error).split()])
        raise InputError(f"{file}: collision geometry: {problem}") from None


def outlines_of_links(
    path: str | os.PathLike[str], arm: ArmModel, links: Container[str], visual: Container[str] = ()
) -> dict[str, np.ndarray]:
    """Points (k, 3), m, base link, on links that rest: corners, or some of a round surface, with the lowest.

    Meshes that are not there are left out, so that a link may lack points, or have none.

    Args:
        path: the URDF file.
        arm: read from it, not mounted.
        links: whose points are asked for.
        visual: of these links the visual geometry, if they have no collision geometry.

    Raises:
        InputError: the geometry cannot be read.
    """
    file, tree = Path(path), parse_urdf(Path(path))
    folders = mesh_folders(file, ())
    for link in tree.iterfind("link"):
        solids, name = link.findall("collision"), link.get("name", "")
        if name in visual and not solids:
            solids = link.findall("visual")
        for item in [*link.findall("collision"), *link.findall("visual")]:
            link.remove(item)
        for item in solids if name in links else ():
            item.tag, mesh = "collision", item.find("geometry/mesh")
            result = None if mesh is None else find_mesh(mesh.get("filename", ""), file, folders)
            if mesh is not None and result is not None:
                mesh.set("filename", str(result))
            if mesh is None or result is not None:
                link.append(item)
    robot, points = pinocchio_model(file), dict[str, list[np.ndarray]]()
    for item in _raw(robot, _pinocchio_geometry(file, robot, tree), arm):
        turn = arm.mount_rotation @ item.rotation
        position = arm.mount_position + arm.mount_rotation @ item.position
        points.setdefault(item.name, []).append(position + _lowest(item.geometry, turn.T[:, 2]) @ turn.T)
    return {name: np.vstack(parts) for name, parts in points.items()}


def _lowest(geometry: Any, up: np.ndarray) -> np.ndarray:
    """Points (k, 3) on a geometry, its axes, among them the lowest ones; `up` (3,) in these axes."""
    coal = load_coal()
    if isinstance(geometry, coal.Sphere | coal.Capsule):
        half = geometry.halfLength if isinstance(geometry, coal.Capsule) else 0.0
        ends = np.outer([-half, half], [0, 0, 1])
        across = np.linalg.svd(up[None])[2]  # rows: up and two directions across
        return (ends[:, None] + geometry.radius * np.vstack([across, -across])).reshape(-1, 3)
    if isinstance(geometry, coal.Cylinder):
        down = np.pi + (np.arctan2(up[1], up[0]) if np.hypot(*up[:2]) > _UPRIGHT else 0.0)
        angles = down + np.linspace(0, 2 * np.pi, 32, endpoint=False)
        rim = geometry.radius * np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
        ends = np.outer([-geometry.halfLength, geometry.halfLength], [0, 0, 1])
        return (ends[:, None] + rim).reshape(-1, 3)
    if isinstance(geometry, coal.BVHModelBase):
        return np.array(geometry.vertices())
    return np.vstack([shape.outline() for shape in _solids(geometry)])


def collision_meshes(
    path: str | os.PathLike[str], package_dirs: Sequence[str | os.PathLike[str]] = ()
) -> dict[str, Path | None] | None:
    """The mesh files of a URDF's collision geometry by the names that it has for them; None: missing.

    Returns:
        None if it has no collision geometry.

    Raises:
        InputError: the URDF cannot be read.
    """
    file, tree = Path(path), parse_urdf(Path(path))
    if tree.find(".//collision/geometry/*") is None:
        return None
    names = (mesh.get("filename", "") for mesh in tree.iterfind(_MESHES))
    folders = mesh_folders(file, package_dirs)
    return {name: find_mesh(name, file, folders) for name in names}


def package_folder(names: Iterable[str]) -> str:
    """The folder of the package of the first of some names of meshes that has one; empty if none has."""
    packages = (name.removeprefix(PACKAGE).lstrip("/").split("/")[0] for name in names if PACKAGE in name)
    return next((f"{package}/" for package in packages), "")


def missing_meshes(
    path: str | os.PathLike[str], package_dirs: Sequence[str | os.PathLike[str]] = ()
) -> list[str] | None:
    """Names of :func:`collision_meshes` whose files are missing; None: there is no collision geometry."""
    meshes = collision_meshes(path, package_dirs)
    return None if meshes is None else [name for name, mesh in meshes.items() if mesh is None]


def find_mesh(name: str, urdf: Path, folders: Iterable[Path]) -> Path | None:
    """The file of a mesh as a URDF names it.

    A package may have another name here. Then the end of the path counts, with at least one folder.
    """
    if name.startswith(PACKAGE):
        folders = list(folders)
        rest = Path(name.removeprefix(PACKAGE).lstrip("/"))  # some files write package:///
        part = rest.parts[0] if rest.parts else ""
        candidates = [folder / rest for folder in folders]
        candidates += [folder / Path(*rest.parts[1:]) for folder in folders if folder.name == part]
        ends = [Path(*rest.parts[k:]) for k in range(1, len(rest.parts) - 1)]
        candidates += [folder / end for end in ends for folder in folders]
    else:
        candidates = [urdf.parent / name.removeprefix(_FILE)]
    return next((candidate.resolve() for candidate in candidates if candidate.is_file()), None)


def read_mesh(path: Path, scale: Sequence[float] = (1.0, 1.0, 1.0)) -> list[Shape]:
    """Solids that contain a mesh (STL, OBJ, DAE and others), its lengths in m times `scale`.

    Raises:
        InputError: it cannot be read.
    """
    try:
        model = load_mesh(path, scale)
    except InputError:
        raise
    except (ValueError, RuntimeError) as error:
        raise InputError(f"{path}: not a readable mesh: {' '.join(str(error).split())}") from None
    return _solids(model)


def mesh_folders(file: Path, given: Sequence[str | os.PathLike[str]]) -> list[Path]:
    """Folders in which packages are searched, first those given."""
    paths = [Path(folder) for folder in given]
    for variable, below in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")):
        paths += [Path(p) / below for p in os.environ.get(variable, "").split(os.pathsep) if p]
    return [*paths, *file.resolve().parents]


def _raw(robot: PinocchioModel, geometry: Any, arm: ArmModel) -> Iterator[Raw]:
    """Geometries in the frames of the arm's links; those before the first one in its mount frame."""
    pin = load_pinocchio()
    data = robot.createData()
    pin.framesForwardKinematics(robot, data, resting_configuration(robot, arm))
    to_base = data.oMf[robot.getFrameId(arm.base_link, pin.FrameType.BODY)].inverse()
    frames = link_frames(arm, np.zeros(arm.n))
    numbers = {robot.getJointId(name): i + 1 for i, name in enumerate(arm.chain_names)}
    for item in geometry.geometryObjects:
        joint = item.parentJoint
        body = max((numbers.get(above, 0) for above in robot.supports[joint]), default=0)
        pose = to_base * data.oMi[joint] * item.placement
        if body:
            axes, origin = frames.rotations[body - 1], frames.origins[body - 1]
        else:
            axes, origin = arm.mount_rotation, arm.mount_position
        name, place = (
            robot.frames[item.parentFrame].name,
            (axes.T @ pose.rotation, axes.T @ (pose.translation - origin)),
        )
        mesh = None
        if isinstance(item.geometry, load_coal().BVHModelBase):
            scale = tuple(np.ravel(item.meshScale).tolist())
            mesh = MeshFile(name, body, str(item.meshPath), scale, *place)
        yield Raw(name, body, item.geometry, *place, mesh)


def _solids(geometry: Any, mesh_parts: int | None = None) -> list[Shape]:
    coal = load_coal()
    if isinstance(geometry, coal.Box):
        return [Box(2 * np.asarray(geometry.halfSide))]
    if isinstance(geometry, coal.Sphere):
        return [Ball(geometry.radius)]
    if isinstance(geometry, coal.Cylinder | coal.Capsule):
        kind = Cylinder if isinstance(geometry, coal.Cylinder) else Capsule
        return [kind(geometry.radius, 2 * geometry.halfLength)]
    if isinstance(geometry, coal.ConvexBase):
        return [Hull(with_few_neighbours(np.array(geometry.points())))]
    triangles = [geometry.tri_indices(i) for i in range(geometry.num_tris)]
    corners = np.array([[triangle[i] for i in range(3)] for triangle in triangles], dtype=int)
    return [Hull(points) for points in convex_parts(np.array(geometry.vertices()), corners, mesh_parts)]


def _require_all(file: Path, tree: ET.Element, read: Counter[str]) -> None:
    """Refuse geometry that the parser leaves out without a word, such as a cylinder without length.

    Args:
        file: the URDF, for messages.
        tree: its elements.
        read: how many geometries each link has in the end.
    """
    for link in tree.iterfind("link"):
        kinds, name = [item.tag for item in link.iterfind("collision/geometry/*")], link.get("name", "")
        if len(kinds) > read[name]:
            raise InputError(
                f"{file.name}: collision geometry of link {name!r} ({', '.join(kinds)}) cannot be read: box "
                "needs size, cylinder radius and length, sphere radius, mesh filename; or "
                "collision = false to go on without"
            )


def _disabled(srdf: str | os.PathLike[str] | None) -> dict[frozenset[str], str]:
    if srdf is None:
        return {}
    try:
        tree = parse_xml(read_xml_text(srdf))
    except (InputError, ET.ParseError) as error:
        text = getattr(error, "text", error)
        raise InputError(f"srdf: {srdf}: not a readable SRDF: {text}") from None
    return {
        frozenset((pair.get("link1", ""), pair.get("link2", ""))): f"SRDF: {pair.get('reason', 'disabled')}"
        for pair in tree.iterfind("disable_collisions")
    }
