"""Base parameters of a parallel robot: leg by leg in closed form, and those of the whole robot.

Rules of Gautier and Khalil: what a joint cannot tell apart moves to the body before it. Of a revolute joint
that is a body of revolution about its axis, of a prismatic joint the whole inertia tensor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array
from ocptip.parallel.description.mdh import moved_inertia, row_frame
from ocptip.parallel.description.platform import BodyInertia
from ocptip.parallel.description.robot_description import FIXED, PRISMATIC, MDHRow, RobotDescription
from ocptip.parallel.symbolic.leg_dynamics import LegPlan
from ocptip.parallel.symbolic.projection import Arguments, Projection
from ocptip.parallel.symbolic.symbols import InertiaLayout, geometry_symbols, inertia_layout, inertia_values

_XX, _YY, _MZ, _M = 0, 3, 8, 9


@dataclass(frozen=True, eq=False)
class LegBaseParameters:
    """Base parameters by the leg-wise closed form, in the order of the inertia layout.

    Attributes:
        kept: of all parameters of the layout, which are base parameters.
        names: of those kept, each the name of the parameter into which others were grouped.
        values: of those kept.
        full: (layout.size,) the same values with zeros where eliminated: a DynPar 2 vector with equal motor
            forces.
    """

    kept: tuple[bool, ...]
    names: tuple[str, ...]
    values: np.ndarray
    full: np.ndarray


def leg_base_parameters(description: RobotDescription) -> LegBaseParameters:
    """Group the parameters of every leg from its coupling point to the base, in closed form.

    Raises:
        InputError: a robot without the coupling form.
    """
    layout = inertia_layout(description)
    values = inertia_values(description)
    kept = np.zeros(layout.size, dtype=bool)
    for group in layout.groups:
        leg = description.legs[group[0]]
        section = layout.leg_slice(group[0])
        table = values[section].reshape(leg.n, 10)
        keep = np.ones((leg.n, 10), dtype=bool)
        for j in range(leg.n - 1, -1, -1):
            if leg.rows[j].sigma == PRISMATIC:
                moved = np.concatenate([table[j, :6], np.zeros(4)])
                keep[j, :6] = False
            else:
                # A body of revolution about the joint's axis looks the same at every angle.
                moved = np.zeros(10)
                moved[[_XX, _YY]] = table[j, _YY]
                moved[[_MZ, _M]] = table[j, [_MZ, _M]]
                keep[j, [_YY, _MZ, _M]] = False
            table[j] -= moved
            if j:
                table[j - 1] += transform_inertia(leg.rows[j]) @ moved
        values[section] = table.ravel()
        kept[section] = keep.ravel()
    kept[layout.platform_slice] = True
    kept &= _effective(description, layout, kept)
    names = np.array(layout.names())
    full = np.where(kept, values, 0.0)
    return LegBaseParameters(tuple(kept.tolist()), tuple(names[kept].tolist()), values[kept], full)


def transform_inertia(row: MDHRow) -> np.ndarray:
    """(10, 10) parameters of a body given in frame j, expressed in frame a(j), at joint variable zero."""
    still = replace(row, sigma=FIXED, r=0.0 if row.sigma == PRISMATIC else row.r)
    frame = row_frame(still)
    moved = (moved_inertia(BodyInertia.from_vector(unit), frame).vector for unit in np.eye(10))
    return np.column_stack(list(moved))


def _effective(description: RobotDescription, layout: InertiaLayout, kept: np.ndarray) -> np.ndarray:
    """Which parameters occur in the generalised force at all."""
    m, n, legs = description.platform.m, layout.bodies, len(description.legs)
    inertia = cs.SX.sym("inertia", layout.size)
    arguments = Arguments(
        pose=cs.SX.sym("z", m),
        rates=cs.SX.sym("zd", m),
        accelerations=cs.SX.sym("zdd", m),
        q=cs.SX.sym("q", n, legs),
        geometry=geometry_symbols(description),
        inertia=cs.vertcat(*(inertia[k] if kept[k] else cs.SX(0.0) for k in range(layout.size))),
        gravity=cs.SX.sym("gravity", 3),
        wrench=cs.SX.zeros(6),
        joint_terms=cs.SX.zeros(3, n * legs),
        quasi=True,
    )
    force = cs.SX()
    for frame in range(n, 0, -1):
        try:
            projection = Projection(description, layout, [LegPlan(frame, n)] * legs, arguments)
        except InputError:
            if frame == 1:
                raise
            continue
        force = projection.generalized_force()
        break
    return np.array(cs.which_depends(force, inertia, 1, False))


@dataclass(frozen=True, eq=False)
class NumericBaseParameters:
    """Base parameters of the whole robot from a stacked regressor, p_base = p_1 + K p_2.

    Attributes:
        names: of p_1, each the name of the parameter into which others were grouped.
        independent: indices (in the inertia layout) of p_1.
        dependent: indices of p_2, whose columns are combinations of those of p_1.
        without_effect: indices of columns that are zero.
        grouping: K, (len(independent), len(dependent)).
        singular_values: of the scaled regressor, largest first.
        gap: decades between the smallest singular value that counts and the largest that does not.
        residual: largest relative difference between W p and W_1 p_base over the stacked rows.
    """

    names: tuple[str, ...]
    independent: tuple[int, ...]
    dependent: tuple[int, ...]
    without_effect: tuple[int, ...]
    grouping: np.ndarray
    singular_values: np.ndarray
    gap: float
    residual: float

    @property
    def rank(self) -> int:
        """Number of base parameters."""
        return len(self.independent)

    @property
    def size(self) -> int:
        """Number of all parameters (DynPar 2)."""
        return self.rank + len(self.dependent) + len(self.without_effect)

    @property
    def matrix(self) -> np.ndarray:
        """(rank, size): p_base = matrix p, from DynPar 2 to the whole robot's DynPar 3."""
        matrix = np.zeros((self.rank, self.size))
        matrix[:, list(self.independent)] = np.eye(self.rank)
        matrix[:, list(self.dependent)] = self.grouping
        return matrix

    def values(self, parameters: ArrayLike) -> np.ndarray:
        """(rank,) base parameters of a parameter vector in the order of the layout."""
        return self.matrix @ finite_array("parameters", parameters, (self.size,))

    def embedded(self, parameters: ArrayLike) -> np.ndarray:
        """The full vector (p_base, 0) that has the same motor forces."""
        full = np.zeros(self.size)
        full[list(self.independent)] = self.values(parameters)
        return full

    def function(self) -> cs.Function:
        """`base_parameters`: `p` (size,) to `p_base` (rank,), for C code beside generated functions."""
        p = cs.SX.sym("p", self.size)
        return cs.Function("base_parameters", [p], [cs.sparsify(cs.DM(self.matrix)) @ p], ["p"], ["p_base"])
