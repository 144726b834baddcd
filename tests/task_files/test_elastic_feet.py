"""Tasks on compliant feet: what a file says of them, and a plan that keeps them on the ground."""

import dataclasses
import json

import numpy as np
import pytest

from ocptip.cli.main import main
from ocptip.motion.plan import plan_motion
from ocptip.motion.task import refusals
from ocptip.published.tasks import experiment_task
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import overshoot_of
from ocptip.task_files.motion import load_task
from tests.places import ROOT
from tests.standing.elastic.test_feet import softened

TASK = """\
[base]
mass = 30.0
center_of_mass = [0, 0, -0.05]
feet = [[0.3, 0, -0.15], [-0.15, 0.26, -0.15], [-0.15, -0.26, -0.15], [0, 0.3, -0.15]]
friction = 0.6
stiffness = 5e5
damping_ratio = 0.1
[arm]
name = "FP1W2F"
mount_position = [0, 0, 0]
[motion]
start_deg = [-90, 35, -18, 45, -37, 180]
goal_deg = [90, 30, -8, 45, 18, 0]
"""


def load(tmp_path, text):
    path = tmp_path / "task.toml"
    path.write_text(text)
    return load_task(path)


def test_jumps_count_with_the_overshoot_of_the_feet(tmp_path):
    task = load(tmp_path, TASK)
    assert task.limits.overshoot == pytest.approx(overshoot_of(0.1))
    assert task.robot.support.elastic.stiffness[3, 0] == 5e5
    asked = load(tmp_path, TASK + "[limits]\nfoot_lift = 1e-4\nfoot_force = 5.0\n")
    assert (asked.limits.foot_lift, asked.limits.foot_force) == (1e-4, 5.0)
    rigid = load(tmp_path, TASK.replace("stiffness = 5e5\ndamping_ratio = 0.1\n", ""))
    assert rigid.limits.overshoot == 0.0


def test_a_foot_that_bears_too_little_is_refused(tmp_path):
    heavy = TASK + "[limits]\nfoot_force = 200.0\n"
    found = refusals(load(tmp_path, heavy))
    assert any("N at rest on its springs, must be >= 200 N" in reason for reason in found)
    assert not refusals(load(tmp_path, TASK))


@pytest.mark.slow
def test_check_says_how_the_base_swings(capsys, tmp_path):
    task = load(tmp_path, TASK)
    start, goal = (np.degrees(angles).tolist() for angles in (task.start, task.goal))
    commands = [[{"phi_e": angle, "speed": 60.0, "acceleration": 120.0}] for angle in goal]
    motion = tmp_path / "motion.json"
    motion.write_text(json.dumps({"start": start, "commands": commands}))
    code = main(["check", str(motion), "--task", str(tmp_path / "task.toml"), "-v", "--tolerance", "none"])
    text = capsys.readouterr().out
    assert code == 0
    assert "compliant feet  " in text
    assert "lowest natural frequency" in text
    assert "lift of a compliant foot" in text
    main(["check", str(motion), "--task", str(tmp_path / "task.toml"), "--json", "--foot-lift", "0.01"])
    data = json.loads(capsys.readouterr().out)
    assert data["limits"]["foot_lift"] == 0.01
    assert data["feet"]["lift_m"] == 0
    assert len(data["feet"]["least_normal_forces_N"]) == 4
    (tmp_path / "task.toml").write_text(TASK + "[tolerance]\nspeed = 0.01\n")
    main(["check", str(motion), "--task", str(tmp_path / "task.toml"), "--stops", "brakes"])
    text = " ".join(capsys.readouterr().out.split())
    assert "compliant feet are checked in the nominal model only" in text
    assert "compliant feet: their forces and lifts during stops are not checked" in text


@pytest.mark.slow
def test_a_plan_keeps_its_feet_on_the_ground():
    """Plan A of the rigid base lifts a foot by 0.07 mm on these feet."""
    task = experiment_task("A", limits=Limits(damping=0.05))
    task = dataclasses.replace(task, robot=softened(task.robot, 1e6, damping_ratio=0.05))
    plan = plan_motion(task, starts=2, seed=0, jobs=1)
    assert plan.verified
    assert plan.check.feet.lift == 0
    rigid = json.loads((ROOT / "studies/results/plans/A-effective/plan.json").read_text())
    assert 1 < plan.energy / rigid["energy_J"] < 1.3
