"""The printed experiment: all 235 event times of table E.2 from the parameters of table E.1."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from ocptip.basics.errors import InputError
from ocptip.published.cases import MotionCase, motion_case, motion_cases
from ocptip.trajectories.ramps import JointRamps, RampCommand, phases_to_commands
from ocptip.trajectories.trajectory import Trajectory

SPEED_LIMITS = np.deg2rad([150, 150, 150, 135, 216, 340])  # (6.1)
ACCELERATION_LIMITS = np.deg2rad([600, 600, 600, 540, 864, 1700])
ROUNDED = np.deg2rad(5e-5)  # half a unit of the last digit of table E.1
NAMES = list(motion_cases())


def joint_times(motion: JointRamps, joint: int) -> dict[str, float]:
    """Event times of an optimised joint by their names in table E.2; NaN where no zero crossing is."""
    times = {f"t{joint}_E": motion.end}
    for k in range(3):
        times[f"t{joint}_{k + 1}p"] = motion.ramp_ends[k]
        times[f"t{joint}_{k + 1}pp"] = motion.brake_starts[k]
        if k:
            times[f"z{joint}_{k + 1}"] = motion.crossings[k]
    return times


def event_times(motion: Trajectory) -> dict[str, float]:
    """All event times by their names in table E.2."""
    times = {"tA": 0.0, "t_E": motion.end}
    for joint in (1, 2, 3):
        times |= joint_times(motion.joints[joint - 1], joint)
    for joint in (4, 5, 6):
        times[f"t{joint}_p"] = motion.joints[joint - 1].ramp_ends[0]
        times[f"t{joint}_pp"] = motion.joints[joint - 1].brake_starts[0]
    return times


def half_units(case: MotionCase, times: dict[str, float]) -> np.ndarray:
    """Differences from the printed times in half units of their last digits, without the 0 of tA."""
    return np.array(
        [
            (times[key] - p.seconds) / p.half_unit
            for key, p in case.printed_times.items()
            if key in times and key != "tA"
        ]
    )


def unrounded(case: MotionCase, joint: int) -> list[RampCommand]:
    """The commands nearest to the printed times among those that round to the printed parameters.

    Successive linear programmes over the eight parameters of the joint; start and goal stay.
    """
    commands = case.reference_commands[joint - 1]
    phi_start, phi_goal = case.start[joint - 1], case.goal[joint - 1]
    first, second, third = ([c.phi_e, c.speed, c.acceleration] for c in commands)
    printed = np.array(first + second + third[1:])

    def commands_of(x: np.ndarray) -> list[RampCommand]:
        rows = [x[:3], x[3:6], [phi_goal, *x[6:]]]
        return [RampCommand(*row) for row in rows]

    def residual(x: np.ndarray) -> np.ndarray:
        return half_units(case, joint_times(JointRamps.from_commands(phi_start, commands_of(x)), joint))

    x, step = printed.copy(), 1e-9
    for _ in range(4):
        r = residual(x)
        slopes = np.column_stack([(residual(x + step * e) - r) / step for e in np.eye(8)])
        minus_worst = -np.ones((len(r), 1))
        scale = ROUNDED  # the unknowns are near 1 then
        bounds = [
            ((p - ROUNDED - y) / scale, (p + ROUNDED - y) / scale) for p, y in zip(printed, x, strict=True)
        ]
        found = linprog(
            [*np.zeros(8), 1.0],
            A_ub=np.block([[slopes * scale, minus_worst], [-slopes * scale, minus_worst]]),
            b_ub=np.concatenate([-r, r]),
            bounds=[*bounds, (0, None)],
        )
        x = np.clip(x + found.x[:8] * scale, printed - ROUNDED, printed + ROUNDED)
    return commands_of(x)


def test_table_e2_has_235_times():
    """So that no comparison below is empty."""
    assert sum(len(case.printed_times) - 1 for case in motion_cases().values()) == 235


@pytest.mark.parametrize("name", NAMES)
def test_printed_parameters_give_the_printed_times(name):
    """Straight from table E.1: within 7e-5 s everywhere, half a unit of the last digit nearly everywhere."""
    case = motion_case(name)
    times = event_times(case.reference_motion(SPEED_LIMITS, ACCELERATION_LIMITS))
    for key, printed in case.printed_times.items():
        assert times[key] == pytest.approx(printed.seconds, abs=7e-5), key
    assert np.sum(np.abs(half_units(case, times)) > 1) <= 3
    assert case.reference_motion(SPEED_LIMITS, ACCELERATION_LIMITS).end == pytest.approx(
        case.printed_duration, abs=5e-3
    )


@pytest.mark.parametrize("name", NAMES)
def test_all_times_to_half_a_unit_of_the_last_digit(name):
    """Table E.1 is rounded itself: some parameters that round to it give every printed time."""
    case = motion_case(name)
    commands = [unrounded(case, joint) for joint in (1, 2, 3)]
    for mine, printed in zip(commands, case.reference_commands, strict=True):
        for one, two in zip(mine, printed, strict=True):
            assert abs(one.phi_e - two.phi_e) <= ROUNDED * (1 + 1e-9)
            assert abs(one.speed - two.speed) <= ROUNDED * (1 + 1e-9)
            assert abs(one.acceleration - two.acceleration) <= ROUNDED * (1 + 1e-9)
    motion = Trajectory.ending_together(
        case.start, case.goal, [*commands, None, None, None], SPEED_LIMITS, ACCELERATION_LIMITS
    )
    assert np.abs(half_units(case, event_times(motion))).max() <= 1


def test_zero_crossings_are_the_printed_ones():
    """Not one more or less, but for the one that table E.2 lacks: joint 2 in column H at 0.4974 s."""
    for case in motion_cases().values():
        times = event_times(case.reference_motion(SPEED_LIMITS, ACCELERATION_LIMITS))
        crossings = {key for key, t in times.items() if key.startswith("z") and np.isfinite(t)}
        missing = crossings - set(case.printed_times)
        assert set(case.printed_times) - set(times) == set()
        assert missing == ({"z2_3"} if case.column == "H" else set())
        if missing:
            assert times["z2_3"] == pytest.approx(0.4974, abs=5e-5)


@pytest.mark.parametrize("name", NAMES)
def test_printed_solutions_are_recovered_from_their_phases(name):
    """Phases of 1 ms and less, triangles, reversals: the inverse finds commands of the same motion."""
    case = motion_case(name)
    for phi_start, phi_goal, commands in zip(case.start, case.goal, case.reference_commands, strict=False):
        motion = JointRamps.from_commands(phi_start, commands)
        found = phases_to_commands(phi_start, motion.peaks, motion.ramps, motion.cruises, phi_goal=phi_goal)
        again = JointRamps.from_commands(phi_start, found)
        assert again.times == pytest.approx(motion.times, abs=1e-9)
        assert again.angles == pytest.approx(motion.angles, abs=1e-9)
        for one, two in zip(found, commands, strict=True):
            assert one.phi_e == pytest.approx(two.phi_e)
            assert one.acceleration == pytest.approx(two.acceleration)


def test_misprint_is_corrected():
    """With the printed sign of parameter 20 in column B joint 3 would go elsewhere."""
    case = next(case for case in motion_cases().values() if case.column == "B")
    assert np.rad2deg(case.reference_commands[2][1].phi_e) == pytest.approx(-24.9137)


def test_cases_of_table_51():
    """Units, labels, poses."""
    case = motion_case("A")
    assert (case.column, case.arm, case.clamped) == ("B", "FP1W2F", False)
    assert [c.triangle_side for c in motion_cases().values()] == [0.5, 0.3, 0.3, 0.5, 0.3, 0.3, 0.5, 0.3]
    assert [c.name for c in motion_cases().values() if c.clamped] == ["C", "F"]
    assert case.start_pose.position.tolist() == [0, -0.3, 0.12]
    assert case.goal_pose.position.tolist() == [0, 0.39, 0.24]
    for pose in (case.start_pose, case.goal_pose):
        assert pose.rotation @ pose.rotation.T == pytest.approx(np.eye(3))
    assert case.reference_motion(SPEED_LIMITS, ACCELERATION_LIMITS).goal == pytest.approx(case.goal)
    with pytest.raises(InputError, match=r"no 'X'.*A, B"):
        motion_case("X")
