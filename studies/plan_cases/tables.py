"""The plans of the eight cases in Markdown: targets, energies, starts, times."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from studies.common import number, percent, software, table
from studies.plan_cases.journal import SETS
from studies.plan_cases.times import BUILDINGS, CALLS, PARTS

NEAR = 0.02  # a start is near the best if its energy is at most this share above it
STAGES = ("start", "coarse", "fine", "exact", "check")
LARGEST_RATIO, NEAR_SHARE = 0.98, 0.90  # targets
START_SECONDS, BUILDING_SECONDS, EVALUATION_SECONDS = 2.0, 5.0, 0.012  # targets


def markdown(data: dict) -> str:
    """All tables."""
    options, rows = data["options"], data["rows"]
    groups = {name: [r for r in rows if r["set"] == name] for name in options["sets"]}
    groups = {name: group for name, group in groups.items() if group}
    lines = [
        f"Seed {options['seed']}, {options['starts']} random starts per case and set.",
        "",
        *targets_table(groups, data["times"]),
    ]
    for name, group in groups.items():
        lines += ["", f"## {SETS[name].title}", "", *energy_table(group), "", *starts_table(group)]
    lines += ["", "## Where the time goes", "", *stages_table(groups)]
    if data["times"]:
        lines += ["", *times_table(data["times"])]
    lines += ["", NOTES, "", *remarks(data)]
    return "\n".join(lines).rstrip() + "\n"


NOTES = f"""\
- *reference*: the printed motion of the case in the same model; *ratio*: energy of our best verified motion
  to that of the reference; *torque*: largest share of a joint's torque limit.
- *verified*: starts that end with a motion that keeps all limits; *near*: those of them at most
  {100 * NEAR:.0f} % above the best of their case and set; shares of all starts.
- *s per start*: wall time of single starts in one thread, building included where a process meets a case for
  the first time. The shares of stages are of the sum of the medians above them.
- *building*: `Search(task)`, the coarse program of a random start and its first evaluation with all
  derivatives: in a fresh process, and the median of {BUILDINGS} in that process, imports left out.
