"""The objective of a motion: electric energy, time, or both."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from ocptip.basics.errors import InputError, number_from

TIE_BREAK = 1e-5  # s/J: of equally fast motions the one with less energy
ENERGY_UNIT = 100.0  # J; programs have costs of about 1


@dataclass(frozen=True)
class Objective:
    """The cost energy_weight * energy + time_weight * duration; made by `ENERGY`, `TIME` or `priced`.

    Attributes:
        name: "energy", "time" or "both".
        energy_weight: of an electric energy of 1 J.
        time_weight: of 1 s.
        unit: of the cost, "J" or "s".
        size: a cost of usual size, for programs.
    """

    name: str
    energy_weight: float
    time_weight: float
    unit: str
    size: float

    def cost(self, energy: float, duration: float) -> float:
        """Cost of a motion with this energy (J) and duration (s), in `unit`."""
        return self.energy_weight * energy + self.time_weight * duration

    def with_power(self, power: float) -> Objective:
        """The same cost of what lacks this power (W) all the time."""
        return replace(self, time_weight=self.time_weight + self.energy_weight * power) if power else self

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        names = ("name", "energy_weight", "time_weight", "unit")
        return {name: getattr(self, name) for name in names}


ENERGY = Objective("energy", 1.0, 0.0, "J", ENERGY_UNIT)
TIME = Objective("time", TIE_BREAK, 1.0, "s", 1.0)


def priced(price_per_second: float) -> Objective:
    """Energy, and `price_per_second` (J/s) for the time that it takes.

    Raises:
        InputError: the cost of time is not above 0.
    """
    price = number_from("price_per_second", price_per_second)
    if price <= 0:
        raise InputError(f"price_per_second: must be > 0 J/s, got {price_per_second!r}")
    return Objective("both", 1.0, price, "J", ENERGY_UNIT)


def objective_of(name: str | None, price_per_second: float | None) -> Objective:
    """By what people write: a name, a cost of time, or neither, which means energy.

    Raises:
        InputError: no such name, "both" without a cost of time, or one with another name.
    """
    if price_per_second is not None:
        if name not in (None, "both"):
            raise InputError(f"price_per_second: belongs to the objective both, not to {name}")
        return priced(price_per_second)
    if name == "both":
        raise InputError("objective: both needs price_per_second, J/s")
    known = {"energy": ENERGY, "time": TIME}
    if name is not None and name not in known:
        raise InputError(f"objective: expected energy, time or both, got {name!r}")
    return known[name or "energy"]
