"""Stops by a cancelled controller: states by hand, Pinocchio's wrenches, the worst of an uncertainty."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.basics.text import percent, quantity
from ocptip.motion.objective import TIME
from ocptip.motion.stops.cancels import in_all, rounded_down, safe_decelerations
from ocptip.motion.stops.check import _contact_text
from ocptip.motion.stops.tables import CancelTable
from ocptip.motion.violations import sentence, statement
from ocptip.published.tasks import experiment_task
from ocptip.reserves import fractional
from ocptip.retiming.retime import least_cost
from ocptip.standing.limit_kinds.limit import Sampled
from ocptip.standing.limit_kinds.worst_cancels import WorstCancelLimit
from ocptip.standing.stops.by_cancel import Cancel, CancelCheck, cancel_times, cancelled_motion, stop_states
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.cancelled import worst_of_cancels
from ocptip.standing.within.worst_case import worst_case_of
from ocptip.task_files.motion import load_task
from ocptip.trajectories.path_fit import rounded_lines
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import INSIDE, Trajectory
from tests.places import EXAMPLES
from tests.quick import some
from tests.robots.pinocchio_twin import dynamics, twin


@pytest.fixture(scope="module")
def ur5():
    return load_task(EXAMPLES / "tasks" / "ur5_cart.toml")


@pytest.fixture(scope="module")
def case():
    return experiment_task("C", "effective")


def controller_at(q, qd, rates, t):
    """Joint by joint, as in the controller's source: a speed that falls to zero, then the hold position."""
    found = []
    for angle, speed, rate in zip(q, qd, rates, strict=True):
        stop, sign = abs(speed) / rate, np.sign(speed)
        if t < stop:
            found.append(
                (angle + speed * t - 0.5 * sign * rate * t * t, speed - sign * rate * t, -sign * rate)
            )
        else:
            found.append((angle + sign * speed**2 / (2 * rate), 0.0, 0.0))
    return np.array(found).T


def test_states_are_those_of_the_controller_between_the_stops_of_joints():
    rng = np.random.default_rng(0)
    q, qd, rates = rng.normal(size=(20, 6)), rng.normal(size=(20, 6)), rng.uniform(0.5, 3, 6)
    qd[0, :3] = 0.0
    found = stop_states(q, qd, rates)
    stops = np.abs(qd) / rates
    inside = np.min(np.abs(found.after[:, None] - stops[found.owner]), axis=1) > 1e-9
    assert inside.sum() > 200
    for k in np.flatnonzero(inside):
        own = found.owner[k]
        expected = controller_at(q[own], qd[own], rates, found.after[k])
        np.testing.assert_allclose([found.q[k], found.qd[k], found.qdd[k]], expected, atol=1e-9)
    for own in range(20):
        rows = np.flatnonzero(found.owner == own)
        assert found.after[rows[-1]] == pytest.approx(np.max(stops[own]))
        assert not found.qdd[rows[-1]].any()
        for end in stops[own][stops[own] > 0]:  # both sides of every stop of a joint
            assert np.sum(np.abs(found.after[rows] - end) < 1e-12) >= 2


def test_joints_that_stop_together_stay_on_a_line_and_the_leading_one_has_its_rate():
    """As the manual says of stopj: linear in joint space, the acceleration is that of the leading axis."""
    rng = np.random.default_rng(1)
    q, qd, most = rng.normal(size=(20, 6)), rng.normal(size=(20, 6)), rng.uniform(0.5, 3, 6)
    qd[0, :3], qd[1] = 0.0, 0.0
    cancel = Cancel(tuple(most), together=True)
    found = cancel.states(q, qd)
    for own in range(20):
        rows = np.flatnonzero(found.owner == own)
        longest = np.max(np.abs(qd[own]) / most)
        assert found.after[rows[-1]] == pytest.approx(longest)
        t = found.after[rows]
        scale = 1 - t / longest if longest else 0 * t
        np.testing.assert_allclose(found.qd[rows], scale[:, None] * qd[own], atol=1e-9)
        way = t - t**2 / (2 * longest) if longest else 0 * t
        np.testing.assert_allclose(found.q[rows], q[own] + way[:, None] * qd[own], atol=1e-9)
        assert np.max(np.abs(found.qdd[rows]) / most) == pytest.approx(float(longest > 0))
    moving = np.abs(qd) > 0
    assert np.all(cancel.rates(qd)[~moving] == np.broadcast_to(most, qd.shape)[~moving])


