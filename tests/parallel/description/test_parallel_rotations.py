"""Twelve Euler conventions against derivatives of the rotation matrix; numbers against expressions."""

import casadi as cs
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.numerics.vectors import skew
from ocptip.parallel.description.frames import (
    PlatformCoordinates,
    euler_rotation,
    rate_matrix,
    rate_matrix_derivative,
    rotation_vector,
)
from ocptip.parallel.description.platform import CONVENTIONS, Platform
from tests.quick import examples


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_rates_are_derivatives_of_the_rotation(convention):
    phi, rates = cs.SX.sym("phi", 3), cs.SX.sym("rates", 3)
    R = euler_rotation(convention, [phi[i] for i in range(3)])
    spin = cs.reshape(cs.jtimes(cs.vec(R), phi, rates), 3, 3) @ R.T
    omega = cs.vertcat(spin[2, 1], spin[0, 2], spin[1, 0])
    drift = cs.jtimes(omega, phi, rates)
    reference = cs.Function("reference", [phi, rates], [R, omega, drift, cs.jacobian(omega, rates)])
    rng = np.random.default_rng(1)
    for angles, speeds in rng.uniform(-3, 3, (5, 2, 3)):
        rotation, velocity, acceleration, E = (np.array(v) for v in reference(angles, speeds))
        np.testing.assert_allclose(euler_rotation(convention, angles), rotation, atol=1e-14)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
        np.testing.assert_allclose(rate_matrix(convention, angles), E, atol=1e-13)
        np.testing.assert_allclose(rate_matrix(convention, angles) @ speeds, velocity[:, 0], atol=1e-13)
        derivative = rate_matrix_derivative(convention, angles, speeds)
        np.testing.assert_allclose(derivative @ speeds, acceleration[:, 0], atol=1e-12)


def test_rate_matrix_of_xyz_is_the_printed_one():
    a, b = 0.4, -0.7
    s1, c1, s2, c2 = np.sin(a), np.cos(a), np.sin(b), np.cos(b)
    np.testing.assert_allclose(
        rate_matrix("xyz", [a, b, 2.0]), [[1, 0, s2], [0, c1, -s1 * c2], [0, s1, c1 * c2]], atol=1e-15
    )


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_determinant_of_the_rates(convention):
    phi = [0.3, 0.8, -1.1]
    expected = np.cos(phi[1]) if len(set(convention)) == 3 else np.sin(phi[1])
    assert abs(np.linalg.det(rate_matrix(convention, phi))) == pytest.approx(abs(expected), rel=1e-12)


@given(st.lists(st.floats(-1, 1), min_size=3, max_size=3), st.floats(0, np.pi))
@examples(60)
def test_rotation_vector_inverts_the_exponential(direction, angle):
    axis = np.array(direction)
    if np.linalg.norm(axis) < 1e-3:
        return
    vector = axis / np.linalg.norm(axis) * angle
    R = pin.exp3(vector)
    found = rotation_vector(R)
    assert np.linalg.norm(found) <= np.pi + 1e-12
    np.testing.assert_allclose(pin.exp3(found), R, atol=2e-7 if angle > 3.1 else 1e-12)


def test_skew():
    u, v = np.random.default_rng(0).normal(size=(2, 3))
    np.testing.assert_allclose(skew(u) @ v, np.cross(u, v))


def test_symbols_come_out_as_symbols():
    phi = cs.SX.sym("phi", 3)
    z = [phi[0]]
    r, R = PlatformCoordinates(Platform((0, 0, 0, 0, 0, 1))).pose(z)
    assert isinstance(R, cs.SX)
    assert isinstance(r, np.ndarray)


@pytest.mark.parametrize(
    ("mask", "convention"),
    [
        ((1, 1, 0, 0, 0, 1), "xyz"),
        ((1, 1, 1, 1, 0, 0), "zyx"),
        ((1, 1, 1, 1, 1, 0), "zyx"),
        ((1, 0, 1, 0, 1, 1), "yzx"),
        ((0, 0, 0, 1, 1, 1), "zxz"),
        ((1, 1, 1, 1, 1, 1), "xzy"),
        ((1, 1, 1, 0, 0, 0), "xyz"),
    ],
)
def test_twist_of_restricted_platforms(mask, convention):
    coordinates = PlatformCoordinates(Platform(mask, convention))
    m = sum(mask)
    z, zd, zdd = np.random.default_rng(2).uniform(-1, 1, (3, m)) + 0.2
    zd_symbol, t = cs.SX.sym("zd", m), cs.SX.sym("t")
    path = [z[i] + zd_symbol[i] * t + 0.5 * zdd[i] * t**2 for i in range(m)]
    r, R = coordinates.pose(path)
    r, R = cs.SX(r), cs.SX(R)
    spin = cs.reshape(cs.jacobian(cs.vec(R), t), 3, 3) @ R.T
    twist = cs.vertcat(cs.jacobian(r, t), spin[2, 1], spin[0, 2], spin[1, 0])
    reference = cs.Function("reference", [t, zd_symbol], [twist, cs.jacobian(twist, t)])
    velocity, acceleration = (np.array(v)[:, 0] for v in reference(0, zd))
    s = coordinates.rates(z) @ zd
    sd = coordinates.rates(z) @ zdd + coordinates.rates_derivative(z, zd) @ zd
    T = coordinates.selection(z)
    np.testing.assert_allclose(T @ s, velocity, atol=1e-13)
    np.testing.assert_allclose(T @ sd + coordinates.selection_drift(z, s), acceleration, atol=1e-12)
