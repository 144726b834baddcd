"""Uncertainty of the data of a robot, its base and the floor, which are known within bounds only.

Of the base at rest (mass, centre of mass, friction) all corners count, see `Uncertainty.corners`: with the
arm at its place the wrench on the contacts is affine in the base's mass and in mass times centre of mass. So
it is a mean of the wrenches at the corners of all bounds. The wrenches that contacts carry within a share of
their friction are a convex set, and addable moments are concave. So no value inside the bounds is worse than
at the worst corner. Cones of friction lie in each other: the smallest friction is the worst.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import product
from math import exp, pi, sqrt
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, finite_array, number_from, positive_number
from ocptip.basics.frozen import settle
from ocptip.contact.bindings.binding import Binding
from ocptip.contact.support import Support
from ocptip.numerics.vectors import skew

_ALONG = 1e-9  # sine of the angle up to which an axis counts as along gravity
_STEEPEST = pi / 4  # rad
_STEPS = 200
_LATEST = 1.0  # s; above that it is the value that is off: not in ms
_SHARES = ("arm_mass", "payload_mass", "springs", "friction", "speed", "drive_speed")
_SIZES = ("tilt", "extra_mass", "delay", "push", "base_push")
BOXES = ("center_of_mass", "payload_center")

IN_FILES = {
    "friction": ("friction", 1.0),
    "tilt_deg": ("tilt", pi / 180),
    "arm_mass": ("arm_mass", 1.0),
    "payload_mass": ("payload_mass", 1.0),
    "springs": ("springs", 1.0),
    "extra_mass": ("extra_mass", 1.0),
    "delay_ms": ("delay", 1e-3),
    "speed": ("speed", 1.0),
    "drive_speed": ("drive_speed", 1.0),
    "push": ("push", 1.0),
    "base_push": ("base_push", 1.0),
    "damping": ("damping", 1.0),
}
"""Single numbers of `[tolerance]` in files: key, attribute, SI unit per unit of the file."""


def overshoot_of(damping: float) -> float:
    """Share kappa of a step by which the load on elastic feet exceeds the load after the step.

    Args:
        damping: damping ratio of base and ground, 0 (kappa = 1) to 1 (kappa = 0); 0.05 gives 0.85.

    Raises:
        InputError: no such ratio.
    """
    ratio = number_from("damping", damping)
    if not 0 <= ratio <= 1:
        raise InputError(f"damping: must be >= 0 and <= 1, got {damping!r}")
    return exp(-ratio * pi / sqrt(1 - ratio**2)) if ratio < 1 else 0.0


def overshoot_of_rise(damping: float, periods: np.ndarray) -> np.ndarray:
    """Overshoot of a load that has no step, but changes linearly within a rise time.

    An oscillator whose load rises so swings, after that, as the mean of its answers to steps at all instants
    of the rise: with e(t) = Re(c exp(l t)) for a step, l its eigenvalue of frequency f, as Re(c (1 - exp(-l
    T)) / (l T) exp(l t)).

    Args:
        damping: damping ratio, below 1.
        periods: f T > 0, undamped natural frequency times rise time.

    Returns:
        Shares of the change; of one period 0 without damping, of longer rises at most 1 / (pi f T).
    """
    swing = sqrt(1 - damping**2)
    periods = np.asarray(periods, dtype=float)[..., None]
    rate = 2 * pi * (-damping + 1j * swing)  # per undamped period
    height = (1 - 1j * damping / swing) * (1 - np.exp(-rate * periods)) / (rate * periods)
    after = periods + np.linspace(0, 1 / swing, _STEPS)  # in undamped periods: a damped one after the rise
    return np.maximum(0.0, np.max(-np.real(height * np.exp(rate * after)), axis=-1))


def overshoot_of_rises(damping: float) -> float:
    """The maximum share for rises of one period and more."""
    return float(np.max(overshoot_of_rise(damping, 1 + np.linspace(0, 1, _STEPS))))


@dataclass(frozen=True, eq=False)
class Corner:
    """Base mass and centre of mass at ends of their bounds.

    Attributes:
        name: e.g. "base mass -5 %, centre of mass +10 mm in x, friction -20 %"; "" without tolerances.
        mass: kg.
        shift: (3,), m, base axes, of the centre of mass.
        per_gravity: (6, 3): change of the wrench about the nominal centre of mass per gravity in base axes.
    """

    name: str
    mass: float
    shift: np.ndarray
    per_gravity: np.ndarray


@dataclass(frozen=True)
class Uncertainty:
    """The bounds by which robot, base and ground may deviate from their nominal data, all at once.

    Attributes:
        base_mass: relative half width of the base's mass, below 1; or (2,), kg: minimum and maximum mass.
        center_of_mass: (3,), m: half sides of the box about the base's centre of mass, base axes.
        friction: relative reduction of all friction coefficients, below 1.
        tilt: of the floor, and of base and robot with it, in any direction, rad.
        arm_mass: relative half width of the mass of each moving link, below 1; inertias in proportion.
        payload_mass: the same of the payload.
        springs: relative half width of the torque of each counterbalance spring, below 1; it changes the
            torques of drives and no contact.
        extra_mass: kg: a point mass at the TCP may be there, up to this.
        payload_center: (3,), m: half sides of the box about the payload's centre of mass, gripper axes.
        delay: s: maximum delay of every joint, independently.
        speed: relative: share by which a motion may run faster or slower, below 1.
        drive_speed: relative: share by which a base drives faster or slower than its profile, on the same
            clock: velocities by it, accelerations by its square.
        push: N: a force up to this in any direction at the TCP.
        base_push: N: the same at the base's centre of mass, wherever that is in its box.
        damping: damping ratio of feet and structure, below 1, with which acceleration steps overshoot; None:
            they do not.
    """

    base_mass: float | Sequence[float] = 0.0
    center_of_mass: Sequence[float] = (0.0, 0.0, 0.0)
    friction: float = 0.0
    tilt: float = 0.0
    arm_mass: float = 0.0
    payload_mass: float = 0.0
    springs: float = 0.0
    extra_mass: float = 0.0
    payload_center: Sequence[float] = (0.0, 0.0, 0.0)
    delay: float = 0.0
    speed: float = 0.0
    drive_speed: float = 0.0
    push: float = 0.0
    base_push: float = 0.0
    damping: float | None = None

    def __post_init__(self) -> None:
        if np.ndim(self.base_mass):
            low, high = mass = finite_array("base_mass", self.base_mass, (2,))
            if not 0 < low <= high:
                raise InputError(f"base_mass: expected 0 < minimum <= maximum mass, kg, got {mass.tolist()}")
            settle(self, base_mass=tuple(mass.tolist()))
        shares = [*_SHARES, *(() if np.ndim(self.base_mass) else ("base_mass",))]
        shares += [] if self.damping is None else ["damping"]
        for name in shares:
            if not 0 <= number_from(name, getattr(self, name)) < 1:
                raise InputError(f"{name}: must be >= 0 and below 1, got {getattr(self, name)!r}")
        for name in _SIZES:
            positive_number(name, getattr(self, name), zero_allowed=True)
        if self.tilt > _STEEPEST:
            raise InputError(f"tilt: must be at most 45 degrees, got {np.degrees(self.tilt):.6g} degrees")
        if self.delay > _LATEST:
            raise InputError(f"delay: must be at most {1e3 * _LATEST:g} ms, got {1e3 * self.delay:.6g} ms")
        for name in BOXES:
            half = finite_array(name, getattr(self, name), (3,))
            if np.any(half < 0):
                raise InputError(f"{name}: half sides must be >= 0, got {half.tolist()}")
            settle(self, **{name: tuple(half.tolist())})

    @property
    def given(self) -> tuple[str, ...]:
        """Names of what is uncertain."""
        names = [field.name for field in fields(self)]
        return tuple(
            name
            for name in names
            if (getattr(self, name) is not None if name == "damping" else np.any(getattr(self, name)))
        )

    @property
    def overshoot(self) -> float:
        """Overshoot of an acceleration step, as a share of its height; 0 where none is counted."""
        return 0.0 if self.damping is None else overshoot_of(self.damping)

    @property
    def title(self) -> str:
        """Its name in sentences: "'workshop' uncertainty" of a preset, else "the given uncertainty"."""
        names = [name for name, preset in PRESETS.items() if self in (preset, preset.of(None))]
        return f"'{names[0]}' uncertainty" if names else "the given uncertainty"

    @property
    def scope(self) -> str:
        """Its name in headlines, which mark the default."""
        default = self in (DEFAULT, DEFAULT.of(None))
        return f"{self.title} (default)" if default else self.title

    def only(self, *names: str) -> Uncertainty:
        """This uncertainty restricted to some quantities; all others are exact."""
        return Uncertainty(**{name: getattr(self, name) for name in names})

    @property
    def late(self) -> float:
        """s: maximum delay of joints in the time of the motion, which may run faster."""
        return self.delay * (1 + self.speed)

    def of(self, payload: object) -> Uncertainty:
        """The uncertainty for an arm with this payload; without payload, its mass and centre are exact."""
        return self if payload else replace(self, payload_mass=0.0, payload_center=(0.0, 0.0, 0.0))

    def heavier(self, more: float) -> Uncertainty:
        """The uncertainty for a base that is heavier by `more`, kg: an interval of its mass moves with it."""
        low_and_high = np.asarray(self.base_mass, dtype=float)
        return replace(self, base_mass=low_and_high + more) if low_and_high.ndim and more else self

    def scaled(self, factor: float) -> Uncertainty:
        """Everything but damping by this factor of it; an interval of the base's mass stays."""
        values = {name: getattr(self, name) for name in self.given if name != "damping"}
        return replace(
            self,
            **{
                name: value
                if name == "base_mass" and isinstance(value, tuple)
                else tuple(factor * x for x in value)
                if isinstance(value, tuple)
                else factor * value
                for name, value in values.items()
            },
        )

    def require_only(self, *names: str, where: str) -> None:
        """Raise InputError if anything else is uncertain, which is not checked `where`."""
        if others := [name for name in self.given if name not in names]:
            raise InputError(f"tolerance.{others[0]}: not checked {where}; there are {', '.join(names)}")

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON, SI units; only what is uncertain."""
        return {name: np.asarray(getattr(self, name)).tolist() for name in self.given}

    def to_table(self) -> dict[str, Any]:
        """The table `[tolerance]` of a file."""
        data = self.to_dict()
        units = {name: (key, scale) for key, (name, scale) in IN_FILES.items()}
        table = {}
        for name, value in data.items():
            key, scale = units.get(name, (name, 1.0))
            table[key] = value if isinstance(value, list) else float(f"{value / scale:.15g}")
        return table

    def lines(self) -> list[str]:
        """In words, one entry per quantity: "tilt 0.5 deg", "arm masses +-5 %"."""
        return [_WORDS[name](getattr(self, name)) for name in self.given]

    def __str__(self) -> str:
        return ", ".join(self.lines()) or "none"

    def masses(self, nominal: float) -> list[float]:
        """Ends of the interval of the base's mass, kg; one if it is known.

        Raises:
            InputError: the nominal mass is not inside.
        """
        share = np.asarray(self.base_mass, dtype=float)
        if share.ndim:
            low, high = share
            if not low <= nominal <= high:
                raise InputError(
                    f"tolerance.base_mass: {low:g} to {high:g} kg without the base's mass {nominal:g} kg"
                )
            return sorted({float(low), float(high)})
        return sorted({nominal * (1 - float(share)), nominal * (1 + float(share))})

    def corners(self, support: Support, gravity: np.ndarray) -> tuple[Corner, ...]:
        """All combinations of ends that differ in their wrench.

        Args:
            support: the nominal base.
            gravity: (N, 3), base axes, of some poses; what has no influence in any of them has none.
        """
        along = np.linalg.norm(np.cross(gravity[:, None], np.eye(3)), axis=2)
        matters = np.any(along > _ALONG * np.linalg.norm(gravity, axis=1)[:, None], axis=0)
        half = np.where(matters, self.center_of_mass, 0.0)
        results = []
        for mass, *shift in product(self.masses(support.mass), *(sorted({-h, h}) for h in half)):
            d = np.array(shift)
            change = np.vstack([(mass - support.mass) * np.eye(3), mass * skew(d)])
            results.append(Corner(self._name(mass / support.mass - 1, d), mass, d, change))
        return tuple(results)

    def _name(self, more: float, shift: np.ndarray) -> str:
        parts = [f"base mass {100 * more:+.3g} %"] if more else []
        moved = [f"{1000 * d:+.3g} mm in {axis}" for d, axis in zip(shift, "xyz", strict=True) if d]
        parts += ["centre of mass " + " and ".join(moved)] if moved else []
        parts += [f"friction {-100 * self.friction:.3g} %"] if self.friction else []
        return ", ".join(parts)

    def contacts(self, nominal: Sequence[Binding]) -> tuple[Binding, ...]:
        """The contacts with the minimum friction."""
        return with_friction(nominal, 1 - self.friction)


def with_friction(nominal: Sequence[Binding], factor: float) -> tuple[Binding, ...]:
    """The contacts with their friction times a factor."""
    names = [[field.name for field in fields(c) if field.name.startswith("friction")] for c in nominal]
    return tuple(
        replace(contact, **{name: factor * getattr(contact, name) for name in field})
        for contact, field in zip(nominal, names, strict=True)
    )


def _half_sides(what: str, half: np.ndarray) -> str:
    sides = [f"+-{1e3 * h:.3g} mm in {axis}" for h, axis in zip(half, "xyz", strict=True) if h]
    return f"{what} {', '.join(sides)}"


def _base_mass(mass: float | np.ndarray) -> str:
    if np.ndim(mass):
        low, high = np.asarray(mass)
        return f"base mass {low:g} to {high:g} kg"
    return f"base mass +-{100 * float(np.asarray(mass)):.3g} %"


_WORDS = {
    "base_mass": _base_mass,
    "center_of_mass": lambda half: _half_sides("base's centre of mass", half),
    "friction": lambda share: f"friction -{100 * share:.3g} %",
    "tilt": lambda angle: f"floor tilt {np.degrees(angle):.3g} deg",
    "arm_mass": lambda share: f"arm masses +-{100 * share:.3g} %",
    "payload_mass": lambda share: f"payload +-{100 * share:.3g} %",
    "springs": lambda share: f"springs +-{100 * share:.3g} %",
    "extra_mass": lambda mass: f"{mass:.3g} kg more at the TCP",
    "payload_center": lambda half: _half_sides("payload's centre of mass", half),
    "delay": lambda time: f"joints delayed by up to {1e3 * time:.3g} ms",
    "speed": lambda share: f"{100 * share:.3g} % faster or slower",
    "drive_speed": lambda share: f"base {100 * share:.3g} % faster or slower",
    "push": lambda force: f"push of {force:.3g} N at the TCP",
    "base_push": lambda force: f"push of {force:.3g} N at the base",
    "damping": lambda zeta: f"acceleration steps overshoot at {100 * zeta:.3g} % damping",
}

NONE = Uncertainty()
WORKSHOP = Uncertainty(
    tilt=np.radians(0.5),
    base_mass=0.05,
    arm_mass=0.05,
    payload_mass=0.05,
    extra_mass=0.1,
    friction=0.2,
    delay=0.010,
    speed=0.03,
    damping=0.05,
)
SITE = replace(
    WORKSHOP, tilt=np.radians(1.5), extra_mass=0.5, friction=0.3, speed=0.05, push=20.0, base_push=20.0
)
DEFAULT = WORKSHOP
"""Holds wherever neither a file nor an option states an uncertainty."""
PRESETS = {"none": NONE, "workshop": WORKSHOP, "site": SITE}
"""By the name in files and options. `SITE` is `WORKSHOP` with more tilt, mass and speed, and with pushes."""
