"""Reports that pipelines ask for: requirements decide the exit code, and a JUnit file names what fails."""

from __future__ import annotations

from abc import abstractmethod
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from ocptip.api.requirements import Outcome, junit, outcomes_to_dict, read_requirements
from ocptip.basics.write import write_text
from ocptip.cli.command import Report


class _Requirable(Protocol):
    def require(self, text: str) -> tuple[Outcome, ...]: ...


def read_gate(options: Namespace) -> None:
    """Refuse requirements that cannot be understood, before anything is computed."""
    if options.require is not None:
        read_requirements(options.require)


def gate_of(options: Namespace, found: _Requirable) -> dict[str, Any]:
    """The fields of a `GatedReport` from the options and the answer."""
    outcomes = () if options.require is None else found.require(options.require)
    return {"outcomes": outcomes, "junit": options.junit}


@dataclass
class GatedReport(Report):
    """An answer with requirements.

    Attributes:
        outcomes: of the requirements.
        junit: file of the report for pipelines; None: not asked for.
    """

    outcomes: tuple[Outcome, ...] = field(default=(), kw_only=True)
    junit: str | None = field(default=None, kw_only=True)

    @property
    @abstractmethod
    def kept(self) -> bool:
        """Whether the answer is yes, apart from requirements."""

    @property
    @abstractmethod
    def headline(self) -> str:
        """The first line: a name, three spaces, and the verdict."""

    @property
    def broken(self) -> Sequence[str]:
        """The broken limits, one sentence each."""
        return ()

    @property
    def good(self) -> bool:
        """Whether the answer is yes, and all requirements are met."""
        return self.kept and all(one.met for one in self.outcomes)

    @property
    def unmet(self) -> list[str]:
        """Requirements that are not met."""
        return [f"{one}" for one in self.outcomes if not one.met]

    def gate_to_dict(self) -> dict[str, Any]:
        """The entry of the requirements for JSON."""
        return outcomes_to_dict(self.outcomes)

    def write(self) -> Iterator[Path]:
        """Write the report for pipelines, if one is wanted."""
        if self.junit is not None:
            name, _, verdict = self.headline.partition("   ")
            text = "; ".join([verdict, *self.broken])
            write_text(self.junit, junit(name, text, self.kept, self.outcomes))
            yield Path(self.junit)
