"""Power maps against hand calculation and the laws of physics; the DC-motor model; NumPy against CasADi."""

import casadi as cs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.published.arms import load_arm, modular_motors
from ocptip.robots.motors import DCMotors, PowerMaps
from tests.quick import examples
from tests.robots.sample_arms import random_arm

MAPS = modular_motors()
DC = DCMotors(np.full(6, 5.0), np.full(6, 0.3), np.full(6, 0.1), np.full(6, 4.0), regeneration=0.4)
LIMITS = load_arm("FSFS").limits


def unit_states(torque, speed):
    return np.array(torque) * LIMITS.torque, np.array(speed) * LIMITS.speed


SIX = st.lists(st.floats(-1, 1), min_size=6, max_size=6)


def test_first_joint_by_hand():
    # Table 6.1, joint 1, load torque 10 N m at 100 deg/s: lowering, so the drive torque is -10.
    current = (0.4869 - 0.05489 + 0.03703 - 0.001224) + 100 * (0.01207 - 0.008322 + 0.0005027 + 0.000001337)
    current += 1e4 * (5.139e-5 + 1.849e-6 + 3.086e-7 - 1.63e-7)
    torque, speed = np.array([-10.0, 0, 0, 0, 0, 0]), np.array([np.deg2rad(100), 0, 0, 0, 0, 0])
    assert MAPS.power(torque, speed)[0] == pytest.approx(24 * current, rel=1e-12)


def test_standing_still_costs_the_electronics():
    np.testing.assert_allclose(
        MAPS.power(np.zeros(6), np.zeros(6)), 24 * np.array([0.4869, 0.5027, 0.4929, 0.4835, 0.2495, 0.3531])
    )


@examples(50)
@given(torque=SIX, speed=SIX)
def test_maps_are_symmetric_and_jump_only_at_rest(torque, speed):
    tau, w = unit_states(torque, speed)
    moving = np.where(w == 0, 0.1, w)
    np.testing.assert_allclose(MAPS.power(tau, moving), MAPS.power(-tau, -moving), rtol=1e-12)
    upward = MAPS.power(tau, np.zeros(6))  # sign(0) = +1
    np.testing.assert_array_equal(upward, MAPS.power(tau, np.zeros(6), np.ones(6)))
    np.testing.assert_allclose(MAPS.power(tau, np.full(6, 1e-12)), upward, rtol=1e-9)
    np.testing.assert_allclose(MAPS.power(tau, np.full(6, -1e-12)), MAPS.power(-tau, np.zeros(6)), rtol=1e-9)


def test_load_reading_conserves_energy_and_the_literal_one_does_not():
    torque, speed = np.meshgrid(np.linspace(-1, 1, 41), np.linspace(-1, 1, 41))
    tau = torque.reshape(-1, 1) * LIMITS.torque
    w = speed.reshape(-1, 1) * LIMITS.speed
    surplus = MAPS.power(tau, w) - tau * w
    assert surplus.min() > 0  # every state draws more than it delivers
    literal = modular_motors(torque_reading="drive").power(tau, w) - tau * w
    assert literal.min() < -100  # a drive that delivers 100 W more than it draws


@examples(50)
@given(torque=SIX, speed=SIX)
@pytest.mark.parametrize(
    "motors", [MAPS, modular_motors(torque_reading="drive"), DC], ids=["load", "drive", "dc"]
)
def test_casadi_and_numpy_agree(motors, torque, speed):
    tau, w = unit_states(torque, speed)
    direction = np.where(w < 0, -1.0, 1.0)
    assert motors.power_expression(cs.SX.sym("t", 6), cs.SX.sym("s", 6), 1).shape == (6, 1)
    t, s, d = (cs.SX.sym(name, 6) for name in "tsd")
    given_sign = cs.Function("p", [t, s], [motors.power_expression(t, s, list(direction))])
    symbol = cs.Function("p", [t, s, d], [motors.power_expression(t, s, d)])
    expected = motors.power(tau, w)
    for value in (given_sign(tau, w), symbol(tau, w, direction)):
        gap = np.array(value)[:, 0] - expected
        assert (np.abs(gap) < 1e-9).all() or (motors is DC and (gap > -1e-9).all() and (gap < 0.031).all())


def test_many_states_equal_one_by_one():
    tau, w = np.random.default_rng(0).normal(size=(2, 20, 6))
    for motors in (MAPS, DC):
        many = motors.power(tau, w)
        np.testing.assert_array_equal(many, [motors.power(t, s) for t, s in zip(tau, w, strict=True)])


def test_dc_motor_by_hand():
    tau, w = np.full(6, 10.0), np.full(6, 2.0)
    motor = 10 + 0.3 + 0.1 * 2
    np.testing.assert_allclose(DC.power(tau, w), 4 + (motor / 5) ** 2 + motor * 2)
    braked = -10 + 0.3 + 0.2
    np.testing.assert_allclose(DC.power(-tau, w), 4 + 0.4 * ((braked / 5) ** 2 + braked * 2))


def test_datasheet_and_estimate():
    one = np.ones(2)
    motors = DCMotors.from_datasheet(
        resistance=4 * one,
        torque_constant=0.1 * one,
        gear_ratio=100 * one,
        coulomb=one,
        viscous=one,
        standby=one,
    )
    np.testing.assert_allclose(motors.motor_constant, 5)
    model = load_arm("FSFS")
    estimate = DCMotors.estimated(model)
    full = estimate.power(model.limits.torque, model.limits.speed) - 5
    mechanical = model.limits.torque * model.limits.speed
    np.testing.assert_allclose(full, mechanical * (1.1 + 0.3 * 1.1**2))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: MAPS.power(np.zeros(5), np.zeros(5)), "torque: expected shape 6, got 5"),
        (lambda: MAPS.power(np.zeros((2, 6)), np.zeros(6)), "speed: expected shape 2 x 6, got 6"),
        (lambda: MAPS.power(np.zeros(6), np.full(6, np.nan)), "speed: contains NaN"),
        (lambda: MAPS.power(np.zeros(6), np.zeros(6), np.zeros(6)), r"direction: must be \+1 or -1"),
        (lambda: modular_motors(torque_reading="x"), "torque_reading: must be 'load' or 'drive'"),
        (lambda: PowerMaps(np.zeros((6, 11))), "coefficients: expected shape n x 12"),
        (lambda: DCMotors([0.0], [1.0], [1.0], [1.0]), "motor_constant: must be > 0"),
        (lambda: DCMotors([1.0], [1.0], [1.0], [1.0], 1.5), "regeneration: must be 0 to 1, got 1.5"),
        (lambda: DCMotors.estimated(random_arm(0, 3)), r"limits\.torque: motors cannot be estimated"),
    ],
)
def test_bad_input_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()
