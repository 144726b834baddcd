"""States of cancelled motions are in the boxes of the checker; claims about them, by hand and hostile."""

from dataclasses import replace

import numpy as np
import pytest

from ocptip.api.tasks import load_task
from ocptip.certificate.describe import motion_data
from ocptip.certificate.find import certify
from ocptip.certificate.find_cancels import cancel_claims
from ocptip.certificate.result import Undecided
from ocptip.certificate.trusted.cancelled import Boxes, Cancelled
from ocptip.certificate.trusted.checker import check_certificate
from ocptip.certificate.trusted.forms import K, numbers_of
from ocptip.certificate.trusted.late import Late
from ocptip.motion.check import check_motion
from ocptip.published.tasks import experiment_task
from ocptip.standing.stops.by_cancel import Cancel
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.trajectories.trajectory import Trajectory
from tests.certificate.test_find import _nod, _swing
from tests.certificate.test_hostile import _judged, _weights, _within

pytest.importorskip("flint")
from tests.oracles import claims
from tests.oracles import world_in_balls as worlds
from tests.places import EXAMPLES
from tests.quick import some

RATES = np.array([3.0, 4.5, 6.0, 7.5, 9.0, 4.5])


def _state(motion, t, own):
    """(3, n) of joints that are each at a time of their own after a cancel at t, s."""
    q, v, _ = (part[0] for part in motion.states(np.array([t])))
    found = np.empty((3, motion.n))
    for j, (when, rate) in enumerate(zip(own, RATES, strict=True)):
        if when < 0:
            found[:, j] = [motion(np.array([t + when]), order)[0, j] for order in range(3)]
            continue
        slower = -np.sign(v[j]) * rate * (abs(v[j]) > 1e-6)
        rests = abs(v[j]) / rate
        u = min(when, rests)
        moves = when < rests
        found[:, j] = q[j] + v[j] * u + slower * u**2 / 2, (v[j] + slower * u) * moves, slower * moves
    return found


def _ends(form, joint, row, s, e):
    """Lower and upper end of a form where s and the first numbers e are known, and others are not."""
    c, count = form.c[:, joint, row], len(e)
    m, first, second = numbers_of(len(c))
    value, off = c[:K] @ s ** np.arange(K), form.r[joint, row]
    for k in range(m):
        slope = c[K + k] + s * c[K + m + k]
        value, off = (value + slope * e[k], off) if k < count else (value, off + abs(slope))
    for bend, i, j in zip(c[K + 2 * m :], first, second, strict=True):
        known = max(i, j) < count
        value, off = (value + bend * e[i] * e[j], off) if known else (value, off + abs(bend))
    return value - off - 1e-9, value + off + 1e-9


@pytest.mark.parametrize("delay", [0.0, 0.01])
def test_states_are_in_their_boxes(delay):
    """At drawn times of cancels, of joints that are each at a time of their own within the delay."""
    rng, (_, motion) = np.random.default_rng(3), _swing("B")
    late = Late(motion_data(motion), delay, 0.0)
    cancelled = Cancelled(motion_data(motion), RATES, late)
    boxes, times = cancelled.whole(), np.array(motion_data(motion)["times"])
    for number in range(10):
        several = 2 + (motion.n if delay and number > 3 else 0)  # also in the delays of joints
        boxes = boxes.halves(rng.integers(0, several, len(boxes.piece)))
        boxes = boxes.some(rng.permutation(len(boxes.piece))[:400])
    boxes = boxes.some(rng.permutation(len(boxes.piece))[:80])
    boxes = boxes.some(~cancelled.rested(boxes))
    assert len(boxes.piece) > 50
    for rows in cancelled.rows(boxes):
        for row, k in enumerate(rows.number):
            s, e = rng.uniform(-1, 1), rng.choice([-1, 1, rng.uniform(-1, 1)], motion.n if delay else 1)
            begin, end = times[boxes.piece[k]]
            left, right = boxes.low[k], boxes.high[k]
            u = 0.5 * (left[0] + right[0]) + 0.5 * (right[0] - left[0]) * s
            delays = slice(2, 2 + motion.n)
            first, last = left[1] - late.delay * right[delays], right[1] - late.delay * left[delays]
            own = 0.5 * (first + last) + 0.5 * (last - first) * np.broadcast_to(e, motion.n)
            state = _state(motion, 0.5 * (begin + end) + 0.5 * (end - begin) * u, own)
            for form, values in zip((rows.q, rows.qd, rows.qdd), state, strict=True):
                for joint, value in enumerate(values):
                    low, high = _ends(form, joint, row, s, e)
                    assert low <= value <= high


