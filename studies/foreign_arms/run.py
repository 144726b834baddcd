"""Arms of other people's packages, their URDFs untouched: are they accepted, does their plan stand?

    python -m studies.foreign_arms.run --out FOLDER [--packages DIR ...] [--only NAME ...] [--starts 2]

For every arm of arms.toml: `ocptip init` writes a task file, its marked lines are filled in (the file's
lines count, without comments and blank ones), `ocptip plan` plans it: without payload and with the nominal
one, with the URDF's collision geometry; and, for the time it takes, without payload with spheres by hand.
Every verified plan is looked at again in steps of 1 ms on the URDF's meshes (mesh_check.py). The packages are
found where they are installed, or in the folders --packages (`pip install --target`). Writes
foreign_arms.json and .md, and per task a folder with its file and plan. Goes on: rows of the same task, URDF
and number of starts are kept.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import resource
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.write import versions, write_text
from ocptip.robots.collision.gaps import UNSEEN
from ocptip.task_files.template import MARK, TaskTemplate, task_template
from ocptip.trajectories.trajectory import Trajectory
from studies.common import PLANNING, digest, ended, json_text, machine, source_state
from studies.foreign_arms.mesh_check import STEP, MeshCheck
from studies.foreign_arms.report import report

_NAME = "foreign_arms"
_PLACES = {"example-robot-data": "share/example-robot-data/robots"}  # within a cmeel prefix
_PLAN = "import sys; from ocptip.cli.main import main; sys.exit(main(sys.argv[1:]))"
_READ = "from ocptip.task_files.motion import load_task; load_task('task.toml')"
_DECK = 0.1  # m, thickness at most


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


def template_of(arm: Mapping[str, Any], urdf: Path, folder: Path) -> TaskTemplate:
    """What `ocptip init` writes for an arm."""
    return task_template(urdf, folder, base_link=arm.get("base_link"), tool_frame=arm.get("tool_frame"))


def deck_of(base: Mapping[str, Any]) -> tuple[list[float], list[float]] | None:
    """Edges and centre (base axes) of the box under an arm, m; None: the base is part of the URDF."""
    if not base.get("deck", True):
        return None
    (x, y), thick = base["half"], min(_DECK, base["height"])
    return [2 * x, 2 * y, thick], [0, 0, round(base["height"] - thick / 2, 4)]


def task_text(
    arm: Mapping[str, Any],
    template: TaskTemplate,
    payload: float,
    places: Mapping[str, str],
    spheres: float | None = None,
) -> str:
    """The file of `ocptip init` with its marked lines filled in.

    Args:
        arm: an entry of arms.toml.
        template: of it.
        payload: kg, 0: none.
        places: files and folders of its collision geometry, by key of `[arm]`.
        spheres: radius, m: spheres by hand instead of the URDF's geometry.
    """
    base, deck = arm["base"], deck_of(arm["base"])
    x, y = base["half"]
    values: dict[str, Any] = {
        "mass": base["mass"],
        "center_of_mass": [0, 0, round(0.4 * base["height"] + 0.1, 3)],
        "feet": [[x, y, 0], [x, -y, 0], [-x, -y, 0], [-x, y, 0]],
        "friction": 0.5,
        "mount_position": [0, 0, base["height"]],
        **{key: arm[key] for key in ("start_deg", "goal_deg", "start_m", "goal_m") if key in arm},
        **arm.get("fill", {}),
    }
    more: dict[str, list[str]] = {"name": [], "friction": [], "mount_position": []}
    if payload:
        more["name"].append(f"payload = {{ mass = {payload}, center_of_mass = [0, 0, 0.05] }}")
    if deck:
        size, position = deck
        box = f'{{ name = "deck", kind = "box", size = {size}, position = {position} }}'
        more["friction"].append(f"shape = [{box}]")
    if spheres is not None:
        geometry = {"sphere_radius": spheres, "excluded_links": arm.get("excluded_spheres")}
    else:
        geometry = dict(places)
    more["mount_position"] += [f"{key} = {json.dumps(value)}" for key, value in geometry.items() if value]
    lines = []
    for line in template.text.splitlines():
        key = line.removeprefix(MARK).split("=")[0].strip()
        if line.startswith(MARK) and key == "package_dirs":  # comes with the geometry, if it is wanted
            continue
        own = line.startswith(MARK) or key in values.keys() & {"start_deg", "goal_deg", "start_m", "goal_m"}
        lines += [f"{key} = {values[key]}" if own else line, *more.get(key, [])]
    if "optimised" in arm:
        lines.append(f"optimised = {json.dumps(arm['optimised'])}")
    return "\n".join(lines) + "\n"


def places_of(arm: Mapping[str, Any], package: Path, folder: Path) -> dict[str, str]:
    """Where the arm's geometry finds its files, seen from the task's folder.

    A package that lies under another name than the URDF calls it gets a link of that name beside the task.
    """
    places = {}
    if "srdf" in arm:
        places["srdf"] = os.path.relpath((package / arm["srdf"]).resolve(), folder.resolve())
    for name, inside in arm.get("links", {}).items():
        places["package_dirs"] = "."
        if not (folder / name).exists():
            (folder / name).symlink_to((package / inside).resolve(), target_is_directory=True)
    return places


def code_lines(text: str) -> int:
    """Lines that are neither blank nor comments."""
    return sum(bool(line.strip()) and not line.lstrip().startswith("#") for line in text.splitlines())


def cpu_of(arguments: Sequence[str], folder: Path, limit: float) -> tuple[subprocess.CompletedProcess, float]:
    """Run Python in a folder: what came of it, and CPU s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=limit, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return done, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def planned(folder: Path, starts: int, limit: float) -> dict[str, Any]:
    """What `ocptip plan` says of the file task.toml, and its CPU time."""
    command = ["-c", _PLAN, "plan", "task.toml", "--json", "--no-figures", "--jobs", "1"]
    command += ["--starts", str(starts), "--out", "plan"]
    try:
        done, cpu = cpu_of(command, folder, limit)
    except subprocess.TimeoutExpired:
        return {"verdict": "stopped", "reason": f"not done in {limit:g} s", "cpu_s": limit}
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
        "pairs": data.get("collision", {}).get("pairs"),
        "left_out": hidden_pairs(data),
        "distance_m": distance.get("value"),
        "distance_between": distance.get("detail"),
        "iterations": data.get("iterations"),
        "verified_starts": sum(start["verified"] for start in data.get("starts", [])),
    }


