"""The study of optimal platforms with tiny options: writes what it promises, and the numbers are right."""

from __future__ import annotations

import json
import math

import pytest

from ocptip.indices.platforms.controllability import control_number
from studies.indices import optimal_platforms
from studies.indices.designs.flight_simulator import FlightSimulator


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    out = tmp_path_factory.mktemp("optimal") / "new"
    options = ["--members", "5", "--starts", "4", "--poses", "20"]
    assert optimal_platforms.main(["--out", str(out), *options]) == 0
    return out, json.loads((out / "optimal_platforms.json").read_text())


@pytest.mark.slow
def test_every_family_is_checked(small):
    _, data = small
    assert set(data["families"]) == {"U1", "U2", "L_H", "L_S", "RPR"}
    for row in data["families"].values():
        assert row["members"] >= 5
        assert row["largest_deviation_from_1"] < 1e-8
        assert row["smallest_singular_value"] > 1e-6


@pytest.mark.slow
def test_search_and_workspaces_are_reported(small):
    _, data = small
    assert data["search"]["families"]["other"] == 0
    assert data["search"]["starts"] == 4
    best = {name: row["best_pose"] for name, row in data["workspaces"].items()}
    assert best["flight simulator, best"] == pytest.approx(0.687121, abs=1e-6)
    assert best["K_S"] == pytest.approx(1.0, abs=1e-9)
    for row in data["workspaces"].values():
        assert 0 < row["minimum"] <= row["mean"] < row["best_pose"]
        assert row["undefined"] == 0


def test_height_and_rotations_of_the_flight_simulator():
    """Values that the specification computed for the source's lost figures, [Naw07] 6.4."""
    best = FlightSimulator.optimal()
    pose = best.platform.at(best.position)
    for coordinate, shift, value in (
        ("z", 2 * 0.25 - 2 * best.height, None),
        ("rx", 0.4, 0.450671),
        ("ry", -0.4, 0.426701),
        ("rz", 0.8, 0.218580),
    ):
        ends = math.degrees(shift) if coordinate != "z" else shift
        x, values = optimal_platforms.moved("best", pose, coordinate, abs(ends) * 241 / 240)
        assert x[0] == pytest.approx(-abs(ends), rel=1e-9)
        expected = FlightSimulator(best.alpha, 0.25) if value is None else None
        wanted = value if expected is None else control_number(expected.platform.at(expected.position)).value
        assert values[0 if ends < 0 else -1] == pytest.approx(wanted, abs=2e-6)
        assert values[120] == pytest.approx(0.687121499, abs=1e-8)


@pytest.mark.slow
def test_files_are_written(small):
    out, data = small
    assert (out / "optimal_platforms_moved.png").stat().st_size > 50_000
    assert (out / "optimal_platforms.png").read_bytes().startswith(b"\x89PNG")
    assert "| K_M, mu = pi/3 | 1.000 |" in (out / "optimal_platforms.md").read_text()
    assert len(data["drawn"]) == 6
    assert not list(out.glob("*.part"))


def test_bad_options_are_refused(tmp_path):
    with pytest.raises(SystemExit) as error:
        optimal_platforms.main(["--out", str(tmp_path), "--members", "0"])
    assert error.value.code == 2
