"""Medians and shares of the comparison with Nelder-Mead, as a table."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from studies.common import number, percent, table
from studies.compare.methods import METHODS
from studies.compare.runs import Key


def time_to(record: dict, cost: float) -> float:
    """Seconds until a search had this cost, infinite if it never had."""
    return next((t for t, _, reached in record["history"] if reached <= cost), math.inf)


def summary(records: dict[Key, dict]) -> list[dict]:
    """One row per case and method, and one for all cases together."""
    cases = sorted({key[0] for key in records})
    groups = [(case, [case]) for case in cases] + ([("all", cases)] if len(cases) > 1 else [])
    rows = []
    for name, members in groups:
        for method in METHODS:
            own = [r for key, r in sorted(records.items()) if key[0] in members and key[2] == method]
            if own:
                row = {"case": name, "method": method, **statistics(own, records)}
                each = [x for case in members if (x := restarted(records, case, method))]
                if each:
                    row["restarted"] = float(np.median([x[0] for x in each]))
                    row["restarts_succeed"] = all(x[1] for x in each)
                rows.append(row)
    return rows


def restarted(records: dict[Key, dict], case: str, method: str) -> tuple[float, int] | None:
    """Seconds that a method needs per success / median seconds of ours, and the number of successes.

    A success is a verified energy (slowed down if need be) within 1 % of the median of ours: what one start
    of ours gives on average. Without any success the time of all runs counts, a lower bound.
    """
    own = [r for key, r in records.items() if key[0] == case and key[2] == method]
    ours = [r for key, r in records.items() if key[0] == case and key[2] == "ours" and r["verified"]]
    if method == "ours" or not own or not ours:
        return None
    goal = 1.01 * np.median([r["energy_J"] for r in ours])
    successes = sum(bool(r["slowed"]) and r["slowed"]["energy_J"] <= goal for r in own)
    seconds = sum(r["cpu_s"] for r in own)
    return seconds / max(successes, 1) / float(np.median([r["cpu_s"] for r in ours])), successes


def statistics(own: list[dict], records: dict[Key, dict]) -> dict:
    """Medians and shares over runs of one method, against ours from the same starts."""
    energies = [math.inf if r["energy_J"] is None else r["energy_J"] for r in own]
    safe = [math.inf if r["slowed"] is None else r["slowed"]["energy_J"] for r in own]
    row = {
        "runs": len(own),
        "energy_J": float(np.median(energies)),
        "verified": float(np.mean([r["verified"] for r in own])),
        "slowed_J": float(np.median(safe)),
        "least_J": min(safe),
        "seconds": float(np.median([r["cpu_s"] for r in own])),
        "evaluations": float(np.median([r["evaluations"] for r in own])),
        "ours_lower": None,
        "ours_lower_slowed": None,
        "times_faster": None,
        "times_faster_total": None,
        "reach_ours": None,
        "times_longer": None,
        "restarted": None,
        "restarts_succeed": True,
    }
    pairs = [(r, records.get((r["case"], r["start"], "ours"))) for r in own if r["method"] != "ours"]
    pairs = [(r, best) for r, best in pairs if best]
    if pairs:
        lower, lower_slowed, faster, faster_total, longer = [], [], [], [], []
        for other, best in pairs:
            mine = best["energy_J"] if best["verified"] else math.inf
            lower.append(mine <= other["energy_J"])
            lower_slowed.append(mine <= (other["slowed"]["energy_J"] if other["slowed"] else math.inf))
            # 0: ours never got to the other's energy
            final = time_to(other, 1.01 * other["history"][-1][2])
            faster.append(final / best["cpu_s"] if lower[-1] else 0.0)
            faster_total.append(other["cpu_s"] / best["cpu_s"] if lower[-1] else 0.0)
            longer.append(time_to(other, 1.01 * mine) / best["cpu_s"])
        row["ours_lower"], row["ours_lower_slowed"] = float(np.mean(lower)), float(np.mean(lower_slowed))
        row["times_faster"], row["times_faster_total"] = map(float, map(np.median, (faster, faster_total)))
        row["reach_ours"] = float(np.mean(np.isfinite(longer)))
        row["times_longer"] = float(np.median(longer))
    return row


COLUMNS: dict[str, Callable[[dict], str]] = {
    "case": lambda r: r["case"],
    "method": lambda r: r["method"],
    "runs": lambda r: str(r["runs"]),
    "energy [J]": lambda r: number(r["energy_J"], 1),
    "verified": lambda r: percent(r["verified"]),
    "slowed [J]": lambda r: number(r["slowed_J"], 1),
    "least [J]": lambda r: number(r["least_J"], 1),
    "seconds": lambda r: number(r["seconds"], 1),
    "evaluations": lambda r: number(r["evaluations"], 0),
    "ours lower": lambda r: percent(r["ours_lower"]),
    "ours lower than slowed": lambda r: percent(r["ours_lower_slowed"]),
    "times faster": lambda r: number(r["times_faster"], 1),
    "times faster, to its end": lambda r: number(r["times_faster_total"], 1),
    "comes to ours": lambda r: percent(r["reach_ours"]),
    "times longer": lambda r: number(r["times_longer"], 1, "never"),
    "restarted": lambda r: ("" if r["restarts_succeed"] else "> ") + number(r["restarted"], 0),
}
NOTES = """\
Medians over the runs. *energy*: of the method's result, *verified*: share of results that keep all limits on
the dense grid, *slowed*: energy after slowing the others down until they do, *least*: of these the least.
*seconds*: CPU. *evaluations*: of cost and limits; for ours Ipopt's iterations. *ours lower*: share of starts
from which our verified energy is not above the other's, verified or not. *times faster*: seconds until the
other method was within 1 % of its final cost (or, *to its end*, until it stopped) / seconds of our whole run;
0 where ours ended above the other's energy. *comes to ours*: share of runs that ever came within 1 % of our
energy from the same start; *times longer*: seconds until then / seconds of our whole run, "never" if at least
half of the runs did not. *restarted*: seconds of all its runs / number of those that end, verified, within
1 % of our median energy / our median seconds: how many times longer it takes from start to start until it is
as good as one of ours; ">" if none was (in the last rows: in some case), then all runs' seconds count."""


def markdown(rows: list[dict], notes: list[str]) -> str:
    """The summary as a Markdown table."""
    cells = [[column(row) for column in COLUMNS.values()] for row in rows]
    lines = [*table(list(COLUMNS), cells, left=2), "", NOTES, *(["", *notes] if notes else [])]
    return "\n".join(lines) + "\n"
