"""The source's observations about its plans (5.9): durations, and heights of the centre of mass."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ocptip.robots.kinematics import link_frames
from ocptip.robots.model import ArmModel
from ocptip.trajectories.trajectory import Trajectory
from studies.time_scaling.losses import cells

DURATION_TRENDS = {
    "large": (
        "Without clamp, motions on the large triangle take less time than on the small one.",
        (("A", "B"), ("D", "E"), ("G", "H")),
    ),
    "clamp": (
        "On the small triangle, motions take less time with the clamp than without.",
        (("C", "B"), ("F", "E")),
    ),
    "arm": (
        "FP1W2F takes less time than the other arms.",
        (("A", "D"), ("A", "G"), ("B", "E"), ("B", "H"), ("C", "F")),
    ),
}
"""Statements of 5.9 about durations, each with pairs of cases: the first takes less time than the second."""
SHORTER = 0.01  # share by which a duration has to be shorter
HEIGHT_TRENDS = {
    "raised": ("On the small triangle the arm is raised during the motion.", "BCEFH"),
    "lowered": ("In case A it is lowered, which lends potential energy to the motion.", "A"),
    "level": ("In cases D and G it is neither raised nor lowered.", "DG"),
}
CHANGED = 0.010  # m, by which the centre of mass has to be raised or lowered


def heights(arm: ArmModel, motion: Trajectory, joint: int) -> dict:
    """How far a motion raises and lowers the arm, against the straight line of its joint angles.

    Compared is the height at the same angle of joint 1, about which the arm turns from start to goal: of the
    centre of mass of the arm, and of the end of the link that `joint` (from 1) turns. z points up.

    Returns:
        raised_m, lowered_m: largest heights above and below the straight line, centre of mass, >= 0.
        raised_at, lowered_at: when, as shares of the duration.
        link_raised_m, link_lowered_m: end of the link.
        lowered_J: potential energy of `lowered_m`.
    """
    times = cells(motion)[0]
    q = motion.states(times)[0]
    way = motion.goal - motion.start
    share = np.clip((q[:, 0] - motion.start[0]) / way[0], 0, 1)
    straight = motion.start + share[:, None] * way
    mass, link = (
        a - b for a, b in zip(arm_heights(arm, q, joint), arm_heights(arm, straight, joint), strict=True)
    )
    return {
        "raised_m": float(max(0.0, mass.max())),
        "raised_at": float(times[np.argmax(mass)] / motion.end),
        "lowered_m": float(max(0.0, -mass.min())),
        "lowered_at": float(times[np.argmin(mass)] / motion.end),
        "lowered_J": float(np.sum(arm.masses) * 9.81 * max(0.0, -mass.min())),
        "link_raised_m": float(max(0.0, link.max())),
        "link_lowered_m": float(max(0.0, -link.min())),
    }


def arm_heights(arm: ArmModel, q: np.ndarray, joint: int) -> tuple[np.ndarray, np.ndarray]:
    """Heights (N,), m, base axes: of the arm's centre of mass; of the end of the link that `joint` turns."""
    frames, n = link_frames(arm, q), arm.n
    centres = frames.origins[:, :n] + np.einsum("tkij,kj->tki", frames.rotations[:, :n], arm.centres)
    return centres[:, :, 2] @ arm.masses / np.sum(arm.masses), frames.origins[:, joint, 2]


def trends(rows: Sequence[dict]) -> list[dict]:
    """The statements of 5.9, each for our plans on either base and for the printed motions.

    `found`, `not_found`: pairs of cases, or cases; the others are missing among the rows.
    """
    found = []
    for source in sources(rows):
        mine = {r["case"]: r for r in rows if (r["motion"], r["base"]) == source}
        label = {"motion": source[0], "base": source[1] if source[0] == "ours" else None}
        for key, (text, pairs) in DURATION_TRENDS.items():
            ratios = {
                f"{a}<{b}": mine[a]["duration_s"] / mine[b]["duration_s"]
                for a, b in pairs
                if a in mine and b in mine
            }
            found.append(_trend(key, text, label, ratios, lambda ratio: ratio < 1 - SHORTER))
        for key, (text, cases) in HEIGHT_TRENDS.items():
            values = {c: (mine[c]["raised_m"], mine[c]["lowered_m"]) for c in cases if c in mine}
            found.append(_trend(key, text, label, values, HOLDS[key]))
    return found


HOLDS: dict[str, Callable[[tuple[float, float]], bool]] = {
    "raised": lambda v: v[0] >= CHANGED and v[0] > v[1],
    "lowered": lambda v: v[1] >= CHANGED and v[1] > v[0],
    "level": lambda v: max(v) < CHANGED,
}
"""By trend, whether (raised, lowered), m, are what it says."""


def sources(rows: Sequence[dict]) -> list[tuple[str, str]]:
    """Motion and base of what the trends are about; the printed motions are the same on either base."""
    known = {(r["motion"], r["base"]): None for r in rows}
    printed = next(iter(key for key in known if key[0] == "printed"), None)
    return [key for key in known if key[0] == "ours" or key == printed]


def _trend(key: str, text: str, label: dict, values: dict, holds: Callable[..., bool]) -> dict:
    return {
        "trend": key,
        "text": text,
        **label,
        "values": values,
        "found": [name for name, value in values.items() if holds(value)],
        "not_found": [name for name, value in values.items() if not holds(value)],
    }
