"""Derivatives of the nonlinear program, its agreement with the fast model, and its degrees of freedom."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocptip.placement.evaluate import Evaluator
from ocptip.placement.ground import Bump, HeightField, Wave
from ocptip.placement.problem import GripperTask, PlacementLimits, ProcessLoad, Weights
from ocptip.placement.search.physics import PatchPhysics, near_gaps, pieces
from ocptip.placement.search.program import ElasticProgram, PlacementProgram
from ocptip.placement.terrain import plane, rough_ground
from ocptip.robots.geometry import Pillar, Wall
from ocptip.robots.kinematics import gripper_pose
from ocptip.standing.tolerance import Uncertainty
from tests.placement.placement_scenes import (
    INTO_WALL,
    clamped,
    drilling,
    four_feet,
    hills,
    modular_robot,
    planar_problem,
    tripod,
)
from tests.quick import some

FRAME = (np.array([0.0, 0.0, -0.3]), np.eye(3))
WAVES = HeightField(Wave(0.02, 0.9, 0.3), Bump([0.3, 0.1], 0.03, 0.3), slope=[0.02, 0.03])
TOLERANCE = Uncertainty(base_mass=0.05, center_of_mass=[0.01, 0.01, 0.02], friction=0.2)
LIMITS = PlacementLimits(condition=40.0, singular_ratio=50.0)


def several_tasks():
    tasks = [
        GripperTask(
            [0, 0, 0.5], INTO_WALL, [ProcessLoad([-5, 0, 0], name="a"), ProcessLoad([0, 3, 0], name="b")]
        ),
        GripperTask([0, 0.2, 0.6], INTO_WALL, [ProcessLoad([-4, 1, 0])], orientation="axis", name="second"),
        GripperTask([0, 0.2, 0.6], INTO_WALL, orientation="free", name="third"),
    ]
    return drilling(tasks=tasks, terrain=hills(), limits=LIMITS)


PROBLEMS = {
    "four feet": lambda: drilling(
        limits=LIMITS, obstacles=[Wall(np.array([1.0, 0, 0]), 0.3, "w"), Pillar([-0.3, 0.4, 0], 0.1)]
    ),
    "three feet": lambda: drilling(
        modular_robot(), terrain=plane(x=(-2, 0), y=(-2, 2), contacts_inside=True)
    ),
    "slip by the contact solver": lambda: drilling(four_feet("tangential")),
    "clamped": lambda: drilling(clamped()),
    "clamped on a step": lambda: drilling(clamped(0.05), ground_frame=FRAME),
    "several tasks on hills": several_tasks,
    "planar": planar_problem,
    "tripod on rough ground": lambda: drilling(tripod(), terrain=rough_ground(WAVES), tolerance=TOLERANCE),
    "four legs on rough ground": lambda: drilling(
        four_feet(), terrain=rough_ground(WAVES, stroke=[0.0, 0.2])
    ),
    "tolerance and slip by the contact solver": lambda: drilling(
        four_feet("tangential"), tolerance=TOLERANCE
    ),
    "only slip counts": lambda: drilling(weights=Weights(0, 1, 0, 0), unloaded=False),
}


def program_at(problem, seed=1, criteria=True):
    """A program at a random point near which all bases stand."""
    physics = PatchPhysics(Evaluator(problem), 0)
    rng = np.random.default_rng(seed)
    low, high = problem.terrain[0].box(np.zeros(3), 0.5)
    p = low + rng.random(len(low)) * (high - low)
    q = rng.uniform(-0.5, 0.5, (len(problem.tasks), problem.robot.arm.n)) + 0.4
    held = [i for i, case in enumerate(problem.cases) if case.constrained]
    own = pieces(physics, p, q, held)
    program = PlacementProgram(physics, near_gaps(physics, p, q, 3.0), held, own, criteria)
    x = program.start(p, q)
    x += 1e-3 * rng.normal(size=len(x))
    if program.forces is not None:
        x[program.grip :: 3] += 0.1  # all contacts loaded
    return program, x


def differences(function, x, step=1e-6):
    return np.array([(function(x + e) - function(x - e)) / (2 * step) for e in step * np.eye(len(x))]).T


@pytest.mark.parametrize("name", some(1, PROBLEMS))
def test_derivatives(name):
    program, x = program_at(PROBLEMS[name]())
    assert len(program.labels) == len(program.bounds[0]) == len(program.values(x)[1])
    gradient = differences(lambda x: program.values(x)[0], x)
    assert program.gradient(x) == pytest.approx(gradient, abs=1e-6)
    jacobian = differences(lambda x: program.values(x)[1], x)
    scale = 1 + np.abs(jacobian).max(axis=1, keepdims=True)
    assert np.abs(program.jacobian(x) - jacobian).max(initial=0.0) < 1e-4
    assert (np.abs(program.jacobian(x) - jacobian) / scale).max() < 1e-6
    rng = np.random.default_rng(0)
    multipliers = rng.normal(size=len(program.labels))

    def lagrangian(x):
        return 0.7 * program.gradient(x) + multipliers @ program.jacobian(x)

    numeric = differences(lagrangian, x)
    exact = program.hessian(x, 0.7, multipliers)
    assert exact == pytest.approx(exact.T, abs=1e-9 * np.abs(exact).max())
    # the curvature of GT and of the manipulability are differences themselves
    assert np.abs(exact - numeric).max() < 1e-4 * np.abs(numeric).max()
    slopes, bends = program.pattern
    assert (program.jacobian(x)[~slopes] == 0).all()
    assert (exact[~bends] == 0).all()


@pytest.mark.slow
@pytest.mark.parametrize("reachable", [False, True])
@pytest.mark.parametrize("name", some(1, ["clamped on a step", "four feet"]))
def test_elastic_derivatives(name, reachable):
    program, x = program_at(PROBLEMS[name](), criteria=False)
    elastic = ElasticProgram(program, reachable)
    z = elastic.start(x)
    rows = elastic.values(z)[1]
    kept = (rows >= elastic.bounds[0] - 1e-9) & (rows <= elastic.bounds[1] + 1e-9)
    assert kept.all()  # violations just large enough
    z += 1e-3 * np.random.default_rng(0).normal(size=len(z))
    jacobian = differences(lambda z: elastic.values(z)[1], z)
    assert elastic.jacobian(z) == pytest.approx(jacobian, abs=1e-4)
    assert elastic.gradient(z) == pytest.approx(differences(lambda z: elastic.values(z)[0], z), abs=1e-7)
    multipliers = np.random.default_rng(1).normal(size=len(rows))
    numeric = differences(lambda z: multipliers @ elastic.jacobian(z), z)
    exact = elastic.hessian(z, 1.0, multipliers)
    slopes, bends = elastic.pattern
    assert (elastic.jacobian(z)[~slopes] == 0).all()
    assert (exact[~bends] == 0).all()
    assert np.abs(exact - numeric).max() < 1e-4 * np.abs(numeric).max()


@pytest.mark.slow
@pytest.mark.parametrize("orientation", ["full", "axis"])
def test_orientation_rows_grow_up_to_half_a_turn(orientation):
    position = np.array([-0.5, 0.1, 0.3])
    q = np.array([0.2, 0.5, -0.4, 0.3, 0.6, 0.1])
    evaluator = Evaluator(drilling())
    _, base = evaluator.place(0, position[None])
    reached = base[0] @ gripper_pose(evaluator.arm, q[None])[1][0]
    across = np.array([1.0, 0.0, 0.0])
    sizes = []
    for angle in np.deg2rad([0, 60, 120, 170, 179, 179.9]):
        wanted = reached @ Rotation.from_rotvec(angle * across).as_matrix()
        task = GripperTask([0, 0, 0.5], wanted, orientation=orientation)
        physics = PatchPhysics(Evaluator(drilling(tasks=task)), 0)
        sizes.append(np.linalg.norm(physics.pose[0].first(np.r_[position, q])[0][3:]))
    assert sizes[0] == pytest.approx(0.0, abs=1e-9)
    assert (np.diff(sizes) > 0.5).all()


def test_three_freedoms_are_left_on_a_plane():
    program, x = program_at(drilling())
    pose = program.jacobian(x)[:6, : program.k + program.n]
    assert np.linalg.matrix_rank(pose) == 6
    assert program.k + program.n - 6 == 3


def test_planar_robot_loses_the_row_that_nothing_changes():
    physics = PatchPhysics(Evaluator(planar_problem()), 0)
    assert physics.pose[0].size == 2
    assert physics.dropped == [pytest.approx(0.0, abs=1e-12)]


def test_rows_agree_with_the_fast_model():
    problem = drilling(limits=LIMITS, obstacles=[Wall(np.array([1.0, 0, 0]), 0.3, "w")])
    program, x = program_at(problem)
    p, q = program.split(x)
    found = Evaluator(problem).task(0, 0, p[None], q)
    rows = program.values(x)[1]
    torque = [i for i, label in enumerate(program.labels) if label.kind == "torque"]
    expected = (found.torques[0] / problem.robot.arm.limits.torque).ravel()
    assert rows[torque] == pytest.approx(expected, abs=1e-12)
    gaps = np.concatenate([r.margins[0] for r in found.rows if r.kind == "clearance"])
    near = [i for i, label in enumerate(program.labels) if label.kind == "clearance"]
    assert rows[near] == pytest.approx(gaps[program.near[0]], abs=1e-9)
    condition = [i for i, label in enumerate(program.labels) if label.kind == "manipulability"]
    margins = np.concatenate([r.margins[0] for r in found.rows if r.kind == "manipulability"])
    assert program.bounds[1][condition] - rows[condition] == pytest.approx(margins)


def test_start_has_the_objective_of_the_fast_model():
    problem = drilling()
    program, x = program_at(problem)
    p, q = program.split(x)
    evaluator = Evaluator(problem)
    found = [evaluator.task(0, 0, p[None], q)]
    if found[0].GT[0, 1] <= 0.9:
        total = evaluator.totals(evaluator.criteria(found))[0]
        assert program.values(program.start(p, q))[0] == pytest.approx(total, abs=1e-6)
    else:
        pytest.fail("the base should stand here")
