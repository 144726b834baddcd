"""Stability verdicts: convex equilibrium, certificates, strong and weak stability."""

import numpy as np
import pytest
from scipy.optimize import linprog

from ocptip.basics.errors import InputError
from ocptip.contact.bindings import pyramid
from ocptip.contact.bindings.clamps import (
    ForceConstantHalfRigidClamp,
    ForceConstantTwoSidedClamp,
    ForceVariableHalfRigidClamp,
    ForceVariableTwoSidedClamp,
    RigidClamp,
)
from ocptip.contact.bindings.laws import normal_range
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve, solve_many
from ocptip.contact.support import Load, Support
from ocptip.contact.verdict import equilibrium, stability
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver
from tests.contact.contact_cases import (
    GRAVITY,
    KINDS,
    binding,
    disturbed_weight,
    feet,
    kind_name,
    parameters,
    platform_loads,
    polygon,
)
from tests.quick import some

WEIGHT = 60 * GRAVITY
CONVEX = (UnilateralContact, ForceConstantHalfRigidClamp, ForceConstantTwoSidedClamp)
RANK = {"none": 0, "weak": 1, "strong": 2}


def corner_base(kind, n=4, facets=6):
    contacts = [kind(position=p, facets=facets, **parameters(kind)) for p in polygon(n)]
    return Support(contacts, mass=60.0, center_of_mass=[0, 0, 0.6], inertia=[3, 4, 5])


def faces_of(contact):
    """(S, 2) outward face normals of the pyramid for a cone of radius 1."""
    angles = 2 * np.pi * np.arange(contact.facets) / contact.facets
    scale = pyramid.corrected_friction(1.0, contact.facets)
    return np.column_stack([np.cos(angles), np.sin(angles)]) / scale


def margin_by_linear_program(support, wrench):
    """Largest s with all pyramid faces and normal limits (of convex bindings) kept by s, from SciPy."""
    size = 3 * support.n_contacts + 1
    rows, rhs = [], []
    for k, contact in enumerate(support.contacts):
        (piece,) = contact.force_pieces()
        for face in faces_of(contact):
            row = np.zeros(size)
            row[3 * k : 3 * k + 3] = [-piece.slope, *face]
            rows.append(row)
            rhs.append(piece.radius)
        for sign, limit in ((-1.0, -piece.normal_min), (1.0, piece.normal_max)):
            if np.isfinite(limit):
                row = np.zeros(size)
                row[3 * k] = sign
                rows.append(row)
                rhs.append(limit)
    rows = np.array(rows)
    rows[:, -1] = 1.0
    balance = np.hstack([support.wrench_matrix, np.zeros((6, 1))])
    program = linprog(-np.eye(size)[-1], rows, rhs, balance, -wrench, bounds=(None, None))
    assert program.status == 0
    return -program.fun


# ------------------------------------------------------------------------------------------ equilibrium


@pytest.mark.parametrize("kind", CONVEX, ids=kind_name)
def test_margin_of_the_pyramids_is_that_of_a_linear_program(kind):
    support = corner_base(kind)
    for load in disturbed_weight(np.random.default_rng(0), support, 25, force=400.0):
        ours = equilibrium(support, load, cone=False)
        assert ours.margin == pytest.approx(margin_by_linear_program(support, load), abs=1e-4)
        assert ours.stands == (ours.margin > -1e-4)


@pytest.mark.parametrize("cone", [True, False], ids=["cone", "pyramid"])
@pytest.mark.parametrize("kind", KINDS, ids=kind_name)
def test_forces_of_the_margin_balance_the_load_and_keep_the_margin(kind, cone):
    support = corner_base(kind, n=3)
    for load in disturbed_weight(np.random.default_rng(1), support, 10):
        result = equilibrium(support, load, cone=cone)
        if not result.stands:
            continue
        np.testing.assert_allclose(support.wrench_matrix @ result.forces.ravel(), -load, atol=1e-4)
        for contact, force in zip(support.contacts, result.forces, strict=True):
            usage = np.linalg.norm(force[1:]) if cone else np.max(faces_of(contact) @ force[1:])
            low, high = normal_range(contact)
            spare = [
                min(p.radius + p.slope * force[0] - usage, force[0] - low, high - force[0])
                for p in contact.force_pieces()
                if p.normal_min - 1e-4 <= force[0] <= p.normal_max + 1e-4
            ]
            assert max(spare) >= result.margin - 1e-4