@pytest.mark.slow
def test_accelerations_before_a_step_are_in_boxes_until_the_delay_after_it():
    """In boxes that are much shorter than the delay: there nothing else contains these accelerations."""
    rng, (_, motion), delay = np.random.default_rng(4), _swing("B"), 0.01
    data = motion_data(motion)
    cancelled, times = Cancelled(data, RATES, Late(data, delay, 0.0)), np.array(data["times"])
    steps, first, last = np.repeat(times[:-1, 1], 20), 0.0, 1e-4
    left = rng.uniform(3e-4, 0.003, len(steps))  # of the delay, when the motion is cancelled
    t = steps + delay - left
    piece = np.searchsorted(times[:-1, 1], t)
    inside = (piece > 0) & (piece < len(times) - 1)
    (begin, end), piece, t, left = times[piece[inside]].T, piece[inside], t[inside], left[inside]
    at = [2 * (t + wide - begin) / (end - begin) - 1 for wide in (-1e-4, 1e-4)]
    at = [np.clip(u, -1, 1) for u in at]
    boxes = Boxes.of(piece, at, (np.full(len(t), first), np.full(len(t), last)), motion.n)
    for rows in cancelled.rows(boxes):
        for row, k in enumerate(rows.number):
            states = _state(motion, t[k], np.full(motion.n, last - delay + rng.uniform(0, left[k] - 2e-4)))
            for form, values in zip((rows.q, rows.qd, rows.qdd), states, strict=True):
                low, high = (part[:, row] for part in form.range)
                assert np.all((low - 1e-9 <= values) & (values <= high + 1e-9))


@pytest.mark.parametrize("divided", some(1, [False, True]))
def test_steps_of_the_motion_that_overshoot_are_in_their_boxes(divided):
    """Draws of the attack, in small boxes about their times: of the motion, of cancels, and of rests. Where
    delays are divided, also about when each joint is there.
    """
    rng, (_, motion) = np.random.default_rng(5), _swing("B")
    data = {"motion": motion_data(motion), "model": {"decelerations_on_cancel": RATES.tolist()}}
    tolerance = {"delay": 0.02, "speed": 0.0, "overshoot": 0.85}
    joints, times = worlds.LateJoints(data["motion"], tolerance), np.array(data["motion"]["times"])
    drawn = [claims._cancelled(data, joints, rng) for _ in range(400)]
    piece, t, after, whens = map(np.array, zip(*(when for when, _ in drawn), strict=True))
    begin, end = times[piece].T
    u, wide = 2 * (t - begin) / (end - begin) - 1, rng.uniform(1e-6, 1e-2, (4, len(t)))
    first, last = np.maximum(after - wide[2], 0.0), after + wide[3]
    near = np.maximum(u - wide[0], -1.0), np.minimum(u + wide[1], 1.0)
    boxes = Boxes.of(piece, near, (first, last), motion.n)
    if divided:
        lag, off = (after[:, None] - whens) / 0.02, rng.choice([1e-4, 0.3], (2, *whens.shape))
        delays = np.s_[:, 2 : 2 + motion.n]
        boxes.low[delays], boxes.high[delays] = np.maximum(lag - off[0], 0.0), np.minimum(lag + off[1], 1.0)
    cancelled, seen = Cancelled(data["motion"], RATES, Late(data["motion"], 0.02, 0.85)), 0
    boxes_of_rest = cancelled.rested(boxes)
    for rows in cancelled.rows(boxes):
        states = np.array([drawn[k][1] for k in rows.number])[~boxes_of_rest[rows.number]]
        for form, values in zip((rows.q, rows.qd, rows.qdd), states.transpose(1, 2, 0), strict=True):
            low, high = (part[:, ~boxes_of_rest[rows.number]] for part in form.range)
            assert np.all(low - 1e-9 <= values)
            assert np.all(values <= high + 1e-9)
        seen += len(states)
    assert seen > 300


