"""A motion task: robot on its support, start, goal, limits; what speaks against planning it."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from ocptip.contact import solve_many
from ocptip.errors import InputError, finite_array, is_whole
from ocptip.motion.cases import motion_case
from ocptip.motion.passive import ArmMotion
from ocptip.motion.proof import MotionLimits
from ocptip.motion.robot import experiment_robot
from ocptip.motion.standing import StandingMechanism

MOST_COMMANDS = 12
_ANGLE_TOLERANCE = 1e-9  # rad
_CONTACT_VERBS = {"slide": "slides", "separate": "lifts off", "yield": "yields"}


@dataclass(frozen=True, eq=False)
class MotionTask:
    """What is to be planned, or what a motion is checked against.

    Attributes:
        name: for messages and titles.
        robot: the arm, or the parallel robot, on its support.
        start, goal: joint angles, (n,), rad, or the platform's coordinates, m and rad.
        limits: reserves, torques, clearance.
        optimised: joints with ramp parameters, counted from 0, increasing; the others are passive.
        commands: ramp commands per optimised joint, at most 12.
        reference: a motion to compare with.
    """

    name: str
    robot: StandingMechanism
    start: np.ndarray
    goal: np.ndarray
    limits: MotionLimits = field(default_factory=MotionLimits)
    optimised: tuple[int, ...] = (0, 1, 2)
    commands: int = 3
    reference: ArmMotion | None = None

    def __post_init__(self) -> None:
        """Raise InputError if shapes or numbers of joints do not fit, or there is nothing to optimise."""
        n = self.robot.n
        for name in ("start", "goal"):
            angles = finite_array(name, getattr(self, name), (n,))
            angles.flags.writeable = False
            object.__setattr__(self, name, angles)
        if not isinstance(self.limits, MotionLimits):
            raise InputError(f"limits: expected MotionLimits, got {self.limits!r}")
        joints = tuple(self.optimised)
        if not joints or not all(is_whole(j) and 0 <= j < n for j in joints):
            raise InputError(f"optimised: expected joints of 0 to {n - 1}, at least one, got {joints}")
        if any(b <= a for a, b in pairwise(joints)):
            raise InputError(f"optimised: joints must increase, got {joints}")
        object.__setattr__(self, "optimised", tuple(map(int, joints)))
        check_commands("commands", self.commands)
        if self.reference is not None and self.reference.n != n:
            raise InputError(f"reference: has {self.reference.n} joints, the {self.robot.kind} has {n}")


def experiment_task(name: str, base: str = "effective", limits: MotionLimits | None = None) -> MotionTask:
    """The task of a printed case, with its printed solution as reference.

    Args:
        name: "A" to "H".
        base: "printed" or "effective", see `experiment_robot`.
        limits: default 0.9 for both reserves, the arm's torques, no collision.

    Raises:
        InputError: there is no such case or base.
    """
    case = motion_case(name)
    robot = experiment_robot(case, base)
    reference = case.reference_motion(robot.limits.speed, robot.limits.acceleration)
    return MotionTask(name, robot, case.start, case.goal, limits or MotionLimits(), reference=reference)


def refusals(task: MotionTask) -> tuple[str, ...]:
    """Why no plan can succeed, one sentence with numbers per reason; empty if nothing speaks against trying.

    Start and goal have to keep the joints' limits, the clearance, and at rest the reserves and the torques;
    every joint needs limits of speed and acceleration.
    """
    limits, found = task.robot.limits, []
    for name, values in (("speed", limits.speed), ("acceleration", limits.acceleration)):
        if numbers := [str(j + 1) for j in np.flatnonzero(~np.isfinite(values))]:
            found.append(f"joints without {name} limit: {', '.join(numbers)}; every joint needs one")
    for where, angles in (("start", task.start), ("goal", task.goal)):
        found += [f"{where}: {reason}" for reason in posture_refusals(task.robot, task.limits, angles)]
    return tuple(found)


def require_plannable(task: MotionTask) -> None:
    """Raise InputError with all reasons of :func:`refusals` if there are any."""
    if reasons := refusals(task):
        raise InputError(f"{task.name}: cannot be planned: {'; '.join(reasons)}")


def posture_refusals(robot: StandingMechanism, limits: MotionLimits, q: np.ndarray) -> list[str]:
    """Why the mechanism cannot rest at angles or coordinates q, (n,)."""
    zero, found = np.zeros((1, robot.n)), []
    low, high = robot.limits.angle_min, robot.limits.angle_max
    for j in np.flatnonzero((q < low - _ANGLE_TOLERANCE) | (q > high + _ANGLE_TOLERANCE)):
        values, unit = (q[j], low[j], high[j]), "m"
        if robot.units[j] == "rad":
            values, unit = np.rad2deg(values), "degrees"
        digits = 2 if unit == "degrees" else 4
        at, least, greatest = (f"{value:.{digits}f}" for value in values)
        found.append(f"joint {j + 1} at {at} {unit} is outside its limits {least} to {greatest}")
    gap, pair, _ = robot.collision.worst(q)
    if gap < 0:
        found.append(f"collision: spheres {pair} overlap by {-1e3 * gap:.1f} mm")
    elif gap < limits.clearance:
        least = 1e3 * limits.clearance
        found.append(f"spheres {pair} are {1e3 * gap:.1f} mm apart, must be >= {least:.1f} mm (clearance)")
    torques, wrenches = robot.loads(q[None], zero, zero)
    allowed = limits.torque_ratio * robot.limits.torque
    for j in np.flatnonzero(np.abs(torques[0]) > allowed):
        needs, unit = f"{abs(torques[0, j]):.4g}", robot.motor_units[j]
        found.append(
            f"joint {j + 1} needs {needs} {unit} to hold the {robot.kind}, must be <= {allowed[j]:.4g}"
        )
    further = robot.further_limits
    values = robot.further(q[None], zero)[0]
    for k in np.flatnonzero(further.excess(values) > 0):
        value, limit, least = further.described(k, float(further.excess(values)[k]))
        sign = ">=" if least else "<="
        found.append(f"{further.names[k]} of {further.details[k]} is {value:.4g}, must be {sign} {limit:.4g}")
    return found + _standing_refusals(robot, limits, wrenches)


def _standing_refusals(robot: StandingMechanism, limits: MotionLimits, wrenches: np.ndarray) -> list[str]:
    """Why the base does not stand safely under a wrench, (1, 6), N and N m."""
    states = solve_many(robot.support, wrenches)
    if not states[0].solved:
        return [f"no verified contact state at rest: {states[0].status}"]
    if not states[0].persistent:
        modes = enumerate(states[0].modes, 1)
        moving = [f"contact {k} {_CONTACT_VERBS.get(m, m)}" for k, m in modes if m != "stick"]
        return [f"the base does not stand at rest: {', '.join(moving)}"]
    tip, slip = robot.tip_over.evaluate(states), robot.slip.evaluate(states, derivatives=False)
    found = []
    if not tip.GN[0] <= limits.GN:
        index, where = int(tip.nearest_axis[0]), ""
        if 0 <= index < len(robot.tip_over.axes):
            first, second = sorted(robot.tip_over.axes[index].contacts)
            where = f" (tipping axis through contacts {first + 1} and {second + 1}, moment reserve "
            where += f"{tip.moments[0, index]:.4g} N m)"
        found.append(f"tip-over GN is {tip.GN[0]:.4g} at rest, must be <= {limits.GN:.4g}{where}")
    if not slip.solved[0]:
        found.append(f"no verified slip reserve at rest: {slip.status[0]}")
    elif not slip.GT[0] <= limits.GT:
        usage = np.nan_to_num(slip.usage[0])
        found.append(
            f"slip GT is {slip.GT[0]:.4g} at rest, must be <= {limits.GT:.4g} (contact "
            f"{int(np.argmax(usage)) + 1} uses {100 * usage.max():.0f} % of its friction)"
        )
    return found


def check_commands(name: str, commands: object) -> None:
    """Raise InputError if this cannot be a number of ramp commands; more than a dozen gain nothing."""
    if not is_whole(commands) or not 1 <= commands <= MOST_COMMANDS:
        raise InputError(f"{name}: must be a whole number >= 1 and <= {MOST_COMMANDS}, got {commands!r}")
