import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.clamps import RigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.resting import solve_resting
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Load, Support
from ocptip.reserves import fractional, minimax
from ocptip.reserves.minimax import ConeBatch
from ocptip.reserves.optimality import lengths
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver
from studies.contact.random_supports import random_support, random_wrenches
from tests.quick import examples, some
from tests.reserves.reserve_scenes import (
    CLAMPS,
    FRICTION,
    GRAVITY,
    HEIGHT,
    MASS,
    clamp,
    clamped,
    corners,
    differences,
    feet,
    relative_errors,
    wrenches,
)

MODES = ("tangential", "full")


def pyramid_error(facets):
    """Largest relative error of the pyramid's radius (2.84)."""
    return (1 - np.cos(np.pi / facets)) / (1 + np.cos(np.pi / facets))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("n", [3, 4, 6])
@pytest.mark.parametrize("degrees", [3.0, 15.0, 25.0])
def test_block_on_a_slope(mode, n, degrees):
    angle = np.radians(degrees)
    gravity = GRAVITY * np.array([np.sin(angle), 0, -np.cos(angle)])
    support = feet(corners(n), center=(0, 0, 0.1), gravity=gravity)
    reserve = Slip(support, mode).evaluate(solve_many(support, [support.weight]))
    assert reserve.solved[0]
    assert reserve.GT[0] == pytest.approx(np.tan(angle) / FRICTION, rel=1e-9)
    np.testing.assert_allclose(reserve.usage[reserve.normal_forces > 1], reserve.GT[0], rtol=1e-6)


@pytest.mark.parametrize("mode", MODES)
def test_no_states_have_no_reserves(mode):
    support = feet(corners(4))
    states = solve_many(support, np.empty((0, 6)))
    reserve = Slip(support, mode).evaluate(states)
    assert reserve.GT.shape == (0,)
    assert reserve.gradient.shape == (0, 6)
    assert TipOver(support).evaluate(states).GN.shape == (0,)


@pytest.mark.parametrize("mode", MODES)
def test_weight_alone_needs_no_friction(mode):
    support = feet(corners(4))
    reserve = Slip(support, mode).evaluate(solve_many(support, [support.weight]))
    assert reserve.GT[0] == pytest.approx(0, abs=1e-9)
    np.testing.assert_array_equal(reserve.gradient, np.zeros((1, 6)))


def test_slipping_adds_the_acceleration():
    support = feet(corners(3))
    states = solve_many(support, [support.wrench([Load(force=(450.0, 0, 0), point=(0, 0, 0.1))])])
    assert states.modes(0) == ["slide"] * 3
    reserve = Slip(support).evaluate(states)
    assert reserve.slip_ratio[0] == pytest.approx(1.0, abs=pyramid_error(12) + 1e-9)
    expected = np.max(lengths(states.contact_accelerations[0, :, 1:]))
    assert reserve.slide_acceleration[0] == pytest.approx(expected)
    assert reserve.GT[0] > 1.5
    full = Slip(support, "full").evaluate(states)
    assert full.GT[0] == pytest.approx(reserve.GT[0])


@pytest.mark.parametrize("mode", MODES)
def test_free_flight(mode):
    support = feet(corners(3))
    reserve = Slip(support, mode).evaluate(solve_many(support, [-support.weight]))
    assert reserve.GT[0] == 0
    assert reserve.status == ("no loaded contact",)
    assert np.all(np.isnan(reserve.usage))


def test_unsolved_states_are_nan_and_say_so():
    support = feet(corners(3))
    states = solve_many(support, [support.weight, support.weight])
    spoilt = type(states)(
        support=support,
        **{name: getattr(states, name).copy() for name in states.__dataclass_fields__ if name != "support"},
    )
    spoilt.solved[1], spoilt.basic[1], spoilt.subsets[1], spoilt.status_codes[1] = False, np.nan, -1, 1
    for mode in MODES:
        reserve = Slip(support, mode).evaluate(spoilt)
        assert np.isfinite(reserve.GT[0])
        assert np.isnan(reserve.GT[1])
        assert np.all(np.isnan(reserve.gradient[1]))
        assert list(reserve.solved) == [True, False]
        assert reserve.status[1].startswith("no contact state")
    assert np.isnan(TipOver(support).evaluate(spoilt).GN[1])
    assert np.all(np.isnan(TipOver(support).evaluate(spoilt).gradient[1]))


