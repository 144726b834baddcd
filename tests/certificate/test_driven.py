"""Proofs of a base that drives: the mass of the page on proofs by hand, on a base that speeds up."""

import copy
from functools import cache

import numpy as np
import pytest

from ocptip.certificate.checks import certified
from ocptip.certificate.trusted.checker import check_certificate
from ocptip.certificate.trusted.described import TORQUES, Checker, Intervals
from ocptip.certificate.trusted.late import Late
from ocptip.motion.check import check_motion
from ocptip.published.tasks import experiment_task
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.torques import maximum_torques
from ocptip.trajectories.drive_profile import DriveProfile
from ocptip.trajectories.trajectory import Trajectory
from tests.certificate.test_hostile import _certificate, _judged, _judged_within, _set, _within
from tests.certificate.test_within_attacked import NONE, driving
from tests.certificate.test_within_in_balls import _random_model, _random_motion
from tests.oracles.worlds import ArmOnBase
from tests.quick import some

LEFT = 6.867  # N m about the rear line at rest; 1 m/s^2 forward takes 2 kg * 0.5 m of it


def _index(moment):
    return 0.49 / (0.49 + moment)


def _driving(data, rate, spin=0.0):
    """The same on a base that speeds up while the motion lasts, and turns all the time."""
    data = copy.deepcopy(data)
    end = data["motion"]["times"][-1][0]
    rows = []
    for a, b in data["motion"]["times"]:
        middle = np.clip(0.5 * (a + b), 0, end)
        rows.append([[rate * middle, rate * 0.5 * (b - a)], [0.0, 0.0], [spin, 0.0]])
    data["motion"]["base_velocities"] = rows
    data["model"]["base"]["inertia"] = np.diag([0.1, 0.1, 0.2]).tolist()
    data["bounds"] |= {"GT": 0.9, "torque_ratio": 0.5}
    return data


@pytest.mark.parametrize(("moment", "holds"), [(2.866, True), (2.868, False)])
def test_a_base_that_speeds_up_by_hand(moment, holds):
    """At 4 m/s^2 the front foot carries little; friction speeds 5 kg up by 20 N."""
    data = _driving(_certificate(), 4.0)
    front = (LEFT - 4) / 0.4
    normal = np.array([0.5 * (5 * 9.81 - front)] * 2 + [front])
    forces = np.column_stack([normal, 20 * normal / (5 * 9.81), 0 * normal]).tolist()
    data["cover"][1] = {**data["cover"][1], "forces": [[[forces], [forces]]]}
    data["bounds"]["GN"] = _index(moment)
    verdict = _judged(data)
    assert ("tip-over" in str(verdict.problems)) != holds
    assert not any("contacts" in problem for problem in verdict.problems), verdict.problems


def test_the_uncertainty_of_the_speed_and_the_overshoot_of_a_base_by_hand():
    """Faster by 3 %: 1.03^2 of 4 m/s^2. A step of 3 m/s^2 that overshoots by as much: 6 m/s^2."""
    for rate, worst, more in ((4.0, 4 * 1.03**2, {"drive_speed": 0.03}), (3.0, 6.0, {"overshoot": 1.0})):
        for slack, holds in ((0.01, True), (-0.01, False)):
            data = _driving(_within([1e-9], 0.01, **more), rate)
            data["bounds"]["GN"] = _index(LEFT - rate - 0.1)
            end = data["motion"]["times"][-1][0]
            ends = [0.0, end + 2e-9] if "overshoot" in more else [-1.0, 0.0, end, end + 1.0]
            problems = str(_judged_within(data, ends, _index(LEFT - worst - slack)).problems)
            assert ("tip-over within tolerance" in problems) != holds, (problems, more)


