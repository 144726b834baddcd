"""Height fields: derivatives, grids, what is refused."""

import casadi as cs
import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.placement.ground import ORDERS, Bump, HeightField, HeightGrid, Wave


def function(expression):
    x, y = cs.SX.sym("x"), cs.SX.sym("y")
    return cs.Function("f", [x, y], [expression(x, y)])


def grid(seed=0):
    heights = 0.05 * np.random.default_rng(seed).normal(size=(17, 25))
    return HeightGrid(np.linspace(-3, 3, 25), np.linspace(-2, 2, 17), heights)


def test_derivatives_of_all_parts_added_up():
    parts = Bump([0.3, 0.2], 0.1, 0.3), Wave(0.03, 0.8, 0.4, 0.2), grid()
    field = HeightField(
        *parts, function(lambda x, y: 0.02 * cs.sin(3 * x * y)), height=0.1, slope=[0.02, 0.05]
    )
    points, step = np.random.default_rng(1).uniform(-1, 1, (20, 2)), 1e-5
    exact = field.derivatives(points)
    for r, (i, j) in enumerate(ORDERS[:6]):
        for axis, (a, b) in enumerate(((1, 0), (0, 1))):
            move = step * np.eye(2)[axis]
            numeric = (
                (field.derivatives(points + move)[:, r] - field.derivatives(points - move)[:, r]) / step / 2
            )
            assert exact[:, ORDERS.index((i + a, j + b))] == pytest.approx(numeric, abs=1e-6)
    assert field.slopes(points) == pytest.approx(exact[:, :3])
    x, y = points.T
    along = x * np.cos(0.4) + y * np.sin(0.4)
    bump = 0.1 * np.exp(-((x - 0.3) ** 2 + (y - 0.2) ** 2) / (2 * 0.3**2))
    wave = 0.03 * np.sin(2 * np.pi * along / 0.8 + 0.2)
    rest = 0.02 * np.sin(3 * x * y) + 0.1 + 0.02 * x + 0.05 * y
    surface = HeightField(grid()).heights(points)
    assert field.heights(points) == pytest.approx(bump + wave + rest + surface)


def test_a_grid_is_met_at_its_points_and_reproduces_cubics():
    own = grid()
    x, y = np.meshgrid(own.x, own.y)
    points = np.column_stack([x.ravel(), y.ravel()])
    field = HeightField(own)
    assert field.heights(points) == pytest.approx(own.heights.ravel(), abs=1e-12)
    assert field.area.tolist() == [[-3, -2], [3, 2]]
    cubic = HeightField(HeightGrid(own.x, own.y, x**3 - 2 * x * y**2 + y))
    inside = np.random.default_rng(2).uniform(-2, 2, (30, 2))
    a, b = inside.T
    assert cubic.heights(inside) == pytest.approx(a**3 - 2 * a * b**2 + b)
    assert cubic.derivatives(inside)[:, ORDERS.index((1, 2))] == pytest.approx(np.full(30, -4.0))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: HeightGrid([0, 1, 2], [0, 1, 2, 3], np.zeros((4, 3))),
            "x: expected 4 increasing numbers or more",
        ),
        (lambda: HeightGrid([0, 1, 2, 2], [0, 1, 2, 3], np.zeros((4, 4))), "x: expected 4 increasing"),
        (lambda: HeightGrid(np.arange(5), np.arange(4), np.zeros((5, 4))), "heights: expected shape"),
        (lambda: Bump([0, 0], 0.1, 0), "radius: must be > 0"),
        (lambda: Wave(0.1, -1), "length: must be > 0"),
        (lambda: HeightField(0.3), "expected Bump, Wave, HeightGrid or a CasADi function, got 0.3"),
        (lambda: HeightField(cs.Function("f", [cs.SX.sym("x", 2)], [1.0])), "expected a function of x and y"),
    ],
)
def test_what_is_no_height_field_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_a_height_may_be_a_root():
    points = np.array([[0.3, 0.7], [-0.2, -1.5]])
    slopes = HeightField(rooted()).slopes(points)
    for (_, y), (height, by_x, by_y) in zip(points, slopes, strict=True):
        assert height**3 + height == pytest.approx(y, abs=1e-9)
        assert (by_x, by_y) == (pytest.approx(0, abs=1e-9), pytest.approx(1 / (3 * height**2 + 1), rel=1e-6))


def rooted():
    """A function with a root finder inside."""
    x, y = cs.MX.sym("x"), cs.MX.sym("y")
    finder = cs.rootfinder("r", "newton", {"x": x, "p": y, "g": x**3 + x - y})
    return cs.Function("f", [x, y], [finder(x, y)])
