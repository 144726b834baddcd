"""Links and joints of a URDF file; one message names everything that is wrong with it.

Pinocchio, which reads masses and placements, gives up at the first fault, and its messages are hard to
understand.
"""

from __future__ import annotations

import html
import math
import os
import re
from collections import Counter
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree

from ocptip.basics.errors import InputError
from ocptip.basics.read import parse_xml, read_xml_text
from ocptip.basics.text import did_you_mean

KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
TOOLS = (
    *("tool0", "tcp", "tool_frame", "tool_link", "tool", "grasp_frame", "grasping_frame", "grasptarget"),
    *("ee_link", "ee", "eef", "end_effector_link", "end_effector", "gripper_link", "flange"),
)
"""Names of tool frames, alone or behind a prefix such as "left_", in the order in which they are chosen."""

MOST_IN_A_ROW, MOST_JOINTS = 500, 10_000
"""Joints one behind the other, and in all, of a robot that is read."""

_ONE_NUMBER = {
    "mass": ("value",),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "limit": ("lower", "upper", "effort", "velocity", "acceleration", "deceleration", "jerk"),
    "mimic": ("multiplier", "offset"),
}
_THREE_NUMBERS = {"origin": ("xyz", "rpy"), "axis": ("xyz",)}
_OTHERS = {"sdf": "an SDF file", "mujoco": "a MuJoCo model", "COLLADA": "a COLLADA file"}
_PREFIX = re.compile(r"(</?|\s)([A-Za-z_]\w*):(?=[A-Za-z_][\w.-]*\s*[=\s/>])")
_FILENAME = re.compile(r"""(\bfilename\s*=\s*)(["'])(.*?)\2""", re.DOTALL)
_XACRO = re.compile(r"\{[^}]*xacro\}")
_VERSIONS = ("1", "1.0", "1.1", "1.2")
_HAND = 1.5
_MOST = 8  # complaints shown; the rest is counted


@dataclass(frozen=True)
class UrdfJoint:
    """A joint.

    Attributes:
        name: unique in its file.
        kind: one of `KINDS`.
        parent, child: links.
        mimics: master joint (it may be missing in the file), multiplier and offset (rad or m), or None.
        axis: (3,), axes of the child; None: the file gives none.
        acceleration, jerk: limits of URDF 1.2, rad/s^2 and rad/s^3 (m/s^2, m/s^3), which Pinocchio does not
            read; of acceleration and deceleration the smaller one; infinite: none.
    """

    name: str
    kind: str
    parent: str
    child: str
    mimics: tuple[str, float, float] | None
    axis: tuple[float, ...] | None = None
    acceleration: float = math.inf
    jerk: float = math.inf

    @property
    def slides(self) -> bool:
        """True for a sliding joint."""
        return self.kind == "prismatic"


