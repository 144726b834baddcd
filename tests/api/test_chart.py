"""`ocptip chart` and `ocptip.chart`: cells, reaches, files and text."""

import csv
import io
import json
import sys
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

import ocptip
from ocptip.cli.layout import headline_of
from ocptip.cli.main import main
from ocptip.pictures.frame import png
from ocptip.pictures.load_chart import chart_figure
from tests.places import EXAMPLES
from tests.quick import some

TASK = EXAMPLES / "tasks/kit_arm.toml"


@pytest.fixture(scope="module")
def chart():
    return ocptip.chart(TASK, samples=600, levels=[0.0, 2.0, 4.0], uncertainty="none")


@pytest.mark.slow
def test_cells_hold_the_smallest_and_the_largest_payload_of_their_postures(chart):
    masses, places = chart.largest.levels, chart.places
    for use in ({}, {"azimuth": False}, {"height": False}):
        cells = chart.cells(**use)
        assert sum(one.postures for one in cells) == len(chart.q) > 200
        for one in cells:
            ends = (one.azimuth or (-np.inf, np.inf), one.reach, one.height or (-np.inf, np.inf))
            inside = np.all([(a <= v) & (v < b) for (a, b), v in zip(ends, places.T, strict=True)], axis=0)
            assert one.postures == inside.sum()
            assert (one.any_posture, one.best_posture) == (masses[inside].min(), masses[inside].max())


