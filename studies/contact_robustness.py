"""Which solvers survive a platform on many feet: solved, failed, wrong, pivots and time.

    python studies/contact_robustness.py --out results [--loads 200] [--seed 0] [--feet 3 4 6 8 12]

Three sets of problems: a platform on 3 to 12 feet on a circle under random loads from rest to sliding and
tipping, with 4 and 12 facets; the same platform under exactly degenerate loads; random supports of 2 to 8
ordinary contacts. Solvers: ours; Lemke's method on two conventional formulations with three pivot rules each;
Pinocchio's PGS and ADMM; Drake's Moby and unrevised Lemke. Solvers that are not installed are left out; run
again with another Python and the same --out to add them.

All are judged by the same yardstick, from their forces alone: the base's acceleration follows from the
forces, the contacts' accelerations from the base's, and both are put into the contact laws (those of the
pyramid; of Coulomb's cone for Pinocchio). "Wrong": success claimed, laws violated by more than 1e-6 of the
largest force.

Finished cases are kept in OUT/contact_robustness_cases: start again to go on after an interruption; delete
the folder to measure afresh. Writes OUT/contact_robustness.json, .md and .png.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from peers import PEERS, ConventionalLemke, Peer
from random_supports import random_support, random_wrenches

from ocptip.baselines import PairwiseContactProblem, StewartTrinkleContactProblem, solve_lcp_many
from ocptip.baselines.lemke import RULES
from ocptip.contact import Support, UnilateralContact, laws, solve_many

WRONG = 1e-6
"""Violation of the contact laws, relative to the largest force, from which a claimed success is wrong."""

MASS, INERTIA, RADIUS, HEIGHT, FRICTION, GRAVITY = 60.0, (3.0, 4.0, 5.0), 0.35, 0.6, 0.5, 9.81
FEET, FACETS, DEGENERATE_FEET = (3, 4, 6, 8, 12), (4, 12), (4, 8)
ROUNDS, SECONDS_PER_SOLVER = 7, 2.0
WRENCHES_PER_SUPPORT = 2

DEGENERATE_LOADS = {
    "weight": (0, 0, -MASS * GRAVITY, 0, 0, 0),
    "200 N lateral": (200, 0, -MASS * GRAVITY, 0, 0, 0),
    "400 N lateral": (400, 0, -MASS * GRAVITY, 0, 0, 0),
    "300 N m": (0, 0, -MASS * GRAVITY, 0, 300, 0),
    "100 N lift": (0, 0, 100 - MASS * GRAVITY, 0, 0, 0),
    "lifted off": (0, 0, 100, 0, 0, 0),
    "no load": (0, 0, 0, 0, 0, 0),
    "1e-12 N": (0, 0, -1e-12, 0, 0, 0),
}
"""Total wrenches on the base: N, N m about the centre of mass; all but the last three contain the weight."""


@dataclass(frozen=True)
class Case:
    """A set of problems: supports of ordinary contacts with wrenches (k, 6) each.

    `feet` and `facets` are None where they differ between the supports. Only `timed` cases are timed: batches
    need one support under many wrenches.
    """

    name: str
    feet: int | None
    facets: int | None
    problems: list[tuple[Support, np.ndarray]]
    timed: bool


@dataclass
class Answers:
    """What a solver returned for the wrenches of one support: forces (k, n, 3), N, contact axes."""

    forces: np.ndarray
    claimed: np.ndarray
    status: Sequence[str]
    pivots: np.ndarray


@dataclass
class Tally:
    """Result of one solver in one case. Pivots and times None where they were not told or not measured."""

    case: str
    solver: str
    feet: int | None
    facets: int | None
    problems: int = 0
    solved: int = 0
    failed: int = 0
    wrong: int = 0
    failures: dict[str, int] = field(default_factory=dict)
    second_attempts: int = 0
    worst_violation: float = 0.0
    worst_wrong: float = 0.0
    pivots_median: float | None = None
    pivots_max: int | None = None
    microseconds: float | None = None
    microseconds_median: float | None = None
    outcomes: str = ""


def platform_on(feet: int, facets: int) -> Support:
    """The platform of the study on `feet` feet; axes: z up, origin on the floor below its centre of mass."""
    angles = 2.0 * np.pi * np.arange(feet) / feet + np.pi / feet
    contacts = [
        UnilateralContact(
            position=(RADIUS * np.cos(a), RADIUS * np.sin(a), 0.0), friction=FRICTION, facets=facets
        )
        for a in angles
    ]
    return Support(contacts, mass=MASS, center_of_mass=(0.0, 0.0, HEIGHT), inertia=INERTIA)


def random_loads(count: int, seed: int) -> np.ndarray:
    """Wrenches (count, 6), N and N m: weight and random loads, from rest to sliding and tipping."""
    rng = np.random.default_rng(seed)
    wrenches = np.empty((count, 6))
    for wrench in wrenches:
        level = rng.uniform(0, 1)
        wrench[:2] = rng.normal(size=2) * 250 * level
        wrench[2] = -MASS * GRAVITY + rng.normal() * 150 * level
        wrench[3:] = rng.normal(size=3) * [90, 90, 60] * level
    return wrenches


def all_cases(feet: Sequence[int], loads: int, seed: int) -> Iterator[Case]:
    """The cases of the study, one after the other."""
    wrenches = random_loads(loads, seed)
    for facets in FACETS:
        for n in feet:
            support = platform_on(n, facets)
            yield Case(f"circle_{n}_feet_{facets}_facets", n, facets, [(support, wrenches)], timed=True)
    degenerate = np.array(list(DEGENERATE_LOADS.values()), dtype=float)
    for facets in FACETS:
        for n in DEGENERATE_FEET:
            problems = [(platform_on(n, facets), degenerate)]
            yield Case(f"degenerate_{n}_feet_{facets}_facets", n, facets, problems, timed=False)
    rng = np.random.default_rng([seed, 1])
    problems = []
    for _ in range(max(1, 3 * loads // WRENCHES_PER_SUPPORT)):
        support = random_support(rng, clamps=False)
        problems.append((support, random_wrenches(rng, support, WRENCHES_PER_SUPPORT)))
    yield Case("random", None, None, problems, timed=False)


def violation(support: Support, wrenches: np.ndarray, forces: np.ndarray, true_cone: bool) -> np.ndarray:
    """How far forces are from the contact laws and the equation of motion; shares nothing with any solver.

    Args:
        support: ordinary contacts only.
        wrenches: (k, 6), N and N m.
        forces: (k, n, 3) in contact axes, N.
        true_cone: Judge by Coulomb's cone instead of its pyramid.

    Returns:
        (k,) the largest violation relative to the largest force at stake.
    """
    k, n = len(wrenches), support.n_contacts
    W, inverse_mass = support.wrench_matrix, support.inverse_mass
    acceleration = (wrenches + forces.reshape(k, 3 * n) @ W.T) @ inverse_mass
    motion = (acceleration @ W).reshape(k, n, 3)
    free = wrenches @ inverse_mass
    at_contacts = np.max(np.abs(free @ W), axis=1)
    free[:, 3:] *= support.length
    unit = support.mass * np.maximum(at_contacts, np.max(np.abs(free), axis=1))
    unit = np.maximum(unit, np.finfo(float).tiny)
    law = cone_violation if true_cone else laws.law_violation
    each = [
        law(contact, forces[:, i], motion[:, i], unit, support.mass)
        for i, contact in enumerate(support.contacts)
    ]
    return np.max(each, axis=0)


def cone_violation(
    contact: UnilateralContact, force: np.ndarray, motion: np.ndarray, unit: np.ndarray, mass: float
) -> np.ndarray:
    """Violation of the laws of an ordinary contact with Coulomb's cone; arguments as `laws.law_violation`."""
    force, motion = force / unit[:, None], motion * mass / unit[:, None]
    normal, lift, limit = force[:, 0], motion[:, 0], contact.friction * force[:, 0]
    slip = np.linalg.norm(motion[:, 1:], axis=1)
    outside = np.linalg.norm(force[:, 1:], axis=1) - limit
    complementarity = np.minimum(np.maximum(lift, 0.0), np.maximum(normal, 0.0))
    # friction opposes the slip fully: a_t' K_t = -mu K_n |a_t|; a product, hence divided by the larger factor
    shortfall = limit * slip + np.sum(motion[:, 1:] * force[:, 1:], axis=1)
    size = np.maximum(1.0, np.maximum(np.max(np.abs(motion), axis=1), limit))
    return np.max([-normal, -lift, complementarity, outside, shortfall / size], axis=0)


