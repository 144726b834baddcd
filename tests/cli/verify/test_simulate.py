"""`ocptip export` and `ocptip simulate` as they are typed."""

import json
import re

import mujoco
import pytest

from ocptip.cli.main import main
from ocptip.motion.files.plan_files import write_plan
from ocptip.published.tasks import experiment_task
from tests.motion.cycles.cycle_files import planned
from tests.pictures.plan_stand_in import plan_of
from tests.standing.simulation.test_replay import plan_of as committed


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plans") / "A"
    write_plan(folder, plan_of(experiment_task("A"), committed("A-effective")[1]))
    return folder


def test_export(written, tmp_path, capsys):
    mjcf, urdf = tmp_path / "a.xml", tmp_path / "a.urdf"
    assert main(["export", str(written), "--mjcf", str(mjcf), "--urdf", str(urdf)]) == 0
    said = capsys.readouterr().out
    assert "have separate rotors" in said
    model = mujoco.MjModel.from_xml_path(str(mjcf))
    assert model.nkey > 70  # the motion
    assert model.body_mass.sum() == pytest.approx(19.161)
    assert "friction of the feet (0.2, 0.2, 0.2)" in urdf.read_text()


def test_exported_motion_runs_in_mujoco_alone(written, tmp_path):
    """Position servos follow the keyframes' controls, and the base stands: the file as users have it."""
    path = tmp_path / "a.xml"
    assert main(["export", str(written), "--mjcf", str(path)]) == 0
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    at = 0
    while data.time < model.key_time[-1] + 0.2:
        while at + 1 < model.nkey and model.key_time[at + 1] <= data.time:
            at += 1
        data.ctrl[:] = model.key_ctrl[at]
        mujoco.mj_step(model, data)
    goal = model.key_ctrl[-1]
    reached = [data.joint(model.actuator(k).name).qpos[0] for k in range(model.nu)]
    assert reached == pytest.approx(goal, abs=0.02)
    assert data.qpos[2] == pytest.approx(model.key_qpos[0, 2], abs=1e-3)


def test_simulate(written, capsys):
    assert main(["simulate", str(written), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["stands"]
    assert data["library"]["rms_least_N"] < 1
    assert "step 0.1 ms" in data["simulator"]


@pytest.fixture(scope="module")
def cycle(tmp_path_factory):
    return planned(tmp_path_factory.mktemp("cycles"))


@pytest.mark.slow
def test_simulate_a_cycle(cycle, capsys):
    assert main(["simulate", str(cycle), "--json", "--step", "0.0004"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["library"]["rms_N"] < 0.05
    assert main(["simulate", str(cycle), "--step", "0.0004", "--payload", "45"]) == 1
    said = capsys.readouterr().out
    assert "FALLS" in said
    assert "(out)" in said
    assert "what the gripper takes or leaves comes and goes at once" in said


def test_export_writes_a_model_per_segment(cycle, tmp_path, capsys):
    assert main(["export", str(cycle), *("--mjcf", f"{tmp_path}/s.xml", "--urdf", f"{tmp_path}/s.urdf")]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["s-1.urdf", "s-1.xml", "s-2.urdf", "s-2.xml"]
    out, back = (mujoco.MjModel.from_xml_path(f"{tmp_path}/s-{k}.xml") for k in (1, 2))
    assert (out.nq, out.nv) == (back.nq, back.nv)
    assert back.body_mass.sum() - out.body_mass.sum() == pytest.approx(1.0)
    assert back.key_time[0] == pytest.approx(out.key_time[-1] + 0.3)  # its rest
    assert back.key_qpos[0] == pytest.approx(out.key_qpos[-1])
    assert "what the gripper takes or leaves" in capsys.readouterr().out


def test_simulate_says_no(written, capsys):
    assert main(["simulate", str(written), "--tilt", "6", "-120", "--friction", "0.9"]) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "FALLS" in said or re.search(
        r"NOT STABLE in the simulator: contact \d (lifts|slides) [\d.]+ mm", said
    )
    assert "floor tilted by 6 deg, downhill towards (-0.5, -0.87, 0), friction x 0.9" in said
    assert "a contact is lost" in said


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--damping", "0.1"], "--damping: only for compliant feet; give --stiffness as well"),
        (["--stiffness", "10"], "--stiffness: 1e3 to 1e8 N/m, got 10"),
        (["--tilt", "90"], "--tilt: 0 to 60 degrees"),
        (["--speed", "0"], "--speed: must be > 0"),
        (["--friction", "1e9"], "--friction: a factor of 0.01 to 100"),
        (["--step", "0.01"], "--step: at most 0.0005 s"),
    ],
)
def test_bad_options(written, capsys, arguments, said):
    assert main(["simulate", str(written), *arguments]) == 2
    assert said in capsys.readouterr().err


def test_bad_folders_and_a_clamp(written, tmp_path, capsys):
    assert main(["simulate", str(tmp_path)]) == 2
    assert "is no folder of a plan" in capsys.readouterr().err
    assert main(["export", str(written)]) == 2
    assert "--mjcf FILE or --urdf FILE" in capsys.readouterr().err
    clamped = tmp_path / "C"
    task = experiment_task("C")
    write_plan(clamped, plan_of(task, task.reference))
    assert main(["export", str(clamped), "--mjcf", str(tmp_path / "c.xml")]) == 0
    assert "jaws that press contact 3" in capsys.readouterr().out
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "c.xml")).joint("jaw3_lower").id > 0


def test_without_mujoco(written, capsys, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    assert main(["simulate", str(written)]) == 2
    assert "pip install 'ocptip[simulate]'" in capsys.readouterr().err
