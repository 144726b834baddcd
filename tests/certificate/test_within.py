"""What is proved within a tolerance: below everything that can be, close to the worst, and nothing else."""

import copy
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from ocptip.certificate import claimed
from ocptip.certificate.checks import certified
from ocptip.certificate.describe import model_data, motion_data, tolerance_data, tolerance_words
from ocptip.certificate.find import certify
from ocptip.certificate.find_within import LOSS_WITHIN, SearchWithin
from ocptip.certificate.result import LATE
from ocptip.certificate.trusted.checker import check_certificate, digest
from ocptip.certificate.trusted.late import Late
from ocptip.certificate.trusted.sharing import Sharing
from ocptip.motion.check import check_motion
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import NONE, WORKSHOP, Uncertainty
from ocptip.standing.within.worst_case import worst_case_of
from ocptip.trajectories.trajectory import Trajectory
from tests.certificate.test_by_hand import BASE, MASS, G
from tests.certificate.test_find import _swing
from tests.certificate.test_hostile import _certificate, _set
from tests.quick import some

_ASKED = {"GN_worst_case": 0.999, "GT_worst_case": 0.999}
_PUSHED = Uncertainty(
    base_mass=(60.0, 90.0),
    center_of_mass=(0.01, 0.005, 0.02),
    payload_mass=0.1,
    payload_center=(0.02, 0.01, 0.0),
    arm_mass=0.1,
    tilt=0.03,
    push=20.0,
    base_push=5.0,
    speed=0.05,
    extra_mass=0.3,
)


def _late_states(
    motion: Trajectory, tolerance: Uncertainty, late: Late, rng: np.random.Generator, count: int
):
    """Times and states (count, 3 n) of joints that are late, some of them as they jump."""
    n, events = motion.n, motion.event_times
    d, more = tolerance.delay * (1 + tolerance.speed), tolerance.overshoot
    sides = [motion.states(events + side) for side in (-1.5e-7, 1.5e-7)]
    times, states = rng.uniform(0, late.end, count), np.empty((count, 3, n))
    joints = np.arange(n)
    for k, t in enumerate(times):
        tau = rng.choice([0.0, d], n) if k % 2 else rng.uniform(0, d, n)
        states[k] = [part[joints, joints] for part in motion.states(t - tau)]
        inside = np.flatnonzero((events <= t) & (events >= t - d)) if d else []
        for j in joints[rng.random(n) < 0.7]:
            if len(inside):
                e, how = rng.choice(inside), rng.integers(3)
                step = sides[1][2][e, j] - sides[0][2][e, j]
                if abs(step) > 1e-3:
                    after = sides[1][2][e, j] + (more * step if how == 2 else 0.0)
                    states[k, :, j] = (
                        sides[0][0][e, j],
                        sides[0][1][e, j],
                        sides[0][2][e, j] if not how else after,
                    )
    return times, states.reshape(count, 3 * n)


@pytest.mark.parametrize("case", some(1, ["G", "B"]))
@pytest.mark.parametrize("tolerance", [WORKSHOP, _PUSHED], ids=["workshop", "pushed"])
@pytest.mark.parametrize("share", some(1, [0.5, 1.0, 0.0]), ids=["some in boxes", "apart", "in boxes"])
def test_no_state_within_the_tolerance_has_less_than_is_proved(case, tolerance, share):
    task, motion = _swing(case)
    robot = task.robot
    tolerance = replace(tolerance, base_mass=0.1) if tolerance is _PUSHED else tolerance
    sharing = Sharing(
        model_data(robot), motion_data(motion), tolerance_data(tolerance, robot.support), _ASKED
    )
    ends = np.unique(np.concatenate([np.linspace(0, sharing.late.end, 40), sharing.late.events]))
    chosen = np.random.default_rng(4).random((len(ends) - 1, robot.n)) < share
    proved = np.full(len(ends) - 1, np.inf)
    for rows in sharing.late.rows(ends[:-1], ends[1:], chosen):
        np.minimum.at(proved, rows.interval, sharing.moments(sharing.terms(rows)))
    times, states = _late_states(motion, tolerance, sharing.late, np.random.default_rng(3), 1500)
    cases = worst_case_of(robot, replace(tolerance, delay=0.0, damping=None))
    found = np.min(cases.all_moments(states), axis=1)
    interval = np.searchsorted(ends, times) - 1
    assert np.all(found >= proved[interval] - 1e-6)
    unit = robot.tip_over.reference_moment
    assert (
        np.min(found) - np.min(proved) < (0.06 if share == 1 else 0.5) * unit
    )  # the worst of the joints is not tried on purpose


