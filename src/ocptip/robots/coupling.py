"""Joints of a chain that follow others, as the mimic joints of URDF files do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError, finite_array
from ocptip.basics.frozen import settle


@dataclass(frozen=True, eq=False)
class Coupling:
    """Where L joints of a chain stand at n coordinates q: `ratios * q[leaders] + offsets`.

    Every coordinate is the value of one of the joints, which leads; the drive is there. By d'Alembert its
    torque is the sum of the ratios times what each of its joints needs.

    Attributes:
        names: of all joints, (L,), from the base on.
        slides: (L,) True for sliding joints.
        leaders: (L,), numbers of coordinates from 0.
        ratios: (L,), 1 for the joint that leads; not 0.
        offsets: (L,), rad (sliding joints: m), 0 for the joint that leads.
        leads: (n,), numbers of the joints that lead.
    """

    names: tuple[str, ...]
    slides: np.ndarray
    leaders: np.ndarray
    ratios: np.ndarray
    offsets: np.ndarray
    leads: np.ndarray

    def __post_init__(self) -> None:
        count = len(self.names)
        for name in ("ratios", "offsets"):
            settle(self, **{name: finite_array(name, getattr(self, name), (count,))})
        for name, kind, size in (("slides", bool, count), ("leaders", int, count), ("leads", int, None)):
            value = np.array(getattr(self, name), dtype=kind)
            if value.ndim != 1 or (size is not None and len(value) != size):
                raise InputError(f"{name}: expected {size or 'some'} values, got {getattr(self, name)!r}")
            settle(self, **{name: value})
        leads = self.leads
        if not self.ratios.all() or set(self.leaders) != set(range(len(leads))):
            raise InputError("leaders, ratios: every joint follows one of the coordinates at a ratio not 0")
        if (leads >= count).any() or not (
            np.array_equal(self.leaders[leads], np.arange(len(leads)))
            and (self.ratios[leads] == 1).all()
            and not self.offsets[leads].any()
        ):
            raise InputError("leads: of each coordinate the joint at ratio 1, offset 0")

    @classmethod
    def of(
        cls, names: Sequence[str], slides: np.ndarray, followers: Mapping[str, tuple[str, float, float]]
    ) -> Coupling:
        """The coupling of joints, of which some follow others: by name the leading one, ratio and offset."""
        order = {name: c for c, name in enumerate(name for name in names if name not in followers)}
        rows = [followers.get(name, (name, 1.0, 0.0)) for name in names]
        leaders = np.array([order[leader] for leader, _, _ in rows])
        ratios, offsets = np.array([row[1:] for row in rows]).T
        leads = np.array([k for k, name in enumerate(names) if name not in followers])
        return cls(tuple(names), slides, leaders, ratios, offsets, leads)

    @property
    def leading(self) -> tuple[str, ...]:
        """Names of the joints that lead, by coordinate."""
        return tuple(self.names[k] for k in self.leads)

    @property
    def matrix(self) -> np.ndarray:
        """(L, n): speeds of the joints per speed of the coordinates."""
        rows = np.zeros((len(self.names), len(self.leads)))
        rows[np.arange(len(self.names)), self.leaders] = self.ratios
        return rows

    @property
    def alone(self) -> np.ndarray:
        """(n,) True for coordinates that move one joint."""
        return np.bincount(self.leaders) == 1

    def joints(self, q: cs.SX) -> list[cs.SX]:
        """Values of the joints, rad (m), at coordinates (n,)."""
        return [r * q[int(c)] + o for c, r, o in zip(self.leaders, self.ratios, self.offsets, strict=True)]

    def rates(self, qd: cs.SX) -> list[cs.SX]:
        """Speeds, or accelerations, of the joints."""
        return [r * qd[int(c)] for c, r in zip(self.leaders, self.ratios, strict=True)]

    def gathered(self, values: Sequence[cs.SX]) -> list[cs.SX]:
        """What belongs to the joints, such as torques or columns of a Jacobian, per coordinate."""
        return [
            sum(
                (r * v for c, r, v in zip(self.leaders, self.ratios, values, strict=True) if c == lead),
                cs.SX(0),
            )
            for lead in range(len(self.leads))
        ]

    def limits(
        self, low: np.ndarray, high: np.ndarray, speed: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Limits (n,) of the coordinates that keep those of all joints, (L,) each: angles and speeds.

        Raises:
            InputError: they leave a coordinate no range.
        """
        ends = (np.stack([low, high]) - self.offsets) / self.ratios
        count = len(self.leading)
        least, most, fastest = np.full(count, -np.inf), np.full(count, np.inf), np.full(count, np.inf)
        np.maximum.at(least, self.leaders, ends.min(axis=0))
        np.minimum.at(most, self.leaders, ends.max(axis=0))
        np.minimum.at(fastest, self.leaders, speed / np.abs(self.ratios))
        if (stuck := np.flatnonzero(least >= most)).size:
            raise InputError(f"limits leave no way to {self.leading[stuck[0]]!r}, for {self.text()}")
        return least, most, fastest

    def text(self) -> str:
        """In words: "elbow_2 follows elbow at -1 times its value + 0.1"."""
        leads = self.leading
        texts = []
        for name, c, ratio, offset in zip(self.names, self.leaders, self.ratios, self.offsets, strict=True):
            if name != leads[c]:
                more = f" {'+' if offset > 0 else '-'} {abs(offset):.4g}" if offset else ""
                texts.append(f"{name} follows {leads[c]} at {ratio:.4g} times its value{more}")
        return "; ".join(texts)
