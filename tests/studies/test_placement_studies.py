"""The studies of the placement: their physics against hand calculation, their files, their bookkeeping."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Load, Support
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.place import place
from ocptip.reserves.tipping import TipOver
from ocptip.task_files.placement import load_placement
from studies.placement import brute_force as placement_brute_force
from studies.placement import clutter as placement_clutter
from studies.placement import pareto as placement_pareto
from studies.placement import planar as planar_placement
from studies.placement.planar import COST_REFERENCE, DIMENSIONS, FORCE, elbow_up, field, planar_problem
from tests.places import RESULTS
from tests.quick import some

POINTS = np.array([[6.0, 7.0], [3.0, 6.0], [5.0, 4.0], [1.2, 3.5]])


@pytest.fixture(scope="module")
def evaluator():
    return Evaluator(planar_problem())


def by_hand(point, force=FORCE):
    """Torques (2,) and positions of the links' weights, from the drawing."""
    l1, l2 = DIMENSIONS["link lengths"]
    w1, w2 = DIMENSIONS["link weights, acting in their middle"]
    height = DIMENSIONS["height of joint 1 above the ground"]
    q1, q2 = elbow_up(np.array([point]))[0]
    elbow = np.array([l1 * np.cos(q1), height + l1 * np.sin(q1)])
    tip = elbow + l2 * np.array([np.cos(q1 + q2 - np.pi), np.sin(q1 + q2 - np.pi)])
    centres = elbow[0] / 2, (elbow[0] + tip[0]) / 2
    lower = w1 * centres[0] + w2 * centres[1] + -force * (tip[1] - height)
    upper = w2 * (centres[1] - elbow[0]) + -force * (tip[1] - elbow[1])
    return tip, np.array([lower, upper]), centres


@pytest.mark.parametrize("point", POINTS)
def test_planar_torques_and_reserve_against_a_planar_support(evaluator, point):
    tip, torques, centres = by_hand(point)
    np.testing.assert_allclose(tip, point, atol=1e-12)
    values = field(evaluator, point[None])
    np.testing.assert_allclose([values["M1"][0], values["M2"][0]], torques, atol=1e-9)
    assert values["GE"][0] == pytest.approx(abs(torques[0]) + 1.2 * abs(torques[1]))
    half = DIMENSIONS["axles in front of and behind joint 1"]
    w1, w2 = DIMENSIONS["link weights, acting in their middle"]
    base = DIMENSIONS["base weight, acting below joint 1"]
    support = Support(
        [UnilateralContact(position=[x, 0.0], normal=[0.0, 1.0], friction=50.0) for x in (half, -half)],
        mass=base,
        center_of_mass=[0.0, DIMENSIONS["height of the base's centre of mass"]],
        gravity=[0.0, -1.0],
    )
    loads = [
        Load(force=[0.0, -w], moment=0.0, point=[x, 0.0]) for w, x in zip((w1, w2), centres, strict=True)
    ]
    loads.append(Load(force=[-FORCE, 0.0], moment=0.0, point=tip))
    states = solve_many(support, support.wrench(loads)[None])
    GN = TipOver(support, 0.1 * half * (base + w1 + w2)).evaluate(states).GN
    assert values["GN"][0] == pytest.approx(GN[0], rel=1e-9)
    assert values["total"][0] == pytest.approx(
        0.25 * values["GN"][0] + 0.75 * values["GE"][0] / COST_REFERENCE
    )


@pytest.mark.slow
def test_planar_minimum_is_where_the_weights_make_the_force(evaluator):
    w1, w2 = DIMENSIONS["link weights, acting in their middle"]
    l1, l2 = DIMENSIONS["link lengths"]
    q1, last = np.arctan((w2 + w1 / 2) / FORCE), np.arctan(w2 / 2 / FORCE)
    point = [
        l1 * np.cos(q1) + l2 * np.cos(last),
        DIMENSIONS["height of joint 1 above the ground"] + l1 * np.sin(q1) + l2 * np.sin(last),
    ]
    np.testing.assert_allclose(point, [6.6, 7.9], atol=0.05)  # the source's global minimum
    values = field(evaluator, np.array([point]))
    assert values["cause"][0] == -1
    assert values["GE"][0] < 1e-9
    best = place(planar_problem(), starts=4).best
    np.testing.assert_allclose(best.parameters, point, atol=1e-3)
    assert best.total <= values["total"][0] + 1e-6


