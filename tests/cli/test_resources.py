"""Too little disk, memory or open files, and Ctrl-C at any time: one line, and nobody else is blamed."""

from __future__ import annotations

import errno
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from ocptip.cli import command
from ocptip.cli.command import BAD_INPUT, INTERNAL_ERROR, INTERRUPTED, explained, say
from tests.places import EXAMPLES
from tests.quick import some

SCENE = str(EXAMPLES / "scenes" / "rover_on_slope.toml")
posix = pytest.mark.skipif(sys.platform != "linux", reason="limits and devices of Linux")


def ocptip(*arguments, limits=(), **options):
    """In a process of its own, after `limits` (name, value) are set."""

    def lower():
        import resource

        for name, value in limits:
            resource.setrlimit(getattr(resource, name), (value, value))

    asked = [sys.executable, "-m", "ocptip", *arguments]
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
    found = subprocess.run(asked, text=True, timeout=300, preexec_fn=lower if limits else None, **options)
    return found.returncode, found.stdout, found.stderr


@posix
@pytest.mark.parametrize("arguments", some(1, [["--version"], ["stand", SCENE, "--json"]]))
def test_a_full_disk_behind_stdout(arguments):
    with open("/dev/full", "w") as full:
        code, _, err = ocptip(*arguments, stdout=full)
    assert (code, err) == (BAD_INPUT, "ocptip: stdout: No space left on device\n")


@pytest.mark.slow
@posix
def test_a_full_disk_behind_stderr():
    with open("/dev/full", "w") as full:
        code, out, _ = ocptip("stand", SCENE, stderr=full)
        assert (code, "STABLE" in out) == (0, True)
        assert ocptip("stand", "no.toml", stderr=full)[0] == BAD_INPUT


@pytest.mark.slow
@posix
@pytest.mark.parametrize("few", [10, 16])
def test_few_open_files(few):
    code, out, err = ocptip("plan", "A", "--jobs", "2", limits=[("RLIMIT_NOFILE", few)])
    said = f"ocptip: too many open files; this process may have {few} files (ulimit -n)\n"
    assert (code, out, err) == (BAD_INPUT, "", said)


@pytest.mark.slow
@posix
@pytest.mark.parametrize("mebibytes", some(1, [250, 500]))
def test_little_memory(mebibytes):
    code, out, err = ocptip("stand", SCENE, limits=[("RLIMIT_AS", mebibytes * 2**20)])
    said = f"ocptip: out of memory; this process may have {mebibytes} MiB (ulimit -v)\n"
    assert (code, out, err) == (BAD_INPUT, "", said)


@pytest.fixture(scope="module")
def whole():
    """How long a short command takes, s."""
    begin = time.perf_counter()
    assert ocptip("stand", SCENE)[0] == 0
    return time.perf_counter() - begin


@pytest.mark.slow
@posix
@pytest.mark.parametrize("share", some(1, [0.3, 0.1, 0.6]))
def test_an_interruption_while_modules_are_loaded(share, whole):
    """Ctrl-C after shares of the time that a short command takes."""
    asked = [sys.executable, "-m", "ocptip", "stand", SCENE]
    with subprocess.Popen(asked, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        time.sleep(share * whole)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=300)
    if "ocptip" not in err + out:
        pytest.skip("before Python itself was ready")
    # A shell says 130 for a process that SIGINT ended, too; so CPython ends where it interrupted exec().
    code = INTERRUPTED if process.returncode == -signal.SIGINT else process.returncode
    assert (code, err.count("\n")) in ((INTERRUPTED, 1), (0, 0)), err
    assert "Traceback" not in err


def raised(error, cause=None):
    try:
        try:
            if cause is not None:
                raise cause
        finally:
            raise error
    except type(error) as caught:
        return caught


@pytest.mark.parametrize(
    ("error", "cause", "code", "said"),
    [
        (MemoryError("Unable to allocate"), None, BAD_INPUT, "out of memory"),
        (RuntimeError("std::bad_alloc"), None, BAD_INPUT, "out of memory"),
        (
            ImportError("x.so: failed to map segment: Cannot allocate memory"),
            None,
            BAD_INPUT,
            "out of memory",
        ),
        (ImportError("numpy failed"), MemoryError(), BAD_INPUT, "out of memory"),
        (RuntimeError("can't start new thread"), None, BAD_INPUT, "the system starts no more threads"),
        (OSError(errno.EMFILE, "Too many open files"), None, BAD_INPUT, "too many open files"),
        (OSError(errno.ENOSPC, "No space left on device", "a/b"), None, BAD_INPUT, "a/b: No space left"),
        (ImportError("numpy failed"), KeyboardInterrupt(), INTERRUPTED, "interrupted"),
        (ValueError("1 is not 2"), None, INTERNAL_ERROR, "internal error: ValueError: 1 is not 2"),
        (np.linalg.LinAlgError("Singular"), None, INTERNAL_ERROR, "internal error: LinAlgError"),
    ],
)
def test_who_is_blamed(error, cause, code, said):
    found, text = explained(raised(error, cause))
    assert found == code
    assert text.startswith(said)


def test_an_interruption_that_a_callback_has_lost(monkeypatch):
    """Callbacks of other libraries drop an interruption, and something else fails."""
    monkeypatch.setattr(command, "stops", [signal.SIGTERM])
    assert explained(RuntimeError("no compiled object yet")) == (INTERRUPTED, "interrupted")


def test_a_message_is_one_line_that_a_terminal_can_show(capsys):
    assert say(2, "a\nb\t\x1b[2J\u2028c" + 10_000 * "x") == 2
    err = capsys.readouterr().err
    assert err.startswith("ocptip: a b \\x1b[2J cxxx")
    assert err.count("\n") == 1
    assert len(err) < command._LONGEST + 100
    assert re.search(r"\(100\d\d characters\)\n$", err)


def test_workers_get_the_files_that_they_need():
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    if before[1] != resource.RLIM_INFINITY and before[1] < 200:
        pytest.skip("the system allows no more")
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (60, before[1]))
        command.require_files(20)
        assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] == 32 + 8 * 20
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


def test_huge_values_of_a_recording_are_refused(tmp_path):
    from ocptip.basics.errors import InputError
    from ocptip.measured.recording import read_recording
    from ocptip.published.tasks import experiment_task

    names = [f"q{k}_deg" for k in range(1, 6)]
    rows = [f"{0.1 * k:.1f}," + ",".join(["1e300" if k == 5 else "1"] * 5) for k in range(60)]
    path = tmp_path / "recording.csv"
    path.write_text("\n".join([",".join(["time_s", *names]), *rows]))
    with pytest.raises(InputError, match=r"recording\.csv: column q1_deg: magnitudes above 1e\+12"):
        read_recording(path, experiment_task("A", "effective").robot)
