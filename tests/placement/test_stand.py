"""Feet on uneven ground: poses, normals, strokes against independent solutions."""

import casadi as cs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.numerics.batch import PointFunction
from ocptip.placement.ground import Bump, HeightField, HeightGrid, Wave
from ocptip.placement.problem import PlacementProblem
from ocptip.placement.terrain import plane, rough_ground
from ocptip.published.arms import load_arm, modular_motors
from ocptip.standing.arm import Robot
from tests.placement.placement_scenes import clamped, drilling, four_feet, on_uneven_ground, tripod
from tests.quick import examples

LINES = np.linspace(-3, 3, 13)
FIELD = HeightField(
    Bump([0.3, 0.2], 0.08, 0.3),
    Wave(0.03, 0.9, 0.4),
    HeightGrid(
        np.linspace(-3, 3, 13), np.linspace(-3, 3, 13), 0.02 * np.random.default_rng(0).normal(size=(13, 13))
    ),
    height=0.02,
    slope=[0.02, 0.03],
)
MODES = {
    "tripod": (tripod, {}),
    "tripod on legs": (tripod, {"stroke": [0.0, 0.2], "attitude": "level"}),
    "four legs": (four_feet, {"stroke": [0.0, 0.2]}),
    "four level legs": (four_feet, {"stroke": [0.0, 0.2], "attitude": "level"}),
}


def stand(mode, field=FIELD):
    robot, options = MODES[mode]
    return drilling(robot(), terrain=rough_ground(field, **options)).stands[0]


def places(own, count, seed=1):
    parameters = np.random.default_rng(seed).uniform(-1, 1, (count, own.patch.size))
    parameters[:, 3:] = 0.1
    return parameters


@pytest.mark.parametrize("mode", MODES)
def test_feet_are_on_the_ground_with_its_normals(mode):
    own = stand(mode)
    stood = own.at(places(own, 200))
    assert stood.missed.max() < 1e-12
    world = stood.origin[:, None] + stood.contacts @ stood.base.transpose(0, 2, 1)
    heights = FIELD.slopes(world[:, :, :2].reshape(-1, 2)).reshape(*world.shape[:2], 3)
    assert world[:, :, 2] == pytest.approx(heights[:, :, 0], abs=1e-12)
    normals = np.concatenate([-heights[:, :, 1:], np.ones((*world.shape[:2], 1))], axis=2)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    turned = np.einsum("nij,nkj->nki", stood.base, stood.frames[:, :, :, 0])
    assert turned == pytest.approx(normals, abs=1e-12)
    assert stood.frames.transpose(0, 1, 3, 2) @ stood.frames == pytest.approx(
        np.broadcast_to(np.eye(3), stood.frames.shape), abs=1e-12
    )
    nominal = np.array([c.position for c in own.feet.usual.support.contacts])
    moved = nominal - stood.contacts
    assert moved[:, :, :2] == pytest.approx(0.0, abs=1e-12)
    if stood.strokes.size:
        assert moved[:, :, 2] == pytest.approx(stood.strokes)
        assert stood.strokes.mean(axis=1) == pytest.approx(0.1)
        if "level" in mode or "on legs" in mode:
            assert stood.base[:, :, 2] == pytest.approx(np.tile([0, 0, 1.0], (200, 1)), abs=1e-12)
        else:  # no other slope of the base has a smaller sum of squared strokes
            across = np.column_stack([nominal[:, :2] - nominal[:, :2].mean(axis=0), np.ones(len(nominal))])
            assert (stood.strokes - 0.1) @ across == pytest.approx(0.0, abs=1e-12)
    else:
        assert moved == pytest.approx(0.0, abs=1e-12)


@examples(20)
@given(x=st.floats(-1, 1), y=st.floats(-1, 1), angle=st.floats(-3, 3))
def test_a_tripod_stands_where_a_general_solver_puts_it(x, y, angle):
    own = stand("tripod")
    stood = own.at(np.array([[x, y, angle]]))
    feet = np.array([c.position for c in tripod().support.contacts]) + np.array([0, 0, 0.3])

    def turn(u):
        normal = np.array([-u[1], -u[2], 1.0])
        first = np.array([1.0, 0.0, u[1]])
        normal, first = normal / np.linalg.norm(normal), first / np.linalg.norm(first)
        upright = np.column_stack([first, np.cross(normal, first), normal])
        return Rotation.from_rotvec(angle * normal).as_matrix() @ upright

    def above(u):
        world = [x, y, u[0]] + feet @ turn(u).T
        return world[:, 2] - FIELD.heights(world[:, :2])

    u = fsolve(above, [0.0, 0.0, 0.0], xtol=1e-13)
    assert stood.base[0] == pytest.approx(turn(u), abs=1e-9)
    assert stood.origin[0] == pytest.approx([x, y, u[0]] + turn(u) @ [0, 0, 0.3], abs=1e-9)


