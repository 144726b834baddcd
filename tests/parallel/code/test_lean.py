"""The lean functions against golden numbers, four other routes, and identities of mechanics."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError, SolverError
from ocptip.parallel.code.lean import lean_function
from ocptip.parallel.description.platform import CONVENTIONS, Parameter
from ocptip.parallel.description.ready_made import rrr3, ups6
from ocptip.parallel.description.robot_description import MDHRow
from ocptip.parallel.dynamics.terms import quasi_terms
from ocptip.parallel.robot import ParallelRobot
from tests.oracles.parallel_routes.constraint import ConstraintRoute
from tests.oracles.parallel_routes.forces import ROUTES, forces_by
from tests.parallel.parallel_cases import KIND_NAMES, error, golden, random_state
from tests.quick import examples, some

GOLDEN = 1e-9
SAME = 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("kind", some(1, KIND_NAMES))
def test_golden_case(kind):
    case = golden(kind)
    lean = lean_function(case.robot, ("tau", "M", "c", "g", "J_a"), form="X")
    found = lean(case.z, case.zd, case.zdd, case.q)
    for ours, theirs in (("tau", "tau_s"), ("M", "M"), ("c", "c"), ("g", "g"), ("J_a", "J_a")):
        assert error(found[ours], case.expected[theirs]) < GOLDEN, ours
    for dynpar in (1, 2, 3):
        motors = lean_function(case.robot, form="A", euler=True, dynpar=dynpar)
        assert error(motors(case.z, case.zd, case.zdd, case.q)["tau"], case.expected["tau_a"]) < GOLDEN


@pytest.mark.parametrize("kind", some(2, KIND_NAMES))
@pytest.mark.parametrize("seed", [1, *(pytest.param(k, marks=pytest.mark.slow) for k in range(2, 6))])
def test_all_routes_agree_on_random_robots(kind, seed):
    state = random_state(kind, seed)
    robot = ParallelRobot(state.robot)
    joints = robot.ik(state.z).q
    q = np.column_stack([leg[: len(state.q)] for leg in joints])
    found = lean_function(state.robot, ("tau", "J_a"), form="A")(state.z, state.s, state.sd, q)
    rates = state.z, state.s, state.sd, joints
    assert error(found["tau"], robot.inverse_dynamics(*rates, rates="quasi").motors) < SAME
    for route in ROUTES:
        assert error(found["tau"], forces_by(route, robot, *rates, rates="quasi").motors) < SAME, route
    assert error(found["J_a"], robot.jacobian(state.z, joints)) < SAME


SLOW_KINDS = [pytest.param(kind, marks=pytest.mark.slow) for kind in ("3RRR", "Delta", "4PRRR")]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["3RPR", pytest.param("6UPS", marks=pytest.mark.slow), *SLOW_KINDS])
def test_five_forms_are_one_equation(kind):
    state = random_state(kind, 5)
    kinematics, z, s, q = state.kinematics, state.z, state.s, state.q
    H = kinematics.rate_matrices(z, s)[0]
    zd = np.linalg.solve(H, s)
    H, D = kinematics.rate_matrices(z, zd)
    zdd = np.linalg.solve(H, state.sd - D @ zd)
    parts = ("tau", "M", "c", "g", "J_a", "qdd")
    S = lean_function(state.robot, parts, form="S")(z, s, state.sd, q)
    motors = state.robot.actuated
    driven = np.array([S["qdd"][joint, leg] for leg, joint in motors])
    inverse = np.linalg.inv(S["J_a"])
    inputs = {"X": (zd, zdd), "Z": (zd, zdd), "A": (s, state.sd), "AA": (zd, driven)}
    expected_force = {
        "X": S["tau"],
        "Z": H.T @ S["tau"],
        "A": inverse.T @ S["tau"],
        "AA": inverse.T @ S["tau"],
    }
    expected_mass = {
        "X": S["M"] @ H,
        "Z": H.T @ S["M"] @ H,
        "A": inverse.T @ S["M"],
        "AA": inverse.T @ S["M"] @ inverse,
    }
    results = {}
    for form, (rates, accelerations) in inputs.items():
        results[form] = found = lean_function(state.robot, ("tau", "M", "c", "g"), form=form)(
            z, rates, accelerations, q
        )
        assert error(found["tau"], expected_force[form]) < SAME, form
        assert error(found["M"], expected_mass[form]) < SAME, form
        assert error(found["M"] @ accelerations + found["c"] + found["g"], found["tau"]) < SAME, form
    other, _ = ConstraintRoute(kinematics, complete=False).terms(z, zd, state.joints, state.robot.gravity)
    for name in ("M", "c", "g"):
        assert error(results["Z"][name], getattr(other, name)) < SAME, name
    assert np.linalg.eigvalsh(S["M"])[0] > 0


@pytest.mark.parametrize("convention", some(1, CONVENTIONS))
def test_conventions(convention):
    state = random_state("6UPS", 3, convention)
    motion = state.kinematics.motion(state.z, state.s, state.joints, complete=False)
    H = state.kinematics.rate_matrices(state.z, state.s)[0]
    zd = np.linalg.solve(H, state.s)
    H, D = state.kinematics.rate_matrices(state.z, zd)
    zdd = np.linalg.solve(H, state.sd - D @ zd)
    expected = quasi_terms(state.kinematics, motion, state.robot.gravity).force(state.sd)
    lean = lean_function(state.robot, form="X")
    assert error(lean(state.z, zd, zdd, state.q)["tau"], expected) < SAME
    assert lean.count.weighted == pytest.approx(2401, rel=0.01)


@pytest.mark.slow
@examples(8)
@given(seed=st.integers(0, 10**6))
def test_power_balance(seed):
    """Power of the motors equals the change of energy, by differences along a motion."""
    case = golden("3RRR")
    lean, robot = _power_functions()
    rng = np.random.default_rng(seed)
    z, s, sd = case.z, rng.uniform(-1, 1, 3), rng.uniform(-2, 2, 3)
    found = lean(z, s, sd, case.q)
    power = sum(
        found["tau"][k] * found["qd"][joint, leg] for k, (leg, joint) in enumerate(case.robot.actuated)
    )
    h = 1e-5

    def energy(t: float) -> float:
        pose = z + s * t + sd * t * t / 2
        start = [column + found["qd"][:, i] * t for i, column in enumerate(case.q.T)]
        joints = robot.kinematics.point_joints(pose, start).q
        return sum(robot.energy(pose, s + sd * t, joints))

    change = (energy(h) - energy(-h)) / (2 * h)
    scale = sum(abs(found["tau"][k] * found["qd"][j, i]) for k, (i, j) in enumerate(case.robot.actuated))
    assert change == pytest.approx(power, abs=1e-6 * max(scale, 1.0))


@cache
def _power_functions():
    robot = golden("3RRR").robot
    return lean_function(robot, ("tau", "M", "qd"), form="A"), ParallelRobot(robot)


@pytest.mark.slow
@pytest.mark.parametrize("kind", some(1, ["3RPR", "6UPS", "4PRRR"]))
def test_drives_friction_and_external_wrench(kind):
    state = random_state(kind, 7)
    rng = np.random.default_rng(11)
    n, count = state.q.shape
    legs = tuple(
        dataclasses.replace(
            leg,
            drive_inertia=tuple(rng.uniform(0, 1, n)),
            viscous=tuple(rng.uniform(0, 1, n)),
            coulomb=tuple(rng.uniform(0, 1, n)),
        )
        for leg in state.robot.legs
    )
    robot = dataclasses.replace(state.robot, legs=legs)
    wrench = rng.uniform(-5, 5, 6)
    without = lean_function(robot, ("tau", "qd", "qdd"), form="S", joint_terms=False)
    plain = without(state.z, state.s, state.sd, state.q)
    lean = lean_function(robot, ("tau", "M", "c", "g", "W_joint"), form="S", wrench=True)
    found = lean(state.z, state.s, state.sd, state.q, wrench=wrench)
    terms, qd, qdd = lean.joint_terms, plain["qd"].ravel("F"), plain["qdd"].ravel("F")
    efforts = terms[0] * qdd + terms[1] * qd + terms[2] * np.sign(qd)
    every = dataclasses.replace(robot, actuated=tuple((leg, j) for leg in range(count) for j in range(n)))
    rows = lean_function(every, ("J_a",), form="S")(state.z, state.s, state.sd, state.q)["J_a"]
    external = state.kinematics.motion(state.z, state.s, state.joints, complete=False).T.T @ wrench
    assert error(found["tau"], plain["tau"] + rows.T @ efforts - external) < SAME
    assert error(found["M"] @ state.sd + found["c"] + found["g"], found["tau"]) < SAME
    assert error(found["W_joint"] @ terms.ravel("F"), rows.T @ efforts) < SAME


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "dynpar"), some(1, [("Delta", 2), ("4PRRR", 3), ("3RPR", 2), ("6UPS", 3)]))
def test_regressor(kind, dynpar):
    state = random_state(kind, 9)
    names = ("tau", "M", "c", "g", "W", "W_M", "W_c", "W_g")
    lean = lean_function(state.robot, names, form="S", dynpar=dynpar)
    p = np.random.default_rng(1).uniform(-1, 1, len(lean.inertia))
    found = lean(state.z, state.s, state.sd, state.q, inertia=p)
    assert error(found["W"] @ p, found["tau"]) < SAME
    assert error(found["W_M"] @ p, found["M"] @ state.sd) < SAME
    assert error(found["W_c"] @ p, found["c"]) < SAME
    assert error(found["W_g"] @ p, found["g"]) < SAME
    motors = lean_function(state.robot, ("tau", "W"), form="A", dynpar=dynpar)
    driven = motors(state.z, state.s, state.sd, state.q, inertia=p)
    assert error(driven["W"] @ p, driven["tau"]) < SAME


def test_joint_rates_follow_the_closure():
    state = random_state("6UPS", 2)
    found = lean_function(state.robot, ("qd", "qdd"), form="S")(state.z, state.s, state.sd, state.q)
    motion = state.kinematics.motion(state.z, state.s, state.joints, complete=False)
    for i, leg in enumerate(motion.legs):
        assert error(found["qd"][:, i], leg.qd) < SAME
        assert error(found["qdd"][:, i], leg.Jq @ state.sd + leg.drift) < SAME


@pytest.mark.slow
def test_legs_of_different_kind_and_own_bodies():
    """A 3RRR whose third leg is longer, heavier and mounted by a numeric angle."""
    state = random_state("3RRR", 4)
    legs = list(state.robot.legs)
    heavy = tuple(dataclasses.replace(body, mass=2 * body.mass) for body in legs[2].bodies)
    rows = (MDHRow(), MDHRow(d=Parameter("a3", 0.9)), MDHRow(d=Parameter("b3", 0.8)))
    legs[2] = dataclasses.replace(legs[2], rows=rows, bodies=heavy, base_rotation=(("z", 0.3),))
    robot = dataclasses.replace(state.robot, legs=tuple(legs))
    assert ParallelRobot(robot).mobility().consistent
    kinematics = ParallelRobot(robot).kinematics
    joints = kinematics.point_joints(state.z).q
    lean = lean_function(robot, ("tau", "M", "c", "g"), form="S")
    assert len(lean.inertia) == 50
    assert lean.inertia_names[0] == "leg1_XX1"
    found = lean(state.z, state.s, state.sd, np.column_stack(joints))
    expected = quasi_terms(
        kinematics, kinematics.motion(state.z, state.s, joints, complete=False), robot.gravity
    )
    for name in ("M", "c", "g"):
        assert error(found[name], getattr(expected, name)) < SAME
    numeric = lean_function(robot, form="S", numeric_geometry=True)
    assert numeric.geometry_names == ()
    assert error(numeric(state.z, state.s, state.sd, np.column_stack(joints))["tau"], found["tau"]) < SAME


def test_other_parameters_at_call_time():
    case = golden("3RPR")
    lean = lean_function(case.robot, form="X")
    doubled = lean(case.z, case.zd, case.zdd, case.q, inertia=2 * lean.inertia)["tau"]
    assert error(doubled, 2 * case.expected["tau_s"]) < GOLDEN
    weightless = lean(case.z, 0 * case.zd, 0 * case.zdd, case.q, gravity=np.zeros(3))["tau"]
    assert np.abs(weightless).max() == 0.0


@pytest.mark.slow
def test_motors_at_several_joints_of_a_leg():
    """Two motors on leg 1, none on leg 2: the motor forces still solve J_a^T tau_a = tau_s."""
    state = random_state("3RRR", 6)
    robot = dataclasses.replace(state.robot, actuated=((0, 0), (2, 0), (0, 1)))
    found = lean_function(robot, ("tau", "J_a"), form="A")(state.z, state.s, state.sd, state.q)
    tau_s = lean_function(robot, form="S")(state.z, state.s, state.sd, state.q)["tau"]
    assert error(found["J_a"].T @ found["tau"], tau_s) < SAME


def test_fast_callable_is_the_same_function():
    state = random_state("6UPS", 1)
    lean = lean_function(state.robot, ("tau", "J_a"), form="A")
    fast = lean.fast()
    fast(0.5 * state.z, state.s, state.sd, state.q)
    expected = lean(state.z, state.s, state.sd, state.q)
    tau, jacobian = fast(state.z, state.s, state.sd, state.q)
    assert np.array_equal(tau, expected["tau"])
    assert np.array_equal(jacobian, expected["J_a"])


def test_singular_pose_is_an_error():
    """Coupling point on the first joint's axis: the direction of a leg without length is not defined."""
    case = golden("3RPR")
    lean = lean_function(case.robot)
    q = case.q.copy()
    q[1, 0] = 0.0
    with pytest.raises(SolverError, match="tau: not finite"):
        lean(case.z, case.zd, case.zdd, q)


