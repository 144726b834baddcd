"""Bodies on a stage of viser: arms, what they hold, bases, obstacles, ground; cones, arrows, lines."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from ocptip.contact.support import Support
from ocptip.robots.collision.shapes import Ball, HalfSpace, Shape
from ocptip.robots.geometry import Wall
from ocptip.robots.model import ArmModel
from ocptip.standing.arm import Robot
from ocptip.standing.objects import GRIPPER

LINK, JOINT, BASE, HELD = (70, 110, 160), (240, 170, 60), (90, 90, 90), (200, 110, 50)
OBSTACLE, GROUND = (150, 150, 150), (215, 215, 215)
SHEER = 0.35  # of a ghost
HEAD = 0.03  # length of the head of an arrow, over the size of the picture
_SIDES = 24  # of a cone


def arm(scene: Any, root: str, robot: Robot, size: float, ghost: tuple[int, int, int] | None) -> list[Any]:
    """Frames of the links with the solids, spheres or sticks on them; in the order of the link frames."""
    arm, style = robot.arm, {} if ghost is None else {"opacity": SHEER}
    links = [scene.add_frame(f"{root}/{k + 1}", show_axes=False) for k in range(arm.links)]
    mount = scene.add_frame(
        f"{root}/0", show_axes=False, position=tuple(arm.mount_position), wxyz=wxyz(arm.mount_rotation)
    )
    names, color = [mount.name, *(link.name for link in links)], ghost or LINK
    if arm.geometry is not None:
        for number, part in enumerate(arm.geometry.shapes):
            if not part.carried:
                solid(scene, f"{names[part.body]}/{number}", part.shape, color, size, **style)
    elif arm.sphere_sets:
        for spheres in arm.sphere_sets:
            for number, (centre, radius) in enumerate(zip(spheres.centres, spheres.radii, strict=True)):
                label, centre_position = f"{names[spheres.link]}/{spheres.name} {number}", tuple(centre)
                scene.add_icosphere(
                    label, float(radius), subdivisions=2, color=color, position=centre_position, **style
                )
    if arm.geometry is None:
        for k, offset in enumerate(arm.offsets):
            if np.linalg.norm(offset) > 1e-6:
                ends, color = np.array([[np.zeros(3), offset]]), ghost or JOINT
                scene.add_line_segments(f"{names[k + 1]}/bone", ends, colors=color, thickness=0.02 * size)
    return links


def held(
    scene: Any, root: str, robot: Robot, part: int, size: float, ghost: tuple[int, int, int] | None
) -> list[Any]:
    """What an arm holds in one part of its motion: solids, a light-metal ball for the mass, objects."""
    arm, results = robot.without_objects().arm, []
    style = {"color": ghost or HELD, **({} if ghost is None else {"opacity": SHEER})}
    for number, one in enumerate(arm.geometry.shapes if arm.geometry is not None else ()):
        if one.carried:
            results.append(
                solid(scene, f"{root}/{one.body}/held {part}.{number}", one.shape, size=size, **style)
            )
    if arm.payload is not None:
        results.append(payload_ball(scene, root, arm, part, size, **style))
    for carried in robot.carried:
        corners, name = carried.corners.reshape(-1, 3), f"{root}/object {part}.{carried.object.name}"
        if carried.carrier == GRIPPER:
            corners = corners @ arm.tool_rotation.T + arm.offsets[-1]
            name = f"{root}/{arm.links}/object {part}.{carried.object.name}"
        if np.linalg.matrix_rank(corners - corners.mean(axis=0), tol=1e-6) == 3:
            vertices, faces = hull(corners)
            results.append(scene.add_mesh_simple(name, vertices, faces, flat_shading=True, **style))
    return [node for node in results if node is not None]


def payload_ball(scene: Any, root: str, arm: ArmModel, part: int, size: float, **style: Any) -> Any:
    """A light-metal ball for the mass of a payload."""
    assert arm.payload is not None
    _, centre, _ = arm.payload.seen_from(arm.tool_rotation, arm.offsets[-1])
    radius = max(0.02 * size, 0.5 * (arm.payload.mass / 2000) ** (1 / 3))
    name = f"{root}/{arm.links}/payload {part + 1}"
    return scene.add_icosphere(name, float(radius), position=tuple(centre), **{"color": HELD, **style})


def base_of(
    scene: Any, root: str, robot: Robot, size: float, ghost: tuple[int, int, int] | None = None
) -> None:
    """The solids of an arm's base, transparent, or else what is known of its form."""
    for number, part in enumerate(robot.shapes):
        solid(scene, f"{root}/{number}", part.shape, ghost or BASE, size, opacity=SHEER)
    if not robot.shapes:
        base(scene, root, robot.support, robot.sensor.position, ghost or BASE)