@pytest.mark.parametrize("quantity", ["tilt", "arm_mass", "push", "speed"])
def test_one_quantity_costs_next_to_nothing(quantity):
    task, motion = _swing()
    own = _PUSHED.only(quantity)
    sharing = Sharing(
        model_data(task.robot), motion_data(motion), tolerance_data(own, task.robot.support), _ASKED
    )
    ends = np.unique(np.concatenate([np.linspace(0, sharing.late.end, 120), sharing.late.events]))
    [rows] = sharing.late.rows(ends[:-1], ends[1:])
    proved = np.min(sharing.moments(sharing.terms(rows)))
    times = np.linspace(1e-6, motion.end - 1e-6, 2000)
    times = np.concatenate([times, motion.event_times + 2e-7, motion.event_times[1:] - 2e-7])
    found = np.min(worst_case_of(task.robot, own).all_moments(np.hstack(motion.states(times))))
    unit = task.robot.tip_over.reference_moment
    assert -1e-6 <= (found - proved) / unit <= 1e-4


@pytest.mark.slow
def test_a_motion_is_certified_within_workshop():
    task, motion = _swing("G")
    limits = Limits(tolerance=WORKSHOP, clearance=0.0)
    checked = certified(task.robot, motion, check_motion(task.robot, motion, limits), limits)
    assert checked.verified
    assert checked.certificate is not None
    assert checked.certified
    assert checked.headline == "PROVED for 'workshop' uncertainty (default)", f"{checked.certificate}"
    data, bounds = checked.certificate.data, checked.certificate.verdict.bounds
    assert data is not None
    assert checked.within is not None
    assert checked.within.tip is not None
    assert bounds["GN_worst_case"] <= checked.within.tip.value * (1.001 + LOSS_WITHIN)
    assert check_certificate(data).tolerance == tolerance_data(WORKSHOP, task.robot.support)
    described = Limits(clearance=0.0)
    nominal = certified(task.robot, motion, check_motion(task.robot, motion, described), described)
    assert nominal.headline == "PROVED for the nominal model only (no uncertainty)"
    _refused(data, lambda d: d["bounds"].update(GN_worst_case=bounds["GN_worst_case"] * 0.99))
    for key, factor in (("speed", 3), ("overshoot", 1.17)):
        _refused(data, partial(_set, f"tolerance.{key}", data["tolerance"][key] * factor))


@pytest.mark.slow
def test_bounds_of_joints_on_time_say_so(monkeypatch):
    """Where what late joints do cannot be proved."""
    task, motion = _swing("G")
    limits = Limits(tolerance=WORKSHOP, clearance=0.0)
    checked = check_motion(task.robot, motion, limits)

    def on_time_only(robot, model, motion, tolerance, *more, **how):
        search = SearchWithin(robot, model, motion, tolerance, *more, **how)
        return SimpleNamespace(claims=lambda _: None) if tolerance["delay"] else search

    monkeypatch.setattr("ocptip.certificate.find.SearchWithin", on_time_only)
    found = certify(task.robot, motion, limits, checked.worst)
    assert found.holds
    assert not found.certified
    assert found.sampled[:2] == LATE
    assert "worst case with all joints on time" in str(found)
    assert "on time" not in str(replace(found, sampled=()))


@pytest.mark.slow
def test_a_share_of_friction_that_is_short_is_claimed_higher(monkeypatch):
    """As where rows are shown at what they need themselves, and not at what all need."""
    task, motion = _swing("G")
    limits = Limits(tolerance=replace(WORKSHOP, delay=0.0, damping=None), clearance=0.0)
    checked = check_motion(task.robot, motion, limits)
    # a limit this near leaves no room for a claim that all rows keep at once
    limits = replace(limits, GT_worst_case=1.05 * checked.worst["GT_worst_case"].value)
    proved = SearchWithin._proved_share
    needed = certify(task.robot, motion, limits, checked.worst).verdict.bounds["GT_worst_case"]
    monkeypatch.setattr(SearchWithin, "_proved_share", lambda own: proved(own) * (1 - 1e-3))
    found = certify(task.robot, motion, limits, checked.worst)
    assert found.certified
    assert needed * (1 - 1e-3) < found.verdict.bounds["GT_worst_case"] < needed * (1 + 1e-3)


