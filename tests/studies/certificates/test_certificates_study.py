"""The study of certificates on one plan, and its words."""

import json

import pytest

from studies.certificates import run as study
from studies.common import RESULTS


@pytest.fixture
def one_plan(tmp_path):
    source = RESULTS / "plans" / "B-effective" / "plan.json"
    target = tmp_path / "plans" / "B-effective"
    target.mkdir(parents=True)
    (target / "plan.json").write_bytes(source.read_bytes())
    return tmp_path


@pytest.mark.slow
def test_one_plan_as_ramps_and_by_controllers(one_plan, capsys):
    none, out = str(one_plan), str(one_plan / "out")
    assert study.main(["--plans", f"{none}/plans", "--replayed", none, "--out", out]) == 0
    rows = json.loads((one_plan / "out" / "certificates.json").read_text(encoding="utf-8"))["rows"]
    assert [row["kind"] for row in rows] == ["ramps", "cubic points", "S-curves", "quintic points"]
    ramps = rows[0]
    assert ramps["verified"]
    assert ramps["certified"]
    assert 0 <= ramps["loss"]["GN"] <= 1e-3
    text = capsys.readouterr().out
    verified = sum(row["verified"] for row in rows)
    assert f"{verified} of {verified} verified motions are certified" in text


def test_nothing_to_look_at(tmp_path, capsys):
    nothing = ["--plans", str(tmp_path), "--replayed", str(tmp_path)]
    assert study.main([*nothing, "--out", str(tmp_path / "out")]) == 1
    assert "no plans in" in capsys.readouterr().err
    assert study.main([*nothing, "--folders", str(tmp_path), "--out", str(tmp_path)]) == 1
    assert "no folder of a plan" in capsys.readouterr().err
