"""Robots in platform coordinates alone, against the numeric robot, and their distance from singular poses."""

from dataclasses import replace

import casadi as cs
import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.parallel.description.platform import Parameter
from ocptip.parallel.description.ready_made import READY_MADE, delta, rpr3, rrr3
from ocptip.parallel.kinematics.closed_form import leg_solution
from ocptip.parallel.minimal_form import joint_function, minimal_form
from ocptip.parallel.robot import ParallelRobot, base_wrench
from tests.parallel.parallel_examples import prr3
from tests.quick import some

KINDS = list(READY_MADE)
GRAVITY = np.array([1.0, -2.0, -9.0])


@pytest.fixture(scope="module", params=some(2, KINDS))
def robot(request):
    return ParallelRobot(READY_MADE[request.param]())


def compiled(form):
    outputs = [form.q, form.motor_forces, form.motor_speeds, form.wrench, form.measures]
    function = cs.Function("form", [form.z, form.zd, form.zdd], outputs)
    return lambda z, zd, zdd: [np.array(v) for v in function(z, zd, zdd)]


def measures_at(form, z):
    m = form.z.numel()
    return compiled(form)(z, np.zeros(m), np.zeros(m))[4][:, 0]


def test_against_the_numeric_robot(robot):
    """Joints, motor forces, motor speeds and base wrench, under any gravity."""
    evaluate = compiled(minimal_form(robot, GRAVITY))
    rng = np.random.default_rng(7)
    for _ in range(4):
        z = robot.description.home + 0.05 * rng.normal(size=robot.m)
        zd, zdd = rng.normal(size=robot.m), 5 * rng.normal(size=robot.m)
        q, forces, speeds, wrench, measures = evaluate(z, zd, zdd)
        for column, expected in zip(q.T, robot.kinematics.point_joints(z).q, strict=True):
            turns = np.round((column - expected) / (2 * np.pi))
            np.testing.assert_allclose(column - 2 * np.pi * turns, expected, atol=1e-12)
        expected = robot.inverse_dynamics(z, zd, zdd, gravity=GRAVITY).motors
        np.testing.assert_allclose(forces[:, 0], expected, rtol=1e-10, atol=1e-9)
        s, _ = robot.kinematics.quasi(z, zd, zdd)
        np.testing.assert_allclose(speeds[:, 0], robot.jacobian(z) @ s, rtol=1e-10, atol=1e-12)
        expected = base_wrench(robot, z, zd, zdd, gravity=GRAVITY)
        np.testing.assert_allclose(wrench[:, 0], expected, rtol=1e-10, atol=1e-9)
        assert np.all(measures > 0)
        assert np.all(measures <= 1)


def test_joint_terms_take_part():
    """Inertia of drives and viscous friction of the description are in the motor forces."""
    description = delta()
    rest = (0.0,) * (len(description.legs[0].rows) - 1)
    legs = tuple(replace(leg, drive_inertia=(0.02, *rest), viscous=(0.3, *rest)) for leg in description.legs)
    heavy = ParallelRobot(replace(description, legs=legs))
    z, zd, zdd = np.array([0.05, -0.03, -0.5]), np.array([0.4, 0.2, -0.3]), np.array([3.0, -2.0, 4.0])
    forces = compiled(minimal_form(heavy))(z, zd, zdd)[1][:, 0]
    np.testing.assert_allclose(forces, heavy.inverse_dynamics(z, zd, zdd).motors, rtol=1e-10)
    assert np.abs(forces - ParallelRobot(description).inverse_dynamics(z, zd, zdd).motors).max() > 0.1


@pytest.mark.parametrize("branch", [(1,), (-1,)])
def test_legs_stay_in_their_branch(branch):
    """An elbow sign of the description, or a guess near home, chooses the same solution."""
    description = rrr3()
    signed = replace(description, legs=tuple(replace(leg, branch=branch) for leg in description.legs))
    robot = ParallelRobot(signed)
    z = np.array([0.05, -0.04, 0.1])
    q = compiled(minimal_form(robot))(z, np.zeros(3), np.zeros(3))[0]
    assert np.all(np.sign(q[1]) == branch[0])
    np.testing.assert_allclose(
        np.sin(q), np.sin(np.transpose(robot.kinematics.point_joints(z).q)), atol=1e-12
    )


