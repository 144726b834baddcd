"""Maximum torques within an uncertainty: as the trusted checker, which is independent, and as Pinocchio."""

from dataclasses import replace
from itertools import product

import numpy as np
import pinocchio as pin
import pytest

from ocptip.certificate.describe import model_data, tolerance_data
from ocptip.certificate.trusted.drives import Drives
from ocptip.certificate.trusted.forms import Form
from ocptip.published.tasks import experiment_task
from ocptip.robots.payload import Payload
from ocptip.robots.process import ProcessWrench
from ocptip.standing.arm import Robot
from ocptip.standing.tolerance import NONE, SITE, Uncertainty
from ocptip.standing.within.in_motion import worst_within
from ocptip.standing.within.torques import maximum_torques
from ocptip.trajectories.trajectory import Trajectory
from tests.quick import some
from tests.robots.pinocchio_twin import dynamics, twin
from tests.robots.test_coupled_joints import arm_of

HELD = Payload(2.0, [0.05, -0.1, 0.2], np.diag([0.02, 0.03, 0.04]))
PRESSED = ProcessWrench([10.0, -5.0, 3.0], [1.0, 2.0, -1.0])
EVERYTHING = replace(SITE, payload_center=(0.01, 0.02, 0.0))


def checker(robot, tolerance, states):
    """What the trusted checker bounds at single instants."""
    data = tolerance_data(tolerance.of(robot.payload), robot.support)
    forms = [Form.of(part.T) for part in states]
    return Drives(model_data(robot), data).greatest(*forms, np.zeros((2, len(states[0])))).T


def none(states):
    return np.empty((len(states[0]), 0))


@pytest.fixture(params=["B", "holding", "pressing", "sliding and coupled"])
def robot(request, tmp_path):
    robot = experiment_task("B").robot
    if request.param == "sliding and coupled":
        arm = arm_of(tmp_path, 3, [False, True, False, False], {4: (1, -0.5, 0.2)})
        return Robot(arm.with_payload(HELD), robot.support, robot.motors)
    arm = robot.arm if request.param == "B" else robot.arm.with_payload(HELD)
    return robot.varied(arm=arm.with_process(PRESSED) if request.param == "pressing" else arm)


@pytest.mark.filterwarnings("ignore::ocptip.basics.errors.InputWarning")  # odd masses
@pytest.mark.parametrize(
    "tolerance", some(1, [EVERYTHING, NONE, SITE]), ids=["everything", "nothing", "site"]
)
def test_they_are_those_of_the_independent_checker(robot, tolerance):
    rng = np.random.default_rng(0)
    states = [rng.uniform(-k, k, (40, robot.n)) for k in (3, 2, 10)]
    found, wanted = (
        maximum_torques(robot, tolerance, *states, none(states)),
        checker(robot, tolerance, states),
    )
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9 * np.max(wanted))
    nominal = np.abs(robot.loads(*states)[0])
    if tolerance is NONE:
        np.testing.assert_allclose(found, nominal, rtol=1e-9, atol=1e-9 * np.max(nominal))
    else:
        assert np.all(found >= nominal - 1e-9)


def test_pinocchio_reaches_the_reported_worst_with_other_inertias():
    task = experiment_task("B")
    robot = task.robot.varied(arm=task.robot.arm.with_payload(HELD))
    tolerance = Uncertainty(arm_mass=0.1, payload_mass=0.2, extra_mass=0.5, speed=0.05)
    motion = Trajectory.ending_together(
        task.start, task.goal, [None] * robot.n, robot.limits.speed / 2, robot.limits.acceleration / 4
    )
    worst = worst_within(robot, motion, tolerance, motion.both_sides(0.02)).torque
    q, qd, qdd = (part[0] for part in motion.states(np.array([worst.time])))
    bare, joint, found = robot.arm.with_payload(None), worst.joint - 1, []
    mass, centre, inertia = HELD.seen_from(bare.tool_rotation, bare.offsets[-1])
    gravity, none = robot.support.gravity, np.zeros(3)

    def torque(links, held, extra, pace):
        """Of a world; the payload and the point mass as bodies of their own."""
        model = twin(bare, masses=links * bare.masses, inertias=links[:, None, None] * bare.inertias)
        body = pin.Inertia(held * mass, np.asarray(centre), held * np.asarray(inertia))
        model.appendBodyToJoint(model.njoints - 1, body, pin.SE3.Identity())
        point = pin.Inertia(extra, np.asarray(bare.offsets[-1]), np.zeros((3, 3)))
        model.appendBodyToJoint(model.njoints - 1, point, pin.SE3.Identity())
        return dynamics(model, q, pace * qd, pace**2 * qdd, gravity, none, none, none)[0][joint]

    for pace, held, extra in product((0.95, 1.05), (0.8, 1.2), (0.0, 0.5)):
        for ends in product((0.9, 1.1), repeat=len(bare.masses)):
            found.append(abs(torque(np.array(ends), held, extra, pace)))
    limit = robot.limits.torque[joint]
    assert max(found) == pytest.approx(worst.value * limit, rel=1e-9)
    assert worst.value * limit > 1.1 * abs(torque(np.ones(len(bare.masses)), 1.0, 0.0, 1.0))
