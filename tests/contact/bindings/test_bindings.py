"""Bindings against their physics, without the solver: which forces and motions their modes can express."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import linprog

from ocptip.basics.errors import InputError
from ocptip.contact.bindings import laws
from ocptip.contact.bindings.clamps import (
    ForceConstantHalfRigidClamp,
    ForceVariableHalfRigidClamp,
    ForceVariableTwoSidedClamp,
    RigidClamp,
)
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve
from ocptip.contact.support import Support
from tests.contact.contact_cases import (
    CLAMPS,
    KINDS,
    TWO_SIDED,
    binding,
    corners_of_polygon,
    kind_name,
    parameters,
    represents,
)

PLACES = [{"planar": True}, {"facets": 3}, {"facets": 8}]
every_kind = pytest.mark.parametrize("kind", KINDS, ids=kind_name)
every_place = pytest.mark.parametrize("place", PLACES, ids=str)


def subsets(contact, *, standing=None, redundant=False):
    """Index sets of a binding's modes; `standing` selects those without or with accelerations."""
    automaton, moves = contact.automaton, contact.columns.is_acceleration
    return [
        subset
        for subset, spare in zip(automaton.subsets, automaton.redundant, strict=True)
        if spare == redundant and (standing is None or standing == (not moves[subset].any()))
    ]


def limit_of(contact, normal_force):
    """Radius of the true cone at a normal force; negative outside the range: the pieces, read literally."""
    limits = [
        piece.radius + piece.slope * normal_force
        for piece in contact.force_pieces()
        if piece.normal_min <= normal_force <= piece.normal_max
    ]
    return max(limits, default=-1.0)


def reach(contact, tangential):
    """Radius of the smallest cross-section (as cone radius) that holds a tangential force."""
    if contact.planar:
        return np.max(np.abs(tangential))
    S = contact.facets
    c = np.cos(np.pi / S)
    angles = 2 * np.pi * np.arange(S) / S
    return np.max(np.column_stack([np.cos(angles), np.sin(angles)]) @ tangential) / (2 * c / (1 + c))


def stands(contact, force):
    """Whether some standing mode expresses a force with non-negative coefficients."""
    return any(
        represents(contact.columns, subset, contact.force_offset(), contact.auxiliary_rhs(), force)
        for subset in subsets(contact, standing=True)
    )


@every_kind
@every_place
def test_standing_modes_express_exactly_the_admissible_forces(kind, place):
    """Contains (3.56), (3.69), (A.5) and (A.11): the pieces are the source's regions in plain numbers."""
    contact = binding(kind, **place)
    rng = np.random.default_rng(7)
    seen = set()
    for _ in range(150):
        normal = rng.uniform(-500, 500)
        tangential = rng.normal(size=contact.dimension - 1)
        tangential *= rng.uniform(0, 300) / np.linalg.norm(tangential)
        excess = reach(contact, tangential) - limit_of(contact, normal)
        if abs(excess) < 1e-3:
            continue
        seen.add(excess < 0)
        assert stands(contact, np.r_[normal, tangential]) == (excess < 0), (normal, tangential)
    assert seen == {True, False}


@every_kind
@every_place
def test_corners_of_the_force_set_are_reached_and_nothing_beyond(kind, place):
    contact = binding(kind, **place)
    for piece in contact.force_pieces():
        low, high = max(piece.normal_min, -400.0), min(piece.normal_max, 400.0)
        for normal in np.linspace(low, high, 5)[1:-1]:
            for corner in corners_of_polygon(contact):
                limit = limit_of(contact, normal)
                assert stands(contact, np.r_[normal, 0.9999 * limit * corner])
                assert not stands(contact, np.r_[normal, 1.0001 * limit * corner])


@pytest.mark.parametrize("normal", [-300.0, -120.0, -60.0, 0.0, 200.0])
def test_half_rigid_force_variable_clamp_has_the_published_limit(normal):
    """Above -F both jaws rub: mu_u F + mu_o (F + K_n); below it the lower one alone: mu_u |K_n|."""
    contact = binding(ForceVariableHalfRigidClamp, planar=True)
    published = 0.4 * 120 + 0.7 * (120 + normal) if normal > -120 else 0.4 * -normal
    assert stands(contact, np.array([normal, 0.9999 * published]))
    assert not stands(contact, np.array([normal, 1.0001 * published]))


@pytest.mark.parametrize("normal", [-119.0, -60.0, 0.0, 200.0])
def test_half_rigid_force_constant_clamp_has_the_published_limit(normal):
    contact = binding(ForceConstantHalfRigidClamp, planar=True)
    published = 0.4 * 120 + 0.7 * (120 + normal)
    assert stands(contact, np.array([normal, 0.9999 * published]))
    assert not stands(contact, np.array([normal, 1.0001 * published]))
    assert not stands(contact, np.array([-121.0, 0.0]))


