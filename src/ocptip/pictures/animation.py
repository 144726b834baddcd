"""Animations of mechanisms in motion as GIF, MP4 or a page: one or two plans, or indices along a motion.

Bodies are lines in an oblique view, which shows arms and closed chains alike.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ocptip.pictures import style
from ocptip.pictures.browser.view import sampled_parts, shared_forces
from ocptip.pictures.frame import drawn, new_figure
from ocptip.pictures.movie import frame_times, require_format, speed_of, speed_text, write_movie
from ocptip.pictures.sketch import GROUND, PATH, ROBOT, draw_base, force_arrows, view_of
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.parts import Part
from ocptip.standing.samples import MotionSamples

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DPI, _WIDTH, _VIEW, _PANEL = 80, 5.0, 4.2, 1.3  # pixels per inch; inches
_CURVES = 3  # at most
_CURVE = 5  # instants of curves per frame


@dataclass(frozen=True, eq=False)
class CarriedBy:
    """The contacts that carry a mechanism, at T instants.

    Attributes:
        contacts: (n, 3), m.
        forces: (T, n, 3), N, base axes.
        weight: N.
        axes: (T, 2) contacts of the nearest tipping axis, from 0; -1: none.
        stable: (T,) no contact is lost.
    """

    contacts: np.ndarray
    forces: np.ndarray
    weight: float
    axes: np.ndarray
    stable: np.ndarray

    def pressure(self, k: int) -> np.ndarray:
        """(3,), m: the zero-moment point at instant k; NaN without load."""
        normal = np.maximum(self.forces[k, :, 2], 0.0)
        return normal @ self.contacts / normal.sum() if normal.sum() > 0 else np.full(3, np.nan)


@dataclass(frozen=True, eq=False)
class Moving:
    """A mechanism at T instants.

    Attributes:
        name: for the title.
        times: (T,), s, or numbers of rows.
        bodies: T lists of lines (k, 3), m.
        curves: (T,) values by label; the first ones are drawn.
        path: (T, 3), m, of the TCP, or (0, 3).
        ground: what carries it; None: not considered.
    """

    name: str
    times: np.ndarray
    bodies: Sequence[Sequence[np.ndarray]]
    curves: Mapping[str, np.ndarray] = field(default_factory=dict)
    path: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    ground: CarriedBy | None = None

    @classmethod
    def of_plan(cls, name: str, parts: Sequence[Part], times: np.ndarray) -> Moving:
        """The motions of a plan at these times (T,), s; at rest before and after."""
        return cls.of_samples(name, parts[0].robot, times, sampled_parts(parts, times)[1])

    @classmethod
    def of_samples(
        cls, name: str, robot: StandingMechanism, times: np.ndarray, seen: MotionSamples
    ) -> Moving:
        """A mechanism on its contacts as sampled at times (T,), s."""
        support, tip = robot.support, seen.tip
        pairs = np.array([(-1, -1), *((min(a.contacts), max(a.contacts)) for a in tip.tip_over.axes)])
        local = [shared_forces(seen.states.contact_forces, seen.slip, k) for k in range(len(times))]
        ground = CarriedBy(
            np.array([c.position for c in support.contacts]),
            np.einsum("kij,tkj->tki", support.frames, np.nan_to_num(np.array(local))),
            robot.mass * float(np.linalg.norm(support.gravity)),
            pairs[tip.nearest_axis + 1],
            (tip.GN < 1) & (seen.slip.GT < 1),
        )
        curves = {}
        if tip.moments.shape[1]:
            curves[style.TIPPING.label] = np.maximum(np.min(tip.moments, axis=1), 0.0)
        curves[style.FRICTION.label] = 100 * seen.slip.GT
        path = seen.gripper[:, :3] if seen.gripper.size else np.empty((0, 3))
        return cls(name, times, [robot.sticks(q) for q in seen.angles], curves, path, ground)

    def text(self, k: int) -> str:
        """Time and values at instant k."""
        values = [
            f"{label.partition(' [')[0]} {curve[k]:.3g} {label.partition(' [')[2].rstrip(']')}".rstrip()
            for label, curve in list(self.curves.items())[:2]
        ]
        return ", ".join([f"{self.times[k]:.2f} s", *values])


def plan_times(*plans: Sequence[Part]) -> np.ndarray:
    """Times (T,), s, for plans that begin together: of the frames, and for curves between them."""
    return frame_times(max(parts[-1].end for parts in plans), finer=_CURVE)


def save_animation(shown: Sequence[Moving], path: str | os.PathLike[str]) -> Path:
    """Write an animation of mechanisms side by side, all with as many instants; returns its path.

    Of instants that are closer than frames the nearest to each frame are shown.

    Raises:
        InputError: another ending than .gif, .mp4 or .html, or ffmpeg is missing for .mp4.
        OSError: the file cannot be written.
    """
    path = Path(path)
    require_format(path)
    times = shown[0].times
    span = float(times[-1] - times[0])
    instants = times[0] + frame_times(span)
    rows = np.abs(times - instants[:, None]).argmin(axis=1)
    figure = new_figure(_WIDTH * len(shown), _VIEW + _PANEL * max(len(_drawn(one)) for one in shown))
    columns = [_MovingView(figure, number, len(shown), moving) for number, moving in enumerate(shown)]
    for label in set.intersection(*(set(one.panels) for one in columns)):  # one scale side by side
        ends = [one.panels[label].get_ylim() for one in columns]
        for one in columns:
            one.panels[label].set_ylim(min(low for low, _ in ends), max(high for _, high in ends))
    colors = "green: contact forces; red: nearest tipping axis; magenta: zero-moment point; "
    played = speed_text(speed_of(span)) if span > 0 else "stands still"
    style.note(figure, f"{colors if any(moving.ground is not None for moving in shown) else ''}{played}")
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # panels stay where they are

    def frame(k: int) -> Any:
        for column, curve in zip(columns, shown, strict=True):
            column.show(k, f"{curve.name}\n{curve.text(k)}")
        return drawn(figure, _DPI)

    write_movie(path, [frame(int(k)) for k in rows], " and ".join(moving.name for moving in shown))
    return path


def still_figure(shown: Moving, k: int) -> Figure:
    """A mechanism on its support polygon at instant k, with the forces of its contacts."""
    figure = new_figure(0.8 * _VIEW, _VIEW)
    _MovingView(figure, 0, 1, replace(shown, name="", curves={})).show(k, "")
    return figure


def _drawn(moving: Moving) -> list[tuple[str, np.ndarray]]:
    return list(moving.curves.items())[:_CURVES]


class _MovingView:
    """The view of one mechanism above its curves.

    Args:
        figure: of all.
        number, count: which of how many columns.
        own: what is shown.
    """

    def __init__(self, figure: Any, number: int, count: int, moving: Moving) -> None:
        self._own, ground, curves = moving, moving.ground, _drawn(moving)
        grid = figure.add_gridspec(1 + len(curves), count, height_ratios=[_VIEW, *[_PANEL] * len(curves)])
        ax = self._ax = figure.add_subplot(grid[0, number])
        lines = [line for frame in moving.bodies for line in frame]
        contacts = np.empty((0, 3)) if ground is None else ground.contacts
        points = np.vstack([contacts, moving.path, *lines])
        self._axes = view_of(points)
        flat = points @ self._axes.T
        low, high = flat.min(axis=0), flat.max(axis=0)
        size = float(np.max(high - low)) or 1.0
        if len(moving.path):
            ax.plot(*(moving.path @ self._axes.T).T, color=PATH, lw=1.0, ls=":")
        if ground is not None:
            self._stand(ax, moving, ground, size)
        style_of = {
            "color": ROBOT,
            "lw": 3.2,
            "marker": "o",
            "ms": 5,
            "mfc": "white",
            "solid_capstyle": "round",
        }
        self._bodies = [ax.plot([], [], zorder=4, **style_of)[0] for _ in moving.bodies[0]]
        ax.set_xlim(low[0] - 0.12 * size, high[0] + 0.12 * size)
        ax.set_ylim(low[1] - 0.12 * size, high[1] + 0.12 * size)
        ax.set_aspect("equal")
        ax.set_axis_off()
        self._title = ax.set_title(" \n ", fontsize=10)
        self._cursors, self.panels = [], dict[str, Any]()
        for row, (label, values) in enumerate(curves, 1):
            panel = figure.add_subplot(grid[row, number])
            panel.plot(moving.times, values, color=_color(label), lw=1.6)
            if np.isfinite(values).any():
                worst = np.nanargmax(values) if label == style.FRICTION.label else np.nanargmin(values)
                panel.plot(moving.times[worst], values[worst], **{**style.RING, "color": _color(label)})
            panel.set_title(label, fontsize=9, loc="left")
            panel.grid(axis="y", color=style.GRID, lw=0.8)
            panel.tick_params(labelsize=8, labelbottom=row == len(curves))
            self._cursors.append(panel.axvline(moving.times[0], color="black", lw=1.0))
            if row == len(curves):
                panel.set_xlabel("time [s]", fontsize=9)
            self.panels[label] = panel

    def _stand(self, ax: Any, moving: Moving, ground: CarriedBy, size: float) -> None:
        """Support polygon, base, contact forces, tipping axis, zero-moment point."""
        flat = ground.contacts @ self._axes.T
        self._polygon = draw_base(ax, self._axes, ground.contacts, moving.bodies[0])
        self._forces, self._scale = force_arrows(ax, flat, size, ground.weight)
        self._axis = ax.plot([], [], color="#c81e1e", lw=3.0, zorder=2)[0]
        self._pressure = ax.plot([], [], ls="", marker="o", ms=7, color="#dc00a0", zorder=5)[0]

    def show(self, k: int, title: str) -> None:
        """Show instant k."""
        moving, ground = self._own, self._own.ground
        for artist, line in zip(self._bodies, moving.bodies[k], strict=True):
            artist.set_data(*(line @ self._axes.T).T)
        for cursor in self._cursors:
            cursor.set_xdata([moving.times[k]] * 2)
        self._title.set_text(title)
        if ground is None:
            return
        self._forces.set_UVC(*(self._scale * ground.forces[k] @ self._axes.T).T)
        pair = ground.axes[k]
        ends = ground.contacts[pair] if pair[0] >= 0 else np.empty((0, 3))
        self._axis.set_data(*(ends @ self._axes.T).T)
        self._pressure.set_data(*(ground.pressure(k)[None] @ self._axes.T).T)
        self._title.set_color("#1a7f37" if ground.stable[k] else style.BROKEN)
        self._polygon.set_facecolor(GROUND if ground.stable[k] else "#f1c4c0")


def _color(label: str) -> str:
    return next((one.color for one in style.QUANTITIES if one.label == label), style.MEMBERS[0])
