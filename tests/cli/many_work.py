"""Answers of tests: what a worker process is asked to do with a task."""

import json
import os
import signal
from pathlib import Path

from ocptip.basics.outputs import replace_folder
from ocptip.cli.command import Report


class Told(Report):
    """What the task says, in a file."""

    def __init__(self, one, options):
        super().__init__()
        self.one, self.starts = one, options.starts

    @property
    def good(self):
        return self.one.task != "no"

    def to_text(self):
        return f"{self.one.name}: {self.one.task.upper()}.\nmore"

    def to_dict(self):
        found = {"case": self.one.name, "digest": self.one.digest, "starts": self.starts}
        found |= {"verified": self.good, "energy_J": 1.5, "duration_s": 2.0, "interrupted": False}
        return {**found, "versions": {"ocptip": "a version"}}

    def write(self):
        yield from replace_folder(self.one.directory, {"plan.json": json.dumps(self.to_dict()).encode()})


def work(one, options, executor):
    """The answer; "dies" ends its process, "fails" raises."""
    assert executor is None
    assert options.jobs == 1
    if one.task == "fails":
        raise ValueError("cannot be")
    if one.task == "dies":
        os.kill(os.getpid(), signal.SIGKILL)
    if one.task.startswith("once"):  # dies at the first time
        path = Path(one.directory.parent / "died")
        if not path.exists():
            path.touch()
            os.kill(os.getpid(), signal.SIGKILL)
    return Told(one, options)
