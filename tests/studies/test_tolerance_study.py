"""The study of tolerances, tiny: samples deviate as they should, and the table says what rows hold."""

import casadi as cs
import numpy as np
import pytest

from ocptip.published.tasks import experiment_task
from ocptip.standing.tolerance import SITE, WORKSHOP
from ocptip.standing.within.worst_case import worst_case_of
from ocptip.trajectories.trajectory import Trajectory
from studies.tolerance.floor import markdown as floor_table
from studies.tolerance.floor import moments_in, worst_worlds
from studies.tolerance.run import at_rest, figure, markdown, on_cart, parts
from studies.tolerance.samples import lost, random_deviations


def straight(task, factor):
    limits = task.robot.limits
    rates = limits.speed / factor, limits.acceleration / factor**2
    return Trajectory.ending_together(task.start, task.goal, [None] * task.robot.n, *rates)


def test_deviations_stay_within_the_tolerance():
    robot = experiment_task("B", "effective").robot
    own = worst_case_of(robot, SITE).deviations
    theta = random_deviations(own, np.random.default_rng(0), 500)
    intervals = own.intervals
    assert np.all(theta[:, intervals] >= own.low[intervals] - 1e-15)
    assert np.all(theta[:, intervals] <= own.high[intervals] + 1e-15)
    gravity = robot.support.gravity + theta[:, own.places["gravity"]]
    assert np.linalg.norm(gravity, axis=1) == pytest.approx(np.linalg.norm(robot.support.gravity))
    angles = np.degrees(
        np.arccos(gravity @ robot.support.gravity / np.linalg.norm(robot.support.gravity) ** 2)
    )
    assert angles == pytest.approx(1.5)
    assert np.linalg.norm(theta[:, own.places["push"]], axis=1) == pytest.approx(20)


def test_fast_motions_lose_contacts_and_slow_ones_on_a_heavy_cart_do_not():
    task, rng = experiment_task("B", "effective"), np.random.default_rng(1)
    assert lost(task.robot, straight(task, 1.0), WORKSHOP, rng, 300) > 0
    cart = on_cart("A")
    assert len(cart.robot.support.contacts) == 4
    assert lost(cart.robot, straight(cart, 4.0), WORKSHOP, rng, 300) == 0


def test_the_table_has_prices_of_all_and_of_the_parts_and_refusals(tmp_path):
    rows = [
        {
            "task": task,
            "preset": "workshop",
            "part": part,
            "energy_J": energy,
            "duration_s": 1.0,
            "cpu_s": 10.0,
        }
        for task, part, energy in (
            ("A", "none", 100.0),
            ("A", "all", 104.0),
            ("A", "tilt", 101.0),
            ("H", "none", 9.0),
        )
    ]
    rows[1] |= {"duration_s": 1.1, "cpu_s": 15.0}
    rows.append({"task": "H", "preset": "workshop", "part": "all", "refused": "too much", "cpu_s": 1.0})
    rows.append({"task": "A", "preset": "workshop", "part": "rest", "described_Nm": 3.0, "within_Nm": 1.26})
    feet = [{"stiffness": 1e5, "force_N": 0.0, "lift_mm": None, "falls": True}]
    feet += [{"stiffness": 1e6, "force_N": 0.0, "lift_mm": 0.0312, "falls": False}]
    rows.append({**rows[1], "part": "ramps", "energy_J": 107.0, "rise_s": 0.0, "feet": feet})
    rows[1]["rise_s"] = 0.05
    text = markdown(rows, ["- A note."])
    money = "| A | workshop | 100.0 | 104.0 | 1.000 | 1.100 | 4.0 % | 10.0 % | 50 ms | 7.0 % | 10.0 | 1.50 |"
    assert money in text
    assert "| H | workshop | 9.0 | - | 1.000 | - | - | - | - | - | 10.0 | - |" in text
    assert "| A | - | falls | - | 0.031 | - | - |" in text
    assert "| A | - | - | 1.0 % | - | - | - | - | - | - | 4.0 % |" in text
    assert "- H: too much" in text
    assert "| A | 3.00 | 1.26 | 42 % |" in text
    assert "`workshop`, 1 tasks: median price in energy 4.0 %, median ratio of CPU time 1.50." in text
    assert "- A note." in text
    figure(rows, tmp_path / "prices.png")
    assert (tmp_path / "prices.png").read_bytes().startswith(b"\x89PNG")


def test_parts_are_those_of_the_tolerance():
    found = parts("workshop")
    assert "push" not in found
    assert found["tilt"].given == ("tilt",)
    assert set(found["all but both"].given) == set(WORKSHOP.given) - {"delay", "damping"}
    assert found["none"].given == ()


def test_what_is_left_at_rest():
    """B with the effective base: more than half of what holds it at rest may be missing in a workshop."""
    found = at_rest(experiment_task("B", "effective"), WORKSHOP)
    assert found["described_Nm"] == pytest.approx(3.0, abs=0.05)
    assert 0 < found["within_Nm"] < 0.5 * found["described_Nm"]


def test_worlds_of_the_floor_are_the_worst_of_their_axes():
    """The moments that free-form motions keep are those of the exact check."""
    task = experiment_task("B", "effective")
    cases = worst_case_of(task.robot, WORKSHOP)
    rng = np.random.default_rng(2)
    s = np.hstack([np.array([task.start, task.goal, task.start]), rng.normal(size=(3, 12))])
    worlds, short = worst_worlds(cases, s)
    assert [axis for axis, _ in worlds] == list(range(cases.axes))
    every = cases.all_moments(s)
    assert short == pytest.approx(every.min())
    state = cs.SX.sym("s", 18)
    moments = cs.Function("moments", [state], [moments_in(cases, worlds, state)])
    found = np.array([moments(one) for one in s])[:, :, 0]
    np.testing.assert_allclose(found.min(axis=0), every.min(axis=0), rtol=1e-9)
    assert np.all(found > every - 1e-9)


def test_the_table_of_the_floor():
    steps = [
        {"energies_J": [101.0, 101.1], "worlds": 3, "slip_worlds": 1, "short_Nm": -0.7, "GT": 1.7},
        {"energies_J": [103.0], "worlds": 6, "slip_worlds": 3, "short_Nm": -0.1, "GT": 1.002},
    ]
    row = {
        "task": "C",
        "nominal_J": 100.0,
        "within_J": 109.0,
        "free_J": 98.0,
        "even_J": 106.0,
        "steps": steps,
    }
    text = floor_table([row], ["- A note."])
    assert (
        "| C | 100.0 | 98.0 | 103.0 | 3.0 % | 5.1 % | 6.0 % | 9.0 % | 2, 0.10 % | 6, 3 | -0.10 | 1.002 |"
        in text
    )
