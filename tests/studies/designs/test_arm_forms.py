import casadi as cs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.indices.arms.axes import arm_from_spears, arm_pose, symbolic_pose
from ocptip.indices.arms.distance import INNER, singularity_distance
from ocptip.indices.arms.operation import operation_indices
from ocptip.indices.arms.symbolic import index_expression, index_function, laplace_determinant
from ocptip.indices.arms.values import index_values
from ocptip.indices.metric import OperationEllipsoid
from ocptip.published.arms import arm_by_name, irb_2000
from studies.indices.designs.arm_forms import (
    DesignArm,
    dm_2_constraint,
    dm_inf_constraint,
    heading_constraint,
    inv_cdn_oe_constraint,
    manipulability_constraint,
    pi_oe_constraint,
)
from tests.indices.sample_axes import published_motion, random_axes, random_ellipsoid
from tests.quick import examples, some
from tests.robots.sample_arms import random_arm

seeds = st.integers(0, 2**32 - 1).map(np.random.default_rng)
SPHERE = OperationEllipsoid.sphere(0.1)
QUIET = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False}


def solve(arm, block, start, *, target=None):
    """Joint angles nearest to `target` (default: the start) that satisfy the block, gripper point held."""
    target = start if target is None else target
    tip = symbolic_pose(arm.model, arm.q)[2] - arm_pose(arm.model, target).position
    problem = {
        "x": cs.vertcat(arm.q, block.variables),
        "f": cs.sumsqr(arm.q - target),
        "g": cs.vertcat(tip, block.g),
    }
    solver = cs.nlpsol("nearest", "ipopt", problem, QUIET)
    result = solver(
        x0=np.concatenate([start, block.guess(start)]),
        lbg=np.concatenate([np.zeros(3), block.lower]),
        ubg=np.concatenate([np.zeros(3), block.upper]),
    )
    stats = solver.stats()
    assert stats["success"], stats["return_status"]
    q = np.array(result["x"]).ravel()[: arm.model.n]
    assert arm_pose(arm.model, q).position == pytest.approx(arm_pose(arm.model, target).position, abs=1e-7)
    return q, stats["iter_count"]


@pytest.mark.parametrize("seed", range(3))
def test_determinant_and_gradient_are_those_of_numpy(seed):
    rng = np.random.default_rng(seed)
    arm = DesignArm.of(arm_from_spears("random", random_axes(rng).T, tool_position=rng.normal(size=3)))
    q = rng.uniform(-3, 3, 6)
    expected = singularity_distance(arm_pose(arm.model, q).jacobian)
    assert arm.values(arm.determinant)(q).item() == pytest.approx(expected.determinant, rel=1e-10)
    assert arm.values(arm.gradient)(q).ravel() == pytest.approx(expected.gradient, rel=1e-8, abs=1e-12)
    all_slopes = arm.values(cs.gradient(arm.determinant, arm.q))(q).ravel()
    assert all_slopes[[0, 5]] == pytest.approx([0, 0], abs=1e-10)
    assert arm.sign_at(q) == np.sign(expected.determinant)


def test_determinant_of_any_matrix():
    matrix = cs.SX.sym("m", 6, 6)
    value = np.random.default_rng(0).normal(size=(6, 6))
    result = cs.Function("d", [matrix], [laplace_determinant(matrix)])(value)
    assert float(result) == pytest.approx(np.linalg.det(value))
    with pytest.raises(InputError, match="6 x 6"):
        laplace_determinant(cs.SX.sym("m", 6, 7))


@examples(20)
@given(seeds)
def test_expressions_bound_the_indices(rng):
    model = arm_from_spears("random", random_axes(rng).T, tool_position=rng.normal(size=3))
    q, ellipsoid, arm = rng.uniform(-3, 3, 6), random_ellipsoid(rng), DesignArm.of(model)
    exact = index_values(model, q, ellipsoid=ellipsoid)
    sign = arm.sign_at(q)

    def value(name, p=8):
        return arm.values(index_expression(arm, name, ellipsoid=ellipsoid, sign=sign, p=p))(q).item()

    assert value("manipulability") == pytest.approx(exact["manipulability"], rel=1e-8)
    assert value("dm_2") == pytest.approx(exact["dm_2"], rel=1e-7)
    if exact["inv_cdn_oe"] < 1e-2:  # powers of the matrix need eigenvalues of comparable size
        return
    for p in (2, 4, 8):
        pi_oe, inv_cdn_oe = value("pi_oe", p), value("inv_cdn_oe", p)
        assert 6 ** (-0.5 / p) * exact["pi_oe"] <= pi_oe * (1 + 1e-6)
        assert pi_oe <= exact["pi_oe"] * (1 + 1e-6)
        assert 6 ** (-1 / p) * exact["inv_cdn_oe"] <= inv_cdn_oe * (1 + 1e-6)
        assert inv_cdn_oe <= exact["inv_cdn_oe"] * (1 + 1e-6)