- *evaluation*: objective, rows, gradient, Jacobian, Hessian of the exact program at its solution, median of
  {CALLS} calls; what the parts share is counted with the values."""


def remarks(data: dict) -> list[str]:
    """What keeps a summary from being complete or uniform, and the versions."""
    options, rows = data["options"], data["rows"]
    found = []
    asked = options["starts"] * len(options["cases"]) * len(options["sets"])
    if (have := sum(r["starts"] for r in rows)) < asked:
        found.append(f"- Not complete: {have} of {asked} starts have ended.")
    if failed := sum(r["starts"] - r["verified"] for r in rows):
        found.append(f"- Starts without a verified motion: {failed}; why, by number, in plan_cases.json.")
    if len(states := {one for r in rows for one in r["states"]}) > 1:
        found.append(f"- The starts come from {len(states)} states of the planner's source code or packages.")
    return [*found, f"- Versions: {software(data['versions'])}."]


def average(values: Sequence[float | None]) -> float | None:
    """Mean of those there are."""
    values = [x for x in values if x is not None]
    return sum(values) / len(values) if values else None


def targets_table(groups: dict[str, list[dict]], times: dict[str, dict]) -> list[str]:
    """What is to be reached beside what is."""

    def verdict(value: float | None, met: Callable[[float], bool], text: Callable[[float], str]) -> str:
        return "-" if value is None else f"{text(value)} ({'met' if met(value) else 'missed'})"

    def most(values: Sequence[float | None]) -> float | None:
        return max((x for x in values if x is not None), default=None)

    rows = []
    targets = " / ".join(number(SETS[name].target, 2) for name in groups)
    measures = [
        (
            f"average ratio of energies, {most([len(g) for g in groups.values()])} cases",
            f"<= {targets}",
            lambda name, g: verdict(
                average([r["ratio"] for r in g]), lambda x: x <= SETS[name].target, number
            ),
        ),
        (
            "largest ratio of a case",
            f"< {LARGEST_RATIO}",
            lambda _, g: verdict(most([r["ratio"] for r in g]), lambda x: x < LARGEST_RATIO, number),
        ),
        (
            "cases with a plan",
            "all",
            lambda _, g: f"{sum(r['ratio'] is not None for r in g)} of {len(g)}",
        ),
        (
            f"starts within {100 * NEAR:.0f} % of the best, least of a case",
            f">= {percent(NEAR_SHARE)}",
            lambda _, g: verdict(min(r["near"] / r["starts"] for r in g), lambda x: x >= NEAR_SHARE, percent),
        ),
        (
            "median CPU s per start, largest of a case",
            f"<= {START_SECONDS:.0f}",
            lambda _, g: verdict(
                most([r["median_s"] for r in g]), lambda x: x <= START_SECONDS, lambda x: number(x, 2)
            ),
        ),
    ]
    for measure, target, cell in measures:
        rows.append([measure, target, *(cell(name, group) for name, group in groups.items())])
    for measure, target, limit, key, scale, digits in (
        (
            "building in a fresh process [s], largest of a case",
            "<= 5",
            BUILDING_SECONDS,
            "building_first_s",
            1,
            2,
        ),
        ("evaluation [ms], largest of a case", "<= 12", EVALUATION_SECONDS, "evaluation_s", 1e3, 1),
    ):
        value = most([x[key] for x in times.values()])
        text = verdict(value, lambda x: x <= limit, lambda x: number(scale * x, digits))  # noqa: B023
        rows.append([measure, target, text, *[""] * (len(groups) - 1)])
    return table(["measure", "target", *groups], rows)


def energy_table(group: list[dict]) -> list[str]:
    """Energies, durations and reserves of one set."""

    def both(r: dict, key: str, digits: int, scale: float = 1.0) -> str:
        return " / ".join(number(one and scale * one[key], digits) for one in (r["reference"], r["plan"]))

    head = [
        "case",
        "reference [J]",
        "ours [J]",
        "ratio",
        "duration [s]",
        "GN",
        "GT",
        "torque",
        "clearance [mm]",
    ]
    head[4:] = [f"{name}, reference / ours" for name in head[4:]]
    rows = [
        [
            r["case"],
            number(r["reference"]["energy_J"], 1),
            number(r["plan"] and r["plan"]["energy_J"], 1),
            number(r["ratio"]),
            both(r, "duration_s", 3),
            both(r, "GN", 3),
            both(r, "GT", 3),
            both(r, "torque_ratio", 2),
            both(r, "clearance_m", 1, 1e3),
        ]
        for r in group
    ]
    ratios = [r["ratio"] for r in group]
    there = [r for r in group if r["plan"]]
    energies = [average([r[who]["energy_J"] for r in there]) for who in ("reference", "plan")]
    rows.append(
        [f"average of {len(there)}", *(number(x, 1) for x in energies), number(average(ratios)), *[""] * 5]
    )
    return table(head, rows)


def starts_table(group: list[dict]) -> list[str]:
    """How the starts of one set ended and what they took."""
    head = [
        "case",
        "starts",
        "verified",
        "near",
        "median CPU s per start",
        "90 % s",
        "median iterations",
        "solves",
    ]
    rows = [
        [
            r["case"],
            str(r["starts"]),
            percent(r["verified"] / r["starts"]),
            percent(r["near"] / r["starts"]),
            number(r["median_s"], 2),
            number(r["ninety_percent_s"], 2),
            number(r["median_iterations"], 0),
            number(r["median_solves"], 0),
        ]
        for r in group
    ]
    shares = [average([r[key] / r["starts"] for r in group]) for key in ("verified", "near")]
    seconds = [average([r[key] for r in group]) for key in ("median_s", "ninety_percent_s")]
    counts = [average([r[key] for r in group]) for key in ("median_iterations", "median_solves")]
    rows.append(
        [
            "average",
            "",
            *map(percent, shares),
            *(number(x, 2) for x in seconds),
            *(number(x, 0) for x in counts),
        ]
    )
    return table(head, rows)


def stages_table(groups: dict[str, list[dict]]) -> list[str]:
    """Median seconds by stage."""
    rows = []
    for name, group in groups.items():
        for r in group:
            rows.append([name, r["case"], *(number(r["stages_s"][stage], 2) for stage in STAGES)])
        means = [average([r["stages_s"][stage] for r in group]) for stage in STAGES]
        total = sum(x or 0.0 for x in means)
        rows.append(
            [name, "share of all", *(percent(x / total if x is not None and total else None) for x in means)]
        )
    return table(["set", "case", *(f"{stage} [s]" for stage in STAGES)], rows)


def times_table(times: dict[str, dict]) -> list[str]:
    """Sizes of the exact programs, times of building and of one evaluation."""
    head = [
        "case",
        "nodes",
        "variables",
        "rows",
        "building, fresh [s]",
        "building, median [s]",
        "evaluation [ms]",
    ]
    head += [f"{part} [ms]" for part in PARTS]
    rows = [
        [
            case,
            *(str(x[key]) for key in ("nodes", "variables", "rows")),
            number(x["building_first_s"], 2),
            number(x["building_s"], 2),
            number(1e3 * x["evaluation_s"], 1),
            *(number(1e3 * x["parts_s"][part], 1) for part in PARTS),
        ]
        for case, x in times.items()
    ]
    return table(head, rows)
