"""Scans of many placements against the evaluation of each one."""

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.maps import scan
from ocptip.placement.problem import GripperTask, PlacementLimits, ProcessLoad
from ocptip.placement.search.starts import exact_scores, solutions
from tests.placement.placement_scenes import INTO_WALL, drilling, modular_robot


@pytest.fixture(scope="module")
def grid():
    rng = np.random.default_rng(0)
    return np.column_stack(
        [rng.uniform(-0.8, 0.1, 250), rng.uniform(-0.4, 0.4, 250), rng.uniform(-3, 3, 250)]
    )


@pytest.fixture(scope="module")
def everything(grid):
    """Totals of all branches of all placements, infeasible ones infinite."""
    problem = drilling()
    evaluator = Evaluator(problem)
    q = solutions(evaluator, 0, 0, grid, np.random.default_rng(0))
    totals = np.full(q.shape[:2], np.inf)
    who, which = np.nonzero(np.isfinite(q).all(axis=2))
    value, margin = exact_scores(evaluator, 0, grid[who], q[who, which][:, None])
    totals[who, which] = np.where(margin >= -1e-6, value, np.inf)
    return problem, totals.min(axis=1)


def test_each_placement_gets_its_best_branch(grid, everything):
    problem, expected = everything
    found = scan(problem, grid)
    assert np.isfinite(expected).sum() > 10
    assert found.feasible.tolist() == np.isfinite(expected).tolist()
    good = found.feasible
    assert found.totals[good] == pytest.approx(expected[good])
    assert found.parameters == pytest.approx(grid)
    assert np.isnan(found.totals[~good]).all()


def test_groups_get_their_best_placement_with_fewer_contacts_solved(grid, everything):
    problem, expected = everything
    groups = np.arange(len(grid)) % 7
    found = scan(problem, grid, groups=groups)
    single = scan(problem, grid, groups=np.zeros(len(grid), dtype=int))
    for g in range(7):
        least = expected[groups == g].min()
        assert np.nan_to_num(found.totals[g], nan=np.inf) == pytest.approx(least)
        assert any(np.array_equal(found.parameters[g], p) for p in grid[groups == g])
    assert single.totals[0] == pytest.approx(expected.min())
    assert single.best == 0
    assert single.solved < found.states


def test_causes_name_what_is_broken(grid):
    wide = scan(drilling(limits=PlacementLimits(condition=1.0001)), grid)
    assert "manipulability" in set(wide.causes)
    assert not wide.feasible.any()
    assert wide.best is None
    causes = scan(drilling(), grid).causes
    behind = grid[:, 0] > 0.2  # no base there: wall at -0.05
    assert not behind.any()
    assert "base clearance" in set(causes)
    far = scan(drilling(), np.array([[-2.0, 0.0, 0.0]]))
    assert far.causes.tolist() == ["reach"]
    assert np.isnan(far.angles).all()


def test_several_tasks_are_scanned_with_a_branch_each(grid):
    tasks = [
        GripperTask([0.0, 0.0, 0.55], INTO_WALL, [ProcessLoad([-6, 0, 0])], name="a"),
        GripperTask([0.0, 0.1, 0.45], INTO_WALL, name="b"),
    ]
    problem = drilling(modular_robot(), tasks=tasks)
    found = scan(problem, grid)
    evaluator = Evaluator(problem)
    good = np.flatnonzero(found.feasible)
    assert len(good)
    value, margin = exact_scores(evaluator, 0, found.parameters[good], found.angles[good])
    assert value == pytest.approx(found.totals[good])
    assert (margin >= -1e-6).all()


def test_refusals(grid):
    with pytest.raises(InputError, match="parameters"):
        scan(drilling(), grid[:, :2])
    with pytest.raises(InputError, match="groups: expected 250"):
        scan(drilling(), grid, groups=np.zeros(3, dtype=int))
