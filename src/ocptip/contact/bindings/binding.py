"""The interface of contact models: a pool of non-negative scalars and the subsets that are its modes.

A new contact model is one subclass of :class:`Binding`; nothing else has to be changed. The solver, the
verdicts, the margins and the command line only use what is declared here.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ocptip.basics.errors import (
    BindingDefinitionError,
    InputError,
    bounded_array,
    finite_array,
    positive_number,
    refuse_huge,
)
from ocptip.basics.frozen import settle
from ocptip.contact.bindings import pyramid
from ocptip.contact.bindings.automaton import Automaton, Mode, build_automaton

LARGEST_FRICTION = 1e3
"""Largest friction coefficient: rubber has 1 to 2, what interlocks perhaps 10."""

TANGENTIAL_SHARE = 2 / 3
"""Tangential over normal stiffness where only the normal one is given: 2 (1 - nu) / (2 - nu) of Mindlin's
contact for rubber, nu = 0.5; steel has 0.82."""

DAMPING_RATIO = 0.05
"""Damping ratio of a compliant contact where none is given."""

_NORMAL_TOLERANCE = 1e-12


@dataclass(frozen=True)
class PoolVariable:
    """A non-negative scalar of a contact model and how it enters the equations.

    Attributes:
        name: name used in the mode list, e.g. "g1" (acceleration), "l1" (force), "lb" (auxiliary).
        acceleration: its contribution to the contact point's acceleration, components (n, t1, t2) or
            (n, t) in the plane; None for none.
        force: its contribution to the contact force, same components; None for none.
        auxiliary: its coefficient in each auxiliary row of the contact model.
    """

    name: str
    acceleration: np.ndarray | None = None
    force: np.ndarray | None = None
    auxiliary: tuple[float, ...] = ()


@dataclass(frozen=True)
class ForcePiece:
    """A convex piece of the set of contact forces at which the contact can rest.

    All forces with `normal_min <= K_n <= normal_max`, `|K_t| <= radius + slope K_n`, and a force along t1 of
    at most `along`: 0 of a wheel that rolls freely, N.
    """

    normal_min: float
    normal_max: float
    radius: float
    slope: float
    along: float = np.inf


@dataclass(frozen=True, eq=False)
class Spring:
    """A contact that gives: springs and dampers along the contact's axes.

    Attributes:
        stiffness: (d,) along (n, t1, t2), N/m.
        delay: damping over stiffness, s, as far as it is given so.
        ratio: damping ratio of the lowest mode, else.
        lowest: normal force, N, below which the contact lets go and exerts just that force: 0 for a foot,
            minus the preload for a clamp with one yielding jaw, minus infinity for a rigid clamp.
    """

    stiffness: np.ndarray
    delay: float
    ratio: float
    lowest: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Binding(ABC):
    """A contact of the base with the ground at one point.

    Subclasses are decorated with `@dataclass(frozen=True, kw_only=True, eq=False)`, have a `kind` (the word
    used in scene files) and implement the abstract methods. Their forces must never do positive work
    on the contact's acceleration (`stability` relies on it).

    The first sentence on each attribute is the meaning of the key in scene files.

    Attributes:
        position: contact point in base axes, m; shape (3,), or (2,) for a planar support.
        normal: direction from the environment into the base; same shape, normalised on construction.
        facets: number of faces of the friction pyramid, at least 3; no meaning in the plane.
        tangent: direction of t1 in base axes, projected into the tangent plane; optional; the first face
            of the pyramid points there. Default: the base axis x, or y where x is close to the normal.
        stiffness: stiffness along the normal of foot and ground, or of the clamped part, N/m; None: rigid.
        tangential_stiffness: stiffness across the normal, N/m; default `TANGENTIAL_SHARE` of the normal one;
            in directions without friction none.
        damping_ratio: damping ratio of the lowest mode of base and mechanism, 0 to 1; at the start of a
            motion, if all contacts have this ratio. The contact's damper is proportional to its spring.
            Default `DAMPING_RATIO`.
        damping: damping along the normal, N s/m, instead of the ratio; across it in proportion to the
            stiffness.
    """

    kind: ClassVar[str]
    registry: ClassVar[dict[str, type[Binding]]] = {}

    position: Sequence[float] | np.ndarray = field()
    normal: Sequence[float] | np.ndarray = field(default=(0.0, 0.0, 1.0))
    facets: int = 8
    tangent: Sequence[float] | np.ndarray | None = None
    stiffness: float | None = None
    tangential_stiffness: float | None = None
    damping_ratio: float | None = None
    damping: float | None = None

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        kind = cls.__dict__.get("kind")
        if kind is not None:
            Binding.registry[kind] = cls

    def __post_init__(self) -> None:
        position = bounded_array("position", self.position, (None,))
        if position.size not in (2, 3):
            raise InputError(f"position: expected 2 or 3 numbers, got {position.size}")
        normal = finite_array("normal", self.normal, (None,))
        if position.size == 2 and normal.size == 3:
            raise InputError("position: has 2 numbers, normal has 3; both have 3, or both 2 in the plane")
        normal = finite_array("normal", normal, (position.size,))
        length = float(np.linalg.norm(normal))
        if length < _NORMAL_TOLERANCE:
            raise InputError(f"normal: must not be zero, got {list(self.normal)}")
        settle(self, position=position, normal=normal / length)
        if position.size == 3:
            settle(self, facets=pyramid.check_facets(self.facets))
        else:
            settle(self, facets=2)
        if self.tangent is not None:
            tangent = finite_array("tangent", self.tangent, (position.size,))
            tangent = tangent - self.normal * (self.normal @ tangent)
            if np.linalg.norm(tangent) < 1e-9:
                raise InputError(f"tangent: must not be parallel to the normal, got {list(self.tangent)}")
            settle(self, tangent=tangent / np.linalg.norm(tangent))
        self._check_spring()
        self.check_parameters()

    def _check_spring(self) -> None:
        names = ("tangential_stiffness", "damping_ratio", "damping")
        given = [name for name in names if getattr(self, name) is not None]
        if self.stiffness is None:
            if given:
                raise InputError(f"{given[0]}: needs stiffness; give that as well")
            return
        positive_parameters(self, "stiffness")
        if self.damping is not None and self.damping_ratio is not None:
            raise InputError("damping: give either damping or damping_ratio")
        for name in given:
            number = positive_number(name, getattr(self, name), zero_allowed=name != "tangential_stiffness")
            refuse_huge(name, number)
            settle(self, **{name: number})
        if self.damping_ratio is not None and self.damping_ratio >= 1:
            raise InputError(f"damping_ratio: must be below 1 (5 %: 0.05), got {self.damping_ratio:g}")

    @abstractmethod
    def check_parameters(self) -> None:
        """Check the physical parameters of the subclass; raise InputError naming the parameter."""

    @abstractmethod
    def pool(self) -> list[PoolVariable]:
        """The non-negative scalars of the contact model."""

    @abstractmethod
    def modes(self) -> list[Mode]:
        """Admissible subsets of the pool, and the redundant ones that close the list."""

    @abstractmethod
    def force_pieces(self) -> list[ForcePiece]:
        """Convex pieces (Coulomb's true cones) of the set of contact forces without motion."""

    def force_offset(self) -> np.ndarray:
        """Constant part of the contact force, components (n, t1, t2), N."""
        return np.zeros(self.dimension)

    def auxiliary_rhs(self) -> tuple[float, ...]:
        """Right-hand sides of the auxiliary rows, N."""
        return ()

    def spring(self) -> Spring | None:
        """The compliance of the contact while it presses; None: it is rigid."""
        if self.stiffness is None:
            return None
        pieces = self.force_pieces()
        across = self.tangential_stiffness or TANGENTIAL_SHARE * self.stiffness
        grips = any(piece.radius or piece.slope for piece in pieces)
        stiffness = np.full(self.dimension, across if grips else 0.0)
        stiffness[0] = self.stiffness
        if any(piece.along == 0 for piece in pieces):
            stiffness[1] = 0.0
        lowest = min(piece.normal_min for piece in pieces)
        if self.damping is not None:
            return Spring(stiffness, self.damping / self.stiffness, 0.0, lowest)
        ratio = DAMPING_RATIO if self.damping_ratio is None else self.damping_ratio
        return Spring(stiffness, 0.0, ratio, lowest)

    def power(self) -> float:
        """W, drawn for as long as the contact holds."""
        return 0.0

    @property
    def dimension(self) -> int:
        """3 in space, 2 in the plane."""
        return len(self.position)

    @property
    def planar(self) -> bool:
        """True for a contact of a planar support."""
        return self.dimension == 2

    @cached_property
    def frame(self) -> np.ndarray:
        """Orthonormal contact frame, columns n, t1, t2 (n, t in the plane) in base axes."""
        n = self.normal
        if self.planar:
            return np.column_stack([n, [n[1], -n[0]]])
        t1 = self.tangent
        if t1 is None:
            t1 = np.eye(3)[0 if abs(n[0]) < 0.9 else 1]
            t1 = t1 - n * (n @ t1)
            t1 = t1 / np.linalg.norm(t1)
        return np.column_stack([n, t1, np.cross(n, t1)])

    @cached_property
    def automaton(self) -> Automaton:
        """The mode automaton derived from the mode list (closedness is checked here)."""
        return build_automaton(self.kind, tuple(v.name for v in self.pool()), tuple(self.modes()))

    @cached_property
    def columns(self) -> Columns:
        """The pool as matrices; checked against the size of the subsets."""
        return Columns.of(self)

    @classmethod
    def parameter_names(cls) -> list[str]:
        """Names of all constructor arguments."""
        return [f.name for f in fields(cls) if f.init]


@dataclass(frozen=True)
class Columns:
    """The pool of a contact model as matrices.

    Attributes:
        names: pool variable names.
        acceleration: (d, p) contact acceleration per unit of each variable, in contact axes.
        force: (d, p) contact force per unit of each variable, in contact axes.
        auxiliary: (r, p) coefficients of the auxiliary rows.
        is_acceleration: (p,) True where the variable is an acceleration (m/s^2).
    """

    names: tuple[str, ...]
    acceleration: np.ndarray
    force: np.ndarray
    auxiliary: np.ndarray
    is_acceleration: np.ndarray

    @classmethod
    def of(cls, binding: Binding) -> Columns:
        pool = binding.pool()
        d, p = binding.dimension, len(pool)
        rows = len(binding.auxiliary_rhs())
        acceleration, force, auxiliary = np.zeros((d, p)), np.zeros((d, p)), np.zeros((rows, p))
        for j, variable in enumerate(pool):
            if variable.acceleration is not None:
                acceleration[:, j] = variable.acceleration
            if variable.force is not None:
                force[:, j] = variable.force
            if variable.auxiliary:
                auxiliary[:, j] = variable.auxiliary
        size = binding.automaton.subsets.shape[1]
        if size != d + rows:
            raise BindingDefinitionError(
                f"{binding.kind}: subsets have {size} elements, but there are {d} + {rows} equations"
            )
        return cls(
            names=tuple(v.name for v in pool),
            acceleration=acceleration,
            force=force,
            auxiliary=auxiliary,
            is_acceleration=np.array([v.acceleration is not None for v in pool]),
        )


def positive_parameters(binding: Binding, *names: str) -> None:
    """Check that the named parameters of a contact are positive finite numbers and store them as floats."""
    for name in names:
        number = positive_number(name, getattr(binding, name))
        refuse_huge(name, number)
        settle(binding, **{name: number})


def friction_parameters(binding: Binding, *names: str) -> None:
    """As `positive_parameters`, for friction coefficients: up to `LARGEST_FRICTION`."""
    positive_parameters(binding, *names)
    for name in names:
        if getattr(binding, name) > LARGEST_FRICTION:
            raise InputError(
                f"{name}: must be <= {LARGEST_FRICTION:g} (rubber has 1 to 2, what interlocks 10), got "
                f"{getattr(binding, name):g}"
            )


def normal_vector(binding: Binding, sign: float = 1.0) -> np.ndarray:
    """Unit vector along the normal in contact axes, times `sign`."""
    vector = np.zeros(binding.dimension)
    vector[0] = sign
    return vector


def sliding_variables(binding: Binding) -> list[PoolVariable]:
    """Tangential acceleration variables: g1..gS along -s_h, or g- and g+ in the plane (3.10)."""
    if binding.planar:
        return [
            PoolVariable("g-", acceleration=np.array([0.0, -1.0])),
            PoolVariable("g+", acceleration=np.array([0.0, 1.0])),
        ]
    directions = pyramid.face_directions(binding.facets)
    return [
        PoolVariable(f"g{h + 1}", acceleration=np.array([0.0, -s[0], -s[1]]))
        for h, s in enumerate(directions)
    ]


def edge_vectors(binding: Binding, friction: float, side: float = 1.0) -> np.ndarray:
    """Edge vectors of the friction pyramid (S, 3) or planar cone (2, 2), see `pyramid.edges`."""
    if binding.planar:
        return pyramid.planar_edges(friction, side)
    return pyramid.edges(friction, binding.facets, side)
