"""Joint trajectories as controllers run them: corners, the way to a first point, wrapped messages."""

import json
import warnings

import numpy as np
import pytest
import yaml

from ocptip.basics.errors import InputError, InputWarning
from ocptip.trajectories.read import load_motion
from tests.quick import some

NAMES = ["a", "b"]
CORNERS = np.array([[1.0, -2.0], [-0.5, -1.5], [-0.8, -2.2]])
TIMES = np.array([0.0, 1.0, 2.0])


def message(times, positions, **columns):
    rows = []
    for k, (t, q) in enumerate(zip(times, positions, strict=True)):
        stamp = dict(zip(("sec", "nanosec"), divmod(round(t * 1e9), 10**9), strict=True))
        row = {"positions": list(map(float, q)), "velocities": [], "time_from_start": stamp}
        rows.append(row | {name: list(map(float, values[k])) for name, values in columns.items()})
    return {"joint_names": NAMES, "points": rows}


def read(folder, data, **how):
    path = folder / "t.json"
    path.write_text(json.dumps(data))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        return load_motion(path, NAMES, **how)


def lines(times):
    """The piecewise lines, at rest before and after, (N, 2)."""
    return np.column_stack([np.interp(times, TIMES, CORNERS[:, j]) for j in range(2)])


def sampled(spacing):
    times = np.arange(0, 2 + spacing / 2, spacing)
    return message(times, lines(times))


@pytest.mark.parametrize("rate", some(5, [None, 125.0, 500.0]))
@pytest.mark.parametrize("spacing", [1.0, 0.25, 0.1, 0.008, 0.001])
def test_corners_last_one_update_however_dense_the_points_are(tmp_path, rate, spacing):
    """Set points of the lines at the rate of the controller: their second difference is the acceleration."""
    motion = read(tmp_path, sampled(spacing), rate=rate)
    period = 1 / (rate or 500.0)
    times = np.linspace(0, motion.end, 3001)
    step = np.diff(lines(np.array([-1.0, 0.0, 1.0, 2.0, 3.0]) * 1.0)[1:4], axis=0)  # rates over 1 s
    jumps = np.vstack([step[0], step[1] - step[0], -step[1]])
    np.testing.assert_allclose(
        motion.acceleration_peaks, np.abs(jumps).max(axis=0) / period, rtol=1e-9
    )  # by hand: each speed jump over one period
    half = period / 2
    ahead, here, behind = (lines(times + shift - half) for shift in (half, 0.0, -half))
    q, v, a = motion.states(times)
    np.testing.assert_allclose(v, (ahead - behind) / period, atol=1e-8)
    fine = np.linspace(-half, half, 401)
    mean = np.mean([lines(times - half + shift) for shift in 0.5 * (fine[1:] + fine[:-1])], axis=0)
    np.testing.assert_allclose(q, mean, atol=1e-5 * period)
    assert np.abs(q - here).max() <= np.abs(jumps).max() * period / 8 * (1 + 1e-9)
    step = 1e-6
    slope = (motion.states(times + step)[1] - motion.states(times - step)[1]) / (2 * step)
    corners = np.concatenate([TIMES, TIMES + period])
    away = np.min(np.abs(times[:, None] - corners), axis=1) > 2 * step
    np.testing.assert_allclose(a[away], slope[away], atol=1e-3)
    np.testing.assert_allclose(motion.states(motion.end + 1.0)[0], CORNERS[-1], atol=1e-12)


def test_dense_and_sparse_files_of_the_same_lines_are_the_same_motion(tmp_path):
    sparse, dense = read(tmp_path, sampled(1.0)), read(tmp_path, sampled(0.008))
    times = np.linspace(0, 2.002, 997)
    for one, other in zip(sparse.states(times), dense.states(times), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-8)
    np.testing.assert_allclose(sparse.event_times, dense.event_times, atol=1e-12)


def test_points_nearer_than_an_update_are_averaged(tmp_path):
    """A wave with points every ms, at 100 Hz: nothing of it that is faster than an update is left."""
    times = np.arange(0, 1.0005, 0.001)
    wave = 0.01 * (1 - np.cos(2 * np.pi * 200 * times))[:, None] * [1.0, 0.0]
    motion = read(tmp_path, message(times, CORNERS[0] + wave), rate=100.0)
    middle = motion.states(np.linspace(0.1, 0.9, 777))
    np.testing.assert_allclose(middle[0], np.broadcast_to(CORNERS[0] + [0.01, 0.0], (777, 2)), atol=1e-9)
    assert np.abs(middle[1]).max() < 1e-9


@pytest.mark.parametrize(("spacing", "warns"), [(0.02, False), (0.025, True), (1.0, True)])
def test_points_far_apart_without_velocities_are_doubted(tmp_path, spacing, warns):
    path = tmp_path / "t.json"
    path.write_text(json.dumps(sampled(spacing)))
    if not warns:
        load_motion(path, NAMES)
        return
    with pytest.warns(InputWarning, match=f"up to {1e3 * spacing:g} ms apart, with positions only"):
        motion = load_motion(path, NAMES)
    assert "2 ms (500 Hz)" in motion.points.interpolation


def test_a_standstill_between_points_is_not_doubted(tmp_path):
    times = [0.0, *(2 + 0.02 * np.arange(50)), 5.0]
    rise = np.linspace(0, 0.5, 50)[:, None] * [1.0, -1.0] + CORNERS[0]
    path = tmp_path / "t.json"
    path.write_text(json.dumps(message(times, [rise[0], *rise, rise[-1]])))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert load_motion(path, NAMES).end == pytest.approx(5.002)


