"""The UR5 of the tests with collision geometry: cylinders, a box, and meshes written as STL."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from tests.places import UR5

CYLINDERS = {  # link: radius, length, origin, roll pitch yaw
    "shoulder_link": (0.06, 0.13, "0 0 0", "0 0 0"),
    "wrist_1_link": (0.04, 0.10, "0 0.09 0", "0 0 0"),
    "wrist_2_link": (0.04, 0.09, "0 0 0.09", "1.5708 0 0"),
}


def with_collision(folder: Path, *, meshes: str = "package://arm_meshes/links") -> Path:
    """Write the URDF, and the meshes where the test's package says that they are."""
    tree = ET.parse(UR5)
    for name, (radius, length, xyz, rpy) in CYLINDERS.items():
        _add(tree, name, "cylinder", {"radius": str(radius), "length": str(length)}, xyz, rpy)
    _add(tree, "wrist_3_link", "sphere", {"radius": "0.035"}, "0 0.06 0", "0 0 0")
    files = folder / "arm_meshes" / "links"
    files.mkdir(parents=True)
    for name, length in (("upper_arm_link", 0.425), ("forearm_link", 0.392)):
        _add(tree, name, "mesh", {"filename": f"{meshes}/{name}.stl"}, "0 0 0", "0 0 0")
        write_stl(files / f"{name}.stl", *elbow(length, 0.12 if name == "upper_arm_link" else -0.01))
    path = folder / "ur5_with_collision.urdf"
    tree.write(path)
    return path


def _add(tree: ET.ElementTree, link: str, kind: str, size: dict[str, str], xyz: str, rpy: str) -> None:
    found = tree.find(f"./link[@name='{link}']")
    collision = ET.SubElement(found, "collision")
    ET.SubElement(collision, "origin", {"xyz": xyz, "rpy": rpy})
    ET.SubElement(ET.SubElement(collision, "geometry"), kind, size)


def box(low: tuple[float, ...], high: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Points (8, 3) and triangles (12, 3) of a box."""
    points = np.array([[(low, high)[(i >> k) & 1][k] for k in range(3)] for i in range(8)])
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return points, np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))])


def elbow(length: float, beside: float) -> tuple[np.ndarray, np.ndarray]:
    """A U along z, not convex: a bar between two blocks that stand out to the side."""
    parts = [
        box((-0.04, beside - 0.04, 0.0), (0.04, beside + 0.04, length)),
        box((-0.05, beside - 0.07, -0.05), (0.05, beside + 0.05, 0.05)),
        box((-0.05, beside - 0.07, length - 0.05), (0.05, beside + 0.05, length + 0.05)),
    ]
    firsts = np.cumsum([0, *(len(points) for points, _ in parts)])
    triangles = [t + first for (_, t), first in zip(parts, firsts, strict=False)]
    return np.vstack([points for points, _ in parts]), np.vstack(triangles)


def write_stl(path: Path, points: np.ndarray, triangles: np.ndarray) -> None:
    """ASCII STL."""
    lines = ["solid part"]
    for triangle in triangles:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x:.9f} {y:.9f} {z:.9f}" for x, y, z in points[triangle]]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid part"]) + "\n")
