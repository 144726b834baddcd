"""Table and figures of the price of the ramp form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ocptip.contact.solver import solve_many
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


def draw(case_name: str, results: list[dict], plans: dict[str, Trajectory | None], path: Path) -> None:
    """Angles, speeds, power and reserves of the free-form motion and of the ramps; one column per base."""
    case = motion_case(case_name)
    figure = Figure(figsize=(6.4 * len(results), 11), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(4, len(results), squeeze=False, sharex=True, sharey="row")
    for r, column in zip(results, axes.T, strict=True):
        robot = experiment_robot(case, r["base"])
        limits = robot.arm.limits
        plan = plans[r["base"]]
        name = "reference motion" if plan is None else "ramp plan"
        ramps = plan or case.reference_motion(limits.speed, limits.acceleration)
        histories = [(name, "--", 1.1, r["ramp_plan_J"] or r["reference_J"], _ramp_history(robot, ramps))]
        if r["free"]["motion"]:
            history = _free_history(robot, motion_from(r["free"]["motion"]))
            histories.append(("free form", "-", 1.8, r["free"]["energy_J"], history))
        for name, style, width, energy, (times, q, v, power, GN, GT) in histories:
            for j in range(robot.arm.n):
                look = {"color": f"C{j}", "ls": style, "lw": width}
                column[0].plot(times, np.rad2deg(q[:, j] - case.start[j]), **look)
                column[1].plot(times, np.rad2deg(v[:, j]), **look)
            column[2].plot(times, power, "k", ls=style, lw=width, label=f"{name}: {energy:.1f} J")
            for values, color, label in ((GN, "C3", "GN"), (GT, "C0", "GT")):
                column[3].plot(times, values, color=color, ls=style, lw=width, label=f"{label}, {name}")
        column[3].axhline(LIMIT, color="#888888", lw=0.9)
        place = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points", "xytext": (-3, 2)}
        column[3].annotate("limit", (1, LIMIT), ha="right", va="bottom", color="#666666", fontsize=8, **place)
        column[0].set_title(f"case {case_name}, {r['base']} base")
        column[3].set_xlabel("time [s]")
        column[2].legend(fontsize=8, loc="upper right")
        column[3].legend(fontsize=8, ncols=2, loc="upper left")
    joints = [Line2D([], [], color=f"C{j}", lw=1.8, label=f"joint {j + 1}") for j in range(6)]
    joints += [Line2D([], [], color="k", ls="-", lw=1.8, label="free form"),
               Line2D([], [], color="k", ls="--", lw=1.1, label="ramps")]  # fmt: skip
    axes[0, 0].legend(handles=joints, fontsize=8, ncols=2, loc="upper left")
    names = ("angle from start [deg]", "speed [deg/s]", "electric power [W]", "reserve values")
    for row, name in zip(axes, names, strict=True):
        row[0].set_ylabel(name)
        for axis in row:
            axis.grid(color="#e4e4e4", lw=0.6)
            axis.set_axisbelow(True)
            axis.tick_params(labelbottom=True)
    axes[2, 0].set_ylim(top=1.2 * axes[2, 0].get_ylim()[1])  # room for the legends
    axes[3, 0].set_ylim(0, 1.3)
    figure.savefig(path, dpi=110)


def _free_history(robot: Robot, motion: FreeMotion) -> tuple[np.ndarray, ...]:
    x = np.linspace(1e-3, 1 - 1e-3, 11)  # at the ends of intervals a joint may rest between two creeps
    q, v, a = (values.reshape(-1, robot.arm.n) for values in motion.inside(x))
    times = (motion.h * (np.arange(len(motion.middles))[:, None] + x)).ravel()
    torques, wrenches = robot.loads(q, v, a)
    states = solve_many(robot.support, wrenches)
    power = robot.motors.power(torques, v).sum(axis=1)
    GT = robot.slip.evaluate(states, derivatives=False).GT
    return times, q, v, power, robot.tip_over.evaluate(states).GN, GT


def _ramp_history(robot: Robot, motion: Trajectory) -> tuple[np.ndarray, ...]:
    margin = 1e-6 * np.diff(motion.intervals, axis=1)  # both sides of every jump, not the jump itself
    times = np.linspace(*motion.intervals.T, 41)[1:-1].ravel()
    times = np.sort(np.concatenate([times, (motion.intervals + margin * [1, -1]).ravel()]))
    s = robot.samples(motion, times)
    return times, s.angles, s.speeds, s.powers.sum(axis=1), s.tip.GN, s.slip.GT
