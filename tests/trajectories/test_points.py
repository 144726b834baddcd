"""Motions given by samples: the curve between them, its exact extremes, its check, and files of motions."""

import json

import numpy as np
import pytest

from ocptip.basics.errors import InputError, InputWarning
from ocptip.motion.check import check_motion
from ocptip.motion.files.output import sample_motion, write_motion_csv
from ocptip.published.tasks import experiment_task
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.read import load_motion, motion_origin
from ocptip.trajectories.trajectory import Trajectory
from tests.quick import some

RAMP = Trajectory.from_profiles(
    [0.2, -0.4],
    [[RampCommand(1.1, 0.8, 2.0), RampCommand(-0.3, 1.2, 3.0)], [RampCommand(0.5, 0.9, 1.7)]],
)


def sampled(motion, count, *, speeds=True, events=True):
    times = np.linspace(0, motion.end, count)
    if events:
        times = np.unique(np.concatenate([times, motion.event_times]))
        times = times[np.concatenate([[True], np.diff(times) > 1e-6])]
    angles, rates, _ = motion.states(times)
    rates[-1] = 0.0
    return Trajectory.from_points(times, angles, rates if speeds else None)


def write_csv(path, motion, count, *, unit="deg", speeds=True):
    """A table in the units and with the columns of motion.csv, times on both sides of every event."""
    times = np.sort(np.concatenate([np.linspace(0, motion.end, count), *[motion.event_times] * 2]))
    angles, rates, accelerations = motion.states(times)
    scale = np.rad2deg(1.0) if unit == "deg" else 1.0
    n = motion.n
    header = ["time_s", *(f"q{j}_{unit}" for j in range(1, n + 1))]
    columns = [times, *(scale * angles).T]
    if speeds:
        header += [f"qd{j}_{unit}_s" for j in range(1, n + 1)]
        columns += [*(scale * rates).T]
    header += [*(f"qdd{j}_{unit}_s2" for j in range(1, n + 1)), "tau1_Nm", "GN"]
    columns += [*(scale * accelerations).T, times * 0 + 3, times * np.nan]
    rows = [",".join(f"{x:.12g}" for x in row) for row in np.column_stack(columns)]
    path.write_text("\n".join([",".join(header), *rows]) + "\n")
    return path


def test_a_ramp_motion_sampled_at_its_events_comes_back_exactly():
    motion = sampled(RAMP, 30)
    times = np.linspace(-0.1, RAMP.end + 0.1, 777)
    for ours, theirs in zip(motion.states(times), RAMP.states(times), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-8)
    for side in ("left", "right"):
        ours, theirs = (m.states(RAMP.event_times, side=side)[2] for m in (motion, RAMP))
        np.testing.assert_allclose(ours, theirs, atol=1e-8)
    np.testing.assert_allclose(motion.angle_ranges, RAMP.angle_ranges, atol=1e-10)
    np.testing.assert_allclose(motion.speed_peaks, RAMP.speed_peaks, atol=1e-10)
    np.testing.assert_allclose(motion.acceleration_peaks, RAMP.acceleration_peaks, atol=1e-8)
    assert (motion.n, motion.end) == (RAMP.n, pytest.approx(RAMP.end))
    np.testing.assert_allclose([motion.start, motion.goal], [RAMP.start, RAMP.goal], atol=1e-12)


def test_missing_an_event_overshoots_by_a_third_of_the_jump_at_most():
    """The figure in the module's documentation: one acceleration jump at any place between two samples."""
    overshoots = []
    for event in np.linspace(0, 1, 61)[1:-1]:
        way, rate = 0.5 * (1 - event) ** 2, 1 - event  # from rest, acceleration 1 after the event
        there = Trajectory.from_points(
            [0, 1, 2, 3], [[0], [way], [way + rate], [way + 1.5 * rate]], [[0], [rate], [rate], [0]]
        )
        inner = there.states([0.0, 1 - 1e-12])[2]
        overshoots.append(max(-inner.min(), inner.max() - 1))
    assert 0.3 < max(overshoots) <= 1 / 3 + 1e-9


