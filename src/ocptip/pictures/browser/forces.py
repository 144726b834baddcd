"""Contact forces on a stage of viser, with friction cones, support polygon and what they say of tipping."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from ocptip.contact.support import Support
from ocptip.pictures.browser import bodies
from ocptip.reserves.tipping import TipOverReserve

FORCE, CONE = (30, 140, 60), (120, 190, 120)
POLYGON, AXIS, POINT = (40, 40, 40), (200, 30, 30), (220, 0, 160)
TALL = 0.5  # height of an arrow for the whole weight, over the size of the picture


class Forces:
    """Contact forces, friction cones, support polygon, the nearest tipping axis and the zero-moment point.

    Args:
        scene: of viser.
        support: the base on its contacts.
        mass: that stands on them, kg; the arrow for its weight has a good size.
        size: of the picture, m.
    """

    def __init__(self, scene: Any, support: Support, mass: float, size: float) -> None:
        self.support, self.size = support, size
        self.points = np.array([np.asarray(c.position) for c in support.contacts])
        self.scale = TALL * size / max(mass * float(np.linalg.norm(support.gravity)), 1e-9)
        for k, contact in enumerate(support.contacts):
            scene.add_icosphere(
                f"/contacts/{k + 1}", 0.012 * size, color=POLYGON, position=tuple(self.points[k])
            )
            friction = getattr(contact, "friction", None) or getattr(contact, "friction_upper", 0.0)
            if friction:
                vertices, faces = bodies.cone(friction, 0.12 * size)
                scene.add_mesh_simple(
                    f"/friction cones/{k + 1}", vertices, faces, color=CONE, opacity=0.35, side="double",
                    position=tuple(self.points[k]), wxyz=bodies.wxyz(bodies.upright(contact.normal)),
                )  # fmt: skip
        edges = around(self.points)
        scene.add_line_segments("/support polygon", edges, colors=POLYGON, thickness=0.005 * size)
        still = np.stack([self.points, self.points + 1e-3 * size * np.array([0, 0, 1.0])], axis=1)
        self.arrows = bodies.arrows(scene, "/contact forces", still, FORCE, size)
        self.axis = scene.add_line_segments(
            "/nearest tipping axis", edges[:1], colors=AXIS, thickness=0.012 * size
        )
        self.pressure = scene.add_icosphere("/zero-moment point", 0.018 * size, color=POINT)

    def show(self, forces: np.ndarray, tip: TipOverReserve, k: int) -> None:
        """Forces (n, 3), N, contact axes, of state k of the margins."""
        known = np.nan_to_num(forces)
        world = np.einsum("kij,kj->ki", self.support.frames, known)
        ends, length = self.points + self.scale * world, self.scale * np.linalg.norm(world, axis=1)
        largest = np.argmax(length)
        drawn = np.where(length > bodies.HEAD * self.size, np.arange(len(length)), largest)  # no bare heads
        ends[largest, 2] += 1e-4 * self.size
        self.arrows.points = np.stack([self.points, ends], axis=1)[drawn].astype(np.float32)
        nearest = int(tip.nearest_axis[k])
        self.axis.visible = nearest >= 0
        if nearest >= 0:
            pair = list(tip.tip_over.axes[nearest].contacts)[:2]
            self.axis.points = self.points[[pair[0], pair[-1]]][None].astype(np.float32)
        press(self.pressure, known, self.points)


def press(node: Any, forces: np.ndarray, points: np.ndarray) -> None:
    """Put the zero-moment point of forces (n, 3), N, contact axes, at points (n, 3), where it is."""
    normal = np.nan_to_num(forces[:, 0])
    node.visible = bool(normal.sum() > 0)
    if node.visible:
        node.position = normal @ points / normal.sum()


def around(points: np.ndarray) -> np.ndarray:
    """(e, 2, 3) edges of the hull of points seen from above; a line of two."""
    if len(points) > 2 and np.linalg.matrix_rank(points[:, :2] - points[0, :2], tol=1e-6) == 2:
        points = points[ConvexHull(points[:, :2]).vertices]
    return np.stack([points, np.roll(points, -1, axis=0)], axis=1)
