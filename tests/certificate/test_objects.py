"""Proofs of objects on contacts: random ones against an independent model, a box by hand, a glass."""

import copy
from functools import cache

import numpy as np
import pytest

import ocptip
from ocptip.certificate.checks import certified
from ocptip.certificate.result import claim_rows
from ocptip.certificate.trusted.checker import check_certificate, claims_of
from ocptip.certificate.trusted.late import Late
from ocptip.certificate.trusted.plain import NOTHING
from ocptip.certificate.trusted.sharing import Sharing
from ocptip.certificate.trusted.within import Within
from ocptip.motion.check import check_motion
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import Uncertainty
from ocptip.trajectories.trajectory import Trajectory
from tests.certificate.test_driven import _driving
from tests.certificate.test_hostile import _judged, _judged_within, _set, _within
from tests.certificate.test_within_attacked import KINDS, NONE, driving
from tests.certificate.test_within_in_balls import _random_model, _random_motion
from tests.oracles.worlds import ArmOnBase
from tests.places import EXAMPLES
from tests.quick import THOROUGH

# --- random objects -----------------------------------------------------------------------------------------


def _random_object(model, rng):
    """Bodies on a link or on the base; whose contacts they are does not matter here."""
    bodies = []
    for _ in range(int(rng.integers(1, 3))):
        half = 0.05 * rng.normal(size=(3, 3))
        inertia = (half @ half.T).tolist()
        body = {
            "mass": rng.uniform(0.1, 2.0),
            "center": rng.uniform(-0.2, 0.2, 3).tolist(),
            "inertia": inertia,
        }
        bodies.append(body)
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    link = int(rng.integers(len(model["arm"]["masses"]) + 1))
    base = {"center_of_mass": rng.uniform(-0.2, 0.2, 3).tolist()}
    return {"link": link, "axes": (axes * np.linalg.det(axes)).tolist(), "bodies": bodies, "base": base}


@pytest.mark.parametrize("seed", range(60 if THOROUGH else 4))
def test_no_corner_of_the_uncertainty_is_worse_than_is_proved(seed):
    rng = np.random.default_rng(seed)
    model = _random_model(rng)
    n = len(model["arm"]["armature"])
    motion, carried = _random_motion(n, rng), _random_object(model, rng)
    if seed % 2:
        model, motion = driving(model, motion, rng)
    share = rng.uniform(0, 0.3) if seed % 3 else 0.0
    kinds = ("payload_mass", "payload_center", "speed", "drive_speed", "tilt")
    tolerance = {**NONE, **{name: (share * np.array(KINDS[name])).tolist() for name in kinds}}
    t = rng.uniform(0, motion["times"][-1][1])
    [rows] = Late(motion, 0.0, 0.0).rows(np.array([t - 1e-7]), np.array([t + 1e-7]))
    within = Within(model, tolerance, motion, carried)
    terms, h = within.terms(rows), rng.normal(size=(5, 6)) * [1, 1, 1, 5, 5, 5]
    proved = within.least(terms, h[:, :, None], np.zeros((2, 5, 1)))[:, 0]
    own, count, k = ArmOnBase(model, tolerance), 1500, len(carried["bodies"])
    q, qd, qdd = (np.repeat(form.c[0].T, count, axis=0) for form in (rows.q, rows.qd, rows.qdd))
    joints = q[:, :n], qd[:, :n], qdd[:, :n]
    moved = own.driven(*joints, qd[:, n:], qdd[:, n:]) if seed % 2 else own.moved(*joints)
    masses = 1 + tolerance["payload_mass"] * rng.choice([-1, 1], (count, k))
    shifts = np.array(tolerance["payload_center"]) * rng.choice([-1, 1], (count, k, 3))
    found = own.on_object(carried, own.corners(count, rng), moved, masses, shifts) @ h.T
    size = np.abs(h) @ terms.size[:, 0]
    assert np.all(found.min(axis=0) >= proved - 1e-9 * size)
    assert np.all(found.min(axis=0) - proved <= (0.1 if share else 1e-6) * size)


# --- a box by hand ------------------------------------------------------------------------------------------


