"""A robot on its contacts in three dimensions, in a browser: what moves, forces, what is left of them.

Drawn by viser. A view is one HTML file that needs nothing else, with a slider over the time of a motion, or
a page served to a browser on this machine.
"""

from __future__ import annotations

import io
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.text import quantity
from ocptip.basics.write import MARK
from ocptip.motion.files.plan_files import samples_joined
from ocptip.pictures.browser import bodies, closed_chains
from ocptip.pictures.browser.forces import TALL, Forces, around, press
from ocptip.pictures.browser.panel import MarginPanel
from ocptip.pictures.scene_picture import margin_texts
from ocptip.reserves.equal_compliance import equal_normal_map, reported_slip
from ocptip.reserves.slip import Slip, SlipReserve
from ocptip.reserves.tipping import TipOverReserve
from ocptip.robots.kinematics import LinkFrames, link_frames
from ocptip.standing.arm import Robot
from ocptip.standing.parts import Part, owners
from ocptip.standing.samples import MotionSamples
from ocptip.task_files.scene import Scene

FEWEST, FRAMES, RATE = 60, 240, 30.0  # of frames, within which there are so many per second
GHOST, LOAD = (230, 130, 0), (190, 40, 40)


def library_viser() -> Any:
    """viser; InputError says how to get it."""
    try:
        import viser
    except ImportError:
        raise InputError("viser is not installed (pip install 'ocptip[view]')") from None
    return viser


@dataclass(frozen=True, eq=False)
class Show:
    """The animation of a page: a function that sets up the scene, and the times of the frames.

    Attributes:
        stage: puts everything on a viser server and returns what shows a frame there.
        times: (T,), s, of the frames; one for what stands still.
        centre, size: (3,), m, and m: where the camera looks, and of how much.
        panel: margins over time beside the picture.
    """

    stage: Callable[[Any], Callable[[int], None]]
    times: np.ndarray
    centre: np.ndarray
    size: float
    panel: MarginPanel


def to_html(show: Show) -> str:
    """One HTML file, without anything from elsewhere."""
    with open_server(show.centre, show.size) as server:
        frame = show.stage(server)
        frame(0)
        recorder = server.get_scene_serializer()
        for k in range(1, len(show.times)):
            recorder.insert_sleep(float(show.times[k] - show.times[k - 1]))
            frame(k)
        if len(show.times) > 1:
            recorder.insert_sleep(1.0)
        return f"{show.panel.overlaid(recorder.as_html())}\n<!-- {MARK} -->\n"


def serve(show: Show, say: Callable[[str], None]) -> None:
    """Serve the page until Ctrl-C.

    Args:
        show: of the page.
        say: gets its address.
    """
    with open_server(show.centre, show.size) as server:
        frame = show.stage(server)
        frame(0)
        _controls(server, show, frame)
        until_interrupted(server, say)


def _controls(server: Any, show: Show, frame: Callable[[int], None]) -> None:
    """A slider over the time, and the panel with a button that shows the minimum margin."""
    gui, panel = server.gui, show.panel
    text = gui.add_html(panel.html(0))
    if len(show.times) == 1:
        return
    slider = gui.add_slider("time [s]", min=0.0, max=float(show.times[-1]), step=0.001, initial_value=0.0)

    def moved(_: Any) -> None:
        k = int(np.abs(show.times - slider.value).argmin())
        frame(k)
        text.content = panel.html(k)

    slider.on_update(moved)
    button = gui.add_button("show the minimum margin")
    button.on_click(lambda _: setattr(slider, "value", float(show.times[panel.worst])))


def until_interrupted(server: Any, say: Callable[[str], None]) -> None:
    """Serve until Ctrl-C; `say` gets the address."""
    say(f"http://localhost:{server.get_port()} (Ctrl-C ends it)")
    try:
        while True:
            time.sleep(1.0)
    except KeyboardInterrupt:
        return