class Ours:
    """`ocptip.contact.solve_many` without warm start: every problem from scratch."""

    name = "ocptip"

    def prepare(self, support: Support, wrenches: np.ndarray) -> Callable[[], object]:
        """The call that is timed."""
        support.system  # noqa: B018  (assembled once, as the matrices of the others)
        return lambda: solve_many(support, wrenches, warm_start=False)

    def read(self, states, support: Support, wrenches: np.ndarray) -> Answers:
        again = np.where(states.attempts == 1, "", "*").tolist()
        status = [states.status(i) + again[i] for i in range(len(states))]
        return Answers(states.contact_forces, states.solved, status, states.pivots)


class Conventional:
    """Lemke's method on a conventional formulation, compiled batch."""

    def __init__(self, label: str, formulation: type, rule: str) -> None:
        self.formulation, self.rule = formulation, rule
        self.name = f"{label} {rule}"

    def prepare(self, support: Support, wrenches: np.ndarray) -> Callable[[], object]:
        """The call that is timed: without building the matrix and without recovering the forces."""
        self.problem = self.formulation(*arguments(support))
        M, Q = self.problem.lcp_matrix(), self.problem.q(wrenches)
        return lambda: solve_lcp_many(M, Q, self.rule)

    def read(self, batch, support: Support, wrenches: np.ndarray) -> Answers:
        forces = [self.problem.recover(z, h)[0] for z, h in zip(batch.z, wrenches, strict=True)]
        return Answers(np.array(forces), batch.solved, batch.status.tolist(), batch.pivots)


