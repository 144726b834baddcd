"""Robots of packages on PyPI through every command, with the defaults of `ocptip init` and no setting tuned.

    python -m studies.stock_robots.run --packages FOLDER --fetch
    python -m studies.stock_robots.run --packages FOLDER --out FOLDER [--only WORD ...] [--again OUTCOME ...]
    python -m studies.stock_robots.run --out FOLDER --table

Every URDF with an arm goes through `init`, `plan`, `check --stops path`, `retime`, `simulate` and `report`.
If `init` asks which link is the tool, it gets the first of its candidates behind most moved joints. From the
task file the study takes the marks away and changes nothing else. Each command is a process with a limit of
CPU time and memory. Writes one line per robot and command to stock_robots.jsonl; goes on where it stopped.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from ocptip.basics.toml import MARK
from ocptip.basics.write import versions
from studies.common import JsonLines, commit, ended, progress
from studies.stock_robots.report import markdown
from studies.stock_robots.robots import StockRobot, stock_robots

PACKAGES = tomllib.loads((Path(__file__).parent / "packages.toml").read_text(encoding="utf-8"))["versions"]
MEMORY = 6 * 2**30
_WALL = 15  # times the CPU limit: other work may share the machine
_NAMED = "init, tool named"
_LATER = {
    "plan": ("plan", "task.toml", "--out", "plan", "--jobs", "1"),
    "check": ("check", "plan", "--stops", "path"),
    "retime": ("retime", "plan", "--out", "retimed"),
    "simulate": ("simulate", "plan"),
    "report": ("report", "plan", "--out", "report.html"),
}


@dataclass(frozen=True)
class Outcome:
    """What became of one command.

    Attributes:
        outcome: proved, checked, yes, no, refused, internal error, time-out or memory.
        reason: the first line of the message, or the headline.
        code: exit code; negative: signal.
        wall, cpu: s.
        memory: maximum resident memory, MB.
    """

    outcome: str
    reason: str
    code: int
    wall: float
    cpu: float
    memory: float


def command(arguments: Sequence[str], folder: Path, seconds: int) -> Outcome:
    """Run one command of ocptip in a folder, with so many seconds of CPU time at most."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))

    began = time.monotonic()
    output, errors = folder / f"{arguments[0]}.out", folder / f"{arguments[0]}.err"
    with output.open("w") as out, errors.open("w") as err:
        process = subprocess.Popen(
            [sys.executable, "-m", "ocptip", *arguments],
            cwd=folder,
            stdout=out,
            stderr=err,
            preexec_fn=limit,
        )
        timer = threading.Timer(_WALL * seconds, process.kill)
        timer.start()
        _, status, used = os.wait4(process.pid, 0)
        timer.cancel()
        process.returncode = code = os.waitstatus_to_exitcode(status)
    said, complained = (path.read_text(errors="replace") for path in (output, errors))
    cpu = used.ru_utime + used.ru_stime
    outcome = classified(arguments[0], code, said, complained)
    reason = shortened(complained if code in (2, 3) or not said.strip() else said)
    return Outcome(outcome, reason, code, time.monotonic() - began, cpu, used.ru_maxrss / 1024)


def classified(name: str, code: int, said: str, complained: str) -> str:
    """The outcome of a command with this exit code and text."""
    if code in (-signal.SIGXCPU, -signal.SIGKILL):
        return "time-out"
    if "MemoryError" in complained or "Out of memory" in complained:
        return "memory"
    if code < 0 or code > 2 or "Traceback" in complained:
        return "internal error"
    if code == 2:
        return "refused"
    if code == 1:
        return "no"
    if name in ("plan", "retime", "check"):
        return "proved" if re.search(r"\b(CERTIFIED|PROVED)\b", said) else "checked"
    return "yes"


