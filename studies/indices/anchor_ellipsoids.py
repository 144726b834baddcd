"""Platforms that are optimal in CTN and isotropic for an operation ellipsoid: where is it among the anchors?

    python -m studies.indices.anchor_ellipsoids --out FOLDER [--members 300] [--starts 40] [--seed 0]

The source leaves this question open. The answer for legs of equal length L, of any platform in any pose:
with Q, the metric of all 2 n anchors, and N, that of the leg rates, the passive joint rates have
Z = (Q - 2 N) / L^2 ([Naw07] 6.3). The eigenvalues of (Z, N) and of (Q, N) belong together,
lambda = (kappa - 2) / L^2, and CTN = 1 exactly where N is a multiple of Q: where the platform is isotropic
for the ellipsoid of inertia of its anchors, `OperationEllipsoid.from_points(anchors)`. No other ellipsoid
has that metric.

n legs that are optimal and isotropic, with directions u_i and c_i = 1 / L_i^2: the translations of
Z = lambda N say 2 E sum c_i - 2 sum c_i u_i u_i' = lambda sum u_i u_i', those of N say
sum u_i u_i' = n / 3 E; together sum (c_i - mean c) u_i u_i' = 0. Six legs have equal lengths therefore,
unless their directions lie on a cone of second order: otherwise the six u_i u_i' are linearly independent.

A sphere of radius R: the lines of six isotropic legs are at the distance R sqrt(2/3) from its centre (4.4).
If they are equal, the mean of |x|^2 over their anchors is R^2; both together say L <= 2 R / sqrt(3), with
all anchors on the sphere if equal.

Writes anchor_ellipsoids.png, .json and .md: these statements checked on random platforms, for the families
L_H and L_S in numbers, and for platforms without symmetry of 6, 7 and 8 legs that are found by search.
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

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.linalg import eigh
from scipy.optimize import brentq, least_squares

from ocptip.basics.errors import InputError, SolverError
from ocptip.basics.write import versions, write_json, write_text
from ocptip.indices.metric import OperationEllipsoid, velocity_map
from ocptip.indices.platforms.controllability import control_number, platform_conditioning
from ocptip.indices.platforms.platform import PlatformPose
from ocptip.numerics.vectors import skew
from studies.common import ended, software, table
from studies.indices.designs.optimal_domains import main_roots, special_limit
from studies.indices.designs.optimal_planar import LARGEST_R
from studies.indices.designs.optimal_platforms import (
    OptimalPlatform,
    ctn_optimal_main,
    ctn_optimal_special,
    example_main,
    example_special,
)

SOLVED, OPTIMAL, EQUAL = 1e-9, 1 - 1e-6, 1e-6
LONGEST = 2.0 / math.sqrt(3.0)
UPPER = np.triu_indices(6)
SMALL = np.triu_indices(3)


def anchors(pose: PlatformPose) -> np.ndarray:
    """(2 n, 3) all anchors, m."""
    return np.vstack([pose.base, pose.platform])


def own_ellipsoid(pose: PlatformPose) -> OperationEllipsoid:
    """The ellipsoid with the metric of the anchors."""
    return OperationEllipsoid.from_points(anchors(pose))


def levels(pose: PlatformPose, ellipsoid: OperationEllipsoid) -> np.ndarray:
    """(2 n,) per anchor the sum of (coordinate / half-axis)^2: 1 on the ellipsoid."""
    return (((anchors(pose) - ellipsoid.center) @ ellipsoid.axes / ellipsoid.half_axes) ** 2).sum(axis=1)


def isotropic_ellipsoid(pose: PlatformPose) -> tuple[float, np.ndarray, np.ndarray]:
    """Of an isotropic pose, from the leg rates alone.

    Returns:
        How far N is from the metric of any ellipsoid (0: isotropic), its centre (3,), and (3, 3) the matrix
        of its squared half-axes, m^2.
    """
    n = pose.N * 18.0 / pose.n_legs  # W if isotropic
    mixed, linear = n[3:, :3] / 6.0, n[3:, 3:] / 6.0
    defect = max(np.abs(linear - np.eye(3)).max(), np.abs(mixed + mixed.T).max())
    center = -np.array([mixed[2, 1], mixed[0, 2], mixed[1, 0]])
    turning = n[:3, :3] - 6.0 * skew(center).T @ skew(center)
    scatter = np.trace(turning) / 2.0 * np.eye(3) - turning
    return float(defect), center, scatter / 2.0


# --- legs of equal length -----------------------------------------------------------------------------------


def equal_legs(count: int, rng: np.random.Generator) -> dict[str, float]:
    """Largest difference of the two ways to CTN over random platforms with legs of one length."""
    worst, least = 0.0, 1.0
    for _ in range(count):
        n = int(rng.integers(6, 10))
        base, direction = rng.normal(size=(n, 3)), rng.normal(size=(n, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        pose = PlatformPose(base, base + rng.uniform(0.3, 3.0) * direction)
        speeds = velocity_map(anchors(pose))
        kappa = eigh(speeds.T @ speeds, pose.N, eigvals_only=True)
        value = control_number(pose).value
        worst = max(worst, abs(value - math.sqrt((kappa[0] - 2.0) / (kappa[-1] - 2.0))))
        least = min(least, platform_conditioning(pose, own_ellipsoid(pose).W()).value - value)
    return {"platforms": count, "largest_difference": worst, "least_inv_cdn_oe_minus_ctn": least}


# --- the two families ---------------------------------------------------------------------------------------


def main_members(count: int, rng: np.random.Generator) -> list[OptimalPlatform]:
    """Random members of L_H, all their real roots."""
    found: list[OptimalPlatform] = []
    while len(found) < count:
        t, r1 = float(rng.uniform(-1, 1)), float(rng.uniform(-2.5, 2.5))
        if abs(abs(t) - 0.5) > 1e-3 and min(abs(t), abs(r1)) > 1e-2:
            branch = int(rng.integers(1, 5))
            found += [ctn_optimal_main(t, r1, root=root, branch=branch) for root in main_roots(t, r1)]
    return found


def special_bound(t: float) -> float:
    """Largest 1/CDN_OE of a member of L_S over all ellipsoids; depends on t alone.

    Translations limit it: N has g (3 - t^2) / 4 across and g (1 + t^2) / 2 along the axis. A spheroid whose
    rotations lie between attains it.
    """
    ratio = (3.0 - t * t) / (2.0 + 2.0 * t * t)
    return math.sqrt(min(ratio, 1.0 / ratio))


def best_of_special(pose: PlatformPose) -> float:
    """1/CDN_OE of a member of L_S with a spheroid whose rotations lie between its translations."""
    turning, linear = np.diagonal(pose.N)[:3], np.diagonal(pose.N)[3:]
    low, high = 6.0 / max(linear), 6.0 / min(linear)
    around, across = low * turning[2], high * turning[0]  # 4 R^2 and 2 (R^2 + c^2)
    squares = np.array([around / 4.0, around / 4.0, across / 2.0 - around / 4.0])
    ellipsoid = OperationEllipsoid(np.zeros(3), half_axes=np.sqrt(squares))
    return platform_conditioning(pose, ellipsoid.W()).value


def families(count: int, rng: np.random.Generator) -> dict[str, Any]:
    """Members of L_H and L_S: how isotropic, for which ellipsoid."""
    main: dict[str, list[float]] = {"defect": [], "away": [], "level": [], "ratio": []}
    for member in main_members(count, rng):
        pose, own = member.pose, own_ellipsoid(member.pose)
        defect, center, squares = isotropic_ellipsoid(pose)
        other = (own.axes * own.half_axes**2) @ own.axes.T
        main["defect"].append(max(defect, 1 - platform_conditioning(pose, own.W()).value))
        size = np.abs(squares).max()
        main["away"].append(max(np.abs(squares - other).max() / size, np.abs(center - own.center).max()))
        main["level"].append(float(np.abs(levels(pose, own) - 1.0).max()))
        main["ratio"].append(math.sqrt(squares[2, 2] / squares[0, 0]))
    special: dict[str, list[float]] = {"away": [], "own": [], "equal": []}
    for _ in range(count):
        t = float(rng.uniform(0.02, 0.98))
        member = ctn_optimal_special(t, float(rng.uniform(0.05, 1.0)) * special_limit(t))
        special["away"].append(abs(best_of_special(member.pose) - special_bound(t)))
        special["own"].append(
            platform_conditioning(member.pose, own_ellipsoid(member.pose).W()).value - special_bound(t)
        )
        equal = ctn_optimal_special(3**-0.5, float(rng.uniform(0.05, 1.0)) * special_limit(3**-0.5)).pose
        special["equal"].append(1 - platform_conditioning(equal, own_ellipsoid(equal).W()).value)
    return {
        "L_H": {
            "members": len(main["defect"]),
            "largest_defect_of_isotropy": max(main["defect"]),
            "largest_difference_of_ellipsoids": max(main["away"]),
            "largest_deviation_of_an_anchor": [min(main["level"]), max(main["level"])],
            "axis_to_radius": [min(main["ratio"]), max(main["ratio"])],
        },
        "L_S": {
            "members": count,
            "largest_difference_from_bound": max(special["away"]),
            "own_ellipsoid_minus_bound": [min(special["own"]), max(special["own"])],
            "largest_defect_of_isotropy_at_equal_legs": max(special["equal"]),
        },
    }


def spheres(t: float, root: int) -> list[float]:
    """All r1 at which the ellipsoid of a member of L_H is a sphere."""

    def ratio(r1: float) -> float:
        try:
            half = np.sort(own_ellipsoid(ctn_optimal_main(t, r1, root=root).pose).half_axes)
        except (InputError, SolverError):
            return math.nan
        return float(math.log(half[0] / half[1]) + math.log(half[2] / half[1]))  # twice the radius, the axis

    grid = np.linspace(0.05, 2.6, 120)
    values = np.array([ratio(r1) for r1 in grid])
    close = (values[:-1] * values[1:] < 0) & (np.abs(np.diff(values)) < 0.5)
    return [float(brentq(ratio, grid[k], grid[k + 1], xtol=1e-14)) for k in np.flatnonzero(close)]


def on_the_ellipsoid() -> dict[str, Any]:
    """Members of L_H with t = 1/2, and those whose ellipsoid is a sphere."""
    half, round_ones = [], []
    for r1 in np.linspace(0.05, 0.999 * LARGEST_R, 40):
        for root in main_roots(0.5, float(r1)):
            pose = ctn_optimal_main(0.5, float(r1), root=root).pose
            half.append(float(np.abs(levels(pose, own_ellipsoid(pose)) - 1.0).max()))
    for root, ts in ((4, (0.05, 0.1, 0.2, 0.3)), (3, (0.05, 0.2, 0.4)), (2, (0.52, 0.6, 0.7))):
        for t, r1 in [(one, r1) for one in ts for r1 in spheres(one, root)]:
            pose = ctn_optimal_main(t, r1, root=root).pose
            own = own_ellipsoid(pose)
            numbers = {
                "leg_to_radius": float(pose.lengths[0] / own.half_axes[0]),
                "largest_deviation_of_an_anchor": float(np.abs(levels(pose, own) - 1.0).max()),
            }
            round_ones.append({"t": t, "root": root, "r1": r1, **numbers})
    return {
        "half": {"members": len(half), "largest_deviation_of_an_anchor": max(half)},
        "spheres": round_ones,
    }


# --- without symmetry ---------------------------------------------------------------------------------------


def pose_of(x: np.ndarray) -> PlatformPose:
    """A platform of its anchors in one vector (6 n,)."""
    base, moving = np.split(x.reshape(-1, 3), 2)
    return PlatformPose(base, moving)


def conditions(x: np.ndarray, isotropic: bool) -> np.ndarray:
    """Zero where CTN = 1 and, if asked, N is the metric of an ellipsoid; scale and place are fixed."""
    pose = pose_of(x)
    ratio = (4.0 / pose.lengths**2).mean()
    points = x.reshape(-1, 3)
    defects = [
        (pose.Z / ratio - pose.N)[UPPER],
        points.mean(axis=0),
        [np.linalg.norm(points, axis=1).mean() - 1],
    ]
    if isotropic:
        mixed, linear = pose.N[:3, 3:], pose.N[3:, 3:]
        defects += [(linear - pose.n_legs / 3.0 * np.eye(3))[SMALL], (mixed + mixed.T)[SMALL]]
    return np.concatenate(defects)


def freedom(x: np.ndarray, isotropic: bool) -> float:
    """Parameters of the solutions about one: what the conditions leave, but for turns of the whole."""
    step = 1e-5 * np.eye(len(x))
    columns = [(conditions(x + h, isotropic) - conditions(x - h, isotropic)) / 2e-5 for h in step]
    values = np.linalg.svd(np.array(columns), compute_uv=False)
    return float(len(x) - 3 - np.sum(values > 1e-7 * values[0]))


def search(legs: int, starts: int, isotropic: bool, rng: np.random.Generator) -> dict[str, Any]:
    """Platforms without symmetry that fulfil the conditions, from random starts."""
    found: list[dict[str, float]] = []
    for _ in range(starts):
        try:
            end = least_squares(
                conditions, rng.normal(size=6 * legs), args=(isotropic,), xtol=1e-15, ftol=1e-15, gtol=1e-15,
                max_nfev=250,
            )  # fmt: skip
            pose = pose_of(end.x)
        except InputError:
            continue
        _, center, squares = isotropic_ellipsoid(pose)
        real = not isotropic or np.linalg.eigvalsh(squares)[0] > 1e-6
        if np.abs(end.fun).max() > SOLVED or control_number(pose).value < OPTIMAL or not real:
            continue
        rows = anchors(pose) - center
        found.append(
            {
                "spread": float(np.ptp(pose.lengths) / pose.lengths.mean()),
                "own": platform_conditioning(pose, own_ellipsoid(pose).W()).value,
                "mean_level": float(np.mean(np.einsum("ij,ji->i", rows, np.linalg.solve(squares, rows.T)))),
                "freedom": freedom(end.x, isotropic),
            }
        )
    told = [key for key in _COLUMNS if isotropic or key != "mean_level"]
    columns = {key: [one[key] for one in found] if key in told else [] for key in _COLUMNS}
    return {
        "legs": legs,
        "isotropic": isotropic,
        "starts": starts,
        "found": len(found),
        "equal_legs": sum(spread < EQUAL for spread in columns["spread"]),
        **{key: [min(own), max(own)] if own else None for key, own in columns.items()},
    }


# --- figure -------------------------------------------------------------------------------------------------


def draw(path: Path, cells: int = 80) -> None:
    """Three members with their ellipsoids, and the parameter domains."""
    figure = Figure(figsize=(14, 8.6), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 3)
    drawn = {
        "K_M of L_H: all anchors on it": example_main(math.pi / 3).pose,
        "L_H, t = 0.3, r1 = 1: on it on average": ctn_optimal_main(0.3, 1.0, root=3, mu=0.6).pose,
        "K_S of L_S: on it on average": example_special().pose,
    }
    for k, (title, pose) in enumerate(drawn.items()):
        axes = figure.add_subplot(grid[0, k], projection="3d")
        _draw_pose(axes, pose)
        axes.set_title(title, fontsize=10)
    _draw_domain(figure, figure.add_subplot(grid[1, 0]), cells, ratios=True)
    _draw_domain(figure, figure.add_subplot(grid[1, 1]), cells, ratios=False)
    _draw_special(figure.add_subplot(grid[1, 2]))
    figure.savefig(path, dpi=100)


def _draw_pose(axes: Any, pose: PlatformPose) -> None:
    own = own_ellipsoid(pose)
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(0, np.pi, 13))
    unit = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
    surface = np.einsum("ij,jkl->ikl", own.axes * own.half_axes, unit) + own.center[:, None, None]
    axes.plot_wireframe(*surface, color="0.75", lw=0.4)
    for b, p in zip(pose.base, pose.platform, strict=True):
        axes.plot(*np.array([b, p]).T, color="#0072b2", lw=1.6)
    axes.plot(*pose.base.T, "s", color="#555555", ms=4, ls="none")
    axes.plot(*pose.platform.T, "o", color="#d55e00", ms=4, ls="none")
    reach = max(np.abs(anchors(pose)).max(), own.half_axes.max())
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), zlim=(-reach, reach))
    axes.set_box_aspect((1, 1, 1), zoom=1.1)
    axes.set(xlabel="x", ylabel="y", zlabel="z")
    axes.tick_params(labelsize=7, pad=-2)


def _draw_domain(figure: Figure, axes: Any, cells: int, *, ratios: bool) -> None:
    """Root 2 of L_H over its parameters: shape of the ellipsoid, or how far anchors are from it."""
    t, r1 = np.linspace(0.0125, 0.9875, cells), np.linspace(0.03, 3.0, cells)
    values = np.full((len(r1), len(t)), np.nan)
    for k, i in np.ndindex(values.shape):
        try:
            pose = ctn_optimal_main(float(t[i]), float(r1[k]), root=2).pose
        except (InputError, SolverError):
            continue
        _, _, squares = isotropic_ellipsoid(pose)
        off = np.abs(levels(pose, own_ellipsoid(pose)) - 1.0).max()
        values[k, i] = 0.5 * math.log2(squares[2, 2] / squares[0, 0]) if ratios else off
    scale = {"cmap": "RdBu_r", "vmin": -3, "vmax": 3} if ratios else {"cmap": "viridis", "vmin": 0, "vmax": 1}
    image = axes.pcolormesh(t, r1, values, shading="nearest", **scale)
    if ratios:
        axes.contour(t, r1, values, levels=[0.0], colors="k", linewidths=1.2)
        label, title = "log2(axis / radius), -3 to 3", "L_H, root 2: shape of the ellipsoid; black: sphere"
    else:
        label, title = "largest |level - 1|, 0 and up", "L_H, root 2: anchors off the ellipsoid"
    axes.axvline(0.5, color="k" if ratios else "w", lw=0.8, ls="--")
    axes.plot(0.5, 2 / 3 * math.sqrt(6), "o", color="#d55e00", ms=5)
    axes.annotate("K_M", (0.5, 2 / 3 * math.sqrt(6)), xytext=(6, -4), textcoords="offset points", fontsize=9)
    axes.set(xlabel="t", ylabel="r1", xlim=(0, 1), ylim=(0, 3))
    axes.set_title(title, fontsize=10)
    figure.colorbar(image, ax=axes, label=label, extend="both" if ratios else "max")


def _draw_special(axes: Any) -> None:
    t = np.linspace(0.02, 0.98, 49)
    for share, color in ((0.1, "#009e73"), (0.6, "#e69f00"), (1.0, "#d55e00")):
        own = []
        for one in t:
            pose = ctn_optimal_special(float(one), share * special_limit(float(one))).pose
            own.append(platform_conditioning(pose, own_ellipsoid(pose).W()).value)
        axes.plot(t, own, color=color, lw=1.0, label=f"ellipsoid of the anchors, r1 = {share:g} r_max")
    axes.plot(t, [special_bound(float(one)) for one in t], color="k", lw=1.6, label="best ellipsoid, any r1")
    axes.plot(3**-0.5, 1.0, "o", color="#0072b2", ms=5, label="equal legs")
    axes.set(xlabel="t", ylabel="1/CDN_OE", xlim=(0, 1), ylim=(0, 1.03))
    axes.set_title("L_S: isotropic with equal legs only", fontsize=10)
    axes.legend(fontsize=8, loc="lower right")


# --- report -------------------------------------------------------------------------------------------------


def report(data: dict[str, Any]) -> str:
    """The results as Markdown."""
    main, special = data["families"]["L_H"], data["families"]["L_S"]
    equal, half, found = (
        data["equal_legs"],
        data["on_the_ellipsoid"]["half"],
        data["on_the_ellipsoid"]["spheres"],
    )
    full = [one for one in found if abs(one["leg_to_radius"] - LONGEST) < EQUAL]
    rows = []
    for one in data["search"]:
        ranges = ["-" if one[key] is None else "{:.3g} .. {:.3g}".format(*one[key]) for key in _COLUMNS]
        asked = "CTN = 1, isotropic" if one["isotropic"] else "CTN = 1"
        rows.append(
            [f"{one['legs']}: {asked}", *(str(one[k]) for k in ("starts", "found", "equal_legs")), *ranges]
        )
    head = ["legs: asked", "starts", "found", "of equal legs", "free parameters", "spread of lengths"]
    head += ["1/CDN_OE of the anchors' ellipsoid", "mean level of the anchors"]
    most = max(one["largest_deviation_of_an_anchor"] for one in full)
    texts = (
        "Legs of one length: CTN = 1 exactly where the platform is isotropic for the ellipsoid of inertia of "
        "its anchors, which lie on it on average: the mean of their levels x^2/a^2 + y^2/b^2 + z^2/c^2 is 1. "
        "Proofs: head of `studies/indices/anchor_ellipsoids.py`.",
        f"- {equal['platforms']} random platforms of 6 to 9 legs of one length: CTN by definition and from "
        f"the anchors' ellipsoid differ by {equal['largest_difference']:.0e} at most; 1/CDN_OE is never "
        f"below CTN (least difference {equal['least_inv_cdn_oe_minus_ctn']:.2g}).",
        f"- L_H, {main['members']} members: isotropic, to {main['largest_defect_of_isotropy']:.0e}; the "
        "ellipsoid that the leg rates demand is that of the anchors, to "
        f"{main['largest_difference_of_ellipsoids']:.0e}; its axis is "
        "{:.2g} to {:.2g} times its radius. ".format(*main["axis_to_radius"])
        + "Levels of anchors are off 1 by up to {1:.3g}.".format(*main["largest_deviation_of_an_anchor"]),
        f"- L_H, t = 1/2, {half['members']} members, of K_M's kind: all anchors lie on the ellipsoid, to "
        f"{half['largest_deviation_of_an_anchor']:.0e}.",
        f"- L_H, spheres, {len(found)} members: in {len(full)} the legs are 2 / sqrt(3) radii long and all "
        f"anchors on the sphere, to {most:.0e}; in {len(found) - len(full)} the legs are shorter.",
        f"- L_S, {special['members']} members: the best ellipsoid has 1/CDN_OE = root of "
        "(3 - t^2) / (2 + 2 t^2) or of its inverse, whatever r1, to "
        f"{special['largest_difference_from_bound']:.0e}. Isotropic at t = +-1 / sqrt(3) only, where all "
        "legs are equal (K_S), for the anchors' ellipsoid to "
        f"{special['largest_defect_of_isotropy_at_equal_legs']:.0e}.",
    )
    lines = [
        "# Optimal in CTN and isotropic: where is the ellipsoid?",
        *(line for text in texts for line in ("", text)),
        "",
        "Without symmetry, from random starts (motions and scale not counted as parameters):",
        "",
        *table(head, rows),
        "",
        "Six such legs that are isotropic, too, are equal; more legs need not be, and the ellipsoid is then "
        "not that of the anchors.",
        "",
        f"Seed {data['options']['seed']}; {software(data['versions'])}; {data['seconds']:.0f} s of CPU time "
        f"on {data['machine']}.",
    ]
    return "\n".join(lines) + "\n"


_COLUMNS = ("freedom", "spread", "own", "mean_level")


def run(out: Path, members: int, starts: int, seed: int) -> str:
    """Compute, write all files, return the Markdown text."""
    begin, rng = time.process_time(), np.random.default_rng(seed)
    out.mkdir(parents=True, exist_ok=True)
    data: dict[str, Any] = {
        "options": {"members": members, "starts": starts, "seed": seed},
        "versions": versions(("numpy", "scipy")),
        "machine": platform.machine(),
        "equal_legs": equal_legs(members, rng),
        "families": families(members, rng),
        "on_the_ellipsoid": on_the_ellipsoid(),
        "search": [
            search(legs, starts, isotropic, rng)
            for legs, isotropic in ((6, False), (6, True), (7, True), (8, True))
        ],
    }
    draw(out / "anchor_ellipsoids.png")
    data["seconds"] = round(time.process_time() - begin, 1)
    text = report(data)
    write_json(out / "anchor_ellipsoids.json", data, indent=1)
    write_text(out / "anchor_ellipsoids.md", text)
    return text


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for figure, table and data")
    parser.add_argument("--members", type=int, default=300, help="random members of each family")
    parser.add_argument("--starts", type=int, default=40, help="random starts of each search")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(argv)
    if min(given.members, given.starts) < 1 or given.seed < 0:
        parser.error("--members and --starts must be at least 1, --seed at least 0")
    return ended("anchor_ellipsoids", lambda: run(given.out, given.members, given.starts, given.seed))


if __name__ == "__main__":
    sys.exit(main())
