"""The study of the free-form optimum, tiny: the collocated motion is a motion, and its figures are true."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ocptip.contact.solver import solve_many
from ocptip.published.cases import motion_case
from ocptip.published.tasks import experiment_robot
from studies.ramp_gap import run as ramp_gap
from studies.ramp_gap.free_form import NODES, FreeForm, tipping_moments
from studies.ramp_gap.free_motion import FreeMotion, minimum_jerk, via_motion
from studies.ramp_gap.search import Search, dense_check


@pytest.fixture(scope="module")
def task():
    """Case B, whose small triangle binds, on its effective base."""
    case = motion_case("B")
    return case, experiment_robot(case, "effective")


@pytest.fixture(scope="module")
def found(task):
    """The best motion of six intervals from minimum jerk, slip included, and its problem."""
    case, robot = task
    search = Search(robot, case.start, case.goal, active=frozenset({"slip"}))
    return search.from_guess(minimum_jerk(case.start, case.goal, 2.0, 6))


@pytest.mark.slow
def test_positions_integrate_from_accelerations_rest_to_rest(task, found):
    case, _ = task
    motion = found.motion
    times = np.linspace(0, motion.duration, 6 * 400 + 1)
    middles = (times[1:] + times[:-1]) / 2
    step = times[1]
    q, v, _ = motion.states(middles - step / 2)
    _, v_mid, a_mid = motion.states(middles)
    np.testing.assert_allclose(np.diff(v, axis=0), step * a_mid[:-1], atol=1e-9)
    np.testing.assert_allclose(np.diff(q, axis=0), step * v_mid[:-1], atol=1e-6)
    np.testing.assert_allclose(motion.angles[[0, -1]], [case.start, case.goal], atol=1e-8)
    np.testing.assert_array_equal(motion.speeds[[0, -1]], 0.0)
    x = np.array([0.0, 1.0])
    np.testing.assert_allclose(motion.inside(x)[0][:, 1], motion.angles[1:], atol=1e-7)


@pytest.mark.slow
def test_energy_is_that_of_the_library_and_below_the_reference(task, found):
    case, robot = task
    edges = np.linspace(0, found.motion.duration, 6001)
    q, v, a = found.motion.states((edges[1:] + edges[:-1]) / 2)
    torques, _ = robot.loads(q, v, a)
    energy = np.sum(robot.motors.power(torques, v)) * edges[1]
    assert found.energy == pytest.approx(energy, rel=1e-4)
    limits = robot.arm.limits
    assert found.energy < 0.9 * robot.energy(case.reference_motion(limits.speed, limits.acceleration))


@pytest.mark.slow
def test_limits_hold_at_nodes_and_in_between(task, found):
    _, robot = task
    nodes = [x.reshape(-1, 6) for x in found.motion.inside(NODES)]
    _, wrenches = robot.loads(*nodes)
    states = solve_many(robot.support, wrenches)
    assert robot.tip_over.evaluate(states).GN.max() < 0.9 + 1e-6
    assert robot.slip.evaluate(states, derivatives=False).GT.max() < 0.9 + 1e-6
    assert found.worst.kept
    assert found.worst == dense_check(robot, found.motion)
    assert max(found.worst.GN, found.worst.GT, found.worst.speed) > 0.85
    np.testing.assert_array_equal(found.motion.signs, found.signs)


def test_tipping_moments_are_linear(task):
    _, robot = task
    A, b = tipping_moments(robot)
    wrench = robot.support.weight * robot.mass / robot.support.mass + [3.0, -2, 5, 1, 2, -1]
    states = solve_many(robot.support, wrench[None])
    np.testing.assert_allclose(robot.tip_over.evaluate(states).moments[0], A @ wrench + b, atol=1e-9)


def test_clamped_base_is_refused():
    with pytest.raises(ValueError, match="unilateral"):
        tipping_moments(experiment_robot(motion_case("C"), "printed"))


def test_refined_motion_is_the_same():
    motion = via_motion(np.zeros(6), np.ones(6), 0.5 * np.arange(-3, 3), 1.7, 4)
    times = np.linspace(0, 1.7, 50)[:-1]
    for before, after in zip(motion.states(times), motion.refined().states(times), strict=True):
        np.testing.assert_allclose(after, before, atol=1e-12)


def test_turning_points():
    speeds = np.array(
        [[1.0, 0.0], [-1.0, 1.0], [0.0, 0.5]]
    )  # rad/s; joint 1 passes zero at 0.5 s, joint 2 never
    motion = FreeMotion(2.0, np.zeros((3, 2)), speeds, (speeds[1:] + speeds[:-1]) / 2)
    np.testing.assert_allclose(motion.turning_points(), [0.5])


@pytest.mark.slow
def test_passive_wrists_follow_their_ramp(task):
    case, robot = task
    problem = FreeForm(robot, case.start, case.goal, 4, passive=(3, 4, 5), iterations=60)
    motion, report = problem.solve(minimum_jerk(case.start, case.goal, 2.0, 4), eps=0.2)
    assert report["success"]
    ramp = case.reference_motion(robot.arm.limits.speed, robot.arm.limits.acceleration)
    ramp = ramp.time_scaled(motion.duration / ramp.end)
    ours, theirs = motion.states(times := np.linspace(0, motion.duration, 30)[:-1]), ramp.states(times)
    for x, y in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(x[:, 3:], y[:, 3:], atol=1e-5)


@pytest.mark.slow
def test_assembled_derivatives(task):
    """Jacobian and Hessian put together from the intervals', against central differences."""
    case, robot = task
    problem = FreeForm(robot, case.start, case.goal, 2, frozenset({"slip", "torque"}), passive=(4,))
    jacobian, hessian = (problem._solver.get_function(name) for name in ("nlp_jac_g", "nlp_hess_l"))
    gradient = problem._solver.get_function("nlp_grad_f")
    rng = np.random.default_rng(1)
    x, multipliers = rng.uniform(0.2, 0.8, jacobian.size1_in(0)), rng.normal(size=jacobian.size1_out(0))
    p = np.r_[np.tile([1.0, -1, 0, 0, 0, 0], 2), 0.3, 0.9, 0.8]
    J = np.array(jacobian(x, p)[1])
    H = np.array(hessian(x, p, 1.7, multipliers))
    H += np.triu(H, 1).T
    for k, step in enumerate(1e-5 * np.eye(len(x))):
        (g_up, J_up), (g_down, J_down) = jacobian(x + step, p), jacobian(x - step, p)
        np.testing.assert_allclose(J[:, k], np.array(g_up - g_down)[:, 0] / 2e-5, rtol=1e-5, atol=1e-5)
        rise = gradient(x + step, p)[-1] - gradient(x - step, p)[-1]
        slope = 1.7 * rise + (J_up - J_down).T @ multipliers
        np.testing.assert_allclose(H[:, k], np.array(slope)[:, 0] / 2e-5, rtol=1e-4, atol=1e-3)