def test_planar_local_minimum_is_where_the_source_prints_it(evaluator):
    point = np.array([0.827, 0.850])  # the elbow at its limit of 10 degrees
    np.testing.assert_allclose(point, [0.8, 0.8], atol=0.055)
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    around = point + 0.15 * np.column_stack([np.cos(angles), np.sin(angles)])
    values = field(evaluator, np.vstack([point, around]))
    feasible = values["cause"] < 0
    assert feasible[0]
    assert feasible[1:].sum() >= 8
    assert values["total"][0] < values["total"][1:][feasible[1:]].min()
    assert values["total"][0] > 5 * field(evaluator, np.array([[6.590, 7.919]]))["total"][0]


def test_planar_regions_name_the_right_cause(evaluator):
    low, far, folded, heavy = [0.3, 2.1], [9.5, 5.0], [-2.0, 3.0], [-2.0, 10.0]
    causes = field(evaluator, np.array([far, folded, heavy, POINTS[0]]))["cause"]
    names = [planar_placement.CAUSES[c] if c >= 0 else "" for c in causes]
    assert names == ["out of reach", "joint angles", "joint torques", ""]
    free = Evaluator(planar_problem(0.0, unloaded=False))
    assert field(free, np.array([heavy]))["cause"][0] == -1  # only the process force is too much there
    assert field(evaluator, np.array([low]))["cause"][0] == 1


@pytest.mark.slow
def test_planar_study_writes_its_files(tmp_path, monkeypatch, capsys):
    entry = {"p": [6.63, 7.92], "angles_deg": [56.3, 150.3], "total": 0.0304}
    entry |= {"GN": 0.12, "GE": 0.0, "M1": 0.0, "M2": 0.0}
    monkeypatch.setattr(planar_placement, "minima", lambda *_: [entry, {**entry, "total": 0.3}])
    options = ["--out", str(tmp_path), "--sets", "2", "--starts", "2", "--points", "21"]
    assert planar_placement.main(options) == 0
    assert "2 of 2 random start sets" in capsys.readouterr().out
    data = json.loads((tmp_path / "placement_planar.json").read_text())
    assert data["start_sets"]["share"] == 1
    assert (tmp_path / "placement_planar.png").stat().st_size > 10_000


@pytest.mark.slow
def test_planar_minima():
    best, second = planar_placement.minima(Evaluator(planar_problem()), 81)[:2]
    np.testing.assert_allclose(best["p"], [6.590, 7.919], atol=1e-3)
    np.testing.assert_allclose(second["p"], [0.8, 0.8], atol=0.05)  # the source's local minimum
    assert second["M2"] == pytest.approx(0, abs=1e-3)
    assert second["total"] > 5 * best["total"]
    assert second["angles_deg"][1] == pytest.approx(10, abs=0.01)  # the elbow's limit holds it


@pytest.mark.slow
@pytest.mark.parametrize("number", some(1, [1, 2]))
def test_random_tasks_are_the_same_for_a_seed(number):
    one, two = (placement_brute_force.random_problem(3, number) for _ in range(2))
    np.testing.assert_array_equal(one.tasks[0].rotation, two.tasks[0].rotation)
    np.testing.assert_array_equal(one.weights.array(), two.weights.array())
    other = placement_brute_force.random_problem(4, number)
    assert not np.array_equal(one.tasks[0].rotation, other.tasks[0].rotation)


def test_brute_force_blocks_cover_the_grid():
    grid, blocks, spacing = placement_brute_force._grid(np.zeros(3), np.array([1.0, 2.0, 3.0]), 12)
    assert grid.shape == (12**3, 3)
    assert len(np.unique(blocks)) == 6 * 6 * 8
    np.testing.assert_allclose(spacing, [1 / 11, 2 / 11, 3 / 12])
    np.testing.assert_allclose(grid.max(axis=0), [1, 2, 3 - 3 / 12])


