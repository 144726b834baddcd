"""The drive envelope of a motion is that of its worst instant, by envelopes of all instants."""

import dataclasses
import json

import numpy as np
import pytest

import ocptip
from ocptip.api.inputs.given import driving
from ocptip.basics.errors import InputError, PlanningError
from ocptip.cli.main import main
from ocptip.standing.at_rest.drive_envelope import largest_manoeuvres
from ocptip.standing.at_rest.drive_states import worst_states
from ocptip.standing.at_rest.manoeuvres import Manoeuvres
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.trajectories.drive_profile import DriveProfile
from ocptip.trajectories.trajectory import Trajectory
from tests.places import EXAMPLES
from tests.quick import some

TASK = EXAMPLES / "tasks" / "ur5_cart.toml"
SPEEDS = Uncertainty(speed=0.05, tilt=0.01, delay=0.01)


@pytest.fixture(scope="module")
def task():
    return ocptip.load_task(TASK, uncertainty="none")


@pytest.fixture(scope="module")
def motion(task):
    limits = task.robot.limits
    own = Trajectory.ending_together(task.start, task.goal, [None] * 6, limits.speed, limits.acceleration)
    return own.time_scaled(1.6)


def manoeuvres(robot):
    directions = np.array([[np.cos(a), np.sin(a), 0] for a in (0, 1, 2.5, 4, 5)])
    curve = Manoeuvres.along(np.array([[0, 0, 0, 0, 0, 0.5, 0, 0, 0.0]]), robot.support.gravity)
    square = np.zeros((1, 9))
    square[0, 1] = 0.5
    found = Manoeuvres.accelerations(directions, robot.support.gravity)
    return found + dataclasses.replace(curve, square=square)


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", some(1, [NONE, SPEEDS]))
def test_the_envelope_is_that_of_the_worst_instant(task, motion, tolerance):
    robot, paths = task.robot, manoeuvres(task.robot)
    times = motion.both_sides(0.05)
    states = np.hstack(motion.states(times))
    number = worst_states(robot, states, paths)
    rows = states[number.ravel()], paths.repeated(number.shape[1]), tolerance
    found = largest_manoeuvres(robot, *rows).at_worst(times[number])
    every = np.repeat(np.arange(len(times)), len(paths)), np.tile(np.arange(len(paths)), len(times))
    tiled = dataclasses.replace(
        paths,
        **{name: getattr(paths, name)[every[1]] for name in ("constant", "linear", "square", "gravity")},
    )
    each = largest_manoeuvres(robot, states[every[0]], tiled, tolerance)
    for name in ("tip", "largest"):
        least = getattr(each, name).reshape(len(times), -1).min(axis=0)
        np.testing.assert_allclose(getattr(found, name), least, rtol=1e-8 if tolerance is NONE else 2e-2)
    for k, time in enumerate(found.times):
        own = np.flatnonzero(times == time)[0]
        assert each.largest.reshape(len(times), -1)[own, k] == pytest.approx(found.largest[k], rel=1e-6)


@pytest.mark.slow
def test_at_the_limit_check_says_the_same(task, motion):
    """A base that accelerates so all the time, forwards, loses a contact a little beyond the limit."""
    found = ocptip.drive(task, motion=motion, directions=4, uncertainty="none")
    limit = found.limit("accelerate")
    for share, stands in ((0.999, True), (1.001, False)):
        speeds = np.array([[0, 0, 0], [share * limit * motion.end, 0, 0]])
        profile = DriveProfile.of_velocities(np.array([0, motion.end]), speeds)
        checked = ocptip.check(ocptip.load_task(task, GN=0.9999, GT=0.9999), motion, drive_profile=profile)
        assert (
            not any(w.name in ("GN", "GT") and w.value >= 1 for w in checked.check.worst.values())
        ) == stands


def test_a_motion_leaves_less_than_its_start(task, motion, capsys):
    moving = ocptip.drive(task, motion=motion, directions=8, uncertainty="none")
    data = moving.to_dict()
    assert "motion of the arm" not in data["not_covered"]
    assert 0 <= data["manoeuvres"]["brake"]["nominal"]["time_s"] <= motion.end
    resting = ocptip.drive(task, "start", directions=8, uncertainty="none")
    assert moving.worst_direction[0] < resting.worst_direction[0]
    assert json.dumps(data)
    with pytest.raises(ocptip.InputError, match="of a posture or of one motion"):
        ocptip.drive(task, "start", motion=motion)
    assert main(["drive", str(TASK), "--posture", "nowhere"]) == 2
    assert "posture" in capsys.readouterr().err


