"""The planar placement example (4.6): isolines, constraint regions, both minima, and how often it is found.

A planar robot with a two-link arm presses horizontally with force 5 at a point; where should it stand, and
how high should the point be? The source gives force, limits, weights and results, but its drawing with
lengths and weights is missing. `DIMENSIONS` are fitted so that both printed minima appear: in the global one,
at p = (6.6, 7.9), the weights of the links make the process force and the joint torques vanish; in the local
one, at p = (0.8, 0.8), the arm is folded and only the torque of its elbow vanishes.

The fit has four equations. The directions of both links in the global minimum follow from their weights; they
and the lengths give its two coordinates. In the local minimum the elbow is at its limit of 10 degrees and
joint 1 near its limit of 20 degrees, which gives the other two. Base weight and axles stay free.

    python -m studies.placement.planar --out results [--sets 200] [--starts 8] [--seed 0]

The model is the library's, with the arm in the plane y = 0 on four wheels so far apart sideways that only the
front and the rear axle can tip. All quantities are in one consistent system of units, gravity is 1.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import casadi as cs
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch as Swatch
from matplotlib.patches import Rectangle

from ocptip.basics.write import atomic_file, versions, write_json, write_text
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.place import place
from ocptip.placement.power import TorqueCost
from ocptip.placement.problem import GripperTask, PlacementLimits, PlacementProblem, ProcessLoad, Weights
from ocptip.placement.terrain import custom_terrain
from ocptip.robots.model import ArmModel, JointLimits
from ocptip.robots.motors import DCMotors
from ocptip.standing.arm import Robot
from studies.common import say, table

DIMENSIONS = {
    "link lengths": (5.0, 4.5),
    "link weights, acting in their middle": (2.0, 6.4),
    "height of joint 1 above the ground": 1.35,
    "base weight, acting below joint 1": 20.0,
    "height of the base's centre of mass": 0.8,
    "axles in front of and behind joint 1": 1.5,
}
FORCE = 5.0
ANGLES = np.deg2rad([[20.0, 160.0], [10.0, 170.0]])
TORQUES = np.array([35.0, 30.0])
COST = np.array([1.0, 1.2])
COST_REFERENCE = float(COST @ TORQUES)
LOWEST = 0.0  # p2 >= 0 (4.40): the 2 of the printed line is the index
GN_LIMIT = 0.9
WIDE = 50.0  # half the track sideways
BOX = ((-3.0, 10.0), (LOWEST, 11.0))
SAME = 1e-3  # a start set has found the global minimum if its total is larger by no more than this

CAUSES = ("out of reach", "joint angles", "joint torques", "tip-over")
COLORS = ("#e4e4e4", "#b9a3cf", "#f0b27a", "#7fb3d5")
GLOBAL, LOCAL = "#b3261e", "#1f5fa8"


def planar_robot() -> Robot:
    """The robot; q1 is the elevation of link 1, q2 the inner angle of the elbow (180 degrees: stretched)."""
    l1, l2 = DIMENSIONS["link lengths"]
    height, half = (
        DIMENSIONS["height of joint 1 above the ground"],
        DIMENSIONS["axles in front of and behind joint 1"],
    )
    upright = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # joint axes along -y
    none = np.full(2, np.inf)
    arm = ArmModel(
        name="planar arm",
        joint_names=("shoulder", "elbow"),
        rotations=np.array([np.eye(3), np.diag([-1.0, -1.0, 1.0])]),
        offsets=np.array([[l1, 0.0, 0.0], [l2, 0.0, 0.0]]),
        masses=np.array(DIMENSIONS["link weights, acting in their middle"]),
        centres=np.array([[l1 / 2, 0.0, 0.0], [l2 / 2, 0.0, 0.0]]),
        inertias=np.zeros((2, 3, 3)),
        limits=JointLimits(ANGLES[:, 0], ANGLES[:, 1], np.ones(2), none, TORQUES),
        mount_position=np.array([0.0, 0.0, height]),
        mount_rotation=upright,
    )
    wheels = [
        UnilateralContact(position=[x, y, 0.0], friction=50.0) for x in (half, -half) for y in (WIDE, -WIDE)
    ]
    weight = DIMENSIONS["base weight, acting below joint 1"]
    support = Support(
        wheels,
        mass=weight,
        center_of_mass=[0.0, 0.0, DIMENSIONS["height of the base's centre of mass"]],
        gravity=[0.0, 0.0, -1.0],
    )
    total = weight + sum(DIMENSIONS["link weights, acting in their middle"])
    return Robot(arm, support, DCMotors.estimated(arm), reference_moment=0.1 * half * total)


def planar_problem(force: float = FORCE, *, unloaded: bool = True) -> PlacementProblem:
    """The example with the gripper's point in the world's origin: the base stands at (-p1, -p2) (4.40).

    Args:
        force: process force.
        unloaded: constraints hold without the force, too.
    """
    p = cs.SX.sym("p", 2)
    pose = cs.Function("pose", [p], [cs.vertcat(-p[0], 0, -p[1]), cs.SX.eye(3)])
    (low, high), (bottom, top) = BOX
    terrain = custom_terrain(pose, [low, bottom], [high, top], parameters=("p1", "p2"), name="height")
    loads = [ProcessLoad([-force, 0.0, 0.0], name="process force")] if force else []
    return PlacementProblem(
        planar_robot(),
        GripperTask([0.0, 0.0, 0.0], loads=loads, orientation="free", name="press"),
        terrain,
        weights=Weights(GN=0.25, GT=0.0, GK=0.0, GE=0.75),
        limits=PlacementLimits(GN=GN_LIMIT, GT=None),
        energy=TorqueCost(COST),
        references={"GE": COST_REFERENCE},
        unloaded=unloaded,
    )


def elbow_up(points: np.ndarray) -> np.ndarray:
    """Joint angles (N, 2), rad, of points p (N, 2) with the elbow above; NaN out of reach."""
    l1, l2 = DIMENSIONS["link lengths"]
    x, z = points[:, 0], points[:, 1] - DIMENSIONS["height of joint 1 above the ground"]
    cosine = (l1**2 + l2**2 - x**2 - z**2) / (2 * l1 * l2)
    with np.errstate(invalid="ignore"):
        inner = np.arccos(cosine)
    return np.column_stack(
        [np.arctan2(z, x) + np.arctan2(l2 * np.sin(inner), l1 - l2 * np.cos(inner)), inner]
    )


def field(evaluator: Evaluator, points: np.ndarray) -> dict[str, np.ndarray]:
    """GN, GE, total (N,) and cause (N,) at points p (N, 2): first kind of constraint broken, -1 for none."""
    q = elbow_up(points)
    reached = np.flatnonzero(np.isfinite(q).all(axis=1))
    result = {name: np.full(len(points), np.nan) for name in ("GN", "GE", "total", "M1", "M2")}
    cause = np.zeros(len(points), dtype=int)
    found = evaluator.task(0, 0, points[reached], q[reached])
    criteria = evaluator.criteria([found])
    result["GN"][reached], result["GE"][reached] = criteria[:, 0], criteria[:, 3]
    result["total"][reached] = evaluator.totals(criteria)
    result["M1"][reached], result["M2"][reached] = found.torques[:, -1].T
    own = np.full(len(reached), -1)
    for number, kinds in ((3, ("GN", "tip-over", "persistence")), (2, ("torque",)), (1, ("joint angle",))):
        broken = np.zeros(len(reached), dtype=bool)
        for rows in found.rows:
            if rows.kind in kinds:
                broken |= (np.nan_to_num(rows.margins, nan=-1.0) < 0).any(axis=1)
        own[broken] = number
    cause[reached] = own
    return {**result, "cause": cause}


def grid(points: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """p1 (k,), p2 (m,) and all pairs (m k, 2)."""
    p1, p2 = (np.linspace(low, high, points) for low, high in BOX)
    return p1, p2, np.stack(np.meshgrid(p1, p2), axis=-1).reshape(-1, 2)


def minima(evaluator: Evaluator, points: int = 241) -> list[dict[str, Any]]:
    """Feasible local minima of the total on a grid that is refined about each of them, the least first."""
    p1, p2, all_points = grid(points)
    values = field(evaluator, all_points)
    total = np.where(values["cause"] < 0, values["total"], np.inf).reshape(points, points)
    padded = np.pad(total, 2, constant_values=np.inf)
    around = [
        padded[2 + i : 2 + i + points, 2 + j : 2 + j + points]
        for i in range(-2, 3)
        for j in range(-2, 3)
        if (i, j) != (0, 0)
    ]
    lowest = np.isfinite(total) & (total < np.min(around, axis=0))
    found = [
        _refined(evaluator, np.array([p1[j], p2[i]]), 2 * (p1[1] - p1[0]))
        for i, j in zip(*np.nonzero(lowest), strict=True)
    ]
    distinct: list[dict[str, Any]] = []
    for entry in sorted(found, key=lambda e: e["total"]):
        if all(np.linalg.norm(np.subtract(entry["p"], other["p"])) > 0.1 for other in distinct):
            distinct.append(entry)
    return distinct


def _refined(evaluator: Evaluator, centre: np.ndarray, size: float) -> dict[str, Any]:
    """Follow the least of a small grid about it, which shrinks only when its centre is the least.

    The total has kinks where a torque vanishes; a grid that shrinks in every step stops anywhere on them.
    """
    offsets = np.stack(np.meshgrid(*[np.linspace(-1, 1, 21)] * 2), axis=-1).reshape(-1, 2)
    best: dict[str, Any] = {"total": np.inf}
    while size > 1e-6:
        points = np.vstack([centre, centre + size * offsets])
        points[:, 1] = np.maximum(points[:, 1], LOWEST)
        values = field(evaluator, points)
        at = int(np.argmin(np.where(values["cause"] < 0, values["total"], np.inf)))
        better = values["total"][at] < best["total"] - 1e-7
        best = {"p": points[at].tolist(), **{k: float(v[at]) for k, v in values.items() if k != "cause"}}
        centre, size = points[at], size if better else 0.4 * size
    return {**best, "angles_deg": np.rad2deg(elbow_up(centre[None])[0]).tolist()}


def start_sets(sets: int, starts: int, seed: int, reference: float) -> dict[str, Any]:
    """How often `place` finds the global minimum, over random start sets."""
    problem, rows = planar_problem(), []
    for number in range(sets):
        began = time.perf_counter()
        result = place(problem, starts=starts, seed=seed + number)
        rows.append(
            {
                "seed": seed + number,
                "total": result.best.total,
                "p": result.best.parameters.tolist(),
                "seconds": time.perf_counter() - began,
                "single_starts_found": sum(abs(s.total - reference) <= SAME for s in result.starts),
                "single_starts": len(result.starts),
            }
        )
        say(f"{number + 1} of {sets} start sets")
    found = [row["total"] - reference <= SAME for row in rows]
    return {
        "sets": sets,
        "starts": starts,
        "seed": seed,
        "found": int(np.sum(found)),
        "share": float(np.mean(found)),
        "single_start_share": sum(r["single_starts_found"] for r in rows)
        / sum(r["single_starts"] for r in rows),
        "least_total": min(row["total"] for row in rows),
        "worst_excess": max(row["total"] for row in rows) - reference,
        "median_seconds": float(np.median([row["seconds"] for row in rows])),
        "rows": rows,
    }


def draw(optima: list[dict[str, Any]], points: int = 241) -> Figure:
    """Constraint regions for force 0 and 5, both minima with the robot, isolines of GN, GE and the total."""
    figure = Figure(figsize=(15.0, 8.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 3)
    p1, p2, all_points = grid(points)
    loaded, free = (
        field(Evaluator(planar_problem(force, unloaded=False)), all_points) for force in (FORCE, 0.0)
    )
    for ax, values, force in ((axes[0, 0], free, 0), (axes[0, 1], loaded, FORCE)):
        _regions(ax, p1, p2, values["cause"])
        ax.set_title(f"Allowed for process force {force:g} (white)", loc="left", fontsize=11)
    _robots(axes[0, 2], optima[:2])
    feasible = (loaded["cause"] < 0) & (free["cause"] < 0)
    for ax, name, levels in (
        (axes[1, 0], "GN", np.arange(0.05, 1.0, 0.05)),
        (axes[1, 1], "GE", np.arange(0.0, 72.0, 4.0)),
        (axes[1, 2], "total", np.arange(0.0, 1.0, 0.04)),
    ):
        values = np.where(feasible, loaded[name], np.nan).reshape(points, points)
        _regions(ax, p1, p2, np.where(feasible, -1, 0), colors=("#f0f0f0",))
        lines = ax.contour(p1, p2, values, levels=levels, cmap="viridis", linewidths=1.2)
        ax.clabel(lines, fontsize=7, fmt="%g")
        ax.set_title({"total": "1/4 GN + 3/4 GE / 71"}.get(name, name), loc="left", fontsize=11)
    for ax in (axes[0, 0], axes[0, 1], *axes[1]):
        for entry, color in zip(optima[:2], (GLOBAL, LOCAL), strict=False):
            ax.plot(*entry["p"], marker="o", ms=9, mfc="none", mec=color, mew=2.2, ls="")
        ax.set_xlabel("p1: point in front of joint 1")
        ax.set_ylabel("p2: height of the point")
        ax.set_aspect("equal")
    handles = [Swatch(color=c, label=name) for c, name in zip(COLORS, CAUSES, strict=True)]
    handles += [
        Line2D([], [], marker="o", ls="", ms=9, mfc="none", mew=2.2, mec=c, label=name)
        for c, name in ((GLOBAL, "global minimum"), (LOCAL, "local minimum"))
    ]
    figure.legend(handles=handles, loc="outside lower center", ncol=len(handles), frameon=False)
    figure.suptitle("Planar placement example", fontsize=14, fontweight="bold")
    return figure


def _regions(
    ax: Any, p1: np.ndarray, p2: np.ndarray, cause: np.ndarray, colors: tuple[str, ...] = COLORS
) -> None:
    image = np.ma.masked_less(cause.reshape(len(p2), len(p1)), 0)
    cmap = ListedColormap(colors)
    ax.pcolormesh(
        p1, p2, image, cmap=cmap, vmin=-0.5, vmax=len(colors) - 0.5, shading="nearest", rasterized=True
    )


def _robots(ax: Any, optima: list[dict[str, Any]]) -> None:
    l1, _ = DIMENSIONS["link lengths"]
    height, half = (
        DIMENSIONS["height of joint 1 above the ground"],
        DIMENSIONS["axles in front of and behind joint 1"],
    )
    for entry, color in zip(optima, (GLOBAL, LOCAL), strict=False):
        q1 = np.deg2rad(entry["angles_deg"][0])
        elbow = np.array([l1 * np.cos(q1), height + l1 * np.sin(q1)])
        chain = np.array([[0.0, height], elbow, entry["p"]])
        ax.plot(*chain.T, color=color, lw=5, marker="o", ms=9, mfc="white", mew=2, solid_capstyle="round")
        x, z = entry["p"]
        ax.annotate("", (x, z), (x + 1.6, z), arrowprops={"arrowstyle": "-|>", "color": color, "lw": 1.8})
        label = f"p = ({x:.2f}, {z:.2f})\n|M| = ({abs(entry['M1']):.2f}, {abs(entry['M2']):.2f})"
        label += f"\ntotal {entry['total']:.3f}"
        ax.annotate(label, (x + 1.7, z), va="center", fontsize=9, color=color)
    ax.add_patch(Rectangle((-half, 0.35), 2 * half, height - 0.35, fc="#dddddd", ec="#5f5f5f"))
    ax.plot([-half, half], [0.3, 0.3], ls="", marker="o", ms=15, mfc="white", mec="#5f5f5f", mew=2)
    ax.axhline(0.0, color="#5f5f5f", lw=1)
    ax.set_aspect("equal")
    ax.set_xlim(-2.5, 13.0)
    ax.set_ylim(-0.6, 10.4)
    ax.set_title("The robot in both minima", loc="left", fontsize=11)


def markdown(data: dict[str, Any]) -> str:
    """The result as text."""
    found = data["start_sets"]
    lines = [
        "# Planar placement example (4.6)",
        "",
        "Our dimensions (the source's drawing is lost), gravity 1:",
        "",
    ]
    lines += [f"- {name}: {value}" for name, value in DIMENSIONS.items()]
    rows = []
    for number, e in enumerate(data["minima"]):
        cells = [f"{v:.3f}" for v in e["p"]] + [f"{v:.1f}" for v in e["angles_deg"]]
        cells += [f"{e['M1']:.3f}", f"{e['M2']:.3f}", f"{e['GN']:.4f}", f"{e['GE']:.3f}", f"{e['total']:.5f}"]
        rows.append(["local" if number else "global", *cells])
    head = ["minimum", "p1", "p2", "q1 [deg]", "q2 [deg]", "M1", "M2", "GN", "GE", "total"]
    lines += [
        "",
        *table(head, rows),
        "",
        f"{found['found']} of {found['sets']} random start sets of {found['starts']} starts found the global "
        f"minimum (total at most {SAME:g} above the grid's; {100 * found['share']:.1f} %), worst excess "
        f"{found['worst_excess']:.2g}; of the single starts {100 * found['single_start_share']:.0f} %. "
        f"Median {found['median_seconds']:.2f} s per start set.",
        "",
    ]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--sets", type=int, default=200, help="random start sets (200)")
    parser.add_argument("--starts", type=int, default=8, help="starts of each (8)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--points", type=int, default=241, help="grid points per axis (241)")
    options = parser.parse_args(arguments)
    if options.sets < 1 or options.starts < 1 or options.points < 21:
        parser.error("--sets and --starts must be at least 1, --points at least 21")
    options.out.mkdir(parents=True, exist_ok=True)
    optima = minima(Evaluator(planar_problem()), options.points)
    data = {
        "dimensions": DIMENSIONS,
        "minima": optima,
        "start_sets": start_sets(options.sets, options.starts, options.seed, optima[0]["total"]),
        "versions": versions(),
    }
    write_json(options.out / "placement_planar.json", data, indent=1)
    write_text(options.out / "placement_planar.md", markdown(data))
    with atomic_file(options.out / "placement_planar.png") as stream:
        draw(optima, options.points).savefig(stream, format="png", dpi=110)
    print(markdown(data), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
