"""A base on its contacts: geometry, inertia and the linear system that the solver pivots on."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import (
    LARGEST,
    InputError,
    bounded_array,
    finite_array,
    positive_number,
    refuse_huge,
)
from ocptip.contact.bindings.binding import Binding
from ocptip.contact.elastic import ElasticFeet
from ocptip.contact.tables import packed
from ocptip.numerics.inertia import symmetric_matrix, why_impossible
from ocptip.numerics.vectors import cross

STANDARD_GRAVITY = 9.81
LARGEST_WRENCH = LARGEST**2
"""Largest element of a wrench, N and N m: forces times distances, and many of them."""

INERTIA_RANGE = 1e3
"""Principal inertias between mass times length squared divided by this and times this count as usual."""

PROOFS = 16
"""Number of velocities that are kept: each proved motion under one wrench, and may prove it for others."""

_RANK_TOLERANCE = 1e-9
_TRIANGLE_TOLERANCE = 1e-6
_MOST_UNUSUAL = 1e15


@dataclass(frozen=True)
class Load:
    """A force and a moment on the base.

    Attributes:
        force: N, base axes, shape (3,) or (2,); None: no force.
        moment: N m, base axes, shape (3,), or a number in the plane; None: no moment.
        point: where the force acts, m, base axes; None: the origin.

    Raises:
        InputError: neither a force nor a moment.
    """

    force: ArrayLike | None = None
    moment: ArrayLike | None = None
    point: ArrayLike | None = None

    def __post_init__(self) -> None:
        if self.force is None and self.moment is None:
            raise InputError("force: missing (a load needs a force or a moment)")


class Support:
    """A rigid base that stands on contacts.

    All vectors are in base axes. A wrench is the force on the base and its moment about the base's
    centre of mass: 6 numbers (N, N m), or 3 (fx, fy, moment) for a planar support, whose axes are
    (x, y) with positive moments from x to y.

    Args:
        contacts: all spatial or all planar.
        mass: of the base, kg.
        center_of_mass: of the base, m; default the origin.
        inertia: about the centre of mass, kg m^2: (3, 3), or (6,) numbers xx, xy, xz, yy, yz, zz, or three
            principal values, or one number in the plane. It decides how a base moves that does not stand, not
            whether contact forces can hold it. Default: mass times the squared distance of the farthest
            contact.
        gravity: m/s^2; default 9.81 against the last base axis.

    Raises:
        InputError: naming what is wrong; numbers above 1e12 are refused as well.
    """

    def __init__(
        self,
        contacts: Sequence[Binding],
        *,
        mass: float = 1.0,
        center_of_mass: ArrayLike | None = None,
        inertia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> None:
        self.contacts = tuple(contacts)
        if not self.contacts:
            raise InputError("contacts: a support needs at least one contact")
        for i, contact in enumerate(self.contacts):
            if not isinstance(contact, Binding):
                raise InputError(f"contacts[{i}]: expected a contact, got {type(contact).__name__}")
            if contact.dimension != self.contacts[0].dimension:
                raise InputError(f"contacts[{i}]: planar and spatial contacts cannot be mixed")
        _refuse_some_springs(self.contacts)
        d = self.contacts[0].dimension
        self.mass = positive_number("mass", mass)
        refuse_huge("mass", self.mass)
        if self.mass < 1 / LARGEST:
            raise InputError(f"mass: must be at least {1 / LARGEST:g} kg, got {mass!r}")
        if center_of_mass is None:
            center_of_mass = np.zeros(d)
        self.center_of_mass = bounded_array("center_of_mass", center_of_mass, (d,))
        if gravity is None:
            gravity = [0.0] * (d - 1) + [-STANDARD_GRAVITY]
        self.gravity = bounded_array("gravity", gravity, (d,))
        self.arms = np.array([c.position for c in self.contacts]) - self.center_of_mass
        farthest = float(np.max(np.linalg.norm(self.arms, axis=1)))
        self.length = farthest if farthest > 0 else 1.0
        self.inertia = _inertia(inertia, self.mass * self.length**2, d)

    @property
    def dimension(self) -> int:
        """3 in space, 2 in the plane."""
        return self.contacts[0].dimension

    @property
    def wrench_size(self) -> int:
        """6 in space, 3 in the plane."""
        return 6 if self.dimension == 3 else 3

    @property
    def n_contacts(self) -> int:
        """Number of contacts."""
        return len(self.contacts)

    @cached_property
    def frames(self) -> np.ndarray:
        """(n, d, d) contact frames, columns n, t1, t2 in base axes."""
        return np.array([c.frame for c in self.contacts])

    @cached_property
    def wrench_matrix(self) -> np.ndarray:
        """W: (6, 3 n) wrench about the centre of mass per contact force in contact axes; (3, 2 n) planar."""
        blocks = []
        for frame, arm in zip(self.frames, self.arms, strict=True):
            blocks.append(np.vstack([frame, moments_of(arm, frame.T).T]))
        return np.hstack(blocks)

    @cached_property
    def inverse_mass(self) -> np.ndarray:
        """Inverse of M = diag(m 1, Theta), (6, 6) or (3, 3)."""
        d = self.dimension
        inverse = np.zeros((self.wrench_size, self.wrench_size))
        inverse[:d, :d] = np.eye(d) / self.mass
        inverse[d:, d:] = np.linalg.inv(self.inertia)
        return inverse

    @cached_property
    def conditioned(self) -> Support:
        """The same support with principal inertias moved into the usual range (`INERTIA_RANGE`).

        It stands and falls under the same loads. Where inertia is far outside (a heavy base taken as a point,
        a wrong unit), rounding in the equations of motion hides that the base rests; here it does not. The
        support itself if nothing has to be moved.
        """
        if self.inertia_is_within(INERTIA_RANGE):
            return self
        values, axes = np.linalg.eigh(self.inertia)
        usual = self.mass * self.length**2
        moved = np.clip(values, usual / INERTIA_RANGE, usual * INERTIA_RANGE)
        inertia = (axes * moved) @ axes.T
        return self.varied(inertia=0.5 * (inertia + inertia.T))

    def varied(self, contacts: Sequence[Binding] | None = None, **changes: Any) -> Support:
        """The same support with other contacts, mass, center_of_mass, inertia or gravity."""
        names = ("mass", "center_of_mass", "inertia", "gravity")
        kept = {name: getattr(self, name) for name in names}
        return Support(self.contacts if contacts is None else contacts, **{**kept, **changes})

    def inertia_is_within(self, factor: float) -> bool:
        """True if all principal inertias are within this factor of mass times length squared."""
        ratios = np.linalg.eigvalsh(self.inertia) / (self.mass * self.length**2)
        return bool(ratios[0] >= 1 / factor and ratios[-1] <= factor)

    @cached_property
    def weight(self) -> np.ndarray:
        """Wrench of the weight of the base about its centre of mass."""
        wrench = np.zeros(self.wrench_size)
        wrench[: self.dimension] = self.mass * self.gravity
        wrench.flags.writeable = False
        return wrench

    def wrench(self, loads: Load | Sequence[Load] = ()) -> np.ndarray:
        """Wrench of the base's weight and of all loads (or of a single one) about its centre of mass.

        Raises:
            InputError: something that is no `Load`, or a load with wrong shapes, NaN, infinity or numbers
                above 1e12.
        """
        total = self.weight.copy()
        d = self.dimension
        if isinstance(loads, Load):
            loads = (loads,)
        elif not isinstance(loads, Iterable):
            raise InputError(f"loads: expected a Load or a list of them, got {loads!r}")
        for i, load in enumerate(loads):
            if not isinstance(load, Load):
                raise InputError(f"load[{i}]: expected a Load, got {type(load).__name__}")
            zero = np.zeros(d)
            force = zero if load.force is None else bounded_array(f"load[{i}].force", load.force, (d,))
            point = zero if load.point is None else bounded_array(f"load[{i}].point", load.point, (d,))
            moment = 0.0
            if load.moment is not None:
                moment = bounded_array(f"load[{i}].moment", load.moment, (3,) if d == 3 else ())
            total[:d] += force
            total[d:] += moment + moments_of(point - self.center_of_mass, force[None])[0]
        return total

    @cached_property
    def elastic(self) -> ElasticFeet | None:
        """The map from loads to the forces of compliant contacts; None if they are rigid."""
        springs = [spring for c in self.contacts if (spring := c.spring())]
        return ElasticFeet(self.wrench_matrix, springs, self.length) if springs else None

    @cached_property
    def proofs(self) -> deque[tuple[np.ndarray, float]]:
        """The latest velocities with the most power, W, that contacts can take up at them, see `resting`."""
        return deque(maxlen=PROOFS)

    @cached_property
    def power(self) -> float:
        """W, drawn by actuators of clamps, all the time."""
        return float(sum(contact.power() for contact in self.contacts))

    @cached_property
    def no_subsets(self) -> np.ndarray:
        """(n,) -1: no contact's admissible subset is known."""
        return np.full(self.n_contacts, -1, dtype=np.int64)

    @cached_property
    def system(self) -> ContactSystem:
        """The assembled linear system (3.18), built once."""
        return ContactSystem(self)


