"""Jerk limits: plans, cycles and retimed paths keep them; where no timing does, the verdict says so."""

from __future__ import annotations

import numpy as np
import pytest

import ocptip
from ocptip.basics.errors import InputError
from ocptip.cli.verify.certify import CertifyReport
from ocptip.motion.check import check_motion
from ocptip.motion.files.plan_files import drives_of, planned_to_dict
from ocptip.motion.motion_plan import MotionPlan
from ocptip.motion.plan import plan_motion
from ocptip.task_files.cycle import load_cycle
from ocptip.task_files.motion import load_task
from ocptip.trajectories.controllers import controller_points
from ocptip.trajectories.fit import fitted
from ocptip.trajectories.path import JointPath
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from tests.motion.test_task import TWO_JOINTS, URDF
from tests.pictures.plan_stand_in import plan_of
from tests.quick import some

JERK = 40.0  # rad/s^3


def limited(folder, text):
    """A task file with a URDF whose joints have jerk limits."""
    urdf = TWO_JOINTS.replace('<robot name="two">', '<robot name="two" version="1.2">')
    for effort in ("40", "20"):
        urdf = urdf.replace(f'effort="{effort}"', f'effort="{effort}" jerk="{JERK:g}"')
    (folder / "two.urdf").write_text(urdf, encoding="utf-8")
    path = folder / "task.toml"
    path.write_text(text, encoding="utf-8")
    return path


def largest_jerk(motion):
    """By differences of the sampled accelerations, (n,), rad/s^3."""
    times, h = np.linspace(0, motion.end, 4001)[1:-1], 1e-5
    return np.max(np.abs(motion.states(times + h)[2] - motion.states(times - h)[2]) / (2 * h), axis=0)


def task_of_two_segments(tmp_path, more=""):
    head, _, rest = URDF.replace("[limits]", f"[limits]\n{more}").partition("goal_deg")
    return load_cycle(limited(tmp_path, f'{head}[[segment]]\ngoal_deg{rest}[[segment]]\ngoal = "start"\n'))


def test_segments_of_cycles_have_them_as_rise_times(tmp_path):
    task = task_of_two_segments(tmp_path)
    for segment in task.segments:
        assert segment.task.rise_times == pytest.approx(2 * task.robot.limits.acceleration / JERK)
    limited_more = task_of_two_segments(tmp_path, "jerk = [60.0, 20.0]\n")
    for segment in limited_more.segments:
        assert segment.task.limits.jerk == (60.0, 20.0)
        expected = 2 * task.robot.limits.acceleration / np.array([JERK, 20.0])
        assert segment.task.rise_times == pytest.approx(expected)


@pytest.mark.slow
def test_plans_of_segments_of_cycles_keep_them(tmp_path):
    plan = plan_motion(task_of_two_segments(tmp_path), starts=1, jobs=1)
    for part in plan.parts:
        assert np.all(largest_jerk(part.motion) <= JERK * (1 + 1e-6))


@pytest.mark.slow
def test_retimed_paths_keep_them_where_the_curvature_has_no_step(tmp_path):
    task = load_task(limited(tmp_path, URDF))
    ends = np.stack([task.goal - task.start, task.start])
    line = Trajectory.from_path(JointPath([0.0, 1.0], ends[:, None]), np.linspace(0, 1, 9), np.ones(9))
    plan = ocptip.retime(task, line)
    (timing,) = plan.timings
    assert np.all(timing.timed.motion.jerk_peaks <= JERK * (1 + 1e-6))
    assert np.max(timing.timed.motion.jerk_peaks) > 0.9 * JERK
    assert not any("jerk" in note for note in plan.task.robot.notes)


def test_a_motion_of_profiles_is_smoothed_for_them(tmp_path):
    """Its accelerations have steps, and so has the curvature of its path."""
    task = load_task(limited(tmp_path, URDF))
    plan = ocptip.retime(task, profiles(task, 0.0))
    assert plan.verified
    assert 0.5 < plan.check.worst["jerk_ratio"].value < 1 + 1e-3
    (timing,) = plan.timings
    assert not timing.fit.path.bends.size
    assert np.max(timing.fit.distance) < 1e-4


@pytest.mark.slow
def test_a_path_with_a_step_of_its_curvature_breaks_them(tmp_path):
    task = load_task(limited(tmp_path, URDF))
    half = 0.5 * (task.goal - task.start)
    bend = np.array([0.2, -0.2])
    pieces = np.stack([[0 * half, bend], [half, half], [task.start, task.start + half]])
    bent = JointPath([0.0, 0.5, 1.0], np.stack([pieces[0], 2 * pieces[1], pieces[2]]))
    assert bent.bends.tolist() == [1]
    plan = ocptip.retime(task, Trajectory.from_path(bent, np.linspace(0, 1, 9), np.ones(9)))
    assert not plan.verified
    assert plan.headline.startswith("LIMITS BROKEN")
    (text,) = plan.broken
    assert text.startswith("jerk is ")
    assert plan.to_dict()["retimed"]["verified"] is False
    (note,) = [note for note in plan.task.robot.notes if "jerk" in note]
    assert "no timing of the path keeps the jerk limits of joints hip, knee" in note
    assert "s = 0.5000" in note
    plan.save(tmp_path / "plan", figures=False)
    assert ocptip.check(tmp_path / "plan").broken[0].startswith("jerk is ")


def test_steps_of_joints_without_a_jerk_limit_break_none(tmp_path):
    path = limited(tmp_path, URDF)
    urdf = (tmp_path / "two.urdf").read_text(encoding="utf-8")
    first = f'jerk="{JERK:g}"'
    (tmp_path / "two.urdf").write_text(urdf.replace(first, "", 1), encoding="utf-8")
    task = load_task(path)
    assert np.isinf(task.robot.limits.jerk).tolist() == [True, False]
    rises = np.array([0.0, RISE])
    assert jerk_of(task, profiles(task, rises)).detail == "knee"  # and no warning


