"""Times of the contact solver and the slip reserve against their targets.

    python -m studies.contact.timing --out results [--loads 1000] [--states 10000] [--unsorted 100000]
        [--rounds 15] [--seed 0]

1. Automaton form against the conventional formulations, 3 to 8 feet, 12 facets: ratio of the medians of
   interleaved rounds, and pivots. Target: at most a third of the best conventional variant that solves all
   problems.
2. Many states along a smooth path, 3 feet, 12 facets: microseconds per state cold (each from scratch) and
   warm, and how many times faster than single calls. Targets: 10, 3, 30.
3. Standing states in random order, 3 feet, 12 facets: microseconds per state from the neighbour's basis and
   from any known one, with one and two threads, and of single calls. Targets: 0.8 (two threads), 10 (single).
4. Slip reserve GT with its derivative for 1,000 states. Target: 0.1 s.

Prints the tables and writes OUT/contact_timing.json and .md.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ocptip.basics.write import versions, write_json, write_text
from ocptip.contact.solver import solve, solve_many
from ocptip.contact.support import Support
from ocptip.reserves.slip import Slip
from studies.common import machine, say, software, table
from studies.contact.problems import GRAVITY, MASS, Case, platform_on, random_loads
from studies.contact.solvers import COMPILED, Conventional, arguments
from studies.contact.yardstick import judge

FACETS = 12
FEET = (3, 4, 5, 6, 7, 8)
RESERVE_FEET, RESERVE_STATES = (3, 4, 8), 1000
SINGLE_CALLS = 300
TARGETS = {
    "ratio": 1 / 3,
    "cold": 10.0,
    "warm": 3.0,
    "times_faster": 30.0,
    "reserve_seconds": 0.1,
    "unsorted": 0.8,
    "single": 10.0,
}


def interleaved(calls: dict[str, Callable[[], object]], rounds: int) -> dict[str, np.ndarray]:
    """Seconds of each call in each round; all calls run once in every round, after one round unmeasured."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for number in range(rounds + 1):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            if number:
                times[name].append(time.perf_counter() - start)
    return {name: np.array(seconds) for name, seconds in times.items()}


def automaton_against_conventional(feet: Sequence[int], loads: int, rounds: int, seed: int) -> list[dict]:
    """Part 1: one row per number of feet."""
    wrenches = random_loads(loads, seed)
    rows = []
    for n in feet:
        say(f"automaton against conventional, {n} feet")
        support = platform_on(n, FACETS)
        case = Case("circle", n, FACETS, [(support, wrenches)], timed=True)
        calls, variants = {}, {}
        for solver in COMPILED:
            if solver.name.endswith("textbook"):
                continue  # fails on most of these problems, see `robustness`
            calls[solver.name] = solver.prepare(support, wrenches)
            answers = solver.read(calls[solver.name](), support, wrenches)
            tally = judge(case, solver.name, [answers], true_cone=False)
            variants[solver.name] = {
                "solved": tally.solved,
                "pivots_median": tally.pivots_median,
                "pivots_mean": float(np.mean(answers.pivots)),
            }
            if isinstance(solver, Conventional):
                calls[f"{solver.name}, conversion"] = conversion(solver, support, wrenches)
        seconds = interleaved(calls, rounds)
        for name, variant in variants.items():
            variant["microseconds"] = 1e6 * float(np.median(seconds[name])) / loads
            variant["microseconds_fastest"] = 1e6 * float(np.min(seconds[name])) / loads
            converting = seconds.get(f"{name}, conversion", np.zeros(1))
            variant["microseconds_conversion"] = 1e6 * float(np.median(converting)) / loads
            variant["microseconds_conversion_fastest"] = 1e6 * float(np.min(converting)) / loads
        ours = variants.pop("ocptip")
        complete = {name: v for name, v in variants.items() if v["solved"] == loads} or variants
        best = min(complete, key=lambda name: complete[name]["microseconds_fastest"])
        rows.append(
            {
                "feet": n,
                "problems": loads,
                "ocptip": ours,
                "conventional": variants,
                "best": best,
                "ratio": _ratio(ours, variants[best], ""),
                "ratio_of_fastest": _ratio(ours, variants[best], "_fastest"),
                "ratio_lcp_alone": ours["microseconds"] / variants[best]["microseconds"],
            }
        )
    return rows


