"""What was proved of a motion: bounds, and where something is missing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from ocptip.certificate.trusted.checker import (
    ANGLE_MARGIN_CANCEL,
    COVERS_OF_CANCELS,
    NOMINAL_CANCEL,
    TORQUES_CANCEL,
    WITHIN_CANCEL,
    Verdict,
)
from ocptip.certificate.trusted.described import CLEARANCE, SPEED_OF_POINTS, SPEED_OF_POINTS_WITHIN
from ocptip.motion.violations import quantity_title
from ocptip.standing.limits import SLIP_WITHIN, TIP_WITHIN, TORQUE_WITHIN

CLEARANCE_ON_TIME = "clearance"
"""Key of the bound of the nominal motion."""
AT_LIMIT = 1e-6
"""Relative (of distances m): what is claimed where a limit is used up."""

LATE = "delayed joints", "overshoot after acceleration steps"
"""Among what is sampled only: bounds within an uncertainty are then those of joints on time."""

_SLIP_OF_CANCELS = tuple(names[1] for names in COVERS_OF_CANCELS.values())
_CLAIMS = (
    ("Tipping margin", "N m", "GN", TIP_WITHIN),
    ("Friction used", "%", "GT", SLIP_WITHIN),
    ("Joint torque", "%", "torque_ratio", TORQUE_WITHIN),
    ("Clearance", "mm", CLEARANCE_ON_TIME, CLEARANCE),
    ("Speed of points", "%", SPEED_OF_POINTS, SPEED_OF_POINTS_WITHIN),
    ("Tipping margin in cancels", "N m", *(names[0] for names in COVERS_OF_CANCELS.values())),
    ("Friction used in cancels", "%", *_SLIP_OF_CANCELS),
    ("Joint torque in cancels", "%", *TORQUES_CANCEL),
)
"""Title, unit, keys of the bounds: nominal, and in the worst case."""
_OF_CANCELS = (ANGLE_MARGIN_CANCEL, *TORQUES_CANCEL, *(k for ks in COVERS_OF_CANCELS.values() for k in ks))
ANGLES = "angle_margin_deg_cancel", "position_margin_m_cancel"
"""Names of sampled values that a bound of the angle margin in cancels covers."""
_LEAST = (CLEARANCE_ON_TIME, CLEARANCE, ANGLE_MARGIN_CANCEL)  # bounds from below
CANCELS = "contacts in cancels"
"""The name of the claim about cancels, where it is not proved."""
_OF_CONTACTS = {
    "contacts": ("GT", "--gt {}"),
    "tip-over": ("GN", "--gn {}"),
    "contacts within tolerance": (SLIP_WITHIN, "GT_worst_case = {} in [limits]"),
    "tip-over within tolerance": (TIP_WITHIN, "GN_worst_case = {} in [limits]"),
}
"""Sampled value by claim, and the limit with which a plan keeps more of the contacts."""
_WORDS = {
    "contacts": ("foot forces and friction", "planning with lower --gn and --gt may help"),
    "tip-over": ("tipping", "planning with lower --gn and --gt may help"),
    "torque": ("joint torques", "planning with a lower --torque-ratio may help"),
    "clearance": ("clearance", "planning with a larger --clearance may help"),
    CANCELS: (
        "contacts when cancelled",
        "planning with --stop-safe cancel, which slows down by up to 5 %, or a gentler cancel may help",
    ),
}
"""Names of claims, and what helps where they are not proved."""
_BY_SLOWER = "a slower motion may help"
_UNBOUNDED = 1e6
_FAR = 0.8  # of what is lost: sampled values below are far from the limit


def every_of_cancels(within: bool) -> set[str]:
    """Names of sampled values in cancels of which all is proved, within an uncertainty or nominal."""
    names = COVERS_OF_CANCELS[NOMINAL_CANCEL] + (COVERS_OF_CANCELS[WITHIN_CANCEL] if within else ())
    return {*names, *ANGLES}


@dataclass(frozen=True)
class Undecided:
    """An interval of time on which a claim could not be proved.

    Attributes:
        start, end: s.
        claim: which.
        short: by how much, relative to the limit (of distances and angles: m, rad).
    """

    start: float
    end: float
    claim: str
    short: float

    @property
    def limit(self) -> str:
        """Name of the limit that the claim is about."""
        of_object, _, claim = self.claim.rpartition(": ")
        return claim.replace("contacts", "slip") + (f" of {of_object}" if of_object else "")

    def remedy(self, worst: Mapping[str, float]) -> str:
        """What helps, with the worst sampled values by name: a limit by as much below them."""
        of_object, _, claimed = self.claim.rpartition(": ")
        claim, within, _ = claimed.partition(" within tolerance")
        _, helps = _WORDS.get(claim, ("", _BY_SLOWER))
        name, planned = _OF_CONTACTS.get(claimed, ("", ""))
        name += f"[{of_object}]" if of_object else ""
        if (value := worst.get(name, 0.0)) > 0 and self.short < 1:
            # So much more has to be left than now: of the friction, or of the moment M0 (1 / GN - 1).
            wanted = value - self.short if claim == "contacts" else 1 / (1 / value + self.short)
            number = max(np.floor(100 * wanted) / 100, 0.01)
            of_file = "; check that plan against this task then" * bool(within)
            helps = f"planning with {planned.format(f'{number:g}')} may help{of_file}"
            if value < _FAR:
                of = f"{100 * value:.0f} % of the friction" if claim == "contacts" else f"GN {value:.2f}"
                helps = f"the bound is coarse, samples have {of}: {helps}"
        return f"{helps}, a smaller uncertainty also" if within else helps

    def __str__(self) -> str:
        """What is not proved, where, and by how much it falls short."""
        of_object, _, claim = self.claim.rpartition(": ")
        claim, within, _ = claim.partition(" within tolerance")
        name, _ = _WORDS.get(claim, (claim, ""))
        name += f" of {of_object}" if of_object else ""
        name += " within the uncertainty" if within else ""
        ends = dict.fromkeys(f"{time:.5f}" for time in (self.start, self.end))
        when = f"{'from' if len(ends) > 1 else 'at'} {' to '.join(ends)} s"
        if self.short > _UNBOUNDED:
            return f"{name} {when}, without any bound there"
        by = {"clearance": f"{1e3 * self.short:.2g} mm", "angle": f"{self.short:.2g} (rad, m)"}
        beyond = by.get(claim, f"{100 * self.short:.2g} % of the limit")
        return f"{name} {when}: the proved bound misses the limit by {beyond}"


@dataclass(frozen=True, eq=False)
class Certificate:
    """The bounds that were proved for all instants of a motion.

    Attributes:
        data: the certificate, plain data for JSON; None where none can be made.
        verdict: of the checker on these data.
        kept: the proved bounds keep the limits that were asked for.
        undecided: where something is missing.
        sampled: names of worst values that are beyond it, known at the sampled instants only.
        reason: why there is none.
        seconds: that finding and checking took.
        speeds_within: speeds of points keep their limits for all delays of joints within the uncertainty.
        cancels: no cancel loses a contact or leaves joint limits, within the uncertainty if one is given.
        worst: sampled worst values, by name.
    """

    data: Mapping[str, Any] | None
    verdict: Verdict
    kept: bool = False
    undecided: tuple[Undecided, ...] = ()
    sampled: tuple[str, ...] = ()
    reason: str = ""
    seconds: float = 0.0
    speeds_within: bool = False
    cancels: bool = False
    worst: Mapping[str, float] = field(default_factory=dict)

    @property
    def certified(self) -> bool:
        """All limits are proved to hold at every instant, within the uncertainty if one is
        given."""
        return self.holds and not self.sampled

    @property
    def holds(self) -> bool:
        """The certificate holds and its bounds keep the limits, apart from values that are sampled."""
        return self.verdict.holds and self.kept

    @property
    def lacks_cancels(self) -> bool:
        """Everything about the motion is proved, but worst values of the base in cancels are sampled."""
        return self.holds and not every_of_cancels(True).isdisjoint(self.sampled)

    @property
    def cancel_torques(self) -> bool:
        """Torques of joints on time keep their limits in all cancels, within the uncertainty if given."""
        within = COVERS_OF_CANCELS[WITHIN_CANCEL][0] in self.verdict.bounds
        return self.cancels and TORQUES_CANCEL[within] in self.verdict.bounds

    @property
    def missing(self) -> str:
        """What is not proved, where, by how much, and what helps; empty if everything is proved."""
        if self.certified:
            return ""
        if self.data is None:
            return f"a proof: {self.reason}"
        if self.undecided:
            worst = max(self.undecided, key=lambda one: one.short)
            more = f"; and {len(self.undecided) - 1} more (ocptip certify)" if len(self.undecided) > 1 else ""
            return f"a proof of {worst}, sampled values keep it{more}; {worst.remedy(self.worst)}"
        if not self.verdict.holds:
            return f"a proof: {self.verdict.problems[0]}"
        if not self.kept:
            return f"a proof within the limits; proved is {claims(self.verdict)}"
        sampled = ", ".join(map(quantity_title, self.sampled))
        return f"a proof of {sampled}: these are only checked at samples, all other limits are proved"

    def short_of(self, limit: str, key: str, number: float) -> tuple[float, list[float]]:
        """By how much it falls short of proving a limit, and the middles of the intervals, s.

        Args:
            limit: its name, with that of the object, if it is about one.
            key: of its bound.
            number: the limit.
        """
        matching = [one for one in self.undecided if one.limit == limit]
        beyond = (
            self.verdict.bounds.get(key, number) - number if self.verdict.holds and not self.kept else 0.0
        )
        short = max([beyond if key not in _LEAST else -beyond, *(one.short for one in matching)])
        return short, [0.5 * (one.start + one.end) for one in matching]

    def followed_by(self, others: Sequence[Self], begins: Sequence[float]) -> Self:
        """The certificate of consecutive motions: the weakest value of every bound, times from the first
        start.

        Its data are those of the motions, in their order; each is checked by itself.

        Args:
            others: of the motions after this one.
            begins: s, of each, this one first.
        """
        parts = [self, *others]
        seconds = sum(part.seconds for part in parts)
        if (none := next((part for part in parts if part.data is None), None)) is not None:
            return replace(none, seconds=seconds)
        verdicts = [part.verdict for part in parts]
        names = dict.fromkeys(name for verdict in verdicts for name in verdict.bounds)
        bounds = {}
        for name in _OF_CANCELS:  # objects may be held by some alone, but all may be cancelled
            if not all(name in verdict.bounds for verdict in verdicts):
                names.pop(name, None)
        for name in names:
            weakest = min if name in _LEAST else max
            bounds[name] = weakest(verdict.bounds[name] for verdict in verdicts if name in verdict.bounds)
        return type(self)(
            {"parts": [part.data for part in parts]},
            Verdict(
                all(verdict.holds for verdict in verdicts),
                tuple(problem for verdict in verdicts for problem in verdict.problems),
                bounds,
                sum(verdict.intervals for verdict in verdicts),
                moments=_least_moments(verdicts),
            ),
            all(part.kept for part in parts),
            tuple(
                replace(one, start=begin + one.start, end=begin + one.end)
                for part, begin in zip(parts, begins, strict=True)
                for one in part.undecided
            ),
            tuple(dict.fromkeys(name for part in parts for name in part.sampled)),
            seconds=seconds,
            speeds_within=all(part.speeds_within for part in parts),
            cancels=all(part.cancels for part in parts),
            worst={name: max(part.worst.get(name, 0.0) for part in parts) for name in self.worst},
        )

    def __str__(self) -> str:
        """In words."""
        if self.data is None:
            return f"none: {self.reason}"
        if not self.verdict.holds:
            first = self.undecided[0] if self.undecided else self.verdict.problems[0]
            more = f", and {len(self.undecided) - 1} more" if len(self.undecided) > 1 else ""
            return f"not proved for all instants: {first}{more}"
        bounds = claims(self.verdict, on_time=set(LATE) <= set(self.sampled))
        result = f"at every instant {bounds} ({self.verdict.intervals} intervals)"
        result += "" if self.kept else "; beyond the limits"
        return result + (
            f"; sampled only: {', '.join(map(quantity_title, self.sampled))}" if self.sampled else ""
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON, without the intervals."""
        return {
            "certified": self.certified,
            "bounds": dict(self.verdict.bounds),
            "intervals": self.verdict.intervals,
            "sampled_only": list(self.sampled),
            "undecided": [vars(one) for one in self.undecided],
            "reason": self.reason,
            "seconds": self.seconds,
        }


