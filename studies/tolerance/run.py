"""Price of a tolerance: plans within it, within each of its quantities alone, and of the world as described.

Plans within it have the rise times that the planner chooses; `ramps` are those whose accelerations jump.

The eight cases with the effective base within `workshop`, three arms on carts within `site`.

    python -m studies.tolerance.run --out results [--starts 8] [--seed 0] [--tasks B "UR5 on a cart"]
        [--quantities tilt delay ...] [--seconds S]

Goes on: finished rows are kept.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, PlanningError
from ocptip.basics.write import versions, write_text
from ocptip.certificate.checks import certified
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.motion.multi_start import with_rise_time
from ocptip.motion.plan import plan_motion
from ocptip.motion.planner.one_start import Search
from ocptip.motion.task import MotionTask
from ocptip.published.cases import motion_cases
from ocptip.published.tasks import experiment_task
from ocptip.standing.tolerance import NONE, PRESETS, Uncertainty
from ocptip.standing.within.worst_case import worst_case_of
from ocptip.task_files.motion import load_task
from studies.common import (
    EXAMPLES,
    PLANNING,
    RowFile,
    ended,
    number,
    percent,
    say,
    software,
    source_state,
    state_notes,
    table,
)
from studies.s_curves.run import STIFFNESSES, feet_of

CART = {"mass": 60.0, "half": 0.30, "friction": 0.6}
JUMPS = ("delay", "damping")
QUANTITIES: dict[str, tuple[str, ...]] = {
    "tilt": ("tilt",),
    "masses": ("base_mass", "arm_mass", "payload_mass", "extra_mass"),
    "friction": ("friction",),
    "pace": ("speed",),
    "push": ("push",),
    "overshoot": ("damping",),
    "lateness": ("delay",),
    "both": JUMPS,
}
"""Parts of a tolerance that are looked at alone: name, attributes."""

NOMINAL, ALL, STATIC, REST = "none", "all", "all but both", "rest"
RAMPS = "ramps"
"""All of a tolerance, with accelerations that jump."""


def on_cart(case: str) -> MotionTask:
    """The arm of a published case on four feet under a heavy base."""
    task = experiment_task(case, "effective")
    own, half = task.robot.support, CART["half"]
    height = own.contacts[0].position[2]
    feet = [
        UnilateralContact(position=[x * half, y * half, height], friction=CART["friction"])
        for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]
    support = Support(feet, mass=CART["mass"], center_of_mass=[0, 0, height / 2], gravity=own.gravity)
    robot = task.robot.varied(support=support)
    return replace(task, name=f"arm of {case} on a cart", robot=robot, reference=None, source=None)


def tasks() -> dict[str, tuple[MotionTask, str]]:
    """All tasks by name, with the name of their tolerance."""
    found = {name: (experiment_task(name, "effective"), "workshop") for name in motion_cases()}
    found["UR5 on a cart"] = load_task(EXAMPLES / "tasks" / "ur5_cart.toml"), "site"
    for case in ("A", "D"):
        task = on_cart(case)
        found[task.name] = task, "site"
    return found


def parts(preset: str) -> dict[str, Uncertainty]:
    """Parts of a tolerance by name, nothing and all of it included."""
    whole = PRESETS[preset]
    only = {name: {key: getattr(whole, key) for key in keys} for name, keys in QUANTITIES.items()}
    found = {name: Uncertainty(**own) for name, own in only.items()}
    found[STATIC] = replace(whole, **{key: getattr(NONE, key) for key in JUMPS})
    return {NOMINAL: NONE, ALL: whole, RAMPS: whole} | {name: own for name, own in found.items() if own.given}


def planned(task: MotionTask, starts: int, seed: int) -> dict[str, Any]:
    """Energy, duration and CPU time of a plan, or why there is none; nothing is compiled meanwhile."""
    began = time.process_time()
    try:
        Search(with_rise_time(task)).rough(starts, seed)
        began = time.process_time()
        plan = plan_motion(task, starts=starts, seed=seed, jobs=1, prove=certified)
    except (InputError, PlanningError) as error:
        return {"refused": f"{error}", "cpu_s": time.process_time() - began}
    worst = plan.check.within.to_dict() if plan.check.within else None
    return {
        "energy_J": plan.energy,
        "duration_s": plan.duration,
        "rise_s": max(plan.motion.rise_times, default=0.0),
        "verified": sum(start.verified for start in plan.starts),
        "cpu_s": time.process_time() - began,
        "worst": worst,
        "feet": feet_of(task.robot, plan.motion),
        "motion": plan.motion.to_dict(),
    }


def at_rest(task: MotionTask, tolerance: Uncertainty) -> dict[str, float]:
    """Least moments about a tipping axis at start and goal, N m: as described, and within a tolerance."""
    cases = worst_case_of(task.robot, tolerance)
    s = np.hstack([np.array([task.start, task.goal]), np.zeros((2, 2 * task.robot.n))])
    moments = [float(own.all_moments(s).min()) for own in (cases.within(NONE), cases)]
    return dict(zip(("described_Nm", "within_Nm"), moments, strict=True))


def jobs(names: Sequence[str] | None, quantities: Sequence[str] | None) -> Iterator[tuple[str, str]]:
    """Tasks and parts: what all of a tolerance costs first."""
    found = tasks()
    chosen = [name for name in found if names is None or name in names]
    for wanted in ((NOMINAL, ALL, RAMPS), (STATIC, "both"), tuple(QUANTITIES)):
        for name in chosen:
            own = parts(found[name][1])
            yield from (
                (name, part)
                for part in wanted
                if part in own and (quantities is None or part in quantities or part in (NOMINAL, ALL, RAMPS))
            )


def prices(rows: Sequence[dict[str, Any]], key: str) -> dict[str, dict[str, float]]:
    """By task and part, how much more of an entry than nominally."""
    by = {(row["task"], row["part"]): row for row in rows}
    found: dict[str, dict[str, float]] = {}
    for (name, part), row in by.items():
        nominal = by.get((name, NOMINAL), {})
        if part != NOMINAL and key in row and key in nominal and "refused" not in row:
            found.setdefault(name, {})[part] = row[key] / nominal[key] - 1
    return found


def markdown(rows: Sequence[dict[str, Any]], notes: list[str]) -> str:
    """The prices of all, and of the parts."""
    by = {(row["task"], row["part"]): row for row in rows}
    presets = {row["task"]: row["preset"] for row in rows}
    names = list(presets)
    energy, duration, cpu = (prices(rows, key) for key in ("energy_J", "duration_s", "cpu_s"))
    lines = []
    for name in names:
        nominal, whole = (by.get((name, part), {}) for part in (NOMINAL, ALL))
        ratio = cpu.get(name, {}).get(ALL)
        lines.append(
            [name, presets[name]]
            + [number(row.get("energy_J"), 1) for row in (nominal, whole)]
            + [number(row.get("duration_s"), 3) for row in (nominal, whole)]
            + [percent(own.get(name, {}).get(ALL), 1) for own in (energy, duration)]
            + [_rise(whole), percent(energy.get(name, {}).get(RAMPS), 1)]
            + [number(nominal.get("cpu_s"), 1), number(None if ratio is None else 1 + ratio, 2)]
        )
    head = ["task", "tolerance", "nominal J", "within J", "nominal s", "within s"]
    head += ["energy", "duration", "rise", "energy of ramps", "nominal CPU s", "CPU ratio"]
    text = ["# Price of tolerances", "", *table(head, lines, left=2), ""]
    text += _medians(rows, energy, cpu)
    refused = {row["task"]: row["refused"] for row in rows if row["part"] == ALL and "refused" in row}
    text += [f"- {name}: {why}" for name, why in refused.items()]
    text += _felt(by, names)
    own = [STATIC, "both", *(name for name in QUANTITIES if name != "both")]
    split = [[name, *(percent(energy.get(name, {}).get(part), 1) for part in (*own, ALL))] for name in names]
    text += ["", "Energy, each quantity alone (both: overshoot and lateness together):", ""]
    text += table(["task", *own, ALL], split)
    text += ["", "Least moment about a tipping axis at rest, N m; what is left moves the arm:", ""]
    lines = []
    for name in names:
        if row := by.get((name, REST)):
            least = row["described_Nm"], row["within_Nm"]
            lines.append([name, *(number(x, 2) for x in least), percent(least[1] / least[0])])
    text += table(["task", "as described", "within", "left"], lines)
    return "\n".join([*text, "", *notes]) + "\n"


def _rise(row: dict[str, Any]) -> str:
    """The rise time of a plan."""
    return "-" if "rise_s" not in row else f"{1e3 * row['rise_s']:.0f} ms" if row["rise_s"] else "ramps"


def _felt(by: dict[tuple[str, str], dict[str, Any]], names: Sequence[str]) -> list[str]:
    """By how much feet lift in plans within the whole tolerance, as described otherwise."""
    lines = []
    for name in names:
        found = [by.get((name, part), {}).get("feet") or [] for part in (ALL, RAMPS)]
        if any(found):
            lines.append([name, *(_lift(own, stiffness) for stiffness in STIFFNESSES for own in found)])
    if not lines:
        return []
    text = ["", "Lift of a foot on compliant feet, 5 % damping, mm (plans within the tolerance):", ""]
    head = [f"{stiffness:.0e} N/m{what}" for stiffness in STIFFNESSES for what in ("", ", ramps")]
    return text + table(["task", *head], lines)


def _lift(found: Sequence[dict[str, Any]], stiffness: float) -> str:
    own = next((one for one in found if one["stiffness"] == stiffness), None)
    if own is None:
        return "-"
    return "falls" if own["falls"] else number(own["lift_mm"], 3)


def _medians(
    rows: Sequence[dict[str, Any]], energy: dict[str, dict[str, float]], cpu: dict[str, dict[str, float]]
) -> list[str]:
    found = []
    for preset in dict.fromkeys(row["preset"] for row in rows):
        own = {row["task"] for row in rows if row["preset"] == preset}
        costs, times = ([of[name][ALL] for name in own if ALL in of.get(name, {})] for of in (energy, cpu))
        if costs:
            price, ratio = percent(float(np.median(costs)), 1), 1 + float(np.median(times))
            what = f"median price in energy {price}, median ratio of CPU time {ratio:.2f}"
            found.append(f"- `{preset}`, {len(costs)} tasks: {what}.")
    return found


_PARTS = {
    ALL: ("the whole uncertainty", "D"),
    RAMPS: ("the whole, trapezoidal profiles", "v"),
    STATIC: ("all but delay and overshoot", "s"),
    "both": ("delay and overshoot", "P"),
    "tilt": ("floor tilt alone", "o"),
    "masses": ("masses alone", "o"),
    "friction": ("friction alone", "o"),
    "pace": ("speed alone", "^"),
    "push": ("push alone", "<"),
    "overshoot": ("overshoot alone", ">"),
    "lateness": ("delay alone", "p"),
}
"""What the legend says of a part, and its mark."""


def figure(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Additional energy of the parts, one row of marks per task."""
    from ocptip.pictures import style
    from ocptip.pictures.frame import new_figure, save_figure

    found = prices(rows, "energy_J")
    fig = new_figure(10.5, 0.42 * len(found) + 1.9)
    ax = fig.subplots()
    for k, (part, (label, mark)) in enumerate(_PARTS.items()):
        points = [(100 * own[part], row) for row, own in enumerate(found.values()) if part in own]
        if points:
            look = {"color": style.member(k)["color"], "marker": mark, "ls": "", "label": label}
            ax.plot(*zip(*points, strict=True), **look, ms=8 if part == ALL else 5.5, alpha=0.85)
    ax.axvline(0.0, color=style.NOTE, lw=0.8, zorder=0)
    ax.set_yticks(range(len(found)), list(found))
    ax.invert_yaxis()
    ax.set_xscale("symlog", linthresh=5)
    ticks = [-5, 0, 5, 10, 20, 50, 100, 200]
    ax.set_xticks(ticks, [f"{tick}" for tick in ticks])
    ax.xaxis.minorticks_off()
    ax.set_xlim(left=max(-5.0, ax.get_xlim()[0]))
    style.finish(
        ax,
        "Each mark is one plan; farther to the right costs more",
        "task",
        "energy beyond the plan of the nominal model [%]",
    )
    ax.grid(axis="x", color=style.GRID, lw=0.8)
    style.head(fig, "What keeping the margins within an uncertainty costs in energy")
    save_figure(fig, path, 130)