@pytest.mark.parametrize("mode", MODES)
def test_a_failing_solver_gives_an_upper_bound_that_says_so(mode, monkeypatch):
    def hopeless(self, A, b):
        return (
            np.full((len(A), A.shape[2]), np.nan),
            np.full(b.shape, np.nan),
            np.full(len(A), "NumericalError"),
        )

    support = feet(corners(4))
    at = wrenches(np.random.default_rng(0), support, 4, force=30, moment=10)
    states = solve_many(support, at)
    honest = Slip(support, mode).evaluate(states)
    monkeypatch.setattr(ConeBatch, "solve", hopeless)
    monkeypatch.setattr(minimax, "planar_forces", lambda q, J, limits: (q + np.nan, q + np.nan))
    nothing = lambda A, fixed, growing: (fixed[:, 0] + np.nan, A[..., 0] + np.nan, fixed + np.nan)  # noqa: E731
    monkeypatch.setattr(fractional, "largest_growth", nothing)
    reserve = Slip(support, mode).evaluate(states)
    assert not np.any(reserve.solved)
    assert all("NumericalError" in status for status in reserve.status)
    assert np.all(reserve.GT >= honest.GT)


def test_inputs():
    support = feet(corners(3))
    with pytest.raises(InputError, match="redistribution"):
        Slip(support, "normal")
    with pytest.raises(InputError, match="another support"):
        Slip(support).evaluate(solve_many(feet(corners(3)), [support.weight]))
    reserve = Slip(support).evaluate(solve_many(support, [support.weight]), derivatives=False)
    assert reserve.gradient is None


SUPPORTS = {
    **{f"{n} feet": lambda n=n: feet(corners(n, turn=0.1)) for n in (3, 4, 6)},
    "4 feet in space": lambda: feet(np.column_stack([corners(4)[:, :2], [0, 0.1, 0, -0.1]])),
    **{kind.kind: lambda kind=kind: clamped(kind) for kind in CLAMPS},
    "planar": lambda: random_support(np.random.default_rng(5), clamps=False, planar=True, n=3),
}


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", some(3, SUPPORTS))
def test_gradients_against_central_differences(name, mode):
    support = SUPPORTS[name]()
    at = wrenches(np.random.default_rng(1), support, 40)
    slip = Slip(support, mode)
    reserve = slip.evaluate(solve_many(support, at, warm_start=False))
    assert np.all(reserve.solved)
    reference, same = differences(support, at, lambda s: slip.evaluate(s, derivatives=False).GT)
    errors = relative_errors(reserve.gradient, reference)[same]
    assert len(errors) > 10
    assert np.quantile(errors, 0.9) < 1e-6  # the others are near a change of the active contacts
    assert np.max(errors) < 1e-3


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", some(4, SUPPORTS))
def test_forces_hold_the_base_with_the_usage_that_is_reported(name, mode):
    support = SUPPORTS[name]()
    states = solve_many(support, wrenches(np.random.default_rng(2), support, 40))
    reserve = Slip(support, mode).evaluate(states)
    assert np.max(reserve.residual) < 1e-7
    forces = np.concatenate([reserve.normal_forces[:, :, None], reserve.tangential_forces], axis=2)
    resultant = forces.reshape(len(states), -1) @ support.wrench_matrix.T
    motion = states.acceleration @ np.linalg.inv(support.inverse_mass)
    np.testing.assert_allclose(motion, states.wrenches + resultant, atol=1e-6)
    np.testing.assert_allclose(np.nanmax(reserve.usage, axis=1), reserve.slip_ratio, rtol=1e-7, atol=1e-9)
    if mode == "tangential":
        np.testing.assert_array_equal(reserve.normal_forces, states.contact_forces[:, :, 0])


def standing_with(support, wrench, usage, sides=180):
    """Whether forces within `usage` times the friction polygons hold the base (linear program)."""
    n = support.n_contacts
    angles = 2 * np.pi * np.arange(sides) / sides
    rows = np.zeros((n * sides, 3 * n))
    for i in range(n):
        rows[i * sides : (i + 1) * sides, 3 * i] = -usage * FRICTION
        rows[i * sides : (i + 1) * sides, 3 * i + 1] = np.cos(angles)
        rows[i * sides : (i + 1) * sides, 3 * i + 2] = np.sin(angles)
    bounds = [(0, None), (None, None), (None, None)] * n
    result = linprog(
        np.zeros(3 * n), A_ub=rows, b_ub=np.zeros(len(rows)),
        A_eq=support.wrench_matrix, b_eq=-wrench, bounds=bounds,
    )  # fmt: skip
    return result.status == 0


