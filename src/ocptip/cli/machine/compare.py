"""`ocptip compare`: a recording of a machine beside the plan that it ran, and what would explain the rest."""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ocptip.api.compare import PlanComparison, compare
from ocptip.basics.text import percent, quantity, some, table, with_error
from ocptip.cli.command import ResultReport
from ocptip.cli.layout import named, under
from ocptip.cli.options import taken
from ocptip.cli.verify.stand import check_plot_target
from ocptip.measured.compare import LEVEL
from ocptip.measured.contact_losses import losses_text
from ocptip.measured.prediction import Predictor
from ocptip.measured.recording import ANGLE, FOOT, GRIPPER, POWER, SPEED
from ocptip.measured.signals import Finding
from ocptip.task_files.option_files import read_columns

_WORDS = {
    "angles": "joint angles", "speeds": "joint speeds", "torques": "torques", "sensor": "force-torque sensor",
    "power": "power", "gripper": "TCP", "base": "pose of the base", "shifts": "shifts of contacts",
}  # fmt: skip


def run(options: Namespace) -> CompareReport:
    """Read both and compare."""
    if options.plot:
        check_plot_target(options.plot)
    same = taken(options, "plan recording unit topics same_clock")
    level = LEVEL if options.level is None else options.level
    result = compare(**same, columns=read_columns(options.columns), level=level)
    return CompareReport(result, options.plot, yes=result.agrees)


@dataclass
class CompareReport(ResultReport):
    """The report of a comparison."""

    result: PlanComparison

    def to_text(self) -> str:
        """Findings, then the table of signals."""
        result = self.result.comparison
        count = len(result.findings)
        verdict = f"{count} finding{'s' if count > 1 else ''}" if count else "AGREES with what was described"
        chance = (
            f"by chance: {percent(result.level) if result.level >= 0.01 else f'{100 * result.level:g} %'}"
        )
        head = f"{self.result.name}: {verdict} (any finding {chance})."
        rows = under("found", map(_finding_text, result.findings))
        rows += self._about()
        return "\n".join([head, "", *self._table(), "", *named(rows)])

    def _about(self) -> list[tuple[str, str]]:
        result = self.result.comparison
        span = result.times[-1] - result.times[0]
        error = f" +- {1e3 * result.clock_error:.2g} ms" if math.isfinite(result.clock_error) else ""
        rows = [
            ("recording", f"{span:.4g} s, a sample every {1e3 * self.result.recording.period:.4g} ms"
             + (f" (every {result.thinned}th of the file)" if result.thinned > 1 else "")),
            ("clock", f"the motion begins at {result.clock:.6g} s of the recording{error}"),
        ]  # fmt: skip
        rows += under("time bases", self.result.recording.rates)
        if result.gripper is not None:
            index = int(np.nanargmax(result.gripper))
            rows.append(
                (
                    "gripper",
                    f"at most {1e3 * result.gripper[index]:.3g} mm off, at {result.times[index]:.3f} s",
                )
            )
        if result.energy is not None:
            measured, predicted = result.energy
            more = 100 * (measured / predicted - 1) if predicted else float("nan")
            rows.append(("energy", f"{measured:.4g} J measured, {predicted:.4g} J predicted ({more:+.2g} %)"))
        if (base := result.base) is not None:
            rows.append(("base", _base_text(base.names, base.changes, base.intervals, base.peaks)))
            if base.contacts.size:
                rows.append(
                    ("", f"contacts shifted by at most {1e3 * base.contacts.max():.3g} mm at any time")
                )
        if result.contact_losses:
            rows.append(("contacts", losses_text(result.contact_losses)))
        if result.unrecorded:
            rows.append(("not recorded", some([_WORDS[kind] for kind in result.unrecorded], 8)))
        if result.unknown:
            rows.append(("left out", f"columns {some(result.unknown)}"))
        return rows

    def _table(self) -> list[str]:
        rows = [["signal", "", "largest", "at", "rms", "of range", "noise", "unexplained", "delay"]]
        for one in self.result.comparison.signals:
            unit, scale = unit_of(self.result.predictor, one.kind, one.index)
            cells = [
                f"{scale * x:.3g}" if math.isfinite(x) else "-"
                for x in (one.largest, one.rms, one.noise, one.left)
            ]
            late = f"{1e3 * one.lag:.2f} ms" if math.isfinite(one.lag) else "-"
            largest, rms, *rest = cells
            rows.append([one.name, unit, largest, f"{one.at:.3f} s", rms, _share(one.share), *rest, late])
        return table(rows, left=(0, 1))


def unit_of(predictor: Predictor, kind: str, index: int) -> tuple[str, float]:
    """Unit of a signal as people read it, and its factor from SI units."""
    if kind == GRIPPER:
        return "mm", 1e3
    if kind == POWER:
        return "W", 1.0
    if kind in (ANGLE, SPEED):
        turns = predictor.robot.units[index] == "rad"
        return ("deg" if turns else "mm") + "/s" * (kind == SPEED), 180 / math.pi if turns else 1e3
    if kind == "torques":
        return predictor.robot.motor_units[index], 1.0
    return ("N" if index < 3 or kind == FOOT else "N m"), 1.0


def _share(share: float) -> str:
    return "-" if not math.isfinite(share) or share > 10 else f"{100 * share:.2g} %"


def _finding_text(finding: Finding) -> str:
    """A finding in words."""
    text = finding.name
    if math.isfinite(finding.value):
        text += f": {with_error(finding.value, finding.interval, finding.unit)}"
    if finding.text:
        text += f" ({finding.text})" if math.isfinite(finding.value) else f": {finding.text}"
    if finding.rivals:
        text += f"; or as well {some(finding.rivals, 3)}"
    return text


def _base_text(names: Sequence[str], changes: np.ndarray, intervals: np.ndarray, peaks: np.ndarray) -> str:
    parts = []
    for name, change, interval, peak in zip(names, changes, intervals, peaks, strict=True):
        scale, unit = (1e3, "mm") if name in "xyz" else (180 / math.pi, "deg")
        after = f"{scale * change:.2g} +- {scale * interval:.2g}" if math.isfinite(change) else "-"
        parts.append(f"{name} {after} {unit} (at most {quantity(scale * peak, unit, 2)})")
    return "afterwards " + ", ".join(parts)
