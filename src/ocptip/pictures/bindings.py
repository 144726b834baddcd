"""Figure of one kind of contact: the forces at which it can rest, and the automaton of its modes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ocptip.contact.bindings.automaton import Automaton
from ocptip.contact.bindings.binding import Binding
from ocptip.pictures.frame import new_figure
from ocptip.pictures.style import FOOT_FORCE, MEMBERS, head

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MODE_COLORS = {"stick": MEMBERS[0], "slide": MEMBERS[1], "separate": MEMBERS[2], "yield": MEMBERS[2]}
ROUNDS, STEP = 600, 0.02  # of the layout


def binding_figure(binding: Binding, largest: float) -> Figure:
    """The forces at rest, and the modes with their neighbours.

    An edge of the automaton joins two modes that differ in one variable: where one leaves the basis of the
    pivoting method, the other enters. Dashed: modes that only close the list and never hold.

    Args:
        binding: of any kind; planar ones have few enough modes to read their variables.
        largest: of the forces drawn, N.

    Returns:
        A figure of two panels.
    """
    figure = new_figure(9.5, 4.2)
    forces, modes = figure.subplots(1, 2, width_ratios=(1, 1.3))
    draw_forces(forces, binding, largest)
    draw_automaton(modes, binding)
    closed = f"{len(binding.automaton.names)} modes, {binding.automaton.closedness}ly closed"
    head(figure, f"{binding.kind}: {closed}")
    return figure


def draw_forces(ax: Any, binding: Binding, largest: float) -> None:
    """Draw the set of forces at rest, a union of convex pieces, over normal and tangential force, N."""
    for piece in binding.force_pieces():
        normal = np.clip([piece.normal_min, piece.normal_max], -largest, largest)
        across = np.maximum(piece.radius + piece.slope * normal, 0.0)
        ax.fill(
            np.concatenate([across, -across[::-1]]), np.concatenate([normal, normal[::-1]]),
            color=FOOT_FORCE.color, alpha=0.35, ec=FOOT_FORCE.color, lw=1.2,
        )  # fmt: skip
    ax.axhline(0.0, color="#808080", lw=0.8)
    ax.axvline(0.0, color="#808080", lw=0.8)
    ax.set_xlim(-largest, largest)
    ax.set_ylim(-largest, largest)
    ax.set_aspect("equal")
    ax.set_xlabel("tangential force [N]")
    ax.set_ylabel("normal force [N]")
    ax.set_title("forces at rest", fontsize=10)


def draw_automaton(ax: Any, binding: Binding) -> None:
    """Draw the modes as nodes, with the variables that may be positive, and the exchanges as edges."""
    automaton, names = binding.automaton, binding.columns.names
    places = _layout(automaton)
    for i, after in enumerate(automaton.successor):
        for j in after:
            ax.plot(*places[[i, j]].T, color="#b0b0b0", lw=1.0, zorder=1)
    for i, (name, place) in enumerate(zip(automaton.names, places, strict=True)):
        color = MODE_COLORS.get(name, "#707070")
        dash = "--" if automaton.redundant[i] else "-"
        ax.text(
            *place, " ".join(names[k] for k in automaton.subsets[i]), ha="center", va="center", fontsize=7,
            zorder=2, bbox={"boxstyle": "round,pad=0.3", "fc": "white", "ec": color, "lw": 1.4, "ls": dash},
        )  # fmt: skip
    for name in dict.fromkeys(automaton.names):
        ax.plot([], [], "s", mfc="white", mec=MODE_COLORS.get(name, "#707070"), label=name)
    ax.legend(frameon=False, fontsize=8, ncols=4, loc="upper center", bbox_to_anchor=(0.5, 0.0))
    ax.margins(0.16)
    ax.set_axis_off()
    ax.set_title("modes", fontsize=10)


def _layout(automaton: Automaton) -> np.ndarray:
    """(modes, 2) places: neighbours attract, all repel, from the slowest vibrations of the graph on."""
    count = len(automaton.names)
    joined = np.zeros((count, count))
    joined[np.repeat(np.arange(count), automaton.successor.shape[1]), automaton.successor.ravel()] = 1.0
    _, shapes = np.linalg.eigh(np.diag(joined.sum(axis=1)) - joined)
    rng = np.random.default_rng(0)  # what is symmetric would stay on a line
    places = shapes[:, 1:3] * np.sqrt(count) + rng.normal(0.0, 0.1, (count, 2))
    for _ in range(ROUNDS):
        away = places[:, None] - places
        distance = np.linalg.norm(away, axis=2) + np.eye(count)
        pull = joined * distance - (1 - np.eye(count)) / distance**2
        places = places - STEP * np.einsum("ij,ijk->ik", pull / distance, away)
    return places
