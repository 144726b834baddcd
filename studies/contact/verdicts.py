"""Strong verdicts of feet in one plane: how long they take, and whether another search contradicts them.

    python -m studies.contact.verdicts --out results [--stands 22] [--checked 200] [--seed 0]

1. Random stands of 4 to 16 feet, on a circle and scattered, with friction of their own, under random loads
   that admissible forces can balance: verdicts and seconds of `stability`. Target: all decided, median 0.5 s.
2. Stands of 3 to 8 feet: contact forces are found by projection onto the true cones, contact by contact, from
   many random starts. It knows nothing of modes, pyramids, triangles or certificates. Where it ends in a
   motion, the verdict must not be strong. So it must not where pivoting with 128 facets finds a motion.

Prints the tables and writes OUT/contact_verdicts.json and .md.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ocptip.basics.write import versions, write_json, write_text
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve_randomly
from ocptip.contact.support import Load, Support
from ocptip.contact.verdict import equilibrium, stability
from studies.common import machine, progress, table

FEET = (4, 6, 8, 12, 16)
CHECKED_FEET = (3, 9)  # from, below
TARGET = 0.5  # s
CLEAR = 1e-4  # acceleration of a motion, relative to the free base's
FINE = 128  # facets
_CONVERGED = 1e-11
_RELAXATION = 1.0


def random_stand(rng: np.random.Generator, n: int, layout: str, facets: int = 8) -> Support:
    """A 50 kg base on n feet in one plane: on a "circle" with one friction, or "scattered" with n."""
    if layout == "circle":
        angles = 2 * np.pi * np.arange(n) / n
        feet = 0.4 * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(n)])
        friction = np.full(n, 0.5)
    else:
        feet = np.column_stack([rng.uniform(-0.5, 0.5, (n, 2)), np.zeros(n)])
        friction = rng.uniform(0.2, 1.0, n)
    contacts = [
        UnilateralContact(position=p, friction=mu, facets=facets)
        for p, mu in zip(feet, friction, strict=True)
    ]
    center = [*feet[:, :2].mean(axis=0), 0.4]
    return Support(contacts, mass=50.0, center_of_mass=center, inertia=[3.0, 4.0, 5.0])


def random_load(rng: np.random.Generator, support: Support) -> np.ndarray:
    """Weight and a push somewhere, from none to one that slides most stands."""
    push = np.r_[rng.normal(size=2) * 120, rng.normal() * 40] * rng.uniform(0, 1.5)
    return support.wrench(Load(force=push, point=rng.uniform([-0.4, -0.4, 0.0], [0.4, 0.4, 0.8])))


def standing_case(rng: np.random.Generator, n: int, layout: str) -> tuple[Support, np.ndarray]:
    """A stand and a load that admissible forces balance."""
    while True:
        support = random_stand(rng, n, layout)
        wrench = random_load(rng, support)
        if equilibrium(support, wrench).stands:
            return support, wrench


def moves_by_projection(support: Support, wrench: np.ndarray, starts: int, sweeps: int, seed: int) -> bool:
    """True if projection onto Coulomb's cones from random forces ends in a motion.

    One contact after the other, K <- the admissible force nearest to K - r u(K), first normal, then
    tangential; its fixed points obey the contact laws.
    """
    rng = np.random.default_rng(seed)
    n, inverse = support.n_contacts, support.inverse_mass
    W = support.wrench_matrix.reshape(6, n, 3).swapaxes(0, 1)
    responses = [inverse @ own for own in W]
    steps = [_RELAXATION / np.linalg.eigvalsh(own.T @ r)[-1] for own, r in zip(W, responses, strict=True)]
    friction = [contact.friction for contact in support.contacts]
    size = np.max(np.abs(wrench))
    forces = rng.normal(size=(n, starts, 3)) * size * 10.0 ** rng.uniform(-2, 0.5, (starts, 1))
    for k in range(n):
        forces[k] = _admissible(forces[k], friction[k])
    motion = wrench @ inverse + sum(f @ r.T for f, r in zip(forces, responses, strict=True))
    for _ in range(sweeps):
        change = np.zeros(starts)
        for k in range(n):
            new = _admissible(forces[k] - steps[k] * (motion @ W[k]), friction[k])
            motion += (new - forces[k]) @ responses[k].T
            change = np.maximum(change, np.max(np.abs(new - forces[k]), axis=1))
            forces[k] = new
        if np.max(change) <= _CONVERGED * size:
            break
    free = np.linalg.norm(wrench @ inverse)
    return bool(np.any((change <= _CONVERGED * size) & (np.linalg.norm(motion, axis=1) > CLEAR * free)))


def _admissible(forces: np.ndarray, friction: float) -> np.ndarray:
    normal = np.maximum(forces[:, 0], 0.0)
    length = np.linalg.norm(forces[:, 1:], axis=1)
    share = np.minimum(1.0, friction * normal / np.where(length > 0, length, 1.0))
    return np.column_stack([normal, share[:, None] * forces[:, 1:]])


def moves_with_fine_pyramids(support: Support, wrench: np.ndarray) -> bool:
    """True if pivoting from random starts finds a clear motion with `FINE` facets."""
    fine = support.varied(
        [UnilateralContact(position=c.position, friction=c.friction, facets=FINE) for c in support.contacts]
    )
    states = solve_randomly(fine, wrench, 64)
    fastest = np.max(np.abs(states.contact_accelerations), axis=(1, 2))
    return bool(np.any(states.solved & (fastest > 100 * CLEAR * states.scale)))


def times(feet: Sequence[int], stands: int, seed: int) -> list[dict]:
    """Part 1: one row per number of feet and layout."""
    rng = np.random.default_rng(seed)
    stability(*standing_case(rng, 4, "circle"))  # compiles
    rows = []
    for n in feet:
        for layout in ("circle", "scattered"):
            seconds, cpu_seconds, words, programs = [], [], Counter(), []
            for _ in range(stands):
                support, wrench = standing_case(rng, n, layout)
                start, cpu_start = time.perf_counter(), time.process_time()
                result = stability(support, wrench)
                seconds.append(time.perf_counter() - start)
                cpu_seconds.append(time.process_time() - cpu_start)
                words[result.verdict if result.decided else "undecided"] += 1
                programs.append(result.nodes)
            rows.append(
                {
                    "feet": n,
                    "layout": layout,
                    "verdicts": dict(words),
                    "median_seconds": float(np.median(seconds)),
                    "longest_seconds": float(np.max(seconds)),
                    "median_cpu_seconds": float(np.median(cpu_seconds)),
                    "median_programs": float(np.median(programs)),
                }
            )
    return rows


def agreement(stands: int, seed: int, starts: int = 32, sweeps: int = 1500) -> dict:
    """Part 2: verdicts against the two other searches."""
    rng = np.random.default_rng([seed, 1])
    counts: Counter[str] = Counter()
    for i in range(stands):
        layout = ("circle", "scattered")[i % 2]
        support, wrench = standing_case(rng, int(rng.integers(*CHECKED_FEET)), layout)
        result = stability(support, wrench)
        projected = moves_by_projection(support, wrench, starts, sweeps, i)
        pivoted = moves_with_fine_pyramids(support, wrench)
        word = result.verdict if result.decided else "undecided"
        counts[word] += 1
        counts["found by projection"] += projected
        counts["found with fine pyramids"] += pivoted
        counts["contradictions"] += result.strong and (projected or pivoted)
        counts["found by neither, but proved to move"] += word == "weak" and not (projected or pivoted)
        progress(i + 1, stands, "stands")
    return {"stands": stands, **counts}


def markdown(data: dict) -> str:
    """The tables."""
    options = data["options"]
    rows = [
        [
            f"{row['feet']} {row['layout']}",
            *(str(row["verdicts"].get(word, 0)) for word in ("strong", "weak", "undecided")),
            f"{row['median_seconds']:.3f}",
            f"{row['longest_seconds']:.3f}",
            f"{row['median_cpu_seconds']:.3f}",
            f"{row['median_programs']:.0f}",
            "met" if row["median_seconds"] <= TARGET and "undecided" not in row["verdicts"] else "missed",
        ]
        for row in data["times"]
    ]
    head = [
        "feet",
        "strong",
        "weak",
        "undecided",
        "median s",
        "longest s",
        "median CPU s",
        "programs",
        "target",
    ]
    versions_text = ", ".join(f"{package} {number}" for package, number in data["versions"].items())
    return (
        "\n".join(
            [
                "# Strong verdicts of feet in one plane",
                "",
                f"{options['stands']} random stands per row, seed {options['seed']}, under loads that "
                f"admissible forces can balance. Target: all decided, median {TARGET:g} s.",
                "",
                *table(head, rows),
                "",
                "## Against two other searches for a motion",
                "",
                "Projection onto the true cones from random starts, and pivoting with "
                f"{FINE} facets from random starts.",
                "",
                *table(["", "stands"], [[name, str(value)] for name, value in data["agreement"].items()]),
                "",
                f"{versions_text}; {data['machine']['architecture']}, {data['machine']['cores']} cores.",
            ]
        )
        + "\n"
    )


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for the table")
    parser.add_argument("--stands", type=int, default=22, help="per number of feet and layout")
    parser.add_argument("--checked", type=int, default=200, help="stands for the other searches")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--feet", type=int, nargs="+", default=list(FEET))
    options = parser.parse_args(argv)
    if min(options.stands, options.checked, *options.feet) < 1:
        parser.error("all numbers must be at least 1")
    options.out.mkdir(parents=True, exist_ok=True)
    data = {
        "options": {name: value for name, value in vars(options).items() if name != "out"},
        "versions": versions(("numpy", "scipy", "llvmlite", "clarabel")),
        "machine": machine(),
        "times": times(options.feet, options.stands, options.seed),
        "agreement": agreement(options.checked, options.seed),
    }
    text = markdown(data)
    write_json(options.out / "contact_verdicts.json", data, indent=1)
    write_text(options.out / "contact_verdicts.md", text)
    print(text, end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
