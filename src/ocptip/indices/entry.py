"""One index of one pose: value, bounds, unit and what it means."""

from __future__ import annotations

from dataclasses import dataclass

from ocptip.basics.write import Record


@dataclass(frozen=True)
class IndexEntry(Record):
    """One performance index of a pose.

    Attributes:
        name: unique within a rating, e.g. "pi_oe".
        symbol: as in the literature, e.g. "PI_OE".
        value: the index; infinite where it is defined so; NaN where it is not defined for this mechanism.
        lower, upper: bounds of its values; upper is infinite if there is none.
        unit: "1" for dimensionless.
        meaning: one sentence for people who read the number.
        status: "ok", or what is special about this pose.
    """

    name: str
    symbol: str
    value: float
    lower: float
    upper: float
    unit: str
    meaning: str
    status: str = "ok"