@contextmanager
def open_server(centre: np.ndarray, size: float) -> Iterator[Any]:
    """A server on a free port of this machine; its camera shows a place (3,), m, of a size, m."""
    viser = library_viser()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with redirect_stdout(io.StringIO()):  # its greetings
        server = viser.ViserServer(host="127.0.0.1", port=port, verbose=False)
    try:
        server.initial_camera.position = tuple(centre + size * np.array([0.56, -0.8, 0.4]))
        server.initial_camera.look_at = tuple(centre)
        yield server
    finally:
        with redirect_stdout(io.StringIO()):
            server.stop()


# --- a motion, a pose -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Act:
    """The motion of an arm on its base, sampled for the frames of a view.

    Attributes:
        name: for the clock.
        robots: of its parts, which differ in what they hold.
        names: of the parts; empty where there is one.
        owner: (T,), number of the part of each frame.
        seen: forces and margins at the frames.
        frames: of the links; of a closed chain without rotations, the middle of its platform last.
        lines: (T,) the bodies of a closed chain as lines (k, 3), m; empty for arms.
    """

    name: str
    robots: tuple[Robot, ...]
    names: tuple[str, ...]
    owner: np.ndarray
    seen: MotionSamples
    frames: LinkFrames
    lines: Sequence[Sequence[np.ndarray]] = ()

    @classmethod
    def of_plan(cls, name: str, parts: Sequence[Part], times: np.ndarray) -> Act:
        """A motion, or those of a cycle, at these times (T,), s; at rest before and after."""
        owner, seen = sampled_parts(parts, times)
        robots, names = tuple(p.robot for p in parts), tuple(p.name for p in parts)
        if seen.gripper.size:
            return cls(name, robots, names, owner, seen, link_frames(robots[0].arm, seen.angles))
        lines = [robots[0].sticks(q) for q in seen.angles]
        places = [np.vstack([*line, line[-1][:-1].mean(axis=0)]) for line in lines]
        frames = LinkFrames(np.empty((len(times), 0, 3, 3)), np.array(places))
        return cls(name, robots, names, owner, seen, frames, lines)

    def points(self) -> np.ndarray:
        """(k, 3), m: where it is."""
        contacts = [np.asarray(c.position) for c in self.robots[0].support.contacts]
        return np.vstack([self.frames.origins.reshape(-1, 3), contacts])

    def panel(self, times: np.ndarray) -> MarginPanel:
        """Margins and foot forces at the times (T,), s, of the frames."""
        seen, more = self.seen, closed_chains.LEGEND if self.lines else ""
        return _panel(times, seen.states.contact_forces, seen.tip, seen.slip, more)

    def clock(self, k: int) -> str:
        """Name of the motion, or of the segment of a cycle, and what is left at frame k."""
        part = self.names[self.owner[k]]
        title = f"{self.name}, {part}" if part else self.name
        seen = self.seen
        shared = shared_forces(seen.states.contact_forces, seen.slip, k)
        return f"{title}  {reserve_clock(seen.tip, seen.slip, shared, k)}"


def _panel(
    times: np.ndarray, contact_forces: np.ndarray, tip: TipOverReserve, slip: SlipReserve, more: str = ""
) -> MarginPanel:
    none = np.full(len(times), np.nan)
    moments = np.maximum(tip.moments.min(axis=1), 0.0) if tip.moments.shape[1] else none
    known = [shared_forces(contact_forces, slip, k)[:, 0] for k in range(len(times))]
    stable = (tip.GN < 1) & (slip.GT < 1)
    return MarginPanel(times, moments, slip.GT, np.nan_to_num(np.array(known)), stable, more)


def sampled_parts(parts: Sequence[Part], times: np.ndarray) -> tuple[np.ndarray, MotionSamples]:
    """Number (T,) of the part at each time, s, and samples there with the forces that reports show."""
    owner, results = np.zeros(len(times), dtype=int), []
    for number, part, instants in owners(parts, times):
        owner[instants] = number
        if len(instants):
            local = np.clip(times[instants] - part.begin, 0.0, part.motion.end)
            results.append(part.robot.samples(part.motion, local))
    seen = samples_joined(results)
    return owner, replace(seen, slip=reported_slip(seen.states, seen.slip))


HERE = np.zeros(3), np.eye(3)
"""Origin, m, and rotation of base axes that are those of the picture."""


