"""Moving pictures of [Naw07] 4.6, 7.2 and 7.3, whose programs were on a CD that is lost.

    python -m studies.indices.animations --out FOLDER [--grid 61] [--frames 10]

Writes published_indices.gif: level lines of three indices of the IRB 2000 over joints 2 and 3 while joint 5
goes from 60 degrees to 0; published_rpr.gif: planar RPR robots with CTN = 1 over the leg length r, with their
singular positions for some orientations; and published_platform.gif: the platform K_M as it turns about a
horizontal axis, with the conic of its singular positions seen from above. Where all positions are singular
there is none: at 90 degrees.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from ocptip.indices.arms.axes import arm_pose
from ocptip.indices.arms.distance import singularity_distance
from ocptip.indices.platforms.platform import PlatformPose
from ocptip.published.arms import irb_2000
from studies.indices.designs.optimal_planar import LARGEST_R, optimal_planar_pose
from studies.indices.designs.optimal_platforms import example_main
from studies.indices.published_figures import poses

INDICES = {"MPB": "|det J|, m³", "DM_inf": "DM_inf, deg", "DM_2": "DM_2, deg"}
TURNS = (-60.0, -30.0, 0.0, 30.0, 60.0)  # degrees, of the platform of an RPR robot


def indices(theta_2: np.ndarray, theta_3: np.ndarray, theta_5: float) -> dict[str, np.ndarray]:
    """The three indices (...) of the IRB 2000; angles in rad, distances in degrees."""
    q = poses(theta_2, theta_3)
    q[..., 4] = theta_5
    found = singularity_distance(arm_pose(irb_2000(), q.reshape(-1, 6)).jacobian)
    values = np.abs(found.determinant), np.degrees(found.dm_inf), np.degrees(found.dm_2)
    return {name: one.reshape(q.shape[:-1]) for name, one in zip(INDICES, values, strict=True)}


def planar_determinant(
    base: np.ndarray, platform: np.ndarray, x: np.ndarray, y: np.ndarray, turn: float
) -> np.ndarray:
    """det J times all leg lengths of a planar RPR robot, moved by (x, y) and turned about the middle, rad."""
    c, s = np.cos(turn), np.sin(turn)
    at = platform @ np.array([[c, s], [-s, c]])
    legs = np.stack([at[:, 0] + x[..., None] - base[:, 0], at[:, 1] + y[..., None] - base[:, 1]], axis=-1)
    moments = base[:, 0] * legs[..., 1] - base[:, 1] * legs[..., 0]
    return np.linalg.det(np.concatenate([moments[..., None], legs], axis=-1))


def platform_determinant(x: np.ndarray, y: np.ndarray, angle: float, axis: float = 0.0) -> np.ndarray:
    """det J times all leg lengths of K_M, moved by (x, y) and turned by an angle, rad.

    The axis is horizontal, `axis` rad from the x axis.
    """
    base, platform = moved_platform(0.0, 0.0, angle, axis)
    found = np.empty(np.shape(x))
    for at in np.ndindex(found.shape):
        pose = PlatformPose(base, platform + np.array([x[at], y[at], 0.0]))
        found[at] = np.linalg.det(pose.jacobian) * np.prod(pose.lengths)
    return found


def moved_platform(x: float, y: float, angle: float, axis: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Base and platform anchors (6, 3) of K_M; as [Naw07] has them, the base is the smaller one."""
    pose = example_main().pose
    middle = pose.base.mean(axis=0)
    turned = Rotation.from_rotvec(angle * np.array([np.cos(axis), np.sin(axis), 0.0])).apply(
        pose.base - middle
    )
    return pose.platform, turned + middle + [x, y, 0.0]


def save(
    path: Path, size: tuple[float, float], panels: int, draw: Callable[..., None], frames: Iterable
) -> None:
    """Write a moving picture; `draw` gets the panels and what a frame is of."""
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, panels, squeeze=False)[0]

    def frame(what: Any) -> list:
        for one in axes:
            one.clear()
        draw(axes, what)
        return []

    FuncAnimation(figure, frame, list(frames), blit=False).save(path, PillowWriter(fps=4), dpi=60)