@dataclass(frozen=True)
class UrdfFile:
    """The tree of a URDF.

    Attributes:
        path: of the file.
        name: of the robot.
        links: their names, in the file's order.
        joints: by name, in the file's order.
        masses: of the links that have one, kg.
    """

    path: Path
    name: str
    links: tuple[str, ...]
    joints: Mapping[str, UrdfJoint]
    masses: Mapping[str, float]

    @cached_property
    def above(self) -> Mapping[str, UrdfJoint]:
        """The joint between each link, but the root, and its parent."""
        return {joint.child: joint for joint in self.joints.values()}

    @cached_property
    def root(self) -> str:
        """The link without a parent."""
        return next(link for link in self.links if link not in self.above)

    @property
    def mass(self) -> float:
        """kg, of all links."""
        return sum(self.masses.values())

    @cached_property
    def standing(self) -> str:
        """The root, or the link behind joints that drive a base over the ground.

        Simulators put such joints between a root without mass and the base: a planar or a floating one, or
        two sliding ones and perhaps one that turns, whose links have no mass. The wheels are their drives.
        Fixed joints may be between them.
        """
        link, kinds = self.root, []
        while not self.masses.get(link):
            behind = [joint for joint in self.joints.values() if joint.parent == link]
            if len(behind) != 1:
                break
            kinds += [behind[0].kind] if behind[0].kind != "fixed" else []
            link = behind[0].child
        slides = [kind == "prismatic" for kind in kinds]
        drives = slides[:2] == [True, True] and len(kinds) <= 3 and not any(slides[2:])
        return (
            link if self.masses.get(link) and (drives or kinds in (["planar"], ["floating"])) else self.root
        )

    def way(self, link: str) -> list[UrdfJoint]:
        """Joints from the root to a link."""
        found: list[UrdfJoint] = []
        while link in self.above:
            found.insert(0, self.above[link])
            link = found[0].parent
        return found

    def leader(self, joint: UrdfJoint, locked: Container[str]) -> tuple[UrdfJoint | None, float, float]:
        """The joint that one follows in the end, ratio and offset (rad or m); none if there is no such joint.

        Joints that follow others may be followed; `locked` ones follow none.
        """
        ratio, offset, seen = 1.0, 0.0, set()
        while joint.mimics and joint.name not in locked:
            master, own, shift = joint.mimics
            if joint.name in seen or master not in self.joints:
                return None, ratio, offset
            seen.add(joint.name)
            ratio, offset, joint = ratio * own, offset + ratio * shift, self.joints[master]
        return joint, ratio, offset

    def ends(self, base: str) -> list[str]:
        """Links behind `base` that carry no further link and do not rest on it."""
        parents = {joint.parent for joint in self.joints.values()}
        return [link for link in self.links if link not in parents and self._moves(base, link)]

    def tips(self, base: str) -> list[str]:
        """The ends behind `base`; of the fingers of a hand instead the link that carries them.

        A hand is a link behind which joints move in several chains, with at least `_HAND` times as many
        moving joints before it as behind it. What is fixed to it stays a tip.
        """
        ends, forks = self.ends(base), Counter[str]()
        after: dict[str, int] = {}
        for end in ends:
            count = 0
            for joint in reversed(self.way(end)):
                count += joint.kind != "fixed"
                after[joint.parent] = max(after.get(joint.parent, 0), count)
        for joint in self.joints.values():
            forks[joint.parent] += joint.kind != "fixed" or after.get(joint.child, 0) > 0
        found = []
        for end in ends:
            way, before = self.way(end), 0
            way = way[next(k for k, joint in enumerate(way) if joint.parent == base) :]
            total = sum(joint.kind != "fixed" for joint in way)
            hand = end
            for joint in way:
                before += joint.kind != "fixed"
                if forks[joint.child] > 1 and before >= _HAND * after[joint.child] and before < total:
                    hand = joint.child
                    break
            found.append(hand)
        return list(dict.fromkeys(found))

    def _moves(self, base: str, link: str) -> bool:
        way = self.way(link)
        starts = [index for index, joint in enumerate(way) if joint.parent == base]
        return bool(starts) and any(joint.kind != "fixed" for joint in way[starts[0] :])

    def base_link(self, name: str | None) -> str:
        """The link of this name, or behind the joint of this name; by default that which stands.

        Raises:
            InputError: no such link; lists those that carry joints.
        """
        if name is None:
            return self.standing
        carriers = dict.fromkeys(j.parent for j in self.joints.values() if j.kind != "fixed")
        return self._known("base_link", name, [self.root, *carriers])

    def tool_frame(self, name: str | None, base: str) -> str:
        """The link of this name, or behind the joint of this name; by default that called like a tool.

        If none is called so it is the only one of the `tips`.

        Raises:
            InputError: no such link, or several; lists the candidates. Or nothing moves behind `base`.
        """
        ends = self.tips(base)
        if name is not None:
            return self._known("tool_frame", name, ends)
        behind = [link for link in self.links if self._moves(base, link)]
        for tool in TOOLS:
            found = [k for k in behind if k.lower() == tool or k.lower().endswith(("_" + tool, "-" + tool))]
            if len(found) == 1:
                return found[0]
            if found:
                raise InputError(f"tool_frame: is missing, candidates: {', '.join(found)}")
        if len(ends) == 1:
            return ends[0]
        if not ends:
            raise InputError(f"base_link: no joint moves behind {base!r}")
        raise InputError(f"tool_frame: is missing, candidates: {', '.join(ends)}")

    def _known(self, argument: str, name: str, candidates: list[str]) -> str:
        if name in self.links:
            return name
        if name in self.joints:  # its frame is that of its child
            return self.joints[name].child
        near = did_you_mean(name, self.links)
        listed = ", ".join(dict.fromkeys(candidates)) or "none"
        raise InputError(f"{argument}: no {name!r}; candidates: {listed}{near}")

    def locked(self, wanted: Mapping[str, float], *, slides: bool) -> dict[str, float]:
        """Values by joint name, out of values by name or pattern ("finger_*"); full names go before patterns.

        Args:
            wanted: rad, or m if `slides`.
            slides: of sliding joints; others turn.

        Raises:
            InputError: no joint of this kind has such a name.
        """
        found: dict[str, float] = {}
        for pattern in sorted(wanted, key=lambda key: key in self.joints):
            named = [joint for joint in self.joints.values() if fnmatchcase(joint.name, pattern)]
            fitting = [joint.name for joint in named if joint.kind != "fixed" and joint.slides == slides]
            if not fitting and named:
                kind = "is fixed" if named[0].kind == "fixed" else "turns" if slides else "slides"
                key = "locked_deg" if slides else "locked_m"
                advice = "" if named[0].kind == "fixed" else f", its key is {key}"
                raise InputError(f"joint {named[0].name!r} {kind}{advice}", "")
            if not fitting:
                known = [joint.name for joint in self.joints.values() if joint.kind != "fixed"]
                listed = ", ".join(known) or "none"
                raise InputError(
                    f"no joint {pattern!r}; there are {listed}{did_you_mean(pattern, known)}", ""
                )
            found |= dict.fromkeys(fitting, wanted[pattern])
        return found


