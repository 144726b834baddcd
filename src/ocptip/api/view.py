"""`ocptip.view`: a plan, a scene or a placement in three dimensions, as a page for a browser."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, naming
from ocptip.basics.outputs import OUTPUTS
from ocptip.basics.read import only_inside, read_json, require_readable
from ocptip.basics.write import versions, write_text
from ocptip.contact.resting import solve_resting
from ocptip.pictures.animation import Moving, plan_times, save_animation
from ocptip.pictures.browser.view import HERE, Show, motion_show, pose_show, scene_show, serve, to_html
from ocptip.pictures.movie import require_format
from ocptip.placement.output import PLACEMENT
from ocptip.placement.problem import PlacementProblem
from ocptip.reserves.equal_compliance import reported_slip
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver
from ocptip.standing.arm import Robot
from ocptip.standing.parts import Part
from ocptip.task_files.placement import load_placement
from ocptip.task_files.plan_folder import read_plan_folder
from ocptip.task_files.scene import read_scene

PLAN_FOLDER = "plan"
"""Name of the folder of the plan at the best place of a cell."""


def view(
    what: str | os.PathLike[str],
    second: str | os.PathLike[str] | None = None,
    *,
    task: str | os.PathLike[str] | None = None,
) -> View:
    """Show a plan, a scene or a placement; `save` writes a page, `serve` opens it for a browser.

    Example::

        ocptip.view("examples/scenes/pushed_cart.toml").save("cart.html")

    Args:
        what: the folder of a plan or of a placement, or a scene file.
        second: the folder of a second plan, shown beside the first.
        task: the task file of a placement, whose folder does not hold the robot.

    Raises:
        InputError: nothing of that kind is there; one line.
    """
    return _view(Path(what), None if second is None else Path(second), task)


@dataclass(frozen=True, eq=False, repr=False)
class View:
    """An animated view of a scene, a plan or a robot.

    Attributes:
        name: of what it shows.
        make_show: makes the frames over times.
        plans: names and motions of the plans that it shows; none: what stands still.
    """

    name: str
    make_show: Callable[[], Show]
    plans: tuple[tuple[str, tuple[Part, ...]], ...] = ()

    @cached_property
    def show(self) -> Show:
        """Frames over times, in three dimensions."""
        return self.make_show()

    @property
    def frames(self) -> int:
        """Their number."""
        return len(self.show.times)

    @cached_property
    def html(self) -> str:
        """The page in three dimensions, complete in itself; needs the package viser."""
        return to_html(self.show)

    def __repr__(self) -> str:
        """The name."""
        return f"<View {self.name}>"

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write a page (.html) or an animation (.gif, .mp4); returns its path.

        A page is in three dimensions; the other files show bodies as lines.

        Raises:
            InputError: another ending, or an animation of what stands still.
        """
        path = Path(path)
        if require_format(path) == ".html":
            write_text(path, self.html)
            return path
        if not self.plans:
            raise InputError("stands still; animations are of plans", "", self.name)
        times = plan_times(*(parts for _, parts in self.plans))
        return save_animation([Moving.of_plan(name, parts, times) for name, parts in self.plans], path)

    def serve(self, say: Callable[[str], None]) -> None:
        """Serve the page until Ctrl-C; `say` gets its address."""
        serve(self.show, say)

    def to_dict(self, path: Path | None = None) -> dict[str, Any]:
        """Plain data for JSON; with the page's size, if it was written to a path."""
        return {
            "name": self.name,
            "frames": self.frames,
            "html": None if path is None else f"{path}",
            "bytes": path.stat().st_size if path is not None and path.is_file() else 0,
            "versions": versions(("viser",)),
        }