@pytest.mark.slow
def test_what_is_lost_as_sampled_is_not_searched(monkeypatch):
    task, motion = _swing("G")
    limits = Limits(tolerance=replace(WORKSHOP, extra_mass=30.0), clearance=0.0)
    checked = check_motion(task.robot, motion, limits)
    assert checked.worst["GN_worst_case"].value > 1.1
    monkeypatch.setattr(SearchWithin, "claims", None)  # nobody calls it
    found = certify(task.robot, motion, limits, checked.worst)
    assert found.holds
    assert not found.certified
    assert "GN_worst_case" in found.sampled
    lost = next(one for one in found.undecided if one.claim == "tip-over within tolerance")
    assert lost.start == checked.worst["GN_worst_case"].time


def _refused(data, change):
    data = copy.deepcopy(data)
    change(data)
    data["sha256"]["tolerance"] = digest(data["tolerance"])
    verdict = check_certificate(data)
    assert not verdict.holds
    assert verdict.problems


# --- made by hand -------------------------------------------------------------------------------------------


def _by_hand():
    """The mass of the page at rest, within tolerances."""
    data = _certificate()
    data["tolerance"] = tolerance_data(NONE, _Support()) | {
        **{"base_mass": [-0.05, 0.05], "arm_mass": 0.05, "tilt": 0.01, "friction": 0.2, "speed": 0.03},
        **{"delay": 0.01, "overshoot": 0.85, "push": 0.2, "extra_mass": 0.05},
    }
    front = G * (BASE * 0.1 + MASS * 0.2) / 0.4
    rear = ((BASE + MASS) * G - front) / 2
    forces = [[[[f, 0.0, 0.0] for f in (rear, rear, front)]]] * 2
    ends = [0.0, 0.01, 0.04]
    named = {"forces": [forces] * 2, "weights": [[[1.0, 1.0]] * 3] * 2}
    data["cover_within"] = {"ends": ends, "apart": [[], [0]], **named}
    data["bounds"] |= {"GN_worst_case": 0.45, "GT_worst_case": 0.2}
    return data


class _Support:
    mass = BASE


def _judged(data):
    data["sha256"] = {key: digest(data[key]) for key in ("model", "motion", "tolerance")}
    return check_certificate(data)


@pytest.mark.parametrize("tolerance", [WORKSHOP, replace(_PUSHED, base_mass=0.1), NONE])
def test_certificates_say_their_tolerance_as_tasks_do(tolerance):
    assert tolerance_words(tolerance_data(tolerance, _Support())) == str(tolerance)


def test_an_uneven_interval_of_the_base_is_said():
    data = tolerance_data(NONE, _Support()) | {"base_mass": [-0.1, 0.2]}
    assert tolerance_words(data) == "base mass -10 to +20 %"


@pytest.mark.parametrize(("limit", "proved", "kept"), [
    (0.999, 0.99995, True), (0.999, 1.0, False), (0.9, 0.8999, True), (0.9, 0.9005, False),
])  # fmt: skip
def test_what_is_proved_keeps_the_limit_asked_for_or_all_contacts(limit, proved, kept):
    limits = Limits(tolerance=WORKSHOP, GN_worst_case=limit)
    assert claimed.kept(limits, {"GN": 0.5, "GT": 0.5, "torque_ratio": 0.5, "GN_worst_case": proved}) == kept


def test_the_tolerance_by_hand_holds():
    verdict = _judged(_by_hand())
    assert verdict.holds, verdict.problems
    assert verdict.intervals == 5


def _dropped(data):
    del data["tolerance"]["push"]


def _more(data):
    data["tolerance"]["luck"] = 1.0


def _without_tolerance(data):
    data["tolerance"] = None


def _without_cover(data):
    data["cover_within"] = None


