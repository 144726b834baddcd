"""Are data those of a certificate? What is not of its form, types, shapes and magnitudes, is refused.

The checker relies on this: NumPy would broadcast a list that is too short, and count a negative index from
the end.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ocptip.certificate.trusted.arm import PROCESS, SPRINGS, TIMES

LARGEST = 1e9  # SI units: no number may be larger, so that none overflows
ROUNDED = 1e-12  # by so much may rotations and normals miss being orthonormal
JUMP = 1e-6  # rad or m, and 100 times as much per s: by so much may pieces that meet differ, all together
LONGEST = 1e5  # s: so long may a motion be, so that its times are rounded by far less than `late.SLACK`
LINE = 1e-6  # breadth over length: contacts narrower than that are on one line
POINTS = "points"
"""Key of points of an arm whose speeds are limited."""
OBJECTS = "objects"
"""Key of a model: what links carry on contacts alone, with bodies and contacts in axes of the link, 0: of the
base; each proved by an entry of the certificate of that name."""
DECELERATIONS = "decelerations_on_cancel"
"""Key of what joints decelerate by when a motion is cancelled, (m,), rad/s^2 or m/s^2."""
SPRING_SHARE = "springs"
"""Key of a tolerance: share of itself by which the torque of a spring may be off; 0 where it is missing."""
DRIVE_SPEED = "drive_speed"
"""Key of a tolerance: share by which a base drives faster or slower on its course; 0 where it is missing."""
VELOCITIES = "base_velocities"
"""Key of a motion while the base drives: its velocities forward and sideways, m/s, and turning, rad/s, in
base axes, by pieces as the angles are."""
_SHARE = 0.999  # relative, at most
_BOXES = ("center_of_mass", "payload_center")
_MOST = {
    **dict.fromkeys(("friction", "arm_mass", "payload_mass", "speed"), _SHARE),
    **{"tilt": np.pi / 4, "delay": 1.1, "overshoot": 1.0},
    **dict.fromkeys(("extra_mass", "push", "base_push"), LARGEST),
}
NOTHING = {
    **dict.fromkeys(_MOST, 0.0),
    **{key: [0.0] * 3 for key in _BOXES},
    "base_mass": [0.0, 0.0],
}
"""A tolerance of nothing at all."""
_LIMITS = {"angle_min", "angle_max", "speed", "acceleration", "torque"}


class MalformedError(ValueError):
    """Data that are no certificate."""


def require(condition: Any, text: str) -> None:
    """Raise MalformedError unless all of the condition holds."""
    if not np.all(condition):
        raise MalformedError(text)


def numbers(name: str, value: Any, shape: tuple[int | None, ...], least: float = -LARGEST) -> np.ndarray:
    """An array of such a shape (None: any length) of numbers, none below `least` or larger than LARGEST."""
    array = np.array(value)
    fits = array.ndim == len(shape) and all(
        n is None or n == given for n, given in zip(shape, array.shape, strict=True)
    )
    require(fits and array.dtype.kind in "iuf", f"{name}: numbers of shape {shape} are expected")
    require((array >= least) & (array <= LARGEST), f"{name}: a number is beyond {least:g} to {LARGEST:g}")
    return array.astype(float)


def require_model(model: Mapping[str, Any]) -> None:
    """Raise MalformedError unless these are an arm, a base, contacts, limits and bodies."""
    base, limits = model["base"], model["limits"]
    joints = len(limits["speed"])
    points = model.get(POINTS, [])  # those of before these were limited have none
    if model["arm"] is None:
        known = not model["pairs"] and not points and model["payload"] is None
        require(known, "program: bodies, points and payload are not known")
        links = 0
    else:
        _require_arm(model["arm"], model["payload"], joints)
        links = len(model["arm"]["masses"])
    numbers("mass of the base", base["mass"], (), 0.0)
    numbers("center_of_mass", base["center_of_mass"], (3,))
    numbers("gravity", base["gravity"], (3,))
    numbers("inertia of the base", base.get("inertia", np.eye(3)), (3, 3))
    if base["reference_moment"] is not None:
        numbers("reference_moment", base["reference_moment"], (), 1e-9)
    _require_contacts(model["contacts"])
    require(set(limits) == _LIMITS, "limits: others are expected")
    for key, limit in limits.items():
        least = -LARGEST if key.startswith("angle") else 1e-9
        numbers(f"limits of {key}", [1.0 if x is None else x for x in limit], (joints,), least)
    _require_bodies(model["bodies"], model["pairs"], links)
    if DECELERATIONS in model:
        numbers(DECELERATIONS, model[DECELERATIONS], (joints,), 1e-9)
    _require_objects(model.get(OBJECTS, []), links)
    for point in points:
        require(set(point) == {"link", "place", "speed"}, f"{POINTS}: link, place and speed are expected")
        _index("link", point["link"], 1, links + 1)
        numbers("place", point["place"], (3,))
        numbers("speed of a point", point["speed"], (), 1e-9)


def _require_arm(arm: Mapping[str, Any], held: Mapping[str, Any] | None, m: int) -> None:
    n = len(arm["masses"])
    for key, least in (("masses", 0.0), ("shift", -LARGEST), ("slides", 0.0)):
        numbers(key, arm[key], (n,), least)
    require(np.isin(np.array(arm["slides"], dtype=float), (0.0, 1.0)), "slides: 0 or 1 is expected")
    numbers("offsets", arm["offsets"], (n, 3))
    numbers("centres", arm["centres"], (n, 3))
    numbers("inertias", arm["inertias"], (n, 3, 3))
    numbers("armature", arm["armature"], (m,), 0.0)
    for key in SPRINGS:  # those of before there were springs have none
        numbers(key, arm.get(key, [0.0] * m), (m,))
    numbers("ratios", arm["ratios"], (n, m))
    _rotations("rotations", arm["rotations"], n)
    _rotations("mount_rotation", [arm["mount_rotation"]], 1)
    numbers("mount_position", arm["mount_position"], (3,))
    shape = (6,)
    if TIMES in arm:
        knots = numbers(TIMES, arm[TIMES], (None,))
        require(len(knots) > 0 and np.all(np.diff(knots) > 0), f"{TIMES}: these are to increase")
        shape = len(knots), 6
    for key in PROCESS:  # those of before this was looked at have none
        numbers(key, arm.get(key, np.zeros(shape).tolist()), shape)
    if held is not None:
        require(set(held) == {"mass", "center", "inertia", "axes"}, "payload: others are expected")
        require(
            numbers("mass of the payload", held["mass"], (), 0.0) <= arm["masses"][-1], "payload: too heavy"
        )
        numbers("center of the payload", held["center"], (3,))
        numbers("inertia of the payload", held["inertia"], (3, 3))
        _rotations("axes", [held["axes"]], 1)


def require_motion(motion: Mapping[str, Any], joints: int) -> None:
    """Raise MalformedError unless these are polynomials of pieces of time, at rest first and last."""
    require(set(motion) <= {"times", "angles", VELOCITIES}, "motion: others are expected")
    times = numbers("times", motion["times"], (None, 2))
    require(times <= LONGEST, f"times: none may be later than {LONGEST:g} s")
    c = numbers("angles", motion["angles"], (len(times), joints, None))
    require(3 <= c.shape[2] <= 6, "angles: three to six coefficients are expected")
    half = 0.5 * (times[:, 1] - times[:, 0])
    ends = len(c) > 1 and half[0] == half[-1] == times[0, 0] == 0 and not np.any(c[[0, -1], :, 1:])
    require(ends and np.all(half[1:-1] > 0), "motion: a piece at rest is to begin and to end it")
    require(times[1:, 0] == times[:-1, 1], "motion: times between pieces are missing")
    rate = np.where(half > 0, 1 / np.where(half > 0, half, 1.0), 0.0)[:, None]
    order, sign = np.arange(c.shape[2]), (-1.0) ** np.arange(c.shape[2])
    gaps = np.sum(np.abs((c @ sign)[1:] - c.sum(axis=2)[:-1]), axis=0)
    speeds = np.sum(np.abs((rate * (c @ (order * -sign)))[1:] - (rate * (c @ order))[:-1]), axis=0)
    if VELOCITIES in motion:
        v = numbers(VELOCITIES, motion[VELOCITIES], (len(times), 3, None))
        require(1 <= v.shape[2] <= 5, f"{VELOCITIES}: one to five coefficients are expected")
        require(not np.any(v[[0, -1], :, 1:]), f"{VELOCITIES}: constant before and after the motion")
        steps = np.sum(np.abs((v @ (-1.0) ** np.arange(v.shape[2]))[1:] - v.sum(axis=2)[:-1]), axis=0)
        require(steps <= 100 * JUMP, f"{VELOCITIES}: pieces do not meet, steps add up to {np.max(steps):.3g}")
    add_up = f"gaps add up to {np.max(gaps):.3g} and {np.max(speeds):.3g} per s"
    require((gaps <= JUMP) & (speeds <= 100 * JUMP), f"motion: pieces do not meet, {add_up}")


def require_process(arm: Mapping[str, Any] | None, motion: Mapping[str, Any]) -> None:
    """Raise MalformedError unless what acts on the gripper varies during a motion only: at rest before and
    after it is what it is at its ends."""
    if arm is not None and TIMES in arm:
        knots, end = np.array(arm[TIMES], dtype=float), motion["times"][-1][1]
        require((knots >= 0) & (knots <= end), f"{TIMES}: one is before or after the motion")


def require_tolerance(tolerance: Mapping[str, Any]) -> None:
    """Raise MalformedError unless this says of every quantity how far it may be off."""
    known = set(tolerance) - {SPRING_SHARE, DRIVE_SPEED}
    require(known == {*_MOST, *_BOXES, "base_mass"}, "tolerance: other quantities are expected")
    for key in (SPRING_SHARE, DRIVE_SPEED):
        require(numbers(key, tolerance.get(key, 0.0), (), 0.0) <= _SHARE, f"{key}: more than {_SHARE:g}")
    for key, most in _MOST.items():
        require(numbers(key, tolerance[key], (), 0.0) <= most, f"{key}: more than {most:g}")
    for key in _BOXES:
        numbers(key, tolerance[key], (3,), 0.0)
    low, high = numbers("base_mass", tolerance["base_mass"], (2,), -_SHARE)
    require(low <= 0 <= high, "base_mass: its interval is to hold 0")


def require_ends(value: Any, start: float, end: float) -> np.ndarray:
    """Times (N + 1,), s, from the start to the end or later, one after the other; else MalformedError."""
    ends = numbers("ends within tolerance", value, (None,))
    covered = len(ends) > 1 and ends[0] == start and ends[-1] >= end and np.all(np.diff(ends) > 0)
    require(covered, "cover_within: the motion, its delays and rests are not covered")
    return ends


def require_joints(value: Any, count: int, joints: int) -> np.ndarray:
    """Which joints (count, joints) are named, interval by interval; else MalformedError."""
    require(isinstance(value, list) and len(value) == count, "apart: joints of every interval are expected")
    values = np.zeros((count, joints), dtype=bool)
    for k, joint_terms in enumerate(value):
        for joint in joint_terms:
            _index("apart", joint, 0, joints)
            values[k, joint] = True
    return values


def require_cover(part: Mapping[str, Any], number: int, forces: tuple[int, ...], pairs: int) -> None:
    """Raise MalformedError unless this is a cut-up piece, with forces (2, rules, contacts, 3) of each."""
    ends = numbers("ends", part["ends"], (None,))
    covered = len(ends) > 1 and ends[0] == -1 and ends[-1] == 1 and np.all(np.diff(ends) > 0)
    require(covered, f"cover: piece {number} is not covered")
    numbers(f"forces of piece {number}", part["forces"], (len(ends) - 1, *forces))
    rows = part["directions"]
    expected = "directions: an interval, a pair, 0 or 1 and three numbers are expected"
    require(all(len(row) == 6 for row in rows), expected)
    for row in rows:
        _index("directions", row[0], 0, len(ends) - 1)
        _index("directions", row[1], 0, pairs)
    numbers("directions", [row[2:] for row in rows] or np.empty((0, 4)), (len(rows), 4))


def _require_objects(objects: Any, links: int) -> None:
    require(isinstance(objects, list) and (links or not objects), f"{OBJECTS}: of an arm")
    names = [one["name"] for one in objects]
    good = all(isinstance(name, str) and name for name in names) and len(set(names)) == len(names)
    require(good, f"{OBJECTS}: different names are expected")
    for one in objects:
        require(
            set(one) == {"name", "link", "axes", "bodies", "base", "contacts"},
            f"{OBJECTS}: others are expected",
        )
        _index("link", one["link"], 0, links + 1)
        _rotations("axes", [one["axes"]], 1)
        require(isinstance(one["bodies"], list) and one["bodies"], f"{OBJECTS}: bodies are expected")
        for body in one["bodies"]:
            require(set(body) == {"mass", "center", "inertia"}, f"{OBJECTS}: other bodies are expected")
            numbers("mass of an object", body["mass"], (), 1e-9)
            numbers("center of an object", body["center"], (3,))
            numbers("inertia of an object", body["inertia"], (3, 3))
        base = one["base"]
        numbers("mass of objects", base["mass"], (), 0.0)
        numbers("center_of_mass of objects", base["center_of_mass"], (3,))
        numbers("gravity of objects", base["gravity"], (3,))
        numbers("reference_moment of objects", base["reference_moment"], (), 1e-9)
        _require_contacts(one["contacts"])


def _require_contacts(contacts: Mapping[str, Any]) -> None:
    positions = numbers("contacts", contacts["positions"], (None, 3))
    require(len(positions) > 2, "contacts: at least three are expected")
    size = np.linalg.svd(positions - positions.mean(axis=0), compute_uv=False)
    require(size[1] > LINE * size[0], "contacts: they are on one line")
    _rotations("frames", contacts["frames"], len(positions))
    require(len(contacts["sets"]) == len(positions), "sets: one of each contact is expected")
    for pieces in contacts["sets"]:
        require(len(pieces) > 0, "sets: a contact has none")
        for low, high, radius, slope in pieces:
            numbers("sets", [radius, slope], (2,))
            least, most = -LARGEST if low is None else low, LARGEST if high is None else high
            ends = numbers("sets", [least, most], (2,))
            require(ends[0] <= ends[1], "sets: normal forces are to increase")


def _require_bodies(bodies: Any, pairs: Any, links: int) -> None:
    for body in bodies:
        if "normal" in body:
            require(set(body) == {"normal", "level"}, "bodies: a half space has a normal and a level")
            normal = numbers("normal", body["normal"], (3,))
            require(abs(np.linalg.norm(normal) - 1) <= ROUNDED, "normal: not of length 1")
            numbers("level", body["level"], ())
        else:
            require(set(body) == {"link", "points", "radius"}, "bodies: link, points and radius are expected")
            _index("link", body["link"], -1, links + 1)
            require(len(numbers("points", body["points"], (None, 3))) > 0, "points: none")
            numbers("radius", body["radius"], (), 0.0)
    for pair in pairs:
        require(len(pair) == 2 and pair[0] != pair[1], "pairs: two different bodies are expected")
        for k in pair:
            _index("pairs", k, 0, len(bodies))
        require("normal" not in bodies[pair[0]], "pairs: a half space comes second")


def _rotations(name: str, value: Any, count: int) -> None:
    R = numbers(name, value, (count, 3, 3))
    off = np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3))
    require((np.max(off, initial=0.0) <= ROUNDED) & (np.linalg.det(R) > 0), f"{name}: not orthonormal")


def _index(name: str, value: Any, least: int, end: int) -> None:
    if not (type(value) is int and least <= value < end):
        raise MalformedError(f"{name}: {value!r} is no number of one")
