"""Small sketches of a posture: the base on its feet, the arm or the legs, seen obliquely from above."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ocptip.pictures.frame import hull
from ocptip.pictures.style import FOOT_FORCE, NOTE, TIPPING, member
from ocptip.standing.mechanism import StandingMechanism

ROBOT, BASE, GROUND, PATH = "#3a3a3a", "#8a8a8a", "#e8e3da", "#9a9a9a"
SKETCH = "sketch"
"""Begins the gid of these panels, which have a scale instead of axes."""

_RISE = np.radians(22.0)
_TURNS = np.radians([-60.0, -30.0, 30.0, 60.0, 120.0, 150.0])
_TALL = 0.35  # height of an arrow for the whole weight, over the size of the picture
_LENGTHS = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)  # m, of the scale


def view_of(points: np.ndarray) -> np.ndarray:
    """Axes (2, 3) to the right and up, of the oblique view in which points (k, 3) are spread most."""
    views = []
    for turn in _TURNS:
        right = np.array([np.cos(turn), np.sin(turn), 0.0])
        back = np.array([-np.sin(turn), np.cos(turn), 0.0])
        views.append(np.array([right, np.sin(_RISE) * back + [0.0, 0.0, np.cos(_RISE)]]))
    return max(views, key=lambda axes: float(np.prod(np.ptp(points @ axes.T, axis=0))))


def draw_postures(
    panels: Sequence[Any],
    robot: StandingMechanism,
    postures: Sequence[tuple[str, np.ndarray]],
    *,
    path: np.ndarray | None = None,
    joints: bool = False,
    feet: bool = False,
    axis: tuple[int, ...] = (),
    forces: Sequence[np.ndarray] = (),
) -> None:
    """Draw postures, all in one view and scale.

    Args:
        panels: axes, one for each.
        robot: that stands.
        postures: title and coordinates (n,) of each.
        path: (k, 3), m, of the TCP.
        joints: number the joints of an arm.
        feet: number the contacts.
        axis: the contacts, from 1, of the tipping axis to mark.
        forces: (n, 3), N, of the contacts in each posture; empty: not drawn.
    """
    contacts = np.array([c.position for c in robot.support.contacts])
    bodies = [robot.sticks(q) for _, q in postures]
    path = np.empty((0, 3)) if path is None else path
    every = np.vstack([contacts, path, *(line for lines in bodies for line in lines)])
    axes = view_of(path if len(path) else every)
    low, high = (every @ axes.T).min(axis=0), (every @ axes.T).max(axis=0)
    margin = 0.08 * float(np.max(high - low)) + 1e-3
    total = max((float(np.linalg.norm(force.sum(axis=0))) for force in forces), default=0.0)
    for k, (ax, (title, _), lines) in enumerate(zip(panels, postures, bodies, strict=True)):
        flat = contacts @ axes.T
        draw_base(ax, axes, contacts, lines)
        if forces:
            arrows, scale = force_arrows(ax, flat, float(np.max(high - low)), total)
            arrows.set_UVC(*(scale * forces[k] @ axes.T).T)
        for foot, place in enumerate(flat):
            ax.plot(*place, marker="s", ms=5, color=member(foot)["color"], zorder=3, gid=f"foot-{foot + 1}")
        if len(axis) == 2:
            ends = contacts[[k - 1 for k in axis]] @ axes.T
            ax.plot(*ends.T, color=TIPPING.color, lw=2.4, zorder=2, gid="tipping-axis")
        if len(path):
            ax.plot(*(path @ axes.T).T, color=PATH, lw=1.0, ls=":", zorder=1, gid="path")
        for number, line in enumerate(lines):
            style = {"color": ROBOT, "lw": 2.6, "solid_capstyle": "round", "zorder": 4}
            ax.plot(
                *(line @ axes.T).T, marker="o", ms=4, mfc="white", mew=1.2, gid=f"body-{number + 1}", **style
            )
        if joints and len(lines) == len(robot.interfaces):  # an arm and its objects
            _number_joints(ax, lines[0] @ axes.T)
        if feet:
            middle = float(flat[:, 0].mean())
            for foot, place in enumerate(flat, 1):
                _write(ax, f"{foot}", place, np.array([np.copysign(10.0, place[0] - middle), -7.0]))
        ax.set_xlim(low[0] - margin, high[0] + margin)
        ax.set_ylim(low[1] - 3 * margin, high[1] + margin)
        ax.set_aspect("equal")
        ax.set_axis_off()
        ax.set_gid(SKETCH)
        ax.set_title(title, fontsize=9.5, y=1.0)
    _scale(panels[0], low, high, margin)


def draw_base(ax: Any, axes: np.ndarray, contacts: np.ndarray, bodies: Sequence[np.ndarray]) -> Any:
    """Draw the base as lines from its contacts (n, 3) to where bodies begin; returns the support polygon."""
    above = np.mean(_roots(bodies), axis=0)
    for foot in contacts:
        ax.plot(*(np.array([foot, above]) @ axes.T).T, color=BASE, lw=1.6, zorder=1)
    return ax.fill(*(contacts[hull(contacts[:, :2])] @ axes.T).T, fc=GROUND, ec="none", zorder=0)[0]


def force_arrows(ax: Any, feet: np.ndarray, size: float, total: float) -> tuple[Any, float]:
    """Arrows at feet (n, 2) that are set to forces by `set_UVC`, times a scale in m per N.

    Args:
        ax, feet: where.
        size: of the picture, m.
        total: N, the force of which the arrow has a good size.
    """
    style = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.014, "zorder": 3.5}
    zero = np.zeros(len(feet))
    arrows = ax.quiver(*feet.T, zero, zero, color=FOOT_FORCE.color, gid="forces", **style)
    return arrows, _TALL * size / max(total, 1e-9)


def _roots(lines: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Where bodies begin at the base: points from which open lines go, and to which none leads."""
    lines = [line for line in lines if not np.allclose(line[0], line[-1], atol=1e-9)]
    ends = [line[-1] for line in lines]
    return [line[0] for line in lines if not any(np.allclose(line[0], end, atol=1e-9) for end in ends)]


