"""The page of the studio: a robot at rest with sliders for posture, load, floor, push and base.

Margins come first, then robustness and the worst case unless something changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from ocptip.basics.errors import OcptipError
from ocptip.basics.text import quantity
from ocptip.pictures.browser import bodies
from ocptip.pictures.browser.forces import Forces
from ocptip.pictures.browser.panel import BAD, GOOD, WARNING
from ocptip.pictures.browser.sliders import FRESH, STALE, Actions, SliderPage, headed, section
from ocptip.pictures.browser.view import LOAD, Act, open_server, shared_forces
from ocptip.robots.kinematics import link_frames
from ocptip.robots.payload import Payload
from ocptip.standing.at_rest.posture_study import Conditions, PostureAnswer, PostureStudy

_AROUND = 1.2  # m, of the sliders of the TCP about the middle of the base, at least
_PUSH, _PAYLOAD, _TILT, _ACCELERATION = 300.0, 10.0, 20.0, 3.0  # N, kg, deg, m/s^2: ends of sliders, at least
_ARROW = 0.25  # length of the arrow of the largest push, over the size of the picture


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


class StudioPage(SliderPage):
    """Posture, load, floor, push and base of an arm.

    Args:
        server: of viser.
        name: of the task.
        study: that answers.
        conditions: to begin with.
        ends, actions: as of `SliderPage`.
        centre, size: (3,), m, and m, of the picture.

    Attributes:
        worst, robust: texts as HTML: margins in the worst case, robustness.
        answered: the latest answer.
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
        self.study, self._start, robot = study, conditions, study.robot
        super().__init__(server, name, robot.units, ends, actions, size)
        self.answered: PostureAnswer | None = None
        scene = server.scene
        bodies.surroundings(scene, robot, centre, size)
        self._links = bodies.arm(scene, "/arm", robot, size, None)
        self._forces = Forces(scene, robot.support, robot.mass, size)
        still = np.zeros((1, 2, 3)) + np.array([[0.0, 0, 0], [0, 0, 1e-3 * size]])
        self._push = bodies.arrows(scene, "/push", still, LOAD, size)
        self._drag = scene.add_transform_controls("/drag the TCP", scale=0.3 * size, visible=False)
        self._payload: tuple[float, Any] = (-1.0, None)
        self._controls()
        self._drag.on_update(lambda _: self._dragged())
        self.begin()

    # --- controls -----------------------------------------------------------------------------------------

    def _controls(self) -> None:
        gui, robot, start = self.server.gui, self.study.robot, self._start
        self.worst, self.robust, self.message = (gui.add_html("") for _ in range(3))
        position, _ = self.study.tcp(start.q)
        with gui.add_folder("TCP, orientation kept where possible" if robot.n >= 6 else "TCP"):
            reach = max(_AROUND, 1.05 * float(robot.arm.reach))
            middle = robot.arm.mount_position
            for k, axis in enumerate("xyz"):
                low, high = middle[k] - reach, middle[k] + reach
                self.slider(f"tcp_{axis}", f"{axis} [m]", low, high, 1e-3, position[k], aims=True)
            drag = gui.add_checkbox("drag handle in the picture", initial_value=False)
            drag.on_update(lambda _: setattr(self._drag, "visible", drag.value))
        with gui.add_folder("Conditions"):
            most = max(_PAYLOAD, 3 * start.payload)
            self.slider("payload", "payload [kg]", 0.0, most, 0.01, start.payload)
            self.slider("friction", "friction factor", 0.1, 2.0, 0.01, 1.0)
            self.slider("tilt", "tilt of the floor [deg]", 0.0, _TILT, 0.1, 0.0)
            self.slider("downhill", "downhill from x [deg]", -180.0, 180.0, 1.0, 0.0)
            self.slider("push", "push at the TCP [N]", 0.0, _PUSH, 1.0, 0.0)
            self.slider("towards", "push from x [deg]", -180.0, 180.0, 1.0, 0.0)
            self.slider("ax", "base acceleration x [m/s^2]", -_ACCELERATION, _ACCELERATION, 0.01, 0.0)
            self.slider("ay", "base acceleration y [m/s^2]", -_ACCELERATION, _ACCELERATION, 0.01, 0.0)
        with gui.add_folder("Joints", expand_by_default=False):
            limits = robot.limits
            lower = np.where(np.isfinite(limits.angle_min), limits.angle_min, -np.pi)
            upper = np.where(np.isfinite(limits.angle_max), limits.angle_max, np.pi)
            self.coordinate_sliders(robot.names, lower, upper, start.q)
        self.pose_buttons()
        gui.add_html(_LEGEND)

    def _dragged(self) -> None:
        for axis, value in zip("xyz", self._drag.position, strict=True):
            self.set(f"tcp_{axis}", float(value))

    def conditions(self) -> Conditions:
        """What the sliders say."""
        slider_values = {key: handle.value for key, handle in self.sliders.items()}
        angles = {key: float(np.radians(slider_values[key])) for key in ("tilt", "downhill", "towards")}
        kept = {key: float(slider_values[key]) for key in ("payload", "friction", "push")}
        return Conditions(
            self.posture(),
            **kept,
            **angles,
            acceleration=(slider_values["ax"], slider_values["ay"]),
        )

    # --- answers ------------------------------------------------------------------------------------------

    @property
    def steps(self) -> Sequence[Callable[[], None]]:
        """Margins first, then robustness and the worst case."""
        return self._answer, self._robustness, self._worst_case

    def show(self, act: Act, k: int) -> None:
        """Show frame k of a plan."""
        self._move(act.frames.rotations[k], act.frames.origins[k])
        forces = shared_forces(act.seen.states.contact_forces, act.seen.slip, k)
        self._forces.show(forces, act.seen.tip, k)

    def _answer(self) -> None:
        conditions, message, note = self.conditions(), "", ""
        if self._aimed:
            self._aimed = False
            place = np.array([self.sliders[f"tcp_{axis}"].value for axis in "xyz"])
            try:
                q, turned = self.study.posture(place, near=conditions.q)
                self.set_posture(q)
                conditions = self.conditions()
                if turned:
                    note = f"TCP turned by {np.degrees(turned):.3g} deg, where it cannot keep its orientation"
            except OcptipError as error:
                message = str(error)
        answer = self.answered = self.study.answer(conditions)
        self._draw(answer)
        position, turn = self.study.tcp(conditions.q)
        if not message:
            for axis, value in zip("xyz", position, strict=True):
                self.set(f"tcp_{axis}", value)
            self._drag.position, self._drag.wxyz = tuple(position), bodies.wxyz(turn)
        self.verdict.content = _verdict_html(answer)
        problems = [text for text in (message, *answer.broken) if text]
        self.tell("; ".join(problems) or note, BAD if problems else WARNING)
        for text in (self.worst, self.robust):
            text.content = text.content.replace(FRESH, STALE)  # keeps its place until it is known

    def _robustness(self) -> None:
        assert self.answered is not None
        result = self.study.robustness(self.answered.conditions)
        self.robust.content = section("Robust to, each alone:", result.lines)

    def _worst_case(self) -> None:
        assert self.answered is not None
        result = self.study.worst(self.answered.conditions)
        if result is not None:
            verdict = "no contact is lost" if result.stable else "A CONTACT IS LOST"
            title = f"Worst case within {self.study.limits.tolerance.scope}: {verdict}"
            kind = self.answered.verdict.verdict
            rows = [*result.lines, ("stability, nominal", kind)]
            self.worst.content = section(title, rows, result.words, bad=not result.stable)

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


_LEGEND = """<p style='margin:6px 12px;color:#555;font-size:85%'>
<b style='color:rgb(30,140,60)'>green arrows</b> contact forces,
<b>black</b> support polygon, <b style='color:rgb(200,30,30)'>red line</b> critical tipping axis,
<b style='color:rgb(220,0,160)'>magenta</b> zero-moment point. At rest; a plan is of the task
without push, tilt and friction factor.</p>"""


def _verdict_html(answer: PostureAnswer) -> str:
    color = BAD if not answer.stable else WARNING if answer.broken else GOOD
    forces = ", ".join(quantity(float(force), "N", 3) for force in answer.forces)
    return headed(answer.headline, color, [*answer.lines, ("foot forces", forces)])
