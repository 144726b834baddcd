"""What the studies share: rows know what made them, and several writers do not hurt each other."""

from __future__ import annotations

import json
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from studies import common


def test_tables_and_numbers():
    assert common.table(["a", "b", "c"], [["1", "2", "3"]], left=2) == [
        "| a | b | c |",
        "| --- | --- | ---: |",
        "| 1 | 2 | 3 |",
    ]
    assert [common.number(x, 1) for x in (None, 2.0, np.inf)] == ["-", "2.0", "none"]
    assert [common.percent(x) for x in (None, 0.5)] == ["-", "50 %"]
    assert common.percent(0.0351, 2) == "3.51 %"


def test_progress_is_for_terminals_only(capsys, monkeypatch):
    common.progress(1, 2, "halves")
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(common.sys.stderr, "isatty", lambda: True, raising=False)
    common.progress(2, 2, "halves")
    assert capsys.readouterr().err == f"\r\033[K[{30 * '#'}] 2/2 halves\n"


def test_state_depends_on_source_and_versions(monkeypatch):
    common.source_state.cache_clear()
    before = [common.source_state(*names) for names in (("contact",), ("contact", "reserves"))]
    assert before[0] != before[1]
    monkeypatch.setattr(common, "versions", lambda: {"numpy": "0"})
    common.source_state.cache_clear()
    assert common.source_state("contact") not in before
    common.source_state.cache_clear()


def test_task_digest_sees_the_files_that_are_named(tmp_path):
    task, arm = tmp_path / "task.toml", tmp_path / "arm.urdf"
    task.write_text('[arm]\nurdf = "arm.urdf"\njoints = ["a", "b"]\n')
    arm.write_text("<robot/>")
    first = common.task_digest(task)
    assert common.task_digest(task) == first
    arm.write_text("<robot></robot>")
    second = common.task_digest(task)
    task.write_text(task.read_text() + "# more\n")
    assert len({first, second, common.task_digest(task)}) == 3


def test_notes_count_rows_of_other_states():
    assert common.state_notes(["now", "now"], "now") == []
    older, unknown = common.state_notes(["now", "old", None, None], "now")
    assert "another state" in older
    assert "1 of 4" in older
    assert "unknown state" in unknown
    assert "2 of 4" in unknown


def test_rows_of_other_options_stay(tmp_path):
    path = tmp_path / "rows.json"
    zero, one = (common.RowFile(path, {"seed": seed}, ["case"], "now") for seed in (0, 1))
    zero.put({"case": "A", "value": 1})
    one.put({"case": "A", "value": np.float64(2)})
    zero.put({"case": "B", "value": np.inf})
    one.put({"case": "A", "value": 4})
    assert [(r["case"], r["value"]) for r in zero.own] == [("A", 1), ("B", None)]
    assert one.own == [{"case": "A", "value": 4, "seed": 1, "state": "now"}]
    assert zero.find(case="B")["value"] is None
    assert one.find(case="B") is None
    assert json.loads(path.read_text())["versions"]["numpy"] == np.__version__


def test_rows_from_before_there_were_digests_are_read(tmp_path):
    path = tmp_path / "rows.json"
    path.write_text(json.dumps({"task": "a.toml", "steps": 6, "rows": [{"weights": [1, 2, 3], "seed": 0}]}))
    options = {"task": "a.toml", "task_digest": "d", "seed": 0}
    (row,) = common.RowFile(path, options, ["weights"], "now").own
    assert "state" not in row
    assert not common.RowFile(path, {**options, "task": "b.toml"}, ["weights"], "now").own


def test_results_of_other_options_stay(tmp_path):
    (tmp_path / "A.json").write_text(json.dumps({"options": {"seed": 0}, "value": 1}))  # of an older study
    for seed in (1, 2):
        common.keep_result(tmp_path, "A", {"options": {"seed": seed}, "value": 10 * seed})
    found = [common.kept_result(tmp_path, "A", {"seed": seed}) for seed in range(4)]
    assert [result and result["value"] for result in found] == [1, 10, 20, None]


def many_lines(path):
    """Append 200 lines."""
    lines = common.JsonLines(path)
    for k in range(200):
        lines.append({"k": k, "text": "x" * 500})


@pytest.mark.slow
def test_many_writers_lose_no_line(tmp_path):
    pytest.importorskip("fcntl")
    path = tmp_path / "lines.jsonl"
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        list(pool.map(many_lines, [path] * 2))
    found = common.JsonLines(path).read()
    assert sorted(line["k"] for line in found) == sorted(2 * list(range(200)))


def test_torn_and_broken_lines(tmp_path):
    lines = common.JsonLines(tmp_path / "lines.jsonl")
    assert lines.read() == []
    lines.append({"header": 1}, first=True)
    lines.append({"header": 2}, first=True)
    with lines.path.open("ab") as stream:
        stream.write(b'{"a"')
    assert lines.read() == [{"header": 1}]
    lines.append([2])
    assert lines.path.read_text() == '{"header": 1}\n[2]\n'
    lines.path.write_text("[1]\n{\n")
    with pytest.raises(InputError, match="line 2 is broken"):
        lines.read()
