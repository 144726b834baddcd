"""Base parameters, friction and links of an arm from torques with noise that were made by known ones."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import stats

from ocptip.basics.errors import InputError
from ocptip.measured.links import (
    all_parameters,
    base_parameters,
    identify_links,
    mass_tolerance,
    parameter_names,
)
from ocptip.measured.parameters import link_parameters, pseudo_of
from ocptip.measured.prediction import Predictor
from ocptip.measured.recording import Recording, Signal
from ocptip.reserves.tipping import TipMap
from ocptip.robots.bodies import exists
from ocptip.robots.process import ProcessWrench
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.worst_case import worst_case_of
from studies.recordings.run import machine

DRY, VISCOUS = np.array([2.0, 3.0, 1.5, 1.0, 1.2, 0.8]), np.array([1.0, 0.6, 0.8, 0.5, 0.7, 0.4])


@cache
def described():
    return Predictor(*machine("UR5"))


@cache
def real():
    """Masses up to 10 % off, centres by millimetres."""
    robot, motion = machine("UR5")
    rng = np.random.default_rng(7)
    factors = 1 + 0.1 * rng.uniform(-1, 1, robot.arm.links)
    arm = replace(
        robot.arm, masses=factors * robot.arm.masses, inertias=factors[:, None, None] * robot.arm.inertias,
        centres=robot.arm.centres + 0.005 * rng.normal(size=(robot.arm.links, 3)),
    )  # fmt: skip
    return Predictor(robot.varied(arm=arm), motion)


def recorded(own, seed, *, late=0.0, sensor=True, noise=0.1):
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, own.motion.end + 0.3, 2e-3)
    state = own.state(times - 0.1234567, np.array([0, 0, late, 0, 0, 0]), np.zeros(25))
    signals = []
    torques = state.torques + DRY * np.sign(state.qd) + VISCOUS * state.qd
    for k in range(6):
        white = rng.normal(size=(2, len(times)))
        signals.append(Signal(f"q{k + 1}", "angles", k, state.encoders[:, k] + 1e-4 * white[0]))
        signals.append(Signal(f"tau{k + 1}", "torques", k, torques[:, k] + noise * white[1]))
    for k, name in enumerate(("fx", "fy", "fz", "mx", "my", "mz")):
        values = state.wrenches[:, k] + noise * rng.normal(size=len(times))
        if sensor:
            signals.append(Signal(name, "sensor", k, values))
    return Recording(times, tuple(signals))


def test_base_parameters_say_all_that_the_columns_say():
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(50, 5))
    columns = np.column_stack([columns, columns @ rng.normal(size=(5, 3)), np.zeros(50)])
    columns = columns[:, rng.permutation(9)] * 10.0 ** rng.integers(-3, 3, 9)
    basis = base_parameters(columns)
    assert len(basis.independent) == 5
    np.testing.assert_allclose(columns[:, basis.independent] @ basis.combinations, columns, atol=1e-9)
    assert basis.names(list("abcdefghi"))


@cache
def identified(seed):
    return identify_links(recorded(real(), seed), described())


@pytest.fixture(scope="module")
def runs():
    return real(), [identified(seed) for seed in range(3)]


@pytest.mark.slow
def test_intervals_hold(runs):
    own, found = runs
    true = np.concatenate([found[0].basis.combinations @ all_parameters(own.robot.arm), DRY, VISCOUS])
    inside, squares = [], 0.0
    for one in found:
        seen, away = one.estimate.seen, one.estimate.values - true
        inside.append(np.abs(away[seen]) < one.estimate.half[seen])
        squares += away[seen] @ np.linalg.solve(one.estimate.covariance[np.ix_(seen, seen)], away[seen])
    assert np.mean(inside) > 0.9
    assert (
        stats.chi2.isf(0.999, len(found) * seen.sum())
        < squares
        < stats.chi2.isf(1e-3, len(found) * seen.sum())
    )
    assert 30 < seen.sum() < len(true)  # joint 5 does not move: its friction is not told
    assert np.isnan(found[0].coulomb).tolist() == [False, False, False, False, True, False]


def test_links_exist_and_predict_what_was_recorded():
    own, one = real(), identified(0)
    assert all(exists(body) for body in zip(one.arm.masses, one.arm.centres, one.arm.inertias, strict=True))
    for k in range(one.arm.links):
        assert np.linalg.eigvalsh(pseudo_of(link_parameters(one.arm)[10 * k : 10 * k + 10]))[0] > 0
    times = np.linspace(0.05, own.motion.end - 0.05, 50)
    states = own.motion.states(times)
    real_loads, described_loads, loads = (
        np.hstack(p.robot.varied(arm=arm).loads(*states))
        for p, arm in ((own, own.robot.arm), (own, machine("UR5")[0].arm), (own, one.arm))
    )
    assert np.abs(loads - real_loads).max() < 0.05 * np.abs(described_loads - real_loads).max()
    assert one.arm.masses.sum() == pytest.approx(own.robot.arm.masses.sum(), rel=1e-3)


@pytest.mark.slow
def test_a_tolerance_of_masses_covers_the_real_arm(runs):
    """Its moments about the tipping axes are within the worst case of the identified one's."""
    own, found = runs
    nominal, states = described(), np.hstack(own.motion.states(own.motion.both_sides(0.02)))
    real_moments = TipMap(own.robot.tip_over)(own.robot.loads(*np.split(states, 3, axis=1))[1])[0]
    for one in found[:3]:
        shares = [mass_tolerance(one, nominal, sigmas) for sigmas in (3.0, 6.0)]
        assert 1e-5 < shares[0] < 0.05
        assert shares[0] < shares[1] <= 2 * shares[0]
        robot = nominal.robot.varied(arm=one.arm)
        least = worst_case_of(robot, Uncertainty(arm_mass=shares[0])).all_moments(states)
        assert np.all(least <= real_moments)
        alone = TipMap(robot.tip_over)(robot.loads(*np.split(states, 3, axis=1))[1])[0]
        assert not np.all(alone <= real_moments)
    assert mass_tolerance(identify_links(recorded(own, 3, sensor=False), nominal), nominal, 3.0) is None