def test_surrogate_on_the_published_pose():
    function = index_function(irb_2000(), "pi_oe", ellipsoid=SPHERE)
    assert float(function(published_motion(0.55))) == pytest.approx(0.111063972617886, abs=1e-12)


@pytest.mark.parametrize("weighted", [False, True])
def test_velocities_and_design_constant(weighted):
    arm = DesignArm.of(heavy_arm(6), weighted=weighted)
    q = np.random.default_rng(1).uniform(-2, 2, 6)
    pose = arm_pose(arm.model, q)
    inertias = pose.inertias if weighted else None
    expected = operation_indices(pose.jacobian, SPHERE, pose.rotation, pose.position, inertias=inertias)
    V = arm.values(arm.velocities(SPHERE))(q)
    assert np.linalg.eigvalsh(V @ V.T)[::-1] == pytest.approx(expected.eigenvalues)
    assert arm.design_constant(SPHERE) == pytest.approx(expected.design_constant)


def heavy_arm(joints):
    """A random arm whose links have proper inertias."""
    import dataclasses

    return dataclasses.replace(random_arm(2, joints), inertias=np.tile(np.eye(3), (joints, 1, 1)))


@pytest.mark.slow
def test_published_constrained_pose():
    """PI_OE >= 0.35 with the tool point held."""
    arm, start = DesignArm.of(irb_2000()), published_motion(0.55)
    found = {}
    for method, most in (("ldl", 30), ("lifted", 150)):
        q, iterations = solve(arm, pi_oe_constraint(arm, SPHERE, 0.35, method=method), start)
        found[method] = q
        assert index_values(arm.model, q, names=["pi_oe"])["pi_oe"] == pytest.approx(0.35, abs=2e-6)
        assert iterations <= most
    assert found["ldl"] == pytest.approx(found["lifted"], abs=1e-4)
    conservative = []
    for p in (1, 4, 8):
        block = pi_oe_constraint(arm, SPHERE, 0.35, method="trace", p=p)
        q, _ = solve(arm, block, published_motion(0.7), target=start)
        conservative.append(index_values(arm.model, q, names=["pi_oe"])["pi_oe"])
    assert conservative[0] > 0.4
    assert conservative[1:] == pytest.approx([0.35, 0.35], abs=2e-4)
    assert min(conservative) > 0.35 - 3e-6


@pytest.mark.parametrize("least", [0.30, 0.35, 0.40])
def test_distance_as_constraint(least):
    arm, start = DesignArm.of(irb_2000()), published_motion(0.55)
    sign = arm.sign_at(start)
    q, iterations = solve(arm, dm_2_constraint(arm, least, sign=sign), start)
    distance = singularity_distance(arm_pose(arm.model, q).jacobian)
    assert distance.dm_2 == pytest.approx(least, abs=1e-6)
    assert np.sign(distance.determinant) == sign
    assert iterations <= 20


def test_smallest_angle_as_constraint():
    arm, start = DesignArm.of(irb_2000()), published_motion(0.55)
    q, iterations = solve(arm, dm_inf_constraint(arm, 0.25, sign=arm.sign_at(start)), start)
    assert singularity_distance(arm_pose(arm.model, q).jacobian).dm_inf == pytest.approx(0.25, abs=1e-6)
    assert iterations <= 25


def place(arm, block, start):
    """Joint angles after the smallest move of the base (x, y, yaw) with which the block holds, gripper fixed.

    None if the optimiser says that this start leads nowhere.
    """
    base = cs.SX.sym("base", 3)
    _, rotation, position = symbolic_pose(arm.model, arm.q)
    c, s = cs.cos(base[2]), cs.sin(base[2])
    yaw = cs.vertcat(cs.horzcat(c, -s, 0), cs.horzcat(s, c, 0), cs.horzcat(0, 0, 1))
    goal = arm_pose(arm.model, start)
    error = goal.rotation.T @ yaw @ rotation
    rows = cs.vertcat(
        cs.vertcat(base[:2], 0) + yaw @ position - goal.position,
        error[2, 1] - error[1, 2],
        error[0, 2] - error[2, 0],
        error[1, 0] - error[0, 1],
    )
    problem = {
        "x": cs.vertcat(arm.q, base, block.variables),
        "f": cs.sumsqr(base) + 1e-3 * cs.sumsqr(arm.q - start),
        "g": cs.vertcat(rows, block.g),
    }
    solver = cs.nlpsol("place", "ipopt", problem, QUIET)
    result = solver(
        x0=np.concatenate([start, np.zeros(3), block.guess(start)]),
        lbg=np.concatenate([np.zeros(6), block.lower]),
        ubg=np.concatenate([np.zeros(6), block.upper]),
    )
    if not solver.stats()["success"]:
        return None
    return np.array(result["x"]).ravel()[: arm.model.n]