def hidden_pairs(data: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Pairs that a plan leaves out although their meshes part: of telescopes, or hidden by convex solids."""
    left_out = data.get("collision", {}).get("left_out", [])
    return [entry for entry in left_out if entry["reason"].startswith(("telescope", UNSEEN))]


def looked_at_again(check: MeshCheck, folder: Path) -> dict[str, Any]:
    """Collisions of the plan of a folder on the meshes."""
    data = json.loads((folder / "plan" / "plan.json").read_text(encoding="utf-8"))
    motion = Trajectory.from_dict(data)
    times = np.append(np.arange(0, data["duration_s"], STEP), data["duration_s"])
    found = check.motion(motion.states(times)[0])
    return {**found, "random_colliding": check.colliding, "always": check.always}


def rows_of(
    arm: Mapping[str, Any],
    folders: Sequence[Path],
    out: Path,
    starts: int,
    limit: float,
    known: Sequence[Mapping[str, Any]] = (),
    loaded_only: bool = False,
) -> Iterator[dict[str, Any]]:
    """One row per payload, none and the nominal one; those `known` are kept if their task is the same."""
    package = package_folder(arm["package"], folders)
    urdf, name = package / arm["urdf"], arm["name"].split(",")[0].replace(" ", "_")
    check = None
    for payload, ending in ((0, ""), (arm["payload"], "_loaded")):
        if loaded_only and not payload:
            continue
        row = {"arm": arm["name"], "package": arm["package"], "urdf": arm["urdf"], "payload_kg": payload}
        folder = out / f"{name}{ending}"
        folder.mkdir(parents=True, exist_ok=True)
        try:
            template = template_of(arm, urdf, folder)
        except InputError as error:
            yield {**row, "accepted": False, "verdict": "refused", "reason": str(error)}
            continue
        places = places_of(arm, package, folder)
        text = task_text(arm, template, payload, places)
        row["task"] = digest([text, hashlib.sha256(urdf.read_bytes()).hexdigest(), starts])
        same = [one for one in known if all(one.get(k) == row[k] for k in ("arm", "payload_kg", "task"))]
        if same:
            yield dict(same[0])
            continue
        write_text(folder / "task.toml", text)
        found = planned(folder, starts, limit)
        row |= {
            "state": source_state(*PLANNING, "task_files"),
            "accepted": found["verdict"] != "refused",
            "joints": template.arm.n,
            "sliding": int(template.arm.prismatic.sum()),
            "lines": code_lines(text),
            **found,
        }
        if found["verdict"] == "verified":
            hidden = [entry["pair"] for entry in found["left_out"]]
            check = check or mesh_check(arm, urdf, template, package, folder, hidden)
            row["meshes"] = looked_at_again(check, folder)
        if not payload:
            row["spheres"] = with_spheres(arm, template, out / f"{name}_spheres", starts, limit)
            row["spheres"]["read_meshes_s"] = cpu_of(["-c", _READ], folder, limit)[1]
        yield row


def with_spheres(
    arm: Mapping[str, Any], template: TaskTemplate, folder: Path, starts: int, limit: float
) -> dict[str, Any]:
    """The same without payload and with spheres by hand along the links."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "task.toml", task_text(arm, template, 0, {}, arm.get("sphere_radius", 0.05)))
    found = planned(folder, starts, limit)
    kept = ("verdict", "reason", "cpu_s", "energy_J", "pairs", "distance_m", "iterations")
    return {key: found.get(key) for key in kept} | {"read_s": cpu_of(["-c", _READ], folder, limit)[1]}


def mesh_check(
    arm: Mapping[str, Any],
    urdf: Path,
    template: TaskTemplate,
    package: Path,
    folder: Path,
    hidden: Sequence[Sequence[str]],
) -> MeshCheck:
    """The independent check of an arm's plans, but for the pairs of :func:`hidden_pairs`."""
    model, deck, base = template.arm, deck_of(arm["base"]), arm["base"]
    return MeshCheck(
        urdf,
        template.base_link,
        model.joint_names,
        model.resting,
        deck=None if deck is None else (deck[0], [0, 0, deck[1][2] - base["height"]]),
        excluded=hidden,
        srdf=package / arm["srdf"] if "srdf" in arm else None,
        package_dirs=[folder],
    )


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--packages", type=Path, nargs="+", default=[])
    parser.add_argument("--only", nargs="+", default=[], help="arms whose names begin so")
    parser.add_argument("--starts", type=int, default=2)
    parser.add_argument("--limit", type=float, default=600.0, help="s per plan")
    parser.add_argument("--loaded", action="store_true", help="only with payload")
    options = parser.parse_args(arguments)
    arms = tomllib.loads((Path(__file__).parent / "arms.toml").read_text(encoding="utf-8"))["arm"]
    chosen = [a for a in arms if not options.only or a["name"].startswith(tuple(options.only))]

    def study() -> str:
        data: dict[str, Any] = {
            "starts": options.starts,
            "machine": machine(),
            "versions": versions(),
            "rows": [],
        }
        options.out.mkdir(parents=True, exist_ok=True)
        path = options.out / f"{_NAME}.json"
        known = json.loads(path.read_text(encoding="utf-8"))["rows"] if path.exists() else []
        for arm in chosen:
            where = options.packages, options.out / _NAME
            for row in rows_of(arm, *where, options.starts, options.limit, known, options.loaded):
                known = [one for one in known if not _same(one, row)] + [row]
                order = {own["name"]: number for number, own in enumerate(arms)}
                data["rows"] = sorted(known, key=lambda r: (order.get(r["arm"], 0), r["payload_kg"]))
                said = f"{row['arm']}, {row['payload_kg']:g} kg: {row['verdict']}"
                print(said, file=sys.stderr, flush=True)
                write_text(path, json_text(data) + "\n")
                write_text(options.out / f"{_NAME}.md", report(data))
        return report(data)

    return ended(_NAME, study, "the arms so far are written.")


def _same(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    return all(one[key] == other[key] for key in ("arm", "payload_kg"))


if __name__ == "__main__":
    sys.exit(main())
