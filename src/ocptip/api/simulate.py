"""`ocptip.simulate`: a plan or a cycle replayed by MuJoCo on a free base, beside what the library says."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np

from ocptip.basics.errors import InputError, naming, positive_number, share_of_one
from ocptip.basics.text import quantity
from ocptip.basics.write import versions, write_json
from ocptip.standing.parts import Part
from ocptip.standing.simulation.mjcf import remarks
from ocptip.standing.simulation.objects import predicted_objects
from ocptip.standing.simulation.replay import Compared, Replay, Simulator, compared, simulator_numbers
from ocptip.standing.simulation.world import World
from ocptip.task_files.plan_folder import PlanFolder, read_plan_folder

STEEPEST = 60.0
"""deg: the largest tilt."""
_LONGEST_STEP = 5e-4
_BOUNDS = {
    "stiffness": (1e3, 1e8, "1e3 to 1e8 N/m, got {:g}; without it feet are stiff"),
    **dict.fromkeys(("friction", "speed"), (0.01, 100.0, "a factor of 0.01 to 100, got {:g}")),
}


def simulate(
    plan: PlanFolder | str | os.PathLike[str],
    *,
    step: float = 1e-4,
    stiffness: float | None = None,
    damping: float | None = None,
    tilt: float | None = None,
    downhill: float = 0.0,
    payload: float | None = None,
    friction: float | None = None,
    speed: float | None = None,
) -> Simulated:
    """Replay a plan with MuJoCo and compare foot forces with those of the library.

    Example::

        ocptip.simulate("ocptip-plan-A", friction=0.9).stable

    Args:
        plan: the folder of a plan or a cycle of an arm, or what was read from it.
        step: s, of the simulator, at most 0.0005.
        stiffness: N/m, of all feet, 1e3 to 1e8; default: that of the plan.
        damping: ratio, 0 to 1, with `stiffness`.
        tilt: rad, of the floor, at most 60 degrees.
        downhill: rad, direction of the tilt from the base's x axis to its y axis.
        payload: kg more at the TCP.
        friction, speed: factors, 0.01 to 100.

    Raises:
        InputError: an argument, or the folder cannot be used; one line.
    """
    given = {"stiffness": stiffness, "damping": damping, "payload": payload}
    given |= {"friction": friction, "speed": speed}
    world = World(**cast(Any, _changes(given, tilt, downhill)))
    step = positive_number("step", step)
    if step > _LONGEST_STEP:
        raise InputError(f"step: at most {_LONGEST_STEP:g} s, got {step:g}")
    folder = read_plan_folder(plan)
    parts = folder.parts("simulate replays", objects=True)
    with naming(str(folder.path)):
        replay = Simulator(parts, step=step).run(world)
        there = world.parts(parts)
        return Simulated(folder.task.name, there, replay, compared(parts, replay), predicted_objects(there))


def _changes(given: dict[str, float | None], tilt: float | None, downhill: float) -> dict[str, float]:
    """Fields of the world that differ, checked."""
    changes = {name: value for name, value in given.items() if value is not None}
    for name, value in changes.items():
        if name == "damping":
            if "stiffness" not in changes:
                raise InputError("damping: only for compliant feet; give stiffness as well")
            changes[name] = share_of_one(name, value)
        else:
            changes[name] = positive_number(name, value, zero_allowed=name == "payload")
        low, high, words = _BOUNDS.get(name, (-np.inf, np.inf, ""))
        if not low <= value <= high:
            raise InputError(f"{name}: {words.format(value)}")
    if tilt is None:
        return changes
    if not 0 <= tilt <= np.radians(STEEPEST):
        raise InputError(f"tilt: 0 to {np.radians(STEEPEST):.4g} rad, got {tilt!r}")
    return {**changes, "tilt": float(tilt), "downhill": float(downhill)}


@dataclass(frozen=True, eq=False, repr=False)
class Simulated:
    """The result of replaying a plan in a simulator.

    Attributes:
        name: of the task.
        parts: what it does in its world.
        replay: what happened.
        library: what the library says of it; None where it does not.
        kept: the library says whether each object keeps its contacts, by name.
    """

    name: str
    parts: tuple[Part, ...]
    replay: Replay
    library: Compared | None
    kept: dict[str, bool] = field(default_factory=dict)

    @property
    def stable(self) -> bool:
        """Whether no foot and no object lifts, slides or falls in the simulator."""
        return self.replay.stands

    def __repr__(self) -> str:
        """The verdict and the minimum foot force."""
        verdict = "stable" if self.stable else "falls" if self.replay.falls else "not stable"
        force = quantity(float(np.min(self.replay.forces)), "N", 3)
        world = self.replay.world.text() or "nominal"
        return f"<Simulated {self.name}: {verdict} ({world}), minimum foot force {force}>"

    def to_dict(self) -> dict[str, Any]:
        """The verdict with all numbers."""
        seen, expected = self.replay, self.library
        index = np.argmin(seen.forces, axis=0)
        library = None
        if expected is not None:
            library = {
                "stands": expected.stands,
                "least_forces_N": expected.least.tolist(),
                "times_s": expected.when.tolist(),
                "rms_least_N": expected.rms_least,
                "rms_N": expected.rms,
            }
        objects = {
            name: {
                "stands": moved.stays,
                "lift_m": moved.lift,
                "slide_m": moved.slide,
                "library": {"stands": self.kept[name]},
            }
            for name, moved in seen.objects.items()
        }
        return {
            "task": self.name,
            "stands": seen.stands,
            "falls": seen.falls,
            "world": vars(seen.world),
            "lift_m": seen.lift,
            "slide_m": seen.slide,
            "least_forces_N": seen.forces[index, np.arange(len(index))].tolist(),
            "times_s": seen.times[index].tolist(),
            "library": library,
            **({"objects": objects} if objects else {}),
            "simulator": simulator_numbers(self.parts[0].robot, seen.step),
            "remarks": remarks(self.parts),
            "versions": versions(("numpy", "mujoco")),
        }

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the data as JSON into a file; returns its path."""
        write_json(Path(path), self.to_dict())
        return Path(path)
