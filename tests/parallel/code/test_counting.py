"""The counting rule, and the operation counts as regression bounds."""

from __future__ import annotations

import casadi as cs
import pytest

from ocptip.parallel.code.lean import lean_function
from ocptip.parallel.code.leg_plans import OperationCount, count_operations
from tests.parallel.parallel_cases import golden
from tests.quick import some

x, y, z = (cs.SX.sym(name) for name in "xyz")


@pytest.mark.parametrize(
    ("outputs", "expected"),
    [
        ([x + y], OperationCount(1, 0, 0, 0, 1)),
        ([x], OperationCount(0, 0, 0, 0, 1)),
        ([cs.SX(3.0)], OperationCount(0, 0, 0, 0, 0)),
        ([-(x * y)], OperationCount(1, 1, 0, 0, 1)),
        ([2 * x], OperationCount(1, 0, 0, 0, 1)),
        ([x * x / y], OperationCount(0, 1, 1, 0, 1)),
        ([cs.sin(x) * cs.cos(x)], OperationCount(0, 1, 0, 2, 1)),
        (cs.cse([(x + y) * z, (x + y) * (x + y)]), OperationCount(1, 2, 0, 0, 3)),
        ([cs.sqrt(x)], OperationCount(0, 0, 0, 0, 1, 1)),
    ],
)
def test_rule_on_small_functions(outputs, expected):
    assert count_operations(cs.Function("f", [x, y, z], outputs)) == expected


def test_weights():
    count = OperationCount(2, 3, 5, 7, 11, 1)
    assert count.arithmetic == 2 + 3 + 4 * 5 + 10 * 7 + 10
    assert count.weighted == count.arithmetic + 11
    assert (count + count).weighted == 2 * count.weighted
    assert count.to_dict()["weighted"] == count.weighted


# Weighted sums: first the best of the published table, then the target, then what is reached now.
BOUNDS = {
    "3RPR": (684, 520, 484),
    "3RRR": (955, 825, 663),
    "Delta": (1905, 1360, 1145),
    "4PRRR": (1132, 975, 862),
}


@pytest.mark.parametrize("kind", some(2, BOUNDS))
def test_motor_forces_stay_cheap(kind):
    published, target, reached = BOUNDS[kind]
    count = lean_function(golden(kind).robot, form="A", dynpar=3, euler=True).count
    assert reached <= target < published
    assert count.weighted <= reached
    assert count.others == 0


@pytest.mark.slow
def test_hexapod_stays_cheap():
    robot = golden("6UPS").robot
    force = lean_function(robot, form="X", dynpar=3).count
    jacobian = lean_function(robot, ("J_a",), form="S").count
    assert force.weighted <= 2337 <= 2470 < 4476
    assert jacobian.weighted <= 592 < 1060
    assert lean_function(robot, form="A", dynpar=3, euler=True).count.weighted <= 2710


@pytest.mark.slow
def test_base_parameters_are_the_cheapest_form():
    robot = golden("Delta").robot
    counts = [lean_function(robot, form="A", dynpar=dynpar).count.weighted for dynpar in (1, 2, 3)]
    assert counts == sorted(counts, reverse=True)