@pytest.mark.slow
def test_brute_force_bookkeeping(tmp_path, monkeypatch, capsys):
    def row(seed, number, evaluations):
        totals = {1: (None, [None, None]), 2: (0.2, [0.2, 0.19])}.get(number, (0.1, [0.1005, 0.102]))
        sets = [{"seed": i, "total": t, "seconds": 1.0, "cpu_seconds": 0.5} for i, t in enumerate(totals[1])]
        grid = {"total": totals[0], "states": 9, "cpu_seconds": 3.0}
        base = {"number": number, "seed": seed, "evaluations": evaluations, "robot": "r"}
        return base | {"grid": grid, "sets": sets}

    monkeypatch.setattr(placement_brute_force, "compared", row)
    options = ["--out", str(tmp_path), "--tasks", "2"]
    assert placement_brute_force.main(options) == 0
    first = capsys.readouterr().out
    assert "3 of 4 start sets are at most 0.5 % worse than the grid; worst +2.00 %" in first
    assert "`place`: 1 further random tasks" in first
    monkeypatch.setattr(placement_brute_force, "compared", None)  # nothing is computed twice
    assert placement_brute_force.main(options) == 0
    assert capsys.readouterr().out == first
    found = [{"seed": 0, "total": 0.1, "seconds": 1.0, "cpu_seconds": 0.5}]
    monkeypatch.setattr(placement_brute_force, "start_sets", lambda _: found)
    assert placement_brute_force.main([*options, "--again"]) == 0
    again = capsys.readouterr().out
    assert "at most 0.5 % worse than the grid; worst +0.00 %" in again

    # another seed leaves these rows alone, and other sources are named
    monkeypatch.setattr(placement_brute_force, "compared", row)
    assert placement_brute_force.main([*options, "--seed", "1"]) == 0
    monkeypatch.setattr(placement_brute_force, "compared", None)
    capsys.readouterr()
    assert placement_brute_force.main(options) == 0
    assert capsys.readouterr().out == again
    monkeypatch.setattr(placement_brute_force, "source_state", lambda *_: "new")
    assert placement_brute_force.main([*options, "--again"]) == 0
    assert "another state of the source code" in capsys.readouterr().out  # of the grids


def test_a_solution_that_only_the_grid_finds_counts_as_a_failure():
    row = {"grid": {"total": 0.2}, "sets": [{"total": None}, {"total": 0.2}]}
    assert placement_brute_force.excess(row) == [np.inf, 0.0]
    row = {"grid": {"total": None}, "sets": [{"total": 0.2}]}
    assert placement_brute_force.excess(row)[0] < 0


@pytest.mark.slow
def test_cluttered_tasks_are_the_same_for_a_seed_and_clear_of_the_gripper():
    one, two, other = (placement_clutter.cluttered(s, 5) for s in (3, 3, 4))
    assert len(one.tasks) == 3
    np.testing.assert_array_equal(one.tasks[2].rotation, two.tasks[2].rotation)
    assert not np.array_equal(one.tasks[2].rotation, other.tasks[2].rotation)
    for pillar in one.obstacles[1:]:
        assert np.linalg.norm(pillar.point[:2]) > 2 * pillar.radius
    assert [len(placement_clutter.drilling(*n).cases) for n in ((20, 1), (1, 8))] == [21, 16]
    among = load_placement(placement_clutter.AMONG_PILLARS).problem
    assert len(among.obstacles) + len(among.keep_out) == 7


