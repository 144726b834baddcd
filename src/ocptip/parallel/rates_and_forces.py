"""What a parallel robot does at an instant: rates of its joints, forces of its motors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocptip.basics.write import Record


@dataclass(frozen=True, eq=False)
class Forces(Record):
    """Result of the inverse dynamics.

    Attributes:
        motors: (n_a,) motor forces, N or N m; of redundant drives those with the smallest norm.
        generalized: (m,) tau_s dual to s', N and N m.
        residual: part of tau_s that the motors cannot balance, relative.
        projection: route it came by.
    """

    motors: np.ndarray
    generalized: np.ndarray
    residual: float
    projection: str


@dataclass(frozen=True, eq=False)
class JointRates:
    """Positions, speeds and accelerations of all joints, coupling joints included.

    Attributes:
        q, qd, qdd: per leg (n_f,).
        residual: largest closure error of the positions, m or rad.
    """

    q: tuple[np.ndarray, ...]
    qd: tuple[np.ndarray, ...]
    qdd: tuple[np.ndarray, ...]
    residual: float
