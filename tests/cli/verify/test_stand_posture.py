"""`ocptip stand TASK.toml --posture`: forces against statics by Pinocchio, verdicts, what is refused."""

import dataclasses
import json

import numpy as np
import pytest

import ocptip
from ocptip.api.stand import stand
from ocptip.cli.main import main
from ocptip.motion.files.plan_files import write_plan
from ocptip.robots.base_motion import BaseMotion
from ocptip.robots.process import ProcessWrench
from ocptip.standing.tolerance import NONE, WORKSHOP
from ocptip.task_files.motion import load_task
from ocptip.trajectories.trajectory import Trajectory
from tests.pictures.plan_stand_in import plan_of
from tests.places import EXAMPLES
from tests.quick import some
from tests.robots.pinocchio_twin import dynamics, twin

TASK = EXAMPLES / "tasks/ur5_cart.toml"


def answered(capsys, *options, task=TASK):
    code = main(["stand", str(task), *options, "--json"])
    return code, json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("posture", some(1, ["goal", "start", "0,-10,0,0,0,0"]))
def test_forces_balance_what_pinocchio_says_of_the_arm(capsys, posture):
    task = load_task(TASK)
    q = {"start": task.start, "goal": task.goal}.get(posture, np.deg2rad([0, -10, 0, 0, 0, 0]))
    code, data = answered(capsys, "--posture", posture, "--tolerance", "none")
    assert code == 0
    arm, support, still = task.robot.arm, task.robot.support, np.zeros(6)
    torques, arm_wrench = dynamics(
        twin(arm), q, still, still, support.gravity, np.zeros(3), np.zeros(3), support.center_of_mass
    )
    wrench = arm_wrench + support.weight
    np.testing.assert_allclose(data["wrench"], wrench, atol=1e-9)
    np.testing.assert_allclose(data["posture"]["torques"], torques, atol=1e-9)
    total = np.zeros(6)
    for contact, force in zip(support.contacts, np.array(data["forces"]), strict=True):
        lever = np.asarray(contact.position) - support.center_of_mass
        total += np.concatenate([force, np.cross(lever, force)])
    np.testing.assert_allclose(total, -wrench, atol=1e-6 * np.abs(wrench).max())
    np.testing.assert_allclose(list(data["posture"]["joints"].values()), q, atol=1e-12)
    assert data["posture"]["broken"] == []


def test_assumptions_about_the_robot_are_part_of_the_answer(capsys):
    code, data = answered(capsys, "--posture", "start")
    assert code == 0
    assert any(note.startswith("energy: motors are estimated") for note in data["assumed"])
    main(["stand", str(TASK), "--posture", "start"])
    assert "\nassumed      energy: motors are estimated" in capsys.readouterr().out


def test_the_folder_of_a_plan_gives_the_postures_of_its_motion(capsys, tmp_path):
    task = load_task(TASK, NONE)
    start, goal = next(pair for pair in task.choices if np.abs(pair[1] - task.goal).max() > 1)
    limits, between = task.robot.limits, dataclasses.replace(task, start=start, goal=goal)
    motion = Trajectory.ending_together(start, goal, [None] * 6, limits.speed, limits.acceleration)
    write_plan(tmp_path / "plan", plan_of(between, motion))
    for posture, q in (("start", start), ("goal", goal)):
        _, data = answered(capsys, "--posture", posture, "--tolerance", "none", task=tmp_path / "plan")
        np.testing.assert_allclose(list(data["posture"]["joints"].values()), q, atol=1e-6)
        assert "choice" not in data["posture"]
        envelope = ocptip.drive(tmp_path / "plan", posture, uncertainty="none")
        np.testing.assert_allclose(envelope.q, q, atol=1e-6)
        assert envelope.motion is None
        assert not envelope.choice
    assert main(["stand", str(tmp_path / "plan")]) == 2
    assert "that of a plan needs --posture start or goal" in capsys.readouterr().err
    _, data = answered(capsys, "--posture", "goal")
    np.testing.assert_allclose(list(data["posture"]["joints"].values()), task.goal, atol=1e-12)
    distinct = {tuple(np.round(np.cos(pair[1] - task.goal), 6)) for pair in task.choices}
    assert f"goal: posture 1 of {len(distinct)} of its pose" in data["posture"]["choice"]


def test_the_margin_within_a_tolerance_counts_the_links(capsys, tmp_path):
    """Without tilt, pushes and friction the worst masses are corners: all of them, by Pinocchio's statics."""
    task = load_task(TASK)
    (tmp_path / "masses.toml").write_text("[tolerance]\narm_mass = 0.1\n", encoding="utf-8")
    code, data = answered(capsys, "--posture", "start", "--tolerance", str(tmp_path / "masses.toml"))
    assert code == 0
    arm, support, still = task.robot.arm, task.robot.support, np.zeros(6)
    about, zero, worst = support.center_of_mass, np.zeros(3), 0.0
    for signs in np.array(np.meshgrid(*[[-1, 1]] * 6)).reshape(6, -1).T:
        bare = twin(arm, masses=arm.masses * (1 + 0.1 * signs))
        own = dynamics(bare, task.start, still, still, support.gravity, zero, zero, about)
        states = task.robot.contact_states((own[1] + support.weight)[None])
        worst = max(worst, float(task.robot.tip_over.evaluate(states).GN[0]))
    assert data["within"]["GN"] == pytest.approx(worst, rel=1e-9)
    assert data["GN"] < worst


