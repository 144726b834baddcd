"""Single printed numbers of the sources that no other test compares."""

import numpy as np
import pytest

from ocptip.indices.platforms.controllability import control_number
from ocptip.indices.platforms.platform import PlatformPose
from ocptip.measured.power_maps import fit_power_map, motors_of
from ocptip.numerics.quadrature import gauss_legendre
from ocptip.parallel.description.frames import modified_rows
from ocptip.parallel.description.platform import value_of
from ocptip.parallel.description.ready_made import READY_MADE
from ocptip.parallel.description.robot_description import PRISMATIC, REVOLUTE, MDHRow
from ocptip.published.arms import modular_motors
from ocptip.published.cases import motion_case
from ocptip.published.tasks import experiment_robot
from studies.indices.designs.flight_simulator import FlightSimulator
from studies.parallel.operations import TABLE, WEIGHTS
from tests.indices.sample_platforms import example_main_anchors
from tests.quick import some

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


# Left columns of tables 5.1 to 5.5: joint, a, alpha in quarter turns; theta or d is the joint's. In 5.2 and
# 5.5 the sliding joint's variable stands in the column of a, in 5.5 the angles of rows 4 to 6 a row too low.
STANDARD_ROWS = {
    "3RRR": [("R", "l1", 0), ("R", "l2", 0), ("R", 0, 0)],
    "3RPR": [("R", 0, 1), ("P", 0, 1), ("R", 0, 0)],
    "Delta": [("R", "l1", 0), ("R", 0, 1), ("R", "l2", 0), ("R", 0, 1), ("R", 0, 0)],
    "4PRRR": [("P", 0, 0), ("R", "l1", 0), ("R", "l2", 0), ("R", 0, 0)],
    "6UPS": [("R", 0, 1), ("R", 0, 1), ("P", 0, 0), ("R", 0, 1), ("R", 0, 1), ("R", 0, 0)],
}


@pytest.mark.parametrize("robot", STANDARD_ROWS)
def test_left_columns_of_tables_51_to_55_are_the_right_ones(robot):
    leg = READY_MADE[robot]().legs[0]
    lengths = READY_MADE[robot]().parameters
    rows = STANDARD_ROWS[robot]
    joints = [MDHRow(PRISMATIC if kind == "P" else REVOLUTE) for kind, _, _ in rows]
    links = [(lengths[a] if isinstance(a, str) else 0.0, k * np.pi / 2) for _, a, k in rows]
    for printed, known in zip(modified_rows(joints, links), leg.rows, strict=True):
        assert printed.sigma == known.sigma
        np.testing.assert_allclose(printed.entries, [value_of(entry) for entry in known.entries], atol=1e-15)


@pytest.mark.parametrize(("case", "side"), [("A", 0.5), ("B", 0.3)])
def test_base_is_the_printed_one(case, side):
    robot = experiment_robot(motion_case(case), "printed")
    assert robot.support.mass == pytest.approx(6.582)  # section 6.2.1
    to_joint_1 = robot.arm.mount_position - robot.support.center_of_mass
    np.testing.assert_allclose(-to_joint_1, [0.036 - 0.126 * side, 0, -0.1], atol=1e-12)  # (6.15)


@pytest.mark.parametrize("case", ["C", "F"])
def test_clamp_presses_with_the_printed_weights(case):
    """Section 6.2.2: carrier of 540 g and weight of 2450 g on K3, oiled like the feet."""
    contacts = experiment_robot(motion_case(case)).support.contacts
    assert contacts[2].clamp_force == pytest.approx(29.33)
    assert contacts[2].clamp_force == pytest.approx(9.81 * (0.540 + 2.450), abs=5e-3)
    assert {contacts[2].friction_upper, contacts[2].friction_lower, contacts[0].friction} == {0.2}


CHAIN, RADIUS = 0.93, 0.2  # N m at angle 0, m: the rig of section 6.1.2


@pytest.mark.parametrize("joint", range(3))
def test_calibration_rig_determines_the_power_map(joint):
    """(6.6): weights up to 24 kg, lifted and lowered at constant speeds, give table 6.1 of 90 mm modules."""
    weights, speeds = np.meshgrid(
        [0.0, 0.54, 2.45, 2.99, 8.0, 16.0, 24.0], np.deg2rad([-150, -75, -20, 20, 90])
    )
    torque = (CHAIN + RADIUS * 9.81 * weights).ravel()
    assert torque.max() < 50.0  # (6.1)
    power = powers(joint, torque, speeds.ravel())
    fitted = motors_of([fit_power_map(torque, speeds.ravel(), power)])
    inside = np.linspace(1.0, 48.0, 9)
    for speed in np.deg2rad([-120.0, 30.0, 60.0]):
        known = fitted.power(inside[:, None], np.full((9, 1), speed))[:, 0]
        np.testing.assert_allclose(known, powers(joint, inside, np.full(9, speed)), rtol=1e-6, atol=1e-6)


def powers(joint, torque, speed):
    """Electric powers (N,), W, of table 6.1."""
    torques, rates = np.zeros((2, len(torque), 6))
    torques[:, joint], rates[:, joint] = torque, speed
    return modular_motors().power(torques, rates)[:, joint]


def test_quadrature_has_the_printed_gauss_legendre():
    nodes, weights = gauss_legendre(np.array([[-1.0, 1.0]]), 4)  # (5.22)
    np.testing.assert_allclose(nodes, [-0.86114, -0.33998, 0.33998, 0.86114], atol=5e-6)
    np.testing.assert_allclose(weights, [0.34785, 0.65215, 0.65215, 0.34785], atol=5e-6)


def translated(pose, shifts):
    """Control numbers (N,) of a pose whose platform is moved by shifts (N, 2) in its plane."""
    offsets = np.column_stack([shifts, np.zeros(len(shifts))])
    return np.array([control_number(PlatformPose(pose.base, pose.platform + d)).value for d in offsets])


@pytest.mark.parametrize("figure", some(1, ["6.9", "7.12"]))
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
