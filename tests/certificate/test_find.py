"""Certificates of motions: what is found, what they say, and that the checker refuses what is not so."""

import copy
import json
from dataclasses import replace
from fractions import Fraction
from math import comb

import numpy as np
import pytest

from ocptip.certificate import describe
from ocptip.certificate.describe import model_data, motion_data, states_at, tolerance_data
from ocptip.certificate.find import certify
from ocptip.certificate.find_within import SearchWithin
from ocptip.certificate.trusted.checker import check_certificate, digest
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.motion.check import check_motion
from ocptip.published.tasks import experiment_task
from ocptip.standing.arm import Robot
from ocptip.standing.limits import SLIP_WITHIN, TIP_WITHIN, Limits
from ocptip.standing.tolerance import NONE, WORKSHOP, Uncertainty
from ocptip.standing.within.worst_case import worst_case_of
from ocptip.trajectories.controllers import controller_points
from ocptip.trajectories.path import JointPath
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from studies.certificates.broken import broken_on_purpose
from tests.quick import some


def _swing(case="B", faster=1.0):
    """A robot and a swing of its joints that stands with some reserve."""
    task = experiment_task(case)
    way = task.goal - task.start
    speeds = task.robot.limits.speed
    commands = [
        [RampCommand(a + 0.4 * w, 0.25 * faster * v, 0.8 * faster**2)]
        for a, w, v in zip(task.start, way, speeds, strict=True)
    ]
    return task, Trajectory.from_profiles(task.start, commands)


def _nod(task, joints=2):
    """A motion of the first joints: few intervals, where what is proved is costly in each."""
    way = 0.15 * (task.goal - task.start)
    way[joints:] = 0.0
    commands = [
        [RampCommand(a + w, 0.25 * v, 0.8)]
        for a, w, v in zip(task.start, way, task.robot.limits.speed, strict=True)
    ]
    return Trajectory.from_profiles(task.start, commands)


def _certified(task, motion, limits=None):
    limits = limits or task.limits
    checked = check_motion(task.robot, motion, limits)
    return checked, certify(task.robot, motion, limits, checked.worst)


@pytest.fixture(scope="module")
def swing():
    task, motion = _swing()
    return task, motion, *_certified(task, motion)


def test_a_standing_motion_is_certified_close_to_its_sampled_worst_values(swing):
    task, _, checked, found = swing
    assert checked.verified
    assert found.certified
    assert not found.undecided
    for name in ("GN", "GT", "torque_ratio"):
        worst = checked.worst[name].value
        assert worst <= found.verdict.bounds[name] <= worst + 1e-3 * max(worst, 0.1)
    assert checked.worst["clearance_m"].value - 1.1e-4 <= found.verdict.bounds["clearance"]
    assert task.limits.GN == 0.9


@pytest.mark.parametrize("case", some(1, ["A", "C", "G"]))
def test_other_cases_clamps_and_frictions(case):
    _, found = _certified(*_swing(case))
    assert found.certified, (found.verdict, found.undecided)


@pytest.mark.parametrize("controller", some(1, ["cubic", "quintic", "linear"]))
def test_what_controllers_run_is_certified(swing, controller):
    task, motion, _, _ = swing
    risen = motion.with_rise_times(0.02) if controller == "quintic" else motion
    checked, found = _certified(task, controller_points(risen, controller))
    assert found.certified == checked.verified, (checked.violations, found.undecided)


def test_s_curves_are_certified(swing):
    task, motion, _, _ = swing
    checked, found = _certified(task, motion.with_rise_times(0.05))
    assert checked.verified
    assert found.certified


def test_a_certificate_survives_json(swing):
    data = json.loads(json.dumps(swing[3].data))
    assert check_certificate(data) == swing[3].verdict


def test_at_the_limit_and_beyond(swing):
    task, motion, checked, _ = swing
    tight = Limits(GN=checked.worst["GN"].value, GT=checked.worst["GT"].value)
    assert _certified(task, motion, tight)[1].certified
    below = Limits(GN=checked.worst["GN"].value * 0.999)
    found = _certified(task, motion, below)[1]
    assert found.verdict.holds  # contacts persist
    assert not found.certified  # but the limit is not kept


