"""Figures of a placement: the robot stands where the numbers say, cells hold what a scan finds."""

from __future__ import annotations

from dataclasses import replace

import casadi as cs
import numpy as np
import pytest
from PIL import Image

from ocptip.pictures.placement import CAUSES, draw_placement, placement_figures
from ocptip.pictures.world_view import half_plane
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.maps import PlacementMap, scan
from ocptip.placement.place import place
from ocptip.placement.result import evaluate_placement
from ocptip.placement.terrain import custom_terrain
from ocptip.task_files.placement import load_placement
from studies.placement.planar import planar_problem
from tests.pictures.placed_example import TASK, found, refused

CELLS = 9


@pytest.fixture(scope="module")
def placed(tmp_path_factory):
    """A spatial placement among obstacles, and its figures."""
    path = tmp_path_factory.mktemp("task") / "press.toml"
    more = """
[[obstacle]]
kind = "wall"
normal = [1, 0, 0]
distance = 0.6

[[keep_out]]
kind = "pillar"
point = [0.0, 0.5, 0.0]
radius = 0.1
"""
    path.write_text(TASK + more, encoding="utf-8")
    result = place(load_placement(path).problem, starts=2, samples=300)
    return result.placements, placement_figures("press", result.placements, cells=CELLS)


def artists(figure, gid):
    return figure.findobj(lambda artist: artist.get_gid() == gid)


@pytest.mark.slow
def test_robot_is_drawn_where_it_stands(placed):
    placements, figures = placed
    best = placements[0]
    top, side = (np.array(line.get_xydata()) for line in artists(figures["placement"], "arm-1"))
    position = best.problem.tasks[0].position
    np.testing.assert_allclose(top[-1], position[:2], atol=1e-6)
    assert side[-1, 1] == pytest.approx(position[2], abs=1e-6)
    mount = best.base_position + best.base_rotation @ best.problem.robot.arm.mount_position
    np.testing.assert_allclose(top[0], mount[:2], atol=1e-9)
    contacts = np.array([c.position for c in best.problem.robot.support.contacts])
    world = best.base_position + contacts @ best.base_rotation.T
    (drawn, _) = artists(figures["placement"], "contacts-best")
    np.testing.assert_allclose(drawn.get_xydata(), world[:, :2])


def test_the_picture_holds_bases_arms_and_forces(placed):
    _, figures = placed
    for ax in figures["placement"].axes:
        (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
        for line in ax.lines:
            if line.get_gid():
                points = line.get_xydata()
                assert ((points >= [left, bottom]) & (points <= [right, top])).all()


def test_map_holds_what_a_scan_finds(placed):
    placements, figures = placed
    best = placements[0]
    chart = PlacementMap.of(best, CELLS)
    total = chart.values("total")
    assert total.shape == (CELLS, CELLS)
    (mesh,) = artists(figures["map"], "total")
    np.testing.assert_allclose(np.ma.filled(mesh.get_array(), np.nan).reshape(total.shape), total)
    assert (total[np.isfinite(total)] >= best.total - 1e-6).all()  # nothing beats the optimum
    evaluator = Evaluator(best.problem)
    row = int(np.nanargmin(chart.scan.totals))
    again = evaluate_placement(evaluator, best.patch, chart.scan.parameters[row], chart.scan.angles[row])
    assert again.feasible
    assert again.total == pytest.approx(chart.scan.totals[row])
    x, y = chart.axes
    np.testing.assert_allclose(chart.scan.parameters[row][:2], [x[row % CELLS], y[row // CELLS]])
    assert set(chart.causes.ravel()) <= {"", *CAUSES}
    assert np.isnan(total[chart.causes != ""]).all()


def test_star_and_legend(placed):
    placements, figures = placed
    stars = artists(figures["map"], "best")
    assert len(stars) == 6  # total, four criteria, causes
    for star in stars:
        np.testing.assert_allclose(star.get_xydata()[0], placements[0].parameters[:2])
    texts = [text.get_text() for text in figures["map"].legends[0].get_texts()]
    assert {"best placement", "out of reach"} <= set(texts)


@pytest.mark.slow
def test_files_and_terrain_of_other_parameters(tmp_path):
    paths = draw_placement(tmp_path / "new", "planar", found().placements, cells=11)
    assert [path.name for path in paths] == ["placement.png", "map.png"]
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["map.png", "placement.png"]
    for path in paths:
        with Image.open(path) as picture:
            assert min(picture.size) > 500


@pytest.mark.slow
def test_refused_placements_are_drawn_with_their_causes():
    error = refused()
    figures = placement_figures("press", [error.nearest], cells=7)
    texts = [text.get_text() for text in figures["map"].legends[0].get_texts()]
    assert "minimum violation" in texts
    assert "joint torques" in texts
    assert "NOT feasible" in figures["placement"].get_suptitle()
    chart = PlacementMap.of(error.nearest, 7)
    assert not chart.scan.feasible.any()
    assert np.isnan(chart.values("total")).all()


@pytest.mark.slow
def test_terrain_of_one_parameter_gets_curves():
    p = cs.SX.sym("p")
    rail = cs.Function("rail", [p], [cs.vertcat(-p, 0, -7.9), cs.SX.eye(3)])
    terrain = custom_terrain(rail, [2.0], [9.0], parameters=("x",), name="rail")
    problem = replace(planar_problem(), terrain=terrain)
    placements = place(problem, starts=1, samples=100).placements
    figure = placement_figures("rail", placements, cells=40)["map"]
    (curve,) = artists(figure, "total")
    x, y = np.array(curve.get_xydata()).T
    assert np.nanmin(y) >= placements[0].total - 1e-9
    assert abs(x[np.nanargmin(y)] - placements[0].parameters[0]) < 0.5
    assert np.isnan(y).any()  # parts of the rail are out of reach


def test_half_plane_is_clipped_to_the_picture():
    corners = half_plane(np.array([1.0, 0.0]), 0.25, ((0, 1), (0, 2)))
    np.testing.assert_allclose(sorted(corners.tolist()), [[0.25, 0], [0.25, 2], [1, 0], [1, 2]])
    assert len(half_plane(np.array([1.0, 0.0]), 3.0, ((0, 1), (0, 2)))) == 0


def test_scan_agrees_with_the_judge(placed):
    best = placed[0][0]
    own = scan(best.problem, best.parameters[None])
    assert own.totals[0] <= best.total + 1e-9