@pytest.mark.slow
def test_the_worst_of_joints_that_stop_together_is_that_of_a_dense_search(case):
    robot, motion = case.robot, case.reference
    cancel = Cancel((4.0,) * robot.n, together=True)
    times, found = cancelled_motion(robot, motion, cancel)
    moments = []
    for t in times:
        q, qd, _ = motion.states(t)
        longest = np.max(np.abs(qd)) / 4.0
        after = np.linspace(0, longest, 9)[:, None]
        states = (
            q + qd * after * (1 - after / (2 * longest)),
            qd * (1 - after / longest),
            0 * after - qd / longest,
        )
        moments.append(np.max(robot.tip_over.evaluate(robot.contact_states(robot.loads(*states)[1])).GN))
    assert np.max(found.GN) >= np.max(moments) - 1e-6
    assert np.max(found.GN) == pytest.approx(np.max(moments), rel=0.02)
    shares = safe_decelerations(robot, motion, case.limits, replace(cancel, GN=0.9, GT=0.9), of_limits=False)
    assert shares.text.startswith("safe at ")
    assert f"of stopj(4), at 100 % {shares.deceleration(shares.maximum)}, harder ones were not" in shares.text
    assert shares.yaml == f"stopj({rounded_down(4 * shares.maximum):g})"
    assert shares.to_dict()["urscript"] == shares.yaml


def test_tipping_moments_are_those_of_pinocchio(ur5):
    """Its recursive Newton-Euler algorithm, and the least moment about the edges of the four wheels."""
    robot, rng = ur5.robot, np.random.default_rng(1)
    q, qd = rng.uniform(-1, 1, (2, 3, 6))
    rates = np.array([5.0, 6.0, 7.0, 8.0, 9.0, 10.0])
    model, support = twin(robot.arm), robot.support
    corners = np.array([contact.position for contact in support.contacts])
    centre = support.center_of_mass
    states, least = stop_states(q, qd, rates), np.full(3, np.inf)
    for own, *state in zip(states.owner, states.q, states.qd, states.qdd, strict=True):
        on_base = dynamics(model, *state, support.gravity, np.zeros(3), np.zeros(3), centre)[1]
        force, moment = on_base[:3] + support.mass * support.gravity, on_base[3:]
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            about = moment + np.cross(centre - a, force)
            along = (b - a) / np.linalg.norm(b - a)
            least[own] = min(least[own], -along @ about if np.cross(b - a, -a)[2] > 0 else along @ about)
    found = CancelCheck(robot, Cancel(tuple(rates))).stops(q, qd)
    expected = robot.tip_over.reference_moment / (robot.tip_over.reference_moment + least)
    assert np.all(least > 0)
    np.testing.assert_allclose(found.GN, expected, rtol=1e-6)


def test_harder_cancels_load_the_base_more_and_take_less_time(case):
    found = [
        cancelled_motion(case.robot, case.reference, Cancel(tuple(share * case.robot.limits.acceleration)))[1]
        for share in (0.2, 0.5, 1.0)
    ]
    worst = [np.max(one.GN) for one in found]
    assert worst[0] < worst[1] < worst[2]
    assert found[0].rests.max() > found[1].rests.max() > found[2].rests.max()
    assert np.all(found[0].displacements.max(axis=0) >= found[2].displacements.max(axis=0))


def test_refinement_finds_no_less_than_a_dense_grid(case):
    cancel = Cancel(tuple(0.7 * case.robot.limits.acceleration))
    _, found = cancelled_motion(case.robot, case.reference, cancel)
    q, qd, _ = case.reference.states(np.arange(0, case.reference.end, 1e-3))
    dense = CancelCheck(case.robot, cancel).stops(q, qd)
    assert np.max(found.GN) >= np.max(dense.GN) - 1e-3