def test_a_motion_that_tips_is_not_certified():
    task, motion = _swing(faster=8.0)
    checked, found = _certified(task, motion)
    assert not checked.verified
    assert not found.certified
    assert "contact is lost" in found.reason


def test_pieces_are_the_motion(swing):
    _, motion, _, _ = swing
    data = motion_data(motion)
    rng = np.random.default_rng(0)
    times = np.array(data["times"])
    piece, u = rng.integers(1, len(times) - 1, 200), rng.uniform(-0.99, 0.99, 200)
    t = times[piece].mean(axis=1) + 0.5 * u * (times[piece, 1] - times[piece, 0])
    for found, expected, tolerance in zip(
        states_at(data, piece, u), motion.states(t), (1e-12, 1e-11, 1e-8), strict=True
    ):
        np.testing.assert_allclose(found, expected, atol=tolerance)


@pytest.mark.parametrize("rise", some(1, [0.03, 0.0]))
@pytest.mark.parametrize("controller", [None, "cubic", "quintic"])
def test_coefficients_are_exact_up_to_rounding(swing, rise, controller):
    """Of rational numbers: the polynomials of the trajectory, moved to the middle of a piece."""
    if controller == "quintic" and not rise:
        return
    motion = swing[1].with_rise_times(rise)
    motion = motion if controller is None else controller_points(motion, controller)
    data = motion_data(motion)
    for (left, right), angles in list(zip(data["times"], data["angles"], strict=True))[1:-1:3]:
        middle, half = (Fraction(0.5 * (right + left * sign)) for sign in (1, -1))
        for j, found in enumerate(angles):
            breaks, c = motion.breaks[j], motion.coefficients[j]
            piece = int(np.searchsorted(breaks, float(middle), side="right")) - 1
            if piece >= c.shape[1]:  # it has come to rest
                exact = [Fraction(motion.goal[j])]
            else:
                since, own = middle - Fraction(breaks[piece]), [Fraction(x) for x in c[:, piece]]
                exact = [
                    half**k * sum(comb(i, k) * own[i] * since ** (i - k) for i in range(k, len(own)))
                    for k in range(len(own))
                ]
            size = max(map(abs, exact))
            assert len(found) == 6
            assert not any(found[len(exact) :])
            for one, other in zip(exact, found, strict=False):
                assert abs(one - Fraction(other)) <= 1e-14 * size


def _way_there(start, way, bend, nodes):
    """Along a cubic in cubic or square timing, from rest to rest."""
    path = JointPath(
        [0.0, 1.0], np.stack([-2 * bend * way, 3 * bend * way, (1 - bend) * way, start])[:, None]
    )
    s = np.linspace(0.0, 1.0, nodes)
    return Trajectory.from_path(path, s, 0.4 * s * (1 - s))


def test_paths_in_time_are_certified_in_pieces_that_are_what_they_do(swing):
    """What is of higher degree in time than a piece is cut into smaller ones, as near as claims need them."""
    task, other, _, _ = swing
    for bend in (0.0, 1.0):
        motion = _way_there(task.start, other.goal - task.start, bend, 5)
        checked, found = _certified(task, motion)
        assert checked.verified
        assert found.certified, f"{found}"
        data = motion_data(motion)
        assert (len(data["times"]) > len(motion.intervals) + 2) == (bend > 0)
        times = np.array(data["times"])[1:-1]
        piece = np.repeat(np.arange(1, len(times) + 1), 41)
        u = np.tile(np.linspace(-0.999, 0.999, 41), len(times))
        t = times[piece - 1].mean(axis=1) + 0.5 * u * (times[piece - 1, 1] - times[piece - 1, 0])
        for own, expected, tolerance in zip(
            states_at(data, piece, u), motion.states(t), (1e-9, 1e-7, 1.1e-6), strict=True
        ):
            assert np.max(np.abs(own - expected)) <= tolerance * max(1.0, np.max(np.abs(expected)))