def run(
    out: Path,
    names: Sequence[str] | None = None,
    quantities: Sequence[str] | None = None,
    starts: int = 8,
    seed: int = 0,
    seconds: float = np.inf,
) -> str:
    """Compute what is missing, write table and figure."""
    out.mkdir(parents=True, exist_ok=True)
    state, options = source_state(*PLANNING), {"starts": starts, "seed": seed}
    file = RowFile(out / "tolerance.json", options, ("task", "part"), state)
    found, began = tasks(), time.monotonic()
    for name, part in jobs(names, quantities):
        if time.monotonic() - began > seconds:
            break
        if file.find(task=name, part=part) is None:
            say(f"{name}, {part}")
            task, preset = found[name]
            limits = replace(task.limits, tolerance=parts(preset)[part])
            rises = () if part == RAMPS else task.rise_times
            own = planned(replace(task, limits=limits, rise_times=rises), starts, seed)
            file.put({"task": name, "preset": preset, "part": part, **own})
    for name in names or found:
        if file.find(task=name, part=REST) is None:
            task, preset = found[name]
            file.put({"task": name, "preset": preset, "part": REST, **at_rest(task, PRESETS[preset])})
    rows = file.own
    notes = [f"{software(versions(('numpy', 'casadi')))}; {starts} starts, seed {seed}, one process."]
    notes += state_notes([row.get("state") for row in rows], state)
    text = markdown(rows, notes)
    write_text(out / "tolerance.md", text)
    figure(rows, out / "tolerance.png")
    return text


def main(argv: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for results")
    parser.add_argument("--starts", type=int, default=8, help="of every plan")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tasks", nargs="+", help="only these")
    parser.add_argument("--quantities", nargs="+", help="only these, besides nothing and all")
    parser.add_argument("--seconds", type=float, default=np.inf, help="begin no plan after so long")
    given = parser.parse_args(argv)
    return ended(
        "tolerance",
        lambda: run(given.out, given.tasks, given.quantities, given.starts, given.seed, given.seconds),
        "finished rows are kept.",
    )


if __name__ == "__main__":
    sys.exit(main())