def _box(link=0):
    """A cube of 1 kg and 0.1 m on the deck."""
    frame = np.roll(np.eye(3), 1, axis=0).T.tolist()
    corners = [[x, y, 0.0] for x, y in ((0.05, 0.05), (-0.05, 0.05), (-0.05, -0.05), (0.05, -0.05))]
    center, inertia = [0.0, 0.0, 0.05], (np.eye(3) / 600).tolist()
    return {
        "name": "box",
        "link": link,
        "axes": np.eye(3).tolist(),
        "bodies": [{"mass": 1.0, "center": center, "inertia": inertia}],
        "base": {
            "mass": 1.0,
            "center_of_mass": center,
            "gravity": [0.0, 0.0, -9.81],
            "reference_moment": 0.1,
        },
        "contacts": {"positions": corners, "frames": [frame] * 4, "sets": [[[0.0, None, 0.0, 0.5]]] * 4},
    }


def _with_box(data, nominal, worst=None):
    """With a box, the same forces and weights in all rows, and claims of moments, N m."""
    box, covers, end = _box(), {"cover_within": None}, data["motion"]["times"][-1][0]
    data["model"]["objects"] = [box]
    kinds = [("cover", NOTHING, nominal)] + ([("cover_within", data["tolerance"], worst)] if worst else [])
    for key, world, moment in kinds:
        tip, slip = claims_of(box, key != "cover")
        data["bounds"] |= {tip: 0.1 / (0.1 + moment), slip: 0.98}
        claims = {"GN_worst_case": data["bounds"][tip], "GT_worst_case": 0.98}
        late = Sharing(data["model"], data["motion"], world, claims, box).late
        ends = [late.start, 0.0, end, late.end] if late.start else [0.0, end, late.end]
        [rows] = late.rows(np.array(ends[:-1]), np.array(ends[1:]))
        count = len(rows.number)
        forces, weights = np.zeros((count, 2, 1, 4, 3)).tolist(), np.ones((count, 4, 2)).tolist()
        apart = [list(range(late.joints))] * (len(ends) - 1)
        covers[key] = {"ends": ends, "apart": apart, "forces": forces, "weights": weights}
    data["objects"] = [covers]
    return data


@cache
def _data():
    """On a base that speeds up by 2.5 m/s^2, within an uncertainty of its speed and of the box."""
    more = {"drive_speed": 0.03, "payload_mass": 0.1, "payload_center": [0.002, 0.0, 0.0]}
    data = _driving(_within([1e-9], 0.01, **more), 2.5)
    end = data["motion"]["times"][-1][0]
    data["bounds"]["GN"] = 0.5
    _judged_within(data, [-1.0, 0.0, end, end + 1.0], 0.3)
    return data


LEFT = 0.05 * (9.81 - 2.5)
TRUE = 0.9 * (0.048 * 9.81 - 0.05 * 2.5 * 1.03**2)
WORST = TRUE - 0.2 * 0.002 * 9.81  # products of mass and place are bounded as those of the largest mass


@pytest.mark.parametrize(
    ("nominal", "worst", "problems"),
    [
        (LEFT - 1e-4, WORST - 1e-4, ""),
        (LEFT + 1e-4, WORST - 1e-4, "box: tip-over:"),
        (LEFT - 1e-4, TRUE + 1e-4, "box: tip-over within"),
    ],
)
def test_a_box_by_hand(nominal, worst, problems):
    verdict = _judged(_with_box(copy.deepcopy(_data()), nominal, worst))
    assert verdict.holds == (not problems), verdict.problems
    assert problems in str(verdict.problems)
    if verdict.holds:
        assert verdict.moments["GN_worst_case[box]"] == pytest.approx(worst)


def _dropped(data):
    data["model"]["objects"] = []


def _dropped_with_proof(data):
    data["model"]["objects"], data["objects"] = [], []


def _twice(data):
    data["model"]["objects"] *= 2
    data["objects"] *= 2


_CHANGES = {
    "an object dropped": _dropped,
    "an object dropped with its proof": _dropped_with_proof,
    "an object twice": _twice,
    **{
        f"{place} = {value!r}": lambda data, place=place, value=value: _set(place, value, data)
        for place, value in (
            ("objects", []),
            ("objects.0.cover", None),
            ("objects.0.cover_within", None),
            ("objects.0.cover.ends", [0.0, 0.02]),
            ("objects.0.cover.forces", []),
            ("objects.0.cover.weights", [[[0.0, 0.0]] * 4] * 3),
            ("bounds.GN[box]", 1.0),
            ("bounds.GT[box]", 0.4),
            ("bounds.GT_worst_case[box]", 0.5),
            ("model.objects.0.name", ""),
            ("model.objects.0.name", "glass"),
            ("model.objects.0.link", 2),
            ("model.objects.0.link", -1),
            ("model.objects.0.axes", np.diag([1.0, 1.0, -1.0]).tolist()),
            ("model.objects.0.bodies", []),
            ("model.objects.0.bodies.0.mass", -1.0),
            ("model.objects.0.bodies.0.center", [0.0, 0.0, 0.09]),
            ("model.objects.0.bodies.0.center", [0.0, 0.0]),
            ("model.objects.0.base.reference_moment", None),
            ("model.objects.0.contacts.sets", [[[0.0, None, 0.0, 0.2]]] * 4),
            ("model.objects.0.contacts.sets", [[[0.0, None, 0.0, 0.5]]] * 3),
            ("tolerance.payload_center", [0.02, 0.0, 0.0]),
            ("tolerance.drive_speed", 0.2),
            ("tolerance.tilt", 0.1),
        )
    },
}


