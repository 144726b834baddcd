"""Exact rotations of symbolic vectors."""

from __future__ import annotations

import casadi as cs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.numerics.vectors import skew
from ocptip.parallel.description.platform import elementary_rotation
from ocptip.parallel.symbolic.spatial_sx import Rotation, acceleration_matrix, turn, unit, vector

ANGLES = st.floats(-7, 7)


def numbers(entries) -> np.ndarray:
    return np.array(cs.DM(cs.evalf(cs.vertcat(*entries)))).ravel()


@given(chain=st.lists(st.tuples(st.integers(0, 2), ANGLES), max_size=5))
def test_chain_is_the_product_of_its_rotations(chain):
    rotation = Rotation(turn(axis, angle) for axis, angle in chain)
    expected = np.eye(3)
    for axis, angle in chain:
        expected = expected @ elementary_rotation("xyz"[axis], angle)
    found = np.array([numbers(row) for row in rotation.matrix()])
    assert found == pytest.approx(expected, abs=1e-12)
    v = [0.3, -1.2, 0.7]
    assert numbers(rotation.inverse(vector(v))) == pytest.approx(expected.T @ v, abs=1e-12)


@pytest.mark.parametrize("quarters", [-3, -2, -1, 0, 1, 2, 3, 5])
def test_right_angles_cost_nothing(quarters):
    v = cs.SX.sym("v", 3)
    turned = Rotation([turn(0, quarters * np.pi / 2)])([v[k] for k in range(3)])
    function = cs.Function("f", [v], turned)
    operations = {function.instruction_id(k) for k in range(function.n_instructions())}
    assert operations <= {cs.OP_INPUT, cs.OP_OUTPUT, cs.OP_NEG}
    assert all(
        entry.is_zero() or entry.is_one() or (-entry).is_one() for entry in Rotation([turn(2, 0)])(unit(0))
    )


def test_neighbouring_turns_merge_and_cancel():
    q = cs.SX.sym("q")
    assert len(Rotation([turn(2, q), turn(2, 0.3), turn(0, 0.2)]).turns) == 2
    assert Rotation([turn(1, np.pi / 2), turn(1, -np.pi / 2)]).turns == ()


@given(st.lists(st.floats(-3, 3), min_size=6, max_size=6))
def test_acceleration_matrix(values):
    w, a = np.array(values[:3]), np.array(values[3:])
    found = np.array([numbers(row) for row in acceleration_matrix(vector(w), vector(a))])
    assert found == pytest.approx(skew(a) + skew(w) @ skew(w), abs=1e-12)
