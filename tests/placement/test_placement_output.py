"""placement.json: strict JSON whose poses, angles and shares are those of the result."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocptip.placement.output import refusal_to_dict, result_to_dict, write_placement
from ocptip.task_files.placement import load_placement
from tests.pictures.placed_example import found, refused
from tests.places import EXAMPLES


def test_result_in_plain_numbers(tmp_path):
    result = found()
    path = write_placement(tmp_path / "new", result_to_dict("press", result))
    assert path.name == "placement.json"
    assert [p.name for p in path.parent.iterdir()] == ["placement.json"]

    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    data = json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)
    assert (data["task"], data["found"], data["seed"]) == ("press", True, 0)
    best, placement = data["best"], result.best
    assert best["feasible"] is True
    assert best["parameters"] == dict(zip(("p1", "p2"), placement.parameters.tolist(), strict=True))
    np.testing.assert_allclose(
        best["base"]["position"], [-best["parameters"]["p1"], 0, -best["parameters"]["p2"]]
    )
    np.testing.assert_allclose(best["ground"], best["base"]["position"])
    np.testing.assert_allclose(best["angles_deg"]["press"], np.rad2deg(placement.angles[0]))
    shares = [entry["share"] for entry in best["criteria"].values()]
    assert sum(shares) == pytest.approx(placement.total)
    assert best["total"] == pytest.approx(placement.total)
    assert best["criteria"]["GE"]["reference"] == pytest.approx(71)
    assert len(best["margins"]) == len(placement.margins)
    assert {m["task"] for m in best["margins"]} == {None, "press"}
    assert len(data["alternatives"]) == len(result.places) - 1
    assert len(data["starts"]) == len(result.starts)
    assert set(data["versions"]) >= {"python", "ocptip", "casadi"}
    assert data["tasks"][0]["loads"][0]["force"] == [-5.0, 0.0, 0.0]


def test_refusal_says_why(tmp_path):
    error = refused()
    data = json.loads(write_placement(tmp_path, refusal_to_dict("press", error)).read_text(encoding="utf-8"))
    assert data["found"] is False
    assert data["reason"] == str(error)
    assert data["nearest"]["feasible"] is False
    broken = [m for m in data["nearest"]["margins"] if m["relative"] < -1e-6]
    assert broken
    assert all(m["kind"] == "torque" and m["value"] > m["limit"] for m in broken)


def test_base_orientation_is_given_twice_and_consistent():
    entry = found().best.to_dict()["base"]
    turn = Rotation.from_euler("xyz", entry["rpy_deg"], degrees=True).as_matrix()
    np.testing.assert_allclose(turn, entry["rotation"], atol=1e-12)


def test_a_directory_that_cannot_be_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        write_placement(tmp_path / "file", {"a": 1})


def test_alternatives_are_other_places():
    """Turned bases and other joint angles at one place are one place."""
    problem = load_placement(EXAMPLES / "tasks" / "place_ur5_wall.toml").problem  # x, y, angle
    best, turned, bent, away = (
        dataclasses.replace(found().best, problem=problem, parameters=np.array(p), angles=np.full((1, 6), q))
        for p, q in (
            ([1.0, 0.2, 0.1], 0.0),
            ([1.01, 0.21, 3.0], 0.0),
            ([1.0, 0.2, 0.1], 1.0),
            ([1.2, 0.2, 0.1], 0.0),
        )
    )
    result = dataclasses.replace(found(), placements=(best, turned, bent, away))
    assert result.places == (best, away)
    elsewhere = dataclasses.replace(found().best, parameters=found().best.parameters + 0.5)
    two = dataclasses.replace(found(), placements=(found().best, found().best, elsewhere))
    assert [data["parameters"] for data in two.to_dict()["alternatives"]] == [
        dict(zip(("p1", "p2"), elsewhere.parameters.tolist(), strict=True))
    ]
