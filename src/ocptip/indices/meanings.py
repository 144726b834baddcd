"""Every index of arms and of platforms: symbol, bounds, unit, and what it means."""

from __future__ import annotations

import math
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


@dataclass(frozen=True)
class Meaning:
    """What is the same for an index in all poses; attributes as in :class:`IndexEntry`."""

    symbol: str
    lower: float
    upper: float
    unit: str
    meaning: str

    def entry(self, name: str, value: float, status: str, upper: float | None = None) -> IndexEntry:
        """The index of one pose; `upper` where its bound depends on the mechanism."""
        bound = self.upper if upper is None else upper
        return IndexEntry(name, self.symbol, value, self.lower, bound, self.unit, self.meaning, status)


def _ratio(symbol: str, meaning: str) -> Meaning:
    return Meaning(symbol, 0.0, 1.0, "1", meaning)


def _amount(symbol: str, unit: str, meaning: str) -> Meaning:
    return Meaning(symbol, 0.0, math.inf, unit, meaning)


ARM = {
    "pi_oe": _ratio(
        "PI_OE",
        "slowest motion of the operation ellipsoid at unit joint rates, relative to turning axis 6; "
        "0 singular, 1 nothing is slower than axis 6",
    ),
    "inv_cdn_oe": _ratio(
        "1/CDN_OE",
        "slowest over fastest motion of the operation ellipsoid at unit joint rates; 0 singular, 1 isotropic",
    ),
    "dm_inf": _amount(
        "DM_inf",
        "rad",
        "angle by which joints 2 to 5 would all have to turn to reach a singularity (linearised); "
        "independent of the tool",
    ),
    "dm_2": _amount(
        "DM_2",
        "rad",
        "shortest path of joints 2 to 5 to a singularity, root of summed squares (linear); independent of "
        "the tool",
    ),
    "manipulability": _amount(
        "MPB",
        "m^3",
        "|det J|; 0 singular; grows with the cube of the arm's size, so compare poses of one arm only",
    ),
    "inv_cdn": _ratio(
        "1/CDN",
        "inverse condition number of the Jacobian in metres about the base origin; changes with unit and "
        "frame",
    ),
    "inv_cdn_cl": _ratio(
        "1/CDN_CL",
        "inverse condition number about the centre of the ellipsoid, lengths divided by its characteristic "
        "length",
    ),
    "inv_cdn_points": _ratio(
        "1/CDN_3P",
        "inverse condition number of the velocities of three points (the ends of the ellipsoid's half-axes); "
        "depends on their choice",
    ),
    "pi_oe_weighted": _ratio("PI^G_OE", "PI_OE at unit rotational energy instead of unit joint rates"),
    "inv_cdn_oe_weighted": _ratio(
        "1/CDN^G_OE", "1/CDN_OE at unit rotational energy instead of unit joint rates"
    ),
    "dm_inf_weighted": _amount(
        "DM^G_inf",
        "J",
        "rotational energy that each of joints 2 to 5 needs to reach a singularity in one second "
        "(linearised)",
    ),
    "dm_2_weighted": _amount(
        "DM^G_2",
        "J",
        "smallest rotational energy of joints 2 to 5 to reach a singularity in one second (linearised)",
    ),
    "sigma": Meaning(
        "sigma",
        -math.pi / 2,
        math.pi / 2,
        "rad",
        "where the motion heads: -pi/2 straight to the singularity, 0 parallel to it, pi/2 straight away",
    ),
}
"""Indices of an arm by name; sigma rates a motion."""

PLATFORM = {
    "ctn": _ratio(
        "CTN",
        "how evenly leg rates control the pose: ratio of smallest to largest rate of the unactuated joints",
    ),
    "inv_cdn_oe": _ratio("1/CDN_OE", "smallest to largest motion of the operation ellipsoid per leg motion"),
    "inv_cdn_cl": _ratio("1/CDN_CL", "the same with a sphere of equal size about the ellipsoid's centre"),
    "inv_cdn_points": _ratio("1/CDN_3P", "smallest to largest motion of the platform anchors per leg motion"),
    "inv_cdn": _ratio(
        "1/CDN",
        "plain condition of the Jacobian about the base origin, in metres; changes with the unit",
    ),
    "manipulability": _amount(
        "MPB",
        "m^3",
        "volume of leg rates per volume of platform motions; not comparable between platforms",
    ),
    "sigma_r": _amount("sigma_R", "m", "smallest leg motion per rad of platform rotation"),
    "sigma_s": _amount("sigma_S", "1", "smallest leg motion per metre of platform translation"),
    "rigidity_rate": Meaning(
        "phi",
        0.0,
        math.pi / 2.0,
        "rad",
        "angle between the motion that legs of fixed length would allow to a scalable platform and all "
        "rigid motions",
    ),
}
"""Indices of a platform by name, the trustworthy ones first; sigma_s is bounded by the number of legs."""

PARALLEL = {
    "dexterity": _ratio(
        "V(J_a)",
        "volume spanned by the unit rows of the Jacobian, angles times the platform's radius; "
        "0 motors do not hold the platform, 1 they act at right angles",
    ),
    "platform": _amount(
        "sigma_a",
        "1",
        "smallest singular value of the Jacobian, angles times the platform's radius; 0 not held; motors of "
        "equal stiffness hold with its square at least",
    ),
    "conditioning": _ratio(
        "1/CDN(J_a)",
        "smallest over largest singular value of the Jacobian, angles times the platform's radius; "
        "1 isotropic",
    ),
    "legs": _amount(
        "sigma_leg",
        "1",
        "smallest singular value of the Jacobian of one leg; 0 the platform loses a motion",
    ),
}
