"""Check a certificate: at every instant of a motion the base stands and every limit is kept.

A reader has to trust the modules of this folder and nothing else: NumPy and plain data, no solver, no
optimiser. For the nominal model these are `checker`, `plain` (are the data of that form), `forms`
(arithmetic), `arm` (the recursion), `contacts`, `distances` and `described`; for parallel robots `program`,
for uncertainties also `late`, `bodies`, `within`, `twists`, `sharing` and `drives`. What is assumed, and one
interval worked by hand, are in docs/certificate.md.

A certificate is plain data:

- `model`: the arm (link frames, inertias) or a program, what it holds, the base (mass, centre of mass,
  gravity), contacts with their force sets, what may collide, the joints' limits, points of links whose
  speeds are limited, as numbers;
- `motion`: pieces of time, on each of which every joint's coordinate is a polynomial of u in [-1, 1]; if the
  base drives, so are its velocities in its axes, which stay what they are before and after;
- `tolerance`: how far the world may be off, or null;
- `bounds`: what is claimed, one number each for the whole motion;
- `cover`: per piece the ends -1 = u_0 < u_1 < ... = 1 of its intervals, contact forces at both ends of each,
  and directions that separate solids (pairs for delayed joints are counted after the pairs);
- `cover_within`: for the tolerance the ends t_0 < t_1 < ... of intervals (from 0 to the delay after the
  motion; without delays, from 1 s before it to 1 s after it), joints that are taken apart on each, contact
  forces and weights of every combination of the possible states of these delayed joints, or null;
- `objects`: of each object of the model `cover`, and `cover_within` for the tolerance, or null: as
  `cover_within`, of its contacts;
- `cover_cancel`, `cover_cancel_within`, where something is claimed of cancels: how times of cancels and times
  after them are divided, forces and weights of every box of these;
- `sha256`: of model, motion and tolerance.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ocptip.certificate.trusted.cancelled import Cancelled
from ocptip.certificate.trusted.described import (
    CLEARANCE,
    SPEED_OF_POINTS,
    SPEED_OF_POINTS_WITHIN,
    TORQUES,
    Checker,
    Intervals,
    angle_margins,
    limits_of,
)
from ocptip.certificate.trusted.drives import Drives
from ocptip.certificate.trusted.forms import known
from ocptip.certificate.trusted.plain import (
    DECELERATIONS,
    LARGEST,
    NOTHING,
    OBJECTS,
    POINTS,
    VELOCITIES,
    MalformedError,
    numbers,
    require,
    require_cover,
    require_ends,
    require_joints,
    require_model,
    require_motion,
    require_process,
    require_tolerance,
)
from ocptip.certificate.trusted.program import require_program
from ocptip.certificate.trusted.sharing import Sharing

FORMAT = "ocptip certificate 4"
CLAIMS = ("GN", "GT", "torque_ratio", "clearance")
CLAIMS_WITHIN = ("GN_worst_case", "GT_worst_case")
CLAIMS_OF_CONTACTS = "contacts within tolerance", "tip-over within tolerance"
NOMINAL_CANCEL, WITHIN_CANCEL = "cover_cancel", "cover_cancel_within"
COVERS_OF_CANCELS = {
    NOMINAL_CANCEL: ("GN_cancel", "GT_cancel"),
    WITHIN_CANCEL: ("GN_cancel_worst_case", "GT_cancel_worst_case"),
}
"""Claims about the states of a motion that is cancelled at any time, and the keys of what proves them."""
ANGLE_MARGIN_CANCEL = "angle_margin_cancel"
"""Claim: minimum margin, rad or m, of joints to their limits in all cancels that claims are about."""
TORQUES_CANCEL = "torque_ratio_cancel", "torque_ratio_cancel_worst_case"
"""Claims: maximum torques over limits in all cancels, of the nominal model and within the tolerance, with all
joints on time; proved with the boxes of `NOMINAL_CANCEL`."""
_TIPPING = ("GN", "GN_worst_case", "GN_cancel", "GN_cancel_worst_case")
_AT_ONCE = 400  # boxes


@dataclass(frozen=True)
class Verdict:
    """The bounds that a certificate proves.

    Attributes:
        holds: everything that it claims.
        problems: why not, one sentence each.
        bounds: claimed: maximum GN, GT, torque_ratio and point_speed_ratio, minimum clearance, m; within an
            uncertainty maximum GN_worst_case and GT_worst_case and, if claimed, torque_ratio_worst_case,
            point_speed_ratio_worst_case and the minimum clearance_worst_case.
        moments: N m: what is proved to be left about every tipping axis, by the same names. GN is a share of
            a reference moment that the certificate may choose; this is not.
        intervals: number of them, and of rows within a tolerance.
        tolerance: how far the world may be off, SI units; None: not at all.
    """

    holds: bool
    problems: tuple[str, ...]
    bounds: Mapping[str, float]
    intervals: int
    tolerance: Mapping[str, Any] | None = None
    moments: Mapping[str, float] = field(default_factory=dict)


def check_certificate(data: Mapping[str, Any]) -> Verdict:
    """Check a certificate, from its data alone."""
    try:
        with np.errstate(all="ignore"):  # what is not a number is not proved
            problems, intervals = _problems(data)
        bounds, tolerance = dict(data["bounds"]), data["tolerance"]
        unit = data["model"]["base"]["reference_moment"]
    except MalformedError as error:
        return Verdict(False, (str(error),), {}, 0)
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError) as error:
        return Verdict(False, (f"not readable: {type(error).__name__}: {error}",), {}, 0)
    if problems:
        return Verdict(False, tuple(problems), bounds, intervals, tolerance)
    units = {} if unit is None else dict.fromkeys(_TIPPING, unit)
    for one in data["model"].get(OBJECTS, []):
        units |= {claims_of(one, within)[0]: one["base"]["reference_moment"] for within in (False, True)}
    moments = {key: reference * (1 / bounds[key] - 1) for key, reference in units.items() if key in bounds}
    return Verdict(not problems, tuple(problems), bounds, intervals, tolerance, moments)


def digest(data: Any) -> str:
    """SHA-256 of plain data."""
    text = json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def claims_of(carried: Mapping[str, Any], within: bool) -> tuple[str, ...]:
    """Names of the bounds of an object's contacts, of the nominal model or within a tolerance."""
    return tuple(f"{key}[{carried['name']}]" for key in (CLAIMS_WITHIN if within else CLAIMS[:2]))


