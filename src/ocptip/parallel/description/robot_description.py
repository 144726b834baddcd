"""Description of a parallel robot: leg tables, base frames, coupling points, platform, motors.

Entries of tables are numbers or named parameters, see `entries`. The same name in several legs is the same
symbol and must have the same value.

Legs, joints and bodies are counted from 0 in the code, and from 1 in messages and files.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ocptip.basics.errors import InputError, finite_array, positive_number, rotation_matrix
from ocptip.basics.frozen import settle
from ocptip.parallel.description.platform import (
    BodyInertia,
    Entry,
    Parameter,
    Platform,
    check_entries,
    check_entry,
    elementary_rotations,
    product_of,
    value_of,
)
from ocptip.robots.payload import Payload

REVOLUTE, PRISMATIC, FIXED = 0, 1, 2

DYNPAR2 = ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M")


@dataclass(frozen=True)
class MDHRow:
    """One joint: transformation from frame a(j) to frame j (2.11),

    T = Rz(gamma) Tz(b) Rx(alpha) Tx(d) Rz(theta) Tz(r); the joint variable is added to theta (revolute) or r.

    Attributes:
        sigma: 0 revolute, 1 prismatic, 2 fixed (only where a leg ends rigidly at the platform).
        gamma, alpha, theta: rad.
        b, d, r: m.
        range: smallest and largest joint position, rad or m, which workspaces keep to.
    """

    sigma: int = REVOLUTE
    gamma: Entry = 0.0
    b: Entry = 0.0
    alpha: Entry = 0.0
    d: Entry = 0.0
    theta: Entry = 0.0
    r: Entry = 0.0
    range: tuple[float, float] = (-math.inf, math.inf)

    def __post_init__(self) -> None:
        if isinstance(self.sigma, bool) or self.sigma not in (REVOLUTE, PRISMATIC, FIXED):
            raise InputError(f"sigma: must be 0 (revolute), 1 (prismatic) or 2 (fixed), got {self.sigma!r}")
        names = ("gamma", "b", "alpha", "d", "theta", "r")
        settle(
            self, sigma=int(self.sigma), **{name: check_entry(name, getattr(self, name)) for name in names}
        )
        low, high = (float(value) for value in self.range)
        if not low < high:
            raise InputError(f"range: expected the smallest and the largest position, got {low:g}, {high:g}")
        settle(self, range=(low, high))

    @property
    def entries(self) -> tuple[Entry, ...]:
        """gamma, b, alpha, d, theta, r."""
        return (self.gamma, self.b, self.alpha, self.d, self.theta, self.r)


class LegBase(ABC):
    """The data that all legs have: joints, a base frame, and ends at the platform.

    Attributes:
        serial: one chain, whose first joints alone place its coupling point.
        branch: signs that choose among closed-form solutions.
    """

    serial = False
    branch: tuple[int, ...] = ()
    rows: tuple[MDHRow, ...]
    bodies: tuple[BodyInertia, ...]
    loops: tuple[tuple[int, int], ...] = ()
    drive_inertia: tuple[float, ...]
    viscous: tuple[float, ...]
    coulomb: tuple[float, ...]
    base_rotation: tuple[tuple[str, Entry], ...]
    base_position: tuple[Entry, ...]
    guess: tuple[float, ...]
    idle: int

    @property
    @abstractmethod
    def tree(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """The row from which each row starts, -1 for the base frame; the rows at the platform, then loops."""

    @property
    @abstractmethod
    def couplings(self) -> list[tuple[np.ndarray, np.ndarray | None]]:
        """Per end its coupling point (3,), m, and its rotation (3, 3), see `SerialLeg`."""

    @property
    @abstractmethod
    def point_joints(self) -> int:
        """Number of joints up to the coupling point."""

    @property
    def joint_rows(self) -> tuple[MDHRow, ...]:
        """Rows of all joints, coupling joints included."""
        return tuple(row for row in self.rows if row.sigma != FIXED)

    @property
    def n_joints(self) -> int:
        """Number of all joints."""
        return len(self.joint_rows)

    def _check_base(self, count: int, sizes: Sequence[int]) -> None:
        """Check what all legs have.

        Args:
            count: of joints or rows that may have drive inertia and friction.
            sizes: numbers of joints that a guess may hold.
        """
        settle(
            self,
            base_rotation=elementary_rotations("base_rotation", self.base_rotation),
            base_position=check_entries("base_position", self.base_position),
            guess=tuple(finite_array("guess", self.guess, (None,)).tolist()),
        )
        for name in ("drive_inertia", "viscous", "coulomb"):
            settle(self, **{name: joint_numbers(name, getattr(self, name), count)})
        if isinstance(self.idle, bool) or not isinstance(self.idle, int) or self.idle < 0:
            raise InputError(f"idle: expected a whole number >= 0, got {self.idle!r}")
        if len(self.guess) not in (0, *sizes):
            wanted = " or ".join(map(str, sizes))
            raise InputError(f"guess: expected {wanted} numbers, got {len(self.guess)}")

    @property
    def base_matrix(self) -> np.ndarray:
        """(3, 3) leg base axes to world axes, R_A."""
        return product_of(self.base_rotation)

    @property
    def origin(self) -> np.ndarray:
        """(3,), m, world axes: origin of the leg's base frame, r_A."""
        return np.array([value_of(e) for e in self.base_position])