def _view(path: Path, second: Path | None, task: str | os.PathLike[str] | None) -> View:
    placement = path / PLACEMENT if path.is_dir() else path
    if placement.name == PLACEMENT and placement.is_file() and second is None:
        with only_inside(placement.parent):
            require_readable(placement)
        name, show = _placement(placement, task)
        return View(name, lambda: show)
    if task is not None:
        raise InputError(f"task: belongs to the folder of a placement, and {path} is none")
    if path.is_dir():
        return _view_of_plans(path, second)
    if second is not None:
        raise InputError("is shown alone; two folders of plans are shown together", "", str(path))
    if path.is_file() and path.suffix != ".toml":
        raise InputError("expected a scene (.toml), or the folder of a plan or of a placement", "", str(path))
    scene = read_scene(path)
    states = solve_resting(scene.support, scene.wrench[None])  # as `stand`: what holds the base, if anything
    with naming(str(path)):
        tip = TipOver(scene.support).evaluate(states)
        slip = reported_slip(states, Slip(scene.support).evaluate(states, derivatives=False))
        show = scene_show(scene, states.contact_forces, tip, slip)
    return View(scene.name, lambda: show)


def _view_of_plans(path: Path, second: Path | None) -> View:
    folders = [read_plan_folder(folder) for folder in (path, second) if folder is not None]
    names = [folder.task.name for folder in folders]
    if len(set(names)) < len(names):  # the folders' names tell them apart
        names = [f"{folder.path}" for folder in folders]
    plans = tuple((name, folder.every_part) for name, folder in zip(names, folders, strict=True))

    def show() -> Show:
        if second is None:
            return motion_show(*plans[0])
        return motion_show(*plans[0], plans[1], _between(path, second))

    return View(" and ".join(names), show, plans)


def _between(first: Path, second: Path) -> tuple[np.ndarray, np.ndarray]:
    """Origin, m, and rotation of the second plan's base axes in the first's: of cells, where they stand."""
    first_place, other = _place_of(first), _place_of(second)
    if first_place is None or other is None:
        return HERE
    return first_place[1].T @ (other[0] - first_place[0]), first_place[1].T @ other[1]


def _place_of(folder: Path) -> tuple[np.ndarray, np.ndarray] | None:
    """Where the base of a plan of `ocptip cell` stands; None of other plans."""
    path = folder.resolve().parent / OUTPUTS["cell"][0]
    if folder.resolve().name != PLAN_FOLDER or not path.is_file():
        return None
    try:
        with only_inside(path.parent):
            base = read_json(path)["places"][0]["placement"]["base"]
        place = tuple(np.array(base[key], dtype=float) for key in ("position", "rotation"))
        return np.reshape(place[0], 3), np.reshape(place[1], (3, 3))
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise InputError(f"is not what `ocptip cell` wrote: {error}", "", str(path)) from None


def _placement(path: Path, task_file: str | os.PathLike[str] | None) -> tuple[str, Show]:
    """The best placement of a file, in base axes, with what stands around it."""
    if task_file is None:
        raise InputError("missing; the file does not hold the robot, name its task file", "task", str(path))
    data, problem = read_json(path), load_placement(task_file).problem
    try:
        if not data["found"]:
            raise InputError("holds no placement", "", str(path))
        best = data["best"]
        position, rotation = (np.array(best["base"][key], dtype=float) for key in ("position", "rotation"))
        values = np.array([best["angles_deg"][task.name] for task in problem.tasks], dtype=float)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"does not fit {task_file}: {error}", "", str(path)) from None
    robot = _in_its_place(problem, position, rotation)
    if values.shape[1] != robot.n:
        raise InputError(
            f"has {values.shape[1]} joint values, the arm of {task_file} {robot.n}", "", str(path)
        )
    q = np.where(robot.arm.prismatic, values, np.deg2rad(values))
    return data["task"], pose_show(f"{data['task']}, {problem.tasks[0].name}", robot, q[0])


def _in_its_place(problem: PlacementProblem, position: np.ndarray, rotation: np.ndarray) -> Robot:
    """The robot with gravity and obstacles of the world, in base axes."""
    robot = problem.robot
    around = [
        one.placed(rotation.T, -rotation.T @ position) for one in (*problem.obstacles, *problem.keep_out)
    ]
    support = robot.support.varied(gravity=rotation.T @ np.asarray(problem.gravity))
    return robot.varied(support=support, obstacles=(*robot.obstacles, *around))
