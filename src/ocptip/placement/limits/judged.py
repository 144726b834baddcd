"""Evaluation of N candidates for the final check, and how far they keep their limits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ocptip.contact.states import ContactStates
from ocptip.placement.problem import TaskLoad
from ocptip.placement.stand import Stood
from ocptip.placement.terrain import Patch


@dataclass(frozen=True, eq=False)
class ConstraintRows:
    """Constraints of one kind at N candidates.

    Attributes:
        kind: of the limit.
        labels: m names.
        values: (N, m) in `unit`.
        limits: (m,).
        upper: values must be <= limits; else >=.
        unit: for people; one for all, or one per label.
        margins: (N, m) >= 0 where kept, in comparable units (0.1 m, 0.2 rad, the limit itself).
    """

    kind: str
    labels: tuple[str, ...]
    values: np.ndarray
    limits: np.ndarray
    upper: bool
    unit: str | tuple[str, ...]
    margins: np.ndarray


@dataclass(frozen=True, eq=False)
class PlacedBase(Stood):
    """Where the base stands at N candidates.

    Attributes, further to those of `Stood`:
        terrain: the patch.
        parameters: (N, k).
    """

    terrain: Patch
    parameters: np.ndarray

    def world(self, points: np.ndarray) -> np.ndarray:
        """(N, m, 3), m, of points (m, 3) or (N, m, 3) in base axes."""
        return self.origin[:, None] + points @ self.base.transpose(0, 2, 1)


@dataclass(frozen=True, eq=False)
class TaskEvaluation(PlacedBase):
    """One task at N candidates; C load cases of the task.

    Attributes:
        task: its number.
        cases: its load cases.
        q: (N, n), rad.
        torques: (N, C, n), N m.
        wrenches: (N, C, 6), N and N m, base axes: on the base about its centre of mass, weight included, of
            the nominal base.
        cornered: (N, C, K, 6), the same at the K corners of the problem's tolerance, about the same point;
            where contacts are not solved K is 1.
        moments: (N, C, K, axes), N m, about the tipping axes; where contacts are not solved the minimum over
            all corners.
        GN, GT: (N, C), the worst of all corners; NaN where not asked for.
        worst: by kind of limit (N, C): the corner at which it is worst.
        GK: (N, C): use of the force space (4.19), 0 without process load.
        GE: (N, C): holding power, W, or torque cost.
        standing: (N, C): the contacts are maintained, at all corners; None if not asked for.
        states: contact states, N C K of them; None if not asked for, or where feet conform.
        rows: constraints by kind.
    """

    task: int
    cases: list[TaskLoad]
    q: np.ndarray
    torques: np.ndarray
    wrenches: np.ndarray
    cornered: np.ndarray
    moments: np.ndarray
    GN: np.ndarray
    GT: np.ndarray
    GK: np.ndarray
    GE: np.ndarray
    worst: dict[str, np.ndarray]
    standing: np.ndarray | None
    states: ContactStates | None
    rows: tuple[ConstraintRows, ...] = ()

    @cached_property
    def counting(self) -> list[int]:
        """Numbers of the cases that count in the criteria."""
        return [c for c, case in enumerate(self.cases) if case.counts]

    @cached_property
    def constrained(self) -> list[int]:
        """Numbers of the cases that count in the constraints."""
        return [c for c, case in enumerate(self.cases) if case.constrained]

    @cached_property
    def names(self) -> list[str]:
        """Names of the constrained cases."""
        return [self.cases[c].name for c in self.constrained]

    def margin(self) -> np.ndarray:
        """(N,) smallest margin; NaN counts as broken."""
        return smallest_margin(self.rows, len(self.q))


def smallest_margin(rows: tuple[ConstraintRows, ...], count: int) -> np.ndarray:
    """(N,) smallest margin of all rows; minus infinity where one is NaN."""
    result = np.full(count, np.inf)
    for r in rows:
        if r.margins.shape[1]:
            result = np.minimum(result, np.min(np.nan_to_num(r.margins, nan=-np.inf), axis=1))
    return result
