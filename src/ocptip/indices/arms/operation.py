"""PI_OE and CDN_OE: how well a serial arm moves an operation ellipsoid.

The sum of squared velocities of the ellipsoid's vertices is zeta = w' Z w with Z = J' W J. It is extremised
over joint rates w of unit length (or of unit rotational energy, in the weighted form). PI_OE compares the
smallest value with what axis 6 alone can always do; CDN_OE compares smallest and largest. Source: [Naw07]
3.3, 3.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocptip.basics.errors import InputError, finite_array
from ocptip.basics.write import Record
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.reviewed import RANK_TOLERANCE, checked_jacobian


@dataclass(frozen=True, eq=False)
class OperationIndices(Record):
    """PI_OE and CDN_OE of N poses (no leading N for a single pose).

    Attributes:
        pi_oe: (N,) PI_OE in [0, 1] (3.15); NaN for more than six axes, where it has no bound.
        inv_cdn_oe: (N,) 1/CDN_OE in [0, 1] (3.21).
        eigenvalues: (N, 6) stationary values of zeta, largest first: m^2 for joint rates of unit length,
            m^2/s^2 per joule in the weighted form.
        rates: (N, 6, n) rows are the joint rates that belong to them.
        design_constant: (N,) DC, value of zeta when axis 6 turns alone (3.14); the same in all poses.
        weighted: True if the joint rates were weighted by moments of inertia.
    """

    pi_oe: np.ndarray
    inv_cdn_oe: np.ndarray
    eigenvalues: np.ndarray
    rates: np.ndarray
    design_constant: np.ndarray
    weighted: bool

    _plain = ("pi_oe", "inv_cdn_oe", "eigenvalues", "worst_rates", "design_constant", "weighted")

    @property
    def worst_rates(self) -> np.ndarray:
        """(N, n) joint rates that move the ellipsoid by the minimum amount; avoid them where the index is
        small.
        """
        return self.rates[..., -1, :]

    @property
    def singular(self) -> np.ndarray:
        """(N,) True where some joint rates leave the end-effector at rest."""
        return np.asarray(self.inv_cdn_oe == 0.0)[()]


def operation_indices(
    jacobian: np.ndarray,
    ellipsoid: OperationEllipsoid,
    rotation: object = None,
    position: object = None,
    *,
    inertias: object = None,
) -> OperationIndices:
    """PI_OE and CDN_OE of serial arms (4.1 to 4.3), or their energy-weighted versions (4.5).

    Args:
        jacobian: (..., 6, n), n >= 6, columns are the spears of the axes, base frame, moments in m.
        ellipsoid: operation ellipsoid on the last link.
        rotation, position: (..., 3, 3) and (..., 3), m: pose of the ellipsoid's frame in the base frame;
            default: the base frame itself.
        inertias: (..., n), kg m^2, > 0: moments of inertia of everything that axis i moves, about axis i.
            Given: joint rates of unit rotational energy; scaling all inertias changes no index.

    Raises:
        InputError: wrong shape, not finite, or an inertia that is not positive.
    """
    matrix = checked_jacobian(jacobian)
    columns = matrix.shape[-1]
    velocities = ellipsoid.factor(rotation, position) @ matrix
    weights = None if inertias is None else np.sqrt(0.5 * checked_inertias(inertias, columns))[..., None, :]
    if weights is not None:
        velocities = velocities / weights
    _, values, rates = np.linalg.svd(velocities, full_matrices=False)
    if weights is not None:
        rates = rates / weights
    largest = values[..., :1]
    values = np.where(values <= RANK_TOLERANCE * largest, 0.0, values)
    ratio = values[..., -1] / np.where(largest[..., 0] > 0, largest[..., 0], 1.0)
    last = np.linalg.norm(velocities[..., -1], axis=-1)
    share = np.minimum(values[..., -1] / last, 1.0) if columns == 6 else np.full(ratio.shape, np.nan)
    return OperationIndices(share[()], ratio[()], values**2, rates, (last**2)[()], inertias is not None)


def checked_inertias(inertias: object, columns: int, used: slice = slice(None)) -> np.ndarray:
    """Return the used ones of moments of inertia (..., columns), all positive, or raise InputError."""
    array = finite_array("inertias", inertias, (..., columns))[..., used]
    if not (array > 0).all():
        raise InputError(f"inertias: all must be > 0 and finite, got {array.tolist()}")
    return array
