"""URDF files out of xacro files and MuJoCo models, by the programs that these are written for."""

from __future__ import annotations

import importlib
import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.read import parse_xml, read_xml_text, require_readable
from ocptip.robots.pinocchio import load_pinocchio
from ocptip.robots.urdf.collision import find_mesh, mesh_folders
from ocptip.robots.urdf.document import is_mjcf
from ocptip.robots.urdf.file import with_files

_SECONDS = 120
"""Longest time of xacro."""


class Converted(NamedTuple):
    """A URDF that was made of another file.

    Attributes:
        files: texts by path, the URDF first, then meshes that it needs.
        armature: kg m^2 (sliding joints: kg) by joint: inertias of rotors, which no URDF has.
        notes: what else the URDF lacks, one sentence each.
    """

    files: Mapping[Path, str]
    armature: Mapping[str, float] = MappingProxyType({})
    notes: tuple[str, ...] = ()


def converted(path: Path, folder: Path, arguments: Sequence[str] = ()) -> Converted | None:
    """The URDF of a xacro file or a MuJoCo model.

    Args:
        path: the file; of any other kind the answer is None.
        folder: where the URDF will be; its meshes are named from there.
        arguments: of xacro, "name:=value".

    Raises:
        InputError: the file cannot be read, or what reads it is not there, or refuses it.
    """
    stem = path.name.removesuffix(path.suffix)
    target = folder / f"{stem.removesuffix('.urdf')}.urdf"
    if path.suffix == ".xacro":
        text = _expanded(path, arguments)
        names = {mesh.get("filename", "") for mesh in parse_xml(text).iterfind(".//geometry/mesh")}
        folders, table = mesh_folders(path, ()), {}
        for name in names:
            if (mesh := find_mesh(name, path, folders)) is not None:
                table[name] = Path(os.path.relpath(mesh, folder.resolve())).as_posix()
        return Converted({target: with_files(text, table)})
    if path.suffix == ".xml" and is_mjcf(read_xml_text(path)):
        return _of_mujoco(path, target)
    return None


def _expanded(path: Path, arguments: Sequence[str]) -> str:
    """The text of a xacro file, expanded by the program, else by the package of Python."""
    if (program := shutil.which("xacro")) is not None:
        call = [program]
    elif importlib.util.find_spec("xacro") is not None:
        call = [sys.executable, "-c", "import xacro; xacro.main()"]
    else:
        raise InputError("a xacro file; install xacro (pip install xacro), or expand it", "", str(path))
    try:
        done = subprocess.run(
            [*call, str(path), *arguments], capture_output=True, text=True, check=False, timeout=_SECONDS
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"xacro did not end within {_SECONDS} s", "", str(path)) from None
    if done.returncode:
        lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
        raise InputError(f"xacro refuses it: {'; '.join(lines[:3])}", "", str(path))
    return done.stdout


def _of_mujoco(path: Path, target: Path) -> Converted:
    """The URDF of a MuJoCo model, whose meshes become OBJ files in a folder beside it."""
    try:
        mujoco: Any = importlib.import_module("mujoco")
    except ImportError:
        raise InputError("a MuJoCo model; install mujoco (pip install mujoco)", "", str(path)) from None
    require_readable(path)
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise InputError(f"MuJoCo refuses it: {' '.join(str(error).split())}", "", str(path)) from None
    meshes: dict[Path, str] = {}
    bases = [b for b in range(1, model.nbody) if model.body_parentid[b] == 0 and _drives(model, b)]
    parts = list(_parts(mujoco, model, bases, target, meshes, path))
    name = quoteattr(path.stem)
    text = "\n".join([f'<robot name={name} version="1.2">', *parts, "</robot>", ""])
    moved = [
        j
        for j in range(model.njnt)
        if model.jnt_type[j] != _FREE and model.jnt_bodyid[j] in _robot(model, bases).difference(bases)
    ]
    rotors = {_joint_name(model, j): float(model.dof_armature[model.jnt_dofadr[j]]) for j in moved}
    armature = {name: value for name, value in rotors.items() if value > 0}
    return Converted({target: text, **meshes}, armature, tuple(_left_out(model, bases, moved)))