def test_a_recording_with_many_samples_is_cancelled_all_along():
    times = np.arange(0, 1.0005, 1e-3)
    found = cancel_times(Trajectory.from_points(times, np.sin(times)[:, None] ** 2))
    assert 2e-3 < np.diff(found, prepend=0.0, append=1.0).max() < 5e-3


def test_safe_decelerations_end_where_a_limit_does(case):
    robot, motion, limits = case.robot, case.reference, case.limits
    full = Cancel(tuple(robot.limits.acceleration), GN=limits.GN, GT=limits.GT)
    found = safe_decelerations(robot, motion, limits, full)
    assert 0 < found.minimum < found.maximum < 1
    inside = [level for level in found.levels if found.minimum <= level.share <= found.maximum]
    assert len(inside) >= 3
    assert all(level.safe for level in inside)
    above = min(level.share for level in found.levels if level.share > found.maximum)
    level = next(level for level in found.levels if level.share == above)
    worst = level.broken[0]
    assert worst.name in ("GN", "GT")
    assert worst.value > worst.limit
    assert 0 <= worst.time <= motion.end
    share, broken = (
        f"{100 * found.hardest.lost:.3g} % of the instants",
        r"tipping margin|friction used|the base",
    )
    assert re.search(rf"; at 100 % ({broken}) .* in a cancel begun at .* \({share}\)", found.text), found.text
    assert "GN" not in found.text
    assert "plan with --stop-safe cancel" in found.text
    assert above - found.maximum <= 0.006
    below = max((level for level in found.levels if level.share < found.minimum), key=lambda own: own.share)
    assert any(worst.name in ("angle_margin_deg", "duration") for worst in below.broken)
    rates = [float(part.split("}")[0]) for part in found.yaml.split("max_deceleration_on_cancel: ")[1:]]
    highest = found.maximum * robot.limits.acceleration
    assert np.all((np.array(rates) <= highest) & (np.array(rates) > 0.99 * highest))
    slow = safe_decelerations(robot, motion, limits, replace(full, longest=0.6), close=1.0)
    assert slow.minimum > found.minimum


@pytest.mark.slow
def test_a_plan_for_cancels_is_not_advised_again(case):
    """Nor where drives lack torque. All instants break that here: it is named first, contacts beside it."""
    robot, motion, limits = case.robot, case.reference, case.limits
    full = Cancel(tuple(robot.limits.acceleration), GN=limits.GN, GT=limits.GT)
    arm = replace(robot.arm, limits=replace(robot.limits, torque=1e-3 * robot.limits.torque))
    gentle = Cancel(tuple(0.3 * robot.limits.acceleration), GN=1.0, GT=1.0)
    tilted = replace(limits, tolerance=Uncertainty(tilt=0.1))
    for own, cancel in ((limits, full), (tilted, gentle)):
        found = safe_decelerations(robot.varied(arm=arm), motion, own, cancel, close=1.0)
        first, *others = found.hardest.broken
        assert first.name == "torque_ratio"
        assert first.value == pytest.approx(found.hardest.torque_ratio)
        assert {one.name for one in others} <= {"GN", "GT"}
        assert others
        assert "--stop-safe" not in found.text
    planned = safe_decelerations(robot, motion, replace(limits, cancel=full), full, close=1.0)
    assert not planned.hardest.safe
    assert "--stop-safe" not in planned.text


def test_a_cancel_within_an_uncertainty_has_its_worst_case_in_words(case):
    """Beside the nominal margin: the same instants as `worst_of_cancels`, M = M0 (1 / GN - 1)."""
    robot, motion = case.robot, case.reference
    cancel = Cancel(tuple(0.3 * robot.limits.acceleration))
    limits = replace(case.limits, tolerance=Uncertainty(tilt=1e-3))
    worst = CancelTable(robot, motion, limits, cancel, cancel_times(motion)[:2]).worst()
    at, used = worst_of_cancels(worst_case_of(robot, limits.tolerance), motion, cancel, cancel_times(motion))
    bound = at.value if at.bound is None else at.bound
    assert worst["GN"] < bound < 1
    least = robot.tip_over.reference_moment * (1 / bound - 1)
    assert worst["tipping_margin_within_Nm"] == pytest.approx(least, rel=1e-12)
    text = _contact_text(worst)
    assert re.fullmatch(
        r"tipping margin >= [\d.]+ N m \(worst case >= [\d.]+ N m\), "
        r"friction used <= [\d.]+ % \(worst case <= [\d.]+ %\)",
        text,
    )
    assert f"(worst case >= {quantity(least, 'N m', 3)})" in text
    assert f"(worst case <= {percent(used.value)})" in text
    assert "worst case the base tips" in _contact_text({**worst, "GN_within": 1.2})