@pytest.mark.parametrize("kind", TWO_SIDED, ids=kind_name)
@pytest.mark.parametrize("share", [0.01, 0.5, 0.99])
def test_two_sided_clamps_have_the_published_limit_between_the_levels(kind, share):
    """(3.69), between -F_u = -(1 + i) F and F_o = (1 + 1/i) F."""
    contact = binding(kind, planar=True)
    i, F = 1.8, 120.0
    normal = -(1 + i) * F + share * (2 + i + 1 / i) * F
    published = (0.7 + 0.4) * F + (0.7 - i * 0.4) / (1 + i) * normal
    assert stands(contact, np.array([normal, 0.9999 * published]))
    assert not stands(contact, np.array([normal, 1.0001 * published]))


def test_upper_jaw_of_the_two_sided_clamp_has_its_own_friction_beyond_its_level():
    contact = binding(ForceVariableTwoSidedClamp, planar=True)
    for normal, limit in ((400.0, 0.7 * 400.0), (-400.0, 0.4 * 400.0)):
        assert stands(contact, np.array([normal, 0.9999 * limit]))
        assert not stands(contact, np.array([normal, 1.0001 * limit]))


@pytest.mark.parametrize("kind", CLAMPS[1:], ids=kind_name)
@every_place
def test_redundant_modes_can_never_be_non_negative(kind, place):
    """Their auxiliary rows alone have no non-negative solution."""
    contact = binding(kind, **place)
    for subset in subsets(contact, redundant=True):
        rows = contact.columns.auxiliary[:, subset]
        program = linprog(np.zeros(len(subset)), A_eq=rows, b_eq=contact.auxiliary_rhs())
        assert program.status == 2
    assert bool(subsets(contact, redundant=True)) == (kind is not ForceVariableTwoSidedClamp)


@every_kind
@every_place
def test_no_mode_is_a_rank_loss(kind, place):
    """Every subset, redundant or not, is a regular basis of a mass point on this contact."""
    contact = binding(kind, **place)
    c = contact.columns
    matrix = np.vstack([c.acceleration - c.force, c.auxiliary])
    for subset in contact.automaton.subsets:
        assert np.linalg.cond(matrix[:, subset]) < 1e4


def random_member(rng, contact, subset):
    """Random non-negative values of a mode's variables that satisfy its auxiliary rows."""
    rows, rhs = contact.columns.auxiliary[:, subset], contact.auxiliary_rhs()
    while True:
        values = rng.exponential(size=len(subset)) * 200 * (rng.random(len(subset)) < 0.8)
        if not rhs:
            return values
        place = rng.choice(np.flatnonzero(rows[0]))
        values[place] = 0.0
        values[place] = (rhs[0] - rows[0] @ values) / rows[0, place]
        if values[place] >= 0:
            return values


@every_kind
@every_place
def test_every_point_of_every_mode_obeys_the_contact_laws(kind, place):
    contact = binding(kind, **place)
    rng = np.random.default_rng(3)
    for subset in subsets(contact):
        for _ in range(4):
            values = random_member(rng, contact, subset)
            force = contact.columns.force[:, subset] @ values + contact.force_offset()
            acceleration = contact.columns.acceleration[:, subset] @ values
            assert laws.law_violation(contact, force[None], acceleration[None], 100.0, 1.0)[0] < 1e-12


@every_kind
@every_place
def test_every_sliding_or_yielding_contact_obeying_the_laws_has_a_mode(kind, place):
    """The other direction: whatever the laws allow, some mode can express."""
    contact = binding(kind, **place)
    rng = np.random.default_rng(4)
    low, high = laws.normal_range(contact)
    corners = corners_of_polygon(contact)
    for _ in range(60):
        direction = rng.normal(size=contact.dimension - 1)
        end = rng.choice(["low", "inside", "high"])
        if end == "low" and np.isfinite(low):
            normal, a_n = low, rng.uniform(0, 10)
        elif end == "high" and np.isfinite(high):
            normal, a_n = high, -rng.uniform(0, 10)
        else:
            normal, a_n = rng.uniform(max(low, -500), min(high, 500)), 0.0
        force = np.r_[normal, limit_of(contact, normal) * corners[np.argmin(corners @ direction)]]
        acceleration = np.r_[a_n, direction]
        assert any(
            represents(
                contact.columns,
                subset,
                contact.force_offset(),
                contact.auxiliary_rhs(),
                force,
                acceleration,
                tolerance=1e-8,
            )
            for subset in subsets(contact)
        ), (force, acceleration)


