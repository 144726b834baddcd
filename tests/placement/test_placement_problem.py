"""Problems are refused at the door with the name, the value and what would be right."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.placement.power import HoldingPower, TorqueCost
from ocptip.placement.problem import (
    GripperTask,
    PlacementLimits,
    PlacementProblem,
    ProcessLoad,
    Weights,
    sampled_loads,
)
from ocptip.placement.terrain import plane
from ocptip.published.arms import load_arm, modular_motors
from ocptip.standing.arm import Robot
from tests.placement.placement_scenes import (
    INTO_WALL,
    drilling,
    four_feet,
    modular_robot,
    planar_arm,
    planar_problem,
)
from tests.quick import some


@pytest.mark.parametrize("half_angle", some(1, [0.3, np.pi, 0.02, 0.61, 1.5, 2.0]))
@pytest.mark.parametrize("count", some(2, [None, 7, 4, 40]))
def test_sampled_loads_enclose_a_cone(half_angle, count):
    loads = sampled_loads(20.0, count, axis=[0, -2.0, 0], half_angle=half_angle)
    forces = np.array([load.force for load in loads]) / 20.0
    assert count in (None, len(forces))
    assert np.linalg.norm(forces, axis=1).max() < (1.02 + 1e-9 if count is None else 3.01)
    rng = np.random.default_rng(0)
    along = 1 - (1 - np.cos(half_angle)) * rng.random(60)
    along[:30] = np.cos(half_angle)
    turn, across = rng.uniform(-np.pi, np.pi, 60), np.sqrt(1 - along**2)
    balance = np.vstack([forces.T, np.ones(len(forces))])
    for e in np.column_stack([across * np.cos(turn), -along, across * np.sin(turn)]):
        mixed = linprog(np.zeros(len(forces)), A_eq=balance, b_eq=np.r_[e, 1.0])
        assert mixed.success  # a mean of the corners


def test_sampled_loads_refuse_what_is_no_cone():
    with pytest.raises(InputError, match="half_angle"):
        sampled_loads(1.0, 4, half_angle=4.0)
    with pytest.raises(InputError, match="count: must be a whole number >= 4"):
        sampled_loads(1.0, 3)
    with pytest.raises(InputError, match="axis"):
        sampled_loads(1.0, 4, axis=[0, 0, 0])


def test_a_margin_that_leaves_a_joint_no_angle_is_refused():
    limits = PlacementLimits(angle_margin=np.radians(80.0))
    with pytest.raises(InputError, match="limits: angle_margin_deg: 80 deg leave shoulder no angle"):
        replace(planar_problem(), limits=limits)


def test_weights_sum_to_one():
    assert Weights(1, 1, 0, 2).array() == pytest.approx([0.25, 0.25, 0, 0.5])
    with pytest.raises(InputError, match="at least one must be > 0"):
        Weights(0, 0, 0, 0)
    with pytest.raises(InputError, match=r"weights\.GK"):
        Weights(GK=-1.0)


def test_load_cases_start_with_the_unloaded_one():
    problem = drilling()
    assert [(c.name, c.counts, c.constrained) for c in problem.cases] == [
        ("without process load", False, True),
        ("thrust", True, True),
    ]
    problem = drilling(tasks=GripperTask([0, 0, 0.5], INTO_WALL), unloaded=False)
    assert [(c.name, c.counts, c.constrained) for c in problem.cases] == [
        ("without process load", True, True)
    ]
    problem = drilling(unloaded=False)
    assert [(c.counts, c.constrained) for c in problem.cases] == [(False, False), (True, True)]


def test_references():
    robot = modular_robot()
    full = robot.arm.limits.torque[None]
    assert drilling(robot).references["GE"] == pytest.approx(HoldingPower(robot.motors).values(full)[0])
    assert planar_problem().references["GE"] == 1.0
    assert drilling(references={"GE": 50.0}).references["GE"] == 50.0
    with pytest.raises(InputError, match="no criterion 'GX'"):
        drilling(references={"GX": 1.0})


def test_holding_power_does_not_depend_on_the_torques_sign():
    power = HoldingPower(modular_motors())
    torque = np.array([[10.0, -5.0, 3.0, 1.0, -1.0, 0.1]])
    assert power.values(torque) == pytest.approx(power.values(-torque))
    value, slope, bend = power.derivatives(6)(torque)
    assert value[0] == pytest.approx(power.values(torque)[0])
    for j, step in enumerate(1e-4 * np.eye(6)):
        up, middle, down = (power.values(torque + k * step)[0] for k in (1, 0, -1))
        assert slope[0, j] == pytest.approx((up - down) / 2e-4, abs=1e-6)
        assert bend[0, j] == pytest.approx((up - 2 * middle + down) / 1e-8, abs=1e-5)


def test_refusals():
    task = GripperTask([0, 0, 0.5], INTO_WALL)
    with pytest.raises(InputError, match=r"task: rotation: not a rotation"):
        GripperTask([0, 0, 0], np.ones((3, 3)))
    with pytest.raises(InputError, match="position"):
        GripperTask([0, np.nan, 0])
    with pytest.raises(InputError, match="orientation: expected one of full, axis, free"):
        GripperTask([0, 0, 0], orientation="any")
    with pytest.raises(InputError, match="tool_axis: must have length 1"):
        GripperTask([0, 0, 0], tool_axis=[0, 0, 2])
    with pytest.raises(InputError, match="loads: names must differ"):
        GripperTask([0, 0, 0], loads=[ProcessLoad(), ProcessLoad()])
    with pytest.raises(InputError, match="force"):
        ProcessLoad([1.0, 2.0])
    with pytest.raises(InputError, match="GN: must be above 0 and at most 1"):
        PlacementLimits(GN=1.5)
    with pytest.raises(InputError, match="condition"):
        PlacementLimits(condition=-3.0)
    with pytest.raises(InputError, match="tasks: names must differ"):
        drilling(tasks=[task, task])
    with pytest.raises(InputError, match="terrain: expected Patch"):
        drilling(terrain=[])
    with pytest.raises(InputError, match="obstacles: expected Wall, Pillar or Solid"):
        drilling(obstacles=["wall"])
    with pytest.raises(InputError, match="the arm has 6 joints, the torque cost 2"):
        drilling(energy=TorqueCost([1.0, 1.0]))
    with pytest.raises(InputError, match="needs 6 free parameters, arm 'planar' on this terrain has 5"):
        PlacementProblem(Robot(planar_arm(), four_feet().support, modular_motors()), task, plane())
    with pytest.raises(InputError, match="GE needs a reference power"):
        PlacementProblem(
            Robot(
                load_arm("FSFS").with_limits(torque=np.full(6, np.inf)),
                four_feet().support,
                modular_motors(),
            ),
            task,
            plane(),
        )


def test_contacts_at_different_heights_need_a_ground_frame():
    feet = [
        UnilateralContact(position=p, friction=0.5) for p in ([0.3, 0, 0], [-0.2, 0.3, 0.1], [-0.2, -0.3, 0])
    ]
    robot = Robot(load_arm("FSFS"), Support(feet, mass=9.0), modular_motors())
    task = GripperTask([0, 0, 0.5])
    with pytest.raises(InputError, match="ground_frame: the contacts have different heights"):
        PlacementProblem(robot, task, plane())
    frame = (np.array([0.0, 0.0, -0.1]), np.eye(3))
    problem = PlacementProblem(robot, task, plane(height=1.0), ground_frame=frame)
    origin, base = problem.base_pose(0, [[0.0, 0.0, 0.0]])
    assert origin[0] == pytest.approx([0.0, 0.0, 1.1])
    assert base[0] == pytest.approx(np.eye(3))