def test_both_halves_of_accelerations_are_all_of_a_box():
    rng, (_, motion) = np.random.default_rng(6), _swing("B")
    cancelled = Cancelled(motion_data(motion), RATES, Late(motion_data(motion), 0.02, 0.85))
    boxes = cancelled.whole()
    for _ in range(6):
        boxes = boxes.halves(rng.integers(0, 2 + motion.n, len(boxes.piece)))
    boxes = boxes.some(rng.permutation(len(boxes.piece))[:200])
    joint = rng.integers(0, motion.n, len(boxes.piece))

    def ends(some):
        values = np.empty((3, 2, motion.n, len(some.piece)))
        for rows in cancelled.rows(some):
            values[..., rows.number] = [form.range for form in (rows.q, rows.qd, rows.qdd)]
        return values

    whole, halves = ends(boxes), ends(boxes.halves(2 + motion.n + joint))
    lower, upper = halves[..., : len(joint)], halves[..., len(joint) :]
    divided = joint == np.arange(motion.n)[:, None]
    for half in (lower, upper):  # nothing else changes
        np.testing.assert_allclose(half[:2], whole[:2], atol=1e-12)
        np.testing.assert_allclose(half[2][:, ~divided], whole[2][:, ~divided], atol=1e-9)
    (low, high), first, second = (values[2][:, divided] for values in (whole, lower, upper))
    tiny = 1e-11  # of the whole, which is rounded outwards, too
    assert np.all((first[0] <= low + tiny) & (first[1] >= second[0]) & (second[1] >= high - tiny))
    wide = high - low > 1e-3
    assert np.count_nonzero(wide) > 50
    np.testing.assert_allclose(np.diff(first[:, wide], axis=0)[0], 0.5 * (high - low)[wide], rtol=1e-6)


def _cancels(GN, rate=3.0, **changes):
    """The mass on its slide goes back and forth, and is cancelled."""
    data = _within([-1.0, 1.0], 0.003)
    data["tolerance"] = data["cover_within"] = None
    del data["bounds"]["GT_worst_case"]
    data["model"]["decelerations_on_cancel"] = [rate]
    data["bounds"] |= {"GN_cancel": GN, "GT_cancel": 0.9, "angle_margin_cancel": 1.0}
    forces = [[[[f, 0.0, 0.0] for f in _weights()]]] * 2
    named = {"forces": [forces] * 4, "weights": [[[1.0, 1.0]] * 3] * 4}
    data["cover_cancel"] = {"trees": ["."] * 4, **named} | changes
    return data


def test_a_cancel_by_hand():
    """At rest 6.867 N m are left about the rear line; the mass that goes back decelerates by 3 m/s^2."""
    enough, short = (0.49 / (0.49 + 6.867 - x) for x in (3.02, 2.98))
    verdict = _judged(_cancels(enough))
    assert verdict.holds, verdict.problems
    assert verdict.moments["GN_cancel"] == pytest.approx(6.867 - 3.02)
    assert "tip-over in cancels: not proved" in _judged(_cancels(short)).problems
    assert _judged(_cancels(0.49 / (0.49 + 6.867 - 1.52), rate=1.5)).holds


def test_the_force_of_a_drive_in_a_cancel_by_hand():
    """2 kg on a slide decelerate by 3 m/s^2: 6 of 100 N."""
    for bound, holds in ((0.0601, True), (0.0599, False)):
        data = _cancels(0.2)
        data["bounds"]["torque_ratio_cancel"] = bound
        assert _judged(data).holds == holds


@pytest.mark.parametrize(
    "changes",
    [
        {"trees": ["."] * 3},
        {"trees": ["."] * 5},
        {"trees": ["", ".", ".", "."]},
        {"trees": ["..", ".", ".", "."]},
        {"trees": ["t.", ".", ".", "."]},
        {"trees": ["x", ".", ".", "."]},
        {"trees": ["t..", ".", ".", "."]},
        {"trees": ["A..", ".", ".", "."]},
        {"trees": ["A.", ".", ".", "."]},
        {"trees": ["C..", ".", ".", "."]},
        {"trees": "...."},
        {"trees": [["."]] * 4},
        {"trees": None},
        {"forces": []},
        {"weights": []},
        {"weights": [[[-1.0, 1.0]] * 3] * 4},
    ],
)
def test_other_covers_are_refused(changes):
    verdict = _judged(_cancels(0.2, **changes))
    assert not verdict.holds
    assert verdict.problems


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("decelerations_on_cancel", [0.0]),
        ("decelerations_on_cancel", [-3.0]),
        ("decelerations_on_cancel", [3.0, 3.0]),
        ("decelerations_on_cancel", [1e300]),
        ("GN_cancel", 1.0),
        ("GT_cancel", None),
        ("GN_cancel_worst_case", 0.5),
        ("angle_margin_cancel", float("nan")),
        ("torque_ratio_cancel", 0.0),
        ("torque_ratio_cancel", float("nan")),
        ("torque_ratio_cancel_worst_case", 0.5),  # without a tolerance
    ],
)
def test_other_claims_are_refused(key, value):
    data = _cancels(0.2)
    place = data["model"] if key in data["model"] else data["bounds"]
    place[key] = value
    assert not _judged(data).holds


