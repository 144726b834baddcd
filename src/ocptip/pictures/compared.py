"""Figure of a recording beside the plan that was run."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ocptip.measured.comparison import ComparedSignal, Comparison
from ocptip.measured.prediction import Predictor
from ocptip.measured.recording import ANGLE, POWER, TORQUE, WRENCH
from ocptip.pictures import style
from ocptip.pictures.frame import DPI, new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def save_comparison(
    path: str | os.PathLike[str], comparison: Comparison, predictor: Predictor, name: str
) -> Path:
    """Draw a comparison into a .png, .pdf or .svg file.

    Raises:
        OSError: it cannot be written; names it.
    """
    return save_figure(comparison_figure(comparison, predictor, name), path, DPI)


def comparison_figure(comparison: Comparison, predictor: Predictor, name: str) -> Figure:
    """A Matplotlib figure: errors of joints, loads measured (dots) and predicted, residuals."""
    kinds = {
        kind: [one for one in comparison.signals if one.kind == kind]
        for kind in (ANGLE, TORQUE, WRENCH, POWER)
    }
    kinds[POWER] = [one for one in kinds[POWER] if one.index == 0]
    forces = [one for one in kinds[WRENCH] if one.index < 3]
    moments = [one for one in kinds[WRENCH] if one.index >= 3]
    figure = new_figure(11.5, 12)
    axes = figure.subplots(5, 2, sharex=True, width_ratios=(3, 2))
    groups = (
        ("Torque of each drive", "torque", "N m", kinds[TORQUE]),
        ("Force on the sensor", "force", "N", forces),
        ("Moment on the sensor", "moment", "N m", moments),
        ("Electric power", "power", "W", kinds[POWER]),
    )
    _errors(axes[0, 0], kinds[ANGLE], comparison.times, predictor.robot.units)
    _deviation(axes[0, 1], comparison)
    for (left, right), group in zip(axes[1:], groups, strict=True):
        _pair(left, right, *group, comparison.times)
    for ax in axes.flat:
        ax.axvspan(0, predictor.motion.end, color=style.SHADE, zorder=-1, lw=0)
    for ax in axes[-1]:
        ax.set_xlabel("time of the motion [s]")
    count = len(comparison.findings)
    verdict = "agrees with the plan" if not count else f"{count} finding{'s' if count > 1 else ''}"
    style.head(figure, f"{name}, recorded: {verdict}")
    style.note(figure, "dots: measured; lines: predicted; shaded: the motion as planned")
    return figure


def _errors(ax: Any, signals: list[ComparedSignal], times: np.ndarray, units: Sequence[str]) -> None:
    for k, one in enumerate(signals):
        scale = 180 / np.pi if units[one.index] == "rad" else 1e3
        away = scale * (one.measured - one.predicted)
        ax.plot(times, away, **style.member(k), lw=0.9, label=one.name, gid=f"error-{one.name}")
    words = [word for unit, word in (("rad", "deg"), ("m", "mm")) if unit in units]
    _finish(ax, bool(signals), "Error of each joint, measured - predicted", f"error [{', '.join(words)}]")


def _deviation(ax: Any, comparison: Comparison) -> None:
    if comparison.gripper is not None:
        line_style = {"color": style.TCP_SPEED.color, "lw": 0.9, "gid": "gripper"}
        ax.plot(comparison.times, 1e3 * comparison.gripper, **line_style)
    _finish(ax, comparison.gripper is not None, "Distance of the TCP from the plan", "deviation [mm]")


def _pair(
    left: Any, right: Any, title: str, what: str, unit: str, signals: list[ComparedSignal], times: np.ndarray
) -> None:
    for k, one in enumerate(signals):
        line_style = style.member(k)
        left.plot(
            times, one.measured, ".", color=line_style["color"], ms=1.5, alpha=0.5, gid=f"measured-{one.name}"
        )
        left.plot(times, one.predicted, **line_style, lw=1.0, label=one.name, gid=f"predicted-{one.name}")
        right.plot(times, one.measured - one.predicted, **line_style, lw=0.8, gid=f"rest-{one.name}")
    _finish(left, bool(signals), title, f"{what} [{unit}]")
    _finish(right, bool(signals), "measured - predicted", f"difference [{unit}]")


def _finish(ax: Any, recorded: bool, title: str, label: str) -> None:
    if not recorded:
        ax.text(0.5, 0.5, "not recorded", transform=ax.transAxes, ha="center", color=style.NOTE)
    style.finish(ax, title, label)
