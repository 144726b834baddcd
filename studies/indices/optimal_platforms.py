"""Optimal Stewart-Gough platforms: members of the isotropic and of the CTN = 1 families, drawn and checked.

    python -m studies.indices.optimal_platforms --out FOLDER [--members 300] [--starts 60] [--poses 2000]
        [--seed 0]

Writes optimal_platforms.png (six members, the domain of the main family, the planar optimum, control numbers
around two platforms), optimal_platforms_moved.png (control numbers over height and rotations),
optimal_platforms.json and optimal_platforms.md: random members of all families with the worst deviation from
1, the search for further families, and the control number of four designs over the same workspace (positions
within a quarter of the mean leg length, rotations up to 20 degrees).
"""

from __future__ import annotations

import argparse
import math
import platform
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import MaxNLocator
from scipy.spatial.transform import Rotation

from ocptip.basics.write import versions, write_json, write_text
from ocptip.indices.platforms.controllability import control_number, control_numbers, platform_conditioning
from ocptip.indices.platforms.platform import PlanarPlatformPose, PlatformPose, StewartPlatform
from ocptip.indices.platforms.reviewed import PlacedPlatform
from ocptip.indices.workspace_maps import index_maps
from studies.common import ended, software, table
from studies.indices.designs.flight_simulator import FlightSimulator
from studies.indices.designs.isotropic_families import isotropic_u1, isotropic_u2
from studies.indices.designs.optimal_domains import (
    TOUCHING_POINT,
    W_CROSSES_S12,
    W_MEETS_S,
    W_MEETS_S12,
    angle_borders,
    inner_borders,
    main_roots,
    outer_border,
    real_root_counts,
    special_limit,
)
from studies.indices.designs.optimal_planar import LARGEST_R, optimal_planar_pose
from studies.indices.designs.optimal_platforms import (
    ctn_optimal_main,
    ctn_optimal_special,
    example_main,
    example_special,
)
from studies.indices.designs.optimal_search import search_optimal

FIRST, SECOND, BODY, GROUND = "#0b6e99", "#d1603d", "#2e8b57", "#555555"
LARGEST_ANGLE = math.radians(20.0)
PERCENTILES = (5.0, 25.0, 50.0, 75.0, 95.0)


def drawn_members() -> dict[str, tuple[PlatformPose, str]]:
    """The platforms of the figure: title -> pose and what is special about it."""
    u1 = isotropic_u1(1.0, 0.45, mu=0.4)
    u2 = isotropic_u2(1.0, mu=0.5)
    main, special = ctn_optimal_main(0.3, 1.0, root=3, mu=0.6), ctn_optimal_special(0.4, 1.2, mu=0.6)
    return {
        "U1, r2 = 0.45, p = 1": (u1.pose(-1.2, 1.2), _isotropy(u1, -1.2, 1.2)),
        "U2, p = 1": (u2.pose(-0.3, 1.5), _isotropy(u2, -0.3, 1.5)),
        "L_H, t = 0.3, r1 = 1": (main.pose, _control(main.pose)),
        "K_M in L_H, mu = pi/3": (example_main(math.pi / 3).pose, _control(example_main().pose)),
        "L_S, t = 0.4, r1 = 1.2": (special.pose, _control(special.pose)),
        "K_S in L_S": (example_special().pose, _control(example_special().pose)),
    }


def _isotropy(family: Any, low: float, high: float) -> str:
    result = platform_conditioning(family.pose(low, high), family.ellipsoid.W())
    return f"1/CDN_OE = {result.value:.6f}"


def _control(pose: PlatformPose) -> str:
    return f"CTN = {control_number(pose).value:.6f}"