def _ratio(ours: dict, other: dict, suffix: str) -> float:
    """Our time to that of a conventional variant with its conversions."""
    return ours[f"microseconds{suffix}"] / (
        other[f"microseconds{suffix}"] + other[f"microseconds_conversion{suffix}"]
    )


def conversion(solver: Conventional, support: Support, wrenches: np.ndarray) -> Callable[[], object]:
    """From wrenches to vectors of the LCP, and from its unknowns to forces and accelerations, one batch."""
    problem = solver.formulation(*arguments(support))
    unknowns = np.eye(len(problem.lcp_matrix()))
    force_map = np.array([problem.recover(z, np.zeros(6))[0].ravel() for z in unknowns])
    Z = np.ones((len(wrenches), len(unknowns)))
    W, inverse_mass = support.wrench_matrix, support.inverse_mass

    def convert() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        forces = Z @ force_map
        return problem.q(wrenches), forces, (wrenches + forces @ W.T) @ inverse_mass @ W

    return convert


def smooth_path(count: int, level: float) -> np.ndarray:
    """Wrenches (count, 6), N and N m: the weight and an arm's reaction, a slow closed curve.

    With level 1 the platform on three feet stands all the time, with 2 it slides or tips on parts of it.
    """
    t = 2 * np.pi * np.arange(count) / count
    wrenches = np.zeros((count, 6))
    wrenches[:, 2] = -MASS * GRAVITY
    harmonics = ((2, 0.3), (3, 1.1), (5, 2.0), (3, 0.7), (2, 1.9), (4, 0.1))
    for axis, ((k, phase), size) in enumerate(zip(harmonics, (60, 60, 80, 35, 35, 15), strict=True)):
        wrenches[:, axis] += level * size * np.sin(k * t + phase)
    return wrenches