def test_leg_measures_vanish_at_the_stretched_arm_and_are_negative_beyond():
    """3RRR, one leg: base joint to coupling point 1.2 m apart is stretched; everything stays finite."""
    robot = ParallelRobot(rrr3())
    form = minimal_form(robot)
    first = robot.description.legs[0]
    index = form.measure_names.index("leg 1 elbow")
    anchor = first.origin[:2]
    inward = -anchor / np.linalg.norm(anchor)
    for distance, sign in ((1.19, 1), (1.2, 0), (1.25, -1)):
        xy = anchor + distance * inward - first.coupling_point[:2]
        value = measures_at(form, [*xy, 0.0])[index]
        assert np.sign(np.round(value, 9)) == sign
    everything = compiled(form)([*(anchor + 1.25 * inward), 0.0], np.ones(3), np.ones(3))
    assert all(np.isfinite(values).all() for values in everything)


def test_platform_measure_changes_sign_in_a_type_two_singularity():
    """3RPR: where the triangles are alike the legs meet in one point."""
    robot = ParallelRobot(rpr3(twist=0.7))
    form = minimal_form(robot)
    values = [measures_at(form, [0.0, 0.0, phi])[-1] for phi in (0.0, -0.6, -0.7, -0.8)]
    assert values[0] > values[1] > 0 > values[3]
    assert abs(values[2]) < 1e-12
    assert robot.singularity([0.0, 0.0, -0.7]).kinds == ("platform (type II)",)


def test_platform_measure_is_the_volume_of_unit_rows(robot):
    form = minimal_form(robot)
    z = robot.description.home + 0.03
    rows = robot.jacobian(z).copy()
    translations = sum(robot.description.platform.mask[:3])
    rows[:, translations:] /= robot.singularity(z).length
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    assert measures_at(form, z)[-1] == pytest.approx(abs(np.linalg.det(rows)), rel=1e-9)


def test_names_are_those_of_the_measures(robot):
    form = minimal_form(robot)
    assert len(form.measure_names) == form.measures.numel() == len(set(form.measure_names))
    assert form.measure_names[-1] == "platform"


def test_what_cannot_be_eliminated_is_refused():
    description = delta()
    leg = description.legs[0]
    rough = replace(leg, coulomb=(0.1,) + (0.0,) * (len(leg.rows) - 1))
    with pytest.raises(InputError, match="leg 1 has dry friction"):
        minimal_form(ParallelRobot(replace(description, legs=(rough, *description.legs[1:]))))
    with pytest.raises(InputError, match="2 motors for 3 coordinates"):
        minimal_form(ParallelRobot(replace(description, actuated=description.actuated[:2]), check=False))
    with pytest.raises(InputError, match="has 2 signs"):
        leg_solution(leg, cs.vertsplit(cs.SX.sym("t", 3)), (1,))


@pytest.mark.parametrize("name", READY_MADE)
def test_joint_function_serves_any_geometry(name):
    """q(z) of generated code: that of the inverse kinematics, also with other numbers for the geometry."""
    robot = ParallelRobot(READY_MADE[name]())
    function, rng = joint_function(robot), np.random.default_rng(3)
    values = robot.description.parameters
    for scale in (1.0, 1.02):
        legs = []
        for leg in robot.description.legs:
            rows = tuple(replace(row, d=_scaled(row.d, scale)) for row in leg.rows)
            legs.append(replace(leg, rows=rows))
        other = ParallelRobot(replace(robot.description, legs=tuple(legs)))
        geometry = [v * (scale if key.startswith("l") else 1.0) for key, v in values.items()]
        for _ in range(3):
            z = robot.description.home + 0.05 * rng.uniform(-1, 1, robot.m)
            q, distance = (np.array(part) for part in function(z, geometry))
            expected = np.column_stack([own[: len(q)] for own in other.ik(z).q])
            np.testing.assert_allclose(np.exp(1j * q), np.exp(1j * expected), atol=1e-9)
            assert 0 < distance <= 1
    far = robot.description.home + 50.0
    assert name in ("3RPR", "6UPS") or float(function(far, geometry)[1]) < 0


def _scaled(entry, factor):
    return replace(entry, value=entry.value * factor) if isinstance(entry, Parameter) else entry


def test_joints_without_closed_form_are_refused_by_leg():
    with pytest.raises(InputError, match="leg 1 has no closed-form inverse kinematics"):
        joint_function(ParallelRobot(prr3()))