def moments_of(arm: np.ndarray, forces: np.ndarray) -> np.ndarray:
    """Moments arm x force of forces (N, d), shape (N, 3), or (N, 1) in the plane (from x to y)."""
    if len(arm) == 3:
        return cross(arm, forces)
    return (arm[0] * forces[:, 1] - arm[1] * forces[:, 0])[:, None]


def _inertia(value: ArrayLike | None, default: float, dimension: int) -> np.ndarray:
    size = 3 if dimension == 3 else 1
    if value is None:
        return np.eye(size) * default
    if np.ndim(np.asarray(value, dtype=object)) == 0:
        matrix = np.eye(size) * positive_number("inertia", value)
    elif size == 3:
        matrix = symmetric_matrix(value)
    else:
        matrix = finite_array("inertia", value, (1, 1))
    principal = np.linalg.eigvalsh(matrix)
    if principal[0] <= 0:
        raise InputError(f"inertia: must be symmetric and positive definite, got {value!r}")
    if principal[0] < default / _MOST_UNUSUAL or principal[-1] > default * _MOST_UNUSUAL:
        shown = ", ".join(f"{x:.4g}" for x in principal)
        raise InputError(
            f"inertia: principal values ({shown} kg m^2) that no body of this mass and size has; mass times "
            f"squared distance of the farthest contact is {default:.4g} kg m^2"
        )
    return matrix