def _unclaimed(data):
    del data["bounds"]["GN_worst_case"]


def _payload(change, data):
    axes = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    own = {"mass": 1.0, "center": [0.0] * 3, "inertia": [[0.0] * 3] * 3, "axes": axes}
    data["model"]["payload"] = own | change


_CHANGES = {
    "a quantity missing": _dropped,
    "a quantity more": _more,
    "no tolerance": _without_tolerance,
    "no cover": _without_cover,
    "no claim": _unclaimed,
    "a payload heavier than its link": partial(_payload, {"mass": 3.0}),
    "a payload of negative mass": partial(_payload, {"mass": -1.0}),
    "a payload with scaled axes": partial(_payload, {"axes": [[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]}),
    **{
        f"{place} = {value!r}": partial(_set, place, value)
        for place, value in (
            *(
                (f"tolerance.{key}", -0.01)
                for key in ("friction", "tilt", "arm_mass", "delay", "push", "speed")
            ),
            *((f"tolerance.{key}", float("nan")) for key in ("extra_mass", "overshoot", "base_push", "tilt")),
            *((f"tolerance.{key}", 1.0) for key in ("friction", "speed", "arm_mass", "tilt")),
            ("tolerance.tilt", "0.01"),
            ("tolerance.tilt", None),
            ("tolerance.tilt", [0.01]),
            ("tolerance.delay", True),
            ("tolerance.overshoot", 1.5),
            ("tolerance.base_mass", 0.05),
            ("tolerance.base_mass", [0.0]),
            ("tolerance.base_mass", [0.01, 0.05]),
            ("tolerance.base_mass", [0.05, -0.05]),
            ("tolerance.base_mass", [-1.5, 0.05]),
            ("tolerance.base_mass", [float("nan"), 0.05]),
            ("tolerance.center_of_mass", [0.01, -0.01, 0.0]),
            ("tolerance.center_of_mass", [0.01]),
            ("tolerance.push", 20.0),
            ("tolerance.tilt", 0.3),
            ("tolerance.friction", 0.9),
            ("tolerance", []),
            ("bounds.GN_worst_case", 0.06),
            ("bounds.GN_worst_case", 1.0),
            ("bounds.GN_worst_case", float("nan")),
            ("bounds.GT_worst_case", 0.01),
            ("bounds.GT_worst_case", -0.5),
            ("cover_within.ends", [0.0, 0.01, 0.02]),
            ("cover_within.ends", [0.01, 0.02, 0.04]),
            ("cover_within.ends", [0.0, 0.02, 0.01, 0.04]),
            ("cover_within.ends", [0.0]),
            ("cover_within.apart", [[]]),
            ("cover_within.apart", [[], [-1]]),
            ("cover_within.apart", [[], [1]]),
            ("cover_within.apart", [[], [True]]),
            ("cover_within.apart", None),
            ("cover_within.forces", []),
            ("cover_within.weights", []),
            ("cover_within.weights", [[[0.0, 0.0]] * 3] * 2),
            ("cover_within.weights", [[[1.0, -1.0]] * 3] * 2),
            ("cover_within.weights", [[[1.0, float("nan")]] * 3] * 2),
            ("cover_within.weights", [[[1.0, 1.0]] * 2 + [[0.0, 0.0]]] * 2),
            ("cover_within.forces.0.0.0.0.0", float("inf")),
        )
    },
}


@pytest.mark.parametrize("name", _CHANGES)
def test_what_is_not_so_is_refused(name):
    data = copy.deepcopy(_by_hand())
    _CHANGES[name](data)
    try:
        verdict = _judged(data)
    except ValueError:  # not a number: there is no digest of it
        data = {**data, "sha256": {}}
        verdict = check_certificate(data)
    assert not verdict.holds
    assert all(len(problem.splitlines()) == 1 for problem in verdict.problems)
    assert verdict.problems


def test_a_narrower_tolerance_than_that_of_the_digest_is_refused():
    data = _by_hand()
    assert _judged(data).holds
    data["tolerance"] = data["tolerance"] | {"tilt": 0.0}
    verdict = check_certificate(data)
    assert not verdict.holds
    assert "tolerance" in verdict.problems[0]
