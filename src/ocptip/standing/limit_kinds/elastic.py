"""Limits of what gives: forces and lift of compliant feet; with elastic joints no contact may be lost.

Programs approximate ringing by the overshoot of acceleration steps. For a motion that breaks the limit, GN
and GT at these steps are tightened, or where they do not count, GN and GT.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ocptip.standing.elastic.drives import on_its_drives
from ocptip.standing.elastic.feet import on_its_feet
from ocptip.standing.instants import Instants
from ocptip.standing.limit_kinds.jumps import AtJumps, Jumps
from ocptip.standing.limit_kinds.limit import (
    AskedLimit,
    InstantAt,
    Sampled,
    WholeMotionLimit,
    Worst,
    WrenchLimit,
)
from ocptip.standing.limit_kinds.nominal import ContactLimit
from ocptip.standing.limit_kinds.rows import NodeRows, RowNodes
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism

_TOUCH = 1e-6  # m: as what a foot counts that lets go and comes down at once
_TIGHTER, _TIGHTEST = 0.05, 0.2  # of the weight per foot: by how much feet are kept down more at a time


class FootForceLimit(WrenchLimit, AskedLimit):
    """Minimum normal force of a foot, as springs share the load while all press: linear in the wrench.

    It goes on smoothly below zero, where a foot would have to pull. The force of a clamp counts from minus
    its preload, at which its jaw yields; clamps that cannot yield have no limit.
    """

    name, result, setting = "foot force", "foot_force_N", "foot_force"
    of_contacts = least = affine = True

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        return robot.support.elastic is not None and bool(np.isfinite(robot.support.elastic.lowest).any())

    def __init__(self, robot: StandingMechanism, asked: Limits, joints: tuple[int, ...]) -> None:
        super().__init__(robot, asked, joints)
        elastic = robot.support.elastic
        assert elastic is not None  # it was wanted
        self._contacts = np.flatnonzero(np.isfinite(elastic.lowest))
        self._map, self._lowest = elastic.normal_map[self._contacts], elastic.lowest[self._contacts]
        self.width = len(self._map)
        self.unit = robot.mass * float(np.linalg.norm(robot.support.gravity)) / self.width or 1.0

    def forces(self, instants: Instants) -> np.ndarray:
        """(N, n), N."""
        return instants.wrenches @ self._map.T - self._lowest

    def measure(self, instants: Instants) -> np.ndarray:
        return -np.min(self.forces(instants), axis=1, keepdims=True)

    def detail(self, instant_at: InstantAt, time: float) -> str:
        return f"contact {self._number(np.argmin(self.forces(instant_at(time))[0]))}"

    def _number(self, row: int | np.integer) -> int:
        """Of a contact, from 1."""
        return int(self._contacts[row]) + 1

    def refusals(self, instants: Instants) -> list[str]:
        forces = self.forces(instants)[0]
        k = int(np.argmin(forces))
        if forces[k] >= self.number:
            return []
        return [
            f"foot {self._number(k)} bears {forces[k]:.4g} N at rest on its springs, must be >= "
            f"{self.number:.4g} N"
        ]

    def path_excess(self, instants: Instants) -> float:
        return float(self.number - np.min(self.forces(instants))) / self.unit

    def uses(self, instants: Instants) -> np.ndarray:
        return 1 + (self.number - self.forces(instants)) / self.unit

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.full(self.width, self.number / self.unit), np.full(self.width, np.inf)

    def rows_at(self, row_nodes: RowNodes, i: np.ndarray, k: np.ndarray) -> NodeRows:
        forces = row_nodes.y[:, row_nodes.columns.wrench] @ self._map.T - self._lowest
        return NodeRows(row_nodes, i, k, forces[i, k] / self.unit, self._map[k])

    def inner(self, asked: Limits) -> Limits:
        return self._raised(asked, 1e-4)

    def tightened(self, asked: Limits, excess: float) -> Limits:
        return self._raised(asked, min(excess / self.unit, _TIGHTER))

    def _raised(self, asked: Limits, share: float) -> Limits:
        return replace(asked, **{self.setting: getattr(asked, self.setting) + share * self.unit})


class JumpFootForceLimit(AtJumps, FootForceLimit):
    """The force of compliant feet under the loads at acceleration steps with their overshoot."""

    name, result, setting = "foot force at acceleration steps", "jump_foot_force_N", "jump_foot_force"

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        return asked.overshoot > 0 and FootForceLimit.wanted(robot, asked)

    def worst(self, values: np.ndarray, sampled: Sampled) -> list[Worst]:
        jumps = Jumps.of(sampled.motion)
        forces = self.forces(jumps.loads(self.robot, self.asked.overshoot))
        if not len(jumps):
            return [self.worst_value(np.inf, np.nan, "no acceleration steps")]
        i, k = np.unravel_index(np.argmin(forces), forces.shape)
        detail = f"contact {self._number(k)}, {jumps.words(int(i))}"
        return [self.worst_value(float(forces[i, k]), float(jumps.times[i]), detail)]


class FootLiftLimit(WholeMotionLimit):
    """Largest height of a foot above the ground in a whole motion on springs.

    Programs know nothing of swings; for a motion that breaks the limit feet are kept down more.
    """

    name, result, setting = "foot lift", "foot_lift_m", "foot_lift"

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        return robot.swings

    def worst(self, values: np.ndarray, sampled: Sampled) -> list[Worst]:
        feet_motion = on_its_feet(self.robot, sampled.motion)
        if feet_motion is None:
            return []
        time, detail = feet_motion.end, ""
        if feet_motion.lifts:
            time, detail = feet_motion.lifts[0].time, f"contact {feet_motion.lifts[0].contact}"
        excess = feet_motion.lift - self.number
        if feet_motion.lifts and not self.number:
            excess = max(excess, _TOUCH)
        return [Worst(self.result, feet_motion.lift, time, self.number, detail, excess)]

    def tightened(self, asked: Limits, excess: float) -> Limits:
        """Feet are pressed more, by about what a spring needs that long.

        S-curves have no acceleration steps: the force after these alone would change nothing.
        """
        elastic = self.robot.support.elastic
        assert elastic is not None  # a robot that swings
        force = float(np.min(elastic.stiffness[:, 0])) * excess
        for kind in (FootForceLimit, JumpFootForceLimit):
            if kind.wanted(self.robot, asked):
                limit = kind(self.robot, asked, tuple(self.joints))
                asked = limit._raised(asked, float(np.clip(force / limit.unit, _TIGHTER, _TIGHTEST)))
        return asked


_TIGHTER_RINGING = 0.05  # by how much, at most, they are tightened at once


class RingingLimit(WholeMotionLimit, ContactLimit):
    """A quantity of the contacts under the loads while the drives ring, with the limit of acceleration
    steps.
    """

    words = "{} while gears ring", "{}_gears"
    after_steps = True
    of_contacts = of_motion = False

    @property
    def width(self) -> int:
        return 0  # programs know nothing of it

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        return robot.chain is not None and not robot.swings

    def worst(self, values: np.ndarray, sampled: Sampled) -> list[Worst]:
        drive_motion = on_its_drives(self.robot, sampled.motion)
        if drive_motion is None:
            return []
        worst = getattr(drive_motion, self.quantity.symbol)
        return [
            self.worst_value(
                worst.value, worst.time, "after the end" if worst.time > sampled.motion.end else ""
            )
        ]

    def tightened(self, asked: Limits, excess: float) -> Limits:
        name = self.setting if asked.overshoot > 0 else self.quantity.symbol
        number = getattr(asked, name)
        return replace(asked, **{name: max(number - min(max(excess, 0.01), _TIGHTER_RINGING), number / 2)})
