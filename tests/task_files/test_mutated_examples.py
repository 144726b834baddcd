"""Every value of every example file changed: it is read, or refused in one line with file and key."""

from __future__ import annotations

import copy
import random
import re
import shutil
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.task_files.cell import load_cell
from ocptip.task_files.cycle import read_task
from ocptip.task_files.parallel import read_parallel_robot
from ocptip.task_files.path import load_path
from ocptip.task_files.placement import load_placement
from ocptip.task_files.platform_points import read_platform
from ocptip.task_files.scene import read_scene
from tests.places import EXAMPLES
from tests.quick import some

READERS = {
    "scenes": read_scene,
    "robots": read_parallel_robot,
    "platforms": read_platform,
    "tasks": read_task,
    "paths": lambda path: load_path(path, read_task(EXAMPLES / "tasks" / "ur5_cart.toml")),
}
FILES = sorted(EXAMPLES.rglob("*.toml"))
SAMPLE = 2  # mutations per file in the quick suite
VALUES = [
    "word",
    True,
    float("nan"),
    float("inf"),
    1e300,
    -1e9,
    10**400,
    -1,
    0,
    [],
    [1.0],
    {},
    {"x": 1},
    [{}],
]

CONTRADICTIONS = (  # between two tables: the one that is read later is refused
    r"numbers like contact\[1\]",
    r"base\.inertia: principal values .* mass times squared distance of the farthest contact",
    r"base\.ground: the contacts have different heights",
    r"_pose: arm .* cannot reach position",
    "is neither a parameter nor a multiple of pi",
    r"there is no \[table\.",
    r"no such joint; there are",  # between the names of joints and what is said of them
    r"arm\.joint\[\d+\]\.\w+: missing",  # between a joint and the table of its link
    r"more than \d+ spheres on link",  # between lengths and the radius of the spheres
    r"there is no row \d+, only",
    "the arm has no collision geometry to check; give arm.sphere_radius",
    "for branched legs, with `ends`, but this leg has none",
    r"terrain '.*': uneven ground: ",  # between contacts and terrain
    r"terrain '.*': [xy]: lower bound .* is above upper bound",  # between the terrain and its grid
    r"segment\[\d+\]\.payload: expected one of",  # between the payloads and who carries them
    r"payload\..*: no segment carries it",
    r"object: payload beside objects: ",  # between the payload and what stands on the gripper
    r"missing table \[arm\]",  # if there is no robot either
)

pytestmark = pytest.mark.filterwarnings("ignore::ocptip.basics.errors.InputWarning")

Path_ = tuple[str | int, ...]


def places(data: object, path: Path_ = ()) -> Iterator[Path_]:
    """Paths of all values, tables and lists included."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        yield (*path, key)
        yield from places(value, (*path, key))


def mutations(data: dict) -> Iterator[tuple[Path_, str, object]]:
    """Path, what is done there, and the new value."""
    for path in places(data):
        yield path, "remove", None
        if isinstance(path[-1], str):
            yield path, "sibling", 1
        for value in VALUES:
            yield path, "set", value


def mutated(data: dict, path: Path_, what: str, value: object) -> dict:
    data = copy.deepcopy(data)
    parent = data
    for key in path[:-1]:
        parent = parent[key]
    if what == "remove":
        del parent[path[-1]]
    elif what == "sibling":
        parent[f"{path[-1]}_"] = value
    else:
        parent[path[-1]] = value
    return data


def toml(value: object) -> str:
    """As inline TOML."""
    if isinstance(value, dict):
        return "{" + ", ".join(f'"{key}" = {toml(item)}' for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else repr(value)


def dotted(path: Path_) -> str:
    """As messages write it, counted from 1: contact[2].position[1]."""
    return "".join(f"[{key + 1}]" if isinstance(key, int) else f".{key}" for key in path)[1:]


def names(message: str, path: Path_) -> bool:
    """Whether a message begins with the file and a place in the table that was changed, or below it."""
    place = message.split(": ")[1]
    last = max(i for i, key in enumerate(path) if isinstance(key, str))
    return place.startswith(dotted(path[:last])) or any(re.search(hint, message) for hint in CONTRADICTIONS)


def read(file: Path, folder: Path, case: tuple[Path_, str, object]) -> str:
    """The refusal, "" if the file is read."""
    data = mutated(tomllib.loads(file.read_text(encoding="utf-8")), *case)
    path = folder / file.name
    path.write_text("".join(f"{key} = {toml(value)}\n" for key, value in data.items()), encoding="utf-8")
    named = {"place": load_placement, "cell": load_cell}
    reader = named.get(file.name.split("_")[0], READERS[file.parent.name])
    try:
        with np.errstate(all="raise", under="ignore"):
            reader(path)
    except InputError as error:
        return str(error)
    return ""


def check(file: Path, folder: Path, case: tuple[Path_, str, object]) -> None:
    message = read(file, folder, case)
    if message:
        assert message.startswith(f"{file.name}: "), message
        assert "\n" not in message
        assert names(message, case[0]), (case, message)


@pytest.fixture
def folder(tmp_path):
    """With what the task files refer to."""
    for urdf in EXAMPLES.rglob("*.urdf"):
        shutil.copy(urdf, tmp_path)
    return tmp_path


def cases(file: Path) -> list[tuple[Path_, str, object]]:
    return list(mutations(tomllib.loads(file.read_text(encoding="utf-8"))))


@pytest.mark.parametrize("file", some(4, FILES[:12]), ids=lambda file: file.stem)
def test_some_mutations(file, folder):
    for case in random.Random(7).sample(cases(file), SAMPLE):
        check(file, folder, case)


@pytest.mark.slow
@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_all_mutations(file, folder):
    for case in cases(file):
        check(file, folder, case)
