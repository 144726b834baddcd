"""Placements: known optima, grids, refusals that name what is in the way."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from ocptip.basics.errors import InputError, PlanningError
from ocptip.contact.support import Support
from ocptip.indices.arms.values import rate_arm
from ocptip.indices.metric import OperationEllipsoid
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.limits.limit import smallest_margin
from ocptip.placement.maps import scan
from ocptip.placement.place import place
from ocptip.placement.problem import GripperTask, PlacementLimits, ProcessLoad, Weights, sampled_loads
from ocptip.placement.result import NoPlacementError, evaluate_placement
from ocptip.placement.search.refine import followed
from ocptip.placement.terrain import plane
from ocptip.reserves.slip import Slip
from ocptip.robots.geometry import Pillar
from ocptip.standing.arm import Robot
from tests.placement.placement_scenes import (
    INTO_WALL,
    clamped,
    drilling,
    four_feet,
    hills,
    modular_robot,
    on_uneven_ground,
    planar_problem,
    random_task,
)
from tests.reserves.test_mixed_friction import least_use


@pytest.fixture(scope="module")
def drilled():
    return place(drilling(), starts=1)


def test_planar_example_ends_where_the_joint_torques_vanish():
    seen = []
    result = place(planar_problem(), starts=4, samples=100, progress=lambda *told: seen.append(told))
    assert [told[0] for told in seen] == [*range(1, len(seen) + 1)]
    assert all(told[1] >= len(seen) for told in seen)
    assert seen[-1][2] == pytest.approx(0.02467811, abs=1e-6)
    best = result.best
    shoulder, elbow = best.angles[0]
    # without torques the joints hang like a chain under the horizontal force (weights 12.4 and 3.6, force 5)
    assert np.tan(shoulder) == pytest.approx((12.4 / 2 + 3.6) / 5.0, abs=1e-6)
    assert np.tan(shoulder + elbow) == pytest.approx(3.6 / 2 / 5.0, abs=1e-6)
    assert best.criteria["GE"] == pytest.approx(0.0, abs=1e-6)
    assert best.parameters == pytest.approx([6.70, 7.90], abs=0.01)  # the source: about (6.6, 7.9)
    assert best.feasible
    assert not best.active


def test_joints_keep_a_margin_from_their_limits():
    """The same arm, which would like 63 and -43 degrees; the elbow's limits are -170 and -10 degrees."""
    limits = PlacementLimits(GN=None, GT=None, angle_margin=np.radians(45.0))
    best = place(replace(planar_problem(), limits=limits), starts=2, samples=60).best
    shoulder, elbow = np.degrees(best.angles[0])
    assert 65.0 < shoulder < 115.0
    assert elbow == pytest.approx(-55.0, abs=1e-4)
    assert [f"{one}" for one in best.active] == [
        "joint angle: upper limit of elbow with its margin: -55 deg, must be <= -55 deg"
    ]


@pytest.mark.slow
def test_planar_optimum_is_found_from_nearly_all_start_sets():
    found = [place(planar_problem(), starts=4, samples=60, seed=s).best.total for s in range(100)]
    assert np.mean(np.array(found) < min(found) + 1e-6) >= 0.95


def test_result_is_judged_and_better_than_a_grid(drilled):
    problem, best = drilled.problem, drilled.best
    assert all(p.feasible for p in drilled.placements)
    assert best.pose_error < 1e-9
    x, y, angle = np.meshgrid(
        np.linspace(-0.9, -0.2, 15), np.linspace(-0.5, 0.5, 15), np.linspace(-np.pi, np.pi, 24), indexing="ij"
    )
    grid = np.column_stack([x.ravel(), y.ravel(), angle.ravel()])
    brute = scan(problem, grid, groups=np.zeros(len(grid), dtype=int))
    assert brute.states > 2000
    assert best.total < brute.totals[0]
    assert best.total > 0.8 * brute.totals[0]  # the grid is not that coarse


def test_no_direction_improves_the_best_placement(drilled):
    problem, best = drilled.problem, drilled.best
    evaluator = Evaluator(problem)
    rng = np.random.default_rng(0)
    steps = rng.normal(size=(300, 3)) * [3e-3, 3e-3, 1e-2] * rng.random((300, 1))
    parameters = best.parameters + steps
    angles, exact = followed(evaluator, 0, parameters, np.tile(best.angles, (300, 1, 1)))
    found = [evaluator.task(0, 0, parameters[exact], angles[exact, 0])]
    kept = (
        np.minimum(found[0].margin(), smallest_margin(evaluator.ground(0, parameters[exact]), exact.sum()))
        >= 0
    )
    totals = evaluator.totals(evaluator.criteria(found))[kept]
    assert exact.sum() > 250
    assert kept.sum() > 20
    assert totals.min() > best.total - 1e-7


