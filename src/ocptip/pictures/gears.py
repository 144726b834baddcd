"""Figure of a motion with elastic joints: vibration of the gripper, forces beside those with stiff gears."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ocptip.pictures.frame import COLORS, new_figure
from ocptip.standing.elastic.drives import SETTLED, DriveMotion
from ocptip.standing.mechanism import StandingMechanism

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_POINTS = 1500


def gears_figure(
    title: str, robot: StandingMechanism, found: DriveMotion, times: np.ndarray, stiff: np.ndarray
) -> Figure:
    """Vibration and normal forces over time.

    Args:
        title: above all.
        robot: that moves.
        found: with its gears.
        times: (N,), s, of `stiff`.
        stiff: (N, n) normal forces with gears and feet that do not give, N.
    """
    figure, course = new_figure(9.5, 8.5), found.course
    figure.suptitle(title, fontsize=13, fontweight="bold")
    vibration, forces = figure.subplots(2, 1, sharex=True)
    some = np.unique(np.linspace(0, len(course.times) - 1, _MOST_POINTS).astype(int))
    own = course.forces[some, :, 0]
    if course.wrenches.shape[1]:
        own = robot.contact_states(course.wrenches[some]).contact_forces[:, :, 0]
    vibration.plot(course.times, 1e3 * found.vibration, color=COLORS[0], lw=1.2, gid="vibration")
    vibration.axhline(1e3 * SETTLED, color="#6f6f6f", lw=1.0, ls=(0, (1, 2)))
    for k in range(stiff.shape[1]):
        color = COLORS[k % len(COLORS)]
        forces.plot(times, stiff[:, k], color=color, lw=1.0, ls=(0, (4, 2)), gid=f"stiff-{k + 1}")
        name = {"label": f"{k + 1}", "gid": f"force-{k + 1}"}
        forces.plot(course.times[some], own[:, k], color=color, lw=1.2, **name)
    peak = f"up to {1e3 * found.peak.value:.3g} mm, {1e3 * found.after:.3g} mm after the end"
    heads = (f"Vibration of the gripper: {peak}", "gripper from rest in the same posture [mm]")
    for ax, (head, label) in zip(
        (vibration, forces), (heads, ("Normal forces of contacts", "force on the base [N]")), strict=True
    ):
        ax.axvline(found.end, color="#c8c8c8", lw=1.0, zorder=0)
        ax.set_title(head, loc="left", fontsize=11)
        ax.set_ylabel(label)
        ax.grid(axis="y", color="#ececec", lw=0.8)
    vibration.set_ylim(bottom=0.0)
    forces.legend(loc="upper right", ncol=4, frameon=False, fontsize=8.5)
    forces.set_xlabel("time [s]")
    note = "dashed: stiff gears; grey line: end of the motion; dotted: settled"
    figure.supxlabel(note, fontsize=9, color="#6f6f6f")
    return figure