@pytest.mark.slow
def test_more_than_all_is_checked_where_it_is_asked_for(case):
    """Beside the shares up to 100 %, which stay."""
    robot, motion, limits = case.robot, case.reference, case.limits
    full = Cancel(tuple(0.5 * robot.limits.acceleration), GN=1.0, GT=1.0, longest=5.0)
    loose = replace(limits, GN=1.0, GT=1.0)
    alone = safe_decelerations(robot, motion, loose, full, close=1.0)
    more = safe_decelerations(robot, motion, loose, full, close=1.0, most=4.0)
    assert alone.hardest.share == 1.0
    assert more.hardest.share == 4.0
    assert set(alone.levels) <= set(more.levels)
    assert more.hardest.GN > alone.hardest.GN


def test_without_a_safe_deceleration_both_ends_and_a_remedy_are_named(case):
    robot, motion, limits = case.robot, case.reference, case.limits
    full = Cancel(tuple(robot.limits.acceleration), GN=limits.GN, GT=limits.GT, longest=0.01)
    found = safe_decelerations(robot, motion, limits, full, close=1.0)
    assert found.maximum is None
    assert "at 100 % " in found.text
    assert "; at 5 % " in found.text
    assert "compliant" not in found.text
    soft = robot.support.varied([replace(foot, stiffness=1e6) for foot in robot.support.contacts])
    assert "; forces of compliant feet not checked)" in replace(found, robot=robot.varied(support=soft)).text
    assert found.text.endswith("To plan for it, try ocptip plan with --stop-safe cancel")
    # What plans leave out is no reason to plan for cancels.
    torque = replace(found.hardest.broken[0], name="torque_ratio")
    lacking = [replace(level, broken=(*level.broken, torque)) for level in found.levels]
    found = replace(found, levels=tuple(lacking))
    assert found.text.endswith(
        ". Plans keep no torques in cancels: plan with slower motions (--duration) or a lighter payload, "
        "then check"
    )
    assert in_all([found, found]).endswith("then check")
    found = replace(
        found, levels=(*lacking[:4], replace(lacking[4], broken=lacking[4].broken[:-1]), *lacking[5:])
    )
    assert found.text.endswith("To plan for it, try ocptip plan with --stop-safe cancel --deceleration 40%")


def test_of_several_broken_limits_that_of_most_instants_is_named_and_the_others_beside_it(case):
    """Shares of the instants by hand: durations and ways of uniform deceleration of each joint alone."""
    robot, motion = case.robot, case.reference
    rates = 0.05 * robot.limits.acceleration
    limits = replace(case.limits, GN=1.0, GT=1.0)
    full = Cancel(tuple(robot.limits.acceleration), GN=0.95, GT=0.99, longest=0.1)
    found = safe_decelerations(robot, motion, limits, full, close=1.0)
    q, qd, _ = motion.states(cancel_times(motion))
    ends = q + np.sign(qd) * qd**2 / (2 * rates)
    beyond = np.maximum(robot.limits.angle_min - ends, ends - robot.limits.angle_max)
    shares = {one.name: one.share for one in found.levels[-1].broken}
    assert shares["duration"] == np.mean(np.max(np.abs(qd) / rates, axis=1) > 0.1)
    assert shares["angle_margin_deg"] == np.mean(np.any(beyond > 1e-9, axis=1))
    assert 0 < shares["GN"] < shares["angle_margin_deg"] < shares["duration"] < 1
    assert [*shares.values()] == sorted(shares.values(), reverse=True)
    share = f"{100 * shares['duration']:.3g} % of the instants"
    also = "also broken: angle margin, tipping margin"
    words = rf"; at 5 % duration is .* s in .*, must be <= 0.1 s \({share}; {also}"
    assert re.search(words, found.text), found.text


