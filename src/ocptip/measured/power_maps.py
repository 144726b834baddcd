"""Power maps of drives from samples of torque, speed and electric power (6.1.2, 6.7)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ocptip.basics.errors import InputError
from ocptip.robots.motors import PowerMaps

TERMS = 12
COLUMNS = {
    "torque_Nm": 1.0,
    "force_N": 1.0,
    "speed_deg_s": np.pi / 180,
    "speed_rad_s": 1.0,
    "speed_m_s": 1.0,
    "power_W": 1.0,
}
_UNSEEN = 1e-9  # share of the largest singular value
_EDGE = 1e-6  # of the ranges: this near to the hull is inside


@dataclass(frozen=True, eq=False)
class PowerMap:
    """The map of one drive.

    Attributes:
        coefficients: (12,), in W as `PowerMaps` has them with a voltage of 1 V.
        covariance: (12, 12).
        noise: W, rms of what is left.
        largest: W, largest residual.
        torque, speed: ranges of the samples, N m and rad/s, as drive torque at positive speed.
        hull: (k, 2) corners of the region that samples cover, in that order.
        count: samples.
    """

    coefficients: np.ndarray
    covariance: np.ndarray
    noise: float
    largest: float
    torque: tuple[float, float]
    speed: tuple[float, float]
    hull: np.ndarray
    count: int

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units."""
        return {
            "coefficients": self.coefficients.tolist(),
            "covariance": self.covariance.tolist(),
            "noise_W": self.noise,
            "largest_residual_W": self.largest,
            "torque_range": list(self.torque),
            "speed_range_rad_s": list(self.speed),
            "hull": self.hull.tolist(),
            "samples": self.count,
        }

    @property
    def covered(self) -> float:
        """Share of the rectangle of torques and speeds that the samples cover."""
        x, y = self.hull.T
        area = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
        return area / float(np.prod(np.ptp(self.hull, axis=0)))

    def error(self, torque: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """(N,) W, standard error of the map at torques and speeds (N,)."""
        rows = terms(torque, speed)
        return np.sqrt(np.einsum("nk,kl,nl->n", rows, self.covariance, rows))

    def outside(self, torque: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """(N,) True where no samples are around: the map is extrapolated there."""
        points = np.column_stack(_folded(torque, speed))
        size = np.ptp(self.hull, axis=0)
        after = np.roll(self.hull, -1, axis=0) - self.hull
        away = points[:, None] - self.hull
        left = after[:, 0] * away[..., 1] - after[:, 1] * away[..., 0]
        return (left < -_EDGE * size[0] * size[1]).any(axis=1)


def _folded(torque: np.ndarray, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Torque and speed mirrored to positive speed (6.8)."""
    direction = np.where(speed < 0, -1.0, 1.0)
    return direction * torque, direction * speed


def terms(torque: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """(N, 12) of the map per coefficient in W, of drive torques, N m, and speeds, rad/s."""
    folded, w = _folded(torque, speed)
    M, w = -folded, w * 180 / np.pi  # loads and degrees per second, see `PowerMaps`
    return np.stack([M**i * w**j for j in range(3) for i in range(4)], axis=1)


def fit_power_map(torque: np.ndarray, speed: np.ndarray, power: np.ndarray) -> PowerMap:
    """Least squares.

    Args:
        torque: (N,), N m, of the drive, behind the gear; sliding joints: N.
        speed: (N,), rad/s (m/s).
        power: (N,), W, electric.

    Raises:
        InputError: too few samples, or they do not tell all twelve coefficients.
    """
    if len(power) <= TERMS:
        raise InputError(f"more than {TERMS} samples are needed for {TERMS} coefficients, got {len(power)}")
    X = terms(torque, speed)
    size = np.linalg.norm(X, axis=0)
    if not size.all():
        raise InputError("samples tell no map: no torque or no speed in them")
    U, s, V = np.linalg.svd(X / size, full_matrices=False)
    if s[-1] < _UNSEEN * s[0]:
        folded, w = _folded(torque, speed)
        raise InputError(
            f"samples at {len(np.unique(folded))} torques and {len(np.unique(w))} speeds do not tell all "
            "coefficients: four torques and three speeds are needed at least, in all combinations"
        )
    result = (V.T / s) @ (U.T @ power) / size
    left = power - X @ result
    noise = float(np.sqrt(left @ left / (len(power) - TERMS)))
    inverse = (V.T / s**2) @ V / np.outer(size, size)
    folded, w = _folded(torque, speed)
    points = np.column_stack([folded, w])
    try:
        corners = points[ConvexHull(points, qhull_options="QJ").vertices]
    except QhullError as error:  # pragma: no cover - the rank has been looked at
        raise InputError("samples lie on a line of torque and speed") from error
    ends = [(float(x.min()), float(x.max())) for x in (folded, w)]
    return PowerMap(
        result, noise**2 * inverse, noise, float(np.abs(left).max()), ends[0], ends[1], corners, len(power)
    )


def samples_by_joint(
    header: Sequence[str], rows: np.ndarray
) -> Mapping[int, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Torques, speeds and powers by number of the joint, from 1; all of joint 1 where no column says it.

    Raises:
        InputError: a column is missing, unknown or there twice.
    """
    known = ["joint", *COLUMNS]
    for name in header:
        if name not in known or header.count(name) > 1:
            there = "there twice" if name in known else "unknown; samples are no recording"
            raise InputError(
                f"column {name!r}: {there}; expected power_W, one for torque_Nm or force_N, one for "
                "speed_deg_s, speed_rad_s or speed_m_s, and joint if there are several"
            )
    results = []
    for kind in ("torque_Nm force_N", "speed_deg_s speed_rad_s speed_m_s", "power_W"):
        columns = [name for name in kind.split() if name in header]
        if len(columns) != 1:
            raise InputError(f"expected one column of {' or '.join(kind.split())}")
        results.append(COLUMNS[columns[0]] * rows[:, header.index(columns[0])])
    joints = rows[:, header.index("joint")] if "joint" in header else np.ones(len(rows))
    if (joints != np.round(joints)).any() or (joints < 1).any():
        raise InputError("column joint: expected numbers from 1")
    return {
        int(j): (results[0][joints == j], results[1][joints == j], results[2][joints == j])
        for j in np.unique(joints)
    }


def motors_table(maps: Sequence[PowerMap]) -> dict[str, Any]:
    """The table `[motors]` of a task file, joint after joint."""
    return {
        "kind": "map",
        "voltage": 1.0,
        "coefficients": [index_map.coefficients.tolist() for index_map in maps],
    }


def motors_of(maps: Sequence[PowerMap]) -> PowerMaps:
    """Drives with these maps."""
    return PowerMaps(np.array([index_map.coefficients for index_map in maps]), voltage=1.0)