def _drives(model: Any, b: int) -> bool:
    """Whether the joints of a body say where a base is: a free one, or two that slide and one that turns.

    Where none has a range, as those of a gantry have, two or three that slide are enough.
    """
    own = slice(model.body_jntadr[b], model.body_jntadr[b] + model.body_jntnum[b])
    kinds, others = [_KINDS.get(kind) for kind in model.jnt_type[own]], model.body_rootid == b
    others[b] = False
    known = kinds.count("prismatic"), kinds.count("revolute"), len(kinds)
    places = kinds == ["floating"] or known == (2, 1, 3)
    places |= known in ((2, 0, 2), (3, 0, 3), (3, 1, 4)) and not np.any(model.jnt_limited[own])
    return places and bool(np.any(model.body_jntnum[others]))


def _robot(model: Any, bases: Sequence[int]) -> set[int]:
    """Bodies of the robot. Beside one that drives, what has no part in it is the scene."""
    return {b for b in range(1, model.nbody) if not bases or model.body_rootid[b] in bases}


def _left_out(model: Any, bases: Sequence[int], moved: Sequence[int]) -> Iterator[str]:
    """What a URDF cannot have, with names."""
    scene = sorted(set(range(1, model.nbody)) - _robot(model, bases))
    sprung = [_joint_name(model, j) for j in moved if np.any(model.jnt_stiffness[j])]
    losses = model.dof_damping, model.dof_frictionloss
    braked = [
        _joint_name(model, j) for j in moved if any(np.any(loss[model.jnt_dofadr[j]]) for loss in losses)
    ]
    parts = {
        "bodies that are no part of the robot (see [[obstacle]])": [_body_name(model, b) for b in scene],
        "tendons": [model.tendon(k).name or f"tendon_{k}" for k in range(model.ntendon)],
        "equalities": [model.equality(k).name or f"equality_{k}" for k in range(model.neq)],
        "springs of joints (see [arm.springs])": sprung,
        "damping and friction of joints (see [motors])": braked,
    }
    for kind, names in parts.items():
        if names:
            yield f"left out of the MuJoCo model: {kind}: {', '.join(names)}"


def _joint_name(model: Any, j: int) -> str:
    return model.joint(j).name or f"joint_{j}"


def _body_name(model: Any, b: int) -> str:
    return model.body(b).name or f"body_{b}"


def _parts(
    mujoco: Any, model: Any, bases: Sequence[int], target: Path, meshes: dict[Path, str], path: Path
) -> Iterator[str]:
    """Links and joints; a body with several joints, or one beside its origin, has links without mass.

    The joints of bases that drive are one that floats: they say where the robot is.
    """
    names = [_body_name(model, b) for b in range(model.nbody)]
    efforts, collides = _efforts(mujoco, model), (model.geom_contype | model.geom_conaffinity) > 0
    robot = sorted(_robot(model, bases))
    if bases:
        collides &= model.geom_bodyid > 0
    for b in (0, *robot):
        name = names[b]
        yield f"<link name={quoteattr(name)}>"
        if b and model.body_mass[b] > 0:
            xx, yy, zz = model.body_inertia[b]
            inertia = f'<inertia ixx="{xx:.17g}" ixy="0" ixz="0" iyy="{yy:.17g}" iyz="0" izz="{zz:.17g}"/>'
            place = _origin(_placed(model.body_ipos[b], model.body_iquat[b]))
            yield f'<inertial>{place}<mass value="{model.body_mass[b]:.17g}"/>{inertia}</inertial>'
        for g in np.flatnonzero(collides & (model.geom_bodyid == b)):
            yield from _solids(mujoco, model, int(g), target, meshes)
        yield "</link>"
    for b in robot:
        parent, here = names[model.body_parentid[b]], _placed(model.body_pos[b], model.body_quat[b])
        joints = range(model.body_jntadr[b], model.body_jntadr[b] + model.body_jntnum[b])
        if b in bases:
            yield _joint(_joint_name(model, joints[0]), "floating", parent, names[b], here, "")
            continue
        for j in joints:
            kind = _KINDS.get(model.jnt_type[j])
            joint = _joint_name(model, j)
            if kind is None:
                raise InputError(f"joint {joint!r}: a ball joint, which a URDF cannot have", "", str(path))
            shift = _placed(model.jnt_pos[j] if kind != "floating" else np.zeros(3))
            last = j == joints[-1] and not shift.translation.any()
            child = names[b] if last else f"{names[b]}_{joint}"
            if not last:
                yield f"<link name={quoteattr(child)}/>"
            yield _joint(joint, kind, parent, child, here * shift, _limits(model, j, kind, efforts))
            parent, here = child, shift.inverse()
        if parent != names[b]:
            yield _joint(f"{names[b]}_fixed", "fixed", parent, names[b], here, "")


_FREE = 0
_KINDS = {_FREE: "floating", 2: "prismatic", 3: "revolute"}  # mjtJoint


