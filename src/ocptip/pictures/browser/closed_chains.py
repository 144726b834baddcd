"""Closed chains on a stage of viser: legs and platform that move, workspace and singular surface.

Both surfaces are dots between cells of a grid of poses with the platform turned as it is shown: between
cells that all joints reach within their ranges and others, and where the motors' volume changes its sign.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ocptip.parallel.analysis.workspace import LENGTHS, Watcher, Workspace, workspace
from ocptip.parallel.minimal_form import minimal_obstacle
from ocptip.parallel.robot import ParallelRobot
from ocptip.pictures.browser.bodies import JOINT, LINK, wxyz

REACHED, SINGULAR = (60, 130, 220), (220, 40, 40)
LEGEND = (
    "<br><b style='color:rgb(60,130,220)'>blue dots</b> edge of the workspace, "
    "<b style='color:rgb(220,40,40)'>red dots</b> singular poses, with the first orientation"
)
_CELLS, _SLOW_CELLS = 40, 12  # per coordinate; without closed forms a pose takes milliseconds
_DOT = 0.004  # over the size of the picture


def legs(
    scene: Any,
    root: str,
    lines: Sequence[Sequence[np.ndarray]],
    size: float,
    ghost: tuple[int, int, int] | None = None,
) -> Callable[[int], None]:
    """Put the bodies of a closed chain on stage; returns what shows a frame."""
    nodes = bodies_of(scene, root, lines[0], size, ghost)

    def frame(k: int) -> None:
        for node, line in zip(nodes, lines[k], strict=True):
            node.points = pieces(line)

    return frame


def bodies_of(
    scene: Any,
    root: str,
    lines: Sequence[np.ndarray],
    size: float,
    ghost: tuple[int, int, int] | None = None,
) -> list[Any]:
    """Nodes of the bodies of a closed chain, the platform last, as lines (k, 3), m, each."""
    colors, thick = [LINK] * (len(lines) - 1) + [JOINT], 0.012 * size
    return [
        scene.add_line_segments(f"{root}/{k}", pieces(line), colors=ghost or color, thickness=thick)
        for k, (line, color) in enumerate(zip(lines, colors, strict=True), 1)
    ]


def pieces(line: np.ndarray) -> np.ndarray:
    """(k - 1, 2, 3) pieces of a line (k, 3)."""
    return np.stack([line[:-1], line[1:]], axis=1).astype(np.float32)


def workspace_of(
    scene: Any,
    robot: ParallelRobot,
    z: np.ndarray,
    size: float,
    place: np.ndarray,
    rotation: np.ndarray,
    progress: Watcher | None = None,
) -> None:
    """Draw where the platform gets with its orientation at z, and is singular.

    Args:
        scene: of viser.
        robot: whose world has its origin at a place (3,), m, and is turned by a rotation (3, 3).
        z: (m,) coordinates.
        size: of the picture, m.
        place, rotation: see `robot`.
        progress: see `workspace`.

    Raises:
        InputError: the robot has not as many motors as coordinates.
    """
    known = robot.description.platform.coordinates
    ranges = {name: (z[k] - size, z[k] + size) for k, name in enumerate(known) if name in LENGTHS}
    cells = _SLOW_CELLS if minimal_obstacle(robot) else _CELLS
    result = workspace(robot, ranges, at=z, cells=cells, progress=progress)
    scene.add_frame("/closed chain", show_axes=False, position=place, wxyz=wxyz(rotation))
    middle = robot.kinematics.pose(z)[0]
    for name, faces, color in (
        ("workspace", boundary(result), REACHED),
        ("singular poses", sign_changes(result), SINGULAR),
    ):
        label = f"/closed chain/{name}"
        if len(faces):
            dots = middles(result, faces, middle).astype(np.float32)
            scene.add_point_cloud(label, dots, color, point_size=_DOT * size, point_shape="circle")
        else:
            scene.remove_by_name(label)


def boundary(result: Workspace) -> np.ndarray:
    """(F, 4): axis and cell (3,) before each face between the inside and others.

    Where the inside ends with the grid, nothing is known beyond.
    """
    return _between(_solid(result, result.inside).astype(int))


def sign_changes(result: Workspace) -> np.ndarray:
    """(F, 4) faces, as those of `boundary`, inside, where the motors' volume changes its sign."""
    signs = np.where(result.inside, np.sign(np.nan_to_num(result.dexterity)), 0.0)
    return _between(_solid(result, signs).astype(int), only=-1)


def _solid(result: Workspace, values: np.ndarray) -> np.ndarray:
    """Values of the cells over x, y and z; one cell along what does not vary."""
    count = dict(zip(result.names, values.shape, strict=True))
    return values.reshape([count.get(name, 1) for name in LENGTHS])


def _between(cells: np.ndarray, only: int | None = None) -> np.ndarray:
    """(F, 4) faces between cells that differ, or whose product is `only`."""
    results = []
    for axis in range(3):
        one, other = np.delete(cells, -1, axis), np.delete(cells, 0, axis)
        here = one != other if only is None else one * other == only
        places = np.argwhere(here)
        results.append(np.column_stack([np.full(len(places), axis), places]))
    return np.vstack(results)


def middles(result: Workspace, faces: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(F, 3), m: the middles of faces; along what does not vary they are at `place` (3,)."""
    known, points = dict(zip(result.names, result.values, strict=True)), np.tile(place, (len(faces), 1))
    for axis, name in enumerate(LENGTHS):
        if name in known:
            step = known[name][1] - known[name][0]
            points[:, axis] = known[name][0] + step * (faces[:, 1 + axis] + 0.5 * (faces[:, 0] == axis))
    return points