def test_a_posture_that_tips_the_base_or_breaks_limits(capsys, tmp_path):
    text = TASK.read_text(encoding="utf-8").replace("mass = 35.0", "mass = 3.0")
    assert "mass = 3.0" in text
    (tmp_path / "ur5.urdf").write_bytes((EXAMPLES / "tasks/ur5.urdf").read_bytes())
    light = tmp_path / "light.toml"
    light.write_text(text, encoding="utf-8")
    code, data = answered(capsys, "--posture", "0,0,0,0,0,0", "--tolerance", "none", task=light)
    assert code == 1
    assert not data["persistent"]
    assert main(["stand", str(light), "--posture", "-400,0,0,0,0,0", "--tolerance", "none"]) == 1
    assert ", AND THE ARM CANNOT REST THERE." in " ".join(capsys.readouterr().out.split())
    assert main(["stand", str(TASK), "--posture", "400,-10,0,0,0,0", "--tolerance", "none"]) == 1
    text = capsys.readouterr().out
    assert "in the given posture   STABLE" in text
    assert ", BUT THE ARM CANNOT REST THERE." in " ".join(text.split())
    assert "\nBroken  " in text


def test_a_base_that_brakes_in_a_turn(capsys):
    options = ["--posture", "start", "--tolerance", "none"]
    code, data = answered(capsys, *options, "--base-acceleration=-1,0.2", "--base-turning", "0.5,-0.3")
    assert code == 0
    motion = BaseMotion([-1, 0.2, 0], [0, 0, 0.5], [0, 0, -0.3])
    task, still = load_task(TASK), np.zeros((1, 6))
    torques, wrenches = task.robot.loads(task.start[None], still, still, base_motion=motion)
    np.testing.assert_allclose(data["wrench"], wrenches[0], atol=1e-9)
    np.testing.assert_allclose(data["posture"]["torques"], torques[0], atol=1e-9)
    assert data["posture"]["base_motion"] == motion.to_dict()
    assert main(["stand", str(TASK), *options, "--base-acceleration=-4,0"]) == 1
    assert "(-4, 0, 0) m/s^2, base axes" in capsys.readouterr().out


def test_the_headline_of_a_base_that_accelerates_names_the_overshoot(capsys):
    left_out, posture = "AT CONSTANT ACCELERATION", ["stand", str(TASK), "--posture", "start"]
    for motion, told in (("--base-acceleration=-0.5,0", True), ("--base-turning=0.1", False)):
        assert main([*posture, motion]) == 0
        text = " ".join(capsys.readouterr().out.split())
        assert (f"UNCERTAINTY (DEFAULT), {left_out}." in text) == told
        assert ("up to 1.85 times as much acts for a moment" in " ".join(text.split())) == told
    assert main([*posture, "--base-acceleration=-0.5,0", "--tolerance=none"]) == 0
    assert left_out not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--posture", "1,2,3"], "expected 6 finite numbers (shoulder_pan_joint"),
        (["--posture", "strat"], "or one of start, goal; got 'strat'; did you mean 'start'?"),
        (
            ["--posture", "start", "--sensitivities", "--base-acceleration", "1,0"],
            "sensitivities: not on a base that drives",
        ),
        (["--posture", "start", "--gn-reference", "9"], "--gn-reference: not with --posture"),
        (
            ["--posture", "start", "--base-acceleration", "1"],
            "--base-acceleration: expected 2 finite",
        ),
        (["--base-turning", "1"], "--base-turning: needs --posture"),
        ([], "is a motion task (ocptip plan), not a scene; for its robot at rest give --posture start"),
    ],
)
def test_mistakes_are_named(capsys, options, message):
    assert main(["stand", str(TASK), *options]) == 2
    assert message in capsys.readouterr().err


def test_goals_of_segments_have_what_is_held_there(capsys):
    task = EXAMPLES / "tasks/ur5_pick_and_place.toml"
    _, data = answered(capsys, "--posture", "carry", "--tolerance", "none", task=task)
    _, start = answered(capsys, "--posture", "start", "--tolerance", "none", task=task)
    assert data["wrench"][2] < start["wrench"][2] - 1.0


@pytest.mark.parametrize("tolerance", some(1, [WORKSHOP.only("base_mass"), NONE]))
def test_the_share_of_a_process_force_is_where_the_base_tips(tolerance):
    task = load_task(TASK)

    def standing(share):
        push = ProcessWrench((0.0, share * 300.0, 0.0), axes="base")
        robot = task.robot.varied(arm=task.robot.arm.with_process(push))
        return stand(robot, task.start, uncertainty=tolerance)

    found = standing(1.0).possible_process
    assert found.equally_compliant is None  # all feet have the same friction
    share = found.best_sharing
    assert 0.05 < share < 0.95
    assert standing(0.99 * share).stable
    assert not standing(1.01 * share + 0.005).stable
    assert standing(0.5 * share).possible_process.best_sharing == 1.0
    assert stand(task.robot, task.start).possible_process is None


def test_changes_in_a_posture_begin_at_its_margins(capsys):
    assert (
        main(["stand", str(TASK), "--posture", "goal", "--sensitivities", "--tolerance", "none", "--json"])
        == 0
    )
    data = json.loads(capsys.readouterr().out)
    changes = {one["quantity"]: one for one in data["sensitivities"]}
    assert "speed" not in changes
    margin = data["tipping_axis"]["moment_reserve"]
    heavier, wider = changes["base_mass"], changes["feet_outwards"]
    assert heavier["before"]["tipping_margin_Nm"] == pytest.approx(margin)
    assert heavier["after"]["tipping_margin_Nm"] > margin
    assert wider["after"]["tipping_margin_Nm"] > margin