@pytest.mark.parametrize("speeds", [True, False])
def test_extremes_are_those_of_a_dense_grid_and_derivatives_fit(speeds):
    random = np.random.default_rng(3)
    times = np.cumsum(random.uniform(0.05, 0.4, 12))
    angles = np.cumsum(random.normal(0, 0.2, (12, 3)), axis=0)
    rates = random.normal(0, 0.5, (12, 3))
    rates[[0, -1]] = 0
    motion = Trajectory.from_points(times, angles, rates if speeds else None)
    dense = np.unique(np.concatenate([np.linspace(0, motion.end, 20001), motion.points.times]))
    q, qd, qdd = motion.states(dense)
    _, _, before = motion.states(dense, side="left")
    np.testing.assert_allclose(motion.states(motion.points.times)[0], angles, atol=1e-12)
    np.testing.assert_allclose(motion.angle_ranges, np.column_stack([q.min(0), q.max(0)]), atol=1e-6)
    np.testing.assert_allclose(motion.speed_peaks, np.abs(qd).max(0), atol=1e-5)
    np.testing.assert_allclose(motion.acceleration_peaks, np.abs([qdd, before]).max((0, 1)), atol=1e-9)
    gradient = np.diff(q, axis=0) / np.diff(dense)[:, None]
    np.testing.assert_allclose(gradient, (qd[1:] + qd[:-1]) / 2, atol=1e-4)
    np.testing.assert_allclose(motion.states([0.0, motion.end])[1], 0, atol=1e-12)
    # between events no speed changes its sign, and the nodes add up to the duration
    middle, quarter = (motion.states(motion.intervals @ w)[1] for w in ([0.5, 0.5], [0.9, 0.1]))
    assert np.all(middle * quarter > -1e-12)
    nodes, weights = motion.quadrature(3)
    assert weights.sum() == pytest.approx(motion.end)
    np.testing.assert_allclose(weights @ motion.states(nodes)[1], angles[-1] - angles[0], atol=1e-12)


def test_time_scaling_keeps_the_path():
    motion = sampled(RAMP, 30)
    slow = motion.time_scaled(2.0)
    times = np.linspace(0, motion.end, 50)
    np.testing.assert_allclose(slow.states(2 * times)[0], motion.states(times)[0], atol=1e-12)
    np.testing.assert_allclose(slow.speed_peaks, motion.speed_peaks / 2)
    np.testing.assert_allclose(slow.acceleration_peaks, motion.acceleration_peaks / 4)


@pytest.mark.parametrize("name", some(1, ["C", "G"]))
def test_check_of_samples_with_events_is_that_of_the_commands(tmp_path, name):
    task = experiment_task(name, "effective")
    exact = check_motion(task.robot, task.reference, task.limits)
    path = tmp_path / "motion.csv"
    write_motion_csv(path, sample_motion(task.robot, task.reference))
    checked = check_motion(task.robot, load_motion(path), task.limits)
    assert checked.verified == exact.verified
    assert checked.energy == pytest.approx(exact.energy, rel=1e-5)
    assert checked.duration == pytest.approx(exact.duration, abs=1e-9)
    for key, worst in exact.worst.items():
        assert checked.worst[key].value == pytest.approx(worst.value, rel=2e-4, abs=1e-6), key


def test_check_of_plain_samples_is_near(tmp_path):
    """Angles only, 100 per second, no events: the spline's own verdict, on the strict side."""
    task = experiment_task("C", "effective")
    exact = check_motion(task.robot, task.reference, task.limits)
    checked = check_motion(task.robot, sampled(task.reference, 214, speeds=False, events=False), task.limits)
    assert checked.energy == pytest.approx(exact.energy, rel=5e-3)
    assert checked.worst["speed_ratio"].value == pytest.approx(exact.worst["speed_ratio"].value, rel=0.02)
    for key in ("GN", "GT", "torque_ratio"):
        assert exact.worst[key].value * 0.99 < checked.worst[key].value < exact.worst[key].value * 1.5, key


def test_a_motion_of_another_number_of_joints_is_refused():
    task = experiment_task("A")
    with pytest.raises(InputError, match="2 joints, the arm has 6"):
        check_motion(task.robot, sampled(RAMP, 5))


