"""A stranger's path: an empty folder, somebody's URDF, this repository; install, init, plan, view, report.

Every step is a command of its own in a new virtual environment; a page each of `view` and `report` is made at
the end. Measured are wall-clock time and CPU time, of plans in one process, since those that are forked for
it are not counted; a person who reads and types comes on top.
"""

from __future__ import annotations

import argparse
import json
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from ocptip.basics.toml import MARK
from ocptip.basics.write import write_json, write_text
from studies.common import RESULTS, ended, machine, table

REPOSITORY = Path(__file__).parents[2]
AGAIN = "plan, again"  # to see what the first one compiles; not a part of the path
PACKAGE, URDF = "airo-models", "arms/ur5e/ur5e.urdf"


@dataclass(frozen=True)
class Step:
    """One command: what it is called, what was typed, how it ended, how long it took, its first line."""

    name: str
    typed: str
    code: int
    seconds: float
    cpu_seconds: float
    said: str


def step(name: str, folder: Path, *typed: str) -> Step:
    """Run a command of the folder's environment there; one that ends with an error ends the study."""
    began, cpu = time.monotonic(), _cpu()
    command = [str(folder / ".venv" / "bin" / typed[0]), *typed[1:]]
    if name == "environment":
        command = [sys.executable, *typed[1:]]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    seconds, spent = time.monotonic() - began, _cpu() - cpu
    text = " ".join(typed).replace(str(REPOSITORY), "REPOSITORY").replace(str(folder), ".")
    said = (done.stdout.strip() or "-").splitlines()[0]
    if done.returncode:
        raise ValueError(f"{text}: exit code {done.returncode}: {done.stderr.strip()[-500:]}")
    return Step(name, text, done.returncode, seconds, spent, said)


def _cpu() -> float:
    """s, of all children that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def path_of(folder: Path, urdf: str | None) -> Iterator[Step]:
    """All steps, in order."""
    yield step("environment", folder, "python", "-m", "venv", ".venv")
    yield step("install", folder, "pip", "install", "-q", f"{REPOSITORY}[view]")
    if urdf is None:
        yield step("robot", folder, "pip", "install", "-q", "--no-deps", "--target", "robot", PACKAGE)
        (found,) = folder.glob(f"robot/*/{URDF}")
        urdf = str(found.relative_to(folder))
    yield step("init", folder, "ocptip", "init", urdf, "--out", "cart.toml")
    task = folder / "cart.toml"
    task.write_text(filled_in(task.read_text()))
    yield step("plan", folder, "ocptip", "plan", "cart.toml", "--out", "plan", "--jobs", "1")
    yield step(AGAIN, folder, "ocptip", "plan", "cart.toml", "--out", "plan", "--jobs", "1")
    yield step("check", folder, "ocptip", "check", "plan")
    yield step("view", folder, "ocptip", "view", "plan", "--html", "view.html")
    yield step("report", folder, "ocptip", "report", "plan", "--out", "report.html")


def filled_in(text: str) -> str:
    """The task file with the examples in its marked lines as they are, without the marks."""
    return re.sub(rf"^{re.escape(MARK)} ?", "", text, flags=re.MULTILINE)


def text_of(steps: list[Step]) -> str:
    """A table and its sums."""
    rows = [
        (one.name, f"`{one.typed}`", f"{one.seconds:.1f}", f"{one.cpu_seconds:.1f}", one.said)
        for one in steps
    ]
    path = [one for one in steps if one.name != AGAIN]
    wall, cpu = sum(one.seconds for one in path), sum(one.cpu_seconds for one in path)
    head = ("step", "typed", "wall [s]", "CPU [s]", "first line")
    total = f"In all, without the second plan, {wall:.0f} s, {cpu:.0f} s of CPU time."
    return "\n".join([*table(head, rows, left=2), "", total, ""])


def main(arguments: list[str] | None = None) -> int:
    """Run the study; prints a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--urdf", help=f"of another arm (default: {URDF} of {PACKAGE})")
    parser.add_argument("--folder", type=Path, help="an empty one that is kept (default: a temporary one)")
    parser.add_argument("--out", type=Path, default=RESULTS, help="where results go")
    options = parser.parse_args(arguments)

    def study() -> str:
        options.out.mkdir(parents=True, exist_ok=True)  # not only after minutes
        with tempfile.TemporaryDirectory() as scratch:
            folder = (options.folder or Path(scratch)).resolve()
            folder.mkdir(exist_ok=True)
            if any(folder.iterdir()):
                raise ValueError(f"{folder}: is not empty")
            steps = list(path_of(folder, options.urdf))
            plan = json.loads((folder / "plan" / "plan.json").read_text())
        verdict = {key: plan[key] for key in ("verified", "certified", "versions")}
        write_json(
            options.out / "stranger.json", {"steps": [asdict(s) for s in steps], **verdict, **machine()}
        )
        write_text(options.out / "stranger.md", text_of(steps))
        return text_of(steps)

    return ended("stranger", study)


if __name__ == "__main__":
    sys.exit(main())
