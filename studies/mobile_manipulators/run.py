"""Mobile manipulators of other people: what `ocptip init` reads of their bases, and whether its file plans.

    python -m studies.mobile_manipulators.run --folder ROBOTS --out FOLDER [--only NAME ...] [--joints N]
    python -m studies.mobile_manipulators.run --out FOLDER --table

Every URDF below ROBOTS whose name is asked for goes through `init`. Where it asks which link is the tool it
gets the first of its candidates behind most moved joints. The study then takes the marks out of the file,
names the first joints to be optimised, and plans with one start. Judged independently of ocptip: the mass
against the sum of Pinocchio's bodies, the contacts against the vertices of the meshes of their links, read by
trimesh and placed by the URDF's own origins at zero.

Writes a line per robot to mobile_manipulators.jsonl and the table to mobile_manipulators.csv.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
import trimesh

from ocptip.basics.toml import MARK
from ocptip.basics.write import versions
from ocptip.task_files.cycle import read_task
from studies.common import JsonLines, commit, ended, progress, software, table
from studies.stock_robots.robots import StockRobot
from studies.stock_robots.run import asked_for_tool, command

SEED = 0
_BELOW = 0.002  # m: vertices that count as the lowest ones
COLUMNS = (
    "robot",
    "base_kg",
    "arm_kg",
    "mass_error",
    "contacts",
    "off_mm",
    "gap_mm",
    "lines",
    "plan",
    "cpu_s",
)


def urdfs(folder: Path) -> Iterator[Path]:
    """All URDF files below a folder, through links."""
    for place, _, names in os.walk(folder, followlinks=True):
        yield from (Path(place, name) for name in sorted(names) if name.endswith(".urdf"))


def studied(urdf: Path, folder: Path, seconds: int, joints: int) -> dict[str, Any]:
    """What is known about one robot; it is planned with so many joints optimised, 0: not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    first = ("init", str(urdf.absolute()), "--out", "task.toml", "--json")
    (folder / "task.toml").unlink(missing_ok=True)
    outcome = command(first, folder, seconds)
    if outcome.outcome == "refused" and (candidates := asked_for_tool(folder)):
        stock = StockRobot("", urdf, 0, 0.0)
        outcome = command((*first, "--tool-frame", max(candidates, key=stock.moved_before)), folder, seconds)
    if outcome.outcome != "yes":
        return {"init": outcome.outcome, "reason": outcome.reason}
    about = json.loads((folder / "init.out").read_text())
    path = folder / "task.toml"
    text = path.read_text().replace(f"{MARK} ", "")
    optimised = json.dumps(about["joints"][: max(joints, 1)])
    path.write_text(text.replace("\n# optimised", f"\noptimised = {optimised}\n# optimised"))
    lines = len(about["to_fill"]) + 1
    row = {"init": "yes", "joints": about["joints"], "tool": about["tool_frame"], "lines": lines}
    row |= {"base": about["base"], "to_fill": about["to_fill"], "examples": about["examples"]}
    row |= _masses(urdf, path) | _off(urdf, about["base_link"], about["base"]["contacts"])
    if joints:
        call = ("plan", "task.toml", "--out", "plan", "--jobs", "1", "--starts", "1", "--seed", f"{SEED}")
        outcome = command((*call, "--no-figures", "--overwrite"), folder, seconds)
        row |= {"plan": outcome.outcome, "reason": outcome.reason, "cpu_s": outcome.cpu, "optimised": joints}
    return row


def _masses(urdf: Path, task: Path) -> dict[str, float]:
    """Masses of base and arm in the task, kg, and how far their sum is off Pinocchio's, as a share."""
    base = float(tomllib.loads(task.read_text())["base"]["mass"])
    arm = float(read_task(task).robot.arm.masses.sum())
    root = _tree(urdf)
    for limit in root.iter("limit"):  # Pinocchio refuses limits without these
        limit.attrib.update({"effort": "0", "velocity": "0"} | limit.attrib)
    for link in root.iter("link"):  # nor does it know capsules
        for item in link.findall("collision"):
            link.remove(item)
    whole = sum(body.mass for body in pin.buildModelFromXML(ET.tostring(root, "unicode")).inertias)
    return {"base_kg": base, "arm_kg": arm, "urdf_kg": whole, "mass_error": abs(base + arm - whole) / whole}


