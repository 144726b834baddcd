"""Figure of a drive envelope: the largest acceleration of a base by direction."""

from __future__ import annotations

from typing import Any

import numpy as np

from ocptip.pictures import style
from ocptip.pictures.frame import new_figure, png
from ocptip.standing.drive_envelope import LARGEST, LargestManoeuvres

_WHEELS = {"color": "black", "ms": 4, "label": "wheels"}
_WIDEST = 1.6  # times the median limit: what lies farther out is not drawn


def envelope_picture(
    name: str,
    scope: str,
    angles: np.ndarray,
    nominal: LargestManoeuvres,
    within: LargestManoeuvres | None,
    feet: np.ndarray,
) -> bytes:
    """Draw a PNG with the tip and the slip limit around the base, nominal and in the worst case.

    Args:
        name, scope: for the title.
        angles: (D,) rad, directions of the first D results.
        nominal, within: results.
        feet: (n, 3), m: the contacts.
    """
    figure = new_figure(6.6, 6.2)
    ax: Any = figure.add_subplot(projection="polar")
    ax.set_theta_zero_location("N")  # forward is up, as from above
    count, around = len(angles), np.append(angles, angles[0])
    known = [own.largest[:count] for own in (nominal, within) if own is not None]
    top = _WIDEST * float(np.median(np.minimum(known[0], LARGEST))) or 1.0
    cases = [("nominal", nominal, style.NOMINAL)]
    if within is not None:
        cases.append(("worst case", within, style.WORST_CASE))
    for title, own, line in cases:
        slips = np.where(own.slip < own.tip, own.slip, np.nan)[:count]
        for word, values, color in (
            ("the base tips", own.tip[:count], style.TIPPING.color),
            ("wheels slide", slips, style.FRICTION.color),
        ):
            drawn = np.where(values < LARGEST, values, np.nan)
            if np.isfinite(drawn).any():
                label = f"{word}, {title}"
                ax.plot(around, np.append(drawn, drawn[0]), color=color, label=label, **line)
    least = known[-1]
    ax.fill(around, np.append(least, least[0]), color=style.SHADE, zorder=0, gid="envelope")
    places = feet[:, :2] - feet[:, :2].mean(axis=0)
    shown = 0.25 * top * places / max(float(np.hypot(*places.T).max()), 1e-9)
    ax.plot(np.arctan2(shown[:, 1], shown[:, 0]), np.hypot(*shown.T), "s", **_WHEELS)
    ax.set_ylim(0.0, top)
    ax.tick_params(labelsize=8, labelcolor=style.NOTE)
    ax.legend(frameon=False, loc="upper left", bbox_to_anchor=(-0.18, 0.06), **style.TEXT)
    style.head(figure, f"{name}: drive envelope", scope)
    style.note(figure, "largest acceleration of the base [m/s^2] by direction; up: forward (x axis)")
    return png(figure)
