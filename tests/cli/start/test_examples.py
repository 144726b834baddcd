"""`ocptip examples`: all files, no file replaced that differs."""

from __future__ import annotations

import json

import pytest

from ocptip.cli.main import main
from tests.places import EXAMPLES

FILES = sorted(path.relative_to(EXAMPLES) for path in EXAMPLES.rglob("*.*"))


def test_all_files_are_copied(capsys, tmp_path):
    target = tmp_path / "new" / "ex"
    assert main(["examples", str(target)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines == [
        f"{target}: {len(FILES)} files written, 0 were there.",
        *(f"{target / name}" for name in FILES),
    ]
    for name in FILES:
        assert (target / name).read_bytes() == (EXAMPLES / name).read_bytes()
    assert main(["stand", str(target / "scenes/rover_on_slope.toml")]) == 0


def test_again_only_what_is_missing(capsys, tmp_path):
    main(["examples", str(tmp_path)])
    gone = tmp_path / FILES[0]
    gone.unlink()
    capsys.readouterr()
    assert main(["examples", str(tmp_path), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["written"] == [str(gone)]
    assert len(data["present"]) == len(FILES) - 1


def test_a_file_that_differs_stays_and_nothing_is_written(capsys, tmp_path):
    own = [tmp_path / FILES[1], tmp_path / FILES[2]]
    for path in own:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("mine")
    assert main(["examples", str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err == f"ocptip: {tmp_path}: would replace files that differ: {FILES[1]}, {FILES[2]}\n"
    assert sorted(path for path in tmp_path.rglob("*") if path.is_file()) == sorted(own)
    assert all(path.read_text() == "mine" for path in own)


@pytest.mark.parametrize("name", ["file", "file/below"])
def test_no_directory(capsys, tmp_path, name):
    (tmp_path / "file").write_text("")
    assert main(["examples", str(tmp_path / name)]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"ocptip: {tmp_path / 'file'}")
    assert err.count("\n") == 1
