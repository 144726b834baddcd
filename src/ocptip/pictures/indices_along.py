"""Indices along a motion, one panel each."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ocptip.basics.write import atomic_file
from ocptip.pictures.frame import COLORS, new_figure


def save_indices(
    robot: str, times: np.ndarray, values: Mapping[str, np.ndarray], path: str | os.PathLike[str]
) -> Path:
    """Draw indices (N,) over times (N,), s, least values marked, into a .png, .pdf or .svg."""
    path = Path(path)
    figure = new_figure(7.5, 1.6 * len(values) + 0.6)
    for ax, (name, own) in zip(
        figure.subplots(len(values), 1, sharex=True, squeeze=False)[:, 0], values.items(), strict=True
    ):
        ax.plot(times, own, color=COLORS[0])
        if np.isfinite(own).any():
            least = int(np.nanargmin(own))
            ax.plot(times[least], own[least], "o", color=COLORS[1])
        ax.set_ylim(bottom=0.0)
        ax.set_ylabel(name)
        ax.set_xlabel("time [s]" if ax.get_subplotspec().is_last_row() else "")
    figure.suptitle(robot)
    with atomic_file(path) as file:
        figure.savefig(file, format=path.suffix[1:], dpi=120)
    return path
