"""Electric power of joint drives: measured maps of the modular arms, and a DC-motor model for other robots.

Both take the drive torque (2.44: positive when it drives the joint in its positive direction) and the joint
speed (of sliding joints the force: N for N m and m for rad throughout), give watts, and have a step at zero
speed, where friction changes its sign. `direction` gives the sign: inside a phase of constant sign an
optimiser passes that sign and gets a smooth expression.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError, finite_array, positive_number
from ocptip.basics.frozen import settle
from ocptip.robots.model import ArmModel


class Motors(Protocol):
    """Drives of n joints."""

    def power(self, torque: np.ndarray, speed: np.ndarray, direction: np.ndarray | None = None) -> np.ndarray:
        """Electric power (N, n) or (n,), W.

        Args:
            torque: (N, n) or (n,), N m, drive torque.
            speed: same shape, rad/s.
            direction: same shape or (n,), +1 or -1; the sign of the speed by default, +1 at rest.
        """
        ...

    def power_expression(self, torque: cs.SX, speed: cs.SX, direction: Any) -> cs.SX:
        """Electric power for CasADi columns (n,), W; `direction`: numbers or symbols of value +1 or -1."""
        ...


@dataclass(frozen=True, eq=False)
class PowerMaps:
    """Measured maps (6.7), polynomials in load torque (cubic) and speed (quadratic).

    The maps were measured by lifting and lowering weights: their M is the *load* torque, opposite to the
    drive torque. Read so, lifting costs more than the mechanical power and lowering feeds back less, as
    thesis M says ("load torque and speed of opposite sign: highest power"). For negative speed P(M, w) =
    P(-M, -w) (6.8).

    Attributes:
        coefficients: (n, 12), A per powers of N m and degrees per second, order of table 6.1.
        voltage: V.
        torque_reading: "load" (M = -drive torque, energy-consistent) or "drive" (M = +drive torque, the
            literal reading of (2.44) put into (6.7); it lets a drive deliver more than it consumes. For
            comparison only).
    """

    coefficients: np.ndarray
    voltage: float = 24.0
    torque_reading: str = "load"

    def __post_init__(self) -> None:
        settle(self, coefficients=finite_array("coefficients", self.coefficients, (None, 12)))
        positive_number("voltage", self.voltage)
        if self.torque_reading not in ("load", "drive"):
            raise InputError(f"torque_reading: must be 'load' or 'drive', got {self.torque_reading!r}")

    def power(self, torque: np.ndarray, speed: np.ndarray, direction: np.ndarray | None = None) -> np.ndarray:
        """Electric power, W; see :class:`Motors`.

        Raises:
            InputError: shapes do not fit, or NaN.
        """
        torque, speed, direction = _checked(torque, speed, direction, len(self.coefficients))
        return self._map(list(self.coefficients.T), torque, speed, direction)

    def power_expression(self, torque: cs.SX, speed: cs.SX, direction: Any) -> cs.SX:
        """Electric power, W, as CasADi column; see :class:`Motors`."""
        columns = [cs.DM(column) for column in self.coefficients.T]
        return self._map(columns, torque, speed, _column(direction))

    def _map(self, c: list, torque: Any, speed: Any, direction: Any) -> Any:
        sign = -1.0 if self.torque_reading == "load" else 1.0
        M = (sign * direction) * torque
        w = direction * speed * (180.0 / np.pi)  # the table is in degrees per second

        def cubic(k: int) -> Any:
            return c[k] + M * (c[k + 1] + M * (c[k + 2] + M * c[k + 3]))

        return self.voltage * (cubic(0) + w * (cubic(4) + w * cubic(8)))


@dataclass(frozen=True, eq=False)
class DCMotors:
    """Geared DC (or brushless, torque-controlled) motors: copper loss, friction, mechanical power, standby.

    P = standby + f((tau_m / K)^2 + tau_m w) with tau_m = tau + coulomb sign(w) + viscous w; f(x) = x for x >=
    0 and regeneration * x below: power that comes back is stored only in part. All on the joint side of the
    gear. The rotor's inertia is not here but in `ArmModel.armature`.

    Attributes:
        motor_constant: (n,), K, N m per sqrt(W): joint torque per square root of copper loss, = gear ratio *
            torque constant / sqrt(winding resistance).
        coulomb: (n,), N m, dry friction.
        viscous: (n,), N m s/rad.
        standby: (n,), W: electronics and brakes, drawn at all times.
        regeneration: 0 (returned power is burnt in a chopper) to 1 (fully reused).
        smoothing: W: CasADi form only, half width of the rounded kink of f where regeneration < 1.
    """

    motor_constant: np.ndarray
    coulomb: np.ndarray
    viscous: np.ndarray
    standby: np.ndarray
    regeneration: float = 0.0
    smoothing: float = 0.1

    def __post_init__(self) -> None:
        n = np.size(self.motor_constant)
        for name in ("motor_constant", "coulomb", "viscous", "standby"):
            value = finite_array(name, getattr(self, name), (n,))
            if (value < 0).any() or (name == "motor_constant" and (value == 0).any()):
                raise InputError(
                    f"{name}: must be {'> 0' if name == 'motor_constant' else '>= 0'}, got {value}"
                )
            settle(self, **{name: value})
        if not 0 <= positive_number("regeneration", self.regeneration, zero_allowed=True) <= 1:
            raise InputError(f"regeneration: must be 0 to 1, got {self.regeneration}")
        positive_number("smoothing", self.smoothing)

    @classmethod
    def from_datasheet(
        cls,
        *,
        resistance: np.ndarray,
        torque_constant: np.ndarray,
        gear_ratio: np.ndarray,
        coulomb: np.ndarray,
        viscous: np.ndarray,
        standby: np.ndarray,
        regeneration: float = 0.0,
    ) -> DCMotors:
        """From motor data: resistance (n,), ohm; torque constant (n,), N m/A; gear ratio (n,).

        Friction and standby power as in the class, on the joint side of the gear.

        Raises:
            InputError: lengths differ, or a value that must be positive is not.
        """
        n = np.size(resistance)
        columns = {"resistance": resistance, "torque_constant": torque_constant, "gear_ratio": gear_ratio}
        R, k, gear = (finite_array(name, value, (n,)) for name, value in columns.items())
        for name, value in zip(columns, (R, k, gear), strict=True):
            if (value <= 0).any():
                raise InputError(f"{name}: must be > 0, got {value}")
        return cls(gear * k / np.sqrt(R), coulomb, viscous, standby, regeneration)

    @classmethod
    def estimated(cls, model: ArmModel, *, regeneration: float = 0.0, standby: float = 5.0) -> DCMotors:
        """A stand-in where no motor data are at hand, from the arm's torque and speed limits.

        Dry friction 5 % of the torque limit, viscous friction 5 % of it at the speed limit, copper loss at
        the torque limit 30 % of torque limit times speed limit: round figures for harmonic-drive joints, an
        assumption. With them plans compare motions of one robot; they do not predict its meter.

        Args:
            regeneration: see the class.
            standby: W per joint.

        Raises:
            InputError: a torque or speed limit is infinite.
        """
        torque, speed = model.limits.torque, model.limits.speed
        for name, value in (("torque", torque), ("speed", speed)):
            if not np.isfinite(value).all():
                raise InputError(
                    f"limits.{name}: motors cannot be estimated without finite limits, got {value}"
                )
        return cls(
            motor_constant=torque / np.sqrt(0.3 * torque * speed),
            coulomb=0.05 * torque,
            viscous=0.05 * torque / speed,
            standby=np.full(model.n, standby),
            regeneration=regeneration,
        )

    def power(self, torque: np.ndarray, speed: np.ndarray, direction: np.ndarray | None = None) -> np.ndarray:
        """Electric power, W; see :class:`Motors`.

        Raises:
            InputError: shapes do not fit, or NaN.
        """
        torque, speed, direction = _checked(torque, speed, direction, len(self.coulomb))
        drawn = self._drawn(torque, speed, direction, self.motor_constant, self.coulomb, self.viscous)
        return self.standby + np.where(drawn > 0, drawn, self.regeneration * drawn)

    def power_expression(self, torque: cs.SX, speed: cs.SX, direction: Any) -> cs.SX:
        """Electric power, W, as CasADi column; at most (1 - regeneration) smoothing / 2 above `power`."""
        constants = (cs.DM(value) for value in (self.motor_constant, self.coulomb, self.viscous))
        drawn = self._drawn(torque, speed, _column(direction), *constants)
        if self.regeneration < 1:
            positive = (drawn + cs.sqrt(drawn**2 + self.smoothing**2)) / 2
            drawn = self.regeneration * drawn + (1 - self.regeneration) * positive
        return cs.DM(self.standby) + drawn

    @staticmethod
    def _drawn(torque: Any, speed: Any, direction: Any, constant: Any, coulomb: Any, viscous: Any) -> Any:
        motor = torque + coulomb * direction + viscous * speed
        return (motor / constant) ** 2 + motor * speed


def _column(direction: Any) -> Any:
    """A CasADi column out of a sequence; CasADi values and single numbers as they are."""
    if isinstance(direction, cs.SX | cs.MX | cs.DM) or np.ndim(direction) == 0:
        return direction
    return cs.vertcat(*direction)


def _checked(
    torque: np.ndarray, speed: np.ndarray, direction: np.ndarray | None, joints: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    shape = (joints,) if np.ndim(torque) < 2 else (None, joints)
    tau = finite_array("torque", torque, shape)
    w = finite_array("speed", speed, tau.shape)
    if direction is None:
        return tau, w, np.where(w < 0, -1.0, 1.0)
    sign = finite_array("direction", direction, (joints,) if np.ndim(direction) < 2 else tau.shape)
    if not np.isin(sign, (-1.0, 1.0)).all():
        raise InputError("direction: must be +1 or -1 everywhere")
    return tau, w, sign
