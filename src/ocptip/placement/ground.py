"""Uneven ground as a height field: its heights and their derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as cs
import numpy as np
import scipy  # subpackages load on first use

from ocptip.basics.errors import InputError, finite_array, number_from, positive_number
from ocptip.basics.frozen import settle
from ocptip.numerics.batch import BatchFunction

if TYPE_CHECKING:
    from scipy.interpolate import NdBSpline

ORDERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))
"""Orders of the derivatives by x and y that a height field gives."""

_SLOPES = 3  # of them: height and slopes
_DEGREE = 3


@dataclass(frozen=True, eq=False)
class Bump:
    """A rounded bump, or a hollow: height exp(-r^2 / (2 radius^2)), r the distance from its middle.

    Attributes:
        at: (2,), m, world x and y of its middle.
        height: m; negative for a hollow.
        radius: m, where the side is steepest.
    """

    at: Sequence[float]
    height: float
    radius: float

    def __post_init__(self) -> None:
        settle(self, at=finite_array("at", self.at, (2,)), height=number_from("height", self.height))
        positive_number("radius", self.radius)

    def expression(self, x: cs.SX, y: cs.SX) -> cs.SX:
        """Its height, m, at world coordinates."""
        square = (x - self.at[0]) ** 2 + (y - self.at[1]) ** 2
        return self.height * cs.exp(-square / (2 * self.radius**2))


@dataclass(frozen=True, eq=False)
class Wave:
    """A plane wave: amplitude sin(2 pi r / length + phase), r the distance along its direction.

    Attributes:
        amplitude: m.
        length: m, from crest to crest.
        direction: rad, across the crests, from the world's x axis.
        phase: rad, at the world's origin.
    """

    amplitude: float
    length: float
    direction: float = 0.0
    phase: float = 0.0

    def __post_init__(self) -> None:
        positive_number("length", self.length)
        for name in ("amplitude", "direction", "phase"):
            settle(self, **{name: number_from(name, getattr(self, name))})

    def expression(self, x: cs.SX, y: cs.SX) -> cs.SX:
        """Its height, m, at world coordinates."""
        along = x * np.cos(self.direction) + y * np.sin(self.direction)
        return self.amplitude * cs.sin(2 * np.pi / self.length * along + self.phase)


@dataclass(frozen=True, eq=False)
class HeightGrid:
    """Heights on a grid, between them a surface of cubic splines (twice continuously differentiable).

    Attributes:
        x: (nx,), y: (ny,): world coordinates of the grid's lines, m, increasing, at least four each.
        heights: (ny, nx), m.
    """

    x: Sequence[float]
    y: Sequence[float]
    heights: np.ndarray

    def __post_init__(self) -> None:
        for name in ("x", "y"):
            value = finite_array(name, getattr(self, name), (None,))
            if len(value) <= _DEGREE or np.any(np.diff(value) <= 0):
                raise InputError(
                    f"{name}: expected {_DEGREE + 1} increasing numbers or more, got {value.tolist()}"
                )
            settle(self, **{name: value})
        shape = len(self.y), len(self.x)
        settle(self, heights=finite_array("heights", self.heights, shape))

    def spline(self) -> NdBSpline:
        """The surface over (x, y); beyond the grid its outermost pieces go on."""
        make_interp_spline = scipy.interpolate.make_interp_spline
        along_x = make_interp_spline(self.x, self.heights.T, _DEGREE)
        both = make_interp_spline(self.y, along_x.c.T, _DEGREE)
        return scipy.interpolate.NdBSpline((along_x.t, both.t), both.c.T, _DEGREE, extrapolate=True)


class HeightField:
    """Heights z of the ground over the world's x and y: the sum of its parts.

    Args:
        *parts: bumps, waves, grids of heights, and CasADi functions (x, y) -> z;
            three times differentiable, a grid's surface between its lines.
        height: m, at the world's origin.
        slope: slope_x, slope_y; height + slope . (x, y) is also a part.

    Attributes:
        area: (2, 2), m: lower and upper bounds of x and y within which all grids have heights.

    Raises:
        InputError: a part that is none of these.
    """

    def __init__(
        self,
        *parts: Bump | Wave | HeightGrid | cs.Function,
        height: float = 0.0,
        slope: Sequence[float] = (0.0, 0.0),
    ) -> None:
        a, b = finite_array("slope", slope, (2,))
        xy = cs.SX.sym("xy", 2)
        total = number_from("height", height) + a * xy[0] + b * xy[1]
        self._splines, self.area = [], np.array([[-np.inf, -np.inf], [np.inf, np.inf]])
        for part in parts:
            if isinstance(part, HeightGrid):
                self._splines.append(part.spline())
                low, high = [part.x[0], part.y[0]], [part.x[-1], part.y[-1]]
                self.area = np.array([np.maximum(self.area[0], low), np.minimum(self.area[1], high)])
            else:
                total = total + _expression(part, xy)
        derivatives = [total]
        for i, j in ORDERS[1:]:
            known = ORDERS.index((i - 1, j) if i else (i, j - 1))
            derivatives.append(cs.gradient(derivatives[known], xy)[0 if i else 1])
        self._all, self._first = (
            BatchFunction(cs.Function("heights", [xy], [cs.vertcat(*derivatives[:count])]))
            for count in (len(ORDERS), _SLOPES)
        )

    def heights(self, points: np.ndarray) -> np.ndarray:
        """(N,), m, at world coordinates (N, 2)."""
        return self.slopes(points)[:, 0]

    def slopes(self, points: np.ndarray) -> np.ndarray:
        """Height, m, and its derivatives by x and y, (N, 3), at world coordinates (N, 2)."""
        return self._derivatives(points, self._first, _SLOPES)

    def derivatives(self, points: np.ndarray) -> np.ndarray:
        """Derivatives (N, 10) of `ORDERS` at world coordinates (N, 2)."""
        return self._derivatives(points, self._all, len(ORDERS))

    def _derivatives(self, points: np.ndarray, smooth: BatchFunction, count: int) -> np.ndarray:
        result = smooth(points)[0].reshape(len(points), count)
        for spline in self._splines:
            result = result + np.column_stack([spline(points, nu=order) for order in ORDERS[:count]])
        return result


def _expression(part: Bump | Wave | cs.Function, xy: cs.SX) -> cs.SX:
    """The height of a part at world coordinates (2,)."""
    if isinstance(part, Bump | Wave):
        return part.expression(xy[0], xy[1])
    if not isinstance(part, cs.Function):
        raise InputError(f"height field: expected Bump, Wave, HeightGrid or a CasADi function, got {part!r}")
    shapes = [part.numel_in(i) for i in range(part.n_in())], [part.numel_out(i) for i in range(part.n_out())]
    if shapes != ([1, 1], [1]):
        raise InputError(f"height field: expected a function of x and y with one result, got {part}")
    return part(xy[0], xy[1])
