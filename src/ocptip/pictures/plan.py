"""Figures of a plan: what the robot does, what the ground feels, what the drives do.

Each (`motion.png`, `ground.png`, `drives.png`) has sketches of postures above panels over one time axis.
Joints and contacts are numbered from 1; each has the same colour in all figures.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ocptip.motion import margins as kinds
from ocptip.motion.margins import MotionMargin
from ocptip.motion.summary import TITLES, at_text
from ocptip.pictures import style
from ocptip.pictures.elastic import feet_figure, gears_figure
from ocptip.pictures.frame import hull, new_figure, place_panels, png_files
from ocptip.pictures.plan_curves import PlanCurves, draw_clearance
from ocptip.pictures.sketch import draw_postures
from ocptip.pictures.style import Quantity
from ocptip.reserves.tipping import moment_at
from ocptip.standing.samples import MotionSamples

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ocptip.motion.motion_plan import MotionPlan

_WIDTH = 10.5  # inches
_SKETCHES, _PANEL = 2.5, 1.95  # inches high
_SAME = 1e-3  # s: postures no farther apart are one

_WORST, _WORST_INSTANT = "worst case", "worst case, at its worst"
_MARKS = {"-nominal": "ring: worst instant, nominal", "-worst-instant": "diamond: in the worst case"}
_EVENTS = "faint vertical lines: switching times of joints"


def plan_pngs(plan: Any, samples: MotionSamples | None = None) -> dict[str, bytes]:
    """Contents of PNG files with all figures of a plan, the three overviews first.

    Args:
        plan: a `MotionPlan`, or any object with its attributes.
        samples: of its motion, from :func:`ocptip.motion.files.output.sample_motion`; computed if None.
    """
    return png_files(_figures(plan, samples))


def plan_figures(plan: MotionPlan, samples: MotionSamples | None = None) -> dict[str, Figure]:
    """Matplotlib figures of a plan, by the names of the files without ending."""
    return {name: draw() for name, draw in _figures(plan, samples).items()}


def ground_figure(plan: Any, samples: MotionSamples | None = None) -> Figure:
    """A Matplotlib figure of the contacts over time; arguments are those of `plan_pngs`."""
    return _ground(PlanCurves.of(plan, samples))


def _figures(plan: MotionPlan, samples: MotionSamples | None) -> dict[str, Callable[[], Figure]]:
    curves = PlanCurves.of(plan, samples)
    figures: dict[str, Callable[[], Figure]] = {name: partial(draw, curves) for name, draw in FIGURES.items()}
    forces = curves.times, curves.normal_forces
    if feet := plan.check.feet:
        figures["feet"] = partial(feet_figure, plan.task.name, feet, *forces)
    if drives := plan.check.drives:
        figures["gears"] = partial(gears_figure, plan.task.name, plan.task.robot, drives, *forces)
    return figures


def _motion(curves: PlanCurves) -> Figure:
    """Postures, angles, speeds, clearance."""
    count = 4 if curves.has_tcp else 3
    robot, end = curves.plan.task.robot, curves.plan.motion.end
    row = curves.margins.get(kinds.TIPPING)
    moments = [("start", 0.0), ("goal", end)]
    if row and row.nominal and row.nominal.time is not None and _SAME < row.nominal.time < end - _SAME:
        moments.insert(1, (f"minimum tipping margin, {row.nominal.time:.3f} s", row.nominal.time))
    figure, top, panels = _begin(curves, "what the robot does", len(moments), count)
    _postures(top, curves, moments)
    _angles(panels[0], curves)
    limits, units = robot.limits.speed, ([f"{unit}/s" for unit in curves.units], curves.scales)
    _shares(panels[1], curves, style.SPEED, "Speed of the joints", curves.samples.speeds, limits, units)
    if curves.has_tcp:
        speed, quantity = curves.tcp_speed, style.TCP_SPEED
        panels[2].plot(
            curves.times, speed, color=quantity.color, **style.NOMINAL, label="TCP", gid="tcp-speed"
        )
        _finish(panels[2], curves, f"Speed of the TCP: at most {speed.max():.3g} m/s", quantity.label)
    _clearance(panels[-1], curves)
    return _end(figure, curves, panels, top)


def _ground(curves: PlanCurves) -> Figure:
    """Where the load is on the feet; tipping margin, friction used, foot forces."""
    figure, top, panels = _begin(curves, "what the ground feels", 2, 3)
    row = curves.margins.get(kinds.TIPPING)
    worst = row.nominal if row else None
    time = 0.0 if worst is None or worst.time is None else min(max(worst.time, 0.0), curves.plan.motion.end)
    moments = [("start" if worst is None else f"minimum tipping margin, {time:.3f} s", time)]
    _postures(top[:1], curves, moments, feet=True, axis=worst.contacts if worst else ())
    _support(top[1], curves)
    _tipping(panels[0], curves)
    _friction(panels[1], curves)
    _foot_forces(panels[2], curves)
    return _end(figure, curves, panels, top)


def _drives(curves: PlanCurves) -> Figure:
    """Torques as shares of their limits, power and energy."""
    figure, top, panels = _begin(curves, "what the drives do", 1, 3)
    row = curves.margins.get(kinds.TORQUE)
    time = 0.0 if row is None or row.nominal is None or row.nominal.time is None else row.nominal.time
    time = min(max(time, 0.0), curves.plan.motion.end)
    _postures(top, curves, [(f"maximum torque / limit, {time:.3f} s", time)], joints=True)
    torques, robot = curves.samples.torques, curves.plan.task.robot
    limits, units = robot.limits.torque, (robot.motor_units, np.ones(robot.n))
    _shares(panels[0], curves, style.TORQUE, "Torque of the drives", torques, limits, units, row)
    total = curves.samples.total_power
    panels[1].fill_between(curves.times, 0.0, total, color=style.POWER.color, alpha=0.15, lw=0)
    _line(panels[1], curves, style.POWER, total, "all drives", "power")
    most = f"Electric power: {total.min():.0f} to {total.max():.0f} W"
    _finish(panels[1], curves, most, style.POWER.label)
    energy = curves.energy(curves.samples)
    _line(panels[2], curves, style.ENERGY, energy, f"plan, {energy[-1]:.1f} J", "energy")
    if curves.reference is not None:
        other = curves.energy(curves.reference)
        name = f"reference, {other[-1]:.1f} J"
        line_style = {"color": style.ENERGY.color, **style.REFERENCE}
        panels[2].plot(curves.reference.times, other, **line_style, label=name, gid="energy-reference")
    _finish(panels[2], curves, "Electric energy since the start", style.ENERGY.label)
    return _end(figure, curves, panels, top)


FIGURES: dict[str, Callable[[PlanCurves], Figure]] = {
    "motion": _motion,
    "ground": _ground,
    "drives": _drives,
}


# --- panels -------------------------------------------------------------------------------------------------


def _angles(ax: Any, curves: PlanCurves) -> None:
    values = (curves.scales * curves.samples.angles).T
    units = list(dict.fromkeys(curves.units))
    axes = {unit: ax if unit == units[0] else ax.twinx() for unit in units}  # m and deg have an axis each
    for j, (name, value, unit) in enumerate(zip(curves.joint_names, values, curves.units, strict=True)):
        label = name if len(units) == 1 else f"{name} [{unit}]"
        axes[unit].plot(curves.times, value, **style.member(j), label=label, gid=f"angle-{j + 1}")
        if axes[unit] is not ax:
            ax.plot([], [], **style.member(j), label=label)  # one legend for both axes
            axes[unit].set_ylabel(f"coordinate [{unit}]")
    title, word = ("Angle of each joint", "angle") if units == ["deg"] else ("Coordinates", "coordinate")
    _finish(ax, curves, title, f"{word} [{units[0]}]")


def _shares(
    ax: Any,
    curves: PlanCurves,
    quantity: Quantity,
    title: str,
    values: np.ndarray,
    limits: np.ndarray,
    units: tuple[Sequence[str], np.ndarray],
    row: MotionMargin | None = None,
) -> None:
    """Joint quantities (N, n) as shares of their limits (n,); those without one are left out.

    The legend has the limits in these units: names, and factors from SI units.
    """
    limited, shares = np.flatnonzero(np.isfinite(limits)), values / limits
    shown = [f"{scale * limit:.3g} {unit}" for limit, unit, scale in zip(limits, *units, strict=True)]
    for j in limited:
        line_style = {
            **style.member(int(j)),
            "label": f"joint {j + 1}, limit {shown[j]}",
            "gid": f"share-{j + 1}",
        }
        ax.plot(curves.times, quantity.scale * shares[:, j], **line_style)
    if not len(limited):
        ax.text(0.5, 0.5, "no joint has such a limit", ha="center", va="bottom", transform=ax.transAxes)
    elif row is not None:
        _marks(ax, curves, quantity, row, sign=_sign(curves, shares, row))
        title = _title(title, row)
        most = curves.limit("torque_ratio")
        for side, label in ((1.0, "limit"), (-1.0, None)):
            _limit(ax, curves, quantity, side * most, label)
    else:
        title += f": at most {quantity.scale * np.max(np.abs(shares[:, limited])):.3g} % of the limit"
    _finish(ax, curves, title, quantity.label)


def _sign(curves: PlanCurves, shares: np.ndarray, row: MotionMargin) -> float:
    """Sign of the share that is largest at the worst instant."""
    if row.nominal is None or row.nominal.time is None:
        return 1.0
    share = shares[int(np.argmin(np.abs(curves.times - row.nominal.time)))]
    return float(np.sign(share[np.nanargmax(np.abs(share))])) or 1.0


def _tipping(ax: Any, curves: PlanCurves) -> None:
    row, quantity = curves.margins.get(kinds.TIPPING), style.TIPPING
    if row is None:
        ax.text(0.5, 0.5, "the base cannot tip", ha="center", va="bottom", transform=ax.transAxes)
        _finish(ax, curves, TITLES[kinds.TIPPING], quantity.label)
        return
    _line(ax, curves, quantity, curves.moments(curves.samples), "nominal", "tipping")
    if len(curves.worst_moments[0]):
        line_style = {"color": quantity.color, **style.WORST_CASE}
        ax.plot(*curves.worst_moments, **line_style, label=_WORST, gid="tipping-worst-case")
    _reference(ax, curves, quantity, curves.moments)
    _marks(ax, curves, quantity, row)
    reference = curves.plan.task.robot.tip_over.reference_moment
    limits = np.array([moment_at(index, reference) for index in curves.limit("GN").tolist()])
    _limit(ax, curves, quantity, limits, "limit")
    _worst_limit(ax, quantity, row)
    ax.set_ylim(bottom=min(0.0, ax.get_ylim()[0]))  # below zero the base tips
    _finish(ax, curves, _title(TITLES[kinds.TIPPING], row), quantity.label)


def _friction(ax: Any, curves: PlanCurves) -> None:
    quantity, row = style.FRICTION, curves.margins.get(kinds.FRICTION)
    usage = curves.samples.slip.usage
    _line(
        ax,
        curves,
        quantity,
        curves.friction(curves.samples),
        "maximum",
        "friction",
        zorder=1.9,
        lw=3.0,
    )
    for k, usage_of_contact in enumerate(usage.T):
        line_style = {**style.member(k), "lw": 1.0, "label": f"contact {k + 1}", "gid": f"use-{k + 1}"}
        ax.plot(curves.times, quantity.scale * usage_of_contact, **line_style)
    _reference(ax, curves, quantity, curves.friction)
    _limit(ax, curves, quantity, curves.limit("GT"), "limit")
    title = TITLES[kinds.FRICTION]
    if row is not None:
        _marks(ax, curves, quantity, row)
        _worst_limit(ax, quantity, row)
        title = _title(title, row)
    ax.set_ylim(bottom=0.0)
    _finish(ax, curves, title, quantity.label)


def _foot_forces(ax: Any, curves: PlanCurves) -> None:
    quantity, row = style.FOOT_FORCE, curves.margins.get(kinds.FOOT_FORCE)
    for k, values in enumerate(curves.normal_forces.T):
        line_style = {**style.member(k), "label": f"contact {k + 1}", "gid": f"normal-{k + 1}"}
        ax.plot(curves.times, values, **line_style)
    for side, word, named in ((0, "minimum", "lets go at"), (1, "maximum", "limit")):
        bounds = curves.normal_range[:, side]
        for value in np.unique(bounds[np.isfinite(bounds)]):
            which = np.flatnonzero(bounds == value)
            of = "" if len(which) == len(bounds) else f"{', '.join(str(k + 1) for k in which)}: "
            ax.axhline(value, **style.LIMIT, label=f"{of}{named} {value:.4g} N", gid=f"{word}-normal")
    contacts, title = curves.plan.check.contacts, "Normal forces"
    if contacts.alike:
        title += " of equally compliant feet"
    elif not contacts.unique:
        title += ", one possible sharing"
    if contacts.alike and contacts.alike.value < 0:
        title += f": one lifts {contacts.alike}"
    elif curves.normal_range[:, 0].any():  # as of clamps, which let go where they would have to pull more
        title = title if row is None else _title(f"{title}, distance from where a contact lets go", row)
    elif row is not None:
        _marks(ax, curves, quantity, row)
        title = _title(title, row)
    _finish(ax, curves, title, quantity.label)


def _clearance(ax: Any, curves: PlanCurves) -> None:
    """Distance of the nearest pair; rings mark the worst instants of the check."""
    quantity, row = style.CLEARANCE, curves.margins.get(kinds.CLEARANCE)
    title = TITLES[kinds.CLEARANCE]
    if draw_clearance(ax, curves.plan.task.robot, curves.samples) and row is not None:
        _marks(ax, curves, quantity, row)
        _limit(ax, curves, quantity, curves.limit("clearance"), "limit")
        title = _title(title, row)
        ax.set_ylim(bottom=min(0.0, ax.get_ylim()[0]))
    _finish(ax, curves, title, quantity.label)


def _support(ax: Any, curves: PlanCurves) -> None:
    """Seen from above: the support polygon, and where the zero-moment point goes."""
    contacts = np.array([c.position for c in curves.plan.task.robot.support.contacts])[:, :2]
    outline = np.append(hull(contacts), hull(contacts)[:1])
    ax.plot(*contacts[outline].T, color=style.NOTE, lw=1.2, label="support polygon", gid="polygon")
    for k, place in enumerate(contacts):
        ax.plot(*place, ls="", marker="s", ms=6, color=style.member(k)["color"], label=f"contact {k + 1}")
    title, row = "Contacts from above", curves.margins.get(kinds.ZERO_MOMENT_POINT)
    if (points := curves.zero_moment_points) is not None:
        ax.plot(*points.T, color=style.TIPPING.color, **style.NOMINAL, label="zero-moment point", gid="zmp")
        title = "Zero-moment point, from above"
        if row is not None:
            title += f":\nat least {at_text(row, row.nominal)} from the edge"
    style.finish(ax, title, "y [m]", "x [m]")
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.12)


# --- parts of panels ----------------------------------------------------------------------------------------


def _begin(curves: PlanCurves, what: str, above: int, count: int) -> tuple[Figure, list[Any], list[Any]]:
    """A figure with places for sketches, and below them panels (count) over one time axis."""
    figure = new_figure(_WIDTH, 0.9 + _SKETCHES + _PANEL * count, layout=False)
    style.head(figure, f"{curves.motion_text}: {what}", curves.plan.check.headline)
    top = list(figure.subplots(1, above, squeeze=False)[0])
    return figure, top, list(figure.subplots(count, 1, squeeze=False, sharex=True)[:, 0])


def _postures(panels: list[Any], curves: PlanCurves, moments: list[tuple[str, float]], **what: Any) -> None:
    """Sketches of the postures at times, s, with titles."""
    motion = curves.plan.motion
    angles = motion.states(np.array([time for _, time in moments]))[0]
    postures = [(title, q) for (title, _), q in zip(moments, angles, strict=True)]
    path = curves.tcp if curves.has_tcp else None
    forces = [curves.forces_at(time) for _, time in moments]
    draw_postures(panels, curves.plan.task.robot, postures, path=path, forces=forces, **what)


def _end(figure: Figure, curves: PlanCurves, panels: list[Any], top: list[Any]) -> Figure:
    """Time axes that end with the motion, or with the reference where that is drawn and longer; all in
    their places.
    """
    gids = [line.get_gid() or "" for ax in figure.axes for line in ax.lines]
    end = max(curves.plan.motion.end, curves.samples.times[-1])
    if curves.reference is not None and any(gid.endswith("-reference") for gid in gids):
        end = max(end, curves.plan.task.reference.end)
    panels[-1].set_xlabel("time [s]")
    panels[-1].set_xlim(0.0, end or 1.0)
    notes = ["green arrows: contact forces"]
    notes += [text for ending, text in _MARKS.items() if any(gid.endswith(ending) for gid in gids)]
    style.note(figure, "; ".join([*notes, *([_EVENTS] if len(curves.events) else [])]))
    place_panels(top, _SKETCHES, panels)
    return figure


def _finish(ax: Any, curves: PlanCurves, title: str, label: str) -> None:
    style.mark_events(ax, curves.events)
    style.mark_segments(ax, getattr(curves.plan, "segments", ()))
    style.finish(ax, title, label)


def _line(
    ax: Any, curves: PlanCurves, quantity: Quantity, values: np.ndarray, label: str, gid: str, **more: Any
) -> None:
    line_style = {"color": quantity.color, **style.NOMINAL, **more}
    ax.plot(curves.times, quantity.scale * values, **line_style, label=label, gid=gid)


def _reference(
    ax: Any, curves: PlanCurves, quantity: Quantity, of: Callable[[MotionSamples], np.ndarray]
) -> None:
    if (other := curves.reference) is not None:
        line_style = {"color": quantity.color, **style.REFERENCE, "alpha": 0.8, "zorder": 1.8}
        gid = f"{quantity.name.split()[0]}-reference"
        ax.plot(other.times, quantity.scale * of(other), **line_style, label="reference", gid=gid)


def _marks(ax: Any, curves: PlanCurves, quantity: Quantity, row: MotionMargin, sign: float = 1.0) -> None:
    """Rings at the worst instant, diamonds at that of the worst case, named where they have no curve."""
    alone = not any(line.get_label() == _WORST for line in ax.lines)
    for index, line_style, word in (
        (row.nominal, style.RING, "nominal"),
        (row.worst_case, style.DIAMOND, "worst-instant"),
    ):
        if index is not None and index.time is not None:
            place = [index.time], [sign * quantity.scale * index.value]
            label = _WORST_INSTANT if alone and word == "worst-instant" else None
            ax.plot(*place, **line_style, color=quantity.color, label=label, gid=f"{row.name}-{word}")


def _limit(ax: Any, curves: PlanCurves, quantity: Quantity, values: np.ndarray, label: str | None) -> None:
    """A limit (N,), with its value in the legend; it may change from segment to segment."""
    values = quantity.scale * values
    low, high = values.min(), values.max()
    if label is not None:
        label = f"{label} {low:.3g}" + (f" to {high:.3g}" if high > low else "") + f" {quantity.unit}"
    if low == high:
        ax.axhline(low, **style.LIMIT, label=label, gid="limit")
    else:
        ax.plot(curves.times, values, **style.LIMIT, label=label, gid="limit")


def _worst_limit(ax: Any, quantity: Quantity, row: MotionMargin) -> None:
    """The limit of the worst case, where that is another."""
    if row.limit_worst_case is not None and row.limit_worst_case != row.limit:
        value = quantity.scale * row.limit_worst_case
        line_style = {**style.LIMIT, "lw": 0.9}
        ax.axhline(
            value,
            **line_style,
            label=f"limit, worst case {value:.3g} {quantity.unit}",
            gid="limit-worst-case",
        )


def _title(name: str, row: MotionMargin) -> str:
    """Name, nominal value and worst case, as the summary of a plan has them."""
    word = "minimum" if row.minimum else "maximum"
    parts = [name if row.nominal is None else f"{name}: {word} {at_text(row, row.nominal)}"]
    if row.worst_case is not None:
        parts.append(f"worst case {at_text(row, row.worst_case)}")
    return ", ".join(parts)
