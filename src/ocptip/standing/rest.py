"""Whether a standing mechanism can rest in a posture; if not, why, with numbers."""

from __future__ import annotations

import numpy as np

from ocptip.contact.solver import solve_many
from ocptip.standing.limits import MotionLimits
from ocptip.standing.mechanism import StandingMechanism

_ANGLE_TOLERANCE = 1e-9  # rad


_CONTACT_VERBS = {"slide": "slides", "separate": "lifts off", "yield": "yields"}


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
