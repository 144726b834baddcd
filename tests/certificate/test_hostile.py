"""Certificates made by hand to be accepted though what they claim is not so: all are refused."""

import copy
from functools import partial
from itertools import pairwise

import numpy as np
import pytest

from ocptip.certificate.trusted.checker import FORMAT, check_certificate, digest
from ocptip.certificate.trusted.late import REST, Late
from ocptip.certificate.trusted.sharing import Sharing
from tests.certificate.test_by_hand import BASE, MASS, G
from tests.certificate.test_by_hand import _model as model_by_hand


def _certificate():
    """The mass of the page at rest on a base, balls about it and about a place of the base."""
    model = model_by_hand()
    model["bodies"] = [
        {"link": 1, "points": [[0.0, 0.0, 0.0]], "radius": 0.1},
        {"link": -1, "points": [[0.5, 0.0, 0.5], [0.7, 0.0, 0.5]], "radius": 0.1},
        {"normal": [0.0, 0.0, -1.0], "level": 0.0},
    ]
    model["pairs"] = [[0, 1], [0, 2]]
    model["points"] = [{"link": 1, "place": [0.0, 0.1, 0.0], "speed": 0.02}]
    weights = _weights()
    forces = [[[[f, 0.0, 0.0] for f in weights]]] * 2
    cover = {"ends": [-1.0, 1.0], "forces": [forces], "directions": [[0, 0, 0.0, 1.0, 0.0, 0.0]]}
    return {
        "format": FORMAT,
        "model": model,
        "motion": {
            "times": [[0.0, 0.0], [0.0, 0.02], [0.02, 0.02]],
            "angles": [[[0.0, 0.0, 0.0]]] * 3,
        },
        "tolerance": None,
        "cover_within": None,
        "bounds": {"GN": 0.4, "GT": 0.1, "torque_ratio": 0.1, "clearance": 0.09, "point_speed_ratio": 0.5},
        "cover": [cover] * 3,
    }


def _weights():
    """Normal forces that hold the weights at x = 0.1 m and x = 0.2 m."""
    front = G * (BASE * 0.1 + MASS * 0.2) / 0.4
    rear = (BASE + MASS) * G - front
    return [rear / 2, rear / 2, front]


def _judged(data):
    data["sha256"] = {key: digest(data[key]) for key in ("model", "motion", "tolerance")}
    return check_certificate(data)


def test_the_certificate_by_hand_holds():
    verdict = _judged(_certificate())
    assert verdict.holds, verdict.problems
    assert verdict.intervals == 3


def _set(place, value, data):
    *way, last = place.split(".")
    for key in way:
        data = data[int(key) if key.isdigit() else key]
    data[int(last) if last.isdigit() else last] = value


def _fewer_forces(data):
    data["cover"][1]["ends"] = [-1.0, 0.0, 0.5, 1.0]


def _forces_of_few_contacts(data):
    for part in data["cover"]:
        part["forces"] = [[[[1e3, 0.0, 0.0]]]] * 2


def _no_forces(data):
    for part in data["cover"]:
        part["forces"] = []


def _creeping(data):
    """By jumps of less than 1 um each: enough of them would go anywhere."""
    angles = [[[7e-7 * k, 0.0, 0.0]] for k in range(5)]
    data["motion"] = {
        "times": [[0, 0], [0, 0.1], [0.1, 0.2], [0.2, 0.3], [0.3, 0.3]],
        "angles": angles,
    }
    data["cover"] = [data["cover"][0]] * 5


def _accelerating(data):
    """Speeds that jump, without accelerations."""
    times = [[0, 0], [0, 1e-4], [1e-4, 2e-4], [2e-4, 3e-4], [3e-4, 3e-4]]
    place, angles = 0.0, [[[0.0, 0.0, 0.0]]]
    for speed in (9e-5, 18e-5, 9e-5):
        angles.append([[place + speed * 5e-5, speed * 5e-5, 0.0]])
        place += speed * 1e-4
    data["motion"] = {"times": times, "angles": [*angles, [[place, 0.0, 0.0]]]}
    data["cover"] = [data["cover"][0]] * 5


