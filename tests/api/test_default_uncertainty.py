"""One uncertainty holds wherever neither a file nor an option states one, and the headline names it."""

import json

import pytest

from ocptip.api.inputs.given import given_motion, task_of_motion
from ocptip.api.tasks import load_task
from ocptip.published.tasks import experiment_task
from ocptip.standing.tolerance import DEFAULT, NONE, SITE, WORKSHOP, Uncertainty


@pytest.fixture
def motion(tmp_path):
    path = tmp_path / "plan.json"
    path.write_text(
        json.dumps({"case": "C", "base": "effective", **experiment_task("C").reference.to_dict()})
    )
    return path


def test_cases_and_files_have_the_default_unless_they_state_another(motion, tmp_path):
    silent, nominal = tmp_path / "silent.toml", tmp_path / "nominal.toml"
    silent.write_text('case = "C"\n')
    nominal.write_text('case = "C"\n[tolerance]\npreset = "none"\n')
    reference = experiment_task("C").reference
    tasks = [
        load_task("C"),
        load_task(silent),
        task_of_motion(motion, None, None)[0],
        task_of_motion(motion, str(silent), None)[0],
        given_motion(motion, "C")[1],
        given_motion(reference, "C")[1],
        given_motion(reference, silent)[1],
    ]
    assert [task.limits.tolerance for task in tasks] == [DEFAULT] * len(tasks)
    for task in (load_task(nominal), task_of_motion(motion, str(nominal), None)[0]):
        assert task.limits.tolerance == NONE
    assert task_of_motion(motion, None, "printed")[0].robot.support.mass == 6.582


def test_the_default_is_named_as_such():
    assert WORKSHOP.scope == WORKSHOP.of(None).scope == "'workshop' uncertainty (default)"
    assert SITE.scope == "'site' uncertainty"
    assert Uncertainty(tilt=0.01).scope == "the given uncertainty"
