"""Smooth functions with two derivatives; contact forces as variables, where they may be redistributed in
full.

GT is itself the optimum of a cone program over the contact forces that hold the base (4.12). As a function of
the wrench it has kinks, and placements like to lie in them, where no gradient vanishes. Inside a nonlinear
program both optimisations become one, which is smooth: forces that balance the wrench, with all usages below
one bound. This is GT with redistribution "full", and with three contacts on a plane, whose normal forces
follow from the wrench, also the one with "tangential".
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError
from ocptip.contact.support import Support
from ocptip.numerics.batch import PointFunction
from ocptip.reserves.force_sets import ForceSets, force_scale
from ocptip.reserves.slip import LARGEST_SQUEEZE
from ocptip.standing.footing import Footing


@dataclass(frozen=True, eq=False)
class Local:
    """Numbers that go into expressions about a point.

    Attributes:
        symbols: that stand for them.
        at: variables, of which the first are those that the numbers depend on -> the numbers.
    """

    symbols: Sequence[cs.SX] = ()
    at: Callable[[np.ndarray], Sequence[np.ndarray]] = lambda _: ()


@dataclass(frozen=True, eq=False)
class Twice:
    """A vector function with two derivatives.

    Attributes:
        first: y and further arguments -> values (m,), Jacobian (m, ny).
        second: the same and multipliers (m,) -> Hessian (ny, ny) of their product with the values.
        size: m.
        labels: m names, where the values are rows of a limit.
        dropped: how far rows miss that no variable can change; they are left out.
        local: numbers that are further arguments of `first` and `second`, behind the others.
    """

    first: PointFunction
    second: PointFunction
    size: int
    labels: tuple
    dropped: float
    local: Local

    @classmethod
    def of(
        cls,
        y: cs.SX,
        arguments: list[cs.SX],
        values: cs.SX,
        labels: Sequence = (),
        dropped: float = 0.0,
        local: Local | None = None,
    ) -> Twice:
        """From expressions."""
        lam, local = cs.SX.sym("lam", values.numel()), local or Local()
        hessian, _ = cs.hessian(cs.dot(lam, values), y)
        return cls(
            PointFunction(
                cs.Function(
                    "first", [y, *arguments, *local.symbols], [values, cs.vec(cs.jacobian(values, y))]
                )
            ),
            PointFunction(cs.Function("second", [y, *arguments, lam, *local.symbols], [hessian])),
            values.numel(),
            tuple(labels),
            dropped,
            local,
        )

    def values(self, *arguments: np.ndarray) -> np.ndarray:
        """Values (m,)."""
        return self.first(*arguments, *self.local.at(arguments[0]))[0]

    def jacobian(self, *arguments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (m,) and Jacobian (m, ny)."""
        values, slope = self.first(*arguments, *self.local.at(arguments[0]))
        return values, slope.reshape(-1, len(values)).T

    def hessian(self, *arguments: np.ndarray) -> np.ndarray:
        """(ny, ny)."""
        result = self.second(*arguments, *self.local.at(arguments[0]))[0]
        return result.reshape(len(arguments[0]), -1)


ROUNDING = 1e-7
"""Added to friction limits that are divided by, in units of the weight."""


