"""Tip-over reserve of contacts in general position against a program of its own and the planar claim.

    python -m studies.contact.general_position --out results [--stands 100] [--loads 5] [--seed 0]

Random stands of 3 to 6 feet with normals tilted by up to 30 degrees and heights of up to 15 cm, under weight
and random loads that they bear. Compared is the least moment over the tipping axes (GN = M0 / (M0 + moment)):

* *ours*: `TipOver`;
* *program*: from the definition, written here anew: axes from positions and normals, and for each of them
  the largest couple that forces in Coulomb's cones can bear beside the load. Forces in base axes, moments
  about the origin, Clarabel;
* *planar claim*: the moments of the normal forces of the contact state about the axis, as on a plane.

Also: which share of the axes needs no cone program, and the time per state with and without one.

Prints the tables and writes OUT/general_position.json, .md and .png.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import clarabel
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ocptip.basics.write import versions, write_json, write_text
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve_many
from ocptip.contact.states import ContactStates
from ocptip.contact.support import Load, Support
from ocptip.numerics.cone_program import USABLE, quiet_settings, solve_cones
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver
from studies.common import machine, percent, progress, software, table

FEET = (3, 4, 5, 6)
MASS = 50.0
TILT, HEIGHT = np.radians(30.0), 0.15
FRICTION = (0.3, 0.9)
SLIP_LIMIT = 0.98
"""States with more of the friction used are left out: there the reserve is that against slipping."""

LARGEST_COUPLE = 1e4
"""N m: bound of the couple in a program; an axis about which the base jams reaches it."""

_TIMED_LOADS = 200
_ROUNDS = 5


def random_stand(rng: np.random.Generator, n: int) -> Support:
    """A base on n feet around it, each with a height, a normal and a friction of its own."""
    turn, radius = np.sort(rng.uniform(0, 2 * np.pi, n)), rng.uniform(0.3, 0.5, n)
    tilt, towards = rng.uniform(0, TILT, n), rng.uniform(0, 2 * np.pi, n)
    places = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), rng.uniform(0, HEIGHT, n)])
    normals = np.column_stack([np.sin(tilt) * np.cos(towards), np.sin(tilt) * np.sin(towards), np.cos(tilt)])
    feet = [
        UnilateralContact(position=p, normal=normal, friction=float(rng.uniform(*FRICTION)), facets=12)
        for p, normal in zip(places, normals, strict=True)
    ]
    return Support(feet, mass=MASS, center_of_mass=[*rng.uniform(-0.05, 0.05, 2), 0.35])


def random_loads(rng: np.random.Generator, support: Support, count: int) -> np.ndarray:
    """Wrenches (count, 6), N and N m: the weight and a force somewhere."""
    return np.array(
        [
            support.wrench(Load(force=rng.normal(size=3) * 60, point=rng.normal(size=3) * 0.3))
            for _ in range(count)
        ]
    )


def bearable(states: ContactStates, slip: Slip) -> np.ndarray:
    """(N,) True for states that stand and do not use up their friction."""
    return states.persistent & (slip.evaluate(states, derivatives=False).GT < SLIP_LIMIT)


# --- the definition, anew -----------------------------------------------------------------------------------


def axes_of(places: np.ndarray, normals: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Point and direction of the lines through two contacts about which a rotation drives no contact in."""
    found = []
    for i, start in enumerate(places):
        for j, end in enumerate(places):
            if i != j:
                e = (end - start) / np.linalg.norm(end - start)
                speed = np.sum(normals * np.cross(e, places - start), axis=1)
                if np.min(speed) >= -1e-9 and np.max(speed) > 1e-9:
                    found.append((start, e))
    return found


def largest_couple(
    places: np.ndarray, normals: np.ndarray, friction: np.ndarray, load: np.ndarray, e: np.ndarray
) -> float:
    """Largest couple (N m) about e beside a load (6,) about the origin that forces in the cones balance.

    Unknown are the couple and a force (3,) per contact in base axes; NaN if no forces balance the load.
    """
    n, unit = len(places), float(np.max(np.abs(load)))
    A, b = np.zeros((6, 1 + 3 * n)), -load / unit
    A[3:, 0] = e
    cones = [A]
    for k, (place, normal, mu) in enumerate(zip(places, normals, friction, strict=True)):
        columns = slice(1 + 3 * k, 4 + 3 * k)
        A[:3, columns] = np.eye(3)
        A[3:, columns] = np.cross(place, np.eye(3)).T
        cone = np.zeros((4, 1 + 3 * n))  # |f - (n.f) n| <= mu n.f
        cone[0, columns] = -mu * normal
        cone[1:, columns] = np.outer(normal, normal) - np.eye(3)
        cones.append(cone)
    bound = np.zeros((1, 1 + 3 * n))
    bound[0, 0] = 1.0
    cost = np.zeros(1 + 3 * n)
    cost[0] = -1.0
    kinds = [clarabel.ZeroConeT(6), *[clarabel.SecondOrderConeT(4)] * n, clarabel.NonnegativeConeT(1)]
    right = np.r_[b, np.zeros(4 * n), LARGEST_COUPLE / unit]
    solution = solve_cones(cost, np.vstack([*cones, bound]), right, kinds, quiet_settings(1e-11))
    return float(solution.x[0]) * unit if str(solution.status) in USABLE else float("nan")


