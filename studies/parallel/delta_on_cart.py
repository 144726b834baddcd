"""What does planning save a Delta on a light cart, against straight motions that stand?

    python -m studies.parallel.delta_on_cart --out FOLDER [--starts 8] [--seed 0] [--jobs 1]

Three motions from the same start to the same goal, all within the same limits (tip-over, slip, motor torques
and speeds, distance from singular poses), each checked on a dense time grid:

- planned: ramps of all three coordinates, least electric energy (`ocptip.motion.plan.plan_motion`),
- straight ramps: one symmetric ramp per coordinate, together on a straight line, of the duration of least
  energy among those that stand,
- straight, smooth: a step of fifth degree in time on the same line, likewise.

Writes delta_on_cart.json, .md and .png, and the plan's own files in the folder `plan`.
"""

from __future__ import annotations

import argparse
import platform
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ocptip.basics.errors import PlanningError
from ocptip.basics.write import versions, write_json, write_text
from ocptip.certificate.checks import certified
from ocptip.motion.check import MotionCheck, check_motion
from ocptip.motion.files.output import sample_motion
from ocptip.motion.files.plan_files import write_plan
from ocptip.motion.plan import plan_motion
from ocptip.motion.task import MotionTask
from ocptip.standing.samples import MotionSamples
from ocptip.task_files.motion import load_task
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from studies.common import EXAMPLES, table

_NAME = "delta_on_cart"
_TASK = EXAMPLES / "tasks/delta_cart.toml"
_SAMPLES = 121
_RANGE = 0.05, 5.0  # s
_DIGITS = 1e-4

Motion = Trajectory


def straight_ramps(task: MotionTask, duration: float) -> Trajectory:
    """Every coordinate accelerates over half the duration and brakes over the other half."""
    commands = []
    for start, goal in zip(task.start, task.goal, strict=True):
        acceleration = 4 * abs(goal - start) / duration**2 or 1.0
        commands.append([RampCommand(goal, acceleration * duration, acceleration)])
    return Trajectory.from_profiles(task.start, commands)


def straight_smooth(task: MotionTask, duration: float) -> Trajectory:
    """A step of fifth degree in time on the straight line."""
    tau = np.linspace(0.0, 1.0, _SAMPLES)
    step = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
    way = task.goal - task.start
    speeds = np.outer(step.deriv()(tau), way) / duration
    speeds[[0, -1]] = 0.0
    return Trajectory.from_points(tau * duration, task.start + np.outer(step(tau), way), speeds)


def shortest(task: MotionTask, motion_of: Callable[[MotionTask, float], Motion]) -> Motion:
    """The fastest motion that the check allows, by bisection of the duration to four digits."""
    fast, slow = _RANGE
    if not check_motion(task.robot, motion_of(task, slow), task.limits).verified:
        raise SystemExit(f"not allowed even in {slow} s")
    while slow - fast > _DIGITS * slow:
        middle = 0.5 * (fast + slow)
        if check_motion(task.robot, motion_of(task, middle), task.limits).verified:
            slow = middle
        else:
            fast = middle
    return motion_of(task, slow)


def cheapest(task: MotionTask, motion_of: Callable[[MotionTask, float], Motion]) -> Motion:
    """Of the allowed motions, up to four times slower than the fastest, the one of least energy.

    A slower motion is not always allowed: gravity may need the acceleration of a faster one. Hence each is
    checked, the cheapest first.
    """
    fastest = shortest(task, motion_of)
    slower = [motion_of(task, duration) for duration in fastest.end * np.geomspace(1.0, 4.0, 61)[1:]]
    motions = sorted([fastest, *slower], key=task.robot.energy)
    return next(m for m in motions if m is fastest or check_motion(task.robot, m, task.limits).verified)


def row(name: str, checked: MotionCheck) -> dict[str, object]:
    """One motion's numbers."""
    worst = {
        key: checked.worst[key].value for key in ("GN", "GT", "torque_ratio", "motor_speed", "singularity")
    }
    return {
        "motion": name,
        "verified": checked.verified,
        "duration_s": checked.duration,
        "energy_J": checked.energy,
        **worst,
    }


