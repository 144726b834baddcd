"""Results of the study of foreign arms as Markdown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

from studies.common import number, table
from studies.foreign_arms.mesh_check import POSTURES

_HEAD = ("arm", "package", "joints", "payload kg", "lines", "verdict", "J", "s", "GN", "GT")
_CHECKS = ("least distance m", "1 ms check on meshes: instants that collide", "CPU s", "spheres", "ratio")


def planning_ratio(row: Mapping[str, Any]) -> float | None:
    """CPU time of planning with the URDF's geometry relative to that with spheres, both without reading."""
    spheres = row.get("spheres") or {}
    if row["verdict"] != "verified" or spheres.get("verdict") != "verified":
        return None
    return (row["cpu_s"] - spheres["read_meshes_s"]) / (spheres["cpu_s"] - spheres["read_s"])


def report(data: Mapping[str, Any]) -> str:
    """Results as Markdown."""
    rows = data["rows"]
    verified = [row for row in rows if row["verdict"] == "verified"]
    lines = [
        "# Arms of other people's packages",
        "",
        f"{len(rows)} tasks, {sum(r['accepted'] for r in rows)} accepted, {len(verified)} verified; "
        f"{data['starts']} starts each, one process; no URDF touched.",
        "",
        *table([*_HEAD, *_CHECKS], map(_cells, rows), left=3),
        "",
        *_on_the_meshes(verified),
        *_on_times(rows),
    ]
    why = [f"- {_task(r)}: {r['reason']}" for r in rows if r.get("reason")]
    why += [
        f"- {_task(r)}, spheres: {r['spheres']['reason']}"
        for r in rows
        if (r.get("spheres") or {}).get("reason")
    ]
    lines += ["", *(["Not verified:", "", *why, ""] if why else [])]
    states = Counter(row.get("state") for row in rows)
    sources = ", ".join(f"{state} ({count} rows)" for state, count in states.items())
    lines.append(f"Source {sources}; {data['machine']['cores']} cores, shared with other work.")
    return "\n".join(lines) + "\n"


def _on_the_meshes(verified: Sequence[Mapping[str, Any]]) -> list[str]:
    again = [row["meshes"] for row in verified if "meshes" in row]
    lines = [
        "- 1 ms check: Pinocchio and coal on the URDF's triangles, pairs chosen anew; left out are",
        f"  neighbours, pairs of the SRDF, those that touch in all of {POSTURES} random postures, and what",
        "  ocptip lists as tubes of a telescope, or as hidden by convex solids:",
        *_hidden(verified),
        *_of_earlier_tasks(verified),
    ]
    if again:
        seen = [found["random_colliding"] for found in again]
        instants, hits = (sum(found[key] for found in again) for key in ("instants", "colliding"))
        lines += [
            f"  {len(again)} plans, {instants} instants, {hits} collide. That it sees collisions: of",
            f"  {POSTURES} random postures of an arm {min(seen)} to {max(seen)} collide.",
        ]
        pairs = {
            f"{row['arm']}: {' and '.join(p)}"
            for row in verified
            for p in row.get("meshes", {}).get("pairs", ())
        }
        lines += [f"  Collides: {pair}." for pair in sorted(pairs)]
    return lines


def _hidden(verified: Sequence[Mapping[str, Any]]) -> list[str]:
    """Pairs that plans leave out and list."""
    rows = {row["arm"]: row for row in verified if row.get("left_out")}
    lines = []
    for name, row in rows.items():
        kinds = [entry["reason"].split(":")[0].split(" (")[0] for entry in row["left_out"]]
        counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
        lines.append(f"  {name}: {counts}.")
    return lines or ["  no pair."]


def _of_earlier_tasks(verified: Sequence[Mapping[str, Any]]) -> list[str]:
    """Rows from before tasks were part of them."""
    old = [row for row in verified if "task" not in row]
    if not old:
        return []
    return [
        f"  {len(old)} rows are of an earlier arms.toml (heavier bases; tubes of Stretch and housings of",
        "  Baxter excluded by hand), their meshes looked at by Pinocchio's computeCollisions, which",
        "  misses some overlaps of cylinders (mesh_check.py).",
    ]


def _on_times(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    ratios = [ratio for row in rows if (ratio := planning_ratio(row)) is not None]
    readings = [row["spheres"]["read_meshes_s"] for row in rows if row.get("spheres")]
    lines = [
        "- CPU s: of the whole command; spheres: the same with spheres by hand along the links, no other",
        "  geometry of the arm. Ratio: of both without start and reading of the file.",
    ]
    if ratios:
        lines += [
            f"  Median of {len(ratios)} ratios {median(ratios):.2f}, largest {max(ratios):.2f}. Start and",
            f"  reading with the URDF's geometry: {min(readings):.1f} to {max(readings):.1f} s.",
        ]
    return lines


def _task(row: Mapping[str, Any]) -> str:
    return f"{row['arm']}, {row['payload_kg']:g} kg"


def _cells(row: Mapping[str, Any]) -> list[str]:
    joints = f"{row.get('joints', '-')}" + (f", {row['sliding']} slide" if row.get("sliding") else "")
    distance, between = row.get("distance_m"), row.get("distance_between")
    found, spheres = row.get("meshes"), row.get("spheres") or {}
    return [
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
        "not checked" if distance is None else number(distance) + (f" ({between})" if between else ""),
        f"{found['colliding']} of {found['instants']}" if found else "-",
        number(row.get("cpu_s"), 0),
        number(spheres.get("cpu_s"), 0),
        number(planning_ratio(row), 2),
    ]
