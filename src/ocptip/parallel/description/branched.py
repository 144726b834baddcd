"""Branched legs, with inner loops, such as the arm of a Delta robot with its two parallel rods."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocptip.basics.errors import InputError, rotation_matrix
from ocptip.basics.frozen import settle
from ocptip.parallel.description.platform import BodyInertia, Entry, check_entries, value_of
from ocptip.parallel.description.robot_description import LegBase, MDHRow


@dataclass(frozen=True, eq=False)
class LegEnd:
    """A frame of a branched leg that is fixed on the platform.

    Attributes:
        row: of the frame (from 0); its origin is the coupling point.
        coupling: (3,) entries, m, platform frame.
        end_rotation: (3, 3) platform axes to the frame, or None: the end is free to turn about the coupling
            point, which stands for a spherical joint without mass.
    """

    row: int
    coupling: tuple[Entry, ...]
    end_rotation: np.ndarray | None = None

    def __post_init__(self) -> None:
        settle(self, coupling=check_entries("coupling", self.coupling))
        if self.end_rotation is not None:
            settle(self, end_rotation=rotation_matrix("end_rotation", self.end_rotation))

    @property
    def coupling_point(self) -> np.ndarray:
        """(3,), m, platform axes."""
        return np.array([value_of(e) for e in self.coupling])


@dataclass(frozen=True, eq=False)
class BranchedLeg(LegBase):
    """A leg whose bodies form a tree, with one or more ends at the platform and optional inner loops.

    Attributes:
        rows: MDH rows; `rows[k]` starts from the frame of row `parents[k]` (2.11, the column a(j)).
        parents: one per row, -1 for the base frame, always before the row itself.
        ends: where the leg meets the platform.
        bodies: one inertia per row, from the first one; missing ones have no mass.
        loops: pairs of rows whose origins coincide (inner loops).
        base_rotation, base_position: as in :class:`ocptip.parallel.description.robot_description.SerialLeg`.
        drive_inertia, viscous, coulomb: per joint, as in `SerialLeg`; fixed rows are not counted.
        guess: joint values near the home pose; empty: searched.
        idle: as in `SerialLeg`.
    """

    rows: tuple[MDHRow, ...]
    parents: tuple[int, ...]
    ends: tuple[LegEnd, ...]
    bodies: tuple[BodyInertia, ...]
    loops: tuple[tuple[int, int], ...] = ()
    base_rotation: tuple[tuple[str, Entry], ...] = ()
    base_position: tuple[Entry, ...] = (0.0, 0.0, 0.0)
    drive_inertia: tuple[float, ...] = ()
    viscous: tuple[float, ...] = ()
    coulomb: tuple[float, ...] = ()
    guess: tuple[float, ...] = ()
    idle: int = 0

    def __post_init__(self) -> None:
        rows = tuple(self.rows)
        count = len(rows)
        if not rows or not all(isinstance(row, MDHRow) for row in rows):
            raise InputError("rows: expected at least one MDHRow")
        parents = tuple(self.parents)
        if len(parents) != count or any(not -1 <= p < k for k, p in enumerate(parents)):
            raise InputError(
                f"parents: expected one earlier row (or -1) for each of {count} rows, got {parents}"
            )
        settle(self, rows=rows, parents=parents)
        if not self.ends:
            raise InputError("ends: a leg needs at least one end at the platform")
        for number, end in enumerate(self.ends, start=1):
            if not 0 <= end.row < count:
                raise InputError(f"ends[{number}].row: there is no row {end.row + 1}, only {count}")
        for number, pair in enumerate(self.loops, start=1):
            for row in pair:
                if not 0 <= row < count:
                    raise InputError(f"loops[{number}]: there is no row {row + 1}, only {count}")
        bodies = tuple(self.bodies)
        if not 1 <= len(bodies) <= count or not all(isinstance(b, BodyInertia) for b in bodies):
            raise InputError(f"bodies: expected 1 to {count} BodyInertia, got {len(bodies)} values")
        settle(self, ends=tuple(self.ends), loops=tuple(map(tuple, self.loops)), bodies=bodies)
        self._check_base(self.n_joints, (self.n_joints,))

    @property
    def tree(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        return self.parents, (*(end.row for end in self.ends), *(row for pair in self.loops for row in pair))

    @property
    def couplings(self) -> list[tuple[np.ndarray, np.ndarray | None]]:
        return [(end.coupling_point, end.end_rotation) for end in self.ends]

    @property
    def point_joints(self) -> int:
        return self.n_joints

    @property
    def entries(self) -> tuple[Entry, ...]:
        """All entries of the leg's geometry."""
        table = [entry for row in self.rows for entry in row.entries]
        points = [entry for end in self.ends for entry in end.coupling]
        return (*table, *[angle for _, angle in self.base_rotation], *self.base_position, *points)
