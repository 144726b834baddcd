"""Headers of CSV files as people and recorders write them."""

import numpy as np
import pytest

from ocptip.basics.errors import InputError, InputWarning
from ocptip.trajectories.csv_text import time_columns
from ocptip.trajectories.read import load_motion
from ocptip.trajectories.read_csv import ACCELERATION, POSITION, SPEED, columns_of

NAMES, UNITS = ["lift", "elbow", "elbow_2"], ["m", "rad", "rad"]


def read(header, unit=None, names=NAMES, units=UNITS):
    time_columns(header.split(","))
    return columns_of(header.split(","), names, units, unit)


@pytest.mark.parametrize(
    "header",
    [
        "time_s,lift_m,elbow_deg,elbow_2_deg",
        "elbow_2_deg,tau1,t,elbow_deg,lift",
        "timestamp,position.lift,position.elbow_deg,position.elbow_2_deg,effort.elbow",
        "time [ms],lift.position [m],elbow.position [deg],elbow_2.position [deg],elbow.temperature",
        "__time,/joint_states/lift/position,/joint_states/elbow/position_deg,/joint_states/elbow_2/position(deg)",
        "time_ns,pos_lift_m,pos_elbow_deg,pos_elbow_2_deg,error.lift",
        "%time,lift_position,elbow_position_deg,elbow_2_position_deg,other_elbow",
        "time,q1_m,q2_deg,q3_deg,q3_temperature",
        "time_s,/arm/lift,/arm/elbow_deg,/arm/elbow_2_deg",
    ],
)
def test_positions_are_found_by_name_in_any_order(header):
    found = read(header)
    cells = header.split(",")
    wanted = [cells[k] for k in found.joints[POSITION]]
    for cell, name, number in zip(wanted, NAMES, "123", strict=True):
        assert name in cell or f"q{number}" in cell
    assert ("elbow_2" in wanted[2], "elbow_2" in wanted[1]) == ("q3" not in wanted[2], False)
    assert found.units[POSITION] == ["m", "deg", "deg"]
    assert (found.joints[SPEED], found.joints[ACCELERATION]) == ([], [])
    clock = time_columns(cells)
    power = {"%time": -9, "time_ns": -9, "time [ms]": -3, "time_s": 0}.get(cells[clock.columns[0]])
    assert clock.power == power


@pytest.mark.parametrize("form", ["{}_deg", "{} [deg]", "position.{}_deg", "{}.position [deg]"])
def test_names_of_joints_may_have_brackets(form):
    names = ["arm[0]", "arm[1]"]
    found = read(
        ",".join(["time_s", *(form.format(name) for name in reversed(names))]), None, names, ["rad"] * 2
    )
    assert found.joints[POSITION] == [2, 1]
    assert found.units[POSITION] == ["deg", "deg"]


def test_speeds_and_accelerations():
    kinds = ("position", "velocity", "acc")
    header = ",".join(["t", *(f"{kind}.{name}" for name in NAMES for kind in kinds)])
    found = read(header, "rad")
    assert found.joints == {POSITION: [1, 4, 7], SPEED: [2, 5, 8], ACCELERATION: [3, 6, 9]}
    assert found.units[SPEED] == ["m", "rad", "rad"]
    np.testing.assert_array_equal(found.scales(SPEED), 1)
    units = read("t,q1_m,q2_rad,q3_rad,qd1_m_s,qd2_deg_s,qd3_deg_s,qdd1_m_s2,qdd2_rad_s^2,qdd3_rad_s2").units
    assert units[SPEED] == ["m", "deg", "deg"]
    assert units[ACCELERATION] == ["m", "rad", "rad"]
    named = read("t,lift,elbow_rad,elbow_2_rad,lift_velocity_m_s,elbow_velocity [deg/s],elbow_2.vel_deg_s")
    assert named.units[SPEED] == ["m", "deg", "deg"]


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (
            "time_s,lift,elbow,elbow_2",
            "elbow says neither degrees nor radians; give --unit deg",
        ),
        ("time_s,lift,elbow_deg", "no position of elbow_2; joints are known by name, or as q1_deg"),
        ("time_s,lift,elbow_deg,elbow_rad,elbow_2_deg", "elbow_deg and elbow_rad are the same quantity"),
        ("time_s,lift,elbow_deg,elbow_2_deg,velocity.lift", "no velocity of elbow, elbow_2"),
        (
            "lift,elbow_deg,elbow_2_deg",
            r"expected one column time_s, got .*; points without times are \[\[waypoint\]\] of a TOML file",
        ),
        ("t,time,lift,elbow_deg,elbow_2_deg", "expected one column time_s"),
        ("time_s,velocity.lift", "no position of lift, elbow, elbow_2"),
    ],
)
def test_what_is_missing_or_unclear_is_said(header, message):
    with pytest.raises(InputError, match=message):
        read(header)


@pytest.fixture
def of_no_unit(tmp_path):
    rows = "\n".join(f"{k / 10},{np.sin(k / 10) ** 2:.6f}" for k in range(32))
    path = tmp_path / "m.csv"
    path.write_text(f"time,position.a\n{rows}\n")
    return path


def test_units_are_never_guessed(of_no_unit):
    with pytest.raises(InputError, match=r"^m\.csv: header: position\.a says neither"):
        load_motion(of_no_unit, ["a"], ["rad"])


@pytest.mark.slow
def test_units_that_are_given_count(of_no_unit):
    path = of_no_unit
    radians = load_motion(path, ["a"], ["rad"], unit="rad")
    with pytest.warns(InputWarning, match="are they radians"):
        degrees = load_motion(path, ["a"], ["rad"], unit="deg")
    at = radians.states([1.0])[0]
    np.testing.assert_allclose(at, np.sin(1.0) ** 2, atol=1e-3)
    np.testing.assert_allclose(degrees.states([1.0])[0], np.deg2rad(at), atol=2e-5)


def test_a_joint_may_be_called_like_a_unit_or_a_word():
    found = columns_of(["t", "arm_m", "position"], ["arm_m", "position"], ["rad", "rad"], "rad")
    assert found.joints[POSITION] == [1, 2]