def test_pyramids_converge_to_the_cones():
    load = np.array([160.0, 90.0, -WEIGHT, 10.0, 20.0, 30.0])
    errors = []
    for facets in (8, 16, 64, 256):
        support = feet(polygon(4), facets=facets)
        cone, faces = (equilibrium(support, load, cone=c).margin for c in (True, False))
        assert cone < 30.0  # friction, not the normal forces, is what limits
        errors.append(abs(faces - cone) / WEIGHT)
        assert errors[-1] < pyramid.radius_error(facets)
    assert errors[-1] < 1e-4


def test_margin_of_a_symmetric_platform_is_known():
    """Each of four feet carries a quarter; s is left of its normal force, and mu s of its friction."""
    support = feet(polygon(4), friction=0.5)
    quarter = WEIGHT / 4
    assert equilibrium(support, support.weight).margin == pytest.approx(0.5 * quarter)
    steep = feet(polygon(4), friction=1.5)
    assert equilibrium(steep, steep.weight).margin == pytest.approx(quarter)


def test_margin_vanishes_at_the_slip_force():
    support = feet(polygon(4), friction=0.5)
    for share, sign in ((0.99, 1), (1.01, -1)):
        force = share * 0.5 * WEIGHT
        load = support.weight + np.array([force, 0, 0, 0, -0.6 * force, 0])  # at the height of the ground
        result = equilibrium(support, load)
        assert np.sign(result.margin) == sign
        assert result.stands == (sign > 0)


def test_margin_vanishes_at_the_tipping_moment():
    support = feet(polygon(4), friction=0.5)
    reach = 0.35 * np.cos(np.pi / 4)
    for share in (0.99, 1.01):
        load = support.weight + np.array([0, 0, 0, 0, share * reach * WEIGHT, 0])
        assert equilibrium(support, load).stands == (share < 1)


@pytest.mark.parametrize("normal", [-300.0, -120.0, -110.0, -60.0])
def test_margin_knows_no_limit_where_two_pieces_of_a_force_set_meet(normal):
    """A clamp at K_n = -F holds mu_u F tangentially: its distance to the limits is not zero."""
    clamp = binding(ForceVariableHalfRigidClamp)
    support = Support([clamp], mass=10.0)
    limit = 0.4 * 120 + 0.7 * (120 + normal) if normal > -120 else 0.4 * -normal
    load = np.array([0, 0, -normal, 0, 0, 0])
    assert equilibrium(support, load).margin == pytest.approx(limit, rel=1e-6)


def test_margin_is_the_largest_of_all_pieces():
    """At K_n = 0.99 F_o the middle piece's end is near, but its limit is not."""
    clamp = binding(ForceVariableTwoSidedClamp)
    support = Support([clamp], mass=10.0)
    for share in (0.9, 0.99, 1.01):
        normal = share * clamp.upper_force
        limit = max(
            p.radius + p.slope * normal
            for p in clamp.force_pieces()
            if p.normal_min <= normal <= p.normal_max
        )
        assert equilibrium(support, [0, 0, -normal, 0, 0, 0]).margin == pytest.approx(limit, rel=1e-6)


@pytest.mark.parametrize("cone", [True, False], ids=["cone", "pyramid"])
@pytest.mark.parametrize("kind", CONVEX, ids=kind_name)
def test_certificate_is_a_motion_on_which_the_load_outdoes_all_admissible_forces(kind, cone):
    """Its power exceeds minus the smallest power of the contact forces, their support function."""
    support = corner_base(kind)
    seen = 0
    for load in disturbed_weight(np.random.default_rng(2), support, 40, force=600.0, moment=300.0):
        result = equilibrium(support, load, cone=cone)
        if result.margin > -0.1:
            continue
        seen += 1
        velocities = (result.certificate @ support.wrench_matrix).reshape(-1, 3)
        most = 0.0  # most negative power of the contact forces on this motion, as a positive number
        for contact, v in zip(support.contacts, velocities, strict=True):
            (p,) = contact.force_pieces()
            reach = np.linalg.norm(v[1:])
            if not cone:
                corners = pyramid.edge_directions(contact.facets) * (1 + pyramid.radius_error(contact.facets))
                reach = np.max(-corners @ v[1:])
            # minimise v_n K_n - reach (radius + slope K_n) over the range of K_n
            slope = v[0] - reach * p.slope
            if np.isinf(p.normal_max):
                assert slope > -1e-6, "the power of the contact forces must be bounded from below"
                slope = max(slope, 0.0)
            at = p.normal_min if slope >= 0 else p.normal_max
            most -= slope * at - reach * p.radius
        assert result.certificate @ load > most + 1e-6
    assert seen > 3


