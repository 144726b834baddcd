"""Bases that drive on wheels with hinges in MuJoCo: wheels lift where the drive envelope says so."""

import numpy as np
import pytest

from ocptip.standing.at_rest.drive_envelope import largest_manoeuvres
from ocptip.standing.at_rest.manoeuvres import Manoeuvres
from ocptip.task_files.motion import load_task
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from studies.driving.run import rows_of
from studies.driving.wheels import RADIUS, on_wheels, tips_at
from studies.driving.whole_body import LIFTED, driven
from tests.places import EXAMPLES
from tests.quick import some

TASK = EXAMPLES / "tasks" / "ur5_cart.toml"


@pytest.fixture(scope="module")
def task():
    return load_task(TASK)


@pytest.mark.parametrize(("slope", "posture"), some(2, [(0.0, "start"), (0.08, "start"), (-0.05, "goal")]))
def test_wheels_lift_at_the_braking_of_the_envelope(task, slope, posture):
    robot, q = task.robot, getattr(task, posture)
    gravity = 9.81 * np.array([np.sin(slope), 0, -np.cos(slope)])
    brake = Manoeuvres.accelerations(np.array([[-1.0, 0, 0]]), gravity)
    found = largest_manoeuvres(robot, q, brake)
    predicted = found.tip[0]
    tilted = robot.varied(support=robot.support.varied(gravity=gravity), reference_moment=1.0)
    model = on_wheels(tilted, q, np.tile([0, 1, 0], (4, 1)))
    rate, initial = 1.0, 9.0  # the deceleration grows by `rate` per second

    def wheel_speeds(t):
        return np.full(4, (initial - rate * t**2 / 2) / RADIUS)

    time = tips_at(model, wheel_speeds, (initial, 0.0), 1.5 * predicted / rate, found.contacts[0])
    assert rate * time == pytest.approx(predicted, rel=0.02)


@pytest.mark.slow
def test_wheels_lift_at_the_speed_of_the_envelope_in_a_curve(task):
    """All wheels are steered to the same centre, on the right; the speed grows slowly."""
    robot, radius, begin, rate = task.robot, 3.0, 1.5, 0.25
    steady, linear, square = np.zeros((3, 1, 9))
    steady[0, [0, 8]] = rate, -rate / radius
    square[0, 1], linear[0, 5] = -1 / radius, -1 / radius
    curve = Manoeuvres(steady, linear, square, robot.support.gravity[None])
    found = largest_manoeuvres(robot, task.start, curve)
    predicted = found.tip[0]
    spokes = np.array([np.add(contact.position, [0, radius, 0]) for contact in robot.support.contacts])
    away = np.linalg.norm(spokes, axis=1)
    model = on_wheels(robot, task.start, spokes / away[:, None])

    def wheel_speeds(t):
        return (begin + rate * t) * away / radius / RADIUS

    time = tips_at(
        model, wheel_speeds, (begin, -begin / radius), 1.5 * (predicted - begin) / rate, found.contacts[0]
    )
    assert begin + rate * time == pytest.approx(predicted, rel=0.02)


def test_a_whole_body_replay_lifts_wheels_beyond_the_braking_of_the_envelope_alone(task):
    """The cart rolls along a diagonal with steered wheels and brakes as hard as it speeds up."""
    robot, q, along = task.robot, task.start, np.array([1.0, 0.5]) / np.hypot(1.0, 0.5)
    brake = Manoeuvres.accelerations(-np.array([[*along, 0.0]]), robot.support.gravity)
    predicted = float(largest_manoeuvres(robot, q, brake).tip[0])
    rest = [(RampCommand(angle, 1.0, 1.0),) for angle in q]
    arm = Trajectory.from_profiles(q, rest)
    for share, lifts in ((0.95, False), (1.1, True)):
        a = share * predicted * along
        moves = [(RampCommand(own * 0.36, own * 0.6, own),) for own in a]
        base = Trajectory.from_profiles(np.r_[0, 0, 0, q], [*moves, (RampCommand(0.0, 1.0, 1.0),), *rest])
        lift, _ = driven(robot, arm, base)
        assert (lift > LIFTED) == lifts


@pytest.mark.slow
def test_the_study_finds_every_limit_within_two_per_cent():
    rows = [row for row in rows_of(TASK, 1, 0) if row["predicted"] is not None]
    assert len(rows) >= 5
    assert max(abs(row["off"]) for row in rows) < 0.02
