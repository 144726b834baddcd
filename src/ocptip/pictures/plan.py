"""Figures of a plan: angles, speeds, torques, power and energy, reserves, normal forces, friction used,
least distance.

An overview of eight panels and a figure for each quantity, all over the same time axis. Faint vertical lines
are the events of the ramps, where accelerations jump. Joints and contacts are numbered from 1; a joint or
contact has the same colour in all figures. A reference motion of the task, if there is one, is dashed.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ocptip.pictures.clearance import draw_clearance
from ocptip.pictures.feet import feet_figure
from ocptip.pictures.frame import (
    COLORS,
    LEGEND_GAP,
    LEGEND_HANDLE,
    LEGEND_SIZE,
    Drawing,
    legend_columns,
    mark_segments,
    new_figure,
    place_panels,
)
from ocptip.pictures.gears import gears_figure
from ocptip.pictures.plan_curves import PlanCurves
from ocptip.standing.limits import WITHIN_OF
from ocptip.standing.mechanism import MotionSamples

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ocptip.motion.plan import MotionPlan

STYLES = ("-", (0, (5, 1.2)), (0, (1.2, 1.2)))  # beyond seven joints or contacts
GN, GT, ENERGY, POWER = "#0072b2", "#d55e00", "#000000", "#009e73"
LIMIT, EVENT = "#8b0000", "#e3e3e3"

_DASHED = (0, (4, 2))
_LIMIT_STYLE = {"color": LIMIT, "lw": 1.3, "ls": (0, (6, 2))}
_WORST = {"marker": "o", "ms": 8, "mfc": "none", "mew": 1.8, "ls": "", "zorder": 6, "clip_on": False}


def draw_plan(
    directory: str | os.PathLike[str], plan: Any, samples: MotionSamples | None = None
) -> list[Path]:
    """Draw all figures of a plan into a directory as PNG; files of the same name are replaced.

    Args:
        directory: made if it does not exist; the one above it must.
        plan: a `MotionPlan`, or any object with its attributes.
        samples: of its motion, from :func:`ocptip.motion.output.sample_motion`; computed if None.

    Returns:
        The paths, `plan.png` (the overview) first.

    Raises:
        OSError: a file or the directory cannot be written; names it.
    """
    return begin_plan(plan, samples).save(directory)


def begin_plan(plan: Any, samples: MotionSamples | None = None) -> Drawing:
    """The same figures, which are being drawn while the caller goes on."""
    return Drawing(_figures(plan, samples))


def plan_figures(plan: MotionPlan, samples: MotionSamples | None = None) -> dict[str, Figure]:
    """The same as matplotlib figures, by the names of the files without ending."""
    return {name: draw() for name, draw in _figures(plan, samples).items()}


def _figures(plan: MotionPlan, samples: MotionSamples | None) -> dict[str, Callable[[], Figure]]:
    curves = PlanCurves.of(plan, samples)
    figures = {name: partial(_drawn, draw, curves) for name, draw in _FIGURES.items()}
    if feet := plan.check.feet:
        figures["feet"] = partial(feet_figure, curves.title, feet, curves.times, curves.normal_forces)
    if drives := plan.check.drives:
        robot = curves.plan.task.robot
        figures["gears"] = partial(
            gears_figure, curves.title, robot, drives, curves.times, curves.normal_forces
        )
    return figures


def _overview(curves: PlanCurves) -> Figure:
    figure, axes = _figure(curves, (14.0, 15.0), 4, 2)
    (angles, speeds), (torques, power), (reserves, forces), (friction, clearance) = axes
    _angles(angles, curves)
    limits = curves.joint_limits
    _shares(
        speeds,
        curves,
        _all("Speed / limit of joints", curves.samples.speeds),
        curves.samples.speeds,
        limits.speed,
        np.ones(len(curves.times)),
    )
    _shares(
        torques,
        curves,
        _all("Torque / limit of joints", curves.samples.torques),
        curves.samples.torques,
        limits.torque,
        curves.limit("torque_ratio"),
    )
    _total_power(power, curves)
    _reserves(reserves, curves, ("GN", "GT"))
    _normal_forces(forces, curves)
    _friction(friction, curves)
    _clearance(clearance, curves)
    return figure


def _angle_figure(curves: PlanCurves) -> Figure:
    figure, axes = _figure(curves, (9.5, 5.5), 1, 1)
    _angles(axes[0, 0], curves, curves.joint_names)
    return figure


def _speed_figure(curves: PlanCurves) -> Figure:
    units, scales = [f"{unit}/s" for unit in curves.units], curves.scales
    limits = np.tile(scales * curves.joint_limits.speed, (len(curves.times), 1))
    return _joint_panels(curves, "speed", units, scales * curves.samples.speeds, limits)


def _torque_figure(curves: PlanCurves) -> Figure:
    units = list(curves.plan.task.robot.motor_units)
    limits = curves.limit("torque_ratio")[:, None] * curves.joint_limits.torque
    return _joint_panels(curves, "torque", units, curves.samples.torques, limits)


def _power_figure(curves: PlanCurves) -> Figure:
    figure, axes = _figure(curves, (9.5, 8.5), 2, 1)
    power, energy = axes[:, 0]
    for j, values in enumerate(curves.samples.powers.T):
        power.plot(curves.times, values, **_style(j), lw=1.2, label=f"joint {j + 1}", gid=f"power-{j + 1}")
    total = curves.samples.total_power
    power.plot(curves.times, total, color="#5f5f5f", lw=2.4, zorder=1.5, label="total", gid="power")
    _finish(power, curves, "Electric power", "power [W]")
    power.set_ylim(bottom=min(0.0, power.get_ylim()[0]) if power.dataLim.ymin < 0 else 0.0)
    _energy(energy, curves)
    _finish(energy, curves, "Electric energy since the start", "energy [J]")
    return figure


def _reserve_figure(curves: PlanCurves) -> Figure:
    figure, axes = _figure(curves, (9.5, 8.5), 2, 1)
    for ax, name in zip(axes[:, 0], ("GN", "GT"), strict=True):
        _reserves(ax, curves, (name,))
    return figure


def _normal_figure(curves: PlanCurves) -> Figure:
    figure, axes = _figure(curves, (9.5, 5.5), 1, 1)
    _normal_forces(axes[0, 0], curves)
    return figure


def _friction_figure(curves: PlanCurves) -> Figure:
    figure, axes = _figure(curves, (9.5, 5.5), 1, 1)
    _friction(axes[0, 0], curves)
    return figure


def _clearance_figure(curves: PlanCurves) -> Figure:
    figure, axes = _figure(curves, (9.5, 5.5), 1, 1)
    _clearance(axes[0, 0], curves)
    return figure


def _friction(ax: Any, curves: PlanCurves) -> None:
    for k, usage in enumerate(curves.samples.slip.usage.T):
        # Contacts often share the largest use; thinner lines on top let the ones below be seen.
        width = max(3.9 - 1.2 * k, 1.2)
        ax.plot(
            curves.times, 100 * usage, **_style(k), lw=width, label=f"contact {k + 1}", gid=f"use-{k + 1}"
        )
    _limit(ax, curves, 100 * curves.limit("GT"), "limit of GT,", " %")
    _finish(ax, curves, "Friction used", "tangential force / friction limit [%]")
    ax.set_ylim(bottom=0.0)


def _clearance(ax: Any, curves: PlanCurves) -> None:
    """The least distance; a ring marks the worst instant that the check has found."""
    title = "Minimum distance"
    if draw_clearance(ax, curves.plan.task.robot, curves.samples):
        worst = curves.plan.check.worst["clearance_m"]
        ax.plot([worst.time], [1e3 * worst.value], **_WORST, mec=LIMIT, gid="clearance-worst")
        _limit(ax, curves, 1e3 * curves.limit("clearance"), "limit", " mm")
        title = f"Minimum distance {1e3 * worst.value:.3g} mm at {max(worst.time, 0.0) + 0.0:.3f} s"
    _finish(ax, curves, title, "distance [mm]")


def _limit(ax: Any, curves: PlanCurves, values: np.ndarray, label: str | None, unit: str = "") -> None:
    """A limit (N,), with its value in the legend; it may change from segment to segment."""
    low, high = values.min(), values.max()
    if label is not None:
        label = f"{label} {low:.4g}{unit}" if low == high else f"{label} {low:.4g} to {high:.4g}{unit}"
    if low == high:
        ax.axhline(low, **_LIMIT_STYLE, label=label, gid="limit")
    else:
        ax.plot(curves.times, values, **_LIMIT_STYLE, label=label, gid="limit")


def _angles(ax: Any, curves: PlanCurves, names: Iterable[str] | None = None) -> None:
    names = names or [str(j + 1) for j in range(curves.samples.angles.shape[1])]
    for j, (name, values) in enumerate(zip(names, (curves.scales * curves.samples.angles).T, strict=True)):
        ax.plot(curves.times, values, **_style(j), label=name, gid=f"angle-{j + 1}")
    if set(curves.units) == {"deg"}:
        title, label = _all("Angles of joints", curves.samples.angles), "angle [deg]"
    else:
        title, label = "Coordinates", f"coordinate [{', '.join(sorted(set(curves.units), reverse=True))}]"
    _finish(ax, curves, title, label)


def _shares(
    ax: Any, curves: PlanCurves, title: str, values: np.ndarray, limits: np.ndarray, largest: np.ndarray
) -> None:
    """Joint quantities as shares of their limits, (N,) of which are allowed; those without are left out."""
    if not np.any(np.isfinite(limits)):
        ax.text(0.5, 0.5, "no joint has such a limit", ha="center", va="bottom", transform=ax.transAxes)
    for j in np.flatnonzero(np.isfinite(limits)):
        ax.plot(
            curves.times,
            100 * values[:, j] / limits[j],
            **_style(int(j)),
            label=str(j + 1),
            gid=f"share-{j + 1}",
        )
    for side, label in ((100, "limit"), (-100, None)):
        _limit(ax, curves, side * largest, label, " %")
    _finish(ax, curves, title, "share of the limit [%]")


def _joint_panels(
    curves: PlanCurves,
    quantity: str,
    units: list[str],
    values: np.ndarray,
    limits: np.ndarray,
) -> Figure:
    """One panel per joint with its own limits, (N, n) as the values are."""
    n = values.shape[1]
    columns = min(n, 2)
    rows = -(-n // columns)
    figure, axes = _figure(curves, (12.0, 0.8 + 2.7 * rows), rows, columns)
    for j, ax in enumerate(axes.ravel()):
        if j >= n:
            ax.remove()
            continue
        unit = units[j]
        ax.plot(curves.times, values[:, j], **_style(j), label=quantity, gid=f"{quantity}-{j + 1}")
        peak = float(np.max(np.abs(values[:, j])))
        if np.isfinite(limits[:, j]).all():
            _limit(ax, curves, limits[:, j], "limit", f" {unit}")
            _limit(ax, curves, -limits[:, j], None)
            most = f"{100 * np.max(np.abs(values[:, j]) / limits[:, j]):.0f} % of the limit"
        else:
            most = "no limit"
        name = curves.joint_names[j]
        _finish(
            ax,
            curves,
            f"{name[:1].upper()}{name[1:]}: at most {peak:.3g} {unit}, {most}",
            f"{quantity} [{unit}]",
        )
    return figure


def _total_power(ax: Any, curves: PlanCurves) -> None:
    """Power on the left axis, energy on the right one."""
    total = curves.samples.total_power
    ax.fill_between(curves.times, 0.0, total, color=POWER, alpha=0.15, lw=0)
    ax.plot(curves.times, total, color=POWER, label="power", gid="power")
    right = ax.twinx()
    _energy(right, curves)
    right.set_ylabel("energy [J]")
    handles, labels = right.get_legend_handles_labels()
    ax.margins(y=0.08)
    _finish(ax, curves, "Electric power and energy", "power [W]", (handles, labels))
    low, high = ax.get_ylim()
    if low < 0:  # both zeros at the same height
        top = right.get_ylim()[1]
        right.set_ylim(top * low / high, top)


def _energy(ax: Any, curves: PlanCurves) -> None:
    for samples, style in ((curves.samples, {"ls": "-"}), (curves.reference, {"ls": _DASHED, "lw": 1.4})):
        if samples is not None:
            energy = _cumulated(samples)
            own = samples is curves.samples
            label = f"{'energy' if own else 'reference'}, {energy[-1]:.1f} J"
            gid = "energy" if own else "energy-reference"
            ax.plot(samples.times, energy, color=ENERGY, **style, label=label, gid=gid)
    ax.set_ylim(min(0.0, ax.get_ylim()[0]) if ax.dataLim.ymin < 0 else 0.0, 1.06 * ax.dataLim.ymax)


def _reserves(ax: Any, curves: PlanCurves, names: tuple[str, ...]) -> None:
    """Reserves with their limits; a ring marks the worst instant that the check has found."""
    for name in names:
        color = GN if name == "GN" else GT
        ax.plot(curves.times, _reserve(curves.samples, name), color=color, label=name, gid=name)
    for name in names:
        color, worst = GN if name == "GN" else GT, curves.plan.check.worst[name]
        ax.plot(
            [worst.time],
            [worst.value],
            **_WORST,
            mec=color,
            label=None if name != names[0] else "worst",
            gid=f"{name}-worst",
        )
        if curves.reference is not None:
            style = {"color": color, "ls": _DASHED, "lw": 1.2, "alpha": 0.75, "zorder": 1.8}
            values, label = _reserve(curves.reference, name), None if name != names[0] else "reference"
            ax.plot(curves.reference.times, values, **style, label=label, gid=f"{name}-reference")
    limits = {tuple(curves.limit(name)): name for name in reversed(names)}
    for values, name in reversed(limits.items()):
        _limit(ax, curves, np.array(values), "limit" if len(limits) == 1 else f"limit of {name}")
    most = {name: curves.plan.check.worst[name] for name in names}
    words = {"GN": "Tip-over GN", "GT": "slip GT"}
    title = ", ".join(f"{words[n]} at most {w.value:.3f} at {w.time:.3f} s" for n, w in most.items())
    worst_case = {name: curves.plan.check.worst.get(WITHIN_OF[name]) for name in names}
    if within := [f"{name} {worst.value:.3f}" for name, worst in worst_case.items() if worst is not None]:
        title += f";\nat the worst of the tolerance {', '.join(within)}"
    _finish(ax, curves, title[:1].upper() + title[1:], f"{', '.join(names)} (1: contact lost)")
    ax.set_ylim(bottom=0.0)


def _normal_forces(ax: Any, curves: PlanCurves) -> None:
    for k, values in enumerate(curves.normal_forces.T):
        ax.plot(curves.times, values, **_style(k), label=str(k + 1), gid=f"normal-{k + 1}")
    for side, word in ((0, "least"), (1, "most")):
        bounds = curves.normal_range[:, side]
        for value in np.unique(bounds[np.isfinite(bounds)]):
            which = np.flatnonzero(bounds == value)
            own = {"color": _style(which[0])["color"]} if len(which) < len(bounds) else {}
            of = "" if len(which) == len(bounds) else f" ({', '.join(str(k + 1) for k in which)})"
            style = {**_LIMIT_STYLE, **(own if len(which) == 1 else {})}
            ax.axhline(value, **style, label=f"{word}{of}: {value:.4g} N", gid=f"{word}-normal")
    title = _all("Normal forces of contacts", curves.normal_forces)
    contacts = curves.plan.check.contacts
    shared = ", equally compliant feet" if contacts.alike else ", one possible sharing"
    shared = "" if contacts.unique else shared
    _finish(ax, curves, title + shared, "force on the base [N]")


def _drawn(draw: Callable[[PlanCurves], Figure], curves: PlanCurves) -> Figure:
    """A figure whose time axes end with the motion, or with the reference where that is drawn and longer."""
    figure = draw(curves)
    lines = [line.get_gid() or "" for ax in figure.axes for line in ax.lines]
    ends = [max(curves.plan.motion.end, curves.samples.times[-1])]
    reference = curves.plan.task.reference
    if reference is not None and any(gid.endswith("-reference") for gid in lines):
        ends.append(reference.end)
    for ax in figure.axes:
        ax.set_xlim(0.0, max(ends) or 1.0)
    place_panels(figure)
    return figure


def _figure(
    curves: PlanCurves, size: tuple[float, float], rows: int, columns: int
) -> tuple[Figure, np.ndarray]:
    figure = new_figure(*size, layout="none")
    figure.suptitle(curves.title, fontsize=13, fontweight="bold", y=1 - 0.09 / size[1])
    if len(curves.events):
        note = "grey lines: switching times"
        figure.supxlabel(note, fontsize=9, color="#6f6f6f", y=0.06 / size[1])
    axes = figure.subplots(rows, columns, squeeze=False)
    return figure, axes


def _finish(
    ax: Any, curves: PlanCurves, title: str, label: str, more: tuple[list[Any], list[str]] = ([], [])
) -> None:
    """Events, time axis, title, and the legend between title and panel, where it covers no curve."""
    from matplotlib.collections import LineCollection

    events = [[(t, 0), (t, 1)] for t in curves.events]
    style = {"color": EVENT, "lw": 0.8, "zorder": 0}
    ax.add_collection(LineCollection(events, transform=ax.get_xaxis_transform(), **style), autolim=False)
    mark_segments(ax, getattr(curves.plan, "segments", ()))
    ax.set_xlabel("time [s]")
    ax.set_ylabel(label)
    ax.grid(axis="y", color="#ececec", lw=0.8)
    ax.set_axisbelow(True)
    handles, labels = ax.get_legend_handles_labels()
    handles, labels = handles + more[0], labels + more[1]
    columns = legend_columns(ax, labels)
    pad = 7 + 14 * -(-len(labels) // columns)
    ax.set_title(title, loc="left", fontsize=11, pad=pad, y=1.0)  # given: nothing is measured to find it
    ax.legend(
        handles,
        labels,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncol=columns,
        frameon=False,
        fontsize=LEGEND_SIZE,
        handlelength=LEGEND_HANDLE,
        columnspacing=LEGEND_GAP,
        borderaxespad=0.2,
        borderpad=0.2,
    )


def _all(what: str, values: np.ndarray) -> str:
    """Title of a panel whose legend holds but numbers: "Angles of joints 1 to 6"."""
    return f"{what} 1 to {values.shape[1]}" if values.shape[1] > 1 else f"{what} 1"


def _style(number: int) -> dict[str, Any]:
    """Colour and line style of a joint or contact."""
    return {
        "color": COLORS[number % len(COLORS)],
        "ls": STYLES[number // len(COLORS) % len(STYLES)],
    }


def _reserve(samples: MotionSamples, name: str) -> np.ndarray:
    return samples.tip.GN if name == "GN" else samples.slip.GT


def _cumulated(samples: MotionSamples) -> np.ndarray:
    """Energy since the start, (N,), J, by the trapezoidal rule."""
    power = samples.total_power
    return np.concatenate([[0.0], np.cumsum(0.5 * np.diff(samples.times) * (power[1:] + power[:-1]))])


_FIGURES: dict[str, Callable[[PlanCurves], Figure]] = {
    "plan": _overview,
    "angles": _angle_figure,
    "speeds": _speed_figure,
    "torques": _torque_figure,
    "power": _power_figure,
    "reserves": _reserve_figure,
    "normal_forces": _normal_figure,
    "friction": _friction_figure,
    "clearance": _clearance_figure,
}
