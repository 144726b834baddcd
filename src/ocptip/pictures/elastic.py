"""Figures of a motion on springs: forces and gaps of compliant feet, and vibration of elastic joints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ocptip.pictures import style
from ocptip.pictures.frame import new_figure
from ocptip.standing.elastic.drives import SETTLED, DriveMotion
from ocptip.standing.elastic.feet import FeetMotion
from ocptip.standing.mechanism import StandingMechanism

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_POINTS = 4000


def feet_figure(title: str, feet_motion: FeetMotion, times: np.ndarray, shared: np.ndarray) -> Figure:
    """Normal forces and gaps over time.

    Args:
        title: name of the task.
        found: the motion on its feet.
        times: (N,), s, of `shared`.
        shared: (N, n) normal forces without swings, N.
    """
    figure, course = new_figure(10.5, 6.4), feet_motion.course
    style.head(figure, f"{title}: forces and gaps of compliant feet")
    forces, gaps = figure.subplots(2, 1, sharex=True)
    some = np.unique(np.linspace(0, len(course.times) - 1, _MOST_POINTS).astype(int))
    for k in range(shared.shape[1]):
        line_style = style.member(k)
        label = "without swings" if k == 0 else None
        dotted = {**style.REFERENCE, "color": line_style["color"]}
        forces.plot(times, shared[:, k], **dotted, label=label, gid=f"shared-{k + 1}")
        force = course.forces[some, k, 0]
        forces.plot(
            course.times[some], force, **line_style, lw=1.2, label=f"foot {k + 1}", gid=f"force-{k + 1}"
        )
        gap = 1e3 * course.gaps[some, k]
        gaps.plot(course.times[some], gap, **line_style, lw=1.2, label=f"foot {k + 1}", gid=f"gap-{k + 1}")
    for ax in (forces, gaps):
        ax.axvline(feet_motion.end, color=style.NOTE, lw=1.0, zorder=0, label="end of the motion", gid="end")
        ax.set_ylim(bottom=0.0)
    first, second = feet_motion.lines()[:2]
    style.finish(forces, f"Normal forces: {first};\n{second}", style.FOOT_FORCE.label)
    lifts = "" if feet_motion.lifts or feet_motion.falls else ": no foot lifts"
    style.finish(gaps, f"Gaps below feet{lifts}", "height above the ground [mm]", "time [s]")
    return figure


if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DRIVE_POINTS = 1500


def gears_figure(
    title: str, robot: StandingMechanism, drive_motion: DriveMotion, times: np.ndarray, stiff: np.ndarray
) -> Figure:
    """Vibration and normal forces over time.

    Args:
        title: name of the task.
        robot: that moves.
        found: with its gears.
        times: (N,), s, of `stiff`.
        stiff: (N, n) normal forces with gears and feet that do not give, N.
    """
    figure, course = new_figure(10.5, 6.4), drive_motion.course
    style.head(figure, f"{title}: vibration of elastic joints")
    vibration, forces = figure.subplots(2, 1, sharex=True)
    some = np.unique(np.linspace(0, len(course.times) - 1, _DRIVE_POINTS).astype(int))
    shown_forces = course.forces[some, :, 0]
    if course.wrenches.shape[1]:
        shown_forces = robot.contact_states(course.wrenches[some]).contact_forces[:, :, 0]
    line_style = {"color": style.TCP_SPEED.color, "lw": 1.2, "label": "TCP", "gid": "vibration"}
    vibration.plot(course.times, 1e3 * drive_motion.vibration, **line_style)
    vibration.axhline(1e3 * SETTLED, **style.LIMIT, label="counted as settled", gid="settled")
    for k in range(stiff.shape[1]):
        line_style, label = style.member(k), "stiff gears" if k == 0 else None
        dotted = {**style.REFERENCE, "color": line_style["color"]}
        forces.plot(times, stiff[:, k], **dotted, label=label, gid=f"stiff-{k + 1}")
        name = {"label": f"contact {k + 1}", "gid": f"force-{k + 1}"}
        forces.plot(course.times[some], shown_forces[:, k], **line_style, lw=1.2, **name)
    for ax in (vibration, forces):
        ax.axvline(drive_motion.end, color=style.NOTE, lw=1.0, zorder=0, label="end of the motion", gid="end")
    vibration.set_ylim(bottom=0.0)
    peak = f"up to {1e3 * drive_motion.peak.value:.3g} mm, {1e3 * drive_motion.after:.3g} mm after the end"
    style.finish(vibration, f"Vibration of the TCP: {peak}", "deviation from rest [mm]")
    style.finish(forces, "Normal force of each contact", style.FOOT_FORCE.label, "time [s]")
    return figure
