"""`ocptip identify` as it is typed; what it writes is read as tables of a task file."""

import json
import tomllib

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.basics.toml import Table, toml_text
from ocptip.cli.main import main
from ocptip.measured.links import identify_links
from ocptip.motion.files.plan_files import write_plan
from ocptip.published.tasks import experiment_task
from ocptip.robots.payload import Payload
from ocptip.task_files.motion import TASK
from ocptip.task_files.tables.arm import arm_of_file
from ocptip.task_files.tables.payload import read_payload
from ocptip.task_files.tables.tolerance import load_tolerance
from tests.cli.machine.test_compare import write
from tests.measured.machines import predictor, recorded
from tests.measured.test_links import described, real
from tests.measured.test_links import recorded as of_links
from tests.pictures.plan_stand_in import plan_of
from tests.places import ROOT
from tests.standing.simulation.test_replay import plan_of as committed


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plans") / "A"
    write_plan(folder, plan_of(experiment_task("A"), committed("A-effective")[1]))
    return folder


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    robot = predictor().robot
    held = robot.varied(arm=robot.arm.with_payload(Payload(2.0, [0.0, 0.0, 0.05])))
    return write(tmp_path_factory.mktemp("recordings") / "r.csv", recorded(0, robot=held))


def test_a_payload_and_its_tolerance_are_written(written, recording, tmp_path, capsys):
    out = tmp_path / "found.toml"
    assert main(["identify", "payload", recording, str(written), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert said.startswith("payload: identified. Tables: payload, tolerance.")
    assert "mass 2" in said
    with Table.read(out, TASK) as data:
        data.close(early=True)
        payload = read_payload(data.table("payload"))
    assert payload.mass == pytest.approx(2.0, rel=0.01)
    tolerance = load_tolerance(str(out))
    assert abs(payload.mass - 2.0) / payload.mass < tolerance.payload_mass < 0.01
    assert tomllib.loads(out.read_text())["payload"]["mass"] == payload.mass


def test_json_has_covariances(written, recording, capsys):
    assert main(["identify", "payload", recording, str(written), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert len(data["payload"]["covariance"]) == 4
    assert data["source"] == "sensor"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("base",), "r.csv: base: does not rest on the sensor"),
        (("bodies", "--tared"), "r.csv: base: its weight cannot be separated"),
        (("payload", "--sigmas", "-1"), "sigmas: must be > 0"),
        (("arm", "--bandwidth", "-1"), "--bandwidth: must be > 0"),
    ],
)
def test_bad_input_is_one_line(written, recording, options, said, capsys):
    what, *rest = options
    assert main(["identify", what, recording, str(written), *rest]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


@pytest.mark.slow
def test_links_that_are_written_are_those_of_the_arm_that_reads_them(tmp_path):
    nominal = described()
    found = identify_links(of_links(real(), 0), nominal)
    tables = found.to_tables(nominal.robot.motors)
    file = tmp_path / "arm.toml"
    urdf = ROOT / "src/ocptip/examples/tasks/ur5.urdf"
    file.write_text(toml_text({"arm": {"urdf": str(urdf), "tool_frame": "tool0", **tables["arm"]}}))
    arm = arm_of_file(file)
    for name in ("masses", "centres", "inertias"):
        np.testing.assert_allclose(getattr(arm, name), getattr(found.arm, name), atol=1e-12)
    assert tables["motors"]["kind"] == "dc"
    assert tables["motors"]["coulomb"][0] == pytest.approx(2.0, abs=0.2)
    file.write_text(toml_text({"arm": {"urdf": str(urdf), "links": {"elbow": {"mass": 1.0}}}}))
    with pytest.raises(InputError, match="no joint 'elbow'; there are shoulder_pan_joint"):
        arm_of_file(file)


def test_an_arm_is_told(written, recording, tmp_path, capsys):
    out = tmp_path / "arm.toml"
    assert main(["identify", "arm", recording, str(written), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "base parameters" in said
    assert "friction" in said
    assert "tau1 " in said
    assert "(plain least squares " in said
    assert "filter " not in said
    tables = tomllib.loads(out.read_text())
    assert set(tables["arm"]["links"]) == {f"joint {k}" for k in range(1, 7)}
    assert 0 < tables["tolerance"]["arm_mass"] < 1
    assert "about every tipping axis, at all instants of this motion" in said
