"""Links and joints of a URDF file; one message names everything that is wrong with it.

Pinocchio, which reads masses and placements, gives up at the first fault, and its messages are hard to
understand.
"""

from __future__ import annotations

import html
import os
import re
from collections import Counter
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path

from ocptip.basics.errors import InputError
from ocptip.basics.text import did_you_mean, some
from ocptip.robots.urdf.document import UrdfJoint, joint_of, parse_urdf, require_shallow, require_valid

TOOLS = (
    *("tool0", "tcp", "tool_frame", "tool_link", "tool", "grasp_frame", "grasping_frame", "grasptarget"),
    *("ee_link", "ee", "eef", "end_effector_link", "end_effector", "gripper_link", "flange"),
)
"""Names of tool frames, alone or behind a prefix such as "left_", in the order in which they are chosen."""

_LIKE_TOOLS = ("grasp", "tool", "tcp", "ee", "eef", "gripper", "hand", "flange")
_NO_TOOLS = (
    *("wheel", "caster", "camera", "aruco", "sensor", "optical", "lens", "imu", "lidar", "laser", "depth"),
    *("marker", "mic"),
)
_LISTED = 8  # candidates, at most

_FILENAME = re.compile(r"""(\bfilename\s*=\s*)(["'])(.*?)\2""", re.DOTALL)
_HAND = 1.5
_JAW, _NO_JAW = (
    re.compile(words, re.IGNORECASE) for words in ("grip|jaw|finger|claw", "wrist|rot|roll|yaw|pitch")
)


def like_tools(links: Iterable[str]) -> list[str]:
    """Links in the order in which they are likely tools: first those named so, last wheels and sensors."""

    def rank(name: str) -> int:
        words = re.split(r"[^a-z]+", name.lower())
        if any(word.startswith(_NO_TOOLS) for word in words):
            return len(_LIKE_TOOLS) + 1
        matches = (k for k, tool in enumerate(_LIKE_TOOLS) for word in words if _is_like(word, tool))
        return min(matches, default=len(_LIKE_TOOLS))

    return sorted(links, key=rank)


def _is_like(word: str, tool: str) -> bool:
    """Short names have to be the whole word."""
    return word == tool or (len(tool) > 3 and word.startswith(tool))


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
        urdf_joints: list[UrdfJoint] = []
        while link in self.above:
            urdf_joints.insert(0, self.above[link])
            link = urdf_joints[0].parent
        return urdf_joints

    def leader(self, joint: UrdfJoint, locked: Container[str]) -> tuple[UrdfJoint | None, float, float]:
        """The joint that one follows in the end, ratio and offset (rad or m); none if there is no such joint.

        Joints that follow others may be followed; `locked` ones follow none.
        """
        ratio, offset, seen = 1.0, 0.0, set()
        while joint.mimics and joint.name not in locked:
            master, multiplier, shift = joint.mimics
            if joint.name in seen or master not in self.joints:
                return None, ratio, offset
            seen.add(joint.name)
            ratio, offset, joint = ratio * multiplier, offset + ratio * shift, self.joints[master]
        return joint, ratio, offset

    def with_followers(self, follows: Mapping[str, tuple[str, float, float]]) -> UrdfFile:
        """This file with further joints that mimic others: name to leading joint, ratio and offset."""
        mimics = {name: replace(self.joints[name], mimics=follow) for name, follow in follows.items()}
        return replace(self, joints={**self.joints, **mimics}) if mimics else self

    def ends(self, base: str) -> list[str]:
        """Links behind `base` that carry no further link and do not rest on it."""
        parents = {joint.parent for joint in self.joints.values()}
        return [link for link in self.links if link not in parents and self._moves(base, link)]

    def tips(self, base: str) -> list[str]:
        """The ends behind `base`; of the fingers of a hand instead the link that carries them.

        A hand is a link behind which joints move in several chains, with at least `_HAND` times as many
        moving joints before it as behind it; so is the link that carries a single jaw, a last joint that is
        named like one. What is fixed to a hand stays a tip.
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
        results = []
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
            jaw = next(joint for joint in reversed(way) if joint.kind != "fixed")
            alone = hand == end and total > 1 + _HAND and _JAW.search(jaw.name)
            results.append(jaw.parent if alone and not _NO_JAW.search(jaw.name) else hand)
        return list(dict.fromkeys(results))

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
            results = [k for k in behind if k.lower() == tool or k.lower().endswith(("_" + tool, "-" + tool))]
            if len(results) == 1:
                return results[0]
            if results:
                raise InputError(f"tool_frame: is missing, candidates: {some(results, _LISTED)}")
        if len(ends) == 1:
            return ends[0]
        if not ends:
            raise InputError(f"base_link: no joint moves behind {base!r}")
        raise InputError(f"tool_frame: is missing, candidates: {some(like_tools(ends), _LISTED)}")

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
        table: dict[str, float] = {}
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
            table |= dict.fromkeys(fitting, wanted[pattern])
        return table


def read_urdf(path: str | os.PathLike[str]) -> UrdfFile:
    """Read the tree of a URDF.

    Raises:
        InputError: the file cannot be read or describes no robot; one line with all reasons.
    """
    file = Path(path)
    root = parse_urdf(file)
    require_shallow(root, file)
    require_valid(root, file)
    joints = {element.get("name", ""): joint_of(element) for element in root.findall("joint")}
    links = tuple(element.get("name", "") for element in root.findall("link"))
    masses = {
        link.get("name", ""): float(mass.get("value", 0))
        for link in root.findall("link")
        if (mass := link.find("inertial/mass")) is not None
    }
    return UrdfFile(file, root.get("name") or file.stem, links, joints, masses)


def with_files(text: str, names: Mapping[str, str]) -> str:
    """The text of a URDF with other names of files (meshes), by their old ones; all else stays as it is."""

    def put(match: re.Match[str]) -> str:
        name = names.get(html.unescape(match[3]))
        return match[0] if name is None else f'{match[1]}"{html.escape(name)}"'

    return _FILENAME.sub(put, text)