def many_states(count: int, rounds: int) -> list[dict]:
    """Part 2: one row per path."""
    support = platform_on(3, FACETS)
    rows = []
    for name, level in (("standing", 1.0), ("partly slipping", 2.0)):
        say(f"many states, {name}")
        path = smooth_path(count, level)
        every = path[:: max(1, count // SINGLE_CALLS)]
        # the single calls take one state of the path after the other, as a caller without batches would
        seconds = interleaved(
            {
                "cold": lambda: solve_many(support, path, warm_start=False),  # noqa: B023
                "warm": lambda: solve_many(support, path),  # noqa: B023
                "single": lambda: [solve(support, wrench) for wrench in every],  # noqa: B023
            },
            rounds,
        )
        cold, warm = solve_many(support, path, warm_start=False), solve_many(support, path)
        each = {
            "cold": 1e6 * float(np.median(seconds["cold"])) / count,
            "warm": 1e6 * float(np.median(seconds["warm"])) / count,
            "single": 1e6 * float(np.median(seconds["single"])) / len(every),
        }
        rows.append(
            {
                "path": name,
                "states": count,
                "solved": int(np.sum(cold.solved & warm.solved)),
                "standing_share": float(np.mean(warm.persistent)),
                "microseconds": each,
                "pivots_mean": {"cold": float(np.mean(cold.pivots)), "warm": float(np.mean(warm.pivots))},
                "times_faster_cold": each["single"] / each["cold"],
                "times_faster_warm": each["single"] / each["warm"],
                "largest_violation": float(np.nanmax([cold.law_violation(), warm.law_violation()])),
            }
        )
    return rows


def unsorted_states(count: int, rounds: int, seed: int) -> dict:
    """Part 3: the standing path in random order."""
    say("unsorted states")
    support = platform_on(3, FACETS)
    wrenches = np.random.default_rng(seed).permutation(smooth_path(count, 1.0))
    few = wrenches[:SINGLE_CALLS]
    seconds = interleaved(
        {
            "neighbour": lambda: solve_many(support, wrenches),
            "any, 1 thread": lambda: solve_many(support, wrenches, warm_start="any", threads=1),
            "any, 2 threads": lambda: solve_many(support, wrenches, warm_start="any", threads=2),
            "single": lambda: [solve(support, wrench) for wrench in few],
        },
        rounds,
    )
    states = solve_many(support, wrenches, warm_start="any")
    sizes = {name: len(few) if name == "single" else count for name in seconds}
    return {
        "states": count,
        "standing": int(np.sum(states.persistent)),
        "pivots_mean": {
            "neighbour": float(np.mean(solve_many(support, wrenches).pivots)),
            "any": float(np.mean(states.pivots)),
        },
        "microseconds": {name: 1e6 * float(np.median(s)) / sizes[name] for name, s in seconds.items()},
        "microseconds_fastest": {name: 1e6 * float(np.min(s)) / sizes[name] for name, s in seconds.items()},
        "largest_violation": float(np.nanmax(states.law_violation())),
    }


def slip_reserve(feet: Sequence[int], count: int, rounds: int) -> list[dict]:
    """Part 4: one row per number of feet and path."""
    rows = []
    for n in feet:
        for name, level in (("standing", 1.0), ("partly slipping", 2.0)):
            say(f"slip reserve, {n} feet, {name}")
            support = platform_on(n, FACETS)
            path, slip = smooth_path(count, level), Slip(support, "tangential")
            states = solve_many(support, path)
            # a fresh copy for each evaluation: states keep what they have computed once
            copies = iter([states.select(slice(None)) for _ in range(2 * (rounds + 1))])
            seconds = interleaved(
                {
                    "value": lambda: slip.evaluate(next(copies), derivatives=False),  # noqa: B023
                    "derivative": lambda: slip.evaluate(next(copies)),  # noqa: B023
                    "with solve": lambda: slip.evaluate(solve_many(support, path)),  # noqa: B023
                },
                rounds,
            )
            rows.append(
                {
                    "feet": n,
                    "path": name,
                    "states": count,
                    "certified": int(np.sum(slip.evaluate(states).solved)),
                    "seconds": {key: float(np.median(value)) for key, value in seconds.items()},
                }
            )
    return rows


def markdown(data: dict) -> str:
    """The tables."""
    options = data["options"]
    lines = [
        "# Times of the contact solver",
        "",
        f"Platform of {MASS:g} kg as in contact_robustness.md, {FACETS} facets, seed {options['seed']}; "
        f"medians of {options['rounds']} interleaved rounds.",
        "",
        "## Automaton form against conventional formulations",
        "",
        f"{options['loads']} random loads in one batch, compiled code on both sides, microseconds per "
        "problem (mean pivots). ocptip's time is from wrenches to forces and accelerations, the others' is "
        "the LCP alone. *Ratio*: ocptip to the fastest conventional variant that solves all problems (bold), "
        "to which the same conversions are added as matrix products for the whole batch; target "
        f"{TARGETS['ratio']:.2f}. *Of fastest rounds*: the same with the fastest round of each instead of "
        "the median, which other work on the machine disturbs less.",
        "",
    ]
    names = list(data["automaton"][0]["conventional"])
    rows = []
    for row in data["automaton"]:
        cells = [_with_pivots(row["ocptip"])]
        for name in names:
            text, best = _with_pivots(row["conventional"][name]), name == row["best"]
            unsolved = row["problems"] - row["conventional"][name]["solved"]
            text += f", {unsolved} not solved" if unsolved else ""
            cells.append(f"**{text}**" if best else text)
        ratios = [f"{row['ratio']:.2f}", f"{row['ratio_of_fastest']:.2f}"]
        rows.append([str(row["feet"]), *cells, *ratios, _met(row["ratio"] <= TARGETS["ratio"])])
    lines += [*table(["feet", "ocptip", *names, "ratio", "of fastest rounds", "target"], rows), ""]
    lines += [
        "## Many states along a smooth path",
        "",
        f"{options['states']} wrenches, 3 feet, microseconds per state; targets: cold {TARGETS['cold']:g}, "
        f"warm {TARGETS['warm']:g}, {TARGETS['times_faster']:g} times faster than single calls of `solve`.",
        "",
    ]
    rows = [
        [
            f"{row['path']} ({row['standing_share']:.0%} of the states stand)",
            *(
                f"{row['microseconds'][key]:.3g}, {_met(row['microseconds'][key] <= TARGETS[key])}"
                for key in ("cold", "warm")
            ),
            f"{row['microseconds']['single']:.3g}",
            f"{row['pivots_mean']['cold']:.1f}, {row['pivots_mean']['warm']:.2f}",
            *(
                f"{row[key]:.0f}, {_met(row[key] >= TARGETS['times_faster'])}"
                for key in ("times_faster_cold", "times_faster_warm")
            ),
        ]
        for row in data["many_states"]
    ]
    head = ["path", "cold", "warm", "single calls", "pivots cold, warm", "times faster: cold", "warm"]
    lines += [*table(head, rows), ""]
    unsorted = data["unsorted"]
    names, pivots = list(unsorted["microseconds"]), unsorted["pivots_mean"]
    lines += [
        "## Standing states in random order",
        "",
        f"{unsorted['states']} wrenches of the standing path in random order, microseconds per state "
        f"(fastest round); mean pivots {pivots['neighbour']:.1f} from the basis of the state before, "
        f"{pivots['any']:.2f} from any known one. Targets: {TARGETS['unsorted']:g} with two threads, "
        f"{TARGETS['single']:g} for a single call.",
        "",
    ]
    cells = [
        f"{unsorted['microseconds'][name]:.3g} ({unsorted['microseconds_fastest'][name]:.3g})"
        for name in names
    ]
    lines += [*table(["states", *names], [[str(unsorted["states"]), *cells]]), ""]
    lines += [
        "## Slip reserve GT",
        "",
        f"Seconds for {data['slip_reserve'][0]['states']} states along the path; target with derivative "
        f"{TARGETS['reserve_seconds']:g} s.",
        "",
    ]
    rows = [
        [
            f"{row['feet']} feet, {row['path']}",
            *(f"{row['seconds'][key]:.3f}" for key in ("value", "derivative", "with solve")),
            f"{row['certified']} of {row['states']}",
            _met(row["seconds"]["derivative"] <= TARGETS["reserve_seconds"]),
        ]
        for row in data["slip_reserve"]
    ]
    head = ["support, path", "value", "with derivative", "states solved, too", "certified", "target"]
    lines += [*table(head, rows), ""]
    machine = data["machine"]
    lines += [f"{software(data['versions'])}; {machine['architecture']}, {machine['cores']} cores."]
    return "\n".join(lines) + "\n"


def _with_pivots(variant: dict) -> str:
    return f"{variant['microseconds']:.3g} ({variant['pivots_mean']:.1f})"


def _met(reached: bool) -> str:
    return "met" if reached else "missed"


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for the table")
    parser.add_argument("--loads", type=int, default=1000, help="random loads per number of feet")
    parser.add_argument("--states", type=int, default=10_000, help="states along the path")
    parser.add_argument("--unsorted", type=int, default=100_000, help="states in random order")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--feet", type=int, nargs="+", default=list(FEET))
    options = parser.parse_args(argv)
    if min(options.loads, options.states, options.unsorted, options.rounds, *options.feet) < 1:
        parser.error("all numbers must be at least 1")
    options.out.mkdir(parents=True, exist_ok=True)
    data = {
        "options": {name: value for name, value in vars(options).items() if name != "out"},
        "versions": versions(("numpy", "llvmlite", "clarabel")),
        "machine": machine(),
        "targets": TARGETS,
        "automaton": automaton_against_conventional(
            options.feet, options.loads, options.rounds, options.seed
        ),
        "many_states": many_states(options.states, options.rounds),
        "unsorted": unsorted_states(options.unsorted, options.rounds, options.seed),
        "slip_reserve": slip_reserve(RESERVE_FEET, min(RESERVE_STATES, options.states), options.rounds),
    }
    say("")
    text = markdown(data)
    write_json(options.out / "contact_timing.json", data, indent=1)
    write_text(options.out / "contact_timing.md", text)
    print(text, end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