def read_urdf(path: str | os.PathLike[str]) -> UrdfFile:
    """Read the tree of a URDF.

    Raises:
        InputError: the file cannot be read or describes no robot; one line with all reasons.
    """
    file = Path(path)
    root = parse_urdf(file)
    require_shallow(root, file)
    complaints = [*_numbers(root), *_tree(root)]
    if complaints:
        more = f"; and {len(complaints) - _MOST} more" if len(complaints) > _MOST else ""
        raise InputError("; ".join(complaints[:_MOST]) + more, "", str(file))
    joints = {element.get("name", ""): _joint(element) for element in root.findall("joint")}
    links = tuple(element.get("name", "") for element in root.findall("link"))
    masses = {
        link.get("name", ""): float(mass.get("value", 0))
        for link in root.findall("link")
        if (mass := link.find("inertial/mass")) is not None
    }
    return UrdfFile(file, root.get("name") or file.stem, links, joints, masses)


def with_files(text: str, names: Mapping[str, str]) -> str:
    """The text of a URDF with other names of files (meshes), by their old ones; all else stays as it is."""

    def put(found: re.Match[str]) -> str:
        name = names.get(html.unescape(found[3]))
        return found[0] if name is None else f'{found[1]}"{html.escape(name)}"'

    return _FILENAME.sub(put, text)


def parse_urdf(file: Path) -> ElementTree.Element:
    """The outermost element; InputError if there is none, which says what the file is instead."""
    return xml_of(file)[0]


def xml_of(file: Path) -> tuple[ElementTree.Element, str]:
    """The outermost element and the text, in UTF-8; errors as of :func:`parse_urdf`."""
    text = read_xml_text(file)
    advice = f"a xacro file, not a URDF yet; expand it: xacro {file.name} > robot.urdf"
    problem, root = None, ElementTree.Element("")
    try:
        # Parsers of robots know no namespaces and take undeclared prefixes, such as drake:acceleration.
        root = parse_xml(_PREFIX.sub(r"\1\2_", text) if "xmlns" not in text else text)
        if any(_XACRO.match(e.tag) or "${" in "".join(e.attrib.values()) for e in root.iter()):
            problem = advice
        elif root.tag != "robot":
            what = _OTHERS.get(root.tag, f"its outermost element is <{root.tag}>")
            problem = f"not a URDF (<robot>): {what}"
    except InputError as error:
        problem = error.text
    except ElementTree.ParseError as error:
        if not text.strip():
            problem = "is empty"
        elif text.startswith("version https://git-lfs"):
            problem = "a pointer of git-lfs, not the file itself; get it: git lfs pull"
        else:
            problem = advice if re.search(r"<xacro:|xmlns:xacro", text) else f"broken XML: {error}"
    if problem:
        raise InputError(problem, "", str(file))
    return root, text