def test_torques_alone_and_a_late_joint():
    own = real()
    found = identify_links(recorded(own, 3, late=4e-3, sensor=False), described())
    true = np.concatenate([found.basis.combinations @ all_parameters(own.robot.arm), DRY, VISCOUS])
    away = (found.estimate.values - true)[found.estimate.seen] / found.estimate.errors[found.estimate.seen]
    assert np.abs(away).max() < 4.5
    assert len(found.names) < 40 < len(parameter_names(own.robot.arm))


PUSH, TWIST = np.array([5.0, -8.0, -20.0]), np.array([1.0, 0.5, -2.0])


@pytest.mark.slow
@pytest.mark.parametrize(
    "process",
    [
        pytest.param(ProcessWrench(PUSH, TWIST), marks=pytest.mark.slow),
        pytest.param(
            ProcessWrench(
                [0 * PUSH, PUSH, PUSH], [TWIST, -TWIST, 0 * TWIST], "tool", "time", [0.1, 0.3, 0.7]
            ),
            marks=pytest.mark.slow,
        ),
        ProcessWrench([0 * PUSH, PUSH, -PUSH], [0 * TWIST, TWIST, TWIST], "base", "path", [0.0, 0.4, 0.8]),
    ],
)
def test_what_a_process_does_is_no_inertia(process):
    """The parameters are those found without it, from the same noise, but for what it tells of the clock."""

    def acting(own):
        arm = own.robot.arm.with_process(process)
        return Predictor(own.robot.varied(arm=arm), own.motion)

    own = real()
    found = identify_links(recorded(acting(own), 3), acting(described()))
    without = identify_links(recorded(own, 3), described())
    away = np.abs(found.estimate.values - without.estimate.values)
    assert np.all(away[without.estimate.seen] < 1.0 * without.estimate.errors[without.estimate.seen])


@pytest.mark.slow
def test_without_noise_loads_are_known_to_a_millionth():
    found = identify_links(recorded(real(), 0, noise=0.0), described()).estimate
    assert found.errors[found.seen].min() > 1e-9


def test_without_torques_it_is_refused():
    recording = recorded(real(), 0)
    without = replace(recording, signals=tuple(recording.of("sensor")))
    with pytest.raises(InputError, match="no torques"):
        identify_links(without, described())