def check_members(count: int, rng: np.random.Generator) -> dict[str, dict[str, float]]:
    """Random members of each family: number, largest |1 - index|, smallest singular value of the Jacobian."""
    deviations: dict[str, list[tuple[float, float]]] = {"U1": [], "U2": [], "L_H": [], "L_S": [], "RPR": []}
    while len(deviations["L_H"]) < count:
        t, r1 = float(rng.uniform(-1, 1)), float(rng.uniform(-2.5, 2.5))
        if abs(abs(t) - 0.5) < 1e-3 or abs(t) < 1e-3 or abs(r1) < 1e-3:
            continue
        for root in main_roots(t, r1):
            branch, g = int(rng.integers(1, 5)), int(rng.integers(3, 6))
            member = ctn_optimal_main(t, r1, root=root, branch=branch, g=g)
            _note(deviations["L_H"], member.control.value, member.pose)
    for _ in range(count):
        t = float(rng.uniform(0.01, 0.99) * rng.choice([-1, 1]))
        r1 = float(rng.uniform(0.01, 1) * special_limit(t))
        signs = tuple(int(s) for s in rng.choice([-1, 1], 3))
        member = ctn_optimal_special(t, r1, signs=signs)
        _note(deviations["L_S"], member.control.value, member.pose)
        p, r2 = float(rng.uniform(0.2, 3)), float(rng.uniform(0.02, 0.66))
        g = int(rng.integers(3, 6))
        for name, family in (
            ("U1", isotropic_u1(p, r2, g=g, signs=signs)),
            ("U2", isotropic_u2(p, g=g, signs=signs)),
        ):
            pose = family.pose(rng.uniform(-2, -0.5, 2 * g), rng.uniform(0.5, 2, 2 * g))
            _note(deviations[name], platform_conditioning(pose, family.ellipsoid.W()).value, pose)
        planar = optimal_planar_pose(float(rng.uniform(0.05, LARGEST_R)), str(rng.choice(["-", "+"])), g)
        _note(deviations["RPR"], control_number(planar).value, planar)
    return {
        name: {
            "members": len(values),
            "largest_deviation_from_1": max(v for v, _ in values),
            "smallest_singular_value": min(s for _, s in values),
        }
        for name, values in deviations.items()
    }


def _note(values: list[tuple[float, float]], index: float, pose: PlatformPose | PlanarPlatformPose) -> None:
    values.append((abs(1.0 - index), float(pose.singular_values[-1])))


def designs() -> dict[str, PlatformPose]:
    """Designs in their best pose, scaled to a mean leg length of 1 m."""
    best = FlightSimulator.optimal()
    poses = {
        "flight simulator, best": best.platform.at(best.position),
        "K_M, mu = 0": example_main(0.0).pose,
        "K_M, mu = pi/3": example_main(math.pi / 3).pose,
        "K_S": example_special().pose,
    }
    return {
        name: PlatformPose(pose.base / pose.lengths.mean(), pose.platform / pose.lengths.mean())
        for name, pose in poses.items()
    }