@pytest.mark.parametrize("name", _CHANGES)
def test_it_is_refused(name):
    data = _with_box(copy.deepcopy(_data()), LEFT - 1e-3, WORST - 1e-3)
    assert _judged(data).holds
    data = copy.deepcopy(data)
    _CHANGES[name](data)
    verdict = _judged(data)
    assert not verdict.holds
    assert verdict.problems


# --- a glass on a tray --------------------------------------------------------------------------------------

_UNCERTAIN = Uncertainty(
    tilt=0.005, friction=0.1, speed=0.02, payload_mass=0.05, payload_center=(0.002, 0.001, 0.0)
)


@cache
def _proved():
    """A UR5 that swings a tray with a glass."""
    task = ocptip.load_task(EXAMPLES / "tasks" / "ur5_waiter.toml", uncertainty="none").segments[0].task
    robot = task.robot.without_objects().carrying(task.robot.objects[:1])
    start, goal = (np.asarray(q, dtype=float) for q in (task.start, task.goal))
    u = np.array([0.0, 0.25, 0.75, 1.0])
    shares = 10 * u**3 - 15 * u**4 + 6 * u**5, 30 * u**2 * (1 - u) ** 2, 60 * u * (1 - u) * (1 - 2 * u)
    states = [np.outer(share, 0.04 * (goal - start)) / 0.3**k for k, share in enumerate(shares)]
    motion = Trajectory.from_points(0.3 * u, start + states[0], *states[1:])
    limits = Limits(tolerance=_UNCERTAIN)
    return robot, motion, certified(robot, motion, check_motion(robot, motion, limits), limits)


@pytest.mark.slow
def test_a_glass_on_a_tray_is_proved():
    checked = _proved()[2]
    assert checked.headline.startswith("PROVED for the given uncertainty"), checked.certificate
    verdict = check_certificate(checked.certificate.data)
    assert verdict.holds
    for name in ("GN", "GT", "GN_worst_case", "GT_worst_case"):
        bound = verdict.bounds[f"{name}[glass_left]"]
        assert 0.9 * bound <= checked.worst[f"{name}[glass_left]"].value <= bound, name
    titles = [row[0] for row in claim_rows(verdict)]
    assert titles[-2:] == ["Tipping margin, glass_left", "Friction used, glass_left"]


@pytest.mark.slow
def test_no_world_loses_the_glass_as_the_contact_solver_sees_it():
    """Random instants and corners of the uncertainty, wrenches of an independent model, Lemke's solver."""
    robot, motion, checked = _proved()
    data, rng, count = checked.certificate.data, np.random.default_rng(7), 600
    [carried], own = data["model"]["objects"], ArmOnBase(data["model"], data["tolerance"])
    moved = own.moved(*motion.states(rng.uniform(0, motion.end, count)))
    half = np.array(_UNCERTAIN.payload_center)
    off = (
        1 + _UNCERTAIN.payload_mass * rng.choice([-1, 1], (count, 1)),
        half * rng.choice([-1, 1], (count, 1, 3)),
    )
    turn, footing = robot.arm.tool_rotation, robot.interfaces[1]
    for within, worlds, (masses, shifts) in (
        (False, own.nominal(count), (np.ones((count, 1)), np.zeros((count, 1, 3)))),
        (True, own.corners(count, rng), off),
    ):
        wrench = own.on_object(carried, worlds, moved, masses, shifts)
        wrench = np.hstack([wrench[:, :3] @ turn, wrench[:, 3:] @ turn])  # in gripper axes
        held = footing.weakest(_UNCERTAIN) if within else footing
        states = held.contact_states(wrench)
        tip, slip = (data["bounds"][name] for name in claims_of(carried, within))
        used = held.slip.evaluate(states, derivatives=False).slip_ratio
        tipping = held.tip_over.evaluate(states).tip_ratio
        assert 0.7 * slip <= np.max(used) <= slip
        assert 0.7 * tip <= np.max(tipping) <= tip


