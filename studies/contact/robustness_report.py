"""Tables and figure of the robustness of contact solvers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from studies.common import software, table
from studies.contact.problems import DEGENERATE_FEET, DEGENERATE_LOADS, FACETS, FRICTION, HEIGHT, MASS, RADIUS
from studies.contact.solvers import SOLVERS

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
             wrongness(r), pivots_text(r)]
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
    facts = f"{data['machine']['architecture']}, {data['machine']['cores']} cores, shared with other work."
    lines += [f"{software(data['versions'])}; {facts}"]
    return "\n".join(lines) + "\n"


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


def wrongness(r: dict) -> str:
    """Largest violation of the wrong answers; JSON keeps infinity as None."""
    if not r["wrong"]:
        return "-"
    return "infinite" if r["worst_wrong"] is None else f"{r['worst_wrong']:.0e}"


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
