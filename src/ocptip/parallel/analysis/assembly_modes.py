"""All assembly modes of a parallel robot: every pose of the platform for given positions of the motors.

The pose is a pair of quaternions (e, h), e . h = 0, with R = e (.) e* / |e|^2 and r = h e* / |e|^2 (Study's
coordinates, h is twice his second quaternion). With the motors locked each coupling point stays on a sphere
or in planes, and both are quadratic in them (Wampler, Mechanism and Machine Theory 31, 1996):

    |r + R k - c|^2 = l^2:   |h|^2 + (|k|^2 + |c|^2 - l^2) |e|^2 + 2 h.(e k) - 2 h.(c e) - 2 (c e).(e k) = 0
    n . (r + R k) = d:       h.(n e) + (n e).(e k) - d |e|^2 = 0
    a . R u = c:             (a e).(e u) - c |e|^2 = 0
    n . R' (b - r) = d:      (b e).(e n) - h.(e n) - d |e|^2 = 0

so a hexapod is seven quadratic equations in projective space, with 40 solutions besides those at e = 0.
`numerics.quadrics` follows all solutions of a random complex robot of the kind to those of the given one.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError, SolverError, finite_array
from ocptip.basics.write import Record
from ocptip.numerics.quadrics import Deformation, distinct, follow, polished, total_degree
from ocptip.numerics.vectors import nearest_turn
from ocptip.parallel.analysis.leg_surfaces import (
    LegSurface,
    angle_form,
    held_leg,
    leg_surface,
    plane_form,
    position_of,
    slot_form,
    sphere_form,
)
from ocptip.parallel.description.robot_description import REVOLUTE
from ocptip.parallel.kinematics.platform import Kinematics

_SEED = 1996
_REAL = 1e-7
_AT_INFINITY = 1e-7
_CLOSED = 1e-7
_FORMS = {"sphere": sphere_form, "plane": plane_form, "angle": angle_form, "slot": slot_form}


@dataclass(frozen=True, eq=False)
class AssemblyMode(Record):
    """A pose of the platform.

    Attributes:
        z: all coordinates of the platform that move: the free ones, then the dependent ones, m and rad.
        position: (3,), m; rotation: (3, 3), platform axes to world axes.
        residual: how far the coupling points are from where the locked legs let them be, m. `certified`:
        Kantorovich's theorem proves that there is a pose, and no other one nearby.
        home_branches: True if the legs reach it with the IK solutions of the home pose, False if with others;
            None where that was not checked (dependent coordinates).
    """

    z: np.ndarray
    position: np.ndarray
    rotation: np.ndarray
    residual: float
    certified: bool
    home_branches: bool | None


@dataclass(frozen=True, eq=False)
class AssemblyModes(Record):
    """All of them, with the count that shows it.

    Attributes:
        qa: (n_a,) motor positions, rad or m.
        modes: real poses.
        paths: solutions of a general robot of this kind, in complex numbers; each was followed to its end.
        regular: ends that are isolated solutions, real ones among them.
        at_infinity: ends that are no poses.
        singular: ends in singular solutions: poses where the locked motors do not hold the platform, which
            `modes` does not list.
        out_of_reach: real ones that a leg does not reach.
        seconds: CPU time.
    """

    qa: np.ndarray
    modes: tuple[AssemblyMode, ...]
    paths: int
    regular: int
    at_infinity: int
    singular: int
    out_of_reach: int
    seconds: float

    @property
    def complete(self) -> bool:
        """True if all paths ended in different regular solutions, or where there is no pose.

        Then there are no others: with probability one, since the paths begin at a random robot.
        """
        return self.regular + self.at_infinity == self.paths

    def to_dict(self) -> dict[str, object]:
        """Plain data."""
        return {**super().to_dict(), "complete": self.complete}


def assembly_modes(kinematics: Kinematics, qa: ArrayLike) -> AssemblyModes:
    """All poses for given motor positions.

    Args:
        kinematics: of a robot with serial legs and as many motors as free coordinates, whose coupling points
            move on spheres, circles, planes, cylinders or lines while the motors are locked.
        qa: (n_a,) motor positions, rad or m.

    Raises:
        InputError: another kind of robot, or wrong shapes.
        SolverError: the general robot of this kind could not be solved.
    """
    begin = time.process_time()
    qa = finite_array("qa", qa, (len(kinematics.description.actuated),))
    return _Robot(kinematics, qa).modes(begin)


@dataclass(frozen=True)
class _Space:
    """Unknowns for the coordinates that move: entries of (e, h) that are not zero, and planes for the rest.

    Attributes:
        entries: indices 0..7 of the unknowns.
        about: axis of the only rotation, -1 where there are none or three.
        lift: the platform also moves along that axis, by an amount that planes of legs give.
        still: directions in which the platform's origin does not move.
    """

    entries: tuple[int, ...]
    about: int = -1
    lift: bool = False
    still: tuple[int, ...] = ()

    @classmethod
    def of(cls, kinematics: Kinematics) -> _Space:
        """From the free and dependent coordinates."""
        description, platform = kinematics.description, kinematics.platform
        moves = [i for i in range(3) if i in platform.order]
        turns = [i - 3 for i in platform.order if i >= 3]
        if len(description.actuated) != description.m or description.redundant:
            raise InputError("assembly modes: need as many motors as coordinates, and no redundant joints")
        if not turns:
            return cls((0, *(5 + i for i in moves)))
        if turns == [0, 1] and len(moves) == 3:  # the legs hold the third angle
            return cls(tuple(range(8)))
        if len(turns) == 3:
            still = tuple(i for i in range(3) if i not in moves)
            return cls((0, 1, 2, 3, *range(4, 8)) if moves else (0, 1, 2, 3), still=still if moves else ())
        about = "xyz".index(platform.convention[turns[0]])
        across = [i for i in range(3) if i != about]
        if len(turns) == 1 and (not moves or set(across) <= set(moves)):
            flat = (5 + across[0], 5 + across[1]) if moves else ()
            return cls((0, 1 + about, *flat), about, about in moves)
        names = ", ".join([*description.platform.coordinates, *description.platform.dependent_coordinates])
        raise InputError(f"assembly modes: not for a platform that moves in {names}")

    @property
    def turning(self) -> bool:
        """The platform only turns."""
        return max(self.entries) < 4

    def levelled(self, surfaces: Sequence[LegSurface]) -> tuple[float, list[LegSurface]]:
        """Height along the axis of rotation, where planes give it, and what is left in the plane."""
        if not self.lift:
            return 0.0, list(surfaces)
        axis = np.eye(3)[self.about]
        level = [
            (d / (normal @ axis)) - s.kappa @ axis
            for s in surfaces
            for normal, d in s.planes
            if np.linalg.norm(np.cross(normal, axis)) < 1e-9
        ]
        if not level:
            raise InputError("assembly modes: no leg fixes the height along the axis of rotation")
        left = []
        for s in surfaces:
            kappa = s.kappa + level[0] * axis
            if s.axis is not None and s.center is not None:
                if np.linalg.norm(np.cross(s.axis, axis)) > 1e-9:
                    raise InputError("assembly modes: cylinders must be parallel to the axis of rotation")
                kappa = kappa - axis * (axis @ kappa)
                s = replace(s, center=s.center - axis * (axis @ s.center))
            left.append(replace(s, kappa=kappa))
        return float(level[0]), left


@dataclass(frozen=True, eq=False)
class _System:
    """Quadratic equations of a robot.

    Attributes:
        entries: indices of the unknowns.
        kinds: per equation its name in `_FORMS` and the number of its point, -1 for the origin.
        points: (N, 3) coupling points, as lengths relative to the scale; axes, normals of the platform.
        vectors: (E, 3) centres or normals; numbers: (E,) |k|^2 + |c|^2 - l^2 or d.
    """

    entries: tuple[int, ...]
    kinds: tuple[tuple[str, int], ...]
    points: np.ndarray
    vectors: np.ndarray
    numbers: np.ndarray

    @classmethod
    def of(cls, surfaces: Sequence[LegSurface], space: _Space, scale: float) -> _System:
        """From the surfaces; equations that follow from those before are left out."""
        kinds: list[tuple[str, int]] = []
        vectors, numbers = [], []
        points = list(np.array([s.kappa for s in surfaces]) / (1.0 if space.turning else scale))
        for k, surface in enumerate(surfaces):
            if surface.center is not None:
                c = surface.center / scale
                kinds.append(("sphere", k))
                vectors.append(c)
                numbers.append(points[k] @ points[k] + c @ c - (surface.radius / scale) ** 2)
            for normal, d in surface.planes:
                kinds.append(("plane", k))
                vectors.append(normal)
                numbers.append(d / (1.0 if space.turning else scale))
            held = [("angle", a, u, c) for a, u, c in surface.angles]
            held += [("slot", b / scale, n, d / scale) for b, n, d in surface.slots]
            for name, vector, leg_number, number in held:
                kinds.append((name, len(points)))
                points.append(leg_number)
                vectors.append(vector)
                numbers.append(number)
        for i in space.still:
            kinds.append(("plane", -1))
            vectors.append(np.eye(3)[i])
            numbers.append(0.0)
        whole = cls(space.entries, tuple(kinds), np.array(points), np.array(vectors), np.array(numbers))
        says = _independent(whole._leg_forms().reshape(len(kinds), -1))
        kept = tuple(kind for kind, keep in zip(kinds, says, strict=True) if keep)
        system = replace(whole, kinds=kept, vectors=whole.vectors[says], numbers=whole.numbers[says])
        wanted, there = len(space.entries) - 1, len(system.forms())
        if there != wanted:
            raise InputError(
                f"assembly modes: the legs with locked motors give {there} equations, but the platform has "
                f"{wanted} unknowns"
            )
        return system

    def forms(self) -> np.ndarray:
        """(k - 1, k, k) of all equations, e . h = 0 included where it says something."""
        e_h = np.zeros((8, 8))
        e_h[:4, 4:] = e_h[4:, :4] = 0.5 * np.eye(4)
        e_h = e_h[np.ix_(self.entries, self.entries)]
        forms = self._leg_forms()
        return np.concatenate([forms, e_h[None]]) if e_h.any() else forms

    def _leg_forms(self) -> np.ndarray:
        out = []
        points = np.vstack([self.points, np.zeros(3)])
        for (kind, k), v, number in zip(self.kinds, self.vectors, self.numbers, strict=True):
            out.append(_FORMS[kind](v, points[k], number)[np.ix_(self.entries, self.entries)])
        return np.array(out).reshape(-1, len(self.entries), len(self.entries))

    def general(self, seed: int) -> _System:
        """A random complex robot of the same kind."""
        rng = np.random.default_rng(seed)

        def some(*shape: int) -> np.ndarray:
            return rng.normal(size=shape) + 1j * rng.normal(size=shape)

        points, vectors = some(*self.points.shape), some(*self.vectors.shape)
        numbers = some(len(self.numbers))
        held = [k < 0 for _, k in self.kinds]
        vectors[held], numbers[held] = self.vectors[held], self.numbers[held]
        return replace(self, points=points, vectors=vectors, numbers=numbers)

    def solutions(self) -> tuple[np.ndarray, np.ndarray]:
        """Ends (P, k) of all paths, and how far they came (P,)."""
        held = [number for number, (_, k) in enumerate(self.kinds) if k < 0]
        key = tuple(tuple(map(float, self.vectors[number])) for number in held)
        starts = _general_solutions(self.entries, self.kinds, len(self.points), key)
        first = self.general(_SEED)
        half = replace(
            self,
            points=(first.points + self.points) / 2,
            vectors=(first.vectors + self.vectors) / 2,
            numbers=(first.numbers + self.numbers) / 2,
        )
        way = Deformation.between(first.forms(), self.forms(), half.forms())
        ends, arrived = follow(way, starts)
        if len(distinct(ends[arrived == 1.0])) < np.count_nonzero(arrived == 1.0):
            ends, arrived = follow(way, starts, tolerance=1e-7)  # two paths in one: smaller steps
        return ends, arrived


def _independent(rows: np.ndarray) -> list[bool]:
    """Which rows (E, n) are no combination of those before."""
    basis, says = np.zeros((0, rows.shape[1])), []
    for row in rows:
        rest = row - basis.T @ (basis @ row)
        says.append(bool(np.linalg.norm(rest) > 1e-9 * max(1.0, float(np.linalg.norm(row)))))
        if says[-1]:
            rest = rest - basis.T @ (basis @ rest)
            basis = np.vstack([basis, rest / np.linalg.norm(rest)])
    return says


@lru_cache(maxsize=32)
def _general_solutions(
    entries: tuple[int, ...],
    kinds: tuple[tuple[str, int], ...],
    points: int,
    held: tuple[tuple[float, ...], ...],
) -> np.ndarray:
    """All regular solutions (P, k) of the general robot of a kind, from 2^(k - 1) paths."""
    vectors, k = np.zeros((len(kinds), 3)), len(entries)
    vectors[[number for number, (_, point) in enumerate(kinds) if point < 0]] = np.reshape(held, (-1, 3))
    general = _System(entries, kinds, np.zeros((points, 3)), vectors, np.zeros(len(kinds))).general(_SEED)
    forms, known = total_degree(k)
    turns = np.exp(2j * np.pi * np.random.default_rng(_SEED + 1).uniform(size=k - 1))
    target = general.forms()
    ends, _ = follow(Deformation.between(forms * turns[:, None, None], target), known)
    ends, around, _ = polished(target, ends)
    ends = ends[np.isfinite(around) & (_norm_of_e(ends, entries) > 1e-8)]
    ends = ends[distinct(ends)]
    if not len(ends):
        raise SolverError("assembly modes: no solution of a general robot of this kind")
    return ends


def _norm_of_e(y: np.ndarray, entries: tuple[int, ...]) -> np.ndarray:
    """| |e|^2 | of solutions (P, k) of length 1."""
    return np.abs(np.sum(y[:, np.array(entries) < 4] ** 2, axis=1))


class _Robot:
    """A robot with locked motors."""

    def __init__(self, kinematics: Kinematics, qa: np.ndarray) -> None:
        self.kinematics, self.qa, self.space = kinematics, qa, _Space.of(kinematics)
        space, surfaces = self.space, []
        for number, leg in enumerate(kinematics.legs):
            of_leg = zip(kinematics.description.actuated, qa, strict=True)
            locked = {joint: float(value) for (leg_number, joint), value in of_leg if leg_number == number}
            if len(space.entries) == 8 and not space.still and leg.n - leg.point < 3:
                surfaces.append(held_leg(leg, locked))
            else:
                surfaces.append(leg_surface(leg, locked, turning=space.turning, planar=space.about >= 0))
        self.level, self.surfaces = space.levelled(surfaces)
        points = [s.kappa for s in self.surfaces] + [s.center for s in self.surfaces if s.center is not None]
        points += [b for s in self.surfaces for b, _, _ in s.slots]
        self.scale = max([1e-9, *(float(np.abs(point).max()) for point in points)])
        self.system = _System.of(self.surfaces, space, self.scale)

    def modes(self, begin: float) -> AssemblyModes:
        """Sort the ends of all paths, and make real ones to poses."""
        forms, entries = self.system.forms(), self.space.entries
        given, arrived = self.system.solutions()
        ends, around, _ = polished(forms, given)
        ends = np.where(np.isfinite(around)[:, None], ends, given)
        away = _norm_of_e(ends, entries) < _AT_INFINITY
        regular = np.isfinite(around) & ~away & (arrived == 1.0)
        indices = np.flatnonzero(regular)[distinct(ends[regular])]
        real = []
        for y in ends[indices]:
            turn = np.sqrt(np.sum(y * y))
            y = y * (turn.conj() / abs(turn)) if abs(turn) > _REAL else y
            if np.linalg.norm(y.imag) < _REAL:
                real.append(y.real)
        polish, sure, _ = polished(forms, np.array(real).reshape(-1, len(entries)))
        every = [self._mode(y, bool(np.isfinite(radius))) for y, radius in zip(polish, sure, strict=True)]
        modes = [mode for mode in every if mode.residual <= _CLOSED * max(self.scale, 1.0)]
        modes.sort(key=lambda mode: tuple(np.round(mode.z, 9)))
        infinite = int(away.sum())
        lost, too_far = len(ends) - len(indices) - infinite, len(every) - len(modes)
        counts = len(ends), len(indices), infinite, lost, too_far
        return AssemblyModes(self.qa, tuple(modes), *counts, time.process_time() - begin)

    def _mode(self, y: np.ndarray, certified: bool) -> AssemblyMode:
        both = np.zeros(8)
        both[list(self.space.entries)] = y
        e, h = both[:4], both[4:]
        R = Rotation.from_quat(np.roll(e, -1)).as_matrix()
        r = self.scale * position_of(e, h)
        residual = max(s.error(r, R) for s in self.surfaces)
        if self.space.lift:
            r = r + self.level * np.eye(3)[self.space.about]
        z = _coordinates(self.kinematics, self.space, e, r, R)
        home = _home_branches(self.kinematics, z, self.qa)
        return AssemblyMode(z, r, R, residual, certified, home)


def _coordinates(
    kinematics: Kinematics, space: _Space, e: np.ndarray, r: np.ndarray, R: np.ndarray
) -> np.ndarray:
    """z with its dependent coordinates, angles nearest to zero."""
    platform = kinematics.platform
    angles = np.zeros(3)
    if space.about >= 0:
        angles[[i - 3 for i in platform.order if i >= 3]] = 2.0 * np.arctan2(e[1 + space.about], e[0])
    elif any(i >= 3 for i in platform.order):
        angles = Rotation.from_matrix(R).as_euler(platform.convention.upper())
        if 5 not in platform.order and abs(angles[2]) > 1:  # the same rotation with a third angle of zero
            around = -angles[1] if len(set(platform.convention)) == 2 else math.pi - angles[1]
            angles = np.array([angles[0] + math.pi, around, angles[2] + math.pi])
        if 5 not in platform.order and abs(nearest_turn(angles)[2]) > _CLOSED:
            raise InputError("assembly modes: in one of them the platform also turns about its third axis")
    return np.concatenate([r, nearest_turn(angles)])[platform.order]


def _home_branches(kinematics: Kinematics, z: np.ndarray, qa: np.ndarray) -> bool | None:
    """Whether the inverse kinematics of the pose gives these motor positions."""
    if kinematics.along is not None:
        return None
    try:
        q = kinematics.joints(z).q
    except InputError:
        return False
    rows = kinematics.description.motor_rows
    gap = np.array([q[leg][joint] for leg, joint in kinematics.description.actuated]) - qa
    gap = np.where([row.sigma == REVOLUTE for row in rows], nearest_turn(gap), gap)
    return bool(np.abs(gap).max() < 1e-6)
