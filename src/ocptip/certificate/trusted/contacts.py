"""Contact forces that hold the base: what is asked of them, and the rule that finds them on an interval.

Forces are named at both ends of an interval, interpolated, and corrected by one fixed linear map so that they
hold the base exactly. If these stay in their sets, the contacts can hold the base throughout. A contact
without friction is given no tangential force, neither by name nor by the map, so that no rounding of one has
to be zero. The minimum share of their friction with which that is shown bounds GT from above. A moment about
a tipping axis is bounded from below: with all contacts on one plane it is affine in the wrench, else forces
are shown that bear it as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np

from ocptip.certificate.trusted.arm import skew
from ocptip.certificate.trusted.forms import Form, U, linear

_FLAT = 1e-9  # of the contacts' extent: closer to a plane is on it


class Contacts:
    """A base on its contacts, and what must be left of them.

    Args:
        model: of a certificate.
        most: claimed bound of GN: a moment of at least M0 (1 / most - 1) is left about each tipping axis.
        friction: factor on the friction of all contacts.

    Attributes:
        count: number of contacts.
        sets: of each contact pieces (minimum, maximum normal force, N, radius, N, slope): the tangential
            force is at most radius + slope times the normal force.
        bears: (3 count,) bool: force components that contacts may have; without friction the normal ones.
        grasp, rounded: (6, 3 count) wrench about the base's centre of mass per contact force; its rounding.
        scale: N: forces are measured in weights of the base.
        flat: all contacts lie on one plane: moments about tipping axes follow from the wrench alone.
        axes, added: (axes, 6) and (axes,): such a moment is the first times the wrench plus the second.
        blurred: (1, 6) error of such a row.
        unit, needed: N m: M0, and what must be left about each axis.
        couples: (axes, 6): wrenches to be borne besides that on the base, each alone, if not flat.
    """

    def __init__(self, model: Mapping[str, Any], most: float, friction: float = 1.0) -> None:
        base, contacts = model["base"], model["contacts"]
        about = np.array(base["center_of_mass"], dtype=float)
        positions, frames = np.array(contacts["positions"]), np.array(contacts["frames"])
        levers = np.array([skew(arm) for arm in positions - about])
        self.grasp = np.concatenate([np.hstack(list(frames)), np.hstack(list(levers @ frames))])
        reach = np.concatenate([np.hstack(list(frames)), np.hstack(list(np.abs(levers) @ np.abs(frames)))])
        self.count, self.rounded = len(positions), U * np.abs(reach)
        self.sets = [
            [
                (_end(low, -np.inf), _end(high, np.inf), friction * r, friction * k)
                for low, high, r, k in pieces
            ]
            for pieces in contacts["sets"]
        ]
        friction_free = [all(r == 0 and k == 0 for *_, r, k in pieces) for pieces in self.sets]
        self.bears = ~np.repeat(friction_free, 3) | (np.arange(3 * self.count) % 3 == 0)
        self.scale = max(float(base["mass"] * np.linalg.norm(base["gravity"])), 1e-9)
        self.flat = _one_plane(positions, frames[:, :, 0])
        self.axes, self.added = _tipping_axes(positions, frames[:, :, 0], about, self.sets)
        lever = float(np.max(np.abs(about)) + np.max(np.abs(positions)))
        self.blurred = U * np.array([[4 * lever] * 3 + [4.0] * 3])
        self.scaling = np.array([1.0] * 3 + [1 / max(lever, 1e-9)] * 3)
        self.unit = float(base["reference_moment"] or 1.0)
        self.needed = self.unit * (1 / most - 1)
        if base["reference_moment"] is None and len(self.axes):
            self.needed = np.inf  # nothing says what is asked for
        self.couples = np.zeros((0 if self.flat else len(self.axes), 6))
        self.couples[:, 3:] = -self.needed * self.axes[: len(self.couples), 3:]
        self._inverses: dict[bytes, tuple[np.ndarray, float]] = {}

    def upright(self, wrench: Form, forces: np.ndarray) -> np.ndarray:
        """How much more than needed is left about tipping axes, (N,), per M0; arguments as of `held`, forces
        (2, couples, contacts, 3, N) for each couple alone."""
        if self.flat:
            least = linear(self.axes, wrench).range[0] + self.added[:, None]
            least -= self.blurred @ wrench.size  # of the axes' own rounding
            return (np.min(least, axis=0, initial=np.inf) - self.needed) / self.unit
        held = [
            self.held(wrench + couple[:, None], forces[:, k], 1.0) for k, couple in enumerate(self.couples)
        ]
        return np.min(held, axis=0) if held else np.full(wrench.r.shape[-1], np.inf)

    def held(self, wrench: Form, forces: np.ndarray, share: float) -> np.ndarray:
        """How far inside a share of their sets forces are that hold wrenches, (N,), per weight.

        Args:
            wrench: (6, N) on the base.
            forces: (2, contacts, 3, N) at both ends, normal and tangential, N. A contact without any at both
                ends carries none.
            share: of the friction.
        """
        slack = np.full(wrench.r.shape[-1], np.inf)
        for pattern, here in patterns(np.any(forces != 0, axis=(0, 2))):
            columns = np.repeat(pattern, 3)
            correction, defect = self.inverse(columns)
            if not np.isfinite(defect):  # these contacts cannot hold every wrench
                slack[here] = -np.inf
                continue
            ends = forces[:, pattern][..., here].reshape(2, -1, len(here)) * self.bears[columns][:, None]
            chosen = Form.of(0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0]))
            rest = linear(self.grasp[:, columns], chosen)
            rest = Form(rest.c, rest.r + self.rounded[:, columns] @ chosen.size) + wrench[:, here]
            left = defect * np.max(rest.size + rest.r, axis=0)  # what the correction leaves, corrected again
            f = chosen - linear(correction, rest)
            f = Form(f.c, f.r + np.abs(correction).sum(axis=1)[:, None] * left)
            for k, contact in enumerate(np.flatnonzero(pattern)):
                force = f[3 * k : 3 * k + (3 if self.bears[3 * contact + 1] else 1)]
                inside = [self._inside(force, *piece, share) for piece in self.sets[contact]]
                slack[here] = np.minimum(slack[here], np.max(inside, axis=0))
            if not self.idle(pattern):
                slack[here] = -np.inf
        return slack

    def idle(self, pattern: np.ndarray) -> bool:
        """Whether all contacts but these (contacts,) may carry nothing."""
        return all(
            any(low <= 0 <= high and radius >= 0 for low, high, radius, _ in self.sets[contact])
            for contact in np.flatnonzero(~pattern)
        )

    def inverse(self, columns: np.ndarray) -> tuple[np.ndarray, float]:
        """A right inverse F of some columns of the grasp matrix G, and a bound of d / (1 - d), d = |1 - G F|.

        Its rows are zero for force components that contacts may not have.

        Without one, or with a poor one, the bound is infinite, and nothing is proved.
        """
        key = columns.tobytes()
        if key not in self._inverses:
            G = self.grasp[:, columns]
            bears = self.bears[columns]
            F = np.linalg.pinv(G * bears) * bears[:, None] if G.shape[1] else np.zeros((0, 6))
            rounding = (self.rounded[:, columns] + U * G.shape[1] * np.abs(G)) @ np.abs(F)
            defect = float(np.max(np.sum(np.abs(np.eye(6) - G @ F) + rounding, axis=1)))
            self._inverses[key] = F, (defect / (1 - defect) if defect < 0.5 else np.inf)
        return self._inverses[key]

    def _inside(
        self, f: Form, low: float, high: float, radius: float, slope: float, share: float
    ) -> np.ndarray:
        """The margin by which forces (3, N), or normal forces (1, N) alone, keep one piece of their set."""
        least, greatest = f[0].range
        if len(f.r) == 1:
            return np.minimum(least - low, high - greatest) / self.scale
        normal, first, second = f[0], f[1], f[2]
        limit = (normal * slope + radius) * share
        cone = (limit * limit - first * first - second * second).range[0] / self.scale
        return np.min([least - low, high - greatest, limit.range[0], cone], axis=0) / self.scale


def patterns(loaded: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Which contacts carry something together, (contacts,), and in which of the columns (contacts, N)."""
    result, which = np.unique(loaded, axis=1, return_inverse=True)
    return [(pattern, np.flatnonzero(which.reshape(-1) == k)) for k, pattern in enumerate(result.T)]