class ContactForces:
    """Balance and friction of contact forces F (3 n,), contact axes, in units of `unit`.

    Each contact keeps to one convex piece of its force set: the one that holds its force in the contact
    solver's state at the start. (Ordinary contacts have only one.)

    Args:
        support: the base on its contacts.
        unit: N.
        moving: (p, forces in N (3 n,)) -> their wrench (6,), where contacts move within the base; else None.
    """

    def __init__(self, support: Support, unit: float, moving: Twice | None = None) -> None:
        self.unit = unit
        self.size = 3 * support.n_contacts
        scale = np.r_[1, 1, 1, np.full(3, 1 / support.length)]
        self._per_force = scale[:, None] * support.wrench_matrix
        self._scale, self._moving = scale, moving
        self.per_wrench = np.diag(scale) / unit
        self._sets = ForceSets(support)
        if len(wheels := np.flatnonzero(np.isfinite(self._sets.along))):
            number = int(wheels[0]) + 1
            raise InputError(f"contact {number}: a wheel that rolls cannot be placed")

    def start(self, wrenches: np.ndarray, footing: Footing) -> tuple[np.ndarray, list[Piece]]:
        """Forces (N, 3 n) of the redistributed states under wrenches (N, 6), and the pieces they lie in."""
        states = footing.contact_states(wrenches, warm_start=False)
        forces = footing.slip.evaluate(states, derivatives=False).forces
        limits = self._sets.limits(np.nan_to_num(states.contact_forces[:, :, 0]), force_scale(states))
        squeeze = LARGEST_SQUEEZE
        pieces = [
            Piece(
                radius=limits.radius[i] / self.unit,
                slope=limits.slope[i],
                lower=np.maximum(limits.normal_min[i] / self.unit, -squeeze),
                upper=np.minimum(limits.normal_max[i] / self.unit, squeeze),
            )
            for i in range(len(wrenches))
        ]
        return forces.reshape(len(wrenches), -1) / self.unit, pieces

    def balance(self, p: np.ndarray, forces: np.ndarray, wrench: np.ndarray) -> np.ndarray:
        """(6,) sums of forces and of moments per length, which vanish in equilibrium."""
        balanced = self._per_force @ forces
        if self._moving is not None:
            balanced = self._scale * self._moving.values(np.concatenate([p, forces]))
        return balanced + self.per_wrench @ wrench

    def slopes(self, p: np.ndarray, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives (6, k) and (6, 3 n) of the balance by p and by the forces."""
        if self._moving is None:
            return np.zeros((6, len(p))), self._per_force
        slope = self._scale[:, None] * self._moving.jacobian(np.concatenate([p, forces]))[1]
        return slope[:, : len(p)], slope[:, len(p) :]

    def hessian(self, p: np.ndarray, forces: np.ndarray, multipliers: np.ndarray) -> np.ndarray | None:
        """Second derivatives of multipliers . balance by (p, forces), None where they vanish."""
        if self._moving is None:
            return None
        return self._moving.hessian(np.concatenate([p, forces]), self._scale * multipliers)


class Piece:
    """Convex pieces of the force sets of n contacts: |K_t| <= radius + slope K_n, lower <= K_n <= upper."""

    def __init__(self, radius: np.ndarray, slope: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> None:
        self.radius, self.slope, self.lower, self.upper = radius, slope, lower, upper

    def __eq__(self, other: object) -> bool:
        names = ("radius", "slope", "lower", "upper")
        return isinstance(other, Piece) and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in names
        )

    __hash__ = None  # pyright: ignore[reportAssignmentType] # arrays have none

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of the forces (3 n,); tangential ones of contacts without friction are zero and need no
        cone.
        """
        wide = np.where((self.radius == 0) & (self.slope == 0), 0.0, np.inf)
        low, high = ((end, sign * wide, sign * wide) for end, sign in ((self.lower, -1), (self.upper, 1)))
        return np.column_stack(low).ravel(), np.column_stack(high).ravel()

    def rows(self, forces: np.ndarray, bound: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """|K_t|^2 / limit - bound^2 limit (n,), must be <= 0; slopes (n, 3 n) by force and (n,) by `bound`.

        In this form the cone has no tip at K_t = 0.
        """
        F = forces.reshape(-1, 3)
        limit = self.radius + self.slope * F[:, 0]
        square, positive = np.sum(F[:, 1:] ** 2, axis=1), limit + ROUNDING
        slope = np.zeros((len(F), *F.shape))
        numbers = np.arange(len(F))
        slope[numbers, numbers, 0] = -self.slope * (square / positive**2 + bound**2)
        slope[numbers, numbers, 1:] = 2 * F[:, 1:] / positive[:, None]
        return square / positive - bound**2 * limit, slope.reshape(len(F), -1), -2 * bound * limit

    def hessian(
        self, forces: np.ndarray, bound: float, multipliers: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Second derivatives of multipliers . rows: (3 n, 3 n), (3 n,) by force and bound, twice by bound."""
        F = forces.reshape(-1, 3)
        limit = self.radius + self.slope * F[:, 0]
        positive = limit + ROUNDING
        result, mixed = np.zeros((F.size, F.size)), np.zeros_like(F)
        for k, (_, *T) in enumerate(F):
            block = slice(3 * k, 3 * k + 3)
            # square / positive is |v|^2 with v = K_t / sqrt(positive); its Hessian is 2 B' B / positive
            B = np.array(
                [[-T[0] * self.slope[k] / positive[k], 1, 0], [-T[1] * self.slope[k] / positive[k], 0, 1]]
            )
            result[block, block] = multipliers[k] * 2 / positive[k] * (B.T @ B)
        mixed[:, 0] = -2 * bound * multipliers * self.slope
        return result, mixed.ravel(), float(-2 * multipliers @ limit)