def test_joints_that_rest_have_no_events():
    still = Trajectory.from_points([0, 1, 2], np.full((3, 2), 0.3))
    np.testing.assert_array_equal(still.event_times, [0, 2])
    np.testing.assert_array_equal(still.angle_ranges, [[0.3, 0.3]] * 2)


def test_a_rest_amid_a_motion_has_only_its_ends_as_events():
    way = np.array([0, 0.5, 1, 1, 1, 1, 1, 0.5, 0])
    motion = Trajectory.from_points(
        np.arange(9.0), way[:, None], np.array([0, 1, 0, 0, 0, 0, 0, -1, 0.0])[:, None]
    )
    np.testing.assert_array_equal(motion.event_times, [0, 1, 2, 6, 7, 8])


@pytest.mark.parametrize(("unit", "speeds"), some(1, [("deg", True), ("rad", False)]))
def test_csv_in_either_unit(tmp_path, unit, speeds):
    motion = load_motion(write_csv(tmp_path / "m.csv", RAMP, 60, unit=unit, speeds=speeds))
    assert (motion.fit.speed_distance is not None) == speeds
    times = np.linspace(0, RAMP.end, 333)
    np.testing.assert_allclose(motion.states(times)[0], RAMP.states(times)[0], atol=3e-6 if speeds else 1e-3)


def test_rows_next_to_each_other_are_thinned_and_times_start_at_zero(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text("q1_rad, time_s\n0,5\n0,5\n0.1,6\n0.1,6.00000001\n\n0.3,7\n0.3,7.00001\n")
    motion = load_motion(path)
    assert motion.fit.samples == 3
    np.testing.assert_allclose(motion.states([0, 1, 2.00001])[0][:, 0], [0, 0.1, 0.3], atol=0.06)
    assert motion.end == pytest.approx(2.00001)


def test_json_of_commands(tmp_path):
    path = tmp_path / "plan.json"
    path.write_text(json.dumps({"case": "A", "base": "effective", "worst": {}, **RAMP.to_dict()}))
    motion = load_motion(path)
    assert motion.profiles is not None
    np.testing.assert_allclose(motion.goal, RAMP.goal)
    assert motion_origin(path) == {"case": "A", "base": "effective"}
    assert motion_origin(write_csv(tmp_path / "m.csv", RAMP, 5)) == {}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"m\.csv: is empty; expected profile commands"),
        ("when,q1_deg\n0,1\n", "header: expected one column time_s, got when, q1_deg"),
        ("time_s,qd1_deg_s\n0,1\n", "header: q1_deg is missing"),
        ("time_s\n0\n", "header: q1_deg is missing"),
        ("time_s,q1_deg,q3_deg\n0,1,2\n", "header: q2_deg is missing"),
        ("time_s,q1_deg,q2_deg,qd1_deg_s\n0,1,2,0\n", "header: qd2_deg_s is missing"),
        ("time_s,q1_deg,q1_rad\n0,1,2\n", "header: q1_deg and q1_rad are the same quantity"),
        ("time_s,q1_deg\n0,1\n1,x\n", "line 3, q1_deg: expected a number, got 'x'"),
        ("time_s,q1_deg\n0,1\n1,nan\n", "line 3, q1_deg: must be finite, got nan"),
        ("time_s,q1_deg\n0,1\n1\n", "line 3: expected 2 values as in the header, got 1"),
        ("time_s,q1_deg\n0,1\n", "at least two samples are needed, got 1"),
        ("time_s,q1_deg\n0,1\n1,2\n0.5,2\n", r"line 4: time_s 0\.5 comes after 1"),
        ("time_s,q1_deg\n0,1\n1,2\n1,3\n2,3\n", "line 4: time_s 1 again, with other angles"),
        ("time_s,q1_deg,qd1_deg_s\n0,1,0\n1,2,3\n", "speeds: joint 1 moves with 3 deg/s at the last sample"),
        ("{", r"m\.csv: broken JSON"),
        ("{}", "motion: start is missing"),
        ("[1]", "motion: expected a table with start and commands"),
        ('{"start": [NaN], "commands": [[]]}', "start: contains NaN"),
    ],
)
def test_bad_files_are_refused_with_place(tmp_path, text, message):
    path = tmp_path / "m.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        load_motion(path)
    assert str(caught.value).startswith("m.csv: ")


