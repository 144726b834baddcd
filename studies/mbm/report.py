"""Prints the table of `mbm.run`: python -m studies.mbm.report NOTE FILE.jsonl ... > studies/results/mbm.md

NOTE is a sentence on the state of the source and of the machine.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from studies.mbm.problems import CART, FAMILIES, FETCH
from studies.mbm.run import CLEARANCE, PROOF, SEARCH, rows_of


def main(arguments: Sequence[str]) -> None:
    """The note, and one table per file."""
    note, *files = arguments
    print("# MotionBenchMaker problems along paths\n")
    print(note)
    for names, base, where in (
        ("Panda, UR5", CART["base"], "deck at 0.75 m"),
        ("Fetch", FETCH["base"], "its own"),
    ):
        print(
            f"{names}: base of {base['mass']:.4g} kg, {where}, friction {base['friction']} (`problems.py`)."
        )
    print("The UR5 is without the gripper of the data set.")
    print(f"Clearance {1e3 * CLEARANCE:g} mm. Search at most {SEARCH:g} s of wall time, proof {PROOF:g} s.")
    print(
        "Seconds are CPU seconds of one core, of a machine that was shared. The file names the uncertainty."
    )
    for name in files:
        rows = rows_of(Path(name))
        print(f"\n## {Path(name).stem}\n")
        print("| family | problems | path | proved | checked | CPU s (median, 95 %, most) | of the search "
              "| duration / toppra | mesh contacts |")  # fmt: skip
        print("|---|---|---|---|---|---|---|---|---|")
        for family in FAMILIES:
            if own := [row for row in rows if row["family"] == family]:
                print(_row(family, own))
        print(_row("all", rows))
        for row in rows:
            if "why" in row:
                print(f"\n- {row['family']} {row['number']}: {row['outcome']}: {row['why']}")


def _row(family: str, rows: Sequence[dict[str, Any]]) -> str:
    paths = [row for row in rows if "path_rad" in row]
    outcomes = [row["outcome"] for row in rows]
    proved, checked = outcomes.count("proved"), sum(one.startswith("checked") for one in outcomes)
    seconds = [sum(row["cpu_s"].values()) for row in paths]
    search = [row["cpu_s"]["search"] for row in paths]
    ratios = [row["duration_s"] / row["toppra_s"] for row in rows if row.get("toppra_s")]
    lost = sum(row.get("toppra_loses_contact", False) for row in rows)
    hits = sum(row.get("mesh_contacts_at_1_ms", 0) for row in rows)
    ratio = f"{np.median(ratios):.3f} ({lost} of toppra's lose a contact)" if ratios else "-"
    cells = [family, len(rows), len(paths), proved, checked, _spread(seconds), _spread(search), ratio, hits]
    return f"| {' | '.join(map(str, cells))} |"


def _spread(values: Sequence[float]) -> str:
    if not values:
        return "-"
    return ", ".join(f"{number:.1f}" for number in (*np.percentile(values, (50, 95)), np.max(values)))


if __name__ == "__main__":
    main(sys.argv[1:])