def test_a_cycle_has_one_proposal_that_fits_all_segments(case):
    robot, motion, limits = case.robot, case.reference, case.limits
    full = Cancel(tuple(robot.limits.acceleration), GN=limits.GN, GT=limits.GT, longest=5.0)
    found = safe_decelerations(robot, motion, limits, full, close=1.0)
    one, other = (replace(found, minimum=a, maximum=b) for a, b in ((0.05, 0.3), (0.1, 0.65)))
    unsafe = replace(found.hardest, broken=(statement("the base tips"),))
    one, other = (replace(own, levels=(unsafe, *own.levels[1:])) for own in (one, other))
    assert in_all([one, other]).startswith("all segments: safe at 10 to 30 %; set at most that ")
    assert in_all([one, other]).endswith("plan with --stop-safe cancel --deceleration 30%")
    none = [replace(own, minimum=None, maximum=None) for own in (one, other)]
    stopping = [replace(unsafe, share=share, stops=True) for share in (0.65, 0.5)]
    none = [replace(own, levels=(level,)) for own, level in zip(none, stopping, strict=True)]
    assert in_all(none).endswith(
        "no deceleration is safe in all of them. To plan for it, try ocptip plan "
        "with --stop-safe cancel --deceleration 65%"
    )


@pytest.mark.slow
def test_within_an_uncertainty_nothing_sampled_is_worse(case):
    """Deviations drawn at random, joints delayed each by itself, in states of random stops."""
    robot, motion = case.robot, case.reference
    own = Uncertainty(base_mass=0.05, tilt=0.01, arm_mass=0.05, delay=0.01)
    cancel = Cancel(tuple(0.3 * robot.limits.acceleration))
    cases, times = worst_case_of(robot, own), cancel_times(motion)
    tip, slip = worst_of_cancels(cases, motion, cancel, times)
    plain = next(worst_of_cancels(worst_case_of(robot, Uncertainty(arm_mass=1e-9)), motion, cancel, times))
    assert plain.value == pytest.approx(np.max(cancelled_motion(robot, motion, cancel)[1].GN), rel=0.02)
    assert tip.value > plain.value
    asked = replace(case.limits, cancel=cancel, tolerance=own)
    sampled = Sampled(robot, motion, times, lambda time: None)
    limits = WorstCancelLimit.of(robot, asked, tuple(range(6)))
    results = [worst for limit in limits for worst in limit.worst(np.empty(0), sampled)]
    assert [worst.name for worst in results] == ["GN_cancel_worst_case", "GT_cancel_worst_case"]
    assert [worst.value for worst in results] == [tip.bound, slip.value]
    rng, rates = np.random.default_rng(0), np.array(cancel.decelerations)
    theta = rng.uniform(cases.deviations.low, cases.deviations.high, (4000, cases.deviations.size))
    for name in ("gravity", "delay"):
        if name in cases.deviations.places:
            theta[:, cases.deviations.places[name]] = 0.0
    count, n = len(theta), robot.n
    begun, after = rng.uniform(0, motion.end, count)[:, None], rng.uniform(0, 0.2, count)[:, None]
    passed = after - rng.choice([0.0, own.delay], (count, n))  # since each joint was told to decelerate
    start = [part.reshape(count, n, n) for part in motion.states(np.repeat(begun, n, axis=1).ravel())]
    path = [part.reshape(count, n, n) for part in motion.states((begun + passed).ravel())]
    s, each = np.empty((count, 3, n)), np.arange(n)
    q, qd = (part[:, each, each] for part in start[:2])
    stopped = np.minimum(np.maximum(passed, 0), np.abs(qd) / rates)
    rate = np.sign(qd) * rates
    s[:, 0] = q + stopped * (qd - 0.5 * rate * stopped)
    s[:, 1] = qd - rate * stopped
    s[:, 2] = np.where(np.abs(qd) / rates > passed, -rate, 0.0)
    for k, part in enumerate(path):
        s[:, k] = np.where(passed < 0, part[:, each, each], s[:, k])
    s = s.reshape(count, -1)
    moments = cases._map(cases.deviations.wrench(s, theta)[0])[0]
    worst = robot.tip_over.reference_moment / (robot.tip_over.reference_moment + moments.min())
    assert worst <= tip.value + 1e-6
    assert slip.value > 0


