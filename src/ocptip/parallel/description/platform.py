"""Entries of a robot's tables, rotations made of them; the platform, and the inertia of a body.

A number is part of the structure (0 and multiples of pi/2 are exact), a named :class:`Parameter` stays a
symbol in generated code.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array, number_from, positive_number
from ocptip.basics.frozen import settle
from ocptip.numerics.inertia import parallel_axis, symmetric_matrix, why_impossible
from ocptip.robots.payload import Payload

_QUARTER = math.pi / 2
_EXACT = 1e-12


@dataclass(frozen=True)
class Parameter:
    """A named number of the geometry, m or rad.

    Attributes:
        name: a Python identifier; equal names mean the same parameter.
        value: of this robot.
    """

    name: str
    value: float

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.isidentifier():
            raise InputError(f"parameter: the name must be an identifier, got {self.name!r}")
        settle(self, value=number_from(f"parameter {self.name}", self.value))


Entry = float | Parameter


def value_of(entry: Entry) -> float:
    """The number behind an entry."""
    return entry.value if isinstance(entry, Parameter) else float(entry)


def right_angles(entry: Entry) -> int | None:
    """k in 0..3 if the entry is a number that equals k pi/2 (modulo 2 pi), else None."""
    if isinstance(entry, Parameter):
        return None
    turns = entry / _QUARTER
    return round(turns) % 4 if abs(turns - round(turns)) < _EXACT * max(1.0, abs(turns)) else None


def exact_cos_sin(entry: Entry) -> tuple[float, float]:
    """Cosine and sine; exactly 0, 1 or -1 at multiples of pi/2 that are not named parameters."""
    k = right_angles(entry)
    if k is None:
        return math.cos(value_of(entry)), math.sin(value_of(entry))
    return (1.0, 0.0, -1.0, 0.0)[k], (0.0, 1.0, 0.0, -1.0)[k]


def elementary_rotation(axis: str, entry: Entry) -> np.ndarray:
    """(3, 3) rotation about a coordinate axis ("x", "y", "z") by an angle, exact at multiples of pi/2."""
    return np.array(turn_about(axis, *exact_cos_sin(entry)))


def turn_about(axis: str, c: Any, s: Any) -> list[list[Any]]:
    """Rows (3, 3) of the rotation about a coordinate axis by the angle with this cosine and sine, scalars."""
    i = "xyz".index(axis)
    j, k = (i + 1) % 3, (i + 2) % 3
    matrix = [[0.0] * 3 for _ in range(3)]
    matrix[i][i] = 1.0
    matrix[j][j] = matrix[k][k] = c
    matrix[k][j], matrix[j][k] = s, -s
    return matrix


def product_of(rotations: Sequence[tuple[str, Entry]]) -> np.ndarray:
    """(3, 3) product of elementary rotations, the first one on the left."""
    matrix = np.eye(3)
    for axis, angle in rotations:
        matrix = matrix @ elementary_rotation(axis, angle)
    return matrix


def elementary_rotations(name: str, value: Sequence[tuple[str, Entry]]) -> tuple[tuple[str, Entry], ...]:
    """Check a sequence of (axis letter, angle)."""
    result = []
    for number, pair in enumerate(value, start=1):
        try:
            axis, angle = pair
        except (TypeError, ValueError):
            raise InputError(f"{name}[{number}]: expected (axis, angle), got {pair!r}") from None
        if axis not in ("x", "y", "z"):
            raise InputError(f"{name}[{number}]: the axis must be x, y or z, got {axis!r}")
        result.append((axis, check_entry(f"{name}[{number}]", angle)))
    return tuple(result)


def check_entry(name: str, value: Entry) -> Entry:
    """Check a number or parameter."""
    return value if isinstance(value, Parameter) else number_from(name, value)


def check_entries(name: str, values: Sequence[Entry]) -> tuple[Entry, ...]:
    """Check three entries."""
    values = tuple(values)
    if len(values) != 3:
        raise InputError(f"{name}: expected 3 entries, got {len(values)}")
    return tuple(check_entry(f"{name}[{number}]", v) for number, v in enumerate(values, start=1))


_PHYSICAL = 1e-6
"""Excess over the limits of a body's inertia, relative, that counts as rounding of the file's numbers."""


@dataclass(frozen=True, eq=False)
class BodyInertia:
    """Mass, first moment and inertia about the frame's origin (DynPar 2), body axes.

    Attributes:
        mass: kg.
        first_moment: (3,), kg m: mass times centre of mass.
        inertia: (3, 3), kg m^2, about the origin of the body's frame.
        grouped: identified or grouped parameters, which may belong to no real body: no physical limits are
            checked.

    Raises:
        InputError: not finite, not symmetric; or, unless grouped, an inertia about the centre of mass that
            no body has: a negative principal moment, or one larger than the sum of the other two. A single
            moment about one coordinate axis is accepted, planar robots need no more.
    """

    mass: float = 0.0
    first_moment: np.ndarray = field(default_factory=lambda: np.zeros(3))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    grouped: bool = False

    def __post_init__(self) -> None:
        settle(
            self,
            mass=number_from("mass", self.mass),
            first_moment=finite_array("first_moment", self.first_moment, (3,)),
            inertia=finite_array("inertia", symmetric_matrix(self.inertia), (3, 3)),
        )
        if not self.grouped:
            self._refuse_impossible()

    def _refuse_impossible(self) -> None:
        """Raise InputError if no distribution of mass, and no planar body, has these numbers."""
        if self.mass < 0:
            raise InputError(f"mass: must be >= 0, got {self.mass}")
        if self.mass == 0 and self.first_moment.any():
            raise InputError(f"first_moment: must be zero without mass, got {self.first_moment.tolist()}")
        about = self.central
        rounding = _PHYSICAL * max(float(np.abs(self.inertia).max()), 1e-300)
        if np.count_nonzero(np.abs(about) > rounding) == 1 and np.trace(about) > 0:
            return
        if reason := why_impossible(about, rounding):
            raise InputError(f"inertia: {reason}")

    @property
    def central(self) -> np.ndarray:
        """(3, 3), kg m^2: inertia about the centre of mass, body axes; about the origin without mass."""
        center = self.first_moment / self.mass if self.mass else np.zeros(3)
        return self.inertia - parallel_axis(self.mass, center)

    @classmethod
    def about_center(
        cls,
        mass: float,
        center: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
        inertia: ArrayLike = (0.0, 0.0, 0.0),
        *,
        grouped: bool = False,
    ) -> BodyInertia:
        """From DynPar 1.

        Args:
            mass: kg, >= 0.
            center: (3,), m, centre of mass in the body frame.
            inertia: about the centre of mass, body axes, kg m^2: (3, 3), or (6,) as xx, xy, xz, yy, yz, zz,
                or three principal values.
            grouped: see the class.
        """
        mass = positive_number("mass", mass, zero_allowed=True)
        c = finite_array("center", center, (3,))
        about_origin = symmetric_matrix(inertia) + parallel_axis(mass, c)
        return cls(mass, mass * c, about_origin, grouped=grouped)

    @classmethod
    def from_vector(cls, parameters: Sequence[float] | np.ndarray) -> BodyInertia:
        """From (10,) XX, XY, XZ, YY, YZ, ZZ, MX, MY, MZ, M, also grouped ones."""
        p = finite_array("parameters", parameters, (10,))
        return cls(p[9], p[6:9], p[:6], grouped=True)

    @property
    def vector(self) -> np.ndarray:
        """(10,) DynPar 2: XX, XY, XZ, YY, YZ, ZZ, MX, MY, MZ, M."""
        return np.concatenate([self.inertia[np.triu_indices(3)], self.first_moment, [self.mass]])

    @property
    def massless(self) -> bool:
        """True if all ten parameters are zero."""
        return not self.vector.any()


COORDINATES = ("x", "y", "z", "phi1", "phi2", "phi3")
CONVENTIONS = ("xyz", "xzy", "yxz", "yzx", "zxy", "zyx", "xyx", "xzx", "yxy", "yzy", "zxz", "zyz")


@dataclass(frozen=True, eq=False)
class Platform:
    """The platform.

    Attributes:
        mask: which of x, y, z, phi1, phi2, phi3 are free; the others stay zero, but for the dependent ones.
        convention: three axis letters of the intrinsic rotations R_P = R_a(phi1) R_b(phi2) R_c(phi3).
        inertia: about the platform's origin P, platform axes.
        payload: what the platform carries; it is in `inertia`.
        bare: inertia without payload, where there is one.
        dependent: which of the six follow from the free ones, because the legs force them to move along.
    """

    mask: tuple[bool, ...]
    convention: str = "xyz"
    inertia: BodyInertia = field(default_factory=BodyInertia)
    payload: Payload | None = None
    bare: BodyInertia | None = None
    dependent: tuple[bool, ...] = (False,) * 6

    def __post_init__(self) -> None:
        for name in ("mask", "dependent"):
            mask = tuple(getattr(self, name))
            if len(mask) != 6 or not all(isinstance(m, bool | np.bool_ | int) and m in (0, 1) for m in mask):
                raise InputError(
                    f"{name}: expected six truth values for {', '.join(COORDINATES)}, got {mask!r}"
                )
            settle(self, **{name: tuple(map(bool, mask))})
        if not any(self.mask):
            raise InputError("mask: at least one platform coordinate must be free")
        both = [c for c in self.coordinates if c in self.dependent_coordinates]
        if both:
            raise InputError(f"dependent: {', '.join(both)} cannot be both free and dependent")
        if self.convention not in CONVENTIONS:
            raise InputError(f"convention: must be one of {', '.join(CONVENTIONS)}, got {self.convention!r}")
        if not isinstance(self.inertia, BodyInertia):
            raise InputError(f"inertia: expected a BodyInertia, got {type(self.inertia).__name__}")

    def with_payload(self, payload: Payload | None) -> Platform:
        """The same platform that carries this, and nothing else; None: the bare one, to the last bit."""
        bare = self.bare or self.inertia
        if payload is None:
            return replace(self, inertia=bare, payload=None, bare=None)
        load = BodyInertia.about_center(payload.mass, payload.center_of_mass, payload.inertia, grouped=True)
        loaded = BodyInertia.from_vector(bare.vector + load.vector)  # each has been checked by itself
        return replace(self, inertia=loaded, payload=payload, bare=bare)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the free coordinates."""
        return tuple(name for name, free in zip(COORDINATES, self.mask, strict=True) if free)

    @property
    def dependent_coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates that follow from the free ones."""
        return tuple(name for name, along in zip(COORDINATES, self.dependent, strict=True) if along)

    @property
    def m(self) -> int:
        """Number of free coordinates."""
        return sum(self.mask)