@pytest.mark.parametrize("n", [4, 6])
def test_full_redistribution_against_linear_programs(n):
    support = feet(corners(n, turn=0.2))
    at = wrenches(np.random.default_rng(n), support, 12, force=60, moment=25)
    states = solve_many(support, at)
    reserve = Slip(support, "full").evaluate(states)
    checked = np.flatnonzero(states.persistent)
    assert len(checked) > 5
    for s in checked:
        assert standing_with(support, at[s], reserve.GT[s] * 1.0001)
        assert not standing_with(support, at[s], reserve.GT[s] * (np.cos(np.pi / 180) - 1e-4))


def test_full_on_four_feet_is_better_than_tangential():
    support = feet(corners(4))
    states = solve_many(support, wrenches(np.random.default_rng(0), support, 60, force=60, moment=25))
    tangential, full = (Slip(support, mode).evaluate(states) for mode in MODES)
    assert np.all(full.GT <= tangential.GT + 1e-12)
    assert np.min(full.GT / tangential.GT) < 0.9


def test_three_feet_have_nothing_to_redistribute_in_full():
    support = feet(corners(3))
    states = solve_many(support, wrenches(np.random.default_rng(0), support, 60))
    tangential, full = (Slip(support, mode).evaluate(states) for mode in MODES)
    np.testing.assert_allclose(full.GT, tangential.GT, rtol=1e-7)


def test_a_preloaded_clamp_without_force_takes_part():
    contacts = [clamp(kind, p) for kind, p in zip(CLAMPS[1:4], corners(3), strict=True)]
    support = Support(contacts, mass=MASS, center_of_mass=(0, 0, HEIGHT), gravity=(0, 0, 0))
    states = solve_many(support, [[20.0, 0, 0, 0, -20 * HEIGHT, 0]])
    reserve = Slip(support).evaluate(states)
    assert np.all(np.isfinite(reserve.usage))
    assert 0 < reserve.GT[0] < 0.2


def test_contacts_that_squeeze_each_other_say_so():
    contacts = [
        UnilateralContact(position=(x, y, z), normal=(-np.sign(x), 0, 0), friction=0.4)
        for x in (-0.3, 0.3)
        for y, z in ((-0.2, 0.0), (0.2, 0.0), (0.0, 0.3))
    ]
    support = Support(contacts, mass=10.0, center_of_mass=(0.25, 0, 0.1))
    states = solve_many(support, [support.wrench([Load(force=(600.0, 0, 0), point=(0.25, 0, 0.1))])])
    assert states.persistent[0]
    tangential, full = (Slip(support, mode).evaluate(states) for mode in MODES)
    assert tangential.status == ("solved",)
    assert "squeeze" in full.status[0]
    assert full.GT[0] < 0.2 * tangential.GT[0]


@examples(60)
@given(seed=st.integers(0, 10**6))
def test_persistent_means_both_reserves_below_one_on_three_feet(seed):
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi / 3, 3) + 2 * np.pi / 3 * np.arange(3))
    places = 0.4 * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(3)])
    support = feet(places, facets=16, friction=float(rng.uniform(0.1, 1.0)))
    states = solve_many(support, wrenches(rng, support, 30))
    worst = np.maximum(Slip(support).evaluate(states, False).GT, TipOver(support).evaluate(states).GN)
    clear = np.abs(worst - 1) > pyramid_error(16)
    np.testing.assert_array_equal((worst < 1)[clear], states.persistent[clear])


@pytest.mark.slow
@examples(50)
@given(seed=st.integers(0, 10**6))
def test_any_support(seed):
    rng = np.random.default_rng(seed)
    support = random_support(rng, planar=rng.random() < 0.3)
    states = solve_many(support, random_wrenches(rng, support, 5))
    tangential, full = (Slip(support, mode).evaluate(states) for mode in MODES)
    np.testing.assert_array_equal(tangential.solved, states.solved)
    ok = states.solved
    assert np.all(full.slip_ratio[ok] <= tangential.slip_ratio[ok] * (1 + 1e-9))
    assert np.all(np.isfinite(tangential.gradient[ok]))
    assert np.all(np.isfinite(full.gradient[ok]))
    for s in np.flatnonzero(ok):
        assert full.solved[s] == full.status[s].startswith(("solved", "no loaded contact"))
    S = max(contact.facets for contact in support.contacts)
    smallest = min(contact.facets for contact in support.contacts)
    outer = 1.0 if S == 2 else (1 + pyramid_error(smallest)) + 1e-6
    assert np.all(tangential.GT[states.persistent] <= outer * (1 + 1e-6))


