"""Contact states and verdicts against linear programs and an enumeration of modes.

    python -m studies.contact.linear_programs --out results [--problems 20000] [--enumerated 300] [--seed 0]

1. Ordinary contacts, spatial, nasty on purpose (friction down to 1e-6, contacts in one place or on one line,
   normals that face each other, loads of 1e-9 N to 1e6 N, a third of them exactly degenerate): a linear
   program finds the forces along the edges of the friction pyramids that come nearest to the balance of the
   load. Where none balance it, no state may stand, and the convex test must say so; where some do, it must,
   too.
2. Planar bases on 2 and 3 contacts: all combinations of lifting off, sticking and sliding either way, written
   down from the contact laws, each with a linear program for the largest power of the load. Verdicts must be
   those that follow: none, weak or strong.

Prints the tables and writes OUT/linear_programs.json and .md.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.optimize import linprog

from ocptip.basics.write import versions, write_json, write_text
from ocptip.contact.bindings.pyramid import corrected_friction, edge_directions
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Support
from ocptip.contact.verdict import equilibrium, stability
from studies.common import machine, progress, software, table
from studies.contact.random_supports import random_support, random_wrenches

WRENCHES = 10
BALANCED, UNBALANCED = 1e-9, 1e-7
"""Relative residuals up to which, and from which on, a program decides; between them it is left open."""

STILL, MOVING = 1e-10, 1e-6
"""The same of the power, relative to that of the free base."""


def nasty_support(rng: np.random.Generator) -> Support:
    """Ordinary contacts with what is troublesome: tiny friction, coinciding or facing contacts."""
    support = random_support(rng, clamps=False)
    if rng.random() < 0.5:
        return support
    contacts = list(support.contacts)
    if rng.random() < 0.5:
        contacts = [replace(c, friction=float(10 ** rng.uniform(-6, 0.5))) for c in contacts]
    layout = rng.integers(4)
    if layout == 0:  # two in one place
        contacts[1] = replace(contacts[1], position=contacts[0].position)
    elif layout == 1:  # all on a line
        way = rng.normal(size=3)
        contacts = [replace(c, position=rng.uniform(-0.5, 0.5) * way) for c in contacts]
    elif layout == 2:  # a jam
        contacts[1] = replace(contacts[1], normal=-np.asarray(contacts[0].normal))
    return support.varied(contacts)


def imbalance(support: Support, wrench: np.ndarray) -> float:
    """Least sum of what forces along the edges of the pyramids leave of a wrench, relative to it.

    Moments are divided by the support's length.
    """
    edges = []
    for contact, frame, arm in zip(support.contacts, support.frames, support.arms, strict=True):
        slope = corrected_friction(contact.friction, contact.facets) / np.cos(np.pi / contact.facets)
        for x, y in np.asarray(edge_directions(contact.facets)):
            force = frame @ [1.0, slope * x, slope * y]
            edges.append(np.r_[force, np.cross(arm, force) / support.length])
    load = np.r_[wrench[:3], wrench[3:] / support.length]
    size = np.max(np.abs(load))
    if size == 0:
        return 0.0
    A = np.hstack([np.array(edges).T, np.eye(6), -np.eye(6)])
    program = linprog(
        np.r_[np.zeros(len(edges)), np.ones(12)],
        A_eq=A,
        b_eq=-load / size,
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    return float(program.fun) if program.status == 0 else float("nan")


def against_programs(problems: int, seed: int) -> dict:
    """Part 1: counts, and the problems on which the answers differ (support, wrench, residual)."""
    counts: Counter[str] = Counter()
    different = []
    for number in range(-(-problems // WRENCHES)):
        rng = np.random.default_rng([seed, number])
        support = nasty_support(rng)
        wrenches = random_wrenches(rng, support, WRENCHES)
        states = solve_many(support, wrenches, warm_start=False)
        for i, wrench in enumerate(wrenches):
            left = imbalance(support, wrench)
            word = "balanced" if left <= BALANCED else "unbalanced" if left >= UNBALANCED else "open"
            counts[word] += 1
            counts["not solved"] += not states.solved[i]
            counts["stand"] += bool(states.persistent[i])
            counts["balanced, but the state moves"] += word == "balanced" and not states.persistent[i]
            convex = equilibrium(support, wrench, cone=False).stands
            wrong = word == "unbalanced" and (states.persistent[i] or convex)
            wrong |= word == "balanced" and not convex
            if wrong:
                different.append([number, i, left, bool(states.persistent[i]), convex])
        progress(number + 1, -(-problems // WRENCHES), "supports")
    return {"counts": dict(counts), "different": different}


def planar_support(rng: np.random.Generator) -> Support:
    """A planar base on 2 or 3 ordinary contacts, on a floor or in a wedge."""
    n = int(rng.integers(2, 4))
    normals = [0.0, 1.0] + rng.normal(size=(n, 2)) * rng.choice([0.0, 0.3, 1.5])
    contacts = [
        UnilateralContact(position=p, normal=q, friction=float(rng.uniform(0.05, 1.5)))
        for p, q in zip(rng.uniform(-0.5, 0.5, (n, 2)), normals, strict=True)
    ]
    return Support(contacts, mass=60.0, center_of_mass=[0.0, 0.6], inertia=float(rng.uniform(0.5, 6.0)))


def largest_power(support: Support, wrench: np.ndarray) -> tuple[float, float]:
    """Over all combinations of planar modes: the smallest and the largest power, relative to the free base's.

    The power of the load on the base's acceleration; zero in a solution that stands. (inf, -inf): no mode.
    """
    n, W = support.n_contacts, support.wrench_matrix
    free = wrench @ support.inverse_mass @ wrench
    unit = float(np.max(np.abs(wrench)))
    power = W.T @ support.inverse_mass @ wrench / free * unit  # per force, in units
    moved, start = W.T @ support.inverse_mass @ W, W.T @ support.inverse_mass @ wrench / unit
    friction = [contact.friction for contact in support.contacts]
    least, most = np.inf, -np.inf
    for modes in itertools.product(("lift", "stick", "left", "right"), repeat=n):
        equal, below = [], []  # rows (of the forces, of the acceleration) = 0 or <= 0
        for k, mode in enumerate(modes):
            N, T = np.eye(2 * n)[2 * k], np.eye(2 * n)[2 * k + 1]
            none = np.zeros(2 * n)
            below.append((-N, none))
            if mode == "lift":
                equal += [(N, none), (T, none)]
                below.append((none, -N))
                continue
            equal.append((none, N))
            if mode == "stick":
                equal.append((none, T))
                below += [(T - friction[k] * N, none), (-T - friction[k] * N, none)]
            else:
                way = 1.0 if mode == "right" else -1.0
                equal.append((T + way * friction[k] * N, none))
                below.append((none, -way * T))
        A_eq, b_eq = _rows(equal, moved, start)
        A_ub, b_ub = _rows(below, moved, start)
        for sign in (1.0, -1.0):
            program = linprog(
                sign * power, A_ub=A_ub, b_ub=b_ub, A_eq=A_eq, b_eq=b_eq, bounds=(None, None), method="highs"
            )
            if program.status == 3:  # a jam: the power is bounded all the same, the forces are not
                program = linprog(
                    sign * power,
                    A_ub=A_ub,
                    b_ub=b_ub,
                    A_eq=A_eq,
                    b_eq=b_eq,
                    bounds=(-1e6, 1e6),
                    method="highs",
                )
            if program.status == 0:
                value = 1.0 + sign * program.fun
                least, most = min(least, value), max(most, value)
    return least, most


def _rows(
    conditions: list[tuple[np.ndarray, np.ndarray]], moved: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rows on forces K of conditions force . K + acceleration . (moved K + start)."""
    A = np.array([force + acceleration @ moved for force, acceleration in conditions])
    return A, -np.array([acceleration @ start for _, acceleration in conditions])