def surroundings(scene: Any, robot: Robot, centre: np.ndarray, size: float) -> None:
    base_of(scene, "/base", robot, size)
    grid(scene, robot.support, centre, size)
    for number, obstacle in enumerate(robot.obstacles):
        if isinstance(obstacle, Wall):
            if abs(obstacle.normal[2]) < 0.9:  # a floor is where the contacts are
                flat = obstacle.normal * (obstacle.distance - obstacle.normal @ centre) + centre
                scene.add_box(
                    f"/obstacles/{number}", OBSTACLE, (2 * size, 2 * size, 0.004 * size), opacity=0.4,
                    position=tuple(flat), wxyz=wxyz(upright(obstacle.normal)),
                )  # fmt: skip
        else:
            solid(scene, f"/obstacles/{number}", obstacle.shape, OBSTACLE, size)


def base(
    scene: Any, root: str, support: Support, above: np.ndarray, color: tuple[int, int, int] = BASE
) -> None:
    """Nothing is known of its form: the hull of its contacts and of a point above."""
    points = np.vstack([[np.asarray(c.position) for c in support.contacts], above])
    if len(points) > 3 and np.linalg.matrix_rank(points[1:] - points[0], tol=1e-6) == 3:
        vertices, faces = hull(points)
        scene.add_mesh_simple(root, vertices, faces, color=color, opacity=SHEER, side="double")


def grid(scene: Any, support: Support, centre: np.ndarray, size: float) -> None:
    height = min(float(c.position[2]) for c in support.contacts)
    scene.add_grid(
        "/ground", 4 * size, 4 * size, cell_size=0.1, section_size=0.5, cell_color=GROUND,
        position=(float(centre[0]), float(centre[1]), height - 0.002 * size),
    )  # fmt: skip


def solid(scene: Any, name: str, shape: Shape, color: tuple[int, int, int], size: float, **style: Any) -> Any:
    """A solid's node; None of what has no end."""
    if isinstance(shape, HalfSpace):
        return None
    placing = {"position": tuple(shape.position), "wxyz": wxyz(shape.rotation), "color": color, **style}
    corners, radius = shape.corners(), shape.thickness
    if type(shape) is Ball:
        return scene.add_icosphere(name, radius, subdivisions=2, **placing)
    if radius:
        corners = (corners[:, None] + radius * _directions()).reshape(-1, 3)
    vertices, faces = hull(corners)
    return scene.add_mesh_simple(name, vertices, faces, flat_shading=not radius, **placing)


def hull(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles, seen from outside, of a convex hull."""
    hull = ConvexHull(points)
    faces = hull.simplices.copy()
    corners = points[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("fi,fi->f", normals, hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    used, numbers = np.unique(faces, return_inverse=True)
    return points[used].astype(np.float32), numbers.reshape(faces.shape).astype(np.uint32)


def _directions() -> np.ndarray:
    """Unit vectors all around."""
    k = np.arange(60) + 0.5
    polar, around = np.arccos(1 - 2 * k / 60), np.pi * (1 + 5**0.5) * k
    return np.column_stack([np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)])


def cone(friction: float, height: float) -> tuple[np.ndarray, np.ndarray]:
    angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
    slant = height / np.hypot(1.0, friction)
    rim = slant * np.column_stack([friction * np.cos(angles), friction * np.sin(angles), np.ones(_SIDES)])
    number = np.arange(_SIDES)
    faces = np.column_stack([np.zeros(_SIDES, dtype=int), 1 + number, 1 + (number + 1) % _SIDES])
    return np.vstack([np.zeros(3), rim]).astype(np.float32), faces.astype(np.uint32)


def arrows(scene: Any, name: str, points: np.ndarray, color: tuple[int, int, int], size: float) -> Any:
    return scene.add_arrows(
        name, points.astype(np.float32), colors=color, shaft_radius=0.006 * size, head_radius=0.014 * size,
        head_length=HEAD * size,
    )  # fmt: skip


def segments(points: np.ndarray) -> np.ndarray:
    """(T - 1, 2, 3) pieces of a line through (T, 3) points; one without length of a point."""
    ahead = points[1:] if len(points) > 1 else points
    return np.stack([points[: len(ahead)], ahead], axis=1)


def upright(normal: Any) -> np.ndarray:
    """(3, 3): turns z into this unit vector."""
    return Rotation.align_vectors([np.asarray(normal, dtype=float)], [[0.0, 0.0, 1.0]])[0].as_matrix()


def wxyz(rotation: np.ndarray) -> tuple[float, ...]:
    """Quaternion, scalar first."""
    return tuple(np.roll(Rotation.from_matrix(rotation).as_quat(), 1))
