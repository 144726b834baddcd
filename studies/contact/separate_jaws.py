"""A clamp reduced to one point (3.2) against one whose two jaws are contacts of their own, a distance apart.

The reduced clamp has the sum of the jaws' forces in one point. In fact the tangential forces of both jaws act
where the jaws are: half the distance above and below that point along the normal, which adds a moment to the
balance. Asked is how large a push at the gripper the base of case C (K3 clamped) can bear at rest, in 24
horizontal directions and as many that also lift by half as much: the greatest factor of the push for which
forces within Coulomb's cones and the clamp's law for its normal forces balance the load. That is a cone
program, for the reduced clamp (distance 0) as well; there the library's own verdict has to agree.

    python -m studies.contact.separate_jaws --out studies/results
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import clarabel
import matplotlib
import numpy as np

from ocptip.basics.write import versions, write_json, write_text
from ocptip.contact.bindings.binding import Binding
from ocptip.contact.bindings.clamps import (
    ForceConstantHalfRigidClamp,
    ForceConstantTwoSidedClamp,
    ForceVariableHalfRigidClamp,
    ForceVariableTwoSidedClamp,
)
from ocptip.contact.support import Support
from ocptip.contact.verdict import equilibrium
from ocptip.numerics.cone_program import USABLE, quiet_settings, solve_cones
from ocptip.published.tasks import experiment_task
from studies.common import number, software, table

DISTANCES = 0.0, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0  # mm
DIRECTIONS = 24
LIFT = 0.5
HUGE = 1e4  # of a push of 1 N: nothing limits it
CLAMPS = (
    ForceConstantHalfRigidClamp,
    ForceVariableHalfRigidClamp,
    ForceConstantTwoSidedClamp,
    ForceVariableTwoSidedClamp,
)


@dataclass(frozen=True)
class Piece:
    """A convex piece of a clamp's law for the normal forces of its jaws N = (upper, lower) >= 0.

    Attributes:
        fixed: rows (2,) with fixed . N = first number.
        least: rows (2,) with least . N >= number.
    """

    fixed: tuple[tuple[float, float, float], ...] = ()
    least: tuple[tuple[float, float, float], ...] = ()


def pieces_of(clamp: Binding) -> list[Piece]:
    """Of the law of a preloaded clamp, each row (upper, lower, number), N."""
    force = vars(clamp)["clamp_force"]
    if isinstance(clamp, ForceConstantHalfRigidClamp):
        return [Piece(fixed=((0, 1, force),))]
    if isinstance(clamp, ForceVariableHalfRigidClamp):
        return [Piece(fixed=((0, 1, force),)), Piece(fixed=((1, 0, 0),), least=((0, 1, force),))]
    if not isinstance(clamp, ForceConstantTwoSidedClamp | ForceVariableTwoSidedClamp):
        raise TypeError(clamp.kind)
    i = clamp.lever_ratio
    both = Piece(fixed=((i / (1 + i), 1 / (1 + i), force),))
    if isinstance(clamp, ForceConstantTwoSidedClamp):
        return [both]
    upper = Piece(fixed=((0, 1, 0),), least=((1, 0, clamp.upper_force),))
    lower = Piece(fixed=((1, 0, 0),), least=((0, 1, clamp.lower_force),))
    return [both, upper, lower]


def largest_push(support: Support, load: np.ndarray, push: np.ndarray, distance: float) -> float:
    """The greatest factor of a wrench `push` (6,) beside `load` (6,) that is borne; -inf: not even none.

    The last contact is a clamp whose jaws are `distance`, m, apart along its normal.
    """
    return max(_bounded(support, load, push, distance, piece) for piece in pieces_of(support.contacts[-1]))


def _bounded(support: Support, load: np.ndarray, push: np.ndarray, distance: float, piece: Piece) -> float:
    """Of one piece: maximise x0; then a force (3,), contact axes, of each foot and of both jaws."""
    *feet, clamp = support.contacts
    normal, frame = support.frames[-1][:, 0], support.frames[-1]
    arms = [*support.arms[:-1], *(support.arms[-1] + side * normal * distance / 2 for side in (1, -1))]
    frames = [*support.frames[:-1], frame, frame]
    maps = [np.vstack([f, np.cross(arm, f.T).T]) for arm, f in zip(arms, frames, strict=True)]
    size = 1 + 3 * len(maps)
    balance = np.hstack([push[:, None], *maps])
    frictions = [*(foot.friction for foot in feet), clamp.friction_upper, clamp.friction_lower]  # type: ignore
    signs = [1.0] * (len(maps) - 1) + [-1.0]
    rows, right, cones = [balance], [-load], [clarabel.ZeroConeT(6)]
    upper, lower = size - 6, size - 3

    def add(rule: Sequence[tuple[float, float, float]], cone: Any, sign: float) -> None:
        for a, b, value in rule:
            row = np.zeros((1, size))
            row[0, upper], row[0, lower] = sign * a, -sign * b  # the lower jaw pushes against the normal
            rows.append(row)
            right.append(np.array([sign * value]))
            cones.append(cone(1))

    add(piece.fixed, clarabel.ZeroConeT, 1.0)
    add(piece.least, clarabel.NonnegativeConeT, -1.0)
    for k, (friction, sign) in enumerate(zip(frictions, signs, strict=True)):
        cone = np.zeros((3, size))
        cone[0, 1 + 3 * k] = -sign * friction
        cone[1, 2 + 3 * k] = cone[2, 3 + 3 * k] = -1.0
        rows.append(cone)
        right.append(np.zeros(3))
        cones.append(clarabel.SecondOrderConeT(3))
    limit = np.zeros((1, size))
    limit[0, 0] = 1.0
    rows.append(limit)
    right.append(np.array([HUGE]))
    cones.append(clarabel.NonnegativeConeT(1))
    cost = np.zeros(size)
    cost[0] = -1.0
    found = solve_cones(cost, np.vstack(rows), np.concatenate(right), cones, quiet_settings(1e-10))
    return float(found.x[0]) if str(found.status) in USABLE else -np.inf


def clamped(kind: type[Binding]) -> tuple[Support, np.ndarray, np.ndarray]:
    """Base of case C with this clamp, its load at rest at the start (6,), and the gripper's place (3,)."""
    task = experiment_task("C")
    own, still = task.robot.support, np.zeros((1, task.robot.n))
    last = own.contacts[-1]
    same = {key: getattr(last, key) for key in ("position", "normal", "facets", "tangent")}
    same |= {key: getattr(last, key) for key in ("friction_upper", "friction_lower", "clamp_force")}
    support = own.varied([*own.contacts[:-1], kind(**same)])
    load = task.robot.loads(task.start[None], still, still)[1][0]
    return support, load, task.robot.tool(task.start[None])[0]


