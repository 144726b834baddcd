"""Free-body diagram of a robot on its base, for the docs: weight, inertia force, contact forces.

The forces are computed, not drawn by hand: two planar feet share the load of a cart whose arm brakes.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

MASS, CENTRE = 60.0, np.array([0.1, 0.75])  # kg, m: base and arm together
FEET, FRICTION = np.array([[-0.4, 0.0], [0.4, 0.0]]), 0.6
ACCELERATION = np.array([-1.9, 0.0])  # m/s^2 of the centre of mass: the arm brakes
SCALE = 1.0 / 1300.0  # m per N


def forces() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weight, inertia force, forces of the feet (2, 2), N; friction in proportion to the normal forces."""
    weight, inertia = MASS * np.array([0.0, -9.81]), -MASS * ACCELERATION
    load = weight + inertia
    moment = (CENTRE[0] - FEET[0, 0]) * load[1] - CENTRE[1] * load[0]  # about the left foot
    right = -moment / (FEET[1, 0] - FEET[0, 0])
    normal = np.array([-load[1] - right, right])
    return weight, inertia, np.column_stack([-load[0] * normal / normal.sum(), normal])


def _arrow(
    ax: Axes, at: np.ndarray, force: np.ndarray, colour: str, name: str, shift: tuple[float, float]
) -> None:
    ax.annotate(
        "",
        at + force * SCALE,
        at,
        arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2.2, "shrinkA": 0, "shrinkB": 0},
    )
    ax.text(*(at + force * SCALE + shift), name, color=colour, ha="center", va="center", fontsize=12)


def draw(path: Path) -> None:
    """Write the picture."""
    mpl.rcParams.update({"svg.hashsalt": "free body", "svg.fonttype": "path", "mathtext.fontset": "cm"})
    figure = Figure(figsize=(7.2, 4.8))
    ax = figure.add_axes((0, 0, 1, 1))
    ax.set(xlim=(-1.05, 1.35), ylim=(-0.38, 1.35), aspect="equal")
    ax.axis("off")
    ax.plot([-0.95, 1.2], [0, 0], color="#404040", lw=1.5)
    ax.add_patch(Rectangle((-0.42, 0.08), 0.84, 0.45, fc="#e4e7eb", ec="#606870", lw=1.2))
    arm = np.array([[-0.1, 0.53], [-0.05, 1.0], [0.5, 1.15], [0.62, 0.95]])
    ax.plot(*arm.T, color="#7aa0c8", lw=9, solid_capstyle="round", solid_joinstyle="round")
    ax.plot(*arm[:3].T, "o", color="#2f5f8f", ms=7)
    ax.text(0.66, 0.88, "TCP", color="#2f5f8f", fontsize=10)
    weight, inertia, feet = forces()
    for foot, force, number in zip(FEET, feet, (1, 2), strict=True):
        ax.add_patch(Rectangle((foot[0] - 0.03, 0.0), 0.06, 0.08, fc="#404040"))
        reach = 0.33
        cone = foot + np.array([[0.0, 0.0], [FRICTION * reach, reach], [-FRICTION * reach, reach]])
        ax.add_patch(Polygon(cone, fc="#2e8b57", alpha=0.13, lw=0))
        _arrow(ax, foot, np.array([0.0, force[1]]), "#2e8b57", f"$f_{{n{number}}}$", (-0.09, -0.02))
        _arrow(ax, foot, np.array([force[0], 0.0]), "#c06a00", f"$f_{{t{number}}}$", (0.0, -0.08))
    _arrow(ax, CENTRE, weight, "#303030", "$m\\,g$", (-0.09, 0.06))
    _arrow(ax, CENTRE, inertia, "#b03060", "$-m\\,a$", (0.09, 0.05))
    ax.plot(*CENTRE, "o", color="#303030", ms=6)
    point = FEET[:, 0] @ feet[:, 1] / feet[:, 1].sum()
    ax.plot([CENTRE[0], point], [CENTRE[1], 0], color="#303030", lw=0.9, ls=(0, (4, 3)))
    ax.plot(point, 0, "D", color="#8040a0", ms=7, clip_on=False)
    ax.annotate(
        "zero-moment point",
        (point, -0.02),
        (0.05, -0.24),
        color="#8040a0",
        fontsize=10,
        ha="center",
        arrowprops={"arrowstyle": "-", "color": "#8040a0", "lw": 0.8},
    )
    ax.plot(*FEET[1], "o", color="#d02020", ms=8, mfc="none", mew=2)
    ax.text(0.86, -0.24, "tipping axis (into the page)", color="#d02020", fontsize=10, ha="center")
    ax.annotate(
        "",
        FEET[1] + [0.02, -0.03],
        (0.72, -0.2),
        arrowprops={"arrowstyle": "-", "color": "#d02020", "lw": 0.8},
    )
    ax.text(-0.82, 0.3, "friction cone", color="#2e8b57", fontsize=10, ha="center")
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    """Draw it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[2] / "docs", help="folder")
    draw(parser.parse_args().out / "free-body.svg")


if __name__ == "__main__":
    main()
