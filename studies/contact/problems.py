"""Contact problems of the studies of the contact solver: a platform on its feet, random supports."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from studies.contact.random_supports import random_support, random_wrenches

MASS, INERTIA, RADIUS, HEIGHT, FRICTION, GRAVITY = 60.0, (3.0, 4.0, 5.0), 0.35, 0.6, 0.5, 9.81
FEET, FACETS, DEGENERATE_FEET = (3, 4, 6, 8, 12), (4, 12), (4, 8)
WRENCHES_PER_SUPPORT = 2
DEGENERATE_LOADS = {
    "weight": (0, 0, -MASS * GRAVITY, 0, 0, 0),
    "200 N lateral": (200, 0, -MASS * GRAVITY, 0, 0, 0),
    "400 N lateral": (400, 0, -MASS * GRAVITY, 0, 0, 0),
    "300 N m": (0, 0, -MASS * GRAVITY, 0, 300, 0),
    "100 N lift": (0, 0, 100 - MASS * GRAVITY, 0, 0, 0),
    "lifted off": (0, 0, 100, 0, 0, 0),
    "no load": (0, 0, 0, 0, 0, 0),
    "1e-12 N": (0, 0, -1e-12, 0, 0, 0),
}
"""Total wrenches on the base: N, N m about the centre of mass; all but the last three contain the weight."""


@dataclass(frozen=True)
class Case:
    """A set of problems: supports of ordinary contacts with wrenches (k, 6) each.

    `feet` and `facets` are None where they differ between the supports. Only `timed` cases are timed: batches
    need one support under many wrenches.
    """

    name: str
    feet: int | None
    facets: int | None
    problems: list[tuple[Support, np.ndarray]]
    timed: bool


def platform_on(feet: int, facets: int) -> Support:
    """The platform of the study on `feet` feet; axes: z up, origin on the floor below its centre of mass."""
    angles = 2.0 * np.pi * np.arange(feet) / feet + np.pi / feet
    contacts = [
        UnilateralContact(
            position=(RADIUS * np.cos(a), RADIUS * np.sin(a), 0.0), friction=FRICTION, facets=facets
        )
        for a in angles
    ]
    return Support(contacts, mass=MASS, center_of_mass=(0.0, 0.0, HEIGHT), inertia=INERTIA)


def random_loads(count: int, seed: int) -> np.ndarray:
    """Wrenches (count, 6), N and N m: weight and random loads, from rest to sliding and tipping."""
    rng = np.random.default_rng(seed)
    wrenches = np.empty((count, 6))
    for wrench in wrenches:
        level = rng.uniform(0, 1)
        wrench[:2] = rng.normal(size=2) * 250 * level
        wrench[2] = -MASS * GRAVITY + rng.normal() * 150 * level
        wrench[3:] = rng.normal(size=3) * [90, 90, 60] * level
    return wrenches


def all_cases(feet: Sequence[int], loads: int, seed: int) -> Iterator[Case]:
    """The cases of the study, one after the other."""
    wrenches = random_loads(loads, seed)
    for facets in FACETS:
        for n in feet:
            support = platform_on(n, facets)
            yield Case(f"circle_{n}_feet_{facets}_facets", n, facets, [(support, wrenches)], timed=True)
    degenerate = np.array(list(DEGENERATE_LOADS.values()), dtype=float)
    for facets in FACETS:
        for n in DEGENERATE_FEET:
            problems = [(platform_on(n, facets), degenerate)]
            yield Case(f"degenerate_{n}_feet_{facets}_facets", n, facets, problems, timed=False)
    rng = np.random.default_rng([seed, 1])
    problems = []
    for _ in range(max(1, 3 * loads // WRENCHES_PER_SUPPORT)):
        support = random_support(rng, clamps=False)
        problems.append((support, random_wrenches(rng, support, WRENCHES_PER_SUPPORT)))
    yield Case("random", None, None, problems, timed=False)