@pytest.mark.slow
def test_study_writes_everything_and_goes_on(tmp_path, monkeypatch, capsys):
    case = motion_case("A")
    robot = experiment_robot(case, "printed")
    reference = case.reference_motion(robot.arm.limits.speed, robot.arm.limits.acceleration)
    plan = tmp_path / "plans" / "A-printed" / "plan.json"
    plan.parent.mkdir(parents=True)
    plan.write_text(json.dumps({**reference.to_dict(), "energy_J": robot.energy(reference)}))
    first = ramp_gap.starts_of
    monkeypatch.setattr(ramp_gap, "starts_of", lambda *a: dict(list(first(*a).items())[:1]))
    call = ["--out", str(tmp_path / "out"), "--plans", str(tmp_path / "plans"), "--cases", "A"]
    call += ["--grids", "4", "--randoms", "0", "--no-wrists"]
    assert ramp_gap.main(call) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert printed.out == (tmp_path / "out" / "ramp_gap.md").read_text()
    assert (tmp_path / "out" / "ramp_gap_A.png").read_bytes().startswith(b"\x89PNG")
    data = json.loads((tmp_path / "out" / "ramp_gap.json").read_text())
    with_plan, without = data["pairs"]
    assert with_plan["price"] == pytest.approx(robot.energy(reference) / with_plan["free"]["energy_J"] - 1)
    assert with_plan["price"] > 0
    assert with_plan["free"]["records"][0]["start"] == "ramp plan"
    assert without["price"] is None
    assert data["versions"]["numpy"] == np.__version__

    monkeypatch.setattr(ramp_gap, "run_pair", None)
    assert ramp_gap.main(call) == 0
    assert json.loads((tmp_path / "out" / "ramp_gap.json").read_text()) == data
    pairs = tmp_path / "out" / "ramp_gap_pairs"
    texts = {path: path.read_text() for path in pairs.iterdir()}
    kept = {path.name.split("-")[1]: json.loads(text) for path, text in texts.items()}
    monkeypatch.setattr(ramp_gap, "run_pair", lambda _, base, *__: {**kept[base], "ramp_plan_J": 1.0})
    assert ramp_gap.main([*call, "--seed", "1"]) == 0  # other options do not take the place of these
    assert {path: path.read_text() for path in texts} == texts
    monkeypatch.setattr(ramp_gap, "run_pair", None)
    monkeypatch.setattr(ramp_gap, "source_state", lambda *_: "new")
    assert ramp_gap.main(call) == 0
    assert "another state of the source code" in (tmp_path / "out" / "ramp_gap.md").read_text()

    plan.write_text(json.dumps({**reference.to_dict(), "energy_J": 100.0}))
    assert ramp_gap.main(call) == 1
    assert "energy_J is 100.0" in capsys.readouterr().err


@pytest.mark.parametrize(
    "options", [["--grids", "5"], ["--grids", "4", "6"], ["--cases", "C"], ["--plans", "no"]]
)
def test_bad_options_are_refused(options, tmp_path, capsys):
    with pytest.raises(SystemExit) as stopped:
        ramp_gap.main(["--out", str(tmp_path), *options])
    assert stopped.value.code == 2
    assert options[0] in capsys.readouterr().err
