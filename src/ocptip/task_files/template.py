"""A task file for a URDF, with everything that the URDF knows, and marked places for what it cannot know."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.schema import Key
from ocptip.basics.text import some
from ocptip.basics.toml import MARK, toml_value
from ocptip.robots.collision.gaps import CLEARANCE
from ocptip.robots.model import FULL_SPEED, ArmModel
from ocptip.robots.urdf.arm import arm_from_urdf
from ocptip.robots.urdf.collision import PACKAGE, geometry_from_urdf, missing_meshes
from ocptip.robots.urdf.file import UrdfFile, like_tools, read_urdf
from ocptip.robots.urdf.ground_contacts import GroundContact
from ocptip.robots.urdf.joint_limits import named_states, with_joint_limits
from ocptip.robots.urdf.sanity import ImpossibleLinksError, doubt_speeds
from ocptip.standing.limits import LIMIT_KEYS
from ocptip.task_files.example import ExampleBase, ExampleMotion, example_base, example_motion
from ocptip.task_files.tables.arm import ARM, ARM_LIMITS
from ocptip.task_files.tables.joints import end_keys
from ocptip.task_files.tables.motors import MOTORS
from ocptip.task_files.task_scene import ROBOT_BASE

SCHEMA = "task.schema.json"
"""File beside a task, from which editors know the keys."""
_OF_URDF = ARM.known_variants["urdf"].keys
_WIDTH = 44  # columns before a comment
_AHEAD = 1e-3  # m: nearer to the last joint a tool frame says no direction
_INVENTED = f"invented while {MARK} stands here"  # true when users have put their own value there, too


@dataclass(frozen=True, eq=False)
class TaskTemplate:
    """A task file to be filled in.

    Attributes:
        text: its content.
        arm: the arm that it describes.
        base_link, tool_frame: names that were given or detected.
        base: on which it stands.
        missing: missing mesh files of its collision geometry; None: it has no such geometry.
        example: where the numbers of the example motion come from.
    """

    text: str
    arm: ArmModel
    base_link: str
    tool_frame: str
    base: ExampleBase
    missing: list[str] | None
    example: str

    @property
    def to_fill(self) -> list[str]:
        """Keys of the marked lines."""
        return marked(self.text)


def task_template(
    urdf: str | os.PathLike[str],
    folder: Path,
    *,
    base_link: str | None = None,
    tool_frame: str | None = None,
    joint_limits: str | os.PathLike[str] | None = None,
    srdf: str | os.PathLike[str] | None = None,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
    armature: Mapping[str, float] | None = None,
    notes: Sequence[str] = (),
) -> TaskTemplate:
    """The file of a motion task for the arm of a URDF.

    Args:
        urdf: the URDF file.
        folder: where the task file will be.
        base_link, tool_frame: see `arm_from_urdf`.
        joint_limits: `joint_limits.yaml` of MoveIt.
        srdf: of MoveIt, with pairs that may touch and named states.
        package_dirs: folders with packages, for names of meshes.
        armature: inertias of rotors, kg m^2 (sliding joints: kg), by joint, which the URDF lacks.
        notes: what else it lacks, one sentence each.

    Raises:
        InputError: the URDF cannot be used; see `arm_from_urdf`.
    """
    file = read_urdf(urdf)
    base = file.base_link(base_link)
    tool = file.tool_frame(tool_frame, base)
    doubtful: dict[str, str] = {}
    try:
        arm = arm_from_urdf(urdf, base_link=base, tool_frame=tool)
    except ImpossibleLinksError as error:
        doubtful = error.links
        arm = arm_from_urdf(urdf, base_link=base, tool_frame=tool, accept_inertia=list(doubtful))
    arm = arm if joint_limits is None else with_joint_limits(arm, joint_limits)
    arm = replace(arm, states={} if srdf is None else named_states(srdf)).with_notes(*notes)
    rotors = np.array([(armature or {}).get(name, 0.0) for name in arm.joint_names])
    arm = replace(arm, armature=np.where(rotors > 0, rotors, arm.armature))
    doubt_speeds(arm)
    missing = missing_meshes(urdf, package_dirs)
    geometry, broken = None, ""
    try:
        if missing is not None and not missing:
            geometry = geometry_from_urdf(urdf, arm, srdf=srdf, package_dirs=package_dirs)
    except InputError as error:
        broken = str(error)
    foot = example_base(file, arm)
    example = example_motion(arm, geometry, foot)
    of_arm = (
        *_arm(file, arm, base, tool, folder, foot, {"joint_limits": joint_limits, "srdf": srdf}),
        *_inertia(doubtful),
        *_geometry(missing, broken, [_relative(one, folder) for one in package_dirs]),
    )
    of_base = (_base(foot), *map(_contact, _rolling(foot)))
    sections = (*of_base, of_arm, _limits(arm), _payload(arm), _motion(arm, example), _near(example))
    body = "\n\n".join(filter(None, ("\n".join(lines) for lines in sections))) + "\n"
    head = [
        f"#:schema ./{SCHEMA}",
        f"# Task for `ocptip plan`, written by `ocptip init` from {file.path.name}.",
        *(f"# {group}: {', '.join(items)}." for group, items in _groups(arm, foot, marked(body)).items()),
        "# SI units; keys in degrees say so. All keys: `ocptip schema --page`.",
        f"name = {toml_value(file.name)}",
    ]
    text = "\n".join(head) + "\n\n" + body
    return TaskTemplate(text, arm, base, tool, foot, missing, example.source)


def marked(text: str) -> list[str]:
    """Keys of the marked lines."""
    lines = (line for line in text.splitlines() if line.startswith(MARK))
    return [line.removeprefix(MARK).split("=")[0].strip() for line in lines]


def _groups(arm: ArmModel, foot: ExampleBase, to_fill: Sequence[str]) -> dict[str, list[str]]:
    """The origins of the values of a template, for people who check it."""
    known, usual = ["joints, links and their limits"], ["motors", "start and goal, an example"]
    if foot.of_urdf:
        known.insert(0, "mass, centre of mass and inertia of the base")
    if foot.contacts_of_urdf:
        known.insert(1, f"{len(foot.contacts)} contacts and their distance from the base link")
    if any(contact.kind == "caster" for contact in foot.contacts):
        usual.insert(0, "casters without friction")
    if not np.isfinite(arm.limits.acceleration).all():
        usual.insert(0, "acceleration limits")
    groups = {"From the URDF": known, "From a default": usual}
    groups[f"To be given, in the lines that begin with {MARK}"] = list(to_fill)
    wheels = [
        "whether drives or brakes hold the wheels",
        'whether they are omni or mecanum (kind = "free-wheel")',
    ]
    groups["Not known to any URDF either"] = [*(wheels if _rolling(foot) else ()), "power of the drives"]
    return groups


def _rolling(foot: ExampleBase) -> list[GroundContact]:
    """The contacts, if not all of them are feet."""
    return list(foot.contacts) if any(contact.kind != "foot" for contact in foot.contacts) else []


def _contact(contact: GroundContact) -> Iterator[str]:
    yield f"[[contact]]  # {contact.reason}"
    yield f"position = {_list(np.round(contact.position, 4))}"
    if contact.kind == "caster":
        yield f"{'friction = 0.0':<{_WIDTH}}  # casters roll; a default"


def _base(foot: ExampleBase) -> Iterator[str]:
    yield f"[base]  # {ROBOT_BASE.meaning}"
    yield f"# As written by init: {foot.source}."
    keys, about = ROBOT_BASE.keys, "of the URDF's links that rest" if foot.of_urdf else _INVENTED
    centre = _list(np.round(foot.foot_center - [0, 0, foot.height], 3))
    if foot.foot_mass > 1e-9:
        about += f"; has to include {foot.foot_mass:.3g} kg of links of the URDF"
        links = f"{foot.foot_mass:.3g}"
        yield f"# Links of the URDF that do not move: {links} kg, centre {centre} m in the axes of base_link."
    yield _line(keys, "mass", f"{foot.mass:.9g}", about, mark=not foot.of_urdf)
    where, invented = "of the URDF" if foot.of_urdf else _INVENTED, not foot.contacts_of_urdf
    yield _line(keys, "center_of_mass", _list(np.round(foot.center_of_mass, 6)), where, mark=not foot.of_urdf)
    if foot.inertia is not None:
        yield _line(keys, "inertia", _list(foot.inertia[np.triu_indices(3)]), where)
    holds = f"{_INVENTED}, of all feet; casters and clamps: [[contact]]"
    if _rolling(foot):
        holds = f"{_INVENTED}, of all wheels; they hold only while drives or brakes hold them"
    else:
        feet = ", ".join(map(_list, np.round(foot.feet, 4)))
        where = _INVENTED if invented else "the lowest points of the URDF's geometry"
        yield _line(keys, "feet", f"[{feet}]", where, mark=invented)
    yield _line(keys, "friction", "0.5", holds, mark=True)
    if foot.foot_mass > 1e-9:
        yield "# To give mass and centre of the base without those links, let the program add them:"
        yield "# [[base.added]]"
        yield f"# mass = {foot.foot_mass:.6g}"
        place = _list(np.round(foot.foot_center, 6))
        yield f"# center_of_mass = {place}  # mount_position + {centre}: change both together"
    if not foot.contacts_of_urdf:
        yield "# Solid of base and deck: without it collisions of the arm with the base are not checked."
        yield "# [[base.shape]]"
        yield '# kind = "box"'
        yield "# size = [0.6, 0.5, 0.5]"
        yield "# position = [0.0, 0.0, 0.25]  # of the centre, base axes"


def _arm(
    file: UrdfFile,
    arm: ArmModel,
    base: str,
    tool: str,
    folder: Path,
    foot: ExampleBase,
    further: Mapping[str, str | os.PathLike[str] | None],
) -> Iterator[str]:
    yield f"[arm]  # {arm.n} joints, {arm.masses.sum():.4g} kg, reach from joint 1 below {arm.reach:.3g} m"
    for key, named in {"urdf": file.path, **further}.items():
        if named is not None:
            yield f"{key} = {toml_value(_relative(named, folder))}"
    yield _line(_OF_URDF, "base_link", toml_value(base))
    others = like_tools(link for link in file.ends(base) if link != tool)
    yield _line(_OF_URDF, "tool_frame", toml_value(tool), f"others: {some(others)}" if others else "")
    height = f"[0.0, 0.0, {round(foot.height, 9) + 0.0:.6g}]"
    yield _line(ARM.keys, "mount_position", height, mark=not foot.contacts_of_urdf)
    if arm.armature.any():
        yield _line(_OF_URDF, "armature", _list(arm.armature), ", ".join(arm.joint_names))
    yield from (f"# {note}" for note in arm.notes)


def _relative(path: str | os.PathLike[str], folder: Path) -> str:
    """A path as a task file in a folder names it."""
    return Path(os.path.relpath(Path(path).resolve(), folder.resolve())).as_posix()


def _geometry(missing: list[str] | None, broken: str, package_dirs: Sequence[str]) -> Iterator[str]:
    """What collisions need that the URDF does not give."""
    lacking = bool(missing) and any(name.startswith(PACKAGE) for name in missing)
    if package_dirs and not lacking:
        yield _line(_OF_URDF, "package_dirs", _texts(package_dirs))
    if broken:
        yield _line(_OF_URDF, "collision", "false", f"or mend {broken}", mark=True)
    elif missing is None:
        yield "# sphere_radius = 0.06  # m; no collision geometry in the URDF: else nothing is checked"
    elif lacking:
        dirs = _texts(package_dirs or ["."])
        yield _line(_OF_URDF, "package_dirs", dirs, f"missing: {some(missing, 2)}", mark=True)
    elif missing:
        yield _line(
            _OF_URDF, "collision", "false", f"or add the missing files: {some(missing, 2)}", mark=True
        )
        yield "# sphere_radius = 0.06  # m; instead of both: spheres along the links, so that they count"


def _limits(arm: ArmModel) -> Iterator[str]:
    """What the URDF lacks; its limits as comments, and accelerations that are assumed without others."""
    limits, width = arm.limits, max(map(len, arm.joint_names))
    shown = *map(arm.in_degrees, (limits.angle_min, limits.angle_max, limits.speed)), limits.torque
    yield "[arm.limits]  # the limits of the files above count, unless keys here replace them:"
    for j, name in enumerate(arm.joint_names):
        low, high, speed, torque = (_limit(values[j]) for values in shown)
        units = ("m", "m/s", "N") if arm.prismatic[j] else ("deg", "deg/s", "N m")
        line = f"#   {name:<{width}}  {low} to {high} {units[0]}, {speed} {units[1]}, {torque} {units[2]}"
        for values, power in ((limits.acceleration, 2), (limits.jerk, 3)):
            if np.isfinite(values[j]):
                line += f", {_limit(arm.in_degrees(values)[j])} {units[0]}/s^{power}"
        yield line
    for slides, keys, examples in (
        (False, ("speed_deg_s", "torque_Nm", "acceleration_deg_s2"), (90, 100)),
        (True, ("speed_m_s", "force_N", "acceleration_m_s2"), (0.2, 500)),
    ):
        indices = np.flatnonzero(arm.prismatic == slides)
        for key, values, example in zip(keys, (limits.speed, limits.torque), examples, strict=False):
            if lacking := [arm.joint_names[j] for j in indices if not np.isfinite(values[j])]:
                table = ", ".join(f"{toml_value(name)} = {example}" for name in lacking)
                yield _line(ARM_LIMITS.keys, key, f"{{ {table} }}", "not in the URDF", mark=True)
        unknown = indices[np.isfinite(limits.speed[indices]) & ~np.isfinite(limits.acceleration[indices])]
        if unknown.size:
            values = arm.in_degrees(limits.speed / FULL_SPEED)
            table = ", ".join(f"{toml_value(arm.joint_names[j])} = {values[j]:.6g}" for j in unknown)
            yield f"# {keys[2]} = {{ {table} }}  # assumed without this line: full speed in {FULL_SPEED:g} s"
    yield "\n[motors]"
    about = 'from torque and speed limits; "dc" with motor data'
    yield _line(MOTORS.keys, "kind", '"estimated"', about)


def _inertia(doubtful: Mapping[str, str]) -> Iterator[str]:
    """Moving links whose inertia no body has."""
    if doubtful:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in doubtful.items())
        yield _line(_OF_URDF, "accept_inertia", _texts(doubtful), f"if that is meant: {reasons}", mark=True)


def _payload(arm: ArmModel) -> Iterator[str]:
    """What the gripper holds, as a comment, for no URDF says it: in front of the tool, as seen from the last
    joint.
    """
    towards = arm.tool_rotation.T @ arm.offsets[-1]
    ahead = int(np.argmax(np.abs(towards))) if np.linalg.norm(towards) > _AHEAD else 2
    centre, size = np.zeros(3), np.full(3, 0.1)
    centre[ahead], size[ahead] = -0.1 if towards[ahead] < 0 else 0.1, 0.2
    yield "# [payload]  # what the gripper holds; without this table nothing"
    yield "# mass = 2.0  # kg"
    yield f"# center_of_mass = {centre.tolist()}  # m: from the origin of tool_frame, its axes"
    yield "# [payload.shape]  # its solid; without one collisions of the payload are not checked"
    yield '# kind = "box"'
    yield f"# size = {size.tolist()}  # m"
    yield f"# position = {centre.tolist()}  # m: of its centre, likewise"


def _motion(arm: ArmModel, example: ExampleMotion) -> Iterator[str]:
    places = {"start": arm.in_degrees(example.start), "goal": arm.in_degrees(example.goal)}
    yield f"[motion]  # {example.source}"
    yield "# Replace them by yours: joint values of the robot's display, or of ROS's /joint_states"
    yield "# (radians there), in the order behind each line; or a gripper pose, see below."
    for slides, key in ((False, "deg"), (True, "m")):
        indices = np.flatnonzero(arm.prismatic == slides)
        if indices.size:
            names = ", ".join(arm.joint_names[j] for j in indices)
            for place, values in places.items():
                yield _line(end_keys(place, place), f"{place}_{key}", _list(values[indices]), names)
    yield "# or start_pose = { position = [0.5, 0.0, 0.8], rpy_deg = [180, 0, 0] }: of tool_frame, base axes"
    if arm.states:
        states = list(arm.states)
        yield f"# or start = {toml_value(states[0])}; states of the SRDF: {', '.join(states)}"
    first = ", ".join(map(toml_value, arm.joint_names[:3]))
    yield f"# optimised = [{first}]  # only these; the others move in one trapezoidal profile each"


def _texts(texts: Iterable[str]) -> str:
    return f"[{', '.join(map(toml_value, texts))}]"


def _near(example: ExampleMotion) -> Iterator[str]:
    """A smaller clearance for an arm whose links are nearer to each other in the example than the default."""
    if example.clear is not None and example.usual <= example.clear < CLEARANCE:
        yield "[limits]"
        yield f"# clearance = {CLEARANCE}  # without this line {1e3 * example.usual:.1f} mm, for no posture"
        yield f"#   brings {example.nearest} farther apart than {2e3 * example.usual:.1f} mm"
    elif example.clear is not None and 0 <= example.clear < CLEARANCE:
        yield "[limits]"
        about = (
            f"{_INVENTED}; links of the example are {1e3 * example.clear:.2g} mm apart; default {CLEARANCE}"
        )
        value = f"{np.floor(8e3 * example.clear) / 1e4:g}"
        yield _line(LIMIT_KEYS, "clearance", value, about, mark=True)


def _line(keys: Mapping[str, Key], name: str, value: str, note: str = "", *, mark: bool = False) -> str:
    """A key with its value, and as comment what is declared of it and where the value comes from."""
    key, text = keys[name], f"{MARK} {name} = {value}" if mark else f"{name} = {value}"
    comment = ": ".join(filter(None, [key.unit, key.meaning.removesuffix(".")]))
    return f"{text:<{_WIDTH}}  # {comment}{f'; {note}' if note else ''}"


def _limit(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "none"


def _list(values: np.ndarray) -> str:
    return f"[{', '.join(f'{value:.6g}' for value in values + 0.0)}]"
