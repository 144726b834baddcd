"""Base parameters: named tables, equal forces, and the rank of the whole robot."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from ocptip.basics.errors import InputError, SolverError
from ocptip.parallel.code.lean import lean_function
from ocptip.parallel.description.platform import BodyInertia
from ocptip.parallel.description.ready_made import READY_MADE
from ocptip.parallel.description.robot_description import DYNPAR2, MDHRow
from ocptip.parallel.dynamics.base_parameters import (
    leg_base_parameters,
    numeric_base_parameters,
    rank_parameters,
    stacked_regressor,
    transform_inertia,
)
from ocptip.parallel.robot import ParallelRobot
from ocptip.parallel.symbolic.symbols import inertia_layout, inertia_values
from tests.parallel.parallel_cases import KIND_NAMES, error, golden, random_state
from tests.parallel.parallel_examples import five_axes
from tests.parallel.test_dependent_coordinates import robot_of
from tests.quick import some


def tables(p: dict[str, float], l1: float) -> dict[str, dict[str, float]]:
    """The published groupings; p holds the parameters by name, P for the platform."""
    planar = {name: p[name] for name in ("ZZP", "MXP", "MYP", "MP")}
    return {
        "3RRR": {
            "ZZ1": p["ZZ1"] + l1**2 * p["M2"],
            "MX1": p["MX1"] + l1 * p["M2"],
            **{name: p[name] for name in ("MY1", "ZZ2", "MX2", "MY2")},
            **planar,
        },
        "3RPR": {
            "ZZ1": p["ZZ1"] + p["YY2"],
            **{name: p[name] for name in ("MX1", "MY1", "MX2", "MZ2", "M2")},
            **planar,
        },
        "4PRRR": {
            "M1": p["M1"] + p["M2"] + p["M3"],
            "ZZ2": p["ZZ2"] + l1**2 * p["M3"],
            "MX2": p["MX2"] + l1 * p["M3"],
            **{name: p[name] for name in ("MY2", "ZZ3", "MX3", "MY3")},
            **planar,
        },
        "Delta": {
            "ZZ1": p["ZZ1"] + l1**2 * (p["M2"] + p["M3"]),
            "MX1": p["MX1"] + l1 * (p["M2"] + p["M3"]),
            "MY1": p["MY1"],
            "ZZ2": p["ZZ2"] + p["YY3"],
            "MX2": p["MX2"],
            "MY2": p["MY2"] - p["MZ3"],
            "XX3": p["XX3"] - p["YY3"],
            **{name: p[name] for name in ("XY3", "XZ3", "YZ3", "ZZ3", "MX3", "MY3", "MP")},
        },
        "6UPS": {
            "ZZ1": p["ZZ1"] + p["YY2"] + p["ZZ3"],
            "MX1": p["MX1"],
            "MY1": p["MY1"] - p["MZ2"],
            "XX2": p["XX2"] + p["XX3"] - p["YY2"] - p["ZZ3"],
            "XY2": p["XY2"] - p["XZ3"],
            "XZ2": p["XZ2"] + p["XY3"],
            "YZ2": p["YZ2"] - p["YZ3"],
            "ZZ2": p["ZZ2"] + p["YY3"],
            **{name: p[name] for name in ("MX2", "MY2", "MX3", "MY3", "MZ3", "M3")},
            **{f"{name}P": p[f"{name}P"] for name in DYNPAR2},
        },
    }


@pytest.mark.parametrize("kind", some(2, KIND_NAMES))
def test_leg_rules_give_the_published_tables(kind):
    robot = golden(kind).robot
    names = inertia_layout(robot).names()
    p = dict(zip(names, inertia_values(robot), strict=True))
    expected = tables({**dict.fromkeys(names, 0.0), **{f"{n}3": 0.0 for n in DYNPAR2}, **p}, _l1(robot))[kind]
    found = leg_base_parameters(robot)
    assert list(found.names) == list(expected)
    assert found.values == pytest.approx(np.array(list(expected.values())), rel=1e-12, abs=1e-12)


def embedded(base, parameters: np.ndarray) -> np.ndarray:
    """The full vector (p_base, 0), which has the same motor forces."""
    full = np.zeros(base.size)
    full[list(base.independent)] = base.values(parameters)
    return full


def _l1(robot) -> float:
    return robot.parameters.get("l1", 0.0)


@pytest.mark.parametrize("kind", some(2, KIND_NAMES))
def test_grouped_vector_has_the_same_forces(kind):
    case = golden(kind)
    lean = lean_function(case.robot, form="X")
    base = leg_base_parameters(case.robot)
    found = lean(case.z, case.zd, case.zdd, case.q, inertia=base.full)["tau"]
    assert error(found, case.expected["tau_s"]) < 1e-9
    assert np.count_nonzero(base.full) < np.count_nonzero(lean.inertia)


def test_transformed_inertia_keeps_the_energy():
    """A body moved to another frame has the same kinetic energy there."""
    rng = np.random.default_rng(3)
    row = MDHRow(gamma=0.4, b=0.3, alpha=1.1, d=0.5, theta=-0.7, r=0.2)
    p = rng.uniform(-1, 1, 10)
    moved = transform_inertia(row) @ p
    ends = (
        transform_inertia(MDHRow(gamma=0.4))
        @ transform_inertia(MDHRow(b=0.3))
        @ transform_inertia(MDHRow(alpha=1.1))
        @ transform_inertia(MDHRow(d=0.5))
        @ transform_inertia(MDHRow(theta=-0.7))
        @ transform_inertia(MDHRow(r=0.2))
    )
    assert moved == pytest.approx(ends @ p, abs=1e-12)
    shifted = transform_inertia(MDHRow(d=0.5)) @ p
    assert shifted[9] == p[9]
    assert shifted[6] == pytest.approx(p[6] + 0.5 * p[9])
    assert shifted[5] == pytest.approx(p[5] + 2 * 0.5 * p[6] + 0.25 * p[9])


@pytest.mark.parametrize(
    ("kind", "random_rank", "design_rank"),
    some(1, [("3RRR", 9, 9), ("4PRRR", 10, 8), ("Delta", 13, 13), ("3RPR", 9, 9), ("6UPS", 23, 21)]),
)
def test_rank_of_the_whole_robot(kind, random_rank, design_rank):
    design = numeric_base_parameters(READY_MADE[kind]())
    assert design.rank == design_rank
    assert design.gap > 8
    assert design.residual < 1e-10
    state = random_state(kind, 1)
    found = numeric_base_parameters(state.robot, spread=0.15)
    assert found.rank == random_rank
    lean = lean_function(state.robot, form="S")
    p = lean.inertia
    expected = lean(state.z, state.s, state.sd, state.q)["tau"]
    tau = lean(state.z, state.s, state.sd, state.q, inertia=embedded(found, p))["tau"]
    assert error(tau, expected) < 1e-8
    assert len(found.values(p)) == random_rank


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "seed", "rank"), some(1, [("Delta", 0, 13), ("4PRRR", 0, 10), ("6UPS", 2, 23)])
)
def test_default_spread_suits_robots_with_a_small_workspace(kind, seed, rank):
    robot = random_state(kind, seed).robot
    found = numeric_base_parameters(robot)
    assert (found.rank, found.gap > 8, found.residual < 1e-10) == (rank, True, True)


@pytest.mark.slow
def test_platform_parameters_are_kept_before_those_of_the_legs():
    layout = inertia_layout(READY_MADE["6UPS"]())
    found = numeric_base_parameters(READY_MADE["6UPS"]())
    names = [layout.names()[k] for k in found.independent]
    assert {"MP", "MXP", "MYP", "MZP"} <= set(names)
    assert "M3" not in names


def test_bad_regressors():
    robot = READY_MADE["3RRR"]()
    layout, p = inertia_layout(robot), inertia_values(robot)
    with pytest.raises(InputError, match="needs at least 30 rows"):
        rank_parameters(np.ones((5, 30)), p, layout)
    with pytest.raises(InputError, match="regressor: expected shape"):
        rank_parameters(np.ones((50, 29)), p, layout)
    with pytest.raises(SolverError, match="reduce the spread"):
        stacked_regressor(robot, spread=50.0)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "rank"), some(1, [("Delta", 13), ("3RRR", 9), ("6UPS", 21)]))
def test_functions_with_the_base_parameters_of_the_whole_robot(kind, rank):
    """DynPar 3 of the whole robot: tau, W and the function that makes it from DynPar 2."""
    robot = READY_MADE[kind]()
    base = numeric_base_parameters(robot)
    lean = lean_function(robot, ("tau", "W"), form="A", dynpar=3, base=base)
    assert len(lean.inertia) == base.rank == rank
    assert lean.inertia_names == base.names
    made = np.array(base.function()(inertia_values(robot))).ravel()
    np.testing.assert_allclose(made, lean.inertia, atol=1e-14)
    rng, kinematics = np.random.default_rng(4), ParallelRobot(robot)
    z = robot.home + 0.05 * rng.uniform(-1, 1, kinematics.m)
    s, sd = rng.uniform(-1, 1, (2, kinematics.m))
    q = kinematics.kinematics.point_joints(z).q
    found = lean(z, s, sd, np.column_stack(q))
    expected = kinematics.inverse_dynamics(z, s, sd, q, rates="quasi").motors
    np.testing.assert_allclose(found["tau"], expected, atol=1e-8 * np.abs(expected).max())
    np.testing.assert_allclose(found["W"] @ made, expected, atol=1e-8 * np.abs(expected).max())
    with pytest.raises(InputError, match="base: expected the base parameters of"):
        lean_function(robot, form="A", base=base)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "make"),
    some(
        1,
        [("five_bar", None), ("rps3", None), ("3T2R", lambda: five_axes(coupling_mass=True)), ("sps6", None)],
    ),
)
def test_base_parameters_of_any_robot(name, make):
    """Forces of the reduced vector, by the numeric robot; the rank is that of regressors at other poses."""
    description = robot_of(name).description if make is None else make()
    base = numeric_base_parameters(description, spread=0.1)
    assert base.gap > 3
    assert base.residual < 1e-9
    robot, rng = ParallelRobot(description), np.random.default_rng(8)
    layout = inertia_layout(description, complete=True)
    assert base.size == layout.size
    full = embedded(base, inertia_values(description, complete=True))
    legs = []
    for i, leg in enumerate(description.legs):
        own = full[layout.leg_slice(i)].reshape(-1, 10)[: len(leg.bodies)]
        legs.append(dataclasses.replace(leg, bodies=tuple(map(BodyInertia.from_vector, own))))
    platform = dataclasses.replace(
        description.platform, inertia=BodyInertia.from_vector(full[layout.platform_slice])
    )
    reduced = ParallelRobot(dataclasses.replace(description, legs=tuple(legs), platform=platform))
    for _ in range(3):
        z = description.home + 0.03 * rng.uniform(-1, 1, robot.m)
        zd, zdd = rng.uniform(-1, 1, (2, robot.m))
        expected = robot.inverse_dynamics(z, zd, zdd).motors
        np.testing.assert_allclose(
            reduced.inverse_dynamics(z, zd, zdd).motors, expected, atol=1e-6 * np.abs(expected).max()
        )
