"""URDFs that hold an arm, out of folders of packages."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from xml.etree import ElementTree as ET

MOVED = ("revolute", "continuous", "prismatic")
JOINTS, LENGTH = 4, 0.3
"""Joints that an arm has at least, and the length of its chain from the first to the last of them, m."""

_LEG = re.compile(r"leg|hip|thigh|calf|knee|ankle|foot|(^|_)[flhr][flhr]_|wheel|hfe|haa", re.IGNORECASE)


@dataclass(frozen=True)
class StockRobot:
    """A robot of a package.

    Attributes:
        package: its name.
        urdf: path of the file.
        joints: moved joints of its longest chain that is no leg.
        length: of this chain, m.
    """

    package: str
    urdf: Path
    joints: int
    length: float

    def moved_before(self, link: str) -> int:
        """Moved joints between the root and a link; 0 behind a leg."""
        return sum(map(_moves, _chains(ET.parse(self.urdf).getroot()).get(link, ())))


def stock_robots(folder: Path, packages: Sequence[str]) -> list[StockRobot]:
    """One robot per kinematic chain, packages in turn.

    Files that differ only in tools, meshes or limits count once, those with the shortest names first.

    Args:
        folder: holds a folder per package.
        packages: their names.
    """
    seen: set[tuple[float, ...]] = set()
    found = [list(_of_package(folder / package, package, seen)) for package in packages]
    return [robot for turn in zip_longest(*found) for robot in turn if robot]


def _of_package(folder: Path, package: str, seen: set[tuple[float, ...]]) -> Iterator[StockRobot]:
    for urdf in sorted(folder.rglob("*.urdf"), key=lambda path: (len(path.name), str(path))):
        try:
            chain = longest_chain(ET.parse(urdf).getroot())
        except ET.ParseError:
            continue
        moved = [joint for joint in chain if _moves(joint)]
        if len(moved) < JOINTS:
            continue
        length = sum(math.hypot(*_offset(joint)) for joint in chain[chain.index(moved[0]) + 1 :])
        key = tuple(round(value, 3) for joint in moved[1:] for value in _offset(joint))
        if length >= LENGTH and key not in seen:
            seen.add(key)
            yield StockRobot(package, urdf, len(moved), length)


def longest_chain(robot: ET.Element) -> list[ET.Element]:
    """Joints from the root to the link behind most moved joints, legs left out; perhaps none."""
    return max(_chains(robot).values(), key=lambda chain: (sum(map(_moves, chain)), len(chain)), default=[])


def _chains(robot: ET.Element) -> dict[str, list[ET.Element]]:
    """Joints from the root to each link, but for links of legs."""
    above = {}
    for joint in robot.findall("joint"):
        child, parent = joint.find("child"), joint.find("parent")
        if child is not None and parent is not None:
            above[child.get("link", "")] = joint, parent.get("link", "")
    chains = {}
    for end in above:
        chain, link = [], end
        while link in above and above[link][0] not in chain:
            joint, link = above[link]
            chain.insert(0, joint)
        if not _LEG.search(" ".join(joint.get("name", "") for joint in chain if _moves(joint))):
            chains[end] = chain
    return chains


def _moves(joint: ET.Element) -> bool:
    limit = joint.find("limit")
    stuck = limit is not None and limit.get("lower", "-") == limit.get("upper", "+")
    return joint.get("type") in MOVED and joint.find("mimic") is None and not stuck


def _offset(joint: ET.Element) -> list[float]:
    origin = joint.find("origin")
    return [float(word) for word in ("0 0 0" if origin is None else origin.get("xyz", "0 0 0")).split()]