def test_with_velocities_no_distance_is_doubted(tmp_path):
    rest = np.zeros((3, 2))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        path = tmp_path / "t.json"
        path.write_text(json.dumps(message(TIMES, CORNERS, velocities=rest)))
        motion = load_motion(path, NAMES, rate=10.0)
    assert motion.points.period is None


@pytest.mark.parametrize(
    "columns",
    [
        {},
        {"velocities": np.zeros((2, 2))},
        {"velocities": np.zeros((2, 2)), "accelerations": np.zeros((2, 2))},
    ],
)
def test_a_first_point_later_is_reached_from_the_start(tmp_path, columns):
    """As from a file that has the start at 0 s; without a start it is refused."""
    start = np.array([1.5, -1.0])
    later = message([0.7, 2.0], CORNERS[1:], **columns)
    motion = read(tmp_path, later, start=start)
    whole = {name: np.zeros((3, 2)) for name in columns}
    same = read(tmp_path, message([0.0, 0.7, 2.0], [start, *CORNERS[1:]], **whole))
    times = np.linspace(-0.1, same.end + 0.1, 501)
    for one, other in zip(motion.states(times), same.states(times), strict=True):
        np.testing.assert_array_equal(one, other)
    assert "task's start" in motion.assumed[0]
    assert "0.7 s" in motion.assumed[0]
    assert same.assumed == ()
    with pytest.raises(InputError, match=r"points\[1\]\.time_from_start: is 0\.7 s.*name a task"):
        read(tmp_path, later)


def test_a_single_goal_point_is_a_trajectory(tmp_path):
    one = message([4.0], CORNERS[1:2])
    motion = read(tmp_path, one, start=CORNERS[0])
    np.testing.assert_array_equal(motion.points.angles, CORNERS[:2])
    np.testing.assert_array_equal(motion.points.times, [0.0, 4.0])
    with pytest.raises(InputError, match="nothing says"):
        read(tmp_path, one)
    with pytest.raises(InputError, match="at least two samples"):
        read(tmp_path, message([0.0], CORNERS[1:2]), start=CORNERS[0])


WRAPPED = {
    "goal": lambda m: {"goal": {"trajectory": m, "goal_tolerance": []}},
    "action": lambda m: {"trajectory": m, "goal_time_tolerance": {"sec": 0, "nanosec": 0}},
    "robot": lambda m: {"joint_trajectory": m, "multi_dof_joint_trajectory": {"points": []}},
    "display": lambda m: {"model_id": "x", "trajectory": [{"joint_trajectory": m}], "trajectory_start": {}},
}


@pytest.mark.parametrize("ending", ["json", "yaml"])
@pytest.mark.parametrize("wrap", WRAPPED)
def test_wrapped_messages(tmp_path, wrap, ending):
    bare = message(TIMES, CORNERS, velocities=np.zeros((3, 2)))
    path = tmp_path / f"t.{ending}"
    write = {"json": json.dumps, "yaml": yaml.safe_dump}[ending]
    path.write_text(write(WRAPPED[wrap](bare)))
    np.testing.assert_array_equal(load_motion(path, NAMES).points.angles, CORNERS)


def test_several_trajectories_and_moving_bases_are_refused(tmp_path):
    bare = message(TIMES, CORNERS)
    with pytest.raises(InputError, match="holds 2 trajectories, expected one"):
        read(tmp_path, {"trajectory": [{"joint_trajectory": bare}] * 2})
    moving = {"joint_trajectory": bare, "multi_dof_joint_trajectory": {"points": [{}]}}
    with pytest.raises(InputError, match="expected a base that does not move"):
        read(tmp_path, moving)


def test_times_of_ros_1(tmp_path):
    data = message(TIMES * 0.3, CORNERS, velocities=np.zeros((3, 2)))
    for row in data["points"]:
        stamp = row["time_from_start"]
        row["time_from_start"] = {"nsecs": stamp["nanosec"], "secs": stamp["sec"]}
    np.testing.assert_allclose(read(tmp_path, data).points.times, TIMES * 0.3, atol=1e-12)
    for wrong in ({}, {"s": 1}, {"sec": 1, "nsecs": 0}, {"secs": 0.5}):
        data["points"][1]["time_from_start"] = wrong
        with pytest.raises(InputError, match=r"points\[2\]\.time_from_start: expected sec and nanosec, or"):
            read(tmp_path, data)


@pytest.mark.parametrize("moves", [False, True])
def test_joints_of_others_are_left_out(tmp_path, moves):
    data = message(TIMES, CORNERS, velocities=np.zeros((3, 2)))
    data["joint_names"] = ["b", "finger", "a"]
    for k, row in enumerate(data["points"]):
        row["positions"] = [row["positions"][1], 0.01 * k * moves, row["positions"][0]]
        row["velocities"] = [0.0] * 3
    path = tmp_path / "t.json"
    path.write_text(json.dumps(data))
    if moves:
        with pytest.warns(InputWarning, match="finger moves, but is no joint of the robot"):
            motion = load_motion(path, NAMES)
    else:
        motion = load_motion(path, NAMES)
    np.testing.assert_array_equal(motion.points.angles, CORNERS)
    assert "finger" in motion.assumed[0]
