"""Paths of motions and points: near what they were made of, smooth where they say so."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PPoly

from ocptip.basics.errors import InputError
from ocptip.trajectories import path_fit
from ocptip.trajectories.fit import fitted
from ocptip.trajectories.path_fit import FINE, FittedPath, blended_lines, path_of_motion, spline_through
from ocptip.trajectories.path_legs import Leg
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from tests.quick import examples

DENSE = np.linspace(0, 1, 5_001)


def _random_motion(seed: int, joints: int = 3) -> Trajectory:
    rng = np.random.default_rng(seed)
    commands = [
        [RampCommand(*row) for row in rng.uniform([-2, 0.3, 1], [2, 3, 8], (rng.integers(1, 4), 3))]
        for _ in range(joints)
    ]
    return Trajectory.from_profiles(rng.uniform(-1, 1, joints), commands)


def _off_polygon(points: np.ndarray, polygon: np.ndarray) -> np.ndarray:
    """Euclidean distances (N,) of points from a polygon."""
    begins, ways = polygon[:-1], np.diff(polygon, axis=0)
    share = np.einsum("nkj,kj->nk", points[:, None] - begins, ways) / np.sum(ways**2, axis=1)
    nearest = begins + np.clip(share, 0, 1)[..., None] * ways
    return np.min(np.linalg.norm(points[:, None] - nearest, axis=2), axis=1)


def _smooth(fit: FittedPath) -> bool:
    """Whether second derivatives are continuous at all breakpoints."""
    inner = fit.path.breakpoints[1:-1]
    left, right = fit.path.at(inner, side="left"), fit.path.at(inner)
    ends = fit.path.breakpoints
    size = np.abs(fit.path.at(0.5 * (ends[1:] + ends[:-1]))[2]).max()
    return all(np.allclose(a, b, atol=1e-7 * size) for a, b in zip(left, right, strict=True))


@examples(15)
@given(seed=st.integers(0, 10_000))
def test_path_of_ramps_is_theirs(seed: int) -> None:
    """Between the first and the last event they pass it at an even pace; that of S-curves is fitted."""
    motion = _random_motion(seed)
    fit = path_of_motion(motion)
    events = motion.event_times
    fast = np.max(np.abs(motion.states(events)[1]), axis=1)
    events = np.concatenate([[0.0], events[fast > 0.01 * fast.max()], [motion.end]])
    if not len(fit.path.corners):
        begin, end = 0.5 * events[1], 0.5 * (events[-2] + events[-1])
        times = np.linspace(events[1], events[-2], 200)
        found = fit.path.at((times - begin) / (end - begin))[0]
        assert np.abs(found - motion.states(times)[0]).max() < 1e-8
    motion = motion.with_rise_times(0.02)
    fit = path_of_motion(motion)
    assert np.all(fit.distance <= FINE)
    assert np.all(np.diff(fit.places) >= 0)
    assert np.abs(fit.path.start - motion.start).max() < 1e-12
    assert np.abs(fit.path.goal - motion.goal).max() < 1e-12
    between = 0.5 * (fit.places[1:] + fit.places[:-1])
    chords = 0.5 * (fit.samples[1:] + fit.samples[:-1])
    assert np.abs(fit.path.at(between)[0] - chords).max() < 3 * FINE


@examples(15)
@given(seed=st.integers(0, 10_000))
def test_its_parameter_is_nearly_the_length(seed: int) -> None:
    """So that the first derivative never vanishes."""
    fit = path_of_motion(_random_motion(seed).with_rise_times(0.02))
    sizes = np.linalg.norm(fit.path.at(DENSE)[1], axis=1)
    assert sizes.min() > 0.5 * np.median(sizes)


def test_a_motion_that_rests_on_its_way_has_a_corner_there() -> None:
    times = np.array([0.0, 1.0, 2.0])
    angles = np.array([[0.0, 0.0], [1.0, 0.5], [0.2, 0.9]])
    fit = path_of_motion(Trajectory.from_points(times, angles, np.zeros((3, 2)), np.zeros((3, 2))))
    assert fit.path.corners.size == 1
    corner = fit.path.breakpoints[fit.path.corners[0]]
    assert np.abs(fit.path.at(corner)[0] - angles[1]).max() < 1e-12
    assert np.all(fit.distance <= FINE)


def test_positions_alone_are_points_of_a_smooth_curve() -> None:
    points = np.random.default_rng(3).normal(size=(7, 3))
    motion = Trajectory.from_points(np.arange(7.0), points, period=1.0)
    fit = path_of_motion(motion)
    assert fit.how == "smooth curve through 7 points"
    assert fit.distance.max() < 1e-12
    assert _smooth(fit)
    assert not fit.path.corners.size
    assert "corners blended" in path_of_motion(motion, 0.02).how
    assert not path_of_motion(motion, 0.02).keeps_to_lines
    assert path_of_motion(motion).keeps_to_lines == "--path-tolerance"


@pytest.mark.slow
def test_distance_of_a_spline_from_the_lines_between_its_points() -> None:
    """Each sample of the curve against all lines, and a TCP at the end of two links."""
    points = np.array([[0.0, 0.0], [0.6, 0.3], [0.9, 1.0], [1.4, 0.8]])
    fit = spline_through(points)

    def position(q: np.ndarray) -> np.ndarray:
        ends = np.cumsum(q, axis=1)
        return np.stack([np.cos(ends).sum(axis=1), np.sin(ends).sum(axis=1), 0 * q[:, 0]], axis=1)

    joints, tool = fit.beside_lines(position)
    rows = [one + np.linspace(0, 1, 1_501)[:, None] * (two - one) for one, two in pairwise(points)]
    lines, curve = np.concatenate(rows), fit.path.at(np.linspace(0, 1, 601))[0]
    wanted = np.abs(curve[:, None] - lines).max(axis=2).min(axis=1).max()
    assert joints.max() == pytest.approx(wanted, abs=2e-3)
    wanted = np.linalg.norm(position(curve)[:, None] - position(lines), axis=2).min(axis=1).max()
    assert tool == pytest.approx(wanted, abs=2e-3)
    straight = spline_through(np.outer([0.0, 0.3, 1.0], [1.0, 2.0]))
    assert straight.beside_lines(position)[1] < 1e-12


@examples(20)
@given(seed=st.integers(0, 10_000), tolerance=st.floats(1e-4, 0.5))
def test_blends_keep_their_tolerance_and_are_smooth(seed: int, tolerance: float) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(6, 3))
    fit = blended_lines(points, tolerance)
    off = _off_polygon(fit.path.at(DENSE)[0], points)
    assert np.all(fit.distance <= tolerance * (1 + 1e-9))
    assert off.max() <= tolerance * np.sqrt(3)
    if not fit.path.corners.size:
        assert _smooth(fit)
    assert np.abs(fit.path.start - points[0]).max() < 1e-12
    assert np.abs(fit.path.goal - points[-1]).max() < 1e-9


def test_a_blend_uses_its_tolerance() -> None:
    """A right angle with much room: the middle of the blend is as far off the corner as allowed."""
    fit = blended_lines(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]), 0.05)
    assert fit.distance == pytest.approx([0.05, 0.05], abs=1e-12)


def test_lines_that_turn_back_or_have_no_tolerance_stop() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [1.0, 0.2]])
    assert blended_lines(points).path.corners.tolist() == [1, 2]
    blended = blended_lines(points, 0.05).path
    assert len(blended.corners) == 1
    assert np.abs(blended.at(blended.breakpoints[blended.corners[0]])[0] - [1.0, 1.0]).max() < 1e-9


def test_points_in_a_row_need_no_blend() -> None:
    fit = blended_lines(np.array([[0.0], [0.25], [1.0]]), 0.1)
    assert fit.distance.max() < 1e-15
    assert not fit.path.corners.size


@pytest.mark.parametrize(
    ("points", "text"),
    [
        (np.zeros((0, 2)), "at least two"),
        (np.zeros((1, 2)), "at least two are needed for a path, got 1"),
        ([[0.0], [0.0], [1e-6], [0.0]], "points: none of 4 differs"),
        ([[0.0], [np.nan]], "points"),
    ],
)
def test_what_is_no_path_is_refused(points: np.ndarray, text: str) -> None:
    for make in (spline_through, blended_lines):
        with pytest.raises(InputError, match=text):
            make(np.array(points))


def test_noise_is_refused_unless_the_path_may_be_off() -> None:
    rng, times = np.random.default_rng(0), np.linspace(0, 2, 101)
    share = times / 2
    smooth = (10 * share**3 - 15 * share**4 + 6 * share**5)[:, None] * [1.0, -0.7]
    noisy = fitted(times, smooth + 1e-3 * rng.normal(size=smooth.shape))
    with pytest.raises(InputError, match=r"joint [12] are noisy.*--path-tolerance"):
        path_of_motion(noisy)
    fit = path_of_motion(noisy, 0.006)
    assert _off_polygon(fit.path.at(DENSE)[0], smooth).max() < 0.006
    exact = path_of_motion(fitted(times, smooth))
    curvature = [np.abs(one.path.at(DENSE)[2]).max() for one in (fit, exact)]
    assert curvature[0] < 20 * (curvature[1] + 1)


def test_a_motion_that_rests_is_no_path() -> None:
    with pytest.raises(InputError, match="does not move"):
        path_of_motion(Trajectory.from_points(np.array([0.0, 1.0]), np.zeros((2, 2)), np.zeros((2, 2))))


def test_ramps_that_end_almost_together_are_taken_as_they_are():
    """A joint that rests a microsecond before the others does not make the path turn back."""
    table = [[RampCommand(1.0, 1.0, 4.0)], [RampCommand(1.0 - 1e-6, 1.0, 4.0)]]
    goal = np.array([1.0, 1.0 - 1e-6])
    motion = Trajectory.ending_together(np.zeros(2), goal, table, np.ones(2), np.full(2, 4.0))
    assert Leg.of_ramps(motion, 0.0, motion.end) is not None
    path = path_of_motion(motion).path
    assert path.pieces < 6
    assert np.max(np.abs(path.at(np.linspace(0, 1, 500))[2])) < 20
    np.testing.assert_allclose(path.goal, motion.goal, atol=1e-12)


@pytest.mark.parametrize(("bend", "factor"), [(0.5, 1.0), (9.0, 3.0)])
def test_a_curve_that_bends_more_than_the_motion_is_slower(bend: float, factor: float) -> None:
    """A short arc of curvature `bend` at 1 m/s, where the motion has accelerations of up to 1 m/s^2."""
    lengths = np.linspace(0.0, 1e-4, 5)
    curve = PPoly(np.array([[[0.0, bend / 2]], [[1.0, 0.0]], [[0.0, 0.0]]]), lengths[[0, -1]])
    leg = Leg(curve, lengths, curve(lengths), np.arange(5))
    speeds, accelerations = np.tile([1.0, 0.0], (5, 1)), np.tile([0.0, 1.0], (5, 1))
    assert leg.slower(lengths, speeds, accelerations) == pytest.approx(factor - 1, abs=1e-5)


@pytest.mark.parametrize("seed", [3, 4])
def test_a_fit_that_is_slower_than_its_motion_is_refined(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """S-curves that nearly turn back: with 0.02 rad curves rang there, and would take 3 to 5 % longer."""
    motion, found = _random_motion(seed).with_rise_times(0.02), []
    monkeypatch.setattr(Leg, "slower", lambda *args, _of=Leg.slower: found.append(_of(*args)) or found[-1])
    fit = path_of_motion(motion, 0.02)
    assert found[0] > 0.03
    assert min(found) < 0.02
    assert np.all(fit.distance <= 0.02)
    monkeypatch.setattr(path_fit, "_TOO_SLOW", 1e-6)
    with pytest.raises(InputError, match=r"path: with the accelerations of the motion .* % longer"):
        path_of_motion(motion, 0.02)


FAR_APART = np.array([[0.0, -0.5, -1.7], [0.25, -0.7, -1.55], [0.5, -0.9, -1.4], [0.3, -0.2, -1.0]])


@pytest.mark.parametrize("at", [0, 1, 3])
@pytest.mark.parametrize("size", [0.0, 1e-6, 4e-5])
@pytest.mark.parametrize("between", ["spline", "lines"])
def test_points_that_are_nearly_the_same_decide_nothing(at, size, between):
    """The curve is that without them, within their distance, wherever rounding points."""
    make = {"spline": spline_through, "lines": blended_lines}[between]
    s = np.linspace(0, 1, 401)
    plain = make(FAR_APART).path.at(s)[0]
    for way in np.eye(3):
        points = np.insert(FAR_APART, at + 1, FAR_APART[at] + size * way, axis=0)
        fit = make(points)
        np.testing.assert_allclose(fit.path.at(s)[0], plain, atol=1.01 * size + 1e-12)
        assert fit.distance.max() <= size + 1e-12
        assert ("1 repeated" if size == 0 else "1 nearly the same") in fit.how
        np.testing.assert_allclose(fit.path.start, points[0], atol=1e-12)
        np.testing.assert_allclose(fit.path.goal, points[-1], atol=1e-12)


def test_what_is_nearly_the_same_grows_with_the_tolerance():
    points = np.insert(FAR_APART, 2, FAR_APART[1] + [2e-3, 0, 0], axis=0)
    assert "without" not in spline_through(points).how
    assert "1 nearly the same" in spline_through(points, 0.05).how
    assert "without" not in blended_lines(points, 0.01).how
    fit = blended_lines(points, 0.05)
    assert "1 nearly the same" in fit.how
    assert np.all(fit.distance <= 0.05 + 1e-12)


def test_points_that_are_all_the_same_are_no_path():
    for points in (FAR_APART[[0, 0]], FAR_APART[:1] + 1e-6 * np.arange(9).reshape(3, 3)):
        with pytest.raises(InputError, match=r"none of \d differs from the others by more than 5e-05"):
            spline_through(points)