COMPILED = (
    Ours(),
    *(Conventional("pairwise", PairwiseContactProblem, rule) for rule in RULES),
    *(Conventional("Stewart-Trinkle", StewartTrinkleContactProblem, rule) for rule in RULES),
)
EXTERNAL = tuple(peer for peer in PEERS if not isinstance(peer, ConventionalLemke))
SOLVERS = [solver.name for solver in (*COMPILED, *EXTERNAL)]


def arguments(support: Support) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Wrench matrix (6, 3n), inverse mass matrix (6, 6), friction (n,) and facets of a support."""
    friction = np.array([contact.friction for contact in support.contacts])
    return support.wrench_matrix, support.inverse_mass, friction, support.contacts[0].facets


def run_compiled(case: Case) -> list[Tally]:
    """Our solver and the baselines: answers of all problems, then times, interleaved."""
    tallies, calls = [], {}
    for solver in COMPILED:
        parts = []
        for support, wrenches in case.problems:
            call = solver.prepare(support, wrenches)
            parts.append(solver.read(call(), support, wrenches))
            calls[solver.name] = call
        tallies.append(judge(case, solver.name, parts, true_cone=False))
    if case.timed:
        times = {name: [] for name in calls}
        for _ in range(ROUNDS):
            for name, call in calls.items():
                if sum(times[name]) < SECONDS_PER_SOLVER:
                    start = time.perf_counter()
                    call()
                    times[name].append(time.perf_counter() - start)
        for tally in tallies:
            tally.microseconds = 1e6 * float(np.median(times[tally.solver])) / tally.problems
    return tallies


def run_peer(case: Case, peer: Peer) -> list[Tally]:
    """An external solver, one problem after the other; it times its own call."""
    parts, seconds = [], []
    for support, wrenches in case.problems:
        if not seconds:
            peer.solve(*arguments(support), wrenches[0])  # the first call also loads the library
        answers = [peer.solve(*arguments(support), wrench) for wrench in wrenches]
        seconds += [a.seconds for a in answers]
        parts.append(
            Answers(
                np.array([a.forces for a in answers]),
                np.array([a.converged for a in answers]),
                ["solved" if a.converged else "not converged" for a in answers],
                np.array([a.iterations for a in answers]),
            )
        )
    tally = judge(case, peer.name, parts, true_cone=peer.name.startswith("pinocchio"))
    if case.timed:
        tally.microseconds = 1e6 * float(np.mean(seconds))
        tally.microseconds_median = 1e6 * float(np.median(seconds))
    return [tally]


def judge(case: Case, solver: str, parts: list[Answers], true_cone: bool) -> Tally:
    """Count what is solved, reported as failed, and wrong."""
    tally = Tally(case.name, solver, case.feet, case.facets)
    failures: Counter[str] = Counter()
    pivots = np.concatenate([part.pivots for part in parts])
    for (support, wrenches), part in zip(case.problems, parts, strict=True):
        off = violation(support, wrenches, part.forces, true_cone)
        good = part.claimed & (off <= WRONG)
        wrong = part.claimed & ~good  # also where forces are NaN
        tally.problems += len(wrenches)
        tally.solved += int(np.sum(good))
        tally.wrong += int(np.sum(wrong))
        tally.failed += int(np.sum(~part.claimed))
        tally.worst_violation = max(tally.worst_violation, *off[good], 0.0)
        tally.worst_wrong = max(tally.worst_wrong, *off[wrong], 0.0)
        for claimed, status in zip(part.claimed, part.status, strict=True):
            tally.second_attempts += status.endswith("*")
            if not claimed:
                failures[status.rstrip("*")] += 1
        tally.outcomes += "".join(
            "." if fine else "W" if claims else "F" for fine, claims in zip(good, part.claimed, strict=True)
        )
    tally.failures = dict(failures)
    if np.all(pivots >= 0):
        tally.pivots_median, tally.pivots_max = float(np.median(pivots)), int(np.max(pivots))
    if len(tally.outcomes) > len(DEGENERATE_LOADS):
        tally.outcomes = ""
    return tally


def versions(*packages: str) -> dict[str, str]:
    """Versions of Python and of those packages that are installed."""
    found = {"python": platform.python_version()}
    for package in packages:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def write_whole(path: Path, text: str) -> None:
    """Write a file so that an interruption leaves either the old or the new one."""
    temporary = path.with_name(path.name + ".part")
    temporary.write_text(text)
    temporary.replace(path)


def run(out: Path, feet: Sequence[int], loads: int, seed: int) -> dict:
    """Run what is not there yet and return everything that belongs to these options."""
    options = {"loads": loads, "seed": seed}
    folder = out / "contact_robustness_cases"
    folder.mkdir(parents=True, exist_ok=True)
    groups = {"compiled": ("numpy", "numba"), **{peer.name: ("numpy", "pin", "drake") for peer in EXTERNAL}}
    peers = {peer.name: peer for peer in EXTERNAL}
    cases = list(all_cases(feet, loads, seed))
    tallies, used = [], {}
    steps = [(case, group) for case in cases for group in groups]
    for done, (case, group) in enumerate(steps):
        path = folder / f"{case.name}__{group}.json"
        stored = json.loads(path.read_text()) if path.exists() else {}
        if stored.get("options") != options:
            if group in peers and not peers[group].available():
                continue
            progress(done, len(steps), f"{case.name}, {group}")
            results = run_peer(case, peers[group]) if group in peers else run_compiled(case)
            packages = versions(*groups[group])
            if group in peers:
                packages.pop("drake" if group.startswith("pinocchio") else "pin", None)
            stored = {
                "options": options,
                "versions": packages,
                "tallies": [asdict(tally) for tally in results],
            }
            write_whole(path, json.dumps(stored))
        tallies += stored["tallies"]
        for package, number in stored["versions"].items():
            used.setdefault(package, set()).add(number)
    progress(len(steps), len(steps), "")
    return {
        "options": {**options, "feet": list(feet), "facets": list(FACETS)},
        "versions": {package: ", ".join(sorted(numbers)) for package, numbers in sorted(used.items())},
        "machine": {"architecture": platform.machine(), "cores": os.cpu_count()},
        "wrong_from": WRONG,
        "degenerate_loads": {name: list(map(float, wrench)) for name, wrench in DEGENERATE_LOADS.items()},
        "results": tallies,
    }


def progress(done: int, total: int, what: str) -> None:
    """One line on a terminal, nothing elsewhere."""
    if sys.stderr.isatty():
        end = "\n" if done == total else ""
        print(f"\r\033[K{done}/{total} {what}", end=end, file=sys.stderr, flush=True)


NOTES = """\
How to read this:

