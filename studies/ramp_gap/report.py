"""Table and figures of the price of the ramp form."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ocptip.contact.solver import solve_many
from ocptip.pictures import style
from ocptip.pictures.frame import new_figure, save_figure
from ocptip.published.cases import motion_case
from ocptip.published.tasks import experiment_robot
from ocptip.standing.arm import Robot
from ocptip.trajectories.trajectory import Trajectory
from studies.common import number, percent, table
from studies.ramp_gap.free_form import LIMIT
from studies.ramp_gap.free_motion import FreeMotion, motion_from
from studies.ramp_gap.search import Options


def price(result: dict) -> float | None:
    """How much more the ramp plan takes than the free-form motion, as a share."""
    free, ramps = result["free"]["energy_J"], result["ramp_plan_J"]
    return ramps / free - 1 if free and ramps else None


def markdown(results: list[dict], options: Options, notes: list[str]) -> str:
    """Energies, convergence and worst values as Markdown tables."""

    head = ["case", "base", "reference [J]", "ramp plan [J]", "passive wrists [J]", "free form [J]"]
    head += ["resting [J]", "price of the ramp form", "reference [s]", "ramp plan [s]", "free form [s]"]
    rows = []
    for r in results:
        wrists, free = r["passive_wrists"] or {"energy_J": None}, r["free"]
        energies = (r["reference_J"], r["ramp_plan_J"], wrists["energy_J"], free["energy_J"])
        seconds = (r["reference_s"], r["ramp_plan_s"], free["duration_s"])
        rows.append([
            r["case"], r["base"], *(number(x, 2) for x in (*energies, free["energy_resting_J"])),
            percent(price(r), 2), *map(number, seconds),
        ])  # fmt: skip
    lines = table(head, rows, left=2)
    head = ["case", "base", *(f"best, {N} intervals [J]" for N in options.grids)]
    head += [f"starts at {options.grids[0]}", "solved", "spread", "GN", "GT", "torque", "speed", "CPU [s]"]
    rows = []
    for r in results:
        records = r["free"]["records"]
        by_grid = [
            [x["energy_J"] for x in records if x["intervals"] == N and x["energy_J"]] for N in options.grids
        ]
        first, worst = by_grid[0], r["free"]["worst"]
        spread = percent(max(first) / min(first) - 1, 2) if first else "-"
        columns = [r["case"], r["base"], *(number(min(e, default=None)) for e in by_grid)]
        columns += [str(sum(x["intervals"] == options.grids[0] for x in records)), str(len(first)), spread]
        columns += [number(worst[key] if worst else None) for key in ("GN", "GT", "torque", "speed")]
        rows.append([*columns, number(r["cpu_s"], 0)])
    return "\n".join([*lines, "", *table(head, rows, left=2), "", NOTES, *notes, ""])


NOTES = """\
- *free form*: six free joints with piecewise quadratic speeds, checked every millisecond; an upper bound of
  the true optimum, as good as the convergence over the grids shows.
- *passive wrists*: the same, but joints 4 to 6 on the passive joints' ramp; the difference to *free form* is
  what the passive joints cost, the difference to *ramp plan* what the ramps of joints 1 to 3 cost.
- *resting*: the free-form motion if joints that creep at less than 0.01 degrees per second count as at rest,
  where the power maps are read for positive direction; creeping chooses the cheaper side.