@every_kind
def test_planar_sliding_is_dissipative(kind):
    """k_1 points towards +t: the sign printed in the source's planar formula would drive the sliding."""
    contact = binding(kind, planar=True)
    names, columns = list(contact.columns.names), contact.columns
    for subset in subsets(contact, standing=False):
        members = {names[j] for j in subset}
        if {"g+", "g-"} & members:
            direction = 1.0 if "g+" in members else -1.0
            tangential = columns.force[1, subset]
            assert np.all(direction * tangential <= 0)
    assert columns.force[1, names.index("l1")] > 0


def test_planar_sliding_to_the_right_is_braked():
    """A block pushed to the right beyond its friction: the force on it points to the left."""
    block = Support([binding(UnilateralContact, planar=True)], mass=1.0)
    state = solve(block, [9.0, -10.0, 0.0])
    assert state.modes == ["slide"]
    np.testing.assert_allclose(state.forces, [[-6.0, 10.0]])
    assert state.acceleration[0] == pytest.approx(3.0)


@every_kind
@pytest.mark.parametrize("planar", [True, False])
def test_frames_are_orthonormal_with_the_normal_first(kind, planar):
    rng = np.random.default_rng(5)
    d = 2 if planar else 3
    for _ in range(20):
        normal = rng.normal(size=d)
        contact = binding(kind, planar=planar, normal=normal)
        np.testing.assert_allclose(contact.frame.T @ contact.frame, np.eye(d), atol=1e-14)
        np.testing.assert_allclose(contact.frame[:, 0], normal / np.linalg.norm(normal), atol=1e-14)
        assert planar or np.linalg.det(contact.frame) == pytest.approx(1.0)


@pytest.mark.parametrize("normal", np.vstack([np.eye(3), -np.eye(3)]).tolist(), ids=str)
def test_a_normal_along_any_axis_has_a_frame(normal):
    frame = binding(UnilateralContact, normal=normal).frame
    np.testing.assert_allclose(frame.T @ frame, np.eye(3), atol=1e-14)


def test_first_face_looks_along_the_given_tangent():
    contact = binding(UnilateralContact, tangent=[1.0, 2.0, 5.0])
    np.testing.assert_allclose(contact.frame[:, 1], np.array([1.0, 2.0, 0.0]) / np.sqrt(5.0))


BAD_NUMBERS = [float("nan"), float("inf"), -0.5, 0.0, True, "0.5", None, [0.5]]


@every_kind
@pytest.mark.parametrize("value", BAD_NUMBERS, ids=str)
def test_bad_physical_parameters_are_refused_by_name(kind, value):
    if kind is UnilateralContact and value == 0.0 and value is not False:
        value = 1e-7  # no friction is a contact, too; this little is none
    for name in parameters(kind):
        with pytest.raises(InputError, match=f"^{name}: "):
            binding(kind, **{name: value})


@pytest.mark.parametrize("planar", [True, False], ids=["planar", "spatial"])
def test_a_contact_without_friction_slides_or_separates(planar):
    contact = binding(UnilateralContact, planar=planar, friction=0)
    assert contact.automaton.closedness == "strong"
    assert set(contact.automaton.names) == {"slide", "separate"}
    up = np.eye(contact.dimension)[0]
    np.testing.assert_array_equal(contact.columns.force[:, ~contact.columns.is_acceleration], up[:, None])


BAD_PLACES = [
    ("position", [0.0, 0.0, float("nan")]),
    ("position", [0.0, 0.0, 0.0, 0.0]),
    ("position", [0.0]),
    ("position", [[0.0, 0.0, 0.0]]),
    ("position", 3.0),
    ("position", "here"),
    ("position", None),
    ("position", ["0", "0", "0"]),
    ("normal", [False, False, True]),
    ("normal", [0.0, 0.0, 0.0]),
    ("normal", [0.0, 1.0]),
    ("normal", [0.0, 0.0, float("inf")]),
    ("normal", [0.0, None, 1.0]),
    ("tangent", [0.0, 0.0, 2.0]),
    ("tangent", [0.0, 1.0]),
    ("tangent", [float("nan"), 0.0, 1.0]),
]


@pytest.mark.parametrize(("name", "value"), BAD_PLACES, ids=str)
def test_bad_places_are_refused_by_name(name, value):
    with pytest.raises(InputError, match=f"^{name}: "):
        binding(RigidClamp, **{name: value})


@every_kind
def test_parameters_cannot_be_changed_afterwards(kind):
    contact = binding(kind)
    with pytest.raises(dataclasses.FrozenInstanceError):
        contact.facets = 4


def test_missing_parameters_are_an_error():
    with pytest.raises(TypeError, match="clamp_force"):
        ForceConstantHalfRigidClamp(position=[0, 0, 0], friction_upper=0.5, friction_lower=0.5)
