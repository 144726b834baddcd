"""`ocptip.place` on files, tasks and problems, and what it says without a placement."""

import json

import pytest

import ocptip
from ocptip.placement.result import NoPlacementError
from ocptip.standing.tolerance import WORKSHOP
from ocptip.task_files.placement import load_placement
from tests.pictures.placed_example import TASK, found, refused


@pytest.fixture
def task(tmp_path):
    (tmp_path / "press.toml").write_text(TASK, encoding="utf-8")
    return tmp_path / "press.toml"


@pytest.fixture
def search(monkeypatch):
    """Replaces the search; a list of its arguments and a result to change."""
    calls = []

    def answered(problem, **options):
        calls.append((problem, options))
        return found()

    monkeypatch.setattr("ocptip.api.place.search", answered)
    return calls


def test_a_file_its_task_and_its_problem_are_searched_alike(task, search):
    read = load_placement(task, WORKSHOP)
    for given in (task, str(task), read, read.problem):
        placed = ocptip.place(given, starts=2, seed=3)
        assert placed.best is placed.answer.best
    assert all(options["starts"] == 2 and options["seed"] == 3 for _, options in search)
    assert len({problem.tolerance.given for problem, _ in search}) == 1


def test_uncertainty_replaces_that_of_the_file(task, search):
    ocptip.place(task, uncertainty="none")
    ocptip.place(task, uncertainty=WORKSHOP)
    given = [problem.tolerance.given for problem, _ in search]
    assert not given[0]
    assert given[1]


def test_its_files_and_repr_say_where_the_base_stands(task, search, tmp_path):
    placed = ocptip.place(task, uncertainty="none")
    assert placed.verified
    paths = placed.save(tmp_path / "found", figures=False)
    data = json.loads(paths[0].read_text(encoding="utf-8"))
    assert [path.name for path in paths] == ["placement.json"]
    assert data["found"]
    assert data["best"]["base"]["position"] == pytest.approx(placed.best.base_position)
    assert "verified, base at (" in repr(placed)


def test_without_a_placement_the_nearest_one_and_the_reason_are_known(task, monkeypatch, tmp_path):
    def refuses(problem, **options):
        raise refused()

    monkeypatch.setattr("ocptip.api.place.search", refuses)
    placed = ocptip.place(task)
    assert isinstance(placed.answer, NoPlacementError)
    assert not placed.found
    assert not placed.verified
    assert placed.best is placed.answer.nearest
    assert "no placement: " in repr(placed)
    assert not placed.to_dict()["found"]
    assert placed.save(tmp_path / "no", figures=False)[0].is_file()


def test_what_cannot_be_used_is_named(task):
    with pytest.raises(ocptip.InputError, match=r"nowhere\.toml"):
        ocptip.place("nowhere.toml")
    with pytest.raises(ocptip.InputError, match="workshp"):
        ocptip.place(task, uncertainty="workshp")
