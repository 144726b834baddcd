"""What ocptip did not write is neither deleted nor, unasked, replaced; links are not followed."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path

import pytest

from ocptip.basics.errors import InputError
from ocptip.basics.outputs import (
    SUMS,
    remove_figures,
    replace_folder,
    require_replaceable,
    require_replaceable_file,
)
from ocptip.basics.write import MARK

PLAN = {
    "plan.json": b'{"versions": {"ocptip": "1"}}',
    "motion.csv": b"time_s\n",
    "certificate.json": b"{}",
    "task/task.toml": b'[arm]\nurdf = "arm.urdf"\n',
    "task/arm.urdf": b'<mesh filename="meshes/hand &amp; arm.stl"/>',
    "task/meshes/hand & arm.stl": b"solid",
}
SHORT = {"plan.json": b'{"versions": {"ocptip": "2"}}', "motion.csv": b"time_s,q1_deg\n"}


@pytest.fixture
def folder(tmp_path):
    replace_folder(tmp_path / "plan", PLAN)
    return tmp_path / "plan"


def add_to_list(folder: Path, *names: str) -> None:
    """As a user does with `sha256sum`."""
    with (folder / SUMS).open("a") as stream:
        for name in names:
            stream.write(f"{hashlib.sha256((folder / name).read_bytes()).hexdigest()}  {name}\n")


def content(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def refused(folder, *, overwrite=True, write=True):
    """What is said; afterwards everything is there as before."""
    before = content(folder)
    with pytest.raises(InputError) as caught:
        require_replaceable(folder, "plan", overwrite=overwrite)
    if write:
        with pytest.raises(InputError):
            replace_folder(folder, SHORT)
    assert content(folder) == before
    return str(caught.value)


def test_files_of_an_earlier_plan_go(folder):
    require_replaceable(folder, "plan", PLAN)
    replace_folder(folder, SHORT)
    assert set(content(folder)) == {*SHORT, SUMS}
    assert [line[66:] for line in (folder / SUMS).read_text().splitlines()] == list(SHORT)


@pytest.mark.parametrize("name", ["data.csv", "task/notes.txt", "task/meshes/other.stl", "notes/plan.json"])
def test_a_file_that_the_user_listed_stays(folder, name):
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).write_text("mine")
    add_to_list(folder, name)
    assert f"lists files that ocptip does not write: {name}; choose another directory" in refused(folder)


def test_a_list_of_the_user_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("mine")
    add_to_list(tmp_path, "thesis.tex")
    assert "thesis.tex" in refused(tmp_path)


@pytest.mark.parametrize(
    "name", ["../outside.txt", "./plan.json", "task//task.toml", "PLAN.JSON", "a\nplan.json"]
)
def test_names_in_other_spellings_delete_nothing(folder, name):
    (folder.parent / "outside.txt").write_text("mine")
    if "\n" not in name and "/" not in name:
        (folder / name).write_text("mine")
    digest = hashlib.sha256(b"mine").hexdigest()
    (folder / SUMS).write_text((folder / SUMS).read_text() + f"{digest}  {name}\n")
    before = content(folder.parent)
    with pytest.raises(InputError):
        require_replaceable(folder, "plan")
    assert content(folder.parent) == before


@pytest.mark.parametrize("number", ["", "0" * 64, "x" * 64, "9" * 10_000])
def test_a_broken_list_is_the_users(folder, number):
    (folder / SUMS).write_text(f"{number}  certificate.json\n")
    with pytest.raises(InputError):
        require_replaceable(folder, "plan")
    replace_folder(folder, SHORT)
    assert (folder / "certificate.json").exists()


def test_a_changed_file_is_not_replaced_unasked_and_never_deleted(folder):
    (folder / "certificate.json").write_text("edited")
    assert "certificate.json (changed since)" in refused(folder, overwrite=False, write=False)
    require_replaceable(folder, "plan", overwrite=True)
    replace_folder(folder, SHORT)
    assert (folder / "certificate.json").read_text() == "edited"


@pytest.mark.parametrize("name", ["plan.json", "task", "task/meshes", "motion.png", SUMS])
def test_links_are_not_followed(folder, name, tmp_path):
    target = tmp_path / "elsewhere"
    if (folder / name).exists():
        (folder / name).rename(target)
    else:
        target.write_text("mine")
    (folder / name).symlink_to(target)
    before = content(tmp_path / "elsewhere") if target.is_dir() else target.read_bytes()
    with pytest.raises(InputError, match="symbolic link"):
        require_replaceable(folder, "plan", PLAN, overwrite=True)
    with pytest.raises(InputError, match="symbolic link"):
        replace_folder(folder, {**PLAN, "plan.json": b"new"}) if name != "motion.png" else remove_figures(
            folder, "plan"
        ) or require_replaceable(folder, "plan", overwrite=True)
    assert (content(target) if target.is_dir() else target.read_bytes()) == before
    assert (folder / name).is_symlink()


def test_folders_in_the_place_of_files(folder):
    (folder / "trajectory.json").mkdir()
    assert "'trajectory.json' is no file" in refused(folder, write=False)
    (folder / "trajectory.json").rmdir()
    (folder / "motion.png").mkdir()
    remove_figures(folder, "plan")
    assert (folder / "motion.png").is_dir()


def test_what_the_task_names_is_not_replaced_unasked(tmp_path):
    (tmp_path / "task").mkdir()
    (tmp_path / "task" / "arm.urdf").write_text("mine")
    with pytest.raises(InputError, match=r"would replace: task/arm\.urdf"):
        require_replaceable(tmp_path, "plan", ["task/arm.urdf"])


def test_nothing_is_replaced_before_all_is_written(folder, monkeypatch):
    before, real, opened = content(folder), Path.open, []

    def full(path, mode="r", **options):
        opened.append(path)
        if len(opened) > 3:
            raise OSError(28, "No space left on device")
        return real(path, mode, **options)

    monkeypatch.setattr(Path, "open", full)
    with pytest.raises(OSError, match="No space left") as caught:
        replace_folder(folder, {**PLAN, "plan.json": b"new"})
    monkeypatch.undo()
    assert caught.value.filename.endswith("task.toml")
    assert len(opened) == 4
    assert content(folder) == before


def test_figures_of_others_stay(tmp_path):
    for name, text in {
        "motion.png": MARK,
        "phase_plane-2.png": MARK,
        "ground.png": "mine",
        "x.png": MARK,
    }.items():
        (tmp_path / name).write_text(text)
    remove_figures(tmp_path, "retime")
    assert sorted(os.listdir(tmp_path)) == ["ground.png", "x.png"]


@pytest.mark.parametrize(
    ("name", "text", "ours"),
    [
        ("a.html", f"<meta content='{MARK}'>", True),
        ("a.json", json.dumps({"versions": {"ocptip": "1"}}), True),
        ("a.json", json.dumps({"format": "ocptip certificate 4"}), True),
        ("a.json", json.dumps({"versions": ["ocptip"]}), False),
        ("a.json", "[" * 100_000, False),
        ("robot.urdf", "<robot/>", False),
    ],
)
def test_a_single_file(tmp_path, name, text, ours):
    path = tmp_path / name
    require_replaceable_file(path)
    path.write_text(text)
    require_replaceable_file(path, overwrite=True)
    if ours:
        require_replaceable_file(path)
    else:
        with pytest.raises(InputError, match="exists and was not written by ocptip"):
            require_replaceable_file(path)
    (tmp_path / "link").symlink_to(path)
    for odd in (tmp_path / "link", tmp_path):
        with pytest.raises(InputError, match="choose another name"):
            require_replaceable_file(odd, overwrite=True)