def workspaces(poses: int, rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """Statistics of the control number around the best pose, the same sample of poses for all designs.

    Positions fill a ball of a quarter of the mean leg length about the best pose, rotations turn about the
    centroid of the platform anchors by up to 20 degrees about a random axis.
    """
    shifts = rng.normal(size=(poses, 3))
    shifts *= (0.25 * rng.uniform(0, 1, poses) ** (1 / 3) / np.linalg.norm(shifts, axis=1))[:, None]
    turns = rng.normal(size=(poses, 3))
    turns *= (LARGEST_ANGLE * rng.uniform(0, 1, poses) / np.linalg.norm(turns, axis=1))[:, None]
    results = {}
    for name, pose in designs().items():
        centre = pose.platform.mean(axis=0)
        moving = StewartPlatform(pose.base, pose.platform - centre, name)
        values = control_numbers(moving, shifts + centre, Rotation.from_rotvec(turns).as_matrix())
        results[name] = {"best_pose": control_number(pose).value, **statistics(values)}
    return results


def statistics(values: np.ndarray) -> dict[str, Any]:
    """Of the control numbers (k,) of a sample; NaN where a leg has length zero."""
    known = values[~np.isnan(values)]
    return {
        "poses": len(values),
        "undefined": len(values) - len(known),
        "minimum": float(known.min()),
        "mean": float(known.mean()),
        "maximum": float(known.max()),
        "percentiles": {str(q): float(np.percentile(known, q)) for q in PERCENTILES},
        "worst": int(np.nanargmin(values)),
        "best": int(np.nanargmax(values)),
    }


def draw(path: Path) -> None:
    """Write the figure."""
    figure = plt.figure(figsize=(16, 14))
    grid = figure.add_gridspec(3, 3, hspace=0.25, wspace=0.05)
    for k, (title, (pose, index)) in enumerate(drawn_members().items()):
        axis = figure.add_subplot(grid[k // 3, k % 3], projection="3d")
        _draw_platform(axis, pose)
        axis.set_title(f"{title}\n{index}", fontsize=11)
    lower = grid[2, :].subgridspec(1, 4, width_ratios=[1, 1.05, 1.1, 1.1], wspace=0.3)
    _draw_domain(figure.add_subplot(lower[0]))
    _draw_planar(figure.add_subplot(lower[1]))
    chosen = designs()
    maps = [figure.add_subplot(lower[2 + k]) for k in range(2)]
    for axis, name in zip(maps, ("flight simulator, best", "K_M, mu = pi/3"), strict=True):
        filled = _draw_map(axis, name, chosen[name])
    maps[0].set_ylabel("dy / mean leg length")
    figure.colorbar(filled, ax=maps, shrink=0.7, pad=0.02, ticks=[0, 0.25, 0.5, 0.75, 1], label="CTN")
    figure.savefig(path, dpi=110, bbox_inches="tight")
    plt.close(figure)


def _draw_platform(axis: Any, pose: PlatformPose) -> None:
    g = pose.n_legs // 2
    for group, colour in ((range(g), FIRST), (range(g, 2 * g), SECOND)):
        for i in group:
            axis.plot(
                *np.array([pose.base[i], pose.platform[i]]).T, color=colour, lw=2.2, solid_capstyle="round"
            )
        for points, marker, body in ((pose.base, "s", GROUND), (pose.platform, "o", BODY)):
            ring = points[[*group, group[0]]]
            axis.plot(*ring.T, color=body, lw=0.9, alpha=0.8)
            axis.scatter(*points[list(group)].T, color=body, marker=marker, s=22, depthshade=False)
    everything = np.vstack([pose.base, pose.platform])
    centre, reach = everything.mean(axis=0), np.ptp(everything, axis=0).max() / 2
    axis.set(
        xlim=(centre[0] - reach, centre[0] + reach),
        ylim=(centre[1] - reach, centre[1] + reach),
        zlim=(centre[2] - reach, centre[2] + reach),
    )
    axis.set_box_aspect((1, 1, 1), zoom=1.15)
    axis.view_init(elev=20, azim=-55)
    axis.tick_params(labelsize=7, pad=-2)
    for each in (axis.xaxis, axis.yaxis, axis.zaxis):
        each.set_major_locator(MaxNLocator(4))


def _draw_domain(axis: Any) -> None:
    t, r1 = np.linspace(0.005, 0.995, 180), np.linspace(0.005, 3.6, 180)
    image = axis.pcolormesh(t, r1, real_root_counts(t, r1).T, cmap="Blues", vmin=0, vmax=6, shading="nearest")
    image.set_rasterized(True)
    fine = np.linspace(0.005, 0.995, 1500)
    axis.plot(fine, [outer_border(x) for x in fine], color="black", lw=1.2, label="S = 0")
    lower, upper = np.array([inner_borders(x) for x in fine]).T
    for curve, label in ((lower, "S1 S2 = 0"), (upper, None)):
        axis.plot(fine, curve, color=SECOND, lw=1.2, label=label)
    for curve, label in zip(np.array([angle_borders(x) for x in fine]).T, ("W = 0", None), strict=True):
        axis.plot(fine, curve, color=BODY, lw=1.0, ls="--", label=label)
    for point in (W_MEETS_S, W_CROSSES_S12, W_MEETS_S12):
        axis.plot(*point, "o", color=BODY, ms=3)
    points = {
        "N": TOUCHING_POINT,
        "M": (0.5, 2 / 3 * math.sqrt(6)),
        "T": (0.5, 4 / 3 * math.sqrt(2)),
    }
    offsets = {"N": (7, 5), "M": (-12, -9), "T": (-12, 3)}
    for name, point in points.items():
        axis.plot(*point, "o", color="black", ms=3.5)
        axis.annotate(name, point, xytext=offsets[name], textcoords="offset points", fontsize=9)
    for text, point in {"4 roots": (0.2, 0.7), "2": (0.8, 1.45), "0": (0.2, 2.8)}.items():
        axis.text(*point, text, fontsize=10)
    axis.set(xlim=(0, 1), ylim=(0, 3.6), xlabel="t", ylabel="r1")
    axis.set_title("main family L_H: real roots", fontsize=11)
    axis.legend(fontsize=8, loc="upper right")


def _draw_planar(axis: Any) -> None:
    r = np.linspace(1e-3, LARGEST_R, 300)
    for branch, colour in (("-", FIRST), ("+", SECOND)):
        curve = np.array([optimal_planar_pose(float(x), branch).base[0] for x in r])
        for side in (1, -1):
            label = f"x1, branch {branch}" if side > 0 else None
            axis.plot(curve[:, 0], side * curve[:, 1], color=colour, lw=1.6, label=label)
    example = optimal_planar_pose(1.2, "+")
    for b, p in zip(example.base, example.platform, strict=True):
        axis.plot(*np.array([b, p]).T, color=GROUND, lw=1.4)
    ring = np.vstack([example.platform, example.platform[:1]])
    axis.plot(*ring.T, color=BODY, lw=1)
    axis.plot(*example.platform.T, "o", color=BODY, ms=4, label="y1, y2, y3")
    axis.plot(*example.base.T, "s", color=GROUND, ms=4, label="x1, x2, x3 at r = 1.2")
    axis.plot(0, 0, "k+")
    axis.set_aspect("equal")
    axis.set(xlim=(-2.1, 2.5), ylim=(-2.9, 2.1), xlabel="x", ylabel="y")
    axis.set_title("planar RPR with CTN = 1", fontsize=11)
    axis.legend(fontsize=7, loc="lower left")


def _draw_map(axis: Any, name: str, pose: PlatformPose) -> Any:
    """Control number over a shift of the platform; returns what a colour bar needs."""
    x = np.linspace(-0.6, 0.6, 81)
    X, Y = np.meshgrid(x, x)
    shifts = np.column_stack([X.ravel(), Y.ravel(), np.zeros(X.size)])
    moving = StewartPlatform(pose.base, pose.platform, name)
    values = control_numbers(moving, shifts, np.eye(3)).reshape(X.shape)
    filled = axis.contourf(X, Y, values, levels=np.arange(0, 1.0001, 0.05), cmap="viridis")
    axis.contour(X, Y, values, levels=np.arange(0, 1.0001, 0.1), colors="white", linewidths=0.5)
    axis.set_aspect("equal")
    axis.set(xlabel="dx / mean leg length", xticks=[-0.5, 0, 0.5], yticks=[-0.5, 0, 0.5])
    axis.set_title(f"{name}, shifted", fontsize=11)
    return filled


MOVES = {
    "height dz / mean leg length": ("z", 1.0),
    "rotation about x [deg]": ("rx", 90.0),
    "rotation about y [deg]": ("ry", 90.0),
    "rotation about z [deg]": ("rz", 120.0),
}


def moved(name: str, pose: PlatformPose, coordinate: str, ends: float) -> tuple[np.ndarray, np.ndarray]:
    """Shifts in mean leg lengths, or turns about the platform's centre, deg, and the control numbers."""
    centre = pose.platform.mean(axis=0)
    file = PlacedPlatform(StewartPlatform(pose.base, pose.platform - centre, name), centre, np.eye(3), None)
    middle = centre[2] if coordinate == "z" else 0.0
    scale = 1.0 if coordinate == "z" else math.radians(1.0)
    found = index_maps(
        file, {coordinate: (middle - scale * ends, middle + scale * ends)}, cells=241, names=["ctn"]
    )
    return (found.values[0] - middle) / scale, found.maps["ctn"]


def draw_moved(path: Path) -> None:
    """Control number over height and rotations, and over two rotations at a time."""
    figure = plt.figure(figsize=(13, 7), layout="constrained")
    upper, lower = figure.subfigures(2, 1)
    panels = upper.subplots(1, 4, sharey=True)
    for axis, (label, (coordinate, ends)) in zip(panels, MOVES.items(), strict=True):
        for k, (name, pose) in enumerate(designs().items()):
            axis.plot(*moved(name, pose, coordinate, ends), lw=1.3, color=f"C{k}", label=name)
        axis.set(xlabel=label, ylim=(0, 1), xlim=(-ends, ends))
    panels[0].set_ylabel("CTN, 0 to 1")
    panels[0].legend(fontsize=7, loc="upper left")
    maps = lower.subplots(1, 4, sharey=True)
    for axis, (name, pose) in zip(maps, designs().items(), strict=True):
        centre = pose.platform.mean(axis=0)
        file = PlacedPlatform(
            StewartPlatform(pose.base, pose.platform - centre, name), centre, np.eye(3), None
        )
        ranges = dict.fromkeys(("rx", "ry"), (-math.pi / 2, math.pi / 2))
        found = index_maps(file, ranges, cells=61, names=["ctn"])
        x, y = (np.degrees(own) for own in found.values)
        filled = axis.contourf(x, y, found.maps["ctn"].T, levels=np.arange(0, 1.0001, 0.05), cmap="viridis")
        axis.contour(x, y, found.signed.T, levels=[0.0], colors="#d00000", linewidths=1.2)
        axis.set(
            xlabel="rx [deg]", aspect="equal", xticks=[-90, -45, 0, 45, 90], yticks=[-90, -45, 0, 45, 90]
        )
        axis.set_title(f"{name}; red: singular", fontsize=10)
    maps[0].set_ylabel("ry [deg]")
    lower.colorbar(filled, ax=maps, label="CTN, 0 to 1")
    figure.savefig(path, dpi=100)
    plt.close(figure)


def report(data: dict[str, Any]) -> str:
    """The results as Markdown."""
    families = [
        [
            name,
            str(row["members"]),
            f"{row['largest_deviation_from_1']:.1e}",
            f"{row['smallest_singular_value']:.1e}",
        ]
        for name, row in data["families"].items()
    ]
    search = data["search"]
    found = ", ".join(f"{count} of {name}" for name, count in search["families"].items())
    designs = [
        [
            name,
            *(f"{x:.3f}" for x in (row["best_pose"], row["minimum"], q["5.0"], row["mean"], q["95.0"])),
        ]
        for name, row in data["workspaces"].items()
        for q in [row["percentiles"]]
    ]
    head = ["family", "members", "largest deviation of the index from 1", "smallest singular value"]
    lines = [
        "# Optimal Stewart-Gough platforms",
        "",
        *table(head, families),
        "",
        f"Search for further families from {search['starts']} random starts: {found}; "
        f"{search['unsolved'] + search['singular']} starts without a regular solution.",
        "",
        f"Control number over {data['options']['poses']} poses within a quarter of the mean leg length and "
        "20 degrees of the best pose:",
        "",
        *table(["design", "best pose", "minimum", "5 %", "mean", "95 %"], designs),
        "",
        f"Seed {data['options']['seed']}; {software(data['versions'])}; {data['seconds']:.0f} s on "
        f"{data['machine']}.",
    ]
    return "\n".join(lines) + "\n"


def run(out: Path, members: int, starts: int, poses: int, seed: int) -> str:
    """Compute, write all files, return the Markdown text."""
    begin, rng = time.perf_counter(), np.random.default_rng(seed)
    out.mkdir(parents=True, exist_ok=True)
    data: dict[str, Any] = {
        "options": {"members": members, "starts": starts, "poses": poses, "seed": seed},
        "versions": versions(("numpy", "scipy")),
        "machine": platform.machine(),
        "families": check_members(members, rng),
        "search": search_optimal(starts, seed).to_dict(),
        "workspaces": workspaces(poses, rng),
        "drawn": {
            title: {"index": index, "base": pose.base.tolist(), "platform": pose.platform.tolist()}
            for title, (pose, index) in drawn_members().items()
        },
    }
    draw(out / "optimal_platforms.png")
    draw_moved(out / "optimal_platforms_moved.png")
    data["seconds"] = round(time.perf_counter() - begin, 1)
    text = report(data)
    write_json(out / "optimal_platforms.json", data, indent=1)
    write_text(out / "optimal_platforms.md", text)
    return text


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for figure, table and data")
    parser.add_argument("--members", type=int, default=300, help="random members of each family")
    parser.add_argument("--starts", type=int, default=60, help="random starts of the search")
    parser.add_argument("--poses", type=int, default=2000, help="poses of the workspace sample")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(argv)
    if min(given.members, given.starts, given.poses) < 1 or given.seed < 0:
        parser.error("--members, --starts and --poses must be at least 1, --seed at least 0")
    return ended(
        "optimal_platforms", lambda: run(given.out, given.members, given.starts, given.poses, given.seed)
    )


if __name__ == "__main__":
    sys.exit(main())
