"""The fast model against independent statics, Pinocchio, the collision model and the reserves."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from ocptip.contact.solver import solve
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.limits.arm import LogMeasures, index_of, measures
from ocptip.placement.limits.limit import TaskEvaluation
from ocptip.placement.problem import GripperTask, PlacementLimits, ProcessLoad
from ocptip.placement.result import evaluate_placement
from ocptip.placement.terrain import plane
from ocptip.robots.collision.shapes import Ball, BodyShape, Box
from ocptip.robots.geometry import Pillar, Solid, Wall
from ocptip.robots.kinematics import gripper_pose, link_frames
from ocptip.task_files.motion import load_task
from tests.placement.placement_scenes import INTO_WALL, clamped, drilling, four_feet, hills, placed_robot

PARAMETERS = np.array([[-0.5, 0.1, 0.4], [-0.45, -0.2, -2.0], [-0.6, 0.0, 3.0]])


def angles(robot, count=3, seed=0):
    limits = robot.arm.limits
    low, high = np.maximum(limits.angle_min, -2), np.minimum(limits.angle_max, 2)
    return low + np.random.default_rng(seed).random((count, robot.arm.n)) * (high - low)


def evaluated(problem, q, task=0) -> TaskEvaluation:
    return Evaluator(problem).task(task, 0, PARAMETERS, q)


@pytest.mark.parametrize("terrain", [plane((0.1, -0.07)), hills()], ids=["plane", "hills"])
def test_torques_are_the_derivative_of_the_potential_energy(terrain):
    problem = drilling(terrain=terrain)
    robot, evaluator = problem.robot, Evaluator(problem)
    q = angles(robot)
    found = evaluated(problem, q)
    force, moment = problem.cases[1].force, problem.cases[1].moment

    def potential(p, q):
        origin, base = (part[0] for part in evaluator.place(0, p))
        frames = link_frames(robot.arm, q)
        centres = frames.origins[:-1] + np.einsum("kij,kj->ki", frames.rotations[:-1], robot.arm.centres)
        world = origin + centres @ base.T
        return -robot.arm.masses @ (world @ problem.gravity) - force @ (origin + base @ frames.origins[-1])

    for k in range(3):
        base = evaluator.place(0, PARAMETERS[k])[1][0]
        for j, step in enumerate(1e-6 * np.eye(6)):
            slope = (potential(PARAMETERS[k], q[k] + step) - potential(PARAMETERS[k], q[k] - step)) / 2e-6
            axis = base @ link_frames(robot.arm, q[k]).rotations[j, :, 2]  # the process moment turns G
            assert found.torques[k, 1, j] == pytest.approx(slope - moment @ axis, abs=1e-6)


def test_torques_are_those_of_pinocchio(root):
    robot = load_task(root / "src/ocptip/examples/tasks" / "ur5_cart.toml").robot
    problem = drilling(robot, tasks=GripperTask([0, 0, 0.9], INTO_WALL, [ProcessLoad([-80, 0, 0])]))
    model = pin.buildModelFromUrdf(str(root / "src/ocptip/examples/tasks" / "ur5.urdf"))
    data = model.createData()
    q = angles(robot)
    found = evaluated(problem, q)
    _, base = Evaluator(problem).place(0, PARAMETERS)
    for k in range(3):
        model.gravity.linear = base[k].T @ problem.gravity  # the arm stands upright on the cart
        frame = model.getFrameId("tool0")
        own = pin.rnea(model, data, q[k], np.zeros(6), np.zeros(6)).copy()
        jacobian = pin.computeFrameJacobian(model, data, q[k], frame, pin.LOCAL_WORLD_ALIGNED)
        loaded = own - jacobian[:3].T @ (base[k].T @ [-80.0, 0, 0])
        assert found.torques[k] == pytest.approx(np.array([own, loaded]), abs=1e-9)


def test_wrench_is_the_sum_of_weights_and_process_load():
    problem = drilling()
    robot, evaluator, q = problem.robot, Evaluator(problem), angles(four_feet())
    found = evaluated(problem, q)
    origin, base = evaluator.place(0, PARAMETERS)
    case = problem.cases[1]
    for k in range(3):
        frames = link_frames(robot.arm, q[k])
        centres = frames.origins[:-1] + np.einsum("kij,kj->ki", frames.rotations[:-1], robot.arm.centres)
        points = [*(origin[k] + centres @ base[k].T), origin[k] + base[k] @ frames.origins[-1]]
        forces = [*(robot.arm.masses[:, None] * problem.gravity), case.force]
        middle = origin[k] + base[k] @ robot.support.center_of_mass
        moment = sum(np.cross(p - middle, f) for p, f in zip(points, forces, strict=True)) + case.moment
        force = sum(forces) + robot.support.mass * problem.gravity
        assert found.wrenches[k, 1] == pytest.approx(np.r_[base[k].T @ force, base[k].T @ moment], abs=1e-9)


@pytest.mark.parametrize("robot", [four_feet(), clamped()], ids=["four feet", "clamped"])
def test_reserves_are_those_of_the_reserves(robot):
    problem = drilling(robot)
    found = evaluated(problem, angles(robot))
    for k in range(3):
        for c in range(2):
            state = solve(robot.support, found.wrenches[k, c])
            assert found.GN[k, c] == pytest.approx(robot.tip_over.evaluate(state.states).GN[0])
            assert found.GT[k, c] == pytest.approx(robot.slip.evaluate(state.states).GT[0], abs=1e-8)
            row = next(r for r in found.rows if r.kind == "persistence")
            assert bool(row.values[k, c]) == state.persistent


def test_force_space_is_the_largest_load_the_joints_can_hold():
    problem = drilling()
    q = angles(four_feet(), seed=3)
    found = evaluated(problem, q)
    limit = problem.robot.arm.limits.torque
    for k in range(3):
        share = found.GK[k, 1]
        own, change = found.torques[k, 0], found.torques[k, 1] - found.torques[k, 0]
        assert (np.abs(own) < limit).all()
        assert np.max(np.abs(own + change / share) / limit) == pytest.approx(
            1.0
        )  # at F_max one joint gives way
    assert (found.GK[:, 0] == 0).all()


def test_holding_torques_beyond_their_limit_leave_no_force():
    robot = four_feet()
    weak = replace(robot.arm, limits=replace(robot.arm.limits, torque=np.full(6, 1e-6)))
    problem = drilling(type(robot)(weak, robot.support, robot.motors))
    assert np.isinf(evaluated(problem, angles(robot)).GK[:, 1]).all()


def test_clearances_are_those_of_the_collision_model():
    obstacles = [Wall(np.array([1.0, 0.0, 0.0]), 0.1, "wall"), Pillar([-0.4, 0.3, 0.0], 0.1)]
    problem = drilling(obstacles=obstacles, keep_out=())
    q = angles(four_feet(), seed=5)
    found = evaluated(problem, q)
    evaluator = Evaluator(problem)
    for k in range(3):
        robot = placed_robot(evaluate_placement(evaluator, 0, PARAMETERS[k], q[k : k + 1]))
        mine = np.concatenate([r.values[k] for r in found.rows if r.kind == "clearance"])
        theirs = robot.collision.gaps(q[k])
        assert np.sort(mine) == pytest.approx(np.sort(theirs), abs=1e-12)
        assert len(mine) > 100


def test_ground_rows():
    contacts = [contact.position for contact in four_feet().support.contacts]
    foot = BodyShape("foot", 0, Ball(0.02, position=contacts[1]))
    ball = BodyShape("ball", 0, Ball(0.05, position=[0.1, 0.0, -0.2]))
    problem = drilling(
        four_feet().varied(shapes=[foot, ball]),
        terrain=plane(x=(-1.0, 0.0), contacts_inside=True),
        limits=PlacementLimits(base_clearance=0.01),
    )
    rows = {
        (r.kind, label): r
        for r in Evaluator(problem).ground(0, [[-0.5, 0.1, np.pi / 2]])
        for label in r.labels
    }
    wall = rows["base clearance", "ball and wall"]
    gaps = dict(zip(wall.labels, wall.values[0], strict=True))
    assert gaps["ball and wall"] == pytest.approx(-0.05 + 0.5 - 0.05)
    assert wall.limits == pytest.approx(0.01)
    pillar = rows["base clearance", "ball and pillar"]
    gaps = dict(zip(pillar.labels, pillar.values[0], strict=True))
    assert gaps["ball and pillar"] == pytest.approx(np.hypot(-0.5 + 0.4, 0.1 + 0.1 - 0.6) - 0.2 - 0.05)
    assert {label for kind, label in rows if kind == "base clearance" and "wall" in label} == {
        *(f"{name} and wall" for name in ("contact 1", "contact 3", "contact 4", "foot", "ball", "B"))
    }  # contact 2 is within the foot; B are the spheres of the arm that stand on the base
    assert rows["bounds", "x: lower bound"].margins[0] == pytest.approx([5.0])
    corner = rows["contact area", "contact 1: x"]
    assert corner.values.min() == pytest.approx(-0.65)


@pytest.mark.slow
@pytest.mark.parametrize("known", [True, False])
def test_a_base_of_balls_among_balls_is_the_same_in_closed_form_and_by_solids(known):
    """One far box makes all of them solids; an arm without geometry does not matter."""
    robot = four_feet()
    arm = (
        robot.arm
        if known
        else replace(robot.arm, sphere_sets=(), collision_pairs=(), floor_sets=(), obstacle_sets=())
    )
    balls = [
        BodyShape(name, 0, Ball(r, position=p))
        for name, r, p in (("a", 0.1, [0.1, 0, -0.1]), ("b", 0.05, [-0.2, 0.1, 0]))
    ]
    around = {"keep_out": [Solid(Ball(0.2, position=[-1.0, 0.3, 0.1]), "rock")]}
    if known:
        around["obstacles"] = [
            Wall(np.array([1.0, 0.0, 0.0]), 0.4, "wall"),
            Solid(Ball(0.1, position=[0.4, 0, 1]), "lamp"),
        ]
    far = Solid(Box([0.1, 0.1, 0.1], position=[50.0, 0, 0]), "far")
    q, found = angles(robot), []
    for more in ([], [far]):
        placed = robot.varied(arm=arm, shapes=balls)
        problem = drilling(placed, **{**around, "keep_out": [*around["keep_out"], *more]})
        rows = [*evaluated(problem, q).rows] if known else []
        rows += Evaluator(problem).ground(0, PARAMETERS)
        kinds = {r.kind for r in rows if "far" not in " ".join(r.labels)}
        assert "base clearance" in kinds
        distances = {}
        for r in (r for r in rows if r.kind in ("clearance", "base clearance")):
            for label, values in zip(r.labels, r.values.T, strict=True):
                pair = " and ".join(word.split("[")[0] for word in label.split(" and "))
                near = np.minimum(values, 0.15)  # solids may answer with bounds beyond
                distances[pair] = np.minimum(distances.get(pair, np.inf), near)
        found.append({pair: d for pair, d in distances.items() if "far" not in pair and pair[:5] != "B and"})
    closed, solid = found
    assert set(closed) == set(solid)
    assert any(pair.startswith("a and") for pair in closed)
    for pair, values in closed.items():
        np.testing.assert_allclose(solid[pair], values, atol=1e-6)


def test_pose_rows_count_only_what_the_task_asks_for():
    robot = four_feet()
    q = angles(robot)[:1]
    position, rotation = gripper_pose(robot.arm, q)
    origin, base = Evaluator(drilling()).place(0, PARAMETERS[:1])
    at, turn = origin[0] + base[0] @ position[0], base[0] @ rotation[0]
    half = turn @ np.diag([-1.0, -1.0, 1.0])  # half a turn about the tool axis
    tilted = turn @ np.diag([1.0, -1.0, -1.0])
    for orientation, wanted, error in (
        ("full", turn, 0.0),
        ("full", half, np.pi),
        ("axis", half, 0.0),
        ("axis", tilted, np.pi),
        ("free", tilted, 0.0),
    ):
        problem = drilling(
            tasks=GripperTask(at + np.array([0.0, 3e-3, 0.0]), wanted, orientation=orientation)
        )
        rows = Evaluator(problem).task(0, 0, PARAMETERS[:1], q).rows[0]
        assert rows.values[0] == pytest.approx([3e-3, error], abs=1e-7)


def differences(logs, q, steps):
    """Central differences of values (N, m, n) and of gradients (N, steps, m, n) at three poses."""
    forward, backward = (
        zip(*(logs.gradient(q[:3] + e) for e in sign * steps), strict=True) for sign in (1, -1)
    )
    values, slopes = (np.array(f) - np.array(b) for f, b in zip(forward, backward, strict=True))
    return values.transpose(1, 2, 0) / 2e-6, slopes.transpose(1, 0, 2, 3) / 2e-6


def test_manipulability_measures_and_their_derivatives():
    arm = four_feet().arm
    q = angles(four_feet(), seed=7)
    values = measures(arm, q, 0.5)
    logs = LogMeasures(arm, PlacementLimits(condition=2.0, singular_ratio=2.0, jacobian_length=0.5))
    weights = np.array([0.7, -0.4])
    value, slope = logs.gradient(q[:3])
    assert value == pytest.approx(np.log(values[:3]))
    steps = 1e-6 * np.eye(6)
    assert slope == pytest.approx(differences(logs, q, steps)[0], rel=1e-5, abs=1e-6)
    bend = np.einsum("m,nkmj->nkj", weights, differences(logs, q, steps)[1])
    assert logs.hessian(q[:3], np.tile(weights, (3, 1))) == pytest.approx(bend, abs=1e-4 * np.abs(bend).max())
    limits = PlacementLimits(index="dm_2", index_min=0.2)
    logs, value = LogMeasures(arm, limits), index_of(arm, q, limits)
    assert logs.bounds == pytest.approx({"dm_2": -np.log(0.2)})
    found, slope = logs.gradient(q[:3])
    assert found[:, 0] == pytest.approx(-np.log(value[:3]))
    assert slope == pytest.approx(differences(logs, q, steps)[0], rel=1e-5, abs=1e-5)
    jacobian = np.diag([1.0, 2.0, 4.0])
    frobenius = np.linalg.norm(jacobian) * np.linalg.norm(np.linalg.inv(jacobian))
    s = np.linalg.svd(jacobian, compute_uv=False)
    assert np.sqrt(np.sum(s**2) * np.sum(1 / s**2)) == pytest.approx(frobenius)  # (4.34) by singular values