@pytest.mark.slow
def test_smooth_optimum_agrees_with_scipy():
    problem = planar_problem()
    evaluator = Evaluator(problem)

    def total(angles):
        reach = 4.8 * np.cumsum([np.cos(angles[0]), np.cos(angles[0] + angles[1])])[-1]
        height = 2 + 4.8 * np.sum([np.sin(angles[0]), np.sin(angles[0] + angles[1])])
        return evaluator.totals(
            evaluator.criteria([evaluator.task(0, 0, np.array([[reach, height]]), angles[None])])
        )[0]

    reference = minimize(
        total, np.deg2rad([60.0, -40.0]), method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12}
    )
    assert place(problem, starts=2, samples=100).best.total == pytest.approx(reference.fun, abs=1e-7)


@pytest.mark.slow
def test_results_repeat_and_differ_from_each_other(drilled):
    drilled = place(drilled.problem, starts=2)
    again = place(drilled.problem, starts=2)
    assert [p.total for p in again.placements] == [p.total for p in drilled.placements]
    totals = [p.total for p in drilled.placements]
    assert totals == sorted(totals)
    for a, b in zip(drilled.placements, drilled.placements[1:], strict=False):
        gap = max(np.abs(a.parameters - b.parameters).max(), np.abs(a.angles - b.angles).max())
        assert gap > 1e-3


def test_to_dict_is_plain(drilled):
    data = drilled.to_dict()
    first = data["best"]
    assert set(first["criteria"]) == {"GN", "GT", "GK", "GE"}
    assert first["parameters"].keys() == {"x", "y", "angle_deg"}
    assert first["total"] == pytest.approx(
        sum(w * first["criteria"][k]["value"] / data["references"][k] for k, w in data["weights"].items())
    )
    assert all(isinstance(m["relative"], float) for m in first["margins"])


@pytest.mark.slow
def test_limits_become_active():
    problem = drilling(limits=PlacementLimits(condition=1e6))
    free = place(problem, starts=3).best
    reached = next(m.value for m in free.margins if m.kind == "manipulability")
    limit = 0.9 * reached
    tight = place(replace(problem, limits=PlacementLimits(condition=limit)), starts=4).best
    value = next(m.value for m in tight.margins if m.kind == "manipulability")
    assert value <= limit * (1 + 1e-6)
    assert tight.total > free.total
    assert value == pytest.approx(limit, rel=1e-3)
    assert "manipulability" in [m.kind for m in tight.active]


@pytest.mark.slow
@pytest.mark.parametrize("index", ["dm_2", "pi_oe", "inv_cdn_oe"])
def test_a_performance_index_is_kept(index):
    """On a six-axis arm, against the index as `ocptip rate` gives it."""
    problem = drilling(limits=PlacementLimits(index=index, index_min=1e-9))
    free = place(problem, starts=1).best
    least = 1.2 * next(m.value for m in free.margins if m.kind == "manipulability")
    tight = place(replace(problem, limits=PlacementLimits(index=index, index_min=least)), starts=1).best
    assert tight.feasible
    assert tight.total > free.total
    tool = OperationEllipsoid.sphere(problem.limits.tool_radius)
    value = rate_arm(problem.robot.arm, tight.angles[0], ellipsoid=tool)[index].value
    assert value >= least * (1 - 1e-6)
    assert value < least * 1.15  # at the limit, but for the smooth form's distance from the index
    if index == "dm_2":
        assert "manipulability" in [m.kind for m in tight.active]


@pytest.mark.slow
def test_one_stand_serves_several_tasks(drilled):
    tasks = [
        drilled.problem.tasks[0],
        GripperTask(
            [0.0, 0.15, 0.45], INTO_WALL, [ProcessLoad([-6, 0, 0])], orientation="axis", name="second"
        ),
    ]
    both = place(drilling(tasks=tasks), starts=3).best
    assert both.angles.shape == (2, 6)
    assert both.feasible
    evaluator = Evaluator(both.problem)
    found = [evaluator.task(t, 0, both.parameters[None], both.angles[t : t + 1]) for t in range(2)]
    assert both.criteria["GN"] == pytest.approx(max(f.GN[0, 1] for f in found))
    assert both.criteria["GE"] == pytest.approx(np.mean([f.GE[0, 1] for f in found]))
    alone = evaluate_placement(Evaluator(drilled.problem), 0, both.parameters, both.angles[:1])
    assert alone.total >= drilled.best.total - 1e-6  # one stand for two is no better for the first