@pytest.mark.slow
def test_clutter_study_counts_what_is_close_and_keeps_what_is_done(tmp_path, monkeypatch, capsys):
    made = []

    def run(problem, seed, **options):
        made.append((problem, options))
        few = len(problem.obstacles) % 2
        total = (
            None if few and problem.robot.arm.name == "FP1W2F" else 0.1 if options else 0.1005 + 0.001 * seed
        )
        entry = {"total": total, "parameters": [0.0], "programs": 7, "iterations": 300}
        return entry | {"cpu_seconds": 2.0 + seed}

    monkeypatch.setattr(placement_clutter, "run", run)
    options = ["--out", str(tmp_path), "--tasks", "3", "--sets", "2", "--thorough", "1"]
    assert placement_clutter.main(options) == 0
    first = capsys.readouterr().out
    assert "3 of 6 runs of the 3 random tasks are within 1 %" in first  # 0.5 % and 1.5 % worse
    assert "+1.50 %" in first
    assert "20 forces, 1 poses" in first
    count = len(made)
    assert placement_clutter.main(options) == 0
    assert len(made) == count  # nothing is computed twice
    assert capsys.readouterr().out == first
    monkeypatch.setattr(placement_clutter, "source_state", lambda *_: "new")
    assert placement_clutter.main([*options, "--again"]) == 0
    assert not any(options for _, options in made[count:])  # the thorough ones stay
    assert "another state of the source code" in capsys.readouterr().out


@pytest.mark.slow
def test_place_is_as_good_as_a_coarse_grid():
    row = placement_brute_force.compared(0, 2, 20_000)
    assert max(placement_brute_force.excess(row)) < placement_brute_force.ALLOWED


def test_front_against_all_pairs():
    values = np.random.default_rng(0).random((60, 3))
    kept = placement_pareto.front(values)
    beaten = [any((o <= v).all() and (o < v).any() for o in values) for v in values]
    assert kept.sum() >= 3
    assert (kept | np.array(beaten)).all()
    for c in range(3):
        assert kept[np.argmin(values[:, c])]
    assert len(placement_pareto.weight_grid(6)) == 28
    assert all(sum(w) == 6 for w in placement_pareto.weight_grid(6))


@pytest.mark.slow
def test_pareto_study_keeps_what_is_done(tmp_path, monkeypatch, capsys):
    points = [(0.2, 0.3, 40.0), (0.3, 0.2, 39.0), (0.3, 0.3, 41.0)]

    def solved(problem, weights, starts, seed):
        entry = {"parameters": [1.0, 0.2, 0.5], "patch": 0, "angles_deg": [[0.0] * 6], "active": []}
        found = [dict(zip(("GN", "GT", "GE"), p, strict=True)) | entry for p in points]
        base = {"weights": list(weights), "starts": starts, "seed": seed, "cpu_seconds": 1.0}
        return base | {"placements": found}

    monkeypatch.setattr(placement_pareto, "solved", solved)
    options = ["--out", str(tmp_path), "--steps", "1"]
    assert placement_pareto.main(options) == 0
    first = capsys.readouterr().out
    assert "3 weights, 9 placements, 6 on the front" in first
    assert (tmp_path / "placement_pareto.png").stat().st_size > 10_000
    monkeypatch.setattr(placement_pareto, "solved", None)
    assert placement_pareto.main(options) == 0
    assert capsys.readouterr().out == first

    # the same name with other content is another task; its rows come beside the old ones
    changed = tmp_path / placement_pareto.TASK.name
    changed.write_text(placement_pareto.TASK.read_text() + "# changed\n")
    points = points[:2]
    monkeypatch.setattr(placement_pareto, "solved", solved)
    assert placement_pareto.main([*options, "--task", str(changed)]) == 0
    assert "3 weights, 6 placements" in capsys.readouterr().out
    monkeypatch.setattr(placement_pareto, "solved", None)
    assert placement_pareto.main(options) == 0
    assert capsys.readouterr().out == first
    rows = json.loads((tmp_path / "placement_pareto.json").read_text())["rows"]
    assert len(rows) == 6
    assert len({row["task_digest"] for row in rows}) == 2
    assert len({row["state"] for row in rows}) == 1


@pytest.mark.slow
def test_committed_rows_are_still_read(tmp_path, monkeypatch, capsys):
    for study, computed in ((placement_pareto, "solved"), (placement_brute_force, "compared")):
        name = "placement_" + study.__name__.rpartition(".")[2]
        shutil.copy(RESULTS / f"{name}.json", tmp_path)
        monkeypatch.setattr(study, computed, None)
        assert study.main(["--out", str(tmp_path)]) == 0
        assert (tmp_path / f"{name}.json").read_bytes() == (RESULTS / f"{name}.json").read_bytes()
        assert capsys.readouterr().out.startswith((RESULTS / f"{name}.md").read_text())
