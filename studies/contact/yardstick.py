"""The yardstick of the contact solvers: answers judged by the contact laws, from their forces alone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ocptip.contact.bindings import laws
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from studies.contact.problems import DEGENERATE_LOADS, Case

WRONG = 1e-6
"""Violation of the contact laws, relative to the largest force, from which a claimed success is wrong."""


@dataclass
class Answers:
    """What a solver returned for the wrenches of one support: forces (k, n, 3), N, contact axes."""

    forces: np.ndarray
    claimed: np.ndarray
    status: Sequence[str]
    pivots: np.ndarray


@dataclass
class Tally:
    """Result of one solver in one case. Pivots and times None where they were not told or not measured."""

    case: str
    solver: str
    feet: int | None
    facets: int | None
    problems: int = 0
    solved: int = 0
    failed: int = 0
    wrong: int = 0
    failures: dict[str, int] = field(default_factory=dict)
    second_attempts: int = 0
    worst_violation: float = 0.0
    worst_wrong: float = 0.0
    pivots_median: float | None = None
    pivots_max: int | None = None
    microseconds: float | None = None
    microseconds_median: float | None = None
    outcomes: str = ""


def violation(support: Support, wrenches: np.ndarray, forces: np.ndarray, true_cone: bool) -> np.ndarray:
    """How far forces are from the contact laws and the equation of motion; shares nothing with any solver.

    Args:
        support: ordinary contacts only.
        wrenches: (k, 6), N and N m.
        forces: (k, n, 3) in contact axes, N.
        true_cone: Judge by Coulomb's cone instead of its pyramid.

    Returns:
        (k,) the largest violation relative to the largest force at stake.
    """
    k, n = len(wrenches), support.n_contacts
    W, inverse_mass = support.wrench_matrix, support.inverse_mass
    acceleration = (wrenches + forces.reshape(k, 3 * n) @ W.T) @ inverse_mass
    motion = (acceleration @ W).reshape(k, n, 3)
    free = wrenches @ inverse_mass
    at_contacts = np.max(np.abs(free @ W), axis=1)
    free[:, 3:] *= support.length
    unit = support.mass * np.maximum(at_contacts, np.max(np.abs(free), axis=1))
    unit = np.maximum(unit, np.finfo(float).tiny)
    law = cone_violation if true_cone else laws.law_violation
    each = [
        law(contact, forces[:, i], motion[:, i], unit, support.mass)
        for i, contact in enumerate(support.contacts)
    ]
    return np.max(each, axis=0)


def cone_violation(
    contact: UnilateralContact, force: np.ndarray, motion: np.ndarray, unit: np.ndarray, mass: float
) -> np.ndarray:
    """Violation of the laws of an ordinary contact with Coulomb's cone; arguments as `laws.law_violation`."""
    force, motion = force / unit[:, None], motion * mass / unit[:, None]
    normal, lift, limit = force[:, 0], motion[:, 0], contact.friction * force[:, 0]
    slip = np.linalg.norm(motion[:, 1:], axis=1)
    outside = np.linalg.norm(force[:, 1:], axis=1) - limit
    complementarity = np.minimum(np.maximum(lift, 0.0), np.maximum(normal, 0.0))
    # friction opposes the slip fully: a_t' K_t = -mu K_n |a_t|; a product, hence divided by the larger factor
    shortfall = limit * slip + np.sum(motion[:, 1:] * force[:, 1:], axis=1)
    size = np.maximum(1.0, np.maximum(np.max(np.abs(motion), axis=1), limit))
    return np.max([-normal, -lift, complementarity, outside, shortfall / size], axis=0)


def judge(case: Case, solver: str, parts: list[Answers], true_cone: bool) -> Tally:
    """Count what is solved, reported as failed, and wrong."""
    tally = Tally(case.name, solver, case.feet, case.facets)
    failures: Counter[str] = Counter()
    pivots = np.concatenate([part.pivots for part in parts])
    for (support, wrenches), part in zip(case.problems, parts, strict=True):
        off = violation(support, wrenches, part.forces, true_cone)
        good = part.claimed & (off <= WRONG)
        wrong = part.claimed & ~good  # also where forces are NaN
        tally.problems += len(wrenches)
        tally.solved += int(np.sum(good))
        tally.wrong += int(np.sum(wrong))
        tally.failed += int(np.sum(~part.claimed))
        tally.worst_violation = max(tally.worst_violation, *off[good], 0.0)
        tally.worst_wrong = max(tally.worst_wrong, *off[wrong], 0.0)
        for claimed, status in zip(part.claimed, part.status, strict=True):
            tally.second_attempts += status.endswith("*")
            if not claimed:
                failures[status.rstrip("*")] += 1
        tally.outcomes += "".join(
            "." if fine else "W" if claims else "F" for fine, claims in zip(good, part.claimed, strict=True)
        )
    tally.failures = dict(failures)
    if np.all(pivots >= 0):
        tally.pivots_median, tally.pivots_max = float(np.median(pivots)), int(np.max(pivots))
    if len(tally.outcomes) > len(DEGENERATE_LOADS):
        tally.outcomes = ""
    return tally
