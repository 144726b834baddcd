"""The path of a stranger: what `init` writes is a task as soon as the marks are gone."""

from __future__ import annotations

from pathlib import Path

import pytest

from ocptip.basics.errors import InputError
from ocptip.basics.toml import MARK
from ocptip.task_files.cycle import read_task
from ocptip.task_files.template import task_template
from studies.stranger.run import filled_in, main
from tests.places import ROOT


def test_marked_lines_are_an_example(tmp_path):
    template = task_template(ROOT / "src" / "ocptip" / "examples" / "tasks" / "ur5.urdf", tmp_path)
    assert MARK in template.text
    path = tmp_path / "cart.toml"
    path.write_text(template.text)
    with pytest.raises(InputError, match=rf"cart\.toml: base\.mass: missing.*{MARK} are not read until"):
        read_task(path)
    path.write_text(filled_in(template.text))
    assert read_task(path).robot.support.mass == pytest.approx(80.0)


def test_a_folder_with_something_in_it_is_refused(tmp_path, capsys):
    Path(tmp_path / "mine").touch()
    assert main(["--folder", str(tmp_path)]) == 1
    assert "is not empty" in capsys.readouterr().err
