"""`ocptip simulate`: a plan or a cycle replayed by MuJoCo on a free base, beside what the library says."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, naming, positive_number, share_of_one
from ocptip.basics.text import quantity
from ocptip.basics.write import versions
from ocptip.cli.command import Report
from ocptip.cli.layout import named, table, under
from ocptip.standing.parts import Part, owners
from ocptip.standing.simulation.mjcf import remarks
from ocptip.standing.simulation.replay import (
    LIFTED,
    SLID,
    Compared,
    Replay,
    Simulator,
    compared,
    simulator_numbers,
)
from ocptip.standing.simulation.world import World
from ocptip.task_files.plan_folder import read_plan_folder

_STEEPEST = 60.0  # deg


def run(options: Namespace) -> SimulateReport:
    """Replay the plan in the world that is asked for."""
    world = _world(options)
    step = positive_number("--step", options.step)
    if step > 5e-4:
        raise InputError(f"--step: at most 0.0005 s, got {step:g}")
    plan = read_plan_folder(options.plan)
    parts = plan.parts("simulate replays")
    with naming(options.plan):
        replay = Simulator(parts, step=step).run(world)
        return SimulateReport(plan.task.name, world.parts(parts), replay, compared(parts, replay))


def _world(options: Namespace) -> World:
    changes: dict[str, Any] = {}
    if options.stiffness is not None:
        changes["stiffness"] = positive_number("--stiffness", options.stiffness)
        if not 1e3 <= options.stiffness <= 1e8:
            raise InputError(
                f"--stiffness: 1e3 to 1e8 N/m, got {options.stiffness:g}; without it feet are stiff"
            )
    if options.damping is not None:
        if options.stiffness is None:
            raise InputError("--damping: of feet that give; give --stiffness, too")
        changes["damping"] = share_of_one("--damping", options.damping)
    if options.tilt is not None:
        angle, *rest = options.tilt
        if len(rest) > 1 or not 0 <= angle <= _STEEPEST:
            raise InputError(
                f"--tilt: 0 to {_STEEPEST:g} degrees and a direction in degrees, got {options.tilt}"
            )
        changes["tilt"] = float(np.radians(angle))
        changes["downhill"] = float(np.radians(rest[0])) if rest else 0.0
    if options.payload is not None:
        changes["payload"] = positive_number("--payload", options.payload, zero_allowed=True)
    for key in ("friction", "speed"):
        if (value := getattr(options, key)) is not None:
            changes[key] = positive_number(f"--{key}", value)
            if not 0.01 <= value <= 100:
                raise InputError(f"--{key}: a factor of 0.01 to 100, got {value:g}")
    return World(**changes)


@dataclass
class SimulateReport(Report):
    """What the simulator saw.

    Attributes:
        name: of the task.
        parts: what it does in its world.
        replay: what happened.
        library: what the library says of it; None where it does not.
    """

    name: str
    parts: tuple[Part, ...]
    replay: Replay
    library: Compared | None

    @property
    def good(self) -> bool:
        """Whether no foot lifts, slides or falls in the simulator."""
        return self.replay.stands

    def to_dict(self) -> dict[str, Any]:
        """The verdict with all numbers."""
        seen, own = self.replay, self.library
        at = np.argmin(seen.forces, axis=0)
        library = None
        if own is not None:
            library = {
                "stands": own.stands,
                "least_forces_N": own.least.tolist(),
                "times_s": own.when.tolist(),
                "rms_least_N": own.rms_least,
                "rms_N": own.rms,
            }
        return {
            "task": self.name,
            "stands": seen.stands,
            "falls": seen.falls,
            "world": vars(seen.world),
            "lift_m": seen.lift,
            "slide_m": seen.slide,
            "least_forces_N": seen.forces[at, np.arange(len(at))].tolist(),
            "times_s": seen.times[at].tolist(),
            "library": library,
            "simulator": simulator_numbers(self.parts[0].robot, seen.step),
            "remarks": remarks(self.parts),
            "versions": versions(("numpy", "mujoco")),
        }

    def to_text(self) -> str:
        """Verdict, forces, lifts and slides."""
        seen, own = self.replay, self.library
        limits = f"{1e3 * LIFTED:g} mm high, none slides by more than {1e3 * SLID:g} mm"
        verdict = f"STANDS in the simulator. No foot gets {limits}"
        if not seen.stands:
            verdict = f"{'FALLS' if seen.falls else 'DOES NOT STAND'} in the simulator"
        lines = [f"{self.name}: {verdict}.", "", *self._table(), ""]
        rows = [("world", seen.world.text() or "as described")]
        if own is not None:
            stands = "no contact is lost" if own.stands else "a contact is lost"
            rows.append(
                (
                    "library",
                    f"{stands}; least foot force {own.rms_least:.2g} N rms apart, all {own.rms:.2g} N",
                )
            )
        else:
            rows.append(
                ("library", "no normal forces to compare: rigid feet that share their load in many ways")
            )
        rows.append(("simulator", simulator_numbers(self.parts[0].robot, seen.step)))
        rows += under("note", remarks(self.parts))
        return "\n".join([*lines, *named(rows)])

    def _table(self) -> list[str]:
        seen, own = self.replay, self.library
        rows = [["contact", "least force", "time", "library", "time", "lift", "slide"]]
        for k in range(seen.forces.shape[1]):
            at = int(np.argmin(seen.forces[:, k]))
            theirs = ["-", "-"]
            if own is not None:
                theirs = [quantity(own.least[k], "N", 3), self._when(own.when[k])]
            force = quantity(float(seen.forces[at, k]), "N", 3)
            lengths = [f"{1e3 * x:.3f} mm" for x in (seen.heights[:, k].max(), seen.slides[k])]
            rows.append([f"{k + 1}", force, self._when(seen.times[at]), *theirs, *lengths])
        return table(rows, left=())

    def _when(self, time: float) -> str:
        """An instant, in a cycle with the segment that it is in."""
        [name] = [part.name for _, part, at in owners(self.parts, np.array([time])) if len(at)]
        return f"{time:.3f} s" + (f" ({name})" if name else "")
