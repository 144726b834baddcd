"""`ocptip certify`: a proof that a motion keeps all limits at every instant, or the check of one."""

from __future__ import annotations

import sys
from argparse import Namespace
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from ocptip.api.certify import Certified, certify, read_certificate
from ocptip.api.inputs.given import task_of_motion
from ocptip.api.tasks import load_task
from ocptip.basics.errors import InputError
from ocptip.basics.text import table, wrapped
from ocptip.basics.write import versions
from ocptip.certificate.describe import drive_words, tolerance_words
from ocptip.certificate.result import Certificate, beyond_cancels, claim_rows
from ocptip.certificate.trusted.checker import Verdict, check_certificate
from ocptip.cli.command import Report, ResultReport
from ocptip.cli.layout import brief_notes, files_lines
from ocptip.cli.motion_summary import notes
from ocptip.cli.options import given_limits, naming_options, taken
from ocptip.cli.terminal import Progress
from ocptip.motion.summary import margin_table, motion_line
from ocptip.task_files.option_files import read_columns

_MOST = 8  # undecided intervals that are listed


def run(options: Namespace) -> Report:
    """Find a certificate, or check one."""
    if (data := read_certificate(options.motion)) is not None:
        if options.out is not None:
            raise InputError("--out: a certificate is checked, not written")
        verdict = check_certificate(data)
        planes = [one for one in data["model"]["bodies"] if "normal" in one] if verdict.holds else []
        drives = drive_words(data["motion"]) if verdict.holds else ""
        return VerdictReport(Path(options.motion).name, verdict, len(planes), drives, yes=verdict.holds)
    with naming_options("base", "rate", "rise_time"):
        task, _ = task_of_motion(options.motion, options.case or options.task, options.base)
        if task.is_cycle and options.out is not None:
            raise InputError("--out: a cycle has a certificate per segment; ocptip plan writes them")
        task = load_task(task, **given_limits(options))
        reading = taken(options, "unit rate topic rise_time")
        with Progress(sys.stderr, "checking the motion ...") as progress:
            how = {"columns": read_columns(options.columns), "stage": progress.stage}
            result = certify(task, options.motion, **reading, **how)
    return CertifyReport(result, options.out, yes=result.certified)


@dataclass
class VerdictReport(Report):
    """The report on the bounds that a certificate proves.

    Attributes:
        name: of the file.
        verdict: on its data.
        planes: half spaces among what may collide in it, such as floors.
        drives: how the base drives, in words; "" where it rests.
    """

    name: str
    verdict: Verdict
    planes: int
    drives: str

    def to_dict(self) -> dict[str, Any]:
        """The verdict."""
        drives = {"base_drives": self.drives} if self.drives else {}
        known = {"certificate": self.name, **vars(self.verdict), "planes": self.planes}
        return {**known, **drives, "versions": versions()}

    def to_text(self) -> str:
        """The verdict."""
        if not self.verdict.holds:
            return "\n".join(
                [f"{self.name}   PROOF DOES NOT HOLD", *(f"  {text}" for text in self.verdict.problems)]
            )
        tolerance = self.verdict.tolerance
        scope = "the nominal model only (no uncertainty)" if tolerance is None else "the uncertainty below"
        rows = [["", "nominal", "worst case"], *map(list, claim_rows(self.verdict))]
        if tolerance is None:
            rows = [row[:2] for row in rows]
        lines = [f"{self.name}   PROVED for {scope}", "", *table(rows, left=(0, 1, 2))]
        proof = f"at every instant, rest before and after included ({self.verdict.intervals} intervals)"
        lines += ["", *wrapped("Proof", [proof])]
        if self.drives:
            lines += wrapped("Base", [self.drives])
        if tolerance is not None:
            lines += wrapped("Within", [tolerance_words(tolerance)])
        lines += wrapped("Cancels", filter(None, [beyond_cancels(self.verdict)]))
        if "clearance" in self.verdict.bounds:
            none = "no floor or wall: what reaches below the contacts is not excluded"
            lines += wrapped("Planes", [f"{self.planes} (floors and walls)" if self.planes else none])
        return "\n".join(lines)


@dataclass
class CertifyReport(ResultReport):
    """The report on the bounds that were proved for a motion."""

    result: Certified

    def to_text(self) -> str:
        """The verdict, margins, what is proved, and where something is missing."""
        result, checked, proof = (
            self.result,
            self.result.check,
            cast(Certificate | None, self.result.certificate),
        )
        stops = "; stops CHECKED at samples" if checked.proved_while_moving and not result.certified else ""
        head = [f"{result.name} on {result.task.name}   {checked.headline}{stops}", motion_line(checked)]
        lines = [*head, *wrapped("Missing", filter(None, [checked.unproved]))]
        lines += wrapped("Broken", result.broken)
        lines += ["", *margin_table(result.task.robot, checked)]
        if proof is not None:
            parts = zip(result.checked.names, result.checked.segments, strict=True)
            segments = [f"{name}: {part.certificate}" for name, part in parts if name]
            undecided = [f"{one}" for one in proof.undecided[:_MOST]]
            if len(proof.undecided) > _MOST:
                undecided.append(f"and {len(proof.undecided) - _MOST} more")
            lines += ["", *wrapped("Proof", [f"{proof}", *segments, f"took {proof.seconds:.2f} s"])]
            lines += wrapped("Not proved", undecided, 12)
        lines += wrapped("Note", notes(checked))
        lines += wrapped("Assumed", [*brief_notes(result.task.robot.notes, self.verbose), *result.assumed])
        return "\n".join([*lines, *files_lines(self.written)])
