"""Files appear complete or not at all; data become strict JSON; versions need no installation."""

from __future__ import annotations

import copy
import dataclasses
import json
import os
import stat
from importlib import metadata

import numpy as np
import pytest

from ocptip.basics.write import PACKAGES, atomic_file, plain, versions, write_json, write_text


@dataclasses.dataclass
class Point:
    name: str
    at: np.ndarray


def test_an_error_within_the_block_leaves_the_old_file(tmp_path):
    target = tmp_path / "a.txt"
    target.write_text("old")

    def half():
        with atomic_file(target) as stream:
            stream.write(b"new")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        half()
    assert target.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_errors_name_the_path(tmp_path):
    target = tmp_path / "missing" / "a.txt"
    with pytest.raises(FileNotFoundError) as caught:
        write_text(target, "new")
    assert caught.value.filename == str(target)


@pytest.mark.skipif(os.name == "nt", reason="permissions of POSIX")
def test_permissions_are_those_of_any_other_file(tmp_path):
    (tmp_path / "other").write_text("")
    write_text(tmp_path / "a.txt", "\N{GREEK SMALL LETTER MU}")
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("other", "a.txt")]
    assert modes[0] == modes[1]
    assert (tmp_path / "a.txt").read_bytes() == b"\xce\xbc"


def test_json_is_strict_and_ends_with_a_line_end(tmp_path):
    write_json(tmp_path / "a.json", {"a": np.nan, 1: Point("p", np.array([1.0, np.inf]))}, indent=None)
    text = (tmp_path / "a.json").read_text()
    assert text == '{"a": null, "1": {"name": "p", "at": [1.0, null]}}\n'
    write_json(tmp_path / "a.json", [1])
    assert json.loads((tmp_path / "a.json").read_text()) == [1]


def test_plain_data():
    value = {"a": np.arange(2), 1: (np.float64("inf"), True, None), "o": np.bool_(False), "s": slice(1)}
    original = copy.deepcopy(value)
    expected = {"a": [0, 1], "1": [None, True, None], "o": False, "s": "slice(None, 1, None)"}
    assert plain(value) == expected
    assert set(value) == set(original)


def test_versions_without_installation(monkeypatch):
    known = metadata.version("numpy")

    def version(name):
        if name == "numpy":
            return known
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "version", version)
    found = versions()
    assert list(found) == ["python", "ocptip", *PACKAGES]
    assert found["ocptip"] == "0+not.installed"
    assert found["numpy"] == np.__version__
    assert found["clarabel"] == "not installed"