- *failed + wrong*: reported failures + claimed successes that violate the contact laws by more than 1e-6 of
  the largest force. One yardstick for all, computed from the forces alone; Pinocchio is judged by Coulomb's
  cone, which it solves for, all others by the pyramid.
- ocptip and the six conventional variants verify their own answers on the original data, and so report a
  failure where others would hand out a wrong answer: without that check, the failures called "inaccurate" in
  the last table would be wrong answers. ocptip tries further starts where the first one fails, the others do
  not; how often it needed that is listed there, too.
- **Scaling decides.** The conventional variants and Drake (without "-raw") get the problem in newtons,
  divided by its largest element. Lemke's method with a tolerance for ties then hardly ever fails on standing
  platforms, in either formulation, nor does Drake's Moby, though on random supports a few of its answers are
  wrong. "-raw" is the same LCP with accelerations in m/s^2 and not divided, as it comes out of the equations:
  there Moby claims success for many answers that solve another problem. The textbook rule fails in spite of
  good scaling, and so, now and then, does Drake's unrevised Lemke.
- So the case for the automaton form is not that nothing else solves these problems, nor is it the number of
  pivots: with 12 facets it needs more than the Stewart-Trinkle form. It is the price of a pivot: the
  basis has 3 rows per foot for any number of facets, not S + 1 or S + 2; see contact_timing.md.
