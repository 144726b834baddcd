"""`ocptip identify` as it is typed; what it writes is read as tables of a task file."""

import json
import tomllib

import pytest

from ocptip.basics.toml import Table
from ocptip.cli.main import main
from ocptip.motion.output import write_plan
from ocptip.published.tasks import experiment_task
from ocptip.robots.payload import Payload
from ocptip.task_files.payload import read_payload
from ocptip.task_files.tolerance import load_tolerance
from tests.cli.test_cli_compare import write
from tests.measured.machines import predictor, recorded
from tests.pictures.plan_stand_in import plan_of
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
    with Table.read(out) as data:
        data.close(*data)
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
        (("bodies", "--tared"), "r.csv: base: its weight cannot be told"),
        (("payload", "--sigmas", "-1"), "sigmas: must be > 0"),
    ],
)
def test_bad_input_is_one_line(written, recording, options, said, capsys):
    what, *rest = options
    assert main(["identify", what, recording, str(written), *rest]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
