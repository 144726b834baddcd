"""`ocptip.identify`: the same values as the functions of `measured`, and tables that a task file takes."""

import tomllib

import pytest

import ocptip
from ocptip.api.identify import motion_for_identification
from ocptip.measured.bodies import PAYLOAD, identify_bodies
from ocptip.motion.files.plan_files import write_plan
from ocptip.published.tasks import experiment_task
from ocptip.robots.payload import Payload
from ocptip.task_files.plan_folder import read_plan_folder
from tests.cli.machine.test_compare import write
from tests.measured.machines import predictor, recorded
from tests.pictures.plan_stand_in import plan_of
from tests.places import EXAMPLES
from tests.standing.simulation.test_replay import plan_of as committed


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("plans") / "A"
    write_plan(path, plan_of(experiment_task("A"), committed("A-effective")[1]))
    return path


@pytest.fixture(scope="module")
def measured():
    robot = predictor().robot
    held = robot.varied(arm=robot.arm.with_payload(Payload(2.0, [0.0, 0.0, 0.05])))
    return recorded(0, robot=held)


@pytest.fixture(scope="module")
def recording(tmp_path_factory, measured):
    return write(tmp_path_factory.mktemp("recordings") / "r.csv", measured)


@pytest.mark.slow
def test_a_payload_is_that_of_the_recording(folder, recording, measured, tmp_path):
    found = ocptip.identify(recording, folder)
    expected = identify_bodies(measured, predictor(), (PAYLOAD,), tared=False)
    assert found.tables["payload"]["mass"] == pytest.approx(expected.bodies[0].mass, rel=1e-4)
    assert repr(found) == "<Identification payload: tables payload, tolerance>"
    saved = tomllib.loads(found.save(tmp_path / "found.toml").read_text(encoding="utf-8"))
    assert saved["payload"]["mass"] == found.tables["payload"]["mass"]
    wider = ocptip.identify(recording, read_plan_folder(folder), sigmas=6.0)
    ratio = wider.tables["tolerance"]["payload_mass"] / found.tables["tolerance"]["payload_mass"]
    assert ratio == pytest.approx(2.0, rel=0.01)


@pytest.mark.parametrize(
    ("plan", "options", "message"),
    [
        (None, {}, "identify payload: needs PLAN_DIR"),
        ("folder", {"what": "pay"}, "what: expected payload, base, bodies, arm or power, got 'pay'"),
        ("folder", {"what": "base"}, r"r\.csv: base: does not rest on the sensor"),
        ("folder", {"what": "arm", "bandwidth": -1.0}, "bandwidth: must be > 0"),
        ("nowhere", {}, "nowhere: no such folder"),
    ],
)
def test_what_cannot_be_used_is_named(folder, recording, plan, options, message):
    with pytest.raises(ocptip.InputError, match=message):
        ocptip.identify(recording, folder if plan == "folder" else plan, **options)


def test_a_cycle_has_no_motion_for_identification():
    with pytest.raises(ocptip.InputError, match="is a cycle"):
        motion_for_identification(EXAMPLES / "tasks" / "ur5_pick_and_place.toml")
