"""`ocptip chart` and `ocptip.chart`: cells, reaches, files and text."""

import csv
import io
import json

import numpy as np
import pytest

import ocptip
from ocptip.cli.main import main
from tests.places import EXAMPLES

TASK = EXAMPLES / "tasks/kit_arm.toml"


@pytest.fixture(scope="module")
def chart():
    return ocptip.chart(TASK, samples=600, payloads=[0.0, 2.0, 4.0], uncertainty="none")


def test_cells_hold_the_smallest_and_the_largest_payload_of_their_postures(chart):
    masses, places = chart.held.masses, chart.places
    for use in ({}, {"azimuth": False}, {"height": False}):
        cells = chart.cells(**use)
        assert sum(one.postures for one in cells) == len(chart.q) > 200
        for one in cells:
            ends = (one.azimuth or (-np.inf, np.inf), one.reach, one.height or (-np.inf, np.inf))
            inside = np.all([(a <= v) & (v < b) for (a, b), v in zip(ends, places.T, strict=True)], axis=0)
            assert one.postures == inside.sum()
            assert (one.any_posture, one.best_posture) == (masses[inside].min(), masses[inside].max())


def test_reaches_are_those_of_postures(chart):
    holds = chart.held.masses >= 4.0
    reach, sector = chart.places[:, 1], np.rint(chart.places[:, 0] / (np.pi / 4)).astype(int) % 8
    for k, (sure, best) in enumerate(
        zip(chart.reaches[2].any_posture, chart.reaches[2].best_posture, strict=True)
    ):
        assert best == reach[(sector == k) & holds].max()
        assert not np.any((sector == k) & ~holds & (reach <= sure))
        assert sure <= best


def test_default_payloads_have_reaches_that_differ():
    chart = ocptip.chart(TASK, samples=600, uncertainty="none")
    rows = [one.any_posture + one.best_posture for one in chart.reaches]
    assert chart.payloads[0] == 0
    assert chart.robot.payload is None or chart.robot.payload.mass in chart.payloads
    heavy = chart.payloads > np.quantile(chart.held.masses, 0.05)
    assert heavy.sum() >= 2
    assert len({row for row, own in zip(rows, heavy, strict=True) if own}) == heavy.sum()


def test_no_posture_collides_or_leaves_the_joint_limits(chart):
    assert chart.robot.collision.least(chart.q).min() >= chart.limits.clearance
    limits = chart.robot.arm.limits
    assert np.all((chart.q >= limits.angle_min) & (chart.q <= limits.angle_max))


def test_the_seed_decides(chart):
    again = ocptip.chart(TASK, samples=600, payloads=[0.0, 2.0, 4.0], uncertainty="none")
    np.testing.assert_array_equal(chart.q, again.q)
    np.testing.assert_array_equal(chart.held.masses, again.held.masses)
    assert not np.array_equal(chart.q, ocptip.chart(TASK, samples=600, seed=1, uncertainty="none").q)


def test_text_files_and_json(tmp_path, capsys):
    folder = tmp_path / "chart"
    arguments = ["chart", str(TASK), "--samples", "200", "--out", str(folder)]
    assert main(arguments) == 0
    text = capsys.readouterr().out
    head, *lines = text.splitlines()
    assert head.startswith(
        "kit arm on a tripod   LOAD CHART, static, within 'workshop' uncertainty (default)"
    )
    assert head.endswith("of 200 postures, seed 0.")
    assert all(len(line) <= 80 for line in lines if not line.startswith("wrote"))
    assert main([*arguments, "--json"]) == 0  # replaces what it wrote
    answer = json.loads(capsys.readouterr().out)
    data = json.loads((folder / "chart.json").read_text(encoding="utf-8"))
    assert data["cells"] == answer["cells"]
    assert data["postures"] == sum(one["postures"] for one in data["side"])
    assert {"motion", "joints delayed by up to 10 ms"} <= set(data["not_covered"])
    rows = list(csv.DictReader(io.StringIO((folder / "chart.csv").read_text(encoding="utf-8"))))
    assert len(rows) == len(data["side"]) + len(data["plan"]) + len(data["cells"])
    assert (folder / "chart.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--samples", "0"], "--samples: must be >= 1, got 0"),
        (["--payloads", "-1"], "--payloads: must be >= 0 kg"),
        (["--cell", "0"], "--cell: must be > 0"),
        (["--most", "-2"], "--most: must be > 0"),
    ],
)
def test_bad_values_are_named_as_typed(tmp_path, capsys, options, message):
    assert main(["chart", str(TASK), "--samples", "20", "--out", str(tmp_path / "c"), *options]) == 2
    assert message in capsys.readouterr().err


def test_a_parallel_robot_has_no_chart():
    with pytest.raises(ocptip.InputError, match="load charts are for arms"):
        ocptip.chart(EXAMPLES / "tasks/delta_cart.toml", samples=5)
