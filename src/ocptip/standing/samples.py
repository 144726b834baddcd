"""A standing mechanism at the instants of a motion, as checks, files and figures have it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ocptip.contact.states import ContactStates
from ocptip.reserves.slip import SlipReserve
from ocptip.reserves.tipping import TipOverReserve


@dataclass(frozen=True, eq=False)
class MotionSamples:
    """The states, torques, powers and loads at N instants of a motion.

    Attributes:
        times: (N,), s.
        angles, speeds, accelerations: (N, n), rad, rad/s, rad/s^2 (straight coordinates: m, m/s, m/s^2).
        torques: one per motor, (N, n), N m, torques of the joints (forces of linear motors: N).
        powers: one per motor, W, electric power of the motors.
        wrenches: (N, 6), N and N m: on the base about its centre of mass, its weight included.
        states: contact states under these wrenches.
        tip, slip: GN and GT of these states.
        clearances: (N,), m, smallest distance of what may collide; infinite where that is not known.
        steady_power: W, electric power of clamps.
        further: (N, k) quantities of :class:`FurtherLimits`; (N, 0) for an arm.
        units: of the coordinates, "rad" or "m"; empty: rad.
        motor_units: "N m" or "N"; empty: N m.
        further_names: (k,) of the columns of `further`.
        gripper: (N, 7): position of the gripper, m, and its axes as a quaternion x, y, z, w, base frame;
            (N, 0) where there is none.
        sensor: (N, 6), N and N m: force and moment on the force-torque sensor, in its axes.
        sensor_name: begins the names of its columns.
    """

    times: np.ndarray
    angles: np.ndarray
    speeds: np.ndarray
    accelerations: np.ndarray
    torques: np.ndarray
    powers: np.ndarray
    wrenches: np.ndarray
    states: ContactStates
    tip: TipOverReserve
    slip: SlipReserve
    clearances: np.ndarray
    further: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    units: tuple[str, ...] = ()
    motor_units: tuple[str, ...] = ()
    further_names: tuple[str, ...] = ()
    gripper: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    sensor: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    sensor_name: str = ""
    steady_power: float = 0.0

    @property
    def total_power(self) -> np.ndarray:
        """(N,), W: of motors and clamps."""
        return self.powers.sum(axis=1) + self.steady_power
