"""One million random contact problems: is there one failure, one wrong answer?

Every problem is solved from scratch (no warm start) and judged by a check that shares nothing with the
solver: the contact laws and the equation of motion, `ContactStates.law_violation`. A reported "no
solution" counts as right only because it is the outcome of a search over all modes; the number of those
is printed. In a share of the problems the verdict is compared with the convex equilibrium test.

Resumable: finished chunks are kept in the output folder with the state of the source that made them; start
again to go on.

    python -m studies.contact.random_problems --out results/random_problems --problems 1000000
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import numpy as np

from ocptip.basics.errors import SolverError
from ocptip.basics.write import versions, write_json
from ocptip.contact.solver import solve_many
from ocptip.contact.verdict import equilibrium
from studies.common import progress, source_state
from studies.contact.random_supports import random_support, random_wrenches

WRENCHES = 20
CHUNK = 20_000
WRONG = 1e-8
"""Violation of the contact laws (relative to the largest right-hand side) that counts as wrong."""

COMPARED_SHARE = 0.01


def run_chunk(seed: int, chunk: int) -> dict:
    """Solve one chunk of problems and count what happened."""
    rng = np.random.default_rng([seed, chunk])
    attempts: Counter[str] = Counter()
    contacts: Counter[str] = Counter()
    worst_residual = worst_law = 0.0
    pivots, wrong, unsolved, compared, disagree, degenerate = 0, [], [], 0, [], 0
    seconds = 0.0
    for number in range(CHUNK // WRENCHES):
        planar = number % 5 == 4
        support = random_support(rng, clamps=number % 2 == 1, planar=planar)
        wrenches = random_wrenches(rng, support, WRENCHES)
        support.system  # noqa: B018  (assembled once, outside the timing)
        start = time.perf_counter()
        states = solve_many(support, wrenches, warm_start=False)
        seconds += time.perf_counter() - start
        violation = states.law_violation()
        name = f"chunk {chunk} support {number}"
        for i in range(WRENCHES):
            clamped = any(c.kind != "unilateral" for c in support.contacts)
            contacts[f"{support.n_contacts}{' planar' if planar else ''}{' clamps' if clamped else ''}"] += 1
            if not states.solved[i]:
                unsolved.append([name, i, states.status(i), [c.kind for c in support.contacts]])
                continue
            attempts[str(int(states.attempts[i]))] += 1
            degenerate += bool(np.any(states.basic[i] <= 1e-12 * np.max(states.basic[i], initial=0)))
            if not violation[i] <= WRONG:
                wrong.append([name, i, float(violation[i])])
        if np.any(states.solved):
            worst_residual = max(worst_residual, float(np.max(states.residual[states.solved])))
            worst_law = max(worst_law, float(np.nanmax(violation)))
        pivots = max(pivots, int(np.max(states.pivots)))
        if rng.random() < COMPARED_SHARE * WRENCHES / 4:
            for i in range(4):
                compared += 1
                try:
                    balance = equilibrium(support, wrenches[i], cone=False)
                except SolverError as error:
                    disagree.append([name, i, str(error)])
                    continue
                # a standing solution must be confirmed; a moving one beside it is weak stability. Loads
                # below the resolution beside large preloads are left out: there rest means nothing
                resolved = np.max(np.abs(wrenches[i])) > 1e-6 * states.scale[i] * support.mass
                if states.persistent[i] and not balance.stands and resolved:
                    disagree.append([name, i, balance.margin])
    return {
        "chunk": chunk,
        "problems": CHUNK,
        "attempts": dict(attempts),
        "contacts": dict(contacts),
        "worst_residual": worst_residual,
        "worst_law_violation": worst_law,
        "max_pivots": pivots,
        "degenerate": degenerate,
        "wrong": wrong,
        "unsolved": unsolved,
        "compared_with_equilibrium": compared,
        "disagreements": disagree,
        "solve_seconds": seconds,
    }


def state() -> str:
    """Short digest of the solver's source code and of all versions."""
    return source_state("contact")


def summary(chunks: list[dict], seed: int) -> dict:
    """Add up the chunks."""
    attempts, contacts = Counter(), Counter()
    for c in chunks:
        attempts.update(c["attempts"])
        contacts.update(c["contacts"])
    total = sum(c["problems"] for c in chunks)
    unsolved = [u for c in chunks for u in c["unsolved"]]
    return {
        "problems": total,
        "wrong_answers": sum(len(c["wrong"]) for c in chunks),
        "no_solution_proved": sum("no solution exists" in u[2] for u in unsolved),
        "failures": sum("no solution exists" not in u[2] for u in unsolved),
        "worst_residual": max(c["worst_residual"] for c in chunks),
        "worst_law_violation": max(c["worst_law_violation"] for c in chunks),
        "degenerate_solutions": sum(c["degenerate"] for c in chunks),
        "max_pivots": max(c["max_pivots"] for c in chunks),
        "attempts (1 guessed start, 2.. other starts, -1 search over all modes)": dict(
            sorted(attempts.items(), key=lambda item: -item[1])
        ),
        "contacts": dict(sorted(contacts.items())),
        "compared_with_equilibrium": sum(c["compared_with_equilibrium"] for c in chunks),
        "disagreements": [d for c in chunks for d in c["disagreements"]],
        "wrong": [w for c in chunks for w in c["wrong"]],
        "unsolved": unsolved[:50],
        "microseconds_per_problem": 1e6 * sum(c["solve_seconds"] for c in chunks) / total,
        "seed": seed,
        "versions": versions(("numpy", "scipy", "llvmlite")),
        "chunks_of_another_state_of_the_source": sum(c.get("state") not in (None, state()) for c in chunks),
        "chunks_of_an_unknown_state_of_the_source": sum("state" not in c for c in chunks),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for chunks and the summary")
    parser.add_argument("--problems", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    count = -(-options.problems // CHUNK)
    paths = [options.out / f"chunk_{options.seed}_{i:04d}.json" for i in range(count)]
    todo = [i for i in range(count) if not paths[i].exists()]
    state()  # before the work, during which the source may change
    with ProcessPoolExecutor(options.workers) as pool:
        futures = {pool.submit(run_chunk, options.seed, i): i for i in todo}
        for done, future in enumerate(as_completed(futures), 1):
            i, result = futures[future], future.result()
            write_json(paths[i], {**result, "state": state()}, indent=None)
            progress(done, len(todo), "chunks")
    total = summary([json.loads(p.read_text()) for p in paths], options.seed)
    write_json(options.out / "random_problems.json", total)
    for key, value in total.items():
        print(f"{key}: {value}")


if __name__ == "__main__":
    main()
