"""Pictures of a scene: support polygon, contact forces, friction used, loads and tipping axes.

A spatial scene gets two panels: seen along a base axis with the friction limits as discs, and in three
dimensions with all forces. A planar one gets the forces in their friction cones, and bars of the friction
used. Contacts are numbered from 1, as in the printed table. Contact forces start at their contact; weight
and loads point at where they act.
"""

from __future__ import annotations

import os
from pathlib import Path

from matplotlib.figure import Figure

from ocptip.basics.errors import InputError
from ocptip.contact.states import ContactStates
from ocptip.pictures.frame import new_figure, save_figure
from ocptip.pictures.labels import Labels
from ocptip.pictures.scene_panels import draw_friction_bars, draw_plane, draw_space, draw_top, fit_space
from ocptip.pictures.scene_picture import ScenePicture
from ocptip.pictures.style import BROKEN, head
from ocptip.reserves.slip import SlipReserve
from ocptip.reserves.tipping import TipOverReserve
from ocptip.task_files.scene import Scene

FORMATS = ("png", "pdf", "svg")


def plot_scene(
    scene: Scene,
    states: ContactStates,
    tip: TipOverReserve,
    slip: SlipReserve,
    path: str | os.PathLike[str],
    *,
    index: int = 0,
) -> None:
    """Draw one state of a scene into a file; an existing file is replaced only by a complete one.

    Args:
        scene: the scene.
        states: solved states of its support.
        tip, slip: the margins of these states.
        path: file name ending in .png, .pdf or .svg.
        index: which of the states.

    Raises:
        InputError: unknown file format.
        OSError: the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower().lstrip(".") not in FORMATS:
        raise InputError(f"path: expected a file name ending in .png, .pdf or .svg, got {str(path)!r}")
    save_figure(draw_scene(scene, states, tip, slip, index=index), path, 150)


def draw_scene(
    scene: Scene, states: ContactStates, tip: TipOverReserve, slip: SlipReserve, *, index: int = 0
) -> Figure:
    """A Matplotlib figure of a scene, see `plot_scene`."""
    picture = ScenePicture(scene, states, tip, slip, index)
    labels = Labels()
    figure = new_figure(13.0, 7.0)
    color = "black" if states.persistent[index] else BROKEN
    head(figure, picture.title, color=color)
    if scene.planar:
        left, right = figure.subplots(1, 2, width_ratios=[1.7, 1.0])
        draw_plane(left, picture, labels)
        draw_friction_bars(right, picture)
    else:
        left = figure.add_subplot(1, 2, 1)
        right = figure.add_subplot(1, 2, 2, projection="3d")
        draw_top(left, picture, labels)
        draw_space(right, picture, labels)
    figure.draw_without_rendering()
    if not scene.planar:
        fit_space(right)
    figure.set_layout_engine("none")
    labels.place(figure)
    return figure
