"""Placements of a base on two wheels amid casters: equally compliant wheels bear a third of the weight."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import ocptip
from ocptip.api.place import Placed
from ocptip.basics.errors import InputError
from ocptip.cli.place.cell import CellReport
from ocptip.cli.place.place import PlaceReport
from ocptip.motion.cycles.task import CycleTask
from ocptip.motion.objective import ENERGY
from ocptip.placement import for_cycle
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.power import TorqueCost
from ocptip.placement.problem import GripperTask, PlacementLimits, PlacementProblem, Weights
from ocptip.placement.result import NoPlacementError, Placement, PlacementResult, evaluate_placement
from ocptip.placement.terrain import plane
from ocptip.placement.within import placement_within
from ocptip.robots.kinematics import gripper_pose
from ocptip.standing.tolerance import NONE, Uncertainty
from tests.placement.placement_scenes import four_feet
from tests.standing.at_rest.test_alike_friction import FRICTION, on_wheels
from tests.standing.test_base_motion import carried

Q = np.array([0.3])


def on_slope(slope: float, tolerance: Uncertainty = NONE) -> PlacementProblem:
    """The cart on a plane that rises along x, with its centre of mass at the height of its wheels."""
    robot = carried(on_wheels(1e-4))
    return PlacementProblem(
        robot,
        [GripperTask(gripper_pose(robot.arm, Q)[0].tolist(), orientation="free")],
        [plane((slope, 0.0), x=(-1, 1), y=(-1, 1))],
        weights=Weights(0, 1, 0, 0),
        energy=TorqueCost([1.0]),
        limits=PlacementLimits(GN=None),
        tolerance=tolerance,
    )


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_equally_compliant_wheels_use_three_times_the_friction(angle):
    problem = on_slope(0.2, Uncertainty(friction=0.1))
    assert problem.if_alike is not None
    used = {}
    for some in (problem, problem.if_alike):
        placement = evaluate_placement(Evaluator(some), 0, np.array([0.0, 0.0, angle]), Q[None])
        used[some.alike] = placement.criteria["GT"]
    assert used[False] == pytest.approx(0.2 / (0.9 * FRICTION), rel=1e-3)
    assert used[True] == pytest.approx(3 * 0.2 / (0.9 * FRICTION), rel=1e-3)


def test_of_equal_friction_the_best_sharing_counts():
    robot = four_feet()
    problem = PlacementProblem(robot, [GripperTask([0.5, 0.0, 0.5])], [plane()])
    assert problem.if_alike is None


@pytest.mark.parametrize(("slope", "but"), [(0.15, False), (0.25, True)])
def test_the_headline_names_what_equally_compliant_feet_lose(slope, but):
    problem = on_slope(slope)
    assert problem.if_alike is not None
    placement, with_springs = (
        evaluate_placement(Evaluator(some), 0, np.zeros(3), Q[None]) for some in (problem, problem.if_alike)
    )
    alike = placement_within(with_springs, NONE)
    result = PlacementResult(problem, (placement,), (), 1, 1, 0, 0.0)
    text = PlaceReport(Placed("cart", result, alike=alike), Path(), False, yes=True).to_text()
    assert ("verified, BUT equally compliant feet slip" in text) == but
    assert f"equally compliant feet use {3e2 * slope / FRICTION:.3g} %" in text
    assert alike.stands is not but


@pytest.mark.slow
@pytest.mark.parametrize(("slope", "rated"), [(0.15, True), (0.19, False), (0.25, False)])
def test_the_search_keeps_the_limit_with_equally_compliant_wheels_where_it_can(slope, rated):
    placed = ocptip.place(on_slope(slope), starts=1, uncertainty="none")
    assert placed.verified
    assert placed.best.problem.alike is rated
    use, best = 3 * slope / FRICTION, placed.best.criteria["GT"]
    if rated:
        assert placed.alike is None
        assert best == pytest.approx(use, rel=1e-3)
    else:
        assert placed.alike is not None
        alike = placed.alike.GT
        assert alike == pytest.approx(use, rel=1e-3)
        assert best == pytest.approx(use / 3, rel=1e-3)
    assert placed.to_dict()["equally_compliant"] is rated


@pytest.mark.parametrize("found", [True, False])
def test_places_for_a_cycle_are_rated_with_equally_compliant_wheels_first(found, monkeypatch):
    asked = []

    def place(problem: PlacementProblem, **_: object) -> PlacementResult:
        asked.append(problem.alike)
        placement = evaluate_placement(Evaluator(problem), 0, np.zeros(3), Q[None])
        if found == problem.alike:
            return PlacementResult(problem, (placement,), (), 1, 1, 0, 0.0)
        raise NoPlacementError("slips", placement)

    def refused(placement: Placement) -> CycleTask:
        raise InputError("no posture")

    monkeypatch.setattr(for_cycle, "place", place)
    result = for_cycle.place_for_cycle(on_slope(0.15), refused, candidates=1)
    assert asked == ([True] if found else [True, False])
    assert result.best.placement.problem.alike is found
    cell = SimpleNamespace(
        name="cell", cycle=SimpleNamespace(objective=ENERGY), problem=on_slope(0.15), tolerance=NONE
    )
    report = CellReport(cell, result, None, Path())
    assert ("equally compliant feet slip everywhere" in report.to_text()) is not found
    assert report.entries()["ranked_for_best_sharing"] is not found
