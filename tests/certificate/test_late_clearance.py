"""Distances of joints that are late, each by itself: found by the check, planned for, proved."""

import copy
from dataclasses import replace
from operator import attrgetter

import numpy as np
import pytest

from ocptip.certificate import find
from ocptip.certificate.checks import certified
from ocptip.certificate.find import certify
from ocptip.certificate.find_within import SearchWithin
from ocptip.certificate.trusted.checker import check_certificate
from ocptip.motion.check import check_motion
from ocptip.published.tasks import experiment_task
from ocptip.robots.geometry import Pillar
from ocptip.standing.arm import Robot
from ocptip.standing.instants import Instants, NodeColumns
from ocptip.standing.limit_kinds.clearance import CLOSE, GAP_SCALE, LateClearanceLimit
from ocptip.standing.limit_kinds.rows import NodeSlopes
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.in_motion import _smallest_gap
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from tests.quick import some

LATE = Uncertainty(delay=0.02, speed=0.05)


@pytest.fixture(scope="module")
def swing():
    task = experiment_task("B")
    way = 0.4 * (task.goal - task.start) + np.array([0.0, -0.6, 1.0, -0.4, 0.0, 0.0])
    commands = [
        [RampCommand(a + w, max(abs(w), 0.1), max(4 * abs(w), 0.4))]
        for a, w in zip(task.start, way, strict=True)
    ]
    motion = Trajectory.from_profiles(task.start, commands)
    # pillars are less than a millimetre away here: what is judged is late joints, not the distance asked for
    limits = Limits(tolerance=LATE, GN=1.0, GT=1.0, clearance=0.0)
    return _beside_a_pillar(task.robot, motion, 0.02), motion, limits


@pytest.fixture(scope="module")
def proved(swing):
    robot, motion, limits = swing
    checked = check_motion(robot, motion, limits)
    return checked, certify(robot, motion, limits, checked.worst)


def late_gaps(robot, motion, count, seed):
    """Distances, m, at random instants with joints late by random delays, or by all of them or none."""
    rng = np.random.default_rng(seed)
    times = rng.uniform(0, motion.end + LATE.late, count)
    share = rng.random((count, motion.n))
    share[::2] = np.round(share[::2])
    earlier = times[:, None] - LATE.late * share
    q = np.column_stack([motion.states(earlier[:, j])[0][:, j] for j in range(motion.n)])
    return robot.collision.least(q)


@pytest.mark.slow
def test_no_late_joints_come_nearer_than_is_found_and_proved(swing, proved):
    robot, motion, _ = swing
    checked, found = proved
    worst, bound = (
        checked.worst["clearance_worst_case_m"].value,
        found.verdict.bounds["clearance_worst_case"],
    )
    assert found.certified, (found.verdict.problems, found.undecided, checked.violations)
    assert worst - 1.1e-3 <= bound < worst < checked.worst["clearance_m"].value - 1e-3
    gaps = late_gaps(robot, motion, 20_000, 1)
    assert np.min(gaps) >= bound
    assert np.min(gaps) >= worst - 1e-4  # the search finds about the least
    assert np.min(gaps) < checked.worst["clearance_m"].value


@pytest.mark.parametrize("on_time", some(1, [False, True]), ids=["not at all", "on time"])
def test_without_proof_of_late_joints_the_rest_is_proved(swing, proved, monkeypatch, on_time):
    robot, motion, limits = swing
    claims = SearchWithin.claims
    late = attrgetter("sharing.late.delay")

    def claims_on_time(search, *args):
        return claims(search, *args) if on_time and not late(search) else None

    monkeypatch.setattr(SearchWithin, "claims", claims_on_time)
    found_now = certify(robot, motion, limits, proved[0].worst)
    assert found_now.holds, found_now.verdict.problems
    assert not found_now.certified
    assert "clearance_worst_case" in found_now.sampled
    assert "clearance_worst_case" not in found_now.verdict.bounds


@pytest.mark.slow
def test_a_clearance_that_is_not_proved_is_claimed_lower_within_its_limit(swing, proved, monkeypatch):
    """Sampled is 4 mm more than there is: no interval is short enough to prove that."""
    robot, motion, limits = swing
    worst, name = dict(proved[0].worst), "clearance_worst_case_m"
    true = worst[name].value
    worst[name] = replace(worst[name], value=true + 4e-3)
    monkeypatch.setattr(find, "_LOWER_AFTER", 0)
    monkeypatch.setattr(find, "_MOST", 1)
    found = certify(robot, motion, limits, worst)
    assert found.certified, found.missing
    assert true - 1e-3 < found.verdict.bounds["clearance_worst_case"] < true
    high = replace(limits, clearance_worst_case=true + 1e-3)
    assert not certify(robot, motion, high, worst).holds


@pytest.mark.slow
def test_that_nothing_touches_is_proved_as_such(swing):
    """Where less than a millimetre is left."""
    robot, motion, limits = swing
    standing = _beside_a_pillar(robot, motion, 0.0033)
    checked = certified(standing, motion, check_motion(standing, motion, limits), limits)
    assert 1e-5 < checked.worst["clearance_worst_case_m"].value < 1e-3
    assert checked.certified
    assert checked.headline == "PROVED for the given uncertainty"
    assert checked.certificate.verdict.bounds["clearance_worst_case"] == 0.0


