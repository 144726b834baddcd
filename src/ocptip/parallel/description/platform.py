"""The platform of a parallel robot: which of its coordinates are free, its inertia, what it carries."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.frozen import settle
from ocptip.parallel.description.body_inertia import BodyInertia
from ocptip.robots.payload import Payload

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