def _overlapping(direction, data):
    """Two balls of 0.1 m, 0.05 m apart, seen along a direction of hardly any length."""
    data["model"]["bodies"][1] = {"link": -1, "points": [[0.25, 0.0, 0.5]], "radius": 0.1}
    data["cover"] = [{**part, "directions": [[0, 0, 0.0, *direction]]} for part in data["cover"]]


def _scaled_half_space(data):
    data["bounds"]["clearance"] = 0.3
    data["model"]["bodies"][1]["points"] = [[2.0, 0.0, 0.5]]
    data["model"]["bodies"][2] = {"normal": [0.0, 0.0, 5.0], "level": 4.0}


def _scaled_frames(data):
    data["model"]["contacts"]["frames"] = [[[0.0, 9.0, 0.0], [0.0, 0.0, 9.0], [1.0, 0.0, 0.0]]] * 3


def _on_one_line(data):
    data["model"]["contacts"]["positions"] = [[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.4, 1e-10, 0.0]]


def _dropped_last_link(data):
    arm = data["model"]["arm"]
    for key in ("rotations", "offsets", "centres", "inertias", "slides", "ratios", "shift"):
        arm[key] = arm[key] * 2


def _weightless_overflow(data):
    data["model"]["base"]["mass"] = 1e160


def _pushed_at(times, data):
    """A process that lifts the base, at the last or the first of these times."""
    force = 1e4 * np.eye(6)[2]
    rest = np.zeros(6)
    rows = [rest, force] if times[-1] > 0 else [force, rest]
    arm = {"process_times": times, "process_in_base": rows, "process_on_link": [rest, rest]}
    data["model"]["arm"] |= {key: np.array(value).tolist() for key, value in arm.items()}


def _in_years(data):
    """Times that are rounded by more than a delay is looked at further."""
    data["motion"]["times"] = [[0.0, 0.0], [0.0, 5e8], [5e8, 5e8]]


def _speed_without_points(data):
    del data["model"]["points"]


def _worst_speed_without_points(data):
    data["model"]["points"] = []
    del data["bounds"]["point_speed_ratio"]
    data["bounds"]["point_speed_ratio_worst_case"] = 0.5


def _points_without_speed(data):
    del data["bounds"]["point_speed_ratio"]


def _one_joint_more(data):
    data["motion"]["angles"] = [[*own, *own] for own in data["motion"]["angles"]]