@pytest.mark.slow
def test_force_sets_count_with_their_worst_direction():
    loads = sampled_loads(6.0, 6, axis=[-1, 0, 0], half_angle=0.5)
    best = place(drilling(tasks=GripperTask([0, 0, 0.55], INTO_WALL, loads)), starts=2).best
    evaluator = Evaluator(best.problem)
    found = evaluator.task(0, 0, best.parameters[None], best.angles[0][None])
    for name in ("GN", "GT", "GK"):
        assert best.criteria[name] == pytest.approx(np.max(getattr(found, name)[0, 1:]))


@pytest.mark.slow
def test_no_force_inside_a_cone_is_worse_than_stated():
    loads, rng = sampled_loads(6.0, axis=[-1, 0, 0], half_angle=0.4), np.random.default_rng(0)
    best = place(drilling(tasks=GripperTask([0, 0, 0.55], INTO_WALL, loads)), starts=2).best
    along = np.where(rng.random(400) < 0.5, np.cos(0.4), 1 - (1 - np.cos(0.4)) * rng.random(400))
    turn, across = rng.uniform(-np.pi, np.pi, 400), np.sqrt(1 - along**2)
    inside = 6.0 * np.column_stack([-along, across * np.cos(turn), across * np.sin(turn)])
    dense = [ProcessLoad(force, name=str(i)) for i, force in enumerate(inside)]
    evaluator = Evaluator(drilling(tasks=GripperTask([0, 0, 0.55], INTO_WALL, dense)))
    found = evaluator.task(0, 0, best.parameters[None], best.angles[0][None])
    assert found.margin()[0] >= -1e-6
    for name in ("GN", "GT", "GK"):
        worst = np.max(getattr(found, name)[0, 1:])
        assert worst <= best.criteria[name] * (1 + 1e-6)
        assert worst >= best.criteria[name] * 0.97


@pytest.mark.slow
def test_terrains_compete():
    low = plane(x=(-1.5, -0.6), contacts_inside=True, name="low")
    high = plane(height=0.15, x=(-0.55, 0.0), contacts_inside=True, name="high")
    both = place(drilling(terrain=[low, high]), starts=6)
    single = []
    for patch in (low, high):
        try:
            single.append(place(drilling(terrain=patch), starts=4).best.total)
        except NoPlacementError:
            single.append(np.inf)
    assert both.best.total <= 1.001 * min(single)  # neighbouring local optima differ by less
    assert both.best.patch == int(np.argmin(single))
    contacts = np.array([c.position for c in both.problem.robot.support.contacts])
    world = both.best.base_position + contacts @ both.best.base_rotation.T
    bounds = both.problem.terrain[both.best.patch].contact_area
    assert world[:, 0].min() >= bounds[0, 0] - 1e-6
    assert world[:, 0].max() <= bounds[1, 0] + 1e-6


@pytest.mark.slow
def test_user_terrain_and_clamps():
    best = place(drilling(terrain=hills()), starts=3).best
    assert best.feasible
    x, y, _ = best.parameters
    assert best.base_position == pytest.approx(
        np.array([x, y, 0.05 * np.sin(2 * x)]) + 0.3 * best.base_rotation[:, 2]
    )
    assert place(drilling(clamped()), starts=2).best.feasible


def test_unreachable_pose_says_by_how_much():
    with pytest.raises(NoPlacementError, match="gripper position") as caught:
        place(drilling(tasks=GripperTask([0.0, 0.0, 1.6], INTO_WALL)), samples=30)
    nearest = caught.value.nearest
    missed = next(m for m in nearest.violations if m.name == "gripper position")
    highest = 0.3 + np.linalg.norm(modular_robot().arm.offsets, axis=1).sum()
    assert missed.value > 1.6 - highest - 0.05
    assert missed.value < 1.3
    assert "0 of" in str(caught.value)
    assert isinstance(caught.value, PlanningError)


@pytest.mark.slow
def test_too_large_force_names_torque_or_standing():
    task = GripperTask([0.0, 0.0, 0.55], INTO_WALL, [ProcessLoad([-6.0, 0.0, -400.0])])
    with pytest.raises(NoPlacementError) as caught:
        place(drilling(tasks=task, limits=PlacementLimits(GN=None, GT=None)), starts=1)
    kinds = {m.kind for m in caught.value.nearest.violations}
    assert kinds & {"torque", "persistence", "tip-over"}
    assert "reach" not in kinds  # the pose itself can be reached
    assert "must be" in str(caught.value)


