"""The study of mobile manipulators on a cart of the tests: masses, contacts, lines that change."""

import json

import pytest

from tests.task_files.test_examples_of_init import cart, folded_arm, written

pytest.importorskip("trimesh")


@pytest.mark.slow
def test_a_cart_goes_through_the_study(tmp_path, capsys):
    from studies.mobile_manipulators.run import main

    (tmp_path / "robots").mkdir()
    written(tmp_path / "robots", *cart(), *folded_arm("chassis"))
    assert main(["--folder", str(tmp_path / "robots"), "--out", str(tmp_path / "out"), "--joints", "0"]) == 0
    assert "| robot | 48.00 | 3.10 |" in capsys.readouterr().out
    (row,) = map(json.loads, (tmp_path / "out" / "mobile_manipulators.jsonl").read_text().splitlines())
    assert row["mass_error"] < 1e-9
    assert row["off_mm"] < 0.1
    assert row["lines"] == 2  # friction, and the joints to be optimised
    assert (tmp_path / "out" / "mobile_manipulators.csv").is_file()
