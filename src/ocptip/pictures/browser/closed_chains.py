"""Closed chains on a stage of viser: legs and platform that move, workspace and singular surface.

Both surfaces are dots between cells of a grid of poses with the platform turned as it is shown: between
cells that all joints reach within their ranges and others, and where the motors' volume changes its sign.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ocptip.parallel.analysis.workspace import LENGTHS, Workspace, workspace
from ocptip.pictures.browser.bodies import JOINT, LINK, wxyz

REACHED, SINGULAR = (60, 130, 220), (220, 40, 40)
LEGEND = (
    "<br><b style='color:rgb(60,130,220)'>blue dots</b> edge of the workspace, "
    "<b style='color:rgb(220,40,40)'>red dots</b> singular poses, with the first orientation"
)
_CELLS = 40  # per coordinate
_DOT = 0.004  # over the size of the picture


def legs(
    scene: Any,
    root: str,
    lines: Sequence[Sequence[np.ndarray]],
    size: float,
    ghost: tuple[int, int, int] | None = None,
) -> Callable[[int], None]:
    """Put the bodies of a closed chain on stage, the platform last; returns what shows a frame."""
    colors = [LINK] * (len(lines[0]) - 1) + [JOINT]
    thick = 0.012 * size
    nodes = [
        scene.add_line_segments(f"{root}/{k}", _pieces(line), colors=ghost or color, thickness=thick)
        for k, (line, color) in enumerate(zip(lines[0], colors, strict=True), 1)
    ]

    def frame(k: int) -> None:
        for node, line in zip(nodes, lines[k], strict=True):
            node.points = _pieces(line)

    return frame


def _pieces(line: np.ndarray) -> np.ndarray:
    return np.stack([line[:-1], line[1:]], axis=1).astype(np.float32)


def workspace_of(scene: Any, robot: Any, q: np.ndarray, size: float) -> None:
    """Draw where the platform of a parallel robot gets with its orientation at q, and is singular."""
    names = [name for name in LENGTHS if name in robot.names]
    middle = np.array([q[robot.names.index(name)] for name in names])
    ranges = {name: (value - size, value + size) for name, value in zip(names, middle, strict=True)}
    result = workspace(robot.robot, ranges, at=q, cells=_CELLS)
    scene.add_frame("/closed chain", show_axes=False, position=robot.position, wxyz=wxyz(robot.rotation))
    place = robot.robot.kinematics.pose(q)[0]
    for name, faces, color in (
        ("workspace", boundary(result), REACHED),
        ("singular poses", sign_changes(result), SINGULAR),
    ):
        if len(faces):
            dots = middles(result, faces, place).astype(np.float32)
            scene.add_point_cloud(
                f"/closed chain/{name}", dots, color, point_size=_DOT * size, point_shape="circle"
            )


def boundary(result: Workspace) -> np.ndarray:
    """(F, 4): axis and cell (3,) before each face between the inside and others; cells count from -1."""
    return _between(np.pad(_solid(result, result.inside), 1).astype(int)) - [0, 1, 1, 1]


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
