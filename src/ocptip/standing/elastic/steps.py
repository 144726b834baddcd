"""Linear systems with constant matrices in each step: their oscillations, states at the ends and within."""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np
import scipy  # subpackages load on first use

from ocptip.contact.elastic import ElasticFeet

_DEGREE, _CLOSE = 12, 0.35  # of Taylor polynomials; the norm up to which what they leave out is rounding
_AT_ONCE = 100  # matrices that fit the processor's cache
_FEW = 16  # instants within a step up to which squares of its matrix cost more than they save


def exponentials(A: np.ndarray, scale: np.ndarray, moving: int) -> np.ndarray:
    """(S, p, p): matrix exponentials of A (S, p, p), many at once.

    Args:
        A: whose first rows and columns are those of a linear system, the others what excites it.
        scale: (p,) sizes of the states; powers of 2 do not round. Velocities are as many times larger than
            their positions as a system is fast, which would otherwise be taken for a larger norm.
        moving: number of the states of the system.
    """
    B, values = A * (scale / scale[:, None]), np.empty(A.shape)
    for k in range(0, len(B), _AT_ONCE):
        values[k : k + _AT_ONCE] = _exponentials(B[k : k + _AT_ONCE], moving)
    return values * (scale[:, None] / scale)


def _exponentials(B: np.ndarray, moving: int) -> np.ndarray:
    # what is left out is linear in the excitation, so that its size does not matter
    parts = (
        np.abs(B[:, block, block]).sum(axis=2).max(initial=0.0) for block in (np.s_[:moving], np.s_[moving:])
    )
    halvings = max(0, int(np.ceil(np.log2(max(*parts, _CLOSE) / _CLOSE))))
    B = B * 0.5**halvings
    square = B @ B
    cube, values = square @ B, np.zeros_like(B)
    for k in range(_DEGREE, -1, -3):  # Paterson and Stockmeyer: by powers of the cube
        values = values @ cube if k < _DEGREE else values
        for power, count in ((np.eye(B.shape[-1]), k), (B, k + 1), (square, k + 2)):
            if count <= _DEGREE:
                values += power * (1 / factorial(count))
    for _ in range(halvings):
        values = values @ values
    return values


def powers(E: np.ndarray, z: np.ndarray, count: int) -> np.ndarray:
    """(count + 1, len(z)): z, E z, E^2 z, ..."""
    X = z[:, None]
    while X.shape[1] <= count:
        X = np.hstack([X, E @ X])
        E = E @ E
    return X[:, : count + 1].T


def ends_of_steps(steps: np.ndarray, counts: np.ndarray, z: np.ndarray, first: int) -> np.ndarray:
    """(S + 1, p): the states at the ends of S steps, from z (p,) on; of one that grows without end NaN.

    Args:
        steps: (S, p, p), from each instant within a step to the next.
        counts: (S,) of the instants.
        z: (p,).
        first: the states from here on are 1, t, t^2 / 2, ..., which restart in every step.
    """
    ends = np.empty((len(steps) + 1, len(z)))
    ends[0] = z
    with np.errstate(over="ignore", invalid="ignore"):
        whole = np.empty_like(steps)
        for count in np.unique(counts):
            whole[counts == count] = np.linalg.matrix_power(steps[counts == count], int(count))
        for i, step in enumerate(whole):
            ends[i, first:], ends[i, first] = 0.0, 1.0
            ends[i + 1] = step @ ends[i]
    return ends


def states_within(steps: np.ndarray, counts: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T, p) states at all instants within steps, and the number of the step of each, (T,).

    Args:
        steps, counts: as of `ends_of_steps`.
        ends: what that returns, of these steps or of more.
    """
    first = np.cumsum(counts) - counts
    states = np.empty((int(np.sum(counts)), ends.shape[1]))
    for count in np.unique(counts):
        rows = np.flatnonzero(counts == count)
        if count > _FEW:
            states[first[rows][:, None] + np.arange(count)] = _doubled(steps[rows], ends[rows], int(count))
            continue
        state, step = ends[rows], steps[rows]
        for k in range(int(count)):
            state = np.einsum("sij,sj->si", step, state)
            states[first[rows] + k] = state
    return states, np.repeat(np.arange(len(counts)), counts)


def _doubled(steps: np.ndarray, begins: np.ndarray, count: int) -> np.ndarray:
    """(S, count, p) states of steps (S, p, p) from begins (S, p): every product doubles their number."""
    states, done = np.empty((len(steps), count, begins.shape[1])), 1
    power = np.ascontiguousarray(np.swapaxes(steps, 1, 2))
    states[:, :1] = begins[:, None] @ power
    while done < count:
        more = min(done, count - done)
        states[:, done : done + more] = states[:, :more] @ power
        done += more
        if done < count:
            power = power @ power
    return states


def oscillations(inertia: np.ndarray, damping: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """(2 d, 2), natural frequencies, Hz, and damping ratios of M u'' + C u' + K u = 0, the slowest first."""
    d = len(inertia)
    A = np.zeros((2 * d, 2 * d))
    A[:d, d:] = np.eye(d)
    A[d:, :d], A[d:, d:] = -np.linalg.solve(inertia, stiffness), -np.linalg.solve(inertia, damping)
    roots = np.linalg.eigvals(A)
    sizes = np.abs(roots)
    with np.errstate(invalid="ignore", divide="ignore"):
        values = np.column_stack([sizes / (2 * np.pi), -roots.real / sizes])
    return values[np.argsort(sizes)]


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of base and mechanism at the start, all feet pressing, with rigid gears.

    Attributes:
        lowest, highest: natural frequencies, Hz.
        damping: ratio of the lowest mode.
        delays: (n,), s: damping over stiffness of each foot.
    """

    lowest: float
    highest: float
    damping: float
    delays: np.ndarray

    @classmethod
    def of(cls, elastic: ElasticFeet, inertia: np.ndarray) -> Modes:
        """With the inertia (6, 6) at the start."""
        squares = scipy.linalg.eigh(elastic.matrix(), inertia, eigvals_only=True)
        moving = squares[squares > 1e-9 * squares[-1]]
        low, high = np.sqrt(moving[0]), np.sqrt(moving[-1])
        delays = np.array([spring.delay + 2 * spring.ratio / low for spring in elastic.springs])
        result = oscillations(inertia, elastic.matrix(factors=delays), elastic.matrix())
        frequencies, ratios = result[np.abs(result[:, 0]) > 1e-3 * low / (2 * np.pi)].T
        slowest = int(np.argmin(np.abs(2 * np.pi * frequencies - low)))
        return cls(low / (2 * np.pi), high / (2 * np.pi), float(ratios[slowest]), delays)
