"""`ocptip.simulate`, `export` and `compare` on the folder of a plan: the same answers as the commands."""

import json

import mujoco
import numpy as np
import pytest

import ocptip
from ocptip.motion.files.plan_files import write_plan
from ocptip.published.tasks import experiment_task
from ocptip.task_files.plan_folder import read_plan_folder
from tests.pictures.plan_stand_in import plan_of
from tests.standing.simulation.test_replay import plan_of as committed


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("plans") / "A"
    write_plan(path, plan_of(experiment_task("A"), committed("A-effective")[1]))
    return path


def test_a_replay_of_a_folder_and_of_what_was_read_from_it(folder, tmp_path):
    one, other = ocptip.simulate(folder), ocptip.simulate(read_plan_folder(folder))
    assert one.stable
    assert one.to_dict() == other.to_dict()
    assert "<Simulated A: stable (nominal), minimum foot force " in repr(one)
    assert json.loads(one.save(tmp_path / "a.json").read_text(encoding="utf-8"))["stands"]
    steep = ocptip.simulate(folder, tilt=np.radians(40))
    assert not steep.stable
    assert "not stable" in repr(steep) or "falls" in repr(steep)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"stiffness": 1.0}, r"stiffness: 1e3 to 1e8 N/m, got 1"),
        ({"damping": 0.1}, "damping: only for compliant feet; give stiffness as well"),
        ({"tilt": 2.0}, r"tilt: 0 to 1\.047 rad, got 2\.0"),
        ({"friction": 1e3}, "friction: a factor of 0"),
        ({"payload": -1.0}, "payload: must be >= 0"),
        ({"step": 0.01}, r"step: at most 0\.0005 s, got 0\.01"),
    ],
)
def test_worlds_that_cannot_be_simulated_are_named(folder, options, message):
    with pytest.raises(ocptip.InputError, match=message):
        ocptip.simulate(folder, **options)


def test_exported_models_are_texts_until_they_are_saved(folder, tmp_path):
    exported = ocptip.export(folder, mjcf=tmp_path / "a.xml", urdf=tmp_path / "a.urdf")
    assert not list(tmp_path.iterdir())
    assert [path.name for path in exported.save()] == ["a.xml", "a.urdf"]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "a.xml"))
    assert model.body_mass.sum() == pytest.approx(exported.parts[0].robot.mass)
    assert exported.to_dict()["files"] == [str(tmp_path / "a.xml"), str(tmp_path / "a.urdf")]
    with pytest.raises(ocptip.InputError, match="mjcf, urdf: name a file"):
        ocptip.export(folder)


@pytest.mark.slow
def test_the_samples_of_a_plan_agree_with_it(folder, tmp_path):
    compared = ocptip.compare(folder, folder / "motion.csv")
    assert compared.agrees
    assert repr(compared) == "<PlanComparison A: agrees>"
    assert json.loads(compared.save(tmp_path / "a.json").read_text(encoding="utf-8"))["task"] == "A"
    assert compared.save(tmp_path / "a.svg").stat().st_size > 1000
    with pytest.raises(ocptip.InputError, match=r"nowhere\.csv"):
        ocptip.compare(folder, "nowhere.csv")