def _end(value: float | None, none: float) -> float:
    return none if value is None else float(value)


def _one_plane(positions: np.ndarray, normals: np.ndarray) -> bool:
    centred = positions - positions.mean(axis=0)
    extent = float(np.max(np.linalg.norm(centred, axis=1)))
    level = np.max(np.abs(centred @ normals[0])) <= _FLAT * extent
    return bool(level and np.max(np.linalg.norm(normals - normals[0], axis=1)) <= _FLAT)


def _tipping_axes(
    positions: np.ndarray, normals: np.ndarray, about: np.ndarray, sets: list[list[Any]]
) -> tuple[np.ndarray, np.ndarray]:
    """Lines of two contacts round which all others can only let go: rows (axes, 6) and numbers (axes,).

    Row times wrench (about `about`) plus number is the moment about the line of what the normal forces have
    left before their contacts let go, for contacts on one plane.
    """
    rows, added, extent = [], [], float(np.max(np.linalg.norm(positions - positions.mean(axis=0), axis=1)))
    lower = np.array([min(piece[0] for piece in pieces) for pieces in sets])
    upper = np.array([max(piece[1] for piece in pieces) for pieces in sets])
    for i, j in combinations(range(len(positions)), 2):
        e = positions[j] - positions[i]
        if np.linalg.norm(e) <= _FLAT * extent:
            continue
        e = e / np.linalg.norm(e)
        lifts = np.einsum("kd,kd->k", normals, np.cross(e, positions - positions[i]))
        lifts[np.abs(lifts) <= _FLAT * extent] = 0.0
        for lift, axis in ((lifts, e), (-lifts, -e)):
            up, down = lift > 0, lift < 0
            if np.any(lift) and np.all(np.isfinite(lower[up])) and np.all(np.isfinite(upper[down])):
                rows.append(-np.concatenate([np.cross(axis, about - positions[i]), axis]))
                added.append(float(-lift[down] @ upper[down] - lift[up] @ lower[up]))
    return np.array(rows).reshape(-1, 6), np.array(added)
