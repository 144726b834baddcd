"""Compliant feet: normal forces of least elastic energy, and those of a simulation with soft contacts."""

import clarabel
import mujoco
import numpy as np
import pytest
import scipy.sparse
from hypothesis import example, given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.binding import TANGENTIAL_SHARE
from ocptip.contact.bindings.clamps import (
    ForceConstantHalfRigidClamp,
    ForceVariableHalfRigidClamp,
    RigidClamp,
)
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.bindings.wheel import FreeWheel
from ocptip.contact.solver import solve, solve_many
from ocptip.contact.support import Support
from ocptip.contact.verdict import stability
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver
from tests.quick import examples

CART = np.array([[0.3, 0.25, 0], [0.3, -0.25, 0], [-0.3, -0.25, 0], [-0.3, 0.25, 0]])


def standing(places, stiffness, center=(0.0, 0.0, 0.4), mass=40.0, friction=0.7, **options):
    """A base on compliant feet; stiffness for all, or one each."""
    each = np.broadcast_to(stiffness, len(places))
    feet = [
        UnilateralContact(position=p, friction=friction, stiffness=k, **options)
        for p, k in zip(places, each, strict=True)
    ]
    return Support(feet, mass=mass, center_of_mass=center)


def assert_least_energy(support, wrench, forces):
    """Normal forces (n,) on the floor z = 0 are those of least elastic energy: conditions of optimality.

    The energy is convex, so that forces in balance are least if compressions f / k are those of one plane
    that no lifted foot reaches into.
    """
    n, height = support.n_contacts, support.center_of_mass[2]
    W = np.vstack([np.ones(n), support.arms[:, 1], -support.arms[:, 0]])
    load = np.array([wrench[2], wrench[3] - height * wrench[1], wrench[4] + height * wrench[0]])
    scale = np.abs(wrench).max()
    np.testing.assert_allclose(W @ forces, -load, atol=1e-9 * scale)
    stiffness = np.array([c.stiffness for c in support.contacts])
    pressing = forces > 0
    assert np.all(forces >= 0)
    root = np.sqrt(stiffness[pressing])
    plane = np.linalg.lstsq(W[:, pressing].T * root[:, None], forces[pressing] / root)[0]
    assert pressing.sum() >= 3
    np.testing.assert_allclose(stiffness * (W.T @ plane) * pressing, forces, atol=1e-6 * scale)
    assert np.all((stiffness * (W.T @ plane))[~pressing] <= 1e-6 * scale)


def loads(rng, support, count):
    return support.weight + rng.normal(size=(count, 6)) * [40, 40, 100, 40, 40, 10]


@examples(30)
@example(348, 4)  # Newton's method ends on two feet there
@example(2786, 8)  # and interior-point methods come to no end
@given(st.integers(0, 10**6), st.integers(3, 9))
def test_normal_forces_have_the_least_energy(seed, n):
    rng = np.random.default_rng(seed)
    places = np.column_stack([rng.uniform(-0.5, 0.5, (n, 2)), np.zeros(n)])
    support = standing(places, 10 ** rng.uniform(4, 6, n), [*places[:, :2].mean(axis=0), 0.3])
    wrenches = loads(rng, support, 8)
    states = solve_many(support, wrenches)
    for i in np.flatnonzero(states.persistent):
        assert_least_energy(support, wrenches[i], states.contact_forces[i, :, 0])


def test_feet_do_lift_in_the_samples():
    """Else the programs above would say little."""
    rng = np.random.default_rng(3)
    support = standing(CART, 1e5)
    states = solve_many(support, loads(rng, support, 200))
    resting = states.select(np.flatnonzero(states.persistent))
    lifted = resting.contact_forces[:, :, 0] == 0
    assert len(resting) > 150
    assert 10 < lifted.any(axis=1).sum() < len(resting)
    assert np.all(resting.contact_forces[lifted] == 0)  # no friction where nothing presses