def shortened(text: str) -> str:
    """The last error of a command, behind its progress, or the first line of an answer."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    errors = [line.removeprefix("ocptip: ") for line in lines if line.startswith("ocptip: ")]
    return (errors[-1] if errors else lines[0] if lines else "")[:400]


def studied(robot: StockRobot, folder: Path, seconds: int) -> Iterator[tuple[str, Outcome]]:
    """All commands for one robot, as far as each has what it needs."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    first = ("init", str(robot.urdf), "--out", "task.toml")
    outcome = command(first, folder, seconds)
    yield "init", outcome
    if outcome.outcome == "refused" and (candidates := asked_for_tool(folder)):
        tool = max(candidates, key=robot.moved_before)  # the first of those behind most moved joints
        outcome = command((*first, "--tool-frame", tool), folder, seconds)
        yield _NAMED, outcome
    if outcome.outcome != "yes":
        return
    task = folder / "task.toml"
    task.write_text(task.read_text().replace(f"{MARK} ", ""))
    for name, arguments in _LATER.items():
        if name == "plan" or (folder / "plan" / "plan.json").exists():
            yield name, command(arguments, folder, seconds)


def asked_for_tool(folder: Path) -> list[str]:
    """The links among which `init` wants a choice; none if it wants something else."""
    found = re.search(r"tool-frame: is missing, candidates: (.*)", (folder / "init.err").read_text())
    return found[1].split(", ") if found else []


def fetch(folder: Path) -> None:
    """Install each package, without what it depends on, into a folder of its own."""
    for number, (name, version) in enumerate(PACKAGES.items()):
        progress(number, len(PACKAGES), name)
        if not (folder / name).exists():
            call = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target"]
            subprocess.run([*call, str(folder / name), f"{name}=={version}"], check=True)


def study(options: argparse.Namespace) -> str:
    """Run what is asked for; the table."""
    if options.fetch:
        fetch(options.packages)
        return ""
    lines = JsonLines(options.out / "stock_robots.jsonl")
    if options.table:
        return markdown(lines.read())
    options.out.mkdir(parents=True, exist_ok=True)
    robots = stock_robots(options.packages, list(PACKAGES))
    here, software = commit(), versions()
    for number, robot in enumerate(robots):
        place = f"{robot.package}/{robot.urdf.relative_to(options.packages / robot.package)}"
        if number % options.parts[1] != options.parts[0] - 1:
            continue
        if options.only and not any(word in place for word in options.only):
            continue
        last = {(row["urdf"], row["command"]): row["outcome"] for row in lines.read()}
        outcomes = [outcome for (urdf, _), outcome in last.items() if urdf == place]
        if outcomes and not {*outcomes} & {*options.again}:
            continue
        progress(number, len(robots), place)
        version = PACKAGES[robot.package]
        head = {
            "urdf": place,
            "version": version,
            "joints": robot.joints,
            "commit": here,
            "software": software,
            "limit": options.seconds,
        }
        folder = options.out / f"{robot.package}-{'-'.join(robot.urdf.parts[-3:])}"
        for row in [
            {**head, "command": name, **asdict(outcome)}
            for name, outcome in studied(robot, folder, options.seconds)
        ]:
            lines.append(row)  # all of a robot at once, so that what is interrupted is repeated
    return markdown(lines.read())


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--packages", type=Path, metavar="FOLDER", help="holds a folder per package")
    parser.add_argument("--fetch", action="store_true", help="install the packages there, and nothing else")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="where results go")
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="WORD", help="files with one of these in their path"
    )
    parser.add_argument(
        "--again", nargs="+", default=[], metavar="OUTCOME", help="repeat robots with one of these"
    )
    parser.add_argument("--seconds", type=int, default=180, metavar="S", help="CPU time of a command (180)")
    parser.add_argument(
        "--parts", type=int, nargs=2, default=(1, 1), metavar=("K", "N"), help="the K-th N-th"
    )
    parser.add_argument(
        "--table", action="store_true", help="print the table of what is there, and nothing else"
    )
    return ended("stock_robots", lambda: study(parser.parse_args(arguments)), "finished robots are kept.")


if __name__ == "__main__":
    sys.exit(main())