def against_enumeration(problems: int, seed: int) -> dict:
    """Part 2: counts of verdicts, and the problems on which the answers differ."""
    counts: Counter[str] = Counter()
    different = []
    for number in range(problems):
        rng = np.random.default_rng([seed, 1, number])
        support = planar_support(rng)
        push = rng.normal(size=3) * [200, 200, 60] * rng.uniform(0, 1)
        wrench = support.weight + push
        least, most = largest_power(support, wrench)
        if STILL < least < MOVING or STILL < most < MOVING:
            counts["open"] += 1
            continue
        expected = "none" if least >= MOVING else "strong" if most <= STILL else "weak"
        verdict = stability(support, wrench)
        counts[verdict.verdict if verdict.decided else "undecided"] += 1
        if verdict.decided and verdict.verdict != expected:
            different.append([number, verdict.verdict, expected, least, most])
        progress(number + 1, problems, "planar problems")
    return {"counts": dict(counts), "different": different}


def markdown(data: dict) -> str:
    """The tables."""
    parts, options, made = [], data["options"], data["machine"]
    for title, part in (
        ("Spatial contacts against linear programs on their pyramids", data["programs"]),
        ("Planar contacts against an enumeration of their modes", data["enumeration"]),
    ):
        rows = [[name, str(value)] for name, value in sorted(part["counts"].items())]
        rows.append(["**answers that differ**", f"**{len(part['different'])}**"])
        parts += [f"## {title}", "", *table(["", "problems"], rows), ""]
    return "\n".join(
        [
            "# Contact states and verdicts against linear programs",
            "",
            f"{options['problems']} spatial problems, {options['enumerated']} planar ones, seed "
            f"{options['seed']}. *Open*: what the programs leave is between {BALANCED:g} and "
            f"{UNBALANCED:g} of the load (planar: the power between {STILL:g} and {MOVING:g} of the free "
            "base's).",
            "",
            *parts,
            f"{software(data['versions'])}; {made['architecture']}, {made['cores']} cores.",
            "",
        ]
    )


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for the table")
    parser.add_argument("--problems", type=int, default=20_000, help="spatial, for linear programs")
    parser.add_argument("--enumerated", type=int, default=300, help="planar, for the enumeration of modes")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(argv)
    if min(options.problems, options.enumerated) < 1:
        parser.error("all numbers must be at least 1")
    options.out.mkdir(parents=True, exist_ok=True)
    data = {
        "options": {name: value for name, value in vars(options).items() if name != "out"},
        "versions": versions(("numpy", "scipy", "llvmlite", "clarabel")),
        "machine": machine(),
        "programs": against_programs(options.problems, options.seed),
        "enumeration": against_enumeration(options.enumerated, options.seed),
    }
    text = markdown(data)
    write_json(options.out / "linear_programs.json", data, indent=1)
    write_text(options.out / "linear_programs.md", text)
    print(text, end="")
    return 0 if not data["programs"]["different"] + data["enumeration"]["different"] else 1


if __name__ == "__main__":
    sys.exit(main())