def _refuse_some_springs(contacts: Sequence[Binding]) -> None:
    rigid = [k for k, c in enumerate(contacts, 1) if c.spring() is None]
    if rigid and len(rigid) < len(contacts):
        kind = contacts[rigid[0] - 1].kind
        raise InputError(
            f"stiffness: contact {rigid[0]}, a {kind}, has none, others do; give all contacts a "
            "stiffness, or none (clamps: that of what they hold)"
        )


def refuse_impossible_inertia(support: Support) -> None:
    """Raise InputError if no distribution of mass has the support's inertia (triangle inequality).

    The contact laws do not need it; data that break it have a wrong unit, axis or sign.
    """
    if support.dimension == 3:
        rounding = _TRIANGLE_TOLERANCE * np.linalg.norm(support.inertia, 2)
        if reason := why_impossible(support.inertia, float(rounding)):
            raise InputError(f"inertia: {reason}")


class ContactSystem:
    """The equations of all contacts in the form `matrix x = rhs(wrench)`, x >= 0.

    Everything is scaled so that all quantities are forces: lengths by `length` (of the support), mass 1;
    an acceleration variable is stored as mass times acceleration (N).

    Rows: contact by contact, first the motion rows (n, t1, t2), then the auxiliary rows of its contact model.

    Where no contact variable accelerates in some direction (clamps without normal motion), more than
    three such contacts make the rows linearly dependent, and every basis singular. The equations then
    leave the distribution of some forces open. `gauge` holds the free directions; adding `gauge gauge'`
    times the force to the dependent rows turns "0 = 0" into "no force in the free directions" and
    changes no other equation.

    Attributes:
        matrix: (m, P) the system with the gauge rows.
        plain_matrix: (m, P) the system itself.
        rhs_matrix: (m, 6) and rhs_offset (m,): rhs = rhs_matrix @ wrench + rhs_offset, N.
        gauge: (m, c) orthonormal directions left open, in rows.
        force_matrix: (d n, P) contact forces in contact axes, N, per unit of x; plus force_offset (d n,).
        acceleration_matrix: (d n, P) mass times contact acceleration per unit of x.
        first_column (n,), row_start (n + 1,): where each contact's columns and rows begin.
    """

    def __init__(self, support: Support) -> None:
        self.support = support
        d, n = support.dimension, support.n_contacts
        columns = [c.columns for c in support.contacts]
        sizes = [c.auxiliary.shape[0] + d for c in columns]
        counts = [len(c.names) for c in columns]
        self.row_start = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        self.first_column = starts[:-1]
        m, p = int(self.row_start[-1]), int(starts[-1])

        scaling = np.ones(support.wrench_size)
        scaling[d:] = 1.0 / support.length
        W = scaling[:, None] * support.wrench_matrix
        inverse_mass = support.mass * support.inverse_mass / np.outer(scaling, scaling)
        delassus = W.T @ inverse_mass @ W
        self.motion_rows = np.concatenate([np.arange(r, r + d) for r in self.row_start[:-1]])

        self.force_matrix = np.zeros((d * n, p))
        self.acceleration_matrix = np.zeros((d * n, p))
        self.force_offset = np.concatenate([c.force_offset() for c in support.contacts])
        auxiliary = np.zeros((m, p))
        self.rhs_offset = np.zeros(m)
        for k, (contact, c) in enumerate(zip(support.contacts, columns, strict=True)):
            cols = slice(starts[k], starts[k + 1])
            self.force_matrix[d * k : d * k + d, cols] = c.force
            self.acceleration_matrix[d * k : d * k + d, cols] = c.acceleration
            auxiliary[self.row_start[k] + d : self.row_start[k + 1], cols] = c.auxiliary
            self.rhs_offset[self.row_start[k] + d : self.row_start[k + 1]] = contact.auxiliary_rhs()

        self.plain_matrix = auxiliary
        self.plain_matrix[self.motion_rows] = self.acceleration_matrix - delassus @ self.force_matrix
        self.rhs_matrix = np.zeros((m, support.wrench_size))
        self.rhs_matrix[self.motion_rows] = W.T @ inverse_mass * scaling
        self.rhs_offset[self.motion_rows] += delassus @ self.force_offset
        self.plain_rhs_offset = self.rhs_offset
        self.matrix, self.gauge = self._with_gauge(columns, W, delassus)
        self._flatten_automata()
        self._find_start_candidates()

    def rhs(self, wrenches: np.ndarray) -> np.ndarray:
        """Right-hand sides (N, m) of wrenches (N, 6)."""
        return wrenches @ self.rhs_matrix.T + self.rhs_offset

    def _with_gauge(self, columns, W, delassus):
        d, n = self.support.dimension, self.support.n_contacts
        dead = []  # directions (in stacked contact axes) in which a contact cannot accelerate
        for k, c in enumerate(columns):
            u, s, _ = np.linalg.svd(c.acceleration)
            for direction in u[:, int(np.sum(s > _RANK_TOLERANCE)) :].T:
                column = np.zeros(d * n)
                column[d * k : d * k + d] = direction
                dead.append(column)
        rows = len(self.rhs_offset)
        if not dead:
            return self.plain_matrix, np.zeros((rows, 0))
        D = np.array(dead).T
        u, s, _ = np.linalg.svd((W @ D).T)
        rank = int(np.sum(s > _RANK_TOLERANCE * max(1.0, s[0])))
        free = D @ u[:, rank:]
        gauge = np.zeros((rows, free.shape[1]))
        gauge[self.motion_rows] = free
        stiffness = np.trace(delassus) / len(delassus)
        matrix = self.plain_matrix - stiffness * gauge @ (free.T @ self.force_matrix)
        self.rhs_offset = self.rhs_offset + stiffness * gauge @ (free.T @ self.force_offset)
        return matrix, gauge

    def _flatten_automata(self) -> None:
        automata = [c.automaton for c in self.support.contacts]
        self.subsets = np.concatenate([a.subsets.ravel() for a in automata])
        self.successor = np.concatenate([a.successor.ravel() for a in automata])
        self.entering = np.concatenate([a.entering.ravel() for a in automata])
        sizes = [a.subsets.size for a in automata]
        self.subset_start = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)

    def _find_start_candidates(self) -> None:
        """Per contact the modes with the most accelerations whose local block is regular."""
        largest = int(np.max(np.diff(self.row_start)))
        subset_ids, inverses, first, count = [], [], [], []
        self.block_start = True
        for k, contact in enumerate(self.support.contacts):
            automaton = contact.automaton
            moving = contact.columns.is_acceleration[automaton.subsets].sum(axis=1)
            moving[automaton.redundant] = -1
            rows = slice(self.row_start[k], self.row_start[k + 1])
            size = self.row_start[k + 1] - self.row_start[k]
            first.append(len(subset_ids))
            for s in np.flatnonzero(moving == moving.max()):
                columns = self.matrix[:, self.first_column[k] + automaton.subsets[s]]
                block = columns[rows]
                if np.linalg.cond(block) < 1e10:
                    inverse = np.zeros((largest, largest))
                    inverse[:size, :size] = np.linalg.inv(block)
                    subset_ids.append(s)
                    inverses.append(inverse)
                    self.block_start &= np.count_nonzero(columns) == np.count_nonzero(block)
            count.append(len(subset_ids) - first[-1])
            if count[-1] == 0:
                raise InputError(f"contacts[{k}]: no mode of this contact has independent columns")
        self.start_subset = np.array(subset_ids, dtype=np.int64)
        self.start_inverse = np.ascontiguousarray(np.moveaxis(np.array(inverses), 0, -1))
        self.start_first = np.array(first, dtype=np.int64)
        self.start_count = np.array(count, dtype=np.int64)
        self.lifts = np.any(self.acceleration_matrix[:: self.support.dimension] > 0, axis=0)
        # sliding is guessed to go against the forces of a base that is glued to the ground
        d = self.support.dimension
        tangential = np.ones(len(self.motion_rows), dtype=bool)
        tangential[::d] = False
        self.hint_matrix = self.rhs_matrix.copy()
        self.hint_matrix[self.motion_rows[tangential]] = np.linalg.pinv(self.support.wrench_matrix)[
            tangential
        ]

    def active_columns(self, subsets: np.ndarray) -> np.ndarray:
        """Columns (N, m) of the basic variables in canonical order, for the contacts' subsets (N, n)."""
        parts = [
            contact.automaton.subsets[subsets[:, k]] + self.first_column[k]
            for k, contact in enumerate(self.support.contacts)
        ]
        return np.hstack(parts)

    @cached_property
    def one(self) -> tuple[tuple[int], int, int]:
        """Shape of a wrench, and how many integers and numbers `pivoting.solve_batch` writes for one."""
        (n,), m, w = self.first_column.shape, len(self.rhs_offset), self.support.wrench_size
        return (w,), n + 3, w + m + 1 + 2 * n * self.support.dimension

    @cached_property
    def tables(self) -> tuple[np.ndarray, np.ndarray]:
        """The system as `pivoting` takes it."""
        return packed(self)
