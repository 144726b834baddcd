"""Machine code of others is not loaded: owner, mode and links count, not a digest within the file."""

from __future__ import annotations

import hashlib
import os
import stat
import warnings

import pytest

from ocptip.basics.errors import InputWarning
from ocptip.numerics.jit import machine, private

pytestmark = pytest.mark.skipif(not hasattr(os, "getuid"), reason="owners and modes of POSIX")


@pytest.fixture
def cache(monkeypatch, tmp_path):
    """The folder of machine code, with one file; a process of its own afterwards."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("OCPTIP_CACHE_DIR", "")
    for one in (private._instead, private._temporary):
        one.cache_clear()
    machine.keep_code(b"key", b"code")
    yield tmp_path / "ocptip"
    for one in (private._instead, private._temporary):
        one.cache_clear()


def loaded():
    return machine.kept_code(b"key")


def test_what_is_made_is_private(cache):
    [file] = cache.iterdir()
    assert [stat.S_IMODE(one.stat().st_mode) for one in (cache, file)] == [0o700, 0o600]
    assert loaded() == b"code"


@pytest.mark.parametrize("mode", [0o720, 0o702, 0o777, 0o1777])
def test_a_folder_that_others_can_write_to(cache, mode):
    cache.chmod(mode)
    with pytest.warns(InputWarning, match=rf"can be written by others \(mode {mode:o}\)"):
        assert loaded() is None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        machine.keep_code(b"key", b"other")  # no second warning
        assert loaded() == b"other"
    instead = machine._path(b"key").parent
    assert instead != cache
    assert stat.S_IMODE(instead.stat().st_mode) == 0o700
    assert os.environ["OCPTIP_CACHE_DIR"] == str(instead.parent)  # of processes that are started
    assert len(list(cache.iterdir())) == 1


def test_a_folder_of_somebody_else(cache, monkeypatch):
    monkeypatch.setattr(os, "getuid", lambda: cache.stat().st_uid + 1)
    with pytest.warns(InputWarning, match="belongs to user"):
        assert loaded() is None


def test_a_folder_that_is_a_link(cache):
    cache.rename(cache.with_name("other"))
    cache.symlink_to(cache.with_name("other"))
    with pytest.warns(InputWarning, match="is a symbolic link"):
        assert loaded() is None


@pytest.mark.parametrize("how", ["mode", "link", "folder", "pipe"])
def test_a_file_that_others_may_have_put_there(cache, how, tmp_path):
    [file] = cache.iterdir()
    if how == "mode":
        file.chmod(0o622)
    else:
        file.rename(tmp_path / "planted")
        {
            "link": lambda: file.symlink_to(tmp_path / "planted"),
            "folder": file.mkdir,
            "pipe": lambda: os.mkfifo(file),
        }[how]()
    assert loaded() is None


def test_a_file_of_somebody_else(cache, monkeypatch):
    """The folder is judged first, then the file: of another owner."""
    real, opened = os.fstat, []

    def fstat(descriptor):
        about = real(descriptor)
        opened.append(about)
        if stat.S_ISREG(about.st_mode):
            return os.stat_result((*about[:4], about.st_uid + 1, *about[5:10]))
        return about

    monkeypatch.setattr(private.os, "fstat", fstat)
    assert loaded() is None
    assert {stat.S_IFMT(about.st_mode) for about in opened} == {stat.S_IFDIR, stat.S_IFREG}


def test_code_planted_with_a_right_digest_is_not_run(cache):
    [file] = cache.iterdir()
    planted = b"evil"
    file.write_bytes(hashlib.sha256(planted).digest() + planted)
    assert loaded() == planted  # of this user itself
    cache.chmod(0o777)
    with pytest.warns(InputWarning):
        assert loaded() is None