def _placed(position: np.ndarray, quat: Sequence[float] = (1.0, 0.0, 0.0, 0.0)) -> Any:
    """A pose, SE3 of Pinocchio, of a quaternion w, x, y, z."""
    pin = load_pinocchio()
    return pin.SE3(pin.Quaternion(*map(float, quat)).normalized(), np.array(position, dtype=float))


def _origin(place: Any) -> str:
    """The <origin> of a pose."""
    values = place.translation, load_pinocchio().rpy.matrixToRpy(place.rotation)
    return '<origin xyz="{}" rpy="{}"/>'.format(*(" ".join(f"{x:.17g}" for x in value) for value in values))


def _joint(name: str, kind: str, parent: str, child: str, place: Any, more: str) -> str:
    kind = "continuous" if kind == "revolute" and "lower" not in more else kind
    ends = f"<parent link={quoteattr(parent)}/><child link={quoteattr(child)}/>"
    return f'<joint name={quoteattr(name)} type="{kind}">{ends}{_origin(place)}{more}</joint>'


def _limits(model: Any, j: int, kind: str, efforts: np.ndarray) -> str:
    """Axis, range and effort; MuJoCo has no limits of speed."""
    if kind == "floating":
        return ""
    axis = " ".join(f"{value:.17g}" for value in model.jnt_axis[j])
    text = ""
    if model.jnt_limited[j]:
        text = ' lower="{:.17g}" upper="{:.17g}"'.format(*model.jnt_range[j])
    elif kind == "prismatic":
        text = ' lower="-1e9" upper="1e9"'
    effort = f' effort="{efforts[j]:.17g}"' if np.isfinite(efforts[j]) else ""
    return f'<axis xyz="{axis}"/><limit{text}{effort}/>'


def _efforts(mujoco: Any, model: Any) -> np.ndarray:
    """(njnt,) N m or N that the actuators of each joint have; infinite: not limited."""
    scalars = np.full(model.njnt, np.inf)
    for j in np.flatnonzero(model.jnt_actfrclimited):
        scalars[j] = np.abs(model.jnt_actfrcrange[j]).max()
    of_joints = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    for a in np.flatnonzero(of_joints & (model.actuator_forcelimited > 0)):
        j = model.actuator_trnid[a, 0]
        force = np.abs(model.actuator_forcerange[a]).max() * abs(model.actuator_gear[a, 0])
        scalars[j] = min(scalars[j], force)
    return scalars


def _solids(mujoco: Any, model: Any, g: int, target: Path, meshes: dict[Path, str]) -> Iterator[str]:
    """Collision solids of a geom; a plane has none, a capsule is a cylinder with two balls."""
    kinds, kind, size = mujoco.mjtGeom, mujoco.mjtGeom(model.geom_type[g]), model.geom_size[g]
    place = _placed(model.geom_pos[g], model.geom_quat[g])
    shapes: list[tuple[float, str]] = []  # where along z
    if kind == kinds.mjGEOM_BOX:
        shapes = [(0.0, '<box size="{:.17g} {:.17g} {:.17g}"/>'.format(*(2 * size)))]
    elif kind == kinds.mjGEOM_SPHERE:
        shapes = [(0.0, f'<sphere radius="{size[0]:.17g}"/>')]
    elif kind == kinds.mjGEOM_ELLIPSOID:  # within its largest ball
        shapes = [(0.0, f'<sphere radius="{size.max():.17g}"/>')]
    elif kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
        shapes = [(0.0, f'<cylinder radius="{size[0]:.17g}" length="{2 * size[1]:.17g}"/>')]
        if kind == kinds.mjGEOM_CAPSULE:
            shapes += [(end, f'<sphere radius="{size[0]:.17g}"/>') for end in (-size[1], size[1])]
    elif kind == kinds.mjGEOM_MESH:
        m = model.geom_dataid[g]
        name = f"{target.stem}_meshes/{model.mesh(m).name or f'mesh_{m}'}.obj"
        first, count = model.mesh_vertadr[m], model.mesh_vertnum[m]
        lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in model.mesh_vert[first : first + count]]
        first, count = model.mesh_faceadr[m], model.mesh_facenum[m]
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in model.mesh_face[first : first + count]]
        meshes[target.parent / name] = "\n".join([*lines, ""])
        shapes = [(0.0, f"<mesh filename={quoteattr(name)}/>")]
    for along, shape in shapes:
        origin = _origin(place * _placed(np.array([0.0, 0.0, along])))
        yield f"<collision>{origin}<geometry>{shape}</geometry></collision>"