- *price*: ramp plan / free form - 1. *spread*: worst / best start on the coarsest grid - 1.
- GN, GT: worst values of the best motion, limit 0.9; torque, speed: shares of their limits."""


_BASES = {"printed": "as-published", "effective": "identified"}


def draw(case_name: str, results: list[dict], plans: dict[str, Trajectory | None], path: Path) -> None:
    """Angles, speeds, power and margins of both motions; one column per base, in the style of all figures."""
    case = motion_case(case_name)
    figure = new_figure(5.2 * len(results) + 1.6, 12.5)
    axes = figure.subplots(5, len(results), squeeze=False, sharex=True, sharey="row")
    for r, column in zip(results, axes.T, strict=True):
        robot = experiment_robot(case, r["base"])
        limits, plan = robot.arm.limits, plans[r["base"]]
        ramps = plan or case.reference_motion(limits.speed, limits.acceleration)
        name = "published" if plan is None else "profiles"
        histories = [
            (name, style.REFERENCE, r["ramp_plan_J"] or r["reference_J"], _ramp_history(robot, ramps))
        ]
        if r["free"]["motion"]:
            history = _free_history(robot, motion_from(r["free"]["motion"]))
            histories.append(("free form", style.NOMINAL, r["free"]["energy_J"], history))
        for name, line, energy, (times, q, v, power, moment, friction) in histories:
            for j in range(robot.arm.n):
                look = {**line, "color": style.MEMBERS[j]}
                label = f"joint {j + 1}" if name == "free form" else None
                column[0].plot(times, np.rad2deg(q[:, j] - case.start[j]), **look, label=label)
                column[1].plot(times, np.rad2deg(v[:, j]), **look)
            for ax, quantity, values, label in (
                (column[2], style.POWER, power, f"{name}: {energy:.1f} J"),
                (column[3], style.TIPPING, moment, name),
                (column[4], style.FRICTION, friction, name),
            ):
                ax.plot(times, quantity.scale * values, **line, color=quantity.color, label=label)
        for ax, quantity, value in (
            (column[3], style.TIPPING, robot.tip_over.reference_moment * (1 / LIMIT - 1)),
            (column[4], style.FRICTION, LIMIT),
        ):
            value *= quantity.scale
            ax.axhline(value, **style.LIMIT, label=f"limit {value:.3g} {quantity.unit}")
    rows = (
        ("Angles from the start", "angle [deg]"),
        ("Speeds", "speed [deg/s]"),
        ("Electric power", style.POWER.label),
        ("Tipping margin", style.TIPPING.label),
        ("Friction used", style.FRICTION.label),
    )
    for row, (title, label) in zip(axes, rows, strict=True):
        for ax, r in zip(row, results, strict=True):
            style.finish(ax, f"{title}, {_BASES.get(r['base'], r['base'])} base", label)
    for ax in axes[-1]:
        ax.set_xlabel("time [s]")
    style.head(figure, f"Case {case_name}: trapezoidal velocity profiles against free-form motions")
    style.note(figure, "solid: free form; dotted: trapezoidal velocity profiles")
    save_figure(figure, path, 110)


def _free_history(robot: Robot, motion: FreeMotion) -> tuple[np.ndarray, ...]:
    x = np.linspace(1e-3, 1 - 1e-3, 11)  # at the ends of intervals a joint may rest between two creeps
    q, v, a = (values.reshape(-1, robot.arm.n) for values in motion.inside(x))
    times = (motion.h * (np.arange(len(motion.middles))[:, None] + x)).ravel()
    torques, wrenches = robot.loads(q, v, a)
    states = solve_many(robot.support, wrenches)
    power = robot.motors.power(torques, v).sum(axis=1)
    GT = robot.slip.evaluate(states, derivatives=False).GT
    return times, q, v, power, np.maximum(robot.tip_over.evaluate(states).moments.min(axis=1), 0.0), GT


def _ramp_history(robot: Robot, motion: Trajectory) -> tuple[np.ndarray, ...]:
    margin = 1e-6 * np.diff(motion.intervals, axis=1)  # both sides of every jump, not the jump itself
    times = np.linspace(*motion.intervals.T, 41)[1:-1].ravel()
    times = np.sort(np.concatenate([times, (motion.intervals + margin * [1, -1]).ravel()]))
    s = robot.samples(motion, times)
    return (
        times,
        s.angles,
        s.speeds,
        s.powers.sum(axis=1),
        np.maximum(s.tip.moments.min(axis=1), 0),
        s.slip.GT,
    )
