"""Phases to commands: round trips, the conditions, and what is said when they are violated."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given

from ocptip.basics.errors import InputError
from ocptip.trajectories.ramps import JointRamps, phase_violations, phases_to_commands, without_idle_ramps
from tests.trajectories.strategies import angles, commands, phases


@given(angles(), phases())
def test_phases_to_commands_to_phases(phi_start, given_phases):
    """The servo law makes exactly the phases that the commands were made from."""
    peaks, ramps, cruises = given_phases
    assert phase_violations(peaks, ramps, cruises) == []
    motion = JointRamps.from_commands(phi_start, phases_to_commands(phi_start, peaks, ramps, cruises))
    assert motion.peaks == pytest.approx(peaks, abs=1e-9)
    assert motion.ramps == pytest.approx(ramps, abs=1e-9)
    assert motion.cruises == pytest.approx(cruises, abs=1e-9)


@given(angles(), commands)
def test_commands_to_phases_to_commands(phi_start, given_commands):
    """The commands found for a motion move the joint the same way, whatever the first ones were."""
    first = JointRamps.from_commands(phi_start, given_commands)
    # Close to where the motion jumps in its commands there is no inverse: condition 5.
    assume(np.all(first.margins[:-1] > 1e-6))
    assume(np.all(np.abs(first.peaks) > 1e-3))
    assume(np.all((first.ramps == 0) | (first.ramps > 1e-5)))
    second = JointRamps.from_commands(
        phi_start, phases_to_commands(phi_start, first.peaks, first.ramps, first.cruises)
    )
    times = np.linspace(0, first.end, 301)
    for one, two in zip(first.states(times)[:2], second.states(times)[:2], strict=True):
        assert one == pytest.approx(two, abs=1e-6)
    assert second.end == pytest.approx(first.end, abs=1e-6)


@given(angles(), phases())
def test_margins_are_those_of_the_phases(phi_start, given_phases):
    """Condition 5 is told from phases alone by the same number as from the commands."""
    peaks, ramps, cruises = given_phases
    motion = JointRamps.from_commands(phi_start, phases_to_commands(phi_start, peaks, ramps, cruises))
    for k in range(1, len(peaks) - 1):
        margin = motion.margins[k]
        below = phase_violations(peaks, ramps, cruises, resolution=margin * (1 - 1e-6) - 1e-9)
        above = phase_violations(peaks, ramps, cruises, resolution=margin * (1 + 1e-6) + 1e-9)
        assert not any(f"command {k + 1}" in text for text in below)
        assert any(f"command {k + 1}" in text for text in above)


def test_goal_replaces_the_last_target():
    """An optimiser's durations are only as good as its tolerance; the commands end at the goal exactly."""
    peaks, ramps, cruises = [1.0], [0.5, 0.5], [1.0]
    goal = 1.5 + 1e-8
    found = phases_to_commands(0.0, peaks, ramps, cruises, phi_goal=goal)
    assert JointRamps.from_commands(0.0, found).phi_end == goal
    with pytest.raises(InputError, match="phi_goal"):
        phases_to_commands(0.0, peaks, ramps, cruises, phi_goal=1.6)


def test_same_speed_without_ramp():
    """w_k = w_{k-1}, d_k = 0: the acceleration is free, the last one follows from the braking."""
    peaks, ramps, cruises = [1.0, 1.0, 1.0], [0.5, 0.0, 0.0, 2.0], [1.0, 0.3, 0.2]
    found = phases_to_commands(0.0, peaks, ramps, cruises)
    assert [command.acceleration for command in found] == [2.0, 2.0, 0.5]
    motion = JointRamps.from_commands(0.0, found)
    assert motion.ramps == pytest.approx(ramps)
    assert motion.cruises == pytest.approx(cruises)


def test_commands_that_move_nothing():
    """They may come first; their speed and acceleration do not matter."""
    found = phases_to_commands(0.2, [0.0, 0.0, -1.0], [0.0, 0.0, 1.0, 1.0], [0.0, 0.0, 0.0])
    motion = JointRamps.from_commands(0.2, found)
    assert motion.peaks == pytest.approx([0, 0, -1])
    assert motion.end == pytest.approx(2.0)
    assert JointRamps.from_commands(0.2, phases_to_commands(0.2, [0.0], [0.0, 0.0], [0.0])).end == 0


