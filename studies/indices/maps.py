"""Maps of the performance indices of an arm: over two joint angles, position and height, two rotations.

    python -m studies.indices.maps OUT [--arm IRB2000] [--joints 2 3] [--fixed 0 0 0 0 60 0]
        [--approach down|forward] [--grid 101] [--ellipsoid 0.1 0.1 0.1]

In the joint plane the other joints stay as given. In the workspace the gripper moves in the vertical plane
through axis 1 (y = 0 of the base frame) with a fixed orientation; each point shows the best of all branches
of the inverse kinematics within the joint limits, for each index on its own; turning axis 1 changes no index
but 1/CDN. The gripper turned in place (rotation vector in the base's xy-plane) starts from the fixed joint
angles. Writes a figure, the arrays (.npz) and a summary (.json) of each map into the folder OUT. The default
joint plane is the published one.
"""

from __future__ import annotations

import argparse
import platform
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ocptip.basics.errors import InputError
from ocptip.basics.write import versions, write_json
from ocptip.indices.arms.axes import arm_pose
from ocptip.indices.arms.values import index_values
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.workspace_maps import index_maps, joint_solutions
from ocptip.published.arms import arm_by_name
from ocptip.robots.inverse.closed_form import closed_form_family
from ocptip.robots.kinematics import gripper_pose
from ocptip.robots.model import ArmModel
from studies.indices.designs.arm_design import joint_range, random_poses

INDICES = {
    "manipulability": "manipulability / largest here",
    "dm_inf": "DM_inf [rad]",
    "dm_2": "DM_2 [rad]",
    "pi_oe": "PI_OE",
    "inv_cdn_oe": "1/CDN_OE",
    "inv_cdn": "1/CDN (metres, base origin)",
}
APPROACHES = {
    "down": np.diag([1.0, -1.0, -1.0]),
    "forward": np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]),
}
LARGEST_ANGLE = 2.0  # rad, end of the colour scale of DM, which grows without bound at stationary points
LARGEST_TURN = np.pi / 2
REACH_SAMPLES = 4000
COARSE = 31


def joint_plane(
    model: ArmModel, joints: tuple[int, int], fixed: np.ndarray, grid: int, ellipsoid: OperationEllipsoid
) -> dict[str, np.ndarray]:
    """Indices (grid, grid) over two joint angles, rad; rows are the second joint. `joints` count from 1."""
    lower, upper = joint_range(model)
    first, second = (np.linspace(lower[k - 1], upper[k - 1], grid) for k in joints)
    q = np.tile(fixed, (grid * grid, 1))
    q[:, joints[0] - 1] = np.tile(first, grid)
    q[:, joints[1] - 1] = np.repeat(second, grid)
    values = index_values(model, q, ellipsoid=ellipsoid, names=INDICES)
    determinant = np.linalg.det(arm_pose(model, q).jacobian)
    maps = {name: value.reshape(grid, grid) for name, value in {**values, "det": determinant}.items()}
    return {"x": first, "y": second, **maps}


def workspace_slice(
    model: ArmModel, rotation: np.ndarray, grid: int, ellipsoid: OperationEllipsoid
) -> dict[str, np.ndarray]:
    """Best index of all branches, (grid, grid), over gripper positions x, z, m; NaN out of reach.

    `branches` is the number of branches within the joint limits.
    """
    xs, zs = (np.linspace(*ends, grid) for ends in reached_box(model, rotation))
    maps = {name: np.full((grid, grid), np.nan) for name in INDICES}
    maps["branches"] = np.zeros((grid, grid))
    for row, z in enumerate(zs):
        columns, q = reaching(model, xs, np.full(grid, z), rotation)
        maps["branches"][row] = np.bincount(columns, minlength=grid)
        if not len(q):
            continue
        for name, value in index_values(model, q, ellipsoid=ellipsoid, names=INDICES).items():
            np.fmax.at(maps[name][row], columns, value)
    return {"x": xs, "y": zs, **maps}


