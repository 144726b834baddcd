"""Terrain: where a base can stand, as a pose over a few parameters (4.1 to 4.3).

A patch maps its parameters p to the ground frame in the world: origin on the ground, z along its normal. The
ground frame is fixed in the base (see `PlacementProblem.ground_frame`), so that it carries the base along.
Several patches make a terrain of several planes. On uneven ground the pose also depends on where the feet
touch it: see `ocptip.placement.stand`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError, finite_array
from ocptip.basics.frozen import settle
from ocptip.numerics.batch import BatchFunction
from ocptip.placement.ground import HeightField

Attitude = Literal["ground", "level"]

_PROBES = 16
_ROTATION_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class Conforming:
    """How feet, points fixed to the base or at the ends of legs along the ground frame's z, stand on a field.

    Attributes:
        field: the ground.
        stroke: (2,), m: shortest and longest stroke of the legs, by which a foot is below its place in the
            base; None: no legs, three rigid feet.
        attitude: of a base on legs: "ground", parallel to the plane that fits the places of the feet best,
            or "level".
    """

    field: HeightField
    stroke: np.ndarray | None
    attitude: Attitude


@dataclass(frozen=True, eq=False)
class Patch:
    """One piece of terrain; see :func:`plane`, :func:`rough_ground` and :func:`custom_terrain`.

    Attributes:
        name: for messages and results.
        function: CasADi function p (k,) -> position (3,), m, and rotation (3, 3) of the ground frame in the
            world; where feet conform it has a second argument: height, m, and slopes by x and y of the base.
        parameters: k names.
        lower, upper: (k,) bounds of the parameters; infinite where there is none (4.25).
        angular: (k,) True for angles in rad, which results hold between -pi and pi.
        horizontal: numbers of the parameters that are the world's x and y of the origin, if there are; then
            their bounds may be infinite.
        contact_area: (2, 2), m: lower and upper bound of the world's x and y of every contact, or None.
        constraints: CasADi function p -> values that must be >= 0, or None (4.26).
        constraint_names: their names.
        conforming: where feet conform to uneven ground: how; else None.
    """

    name: str
    function: cs.Function
    parameters: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    angular: tuple[bool, ...]
    horizontal: tuple[int, int] | None = None
    contact_area: np.ndarray | None = None
    constraints: cs.Function | None = None
    constraint_names: tuple[str, ...] = ()
    conforming: Conforming | None = None

    def __post_init__(self) -> None:
        k = len(self.parameters)
        shapes = [self.function.size_in(i) for i in range(self.function.n_in())]
        results = [self.function.size_out(i) for i in range(self.function.n_out())]
        wanted = [(k, 1), (3, 1)] if self.conforming else [(k, 1)]
        if shapes != wanted or results != [(3, 1), (3, 3)]:
            raise InputError(
                f"terrain {self.name!r}: expected a function of ({k},) with results (3,) and (3, 3), got "
                f"{shapes} and {results}"
            )
        for name in ("lower", "upper"):
            value = np.array(getattr(self, name), dtype=float)
            if value.shape != (k,) or np.isnan(value).any():
                raise InputError(f"terrain {self.name!r}: {name}: expected {k} numbers, got {value}")
            settle(self, **{name: value})
        for i in np.flatnonzero(self.lower > self.upper):
            raise InputError(
                f"terrain {self.name!r}: {self.parameters[i]}: lower bound {self.lower[i]} is above upper "
                f"bound {self.upper[i]}"
            )
        free = ~np.isfinite(self.lower) | ~np.isfinite(self.upper)
        for i in np.flatnonzero(free):
            if not self.angular[i] and i not in (self.horizontal or ()):
                raise InputError(
                    f"terrain {self.name!r}: {self.parameters[i]}: needs finite bounds, got {self.lower[i]} "
                    f"to {self.upper[i]}"
                )
        if not self.conforming:
            self._probe()

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.parameters)

    @cached_property
    def _batch(self) -> BatchFunction:
        return BatchFunction(self.function)

    @cached_property
    def _constraint_batch(self) -> BatchFunction | None:
        return None if self.constraints is None else BatchFunction(self.constraints)

    def poses(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Origins (N, 3), m, and rotations (N, 3, 3) of the ground frame at parameters (N, k)."""
        origins, rotations = self._batch(np.atleast_2d(parameters))
        return origins, rotations

    def constraint_values(self, parameters: np.ndarray) -> np.ndarray:
        """(N, m) values that must be >= 0."""
        parameters = np.atleast_2d(parameters)
        if self._constraint_batch is None:
            return np.empty((len(parameters), 0))
        return self._constraint_batch(parameters)[0].reshape(len(parameters), -1)

    def wrapped(self, parameters: np.ndarray) -> np.ndarray:
        """The same parameters with unbounded angles between -pi and pi."""
        result = np.array(parameters, dtype=float)
        for i in np.flatnonzero(self.angular):
            turned = np.remainder(result[..., i] + np.pi, 2 * np.pi) - np.pi
            inside = (turned >= self.lower[i]) & (turned <= self.upper[i])
            result[..., i] = np.where(inside, turned, result[..., i])
        return result

    def box(self, centre: Sequence[float] | np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
        """Finite bounds (k,), (k,) for sampling: world coordinates within `reach` of `centre` (3,), m.

        Angles take part with one turn at most.
        """
        low, high = self.lower.copy(), self.upper.copy()
        for i in range(self.size):
            if self.angular[i]:
                low[i], high[i] = _one_turn(low[i], high[i])
        for axis, i in enumerate(self.horizontal or ()):
            low[i], high[i] = max(low[i], centre[axis] - reach), min(high[i], centre[axis] + reach)
            if low[i] > high[i]:  # the whole patch lies beyond: its nearest edge
                nearest = min(max(centre[axis], self.lower[i]), self.upper[i])
                low[i] = high[i] = nearest
        return low, high

    def _probe(self) -> None:
        """Refuse functions that do not give poses somewhere inside the bounds."""
        rng = np.random.default_rng(0)
        low, high = (np.nan_to_num(b, posinf=1.0, neginf=-1.0) for b in (self.lower, self.upper))
        low, high = np.minimum(low, high), np.maximum(low, high)
        positions, rotations = self.poses(low + rng.random((_PROBES, self.size)) * (high - low))
        finite = np.isfinite(positions).all() and np.isfinite(rotations).all()
        error = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max() if finite else np.inf
        if not error <= _ROTATION_TOLERANCE or np.linalg.det(rotations).min() < 0:
            raise InputError(
                f"terrain {self.name!r}: function: its second result is no rotation (orthonormal to "
                f"{error:.1e})"
            )


def plane(
    slope: Sequence[float] = (0.0, 0.0),
    height: float = 0.0,
    *,
    x: Sequence[float] = (-np.inf, np.inf),
    y: Sequence[float] = (-np.inf, np.inf),
    angle: Sequence[float] = (-np.inf, np.inf),
    contacts_inside: bool = False,
    name: str = "floor",
) -> Patch:
    """The plane z = height + slope_x X + slope_y Y in world coordinates (4.2, 4.3); flat by default.

    Parameters p: world coordinates X and Y of the ground frame's origin, and its angle about the normal,
    from the axis e_x = (1, 0, slope_x) / |.|.

    Args:
        slope: slope_x, slope_y.
        height: m, of the plane at the world's origin.
        x, y: m, bounds of X and Y.
        angle: rad, bounds of the angle.
        contacts_inside: the bounds of X and Y also hold for every contact (a platform with edges).
        name: for messages and results.

    Raises:
        InputError: wrong shapes, NaN, empty bounds.
    """
    a, b = finite_array("slope", slope, (2,))
    level = finite_array("height", height, ())
    lower, upper = _bounds(name, x=x, y=y, angle=angle)
    p = cs.SX.sym("p", 3)
    position = cs.vertcat(p[0], p[1], float(level) + a * p[0] + b * p[1])
    return Patch(
        name=name,
        function=cs.Function("plane", [p], [position, turned(a, b, p[2])]),
        parameters=("x", "y", "angle"),
        lower=lower,
        upper=upper,
        angular=(False, False, True),
        horizontal=(0, 1),
        contact_area=np.array([lower[:2], upper[:2]]) if contacts_inside else None,
    )


def rough_ground(
    field: HeightField,
    *,
    stroke: Sequence[float] | None = None,
    attitude: Attitude = "ground",
    x: Sequence[float] = (-np.inf, np.inf),
    y: Sequence[float] = (-np.inf, np.inf),
    angle: Sequence[float] = (-np.inf, np.inf),
    contacts_inside: bool = False,
    name: str = "ground",
) -> Patch:
    """Uneven ground on which every foot stands at the local height, with the ground's normal there.

    Parameters p: world coordinates X and Y of the ground frame's origin, its angle about its normal as on a
    plane of the same slope, and with legs their mean stroke, m. Contacts must be ordinary ones.

    Args:
        field: heights of the ground.
        stroke: m, shortest and longest stroke of legs along the ground frame's z axis; without it three rigid
            feet.
        attitude: of a base on legs, see `Conforming`.
        x, y: m, bounds of X and Y.
        angle: rad, bounds of the angle.
        contacts_inside: the bounds of X and Y also hold for every contact; those of grids always do.
        name: for messages and results.

    Raises:
        InputError: wrong shapes, NaN, empty bounds.
    """
    if not isinstance(field, HeightField):
        raise InputError(f"terrain {name!r}: field: expected a HeightField, got {field!r}")
    if attitude not in get_args(Attitude):
        raise InputError(
            f"terrain {name!r}: attitude: expected one of {', '.join(get_args(Attitude))}, got {attitude!r}"
        )
    if stroke is None and attitude == "level":
        raise InputError(f"terrain {name!r}: stroke: missing (only a base on legs can be level)")
    lower, upper = area = _bounds(name, x=x, y=y, angle=angle)
    inside = np.array([bound[:2] for bound in area]) if contacts_inside else field.area
    inside = np.array([np.maximum(inside[0], field.area[0]), np.minimum(inside[1], field.area[1])])
    lower[:2], upper[:2] = np.maximum(lower[:2], field.area[0]), np.minimum(upper[:2], field.area[1])
    parameters, ends = ("x", "y", "angle"), None
    if stroke is not None:
        ends = finite_array(f"terrain {name!r}: stroke", stroke, (2,))
        parameters += ("stroke",)
        lower, upper = np.append(lower, ends[0]), np.append(upper, ends[1])
    p, u = cs.SX.sym("p", len(parameters)), cs.SX.sym("u", 3)
    pose = [cs.vertcat(p[0], p[1], u[0]), turned(u[1], u[2], p[2])]
    return Patch(
        name=name,
        function=cs.Function("rough_ground", [p, u], pose),
        parameters=parameters,
        lower=lower,
        upper=upper,
        angular=(False, False, True, False)[: len(parameters)],
        horizontal=(0, 1),
        contact_area=inside if np.isfinite(inside).any() else None,
        conforming=Conforming(field, ends, attitude),
    )


def turned(a: float | cs.SX, b: float | cs.SX, angle: cs.SX) -> cs.SX:
    """Axes (3, 3) of a plane with slopes a and b by x and y, turned by an angle about its normal (4.2)."""
    e_x = cs.vertcat(1.0, 0.0, a) / cs.sqrt(1 + a * a)
    e_z = cs.vertcat(-a, -b, 1.0) / cs.sqrt(1 + a * a + b * b)
    c, s = cs.cos(angle), cs.sin(angle)
    turn = cs.vertcat(cs.horzcat(c, -s, 0), cs.horzcat(s, c, 0), cs.horzcat(0, 0, 1))
    return cs.horzcat(e_x, cs.cross(e_z, e_x), e_z) @ turn


def _bounds(name: str, **given: Sequence[float]) -> np.ndarray:
    """Lower and upper bounds (2, k) of parameters."""
    bounds = []
    for key, value in given.items():
        pair = np.array(value, dtype=float)
        if pair.shape != (2,) or np.isnan(pair).any():
            raise InputError(f"terrain {name!r}: {key}: expected two bounds, got {value!r}")
        bounds.append(pair)
    return np.array(bounds).T


def custom_terrain(
    function: cs.Function,
    lower: Sequence[float],
    upper: Sequence[float],
    *,
    parameters: Sequence[str] | None = None,
    angular: Sequence[bool] | None = None,
    constraints: cs.Function | None = None,
    constraint_names: Sequence[str] | None = None,
    name: str = "terrain",
) -> Patch:
    """Any other terrain: f_U as a CasADi function (4.1).

    Args:
        function: p (k,) -> position (3,), m, and rotation (3, 3) of the ground frame in the world; twice
            differentiable.
        lower, upper: (k,) bounds; finite except for angles.
        parameters: k names; default p1, p2, ...
        angular: which parameters are angles, rad; default none.
        constraints: p -> values that must be >= 0 (4.26).
        constraint_names: their names.
        name: for messages and results.

    Raises:
        InputError: shapes do not fit, empty or missing bounds, no rotation.
    """
    size = function.numel_in(0)
    count = 0 if constraints is None else constraints.numel_out(0)
    names = constraint_names or tuple(f"{name} constraint {i + 1}" for i in range(count))
    if len(names) != count:
        raise InputError(f"terrain {name!r}: constraint_names: expected {count}, got {len(names)}")
    return Patch(
        name=name,
        function=function,
        parameters=tuple(parameters or (f"p{i + 1}" for i in range(size))),
        lower=np.array(lower, dtype=float),
        upper=np.array(upper, dtype=float),
        angular=tuple(bool(v) for v in (angular or [False] * size)),
        constraints=constraints,
        constraint_names=tuple(names),
    )


def _one_turn(low: float, high: float) -> tuple[float, float]:
    """An interval of angles cut to one turn, to that from -pi to pi if it lies inside."""
    if high - low <= 2 * np.pi:
        return low, high
    first = min(max(low, -np.pi), high - 2 * np.pi)
    return first, first + 2 * np.pi