def test_no_certificate_where_it_stands():
    support = feet(polygon(4))
    assert equilibrium(support, support.weight).certificate is None


def test_moment_that_no_contact_can_transmit_has_a_certificate():
    """Two feet transmit no moment about their line: the certificate is the turn about it."""
    support = feet([[-0.4, 0, 0], [0.4, 0, 0]])
    load = support.weight + np.array([0, 0, 0, 5.0, 0, 0])
    result = equilibrium(support, load)
    assert not result.stands
    assert result.margin == -np.inf
    velocities = result.certificate @ support.wrench_matrix
    np.testing.assert_allclose(velocities, 0.0, atol=1e-9)
    assert result.certificate @ load > 0


def test_equilibrium_of_one_contact():
    support = Support([binding(RigidClamp)], mass=1.0)
    assert equilibrium(support, [3.0, 0, -10.0, 0, 0, 0]).stands
    assert not equilibrium(support, [8.0, 0, -10.0, 0, 0, 0]).stands
    assert not equilibrium(support, [0, 0, -10.0, 1.0, 0, 0]).stands


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1e3, 1e6])
def test_margin_is_a_force(scale):
    support = feet(polygon(4))
    load = support.weight + np.array([100.0, 20.0, 0, 10.0, 0, 0])
    one, other = equilibrium(support, load), equilibrium(support, scale * load)
    assert other.stands == one.stands
    assert other.margin == pytest.approx(scale * one.margin, rel=1e-5)


def test_equilibrium_without_any_load():
    assert equilibrium(feet(polygon(4)), np.zeros(6)).stands


@pytest.mark.parametrize("function", [equilibrium, stability])
@pytest.mark.parametrize("wrench", [np.zeros(5), [0, 0, float("nan"), 0, 0, 0], "down"], ids=str)
def test_bad_wrenches_are_refused(function, wrench):
    with pytest.raises(InputError, match=r"^wrench: "):
        function(feet(polygon(3)), wrench)


# --------------------------------------------------------------------------------------- weak and strong


@pytest.mark.slow
def test_three_feet_on_a_plane_leave_no_doubt():
    """Pivoting, some solution stands, every solution stands: all three say the same."""
    seen = set()
    for facets in (4, 8):
        support = feet(polygon(3), facets=facets, friction=0.4)
        for load in platform_loads(np.random.default_rng(facets), 25):
            result = stability(support, load)
            assert result.decided
            assert result.strong == result.weak == result.state.persistent == result.pyramid.stands
            seen.add(result.verdict)
    assert seen == {"strong", "none"}


# Four feet, mu = 0.8, 8 facets: under the first load pivoting finds the motion, under the second the rest.
AMBIGUOUS = ([131.0, 86.0, -491.0, 46.0, 3.0, -62.0], [60.0, -118.0, -495.0, -8.0, 44.0, 53.0])


@pytest.mark.parametrize("load", AMBIGUOUS, ids=["moving one found first", "standing one found first"])
def test_four_feet_can_stand_and_slip_under_the_same_load(load):
    support = feet(polygon(4), facets=8, friction=0.8)
    result = stability(support, load)
    assert result.verdict == "weak"
    assert result.decided
    assert result.pyramid.margin > 1.0
    assert margin_by_linear_program(support, np.array(load)) > 1.0
    moving = result.counterexample
    assert not moving.persistent
    assert moving.states.law_violation()[0] < 1e-8
    assert moving.residual < 1e-9
    assert np.max(np.abs(moving.acceleration)) > 1e-2
    assert np.dot(moving.acceleration, load) > 0
    assert set(moving.modes) & {"slide", "separate"}


