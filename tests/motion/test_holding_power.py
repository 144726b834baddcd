"""Power that holds force-constant clamps: part of energies, and of what is least."""

import json
from dataclasses import replace

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.clamps import ForceConstantHalfRigidClamp, ForceConstantTwoSidedClamp
from ocptip.motion.check import check_motion
from ocptip.motion.objective import ENERGY, TIME, priced
from ocptip.motion.planner.formulation import Formulation
from ocptip.motion.task import Segment
from ocptip.placement.power import HoldingPower
from ocptip.published.tasks import experiment_task
from ocptip.retiming.retime import retime
from ocptip.robots.motors import DCMotors
from ocptip.standing.limits import Limits
from ocptip.task_files.scene import read_scene
from ocptip.trajectories.path_fit import path_of_motion
from ocptip.trajectories.trajectory import Trajectory
from tests.places import ROOT
from tests.quick import some

WATTS = 60.0


def of_case_c(watts=0.0):
    """Task of case C, whose third contact is pressed by a weight, or by an actuator."""
    task = experiment_task("C")
    own = task.robot.support
    contacts = [
        replace(c, holding_power=watts) if isinstance(c, ForceConstantHalfRigidClamp) else c
        for c in own.contacts
    ]
    return replace(task, robot=task.robot.varied(support=own.varied(contacts)))


def plan_c():
    return Trajectory.from_dict(
        json.loads((ROOT / "studies/results/plans/C-effective/plan.json").read_text())
    )


def test_energy_of_a_motion_has_it_for_as_long_as_it_takes():
    motion, (weight, actuator) = plan_c(), (of_case_c(w).robot for w in (0.0, WATTS))
    assert actuator.support.power == WATTS
    more = WATTS * motion.end
    assert actuator.energy(motion) - weight.energy(motion) == pytest.approx(more)
    assert check_motion(actuator, motion).energy == pytest.approx(check_motion(weight, motion).energy + more)
    times = np.linspace(0, motion.end, 5)
    one, other = (robot.samples(motion, times).total_power for robot in (actuator, weight))
    assert np.allclose(one - other, WATTS)
    segments = [Segment("to", of_case_c(w), dwell=1.0) for w in (WATTS, 0.0)]
    assert np.subtract(*(own.standby(motion.goal) for own in segments)) == pytest.approx(WATTS)


@pytest.mark.parametrize("objective", some(2, [ENERGY, TIME, priced(20.0)]))
def test_programs_have_it_in_their_cost(objective):
    energy, duration = 123.0, 4.5
    without = objective.with_power(WATTS).cost(energy - WATTS * duration, duration)
    assert without == pytest.approx(objective.cost(energy, duration))
    costs = []
    for watts in (0.0, WATTS):
        task = of_case_c(watts)
        form = Formulation(
            task.robot, task.start, task.goal, task.optimised, task.commands, objective,
            (task.limits.min_duration, task.limits.max_duration),
        )  # fmt: skip
        costs.append(form.objective)
    assert costs[1].time_weight - costs[0].time_weight == pytest.approx(objective.energy_weight * WATTS)
    assert costs[0] is objective


@pytest.mark.slow
def test_the_cheapest_timing_is_faster_where_holding_costs():
    """Of an arm whose timings are exact, DC motors: with a coarse grid."""
    task, path = of_case_c(), path_of_motion(plan_c()).path
    n = task.robot.n
    motors = DCMotors(np.full(n, 5.0), np.full(n, 2.0), np.full(n, 1.0), np.full(n, 0.5))
    found = []
    for watts in (0.0, WATTS):
        robot = of_case_c(watts).robot.varied(motors=motors)
        found.append(retime(robot, path, Limits(), ENERGY, nodes=60))
    assert found[1].motion.end < found[0].motion.end - 0.01
    weights = found[0].check.energy - found[1].check.energy + WATTS * found[1].motion.end
    assert weights < 1e-3  # without holding, the slower timing is the cheaper one


def test_placements_have_it_in_ge():
    motors = experiment_task("C").robot.motors
    torques = np.array([[10.0, -5.0, 3.0, 1.0, -1.0, 0.1]])
    one, other = HoldingPower(motors, WATTS), HoldingPower(motors)
    assert one.values(torques) - other.values(torques) == pytest.approx(WATTS)
    values = [power.derivatives(6)(torques) for power in (one, other)]
    assert values[0][0] - values[1][0] == pytest.approx(WATTS)
    assert np.allclose(values[0][1], values[1][1])


def test_clamps_of_a_file(tmp_path):
    text = """
[base]
mass = 20
center_of_mass = [0, 0, 0.2]
[[contact]]
position = [0.3, 0, 0]
friction = 0.5
[[contact]]
position = [-0.3, 0.3, 0]
friction = 0.5
{extra}
[[contact]]
kind = "force-constant-two-sided-clamp"
position = [-0.3, -0.3, 0]
friction_upper = 0.3
friction_lower = 0.3
clamp_force = 50
holding_power = {watts}
"""
    path = tmp_path / "scene.toml"
    path.write_text(text.format(watts=12, extra=""))
    support = read_scene(path).support
    assert isinstance(support.contacts[2], ForceConstantTwoSidedClamp)
    assert support.power == 12.0
    path.write_text(text.format(watts=-1, extra=""))
    with pytest.raises(InputError, match=r"contact\[3\]\.holding_power: must be >= 0"):
        read_scene(path)
    path.write_text(text.format(watts=12, extra="holding_power = 3"))
    with pytest.raises(InputError, match=r"contact\[2\]\.holding_power: unknown key"):
        read_scene(path)