def least_by_program(support: Support, wrench: np.ndarray) -> float:
    """Least moment over the axes, N m; NaN where there is no axis."""
    places = np.array([contact.position for contact in support.contacts])
    normals = np.array([contact.normal for contact in support.contacts])
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    friction = np.array([contact.friction for contact in support.contacts])
    load = np.r_[wrench[:3], wrench[3:] + np.cross(support.center_of_mass, wrench[:3])]
    couples = [largest_couple(places, normals, friction, load, e) for _, e in axes_of(places, normals)]
    return min(couples, default=float("nan"))


# --- the study ----------------------------------------------------------------------------------------------


def compared(feet: Sequence[int], stands: int, loads: int, seed: int) -> list[dict]:
    """One row per bearable state: feet, moments (N m) of ours, program and claim, GN, closed axes."""
    rows = []
    for n in feet:
        rng = np.random.default_rng([seed, n])
        for number in range(stands):
            support = random_stand(rng, n)
            tip_over = TipOver(support)
            wrenches = random_loads(rng, support, loads)
            if not tip_over.axes:
                continue
            states = solve_many(support, wrenches)
            states = states.select(bearable(states, Slip(support)))
            reserve = tip_over.evaluate(states)
            claims = np.min(states.contact_forces[:, :, 0] @ tip_over.lifts.T, axis=1)
            closed = tip_over.addable_moments.closed_form(states.wrenches)
            for i, wrench in enumerate(states.wrenches):
                program = least_by_program(support, wrench)
                rows.append(
                    {
                        "feet": n,
                        "ours": float(np.min(reserve.moments[i])),
                        "program": program,
                        "claim": float(claims[i]),
                        "M0": tip_over.reference_moment,
                        "GN": float(reserve.GN[i]),
                        "closed": int(np.sum(closed[i])),
                        "axes": len(tip_over.axes),
                    }
                )
            progress(number + 1, stands, f"stands of {n} feet")
    return rows


def times(feet: Sequence[int], stands: int, seed: int) -> list[dict]:
    """CPU microseconds per state with derivative, where no axis needs a cone program and where one does."""
    rows = []
    for n in feet:
        rng = np.random.default_rng([seed, n, 1])
        microseconds: dict[str, list[float]] = {"closed": [], "clarabel": []}
        for _ in range(stands):
            support = random_stand(rng, n)
            tip_over = TipOver(support)
            states = solve_many(support, random_loads(rng, support, _TIMED_LOADS))
            wrenches = states.wrenches[bearable(states, Slip(support))]
            if not tip_over.axes or not len(wrenches):
                continue
            addable = tip_over.addable_moments
            closed = np.all(addable.closed_form(wrenches), axis=1)
            for name, own in (("closed", wrenches[closed]), ("clarabel", wrenches[~closed])):
                if len(own) >= _TIMED_LOADS // 10:
                    microseconds[name].append(min(_seconds(addable, own)) / len(own) * 1e6)
        rows.append(
            {"feet": n}
            | {name: float(np.median(values)) if values else None for name, values in microseconds.items()}
        )
    return rows


def _seconds(addable, wrenches: np.ndarray) -> list[float]:
    seconds = []
    for _ in range(_ROUNDS):
        start = time.process_time()
        addable(wrenches)
        seconds.append(time.process_time() - start)
    return seconds


def summary(rows: list[dict], feet: Sequence[int]) -> list[dict]:
    """One row per number of feet, and one for all."""
    result = []
    for n in (*feet, None):
        own = [row for row in rows if n in (None, row["feet"])]
        if not own:
            continue
        ours, program, claim, M0 = (
            np.array([row[name] for row in own]) for name in ("ours", "program", "claim", "M0")
        )
        known = np.isfinite(program) & (program < 0.99 * LARGEST_COUPLE)
        off = np.abs(ours - program)[known] / np.maximum(program[known], M0[known])
        gn = np.abs(M0 / (M0 + np.maximum(ours, 0)) - M0 / (M0 + np.maximum(program, 0)))[known]
        ratio = program[known] / claim[known]
        result.append(
            {
                "feet": n,
                "states": len(own),
                "without_program": int(np.sum(~known)),
                "ratio_min": float(np.min(ratio)),
                "ratio_median": float(np.median(ratio)),
                "ratio_max": float(np.max(ratio)),
                "claim_unsafe": float(np.mean(ratio < 1 - 1e-6)),
                "largest_difference": float(np.max(off)),
                "largest_difference_GN": float(np.max(gn)),
                "closed_share": sum(row["closed"] for row in own) / sum(row["axes"] for row in own),
            }
        )
    return result


