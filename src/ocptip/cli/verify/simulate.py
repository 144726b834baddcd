"""`ocptip simulate`: a plan or a cycle replayed by MuJoCo on a free base, beside what the library says."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import dataclass

import numpy as np

from ocptip.api.simulate import STEEPEST, Simulated, simulate
from ocptip.basics.errors import InputError
from ocptip.basics.text import quantity, some, table
from ocptip.cli.command import ResultReport
from ocptip.cli.layout import fitted, headlines, under
from ocptip.cli.options import naming_options, taken
from ocptip.standing.parts import owners
from ocptip.standing.simulation.mjcf import remarks
from ocptip.standing.simulation.objects import LIFTED, SLID
from ocptip.standing.simulation.replay import simulator_numbers

_OF_WORLD = "stiffness damping payload friction speed"


def run(options: Namespace) -> SimulateReport:
    """Replay the plan in the scenario of the options."""
    if options.damping is not None and options.stiffness is None:
        raise InputError("--damping: only for compliant feet; give --stiffness as well")
    given = taken(options, f"step {_OF_WORLD}")
    with naming_options("step", *_OF_WORLD.split()):
        simulated = simulate(options.plan, **given, **_tilt(options))
    return SimulateReport(simulated, yes=simulated.stable)


def _tilt(options: Namespace) -> dict[str, float]:
    """Tilt and its direction, rad."""
    if options.tilt is None:
        return {}
    angle, *rest = options.tilt
    if len(rest) > 1 or not 0 <= angle <= STEEPEST:
        raise InputError(f"--tilt: 0 to {STEEPEST:g} degrees and a direction in degrees, got {options.tilt}")
    return {"tilt": float(np.radians(angle)), "downhill": float(np.radians(rest[0])) if rest else 0.0}


@dataclass
class SimulateReport(ResultReport):
    """The report of a simulation."""

    result: Simulated

    def to_text(self) -> str:
        """Verdict, forces, lifts and slides."""
        seen, other = self.result.replay, self.result.library
        limits = f"{1e3 * LIFTED:g} mm high, none with friction slides by more than {1e3 * SLID:g} mm"
        what = "No foot and no object" if seen.objects else "No foot"
        verdict = f"STABLE in the simulator. {what} gets {limits}"
        if not seen.stands:
            moves = some(self._moves(), 3)
            verdict = "FALLS in the simulator" if seen.falls else f"NOT STABLE in the simulator: {moves}"
        lines = [*headlines(f"{self.result.name}   {verdict}."), "", *self._table(), ""]
        if seen.objects:
            lines += [*self._objects(), ""]
        rows = [("scenario", seen.world.text() or "nominal")]
        if other is not None:
            stands = "no contact is lost" if other.stands else "a contact is lost"
            rows.append(
                (
                    "library",
                    f"{stands}; minimum foot force {other.rms_least:.2g} N rms apart, all {other.rms:.2g} N",
                )
            )
        else:
            rows.append(
                ("library", "no normal forces to compare: how rigid feet share their load is not determined")
            )
        rows.append(("simulator", simulator_numbers(self.result.parts[0].robot, seen.step)))
        rows += under("note", remarks(self.result.parts))
        return "\n".join([*lines, *fitted(rows)])

    def _moves(self) -> list[str]:
        """What lifts or slides by more than what counts as none, feet first; of feet the farthest."""
        seen = self.result.replay
        heights = seen.heights.max(axis=0)
        lifts = [(f"contact {np.argmax(heights) + 1}", seen.lift)]
        slides = [(f"contact {np.argmax(np.nan_to_num(seen.slides)) + 1}", seen.slide)]
        lifts += [(name, moved.lift) for name, moved in seen.objects.items()]
        slides += [(name, moved.slide) for name, moved in seen.objects.items()]
        return [
            f"{name} {verb} {1e3 * by:.3g} mm (counts from {1e3 * most:g} mm)"
            for verb, moved, most in (("lifts", lifts, LIFTED), ("slides", slides, SLID))
            for name, by in moved
            if by > most
        ]

    def _table(self) -> list[str]:
        seen, library = self.result.replay, self.result.library
        rows = [["contact", "minimum force", "time", "library", "time", "lift", "slide"]]
        for k in range(seen.forces.shape[1]):
            index = int(np.argmin(seen.forces[:, k]))
            theirs = ["-", "-"]
            if library is not None:
                theirs = [quantity(library.least[k], "N", 3), self._when(library.when[k])]
            force = quantity(float(seen.forces[index, k]), "N", 3)
            lengths = [
                "-" if np.isnan(x) else f"{1e3 * x:.3f} mm"
                for x in (seen.heights[:, k].max(), seen.slides[k])
            ]
            rows.append([f"{k + 1}", force, self._when(seen.times[index]), *theirs, *lengths])
        return table(rows, left=())

    def _objects(self) -> list[str]:
        rows = [["object", "lift", "slide", "library"]]
        for name, moved in self.result.replay.objects.items():
            answer = "keeps its contacts" if self.result.kept[name] else "loses a contact"
            rows.append([name, f"{1e3 * moved.lift:.3f} mm", f"{1e3 * moved.slide:.3f} mm", answer])
        return table(rows, left=(0, 3))

    def _when(self, time: float) -> str:
        """An instant, in a cycle with the segment that it is in."""
        [name] = [
            part.name for _, part, instants in owners(self.result.parts, np.array([time])) if len(instants)
        ]
        return f"{time:.3f} s" + (f" ({name})" if name else "")