def motion_show(
    name: str,
    parts: Sequence[Part],
    second: tuple[str, Sequence[Part]] | None = None,
    there: tuple[np.ndarray, np.ndarray] = HERE,
) -> Show:
    """An arm's motion on its base, or a cycle; beside it another one, which begins at the same time.

    Args:
        name: for the clock.
        parts: one, or the segments of a cycle.
        second: name and parts of what is drawn as a ghost.
        there: origin (3,), m, and rotation (3, 3) of the ghost's base axes in those of the first.
    """
    end = max(one[-1].end for one in (parts, *((second[1],) if second else ())))
    step = max(min(1 / RATE, end / FEWEST), end / FRAMES)
    times = np.append(np.arange(0.0, end, step), end)
    ghost = Act.of_plan(*second, times) if second else None
    return _show(Act.of_plan(name, parts, times), times, ghost, there)


def pose_show(name: str, robot: Robot, q: np.ndarray) -> Show:
    """An arm at rest on its base; joint values (n,)."""
    times, still = np.zeros(1), 0 * q[None]
    seen = robot.samples_of(times, q[None], still, still)
    return _show(
        Act(name, (robot,), ("",), np.zeros(1, dtype=int), seen, link_frames(robot.arm, q[None])), times
    )


def _show(
    act: Act,
    times: np.ndarray,
    ghost: Act | None = None,
    there: tuple[np.ndarray, np.ndarray] = HERE,
) -> Show:
    others = ghost.points() @ there[1].T + there[0] if ghost else np.empty((0, 3))
    points = np.vstack([act.points(), others])
    centre, size = points.mean(axis=0), float(np.linalg.norm(np.ptp(points, axis=0)))

    def stage(server: Any) -> Callable[[int], None]:
        scene, robot = server.scene, act.robots[0]
        move = mover(scene, "/arm", act, size)
        bodies.surroundings(scene, robot, centre, size)
        if act.lines:
            closed: Any = robot
            closed_chains.workspace_of(
                scene, closed.robot, act.seen.angles[0], size, closed.position, closed.rotation
            )
        _path(scene, "/path of the gripper", act, bodies.HELD, size)
        forces = Forces(scene, robot.support, robot.mass, size)
        top = centre + np.array([0, 0, 0.6 * size])
        title = scene.add_label("/clock", act.name, position=tuple(top), anchor="bottom-center")
        beside = _ghost(scene, ghost, there, top, size) if ghost else lambda _: None
        tip, slip = act.seen.tip, act.seen.slip

        def frame(k: int) -> None:
            move(k)
            forces.show(shared_forces(act.seen.states.contact_forces, slip, k), tip, k)
            title.text = f"{times[k]:.2f} s  {act.clock(k)}"
            beside(k)

        return frame

    return Show(stage, times, centre, size, act.panel(times))


def _ghost(
    scene: Any, act: Act, there: tuple[np.ndarray, np.ndarray], top: np.ndarray, size: float
) -> Callable[[int], None]:
    """A second motion where its base is: base with its axes, arm, path, zero-moment point, and its clock."""
    axes = {"axes_length": 0.15 * size, "axes_radius": 0.004 * size}
    scene.add_frame("/second", position=tuple(there[0]), wxyz=bodies.wxyz(there[1]), **axes)
    bodies.base_of(scene, "/second/base", act.robots[0], size, GHOST)
    move = mover(scene, "/second/arm", act, size, GHOST)
    _path(scene, "/second/path of the gripper", act, GHOST, size)
    feet = np.array([np.asarray(c.position) for c in act.robots[0].support.contacts])
    edges = around(feet) + np.array([0, 0, 1e-3 * size])
    scene.add_line_segments("/second/support polygon", edges, colors=GHOST, thickness=0.003 * size)
    pressure = scene.add_icosphere("/second/zero-moment point", 0.018 * size, color=GHOST)
    below = tuple(top - np.array([0, 0, 0.02 * size]))
    title = scene.add_label("/clock of the second", act.name, position=below, anchor="top-center")
    slip = act.seen.slip

    def frame(k: int) -> None:
        move(k)
        press(pressure, shared_forces(act.seen.states.contact_forces, slip, k), feet)
        title.text = f"(ghost) {act.clock(k)}"

    return frame