def reached_box(model: ArmModel, rotation: np.ndarray) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ranges of x and z, m, that hold the slice, by a coarse scan of what the arm reaches at all."""
    reached = gripper_pose(model, random_poses(model, REACH_SAMPLES, 0))[0]
    radius = np.hypot(reached[:, 0], reached[:, 1]).max()
    xs = np.linspace(-radius, radius, COARSE)
    zs = np.linspace(reached[:, 2].min(), reached[:, 2].max(), COARSE)
    inside = np.zeros((COARSE, COARSE), dtype=bool)
    inside.flat[reaching(model, np.tile(xs, COARSE), np.repeat(zs, COARSE), rotation)[0]] = True
    if not inside.any():
        raise InputError(f"--approach: {model.name} reaches no point of the slice with this orientation")
    return tuple(
        (float(values[found[0]] - 2 * step), float(values[found[-1]] + 2 * step))
        for values, found, step in (
            (xs, np.flatnonzero(inside.any(axis=0)), xs[1] - xs[0]),
            (zs, np.flatnonzero(inside.any(axis=1)), zs[1] - zs[0]),
        )
    )


def reaching(
    model: ArmModel, x: np.ndarray, z: np.ndarray, rotation: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """All branches within the limits: number (k,) of the point x, z (N,), m, and joint angles (k, 6), rad."""
    positions = np.column_stack([x, np.zeros(len(x)), z])
    return joint_solutions(model, positions, np.tile(rotation, (len(x), 1, 1)))


def turned_in_place(
    model: ArmModel, q: np.ndarray, grid: int, ellipsoid: OperationEllipsoid
) -> dict[str, np.ndarray]:
    """Best index of all branches, (grid, grid), over turns rx, ry, rad, from joint angles q (6,)."""
    ranges = dict.fromkeys(("rx", "ry"), (-LARGEST_TURN, LARGEST_TURN))
    found = index_maps(model, ranges, pose=q, names=INDICES, cells=grid, ellipsoid=ellipsoid)
    return {"x": found.values[0], "y": found.values[1], **{k: own.T for k, own in found.maps.items()}}


def summary(maps: dict[str, np.ndarray]) -> dict[str, Any]:
    """Extremes and means of all indices over the points of a map that are reached."""
    result = {}
    for name in INDICES:
        value = maps[name]
        reached = np.isfinite(value)
        row, column = np.unravel_index(np.nanargmax(value), value.shape)
        result[name] = {
            "min": float(np.nanmin(value)),
            "mean": float(value[reached].mean()),
            "max": float(np.nanmax(value)),
            "max_at": [float(maps["x"][column]), float(maps["y"][row])],
        }
    result["reached_share"] = float(np.isfinite(maps["pi_oe"]).mean())
    return result


def draw(maps: dict[str, np.ndarray], title: str, labels: tuple[str, str], degrees: bool, path: Path) -> None:
    """Six panels of level lines; white: singular poses, grey: out of reach."""
    wide = 1.0 if degrees else np.ptp(maps["x"]) / np.ptp(maps["y"])
    figure = Figure(figsize=(2.5 + 9.5 * wide**0.7, 7.6), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    x, y = (np.degrees(maps[k]) if degrees else maps[k] for k in "xy")
    for axes, (name, label) in zip(
        figure.subplots(2, 3, sharex=True, sharey=True).flat, INDICES.items(), strict=True
    ):
        value = maps[name]
        if name == "manipulability":
            value = value / np.nanmax(value)
        top = LARGEST_ANGLE if name.startswith("dm_") else float(np.nanmax(value))
        levels = np.linspace(0.0, top, 21)
        filled = axes.contourf(x, y, np.minimum(value, top), levels=levels, cmap="viridis")
        axes.contour(x, y, np.minimum(value, top), levels=levels[1::2], colors="k", linewidths=0.3)
        if "det" in maps:
            axes.contour(x, y, maps["det"], levels=[0.0], colors="w", linewidths=1.8)
        round_ones = MaxNLocator(5).tick_values(0.0, top)
        figure.colorbar(filled, ax=axes, ticks=round_ones[round_ones <= top], format="%.3g")
        axes.set_title(label, fontsize=10)
        axes.set_facecolor("0.85")
        if not degrees:
            axes.set_aspect("equal")
    for axes in figure.axes[:6]:
        axes.label_outer()
        if axes.get_subplotspec().is_last_row():
            axes.set_xlabel(labels[0])
        if axes.get_subplotspec().is_first_col():
            axes.set_ylabel(labels[1])
    figure.savefig(path, dpi=110)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", metavar="OUT", type=Path, help="folder for figures, arrays and summaries")
    parser.add_argument("--arm", default="IRB2000")
    parser.add_argument("--joints", type=int, nargs=2, default=(2, 3), help="joints of the plane, 1 to 6")
    parser.add_argument(
        "--fixed", type=float, nargs=6, default=(0, 0, 0, 0, 60, 0), help="other joints, degrees"
    )
    parser.add_argument(
        "--approach", choices=APPROACHES, default="down", help="gripper z in the workspace slice"
    )
    parser.add_argument("--grid", type=int, default=101)
    parser.add_argument("--ellipsoid", type=float, nargs=3, default=(0.1, 0.1, 0.1), help="half-axes, m")
    options = parser.parse_args(arguments)
    try:
        model = arm_by_name(options.arm)
        ellipsoid = OperationEllipsoid(np.zeros(3), half_axes=options.ellipsoid)
    except InputError as error:
        parser.error(str(error))
    first, second = options.joints
    if not (1 <= first <= 6 and 1 <= second <= 6 and first != second) or options.grid < 3:
        parser.error("--joints: two different ones of 1 to 6; --grid: at least 3")
    if closed_form_family(model) is None:
        parser.error(f"--arm: {model.name} has no inverse kinematics in closed form")
    options.out.mkdir(parents=True, exist_ok=True)

    begin = time.perf_counter()
    plane = joint_plane(model, (first, second), np.radians(options.fixed), options.grid, ellipsoid)
    between = time.perf_counter()
    try:
        space = workspace_slice(model, APPROACHES[options.approach], options.grid, ellipsoid)
    except InputError as error:
        parser.error(str(error))
    ended = time.perf_counter()
    turned = turned_in_place(model, np.radians(options.fixed), options.grid, ellipsoid)
    seconds = {"joint_plane": between - begin, "workspace": ended - between}
    seconds["turned"] = time.perf_counter() - ended
    fixed = ", ".join(
        f"joint {k + 1} at {a:g}°" for k, a in enumerate(options.fixed) if k + 1 not in options.joints
    )
    draw(
        plane,
        f"{model.name}: {fixed}; white: singular",
        (f"joint {first} [deg]", f"joint {second} [deg]"),
        True,
        options.out / "index_maps_joint_plane.png",
    )
    draw(
        space,
        f"{model.name}: gripper pointing {options.approach}, best branch; grey: out of reach",
        ("x [m]", "z [m]"),
        False,
        options.out / "index_maps_workspace.png",
    )
    angles = ", ".join(f"{angle:g}" for angle in options.fixed)
    draw(
        turned,
        f"{model.name}: gripper turned in place from joint angles {angles}°, best branch; grey: out of reach",
        ("rx [deg]", "ry [deg]"),
        True,
        options.out / "index_maps_turned.png",
    )
    kinds = {"joint_plane": plane, "workspace": space, "turned": turned}
    for name, maps in kinds.items():
        np.savez_compressed(options.out / f"index_maps_{name}.npz", **maps)
    record = {
        "arm": model.name,
        "grid": options.grid,
        "ellipsoid": list(options.ellipsoid),
        "joints": list(options.joints),
        "fixed_deg": list(options.fixed),
        "approach": options.approach,
        "joint_plane": summary(plane),
        "workspace": summary(space),
        "turned": summary(turned),
        "seconds": seconds,
        "machine": platform.machine(),
        "versions": versions(("numpy", "casadi")),
    }
    write_json(options.out / "index_maps.json", record)
    for name in kinds:
        print(f"{name}: {seconds[name]:.1f} s")
        for index, row in record[name].items():
            if index != "reached_share":
                print(f"  {index:<15} {row['min']:.4g} .. {row['max']:.4g}, mean {row['mean']:.4g}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
