"""Uncertain mass, centre of mass and friction of the base: nothing inside is worse than what is reported."""

from dataclasses import replace

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.contact.solver import solve
from ocptip.contact.support import Support
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.ground import HeightField, Wave
from ocptip.placement.place import place
from ocptip.placement.result import evaluate_placement
from ocptip.placement.search.starts import sample
from ocptip.placement.terrain import plane, rough_ground
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver
from ocptip.robots.dynamics import evaluate_dynamics
from ocptip.standing.tolerance import Uncertainty
from tests.placement.placement_scenes import clamped, drilling, tripod
from tests.quick import some

TOLERANCE = Uncertainty(base_mass=0.05, center_of_mass=[0.01, 0.015, 0.02], friction=0.2)
WAVES = HeightField(Wave(0.05, 0.8, 0.3), Wave(0.04, 0.7, 1.8))
PROBLEMS = {
    "four feet on an incline": lambda **more: drilling(tolerance=TOLERANCE, **more),
    "three feet": lambda **more: drilling(tripod(), tolerance=TOLERANCE, terrain=plane(), **more),
    "three feet on rough ground": lambda **more: drilling(
        tripod(), tolerance=TOLERANCE, terrain=rough_ground(WAVES), **more
    ),
    "clamped": lambda **more: drilling(clamped(), tolerance=TOLERANCE, **more),
}


def candidate(own):
    evaluator = Evaluator(own)
    found = sample(evaluator, np.random.default_rng(0), 500)
    return evaluator, found[0][1], found[0][2]


def reserves(own, p, q, case, mass, centre, friction):
    """GN and GT of a base with this mass, kg, centre of mass, m, and share of the friction, from scratch."""
    stood = own.stands[0].at(p)
    nominal, turn = own.robot.support, stood.base[0]
    contacts = []
    for contact, at, frame in zip(nominal.contacts, stood.contacts[0], stood.frames[0], strict=True):
        rates = {key: friction * value for key, value in vars(contact).items() if key.startswith("friction")}
        contacts.append(replace(contact, position=at, normal=frame[:, 0], tangent=frame[:, 1], **rates))
    support = Support(contacts, mass=mass, center_of_mass=centre)
    gravity = turn.T @ own.gravity
    arm = evaluate_dynamics(
        own.robot.arm, q, 0 * q, 0 * q, gravity=gravity, about=centre, force=turn.T @ case.force,
        moment=turn.T @ case.moment,
    )  # fmt: skip
    state = solve(support, arm.wrench[0] + np.r_[mass * gravity, 0, 0, 0]).states
    tip = TipOver(support, own.robot.tip_over.reference_moment)
    return tip.evaluate(state).GN[0], Slip(support).evaluate(state, derivatives=False).GT[0]


@pytest.mark.parametrize("name", some(1, PROBLEMS))
def test_nothing_inside_the_tolerance_is_worse_and_the_named_corner_attains_it(name):
    own = PROBLEMS[name]()
    evaluator, p, q = candidate(own)
    found = evaluator.task(0, 0, p[None], q)
    placed, rng = evaluate_placement(evaluator, 0, p, q), np.random.default_rng(1)
    nominal, case = own.robot.support, found.cases[1]
    corners = {corner.name: corner for corner in own.corners}
    worst = {m.kind: m for m in placed.margins if m.kind in ("GN", "GT") and case.name in m.name}
    values = [worst["GN"].value, worst["GT"].value]
    assert values == pytest.approx([found.GN[0, 1], found.GT[0, 1]])
    for _ in range(15):
        mass = nominal.mass * (1 + rng.uniform(-0.05, 0.05))
        shift = rng.uniform(-1, 1, 3) * TOLERANCE.center_of_mass
        inside = reserves(own, p, q, case, mass, nominal.center_of_mass + shift, rng.uniform(0.8, 1))
        assert (np.array(inside) <= np.array(values) + 1e-7).all()
    for kind, at in (("GN", 0), ("GT", 1)):
        corner = corners[worst[kind].worst]
        centre = nominal.center_of_mass + corner.shift
        assert reserves(own, p, q, case, corner.mass, centre, 0.8)[at] == pytest.approx(values[at], abs=1e-6)
    rough = evaluator.task(0, 0, p[None], q, contacts=False)
    assert rough.moments.min() == pytest.approx(found.moments.min(), rel=0.5)
    if name != "three feet on rough ground":
        assert rough.moments.min(axis=(2, 3)) == pytest.approx(found.moments.min(axis=(2, 3)))


@pytest.mark.slow
def test_placements_hold_at_every_corner():
    own = PROBLEMS["three feet"]()
    best = place(own, starts=1, samples=500).best
    assert best.feasible
    nominal = replace(own, tolerance=Uncertainty())
    assert evaluate_placement(Evaluator(nominal), 0, best.parameters, best.angles).total < best.total
    nominal, case = own.robot.support, own.cases[1]
    for corner in own.corners:
        centre = nominal.center_of_mass + corner.shift
        GN, GT = reserves(own, best.parameters, best.angles, case, corner.mass, centre, 0.8)
        assert best.criteria["GN"] + 1e-7 >= GN
        assert best.criteria["GT"] + 1e-6 >= GT
    margin = next(m for m in best.margins if m.kind == "GT")
    assert margin.worst.startswith("base mass -5 %, centre of mass ")
    assert margin.worst.endswith(", friction -20 %")
    assert f"({margin.worst})" in str(margin)
    assert best.to_dict()["margins"][0].keys() >= {"worst"}


def test_corners_without_influence_are_left_out():
    """Gravity is along the base's z axis on a horizontal floor, so that a shift in z changes nothing."""
    names = [corner.name for corner in PROBLEMS["three feet"]().corners]
    assert len(names) == len(set(names)) == 8
    assert not any("in z" in name for name in names)
    assert len(PROBLEMS["four feet on an incline"]().corners) == 16
    assert [c.name for c in drilling().corners] == [""]
    only = drilling(tolerance=Uncertainty(friction=0.1))
    assert [c.name for c in only.corners] == ["friction -10 %"]
    assert only.footing.support.contacts[0].friction == pytest.approx(0.45)


def test_an_interval_of_the_mass():
    own = drilling(tolerance=Uncertainty(base_mass=[14.0, 18.0]))
    assert [corner.mass for corner in own.corners] == [14.0, 18.0]
    assert [corner.name for corner in own.corners] == ["base mass -6.67 %", "base mass +20 %"]
    with pytest.raises(InputError, match=r"tolerance\.base_mass: 16 to 18 kg without the base's mass 15 kg"):
        drilling(tolerance=Uncertainty(base_mass=[16.0, 18.0]))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"base_mass": 1.0}, "base_mass: must be >= 0 and below 1, got 1.0"),
        ({"base_mass": [5.0, 4.0]}, "base_mass: expected 0 < minimum <= maximum mass"),
        ({"friction": -0.1}, "friction: must be >= 0 and below 1"),
        ({"center_of_mass": [0.1, -0.1, 0]}, "center_of_mass: half sides must be >= 0"),
        ({"center_of_mass": [0.1]}, "center_of_mass: expected shape"),
    ],
)
def test_broken_tolerances_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        Uncertainty(**options)
