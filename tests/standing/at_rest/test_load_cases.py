"""Load cases at rest against statics by hand, and against each other."""

from dataclasses import replace

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve_many
from ocptip.published.tasks import experiment_task
from ocptip.reserves.slip import Slip
from ocptip.standing.at_rest.load_cases import (
    LoadCaseGrid,
    RestLoads,
    largest_payload,
    load_cases,
    tilt_by_direction,
)
from ocptip.task_files.option_files import load_asked

TASK = experiment_task("A")
ROBOT, POSE = TASK.robot, TASK.start


def centre_of_mass():
    """Of base and arm, from the base's centre of mass, by the moments of gravity along two axes."""
    per = RestLoads(ROBOT, POSE[None]).per_gravity[0]
    mass = per[0, 0]
    return mass, np.array([-per[4, 2], per[3, 2], per[4, 0]]) / mass


def test_weight_and_moments_are_those_of_the_robots_loads():
    loads, still = RestLoads(ROBOT, POSE[None]), np.zeros((1, ROBOT.n))
    assert np.allclose(
        loads.wrenches(ROBOT.support.gravity), ROBOT.loads(POSE[None], still, still)[1], atol=1e-9
    )
    assert centre_of_mass()[0] == pytest.approx(ROBOT.mass)


def test_tilt_at_which_it_tips_or_slips_is_that_of_statics():
    sides, tilts = tilt_by_direction(ROBOT, POSE, 24)
    _, centre = centre_of_mass()
    feet = np.array([c.position for c in ROBOT.support.contacts]) - ROBOT.support.center_of_mass
    slips = np.arctan(ROBOT.support.contacts[0].friction)
    for side, tilt in zip(sides, tilts, strict=True):
        tips = np.inf
        for a, b in ((0, 1), (1, 2), (2, 0)):
            along = feet[b] - feet[a]
            out = np.array([along[1], -along[0], 0.0]) / np.linalg.norm(along[:2])
            out = out * np.sign(out @ (feet[a] - feet[:, :3].mean(axis=0)))
            across, height = out @ (feet[a] - centre), centre[2] - feet[a][2]
            if out @ side > 0:
                tips = min(tips, np.arctan2(across, height * (out @ side)))
        facets = 1e-4 if tips < 0.95 * slips else 0.04  # sliding begins where the pyramid ends
        assert tilt == pytest.approx(min(tips, slips), rel=facets)


def test_payload_is_where_the_gripper_tips_the_base():
    held = largest_payload(ROBOT, np.array([POSE, TASK.goal]))
    loads = RestLoads(ROBOT, POSE[None])
    for factor, stands in ((0.999, True), (1.001, False)):
        states = solve_many(ROBOT.support, loads.wrenches(ROBOT.support.gravity, factor * held[0]))
        assert bool(states.persistent[0]) == stands
    assert held[1] > 0


def test_cases_are_all_combinations_and_the_worst_direction_is_worst():
    asked = LoadCaseGrid({"start": POSE}, payloads=(0.0, 1.0), tilts=(0.0, 0.02), pushes=(0.0, 10.0))
    cases = load_cases(ROBOT, asked)
    assert len(cases) == 8
    assert cases[0].stands
    rng = np.random.default_rng(1)
    loads, worst = RestLoads(ROBOT, POSE[None]), cases[-1]
    g = ROBOT.support.gravity
    for _ in range(50):
        turn, push = rng.uniform(0, 2 * np.pi), rng.normal(size=3)
        tilt = np.linalg.norm(g) * np.array(
            [np.cos(turn) * np.sin(0.02), np.sin(turn) * np.sin(0.02), -np.cos(0.02)]
        )
        wrench = loads.wrenches(tilt, 1.0, 10 * push / np.linalg.norm(push))
        state = solve_many(ROBOT.support, wrench)
        assert ROBOT.slip.evaluate(state, derivatives=False).GT[0] <= 1.02 * worst.GT


def test_a_file_says_which_cases(tmp_path):
    file = tmp_path / "cases.toml"
    file.write_text(
        "tilt_deg = [2]\npush_N = [5, 6]\n[[pose]]\nname = 'up'\nangles_deg = [0, 10, 0, 0, 0, 0]\n"
    )
    asked = load_asked(file, ROBOT.arm, {"start": POSE})
    assert list(asked.poses) == ["start", "up"]
    assert asked.poses["up"][1] == pytest.approx(np.radians(10))
    assert (asked.tilts, asked.pushes) == ((pytest.approx(np.radians(2)),), (5.0, 6.0))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("tilt_deg = [-1]", "tilt_deg: expected numbers >= 0"),
        ("push_N = []", "at least one"),
        ("pushN = [1]", "did you mean 'push_N'"),
        ("[[pose]]\nname = 'x'", "angles_deg: missing"),
        ("[[pose]]\nname = 'x'\nangles_deg = [1, 2]", r"pose\[1\].angles_deg"),
    ],
)
def test_bad_files_are_refused_by_name(tmp_path, text, words):
    file = tmp_path / "cases.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=words):
        load_asked(file, ROBOT.arm, {})


@pytest.mark.slow
@pytest.mark.parametrize("corners", [3, *(pytest.param(n, marks=pytest.mark.slow) for n in (4, 5))])
def test_what_half_spaces_prove_need_not_be_solved(corners, monkeypatch):
    turns = 2 * np.pi * np.arange(corners) / corners + 0.1
    feet = [
        UnilateralContact(position=[0.4 * np.cos(t), 0.3 * np.sin(t), -0.1], friction=0.3 + 0.05 * k)
        for k, t in enumerate(turns)
    ]
    robot = ROBOT.varied(support=ROBOT.support.varied(feet))
    asked = LoadCaseGrid({"start": POSE}, payloads=(0.0,), tilts=(0.05,), pushes=(15.0, 60.0))

    def found():
        tilts, payloads = tilt_by_direction(robot, POSE)[1], largest_payload(robot, POSE[None])
        rows = load_cases(robot, asked)
        values = [[row.GN, row.GT, row.least_force] for row in rows]
        return [replace(row, GN=0.0, GT=0.0, least_force=0.0) for row in rows], values, tilts, payloads

    quick = found()
    monkeypatch.setattr(Slip, "half_spaces", lambda *_: None)
    all_of_them = found()
    assert quick[0] == all_of_them[0]
    for some, every in zip(quick[1:], all_of_them[1:], strict=True):
        np.testing.assert_allclose(some, every, rtol=1e-9)
    assert {case.stands for case in quick[0]} == {True, False}


@pytest.mark.parametrize("friction", [0.35, 0.8])
def test_no_direction_of_a_push_is_worse_than_the_reported_one(friction):
    """A wheel that carries little slips first under pushes between the horizontal and 45 degrees."""
    feet = [replace(c, friction=friction) for c in ROBOT.support.contacts]
    robot = ROBOT.varied(support=ROBOT.support.varied(feet))
    push, rng = 3.0, np.random.default_rng(3)
    (case,) = load_cases(robot, LoadCaseGrid({"start": POSE}, (0.0,), (0.0,), (push,)))
    anywhere = rng.normal(size=(2000, 3))
    anywhere /= np.linalg.norm(anywhere, axis=1)[:, None]
    loads = RestLoads(robot, POSE[None])
    resting = loads.wrenches(robot.support.gravity)
    states = robot.contact_states(resting + np.vstack([loads.at_tool(push * d) for d in anywhere]))
    used = robot.slip.evaluate(states, derivatives=False).GT
    assert used.max() * (1 - 1e-3) <= case.GT
    assert robot.tip_over.evaluate(states).GN.max() * (1 - 1e-3) <= case.GN