def pushes(support: Support, place: np.ndarray) -> np.ndarray:
    """(2 x DIRECTIONS, 6): of 1 N horizontally, then with a share upwards."""
    angles = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    level = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(DIRECTIONS)])
    forces = np.vstack([level, level + np.array([0.0, 0.0, LIFT])])
    arm = place - support.center_of_mass
    return np.hstack([forces, np.cross(arm, forces)])


def agrees(support: Support, load: np.ndarray, push: np.ndarray, factor: float) -> bool:
    """The library's verdict on the reduced clamp: it stands a little below the factor, and not above."""
    below, above = (equilibrium(support, load + share * factor * push) for share in (0.999, 1.001))
    return below.stands and not above.stands


def compared(kind: type[Binding]) -> dict[str, Any]:
    """Greatest pushes, N, by distance and direction."""
    support, load, place = clamped(kind)
    wrenches = pushes(support, place)
    found = [[largest_push(support, load, push, d / 1e3) for push in wrenches] for d in DISTANCES]
    same = [agrees(support, load, push, factor) for push, factor in zip(wrenches, found[0], strict=True)]
    return {"clamp": kind.kind, "pushes_N": found, "agree": int(np.sum(same)), "count": len(same)}


def wedged() -> dict[str, int]:
    """How many pushes two rigid jaws without preload bear whatever their size, by distance, mm."""
    support, load, place = clamped(CLAMPS[0])
    wrenches = pushes(support, place)
    found = {}
    for distance in DISTANCES:
        bounds = [_bounded(support, load, push, distance / 1e3, Piece()) for push in wrenches]
        found[f"{distance:g}"] = int(np.sum(np.array(bounds) > 0.99 * HUGE))
    return found


