"""What the wrench on the base, or on an object, is made of within a tolerance: weights times polynomials.

Plain data and NumPy only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ocptip.certificate.trusted.forms import Form, K, U, beside, numbers_of

_BY_ROW = ("size", "error", "middle", "spread", "centre", "half")


@dataclass(frozen=True, eq=False)
class Terms:
    """The terms of the wrench on the base, over R rows.

    Attributes:
        low, high: (T,) ends of the weights.
        masses: (T,) kg: times gravity it is a term's force.
        process: forms (6, R): what acts on the gripper, for any speed factor and any weights.
        parts: forms (T, 3 + 6 G, R): first moment about the reference point, kg m, and the wrench that its
            motion needs, in G shares, at speed factors of 1.
        tool: index of the term of a unit mass at the gripper.
        gravity: (3,), m/s^2.
        size, error: (6, R) bounds of absolute values of the wrench, and of errors.
        middle, spread: (T, 6, R): a term's wrench in the middle, and by how much at most it differs.
        centre, half: (6, R): a box round all wrenches.
    """

    low: np.ndarray
    high: np.ndarray
    masses: np.ndarray
    parts: Form
    process: Form
    tool: int
    gravity: np.ndarray
    size: np.ndarray
    error: np.ndarray
    middle: np.ndarray
    spread: np.ndarray
    centre: np.ndarray
    half: np.ndarray

    def some(self, rows: Any) -> Terms:
        """The terms of some rows."""
        fields = {name: getattr(self, name)[..., rows] for name in _BY_ROW}
        parts, process = (Form(form.c[..., rows], form.r[..., rows]) for form in (self.parts, self.process))
        return Terms(self.low, self.high, self.masses, parts, process, self.tool, self.gravity, **fields)

    @classmethod
    def joined(cls, groups: list[Terms]) -> Terms:
        """The terms of the rows of some groups, one after the other."""
        by_row = {name: np.concatenate([getattr(g, name) for g in groups], axis=-1) for name in _BY_ROW}
        parts, process = beside([g.parts for g in groups]), beside([g.process for g in groups])
        return replace(groups[0], parts=parts, process=process, **by_row)

    @property
    def ends(self) -> np.ndarray:
        """(3, T): ends of the weights, and masses."""
        return np.array([self.low, self.high, self.masses])

    @property
    def numbers(self) -> int:
        """How many numbers e there are."""
        return numbers_of(len(self.parts.c))[0]

    def in_box(self, h: np.ndarray, constant: np.ndarray) -> np.ndarray:
        """As `Within.least`, of any wrench of the boxes: quicker, and as a rule less."""
        half = self.half * (1 + U) + 8 * U * np.abs(self.centre)
        inside = np.einsum("air,ir->ar", h, self.centre) - np.einsum("air,ir->ar", np.abs(h), half)
        return np.min(constant, axis=0) + inside - 8 * U * np.max(np.abs(constant), axis=0)

    def described(self, s: float) -> np.ndarray:
        """(6, R): the wrench with middle weights at s, everybody on time."""
        powers = s ** np.arange(K)
        c = np.einsum("t,k,ktir->ir", 0.5 * (self.low + self.high), powers, self.parts.c[:K])
        weight = np.sum(0.5 * (self.low + self.high) * self.masses) * self.gravity
        moment = np.cross(c[:3], self.gravity, axisa=0, axisc=0)
        process = np.einsum("k,kir->ir", powers, self.process.c[:K])
        needed = self.needed(c)
        return process + np.concatenate([weight[:, None] + needed[:3], moment + needed[3:]])

    @staticmethod
    def needed(c: np.ndarray, factors: np.ndarray | None = None) -> np.ndarray:
        """(..., 6, R): the sum of shares of parts (..., 3 + 6 G, R) times factors (G,), 1 by default."""
        shares = np.split(c[..., 3:, :], (c.shape[-2] - 3) // 6, axis=-2)
        factors = np.ones(len(shares)) if factors is None else factors
        return np.sum([factor * share for factor, share in zip(factors, shares, strict=True)], axis=0)


def wrench_bounds(
    sizes: np.ndarray, gravity: np.ndarray, factors: np.ndarray, masses: np.ndarray
) -> np.ndarray:
    """(T, 6, R): what wrenches of terms can be at most, whose numbers are at most sizes (T, 3 + 6 G, R)."""
    needed = Terms.needed(sizes, factors)
    force = needed[:, :3] + (masses[:, None] * gravity)[:, :, None]
    moment = np.stack([moment_bounds(lever, gravity) for lever in sizes[:, :3]])
    return np.concatenate([force, needed[:, 3:] + moment], axis=1)


def moment_bounds(lever: np.ndarray, force: np.ndarray) -> np.ndarray:
    """The maximum moments (3, R) of levers (3, R) and a force (3,), each given by its maximum amount."""
    (x, y, z), (a, b, c) = lever, force
    return np.stack([y * c + z * b, z * a + x * c, x * b + y * a])
