"""What the velocity-ramp form costs: ramp plans against the free-form optimum of the same task.

The free-form problem has the same arm, base, power maps and limits as `ocptip plan`, but every joint may move
as it likes: six speeds that are piecewise quadratic in time on N equal intervals, continuous at their ends,
while the accelerations may jump there (as those of ramps do). Doubling N keeps every motion of the coarser
grid, so the energies fall from grid to grid (but for the tightening of limits) and bound the optimum from
above. See `free_motion` for the motions, `free_form` for the problem, `search` for its solution.

Joints that creep take the cheaper side of their power maps. Ramps can do so, too; the results also tell the
energy if such joints count as at rest, where the maps are read for positive direction. All energies are those
of the exact maps, integrated between the turning points.

    python -m studies.ramp_gap.run --out results [--plans plans] [--cases A B] [--grids 20 40 80] [--seed 0]

`--plans DIR`: ramp plans as DIR/A-effective/plan.json with `start` (degrees), `commands` and `energy_J`.
Finished pairs of case and base are kept, those of other options, too; start again to go on.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from ocptip.basics.write import plain, versions, write_json, write_text
from ocptip.published.cases import motion_case, motion_cases
from ocptip.published.tasks import BASES, experiment_robot
from ocptip.trajectories.trajectory import Trajectory
from studies.common import PLANNING, ended, keep_result, kept_result, machine, say, source_state, state_notes
from studies.ramp_gap.free_form import CREEP
from studies.ramp_gap.free_motion import motion_dict
from studies.ramp_gap.report import draw, markdown, price
from studies.ramp_gap.search import DENSE_STEP, SMOOTHING, Options, Search, climb, exact_energy, starts_of


def run_pair(
    case_name: str, base: str, plan: Trajectory | None, options: Options, say: Callable[[str], None]
) -> dict:
    """Everything found for one case on one base, as plain data."""
    case = motion_case(case_name)
    robot = experiment_robot(case, base)
    limits = robot.arm.limits
    reference = case.reference_motion(limits.speed, limits.acceleration)
    guesses = starts_of(reference, plan, case.goal, options)
    begin = time.process_time()
    result = {
        "case": case_name,
        "base": base,
        "reference_J": robot.energy(reference),
        "ramp_plan_J": None if plan is None else robot.energy(plan),
        "ramp_plan_s": None if plan is None else plan.end,
        "reference_s": reference.end,
    }
    active: frozenset[str] = frozenset()
    for kind, passive in (("passive_wrists", (3, 4, 5)), ("free", ())):
        if passive and not options.wrists:
            result[kind] = None
            continue
        search = Search(
            robot, case.start, case.goal, passive=passive, iterations=options.iterations, active=active
        )
        records, best, coarse = climb(
            search, guesses, options, lambda text, kind=kind: say(f"{kind}, {text}")
        )
        active = search.active
        if (
            passive
            and best
            and np.max(np.abs(best.motion.speeds[:, passive]) / limits.speed[[passive]]) > 0.999
        ):
            best = coarse = None  # their ramp would not be a triangle
        if coarse:
            guesses = {"passive wrists": coarse.motion, **guesses}
        result[kind] = {
            "energy_J": best.energy if best else None,
            "energy_resting_J": exact_energy(robot, best.motion, 2 * CREEP) if best else None,
            "duration_s": best.motion.duration if best else None,
            "worst": dict(vars(best.worst)) if best else None,
            "limits_included": sorted(search.active),
            "records": records,
            "motion": motion_dict(best.motion) if best else None,
        }
    result["cpu_s"] = time.process_time() - begin
    return result


def read_plan(folder: Path | None, case: str, base: str) -> Trajectory | None:
    """The ramp plan of a case on a base; None if there is no such file.

    Raises:
        ValueError: it leads elsewhere, or its energy is not that of this model.
    """
    path = folder / f"{case}-{base}" / "plan.json" if folder else None
    if path is None or not path.exists():
        return None
    data = json.loads(path.read_text())
    motion, task = Trajectory.from_dict(data), motion_case(case)
    if not (
        np.allclose(motion.start, task.start, atol=1e-4) and np.allclose(motion.goal, task.goal, atol=1e-4)
    ):
        raise ValueError(f"{path}: does not lead from start to goal of case {case}")
    energy = experiment_robot(task, base).energy(motion)
    if abs(energy - data["energy_J"]) > 1e-3 * energy:
        raise ValueError(f"{path}: energy_J is {data['energy_J']}, but the commands take {energy:.3f} J")
    return motion


def run(out: Path, cases: Sequence[str], plans: Path | None, options: Options) -> str:
    """Solve what is not there yet, write all files, return the Markdown text."""
    folder = out / "ramp_gap_pairs"
    folder.mkdir(parents=True, exist_ok=True)
    results, motions, state = [], {}, source_state(*PLANNING)
    for case in cases:
        for base in BASES:
            plan = motions[case, base] = read_plan(plans, case, base)
            key = plain({**asdict(options), "plan": plan.to_dict() if plan else None})
            saved = kept_result(folder, f"{case}-{base}", key)
            if saved is None:
                found = run_pair(case, base, plan, options, partial(_say, f"{case}, {base} base"))
                saved = {**found, "options": key, "state": state}
                keep_result(folder, f"{case}-{base}", saved)
            results.append(saved)
    say("")
    head = {
        "versions": versions(("numpy", "casadi")),
        "machine": machine(),
        "options": asdict(options),
        "smoothing_rad_s": SMOOTHING,
        "dense_step_s": DENSE_STEP,
        "pairs": [without_motions(r) for r in results],
    }
    text = markdown(results, options, state_notes([r.get("state") for r in results], state))
    write_json(out / "ramp_gap.json", head, indent=1)
    write_text(out / "ramp_gap.md", text)
    for case in cases:
        mine = [r for r in results if r["case"] == case]
        draw(case, mine, {base: motions[case, base] for base in BASES}, out / f"ramp_gap_{case}.png")
    return text


def _say(what: str, text: str) -> None:
    say(f"{what}: {text}")


def without_motions(result: dict) -> dict:
    """A result without options and motions, which stay in the pair's file; with the price."""
    short = {key: value for key, value in result.items() if key != "options"}
    for kind in ("free", "passive_wrists"):
        if short[kind]:
            short[kind] = {key: value for key, value in short[kind].items() if key != "motion"}
    return {**short, "price": price(result)}