def _problems(data: Mapping[str, Any]) -> tuple[list[str], int]:
    if data["format"] != FORMAT:
        return [f"format is {data['format']!r}, expected {FORMAT!r}"], 0
    results = [
        f"the {key} is not that of the digest"
        for key in ("model", "motion", "tolerance")
        if digest(data[key]) != data["sha256"][key]
    ]
    bounds, motion, model = data["bounds"], data["motion"], data["model"]
    require_model(model)
    if model["arm"] is None:
        require_program(model["program"], len(model["limits"]["speed"]))
        require(data["tolerance"] is None, "tolerance: of a program nothing is known")
    require_motion(motion, len(model["limits"]["speed"]))
    require_process(model["arm"], motion)
    if VELOCITIES in motion:
        rigid = model["arm"] is not None and "inertia" in model["base"]
        require(rigid, f"{VELOCITIES}: an arm, and the inertia of the base are expected")
    cancels = [names for names in COVERS_OF_CANCELS.values() if bounds.keys() & set(names)]
    within = () if (tolerance := data["tolerance"]) is None else CLAIMS_WITHIN
    if tolerance is not None:
        require_tolerance(tolerance)
    ratios = (TORQUES, SPEED_OF_POINTS_WITHIN)
    above = (*ratios, *TORQUES_CANCEL, SPEED_OF_POINTS)  # bounds that may exceed 1
    names_bounded = (*within, *(key for key in ratios if within and key in bounds))
    names_bounded += (SPEED_OF_POINTS,) if model.get(POINTS) else ()
    names_bounded += tuple(key for names in cancels for key in names)
    if COVERS_OF_CANCELS[NOMINAL_CANCEL] in cancels:
        names_bounded += tuple(key for key in TORQUES_CANCEL[: 1 + bool(within)] if key in bounds)
    carried, kinds = model.get(OBJECTS, []), (False, True) if within else (False,)
    names_bounded += tuple(key for one in carried for kind in kinds for key in claims_of(one, kind))
    apart = [key for key in ("clearance", CLEARANCE) if key in bounds]
    angles = [key for key in (ANGLE_MARGIN_CANCEL,) if cancels]
    if unknown := set(bounds) - {*CLAIMS, *names_bounded, *(apart if within else ()), *angles}:
        results.append(f"unknown claims: {', '.join(sorted(unknown))}")
    results += [
        f"{key}: {bounds[key]} is no bound that proves anything"
        for key, most in (
            ("GN", 1.0),
            ("GT", 1.0),
            ("torque_ratio", LARGEST),
            *((key, LARGEST if key in above else 1.0) for key in names_bounded),
        )
        if not 0 < numbers(key, bounds[key], ()) < most
    ]
    numbers("clearance", [bounds[key] for key in (*apart, *angles)], (None,))
    if SPEED_OF_POINTS_WITHIN in bounds and not model.get(POINTS):
        results.append(f"{SPEED_OF_POINTS_WITHIN}: claimed without points")
    if "clearance" not in bounds if model["pairs"] else apart:
        results.append("clearance: claimed without anything that may collide, or not claimed with it")
    if len(data["cover"]) != len(motion["times"]):
        results.append(f"cover: of {len(data['cover'])} pieces, the motion has {len(motion['times'])}")
    if len(data.get(OBJECTS, [])) != len(carried):
        results.append(f"{OBJECTS}: of {len(data.get(OBJECTS, []))}, the model has {len(carried)}")
    if results:
        return results, 0
    missing = (tolerance is None) != (data["cover_within"] is None)
    if missing:
        return ["cover_within: given without a tolerance, or not given with one"], 0
    problems, intervals = _problems_as_described(data)
    if tolerance is not None:
        other, rows = _problems_within(data, data["cover_within"], tolerance, bounds)
        problems, intervals = problems + other, intervals + rows
    for one, covers in zip(carried, data.get(OBJECTS, []), strict=True):
        for kind in kinds:
            claims = {name: bounds[k] for name, k in zip(CLAIMS_WITHIN, claims_of(one, kind), strict=True)}
            cover = covers["cover_within" if kind else "cover"]
            world = tolerance if kind and tolerance is not None else NOTHING
            other, rows = _problems_within(data, cover, world, claims, one)
            if not kind:
                other = [text.replace(" within tolerance", "") for text in other]
            problems, intervals = problems + [f"{one['name']}: {text}" for text in other], intervals + rows
    for cover, names in COVERS_OF_CANCELS.items():
        if names in cancels:
            other, rows = _problems_of_cancels(data, cover, names)
            problems, intervals = problems + other, intervals + rows
    return problems, intervals


