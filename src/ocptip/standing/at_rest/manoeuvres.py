"""Families of motions of a base that drives: what it is asked to do, with one parameter each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np

LARGEST = 100.0
"""Largest parameter that is tried, m/s^2, rad/s or m/s: no ground vehicle gets there."""


@dataclass(frozen=True)
class Manoeuvre:
    """What a base is asked to do.

    Attributes:
        key: of files.
        text: for people.
        unit: of its limit.
    """

    key: str
    text: str
    unit: str = "m/s^2"

    def value(self, parameter: float) -> float | None:
        """The limit; None where nothing limits it."""
        return None if parameter >= LARGEST else float(parameter)


@dataclass(frozen=True, eq=False)
class Manoeuvres:
    """P families of base motions with one parameter x >= 0 each.

    Rows are those of `BaseMotion`: constant + x linear + x^2 square.

    Attributes:
        constant, linear, square: (P, 9); `square` has accelerations alone.
        gravity: (P, 3), m/s^2, base axes.
    """

    constant: np.ndarray
    linear: np.ndarray
    square: np.ndarray
    gravity: np.ndarray

    @classmethod
    def accelerations(cls, directions: np.ndarray, gravity: np.ndarray) -> Manoeuvres:
        """Accelerations in directions (P, 3), with gravity (P, 3) or (3,); x is m/s^2."""
        return cls.along(np.hstack([directions, np.zeros((len(directions), 6))]), gravity)

    @classmethod
    def along(cls, linear: np.ndarray, gravity: np.ndarray) -> Manoeuvres:
        """Motions in proportion to rows (P, 9), with gravity (P, 3) or (3,)."""
        none = np.zeros(linear.shape)
        return cls(none, linear, none, np.broadcast_to(gravity, (len(linear), 3)))

    @classmethod
    def corners(
        cls,
        accelerations: tuple[Iterable[float], ...],
        velocities: tuple[Iterable[float], ...],
        gravity: np.ndarray,
    ) -> Manoeuvres:
        """In proportion to all combinations of velocities in base axes and their derivatives, each a set."""
        every = product(*accelerations, *velocities)
        rows = [[a - u * w, b + v * w, 0, 0, 0, w, 0, 0, turn] for a, b, turn, v, u, w in every]
        return cls.along(np.array(rows), gravity)

    def __add__(self, other: Manoeuvres) -> Manoeuvres:
        """These and others."""
        parts = ("constant", "linear", "square", "gravity")
        return Manoeuvres(*(np.vstack([getattr(self, name), getattr(other, name)]) for name in parts))

    def repeated(self, count: int) -> Manoeuvres:
        """Each family so often, one after the other."""
        parts = (self.constant, self.linear, self.square, self.gravity)
        return Manoeuvres(*(np.repeat(part, count, axis=0) for part in parts))

    def __len__(self) -> int:
        """Number of families."""
        return len(self.linear)

    def at(self, which: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows (R, 9) of base motions, and gravity (R, 3), of families (R,) at parameters (R,)."""
        x = x[:, None]
        rows = self.constant[which] + x * self.linear[which] + x**2 * self.square[which]
        return rows, self.gravity[which]