def main(argv: Sequence[str] | None = None) -> int:
    unclamped = [name for name, case in motion_cases().items() if not case.clamped]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for results, table and figures")
    parser.add_argument("--plans", type=Path, help="folder with ramp plans, e.g. A-effective/plan.json")
    parser.add_argument("--cases", nargs="+", choices=unclamped, default=["A", "B"])
    parser.add_argument("--grids", type=int, nargs="+", default=list(Options.grids), help="20 40 80 ...")
    parser.add_argument("--randoms", type=int, default=Options.randoms, help="random starts")
    parser.add_argument("--seed", type=int, default=Options.seed)
    parser.add_argument("--iterations", type=int, default=Options.iterations, help="of Ipopt, per solve")
    parser.add_argument("--no-wrists", action="store_true", help="leave out the problem with passive wrists")
    given = parser.parse_args(argv)
    grids = given.grids
    if grids[0] < 2 or grids[0] % 2 or any(2 * a != b for a, b in pairwise(grids)):
        parser.error(f"--grids must be even numbers, each twice the one before, got {grids}")
    if given.randoms < 0 or given.iterations < 1:
        parser.error("--randoms must be at least 0 and --iterations at least 1")
    if given.plans and not given.plans.is_dir():
        parser.error(f"--plans: there is no folder {given.plans}")
    options = Options(tuple(grids), given.randoms, given.seed, given.iterations, not given.no_wrists)
    return ended(
        "ramp_gap",
        lambda: run(given.out, given.cases, given.plans, options),
        "finished pairs are kept, start again to go on.",
    )


if __name__ == "__main__":
    sys.exit(main())