def _least_moments(verdicts: Sequence[Verdict]) -> dict[str, float]:
    """By name, where each has one."""
    names = set.intersection(*(set(verdict.moments) for verdict in verdicts))
    return {name: min(verdict.moments[name] for verdict in verdicts) for name in sorted(names)}


def claims(verdict: Verdict, on_time: bool = False) -> str:
    """The proved bounds in one line, see `claim_rows`; `on_time` notes that no joint is delayed."""
    rows = claim_rows(verdict)
    within = [f" (worst case {worst})" if worst != "-" else "" for _, _, worst in rows]
    parts = [f"{name[:1].lower()}{name[1:]} {claim_text}" for name, claim_text, _ in rows]
    text = ", ".join(part + more for part, more in zip(parts, within, strict=True))
    text += "; worst case with all joints on time" if on_time and any(within) else ""
    return "; ".join(filter(None, [text, beyond_cancels(verdict)]))


def beyond_cancels(verdict: Verdict) -> str:
    """What proved bounds of cancels say nothing of, a sentence without its end; empty without such bounds."""
    proved = CLEARANCE_ON_TIME in verdict.bounds and not verdict.bounds.keys().isdisjoint(_OF_CANCELS)
    return "clearance in cancels is not proved, ocptip check --stops cancel samples it" if proved else ""