def require_shallow(root: ElementTree.Element, file: Path) -> None:
    """Refuse robots of which a C++ parser, which calls itself for every link, would end the process.

    Raises:
        InputError: says how many links are in a row, or in all.
    """
    above = {joint.child: joint.parent for joint in map(_joint, root.findall("joint"))}
    if len(above) > MOST_JOINTS:
        raise InputError(f"has {len(above)} joints; expected at most {MOST_JOINTS}", "", str(file))
    depths: dict[str, int] = {}
    for link in above:
        way: dict[str, None] = {}
        while link in above and link not in depths and link not in way:  # a circle is refused elsewhere
            way[link] = None
            link = above[link]
        for number, one in enumerate(reversed(way), depths.get(link, 0) + 1):
            depths[one] = number
    if depths and (most := max(depths.values())) > MOST_IN_A_ROW:
        raise InputError(f"has {most} joints in a row; expected at most {MOST_IN_A_ROW}", "", str(file))


def _numbers(root: ElementTree.Element) -> Iterator[str]:
    """Attributes that should be numbers and are not."""
    for owner in root:
        if owner.tag not in ("link", "joint"):
            continue
        for element in owner.iter():
            for keys, count in ((_ONE_NUMBER, 1), (_THREE_NUMBERS, 3)):
                for key in keys.get(element.tag, ()):
                    if key in element.attrib and not _are_numbers(text := element.attrib[key], count):
                        what = "a number" if count == 1 else "three numbers"
                        where = f"{owner.tag} {owner.get('name')!r}: <{element.tag} {key}>"
                        yield f"{where}: expected {what}, got {text!r}"


def _are_numbers(text: str, count: int) -> bool:
    try:
        return len(text.split()) == count and all(math.isfinite(float(word)) for word in text.split())
    except ValueError:
        return False


def _tree(root: ElementTree.Element) -> Iterator[str]:
    """What keeps links and joints from being one tree."""
    links, joints = ([e.get("name", "") for e in root.findall(tag)] for tag in ("link", "joint"))
    if not links:
        other = any(root.find(tag) is not None for tag in ("disable_collisions", "group", "end_effector"))
        yield "no <link> in it" + ("; it is an SRDF, whose key is srdf" if other else "")
    if root.get("version", "1.0") not in _VERSIONS:
        yield f"<robot version>: expected 1.0 to 1.2, got {root.get('version')!r}"
    if "name" not in root.attrib:
        yield '<robot> has no name; write <robot name="...">'
    materials = [element.get("name", "") for element in root.findall("material[@name]")]
    for kind, names in (("link", links), ("joint", joints), ("material", materials)):
        for name, count in Counter(names).items():
            if not name:
                yield f"a {kind} has no name"
            elif count > 1:
                yield f"{count} {kind}s are called {name!r}"
    above: dict[str, list[str]] = {}
    for element in root.findall("joint"):
        yield from _joint_complaints(element, links, lean=root.get("version") == "1.2")
        joint = _joint(element)
        above.setdefault(joint.child, []).append(joint.parent)
    for child, parents in above.items():
        if len(parents) > 1:
            yield f"link {child!r} is the child of {len(parents)} joints; a URDF is a tree"
    roots = [link for link in links if link not in above]
    if links and len(roots) != 1:
        listed = ", ".join(map(repr, roots[:4]))
        yield f"expected one link without a parent, got {len(roots)}{': ' if roots else ''}{listed}"
    elif links and all(len(p) == 1 for p in above.values()):
        yield from _loops(above, roots[0])


