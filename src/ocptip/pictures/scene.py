"""A picture of a scene: seen along a base axis, in space, in the plane, friction used; with their texts."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from matplotlib.patheffects import withStroke
from mpl_toolkits.mplot3d import proj3d
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from ocptip.basics.errors import InputError
from ocptip.basics.text import percent, quantity
from ocptip.contact.states import ContactStates
from ocptip.pictures import style
from ocptip.pictures.frame import hull, new_figure, save_figure
from ocptip.pictures.scene_picture import ScenePicture, longest, nice
from ocptip.pictures.style import BROKEN, head
from ocptip.reserves.slip import SlipReserve
from ocptip.reserves.tipping import TipOverReserve
from ocptip.task_files.scene import Scene

_GAPS = (5, 14, 26)  # points between a label and its anchor
_TURNS = (0.0, 0.5, -0.5, 1.0, -1.0, 1.6, -1.6, 2.4, -2.4, 3.1)  # rad away from its preferred direction


@dataclass
class Labels:
    """Texts that find free places beside their anchors once the layout of the figure is known."""

    wanted: list[tuple[Any, np.ndarray, np.ndarray, str, str, str]] = field(default_factory=list)
    obstacles: list[tuple[Any, np.ndarray]] = field(default_factory=list)

    def add(self, ax: Any, anchor: Any, towards: Any, text: str, color: str = "black", gid: str = "") -> None:
        """A text at `anchor`, in the direction of `towards` if there is room (both data coordinates)."""
        self.wanted.append((ax, np.asarray(anchor, float), np.asarray(towards, float), text, color, gid))

    def avoid(self, ax: Any, start: Any, end: Any) -> None:
        """Keep texts off the line from `start` to `end` (data coordinates)."""
        steps = np.linspace(0.0, 1.0, 24)[:, None]
        self.obstacles.append((ax, (1 - steps) * np.asarray(start, float) + steps * np.asarray(end, float)))

    def place(self, figure: Figure) -> None:
        """Write all texts."""
        canvas: Any = figure.canvas  # of `new_figure`
        renderer = canvas.get_renderer()
        per_point = figure.dpi / 72.0
        points = np.vstack([np.empty((0, 2)), *(on_screen(ax, line) for ax, line in self.obstacles)])
        boxes: list[np.ndarray] = []
        for ax, anchor, towards, text, color, gid in self.wanted:
            start, ahead = on_screen(ax, np.array([anchor, anchor + towards]))
            moved = np.any(np.abs(ahead - start) > 1e-6)
            preferred = math.atan2(*(ahead - start)[::-1]) if moved else 0.5 * np.pi
            artist = figure.text(0, 0, text, color=color, fontsize=9.5, ha="center", va="center", gid=gid)
            artist.set_path_effects([withStroke(linewidth=2.5, foreground="white")])
            extent = artist.get_window_extent(renderer)
            half = 0.5 * np.array([extent.width, extent.height])
            frame = ax.get_window_extent(renderer)
            best_cost, best_center = np.inf, start
            for gap, turn in product(_GAPS, _TURNS):
                u = np.array([math.cos(preferred + turn), math.sin(preferred + turn)])
                reach = min(half / np.maximum(np.abs(u), 1e-9))  # from the text's centre to its rim
                center = start + (reach + gap * per_point) * u
                box = np.array([center - half - 4, center + half + 4])
                outside = np.any(box[0] < [frame.x0, frame.y0]) or np.any(box[1] > [frame.x1, frame.y1])
                hits = sum(bool(np.all(box[0] < b[1]) and np.all(b[0] < box[1])) for b in boxes)
                covered = int(np.sum(np.all((points > box[0]) & (points < box[1]), axis=1)))
                cost = 100 * hits + 60 * outside + 3 * covered + abs(turn) + 0.1 * gap
                if cost < best_cost:
                    best_cost, best_center = cost, center
            boxes.append(np.array([best_center - half, best_center + half]))
            x, y = figure.transFigure.inverted().transform(best_center)
            artist.set_position((x, y))


def on_screen(ax: Any, points: np.ndarray) -> np.ndarray:
    """Display coordinates (pixels) of data points of a two- or three-dimensional panel."""
    if ax.name == "3d":
        xs, ys, zs = points.T
        x, y, _ = proj3d.proj_transform(xs, ys, zs, ax.get_proj())
        points = np.column_stack([x, y])
    return ax.transData.transform(points)


CONTACT, FRICTION, NEAREST = style.FOOT_FORCE.color, style.FRICTION.color, style.TIPPING.color
LIMIT, WEIGHT, LOAD, MOMENT = "#f0b58a", "#5f5f5f", style.LOAD, style.LOAD_MOMENT
AXIS, GROUND = "#9a9a9a", "#eceae4"
_AXIS_NAMES = "xyz"
_RING = {"marker": "o", "ls": "", "mfc": "none", "mec": NEAREST, "mew": 2.5}
_HEAD = {"headwidth": 3.4, "headlength": 4.2, "headaxislength": 3.8, "minshaft": 1.2}
_SHAFT = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.005, **_HEAD}


def draw_top(ax: Any, picture: ScenePicture, labels: Labels) -> None:
    support, span = picture.scene.support, picture.span
    view = list(_best_view(picture.positions))
    flat = picture.positions[:, view]
    largest = max(float(np.max(picture.limits)), longest(picture.tangential)) or 1.0
    newton_per_metre = nice(largest / _disc_size(flat, span))

    ax.add_patch(Polygon(flat[hull(flat)], facecolor=GROUND, edgecolor="none", zorder=0, gid="polygon"))
    for i, axis in enumerate(picture.axes):
        ends, style = flat[list(axis.contacts)], _axis_style(i == picture.nearest)
        beyond = 0.12 * span * _direction(ends[1] - ends[0])
        ends = np.array([ends[0] - beyond, ends[1] + beyond])
        ax.plot(*ends.T, **style, gid=f"axis-{picture.axis_name(i)}")
        labels.avoid(ax, *ends)
    corners = [flat]
    for k in range(support.n_contacts):
        circle = flat[k] + _circle(support.frames[k][:, 1:], picture.limits[k] / newton_per_metre)[:, view]
        _draw_region(ax, labels, circle, f"limit-{k + 1}")
        ax.plot(*flat[k], "o", ms=5, color=CONTACT, zorder=4)
        corners.append(circle)
        outward = _direction(flat[k] - flat.mean(axis=0), default=(0.0, 1.0))
        rim = flat[k] + outward * np.max((circle - flat[k]) @ outward)
        labels.add(ax, rim, outward * span, picture.contact_text(k), gid=f"contact-{k + 1}")
    arrows = picture.tangential[:, view] / newton_per_metre
    ax.quiver(*flat.T, *arrows.T, **_SHAFT, color=FRICTION, zorder=5, gid="tangential")

    handles: list[Any] = [
        Patch(facecolor=LIMIT, edgecolor=FRICTION, alpha=0.6, label="friction limit at this normal force"),
        Line2D([], [], color=FRICTION, lw=2.5, label="tangential force on the base"),
    ]
    for marker, label, point in _ground_points(picture):
        style = {"marker": marker, "ls": "", "mew": 2.2, "color": "black", "mfc": "none"}
        ax.plot(*point[view], **style, ms=10, zorder=6, gid=label)
        handles.append(Line2D([], [], **style, ms=8, label=label))
        corners.append(point[view][None])
    everything = np.vstack(corners)
    low, high = everything.min(axis=0) - 0.22 * span, everything.max(axis=0) + 0.22 * span
    ax.update_datalim([low, high])
    _finish(ax, f"seen along {_AXIS_NAMES[3 - sum(view)]}: friction", newton_per_metre, handles, picture)
    ax.set(xlabel=f"{_AXIS_NAMES[view[0]]} [m]", ylabel=f"{_AXIS_NAMES[view[1]]} [m]")


def draw_space(ax: Any, picture: ScenePicture, labels: Labels) -> None:
    support, span = picture.scene.support, picture.span
    ax.computed_zorder = False
    ax.set_proj_type("ortho")
    ax.view_init(elev=24, azim=-62)
    rim = hull(picture.positions[:, list(_best_view(picture.positions))])
    ax.add_collection3d(
        Poly3DCollection([picture.positions[rim]], facecolor=GROUND, edgecolor="none", zorder=1)
    )
    for i, axis in enumerate(picture.axes):
        ends = picture.positions[list(axis.contacts)]
        ax.plot(*ends.T, **_axis_style(i == picture.nearest))
        labels.avoid(ax, *ends)
    drawn = [picture.positions, support.center_of_mass[None]]

    def arrow(start: np.ndarray, vector: np.ndarray, color: str, label: str, label_at_end: bool) -> None:
        length = float(np.linalg.norm(vector))
        if length > 0.004 * span:
            head = min(0.4, 0.05 * span / length)
            ax.quiver(*start, *vector, color=color, lw=2.2, arrow_length_ratio=head, zorder=5)
            labels.avoid(ax, start, start + vector)
        drawn.append(np.array([start, start + vector]))
        sign = 1.0 if label_at_end else -1.0
        labels.add(ax, start + vector if label_at_end else start, sign * vector, label, color)

    for k, position in enumerate(picture.positions):
        ax.plot(*np.array([position, support.center_of_mass]).T, color="#c4c4c4", lw=1.2, zorder=2)
        ax.plot(*position[:, None], "o", color=CONTACT, ms=5, zorder=4)
        force = picture.forces[k]
        label = f"{k + 1}: {quantity(float(np.linalg.norm(force)), 'N', 3)}"
        arrow(position, force / picture.newton_per_metre, CONTACT, label, label_at_end=True)
    ax.plot(*support.center_of_mass[:, None], "o", color=WEIGHT, ms=8, zorder=4)
    for name, color, force, point in _acting(picture):
        vector = force / picture.newton_per_metre
        ax.plot(*np.array([point, support.center_of_mass]).T, color="#e5c9c7", lw=1.2, zorder=2)
        label = f"{name} {quantity(float(np.linalg.norm(force)), 'N', 3)}"
        arrow(point - vector, vector, color, label, label_at_end=False)
    for number, load in enumerate(picture.loads, start=1):
        moment = load.moment
        if np.any(moment):
            aside = 0.12 * span * np.eye(3)[1 if abs(moment[0]) >= abs(moment[1]) else 0]
            where = (load.point if np.any(load.force) else support.center_of_mass) + aside
            label = f"load {number}: {quantity(float(np.linalg.norm(moment)), 'N m', 3)}"
            arrow(where, 0.3 * span * _direction(moment), MOMENT, label, label_at_end=True)

    everything = np.vstack(drawn)
    low, high = everything.min(axis=0) - 0.05 * span, everything.max(axis=0) + 0.05 * span
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    ax.set_box_aspect(high - low)
    for axis, share in zip((ax.xaxis, ax.yaxis, ax.zaxis), (high - low) / np.max(high - low), strict=True):
        axis.set_pane_color((0.97, 0.97, 0.97))
        axis.get_major_locator().set_params(nbins=max(2, round(5 * share)))
    handles: list[Any] = [
        Line2D([], [], color=CONTACT, lw=2, label="contact force on the base"),
        Line2D([], [], marker="o", color=WEIGHT, lw=2, label="centre of mass, weight"),
    ]
    if any(np.any(load.force) for load in picture.loads):
        handles.append(Line2D([], [], color=LOAD, lw=2, label="load"))
    if any(np.any(load.moment) for load in picture.loads):
        handles.append(Line2D([], [], color=MOMENT, lw=2, label="load moment (length not to scale)"))
    _finish(ax, "forces", picture.newton_per_metre, handles, picture)
    ax.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    ax.zaxis.labelpad = 10


def draw_plane(ax: Any, picture: ScenePicture, labels: Labels) -> None:
    support, span, scale = picture.scene.support, picture.span, picture.newton_per_metre
    largest = 1.2 * longest(picture.forces) or 0.5 * scale * span
    drawn = [picture.positions, support.center_of_mass[None]]

    def arrow(start: np.ndarray, force: np.ndarray, color: str, gid: str) -> None:
        ax.quiver(*start, *(force / scale), **_SHAFT, color=color, zorder=4, gid=gid)
        end = start + force / scale
        labels.avoid(ax, start, end)
        drawn.append(np.array([start, end]))

    for k, contact in enumerate(support.contacts):
        position = picture.positions[k]
        for piece in contact.force_pieces():
            region = position + _planar_region(piece, largest) @ contact.frame.T / scale
            _draw_region(ax, labels, region, f"cone-{k + 1}")
            drawn.append(region)
        ax.plot(*np.array([position, support.center_of_mass]).T, color="#c4c4c4", lw=1.2, zorder=0)
        ax.plot(*position, "o", color=CONTACT, ms=6, zorder=5)
        arrow(position, picture.forces[k], CONTACT, f"force-{k + 1}")
        outwards = -span * np.asarray(contact.normal)
        labels.add(ax, position, outwards, picture.contact_text(k), gid=f"contact-{k + 1}")
    ax.plot(*support.center_of_mass, "o", color=WEIGHT, ms=8, zorder=5)
    for name, color, force, point in _acting(picture):
        arrow(point - force / scale, force, color, name.rstrip(":"))
        label = f"{name} {quantity(float(np.linalg.norm(force)), 'N', 3)}"
        labels.add(ax, point - force / scale, -force, label, color)
    for number, load in enumerate(picture.loads, start=1):
        if load.moment:
            where = np.add(load.point if np.any(load.force) else support.center_of_mass, (0.14 * span, 0.0))
            symbol = r"$\circlearrowleft$" if load.moment > 0 else r"$\circlearrowright$"
            ax.plot(*where, marker=symbol, ms=24, color=MOMENT, zorder=5)
            labels.avoid(ax, where - 0.06 * span, where + 0.06 * span)
            label = f"load {number}: {quantity(float(load.moment), 'N m', 3)}"
            labels.add(ax, np.add(where, (0.06 * span, 0.0)), (span, 0.0), label, MOMENT)
    handles: list[Any] = [
        Line2D([], [], color=CONTACT, lw=2, label="contact force on the base"),
        Patch(facecolor=LIMIT, edgecolor=FRICTION, alpha=0.5, label="forces the contact can bear"),
        Line2D([], [], marker="o", color=WEIGHT, lw=2, label="centre of mass, weight"),
        Line2D([], [], color=LOAD, lw=2, label="load"),
    ]
    if 0 <= picture.nearest < len(picture.axes):
        ax.plot(*picture.axes[picture.nearest].point, **_RING, ms=17, zorder=6, gid="nearest")
    everything = np.vstack(drawn)
    low, high = everything.min(axis=0) - 0.2 * span, everything.max(axis=0) + 0.2 * span
    ax.update_datalim([low, high])
    _finish(ax, "forces", scale, handles, picture)
    ax.set(xlabel="x [m]", ylabel="y [m]")


def draw_friction_bars(ax: Any, picture: ScenePicture) -> None:
    used = 100 * np.nan_to_num(picture.usage, nan=0.0, posinf=0.0)
    numbers = np.arange(1, len(used) + 1)
    bars = ax.bar(numbers, used, width=0.5, color=FRICTION)
    ax.bar_label(bars, [percent(share) for share in picture.usage], padding=2)
    ax.axhline(100.0, **style.LIMIT)
    ax.set_xticks(numbers)
    ax.set(xlim=(0.4, len(used) + 0.6), ylim=(0, max(115.0, 1.12 * float(used.max()))))
    ax.set(xlabel="contact [number]", ylabel=style.FRICTION.label)
    ax.set_title("friction used (slips at 100 %)", fontsize=12)


def _draw_region(ax: Any, labels: Labels, corners: np.ndarray, gid: str) -> None:
    """A set of admissible forces, kept free of labels along its rim."""
    style = {"facecolor": LIMIT + "70", "edgecolor": FRICTION, "lw": 0.9, "zorder": 2}
    ax.add_patch(Polygon(corners, **style, gid=gid))
    for a, b in zip(corners, np.roll(corners, 1, axis=0), strict=True):
        labels.avoid(ax, a, b)


def _finish(ax: Any, title: str, newton_per_metre: float, handles: list[Any], picture: ScenePicture) -> None:
    """Title with the scale, equal axes, grid and a legend below the panel."""
    ax.set_title(f"{title} (arrows: 0.1 m = {quantity(0.1 * newton_per_metre, 'N', 3)})", fontsize=12)
    if ax.name != "3d":
        ax.set_aspect("equal", adjustable="datalim")
        ax.margins(0.0)
        ax.autoscale_view()
        ax.grid(True, color="#eeeeee")
        ax.set_axisbelow(True)
    if 0 <= picture.nearest < len(picture.axes):
        style = {**_RING, "ms": 11} if picture.scene.planar else {"color": NEAREST, "lw": 2.8}
        handles.append(Line2D([], [], label=picture.nearest_text(), **style))
    if len(picture.axes) > 1 and not picture.scene.planar:
        handles.append(Line2D([], [], color=AXIS, lw=1.4, ls=(0, (4, 2.5)), label="potential tipping axes"))
    place = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.09 if ax.name != "3d" else -0.03)}
    ax.legend(handles=handles, **place, ncols=2, fontsize=9.5, frameon=False)


def _axis_style(nearest: bool) -> dict[str, Any]:
    if nearest:
        return {"color": NEAREST, "lw": 2.8, "ls": "-", "zorder": 3}
    return {"color": AXIS, "lw": 1.3, "ls": (0, (5, 4)), "zorder": 1.5}


def _acting(picture: ScenePicture) -> list[tuple[str, str, np.ndarray, np.ndarray]]:
    """Weight and load forces: name, colour, force (N) and the point where it acts (m)."""
    acting = [("weight", WEIGHT, picture.weight, picture.scene.support.center_of_mass)]
    for number, load in enumerate(picture.loads, start=1):
        if np.any(load.force):
            acting.append((f"load {number}:", LOAD, load.force, load.point))
    return [entry for entry in acting if np.any(entry[2])]


def _ground_points(picture: ScenePicture) -> list[tuple[str, str, np.ndarray]]:
    """Where the lines of action of weight, and of weight with loads, meet the contacts' mean plane."""
    support, center = picture.scene.support, picture.positions.mean(axis=0)
    if len(picture.positions) < 3:
        return []
    _, stretches, axes = np.linalg.svd(picture.positions - center)
    normal = axes[-1]
    facing = abs(float(np.mean([np.asarray(c.normal) for c in support.contacts], axis=0) @ normal))
    if facing < 0.7 or stretches[2] > 0.2 * stretches[0]:
        return []  # contacts that face each other, or in different heights: there is no such ground
    points = []
    for marker, label, wrench in (
        ("x", "weight meets the ground", support.weight),
        ("P", "weight and loads meet the ground", picture.scene.wrench),
    ):
        force, moment = wrench[:3], wrench[3:]
        down = float(normal @ force)
        if abs(down) <= 1e-6 * float(np.linalg.norm(force)):
            continue
        about_center = moment + np.cross(support.center_of_mass - center, force)
        point = center + np.cross(normal, about_center) / down
        if np.linalg.norm(point - center) < 1.5 * picture.span:
            points.append((marker, label, point))
    return points if picture.scene.loads else points[:1]