def _off(urdf: Path, base: str, contacts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Largest distances, mm: of contacts from the box of their links' lowest vertices, seen from above, and
    of these vertices from the common ground. None: no link of them has a mesh or solid that trimesh reads."""
    root = _tree(urdf)
    places = _places(root)
    to_base = np.linalg.inv(places[base])
    off, lows = [], []
    for contact in contacts:
        link = contact["reason"].split(":")[0]
        vertices = _vertices(root, urdf, link, to_base @ places[link]) if link in places else None
        if vertices is None:
            continue
        low = vertices[vertices[:, 2] < vertices[:, 2].min() + _BELOW]
        at = np.array(contact["position"][:2])
        off.append(np.linalg.norm(at - np.clip(at, low[:, :2].min(axis=0), low[:, :2].max(axis=0))))
        lows.append(float(vertices[:, 2].min()))
    if not off:
        return {"off_mm": None, "gap_mm": None, "judged": 0}
    return {"off_mm": 1e3 * max(off), "gap_mm": 1e3 * (max(lows) - min(lows)), "judged": len(off)}


def _tree(urdf: Path) -> ET.Element:
    """The robot; prefixes that no file declares, such as drake:acceleration, are part of the names."""
    text = urdf.read_text()
    return ET.fromstring(text if "xmlns" in text else re.sub(r"(</?|\s)(\w+):(\w+[ =>/])", r"\1\2_\3", text))


def _origin(element: ET.Element | None) -> np.ndarray:
    """(4, 4) of an <origin>."""
    found = np.eye(4)
    if element is not None:
        r, p, y = (float(word) for word in element.get("rpy", "0 0 0").split())
        found = trimesh.transformations.euler_matrix(r, p, y, "sxyz")
        found[:3, 3] = [float(word) for word in element.get("xyz", "0 0 0").split()]
    return found


def _places(root: ET.Element) -> dict[str, np.ndarray]:
    """(4, 4) of all links in the frame of the root link, joints at zero."""
    joints = root.findall("joint")
    children = {joint.find("child").get("link") for joint in joints}
    places = {
        link.get("name"): np.eye(4) for link in root.findall("link") if link.get("name") not in children
    }
    while len(places) < len(root.findall("link")):
        for joint in joints:
            parent, child = joint.find("parent").get("link"), joint.find("child").get("link")
            if parent in places and child not in places:
                places[child] = places[parent] @ _origin(joint.find("origin"))
    return places


def _vertices(root: ET.Element, urdf: Path, link: str, place: np.ndarray) -> np.ndarray | None:
    """Vertices (k, 3), m, of a link's collision geometry, else of its visual geometry."""
    element = next(own for own in root.findall("link") if own.get("name") == link)
    found = []
    for solid in element.findall("collision") or element.findall("visual"):
        mesh = solid.find("geometry/mesh")
        shape = None if mesh is None else _mesh(mesh, urdf)
        if mesh is None:
            shape = _primitive(solid.find("geometry")[0])
        if shape is None:
            return None
        found.append(trimesh.transform_points(shape, place @ _origin(solid.find("origin"))))
    return np.vstack(found) if found else None


def _primitive(element: ET.Element) -> np.ndarray:
    size = {key: [float(word) for word in value.split()] for key, value in element.attrib.items()}
    if element.tag == "box":
        return trimesh.creation.box(size["size"]).vertices
    if element.tag == "sphere":
        return trimesh.creation.icosphere(5, size["radius"][0]).vertices
    return trimesh.creation.cylinder(size["radius"][0], size["length"][0], sections=720).vertices


def _mesh(element: ET.Element, urdf: Path) -> np.ndarray | None:
    name = element.get("filename", "")
    rest = name.split("://", 1)[-1]
    tries = [urdf.parent / rest, *(folder / rest for folder in urdf.resolve().parents)]
    path = next((own for own in tries if own.is_file()), None)
    if path is None:
        return None
    try:
        mesh = trimesh.load(path, force="mesh")
    except Exception:
        return None
    return np.asarray(mesh.vertices) * [float(word) for word in element.get("scale", "1 1 1").split()]


def written(rows: Sequence[Mapping[str, Any]], out: Path) -> str:
    """The table, which is written as CSV as well."""
    lines = []
    for row in {row["robot"]: row for row in rows}.values():
        if row["init"] != "yes":
            lines.append([row["robot"], *["-"] * 7, f"init: {row['init']}", "-"])
            continue
        kinds = Counter(contact["kind"] for contact in row["base"]["contacts"])
        contacts = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
        if not row["base"]["from_urdf"]:
            contacts = "invented"
        off, gap = ("-" if row[key] is None else f"{row[key]:.1f}" for key in ("off_mm", "gap_mm"))
        error = f"{row['mass_error']:.0e}" if row["base"]["from_urdf"] else "-"
        masses = f"{row['base_kg']:.2f}", f"{row['arm_kg']:.2f}", error
        plan = row.get("plan", "-")
        cpu = f"{row['cpu_s']:.0f}" if "cpu_s" in row else "-"
        lines.append([row["robot"], *masses, contacts, off, gap, str(row["lines"]), plan, cpu])
    with (out / "mobile_manipulators.csv").open("w", newline="") as file:
        csv.writer(file).writerows([COLUMNS, *lines])
    commits = ", ".join(sorted({row["commit"] for row in rows}))
    head = [
        "# Mobile manipulators of other people's packages",
        "",
        "`init` got the URDF, and the tool where it asked for one; plans had one start and seed 0.",
        "`mass_error`: of base and arm against all bodies of Pinocchio, a share. `off_mm`: largest distance",
        f"of a contact from the lowest vertices (within {1e3 * _BELOW:g} mm) of its link, seen from above.",
        "`gap_mm`: difference of the heights of the contacts' links. `lines`: that had to be changed, one of",
        "them names the optimised joints. `-`: not run.",
        "",
        f"Commits {commits}; {software(rows[-1]['software'])}." if rows else "",
        "",
    ]
    return "\n".join([*head, *table(COLUMNS, sorted(lines))]) + "\n"


def study(options: argparse.Namespace) -> str:
    """Run what is asked for; the table."""
    rows = JsonLines(options.out / "mobile_manipulators.jsonl")
    if not options.table:
        options.out.mkdir(parents=True, exist_ok=True)
        chosen = [urdf for urdf in urdfs(options.folder) if not options.only or urdf.stem in options.only]
        head = {"commit": commit(), "software": versions(), "seed": SEED}
        for number, urdf in enumerate(chosen):
            progress(number, len(chosen), urdf.stem)
            row = studied(urdf, options.out / urdf.stem, options.seconds, options.joints)
            rows.append({"robot": urdf.stem, **head, **row})
    return written(rows.read(), options.out)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--folder", type=Path, metavar="ROBOTS", help="holds URDF files with their meshes")
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="where results go")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="names of URDF files")
    parser.add_argument("--seconds", type=int, default=600, metavar="S", help="CPU time of a command (600)")
    parser.add_argument("--joints", type=int, default=2, metavar="N", help="optimised ones (2); 0: no plans")
    parser.add_argument("--table", action="store_true", help="print the table of what is there")
    return ended("mobile_manipulators", lambda: study(parser.parse_args(arguments)), "rows are kept.")


if __name__ == "__main__":
    sys.exit(main())