def jam(load_share, *, planar=False, friction=1.0):
    """A block of 10 kg between two walls that face each other."""
    d = 2 if planar else 3
    contacts = [
        UnilateralContact(position=np.eye(d)[0] * x, normal=-np.sign(x) * np.eye(d)[0], friction=friction)
        for x in (-0.3, 0.3)
    ]
    support = Support(contacts, mass=10.0)
    return support, load_share * support.weight


@pytest.mark.parametrize("planar", [True, False], ids=["planar", "spatial"])
@pytest.mark.parametrize("share", [1e-6, 1.0, 1e3])
def test_a_block_jammed_between_walls_may_hold_or_fall(planar, share):
    support, load = jam(share, planar=planar)
    result = stability(support, load)
    assert result.verdict == "weak"
    assert result.pyramid.stands
    falling = result.counterexample
    assert falling.states.law_violation()[0] < 1e-8
    assert falling.acceleration[support.dimension - 1] < 0


def test_without_load_nothing_moves_a_jammed_block():
    """No solution can have positive power of a load that is zero."""
    support, load = jam(0.0)
    assert stability(support, load).verdict == "strong"


@pytest.mark.slow
def test_verdicts_are_ordered():
    """Strong implies that pivoting stands, pivoting stands implies weak; none implies that it moves."""
    rng = np.random.default_rng(3)
    for kind in KINDS:
        support = corner_base(kind, n=3, facets=4)
        for load in disturbed_weight(rng, support, 3, force=300.0):
            result = stability(support, load, max_nodes=300)
            rank = RANK[result.verdict]
            assert rank < 2 or (result.state.persistent and result.pyramid.stands)
            assert rank > 0 or not (result.state.persistent or result.pyramid.stands)
            assert (result.counterexample is not None) == (rank == 1 and result.decided)
            if result.counterexample is not None:
                assert not result.counterexample.persistent
                assert result.counterexample.states.law_violation()[0] < 1e-8


@pytest.mark.slow
def test_a_persistent_state_always_means_weak_stability():
    """Standing forces found by pivoting lie in the pyramids: the convex test must see them too."""
    rng = np.random.default_rng(4)
    for kind in KINDS:
        support = corner_base(kind, n=3)
        states = solve_many(support, disturbed_weight(rng, support, 30, force=300.0))
        for i in np.flatnonzero(states.persistent):
            assert equilibrium(support, states.wrenches[i], cone=False).stands


def clamped_about_a_line():
    """Two clamps with 10 kN preload transmit no moment about the line through them."""
    contacts = [
        ForceConstantHalfRigidClamp(
            position=[x, 0, 0], friction_upper=0.5, friction_lower=0.5, clamp_force=1e4
        )
        for x in (-0.4, 0.4)
    ]
    return Support(contacts, mass=1.0)


def test_a_large_preload_does_not_hide_a_moment_that_nothing_balances():
    """0.5 mN m turn the base by 3 mrad/s^2: pivoting sees it, so must the verdict."""
    support = clamped_about_a_line()
    load = [0, 0, 0, 5e-4, 0, 0]
    result = stability(support, load)
    assert not result.state.persistent
    assert not result.pyramid.stands
    assert result.verdict == "none"


@pytest.mark.parametrize("moment", [1e-3, 5e-4, 1e-4, 1e-5, 1e-6])
def test_a_counterexample_never_stands(moment):
    result = stability(clamped_about_a_line(), [0, 0, 0, moment, 0, 0])
    assert result.counterexample is None or not result.counterexample.persistent


FOUR_FEET = [[0.3, 0.25, 0.0], [0.3, -0.25, 0.0], [-0.3, -0.25, 0.0], [-0.3, 0.25, 0.0]]
POWERS = [10.0**k for k in range(-6, 10)]


def cart(mass=40.0, inertia=(4.0, 3.5, 2.5), friction=0.9):
    return feet(
        FOUR_FEET, friction=friction, facets=12, mass=mass, inertia=inertia, center_of_mass=[0, 0, 0.5]
    )


def judged(support, force):
    """Verdict, modes, GN and GT under a horizontal push at the handle."""
    wrench = support.wrench(Load(force=force, point=[0.0, 0.0, 1.0]))
    verdict, states = stability(support, wrench), solve_many(support, wrench[None])
    assert verdict.decided
    reserves = TipOver(support).evaluate(states).GN[0], Slip(support, "full").evaluate(states).GT[0]
    return verdict.verdict, states.persistent[0], states.modes(0), reserves