@dataclass(frozen=True, eq=False)
class SerialLeg(LegBase):
    """A serial leg from the base to the platform.

    Attributes:
        rows: MDH rows of all joints, the coupling joints at the platform included; row n (from 0) belongs to
            the coupling frame, whose origin is the coupling point.
        n: number of joints up to the coupling point, 1 <= n < len(rows).
        bodies: inertias of bodies 1..n; more, up to one per row, if coupling bodies have mass.
        base_rotation: elementary rotations (axis, angle) whose product turns leg base axes to world axes.
        base_position: (3,) entries, m: origin of the base frame, world axes.
        coupling: (3,) entries, m: coupling point in the platform frame (kappa).
        end_rotation: (3, 3) platform axes to the last frame of the leg. None: the robot is assembled in its
            home pose with the coupling joints as `guess` says, or at zero; but a universal joint so that its
            second axis is parallel to the leg's first turning axis, where it can be, and a spherical one
            with its middle axis at a quarter turn, where its axes would coincide.
        drive_inertia, viscous, coulomb: one number per row: inertia of the drive seen at the joint (kg m^2 or
            kg), viscous and Coulomb friction; empty: none.
        branch: signs that choose among closed-form solutions, see `parallel.kinematics.closed_form`; empty:
            all positive.
        guess: joint values near the home pose, for tables without a closed form; empty: searched.
        idle: freedoms that neither platform nor motors notice: the spin of a leg between two ball joints.
    """

    serial = True
    rows: tuple[MDHRow, ...]
    n: int
    bodies: tuple[BodyInertia, ...]
    base_rotation: tuple[tuple[str, Entry], ...] = ()
    base_position: tuple[Entry, ...] = (0.0, 0.0, 0.0)
    coupling: tuple[Entry, ...] = (0.0, 0.0, 0.0)
    end_rotation: np.ndarray | None = None
    drive_inertia: tuple[float, ...] = ()
    viscous: tuple[float, ...] = ()
    coulomb: tuple[float, ...] = ()
    branch: tuple[int, ...] = ()
    guess: tuple[float, ...] = ()
    idle: int = 0

    def __post_init__(self) -> None:
        rows = tuple(self.rows)
        for number, row in enumerate(rows, start=1):
            if not isinstance(row, MDHRow):
                raise InputError(f"rows[{number}]: expected an MDHRow, got {type(row).__name__}")
        count = len(rows)
        if isinstance(self.n, bool) or not isinstance(self.n, int) or not 1 <= self.n < count:
            raise InputError(
                f"n: joints up to the coupling point, must be 1..{count - 1} for {count} rows (the row after "
                f"the last one places the coupling point), got {self.n!r}"
            )
        fixed = [number for number, row in enumerate(rows, start=1) if row.sigma == FIXED]
        if fixed and (fixed != [count] or self.n != count - 1):
            raise InputError(f"rows[{fixed[0]}].sigma: only the row of the coupling point may be fixed")
        self._check_coupling(rows)
        bodies = tuple(self.bodies)
        if not self.n <= len(bodies) <= count or not all(isinstance(b, BodyInertia) for b in bodies):
            raise InputError(f"bodies: expected {self.n} to {count} BodyInertia, got {len(bodies)} values")
        settle(self, rows=rows, bodies=bodies, branch=tuple(self.branch))
        self._check_base(count, (self.n, self.n_joints))
        settle(self, coupling=check_entries("coupling", self.coupling))
        if self.end_rotation is not None:
            settle(self, end_rotation=rotation_matrix("end_rotation", self.end_rotation))
        if any(sign not in (1, -1) for sign in self.branch):
            raise InputError(f"branch: expected signs 1 or -1, got {self.branch!r}")

    def _check_coupling(self, rows: tuple[MDHRow, ...]) -> None:
        for number, row in enumerate(rows[self.n :], start=self.n + 1):
            offsets = (row.b, row.d, row.r) if number > self.n + 1 else ()
            if row.sigma == PRISMATIC or any(isinstance(v, Parameter) or v != 0 for v in offsets):
                raise InputError(
                    f"rows[{number}]: the joints behind the coupling point must turn about it; give n = "
                    f"{number - 1} or more if this joint moves the point"
                )

    @property
    def tree(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        return tuple(range(-1, len(self.rows) - 1)), (len(self.rows) - 1,)

    @property
    def couplings(self) -> list[tuple[np.ndarray, np.ndarray | None]]:
        return [(self.coupling_point, self.end_rotation)]

    @property
    def point_joints(self) -> int:
        return self.n

    @property
    def coupling_point(self) -> np.ndarray:
        """(3,), m, platform axes: kappa."""
        return np.array([value_of(e) for e in self.coupling])

    @property
    def entries(self) -> tuple[Entry, ...]:
        """All entries of the leg's geometry."""
        table = [entry for row in self.rows for entry in row.entries]
        angles = [angle for _, angle in self.base_rotation]
        return (*table, *angles, *self.base_position, *self.coupling)


@dataclass(frozen=True, eq=False)
class RobotDescription:
    """Everything that defines a parallel robot.

    Attributes:
        name: for messages and titles.
        legs: the legs.
        platform: the platform.
        actuated: (leg, joint) pairs from 0, in the order of the motor forces.
        home: (m,) coordinates of a pose in the workspace, m and rad: the platform's free ones, then the
            redundant joints'.
        gravity: (3,), m/s^2, world axes.
        redundant: (leg, joint) pairs whose positions are coordinates besides the platform's, because the
            platform's pose does not fix them (kinematic redundancy).
        dependent_home: values of the platform's dependent coordinates in the home pose, m and rad; empty:
            zeros. Near is enough: they are made to close the legs.
    """

    name: str
    legs: tuple[SerialLeg, ...]
    platform: Platform
    actuated: tuple[tuple[int, int], ...]
    home: np.ndarray
    gravity: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))
    redundant: tuple[tuple[int, int], ...] = ()
    dependent_home: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        legs = tuple(self.legs)
        if not legs:
            raise InputError("legs: a parallel robot needs at least one leg")
        settle(self, legs=legs)
        if not isinstance(self.platform, Platform):
            raise InputError(f"platform: expected a Platform, got {type(self.platform).__name__}")
        settle(self, actuated=self._pairs("actuated"))
        if not self.actuated:
            raise InputError("actuated: a robot needs at least one motor")
        settle(self, redundant=self._pairs("redundant"), gravity=finite_array("gravity", self.gravity, (3,)))
        along = len(self.platform.dependent_coordinates)
        if along and self.redundant:
            raise InputError("redundant: a platform with dependent coordinates cannot have redundant joints")
        settle(self, home=finite_array("home", self.home, (self.m,)))
        if len(self.dependent_home) == 0:
            settle(self, dependent_home=np.zeros(along))
        settle(self, dependent_home=finite_array("dependent_home", self.dependent_home, (along,)))
        _ = self.parameters

    def _pairs(self, name: str) -> tuple[tuple[int, int], ...]:
        pairs = []
        for number, pair in enumerate(getattr(self, name), start=1):
            try:
                leg, joint = (int(v) for v in pair)
            except (TypeError, ValueError):
                raise InputError(f"{name}[{number}]: expected (leg, joint), got {pair!r}") from None
            if not 0 <= leg < len(self.legs):
                raise InputError(f"{name}[{number}]: there is no leg {leg + 1}, only {len(self.legs)}")
            if not 0 <= joint < self.legs[leg].n_joints:
                raise InputError(
                    f"{name}[{number}]: leg {leg + 1} has {self.legs[leg].n_joints} joints, got {joint + 1}"
                )
            pairs.append((leg, joint))
        if len(set(pairs)) != len(pairs):
            raise InputError(f"{name}: a joint is listed twice: {getattr(self, name)!r}")
        return tuple(pairs)

    @property
    def m(self) -> int:
        """Number of coordinates: free ones of the platform and redundant joints."""
        return self.platform.m + len(self.redundant)

    def with_payload(self, payload: Payload | None) -> RobotDescription:
        """This robot with another payload of its platform; None: without payload."""
        return replace(self, platform=self.platform.with_payload(payload))

    def with_joint_ranges(self, ranges: Mapping[int, tuple[float, float]]) -> RobotDescription:
        """The same robot; joint number (from 0), of every leg that has it -> its range, rad or m."""
        legs = []
        for leg in self.legs:
            joints = iter(range(len(leg.rows)))
            rows = [
                row
                if row.sigma == FIXED or (joint := next(joints)) not in ranges
                else replace(row, range=ranges[joint])
                for row in leg.rows
            ]
            legs.append(replace(leg, rows=tuple(rows)))
        if unknown := [k for k in ranges if not 0 <= k < max(leg.n_joints for leg in self.legs)]:
            raise InputError(f"range: no leg has a joint {unknown[0] + 1}")
        return replace(self, legs=tuple(legs))

    @property
    def moving_mass(self) -> float:
        """Mass of platform and legs, kg."""
        return self.platform.inertia.mass + sum(body.mass for leg in self.legs for body in leg.bodies)

    @property
    def motor_rows(self) -> tuple[MDHRow, ...]:
        """Rows of the motors' joints."""
        return tuple(self.legs[leg].joint_rows[joint] for leg, joint in self.actuated)

    @property
    def parameters(self) -> dict[str, float]:
        """Named parameters and their values, in the order in which they first appear."""
        table: dict[str, float] = {}
        for leg in self.legs:
            for entry in leg.entries:
                if isinstance(entry, Parameter):
                    known = table.setdefault(entry.name, entry.value)
                    if known != entry.value:
                        raise InputError(
                            f"parameter {entry.name}: has the values {known} and {entry.value}; equal names "
                            "mean the same parameter"
                        )
        return table

    @property
    def position_rows(self) -> tuple[int, ...]:
        """Free translations (0, 1, 2): the rows of the position closure."""
        return tuple(i for i in range(3) if self.platform.mask[i])

    @property
    def coupling_obstacle(self) -> str:
        """Why the coupling-point formulation (3.42) does not apply, "" if it does; names the leg from 1.

        Only if every leg has as many joints up to its coupling point as there are free translations is J_B
        square; else the complete legs are needed.
        """
        rows = len(self.position_rows)
        if along := self.platform.dependent_coordinates:
            return f"the platform has dependent coordinates ({', '.join(along)})"
        for number, leg in enumerate(self.legs, start=1):
            if not leg.serial:
                return f"leg {number} is branched or has closed loops"
            if leg.n != rows:
                return f"leg {number} has {leg.n} joints up to its coupling point, not {rows}"
            if leg.idle:
                return f"leg {number} has idle freedoms"
        for leg, joint in self.actuated:
            if joint >= self.legs[leg].n:
                return f"leg {leg + 1} has a motor on joint {joint + 1}, behind its coupling point"
        return "joints are redundant" if self.redundant else ""

    @property
    def coupling_form(self) -> bool:
        """True if the coupling-point formulation (3.42) applies, see `coupling_obstacle`."""
        return not self.coupling_obstacle

    @property
    def inertia_vector(self) -> np.ndarray:
        """DynPar 2 of all bodies: leg by leg bodies 1..n, the platform last, 10 numbers each."""
        legs = [body.vector for leg in self.legs for body in leg.bodies]
        return np.concatenate([*legs, self.platform.inertia.vector])


def joint_numbers(name: str, values: Sequence[float], count: int) -> tuple[float, ...]:
    """Check numbers >= 0, one per row; missing ones are zero."""
    if len(values) == 0:
        return (0.0,) * count
    if len(values) > count:
        raise InputError(f"{name}: expected at most {count} numbers, one per row, got {len(values)}")
    checked = [positive_number(f"{name}[{i}]", v, zero_allowed=True) for i, v in enumerate(values, start=1)]
    return (*checked, *[0.0] * (count - len(checked)))