def test_nominal_wrenches_are_those_of_an_independent_model():
    rng = np.random.default_rng(2)
    for _ in range(4):
        model = _random_model(rng)
        n = len(model["arm"]["armature"])
        model, motion = driving(model, _random_motion(n, rng), rng)
        model["base"]["reference_moment"] = 1.0
        frame = np.roll(np.eye(3), 1, axis=0).T.tolist()
        places = [[0.3, 0.3, 0.0], [-0.3, 0.3, 0.0], [0.0, -0.3, 0.0]]
        contacts = {"positions": places, "frames": [frame] * 3, "sets": [[[0.0, None, 0.0, 0.5]]] * 3}
        keys = ("angle_min", "angle_max", "speed", "acceleration", "torque")
        limits = dict.fromkeys(keys, [None] * n)
        model |= {"contacts": contacts, "bodies": [], "pairs": [], "limits": limits}
        checker = Checker(model, {"GN": 0.5, "GT": 0.5})
        piece, u = rng.integers(1, 5, 6), rng.uniform(-0.9, 0.9, 6)
        at = Intervals(motion, piece, u - 1e-6, u + 1e-6)
        own = ArmOnBase(model, NONE)
        times = np.array(motion["times"])[piece]
        half = 0.5 * (times[:, 1] - times[:, 0])
        c = np.polynomial.Polynomial
        rows = [[c(row) for row in motion["base_velocities"][k]] for k in piece]
        v = np.array([[p(x) for p in row] for row, x in zip(rows, u, strict=True)])
        dv = np.array([[p.deriv()(x) / h for p in row] for row, x, h in zip(rows, u, half, strict=True)])
        moved = own.driven(*(form.c[0].T for form in (at.q, at.qd, at.qdd)), v, dv)
        acting = [np.asarray(own.arm.get(k, np.zeros(6))) for k in ("process_in_base", "process_on_link")]
        found = own.wrench(own.nominal(6), moved, np.tile(np.concatenate(acting), (6, 1)))
        wrench = checker.loads(at).wrench
        np.testing.assert_allclose(wrench.c[0].T, found, rtol=1e-9, atol=1e-9)
        assert np.all(wrench.r <= 1e-6 * (1 + np.abs(wrench.c[0])))


def test_rows_hold_every_state_of_a_base_that_drives():
    rng = np.random.default_rng(5)
    motion = driving(_random_model(rng), _random_motion(3, rng), rng)[1]
    for k, row in enumerate(motion["base_velocities"]):  # steps of the accelerations
        row[0] = [0.1 * k, 0.05 if 0 < k < len(motion["times"]) - 1 else 0.0, 0.0, 0.0]
    late = Late(motion, 0.01, 0.5)
    ends = np.linspace(-0.5 * late.delay, late.end, 60)
    apart = rng.random((len(ends) - 1, late.joints)) < 0.5
    low, high = np.full((2, 2, len(ends) - 1, 3), np.inf)
    for rows in late.rows(ends[:-1], ends[1:], apart):
        for k, form in enumerate((rows.qd, rows.qdd)):
            least, most = form.range
            np.minimum.at(low[k], rows.interval, least[3:].T)
            np.minimum.at(high[k], rows.interval, -most[3:].T)
    times = np.array(motion["times"])
    for t in rng.uniform(0, times[-1, 1], 200):
        piece = int(np.searchsorted(times[:-1, 1], t))
        half = 0.5 * (times[piece, 1] - times[piece, 0])
        u = (t - 0.5 * times[piece].sum()) / half
        interval = np.searchsorted(ends, t) - 1
        for axis, row in enumerate(motion["base_velocities"][piece]):
            p = np.polynomial.Polynomial(row)
            for k, value in enumerate((p(u), p.deriv()(u) / half)):
                assert low[k, interval, axis] <= value + 1e-9
                assert -high[k, interval, axis] >= value - 1e-9


@pytest.mark.parametrize("overshoot", [0.0, 0.5])
def test_what_a_base_does_before_a_motion_is_a_case_of_its_first_instant(overshoot):
    motion = _driving(_within([1.0, -1.0], 0.01), 5.0)["motion"]
    late = Late(motion, 0.005, overshoot)
    found = [
        np.concatenate(form.range)
        for rows in late.rows(np.array([late.start]), np.array([1e-3]))
        for form in [rows.qdd[1:2]]
    ]
    low, high = np.min([own[0] for own in found]), np.max([own[1] for own in found])
    assert low <= 0
    assert high >= 5