def _problems_as_described(data: Mapping[str, Any]) -> tuple[list[str], int]:
    """Problems of the claims about the nominal model."""
    motion, model, results = data["motion"], data["model"], []
    checker = Checker(model, data["bounds"], data["tolerance"], motion)
    shape = (2, 1 + len(checker.contacts.couples), checker.contacts.count, 3)
    piece, start, end, forces, given = [], [], [], [], {}
    for number, part in enumerate(data["cover"]):
        require_cover(part, number + 1, shape, len(model["pairs"]) * (1 + (CLEARANCE in data["bounds"])))
        ends, contact_forces = np.array(part["ends"], dtype=float), np.array(part["forces"], dtype=float)
        for interval, pair, *direction in part["directions"]:
            given[len(piece) + interval, pair] = direction
        piece += [number] * (len(ends) - 1)
        start.append(ends[:-1])
        end.append(ends[1:])
        forces.append(contact_forces)
    unknown = [0.0, np.nan, np.nan, np.nan]

    def directions(intervals: np.ndarray, pairs: np.ndarray) -> np.ndarray:
        return np.array(
            [given.get(key, unknown) for key in zip(intervals.tolist(), pairs.tolist(), strict=True)]
        )

    time_intervals = Intervals(motion, np.array(piece), np.concatenate(start), np.concatenate(end))
    every = np.moveaxis(np.concatenate(forces), 0, -1)  # (2, rules, contacts, 3, N)
    for name, margin in checker.margins(
        time_intervals, checker.loads(time_intervals), every, directions
    ).items():
        if not np.all(margin >= 0):
            k = int(np.argmin(margin))
            results.append(
                f"{name}: not proved near {time_intervals.times[k]:.6g} s, {np.sum(~(margin >= 0))} intervals"
            )
    return results, len(piece)