def test_unreadable_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_motion(tmp_path / "none.json")
    with pytest.raises(InputError, match="is a folder; expected a file"):
        load_motion(tmp_path)
    (tmp_path / "b.csv").write_bytes(b"time_s\xff")
    with pytest.raises(InputError, match="not a text file in UTF-8"):
        load_motion(tmp_path / "b.csv")
    (tmp_path / "b.json").write_text("{")
    with pytest.raises(InputError, match=r"b\.json: broken JSON"):
        motion_origin(tmp_path / "b.json")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0.0], [[1.0]]), "at least two samples"),
        (([0, 1, 1], [[1], [2], [3]]), "times: must increase, sample 3 at 1 s follows 1 s"),
        (([0, 1], [[1], [np.nan]]), "angles: contains NaN"),
        (([0, 1], [1, 2]), "angles: expected shape 2 x n, got 2"),
        (([0, 1], np.zeros((2, 0))), "angles: at least one joint"),
        (([0, 1], [[1], [2]], [[0], [0.1]]), "joint 1 moves with 5.73 deg/s at the last sample"),
        (([0, 1], [[1], [2]], [[0]]), "speeds: expected shape 2 x 1, got 1 x 1"),
    ],
)
def test_bad_samples_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        Trajectory.from_points(*arguments)


def test_bad_questions_are_refused():
    motion = sampled(RAMP, 5)
    with pytest.raises(InputError, match="NaN"):
        motion.states([np.nan])
    with pytest.raises(InputError, match="side"):
        motion.states([0.0], side="both")
    with pytest.raises(InputError, match="order"):
        motion.quadrature(0)
    with pytest.raises(InputError, match="factor"):
        motion.time_scaled(0.0)


@pytest.mark.slow
@pytest.mark.parametrize("case", "AE")
def test_a_file_cut_off_is_refused_and_a_thinned_one_is_not(tmp_path, case):
    """Angles alone: the spline would brake within the last interval, with accelerations of any size."""
    task = experiment_task(case)
    path = tmp_path / "motion.csv"
    write_motion_csv(path, sample_motion(task.robot, task.reference))
    rows = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines()]
    columns = [0, *(rows[0].index(f"q{j}_deg") for j in range(1, 7))]
    lines = [",".join(row[c] for c in columns) for row in rows]

    def load(some):
        path.write_text("\n".join(some) + "\n", encoding="utf-8")
        return load_motion(path)

    for step in (1, 4, 20):
        assert load([*lines[:-1:step], lines[-1]]).n == 6
    for end in range(30, len(lines) - 30, 23):
        with pytest.raises(InputError, match=r"ends before it rests: .* the last two rows .* cut off\?"):
            load(lines[:end])
        with pytest.raises(InputError, match=r"begins before it rests: .* the first two rows"):
            load([lines[0], *lines[end:]])


def test_angles_within_a_turn_of_radians_are_warned_of(tmp_path):
    path = tmp_path / "motion.csv"
    path.write_text("time_s,q1_deg,q2_deg\n0,0.5,0\n1,1.2,-3.1\n", encoding="utf-8")
    with pytest.warns(InputWarning, match=r"no angle is above 3.1 degrees; are they radians\?"):
        load_motion(path)
    path.write_text("time_s,q1_rad,q2_rad\n0,0.5,0\n1,1.2,-3.1\n", encoding="utf-8")
    load_motion(path)
    motion = {"start": [0.5], "commands": [[{"phi_e": 1.5, "speed": 1, "acceleration": 2}]]}
    path.write_text(json.dumps(motion), encoding="utf-8")
    with pytest.warns(InputWarning, match="no angle is above 1.5 degrees"):
        load_motion(path)
    for known in ({"units": ["m"]}, {"units": ["deg"]}, {"digest": "of a plan"}):
        path.write_text(json.dumps({**motion, **known}), encoding="utf-8")
        load_motion(path, units=known.get("units", ("deg",)))
