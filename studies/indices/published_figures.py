"""Figures of the theses whose drawings are lost: [Naw07] 4.2 and 6.3 to 6.7, thesis M 6.7.

    python -m studies.indices.published_figures --out FOLDER [--grid 81]

Writes published_power_map.png: electric power of drive 1 over load torque and speed (thesis M, table 6.1);
published_gradient_field.png: manipulability of the IRB 2000 over joints 2 and 3 with joint 5 at 90
degrees, its steepest descent, singular poses, the stationary pose and its directions of principal curvature;
and published_design_maps.png: five indices of flight-simulator platforms over alpha and h.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.optimize import root

from ocptip.indices.arms.axes import arm_pose
from ocptip.indices.arms.distance import Curvatures, singularity_distance, stationary_curvatures
from ocptip.indices.platforms.controllability import control_number
from ocptip.indices.platforms.reviewed import best_complex, manipulability
from ocptip.published.arms import irb_2000, load_arm, modular_motors
from studies.indices.designs.flight_simulator import LARGEST_ALPHA, FlightSimulator

NEAR = (0.9, -0.2)  # rad, printed to five digits
TITLES = {
    "volume": "|det J| (figure 6.3)",
    "relative": "|det J| / largest of this alpha (6.4)",
    "sigma_r": "sigma_R (6.5)",
    "sigma_s": "sigma_S (6.6)",
    "ctn": "CTN (6.7)",
}


def poses(theta_2: np.ndarray, theta_3: np.ndarray) -> np.ndarray:
    """Joint angles (..., 6), rad, at theta_5 = 90 degrees; joints 1, 4 and 6 do not matter."""
    q = np.zeros((*np.broadcast(theta_2, theta_3).shape, 6))
    q[..., 1], q[..., 2], q[..., 4] = theta_2, theta_3, np.pi / 2
    return q


def descent(theta_2: np.ndarray, theta_3: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """det J (...), m^3, and minus the gradient (..., 2) of |det J|, m^3/rad, over joints 2 and 3."""
    q = poses(theta_2, theta_3)
    distance = singularity_distance(arm_pose(irb_2000(), q.reshape(-1, 6)).jacobian)
    downhill = -np.sign(distance.determinant)[:, None] * distance.gradient[:, :2]
    return distance.determinant.reshape(q.shape[:-1]), downhill.reshape(*q.shape[:-1], 2)


def stationary_pose() -> tuple[np.ndarray, Curvatures]:
    """Angles (2,), rad, of joints 2 and 3 where the gradient is 0, and the principal curvatures there."""
    angles = root(lambda at: descent(*at)[1], NEAR, tol=1e-13).x
    return angles, stationary_curvatures(arm_pose(irb_2000(), poses(*angles)).jacobian)


def design_maps(alphas: np.ndarray, heights: np.ndarray) -> dict[str, np.ndarray]:
    """Indices (heights, alphas) of the middle poses, by the names of `TITLES`."""
    maps = {name: np.empty((len(heights), len(alphas))) for name in TITLES}
    for column, alpha in enumerate(alphas):
        for row, height in enumerate(heights):
            design = FlightSimulator(float(alpha), float(height))
            pose = design.platform.at(design.position)
            complexes = best_complex(pose)
            maps["volume"][row, column] = manipulability(pose)
            maps["sigma_r"][row, column], maps["sigma_s"][row, column] = complexes.sigma_r, complexes.sigma_s
            maps["ctn"][row, column] = control_number(pose).value
    maps["relative"] = maps["volume"] / maps["volume"].max(axis=0)
    return maps


def draw_field(path: Path, grid: int) -> None:
    """Write the figure of the gradient field."""
    model = irb_2000()
    low, high = model.limits.angle_min[1:3], model.limits.angle_max[1:3]
    theta_2, theta_3 = np.meshgrid(*(np.linspace(*ends, grid) for ends in zip(low, high, strict=True)))
    determinant, _ = descent(theta_2, theta_3)
    figure = Figure(figsize=(9, 5.4), layout="constrained")
    axes = FigureCanvasAgg(figure).figure.add_subplot()
    x, y = np.degrees(theta_2), np.degrees(theta_3)
    filled = axes.contourf(x, y, np.abs(determinant), levels=15, cmap="viridis", alpha=0.7)
    axes.contour(x, y, determinant, levels=[0.0], colors="w", linewidths=2.5)
    few = (slice(None, None, max(1, grid // 20)),) * 2
    down = descent(theta_2[few], theta_3[few])[1]
    down /= np.linalg.norm(down, axis=-1, keepdims=True)
    axes.quiver(x[few], y[few], down[..., 0], down[..., 1], angles="xy", width=0.0018, color="0.15")
    angles, curvatures = stationary_pose()
    at = np.degrees(angles)
    for value, direction in zip(curvatures.values, curvatures.directions, strict=True):
        if abs(direction[3]) < 0.5:  # the third one is that of joint 5
            ends = at + 14.0 * np.array([[-1.0], [1.0]]) * direction[:2]
            axes.plot(*ends.T, lw=2, label=f"curvature {value:.4g} m³/rad²")
    axes.plot(*at, "o", color="k", ms=5)
    axes.set(xlabel="joint 2 [deg]", ylabel="joint 3 [deg]", aspect="equal")
    axes.set_title(
        "IRB 2000, joint 5 at 90°: steepest descent of the manipulability; white: singular", fontsize=10
    )
    axes.legend(loc="lower left", fontsize=8)
    figure.colorbar(filled, ax=axes, label="|det J| [m³]")
    figure.savefig(path, dpi=110)


def power_map(grid: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Load torques (grid,), N m, speeds (2 grid,), rad/s, not 0, and powers (2 grid, grid), W, of drive 1."""
    limits = load_arm("FP1W2F").limits
    loads, half = limits.torque[0] * np.linspace(-1, 1, grid), limits.speed[0] * np.linspace(1e-9, 1, grid)
    speeds = np.concatenate([-half[::-1], half])
    torques, rates = np.zeros((2, 2 * grid, grid, 6))
    torques[..., 0], rates[..., 0] = -loads, speeds[:, None]  # the drive holds against the load
    powers = modular_motors().power(torques.reshape(-1, 6), rates.reshape(-1, 6))[:, 0]
    return loads, speeds, powers.reshape(2 * grid, grid)


