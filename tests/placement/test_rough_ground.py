"""Criteria and limits of feet on uneven ground, against supports built by hand."""

import numpy as np
import pytest

from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve
from ocptip.contact.support import Support
from ocptip.placement.estimates import NOT_HELD, edge_moments, friction_shares
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.ground import Bump, HeightField, Wave
from ocptip.placement.limits.contact import LeastMoments, addable
from ocptip.placement.place import place
from ocptip.placement.problem import Weights
from ocptip.placement.search.physics import PatchPhysics
from ocptip.placement.search.starts import best_branches, exact_scores, sample
from ocptip.placement.terrain import plane, rough_ground
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver
from tests.placement.placement_scenes import drilling, four_feet, placed_robot, tripod
from tests.quick import some

FIELD = HeightField(Bump([-0.4, 0.3], 0.06, 0.25), Wave(0.03, 0.9, 0.4), slope=[0.03, -0.05])
ROUGH = HeightField(Wave(0.08, 0.8, 0.3), Wave(0.06, 0.7, 1.8))
MODES = {
    "tripod": (tripod, {}),
    "four legs": (four_feet, {"stroke": [0.0, 0.25]}),
    "four level legs": (four_feet, {"stroke": [0.0, 0.25], "attitude": "level"}),
}


def problem(mode, field=FIELD, **options):
    robot, own = MODES[mode]
    return drilling(robot(), terrain=rough_ground(field, **own), **options)


def reached(own, count, seed=0, samples=400):
    """Parameters (N, k) and angles (N, n) of candidates that reach the task."""
    found = sample(Evaluator(own), np.random.default_rng(seed), samples)
    chosen = np.unique(np.linspace(0, len(found) - 1, count).astype(int))
    return np.array([found.parameters[i] for i in chosen]), found.angles[chosen, 0]


def by_hand(own, stood, k, friction=None):
    """The support at candidate k: feet put on the ground by their world coordinates."""
    field, nominal = own.terrain[0].conforming.field, own.robot.support
    contacts = []
    for contact, place_ in zip(nominal.contacts, stood.contacts[k], strict=True):
        world = stood.origin[k] + stood.base[k] @ place_
        z, zx, zy = field.slopes(world[None, :2])[0]
        point = stood.base[k].T @ (np.array([*world[:2], z]) - stood.origin[k])
        normal = stood.base[k].T @ np.array([-zx, -zy, 1.0])
        mu = contact.friction if friction is None else friction
        contacts.append(UnilateralContact(position=point, normal=normal, friction=mu, facets=contact.facets))
    return Support(contacts, mass=nominal.mass, center_of_mass=nominal.center_of_mass)


@pytest.mark.slow
@pytest.mark.parametrize("slope", [(0.1, -0.06)])
def test_an_even_field_is_judged_like_a_plane(slope):
    even = drilling(tripod(), terrain=plane(slope, 0.05))
    uneven = drilling(tripod(), terrain=rough_ground(HeightField(height=0.05, slope=slope)))
    parameters, q = reached(even, 12)
    a, b = (Evaluator(own).task(0, 0, parameters, q) for own in (even, uneven))
    for name in ("GN", "GT", "GK", "GE", "torques", "wrenches", "moments"):
        assert getattr(b, name) == pytest.approx(getattr(a, name), abs=1e-9), name
    assert (a.standing == b.standing).all()
    for rows, others in zip(a.rows, b.rows, strict=True):
        assert others.margins == pytest.approx(rows.margins, abs=1e-7), rows.kind


@pytest.mark.parametrize("field", some(1, [ROUGH, FIELD]))
@pytest.mark.parametrize("mode", some(1, MODES))
def test_reserves_are_those_of_a_support_built_by_hand(mode, field):
    own = problem(mode, field)
    parameters, q = reached(own, 6)
    evaluator = Evaluator(own)
    found = evaluator.task(0, 0, parameters, q)
    quick = evaluator.task(0, 0, parameters, q, fast=True)
    reference = own.robot.tip_over.reference_moment
    for k in range(len(q)):
        support = by_hand(own, found, k)
        tip, slip = TipOver(support, reference), Slip(support)
        for c in range(len(found.cases)):
            state = solve(support, found.wrenches[k, c])
            assert found.standing[k, c] == state.states.persistent[0]
            if found.standing[k, c]:
                assert found.GN[k, c] == pytest.approx(tip.evaluate(state.states).GN[0], abs=1e-7)
                full = slip.evaluate(state.states, derivatives=False)
                assert found.GT[k, c] == pytest.approx(full.GT[0], abs=1e-6)
                assert quick.GT[k, c] >= full.slip_ratio[0] - 1e-6
                assert quick.GN[k, c] <= found.GN[k, c] + 1e-9  # as if friction lasted