def drawn_cancels(motion, cancel, late, more, count, rng):
    """States (count, 3 n) of joints that are each at a time of their own in the delay, or overshoot there.

    The steps of a joint are those of the motion, the cancel, and its rest.
    """
    times, n, s = motion.event_times, motion.n, np.empty((count, 3, motion.n))
    before, after = (motion.states(times + side * INSIDE)[2].T for side in (-1, 1))
    for k in range(count):
        t = float(rng.choice(times)) + rng.uniform(0, late)
        q, v, _ = (part[0] for part in motion.states(np.array([t])))
        acting, rates = motion.states(np.array([t + INSIDE]))[2][0], cancel.rates(v[None])[0]
        slower, rests = -np.sign(v) * rates, np.abs(v) / rates
        now = t + rng.choice([0.0, *rests]) + rng.choice([0.0, rng.uniform(0, late)])
        for j in range(n):
            steps = [step for step in zip(times, before[j], after[j], strict=True) if step[0] <= t]
            steps += [(t, acting[j], slower[j]), (t + rests[j], slower[j], 0.0)]
            steps = [step for step in steps if abs(step[2] - step[1]) > 1e-6]
            inside = [i for i, step in enumerate(steps) if now - late <= step[0] <= now]
            at, own = now - rng.uniform(0, late), None
            if inside and rng.random() < 0.75:
                last = int(rng.choice(inside))
                first = int(rng.choice([i for i in inside if i <= last]))
                at, _, own = steps[last]
                own += more * sum(step[2] - step[1] for step in steps[first : last + 1])
            if at < t:
                state = [part[0, j] for part in motion.states(np.array([at]))]
            else:
                state = controller_at(q[j : j + 1], v[j : j + 1], rates[j : j + 1], at - t)[:, 0]
            s[k, :, j] = *state[:2], state[2] if own is None else own
    return s.reshape(count, -1)


@pytest.mark.slow
@pytest.mark.parametrize(("delay", "together"), some(1, [(0.01, False), (0.0, False), (0.01, True)]))
def test_steps_of_the_motion_overshoot_in_cancels(ur5, delay, together):
    """No drawn state tips more than reported, but by 0.002 of GN: instants and states are samples. Of all
    combinations none uses more friction, but by 0.001: by slopes alone they did, 0.23 instead of 0.15.
    """
    robot, rng = ur5.robot, np.random.default_rng(1)
    speed, acceleration, way = robot.limits.speed, robot.limits.acceleration, [1.0, 0.8, -1.0, 0.5, 0.3, 0.4]
    ramps = [RampCommand(*own) for own in zip(way, 0.4 * speed, 0.3 * acceleration, strict=True)]
    motion = Trajectory.from_profiles([0.0, -1.2, 1.2, 0.0, 0.0, 0.0], [[ramp] for ramp in ramps])
    cancel = Cancel(tuple(0.1 * acceleration), together=together)
    own = Uncertainty(delay=delay, damping=0.1)
    cases = worst_case_of(robot, own)
    tip, slip = worst_of_cancels(cases, motion, cancel, cancel_times(motion))
    s = drawn_cancels(motion, cancel, own.late, own.overshoot, 1000, rng)
    wrenches = cases.deviations.wrench(s, cases.deviations.nominal(len(s)))[0]
    used = float(np.max(cases.footing.slip.greatest(wrenches)))
    assert used <= slip.value + 1e-3
    assert used > 0.9 * slip.value
    drawn = float(cases.tip_ratio(cases._map(wrenches)[0].min()))
    assert drawn <= tip.value + 2e-3
    assert drawn > 0.9 * tip.value