def test_forces_balance_and_their_maps_are_derivatives():
    rng = np.random.default_rng(4)
    support = standing(CART, [1e5, 3e5, 2e5, 1e6])
    wrenches = loads(rng, support, 50)
    states = solve_many(support, wrenches)
    rest = np.flatnonzero(states.persistent)
    flat = states.contact_forces.reshape(len(states), -1)
    assert np.allclose((flat @ support.wrench_matrix.T + wrenches)[rest], 0, atol=1e-9)
    for axis in range(6):
        ahead, behind = (solve_many(support, wrenches + s * 1e-4 * np.eye(6)[axis]) for s in (1, -1))
        slope = (ahead.contact_forces - behind.contact_forces) / 2e-4
        assert np.allclose(slope[rest], states.force_maps[rest, :, :, axis], atol=1e-6)


def test_three_feet_share_as_statics_says():
    rng = np.random.default_rng(5)
    triangle = CART[:3]
    soft, rigid = standing(triangle, 1e5, (0.1, -0.08, 0.4)), [
        UnilateralContact(position=p, friction=0.7) for p in triangle
    ]  # fmt: skip
    rigid = Support(rigid, mass=40.0, center_of_mass=(0.1, -0.08, 0.4))
    wrenches = rigid.weight + rng.normal(size=(30, 6)) * 10
    ours, theirs = solve_many(soft, wrenches), solve_many(rigid, wrenches)
    assert np.allclose(ours.contact_forces[:, :, 0], theirs.contact_forces[:, :, 0])
    GT = [Slip(s).evaluate(states).GT for s, states in ((soft, ours), (rigid, theirs))]
    assert np.allclose(*GT, atol=1e-6)


def test_reserves_of_four_feet_use_the_definite_normal_forces():
    """The tipping moments do not depend on the sharing; the slip reserve is that of the springs' forces."""
    rng = np.random.default_rng(6)
    soft = standing(CART, [1e5, 1e5, 1e5, 3e5])
    rigid = Support([UnilateralContact(position=p, friction=0.7) for p in CART], mass=40.0,
                    center_of_mass=(0, 0, 0.4))  # fmt: skip
    wrenches = rigid.weight + rng.normal(size=(30, 6)) * [40, 40, 60, 10, 10, 10]
    ours, theirs = solve_many(soft, wrenches), solve_many(rigid, wrenches)
    assert np.all(ours.persistent)
    assert np.allclose(*(TipOver(s).evaluate(x).GN for s, x in ((soft, ours), (rigid, theirs))))
    slip, full = Slip(soft), Slip(rigid)
    assert (slip.redistribution, full.redistribution) == ("tangential", "full")
    reserve, best = slip.evaluate(ours), full.evaluate(theirs)
    assert np.array_equal(reserve.normal_forces, ours.contact_forces[:, :, 0])
    assert np.all(reserve.GT >= best.GT - 1e-6)
    assert np.max(reserve.GT - best.GT) > 1e-3


def test_slope_of_the_slip_reserve():
    rng = np.random.default_rng(7)
    support = standing(CART, [1e5, 2e5, 1e5, 3e5])
    wrenches = support.weight + rng.normal(size=(12, 6)) * [60, 60, 60, 20, 20, 10]
    slip, states = Slip(support), solve_many(support, wrenches)
    gradient = slip.evaluate(states).gradient
    for axis in range(6):
        GT = [slip.evaluate(solve_many(support, wrenches + s * 1e-3 * np.eye(6)[axis])).GT for s in (1, -1)]
        assert np.allclose((GT[0] - GT[1]) / 2e-3, gradient[:, axis], atol=2e-5)


