"""A robot on its contacts in three dimensions, in a browser: what moves, forces, what is left of them.

Drawn by viser. A view is one HTML file that needs nothing else, with a slider over the time of a motion, or
a page served to a browser on this machine.
"""

from __future__ import annotations

import io
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError
from ocptip.basics.text import quantity
from ocptip.contact.support import Support
from ocptip.reserves.slip import SlipReserve
from ocptip.reserves.tipping import TipOverReserve
from ocptip.robots.collision.shapes import Ball, HalfSpace, Shape
from ocptip.robots.geometry import Wall
from ocptip.robots.kinematics import link_frames
from ocptip.standing.arm import StandingRobot
from ocptip.task_files.scene import Scene
from ocptip.trajectories.sampled import Motion

FRAMES, RATE = 240, 30.0  # at most so many frames, so many per second
LINK, JOINT, BASE, HELD = (70, 110, 160), (240, 170, 60), (90, 90, 90), (200, 110, 50)
OBSTACLE, GROUND, FORCE, CONE = (150, 150, 150), (215, 215, 215), (30, 140, 60), (120, 190, 120)
POLYGON, AXIS, POINT, LOAD = (40, 40, 40), (200, 30, 30), (220, 0, 160), (190, 40, 40)
_TALL = 0.5  # height of an arrow for the whole weight, over the size of the picture
_SIDES = 24  # of a cone


def library_viser() -> Any:
    """viser; InputError says how to get it."""
    try:
        import viser
    except ImportError:
        raise InputError("viser is not installed (pip install 'ocptip[view]')") from None
    return viser


@dataclass(frozen=True, eq=False)
class Show:
    """What a page shows: how to put it on stage, and how it changes.

    Attributes:
        stage: puts everything on a viser server and returns what shows a frame there.
        times: (T,), s, of the frames; one for what stands still.
        centre, size: (3,), m, and m: where the camera looks, and of how much.
    """

    stage: Callable[[Any], Callable[[int], None]]
    times: np.ndarray
    centre: np.ndarray
    size: float


def to_html(show: Show) -> str:
    """One HTML file, without anything from elsewhere."""
    with _server(show) as (server, frame):
        frame(0)
        recorder = server.get_scene_serializer()
        for k in range(1, len(show.times)):
            recorder.insert_sleep(float(show.times[k] - show.times[k - 1]))
            frame(k)
        if len(show.times) > 1:
            recorder.insert_sleep(1.0)
        return recorder.as_html()


def serve(show: Show, say: Callable[[str], None]) -> None:
    """Serve the page until Ctrl-C.

    Args:
        show: of the page.
        say: gets its address.
    """
    with _server(show) as (server, frame):
        frame(0)
        if len(show.times) > 1:
            slider = server.gui.add_slider(
                "time [s]", min=0.0, max=float(show.times[-1]), step=0.001, initial_value=0.0
            )
            slider.on_update(lambda _: frame(int(np.abs(show.times - slider.value).argmin())))
        say(f"http://localhost:{server.get_port()} (Ctrl-C ends it)")
        try:
            while True:
                time.sleep(1.0)
        except KeyboardInterrupt:
            return


@contextmanager
def _server(show: Show) -> Iterator[tuple[Any, Callable[[int], None]]]:
    """A server on a free port of this machine, with everything on stage."""
    viser = library_viser()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with redirect_stdout(io.StringIO()):  # its greetings
        server = viser.ViserServer(host="127.0.0.1", port=port, verbose=False)
    try:
        server.initial_camera.position = tuple(show.centre + show.size * np.array([0.7, -1.0, 0.5]))
        server.initial_camera.look_at = tuple(show.centre)
        yield server, show.stage(server)
    finally:
        with redirect_stdout(io.StringIO()):
            server.stop()


# --- a motion, a pose -----------------------------------------------------------------------------------


def motion_show(name: str, robot: StandingRobot, motion: Motion) -> Show:
    """An arm's motion on its base."""
    step = max(1 / RATE, motion.end / FRAMES)
    times = np.append(np.arange(0.0, motion.end, step), motion.end)
    return _robot_show(name, robot, times, motion.states(times))


def pose_show(name: str, robot: StandingRobot, q: np.ndarray) -> Show:
    """An arm at rest on its base; joint values (n,)."""
    return _robot_show(name, robot, np.zeros(1), (q[None], 0 * q[None], 0 * q[None]))