@pytest.mark.parametrize("w", [1.0, -0.3])
def test_last_command_that_only_brakes(w):
    """Its phases are not unique (d_n = 0 and a brake instead), its motion is."""
    motion = JointRamps.from_commands(0.0, phases_to_commands(0.0, [w, 0.0], [0.5, 0.8, 0.0], [0.4, 0.0]))
    assert motion.end == pytest.approx(1.7, abs=1e-6)
    assert motion.phi_end == pytest.approx(w * (0.25 + 0.4 + 0.4))
    assert motion.states(1.3)[1] == pytest.approx(w / 2)


def test_slowing_down_without_cruise_jumps():
    """Why condition 5 is there: the least rounding of the target would make the joint stop and turn back."""
    peaks, ramps, cruises = [1.0, 0.5, 0.8], [0.5, 0.5, 0.3, 0.8], [1.0, 0.0, 1.0]
    assert len(phase_violations(peaks, ramps, cruises)) == 1
    found = phases_to_commands(0.0, peaks, ramps, [1.0, 1e-6, 1.0])
    motion = JointRamps.from_commands(0.0, found)
    assert motion.margins[1] == pytest.approx(0.5e-6)
    short = [found[0], type(found[1])(found[1].phi_e - 1e-6, found[1].speed, found[1].acceleration), found[2]]
    jumped = JointRamps.from_commands(0.0, short)
    assert jumped.brake_starts[1] - motion.brake_starts[1] == pytest.approx(0.5, abs=2e-3)


@pytest.mark.parametrize(
    ("peaks", "ramps", "cruises", "said"),
    [
        ([1.0], [-0.5, 0.5], [0.0], "ramp 1: lasts -0.5 s"),
        ([1.0], [0.5, 0.5], [-1.0], "cruise 1: lasts -1 s"),
        ([1.0], [0.0, 0.5], [0.0], "command 1 .*step of the speed"),
        ([1.0, 1.0], [0.5, 0.1, 0.5], [0.0, 1.0], "command 2 .*changes no speed"),
        ([1.0, 0.0, 1.0], [0.5, 0.5, 0.5, 0.5], [0.0, 0.0, 0.0], "command 2 .*rest between its ends"),
        ([0.0], [0.0, 0.0], [1.0], "command 1 .*rest between its ends"),
        ([1.0, 0.5, 1.0], [0.5, 0.5, 0.5, 1.0], [0.0, 0.0, 0.0], "command 2 .*braking at once"),
        ([1.0, 2.0], [0.5, 0.5, 0.5], [0.0, 0.0], "braking: lasts 0.5 s, must last 1 s"),
        ([1.0, 1.0], [0.5, 0.0, 0.0], [0.0, 1.0], "braking: lasts 0 s"),
    ],
)
def test_violations_are_named(peaks, ramps, cruises, said):
    """One sentence each, and the inverse refuses with the same words."""
    found = phase_violations(peaks, ramps, cruises)
    assert len(found) == 1
    with pytest.raises(InputError, match=said):
        phases_to_commands(0.0, peaks, ramps, cruises)


def test_optimiser_noise_is_tolerated():
    """Durations a little below 0, and next to no change of speed in next to no time."""
    found = phases_to_commands(0.0, [1.0, 1.0 + 1e-9], [0.5, -1e-9, 0.5], [-1e-8, 1.0])
    assert JointRamps.from_commands(0.0, found).end == pytest.approx(2.0)


def test_bad_arrays_are_refused():
    """Shapes and NaN."""
    with pytest.raises(InputError, match="ramps: expected shape 2"):
        phase_violations([1.0], [1.0], [1.0])
    with pytest.raises(InputError, match="cruises: contains NaN"):
        phase_violations([1.0], [1.0, 1.0], [np.nan])
    with pytest.raises(InputError, match="at least one"):
        phase_violations([], [1.0], [])


def test_ramps_that_change_no_speed_are_cruise():
    phases = [0.5, 0.5, -0.4], [0.2, 0.1, 0.3, 0.2], [0.3, 0.4, 0.5]
    with pytest.raises(InputError, match="changes no speed"):
        phases_to_commands(0.1, *phases)
    w, d, c = without_idle_ramps(*map(np.array, phases))
    np.testing.assert_allclose(d, [0.2, 0.0, 0.3, 0.2])
    np.testing.assert_allclose(c, [0.4, 0.4, 0.5])
    d[-1] = braking = 0.4 * 0.3 / 0.9
    ramps = JointRamps.from_commands(0.1, phases_to_commands(0.1, w, d, c))
    assert ramps.phi_end == pytest.approx(0.1 + 0.05 + 0.4 + 0.015 - 0.2 - 0.2 * braking)
