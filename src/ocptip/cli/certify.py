"""`ocptip certify`: a proof that a motion keeps all limits at every instant, or the check of one."""

from __future__ import annotations

import json
from argparse import Namespace
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ocptip.basics.errors import InputError, naming
from ocptip.basics.read import parse_json, read_text
from ocptip.basics.write import versions, write_text
from ocptip.certificate.checks import certified, certified_cycle
from ocptip.certificate.describe import tolerance_words
from ocptip.certificate.result import Certificate, claims
from ocptip.certificate.trusted.checker import Verdict, check_certificate
from ocptip.cli.command import Report
from ocptip.cli.cycles import require_plain, segments_of
from ocptip.cli.given_motion import motion_of, read_options, task_of
from ocptip.cli.layout import named, under
from ocptip.cli.options import given_limits, with_limits
from ocptip.cli.terminal import say_if_compiling
from ocptip.motion.check import MotionCheck, check_motion
from ocptip.motion.cycles.check import CycleCheck, check_cycle
from ocptip.motion.cycles.task import CycleTask
from ocptip.standing.limits import TIP_WITHIN
from ocptip.trajectories.read import CERTIFICATE, load_motions
from ocptip.trajectories.trajectory import Trajectory

_MOST = 8  # undecided intervals that are listed


def run(options: Namespace) -> Report:
    """Find a certificate, or judge one."""
    if (data := _certificate_in(Path(options.motion))) is not None:
        if options.out is not None:
            raise InputError("--out: a certificate is checked, not written")
        verdict = check_certificate(data)
        planes = [one for one in data["model"]["bodies"] if "normal" in one] if verdict.holds else []
        return VerdictReport(Path(options.motion).name, verdict, len(planes))
    task, path = task_of(options)
    name = Path(options.motion).name
    if isinstance(task, CycleTask):
        return _cycle(name, path, task, options)
    task = with_limits(task, options)
    motion = motion_of(path, task, options)
    _refuse_fits(options.motion, motion)
    say_if_compiling()
    with naming(name):
        checked = certified(task.robot, motion, check_motion(task.robot, motion, task.limits), task.limits)
    return CertifyReport(
        name, task.name, checked, None if options.out is None else Path(options.out), motion.assumed
    )


def _certificate_in(path: Path) -> dict[str, Any] | None:
    """The data if the file is a certificate; of what is none, the reader of motions says what is wrong."""
    if path.suffix.lower() != ".json" or not path.is_file() or CERTIFICATE not in (text := read_text(path)):
        return None
    try:
        data = parse_json(text)
    except InputError:
        return None
    known = isinstance(data, dict) and str(data.get("format", "")).startswith(CERTIFICATE)
    return data if known else None


def _cycle(name: str, path: Path, task: CycleTask, options: Namespace) -> CertifyReport:
    """Certificates of all segments of a cycle."""
    if options.out is not None:
        raise InputError("--out: a cycle has a certificate per segment; ocptip plan writes them")
    require_plain(options, "rise_time")
    task = task.with_limits(given_limits(options))
    found = load_motions(path, task.robot.names, task.robot.units, **read_options(path, task, options))
    _refuse_fits(options.motion, found)
    say_if_compiling()
    with naming(name):
        motion = segments_of(task, found)
        checked = certified_cycle(task, motion, check_cycle(task, motion))
    return CertifyReport(name, task.name, checked.whole, None, found.assumed, checked)


def _refuse_fits(name: str, motion: Trajectory) -> None:
    if motion.fit is not None:
        raise InputError(
            f"{name}: its samples do not say the accelerations exactly, and a proof about a fit to "
            "them says nothing about the motion; certify the commanded motion, or use ocptip check"
        )


@dataclass
class VerdictReport(Report):
    """What a certificate proves.

    Attributes:
        name: of the file.
        verdict: on its data.
        planes: half spaces among what may collide in it, such as floors.
    """

    name: str
    verdict: Verdict
    planes: int

    @property
    def good(self) -> bool:
        """Whether it holds."""
        return self.verdict.holds

    def to_dict(self) -> dict[str, Any]:
        """The verdict."""
        return {
            "certificate": self.name,
            **vars(self.verdict),
            "planes": self.planes,
            "versions": versions(),
        }

    def to_text(self) -> str:
        """The verdict."""
        if not self.verdict.holds:
            return "\n".join(
                [f"{self.name}: DOES NOT HOLD.", *(f"  {text}" for text in self.verdict.problems)]
            )
        own = f"at every instant {claims(self.verdict.bounds)} ({self.verdict.intervals} intervals)"
        tolerance = self.verdict.tolerance
        words = "none: the world as described" if tolerance is None else tolerance_words(tolerance)
        rows = [("proof", own)]
        if left := self.verdict.moments:
            more = f", within the tolerance {left[TIP_WITHIN]:.4g} N m" if len(left) > 1 else ""
            rows.append(("left", f"at least {left['GN']:.4g} N m about every tipping axis{more}"))
        rows.append(("tolerance", words))
        if "clearance" in self.verdict.bounds:
            none = "no floor or wall: what reaches below the contacts is not excluded"
            rows.append(("planes", f"{self.planes} (floors and walls)" if self.planes else none))
        return f"{self.name}: HOLDS.\n" + "\n".join(named(rows))


@dataclass
class CertifyReport(Report):
    """What was proved of a motion.

    Attributes:
        motion: name of the motion's file.
        task: name of the task.
        checked: the sampled check with the certificate.
        out: where the certificate goes.
        assumed: what the file does not say.
        segments: checks of the segments of a cycle, with their certificates; None for a single motion.
    """

    motion: str
    task: str
    checked: MotionCheck
    out: Path | None
    assumed: tuple[str, ...]
    segments: CycleCheck | None = None

    @property
    def good(self) -> bool:
        """Whether all limits are proved to be kept."""
        return self.checked.certified

    @property
    def _certificate(self) -> Certificate | None:
        return self.checked.certificate

    def to_dict(self) -> dict[str, Any]:
        """The check with the certificate's bounds."""
        own = self.segments or self.checked
        return {
            "motion": self.motion,
            "task": self.task,
            **own.to_dict(),
            "assumed": list(self.assumed),
            "versions": versions(),
        }

    def to_text(self) -> str:
        """The verdict, what is proved, and where something is missing."""
        checked, found = self.checked, self._certificate
        lines = [f"{self.motion} on {self.task}: {checked.headline}."]
        lines += [f"  {violation}" for violation in checked.violations]
        if found is not None:
            own = self.segments
            parts = zip(own.names, own.segments, strict=True) if own else ()
            rows = [
                ("proof", f"{found}"),
                *((name, f"{part.certificate}") for name, part in parts),
                ("time", f"{found.seconds:.2f} s"),
            ]
            rows += under("assumed", self.assumed)
            rows += under("undecided", [f"{one}" for one in found.undecided[:_MOST]])
            if len(found.undecided) > _MOST:
                rows.append(("", f"and {len(found.undecided) - _MOST} more"))
            rows += under("written", [f"{path}" for path in self.written])
            lines += ["", *named(rows)]
        return "\n".join(lines)

    def write(self) -> Iterator[Path]:
        """The certificate."""
        if self.out is not None and self._certificate is not None and self._certificate.data is not None:
            write_text(self.out, json.dumps(self._certificate.data, allow_nan=False) + "\n")
            yield self.out