def test_stops_are_refused_while_the_base_drives(task):
    profile = "1 m, 0.5 m/s, 0.5 m/s^2"
    with pytest.raises(InputError, match="stops path: not for a base that drives"):
        ocptip.check(task, "start", drive_profile=profile, stops="path")


@pytest.mark.slow
def test_limits_on_stops_are_left_out_while_the_base_drives(task):
    stopping = task.each(lambda own: dataclasses.replace(own, limits=own.stops.asked(own.limits)))
    found = ocptip.check(stopping, "start", drive_profile="1 m, 0.5 m/s, 0.5 m/s^2")
    assert found.verified
    assert not found.task.limits.stoppable
    assert any("stops of the arm, also those that the task asks for" in text for text in found.assumed)


@pytest.mark.slow
def test_a_check_says_which_acceleration_steps_it_covers(task):
    profile = "1 m, 0.5 m/s, 0.5 m/s^2"
    nominal = ocptip.check(task, "start", drive_profile=profile)
    assert not any("overshoot" in text for text in nominal.assumed)
    within = dataclasses.replace(task.limits, tolerance=Uncertainty(damping=0.05))
    found = ocptip.check(dataclasses.replace(task, limits=within), "start", drive_profile=profile)
    assert "base and joints in all combinations, with delayed joints, on rigid" in found.assumed[-2]
    assert found.assumed[-1].endswith("sway of elastic contacts at acceleration steps")


def test_task_files_take_drive_profiles_in_words(tmp_path):
    text = TASK.read_text(encoding="utf-8").replace("ur5.urdf", str(TASK.parent / "ur5.urdf"))
    words, file = "1 m, 0.5 m/s, 0.8 m/s^2", tmp_path / "cart.toml"
    file.write_text(text.replace("[motion]", f'[motion]\ndrive_profile = "{words}"'), encoding="utf-8")
    robot = ocptip.load_task(file).robot
    assert robot.acts.end == pytest.approx(1 / 0.5 + 0.5 / 0.8)
    wrong = text.replace("[motion]", '[motion]\ndrive_profile = "1 m, fast"')
    file.write_text(wrong, encoding="utf-8")
    with pytest.raises(InputError, match=r"cart\.toml: motion\.drive_profile: .*expected distance, speed"):
        ocptip.load_task(file)


def test_a_search_without_plan_says_what_the_base_alone_breaks(task, monkeypatch):
    def none(*_):
        raise PlanningError("no start gave a plan")

    monkeypatch.setattr("ocptip.api.plan.searched", none)
    said, plain = list[str](), ocptip.load_task(task, uncertainty="none")
    for speed, alone in ((3.0, True), (0.1, False)):
        speeds = np.array([[speed, 0, 0], [speed, 0, 0], [0, 0, 0]])
        profile = DriveProfile.of_velocities(np.array([0, 0.1, 0.4]), speeds)
        with pytest.raises(ocptip.NoPlanError, match="no start gave a plan") as caught:
            ocptip.plan(driving(plain, profile), stage=said.append)
        told = "the base alone, its arm at rest, breaks limits: at the start: GN is" in f"{caught.value}"
        assert told == alone
    assert len(said) == 1


def test_a_refused_timing_says_what_the_base_alone_breaks(task, motion, monkeypatch):
    def none(*_, **__):
        raise InputError("path: cannot be timed: no speed keeps all limits")

    monkeypatch.setattr("ocptip.api.retime.time_path", none)
    for speed, alone in ((3.0, True), (0.1, False)):
        speeds = np.array([[speed, 0, 0], [speed, 0, 0], [0, 0, 0]])
        profile = DriveProfile.of_velocities(np.array([0, 0.1, 0.4]), speeds)
        with pytest.raises(InputError, match="motion: path: cannot be timed: no speed") as caught:
            ocptip.retime(task, motion, drive_profile=profile)
        told = "the base alone, its arm at rest, breaks limits: at the start: GN is" in f"{caught.value}"
        assert told == alone