@pytest.mark.slow
def test_least_violation_of_a_limit_is_found():
    """The reported excess of the only constraint in the way is the smallest there is."""
    only = Weights(GN=0, GT=1, GK=0, GE=0)
    problem = drilling(weights=only, limits=PlacementLimits(), unloaded=False)
    least = place(problem, starts=4).best.criteria["GT"]
    with pytest.raises(NoPlacementError) as caught:
        place(replace(problem, limits=PlacementLimits(GT=0.7 * least)), starts=4)
    missed = next(m for m in caught.value.nearest.violations if m.kind == "GT")
    assert missed.value == pytest.approx(least, rel=0.02)
    assert {m.kind for m in caught.value.nearest.violations} == {"GT"}


def test_everything_blocked_by_keep_out():
    with pytest.raises(NoPlacementError, match="the base alone can stand at none of") as caught:
        place(drilling(keep_out=[Pillar([0.0, 0.0, 0.0], 2.5)]), samples=100, starts=1)
    assert caught.value.nearest.pose_error < 1e-6  # the arm reaches its pose: the base is in the way
    assert caught.value.nearest.violations[0].kind == "base clearance"


@pytest.mark.slow
def test_slipping_is_stated_as_the_friction_that_would_be_needed():
    feet = four_feet().support.contacts
    smooth = Support(
        [replace(foot, friction=0.005) for foot in feet],
        mass=four_feet().support.mass,
        center_of_mass=four_feet().support.center_of_mass,
    )
    robot = Robot(four_feet().arm, smooth, four_feet().motors)
    with pytest.raises(NoPlacementError) as caught:
        place(drilling(robot, terrain=plane()), starts=1)
    nearest = caught.value.nearest
    stated = next(m for m in nearest.violations if m.kind == "GT")
    load = nearest.problem.tasks[0].loads[0]
    weight = 9.81 * (smooth.mass + robot.arm.masses.sum()) - load.force[2]
    least = abs(load.force[0]) / (0.005 * weight)  # all of the friction against the force
    assert stated.value >= least * (1 - 1e-6)
    assert stated.value < 2 * least  # the rest holds the moment about the vertical


@pytest.mark.slow
def test_a_cart_on_two_wheels_and_two_casters_is_placed_with_the_best_sharing():
    feet = four_feet().support.contacts
    casters = [*feet[:2], *(replace(foot, friction=0.0) for foot in feet[2:])]
    robot = Robot(four_feet().arm, four_feet().support.varied(casters), four_feet().motors)
    found = place(drilling(robot), starts=1).best
    [margin] = [m for m in found.margins if (m.kind, m.name) == ("GT", "without process load")]
    tilted = robot.varied(support=robot.support.varied(gravity=found.base_rotation.T @ [0.0, 0.0, -9.81]))
    still = np.zeros_like(found.angles)
    [wrench] = tilted.loads(found.angles, still, still)[1]
    assert margin.value == pytest.approx(least_use(tilted.support, wrench), abs=1e-6)
    assert found.criteria["GT"] < 0.3


def test_bad_numbers_are_refused():
    for name in ("starts", "samples", "keep"):
        with pytest.raises(InputError, match=f"{name}: must be a whole number >= 1"):
            place(drilling(), **{name: 0})


def test_a_coordinate_that_nothing_changes_is_refused():
    problem = planar_problem()
    task = GripperTask([0.0, 0.1, 0.0], orientation="free")
    with pytest.raises((InputError, NoPlacementError), match=r"off by 0\.1"):
        place(replace(problem, tasks=task), samples=60)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_never_worse_than_a_million_evaluations(seed):
    problem = random_task(seed)
    low, high = problem.terrain[0].box(problem.tasks[0].position, 0.55)
    axes = [np.linspace(a, b, n) for a, b, n in zip(low, high, (90, 90, 64), strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    brute = scan(problem, grid, groups=np.zeros(len(grid), dtype=int))
    if brute.best is None:
        pytest.skip("the grid has no feasible placement")
    assert place(problem, seed=seed).best.total <= 1.005 * brute.totals[0]


@pytest.mark.slow
def test_feet_with_different_normals_are_judged_with_all_forces_redistributed():
    problem = drilling(on_uneven_ground())
    best = place(problem, starts=1).best
    evaluator = Evaluator(problem)
    fast, full = (
        evaluator.task(0, 0, best.parameters[None], best.angles[0][None], fast=fast).GT
        for fast in (True, False)
    )
    assert fast == pytest.approx(full)
    own = evaluator.task(0, 0, best.parameters[None], best.angles[0][None]).states
    kept = Slip(problem.robot.support, "tangential").evaluate(own, derivatives=False).GT
    assert (kept > full[0] + 0.01).all()


@pytest.mark.slow
def test_four_feet_use_the_full_redistribution():
    assert four_feet().slip.redistribution == "full"
    best = place(drilling(four_feet("tangential")), starts=2).best
    assert best.feasible
    assert best.total >= place(drilling(), starts=2).best.total - 1e-6  # a smaller set of contact forces
