"""The page of the studio for closed chains: sliders of the platform, legs near their limits, workspace."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from ocptip.basics.errors import OcptipError
from ocptip.basics.text import percent, quantity
from ocptip.parallel.analysis.singularity import SINGULAR
from ocptip.parallel.analysis.workspace import LENGTHS, ChainPosture
from ocptip.parallel.robot import ParallelRobot
from ocptip.pictures.browser import bodies, closed_chains
from ocptip.pictures.browser.bodies import JOINT, LINK
from ocptip.pictures.browser.forces import Forces
from ocptip.pictures.browser.panel import BAD, GOOD, WARNING
from ocptip.pictures.browser.sliders import Actions, SliderPage, headed
from ocptip.pictures.browser.view import HERE, Act, open_server, shared_forces
from ocptip.standing.margins import Margins
from ocptip.standing.platform import StandingParallelRobot

_NEAR = 0.1  # of half the range of a joint, from which on its leg is orange
_ORANGE, _RED = (240, 140, 0), (215, 30, 30)
_TURN = np.radians(60.0)  # of sliders of angles without limits
_LEGEND = """<p style='margin:6px 12px;color:#555;font-size:85%'>
A leg is <b style='color:rgb(240,140,0)'>orange</b> where a joint is near an end of its range (a tenth of
half of it), <b style='color:rgb(215,30,30)'>red</b> beyond, or where the leg is singular. The picture
keeps the last pose that can be reached. Singular values are those of unit speeds, angles counted as lengths;
below 0.001 a pose counts as singular. Blue dots: edge of the workspace; red dots: singular poses.</p>"""


@contextmanager
def chain_page(
    robot: ParallelRobot,
    standing: StandingParallelRobot | None,
    ends: dict[str, np.ndarray],
    actions: Actions | None,
) -> Iterator[ChainPage]:
    """The page on a server, while it is open; arguments as of `ChainPage`."""
    place, rotation = HERE if standing is None else (standing.position, standing.rotation)
    points = np.vstack([place + line @ rotation.T for line in robot.kinematics.sticks(ends["start"])])
    if standing is not None:
        points = np.vstack([points, [np.asarray(c.position) for c in standing.support.contacts]])
    centre, size = points.mean(axis=0), float(np.linalg.norm(np.ptp(points, axis=0)))
    with open_server(centre, size) as server:
        page = ChainPage(server, robot, standing, ends, actions, centre, size)
        try:
            yield page
        finally:
            page.close()


class ChainPage(SliderPage):
    """A closed chain at rest, whose platform is moved by sliders.

    Args:
        server: of viser.
        robot: the closed chain.
        standing: the same on its base; None: without one there are no margins.
        ends, actions: as of `SliderPage`; the page begins at "start".
        centre, size: (3,), m, and m, of the picture.

    Attributes:
        answered: the latest pose that was reached.
    """

    def __init__(
        self,
        server: Any,
        robot: ParallelRobot,
        standing: StandingParallelRobot | None,
        ends: dict[str, np.ndarray],
        actions: Actions | None,
        centre: np.ndarray,
        size: float,
    ) -> None:
        self.robot, self.standing, scene = robot, standing, server.scene
        names = robot.description.platform.coordinates
        units = ["m" if name in LENGTHS else "rad" for name in names]
        super().__init__(server, robot.description.name, units, ends, actions, size)
        self.answered: ChainPosture | None = None
        self._place, self._rotation = HERE if standing is None else (standing.position, standing.rotation)
        z, self._forces = ends["start"], None
        self._nodes = closed_chains.bodies_of(scene, "/robot", self._lines(ChainPosture(robot, z)), size)
        if standing is None:
            low = np.array([*centre[:2], min(leg.origin[2] for leg in robot.kinematics.legs)])
            scene.add_grid("/ground", 4 * size, 4 * size, cell_size=0.1, position=tuple(low))
        else:
            bodies.base(scene, "/base", standing.support, standing.sensor.position)
            bodies.grid(scene, standing.support, centre, size)
            self._forces = Forces(scene, standing.support, standing.mass, size)
        self._controls(names, z)
        self.begin()

    def _controls(self, names: Sequence[str], z: np.ndarray) -> None:
        gui, around = self.server.gui, np.where(self._turning, _TURN, round(self.size / 2, 2))
        lower, upper = z - around, z + around
        if self.standing is not None:
            limits = self.standing.limits
            lower = np.where(np.isfinite(limits.angle_min), limits.angle_min, lower)
            upper = np.where(np.isfinite(limits.angle_max), limits.angle_max, upper)
        self.message = gui.add_html("")
        with gui.add_folder("Platform"):
            self.coordinate_sliders(names, lower, upper, z)
        button = gui.add_button("Workspace and singular poses with this orientation")
        button.on_click(lambda _: self.guarded(self.workspace))
        if self.actions is not None:
            self.pose_buttons()
        gui.add_html(_LEGEND)

    @property
    def steps(self) -> Sequence[Callable[[], None]]:
        """One answer: pose, ranges, distance from singular poses, margins."""
        return (self._answer,)

    def workspace(self) -> None:
        """Draw the workspace with the orientation of the sliders."""

        def counted(done: int, total: int, _: None) -> None:
            self.tell(f"workspace: {done} of {total} poses", WARNING)

        scene, z, place = self.server.scene, self.posture(), (self._place, self._rotation)
        closed_chains.workspace_of(scene, self.robot, z, self.size, *place, counted)
        self.tell("", GOOD)

    def show(self, act: Act, k: int) -> None:
        """Show frame k of a plan."""
        self._draw(act.lines[k], [LINK] * len(self.robot.description.legs))
        if self._forces is not None:
            shared = shared_forces(act.seen.states.contact_forces, act.seen.slip, k)
            self._forces.show(shared, act.seen.tip, k)

    def _answer(self) -> None:
        try:
            answer = ChainPosture(self.robot, self.posture())
        except OcptipError as error:
            self.tell(str(error), BAD)
            return
        self.answered, beyond, margins = answer, answer.beyond, self._margins(answer.z)
        self._draw(self._lines(answer), self._colors(answer))
        title = "OUT OF RANGE OR SINGULAR" if beyond else "Reached"
        self.verdict.content = headed(title, BAD if beyond else GOOD, [*answer.lines, *margins])
        self.tell("; ".join(beyond), BAD)

    def _margins(self, z: np.ndarray) -> list[tuple[str, str]]:
        """Names and values of margins and motor forces at rest, and the contact forces drawn."""
        if self.standing is None or self._forces is None:
            return []
        standing, still = self.standing, 0 * z[None]
        seen = standing.samples_of(np.zeros(1), z[None], still, still)
        self._forces.show(shared_forces(seen.states.contact_forces, seen.slip, 0), seen.tip, 0)
        margins = Margins.under(seen.wrenches, standing.tip_over, standing.slip)[0]
        used = np.abs(seen.torques[0]) / standing.limits.torque
        motor = int(np.argmax(used))
        return [
            ("tipping margin", quantity(float(margins.tipping_moment), "N m", 3)),
            ("friction used", percent(float(margins.GT))),
            ("minimum foot force", quantity(float(margins.normal_forces.min()), "N", 3)),
            ("motor force used", f"{percent(float(used[motor]))} of motor {motor + 1}"),
        ]

    def _lines(self, posture: ChainPosture) -> list[np.ndarray]:
        lines = self.robot.kinematics.sticks(posture.z, posture.found.q)
        return [self._place + line @ self._rotation.T for line in lines]

    def _colors(self, posture: ChainPosture) -> list[tuple[int, int, int]]:
        """A colour for each leg."""
        colors = [LINK] * len(self.robot.description.legs)
        for joint in reversed(posture.joints):  # the worst of a leg comes last
            if joint.left < _NEAR:
                colors[joint.leg] = _RED if joint.left < 0 else _ORANGE
        for leg, kind in enumerate(posture.singularity.legs):
            colors[leg] = _RED if kind < SINGULAR else colors[leg]
        return colors

    def _draw(self, lines: Sequence[np.ndarray], legs: Sequence[tuple[int, int, int]]) -> None:
        counts = [len(leg.topology.parents) for leg in self.robot.kinematics.legs]
        colors = [color for color, count in zip(legs, counts, strict=True) for _ in range(count)]
        for node, line, color in zip(self._nodes, lines, [*colors, JOINT], strict=True):
            node.points = closed_chains.pieces(line)
            node.colors = np.array(color, dtype=np.uint8)
