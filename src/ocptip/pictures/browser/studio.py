"""The page of the studio: a robot at rest with sliders for posture, load, floor, push and base.

Callbacks of the page only note that something changed. One thread answers the latest state, so that a drag
over many values never queues: margins first, then robustness and the worst case unless something changed.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from ocptip.basics.errors import OcptipError
from ocptip.basics.text import quantity
from ocptip.pictures.browser import bodies
from ocptip.pictures.browser.forces import Forces
from ocptip.pictures.browser.panel import BAD, GOOD, WARNING
from ocptip.pictures.browser.view import (
    GHOST,
    LOAD,
    RATE,
    Act,
    mover,
    open_server,
    shared_forces,
)
from ocptip.robots.kinematics import link_frames
from ocptip.robots.payload import Payload
from ocptip.standing.at_rest.posture_study import Conditions, PostureAnswer, PostureStudy
from ocptip.standing.parts import Part

_AROUND = 1.2  # m, of the sliders of the TCP about the middle of the base, at least
_PUSH, _PAYLOAD, _TILT, _ACCELERATION = 300.0, 10.0, 20.0, 3.0  # N, kg, deg, m/s^2: ends of sliders, at least
_ARROW = 0.25  # length of the arrow of the largest push, over the size of the picture


@dataclass(frozen=True)
class Actions:
    """What buttons do.

    Attributes:
        keep: makes a posture "start" or "goal" of the task, and says where it was saved.
        plan: plans between the poses; a headline, and the motions.
    """

    keep: Callable[[str, np.ndarray], str]
    plan: Callable[[], tuple[str, Sequence[Part]]]


@contextmanager
def studio_page(
    name: str,
    study: PostureStudy,
    conditions: Conditions,
    ends: dict[str, np.ndarray],
    actions: Actions,
) -> Iterator[StudioPage]:
    """The page on a server, while it is open; arguments as of `StudioPage`."""
    robot = study.robot
    contacts = np.array([np.asarray(c.position) for c in robot.support.contacts])
    points = np.vstack([contacts, *(link_frames(robot.arm, q).origins for q in ends.values())])
    centre, size = points.mean(axis=0), float(np.linalg.norm(np.ptp(points, axis=0)))
    with open_server(centre, size) as server:
        page = StudioPage(server, name, study, conditions, ends, actions, centre, size)
        try:
            yield page
        finally:
            page.close()


class StudioPage:
    """Scene and sliders on a viser server.

    Args:
        server: of viser.
        name: of the task.
        study: that answers.
        conditions: to begin with.
        ends: postures (n,) of "start" and "goal"; changed by the buttons.
        actions: of the buttons.
        centre, size: (3,), m, and m, of the picture.

    Attributes:
        sliders: handles by name.
        verdict, worst, robust, message: texts as HTML: margins, nominal and in the worst case, robustness,
            what is wrong.
        answered: the latest answer; `idle` is set while nothing is left to answer.
    """

    def __init__(
        self,
        server: Any,
        name: str,
        study: PostureStudy,
        conditions: Conditions,
        ends: dict[str, np.ndarray],
        actions: Actions,
        centre: np.ndarray,
        size: float,
    ) -> None:
        self.server, self.study, self.ends, self.actions, self.size = server, study, ends, actions, size
        self._start, self._centre, robot = conditions, centre, study.robot
        self.answered: PostureAnswer | None = None
        self.idle, self._changed, self._closed = threading.Event(), threading.Event(), threading.Event()
        self._aimed, self._lock = False, threading.Lock()
        scene = server.scene
        bodies.surroundings(scene, robot, centre, size)
        self._links = bodies.arm(scene, "/arm", robot, size, None)
        self._forces = Forces(scene, robot.support, robot.mass, size)
        still = np.zeros((1, 2, 3)) + np.array([[0.0, 0, 0], [0, 0, 1e-3 * size]])
        self._push = bodies.arrows(scene, "/push", still, LOAD, size)
        self._drag = scene.add_transform_controls("/drag the TCP", scale=0.3 * size, visible=False)
        self._payload: tuple[float, Any] = (-1.0, None)
        self._count = 1
        self._plans: list[tuple[str, Sequence[Part]]] = []
        self._thread = threading.Thread(target=self._work, daemon=True)
        self.sliders: dict[str, Any] = {}
        self._controls(name)
        self._drag.on_update(lambda _: self._dragged())
        self._changed.set()
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._closed.set()
        self._changed.set()
        self._thread.join()

    # --- controls -----------------------------------------------------------------------------------------

    def _controls(self, name: str) -> None:
        gui, robot, start = self.server.gui, self.study.robot, self._start
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        self.verdict = gui.add_html(f"<h3>{escape(name)}</h3>")
        self.worst, self.robust, self.message = (gui.add_html("") for _ in range(3))
        with gui.add_folder("Conditions"):
            most = max(_PAYLOAD, 3 * start.payload)
            self._slider("payload", "payload [kg]", 0.0, most, 0.01, start.payload)
            self._slider("friction", "friction factor", 0.1, 2.0, 0.01, 1.0)
            self._slider("tilt", "tilt of the floor [deg]", 0.0, _TILT, 0.1, 0.0)
            self._slider("downhill", "downhill from x [deg]", -180.0, 180.0, 1.0, 0.0)
            self._slider("push", "push at the TCP [N]", 0.0, _PUSH, 1.0, 0.0)
            self._slider("towards", "push from x [deg]", -180.0, 180.0, 1.0, 0.0)
            self._slider("ax", "base acceleration x [m/s^2]", -_ACCELERATION, _ACCELERATION, 0.01, 0.0)
            self._slider("ay", "base acceleration y [m/s^2]", -_ACCELERATION, _ACCELERATION, 0.01, 0.0)
        with gui.add_folder("Joints"):
            limits = robot.limits
            for k, (joint, unit) in enumerate(zip(robot.names, robot.units, strict=True)):
                scale = 180 / np.pi if unit == "rad" else 1.0
                ends = [
                    scale * (bound if np.isfinite(bound) else turn)
                    for bound, turn in ((limits.angle_min[k], -np.pi), (limits.angle_max[k], np.pi))
                ]
                label = f"{joint} [{'deg' if unit == 'rad' else 'm'}]"
                self._slider(
                    f"q{k}", label, ends[0], ends[1], 0.1 if unit == "rad" else 1e-3, scale * start.q[k]
                )
        position, _ = self.study.tcp(start.q)
        with gui.add_folder("TCP, orientation kept" if robot.n >= 6 else "TCP"):
            reach = max(_AROUND, 1.05 * float(robot.arm.reach))
            middle = robot.arm.mount_position
            for k, axis in enumerate("xyz"):
                low, high = middle[k] - reach, middle[k] + reach
                self._slider(f"tcp_{axis}", f"{axis} [m]", low, high, 1e-3, position[k], aims=True)
            drag = gui.add_checkbox("drag handle in the picture", initial_value=False)
            drag.on_update(lambda _: setattr(self._drag, "visible", drag.value))
        with gui.add_folder("Poses and plan"):
            save, go = (
                gui.add_button_group("save as", ("start", "goal")),
                gui.add_button_group("go to", ("start", "goal")),
            )
            save.on_click(lambda _: self._keep(save.value))
            go.on_click(lambda _: self.set_posture(self.ends[go.value]))
            gui.add_button("Plan and check").on_click(lambda _: self._plan())
            self._play_button = gui.add_button("Play", disabled=True)
            self._play_button.on_click(lambda _: self._play())
        gui.add_html(_LEGEND)

    def _slider(
        self, key: str, label: str, low: float, high: float, step: float, value: float, *, aims: bool = False
    ) -> None:
        low, high = min(low, value), max(high, value)
        handle = self.server.gui.add_slider(label, low, high, step, float(value))
        handle.on_update(lambda _: self._note(aims))
        self.sliders[key] = handle

    def _note(self, aims: bool = False) -> None:
        """A value changed; a slider of the TCP asks for a posture. What the answers set asks nothing."""
        if threading.current_thread() is not self._thread:
            self._aimed |= aims
            with self._lock:
                self.idle.clear()
                self._changed.set()

    def _dragged(self) -> None:
        for axis, value in zip("xyz", self._drag.position, strict=True):
            self._set(f"tcp_{axis}", float(value))

    def _set(self, key: str, value: float) -> None:
        """Move a slider."""
        handle = self.sliders[key]
        handle.value = float(np.clip(value, handle.min, handle.max))

    def set_posture(self, q: np.ndarray) -> None:
        """Move the sliders of the joints to a posture (n,), rad and m."""
        for k, (value, unit) in enumerate(zip(q, self.study.robot.units, strict=True)):
            self._set(f"q{k}", float(np.degrees(value)) if unit == "rad" else float(value))

    def conditions(self) -> Conditions:
        """What the sliders say."""
        slider_values = {key: handle.value for key, handle in self.sliders.items()}
        turning = np.array(self.study.robot.units) == "rad"
        values = np.array([slider_values[f"q{k}"] for k in range(len(turning))], dtype=float)
        angles = {key: float(np.radians(slider_values[key])) for key in ("tilt", "downhill", "towards")}
        kept = {key: float(slider_values[key]) for key in ("payload", "friction", "push")}
        return Conditions(
            np.where(turning, np.radians(values), values),
            **kept,
            **angles,
            acceleration=(slider_values["ax"], slider_values["ay"]),
        )

    # --- answers ------------------------------------------------------------------------------------------

    def _work(self) -> None:
        """Answer the latest state; what comes later is dropped where the state changed meanwhile."""
        while not self._closed.is_set():
            self._changed.wait()
            self._changed.clear()
            for step in (self._answer, self._robustness, self._worst_case):
                if not self._changed.is_set() and not self._closed.is_set():
                    self._guarded(step)
            with self._lock:
                if not self._changed.is_set():
                    self.idle.set()

    def _guarded(self, step: Callable[[], None]) -> None:
        try:
            step()
        except OcptipError as error:
            self._tell(str(error), BAD)

    def _answer(self) -> None:
        conditions, message = self.conditions(), ""
        if self._aimed:
            self._aimed = False
            place = np.array([self.sliders[f"tcp_{axis}"].value for axis in "xyz"])
            try:
                q = self.study.posture(place, near=conditions.q)
                self.set_posture(q)
                conditions = self.conditions()
            except OcptipError as error:
                message = str(error)
        answer = self.answered = self.study.answer(conditions)
        self._draw(answer)
        position, turn = self.study.tcp(conditions.q)
        if not message:
            for axis, value in zip("xyz", position, strict=True):
                self._set(f"tcp_{axis}", value)
            self._drag.position, self._drag.wxyz = tuple(position), bodies.wxyz(turn)
        self.verdict.content = _verdict_html(answer)
        problems = [*([message] if message else []), *answer.broken]
        self._tell("; ".join(problems), BAD)
        for text in (self.worst, self.robust):
            text.content = text.content.replace(_FRESH, _STALE)  # keeps its place until it is known

    def _robustness(self) -> None:
        assert self.answered is not None
        result = self.study.robustness(self.answered.conditions)
        self.robust.content = _section("Robust to, each alone:", result.lines)

    def _worst_case(self) -> None:
        assert self.answered is not None
        result = self.study.worst(self.answered.conditions)
        if result is not None:
            verdict = "no contact is lost" if result.stable else "A CONTACT IS LOST"
            title = f"Worst case within {self.study.limits.tolerance.scope}: {verdict}"
            kind = self.answered.verdict.verdict
            rows = [*result.lines, ("stability, nominal", kind)]
            self.worst.content = _section(title, rows, result.words, bad=not result.stable)

    def _draw(self, answer: PostureAnswer) -> None:
        conditions, size = answer.conditions, self.size
        frames = link_frames(self.study.robot.arm, conditions.q)
        self._move(frames.rotations, frames.origins)
        shared = shared_forces(answer.loaded.states.contact_forces, answer.slip, 0)
        self._forces.show(shared, answer.loaded.tip, 0)
        place, _ = self.study.tcp(conditions.q)
        along = np.array([np.cos(conditions.towards), np.sin(conditions.towards), 0.0])
        tail = place - _ARROW * size * max(conditions.push / _PUSH, 0.2) * along
        self._push.points = np.array([[tail, place]], dtype=np.float32)
        self._push.visible = conditions.push > 0
        if conditions.payload != self._payload[0]:
            self._hold(conditions.payload)

    def _hold(self, mass: float) -> None:
        """A ball for the payload."""
        if self._payload[1] is not None:
            self._payload[1].remove()
        robot, node = self.study.robot, None
        if mass > 0:
            centre = np.zeros(3) if robot.payload is None else robot.payload.center_of_mass
            held = robot.arm.with_payload(Payload(mass, centre))
            node = bodies.payload_ball(self.server.scene, "/arm", held, 0, self.size)
        self._payload = mass, node

    def _move(self, rotations: np.ndarray, origins: np.ndarray) -> None:
        for link, rotation, origin in zip(self._links, rotations, origins, strict=False):
            link.position, link.wxyz = origin, bodies.wxyz(rotation)

    def _tell(self, text: str, color: str) -> None:
        self.message.content = f"<p style='color:{color};margin:4px 12px'>{escape(text)}</p>" if text else ""

    # --- poses and plan -----------------------------------------------------------------------------------

    def _keep(self, which: str) -> None:
        q = self.conditions().q
        self.ends[which] = q
        self._reported(lambda: self.actions.keep(which, q))

    def _plan(self) -> None:
        self._tell("planning ...", WARNING)

        def planned() -> str:
            headline, parts = self.actions.plan()
            self._plans = [*self._plans[-1:], (f"plan {self._count}", parts)]
            self._count += 1
            self._play_button.disabled = False
            return headline

        self._reported(planned)

    def _reported(self, action: Callable[[], str]) -> None:
        try:
            self._tell(action(), GOOD)
        except (OcptipError, OSError) as error:
            self._tell(str(error), BAD)

    def _play(self) -> None:
        """Show the last plan with its forces, the one before as a ghost; then the posture of the sliders."""
        end = max(parts[-1].end for _, parts in self._plans)
        times = np.append(np.arange(0.0, end, 1 / RATE), end)
        *before, act = (Act.of_plan(name, parts, times) for name, parts in self._plans)
        scene, seen = self.server.scene, act.seen
        ghosts = [mover(scene, "/plan before", one, self.size, GHOST) for one in before]
        wait = threading.Event()
        for k in range(len(times)):
            self._move(act.frames.rotations[k], act.frames.origins[k])
            self._forces.show(shared_forces(seen.states.contact_forces, seen.slip, k), seen.tip, k)
            for ghost in ghosts:
                ghost(k)
            texts = [act.clock(k), *(f"(ghost) {one.clock(k)}" for one in before)]
            self.verdict.content = f"<h3 style='margin:4px 12px'>{times[k]:.2f} s</h3>" + "".join(
                f"<p style='margin:4px 12px'>{escape(text)}</p>" for text in texts
            )
            wait.wait(1 / RATE)
        for _ in ghosts:
            scene.remove_by_name("/plan before")
        self._note()


_FRESH, _STALE = "opacity:1", "opacity:0.4"
_CELL = "style='padding:0 8px 0 0;line-height:1.35;white-space:nowrap'"
_LEGEND = """<p style='margin:6px 12px;color:#555;font-size:85%'>
<b style='color:rgb(30,140,60)'>green arrows</b> contact forces,
<b>black</b> support polygon, <b style='color:rgb(200,30,30)'>red line</b> critical tipping axis,
<b style='color:rgb(220,0,160)'>magenta</b> zero-moment point. At rest; a plan is of the task
without push, tilt and friction factor.</p>"""


def _rows(rows: Sequence[tuple[str, str]]) -> str:
    cells = (
        f"<tr><td {_CELL}>{escape(name)}</td><td {_CELL}><b>{escape(value)}</b></td></tr>"
        for name, value in rows
    )
    return f"<table style='margin:0 12px;font-size:13px'>{''.join(cells)}</table>"


def _verdict_html(answer: PostureAnswer) -> str:
    color = BAD if not answer.stable else WARNING if answer.broken else GOOD
    forces = ", ".join(quantity(float(force), "N", 3) for force in answer.forces)
    head = f"<h3 style='color:{color};margin:4px 12px'>{escape(answer.headline)}</h3>"
    return head + _rows([*answer.lines, ("foot forces", forces)])


def _section(title: str, rows: Sequence[tuple[str, str]], below: str = "", *, bad: bool = False) -> str:
    color, kind = BAD if bad else "#555", "margin:6px 14px 0;font-size"
    head = f"<p style='{kind}:13px;color:{color}'>{escape(title)}</p>"
    note = f"<p style='{kind}:11px;color:#555'>{escape(below)}</p>"
    return f"<div style='{_FRESH}'>{head}{_rows(rows)}{note}</div>"