- *Time*: ocptip and the conventional variants run as a batch in compiled code, one call for all loads of a
  support: mean per problem, median of interleaved repeats. ocptip's time includes the check, forces and
  accelerations; the conventional ones' the check, but neither their matrix nor the recovery of the forces.
  Pinocchio and Drake: the solver's own call from Python, one problem at a time, mean over all problems
  (median in brackets); Drake's includes its handling of the program. Failures are included everywhere.
  Compare orders of magnitude across these groups, not percentages.
- *Pivots*: median / maximum; iterations for Pinocchio. Drake does not tell.
"""


def markdown(data: dict) -> str:
    """The tables."""
    results, options = data["results"], data["options"]
    by_key = {(r["case"], r["solver"]): r for r in results}
    names = [name for name in SOLVERS if any(r["solver"] == name for r in results)]
    random_case = [by_key[("random", name)] for name in names if ("random", name) in by_key]
    lines = [
        "# Robustness of contact solvers",
        "",
        f"Platform of {MASS:g} kg on feet on a circle of {RADIUS:g} m, {HEIGHT:g} m below its centre of "
        f"mass, friction {FRICTION:g}; {options['loads']} random loads per case from rest to sliding and "
        f"tipping, seed {options['seed']}.",
        "",
        *NOTES.splitlines(),
        "",
    ]
    columns: tuple[tuple[str, Callable[[dict], str]], ...] = (
        ("failed + wrong", outcome),
        ("largest violation of the solved", lambda r: f"{r['worst_violation']:.0e}" if r["solved"] else "-"),
        ("pivots, median / max", pivots_text),
        ("microseconds per problem", time_text),
    )
    for facets in options["facets"]:
        for title, text in columns:
            lines += [f"## {facets} facets: {title}", ""]
            rows = [
                [name, *(text(by_key[key]) if key in by_key else "" for key in keys)]
                for name in names
                for keys in [[(f"circle_{n}_feet_{facets}_facets", name) for n in options["feet"]]]
            ]
            lines += [*table(["solver", *(f"{n} feet" for n in options["feet"])], rows), ""]
    lines += ["## Degenerate loads", ""]
    supports = [f"degenerate_{n}_feet_{facets}_facets" for facets in FACETS for n in DEGENERATE_FEET]
    lines += [
        "Total load on the base, exact numbers, on 4 and 8 feet with 4 and 12 facets in this order. "
        "`.` solved, `F` failure reported, `W` wrong.",
        "",
    ]
    rows = []
    for name in names:
        strings = [by_key[case, name]["outcomes"] for case in supports if (case, name) in by_key]
        cells = ["".join(outcomes) for outcomes in zip(*strings, strict=True)]
        rows.append([name, *(f"`{cell}`" for cell in cells)])
    lines += [*table(["solver", *DEGENERATE_LOADS], rows), ""]
    if random_case:
        lines += [
            "## Random supports",
            "",
            f"{random_case[0]['problems']} problems: 2 to 8 ordinary contacts, coplanar or not, 4 to 16 "
            f"facets, friction 0.05 to 1.5, loads of 1e-9 N to 1e6 N, a third exactly degenerate.",
            "",
        ]
        rows = [
            [r["solver"], str(r["solved"]), str(r["failed"]), str(r["wrong"]), f"{r['worst_violation']:.0e}",
             f"{r['worst_wrong']:.0e}" if r["wrong"] else "-", pivots_text(r)]
            for r in random_case
        ]  # fmt: skip
        head = ["solver", "solved", "failed", "wrong", "largest violation of the solved",
                "of the wrong", "pivots, median / max"]  # fmt: skip
        lines += [*table(head, rows), ""]
    lines += ["## Kinds of failure, all cases", ""]
    rows = []
    for name in names:
        kinds: Counter[str] = Counter()
        for r in results:
            if r["solver"] == name:
                kinds.update(r["failures"])
                kinds["(solved at a second or later attempt)"] += r["second_attempts"]
        text = ", ".join(f"{kind}: {count}" for kind, count in kinds.most_common() if count)
        rows.append([name, str(sum(r["problems"] for r in results if r["solver"] == name)), text or "none"])
    lines += [*table(["solver", "problems", "failures"], rows), ""]
    software = ", ".join(f"{package} {number}" for package, number in data["versions"].items())
    machine = data["machine"]
    lines += [f"{software}; {machine['architecture']}, {machine['cores']} cores, shared with other work."]
    return "\n".join(lines) + "\n"


def table(head: list[str], rows: list[list[str]]) -> list[str]:
    """Lines of a Markdown table."""
    rule = ["---", *["---:"] * (len(head) - 1)]
    return ["| " + " | ".join(row) + " |" for row in (head, rule, *rows)]


def outcome(r: dict) -> str:
    """Failed + wrong as "a+b"; "0" where everything is solved."""
    if not r["wrong"]:
        return str(r["failed"])
    return f"{r['failed']}+{r['wrong']}"


def pivots_text(r: dict) -> str:
    """Median / maximum."""
    return "-" if r["pivots_max"] is None else f"{r['pivots_median']:.0f} / {r['pivots_max']}"


def time_text(r: dict) -> str:
    """Mean, and the median in brackets where it is known."""
    mean = three_digits(r["microseconds"])
    median = r["microseconds_median"]
    return mean if median is None else f"{mean} ({three_digits(median)})"


def three_digits(value: float) -> str:
    """A positive number with three digits, or all digits before the point."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def draw(data: dict, path: Path) -> None:
    """Failures by solver and feet, time and pivots per problem; one row of panels per facet count."""
    options = data["options"]
    feet, facet_counts = options["feet"], options["facets"]
    cell = {
        (r["facets"], r["solver"], r["feet"]): r for r in data["results"] if r["case"].startswith("circle")
    }
    names = [name for name in SOLVERS if any(key[1] == name for key in cell)]
    figure = Figure(figsize=(13.5, 0.34 * len(names) * len(facet_counts) + 2.6), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(
        f"A platform on its feet, {options['loads']} random loads per case: what fails, and what it costs"
    )
    axes = figure.subplots(len(facet_counts), 3, squeeze=False, sharex="col", width_ratios=(1.15, 1, 1))
    shades = LinearSegmentedColormap.from_list("feet", ["#9cc3e6", "#0b2a4a"])(np.linspace(0, 1, len(feet)))
    groups = [name.split("-")[0].split()[0] for name in names]
    for facets, (counts, times, pivots) in zip(facet_counts, axes, strict=True):
        here = {(name, n): r for (s, name, n), r in cell.items() if s == facets}
        _draw_counts(counts, here, names, feet)
        counts.set_title(
            f"{facets} facets: failures reported + wrong answers (bold) of {options['loads']}", fontsize=10
        )
        _draw_dots(times, here, names, feet, shades, "microseconds")
        times.set_title("mean time per problem [µs]", fontsize=10)
        _draw_dots(pivots, here, names, feet, shades, "pivots_median", "pivots_max")
        pivots.set_title("pivots or iterations: median (dot) to maximum", fontsize=10)
        for axis in (counts, times, pivots):
            axis.set_ylim(len(names) - 0.5, -0.5)
            axis.set_yticks(range(len(names)), names if axis is counts else [""] * len(names))
            axis.tick_params(axis="y", length=0)
            axis.tick_params(axis="x", labelbottom=True)
            for y in range(1, len(names)):
                new = groups[y] != groups[y - 1]
                axis.axhline(y - 0.5, color="#888888" if new else "#e4e4e4", lw=0.9 if new else 0.6, zorder=0)
            for side in ("top", "right", "left"):
                axis.spines[side].set_visible(False)
    axes[0, 1].legend(fontsize=8, loc="upper right", framealpha=0.9)
    figure.savefig(path, dpi=120)


def _draw_counts(axis: Axes, here: dict, names: list[str], feet: list[int]) -> None:
    """Table of failures and wrong answers, coloured by their share."""
    colors = LinearSegmentedColormap.from_list("failures", ["#e9f3ea", "#f6d9a8", "#d0604d"])
    for (name, n), r in here.items():
        if n not in feet:
            continue
        x, y = feet.index(n), names.index(name)
        bad = (r["failed"] + r["wrong"]) / r["problems"]
        axis.fill_between([x - 0.48, x + 0.48], y - 0.46, y + 0.46, color=colors(bad**0.5), lw=0)
        color, weight = "white" if bad > 0.6 else "black", "bold" if r["wrong"] else "normal"
        axis.text(x, y, outcome(r), ha="center", va="center", fontsize=8.5, color=color, weight=weight)
    axis.set_xlim(-0.5, len(feet) - 0.5)
    axis.set_xticks(range(len(feet)), [str(n) for n in feet])
    axis.set_xlabel("feet")


def _draw_dots(axis: Axes, here, names, feet, shades, key: str, end: str | None = None) -> None:
    """One dot per solver and number of feet on a logarithmic axis, with a line to the value `end`."""
    for y, name in enumerate(names):
        if all(here[name, n][key] is None for n in feet if (name, n) in here):
            axis.annotate("not told", (0.02, y), xycoords=("axes fraction", "data"), va="center",
                          fontsize=8, color="#888888")  # fmt: skip
    for x, n in enumerate(feet):
        known = [(y, here[name, n]) for y, name in enumerate(names) if (name, n) in here]
        known = [(y, r) for y, r in known if r[key] is not None]
        rows = np.array([y for y, _ in known]) + 0.3 * (2 * x / max(1, len(feet) - 1) - 1)
        values = np.maximum([r[key] for _, r in known], 0.5)
        if end is not None:
            axis.hlines(rows, values, [max(r[end], 0.5) for _, r in known], color=shades[x], lw=1)
        axis.plot(values, rows, "o", ms=4.5, color=shades[x], label=f"{n} feet")
    axis.set_xscale("log")
    axis.grid(axis="x", color="#dddddd", lw=0.6)
    axis.set_axisbelow(True)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for cases, table and figure")
    parser.add_argument("--loads", type=int, default=200, help="random loads per case")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--feet", type=int, nargs="+", default=list(FEET))
    options = parser.parse_args(argv)
    if options.loads < 1 or min(options.feet) < 1:
        parser.error("--loads and --feet must be at least 1")
    try:
        data = run(options.out, options.feet, options.loads, options.seed)
    except KeyboardInterrupt:
        print("\nInterrupted; finished cases are kept, start again to go on.", file=sys.stderr)
        return 130
    text = markdown(data)
    compact = json.dumps(data["results"], separators=(",", ":")).replace("},{", "},\n{")
    head = json.dumps({**data, "results": []}, indent=1)
    write_whole(
        options.out / "contact_robustness.json", head.replace('"results": []', f'"results": {compact}')
    )
    write_whole(options.out / "contact_robustness.md", text)
    draw(data, options.out / "contact_robustness.png")
    print(text, end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
