"""Sensitivities against differences with the inverse kinematics solved anew."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.optimize import root

from ocptip.basics.errors import InputError
from ocptip.parallel.code.lean import lean_function
from ocptip.parallel.description.platform import Parameter
from studies.parallel.sensitivities import ForceSensitivities
from tests.parallel.parallel_cases import KIND_NAMES, chain_end, error, random_state
from tests.quick import some


def changed(robot, name: str, step: float):
    """The robot with one named parameter changed."""

    def moved(entry):
        named = isinstance(entry, Parameter) and entry.name == name
        return Parameter(name, entry.value + step) if named else entry

    legs = []
    for leg in robot.legs:
        rows = tuple(
            dataclasses.replace(
                row, **{k: moved(getattr(row, k)) for k in ("gamma", "b", "alpha", "d", "theta", "r")}
            )
            for row in leg.rows
        )
        legs.append(
            dataclasses.replace(
                leg,
                rows=rows,
                base_rotation=tuple((axis, moved(angle)) for axis, angle in leg.base_rotation),
                base_position=tuple(moved(e) for e in leg.base_position),
                coupling=tuple(moved(e) for e in leg.coupling),
            )
        )
    return dataclasses.replace(robot, legs=tuple(legs))


def closed(robot, state) -> np.ndarray:
    """(n, N) joint variables that close the position loops of a changed robot, from those of the state."""
    r, R = state.kinematics.pose(state.z)
    axes = list(robot.position_rows)
    columns = []
    for leg, start in zip(robot.legs, state.q.T, strict=True):
        target = r + R @ leg.coupling_point - leg.origin
        rows = leg.rows[: leg.n + 1]

        def gap(q, leg=leg, rows=rows, target=target):
            return (leg.base_matrix @ chain_end(rows, q) - target)[axes]

        columns.append(root(gap, start, tol=1e-13).x)
        assert np.abs(gap(columns[-1])).max() < 1e-11
    return np.column_stack(columns)


@pytest.mark.slow
@pytest.mark.parametrize("kind", some(1, KIND_NAMES))
def test_geometry(kind):
    state = random_state(kind, 2)
    generated = ForceSensitivities(state.robot)
    found = generated(state.z, state.s, state.sd, state.q)
    lean = lean_function(state.robot, form="A")
    assert error(found.forces, lean(state.z, state.s, state.sd, state.q)["tau"]) < 1e-10
    h = 1e-5
    chosen = [name for name in found.geometry_names if name[-2:] not in ("_z",)][
        :: max(1, len(found.geometry_names) // 8)
    ]
    for name in chosen:
        forces, joints = [], []
        for step in (h, -h):
            robot = changed(state.robot, name, step)
            q = closed(robot, state)
            geometry = np.array(list(robot.parameters.values()))
            forces.append(lean(state.z, state.s, state.sd, q, geometry=geometry)["tau"])
            joints.append(q.ravel("F"))
        column = found.geometry_names.index(name)
        scale = max(1.0, np.abs(found.geometry).max())
        assert found.geometry[:, column] == pytest.approx((forces[0] - forces[1]) / (2 * h), abs=1e-5 * scale)
        assert found.joints[:, column] == pytest.approx((joints[0] - joints[1]) / (2 * h), abs=1e-5)


@pytest.mark.slow
def test_inertia_derivatives_are_the_regressor():
    state = random_state("Delta", 3)
    found = ForceSensitivities(state.robot)(state.z, state.s, state.sd, state.q)
    lean = lean_function(state.robot, ("W",), form="A")
    assert error(found.inertia, lean(state.z, state.s, state.sd, state.q)["W"]) < 1e-10
    assert found.inertia_names == lean.inertia_names
    plain = ForceSensitivities(state.robot, motor_forces=False)(state.z, state.s, state.sd, state.q)
    tau_s = lean_function(state.robot, form="S")(state.z, state.s, state.sd, state.q)["tau"]
    assert error(plain.forces, tau_s) < 1e-10
    assert set(plain.to_dict()["inertia"]) == set(lean.inertia_names)


def test_open_legs_are_refused():
    state = random_state("3RRR", 1)
    generated = ForceSensitivities(state.robot)
    with pytest.raises(InputError, match="legs miss the platform's coupling points"):
        generated(state.z, state.s, state.sd, state.q + 0.1)
    with pytest.raises(InputError, match="sd: expected shape 3"):
        generated(state.z, state.s[:2], state.sd, state.q)