@pytest.mark.parametrize("mode", MODES)
def test_expressions_have_exact_values_and_derivatives(mode):
    own = stand(mode)
    p = cs.SX.sym("p", own.patch.size)
    values = cs.vertcat(*(cs.vec(part) for part in own.expressions(p)))
    slopes = cs.jacobian(values, p)
    function = PointFunction(
        cs.Function("f", [p, *own.given], [values, slopes, cs.jacobian(cs.vec(slopes), p)])
    )

    def direct(at):
        stood = own.at(at[None])
        frames = np.concatenate([frame.ravel(order="F") for frame in stood.frames[0]])
        parts = stood.origin[0], stood.base[0].ravel(order="F"), stood.contacts[0].ravel(), frames
        return np.concatenate([*parts, stood.strokes[0] if stood.strokes.size else np.zeros(3)])

    at, steps = places(own, 1, 5)[0], 1e-5 * np.eye(own.patch.size)
    found, slope, bend = function(at, *own.local(at))
    assert found == pytest.approx(direct(at), abs=1e-12)
    numeric = np.array([(direct(at + s) - direct(at - s)) / 2e-5 for s in steps]).T
    assert slope == pytest.approx(numeric, abs=1e-7)
    ends = [[function(at + sign * s, *own.local(at + sign * s))[1] for sign in (1, -1)] for s in steps]
    numeric = np.array([(after - before) / 2e-5 for after, before in ends])
    bend = bend.reshape(own.patch.size, len(found), own.patch.size)
    assert bend.transpose(2, 1, 0) == pytest.approx(numeric, abs=1e-4)


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.15, -0.08)])
def test_an_inclined_field_is_a_plane(slope):
    even = drilling(tripod(), terrain=plane(slope, 0.3)).stands[0]
    for options in ({}, {"stroke": [0.0, 0.2]}):
        own = drilling(
            tripod(), terrain=rough_ground(HeightField(height=0.3, slope=slope), **options)
        ).stands[0]
        parameters = places(own, 50)
        parameters[:, 3:] = 0.0
        a, b = own.at(parameters), even.at(parameters[:, :3])
        for name in ("origin", "base", "contacts", "frames"):
            assert getattr(a, name) == pytest.approx(getattr(b, name), abs=1e-12), name
        ground, turn = own.ground(parameters)
        assert ground == pytest.approx(even.ground(parameters[:, :3])[0], abs=1e-12)
        assert turn == pytest.approx(even.ground(parameters[:, :3])[1], abs=1e-12)


def test_ground_on_which_no_plane_can_stand_is_said_to_be_missed():
    spikes = HeightField(Wave(3.0, 0.3, 0.4))
    own = stand("tripod", spikes)
    stood = own.at(places(own, 50))
    on = stood.missed < 1e-7
    world = stood.origin[:, None] + stood.contacts @ stood.base.transpose(0, 2, 1)
    gaps = world[:, :, 2] - spikes.heights(world[:, :, :2].reshape(-1, 2)).reshape(world.shape[:2])
    assert np.abs(gaps[on]).max(initial=0.0) < 1e-7
    assert (np.abs(gaps[~on]).max(axis=1) > 1e-9).all()


def in_line():
    feet = [UnilateralContact(position=[0.1 * k, 0.0, -0.3], friction=0.5) for k in range(3)]
    support = Support(feet, mass=15.0)
    return Robot(load_arm("FP1W2F"), support, modular_motors(), reference_moment=1.0)


@pytest.mark.parametrize(
    ("robot", "options", "message"),
    [
        (four_feet, {}, "4 feet need legs"),
        (clamped, {}, "needs ordinary contacts, contact 3 is 'force-constant-half-rigid-clamp'"),
        (on_uneven_ground, {}, "contact 1 has a normal; normals follow"),
        (in_line, {}, "not on one line"),
    ],
)
def test_feet_that_cannot_conform_are_refused(robot, options, message):
    with pytest.raises(InputError, match=f"terrain 'ground': uneven ground: .*{message}"):
        drilling(robot(), terrain=rough_ground(FIELD, **options))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"stroke": [0.2, 0.1]}, "stroke: lower bound 0.2 is above upper bound 0.1"),
        ({"attitude": "level"}, "only a base on legs can be level"),
        ({"attitude": "upright", "stroke": [0, 1]}, "expected one of ground, level, got 'upright'"),
        ({"x": (0, np.nan)}, "x: expected two bounds"),
    ],
)
def test_rough_ground_refuses_broken_input(options, message):
    with pytest.raises(InputError, match=message):
        rough_ground(FIELD, **options)
    with pytest.raises(InputError, match="expected a HeightField"):
        rough_ground(0.3)


def test_bounds_of_grids_hold_for_the_contacts():
    own = rough_ground(FIELD, x=(-1, 5), contacts_inside=True)
    assert own.contact_area.tolist() == [[-1, -3], [3, 3]]
    assert (own.lower[:2].tolist(), own.upper[:2].tolist()) == ([-1, -3], [3, 3])
    assert rough_ground(FIELD, x=(-1, 5)).contact_area.tolist() == [[-3, -3], [3, 3]]
    assert rough_ground(HeightField(), x=(-1, 5)).contact_area is None
    assert isinstance(drilling(tripod(), terrain=own), PlacementProblem)
