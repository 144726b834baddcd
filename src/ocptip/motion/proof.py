"""What checks, planner and files ask of a proof; how it is made is the matter of `ocptip.certificate`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, Self


class Proof(Protocol):
    """A proof for all instants of a motion, as checks, planner and files use it.

    The package `certificate` makes such proofs; nothing here depends on how.
    """

    @property
    def certified(self) -> bool:
        """Every limit is proved to hold at every instant."""
        ...

    @property
    def holds(self) -> bool:
        """The same, apart from values that are sampled."""
        ...

    @property
    def sampled(self) -> tuple[str, ...]:
        """Names of worst values that it says nothing of."""
        ...

    @property
    def speeds_within(self) -> bool:
        """Speeds of points keep their limits for all delays of joints within the uncertainty."""
        ...

    @property
    def cancels(self) -> bool:
        """No cancel loses a contact or leaves joint limits, within the uncertainty if one is given."""
        ...

    @property
    def cancel_torques(self) -> bool:
        """Torques of joints on time keep their limits in all cancels, within the uncertainty if given."""
        ...

    @property
    def lacks_cancels(self) -> bool:
        """That cancels lose no contact of the base was asked for and is not proved, though the motion is."""
        ...

    @property
    def data(self) -> Mapping[str, Any] | None:
        """Plain data for JSON from which the proof is checked; None where there is none."""
        ...

    @property
    def missing(self) -> str:
        """What is not proved, where, by how much, and what helps; empty if all is proved."""
        ...

    def short_of(self, limit: str, key: str, number: float) -> tuple[float, list[float]]:
        """By how much a limit is not proved, and when, s."""
        ...

    def followed_by(self, others: Sequence[Self], begins: Sequence[float]) -> Self:
        """The result for motions one after the other, this one first, which begin at `begins`, s."""
        ...

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        ...