def test_a_motion_that_no_pieces_fit_is_not_certified(swing, monkeypatch):
    monkeypatch.setattr(describe, "_HALVED", 0)
    task, other, _, _ = swing
    found = _certified(task, _way_there(task.start, other.goal - task.start, 1.0, 5))[1]
    assert not found.certified
    assert "polynomial of time of degree 5" in found.reason


def _mutations():
    def forces(data):
        data["cover"][2]["forces"][0][0][0][1][1] += 1e3  # squeezes; a change of the sum would be corrected

    def weightless(data):
        for part in data["cover"]:
            part["forces"] = np.zeros_like(part["forces"]).tolist()

    def on_two_feet(data):
        for both in data["cover"][2]["forces"]:
            for rules in both:
                rules[0][1] = [0.0, 0.0, 0.0]

    def less(data):
        data["bounds"]["GT"] *= 0.99

    def less_tip(data):
        data["bounds"]["GN"] *= 0.99

    def torque(data):
        data["bounds"]["torque_ratio"] *= 0.99

    def nearer(data):
        data["bounds"]["clearance"] += 0.01

    def gap(data):
        ends = data["cover"][2]["ends"]
        ends[1] = ends[0] + 0.5 * (ends[1] - ends[0])
        data["cover"][2]["ends"] = ends[:2] + ends[2:]
        data["cover"][2]["forces"] = data["cover"][2]["forces"]
        data["cover"][2]["ends"][-1] = 0.99

    def missing(data):
        part = data["cover"][1]
        part["ends"], part["forces"] = part["ends"][:-1], part["forces"][:-1]

    def piece(data):
        data["cover"].pop(2)

    def motion(data):
        data["motion"]["angles"][2][0][0] += 1e-9

    def moved(data):
        data["motion"]["angles"][2][0][0] += 0.1
        data["sha256"]["motion"] = digest(data["motion"])

    def model(data):
        data["model"]["arm"]["masses"][3] += 1e-9

    def heavier(data):
        data["model"]["arm"]["masses"][3] *= 1.2
        data["sha256"]["model"] = digest(data["model"])

    def slippery(data):
        for pieces in data["model"]["contacts"]["sets"]:
            pieces[0][3] *= 0.9
        data["sha256"]["model"] = digest(data["model"])

    def nothing(data):
        data["bounds"]["GN"] = 1.0

    def not_a_number(data):
        data["cover"][1]["forces"][0][0][0][0][0] = float("nan")

    def format_(data):
        data["format"] = "another"

    def lacking(data):
        del data["bounds"]

    return [f for name, f in sorted(locals().items()) if callable(f)]


@pytest.mark.parametrize("mutate", _mutations(), ids=lambda f: f.__name__)
def test_mutations_are_refused(swing, mutate):
    data = copy.deepcopy(swing[3].data)
    assert check_certificate(data).holds
    mutate(data)
    verdict = check_certificate(data)
    assert not verdict.holds
    assert verdict.problems


@pytest.mark.slow
@pytest.mark.parametrize(
    ("count", "within"), [(1, 0), pytest.param(40, 2, marks=pytest.mark.slow)], ids=["few", "many"]
)
def test_motions_broken_for_less_than_a_millisecond_are_not_certified(count, within):
    """Between the instants that the sampled check looked at, the acceleration of a joint leaps."""
    found = broken_on_purpose(count)
    assert (found["certified"], found["named"], found["within"]) == (0, count, within)


def test_feet_that_give_are_not_certified(swing):
    task, motion, checked, _ = swing
    own = task.robot.support
    feet = [replace(contact, stiffness=1e7) for contact in own.contacts]
    found = certify(task.robot.varied(support=own.varied(feet)), motion, task.limits, checked.worst)
    assert found.holds
    assert "GT" in found.sampled
    assert not found.certified