RISE, SPEED, ACCELERATION = 0.1, 0.6, 1.5


def profiles(task, rise):
    """One command per joint: the jerk of its S-curve is the acceleration divided by the rise time."""
    commands = [[RampCommand(goal, SPEED, ACCELERATION)] for goal in task.goal]
    return Trajectory.from_profiles(task.start, commands, rise)


def jerk_of(task, motion):
    return check_motion(task.robot, motion, task.limits).worst["jerk_ratio"]


@pytest.mark.parametrize("factor", some(1, [1.0, 0.5]))
def test_the_jerk_of_s_curves_is_exact(tmp_path, factor):
    task = load_task(limited(tmp_path, URDF))
    motion = profiles(task, RISE).time_scaled(factor)
    worst = jerk_of(task, motion)
    assert worst.value * JERK == pytest.approx(ACCELERATION / RISE / factor**3)
    assert worst.value * JERK == pytest.approx(np.max(largest_jerk(motion)), rel=1e-3)
    assert worst.broken == (factor < 1)
    for controller in ("quintic", "cubic"):  # both run S-curves as they are
        points = controller_points(motion, controller)
        assert jerk_of(task, points).value == pytest.approx(worst.value, rel=1e-3)
        assert jerk_of(task, points).detail == worst.detail == "hip"


def test_acceleration_steps_break_every_jerk_limit(tmp_path):
    task = load_task(limited(tmp_path, URDF))
    found = ocptip.check(task, profiles(task, 0.0))
    assert not found.verified
    step = f"{np.rad2deg(ACCELERATION):.4g} deg/s^2"
    (text,) = [text for text in found.broken if "jerk" in text]
    assert text == f"jerk is unlimited (hip, its acceleration steps by up to {step}), must be <= 100 %"
    with pytest.raises(InputError, match="rise_time: 0 exceeds any jerk limit, and joints hip, knee have"):
        ocptip.plan(task, rise_time=0.0)


def test_the_jerk_between_points_is_estimated_where_accelerations_step(tmp_path):
    task = load_task(limited(tmp_path, URDF))
    way, end = task.goal - task.start, 3.0
    s = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])  # its third derivative is 60 at both ends
    times = np.linspace(0, 1, 61)
    angles = task.start + s(times)[:, None] * way
    motion = Trajectory.from_points(end * times, angles, s.deriv()(times)[:, None] * way / end)
    worst = jerk_of(task, motion)
    assert worst.value * JERK == pytest.approx(60 * np.abs(way).max() / end**3, rel=0.05)
    assert worst.detail == "knee, estimated by acceleration steps between points"
    assert "jerk / limit" in ocptip.check(task, motion).unproved


@pytest.mark.slow
@pytest.mark.parametrize(("noise", "seen"), some(1, [(1e-5, 0.1), (0.0, 0.5)]))
def test_samples_have_at_least_the_jerk_that_their_differences_show(tmp_path, noise, seen):
    task = load_task(limited(tmp_path, URDF))
    rng = np.random.default_rng(0)
    shares = []
    for rise in (0.1, 0.02):
        motion = profiles(task, rise)
        times = np.linspace(0, motion.end, 1000)
        samples = motion.states(times)[0] + noise * rng.normal(size=(1000, 2))
        samples = fitted(times, samples, rounding=np.full(2, 1e-7))
        worst = jerk_of(task, samples)
        shares.append(worst.value * JERK * rise / ACCELERATION)
        assert worst.broken == (rise < 0.1 and noise == 0)
        assert worst.detail.endswith(", at least, by differences of samples")
        half = jerk_of(task, samples.time_scaled(2.0))
        assert 8 * half.value == pytest.approx(worst.value)
    assert seen < min(shares) <= max(shares) <= 1.0


def test_the_jerk_limit_of_a_task_counts_beside_those_of_the_joints(tmp_path):
    for jerk, allowed in (((20.0, 30.0), (20.0, 30.0)), ((60.0, 30.0), (JERK, 30.0))):
        task = load_task(limited(tmp_path, URDF.replace("[limits]", f"[limits]\njerk = {list(jerk)}")))
        assert task.rise_times == pytest.approx(2 * task.robot.limits.acceleration / allowed)
        shares = profiles(task, RISE).largest_jerks / allowed
        assert jerk_of(task, profiles(task, RISE)).value == pytest.approx(np.max(shares))
        assert "jerk" in task.limits.to_dict()
    assert "jerk" not in load_task(limited(tmp_path, URDF)).limits.to_dict()


def test_assumptions_are_part_of_proofs_and_of_plans_of_cycles(tmp_path):
    task = load_task(limited(tmp_path, URDF))
    (note,) = [note for note in task.robot.notes if note.startswith("energy: motors are estimated")]
    motion = profiles(task, RISE)
    proof = ocptip.certify(task, motion)
    assert note in proof.to_dict()["assumed"]
    text = " ".join(CertifyReport(proof, None, yes=True).to_text().split())
    assert f"Assumed {' '.join(task.robot.notes)}" in text
    cycle = task_of_two_segments(tmp_path)
    back = Trajectory.from_profiles(
        task.goal, [[RampCommand(start, SPEED, ACCELERATION)] for start in task.start], RISE
    )
    parts = [plan_of(one.task, way) for one, way in zip(cycle.segments, (motion, back), strict=True)]
    plan = MotionPlan.of_cycle(cycle, parts, seconds=0.0, options={})
    assert note in planned_to_dict(plan, drives_of(plan), plan.checked)["assumed"]