def test_quick_estimates():
    """Forces in closed form for a plane; nothing holds what pulls a base up."""
    support = tripod().support
    places, frames = support.arms + support.center_of_mass, support.frames
    wrenches = np.array([[support.weight, [5, 3, -150, 2, 1, 0], [0, 0, 10.0, 0, 0, 0]]])
    shares = friction_shares(wrenches, places[None], frames[None], support)[0]
    states = [solve(support, w).states for w in wrenches[0]]
    exact = [Slip(support).evaluate(s, derivatives=False).slip_ratio[0] for s in states[:2]]
    assert shares[:2] == pytest.approx(exact, abs=2e-3)
    assert shares[2] == NOT_HELD
    tip = TipOver(support)
    pairs = np.array([axis.contacts for axis in tip.axes])
    moments = edge_moments(wrenches, places[None], pairs, support.center_of_mass)[0]
    assert moments[:2] == pytest.approx(np.concatenate([tip.evaluate(s).moments for s in states[:2]]))


@pytest.mark.slow
def test_moments_off_a_plane_depend_on_the_place_as_the_lagrangian_says():
    """Where friction ends before the base tips the moments are optima of cone programs."""
    own = drilling(tripod(0.4), terrain=rough_ground(ROUGH))
    parameters, q = reached(own, 40)
    work = Evaluator(own)
    found, stand, pairs, kinds = work.task(0, 0, parameters, q), own.stands[0], work.tip_over.pairs, set()

    physics = PatchPhysics(work, 0)
    placed = physics.functions[work.tip_over][0]
    for k in np.flatnonzero(found.standing.all(axis=1))[:8]:
        p, wrench, step = parameters[k], found.wrenches[k, 1], 1e-5
        at = addable(stand.footing(p).support, pairs, wrench[None])
        corner = np.tile(np.eye(6), (len(pairs), 1, 1))
        worst = LeastMoments(at.moments[0], at.slopes[0], corner, at.forces[0])
        slope = placed.slope(p, wrench, worst)
        ends = [
            [addable(stand.footing(p + s * e).support, pairs, wrench[None]).moments[0] for s in (step, -step)]
            for e in np.eye(3)
        ]
        numeric = np.array([(after - before) / (2 * step) for after, before in ends]).T
        assert slope == pytest.approx(numeric, abs=2e-3 * (1 + np.abs(numeric).max()))
        kinds |= set(np.isnan(at.forces[0, :, 0]).tolist())
    assert kinds == {True, False}  # both closed forms and cone programs


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["tripod", pytest.param("four level legs", marks=pytest.mark.slow)])
def test_placements_on_rough_ground_are_verified_by_hand(mode):
    own = problem(mode, weights=Weights(0.4, 0.4, 0.1, 0.1))
    best = place(own, starts=1, samples=1000).best
    assert best.feasible
    stood = own.stands[0].at(best.parameters)
    support = by_hand(own, stood, 0)
    found = Evaluator(own).task(0, 0, best.parameters[None], best.angles)
    state = solve(support, found.wrenches[0, 1]).states
    assert state.persistent[0]
    tip = TipOver(support, own.robot.tip_over.reference_moment)
    assert best.criteria["GN"] == pytest.approx(tip.evaluate(state).GN[0], abs=1e-7)
    assert best.criteria["GT"] == pytest.approx(
        Slip(support).evaluate(state, derivatives=False).GT[0], abs=1e-6
    )
    feet = best.to_dict()["feet"]
    world = np.array(feet["positions"])
    assert world[:, 2] == pytest.approx(FIELD.heights(world[:, :2]), abs=1e-9)
    assert ("strokes" in feet) == (mode != "tripod")
    for margin in best.margins:
        assert margin.kind != "stroke" or margin.relative >= -1e-6
    robot = placed_robot(best)
    for contact, other in zip(robot.support.contacts, support.contacts, strict=True):
        assert contact.position == pytest.approx(other.position, abs=1e-9)
        assert contact.normal == pytest.approx(other.normal, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("mode", some(1, ["tripod", "four legs"]))
def test_no_place_of_a_grid_is_better(mode):
    """Every place, angle, branch of a grid judged with contacts of its own."""
    own = problem(mode, weights=Weights(0.5, 0.5, 0.0, 0.0))
    best = place(own, starts=5, seed=1).best
    evaluator, rng = Evaluator(own), np.random.default_rng(3)
    low, high = own.terrain[0].box(own.tasks[0].position, own.reach)
    axes = [
        np.linspace(*ends, 25 if i < 2 else 24 if i == 2 else 3)
        for i, ends in enumerate(zip(low, high, strict=True))
    ]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    ground = np.min([np.min(r.margins, axis=1) for r in evaluator.ground(0, grid) if r.margins.size], axis=0)
    found = best_branches(evaluator, 0, grid[ground >= 0], ground[ground >= 0], rng)
    order = np.argsort(np.where(found.margins >= 0, found.totals, np.inf))[:2000]
    parameters, angles = np.array(found.parameters)[order], found.angles[order]
    totals, margins = exact_scores(evaluator, 0, parameters, angles, fast=True)
    near = np.argsort(np.where(margins >= -0.01, totals, np.inf))[:100]
    totals, margins = exact_scores(evaluator, 0, parameters[near], angles[near])
    assert np.sum(margins >= 0) > 20
    assert best.total <= np.min(totals[margins >= 0]) + 1e-6