def mover(
    scene: Any, root: str, act: Act, size: float, ghost: tuple[int, int, int] | None = None
) -> Callable[[int], None]:
    """Puts an arm on stage with what it holds in turn, and says how to show it in a frame."""
    if act.lines:
        return closed_chains.legs(scene, root, act.lines, size, ghost)
    links = bodies.arm(scene, root, act.robots[0], size, ghost)
    held = [bodies.held(scene, root, one, number, size, ghost) for number, one in enumerate(act.robots)]

    def frame(k: int) -> None:
        for link, rotation, origin in zip(
            links, act.frames.rotations[k], act.frames.origins[k], strict=False
        ):
            link.position, link.wxyz = origin, bodies.wxyz(rotation)
        for number, nodes in enumerate(held):
            for node in nodes:
                node.visible = number == act.owner[k]

    return frame


def _path(scene: Any, name: str, act: Act, color: tuple[int, int, int], size: float) -> None:
    ends = bodies.segments(act.frames.origins[:, -1])
    scene.add_line_segments(name, ends, colors=color, thickness=0.003 * size)


def reserve_clock(tip: TipOverReserve, slip: SlipReserve, forces: np.ndarray, k: int) -> str:
    """Margins of state k, with its forces (n, 3), N."""
    support = tip.states.support
    shared = "" if Slip(support).redistribution == "tangential" else " (one possible sharing)"
    shared = " (equally compliant feet)" if equal_normal_map(support) is not None else shared
    force = f"minimum foot force {quantity(forces[:, 0].min(), 'N', 3)}{shared}"
    return ", ".join([*margin_texts(tip, slip, k), force])


def shared_forces(contact_forces: np.ndarray, slip: SlipReserve, k: int) -> np.ndarray:
    """Forces (n, 3), N, contact axes, of state k as the friction optimum shares them, else those of the
    contact solver.
    """
    shared = np.column_stack([slip.normal_forces[k], slip.tangential_forces[k]])
    return shared if np.all(np.isfinite(shared)) else contact_forces[k]


def scene_show(scene: Scene, contact_forces: np.ndarray, tip: TipOverReserve, slip: SlipReserve) -> Show:
    """A base on its contacts under the loads of a scene file.

    Args:
        scene: in space.
        contact_forces: (1, n, 3), N, contact axes.
        tip, slip: margins of that state.

    Raises:
        InputError: the scene is in the plane.
    """
    support = scene.support
    if scene.planar:
        raise InputError("is in the plane; ocptip stand --plot draws it", "", scene.name)
    points = np.vstack([[np.asarray(c.position) for c in support.contacts], support.center_of_mass])
    centre, size = points.mean(axis=0), float(np.linalg.norm(np.ptp(points, axis=0)))

    def stage(server: Any) -> Callable[[int], None]:
        drawn = server.scene
        bodies.base(drawn, "/base", support, support.center_of_mass)
        bodies.grid(drawn, support, centre, size)
        total = support.mass
        forces = Forces(drawn, support, total, size)
        weight = float(np.linalg.norm(support.weight[:3])) or 1.0
        for k, load in enumerate(scene.loads):
            if load.force is not None:
                tip_of = np.asarray(load.point if load.point is not None else np.zeros(3), dtype=float)
                tail = tip_of - TALL * size * np.asarray(load.force, dtype=float) / weight
                bodies.arrows(drawn, f"/load {k + 1}", np.array([[tail, tip_of]]), LOAD, size)
        shared = shared_forces(contact_forces, slip, 0)
        text = f"{scene.name}  {reserve_clock(tip, slip, shared, 0)}"
        top = centre + np.array([0, 0, 0.7 * size])
        drawn.add_label("/clock", text, position=tuple(top), anchor="bottom-center")
        forces.show(shared, tip, 0)
        return lambda _: None

    times = np.zeros(1)
    return Show(stage, times, centre, size, _panel(times, contact_forces, tip, slip))