def claim_rows(verdict: Verdict) -> list[tuple[str, str, str]]:
    """The proved bounds of every quantity: nominal, and in the worst case ("-": nothing).

    Rounded to the safe side; what exceeds a limit by rounding is the limit.
    """
    rows, objects = [], [key[3:-1] for key in verdict.bounds if key.startswith("GN[")]
    of_objects = [
        (f"{title}, {name}", unit, *(f"{key}[{name}]" for key in keys))
        for name in objects
        for title, unit, *keys in _CLAIMS[:2]
    ]
    for title, at_least, *keys in (*_CLAIMS, *of_objects):
        texts = [_proved(verdict, key, at_least) for key in keys]
        if set(texts) != {"-"}:
            rows.append((title, *texts))
    return rows


def _proved(verdict: Verdict, key: str, at_least: str) -> str:
    """A bound with its sign and unit: ">= 5.943 N m", "<= 63.65 %"."""
    if key not in (verdict.moments if at_least == "N m" else verdict.bounds):
        return "-"
    bound = verdict.bounds[key]
    if at_least == "mm":
        return f">= {_tenths(bound):.1f} mm"
    share = bound / (1 + 2 * AT_LIMIT)
    if key in _SLIP_OF_CANCELS:  # proved is that the limit is kept, no closer bound
        return f"within the limit of {100 * share:.4g} %"
    if at_least == "N m":  # the moment is unit (1 / GN - 1)
        moment = verdict.moments[key] * (1 / share - 1) / (1 / bound - 1)
        digits = 10.0 ** (3 - math.floor(math.log10(moment)))
        return f">= {math.floor(moment * digits) / digits:.4g} N m"
    rounded = np.ceil(1e4 * share) / 100
    return f"<= {rounded:.2f} %" if share >= 1 or rounded < 100 else "< 100 %"


def _tenths(distance: float) -> float:
    """mm, rounded to the safe side; what is at a limit is the limit."""
    return np.floor(1e4 * (distance + 2 * AT_LIMIT)) / 10