def test_a_cart_in_a_simulation_with_soft_contacts():
    """MuJoCo's contacts are springs of one stiffness at rest, if their impedance does not vary."""
    load, point = np.array([0.0, 0.0, -150.0]), np.array([0.12, 0.1, 0.4])
    balls = "".join(
        f'<geom type="sphere" size="0.02" pos="{x} {y} {0.02 - 0.4}" mass="0"/>' for x, y, _ in CART
    )
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="0.001" cone="elliptic"/>
      <default><geom friction="0.7" solref="-3e3 -90" solimp="0.9 0.9 0.001"/></default>
      <worldbody><geom type="plane" size="2 2 1"/><body pos="0 0 0.4"><freejoint/>
      <inertial pos="0 0 0" mass="40" diaginertia="4 4 4"/>{balls}</body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    data.xfrc_applied[1, :3], data.xfrc_applied[1, 3:] = load, np.cross(point - [0, 0, 0.4], load)
    for _ in range(4000):
        mujoco.mj_step(model, data)
    assert np.abs(data.qvel).max() < 1e-6
    found = np.zeros(4)
    for c in range(data.ncon):
        force = np.zeros(6)
        mujoco.mj_contactForce(model, data, c, force)
        found[np.argmin(np.linalg.norm(CART[:, :2] - data.contact[c].pos[:2], axis=1))] += force[0]
    support = standing(CART, 1e5)
    wrench = support.weight + np.concatenate([load, np.cross(point - [0, 0, 0.4], load)])
    ours = solve(support, wrench).contact_forces[:, 0]
    assert np.allclose(ours, found, atol=0.01 * ours.max())  # of the 394 N and 150 N that they bear
    assert ours.min() > 20
    assert ours.max() - ours.min() > 50


def test_castors_give_along_the_normal_only():
    support = standing(CART, 1e5, friction=0.0)
    assert np.all(support.elastic.stiffness == [1e5, 0, 0])
    assert np.allclose(solve(support, support.weight).forces, [0, 0, 40 * 9.81 / 4])


def test_defaults_are_what_is_said():
    foot = UnilateralContact(position=[0, 0, 0], friction=0.5, stiffness=3e5)
    assert np.allclose(foot.spring().stiffness, [3e5, TANGENTIAL_SHARE * 3e5, TANGENTIAL_SHARE * 3e5])
    assert (foot.spring().ratio, foot.spring().delay) == (0.05, 0.0)
    damped = UnilateralContact(position=[0, 0, 0], friction=0.5, stiffness=1e5, damping=200.0)
    assert (damped.spring().ratio, damped.spring().delay) == (0.0, 2e-3)


def test_a_base_that_moves_does_so_as_on_rigid_feet():
    support = standing(CART, 1e5)
    state = solve(support, support.weight + np.array([0, 0, 0, 0, 150.0, 0]))
    assert not state.persistent
    assert state.acceleration[4] > 0
    assert stability(support, support.weight).strong


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"stiffness": 0.0}, "stiffness: must be > 0"),
        ({"tangential_stiffness": 1e5}, "tangential_stiffness: needs stiffness"),
        ({"stiffness": 1e5, "damping": 10, "damping_ratio": 0.1}, "either damping or damping_ratio"),
        ({"stiffness": 1e5, "damping_ratio": 5}, "damping_ratio: must be below 1"),
        ({"stiffness": 1e5, "damping": -1}, "damping: must be >= 0"),
    ],
)
def test_what_cannot_be_is_refused(options, words):
    with pytest.raises(InputError, match=words):
        UnilateralContact(position=[0, 0, 0], friction=0.5, **options)


def test_feet_that_give_beside_rigid_contacts_are_refused():
    soft = [UnilateralContact(position=p, friction=0.5, stiffness=1e5) for p in CART[:3]]
    clamp = RigidClamp(position=CART[3], friction_upper=0.5, friction_lower=0.5)
    with pytest.raises(InputError, match=r"contact 4, a rigid-clamp, has none, others do; .* what they hold"):
        Support([*soft, clamp])
    with pytest.raises(InputError, match=r"contact 4, a unilateral, has none"):
        Support([*soft, UnilateralContact(position=CART[3], friction=0.5)])


def random_contact(rng, position, stiffness):
    """A foot or clamp."""
    jaws = {"position": position, "friction_upper": 0.5, "friction_lower": 0.3, "stiffness": stiffness}
    force = {"clamp_force": rng.uniform(10, 80)}
    return [
        lambda: UnilateralContact(position=position, friction=0.7, stiffness=stiffness),
        lambda: RigidClamp(**jaws),
        lambda: ForceConstantHalfRigidClamp(**jaws, **force),
        lambda: ForceVariableHalfRigidClamp(**jaws, **force),
    ][rng.integers(4)]()