def _loops(above: Mapping[str, list[str]], root: str) -> Iterator[str]:
    for link in above:
        seen, at = {link}, link
        while at != root and at in above:
            at = above[at][0]
            if at == link:
                yield f"link {link!r} is an ancestor of itself; a URDF is a tree"
                return
            if at in seen:
                break
            seen.add(at)


def _joint_complaints(element: ElementTree.Element, links: list[str], *, lean: bool) -> Iterator[str]:
    """What is wrong with a joint; in a `lean` version of URDF limits need neither effort nor velocity."""
    joint = _joint(element)
    who = f"joint {joint.name!r}"
    if joint.kind not in KINDS:
        near = did_you_mean(joint.kind, KINDS)
        yield f"{who}: type {joint.kind!r}, expected one of {', '.join(KINDS)}{near}"
    for word, link in (("parent", joint.parent), ("child", joint.child)):
        if not link:
            yield f"{who}: no <{word} link=...>"
        elif link not in links:
            yield f"{who}: {word} {link!r} is no link of the file{did_you_mean(link, links)}"
    limit, axis = element.find("limit"), element.find("axis")
    if joint.kind in ("revolute", "prismatic"):
        if limit is None:
            yield f"{who}: a {joint.kind} joint needs <limit lower upper effort velocity>"
        elif _are_numbers(f"{limit.get('lower', 0)} {limit.get('upper', 0)}", 2):
            lower, upper = float(limit.get("lower", 0)), float(limit.get("upper", 0))
            if lower > upper:
                yield f"{who}: lower limit {lower:g} is above the upper one, {upper:g}"
    yield from (f"{who}: {reason}" for reason in _parser_complaints(element, lean=lean))
    text = "1 0 0" if axis is None else axis.get("xyz", "1 0 0")
    if joint.kind != "fixed" and _are_numbers(text, 3) and not any(map(float, text.split())):
        yield f"{who}: its axis is 0 0 0"


def _parser_complaints(joint: ElementTree.Element, *, lean: bool) -> Iterator[str]:
    """What the parser of Pinocchio refuses with no more than "not a valid URDF"."""
    limit, dynamics = joint.find("limit"), joint.find("dynamics")
    needed = () if lean else ("effort", "velocity")
    if limit is not None and (lacking := [key for key in needed if key not in limit.attrib]):
        yield f"<limit> has no {' and no '.join(lacking)}; give 0 where there is no limit"
    if dynamics is not None and not {"damping", "friction"} & {*dynamics.attrib}:
        yield "<dynamics> has neither damping nor friction; take it out"
    if any("k_velocity" not in controller.attrib for controller in joint.findall("safety_controller")):
        yield "<safety_controller> has no k_velocity; give it, or take the element out"
    if any("joint" not in mimic.attrib for mimic in joint.findall("mimic")):
        yield "<mimic> names no joint"


def _joint(element: ElementTree.Element) -> UrdfJoint:
    tags = ("parent", "child", "mimic", "axis", "limit")
    parent, child, mimic, axis, limit = (element.find(tag) for tag in tags)
    mimics, along = None, "" if axis is None else axis.get("xyz", "")
    if mimic is not None:
        factor, offset = mimic.get("multiplier", "1"), mimic.get("offset", "0")
        if _are_numbers(f"{factor} {offset}", 2):
            mimics = mimic.get("joint", ""), float(factor), float(offset)
    return UrdfJoint(
        element.get("name", ""),
        element.get("type", ""),
        "" if parent is None else parent.get("link", ""),
        "" if child is None else child.get("link", ""),
        mimics,
        tuple(map(float, along.split())) if _are_numbers(along, 3) else None,
        min(_positive(limit, key) for key in ("acceleration", "deceleration")),
        _positive(limit, "jerk"),
    )


def _positive(limit: ElementTree.Element | None, key: str) -> float:
    """A limit; infinite if there is none, or 0, which stands for none in many files."""
    text = "" if limit is None else limit.get(key, "")
    value = float(text) if _are_numbers(text, 1) else 0.0
    return value if value > 0 else math.inf