def markdown(rows: list[dict], options: argparse.Namespace, task: MotionTask) -> str:
    """The results in Markdown."""
    limits = task.limits
    lines = [
        "# A Delta on a light cart: planned and straight motions",
        "",
        f"Limits: GN {limits.GN}, GT {limits.GT}, motor torque {task.robot.limits.torque.min():g} N m, motor "
        f"speed {np.min(task.robot.platform_limits.motor_speed):g} rad/s; {options.starts} starts, seed "
        f"{options.seed}. Written by `studies/parallel/delta_on_cart.py`.",
        "",
    ]
    head = ["motion", "checked", "duration [s]", "energy [J]", "GN", "GT", "torque / limit"]
    head += ["motor speed [rad/s]", "distance from singular poses"]
    cells = [
        [
            r["motion"],
            "yes" if r["verified"] else "no",
            f"{r['duration_s']:.4f}",
            f"{r['energy_J']:.2f}",
            *(f"{r[name]:.3f}" for name in ("GN", "GT", "torque_ratio")),
            f"{r['motor_speed']:.2f}",
            f"{r['singularity']:.3f}",
        ]
        for r in rows
    ]
    return "\n".join([*lines, *table(head, cells)]) + "\n"


def plot(found: dict[str, MotionSamples], task: MotionTask, target: Path) -> None:
    """Path from the side, coordinates' speeds, reserves, motor torques."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, 2, figsize=(10.5, 7.5), layout="constrained")
    (path, power), (tip, slip) = axes
    for name, samples in found.items():
        path.plot(samples.angles[:, 0], samples.angles[:, 2], label=name)
        power.plot(samples.times, samples.powers.sum(axis=1), label=name)
        tip.plot(samples.times, samples.tip.GN, label=name)
        slip.plot(samples.times, samples.slip.GT, label=name)
    path.set(title="Path of the platform, from the side", xlabel="x [m]", ylabel="z [m]")
    power.set(title="Electric power of the motors", xlabel="time [s]", ylabel="power [W]")
    for ax, name, limit in ((tip, "GN (tip-over)", task.limits.GN), (slip, "GT (slip)", task.limits.GT)):
        ax.axhline(limit, color="0.4", linestyle=":", label="limit")
        ax.set(title=name, xlabel="time [s]", ylabel="reserve value", ylim=(0, 1))
    for ax in axes.flat:
        ax.legend(fontsize=8)
        ax.grid(alpha=0.3)
    figure.savefig(target, dpi=120)
    pyplot.close(figure)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--starts", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(arguments)
    if options.starts < 1 or options.jobs < 1:
        parser.error("--starts and --jobs must be at least 1")
    options.out.mkdir(parents=True, exist_ok=True)
    task = load_task(_TASK)
    try:
        plan = plan_motion(task, starts=options.starts, seed=options.seed, jobs=options.jobs, prove=certified)
    except PlanningError as error:
        raise SystemExit(str(error)) from None
    motions: dict[str, Motion] = {
        "planned": plan.motion,
        "straight ramps": cheapest(task, straight_ramps),
        "straight, smooth": cheapest(task, straight_smooth),
    }
    rows = [row(name, check_motion(task.robot, motion, task.limits)) for name, motion in motions.items()]
    samples = {name: sample_motion(task.robot, motion, 0.002) for name, motion in motions.items()}
    text = markdown(rows, options, task)
    data = {
        "task": _TASK.name,
        "options": {"starts": options.starts, "seed": options.seed},
        "versions": {**versions(("numpy",)), "machine": platform.machine()},
        "motions": rows,
        "starts": [
            {"number": s.number, "status": s.status, "energy_J": s.energy, "cpu_s": s.cpu_seconds}
            for s in plan.starts
        ],
    }
    write_json(options.out / f"{_NAME}.json", data, indent=1)
    write_text(options.out / f"{_NAME}.md", text)
    plot(samples, task, options.out / f"{_NAME}.png")
    write_plan(options.out / "plan", plan, samples=[samples["planned"]])
    print(text, end="")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
