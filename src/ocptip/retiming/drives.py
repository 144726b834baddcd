"""Drives whose electric power is quadratic: what makes the cheapest timing a convex program.

Of other drives, such as measured maps, the largest quadratic power below theirs gives a lower bound.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # subpackages load on first use

from ocptip.robots.model import JointLimits
from ocptip.robots.motors import DCMotors, Motors

_TORQUES, _SPEEDS, _FINER = 25, 17, 8
_SHIFTS = np.linspace(0.0, 0.4, 5)  # of the torque limit


@dataclass(frozen=True, eq=False)
class QuadraticDrives:
    """P = standby + f(loss m^2 + mechanical m w + rub |w| + drag w^2), m = torque + coulomb sign(w).

    f(e) = r e where e < 0. Every term but that of drag leaves P / |w| convex along a path.

    Attributes:
        loss: (n,), W per (N m)^2, >= 0.
        coulomb: (n,), N m.
        mechanical: (n,).
        rub: (n,), N m.
        drag: (n,), N m s/rad, >= 0.
        standby: W, of all drives, >= 0.
        regeneration: r, 0 to 1.
        exact: they are the robot's; else its power is nowhere below this.
    """

    loss: np.ndarray
    coulomb: np.ndarray
    mechanical: np.ndarray
    rub: np.ndarray
    drag: np.ndarray
    standby: float
    regeneration: float
    exact: bool = True

    @classmethod
    def free(cls, joints: int) -> QuadraticDrives:
        """Drives that need nothing."""
        none = np.zeros(joints)
        return cls(none, none, none, none, none, 0.0, 1.0)

    @classmethod
    def of(cls, motors: Motors, limits: JointLimits) -> QuadraticDrives:
        """The DC motors themselves; for other motors quadratic lower bounds, within torque and speed
        limits.
        """
        if not isinstance(motors, DCMotors):
            return _below(motors, limits)
        loss, viscous = motors.motor_constant**-2, motors.viscous
        mechanical, drag = 1 + 2 * loss * viscous, viscous * (1 + loss * viscous)
        none, standby = np.zeros_like(loss), float(np.sum(motors.standby))
        return cls(loss, motors.coulomb, mechanical, none, drag, standby, motors.regeneration)


def _below(motors: Motors, limits: JointLimits) -> QuadraticDrives:
    """By linear programs over samples of torque and speed; lower by what finer samples need."""
    n, results = len(limits.speed), []
    for joint in range(n):
        coarse, fine = (_sampled(motors, limits, joint, _TORQUES * k, _SPEEDS * k) for k in (1, _FINER))
        best = None
        for shift in _SHIFTS * limits.torque[joint]:
            terms = _terms(coarse[0] + shift, coarse[1])
            least = [(0, None), (0, None), (None, None), (None, None), (0, None)]
            fit = scipy.optimize.linprog(
                -terms.mean(axis=0), A_ub=terms, b_ub=coarse[2], bounds=least, method="highs"
            )
            if fit.success and (best is None or fit.fun < best[0]):
                best = fit.fun, shift, fit.x
        shift, values = (0.0, np.zeros(5)) if best is None else best[1:]
        above = float(np.max(_terms(fine[0] + shift, fine[1]) @ values - fine[2]))
        results.append((shift, *values, max(above, 0.0)))
    coulomb, standby, loss, mechanical, rub, drag, above = np.array(results).T
    total = float(np.sum(standby) - np.sum(above))
    return QuadraticDrives(loss, coulomb, mechanical, rub, drag, total, 1.0, exact=False)


def _terms(m: np.ndarray, w: np.ndarray) -> np.ndarray:
    return np.column_stack([np.ones_like(m), m**2, m * w, w, w**2])


def _sampled(
    motors: Motors, limits: JointLimits, joint: int, torques: int, speeds: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Torque, speed and power of one joint that turns forwards; backwards it is the same by symmetry."""
    grid = np.meshgrid(
        np.linspace(-1, 1, torques) * limits.torque[joint], np.linspace(0, 1, speeds) * limits.speed[joint]
    )
    torque, speed = (np.zeros((grid[0].size, len(limits.speed))) for _ in range(2))
    torque[:, joint], speed[:, joint] = grid[0].ravel(), grid[1].ravel()
    power = motors.power(torque, speed, np.ones_like(speed))[:, joint]
    return torque[:, joint], speed[:, joint], power