def _on_casters(task, caster, wheel=0.6):
    """The arm of a task on two drive wheels amid four casters."""
    places = [(0.0, 0.3), (0.0, -0.3), (0.35, 0.28), (0.35, -0.28), (-0.35, -0.28), (-0.35, 0.28)]
    contacts = [
        UnilateralContact(position=[x, y, 0.0], friction=caster if k > 1 else wheel)
        for k, (x, y) in enumerate(places)
    ]
    support = Support(contacts, mass=80.0, center_of_mass=[0.05, 0.0, 0.3])
    return Robot(task.robot.arm, support, task.robot.motors)


@pytest.mark.slow
@pytest.mark.parametrize(
    "tolerance",
    [NONE, pytest.param(WORKSHOP.only("tilt", "arm_mass", "friction"), marks=pytest.mark.slow)],
)
def test_casters_without_friction_cost_no_proof(swing, tolerance):
    task, motion, *_ = swing
    robot, limits = _on_casters(task, 0.0), Limits(tolerance=tolerance)
    checked = check_motion(robot, motion, limits)
    found = certify(robot, motion, limits, checked.worst)
    assert checked.verified
    assert found.certified, (found.verdict, found.undecided)
    other = _on_casters(task, 1e-4)  # nearly none is nearly the same
    nearly = check_motion(other, motion, limits)
    bounds = certify(other, motion, limits, nearly.worst).verdict.bounds
    assert found.verdict.bounds["GN"] == pytest.approx(bounds["GN"], rel=1e-3)
    assert found.verdict.bounds["GT"] == pytest.approx(bounds["GT"], rel=0.02)


@pytest.mark.slow
def test_forces_that_a_contact_without_friction_cannot_bear_prove_nothing(swing):
    """Wheels without friction, and tangential forces named for them as before."""
    task, motion, *_ = swing
    robot = _on_casters(task, 0.0)
    limits = Limits()
    data = copy.deepcopy(certify(robot, motion, limits, check_motion(robot, motion, limits).worst).data)
    for pieces in data["model"]["contacts"]["sets"][:2]:
        pieces[0][2:] = [0.0, 0.0]
    data["sha256"]["model"] = digest(data["model"])
    verdict = check_certificate(data)
    assert any(problem.startswith("contacts") for problem in verdict.problems)


def proved_on(support, task, tolerance):
    """Check and certificate of a motion of the task's arm on another support; both have to hold."""
    motion = _nod(task)
    robot = Robot(task.robot.arm, support, task.robot.motors)
    limits = Limits(tolerance=tolerance)
    checked = check_motion(robot, motion, limits)
    found = certify(robot, motion, limits, checked.worst)
    assert checked.verified
    assert found.certified, (found.verdict, found.undecided)
    return checked, found


@pytest.mark.slow
@pytest.mark.parametrize(
    "tolerance",
    [Uncertainty(base_push=20.0), pytest.param(Uncertainty(push=5.0, tilt=0.01), marks=pytest.mark.slow)],
)
def test_four_feet_that_two_of_them_could_bear_alone_are_proved_within_pushes(swing, tolerance):
    """The best sharing leaves two feet next to nothing; a rule by equal weights bears the pushes."""
    places = [(0.3, 0.25), (0.3, -0.25), (-0.3, -0.25), (-0.3, 0.25)]
    feet = [UnilateralContact(position=[x, y, 0.0], friction=0.5) for x, y in places]
    support = Support(feet, mass=40.0, center_of_mass=[0.03, 0.0, 0.25])
    checked, found = proved_on(support, swing[0], tolerance)
    sampled = checked.worst["GN_worst_case"].value
    assert sampled * 0.999 <= found.verdict.bounds["GN_worst_case"] <= 1.01 * sampled