@pytest.mark.slow
def test_a_proof_of_another_glass_is_refused():
    data = dict(_proved()[2].certificate.data)
    for place, value in (
        ("model.objects.0.bodies.0.center", [0.0, 0.0, 0.3]),
        ("model.objects.0.contacts.sets", [[[0.0, None, 0.0, 0.1]]] * 8),
        ("model.arm.mount_rotation", [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    ):
        changed = copy.deepcopy(data)
        _set(place, value, changed)
        assert not _judged(changed).holds, place


# --- anything changed ---------------------------------------------------------------------------------------

_FACTORS = (1 + 1e-6, 1 - 1e-6, 1.1, 0.9, -1.0, 0.0, 3.0)
_PLACES = ("motion.base_velocities", "tolerance", "bounds", "model.objects.0.bodies", "model.base.inertia")


def _leaves(value, place=()):
    """Places of all numbers."""
    if isinstance(value, float | int):
        yield place
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in items:
        yield from _leaves(part, (*place, key))


def _part(data, place):
    for key in place:
        data = data[int(key) if str(key).isdigit() else key]
    return data


def _least(data, box, rng, within):
    """Moments about edges of the box, and the share of friction it needs, of random worlds, by no code of the
    checker."""
    own, (times, count) = ArmOnBase(data["model"], data["tolerance"]), (np.array(data["motion"]["times"]), 60)
    piece = rng.integers(0, len(times), count)
    half, u = 0.5 * np.diff(times[piece], axis=1), rng.choice([-1.0, 0.0, 1.0], (count, 1))
    rows = np.array([[np.pad(c, (0, 2 - len(c))) for c in v] for v in data["motion"]["base_velocities"]])[
        piece
    ]
    rates = np.divide(rows[:, :, 1], half, out=np.zeros((count, 3)), where=half > 0)
    moved = own.driven(*np.zeros((3, count, 1)), rows[:, :, 0] + u * rows[:, :, 1], rates)
    worlds = own.corners(count, rng) if within else own.nominal(count)
    share, size = (data["tolerance"][key] for key in ("payload_mass", "payload_center"))
    masses = 1 + within * share * rng.choice([-1, 1], (count, 1))
    shifts = within * np.array(size) * rng.choice([-1, 1], (count, 1, 3))
    wrench = own.on_object(box, worlds, moved, masses, shifts)
    force, moment = wrench[:, :3], wrench[:, 3:] + np.cross(box["base"]["center_of_mass"], wrench[:, :3])
    reach = -0.05 * force[:, 2]
    edges = np.array([reach - side * moment[:, axis] for axis in (0, 1) for side in (-1, 1)])
    friction = 0.5 * (1 - within * data["tolerance"]["friction"])
    return np.min(edges), np.max(
        np.linalg.norm(force[:, :2], axis=1) / np.maximum(-friction * force[:, 2], 1e-9)
    )


@pytest.mark.slow
def test_what_is_accepted_of_changed_proofs_is_so():
    rng, accepted, refused = np.random.default_rng(0), 0, 0
    original = _with_box(copy.deepcopy(_data()), LEFT - 0.01, WORST - 0.01)
    [box] = original["model"]["objects"]
    places = [
        (*way.split("."), *leaf) for way in _PLACES for leaf in _leaves(_part(original, way.split(".")))
    ]
    for _ in range(400 if THOROUGH else 40):
        data = copy.deepcopy(original)
        *way, last = places[rng.integers(len(places))]
        holder, last = _part(data, way), int(last) if str(last).isdigit() else last
        holder[last] = float(rng.choice(_FACTORS)) * holder[last] + float(rng.choice([0.0, 1e-3]))
        verdict = _judged(data)
        refused += not verdict.holds
        if not verdict.holds:
            continue
        accepted += 1
        [box] = data["model"]["objects"]
        for within in (False, True):
            moment, used = _least(data, box, rng, within)
            tip, slip = claims_of(box, within)
            assert moment >= verdict.moments[tip] - 1e-9, (way, last, within)
            assert used <= verdict.bounds[slip] + 1e-9, (way, last, within)
    assert accepted >= 8
    assert refused >= 8