def _problems_within(
    data: Mapping[str, Any],
    cover: Mapping[str, Any],
    tolerance: Mapping[str, Any],
    bounds: Mapping[str, float],
    carried: Mapping[str, Any] | None = None,
) -> tuple[list[str], int]:
    """The problems of claims within an uncertainty about the base or an object, and the number of rows."""
    sharing = Sharing(data["model"], data["motion"], tolerance, bounds, carried)
    ends = require_ends(cover["ends"], sharing.late.start, sharing.late.end)
    apart = require_joints(cover["apart"], len(ends) - 1, sharing.late.joints)
    groups = sharing.late.rows(ends[:-1], ends[1:], apart)
    count = sum(len(rows.number) for rows in groups)
    forces, weights = _shared(sharing, cover, count)
    results = []
    for rows in groups:
        by_row = forces[..., rows.number], weights[..., rows.number]
        for name, margin in sharing.margins(sharing.terms(rows), *by_row).items():
            if not np.all(margin >= 0):
                near = ends[rows.interval[int(np.argmin(margin))]]
                results.append(f"{name}: not proved near {near:.6g} s, {np.sum(~(margin >= 0))} rows")
    return results, count


def _problems_of_cancels(
    data: Mapping[str, Any], cover: str, claimed: tuple[str, str]
) -> tuple[list[str], int]:
    """The problems of claims about a cancelled motion, and the number of boxes."""
    model, motion, bounds, cancel_data = data["model"], data["motion"], data["bounds"], data[cover]
    tolerance = data["tolerance"] if cover == WITHIN_CANCEL else NOTHING
    if tolerance is None or model["arm"] is None or VELOCITIES in motion:
        raise MalformedError(f"{cover}: of an arm on a base that rests, within a tolerance")
    claims: dict[str, float] = {key: bounds[name] for key, name in zip(CLAIMS_WITHIN, claimed, strict=True)}
    sharing = Sharing(model, motion, tolerance, claims)
    cancelled = Cancelled(motion, model[DECELERATIONS], sharing.late)
    boxes = cancelled.cover(cancel_data["trees"])
    count, limits = len(boxes.piece), limits_of(model)
    forces, weights = _shared(sharing, cancel_data, count)
    worlds = dict(zip(TORQUES_CANCEL, (NOTHING, data["tolerance"]), strict=True))
    asked = bounds.keys() & worlds if cover == NOMINAL_CANCEL else ()
    drives = {key: Drives(model, worlds[key]) for key in asked}
    names = [*CLAIMS_OF_CONTACTS, "angle", *drives]
    least = np.full(len(names), np.inf)
    for begin in range(0, count, _AT_ONCE):
        for rows in cancelled.rows(boxes.some(slice(begin, begin + _AT_ONCE))):
            here = begin + rows.number
            margins = sharing.margins(sharing.terms(rows), forces[..., here], weights[..., here])
            margins["angle"] = angle_margins(rows.q, limits) - bounds[ANGLE_MARGIN_CANCEL]
            for key, one in drives.items():
                margins[key] = bounds[key] - one.shares(rows, limits["torque"])
            least = np.minimum(least, [np.min(known(margins[name])) for name in names])
    within = " within tolerance" if cover == WITHIN_CANCEL else ""
    short = [name.split()[0] for name, value in zip(names, least, strict=True) if not value >= 0]
    return [f"{name} in cancels{within}: not proved" for name in short], count


def _shared(sharing: Sharing, cover: Mapping[str, Any], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Forces and weights of `count` rows, rows as the last axis."""
    contacts = sharing.contacts.count
    shape = (count, 2, 1 + len(sharing.contacts.couples), contacts, 3)
    forces = np.moveaxis(numbers("forces within tolerance", cover["forces"], shape), 0, -1)
    return forces, np.moveaxis(numbers("weights", cover["weights"], (count, contacts, 2), 0.0), 0, -1)