def _without_inertia(data):
    del data["model"]["base"]["inertia"]


def _stepping(data):
    """Speeds that step, without accelerations."""
    data["motion"]["base_velocities"] = [[[v], [0.0], [0.0]] for v in (0.0, 1.0, 0.0)]


def _still_braking(data):
    data["motion"]["base_velocities"][-1][0][1] = -1.0


def _short(data):
    del data["motion"]["base_velocities"][0]


def _cancelled(data):
    data["model"]["decelerations_on_cancel"] = [1.5]
    data["bounds"] |= {"GN_cancel": 0.9, "GT_cancel": 0.9, "angle_margin_cancel": 0.0}
    data["cover_cancel"] = {"trees": ["."] * 2, "forces": [], "weights": []}


_CHANGES = {
    "no inertia": _without_inertia,
    "steps of speeds": _stepping,
    "no end": _still_braking,
    "a piece less": _short,
    "cancels": _cancelled,
    **{
        f"{place} = {value!r}": lambda data, place=place, value=value: _set(place, value, data)
        for place, value in (
            ("motion.base_velocities", []),
            ("motion.base_velocities", None),
            ("motion.base_velocities.1", [[0.0, 0.06]] * 2),
            ("motion.base_velocities.1.0.1", 0.12),
            ("motion.base_velocities.1.0.1", -0.06),
            ("motion.velocities", [[0.0]]),
            ("model.base.inertia", [1.0, 1.0, 1.0]),
            ("tolerance", {"drive_speed": -0.5}),
        )
    },
}


def test_the_certificate_while_driving_holds():
    assert _judged(_driving(_certificate(), 0.5, 0.3)).holds


@pytest.mark.parametrize("name", _CHANGES)
def test_it_is_refused(name):
    data = _driving(_certificate(), 0.5, 0.3)
    _CHANGES[name](data)
    verdict = _judged(data)
    assert not verdict.holds
    assert verdict.problems


@pytest.mark.parametrize(("rate", "spin"), [(3.5, 0.0), (-14.0, 0.0), (0.5, 7.0)])
def test_a_profile_that_loses_a_contact_is_refused(rate, spin):
    """The forces named hold the weight at rest; corrected, they are more than these contacts bear."""
    data = _driving(_certificate(), rate, spin)
    assert not _judged(data).holds


# --- a robot ------------------------------------------------------------------------------------------------

_UNCERTAIN = Uncertainty(
    tilt=0.005, friction=0.1, drive_speed=0.05, speed=0.03, base_mass=0.05, center_of_mass=(0.01, 0.0, 0.01)
)


@cache
def _proved():
    """An arm that moves on a base that drives an arc and brakes after the arm has come to rest."""
    task = experiment_task("A")
    start = np.asarray(task.segments[0].task.start, dtype=float)
    rise = np.array([0.0, 0.2, 0.4, 0.6])
    course = np.array([[0.0, 0, 0], [0.16, 0, 0.1], [0.16, 0, 0.1], [0, 0, 0]])
    robot = task.robot.driving(DriveProfile.of_velocities(rise, course))
    goal = start + 0.02 * np.arange(1, len(start) + 1)
    motion = Trajectory.from_points(np.array([0.0, 0.35]), np.array([start, goal]))
    limits = Limits(clearance=0.0, tolerance=_UNCERTAIN)
    return robot, motion, certified(robot, motion, check_motion(robot, motion, limits), limits)


def test_a_motion_while_the_base_drives_is_proved():
    robot, _, checked = _proved()
    assert checked.headline == "PROVED for the given uncertainty", checked.certificate
    data = checked.certificate.data
    assert data["motion"]["times"][-1][1] == robot.acts.end
    assert check_certificate(data).holds