@pytest.mark.slow
def test_blocks_of_postures_are_one_chart(chart, monkeypatch):
    monkeypatch.setattr(sys.modules["ocptip.api.chart"], "_BLOCK", 100)
    done = []
    how = {"samples": 600, "levels": [0.0, 2.0, 4.0], "uncertainty": "none"}
    found = ocptip.chart(TASK, **how, progress=lambda *state: done.append(state))
    assert np.array_equal(found.largest.levels, chart.largest.levels)
    assert done[-1] == (len(chart.q), len(chart.q), None)
    assert len(done) == -(-len(chart.q) // 100)


def test_reaches_are_those_of_postures(chart):
    holds = chart.largest.levels >= 4.0
    reach, sector = chart.places[:, 1], np.rint(chart.places[:, 0] / (np.pi / 4)).astype(int) % 8
    for k, (sure, best) in enumerate(
        zip(chart.reaches[2].any_posture, chart.reaches[2].best_posture, strict=True)
    ):
        assert best == reach[(sector == k) & holds].max()
        assert not np.any((sector == k) & ~holds & (reach <= sure))
        assert sure <= best


@pytest.mark.slow
def test_the_figure_has_the_reaches_and_no_label_lies_on_another(chart):
    cells, feet = chart.cells(azimuth=False), np.array([[0.3, 0.3, 0], [0.3, -0.3, 0], [-0.4, 0, 0]])
    figure = chart_figure(("task", "payload", "kg", ""), chart.edges, cells, chart.reaches, feet)
    png(figure)  # which places the labels
    for ax, key in zip(figure.axes[::2], ("any_posture", "best_posture"), strict=True):
        bands = {one.get_gid(): one.get_paths() for one in ax.collections}
        for number, one in enumerate(chart.reaches):
            corners = np.concatenate([path.vertices for path in bands[f"reach-{number}"]])
            for k, end in enumerate(getattr(one, key)):
                inside = np.abs((corners[:, 0] - k * np.pi / 4 + np.pi) % (2 * np.pi) - np.pi) < np.pi / 9
                assert corners[inside, 1].max() == end
        boxes = [label.get_window_extent() for label in ax.texts]
        assert len(boxes) >= 2
        assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    shades = [bar.get_facecolor() for bar in figure.axes[1].patches]
    bands = [int(np.searchsorted(chart.levels, one.any_posture, side="right")) for one in cells]
    assert len(set(shades)) == len(set(bands)) == len(set(zip(bands, shades, strict=True))) > 1


def test_default_payloads_have_reaches_that_differ():
    chart = ocptip.chart(TASK, samples=600, uncertainty="none")
    rows = [one.any_posture + one.best_posture for one in chart.reaches]
    assert chart.levels[0] == 0
    assert chart.robot.payload is None or chart.robot.payload.mass in chart.levels
    heavy = chart.levels > np.quantile(chart.largest.levels, 0.05)
    assert heavy.sum() >= 2
    assert len({row for row, own in zip(rows, heavy, strict=True) if own}) == heavy.sum()


def test_no_posture_collides_or_leaves_the_joint_limits(chart):
    assert chart.robot.collision.least(chart.q).min() >= chart.limits.clearance
    limits = chart.robot.arm.limits
    assert np.all((chart.q >= limits.angle_min) & (chart.q <= limits.angle_max))


@pytest.mark.slow
def test_the_seed_decides(chart):
    again = ocptip.chart(TASK, samples=600, levels=[0.0, 2.0, 4.0], uncertainty="none")
    np.testing.assert_array_equal(chart.q, again.q)
    np.testing.assert_array_equal(chart.largest.levels, again.largest.levels)
    assert not np.array_equal(chart.q, ocptip.chart(TASK, samples=600, seed=1, uncertainty="none").q)


def test_text_files_and_json(tmp_path, capsys):
    folder = tmp_path / "chart"
    arguments = ["chart", str(TASK), "--samples", "60", "--out", str(folder)]
    assert main(arguments) == 0
    text = capsys.readouterr().out
    head, lines = headline_of(text), text.splitlines()
    assert head.startswith(
        "kit arm on a tripod   LOAD CHART, at rest, within 'workshop' uncertainty (default)"
    )
    assert head.endswith("of 60 postures, seed 0.")
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
        (["--levels", "-1"], "--levels: must be one or more >= 0 kg"),
        (["--cell", "0"], "--cell: must be > 0"),
        (["--most", "-2"], "--most: must be > 0"),
        (["--joint-speed", "-1"], "--joint-speed: must be >= 0"),
        (["--push-height", "1"], "--push-height: needs a chart of a push"),
        (["--speed-override", "0.5"], "--speed-override: needs joint_speed or joint_acceleration"),
    ],
)
def test_bad_values_are_named_as_typed(tmp_path, capsys, options, message):
    assert main(["chart", str(TASK), "--samples", "20", "--out", str(tmp_path / "c"), *options]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_a_parallel_robot_has_no_chart():
    with pytest.raises(ocptip.InputError, match="load charts are for arms"):
        ocptip.chart(EXAMPLES / "tasks/delta_cart.toml", samples=5)


@pytest.mark.slow
def test_payloads_on_other_bases_are_those_of_their_own_charts():
    """Ballast and foot width are changes of the task's base."""
    task = ocptip.load_task(TASK, uncertainty="none")
    given = {"samples": 300, "levels": [0.0], "uncertainty": "none", "most": 30.0}
    found = ocptip.chart(task, ballast=[0.0, 5.0], foot_width=[1.2], **given)
    support = task.robot.support
    places = np.array([contact.position for contact in support.contacts])
    middle = [*places[:, :2].mean(axis=0), 0.0]
    wide = [
        replace(contact, position=middle + (place - middle) * [1.2, 1.2, 1.0])
        for contact, place in zip(support.contacts, places, strict=True)
    ]
    mass = support.mass + 5.0
    heavy = support.varied(mass=mass, inertia=mass / support.mass * support.inertia)
    for design, base in zip(found.designs, (support, heavy, support.varied(wide)), strict=True):
        other = ocptip.chart(replace(task, robot=task.robot.varied(support=base)), **given)
        reach = found.places[:, 1]
        for end, payload in zip(found.edges[1][1:], design.levels, strict=True):
            here = other.largest.levels[reach < end]
            assert payload == (pytest.approx(here.min(), abs=1e-9) if len(here) else None)
    before, after, wider = (np.array(one.levels, dtype=float) for one in found.designs)
    assert np.nanmax(after - before) > 0.1
    assert np.nanmax(wider - before) > 0.1


@pytest.mark.slow
def test_files_of_a_design(tmp_path, capsys):
    arguments = [str(TASK), "--samples", "200", "--tolerance", "none", "--ballast", "0", "10", "--out"]
    assert main(["chart", *arguments, str(tmp_path / "chart")]) == 0
    assert "by ballast [kg]" in capsys.readouterr().out
    data = json.loads((tmp_path / "chart/chart.json").read_text())
    assert [one["ballast_kg"] for one in data["designs"]] == [0.0, 10.0]
    rows = list(csv.DictReader((tmp_path / "chart/design.csv").read_text().splitlines()))
    payloads = [own for one in data["designs"] for own in one["payload_up_to_reach_kg"]]
    assert [float(row["payload_kg"]) for row in rows] == payloads
    assert [float(row["value"]) for row in rows[:: len(rows) // 2]] == [0.0, 10.0]
    assert (tmp_path / "chart/design.png").stat().st_size > 10_000
    assert main(["chart", str(TASK), "--foot-width", "-1"]) == 2
    assert "--foot-width" in capsys.readouterr().err


@pytest.mark.parametrize(("of", "unit"), some(1, [("tilt", "deg"), ("push", "N")]))
def test_charts_of_tilts_and_pushes(tmp_path, of, unit):
    chart = ocptip.chart(TASK, of=of, samples=100, uncertainty="none")
    data = chart.to_dict()
    assert f"{of}_any_posture_{unit}" in data["cells"][0]
    largest = max(cell[f"{of}_best_posture_{unit}"] for cell in data["cells"])
    assert largest == pytest.approx(chart.values.max())
    assert 1 < largest < data[f"largest_tried_{unit}"]
    chart.save(tmp_path / "chart")
    assert f"{of}_any_posture_{unit}" in (tmp_path / "chart/chart.csv").read_text().splitlines()[0]


@pytest.mark.slow
def test_payloads_by_speed_override_are_those_of_charts_at_such_speeds():
    given = {"samples": 60, "levels": [0.0], "uncertainty": "none"}
    found = ocptip.chart(TASK, joint_speed=0.2, joint_acceleration=0.4, speed_override=[0.5, 1.0], **given)
    slower = ocptip.chart(TASK, joint_speed=0.1, joint_acceleration=0.1, **given)
    assert found.designs[0].levels == pytest.approx(slower.within(slower.largest))
    assert found.designs[1].levels == pytest.approx(found.within(found.largest))
    assert "20 % of their speed and 40 % of their acceleration limits" in found.scope
    assert "motion" not in found.to_dict()["not_covered"]
    assert (found.values <= slower.values + 1e-9).all()