@pytest.mark.parametrize(
    "key", ["decelerations_on_cancel", "GN_cancel", "cover_cancel", "angle_margin_cancel"]
)
def test_claims_need_their_data(key):
    data = _cancels(0.2)
    for place in (data, data["model"], data["bounds"]):
        place.pop(key, None)
    assert not _judged(data).holds


@pytest.fixture(scope="module")
def nodding():
    """A nod, within an uncertainty of small delays, that can be cancelled: robot, limits, check, proof, what
    the proof says as it goes on.
    """
    task, said = experiment_task("B"), []
    tolerance = Uncertainty(delay=0.005, speed=0.02, friction=0.05, damping=0.2, tilt=0.005)
    cancel = Cancel(tuple((0.15 * task.robot.limits.acceleration).tolist()))
    limits = replace(task.limits, tolerance=tolerance, cancel=cancel)
    motion = _nod(task)
    checked = check_motion(task.robot, motion, limits)
    return task.robot, limits, checked, certify(task.robot, motion, limits, checked.worst, said.append), said


def test_a_proof_says_how_much_is_done(nodding):
    *_, said = nodding
    for what in ("the nominal motion", "the worst case", "cancels", "the worst case of cancels"):
        texts = [text for text in said if text.startswith(f"proving {what}: ") and "%" in text]
        shares = [float(text.split(": ")[1].partition(" %")[0]) for text in texts]
        assert shares, what
        assert shares == sorted(shares), what
    assert texts[0].endswith(" boxes left ...")


def test_cancels_are_proved_close_to_their_sampled_worst_values(nodding):
    _, _, checked, found, _ = nodding
    assert found.certified
    assert found.cancels
    bounds = found.verdict.bounds
    for name, near in (("GN_cancel", 1.03), ("GN_cancel_worst_case", 1.15)):
        assert checked.worst[name].value <= bounds[name] <= near * checked.worst[name].value
    assert bounds["angle_margin_cancel"] <= np.radians(checked.worst["angle_margin_deg_cancel"].value)


def test_torques_of_cancels_are_proved_close_to_drawn_ones(nodding):
    """Joints on time, as planned and faster by the speed factor."""
    robot, limits, _, found, _ = nodding
    bounds, rates = found.verdict.bounds, np.array(limits.cancel.decelerations)
    motion, rng = _nod(experiment_task("B")), np.random.default_rng(0)
    instants, count = np.append(rng.uniform(0, motion.end, 400), motion.event_times), 7
    q, v, _ = motion.states(instants)
    states = limits.cancel.states_at(
        q, v, np.repeat(np.arange(len(q)), count), np.tile(np.linspace(0, 1, count), len(q))
        * np.repeat(np.max(np.abs(v) / rates, axis=1), count) * 0.999,
    )  # fmt: skip
    drawn = np.abs(robot.loads(states.q, states.qd, states.qdd)[0]) / robot.limits.torque
    assert np.max(drawn) <= bounds["torque_ratio_cancel"] <= limits.torque_ratio
    assert np.max(drawn) > 0.6 * bounds["torque_ratio_cancel"]
    speed = 1 + limits.tolerance.speed
    faster = robot.loads(states.q, speed * states.qd, speed**2 * states.qdd)[0] / robot.limits.torque
    assert np.max(np.abs(faster)) <= bounds["torque_ratio_cancel_worst_case"] <= limits.torque_ratio
    assert "joint torque in cancels <= " in str(found)


@pytest.mark.slow
def test_no_drawn_cancel_is_worse_than_proved(nodding):
    """Wrenches by ball arithmetic, contact forces by a linear program."""
    _attacked(nodding[0], nodding[3], 40)


