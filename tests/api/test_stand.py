"""`ocptip.stand` on scenes, files, tasks and robots: the same answers as the command."""

import json

import numpy as np
import pytest

import ocptip
from ocptip.cli.main import main
from ocptip.task_files.motion import load_task
from tests.places import EXAMPLES
from tests.quick import some

PUSHED = EXAMPLES / "scenes" / "pushed_cart.toml"
UR5 = EXAMPLES / "tasks" / "ur5_cart.toml"


def typed(capsys, *arguments):
    code = main(["stand", *map(str, arguments), "--json"])
    return code, json.loads(capsys.readouterr().out)


@pytest.mark.slow
@pytest.mark.parametrize("given", some(1, [PUSHED, str(PUSHED), ocptip.read_scene(PUSHED)]))
def test_a_scene_has_the_answer_of_the_command(given, capsys, tmp_path):
    code, expected = typed(capsys, PUSHED)
    standing = ocptip.stand(given)
    saved = json.loads(standing.save(tmp_path / "scene.json").read_text(encoding="utf-8"))
    assert standing.stable == (code == 0)
    expected.pop("warnings")
    assert saved == expected
    assert standing.save(tmp_path / "scene.svg").stat().st_size > 1000
    assert "N m about contacts" in repr(standing)
    assert ("stable" if standing.stable else "not stable") in repr(standing)


def test_a_posture_is_a_name_or_values_of_a_task_its_file_or_a_robot(capsys):
    code, expected = typed(capsys, UR5, "--posture", "goal", "--tolerance", "none")
    task = load_task(UR5)
    for found in (
        ocptip.stand(UR5, "goal", uncertainty="none"),
        ocptip.stand(task, "goal", uncertainty="none"),
        ocptip.stand(task.robot, task.goal, uncertainty="none"),
    ):
        assert found.stable == (code == 0)
        assert found.tip.GN[0] == pytest.approx(expected["GN"])
        assert found.slip.GT[0] == pytest.approx(expected["GT"], abs=1e-6)
    assert ocptip.stand(task).posture.name == "start"


def test_uncertainty_is_that_of_the_task_unless_it_is_given():
    assert ocptip.stand(UR5, "start").within is not None
    assert ocptip.stand(UR5, "start", uncertainty="none").within is None
    assert ocptip.stand(PUSHED, uncertainty="workshop").within is not None


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((PUSHED, "start"), {}, "pushed_cart.toml"),
        ((ocptip.read_scene(PUSHED), np.zeros(6)), {}, "q: belongs to a robot"),
        ((UR5, "strat"), {}, "q: expected one of start, goal, got 'strat'; did you mean 'start'"),
        ((UR5, [0.0]), {}, "q: expected shape 6, got 1"),
        ((UR5, "start"), {"reference_moment": 9.0}, "reference_moment: of a scene"),
        ((PUSHED,), {"reference_moment": -1.0}, "reference_moment: must be > 0"),
        ((PUSHED,), {"uncertainty": "workshp"}, "workshp"),
    ],
)
def test_what_cannot_be_used_is_named(arguments, options, message):
    with pytest.raises(ocptip.InputError, match=message):
        ocptip.stand(*arguments, **options)
