"""Speed limits of points of an arm: values against Pinocchio, checks, timings and files that have them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from ocptip.basics.errors import InputError
from ocptip.certificate.checks import certified
from ocptip.certificate.find import certify
from ocptip.cli.main import main
from ocptip.motion.check import check_motion
from ocptip.motion.objective import TIME
from ocptip.motion.plan import plan_motion
from ocptip.published.tasks import experiment_task
from ocptip.retiming.retime import retime
from ocptip.robots.kinematics import PointSpeeds
from ocptip.robots.urdf.arm import arm_from_urdf
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.task_files.motion import load_task
from ocptip.trajectories.path_fit import path_of_motion
from tests.certificate.test_find import _nod as nod
from tests.motion.test_task import TWO_JOINTS, URDF
from tests.places import UR5
from tests.quick import some
from tests.robots.pinocchio_twin import twin

LATE = Uncertainty(delay=0.005, speed=0.02, friction=0.05)


@pytest.fixture(scope="module")
def task():
    return experiment_task("A", "effective")


def test_speeds_are_those_of_pinocchios_frames(task):
    arm = arm_from_urdf(UR5).mounted([0.1, 0.2, 0.7])
    elbow = arm.joint_names[2]
    robot = task.robot.varied(arm=arm, speed_limits={"tcp": 0.25, elbow: 0.5})
    rng, model = np.random.default_rng(0), twin(arm)
    data = model.createData()
    q, qd = rng.uniform(-2, 2, (2, 30, 6))
    qd[0] = 0.0
    found = robot.further(q, qd)
    for k in range(30):
        pin.forwardKinematics(model, data, q[k], qd[k])
        pin.updateFramePlacements(model, data)
        tcp = pin.getFrameVelocity(model, data, model.getFrameId("G"), pin.LOCAL_WORLD_ALIGNED).linear
        joint = pin.getVelocity(model, data, model.getJointId(elbow), pin.LOCAL_WORLD_ALIGNED).linear
        expected = np.linalg.norm(tcp), np.linalg.norm(joint)
        np.testing.assert_allclose(found[k], expected, rtol=1e-9, atol=2e-6)
    assert robot.further_limits.labels == ("tcp_speed_m_s_TCP", f"point_speed_m_s_{elbow}")


def test_a_check_finds_the_maximum(task):
    times = np.linspace(0, task.reference.end, 20_001)
    places = task.robot.tool(task.reference.states(times)[0])
    fastest = np.max(np.linalg.norm(np.diff(places, axis=0), axis=1)) / times[1]
    for share, kept in ((0.99, False), (1.01, True)):
        robot = task.robot.varied(speed_limits={"tcp": share * fastest})
        checked = check_motion(robot, task.reference, task.limits)
        assert checked.worst["tcp_speed_m_s"].value == pytest.approx(fastest, rel=1e-4)
        assert any(broken.name == "tcp_speed_m_s" for broken in checked.violations) != kept


def test_a_timing_of_a_path_keeps_the_limit_and_is_there_for_a_while(task):
    path = path_of_motion(task.reference).path
    robot = task.robot.varied(speed_limits={"tcp": 0.25})
    slow = retime(robot, path, task.limits, nodes=60)
    assert slow.verified
    assert slow.check.worst["tcp_speed_m_s"].value == pytest.approx(0.25, rel=2e-3)
    q, qd, _ = slow.motion.states(np.linspace(0, slow.motion.end, 400))
    assert np.mean(robot.further(q, qd)[:, 0] > 0.249) > 0.3


@pytest.mark.slow
@pytest.mark.parametrize("name", some(1, ["tcp", "knee"]))
def test_plans_and_timings_keep_limits_of_tcp_and_elbow(tmp_path, name):
    """Limits are three quarters of what the fastest motion has."""
    (tmp_path / "two.urdf").write_text(TWO_JOINTS, encoding="utf-8")
    (tmp_path / "task.toml").write_text(URDF, encoding="utf-8")
    task = replace(load_task(tmp_path / "task.toml"), objective=TIME)
    task = replace(task, limits=replace(task.limits, tolerance=NONE))
    free = plan_motion(task, starts=1, jobs=1).motion
    point = PointSpeeds(task.robot.arm, [name])
    limit = 0.75 * float(np.max(point(*free.states(np.linspace(0, free.end, 2001))[:2])))
    robot = task.robot.varied(speed_limits={name: limit})
    slow = plan_motion(replace(task, robot=robot), starts=1, jobs=1)
    timed = retime(robot, path_of_motion(free).path, task.limits, nodes=40)
    for motion, check in ((slow.motion, slow.check), (timed.motion, timed.check)):
        assert check.verified
        assert motion.end > free.end * (1 - 1e-5)  # in both switching times that nearly meet are one
        speeds = point(*motion.states(np.linspace(0, motion.end, 2001))[:2])
        assert 0.8 * limit < np.max(speeds) <= limit * (1 + 1e-6)


def test_a_file_has_speed_limits(tmp_path, capsys, task):
    file, motion = tmp_path / "case.toml", tmp_path / "plan.json"
    file.write_text('case = "A"\n[limits]\ntcp_speed = 0.25\npoint_speed = {"joint 3" = 0.5}\n')
    motion.write_text(json.dumps({"case": "A", "base": "effective", **task.reference.to_dict()}))
    read = load_task(file)
    assert read.robot.speed_limits == {"tcp": 0.25, "joint 3": 0.5}
    again = tmp_path / "again.toml"
    again.write_text(read.source.text("A", read.limits, read.objective))
    assert load_task(again).robot.speed_limits == read.robot.speed_limits
    assert main(["check", str(motion), "--tcp-speed", "0.25", "--tolerance", "none"]) == 1
    text = " ".join(capsys.readouterr().out.split())
    assert "TCP speed is" in text
    assert main(["check", str(motion), "--tcp-speed", "0"]) == 2
    assert "--tcp-speed: must be > 0" in capsys.readouterr().err
    file.write_text('case = "A"\n[limits]\npoint_speed = {elbow = 0.5}\n')
    with pytest.raises(InputError, match=r"limits\.point_speed.*no joint 'elbow'; there are joint 1"):
        load_task(file)


@pytest.fixture(scope="module")
def nodding():
    """A task, a motion of two joints, and the largest speed of its TCP."""
    task = experiment_task("B")
    motion = nod(task)
    q, qd, _ = motion.states(np.linspace(0, motion.end, 20_001))
    return task, motion, np.max(task.robot.varied(speed_limits={"tcp": 1.0}).further(q, qd))


def test_a_limit_is_proved_for_all_instants_and_a_bound_holds_with_delayed_joints(nodding):
    """Places of 4,000 drawn delays and times are no faster than proved."""
    (task, motion, fastest), rng = nodding, np.random.default_rng(1)
    robot = task.robot.varied(speed_limits={"tcp": 1.001 * fastest, "joint 4": 2 * fastest})
    limits = replace(task.limits, tolerance=LATE)
    checked = check_motion(robot, motion, limits)
    proved = certified(robot, motion, checked, limits)
    assert proved.certified, (checked.violations, proved.certificate)
    bounds = proved.certificate.verdict.bounds
    assert fastest <= bounds["point_speed_ratio"] * 1.001 * fastest <= 1.0013 * fastest
    times = rng.uniform(0, motion.end, (4000, 1)) - rng.uniform(0, 1.02 * LATE.delay, (4000, 6))
    q, qd = (np.stack([motion(times[:, j], k)[:, j] for j in range(6)], axis=1) for k in (0, 1))
    share = 1.02 * np.max(robot.further(q, qd) / robot.further_limits.upper)
    assert share <= bounds["point_speed_ratio_worst_case"] <= 1.1 * share
    assert share > 1
    assert "speeds of points in the nominal model" in proved.headline


def test_a_limit_that_is_exceeded_between_samples_is_not_proved(nodding):
    task, motion, fastest = nodding
    robot = task.robot.varied(speed_limits={"tcp": 0.999 * fastest})
    checked = check_motion(robot, motion, task.limits)
    kept = replace(checked.worst["tcp_speed_m_s"], value=0.999 * fastest)
    found = certify(robot, motion, task.limits, {**checked.worst, "tcp_speed_m_s": kept})
    assert not found.holds
    assert {one.claim for one in found.undecided} == {"speed of points"}