def _attacked(robot, found, count):
    rng, model, tolerance = np.random.default_rng(2), found.data["model"], found.data["tolerance"]
    bounds, joints = found.data["bounds"], worlds.LateJoints(found.data["motion"], tolerance)
    asked = bounds["GN_cancel_worst_case"], bounds["GT_cancel_worst_case"]
    for _ in range(count):
        _, state = claims._cancelled(found.data, joints, rng)
        world = worlds.random_world(model, tolerance, rng, ends=0.8)
        wrench = claims._numbers(worlds.loads(model, world, state))[1]
        assert robot.tip_over.evaluate(robot.contact_states(wrench[None])).GN[0] <= asked[0]
        if len(model["contacts"]["positions"]) == 3:  # forces of more are not unique
            assert claims._contacts(model, wrench, *asked, 1 - tolerance["friction"]) is None


@pytest.mark.slow
def test_cancels_that_are_too_hard_are_not_proved(nodding):
    """The times of cancels in which a contact may be lost are named."""
    robot, limits, _, found, _ = nodding
    hard = Cancel(tuple((4.0 * robot.limits.acceleration).tolist()))
    model = found.data["model"] | {"decelerations_on_cancel": list(hard.decelerations)}
    parts = found.data["motion"], found.data["tolerance"], replace(limits, cancel=hard)
    other = cancel_claims(robot, model, *parts, {}, np.empty(0))
    assert not other.bounds
    assert not other.cover
    nominal, within = (str(Undecided(*one)) for one in other.short)
    assert nominal.startswith("contacts when cancelled")
    assert within.startswith("contacts when cancelled within the uncertainty")


@pytest.mark.slow
def test_delays_of_joints_are_divided_where_times_are_not_enough():
    """A UR5 on its cart, joints in step: only what the first joint does at its step, which the others do not
    share, lets the proof reach a motion whose samples have GN 0.958.
    """
    task = load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
    robot, rates = task.robot, task.robot.limits.acceleration
    limits = replace(task.limits, cancel=Cancel(tuple((0.15 * rates).tolist())))
    motion = Trajectory.ending_together(task.start, task.goal, [None] * 6, robot.limits.speed, rates)
    motion = motion.time_scaled(1.2421512 / motion.end)
    checked = check_motion(robot, motion, limits)
    assert 0.95 < checked.worst["GN_cancel_worst_case"].value < 0.97
    found = certify(robot, motion, limits, checked.worst)
    assert found.cancels
    trees = "".join(found.data["cover_cancel_within"]["trees"])
    assert "A" in trees  # delays of the first joint
    assert check_certificate(found.data).holds
    _attacked(robot, found, 60)
    whole = [
        "." if set(tree) & set("ABCDEF") else tree for tree in found.data["cover_cancel_within"]["trees"]
    ]
    other = found.data | {"cover_cancel_within": found.data["cover_cancel_within"] | {"trees": whole}}
    assert not check_certificate(other).holds


def test_a_foot_that_would_lift_if_all_were_equally_compliant_gets_less_of_the_load():
    """The arm leans over one of four feet; hardly any friction is left. Without that sharing of the load no
    size of boxes is enough.
    """
    task = experiment_task("B")
    support, turns = task.robot.support, np.pi / 2 * np.arange(4)
    feet = 0.2 * 2**0.5 * np.stack([np.cos(turns), np.sin(turns)]).T + [0.0, 0.12]
    height = support.contacts[0].position[2]
    contacts = [replace(support.contacts[0], friction=0.0232, position=[*foot, height]) for foot in feet]
    robot = task.robot.varied(support=support.varied(contacts))
    cancel = Cancel(tuple((0.15 * robot.limits.acceleration).tolist()))
    limits, motion = replace(task.limits, cancel=cancel, tolerance=NONE), _nod(task)
    checked = check_motion(robot, motion, limits)
    assert checked.contacts.alike.value < -15  # N, of the foot behind
    found = certify(robot, motion, limits, checked.worst)
    assert found.cancels
    cover = found.data["cover_cancel"]
    shared = [not np.any(forces) and len(np.unique(shares)) > 1 for forces, shares in _boxes(cover)]
    assert any(shared)
    alike = [
        np.ones_like(shares).tolist() if one else shares
        for one, (_, shares) in zip(shared, _boxes(cover), strict=True)
    ]
    assert not check_certificate(found.data | {"cover_cancel": cover | {"weights": alike}}).holds


def _boxes(cover):
    """Forces and weights of each box."""
    return list(zip(cover["forces"], cover["weights"], strict=True))
