"""The XML of a URDF file: its outermost element, its joints, and all that is wrong with it at once.

Pinocchio, which reads masses and placements, gives up at the first fault, with a message for developers.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from xml.etree import ElementTree

from ocptip.basics.errors import InputError
from ocptip.basics.read import parse_xml, read_xml_text
from ocptip.basics.text import did_you_mean

KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
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
_XACRO = re.compile(r"\{[^}]*xacro\}")
_VERSIONS = ("1", "1.0", "1.1", "1.2")
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


def parse_urdf(file: Path) -> ElementTree.Element:
    """The outermost element; InputError if there is none, which says what the file is instead."""
    return xml_of(file)[0]


def xml_of(file: Path) -> tuple[ElementTree.Element, str]:
    """The outermost element and the text, in UTF-8; errors as of :func:`parse_urdf`.

    Two customs of makers are put into what all parsers read. A limit without effort or velocity has none, as
    version 1.2 allows. A capsule is a cylinder of its length with a ball at either end.
    """
    text = read_xml_text(file)
    advice = f"a xacro file, not a URDF yet; expand it: xacro {file.name} > robot.urdf, or ocptip init"
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
    limits = [limit for limit in root.iter("limit") if not {"effort", "velocity"} <= limit.attrib.keys()]
    for limit in limits:  # parsers of older versions refuse the file; 0 stands for no limit
        limit.attrib.update({"effort": "0", "velocity": "0"} | limit.attrib)
    changed = bool(limits) | _open_capsules(root)
    return root, ElementTree.tostring(root, "unicode") if changed else text


def _open_capsules(root: ElementTree.Element) -> bool:
    """Replace capsules by their parts in place; whether there are any. Those without numbers stay."""
    result = False
    for link, tag in product(root.findall("link"), ("collision", "visual")):
        for element in link.findall(tag):
            capsule, origin = element.find("geometry/capsule"), element.find("origin")
            size = " ".join("" if capsule is None else capsule.get(key, "") for key in ("radius", "length"))
            placing = {"xyz": "0 0 0", "rpy": "0 0 0"} | ({} if origin is None else origin.attrib)
            numbers = _are_numbers(size, 2) and all(_are_numbers(placing[key], 3) for key in ("xyz", "rpy"))
            if capsule is None or not numbers:
                continue
            radius, length = map(float, size.split())
            (x, y, z), (roll, pitch, yaw) = (map(float, placing[key].split()) for key in ("xyz", "rpy"))
            along = (
                math.cos(yaw) * math.sin(pitch) * math.cos(roll) + math.sin(yaw) * math.sin(roll),
                math.sin(yaw) * math.sin(pitch) * math.cos(roll) - math.cos(yaw) * math.sin(roll),
                math.cos(pitch) * math.cos(roll),
            )
            for side in (-0.5, 0.5):
                end = [index + side * length * part for index, part in zip((x, y, z), along, strict=True)]
                ball = ElementTree.SubElement(link, tag)
                ElementTree.SubElement(ball, "origin", xyz=" ".join(map(repr, end)))
                ElementTree.SubElement(
                    ElementTree.SubElement(ball, "geometry"), "sphere", radius=f"{radius!r}"
                )
            capsule.tag, result = "cylinder", True
    return result


def is_mjcf(text: str) -> bool:
    """Whether an XML text is a MuJoCo model."""
    try:
        return parse_xml(text).tag == "mujoco"
    except (InputError, ElementTree.ParseError):
        return False


def require_shallow(root: ElementTree.Element, file: Path) -> None:
    """Refuse robots of which a C++ parser, which calls itself for every link, would end the process.

    Raises:
        InputError: says how many links are in a row, or in all.
    """
    above = {joint.child: joint.parent for joint in map(joint_of, root.findall("joint"))}
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


def require_valid(root: ElementTree.Element, file: Path) -> None:
    """Refuse elements that describe no robot.

    Raises:
        InputError: one line with all reasons.
    """
    complaints = [*_numbers(root), *_tree(root)]
    if complaints:
        more = f"; and {len(complaints) - _MOST} more" if len(complaints) > _MOST else ""
        raise InputError("; ".join(complaints[:_MOST]) + more, "", str(file))


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
        yield from _joint_complaints(element, links)
        joint = joint_of(element)
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
        seen, current = {link}, link
        while current != root and current in above:
            current = above[current][0]
            if current == link:
                yield f"link {link!r} is an ancestor of itself; a URDF is a tree"
                return
            if current in seen:
                break
            seen.add(current)


def _joint_complaints(element: ElementTree.Element, links: list[str]) -> Iterator[str]:
    """What is wrong with a joint."""
    joint = joint_of(element)
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
    yield from (f"{who}: {reason}" for reason in _parser_complaints(element))
    text = "1 0 0" if axis is None else axis.get("xyz", "1 0 0")
    if joint.kind != "fixed" and _are_numbers(text, 3) and not any(map(float, text.split())):
        yield f"{who}: its axis is 0 0 0"


def _parser_complaints(joint: ElementTree.Element) -> Iterator[str]:
    """What the parser of Pinocchio refuses with no more than "not a valid URDF"."""
    dynamics = joint.find("dynamics")
    if dynamics is not None and not {"damping", "friction"} & {*dynamics.attrib}:
        yield "<dynamics> has neither damping nor friction; take it out"
    if any("k_velocity" not in controller.attrib for controller in joint.findall("safety_controller")):
        yield "<safety_controller> has no k_velocity; give it, or take the element out"
    if any("joint" not in mimic.attrib for mimic in joint.findall("mimic")):
        yield "<mimic> names no joint"


def joint_of(element: ElementTree.Element) -> UrdfJoint:
    """The joint that an element describes."""
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
