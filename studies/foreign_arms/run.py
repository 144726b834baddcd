"""Arms of other people's packages, their URDFs untouched: are they accepted, does their plan stand?

    python -m studies.foreign_arms.run --out FOLDER [--packages DIR ...] [--only NAME ...] [--starts 2]

For every arm of arms.toml: `ocptip init` writes a task file, its marked lines are filled in (the file's lines
count, without comments and blank ones), `ocptip plan` plans it, without payload and with the nominal one. The
packages are found where they are installed, or in the folders --packages (`pip install --target`). Writes
foreign_arms.json and .md, and per arm a folder with its task file and plan.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ocptip.basics.errors import InputError
from ocptip.basics.write import versions, write_text
from ocptip.task_files.template import MARK, task_template
from studies.common import PLANNING, ended, json_text, machine, number, source_state, table

_NAME = "foreign_arms"
_PLACES = {"example-robot-data": "share/example-robot-data/robots"}  # within a cmeel prefix
_PLAN = "import sys; from ocptip.cli.main import main; sys.exit(main(sys.argv[1:]))"
_PAYLOADS = find_spec("ocptip.task_files.payload") is not None


def package_folder(name: str, folders: Sequence[Path]) -> Path:
    """Where the URDFs of a package lie.

    Raises:
        InputError: it is neither installed nor in one of the folders.
    """
    inside = _PLACES.get(name)
    if inside is None:
        candidates = [folder / name for folder in folders]
        found = find_spec(name)
        candidates += [Path(place) for place in (found.submodule_search_locations or ())] if found else []
    else:
        roots = [*folders, *(Path(entry) for entry in sys.path)]
        candidates = [root / "cmeel.prefix" / inside for root in roots]
    for candidate in candidates:
        if candidate.is_dir():
            return candidate
    raise InputError(f"package {name} not found; pip install --target DIR {name}, then --packages DIR")


def task_text(arm: Mapping[str, Any], urdf: Path, folder: Path, payload: float) -> str:
    """The file of `ocptip init` with its marked lines filled in."""
    names = {key: arm.get(key) for key in ("base_link", "tool_frame")}
    base = arm["base"]
    x, y = base["half"]
    values: dict[str, Any] = {
        "mass": base["mass"],
        "center_of_mass": [0, 0, round(0.4 * base["height"] + 0.1, 3)],
        "feet": [[x, y, 0], [x, -y, 0], [-x, -y, 0], [-x, y, 0]],
        "friction": 0.6,
        "mount_position": [0, 0, base["height"]],
        **{key: arm[key] for key in ("start_deg", "goal_deg", "start_m", "goal_m") if key in arm},
        **arm.get("fill", {}),
    }
    lines = []
    for line in task_template(urdf, folder, **names).text.splitlines():
        if line.startswith(MARK):
            key = line.removeprefix(MARK).split("=")[0].strip()
            line = f"{key} = {values[key]}"
        lines.append(line)
    if "optimised" in arm:
        lines.append(f"optimised = {json.dumps(arm['optimised'])}")
    if payload:
        lines += ["", "[payload]", f"mass = {payload}", "center_of_mass = [0, 0, 0.05]"]
    return "\n".join(lines) + "\n"


def code_lines(text: str) -> int:
    """Lines that are neither blank nor comments."""
    return sum(bool(line.strip()) and not line.lstrip().startswith("#") for line in text.splitlines())


def planned(folder: Path, starts: int, limit: float) -> dict[str, Any]:
    """What `ocptip plan` says of the file task.toml, and its CPU time."""
    command = [sys.executable, "-c", _PLAN, "plan", "task.toml", "--json", "--no-figures", "--jobs", "1"]
    command += ["--starts", str(starts), "--out", "plan"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=limit, check=False)
    except subprocess.TimeoutExpired:
        return {"verdict": "stopped", "reason": f"not done in {limit:g} s", "cpu_s": limit}
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    if done.returncode not in (0, 1):
        return {"verdict": "refused", "reason": done.stderr.strip(), "cpu_s": cpu}
    data = json.loads(done.stdout)
    worst, reason = data.get("worst", {}), data.get("status") or "; ".join(data.get("violations", []))
    distance = worst.get("clearance_m", {})
    return {
        "verdict": "verified" if data["verified"] else "no plan",
        "reason": reason,
        "cpu_s": cpu,
        "energy_J": data.get("energy_J"),
        "duration_s": data.get("duration_s"),
        "GN": worst.get("GN", {}).get("value"),
        "GT": worst.get("GT", {}).get("value"),
        "distance_m": distance.get("value"),
        "distance_between": distance.get("detail"),
        "verified_starts": sum(start["verified"] for start in data.get("starts", [])),
    }


def rows_of(
    arm: Mapping[str, Any], folders: Sequence[Path], out: Path, starts: int, limit: float
) -> Iterator[dict[str, Any]]:
    """One row per payload."""
    urdf = package_folder(arm["package"], folders) / arm["urdf"]
    for payload in (0, arm["payload"]) if _PAYLOADS else (0,):
        folder = out / f"{arm['name'].split(',')[0].replace(' ', '_')}{'_loaded' if payload else ''}"
        folder.mkdir(parents=True, exist_ok=True)
        row = {"arm": arm["name"], "package": arm["package"], "urdf": arm["urdf"], "payload_kg": payload}
        try:
            text = task_text(arm, urdf, folder, payload)
        except InputError as error:
            yield {**row, "accepted": False, "verdict": "refused", "reason": str(error)}
            continue
        write_text(folder / "task.toml", text)
        joints = [key for key in text.splitlines() if key.startswith("#   ")]
        sliding = sum(" m, " in line for line in joints)
        found = planned(folder, starts, limit)
        yield {
            **row,
            "accepted": found["verdict"] != "refused",
            "joints": len(joints),
            "sliding": sliding,
            "lines": code_lines(text),
            **found,
        }


def report(data: Mapping[str, Any]) -> str:
    """Results as Markdown."""
    head = [
        "arm",
        "package",
        "joints",
        "payload kg",
        "lines",
        "verdict",
        "J",
        "s",
        "GN",
        "GT",
        "least distance m",
    ]
    rows = []
    for row in data["rows"]:
        joints = f"{row.get('joints', '-')}" + (f", {row['sliding']} slide" if row.get("sliding") else "")
        distance = row.get("distance_m")
        between = (
            f" ({row['distance_between']})" if distance is not None and row.get("distance_between") else ""
        )
        rows.append(
            [
                row["arm"],
                row["package"],
                joints,
                f"{row['payload_kg']:g}",
                f"{row.get('lines', '-')}",
                row["verdict"],
                number(row.get("energy_J"), 1),
                number(row.get("duration_s"), 2),
                number(row.get("GN")),
                number(row.get("GT")),
                ("not checked" if distance is None else number(distance)) + between,
                number(row.get("cpu_s"), 0),
            ]
        )
    verified = sum(row["verdict"] == "verified" for row in data["rows"])
    reasons = [
        f"- {r['arm']}, {r['payload_kg']:g} kg: {r['reason']}" for r in data["rows"] if r.get("reason")
    ]
    lines = [
        "# Arms of other people's packages",
        "",
        f"{len(rows)} tasks, {sum(r['accepted'] for r in data['rows'])} accepted, {verified} verified; "
        f"{data['starts']} starts each, one process; no URDF touched.",
        *([] if _PAYLOADS else ["Without payload only: this state of the source has none."]),
        "",
        *table([*head, "CPU s"], rows, left=3),
        "",
        *(["Not verified:", "", *reasons, ""] if reasons else []),
        f"Source {data['source']}, {data['machine']['cores']} cores, shared with other work.",
    ]
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--packages", type=Path, nargs="+", default=[])
    parser.add_argument("--only", nargs="+", default=[], help="arms whose names begin so")
    parser.add_argument("--starts", type=int, default=2)
    parser.add_argument("--limit", type=float, default=600.0, help="s per plan")
    options = parser.parse_args(arguments)
    arms = tomllib.loads((Path(__file__).parent / "arms.toml").read_text(encoding="utf-8"))["arm"]
    chosen = [a for a in arms if not options.only or a["name"].startswith(tuple(options.only))]

    def study() -> str:
        data: dict[str, Any] = {
            "starts": options.starts,
            "source": source_state(*PLANNING, "task_files"),
            "machine": machine(),
            "versions": versions(),
            "rows": [],
        }
        options.out.mkdir(parents=True, exist_ok=True)
        for arm in chosen:
            for row in rows_of(arm, options.packages, options.out / _NAME, options.starts, options.limit):
                data["rows"].append(row)
                print(
                    f"{row['arm']}, {row['payload_kg']:g} kg: {row['verdict']}", file=sys.stderr, flush=True
                )
                write_text(options.out / f"{_NAME}.json", json_text(data) + "\n")
                write_text(options.out / f"{_NAME}.md", report(data))
        return report(data)

    return ended(_NAME, study, "the arms so far are written.")


if __name__ == "__main__":
    sys.exit(main())