@pytest.mark.parametrize("change", ["claim", "directions", "delay", "pair"])
def test_what_is_not_so_of_late_joints_is_refused(proved, change):
    data = copy.deepcopy(proved[1].data)
    count = len(data["model"]["pairs"])
    if change == "claim":
        data["bounds"]["clearance_worst_case"] += 2e-3
    elif change == "delay":
        data["tolerance"]["delay"] *= 2
    for part in data["cover"] if change in ("directions", "pair") else ():
        late = [row for row in part["directions"] if row[1] >= count]
        if change == "directions":
            part["directions"] = [row for row in part["directions"] if row not in late]
        for row in late:
            row[1] += count
    verdict = check_certificate(data)
    assert not verdict.holds, verdict


def test_late_distances_are_claimed_of_a_tolerance_only(proved):
    data = copy.deepcopy(proved[1].data)
    data["tolerance"] = data["cover_within"] = None
    data["bounds"] = {
        k: v for k, v in data["bounds"].items() if not k.startswith(("GN_", "GT_", "torque_ratio_"))
    }
    data["sha256"]["tolerance"] = (
        "74234e98afe7498fb5daf1f36ac2d78acc339464f950703b8c019892f982b90b"  # of null
    )
    assert check_certificate(data).problems == ("unknown claims: clearance_worst_case",)


def test_joints_that_touch_when_late_are_not_verified(swing):
    """A pillar as near to the path as joints on time allow."""
    robot, motion, limits = swing
    standing = _beside_a_pillar(robot, motion, 2e-4)
    checked = certified(standing, motion, check_motion(standing, motion, limits), limits)
    assert checked.worst["clearance_m"].value > 0
    assert not checked.verified
    [violation] = checked.violations
    assert violation.name == "clearance_worst_case_m"
    assert violation.value < 0
    assert "pillar" in violation.detail
    nominal = replace(limits, tolerance=Uncertainty())
    assert check_motion(standing, motion, nominal).verified
    assert checked.within is not None
    assert checked.within.gap is not None
    assert checked.within.gap.joints


def _beside_a_pillar(robot, motion, gap):
    """The robot with a pillar so far, m, beside what its arm sweeps."""
    q = motion.states(np.linspace(0, motion.end, 2000))[0]
    gripper = robot.gripper(q)[1000, :2]
    away = 1.5
    for _ in range(20):
        pillar = Pillar([*(away * gripper), 0.0], 0.05)
        standing = Robot(robot.arm, robot.support, robot.motors, obstacles=[pillar])
        away -= (float(np.min(standing.collision.least(q))) - gap) / np.linalg.norm(gripper)
    return standing


@pytest.mark.parametrize("seed", range(3))
def test_rows_are_distances_of_late_joints_with_exact_derivatives(swing, seed):
    robot, motion, limits = swing
    rng = np.random.default_rng(seed)
    limit = LateClearanceLimit(robot, replace(limits, clearance_worst_case=0.05), tuple(range(robot.n)))
    states = motion.states(rng.uniform(0.2, 0.8, 4) * motion.end)
    s = np.hstack(states)
    at = Instants.of_states(robot, *states)
    own = limit.chosen(at)
    mask = np.zeros((4, limit.width), dtype=bool)
    mask[np.arange(4), np.argmin(limit._gaps(at), axis=1)] = True

    def rows(s):
        size = s.shape[1]
        slopes = np.tile(np.eye(size), (len(s), 1, 1))
        return own.rows(
            NodeSlopes(NodeColumns(robot.n, 0), s, slopes, np.empty((4, 0)), np.empty((4, 0, size))), mask
        )

    found = rows(s)
    gaps, exact = np.min(limit._gaps(at), axis=1), found.values / GAP_SCALE
    near = gaps < 0.05 + CLOSE  # of farther ones slopes tell
    np.testing.assert_allclose(gaps[near], exact[near], atol=1e-12)
    np.testing.assert_allclose(gaps, exact, atol=2e-4)
    assert near.any()
    on = rng.uniform(0.5, 2, 4)
    _, bends = own.curvature(found, on)
    jacobian = own.jacobian(found)
    for k in range(s.shape[1]):
        step = np.zeros(s.shape[1])
        step[k] = 1e-5
        more, less = rows(s + step), rows(s - step)
        np.testing.assert_allclose((more.values - less.values) / 2e-5, jacobian[:, k], atol=2e-6)
        bent = on[:, None] * (own.jacobian(more) - own.jacobian(less)) / 2e-5
        np.testing.assert_allclose(bent, bends[:, k], atol=2e-4)


def test_nothing_is_late_without_a_delay(swing):
    robot, motion, limits = swing
    own = replace(limits, tolerance=Uncertainty(tilt=0.01))
    assert not LateClearanceLimit.wanted(robot, own)
    assert _smallest_gap(robot, motion, own.tolerance, np.linspace(0, 1, 5)) is None
    assert "clearance_worst_case_m" not in check_motion(robot, motion, own).worst


def test_a_motion_that_does_not_move_is_as_near_when_late(swing):
    robot, motion, _ = swing
    still = Trajectory.from_profiles(motion.start, [[RampCommand(q, 1.0, 1.0)] for q in motion.start])
    gap = _smallest_gap(robot, still, LATE, np.array([0.0]))
    assert gap is not None
    assert gap.value == pytest.approx(float(robot.collision.least(motion.start[None])[0]))
    assert gap.joints == ()