def errors(row: dict[str, Any]) -> np.ndarray:
    """(distances, directions): by which share the reduced clamp bears more than the one with jaws apart."""
    found = np.array(row["pushes_N"])
    return found[0] / found - 1


def markdown(result: dict[str, Any]) -> str:
    """The page."""
    rows = []
    for row in result["rows"]:
        for distance, own in zip(DISTANCES[1:], errors(row)[1:], strict=True):
            cells = [100 * value for value in (own.min(), np.median(own), own.max())]
            rows.append([row["clamp"], f"{distance:g}", *(number(cell, 2) for cell in cells)])
    agree = sum(row["agree"] for row in result["rows"])
    count = sum(row["count"] for row in result["rows"])
    lines = [
        "# Jaws apart",
        "",
        f"{software(result['versions'])}. Base of case C (triangle of 0.3 m, friction 0.2, K3 clamped with "
        "29.33 N), arm at rest at the start; the greatest push at the gripper, in "
        f"{DIRECTIONS} horizontal directions and as many obliquely upwards, that the base bears with the "
        "clamp reduced to one point, and with jaws apart.",
        "",
        "By how much the reduced clamp bears more (per cent; negative: less), over the directions. With the "
        "clamp reduced, the library's verdict agrees a thousandth below and above in "
        f"{agree} of {count} pushes.",
        "",
        *table(["clamp", "jaws apart [mm]", "least [%]", "median [%]", "most [%]"], rows, left=1),
        "",
        "![Errors over the distance](separate_jaws.png)",
        "",
        "Two *rigid* jaws without preload are not in the table: as two contacts they can wedge, and only the "
        f"contact laws say which of these forces come about. Of {2 * DIRECTIONS} pushes they balance "
        + ", ".join(f"{n} at {d} mm" for d, n in result["wedged"].items())
        + f" up to {HUGE:g} N and more.",
    ]
    return "\n".join(lines) + "\n"


def figure(result: dict[str, Any], path: Path) -> None:
    """Median and range of the errors over the distance."""
    matplotlib.use("Agg")
    from matplotlib import pyplot

    drawn, axes = pyplot.subplots(figsize=(7, 4.2))
    for row in result["rows"]:
        own = 100 * errors(row)
        (line,) = axes.plot(DISTANCES, np.median(own, axis=1), label=row["clamp"])
        axes.fill_between(DISTANCES, own.min(axis=1), own.max(axis=1), color=line.get_color(), alpha=0.15)
    axes.set_xlabel("distance of the jaws [mm]")
    axes.set_ylabel("reduced clamp bears more [%]")
    axes.set_title("Median and range over directions of a push", loc="left", fontsize=10)
    axes.legend(frameon=False, fontsize=8)
    axes.grid(color="#ececec")
    drawn.tight_layout()
    drawn.savefig(path, dpi=130, metadata={"Software": None})
    pyplot.close(drawn)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    result = {
        "versions": versions(("numpy", "scipy", "clarabel")),
        "distances_mm": DISTANCES,
        "rows": [compared(kind) for kind in CLAMPS],
        "wedged": wedged(),
    }
    write_json(options.out / "separate_jaws.json", result, indent=1)
    write_text(options.out / "separate_jaws.md", markdown(result))
    figure(result, options.out / "separate_jaws.png")
    print(markdown(result), end="")


if __name__ == "__main__":
    main()