def _robot_show(
    name: str, robot: StandingRobot, times: np.ndarray, states: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> Show:
    seen = robot.samples_of(times, *states)
    frames = link_frames(robot.arm, states[0])
    points = np.vstack([frames.origins.reshape(-1, 3), [c.position for c in robot.support.contacts]])
    centre, size = points.mean(axis=0), float(np.linalg.norm(np.ptp(points, axis=0)))

    def stage(server: Any) -> Callable[[int], None]:
        scene = server.scene
        links = _arm(scene, robot, size)
        _surroundings(scene, robot, centre, size)
        scene.add_line_segments(
            "/path of the gripper", _segments(frames.origins[:, -1]), colors=HELD, thickness=0.003 * size
        )
        forces = Forces(scene, robot.support, robot.mass, size)
        top = centre + np.array([0, 0, 0.6 * size])
        title = scene.add_label("/clock", name, position=tuple(top), anchor="bottom-center")
        tip, slip = seen.tip, seen.slip

        def frame(k: int) -> None:
            for link, rotation, origin in zip(links, frames.rotations[k], frames.origins[k], strict=False):
                link.position, link.wxyz = origin, _wxyz(rotation)
            forces.show(shared_forces(seen.states.contact_forces, slip, k), tip, k)
            title.text = (
                f"{name}  {times[k]:.2f} s  {reserve_clock(tip, slip, seen.states.contact_forces, k)}"
            )

        return frame

    return Show(stage, times, centre, size)


def reserve_clock(tip: TipOverReserve, slip: SlipReserve, forces: np.ndarray, k: int) -> str:
    """What is left of state k: "GN 0.391, GT 0.708, least foot 9.75 N"."""
    parts = [
        f"GN {tip.GN[k]:.3f}",
        f"GT {slip.GT[k]:.3f}",
        f"least foot {quantity(forces[k, :, 0].min(), 'N', 3)}",
    ]
    return ", ".join(parts)


def shared_forces(contact_forces: np.ndarray, slip: SlipReserve, k: int) -> np.ndarray:
    """Forces (n, 3), N, contact axes, of state k as the slip reserve shares them, else the solver's."""
    shared = np.column_stack([slip.normal_forces[k], slip.tangential_forces[k]])
    return shared if np.all(np.isfinite(shared)) else contact_forces[k]


def scene_show(scene: Scene, contact_forces: np.ndarray, tip: TipOverReserve, slip: SlipReserve) -> Show:
    """A base on its contacts under the loads of a scene file.

    Args:
        scene: in space.
        contact_forces: (1, n, 3), N, contact axes.
        tip, slip: reserves of that state.

    Raises:
        InputError: the scene is in the plane.
    """
    support = scene.support
    if scene.planar:
        raise InputError("is in the plane; ocptip stand --plot draws it", "", scene.name)
    points = np.vstack([[c.position for c in support.contacts], support.center_of_mass])
    centre, size = points.mean(axis=0), float(np.linalg.norm(np.ptp(points, axis=0)))

    def stage(server: Any) -> Callable[[int], None]:
        drawn = server.scene
        _base(drawn, support, support.center_of_mass)
        _grid(drawn, support, centre, size)
        total = support.mass
        forces = Forces(drawn, support, total, size)
        weight = float(np.linalg.norm(support.weight[:3])) or 1.0
        for k, load in enumerate(scene.loads):
            if load.force is not None:
                tip_of = np.asarray(load.point if load.point is not None else np.zeros(3), dtype=float)
                tail = tip_of - _TALL * size * np.asarray(load.force, dtype=float) / weight
                _arrows(drawn, f"/load {k + 1}", np.array([[tail, tip_of]]), LOAD, size)
        text = f"{scene.name}  {reserve_clock(tip, slip, contact_forces, 0)}"
        top = centre + np.array([0, 0, 0.7 * size])
        drawn.add_label("/clock", text, position=tuple(top), anchor="bottom-center")
        forces.show(shared_forces(contact_forces, slip, 0), tip, 0)
        return lambda _: None

    return Show(stage, np.zeros(1), centre, size)


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
        self.points = np.array([c.position for c in support.contacts])
        self.scale = _TALL * size / max(mass * float(np.linalg.norm(support.gravity)), 1e-9)
        for k, contact in enumerate(support.contacts):
            scene.add_icosphere(
                f"/contacts/{k + 1}", 0.012 * size, color=POLYGON, position=tuple(self.points[k])
            )
            friction = getattr(contact, "friction", None) or getattr(contact, "friction_upper", 0.0)
            if friction:
                vertices, faces = _cone(friction, 0.12 * size)
                scene.add_mesh_simple(
                    f"/friction cones/{k + 1}", vertices, faces, color=CONE, opacity=0.35, side="double",
                    position=tuple(self.points[k]), wxyz=_wxyz(_upright(contact.normal)),
                )  # fmt: skip
        edges = self._polygon()
        scene.add_line_segments("/support polygon", edges, colors=POLYGON, thickness=0.005 * size)
        still = np.stack([self.points, self.points + 1e-3 * size * np.array([0, 0, 1.0])], axis=1)
        self.arrows = _arrows(scene, "/contact forces", still, FORCE, size)
        self.axis = scene.add_line_segments(
            "/nearest tipping axis", edges[:1], colors=AXIS, thickness=0.012 * size
        )
        self.pressure = scene.add_icosphere("/zero-moment point", 0.018 * size, color=POINT)

    def show(self, forces: np.ndarray, tip: TipOverReserve, k: int) -> None:
        """Forces (n, 3), N, contact axes, of state k of the reserves."""
        known = np.nan_to_num(forces)
        world = np.einsum("kij,kj->ki", self.support.frames, known)
        ends = self.points + self.scale * world
        ends[np.linalg.norm(ends - self.points, axis=1) < 1e-4 * self.size, 2] += 1e-4 * self.size
        self.arrows.points = np.stack([self.points, ends], axis=1).astype(np.float32)
        nearest = int(tip.nearest_axis[k])
        self.axis.visible = nearest >= 0
        if nearest >= 0:
            pair = list(tip.tip_over.axes[nearest].contacts)[:2]
            self.axis.points = self.points[[pair[0], pair[-1]]][None].astype(np.float32)
        total = known[:, 0].sum()
        self.pressure.visible = bool(total > 0)
        if total > 0:
            self.pressure.position = known[:, 0] @ self.points / total

    def _polygon(self) -> np.ndarray:
        """(e, 2, 3) edges of the hull of the contacts seen from above; a line of two."""
        if (
            len(self.points) > 2
            and np.linalg.matrix_rank(self.points[:, :2] - self.points[0, :2], tol=1e-6) == 2
        ):
            around = self.points[ConvexHull(self.points[:, :2]).vertices]
        else:
            around = self.points
        return np.stack([around, np.roll(around, -1, axis=0)], axis=1)


# --- bodies ---------------------------------------------------------------------------------------------


def _arm(scene: Any, robot: StandingRobot, size: float) -> list[Any]:
    """Frames of the links with the solids, spheres or sticks on them; in the order of the link frames."""
    arm = robot.arm
    links = [scene.add_frame(f"/arm/{k + 1}", show_axes=False) for k in range(arm.links)]
    mount = scene.add_frame(
        "/arm/0", show_axes=False, position=tuple(arm.mount_position), wxyz=_wxyz(arm.mount_rotation)
    )
    names = [mount.name, *(link.name for link in links)]
    if arm.geometry is not None:
        for number, part in enumerate(arm.geometry.shapes):
            _solid(scene, f"{names[part.body]}/{number}", part.shape, HELD if part.carried else LINK, size)
    elif arm.sphere_sets:
        for spheres in arm.sphere_sets:
            for number, (centre, radius) in enumerate(zip(spheres.centres, spheres.radii, strict=True)):
                own = f"{names[spheres.link]}/{spheres.name} {number}"
                scene.add_icosphere(own, float(radius), subdivisions=2, color=LINK, position=tuple(centre))
    if arm.geometry is None:
        for k, offset in enumerate(arm.offsets):
            if np.linalg.norm(offset) > 1e-6:
                ends = np.array([[np.zeros(3), offset]])
                scene.add_line_segments(f"{names[k + 1]}/bone", ends, colors=JOINT, thickness=0.02 * size)
    if arm.payload is not None:
        _, centre, _ = arm.payload.seen_from(arm.tool_rotation, arm.offsets[-1])
        radius = max(0.02 * size, 0.5 * (arm.payload.mass / 2000) ** (1 / 3))  # of a light metal
        scene.add_icosphere(f"{names[-1]}/payload", float(radius), color=HELD, position=tuple(centre))
    return links


def _surroundings(scene: Any, robot: StandingRobot, centre: np.ndarray, size: float) -> None:
    if robot.shapes:
        for number, part in enumerate(robot.shapes):
            _solid(scene, f"/base/{number}", part.shape, BASE, size)
    else:
        _base(scene, robot.support, robot.arm.mount_position)
    _grid(scene, robot.support, centre, size)
    for number, obstacle in enumerate(robot.obstacles):
        if isinstance(obstacle, Wall):
            if abs(obstacle.normal[2]) < 0.9:  # a floor is where the contacts are
                flat = obstacle.normal * (obstacle.distance - obstacle.normal @ centre) + centre
                scene.add_box(
                    f"/obstacles/{number}", OBSTACLE, (2 * size, 2 * size, 0.004 * size), opacity=0.4,
                    position=tuple(flat), wxyz=_wxyz(_upright(obstacle.normal)),
                )  # fmt: skip
        else:
            _solid(scene, f"/obstacles/{number}", obstacle.shape, OBSTACLE, size)


def _base(scene: Any, support: Support, above: np.ndarray) -> None:
    """Nothing is known of its form: the hull of its contacts and of a point above."""
    points = np.vstack([[c.position for c in support.contacts], above])
    if len(points) > 3 and np.linalg.matrix_rank(points[1:] - points[0], tol=1e-6) == 3:
        vertices, faces = _hull(points)
        scene.add_mesh_simple("/base", vertices, faces, color=BASE, opacity=0.35, side="double")


def _grid(scene: Any, support: Support, centre: np.ndarray, size: float) -> None:
    height = min(float(c.position[2]) for c in support.contacts)
    scene.add_grid(
        "/ground", 4 * size, 4 * size, cell_size=0.1, section_size=0.5, cell_color=GROUND,
        position=(float(centre[0]), float(centre[1]), height - 0.002 * size),
    )  # fmt: skip


def _solid(scene: Any, name: str, shape: Shape, color: tuple[int, int, int], size: float) -> None:
    if isinstance(shape, HalfSpace):
        return
    at = {"position": tuple(shape.position), "wxyz": _wxyz(shape.rotation)}
    corners, radius = shape.corners(), shape.thickness
    if type(shape) is Ball:
        scene.add_icosphere(name, radius, subdivisions=2, color=color, **at)
        return
    if radius:
        corners = (corners[:, None] + radius * _directions()).reshape(-1, 3)
    vertices, faces = _hull(corners)
    scene.add_mesh_simple(name, vertices, faces, color=color, flat_shading=not radius, **at)


def _hull(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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


def _cone(friction: float, height: float) -> tuple[np.ndarray, np.ndarray]:
    angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
    slant = height / np.hypot(1.0, friction)
    rim = slant * np.column_stack([friction * np.cos(angles), friction * np.sin(angles), np.ones(_SIDES)])
    number = np.arange(_SIDES)
    faces = np.column_stack([np.zeros(_SIDES, dtype=int), 1 + number, 1 + (number + 1) % _SIDES])
    return np.vstack([np.zeros(3), rim]).astype(np.float32), faces.astype(np.uint32)


def _arrows(scene: Any, name: str, points: np.ndarray, color: tuple[int, int, int], size: float) -> Any:
    return scene.add_arrows(
        name, points.astype(np.float32), colors=color, shaft_radius=0.006 * size, head_radius=0.014 * size,
        head_length=0.03 * size,
    )  # fmt: skip


def _segments(points: np.ndarray) -> np.ndarray:
    """(T - 1, 2, 3) pieces of a line through (T, 3) points; one without length of a point."""
    ahead = points[1:] if len(points) > 1 else points
    return np.stack([points[: len(ahead)], ahead], axis=1)


def _upright(normal: Any) -> np.ndarray:
    """(3, 3): turns z into this unit vector."""
    return Rotation.align_vectors([np.asarray(normal, dtype=float)], [[0.0, 0.0, 1.0]])[0].as_matrix()


def _wxyz(rotation: np.ndarray) -> tuple[float, ...]:
    """Quaternion, scalar first."""
    return tuple(np.roll(Rotation.from_matrix(rotation).as_quat(), 1))