def _planar_region(piece: Any, largest: float) -> np.ndarray:
    """Corners (n, t) of a force piece, cut off at the normal force `largest`, N."""
    low, high = max(piece.normal_min, -largest), min(piece.normal_max, largest)
    wide = [max(0.0, piece.radius + piece.slope * k) for k in (low, high)]
    return np.array([[low, -wide[0]], [high, -wide[1]], [high, wide[1]], [low, wide[0]]])


def fit_space(ax: Any) -> None:
    """Zoom a three-dimensional panel so that its box with tick labels fills the room it has."""
    limits = np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])
    corners = on_screen(ax, np.array([[x, y, z] for x in limits[0] for y in limits[1] for z in limits[2]]))
    frame = ax.get_window_extent()
    size = np.array([frame.width, frame.height]) * (0.84, 0.92)
    zoom = float(np.min(size / np.ptp(corners, axis=0)))
    ax.set_box_aspect(np.ptp(limits, axis=1), zoom=zoom)


def _best_view(positions: np.ndarray) -> tuple[int, int]:
    """The two base axes that show the contacts best; x and y unless another view is clearly wider."""
    views = [(0, 1), (0, 2), (1, 2)]
    areas = [_area(positions[:, view]) for view in views]
    best = int(np.argmax(areas))
    return views[best] if areas[best] > 3.0 * areas[0] else views[0]


