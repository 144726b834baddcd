"""At which instants of an arm's motion the base tips, slides or lifts a wheel first, for manoeuvres."""

from __future__ import annotations

import numpy as np

from ocptip.reserves.equal_compliance import normal_map_of, slides_beyond
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.drive_envelope import ManoeuvreSearch, first_zero
from ocptip.standing.at_rest.manoeuvres import LARGEST, Manoeuvres
from ocptip.standing.tolerance import Uncertainty


def worst_states(robot: Robot, states: np.ndarray, manoeuvres: Manoeuvres, interface: int = 0) -> np.ndarray:
    """(P, 4) numbers of the states in which the nominal base tips, slides, lifts a wheel, slides first.

    The first sliding is that of friction pyramids, lifting and the second sliding are those of equally
    compliant wheels, sliding along or about some axes; where one of them is not known, it is the state that
    tips first.

    Args:
        robot: on its base, with contacts on one plane.
        states: (N, 3 n), see `largest_manoeuvres`.
        manoeuvres: P of them.
        interface: see `largest_manoeuvres`.
    """
    footing = robot.interfaces[interface]
    count, families = len(states), len(manoeuvres)
    search = ManoeuvreSearch(
        robot, np.tile(states, (families, 1)), manoeuvres.repeated(count), Uncertainty(), interface
    )
    size = count * families
    off = np.zeros((size, search.deviations.size))
    polynomials = search.polynomials(np.arange(size), off, np.ones(size))
    facets, normals = footing.slip.half_spaces(1.0), normal_map_of(footing.support)
    slopes, offsets = footing.tip_over.affine_moments or (np.empty((0, 6)), np.empty(0))
    slides = None if normals is None else -slides_beyond(footing.support, normals)
    rows = [slopes, None if facets is None else -facets, normals, slides]
    scalars = np.full((len(rows), size), LARGEST)
    for k, line in enumerate(rows):
        for number, row in enumerate(() if line is None else line):
            coefficients = polynomials @ row
            coefficients[:, 0] += offsets[number] if k == 0 else 0.0
            scalars[k] = np.minimum(scalars[k], first_zero(coefficients))
    worst = np.argmin(scalars.reshape(len(rows), families, count), axis=2)
    known = np.array([line is not None for line in rows])
    return np.where(known[:, None], worst, worst[0]).T