@examples(20)
@given(seed=st.integers(0, 10**6), mode=st.sampled_from(MODES))
def test_rotating_the_base_axes_changes_nothing(seed, mode):
    rng = np.random.default_rng(seed)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    R = R * np.sign(np.linalg.det(R))
    places = corners(4, turn=rng.uniform(0, 1))
    plain = feet(places)
    turned = Support(
        [
            UnilateralContact(position=R @ p, normal=R[:, 2], tangent=R[:, 0], friction=FRICTION, facets=12)
            for p in places
        ],
        mass=MASS,
        center_of_mass=R @ [0, 0, HEIGHT],
        inertia=R @ np.diag([3.0, 4.0, 5.0]) @ R.T,
        gravity=R @ [0, 0, -GRAVITY],
    )
    at = wrenches(rng, plain, 4, force=60, moment=20)
    rotated = np.hstack([at[:, :3] @ R.T, at[:, 3:] @ R.T])
    first, second = solve_many(plain, at), solve_many(turned, rotated)
    a, b = Slip(plain, mode).evaluate(first), Slip(turned, mode).evaluate(second)
    alike = np.max(np.abs(first.contact_forces - second.contact_forces), axis=(1, 2)) < 1e-6
    compared = alike | (mode == "full") & first.persistent & second.persistent
    np.testing.assert_allclose(a.slip_ratio[compared], b.slip_ratio[compared], rtol=1e-6)


def test_six_feet_in_few_groups(monkeypatch):
    """Problems of one size share one program, whatever contacts are loaded."""
    built = []
    original = ConeBatch.__init__

    def counted(self, *arguments, **options):
        built.append(1)
        original(self, *arguments, **options)

    monkeypatch.setattr(minimax.ConeBatch, "__init__", counted)
    support = feet(corners(6))
    states = solve_many(support, wrenches(np.random.default_rng(0), support, 200))
    assert np.all(Slip(support).evaluate(states).solved)
    assert len(built) <= 8


def test_rigid_clamps_stay_in_the_piece_of_their_normal_force():
    support = Support([clamp(RigidClamp, p) for p in corners(4)], mass=MASS, center_of_mass=(0, 0, HEIGHT))
    states = solve_many(support, wrenches(np.random.default_rng(4), support, 30))
    reserve = Slip(support, "full").evaluate(states)
    before = states.contact_forces[:, :, 0]
    both = np.abs(before) > 1e-6
    assert np.all(reserve.normal_forces[both] * before[both] >= -1e-6)


@pytest.mark.parametrize("mode", MODES)
def test_a_castor_uses_no_friction_and_the_wheels_all_of_it(mode):
    places, friction = [[0.3, -0.2, 0], [0.3, 0.2, 0], [-0.3, 0, 0]], [0.5, 0.5, 0]
    contacts = [UnilateralContact(position=p, friction=mu) for p, mu in zip(places, friction, strict=True)]
    support = Support(contacts, mass=40.0, center_of_mass=[0, 0, 0.3])
    states = solve_many(support, [support.wrench(Load(force=[60.0, 0, 0], point=[0, 0, 0]))])
    reserve = Slip(support, mode).evaluate(states)
    assert states.persistent[0]
    assert reserve.solved[0]
    np.testing.assert_allclose(reserve.tangential_forces[0, 2], 0.0, atol=1e-9)
    assert reserve.usage[0, 2] == 0.0
    assert reserve.GT[0] == pytest.approx(60.0 / (0.5 * 40 * GRAVITY / 2), rel=1e-6)


@pytest.mark.parametrize("mode", MODES)
def test_a_cart_on_castors_alone_slips_under_any_push(mode):
    support = Support(
        [UnilateralContact(position=p, friction=0) for p in corners(4)], mass=40.0, center_of_mass=[0, 0, 0.3]
    )
    slip = Slip(support, mode)
    states = solve_many(support, [support.weight, support.weight + np.array([1e-3, 0, 0, 0, 0, 0])])
    np.testing.assert_array_equal(states.persistent, [True, False])
    reserve = slip.evaluate(states)
    assert reserve.GT[0] == 0.0
    assert reserve.GT[1] > 1.0
    assert reserve.GT[1] == pytest.approx(1.0 + reserve.slide_acceleration[1])


