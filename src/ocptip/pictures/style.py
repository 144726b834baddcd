"""One style for all figures: colours, line styles, labels with units, legends of what is drawn.

A quantity has one colour in every figure; joints, contacts and other numbered things have those of `MEMBERS`.
Solid lines are nominal, dashed ones the worst case of the uncertainty, dash-dotted dark red ones a limit,
dotted ones something to compare with.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

LIMIT_COLOR, NOTE, GRID, EVENT, SHADE = "#8b0000", "#606060", "#ececec", "#d9d9d9", "#f4f7fb"


@dataclass(frozen=True)
class Quantity:
    """A quantity of figures.

    Attributes:
        name: on its axis.
        unit: that is drawn.
        color: of its lines, in all figures.
        scale: from SI to the unit.
    """

    name: str
    unit: str
    color: str
    scale: float = 1.0

    @property
    def label(self) -> str:
        """Label of an axis: name and unit."""
        return f"{self.name} [{self.unit}]"


# Okabe and Ito's palette, told apart with any colour vision.
TIPPING = Quantity("tipping margin", "N m", "#0072b2")
FRICTION = Quantity("friction used", "%", "#d55e00", 100.0)
FOOT_FORCE = Quantity("normal force", "N", "#009e73")
TORQUE = Quantity("torque / limit", "%", "#cc79a7", 100.0)
CLEARANCE = Quantity("clearance", "mm", "#56b4e9", 1e3)
POWER = Quantity("electric power", "W", "#e69f00")
ENERGY = Quantity("electric energy", "J", "#7f5500")
SPEED = Quantity("speed / limit", "%", "#5f7f00", 100.0)
TCP_SPEED = Quantity("TCP speed", "m/s", "#000000")
ACCELERATION = Quantity("acceleration / limit", "%", "#7f7f7f", 100.0)
PAYLOAD = Quantity("further payload", "kg", "#4d4d4d")
QUANTITIES = (
    TIPPING, FRICTION, FOOT_FORCE, TORQUE, CLEARANCE, POWER, ENERGY, SPEED, TCP_SPEED, ACCELERATION, PAYLOAD,
)  # fmt: skip

LOAD, LOAD_MOMENT = "#6a3d9a", "#b07cc6"  # forces and moments that act on the robot
BROKEN = "#8b0000"  # of titles that say that something does not hold

# Tol's muted palette, which has no colour of a quantity in it.
MEMBERS = ("#332288", "#cc6677", "#117733", "#88ccee", "#882255", "#ddaa33", "#44aa99")
DASHES = ("-", (0, (5, 1.2)), (0, (1.2, 1.2)))  # beyond seven joints or contacts

NOMINAL = {"ls": "-", "lw": 1.7}
WORST_CASE = {"ls": (0, (4, 1.6)), "lw": 1.5}
REFERENCE = {"ls": (0, (1, 1.4)), "lw": 1.5}
LIMIT = {"ls": (0, (7, 2, 1.2, 2)), "lw": 1.4, "color": LIMIT_COLOR}
RING = {"marker": "o", "ms": 8, "mfc": "none", "mew": 1.8, "ls": "", "zorder": 6, "clip_on": False}
DIAMOND = {**RING, "marker": "D", "ms": 7}

TEXT = {"fontsize": 8.5}
_WRAPPED, _WRAPPED_NOTE = 8.6, 14.0  # characters of a line of a title, a note, per inch of the figure


def member(number: int) -> dict[str, Any]:
    """Colour and line style of the joint or contact of this number, from 0."""
    return {"color": MEMBERS[number % len(MEMBERS)], "ls": DASHES[number // len(MEMBERS) % len(DASHES)]}


def finish(ax: Any, title: str, label: str, across: str = "") -> None:
    """Title, labels with units, grid, and beside the panel a legend of what is drawn."""
    ax.set_title(title, loc="left", fontsize=10.5, y=1.0)  # given, or Matplotlib measures labels to find it
    ax.set_ylabel(label)
    if across:
        ax.set_xlabel(across)
    ax.grid(axis="y", color=GRID, lw=0.8)
    ax.set_axisbelow(True)
    handles, labels = ax.get_legend_handles_labels()
    if labels:
        beside = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.02), "borderaxespad": 0.4}
        ax.legend(handles, labels, frameon=False, handlelength=2.2, **beside, **TEXT)


def head(figure: Any, title: str, below: str = "", color: str = "black") -> None:
    """The title of a figure, and in a second line the verdict, or what else all of it is about."""
    wide = int(_WRAPPED * figure.get_figwidth())
    lines = [*textwrap.wrap(title, wide), *textwrap.wrap(below, wide)]
    figure.suptitle("\n".join(lines), fontsize=12.5, fontweight="bold", color=color)


def note(figure: Any, text: str) -> None:
    """Text below all panels: what lines mean that no legend names."""
    lines = textwrap.wrap(text, int(_WRAPPED_NOTE * figure.get_figwidth()))
    figure.supxlabel("\n".join(lines), fontsize=8.5, color=NOTE)


def mark_events(ax: Any, times: Iterable[float]) -> None:
    """Faint vertical lines; they have no legend, `note` names them."""
    from matplotlib.collections import LineCollection

    lines = LineCollection(
        [[(time, 0.0), (time, 1.0)] for time in times],
        transform=ax.get_xaxis_transform(), color=EVENT, lw=0.8, zorder=0, gid="events",
    )  # fmt: skip
    ax.add_collection(lines, autolim=False)


def mark_segments(ax: Any, segments: Iterable[tuple[float, float, str]]) -> None:
    """Shade the motions of a cycle on a time axis, and name them: begin and end, s, and name of each."""
    for begin, end, name in segments:
        ax.axvspan(begin, end, color=SHADE, zorder=-1, lw=0)
        placing = {"xy": (begin, 0.0), "xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
        ax.annotate(name, xytext=(2, 3), fontsize=7, color="#404040", annotation_clip=False, **placing)
