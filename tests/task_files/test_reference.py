"""The declared keys: the page, the JSON Schema, and that files are refused by both or by none."""

from __future__ import annotations

import json
import re
import tomllib

import pytest
from jsonschema import Draft202012Validator

import ocptip
from ocptip.basics.errors import InputError
from ocptip.cli.main import main
from ocptip.standing.limits import LIMIT_KEYS
from ocptip.task_files.cycle import read_task
from ocptip.task_files.parallel import read_parallel_robot
from ocptip.task_files.placement import load_placement
from ocptip.task_files.platform_points import read_platform
from ocptip.task_files.reference import _all_tables, _flat, json_schema, reference_page
from ocptip.task_files.scene import read_scene
from tests.places import EXAMPLES, ROOT

FILES = sorted(EXAMPLES.rglob("*.toml"))


@pytest.fixture(scope="module")
def validator():
    return Draft202012Validator(json_schema())


def test_the_page_is_printed_from_the_declarations():
    page = (ROOT / "docs" / "task-file-reference.md").read_text(encoding="utf-8")
    assert page == reference_page(), "run: ocptip schema --page > docs/task-file-reference.md"


def test_the_command_prints_schema_and_page(capsys):
    assert main(["schema"]) == 0
    printed = json.loads(capsys.readouterr().out)
    Draft202012Validator.check_schema(printed)
    assert printed == json.loads(json.dumps(json_schema()))
    assert main(["schema", "--page"]) == 0
    assert capsys.readouterr().out == reference_page()


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_every_example_is_valid(file, validator):
    text = file.read_text(encoding="utf-8")
    assert text.startswith("#:schema ./task.schema.json\n")
    validator.validate(tomllib.loads(text))


READERS = {
    "scenes": read_scene,
    "robots": read_parallel_robot,
    "platforms": read_platform,
    "tasks": lambda path: (load_placement if path.name.startswith("place") else read_task)(path),
}


@pytest.mark.parametrize(
    ("example", "old", "new"),
    [
        ("scenes/pushed_cart.toml", "mass =", "mas ="),
        ("scenes/pushed_cart.toml", "mass = ", "mass = -"),
        ("scenes/pushed_cart.toml", "[base]", "[base]\nfloor = true"),
        ("scenes/pushed_cart.toml", "friction = 0.9", 'friction = "rough"'),
        ("scenes/pushed_cart.toml", 'kind = "unilateral"', 'kind = "glue"'),
        ("scenes/clamped_tripod.toml", "clamp_force", "stiffness"),
        ("tasks/ur5_cart.toml", 'urdf = "ur5.urdf"', 'urdf = "ur5.urdf"\ndh = "standard"'),
        ("tasks/ur5_cart.toml", "acceleration_deg_s2", "acceleration_deg_s"),
        ("tasks/ur5_cart.toml", "height = 0.75", "height = true"),
        ("tasks/ur5_cart.toml", "[motion]", "[motion]\nduration = 1.0\nmax_duration = 2.0"),
        ("tasks/ur5_cart.toml", "rpy_deg = [180, 0, 0]", "rpy_deg = [180, 0]"),
        ("tasks/ur5_cart.toml", "[motion]", "[motions]"),
        ("tasks/ur5_cart.toml", 'kind = "estimated"', 'kind = "dc"'),
        ("tasks/ur5_pick_and_place.toml", "[motion]", "[motion]\nmax_duration = 2.0"),
        ("tasks/place_ur5_wall.toml", "distance = 2.0", "distances = 2.0"),
        ("robots/five_bar.toml", 'joint = "revolute"', 'joint = "revolving"'),
        ("robots/five_bar.toml", "[platform]", "[platform]\nmasses = 1.0"),
        ("platforms/flight_simulator.toml", 'unit = "m"', 'unit = "inch"'),
    ],
)
def test_broken_files_are_refused_by_reader_and_schema(example, old, new, validator, tmp_path):
    text = (EXAMPLES / example).read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / (EXAMPLES / example).name
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    (tmp_path / "ur5.urdf").write_bytes((EXAMPLES / "tasks" / "ur5.urdf").read_bytes())
    with pytest.raises(InputError, match=re.escape(path.name)):
        READERS[example.split("/")[0]](path)
    assert not validator.is_valid(tomllib.loads(path.read_text(encoding="utf-8")))


def test_every_key_of_limits_reaches_the_limits_and_the_file_in_a_folder_of_a_plan(tmp_path):
    values = {name: 0.5 for name in LIMIT_KEYS if "foot" not in name}  # those are for compliant feet
    asked = "\n".join(f"{name} = {value}" for name, value in values.items())
    (tmp_path / "task.toml").write_text(f'case = "B"\n[limits]\n{asked}\n', encoding="utf-8")
    task = ocptip.load_task(tmp_path / "task.toml")
    written = tomllib.loads(task.source.text("B", task.limits, task.objective))["limits"]
    for name, value in values.items():
        assert getattr(task.limits, name) == written[name] == value


def test_meanings_are_short_sentences():
    for keys in _all_tables():
        for variant, _ in _flat(keys):
            for name, key in variant.keys.items():
                assert re.fullmatch(r"[A-Z`\[].*\.", key.meaning), (keys.name, name, key.meaning)
                assert len(key.meaning.split()) <= 25, (keys.name, name, key.meaning)