def least_energy(stiffness, balance, load, lowest):
    """Normal forces of a quadratic program: least energy of springs in balance, none below its lowest."""
    bounded = np.isfinite(lowest)
    rows = scipy.sparse.csc_matrix(np.vstack([balance, -np.eye(len(lowest))[bounded]]))
    cones = [clarabel.ZeroConeT(3), clarabel.NonnegativeConeT(int(bounded.sum()))]
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.tol_gap_abs, settings.tol_gap_rel, settings.tol_feas = False, *3 * [1e-11]
    energy, none = scipy.sparse.csc_matrix(np.diag(1e5 / stiffness)), np.zeros(len(lowest))
    ends = np.concatenate([-load, -lowest[bounded]])
    solution = clarabel.DefaultSolver(energy, none, rows, ends, cones, settings).solve()
    return np.array(solution.x) if str(solution.status) == "Solved" else None


@pytest.mark.slow
def test_feet_beside_clamps_share_as_a_quadratic_program_says():
    """Clamps whose jaw yields let go at minus their preload, others never; some do in these samples."""
    rng, compared, let_go = np.random.default_rng(0), 0, 0
    for _ in range(60):
        n = rng.integers(4, 8)
        places = np.column_stack([rng.uniform(-0.5, 0.5, (n, 2)), np.zeros(n)])
        contacts = [random_contact(rng, p, 10 ** rng.uniform(4.5, 6)) for p in places]
        support = Support(contacts, mass=20.0, center_of_mass=[*places[:, :2].mean(axis=0), 0.3])
        wrenches = support.weight + rng.normal(size=(8, 6)) * [40, 40, 150, 60, 60, 10]
        elastic, W = support.elastic, np.vstack([np.ones(n), support.arms[:, 1], -support.arms[:, 0]])
        shared = elastic.share(wrenches)
        for i, w in enumerate(wrenches):
            load = np.array([w[2], w[3] - 0.3 * w[1], w[4] + 0.3 * w[0]])
            expected = least_energy(elastic.stiffness[:, 0], W, load, elastic.lowest)
            if expected is None:
                continue
            assert shared.balanced[i]
            np.testing.assert_allclose(shared.forces[i, :, 0], expected, atol=1e-4)
            compared, let_go = compared + 1, let_go + (not shared.pressing[i].all())
    assert compared > 200
    assert 50 < let_go < compared


def test_springs_of_contacts_that_are_no_feet():
    at = {"position": [0, 0, 0], "stiffness": 3e5, "damping": 60.0}
    jaws = {**at, "friction_upper": 0.5, "friction_lower": 0.3}
    assert RigidClamp(**jaws).spring().lowest == -np.inf
    clamp = ForceConstantHalfRigidClamp(**jaws, clamp_force=29.33).spring()
    assert (clamp.lowest, clamp.delay) == (-29.33, 2e-4)
    assert np.allclose(FreeWheel(**at, friction=0.5).spring().stiffness, [3e5, 0.0, TANGENTIAL_SHARE * 3e5])


def test_verdict_and_forces_beside_clamps_are_those_of_statics_where_that_decides():
    """Two feet and a clamp: whatever the stiffness, also where the clamp pulls."""
    rng, jaws = np.random.default_rng(8), {"friction_upper": 0.5, "friction_lower": 0.3, "clamp_force": 60.0}

    def held(stiffness):
        own = {"stiffness": stiffness}
        feet = [UnilateralContact(position=p, friction=0.7, **own) for p in CART[:2]]
        clamp = ForceConstantHalfRigidClamp(position=(-0.3, 0, 0), **jaws, **own)
        return Support([*feet, clamp], mass=20.0, center_of_mass=(0.28, 0, 0.2))

    soft, rigid = held(1e5), held(None)
    wrenches = rigid.weight + rng.normal(size=(40, 6)) * [5, 5, 60, 5, 12, 2]
    ours, theirs = solve_many(soft, wrenches), solve_many(rigid, wrenches)
    assert np.array_equal(ours.persistent, theirs.persistent)
    rest = ours.persistent
    assert rest.sum() > 10
    assert (theirs.contact_forces[rest, 2, 0] < -1).any()
    assert np.allclose(ours.contact_forces[rest, :, 0], theirs.contact_forces[rest, :, 0])
    GT = [Slip(s).evaluate(states.select(rest)).GT for s, states in ((soft, ours), (rigid, theirs))]
    assert np.allclose(*GT, atol=1e-6)