def draw_power(path: Path, grid: int) -> None:
    """Write the figure of the power map."""
    loads, speeds, powers = power_map(grid)
    figure = Figure(figsize=(7.2, 5), layout="constrained")
    axes = FigureCanvasAgg(figure).figure.add_subplot()
    filled = axes.contourf(loads, np.degrees(speeds), powers, levels=20, cmap="viridis")
    axes.contour(loads, np.degrees(speeds), powers, levels=[0.0], colors="r", linewidths=1.5)
    axes.axhline(0.0, color="w", lw=1.5)
    axes.set(xlabel="load torque [N m]", ylabel="joint speed [deg/s]")
    axes.set_title(
        "Electric power of drive 1; inside the red corners it feeds back; white: step at rest", fontsize=9
    )
    figure.colorbar(filled, ax=axes, label="W")
    figure.savefig(path, dpi=100)


def draw_designs(path: Path, grid: int) -> None:
    """Write the figure of the maps over design and height."""
    alphas, heights = np.linspace(0.0, 0.98 * LARGEST_ALPHA, grid), np.linspace(0.02, 1.0, grid)
    figure = Figure(figsize=(16, 3.8), layout="constrained")
    FigureCanvasAgg(figure)
    best = FlightSimulator.optimal()
    panels = figure.subplots(1, len(TITLES), sharex=True, sharey=True)
    for axes, (name, values) in zip(panels, design_maps(alphas, heights).items(), strict=True):
        filled = axes.contourf(np.degrees(alphas), heights, values, levels=15, cmap="viridis")
        axes.plot(np.degrees(best.alpha), best.height, "r+", ms=10)
        axes.set_title(TITLES[name], fontsize=10)
        axes.set_xlabel("alpha [deg]")
        figure.colorbar(filled, ax=axes, format="%.3g")
    panels[0].set_ylabel("h / radius")
    figure.suptitle("Flight simulators in the middle pose; cross: largest control number", fontsize=11)
    figure.savefig(path, dpi=100)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for the figures")
    parser.add_argument("--grid", type=int, default=81, help="points along each axis")
    options = parser.parse_args(argv)
    if options.grid < 3:
        parser.error("--grid: at least 3")
    options.out.mkdir(parents=True, exist_ok=True)
    draw_power(options.out / "published_power_map.png", options.grid)
    draw_field(options.out / "published_gradient_field.png", options.grid)
    draw_designs(options.out / "published_design_maps.png", options.grid)
    angles, curvatures = stationary_pose()
    print("stationary pose, rad:", np.round(angles, 5), "curvatures, m^3/rad^2:", curvatures.values)
    return 0


if __name__ == "__main__":
    sys.exit(main())