def _number_joints(ax: Any, line: np.ndarray) -> None:
    """Numbers at the joints of an arm; a joint close to an earlier one shares its text: wrists fold."""
    groups: list[list[int]] = []
    near = 0.2 * float(np.max(np.ptp(line, axis=0)))
    for joint, point in enumerate(line[1:-1], 1):
        beside = (group for group in groups if np.linalg.norm(line[group[0]] - point) < near)
        group = next(beside, None)
        if group is None:
            groups.append([joint])
        else:
            group.append(joint)
    for group in groups:
        text = ", ".join(map(str, group))
        rightmost = line[max(group, key=lambda joint: line[joint, 0])]
        _write(ax, text, rightmost, np.array([6.0 + 2.5 * len(text), 5.0]))
    _write(ax, "TCP", line[-1], np.array([0.0, -10.0]))


def _write(ax: Any, text: str, place: np.ndarray, points: np.ndarray) -> None:
    style = {"fontsize": 8, "color": NOTE, "ha": "center", "va": "center", "zorder": 6}
    ax.annotate(text, place, tuple(points), textcoords="offset points", annotation_clip=False, **style)


def _scale(ax: Any, low: np.ndarray, high: np.ndarray, margin: float) -> None:
    """A bar of a round length below the first sketch."""
    wide = float(high[0] - low[0])
    length = max(
        (length_of_scale for length_of_scale in _LENGTHS if length_of_scale <= 0.5 * wide),
        default=_LENGTHS[0],
    )
    y = low[1] - 2.4 * margin
    ax.plot([low[0], low[0] + length], [y, y], color=NOTE, lw=1.4, gid="scale")
    _write(ax, f"{length:g} m", np.array([low[0] + length, y]), np.array([16.0, 0.0]))