@pytest.mark.slow
def test_slip_is_searched_only_where_it_can_exceed_what_is_enough(ur5, monkeypatch):
    """Four feet: half spaces show the rest; and delayed joints are worst where their slopes say so."""
    robot, rates = ur5.robot, (ur5.robot.limits.speed / 2, ur5.robot.limits.acceleration / 4)
    motion = Trajectory.ending_together(np.zeros(6), np.full(6, 0.8), [None] * 6, *rates)
    own = Uncertainty(base_mass=0.05, friction=0.1, delay=0.01, damping=0.05)
    cancel, times = Cancel(tuple(0.2 * robot.limits.acceleration)), cancel_times(motion)[::10]
    cases = worst_case_of(robot, own)
    tip, slip = worst_of_cancels(cases, motion, cancel, times)
    assert 0.1 < slip.value < 0.6
    solved = []
    solve = fractional.largest_growth
    monkeypatch.setattr(
        fractional, "largest_growth", lambda A, *loads: solved.append(len(A)) or solve(A, *loads)
    )
    assert list(worst_of_cancels(cases.up_to(0.9), motion, cancel, times)) == [tip, None]
    assert not solved
    assert list(worst_of_cancels(cases.up_to(0.9 * slip.value), motion, cancel, times)) == [tip, slip]
    assert solved
    monkeypatch.setattr("ocptip.standing.within.worst_options.CLOSER", 10**9)
    assert list(worst_of_cancels(cases, motion, cancel, times)) == [tip, slip]


def test_rounding_never_exceeds_a_safe_value():
    for value in (6.1525, 352.5, 0.44063, 14.79999, 1.0):
        assert 0.99 * value <= rounded_down(value) <= value


def test_what_cannot_be_is_refused(case):
    with pytest.raises(InputError, match="must be > the reaction time"):
        Cancel((1.0,), reaction=2.5)
    with pytest.raises(InputError, match=r"cancel\.decelerations"):
        Cancel((0.0,))
    limits = replace(case.robot.limits, acceleration=np.array([1, np.inf, 1, 1, 1, 1.0]))
    robot = case.robot.varied(arm=replace(case.robot.arm, limits=limits))
    with pytest.raises(InputError, match="joint 2 has no acceleration limit"):
        case.stops.cancel(robot, case.limits)


def test_the_smallest_clearance_names_its_bodies_and_when():
    """The posture at that time after that cancel has this distance between these bodies, none smaller."""
    task = experiment_task("A")
    robot, motion = task.robot, task.reference
    cancel = Cancel(tuple(robot.limits.acceleration.tolist()))
    times, found = cancelled_motion(robot, motion, cancel)
    i = int(np.argmin(found.clearances))
    q, v, _ = (part[0] for part in motion.states(times[i : i + 1]))
    rate = np.array(cancel.decelerations)
    after = np.minimum(found.nearest_after[i], np.abs(v) / rate)
    gaps = robot.collision.gaps((q + v * after - np.sign(v) * rate * after**2 / 2)[None])[0]
    assert gaps.min() == gaps[found.nearest[i]] == pytest.approx(found.clearance, abs=1e-9)
    table = CancelTable(robot, motion, replace(task.limits, clearance=5.0), cancel, times[:2])
    [text] = [sentence(broken) for broken in table.violations() if broken.name == "clearance"]
    assert f"between {robot.collision.labels[found.nearest[i]]} " in text
    assert f" s after a stop begun at {times[i]:.4f} s, must be >= 5000.0 mm" in text


def test_a_path_from_and_to_end_stops_can_be_timed_for_cancels():
    """The joint that moves starts at one end of its range and stops at the other."""
    task = load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
    robot = task.robot
    ends = np.stack([task.start, task.start])
    ends[1, 0] += 0.4
    known = robot.arm.limits
    low, high = known.angle_min.copy(), known.angle_max.copy()
    low[0], high[0] = ends[:, 0]
    arm = replace(robot.arm, limits=replace(known, angle_min=low, angle_max=high))
    cancel = Cancel(tuple(np.full(robot.n, 2.0)))
    limits = replace(task.limits, cancel=cancel, tolerance=Uncertainty())
    path = rounded_lines(ends, ()).path
    free = least_cost(robot, path, limits, TIME, 40)
    # It speeds up as without end stops, at 4 way / free^2, and brakes no harder than when cancelled.
    wanted = np.sqrt(2 * 0.4 * (free**2 / (4 * 0.4) + 1 / 2.0))
    assert least_cost(robot.varied(arm=arm), path, limits, TIME, 40) == pytest.approx(wanted, rel=0.03)
