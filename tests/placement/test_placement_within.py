"""Placements at the worst of a tolerance: wrenches of the evaluator, brute force, refusals."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from ocptip.contact.solver import solve_many
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.result import evaluate_placement
from ocptip.placement.search.starts import sample
from ocptip.placement.within import placement_within, rest_case, searched
from ocptip.reserves.slip import Slip
from ocptip.robots.payload import Payload
from ocptip.standing.tolerance import WORKSHOP, Uncertainty
from tests.placement.placement_scenes import drilling


@pytest.fixture(scope="module")
def placement():
    own = drilling()
    arm = own.robot.arm.with_payload(Payload.box(1.5, [0.1, 0.1, 0.2], [0.0, 0.0, 0.1]))
    own = replace(own, robot=own.robot.varied(arm=arm))
    evaluator = Evaluator(own)
    found = sample(evaluator, np.random.default_rng(0), 500)
    return evaluate_placement(evaluator, 0, found[0][1], found[0][2])


def test_wrenches_are_those_of_the_evaluator(placement):
    evaluator = Evaluator(placement.problem)
    for t, q in enumerate(placement.angles):
        found = evaluator.task(t, placement.patch, placement.parameters[None], q[None])
        for c, case in enumerate(found.cases):
            own = rest_case(placement, case, Uncertainty())
            nominal = own._wrenches([own._off(own.footing.support.gravity)])[0]
            np.testing.assert_allclose(nominal, found.wrenches[0, c], atol=1e-9)


@pytest.mark.slow
def test_nothing_inside_is_worse(placement):
    tolerance = Uncertainty(
        tilt=0.02,
        arm_mass=0.1,
        payload_mass=0.1,
        extra_mass=0.5,
        push=10.0,
        payload_center=(0.02, 0.01, 0.03),
    )
    found = placement_within(placement, tolerance)
    rng, worst = np.random.default_rng(1), 0.0
    for case in placement.problem.cases:
        own = rest_case(placement, case, tolerance)
        for _ in range(60):
            direction = rng.normal(size=6)
            (off,) = own._worst(
                direction[None], own.footing.support.gravity[None]
            )  # ends of everything in some direction
            states = solve_many(own.footing.support, own._wrenches([off]))
            worst = max(worst, float(Slip(own.footing.support).evaluate(states, derivatives=False).GT[0]))
    assert worst - 1e-9 <= found.GT


@pytest.mark.slow
def test_what_needs_a_motion_is_left_out_and_the_rest_is_named(placement):
    found = placement_within(placement, WORKSHOP)
    assert found.ignored == (
        "joints delayed by up to 10 ms",
        "3 % faster or slower",
        "acceleration steps overshoot at 5 % damping",
    )
    assert found.GN_worst.startswith(tuple(case.name for case in placement.problem.cases))
    assert "tilt 0.5 deg" in found.GN_worst
    assert searched(WORKSHOP).given == ("base_mass", "friction")
    heavy = placement_within(placement, Uncertainty(push=5000.0))
    assert not heavy.stands
    assert heavy.reason.startswith("push of 5e+03 N at the TCP alone is too much, possible is push of ")


def test_a_push_at_the_base_moves_with_its_centre(placement):
    tolerance = Uncertainty(center_of_mass=(0.02, 0.03, 0.05), base_push=60.0)
    own = rest_case(placement, placement.problem.cases[0], tolerance)
    gravity, mass = own.footing.support.gravity, own.footing.support.mass
    nominal = own._wrenches([own._off(gravity)])[0]
    rng = np.random.default_rng(2)
    for _ in range(20):
        a = rng.normal(size=6) * [1, 1, 1, 5, 5, 5]
        least = np.inf
        for signs in product((-1, 1), repeat=3):
            shift = np.array(signs) * tolerance.center_of_mass
            per_force = a[:3] + np.cross(a[3:], shift)
            push = -60.0 * per_force / np.linalg.norm(per_force)
            least = min(least, a @ nominal + a[3:] @ np.cross(shift, mass * gravity) + per_force @ push)
        found = own._wrenches(own._worst(a[None], gravity[None]))[0]
        assert a @ found == pytest.approx(least, rel=1e-12)