def test_stretched_leg_has_unbounded_motor_rates():
    """A leg in its type I singularity (stretched) makes motor rates unbounded, but not the lever arm."""
    case = golden("3RRR")
    lean = lean_function(case.robot, ("J_a",), form="S")
    stretched = case.q.copy()
    stretched[1, 0] = 1e-6
    assert np.abs(lean(case.z, case.zd, case.zdd, stretched)["J_a"][0]).max() > 1e5


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"outputs": ("tau", "mass")}, "outputs: expected names"),
        ({"outputs": "tau"}, "outputs: expected names"),
        ({"outputs": ("tau", "tau")}, "a name occurs twice"),
        ({"form": "B"}, "form: must be one of"),
        ({"dynpar": 4}, "dynpar: must be"),
        ({"outputs": ("W",), "dynpar": 1}, "not linear in DynPar 1"),
        ({"outputs": ("W_joint",)}, "needs joint_terms"),
        ({"form": "S", "euler": True}, "only form A"),
    ],
)
def test_bad_options(options, message):
    with pytest.raises(InputError, match=message):
        lean_function(rrr3(), **options)


def test_bad_arguments():
    case = golden("3RRR")
    lean = lean_function(case.robot)
    with pytest.raises(InputError, match=r"q: expected shape 2 x 3, got 3 x 2"):
        lean(case.z, case.zd, case.zdd, case.q.T)
    with pytest.raises(InputError, match="zdd: contains NaN"):
        lean(case.z, case.zd, case.zdd * np.nan, case.q)
    with pytest.raises(InputError, match="wrench: this function was generated without it"):
        lean(case.z, case.zd, case.zdd, case.q, wrench=np.zeros(6))


def test_robots_outside_the_formulation():
    redundant = dataclasses.replace(rrr3(), actuated=((0, 0), (1, 0), (2, 0), (0, 1)))
    with pytest.raises(InputError, match="4 motors for 3 free coordinates"):
        lean_function(redundant, form="A")
    with pytest.raises(InputError, match="form AA needs as many motors"):
        lean_function(redundant, form="AA")
    assert lean_function(redundant, ("J_a",), form="S")(
        np.zeros(3), np.zeros(3), np.zeros(3), np.full((2, 3), 0.5)
    )["J_a"].shape == (4, 3)
    motor_behind = dataclasses.replace(ups6(), actuated=((0, 2), (1, 2), (2, 2), (3, 2), (4, 2), (5, 3)))
    with pytest.raises(InputError, match="lean formulation needs legs of 3 joints"):
        lean_function(motor_behind)
    tilted = rrr3()
    legs = tuple(
        dataclasses.replace(leg, base_rotation=(("x", Parameter("tilt", 0.0)), *leg.base_rotation))
        for leg in tilted.legs
    )
    with pytest.raises(InputError, match="multiples of pi/2"):
        lean_function(dataclasses.replace(tilted, legs=legs))