def _area(points: np.ndarray) -> float:
    """Area of the convex hull, m^2."""
    x, y = points[hull(points)].T if len(points) > 2 else np.zeros((2, 1))
    return float(abs(x @ np.roll(y, 1) - y @ np.roll(x, 1))) / 2


def _disc_size(flat: np.ndarray, span: float) -> float:
    """Radius of the largest friction disc, m: large enough to read, small enough not to overlap."""
    distances = np.linalg.norm(flat[:, None] - flat[None], axis=2)
    apart = distances[distances > 1e-9 * span]
    return float(np.clip(0.45 * apart.min(), 0.06 * span, 0.2 * span)) if apart.size else 0.2 * span


def _circle(tangents: np.ndarray, radius: float) -> np.ndarray:
    angles = np.linspace(0.0, 2.0 * np.pi, 49)[:-1]
    return radius * np.column_stack([np.cos(angles), np.sin(angles)]) @ tangents.T


def _direction(vector: np.ndarray, default: Sequence[float] | None = None) -> np.ndarray:
    size = float(np.linalg.norm(vector))
    if size > 1e-12:
        return vector / size
    return np.zeros_like(vector) if default is None else np.array(default)


FORMATS = ("png", "pdf", "svg")


def plot_scene(
    scene: Scene,
    states: ContactStates,
    tip: TipOverReserve,
    slip: SlipReserve,
    path: str | os.PathLike[str],
    *,
    index: int = 0,
    below: str = "",
) -> None:
    """Draw one state of a scene into a file; an existing file is replaced only by a complete one.

    Args:
        scene: the scene.
        states: solved states of its support.
        tip, slip: the margins of these states.
        path: file name ending in .png, .pdf or .svg.
        index: which of the states.
        below: what the title has in a second line.

    Raises:
        InputError: unknown file format.
        OSError: the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower().lstrip(".") not in FORMATS:
        raise InputError(f"path: expected a file name ending in .png, .pdf or .svg, got {str(path)!r}")
    save_figure(draw_scene(scene, states, tip, slip, index=index, below=below), path, 150)


def draw_scene(
    scene: Scene,
    states: ContactStates,
    tip: TipOverReserve,
    slip: SlipReserve,
    *,
    index: int = 0,
    below: str = "",
) -> Figure:
    """A Matplotlib figure of a scene, see `plot_scene`."""
    picture, labels = ScenePicture(scene, states, tip, slip, index), Labels()
    figure = new_figure(13.0, 7.0)
    color = BROKEN if below or not states.persistent[index] else "black"
    head(figure, picture.title, below, color=color)
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
