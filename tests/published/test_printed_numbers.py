"""Single printed numbers of the sources that no other test compares."""

import numpy as np
import pytest

from ocptip.indices.platforms.controllability import control_number
from ocptip.indices.platforms.platform import PlatformPose
from ocptip.numerics.quadrature import gauss_legendre
from ocptip.published.cases import motion_case
from ocptip.published.tasks import experiment_robot
from studies.indices.designs.flight_simulator import FlightSimulator
from studies.parallel.operations import TABLE, WEIGHTS
from tests.indices.sample_platforms import example_main_anchors

# Weighted sums of table 5.7 in the order of the rows (openSYMORO, Abdellatif, ParaDyn).
WEIGHTED_SUMS = {
    "3RPR tau_a": (1009, 711, 684),
    "3RRR tau_a": (1288, 1103, 955),
    "Delta tau_a": (4634, 2072, 1905),
    "4PRRR tau_a": (2418, 1385, 1132),
    "6UPS tau_s": (5059, 5229, 4476),
    "6UPS J_a": (6770, 1060, 1097),
}


@pytest.mark.parametrize("robot", WEIGHTED_SUMS)
def test_weighted_operations_sum_as_printed_in_table_57(robot):
    np.testing.assert_array_equal(np.array(TABLE[robot]) @ WEIGHTS, WEIGHTED_SUMS[robot])


@pytest.mark.parametrize(("case", "side"), [("A", 0.5), ("B", 0.3)])
def test_base_is_the_printed_one(case, side):
    robot = experiment_robot(motion_case(case), "printed")
    assert robot.support.mass == pytest.approx(6.582)  # section 6.2.1
    to_joint_1 = robot.arm.mount_position - robot.support.center_of_mass
    np.testing.assert_allclose(-to_joint_1, [0.036 - 0.126 * side, 0, -0.1], atol=1e-12)  # (6.15)


def test_quadrature_has_the_printed_gauss_legendre():
    nodes, weights = gauss_legendre(np.array([[-1.0, 1.0]]), 4)  # (5.22)
    np.testing.assert_allclose(nodes, [-0.86114, -0.33998, 0.33998, 0.86114], atol=5e-6)
    np.testing.assert_allclose(weights, [0.34785, 0.65215, 0.65215, 0.34785], atol=5e-6)


def translated(pose, shifts):
    """Control numbers (N,) of a pose whose platform is moved by shifts (N, 2) in its plane."""
    offsets = np.column_stack([shifts, np.zeros(len(shifts))])
    return np.array([control_number(PlatformPose(pose.base, pose.platform + d)).value for d in offsets])


@pytest.mark.parametrize("figure", ["6.9", "7.12"])
def test_highest_isoline_is_the_printed_one(figure):
    """Isolines 0.05 apart; the highest printed one is 0.65 in figure 6.9 and 0.95 in figure 7.12."""
    best = FlightSimulator.optimal()
    pose, highest = {
        "6.9": (best.platform.at(best.position), 0.65),
        "7.12": (example_main_anchors(), 0.95),
    }[figure]
    line = np.linspace(-0.6, 0.6, 25)
    values = translated(pose, np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2))
    assert np.floor(values.max() / 0.05 - 1e-9) * 0.05 == pytest.approx(highest)