@pytest.mark.slow
def test_what_is_proved_of_four_feet_does_not_depend_on_what_is_searched_together(swing):
    places = [(0.3, 0.25), (0.3, -0.25), (-0.3, -0.25), (-0.3, 0.25)]
    feet = [UnilateralContact(position=[x, y, 0.0], friction=0.5) for x, y in places]
    support = Support(feet, mass=40.0, center_of_mass=[0.03, 0.0, 0.25])
    task, motion, tolerance = swing[0], _nod(swing[0]), Uncertainty(tilt=0.01, arm_mass=0.05, friction=0.1)
    robot, data = Robot(task.robot.arm, support, task.robot.motors), motion_data(motion)
    goals = {TIP_WITHIN: 0.5, SLIP_WITHIN: 0.9}
    parts = model_data(robot, data["times"][-1][1], None), data, tolerance_data(tolerance, support)
    search = SearchWithin(worst_case_of(robot, tolerance).footing, *parts, goals, np.empty(0))
    starts = np.linspace(0.0, 0.9 * motion.end, 12)
    [rows] = search.sharing.late.rows(starts, starts + 0.002)
    together = search.checked(rows)
    for k in range(len(starts)):
        alone = search.checked(rows.some(slice(k, k + 1)))
        for name in ("forces", "weights", "moments", "holds"):
            np.testing.assert_array_equal(getattr(alone, name)[..., 0], getattr(together, name)[..., k])


_HEIGHTS = [
    ((0.35, 0.0), 0.0),
    ((0.1, 0.33), 0.03),
    ((-0.28, 0.2), -0.02),
    ((-0.28, -0.2), 0.01),
    ((0.1, -0.33), 0.05),
]
_THREE_DEVIATIONS = Uncertainty(tilt=0.01, arm_mass=0.05, friction=0.2)
_LEANING = [((0.35, 0.0), 0.0), ((-0.2, 0.3), 0.0), ((-0.2, -0.3), 0.0)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("places", "lean", "tolerance"),
    [
        pytest.param(_HEIGHTS, 0.0, NONE, marks=pytest.mark.slow),
        pytest.param(_HEIGHTS, 0.0, _THREE_DEVIATIONS, marks=pytest.mark.slow),
        pytest.param(_LEANING, 0.5, NONE, marks=pytest.mark.slow),
        (_LEANING, 0.5, _THREE_DEVIATIONS),
    ],
    ids=["five uneven, nominal", "five uneven", "leaning, nominal", "leaning"],
)
def test_contacts_in_general_position_are_proved(swing, places, lean, tolerance):
    feet = [
        UnilateralContact(position=[x, y, z], normal=[-lean * x, -lean * y, 1.0], friction=0.6)
        for (x, y), z in places
    ]
    support = Support(feet, mass=60.0, center_of_mass=[0.0, 0.0, 0.3])
    checked, found = proved_on(support, swing[0], tolerance)
    if tolerance.given:  # one rule for all couples: with half of the moment that is left, at least
        value = checked.worst["GN_worst_case"].value
        assert value * 0.999 <= found.verdict.bounds["GN_worst_case"] <= 2.1 * value


def test_without_delays_joints_have_one_case_in_an_interval_however_dense_switching_times_are(swing):
    """Cases of six joints in one interval multiply: a proof of a linear controller had too many."""
    task = swing[0]
    motion = controller_points(_nod(task, 6).with_rise_times(0.02), "linear", step=0.002)
    uncertain = Uncertainty(tilt=0.005, arm_mass=0.02)
    robot, data = task.robot, motion_data(motion)
    tolerance = tolerance_data(uncertain, robot.support)
    goals = {TIP_WITHIN: 0.9, SLIP_WITHIN: 0.9}
    weakest = worst_case_of(robot, uncertain).footing
    search = SearchWithin(weakest, model_data(robot), data, tolerance, goals, np.empty(0))
    starts, ends = search._first()
    assert len(motion.event_times) > 200 * search.sharing.late.end  # two in each interval of 10 ms
    groups = search.sharing.late.rows(starts, ends, np.zeros((len(starts), 6), dtype=bool))
    assert sum(len(rows.number) for rows in groups) == len(starts)