def draw_indices(grid: int) -> Callable[..., None]:
    """Level lines of the three indices; the singular poses are those of joints 2 and 3."""
    low, high = irb_2000().limits.angle_min[1:3], irb_2000().limits.angle_max[1:3]
    theta_2, theta_3 = np.meshgrid(*(np.linspace(*ends, grid) for ends in zip(low, high, strict=True)))
    levels = {
        "MPB": np.linspace(0.0, 0.35, 15),
        "DM_inf": np.linspace(0.0, 40.0, 17),
        "DM_2": np.linspace(0.0, 60.0, 17),
    }

    def draw(axes: Sequence[Any], degrees: float) -> None:
        for one, (name, values) in zip(
            axes, indices(theta_2, theta_3, np.radians(degrees)).items(), strict=True
        ):
            one.contour(np.degrees(theta_2), np.degrees(theta_3), values, levels=levels[name], cmap="viridis")
            one.set_title(f"{INDICES[name]}, joint 5 at {degrees:.0f} deg", fontsize=10)
            one.set(xlabel="joint 2, deg", ylabel="joint 3, deg")

    return draw


def draw_robots(grid: int) -> Callable[..., None]:
    """A planar robot of each branch with its singular positions."""
    x, y = np.meshgrid(*2 * [np.linspace(-3.0, 3.0, grid)])

    def draw(axes: Sequence[Any], r: float) -> None:
        for one, branch in zip(axes, ("-", "+"), strict=True):
            pose = optimal_planar_pose(r, branch)
            for number, turn in enumerate(TURNS):
                values = planar_determinant(pose.base, pose.platform, x, y, np.radians(turn))
                one.contour(x, y, values, levels=[0.0], colors=[f"C{number}"], linewidths=1.2)
                one.plot([], [], color=f"C{number}", label=f"{turn:g} deg")
            for a, b in zip(pose.base, pose.platform, strict=True):
                one.plot(*np.transpose([a, b]), "k-o", ms=3)
            one.fill(*pose.platform.T, color="0.8")
            one.set(aspect="equal", xlim=(-3, 3), ylim=(-3, 3))
            one.set_title(f"branch {branch}, leg length {r:.2f}", fontsize=10)
        axes[-1].legend(title="turned by, singular", fontsize=7, title_fontsize=7, loc="upper right")

    return draw


def draw_platform(grid: int) -> Callable[..., None]:
    """K_M from above, and the conic on which its middle makes it singular."""
    x, y = np.meshgrid(*2 * [np.linspace(-3.0, 3.0, grid)])

    def draw(axes: Sequence[Any], degrees: float) -> None:
        base, platform = moved_platform(0.0, 0.0, np.radians(degrees))
        values = platform_determinant(x, y, np.radians(degrees))
        axes[0].contour(x, y, values, levels=[0.0], colors="r")
        for a, b in zip(base, platform, strict=True):
            axes[0].plot([a[0], b[0]], [a[1], b[1]], "k-", lw=1)
        axes[0].plot(*base[:, :2].T, "ks", ms=4)
        axes[0].plot(*platform[:, :2].T, "bo", ms=4)
        axes[0].plot(0.0, 0.0, "r+", ms=8)
        axes[0].set(aspect="equal", xlim=(-3, 3), ylim=(-3, 3))
        axes[0].set_title(f"K_M turned by {degrees:.0f} deg: singular positions", fontsize=9)

    return draw


def main(arguments: Sequence[str] | None = None) -> int:
    """Write them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for the pictures")
    parser.add_argument("--grid", type=int, default=61, help="points along each axis")
    parser.add_argument("--frames", type=int, default=10, help="of each picture")
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    count, grid = options.frames, options.grid
    radii = np.linspace(2 / 3 * np.sqrt(6) * 1.001, LARGEST_R * 0.999, count)  # both branches exist
    save(
        options.out / "published_indices.gif", (12, 3.2), 3, draw_indices(grid), np.linspace(60.0, 1.0, count)
    )
    save(options.out / "published_rpr.gif", (9, 4.5), 2, draw_robots(grid), radii)
    angles = np.linspace(0.0, 89.0, count)
    save(options.out / "published_platform.gif", (4.5, 4.5), 1, draw_platform(max(9, grid // 3)), angles)
    return 0


if __name__ == "__main__":
    sys.exit(main())
