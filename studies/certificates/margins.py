"""Margins of contacts under a wrench, from the data of a certificate: NumPy and one cone program, no ocptip.

Contacts on one plane tip about lines through two of them. Contact forces have a margin t where all forces of
contact k are inside their set by t newtons; the largest t is a concave function of the wrench.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations, product
from typing import Any

import clarabel
import numpy as np
from scipy import sparse

_FLAT = 1e-9  # of the contacts' extent


class ContactMargins:
    """Of a base on its contacts.

    Args:
        model: of a certificate.
        friction: factor on all friction.
    """

    def __init__(self, model: Mapping[str, Any], friction: float) -> None:
        contacts, about = model["contacts"], np.array(model["base"]["center_of_mass"], dtype=float)
        self.positions = np.array(contacts["positions"], dtype=float) - about
        self.frames = np.array(contacts["frames"], dtype=float)
        self.sets = [
            [
                (
                    -np.inf if low is None else low,
                    np.inf if high is None else high,
                    friction * radius,
                    friction * slope,
                )
                for low, high, radius, slope in pieces
            ]
            for pieces in contacts["sets"]
        ]
        moments = np.cross(self.positions[:, :, None], self.frames, axis=1)
        self.grasp = np.concatenate([np.hstack(list(self.frames)), np.hstack(list(moments))])
        self.axes, self.added = self._tipping()

    @property
    def flat(self) -> bool:
        """All contacts lie on one plane, whose normal is theirs."""
        normals, centred = self.frames[:, :, 0], self.positions - self.positions.mean(axis=0)
        size = np.max(np.linalg.norm(centred, axis=1))
        return bool(
            np.max(np.abs(centred @ normals[0])) <= _FLAT * size
            and np.max(np.abs(normals - normals[0])) <= _FLAT
        )

    def _tipping(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows (A, 6) and numbers (A,): moments left about tipping axes are rows . wrench + numbers."""
        rows, numbers = [], []
        normals, size = self.frames[:, :, 0], np.max(np.linalg.norm(self.positions, axis=1))
        low = np.array([min(piece[0] for piece in pieces) for pieces in self.sets])
        high = np.array([max(piece[1] for piece in pieces) for pieces in self.sets])
        for i, j in combinations(range(len(normals)), 2):
            line = self.positions[j] - self.positions[i]
            if np.linalg.norm(line) <= _FLAT * size:
                continue
            for e in (line / np.linalg.norm(line), -line / np.linalg.norm(line)):
                lift = np.cross(self.positions - self.positions[i], normals) @ e
                lift[np.abs(lift) <= _FLAT * size] = 0.0
                # contacts let go at their smallest forces where they lift, at their largest where they press
                end = np.where(lift > 0, low, np.where(lift < 0, high, 0.0))
                if not lift.any() or not np.all(np.isfinite(end)):
                    continue  # one of them holds the base always
                ends = lift @ end
                rows.append(np.concatenate([np.cross(e, self.positions[i]), -e]))
                numbers.append(-ends)
        return np.array(rows).reshape(-1, 6), np.array(numbers)

    def inside(self, wrench: np.ndarray, share: float) -> tuple[float, np.ndarray]:
        """How far inside a share of their sets forces can be that hold a wrench, N; and its slope (6,).

        Minus infinity where no forces hold it.
        """
        best, slope = -np.inf, np.zeros(6)
        for chosen in product(*self.sets):
            value, own = self._inside(wrench, share, chosen)
            if value > best:
                best, slope = value, own
        return best, slope

    def _inside(
        self, wrench: np.ndarray, share: float, chosen: tuple[tuple[float, float, float, float], ...]
    ) -> tuple[float, np.ndarray]:
        count = len(chosen)
        size = 3 * count + 1  # forces and t
        scale = max(float(np.linalg.norm(wrench[:3])), 1.0)
        A, b, cones = [np.hstack([self.grasp, np.zeros((6, 1))])], [-wrench / scale], [clarabel.ZeroConeT(6)]
        bounds, limits = [], []
        for k, (low, high, radius, slope) in enumerate(chosen):
            rubs = radius > 0 or slope > 0
            for end, sign in ((low, -1.0), (high, 1.0)):
                if np.isfinite(end):
                    row = np.zeros(size)
                    row[3 * k], row[-1] = sign, 1.0
                    bounds.append((row, sign * end / scale))
            rows = np.zeros((3, size))
            rows[0, 3 * k], rows[0, -1] = -share * slope, float(rubs)
            rows[1, 3 * k + 1] = rows[2, 3 * k + 2] = -1.0
            limits.append((rows, np.array([share * radius / scale, 0.0, 0.0])))
        bounds.append((np.eye(size)[-1], 10.0))  # t, of clamps without an end
        A.append(np.array([row for row, _ in bounds]))
        b.append(np.array([number for _, number in bounds]))
        cones.append(clarabel.NonnegativeConeT(len(bounds)))
        for rows, number in limits:
            A.append(rows)
            b.append(number)
            cones.append(clarabel.SecondOrderConeT(3))
        cost = np.zeros(size)
        cost[-1] = -1.0
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
        solver = clarabel.DefaultSolver(
            sparse.csc_matrix((size, size)),
            cost,
            sparse.csc_matrix(np.vstack(A)),
            np.concatenate(b),
            cones,
            settings,
        )
        found = solver.solve()
        if str(found.status) not in ("Solved", "AlmostSolved"):
            return -np.inf, np.zeros(6)
        return scale * found.x[-1], -np.array(found.z[:6])