def test_a_state_whose_forces_are_all_but_optimal_is_certified():
    """Along a path of a cart's loads, whose contact states start from each other's."""
    corners = [[0.25, 0.2, 0], [0.25, -0.2, 0], [-0.25, -0.2, 0], [-0.25, 0.2, 0]]
    feet = [UnilateralContact(position=corner, friction=0.6) for corner in corners]
    support = Support(feet, mass=35.0, center_of_mass=[0, 0, 0.3])
    rng = np.random.default_rng(0)
    first = np.array([30, 5, -508, -3, 52, 0.1]) * (1 + 0.2 * rng.normal(size=6))
    way = np.array([1, -30, 1, 60, 2, -1]) * rng.normal(size=6) * 0.3
    states = solve_many(support, first + np.linspace(0, 1, 4000)[:310, None] * way)
    assert Slip(support).evaluate(states).solved.all()  # the 309th had a gap of 1.6e-7


@examples(15)
@given(seed=st.integers(0, 10**6), n=st.integers(4, 6))
def test_tiny_friction_is_certified(seed, n):
    """Friction and the loads in its plane times the same factor give the same reserve."""
    rng = np.random.default_rng(seed)
    turn, friction = 2 * np.pi * np.arange(n) / n, rng.uniform(0.2, 0.9, n)
    push, turning = rng.normal(size=2) * 60, rng.normal() * 15
    reserves = []
    for factor in (1.0, 1e-3, 1e-5, 5e-6):
        contacts = [
            UnilateralContact(position=[0.4 * np.cos(a), 0.4 * np.sin(a), 0.0], friction=factor * mu)
            for a, mu in zip(turn, friction, strict=True)
        ]
        support = Support(contacts, mass=60.0, center_of_mass=[0.03, 0.02, 0.3])
        load = Load(force=[*factor * push, 0.0], point=[0, 0, 0], moment=[0, 0, factor * turning])
        states = solve_many(support, support.wrench(load)[None])
        reserve = Slip(support, "full").evaluate(states)
        if states.persistent[0]:
            assert reserve.solved[0], reserve.status
            reserves.append(reserve.GT[0])
            assert np.all(reserve.usage[0][np.isfinite(reserve.usage[0])] <= reserve.GT[0] * (1 + 1e-6))
    np.testing.assert_allclose(reserves, reserves[:1] * len(reserves), rtol=1e-5)


def test_optima_are_found_only_where_they_decide(monkeypatch):
    """A bound below a level, or well below the maximum, spares the cone programs; the maximum is exact."""
    support = feet(corners(4))
    at = wrenches(np.random.default_rng(4), support, 400, force=15, moment=3)
    slip, states = Slip(support), solve_resting(support, at)
    assert slip.redistribution == "full"
    true = slip.evaluate(states, derivatives=False).GT
    programs = []
    solve = ConeBatch.solve
    monkeypatch.setattr(ConeBatch, "solve", lambda self, A, b: programs.append(len(A)) or solve(self, A, b))
    found = slip.evaluate(states, derivatives=False, only_maximum=True)
    GT = found.GT
    assert sum(programs) < 100
    assert np.argmax(GT) == np.argmax(true)
    assert np.max(GT) == pytest.approx(np.max(true), abs=1e-9)
    near = true > 0.95 * min(1.0, np.max(true))
    np.testing.assert_allclose(GT[near], true[near], atol=1e-9)
    assert np.all(true - 1e-9 <= GT)
    assert np.all(GT[~near] <= 0.95 * np.max(true) + 1e-9)
    assert found.solved.all()
    forces = found.forces.reshape(len(states), -1)
    np.testing.assert_allclose(forces @ support.wrench_matrix.T, -states.wrenches, atol=1e-6)
    programs.clear()
    level = float(np.quantile(true, 0.9))
    GT = slip.evaluate(states, derivatives=False, least=level).GT
    assert sum(programs) < 400
    np.testing.assert_array_equal(level < GT, true > level)
    above = true > level
    np.testing.assert_allclose(GT[above], true[above], atol=1e-9)