def markdown(data: dict) -> str:
    """The tables."""
    options = data["options"]
    rows = [
        [
            "all" if row["feet"] is None else str(row["feet"]),
            str(row["states"]),
            *(f"{row[name]:.2f}" for name in ("ratio_min", "ratio_median", "ratio_max")),
            percent(row["claim_unsafe"]),
            f"{row['largest_difference']:.1e}",
            f"{row['largest_difference_GN']:.1e}",
            percent(row["closed_share"]),
        ]
        for row in data["summary"]
    ]
    head = ["feet", "states", "least", "median", "largest", "claim too large", "difference", "of GN"]
    time_rows = [
        [
            str(row["feet"]),
            *("-" if row[name] is None else f"{row[name]:.3g}" for name in ("closed", "clarabel")),
        ]
        for row in data["times"]
    ]
    return "\n".join(
        [
            "# Tip-over reserve of contacts in general position",
            "",
            f"{options['stands']} random stands per number of feet, normals tilted by up to "
            f"{np.degrees(TILT):.0f} degrees, heights up to {100 * HEIGHT:.0f} cm, {options['loads']} loads "
            f"each, of which those count that are borne with GT < {SLIP_LIMIT:g}; seed {options['seed']}.",
            "",
            "*Least, median, largest*: true moment (cone program written for this study) to the planar claim "
            "(moments of the normal forces of the contact state); below 1 the claim is on the unsafe side. "
            "*Difference*: largest, of `TipOver` from the program, relative to the moment or M0. *Closed "
            "form*: share of the axes that needed no cone program in `TipOver`.",
            "",
            *table([*head, "closed form"], rows),
            "",
            f"Left out: {data['summary'][-1]['without_program']} states whose program was not solved, or in "
            "which the base jams about every axis.",
            "",
            "## Time",
            "",
            "CPU microseconds per state with derivative, about all axes: states where no axis needs "
            f"Clarabel, and where one does (median over stands, fastest of {_ROUNDS} rounds each).",
            "",
            *table(["feet", "closed form", "with Clarabel"], time_rows),
            "",
            f"{software(data['versions'])}; {data['machine']['architecture']}, "
            f"{data['machine']['cores']} cores.",
            "",
        ]
    )


def draw(rows: list[dict], path: Path) -> None:
    """Claimed against true reserve, a point per state."""
    M0, program, claim = (np.array([row[name] for row in rows]) for name in ("M0", "program", "claim"))
    true, claimed = M0 / (M0 + np.maximum(program, 0)), M0 / (M0 + np.maximum(claim, 0))
    figure = Figure(figsize=(6, 5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    for n in sorted({row["feet"] for row in rows}):
        own = np.array([row["feet"] == n for row in rows])
        axes.plot(claimed[own], true[own], ".", markersize=4, label=f"{n} feet")
    low, high = 0.9 * float(np.nanmin([true, claimed])), 1.1 * float(np.nanmax([true, claimed]))
    axes.plot([low, high], [low, high], color="0.4", linewidth=1)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_title("Above the line the base is nearer to tipping than claimed", fontsize=10)
    axes.set_xlabel("GN from normal forces alone (planar claim)")
    axes.set_ylabel("GN with friction (cone program)")
    axes.legend(loc="lower right")
    figure.savefig(path, dpi=120)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for table and figure")
    parser.add_argument("--stands", type=int, default=100, help="per number of feet")
    parser.add_argument("--loads", type=int, default=5, help="per stand")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--feet", type=int, nargs="+", default=list(FEET))
    options = parser.parse_args(argv)
    if min(options.stands, options.loads, options.feet[0] - 2) < 1:
        parser.error("all numbers must be at least 1, feet at least 3")
    options.out.mkdir(parents=True, exist_ok=True)
    rows = compared(options.feet, options.stands, options.loads, options.seed)
    data = {
        "options": {name: value for name, value in vars(options).items() if name != "out"},
        "versions": versions(("numpy", "scipy", "llvmlite", "clarabel")),
        "machine": machine(),
        "summary": summary(rows, options.feet),
        "times": times(options.feet, max(1, options.stands // 4), options.seed),
    }
    text = markdown(data)
    write_json(options.out / "general_position.json", data, indent=1)
    write_text(options.out / "general_position.md", text)
    draw(rows, options.out / "general_position.png")
    print(text, end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
