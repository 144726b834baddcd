"""Which solvers survive a platform on many feet: solved, failed, wrong, pivots and time.

    python -m studies.contact.robustness --out results [--loads 200] [--seed 0] [--feet 3 4 6 8 12]

Three sets of problems: a platform on 3 to 12 feet on a circle under random loads from rest to sliding and
tipping, with 4 and 12 facets; the same platform under exactly degenerate loads; random supports of 2 to 8
ordinary contacts. Solvers: ours; Lemke's method on two conventional formulations with three pivot rules each;
Pinocchio's PGS and ADMM; Drake's Moby and unrevised Lemke. Solvers that are not installed are left out; run
again with another Python and the same --out to add them.

All are judged by the same yardstick, from their forces alone: the base's acceleration follows from the
forces, the contacts' accelerations from the base's, and both are put into the contact laws (those of the
pyramid; of Coulomb's cone for Pinocchio). "Wrong": success claimed, laws violated by more than 1e-6 of the
largest force.

Finished cases are kept in OUT/contact_robustness_cases, those of other --loads and --seed, too: start again
to go on after an interruption; delete the folder to measure afresh. Writes OUT/contact_robustness.json, .md
and .png.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from ocptip.basics.write import versions, write_text
from studies.common import ended, json_text, keep_result, kept_result, machine, progress
from studies.contact.problems import DEGENERATE_LOADS, FACETS, FEET, all_cases
from studies.contact.robustness_report import draw, markdown
from studies.contact.solvers import EXTERNAL, run_compiled, run_peer
from studies.contact.yardstick import WRONG


def run(out: Path, feet: Sequence[int], loads: int, seed: int) -> dict:
    """Run what is not there yet and return everything that belongs to these options."""
    options = {"loads": loads, "seed": seed}
    folder = out / "contact_robustness_cases"
    folder.mkdir(parents=True, exist_ok=True)
    external = {peer.name: ("numpy", "pin", "drake") for peer in EXTERNAL}
    groups = {"compiled": ("numpy", "llvmlite"), **external}
    peers = {peer.name: peer for peer in EXTERNAL}
    cases = list(all_cases(feet, loads, seed))
    tallies, used = [], {}
    steps = [(case, group) for case in cases for group in groups]
    for done, (case, group) in enumerate(steps):
        name = f"{case.name}__{group}"
        stored = kept_result(folder, name, options)
        if stored is None:
            if group in peers and not peers[group].available():
                continue
            progress(done, len(steps), f"{case.name}, {group}")
            results = run_peer(case, peers[group]) if group in peers else run_compiled(case)
            packages = versions(groups[group])
            if group in peers:
                packages.pop("drake" if group.startswith("pinocchio") else "pin", None)
            stored = {
                "options": options,
                "versions": packages,
                "tallies": [asdict(tally) for tally in results],
            }
            keep_result(folder, name, stored)
        tallies += stored["tallies"]
        for package, number in stored["versions"].items():
            used.setdefault(package, set()).add(number)
    progress(len(steps), len(steps), "cases")
    return {
        "options": {**options, "feet": list(feet), "facets": list(FACETS)},
        "versions": {package: ", ".join(sorted(numbers)) for package, numbers in sorted(used.items())},
        "machine": machine(),
        "wrong_from": WRONG,
        "degenerate_loads": {name: list(map(float, wrench)) for name, wrench in DEGENERATE_LOADS.items()},
        "results": tallies,
    }


def write_all(out: Path, data: dict) -> str:
    """Write results, tables and figure; return the tables."""
    text = markdown(data)
    write_text(out / "contact_robustness.json", json_text(data, "results"))
    write_text(out / "contact_robustness.md", text)
    draw(data, out / "contact_robustness.png")
    return text


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for cases, table and figure")
    parser.add_argument("--loads", type=int, default=200, help="random loads per case")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--feet", type=int, nargs="+", default=list(FEET))
    options = parser.parse_args(argv)
    if options.loads < 1 or min(options.feet) < 1:
        parser.error("--loads and --feet must be at least 1")
    return ended(
        "contact_robustness",
        lambda: write_all(options.out, run(options.out, options.feet, options.loads, options.seed)),
        "finished cases are kept, start again to go on.",
    )


if __name__ == "__main__":
    sys.exit(main())