def _worlds(data, robot, motion, count, rng):
    """States, what acts, and a model of worlds within the uncertainty, at random instants of a proof."""
    events = np.concatenate([motion.event_times, robot.acts.knots])
    times = np.concatenate([rng.uniform(0, robot.acts.end, count), events + 2e-7, events - 2e-7])
    states, acting = motion.states(times), robot.acting(times)
    v = robot.drive_profile.velocities.at(times, range(2))
    own = ArmOnBase(data["model"], data["tolerance"])
    return times, states, acting, own, own.driven(*states, *v)


@pytest.mark.slow
def test_no_world_is_worse_than_is_proved():
    """Tipping moments at the worst world of each axis, and both indices of the contact solver at corners."""
    robot, motion, checked = _proved()
    data, rng = checked.certificate.data, np.random.default_rng(3)
    times, _, _, own, moved = _worlds(data, robot, motion, 25, rng)
    bounds, none = data["bounds"], np.zeros((len(times), 12))
    checker = Checker(data["model"], bounds, data["tolerance"], data["motion"])
    least, wrenches = np.inf, []
    for axis, added in zip(checker.contacts.axes, checker.contacts.added, strict=True):
        h = np.tile(axis, (len(times), 1))
        worlds, values = own.least(h, own.corners(len(times), rng), moved, none)
        least = min(least, float(np.min(values + added)))
        wrenches += [own.wrench(world, moved, none) for world in (worlds, own.corners(len(times), rng))]
    unit = robot.tip_over.reference_moment
    needed = unit * (1 / bounds["GN_worst_case"] - 1)
    assert needed <= least <= needed + 0.05 * unit
    weakest = robot.weakest(_UNCERTAIN)
    every = np.concatenate(wrenches)
    used = weakest.slip.evaluate(weakest.contact_states(every), derivatives=False).slip_ratio
    assert 0.8 * bounds["GT_worst_case"] <= np.max(used) <= bounds["GT_worst_case"]
    nominal = own.wrench(own.nominal(len(times)), moved, none)
    used = robot.slip.evaluate(robot.contact_states(nominal), derivatives=False).slip_ratio
    assert np.max(used) <= bounds["GT"]


def test_the_independent_model_of_a_base_that_drives_is_that_of_the_robot():
    robot, motion, checked = _proved()
    args = checked.certificate.data, robot, motion, 10, np.random.default_rng(1)
    times, states, acting, own, moved = _worlds(*args)
    found = own.wrench(own.nominal(len(times)), moved, np.zeros((len(times), 12)))
    np.testing.assert_allclose(found, robot.loads(*states, acting)[1], rtol=1e-9, atol=1e-9)


def test_torques_within_the_uncertainty_are_bounded_closely():
    robot, motion, checked = _proved()
    _, states, acting, _, _ = _worlds(checked.certificate.data, robot, motion, 60, np.random.default_rng(5))
    share = np.max(maximum_torques(robot, _UNCERTAIN, *states, acting) / robot.limits.torque)
    bound = checked.certificate.data["bounds"][TORQUES]
    assert bound * 0.99 <= share <= bound


def _other_profile(factor, data):
    v = np.array(data["motion"]["base_velocities"])
    data["motion"]["base_velocities"] = (factor * v).tolist()


def _no_profile(data):
    del data["motion"]["base_velocities"]


def _as_light(data):
    data["model"]["base"]["mass"] *= 0.8


_OTHERS = {
    "faster": lambda data: _other_profile(1.1, data),
    "backwards": lambda data: _other_profile(-1.0, data),
    "faster and slower": lambda data: _set("tolerance.drive_speed", 0.3, data),
    "a lighter base": _as_light,
}


@pytest.mark.parametrize("name", some(2, _OTHERS))
def test_a_proof_of_another_profile_is_refused(name):
    data = copy.deepcopy(dict(_proved()[2].certificate.data))
    _OTHERS[name](data)
    assert "digest" in str(check_certificate(data).problems)
    assert not _judged(data).holds


def test_a_proof_whose_profile_was_dropped_is_refused():
    data = copy.deepcopy(dict(_proved()[2].certificate.data))
    _no_profile(data)
    assert check_certificate(data).problems == ("the motion is not that of the digest",)
