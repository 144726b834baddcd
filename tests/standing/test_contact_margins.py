"""Foot forces, moments left, zero-moment points and friction used, against geometry, GN, GT, samples."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from ocptip.contact.bindings.clamps import ForceConstantHalfRigidClamp, RigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Support
from ocptip.contact.verdict import equilibrium, stability
from ocptip.motion.check import check_motion
from ocptip.motion.files.output import sample_motion
from ocptip.published.tasks import experiment_task
from ocptip.reserves.equal_compliance import equal_normal_map
from ocptip.reserves.tipping import TipOver
from ocptip.standing.contact_margins import ContactMargins, Margin
from ocptip.standing.footing import Footing
from ocptip.standing.instants import Instants, Loaded
from tests.contact.test_resting import four_feet


@pytest.fixture(scope="module")
def case():
    return experiment_task("A", "effective")


@given(st.integers(0, 10**6), st.integers(3, 6))
def test_zero_moment_point_lies_that_far_inside_the_hull(seed, count):
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, count)) + np.arange(count)
    feet = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(count)]) * rng.uniform(
        0.4, 1, (count, 1)
    )
    hull, c = ConvexHull(feet[:, :2]), np.array([*feet[:, :2].mean(axis=0), 0.5])
    support = Support(
        [UnilateralContact(position=p, friction=0.9) for p in feet], mass=10.0, center_of_mass=c
    )
    wrenches = [0, 0, -100, 0, 0, 0] + rng.uniform(-1, 1, (20, 6)) * [5, 5, 20, 20, 20, 2]
    states = solve_many(support, wrenches)
    F, M = wrenches[:, :3], wrenches[:, 3:]
    x = c[0] - (M[:, 1] + c[2] * F[:, 0]) / F[:, 2]  # where the wrench has no moment in the plane
    y = c[1] + (M[:, 0] - c[2] * F[:, 1]) / F[:, 2]
    inside = -np.max(hull.equations @ [x, y, np.ones(len(x))], axis=0)
    still = states.persistent
    distances = TipOver(support).evaluate(states).edge_distances
    np.testing.assert_allclose(distances[still], inside[still], atol=1e-7)
    assert np.all(inside[still] > -1e-7)


def test_clamps_have_no_support_polygon():
    feet = [UnilateralContact(position=p, friction=0.5) for p in ([1, 0, 0], [0, 1, 0])]
    clamp = ForceConstantHalfRigidClamp(
        position=[0, 0, 0], friction_upper=0.5, friction_lower=0.5, clamp_force=20.0
    )
    support = Support([*feet, clamp], mass=10.0, center_of_mass=[0.3, 0.3, 0.5])
    states = solve_many(support, [[0, 0, -98.1, 0, 0, 0]])
    assert np.isnan(TipOver(support).evaluate(states).edge_distances).all()


def test_values_are_those_of_gn_gt_and_the_samples(case):
    checked = check_motion(case.robot, case.reference)
    found, tip = checked.contacts, case.robot.tip_over
    assert found.unique
    GN, GT = checked.worst["GN"], checked.worst["GT"]
    assert found.moment.value == pytest.approx(tip.reference_moment * (1 / GN.value - 1), rel=1e-9)
    assert (found.moment.time, found.friction.time) == (GN.time, GT.time)
    assert found.friction.value == pytest.approx(GT.value, rel=1e-9)
    samples = sample_motion(case.robot, case.reference, 1e-3)
    normal = samples.states.contact_forces[:, :, 0]
    assert found.force.value == pytest.approx(normal.min(), rel=1e-3)
    assert found.force.contacts == (1 + int(np.argmin(normal.min(axis=0))),)
    assert found.edge.value == pytest.approx(np.nanmin(samples.tip.edge_distances), rel=1e-3)


def test_parts_together_are_the_whole(case):
    times = np.linspace(0, case.reference.end, 40)
    of = lambda t: ContactMargins.of(Instants.of_states(case.robot, *case.reference.states(t)), t)  # noqa: E731
    whole, parts = of(times), of(times[:13]).worse(of(times[13:]))
    for name in ("force", "moment", "edge", "friction"):
        one, other = getattr(whole, name), getattr(parts, name)
        assert (one.time, one.contacts) == (other.time, other.contacts), name
        assert one.value == pytest.approx(other.value, rel=1e-9), name
    assert set(whole.to_dict()) == {
        "least_normal_force_N",
        "least_moment_Nm",
        "least_edge_distance_m",
        "friction_use",
        "friction_missing_N",
        "normal_forces_unique",
        "least_force_if_feet_give_alike_N",
        "equal_compliance",
        "weak_instants",
        "first_weak_s",
    }
    assert (whole.weak, whole.to_dict()["first_weak_s"]) == (0, None)


def test_it_is_said_where_rigid_bodies_leave_open_whether_the_base_stands(case):
    support, wrenches = four_feet(np.random.default_rng(0))
    robot, times = case.robot.varied(support=support), np.linspace(0, 1, 60)
    still = np.zeros((60, robot.n))
    found = ContactMargins.of(Instants(robot, still, still, wrenches, still[:, :0], still, still), times)
    moved = np.flatnonzero(~solve_many(support, wrenches).persistent)
    weak = [k for k in moved if equilibrium(support, wrenches[k]).stands]
    assert (found.weak, found.first_weak) == (len(weak), times[weak[0]])
    assert stability(support, wrenches[weak[0]]).verdict == "weak"
    assert found.later(2.0).first_weak == 2 + times[weak[0]]
    both = found.worse(found)
    assert (both.weak, both.first_weak) == (2 * found.weak, found.first_weak)
    springs = robot.varied(support=support.varied([replace(c, stiffness=1e5) for c in support.contacts]))
    instants = Instants(springs, still, still, wrenches, still[:, :0], still, still)
    assert ContactMargins.of(instants, times).weak == 0


def test_what_has_no_meaning_is_left_out(case):
    nothing = ContactMargins(None, None, None, None, unique=False)
    assert nothing.lines() == []
    assert nothing.to_dict()["least_moment_Nm"] is None
    one = ContactMargins.of(Instants.at_rest(case.robot, case.start[None]), np.zeros(1))
    assert nothing.worse(one).force == one.worse(nothing).force == one.force
    assert one.lines()[0].startswith("minimum foot force ")


@pytest.mark.slow
def test_shares_of_feet_that_give_alike_are_those_of_springs_and_negative_where_springs_lift_one(case):
    rng = np.random.default_rng(1)
    corners = [
        UnilateralContact(position=[x, y, 0.0], friction=0.6) for x in (-0.3, 0.3) for y in (-0.2, 0.2)
    ]
    support = Support(corners, mass=30.0, center_of_mass=[0, 0, 0.15])
    springs = support.varied([replace(corner, stiffness=2e5) for corner in corners])
    wrenches = support.weight + rng.normal(size=(300, 6)) * [40, 40, 60, 60, 60, 20]
    alike = wrenches @ equal_normal_map(support).T
    shared = springs.elastic.share(wrenches)
    lifts = ~shared.pressing.all(axis=1)
    assert 30 < lifts.sum() < 270
    np.testing.assert_array_equal(lifts, alike.min(axis=1) < 0)
    np.testing.assert_allclose(alike[~lifts], shared.forces[~lifts, :, 0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(alike.sum(axis=1), -wrenches[:, 2], rtol=1e-9)
    times, still = np.linspace(0, 1, 300), np.zeros((300, case.robot.n))
    robot = case.robot.varied(support=support)
    states = still, still, wrenches, still[:, :0], still, still
    of = lambda rows: ContactMargins.of(Instants(robot, *(part[rows] for part in states)), times[rows])  # noqa: E731
    assert of(lifts | True).alike.value == pytest.approx(alike.min())
    assert of(lifts).lines()[0].startswith("minimum foot force -")
    assert of(lifts).differs.startswith("with equally compliant feet contact")
    assert of(lifts).force.value == 0
    standing = of(~lifts)
    rows = np.flatnonzero(~lifts & solve_many(support, wrenches).persistent)
    assert standing.lines()[-1].startswith("the same with equally compliant feet")
    assert standing.force.value == pytest.approx(shared.forces[rows, :, 0].min())
    standing = of(rows)
    used = standing.to_dict()["equal_compliance"]["friction_use"]["value"]
    assert used == standing.equal_friction.value >= standing.friction.value
    clamped = support.varied([RigidClamp(position=[0, 0, 0], friction_upper=0.5, friction_lower=0.5)])
    assert equal_normal_map(clamped) is None


def test_the_contacts_that_only_equally_compliant_feet_lose_are_named_with_their_share():
    rest = ContactMargins(None, None, None, None, unique=False)
    lifts = replace(rest, alike=Margin(-3.0, 0.5, (3,)), equal_friction=Margin(0.99, 0.5, (1,)))
    slips = replace(rest, alike=Margin(3.0, 0.5, (3,)), equal_friction=Margin(1.37, 0.5, (1, 2)))
    assert rest.differs == ""
    assert lifts.differs == "with equally compliant feet contact 3 lifts"
    does = "contacts 1 and 2 slip, needing 137 % of the friction"
    assert slips.differs == f"with equally compliant feet {does}"
    both = replace(lifts, equal_friction=slips.equal_friction).differs
    assert both == f"{lifts.differs} and {does}"


@pytest.mark.parametrize(("radius", "lifts"), [(0.2, True), (0.25, False)])
def test_the_headline_of_a_check_says_where_equally_compliant_feet_differ(case, radius, lifts):
    """On four feet in a square, one lifts on equal springs long before the base tips."""
    support, turns = case.robot.support, np.arange(4) * np.pi / 2
    height = support.contacts[0].position[2]
    feet = [
        UnilateralContact(position=[radius * np.cos(a), radius * np.sin(a), height], friction=0.8)
        for a in turns
    ]
    robot = case.robot.varied(support=support.varied(feet))
    checked = check_motion(robot, case.reference)
    times = np.linspace(1e-6, case.reference.end - 1e-6, 400)
    wrenches = robot.loads(*case.reference.states(times))[1]
    x, y = (np.array([foot.position for foot in feet]) - support.center_of_mass)[:, :2].T
    down, height = -wrenches[:, 2], height - support.center_of_mass[2]
    about_x = -(wrenches[:, 3] + height * wrenches[:, 1])
    about_y = -(wrenches[:, 4] - height * wrenches[:, 0])
    springs = np.linalg.pinv([np.ones(4), y, -x]) @ [down, about_x, about_y]  # least squares in balance
    assert (springs.min() < 0) == lifts
    assert checked.contacts.alike.value == pytest.approx(springs.min(), abs=0.2)
    assert checked.headline == "CHECKED at samples for the nominal model only (no uncertainty)" + (
        f", BUT with equally compliant feet {checked.contacts.alike.where} lifts" if lifts else ""
    )
    assert checked.to_dict()["contacts"]["equal_compliance"]["agrees"] != lifts


def test_what_slides_and_would_tip_if_friction_held_needs_an_infinite_factor():
    feet = [(x, y, 0.0) for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    contacts = [UnilateralContact(position=p, friction=0.1) for p in feet]
    footing = Footing(Support(contacts, mass=1.0, center_of_mass=[0, 0, 0.5]))
    wrenches = np.array([[0, 0, -9.81, 0, 0, 0], [1.5, 0, -9.81, 0, 0, 0], [8.0, 0, -9.81, 0, 0, 0]])
    times = np.array([0.0, 1.0, 2.0])  # by hand: it tips from 1.962 N on, and slides from 0.981 N on
    found = ContactMargins.of(Loaded(footing, wrenches[:2]), times[:2])
    assert found.friction.value == pytest.approx(1.5 / 0.981, rel=1e-6)
    found = ContactMargins.of(Loaded(footing, wrenches), times)
    assert (found.friction.value, found.friction.time) == (np.inf, 2.0)
    assert found.missing is None