@pytest.mark.slow
@pytest.mark.parametrize("name", some(1, ["FP1W2F", "IRB2000", "FSFS", "W1P1P2W2"]))
def test_placement_with_an_index_as_constraint(name):
    arm = DesignArm.of(arm_by_name(name))
    rng, done, solved = np.random.default_rng(0), 0, 0
    while done < 4:
        start = rng.uniform(-1.5, 1.5, 6)
        before = index_values(arm.model, start)
        if not 0.05 < before["pi_oe"] < 0.25 or before["dm_2"] > 0.5:
            continue
        done += 1
        sign = arm.sign_at(start)
        blocks = {
            "pi_oe": lambda least: pi_oe_constraint(arm, SPHERE, least),
            "inv_cdn_oe": lambda least: inv_cdn_oe_constraint(arm, SPHERE, least),
            "dm_2": lambda least, sign=sign: dm_2_constraint(arm, least, sign=sign),
            "dm_inf": lambda least, sign=sign: dm_inf_constraint(arm, least, sign=sign),
            "manipulability": lambda least, sign=sign: manipulability_constraint(arm, least, sign=sign),
        }
        for index, block in blocks.items():
            least = 1.2 * before[index]
            q = place(arm, block(least), start)
            if q is not None:
                solved += 1
                assert index_values(arm.model, q, names=[index])[index] >= least * (1 - 1e-4), index
    assert solved >= 18  # of 20 from single starts; some have no solution nearby


def test_weighted_constraint():
    arm = DesignArm.of(heavy_arm(6), weighted=True)
    rng = np.random.default_rng(3)
    start = rng.uniform(-1, 1, 6)
    before = float(index_values(arm.model, start)["pi_oe_weighted"])
    q, _ = solve(arm, pi_oe_constraint(arm, SPHERE, 1.5 * before), start)
    assert index_values(arm.model, q)["pi_oe_weighted"] == pytest.approx(1.5 * before, rel=1e-3)


def test_seven_axes_with_the_condition_number():
    arm = DesignArm.of(heavy_arm(7))
    start = np.random.default_rng(4).uniform(-1, 1, 7)
    before = float(index_values(arm.model, start)["inv_cdn_oe"])
    q, _ = solve(arm, inv_cdn_oe_constraint(arm, SPHERE, 1.3 * before), start)
    assert index_values(arm.model, q)["inv_cdn_oe"] >= 1.3 * before - 1e-6
    with pytest.raises(InputError, match="six axes, got 7"):
        pi_oe_constraint(arm, SPHERE, 0.1)
    with pytest.raises(InputError, match="six axes"):
        dm_2_constraint(arm, 0.1, sign=1)


@examples(20)
@given(seeds)
def test_heading_constraint_is_the_motion_angle(rng):
    arm = DesignArm.of(irb_2000())
    q, rates, steepest = rng.uniform(-1, 1, 6), rng.normal(size=6), rng.uniform(0.1, 1.4)
    block = heading_constraint(arm, cs.SX(rates), steepest, sign=arm.sign_at(q))
    distance = singularity_distance(arm_pose(arm.model, q).jacobian)
    value = arm.values(block.g)(q).item()
    size = np.linalg.norm(distance.gradient) * np.linalg.norm(rates[INNER]) / arm.volume
    sigma = distance.motion_angle(rates)
    assert value / size == pytest.approx(np.sin(sigma) + np.sin(steepest), abs=1e-9)
    assert (value >= 0) == (sigma >= -steepest)


def test_bad_input_is_refused():
    arm = DesignArm.of(irb_2000())
    with pytest.raises(InputError, match=r"sign: must be 1 or -1"):
        dm_2_constraint(arm, 0.1, sign=0)
    with pytest.raises(InputError, match="at most 1"):
        pi_oe_constraint(arm, SPHERE, 1.5)
    with pytest.raises(InputError, match="least"):
        manipulability_constraint(arm, -0.1, sign=1)
    with pytest.raises(InputError, match="method"):
        pi_oe_constraint(arm, SPHERE, 0.5, method="minors")
    with pytest.raises(InputError, match="no expression 'dm_inf'"):
        index_expression(arm, "dm_inf")
    with pytest.raises(InputError, match="ellipsoid"):
        index_expression(arm, "pi_oe")
    with pytest.raises(InputError, match="steepest"):
        heading_constraint(arm, cs.SX(6, 1), 2.0, sign=1)
    with pytest.raises(InputError, match="singular pose"):
        arm.sign_at(np.zeros(6))