@pytest.mark.parametrize(("push", "word"), some(1, [(100.0, "strong"), (260.0, "none")]))
def test_verdicts_do_not_depend_on_the_units_of_mass_and_force(push, word):
    *first, reserves = judged(cart(), [push, 0, 0])
    assert first[0] == word
    for factor in POWERS:
        *same, scaled = judged(cart(40.0 * factor, factor * np.array([4.0, 3.5, 2.5])), [push * factor, 0, 0])
        assert same == first, factor
        assert scaled == pytest.approx(reserves, rel=1e-6), factor


@pytest.mark.slow
@pytest.mark.parametrize(("push", "word"), [(100.0, "strong"), (260.0, "none")])
def test_verdicts_do_not_depend_on_the_inertia(push, word):
    *first, reserves = judged(cart(), [push, 0, 0])
    assert first[0] == word
    for factor in POWERS:
        *same, other = judged(cart(inertia=factor * np.array([4.0, 3.5, 2.5])), [push, 0, 0])
        assert same == first, factor
        if word == "strong":  # forces of a base that moves depend on how it moves
            assert other == pytest.approx(reserves, rel=1e-6), factor


@pytest.mark.parametrize("mass", [1e6, 1e7, 1e8, 1e9, 1e12])
def test_a_heavy_base_of_small_inertia_stands_for_sure(mass):
    assert judged(cart(mass), [260.0, 0, 0])[:3] == ("strong", True, ["stick"] * 4)


def test_large_friction_is_refused_and_below_it_the_work_is_bounded():
    support = cart(4000.0, friction=1e3)
    verdict = stability(support, support.wrench(Load(force=[260.0, 0, 0], point=[0, 0, 1.0])), max_nodes=200)
    assert verdict.state.persistent
    assert verdict.nodes <= 200
    with pytest.raises(InputError, match=r"^friction: must be <= 1000"):
        cart(friction=1e8)


@pytest.mark.parametrize("function", [solve, equilibrium, stability])
def test_huge_wrenches_are_refused(function):
    with pytest.raises(InputError, match=r"^wrench: magnitudes above"):
        function(cart(), [1e308] * 6)


def test_undecided_is_called_weak_and_says_so():
    support = feet(polygon(4), facets=8)
    result = stability(support, support.weight, max_nodes=0)
    assert (result.verdict, result.decided, result.strong) == ("weak", False, False)
    assert result.counterexample is None
    assert "not decided" in result.explanation


def test_explanations_are_sentences():
    support = feet(polygon(4))
    for load, words in (
        (support.weight, "Every solution"),
        ([0, 0, 10.0, 0, 0, 0], "No admissible contact forces"),
    ):
        result = stability(support, load)
        assert words in result.explanation
        assert result.explanation.endswith(".")
        assert result.to_dict()["verdict"] == result.verdict


def test_a_load_between_pyramid_and_cone_is_named():
    """Along an edge the pyramid reaches farther than the cone."""
    support = feet(polygon(4), facets=4)
    force = 1.05 * 0.5 * WEIGHT * np.array([1.0, 1.0]) / np.sqrt(2)
    load = support.weight + np.r_[force, 0, np.cross([0, 0, -0.6], [*force, 0])]
    result = stability(support, load)
    assert result.pyramid.stands
    assert not result.cone.stands
    assert "between friction pyramid and cone" in result.explanation


def test_a_rigid_clamp_beside_the_feet_makes_the_base_stand_under_a_pull():
    contacts = [UnilateralContact(position=p, friction=0.5) for p in polygon(4)]
    load = np.array([0, 0, 100.0, 0, 0, 0])
    free = Support(contacts, mass=60.0, center_of_mass=[0, 0, 0.6])
    held = Support(
        [*contacts, RigidClamp(position=[0, 0, 0], friction_upper=0.5, friction_lower=0.5)],
        mass=60.0,
        center_of_mass=[0, 0, 0.6],
    )
    assert stability(free, load).verdict == "none"
    assert stability(held, load).weak
    assert solve(held, load).persistent