_CHANGES = {
    "fewer forces than intervals": _fewer_forces,
    "forces of one contact": _forces_of_few_contacts,
    "no forces": _no_forces,
    "creeping by jumps": _creeping,
    "speeding up by jumps": _accelerating,
    "tiny direction": partial(_overlapping, [1.5e-162, 0.0, 0.0]),
    "no direction": partial(_overlapping, [0.0, 0.0, 0.0]),
    "huge direction": partial(_overlapping, [1e200, 0.0, 0.0]),
    "half space not of length 1": _scaled_half_space,
    "frames not of length 1": _scaled_frames,
    "contacts on a line": _on_one_line,
    "a link dropped": _dropped_last_link,
    "a mass that overflows": _weightless_overflow,
    "a joint more": _one_joint_more,
    "speed without points": _speed_without_points,
    "worst speed without points": _worst_speed_without_points,
    "points without speed": _points_without_speed,
    "a process after the motion": partial(_pushed_at, [0.02, 0.5]),
    "a process before the motion": partial(_pushed_at, [-1.0, 0.0]),
    "a motion of years": _in_years,
    **{
        f"{place} = {value!r}": partial(_set, place, value)
        for place, value in (
            ("bounds.torque_ratio", -1.0),
            ("bounds.torque_ratio", True),
            ("bounds.torque_ratio", float("nan")),
            ("bounds.GN", 0.0),
            ("bounds.point_speed_ratio", 0.0),
            ("bounds.point_speed_ratio", float("inf")),
            ("bounds.point_speed_ratio_worst_case", 0.5),
            ("model.points.0.link", 0),
            ("model.points.0.link", -1),
            ("model.points.0.link", 2),
            ("model.points.0.place", [0.1]),
            ("model.points.0.speed", 0.0),
            ("model.points.0.speed", -1.0),
            ("model.points.0.speed", None),
            ("model.points", [{}]),
            ("bounds.GT", "0.5"),
            ("bounds.clearance", float("-inf")),
            ("model.base.reference_moment", -1.0),
            ("model.base.reference_moment", 0.0),
            ("model.base.reference_moment", None),
            ("model.base.gravity", [-9.81]),
            ("model.base.center_of_mass", [0.1]),
            ("model.base.mass", [3.0]),
            ("model.base.mass", -1.0),
            ("model.arm.masses", [-1.0]),
            ("model.arm.masses", []),
            ("model.arm.slides", [0.5]),
            ("model.arm.slides", ["1"]),
            ("model.arm.mount_position", [0.2]),
            ("model.arm.mount_rotation", [[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]),
            ("model.arm.mount_rotation", [[1, 0, 0], [0, 1, 0], [0, 0, -1]]),
            ("model.limits.speed", [-1.0]),
            ("model.limits.torque", [-1.0]),
            ("model.limits.acceleration", [1.0, 1.0]),
            ("model.limits.angle_max", []),
            ("model.contacts.sets.0", []),
            ("model.contacts.sets.0", [[None, None, 0.0]]),
            ("model.contacts.sets", [[[0.0, None, 0.0, 0.5]]]),
            ("model.contacts.sets.0.0.2", "1"),
            ("model.contacts.sets.0.0.3", -0.5),
            ("model.bodies.0.radius", -0.2),
            ("model.bodies.0.link", -2),
            ("model.bodies.0.link", 2),
            ("model.bodies.0.link", True),
            ("model.bodies.0.points", []),
            ("model.bodies.0.points", [[0.0]]),
            ("model.bodies.0", {"points": [[0.0, 0.0, 0.0]], "radius": 0.1}),
            ("model.bodies.2.normal", [0.0, 0.0, 0.0]),
            ("model.pairs", [[0, -2]]),
            ("model.pairs", [[0, 3]]),
            ("model.pairs", [[0, 0]]),
            ("model.pairs", [[2, 0]]),
            ("model.pairs", [[0.2, 1.3]]),
            ("model.pairs", [0, 1]),
            ("model.pairs", []),
            ("motion.times", [[0.0, 0.0], [0.0, -0.02], [-0.02, -0.02]]),
            ("motion.times", [[1.0, 1.0], [1.0, 1.02], [1.02, 1.02]]),
            ("motion.times", [[0.0, 0.0], [0.01, 0.02], [0.02, 0.02]]),
            ("motion.angles.0", [[0.0, 0.1, -0.1]]),
            ("motion.angles", [[[0.0]]] * 3),
            ("motion.angles", [[[0.0] * 7]] * 3),
            ("cover", []),
            ("cover.1", {"ends": [-1.0, 1.0], "forces": [], "directions": []}),
            ("cover.1.directions", [[0, -2, 0.0, 1.0, 0.0, 0.0]]),
            ("cover.1.directions", [[0, 0, 1.0]]),
            ("cover", "none"),
            ("model", []),
            ("bounds", None),
        )
    },
}


@pytest.mark.parametrize("name", _CHANGES)
def test_it_is_refused(name):
    data = copy.deepcopy(_certificate())
    data["cover"] = copy.deepcopy([dict(part) for part in data["cover"]])
    _CHANGES[name](data)
    verdict = _judged(data)
    assert not verdict.holds
    assert all(len(problem.splitlines()) == 1 for problem in verdict.problems)
    assert verdict.problems


# --- within tolerances --------------------------------------------------------------------------------------


def _within(accelerations, half, **tolerance):
    """The mass on its slide, pieces of constant acceleration one after the other, 2 half seconds each."""
    data = _certificate()
    angles, q, v = [[[0.0, 0.0, 0.0]]], 0.0, 0.0
    for a in accelerations:
        bent = 0.5 * a * half**2
        angles.append([[q + v * half + bent, v * half + 2 * bent, bent]])
        q, v = q + 2 * v * half + 4 * bent, v + 2 * half * a
    ends = [2 * half * k for k in range(len(accelerations) + 1)]
    times = [[0.0, 0.0], *([a, b] for a, b in pairwise(ends)), [ends[-1], ends[-1]]]
    data["motion"] = {"times": times, "angles": [*angles, [[q, 0.0, 0.0]]]}
    data["cover"] = [data["cover"][0]] * len(times)
    none = dict.fromkeys(("friction", "arm_mass", "payload_mass", "speed", "tilt", "delay", "overshoot"), 0.0)
    none |= dict.fromkeys(("extra_mass", "push", "base_push"), 0.0)
    boxes = {key: [0.0] * 3 for key in ("center_of_mass", "payload_center")}
    data["tolerance"] = {**none, **boxes, "base_mass": [0.0, 0.0], **tolerance}
    data["bounds"] |= {"GN": 0.5, "GT": 0.7, "clearance": 0.05, "GT_worst_case": 0.9}
    return data


def _judged_within(data, ends, bound):
    """With one choice of forces and weights in all rows there are."""
    data["bounds"]["GN_worst_case"] = bound
    late = Sharing(data["model"], data["motion"], data["tolerance"], data["bounds"]).late
    [rows] = late.rows(np.array(ends[:-1]), np.array(ends[1:]))
    count = len(rows.number)
    forces = [[[[f, 0.0, 0.0] for f in _weights()]]] * 2
    named = {"forces": [forces] * count, "weights": [[[1.0, 1.0]] * 3] * count}
    data["cover_within"] = {"ends": ends, "apart": [list(range(late.joints))] * (len(ends) - 1), **named}
    return _judged(data)


@pytest.mark.parametrize(("delay", "worst"), [(0.0, 0.331), (0.01, 0.86)])
def test_speeds_of_points_are_bounded_by_the_speed_of_their_link(delay, worst):
    """The mass reaches 6 mm/s: 0.3 of 20 mm/s; with a speed factor of 1.1, 0.33; delays add to that bound."""
    data = _within([1.0, -1.0], 0.003, speed=0.1, delay=delay)
    end = data["motion"]["times"][-1][0]
    ends = [0.0, end + 1.1 * delay + 2e-9] if delay else [-REST, end, end + REST]
    for bounds, holds in (((0.301, worst), True), ((0.299, worst), False), ((0.301, 0.329), False)):
        data["bounds"] |= dict(
            zip(("point_speed_ratio", "point_speed_ratio_worst_case"), bounds, strict=True)
        )
        problems = _judged_within(data, ends, 0.5).problems
        assert any("speed of points" in text for text in problems) != holds


def test_rest_is_within_the_tolerance_if_nothing_is_late():
    """At rest 6.867 N m are left about the rear line; only while it goes back, for 40 us, more than 7 N m."""
    data = _within([-1.0], 2e-5)
    moving, resting = (0.49 / (0.49 + moment) for moment in (7.0, 6.86))
    end = data["motion"]["times"][-1][0]
    verdict = _judged_within(data, [0.0, end], moving)
    assert "not covered" in verdict.problems[0]
    ends = [-REST, 0.0, end, end + REST]
    assert "tip-over within tolerance" in _judged_within(data, ends, moving).problems[0]
    assert _judged_within(data, ends, resting).holds


def test_steps_within_a_delay_add_up_from_each_of_them():
    """Steps of -1, 1, 1, -1 m/s^2, the second and the third within the delay, not the first: 2 m/s^2 more."""
    data = _within([-1.0, 0.0, 1.0], 0.003, delay=0.01, overshoot=1.0)
    late = data["motion"]["times"][-1][0] + 0.01 + 2e-9
    apart, together = (0.49 / (0.49 + 6.867 - a - 0.05) for a in (1 + 1, 1 + 2))
    assert _judged_within(data, [0.0, late], together).holds
    assert "tip-over within tolerance" in _judged_within(data, [0.0, late], apart).problems[0]


def test_what_steps_hardly_add_up_to_is_not_lost():
    data = _within([1.0, 5e-6], 0.002, delay=0.01, overshoot=1.0)  # 1, then nearly -1
    [at] = Late(data["motion"], 0.01, 1.0).rows(np.array([0.004]), np.array([0.005]))
    _, high = at.qdd.range
    resting = np.isclose(at.qdd.c[0, 0], 5e-6, atol=1e-9)
    assert np.any(resting & (high[0] >= 1e-5 - 1e-12))
