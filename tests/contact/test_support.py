"""A base on its contacts: wrenches, the assembled system, refused input."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError, OcptipError
from ocptip.contact.bindings.clamps import RigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import INERTIA_RANGE, Load, Support, refuse_impossible_inertia
from tests.contact.contact_cases import CLAMPS, KINDS, binding, feet, kind_name, mixed, parameters, polygon

PLATFORM = feet(polygon(3))
PLANAR = feet([[-0.4, 0.0], [0.4, 0.0]])


def test_weight_acts_at_the_center_of_mass():
    np.testing.assert_allclose(PLATFORM.wrench(), [0, 0, -60 * 9.81, 0, 0, 0])
    np.testing.assert_allclose(PLANAR.wrench(), [0, -60 * 9.81, 0])


def test_loads_are_added_about_the_center_of_mass():
    load = Load(force=[100.0, 0, 0], moment=[1.0, 2.0, 3.0], point=[0, 0.5, 1.0])
    expected = [100.0, 0, -60 * 9.81, 1.0, 2.0 + 100 * 0.4, 3.0 - 100 * 0.5]
    np.testing.assert_allclose(PLATFORM.wrench([load]), expected)
    np.testing.assert_allclose(PLATFORM.wrench([load, load]), 2 * np.array(expected) - PLATFORM.weight)


def test_planar_moments_turn_from_x_to_y():
    """A force to the right above the center of mass turns clockwise: negative."""
    np.testing.assert_allclose(
        PLANAR.wrench([Load(force=[10.0, 0.0], point=[0.0, 1.0])]), [10, -60 * 9.81, -4.0]
    )
    np.testing.assert_allclose(PLANAR.wrench([Load(moment=5.0)]), [0, -60 * 9.81, 5.0])


def test_a_load_may_be_a_force_or_a_moment_alone():
    np.testing.assert_allclose(PLATFORM.wrench([Load(moment=[1, 2, 3])]), [0, 0, -588.6, 1, 2, 3])
    np.testing.assert_allclose(PLATFORM.wrench([Load(force=[0, 1, 0])]), [0, 1, -588.6, 0.6, 0, 0])


def test_wrench_matrix_moves_forces_to_the_center_of_mass():
    support = mixed(UnilateralContact)
    rng = np.random.default_rng(0)
    forces = rng.normal(size=(3, 3))
    base_axes = [c.frame @ f for c, f in zip(support.contacts, forces, strict=True)]
    moments = [
        np.cross(c.position - [0, 0, 0.6], f) for c, f in zip(support.contacts, base_axes, strict=True)
    ]
    expected = np.r_[np.sum(base_axes, axis=0), np.sum(moments, axis=0)]
    np.testing.assert_allclose(support.wrench_matrix @ forces.ravel(), expected, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS, ids=kind_name)
@pytest.mark.parametrize("planar", [True, False], ids=["planar", "spatial"])
def test_system_is_the_equation_of_motion_and_the_auxiliary_rows(kind, planar):
    """For any values x: motion rows say a = W' inv(M) (h + W K), auxiliary rows are the binding's own."""
    support = mixed(kind, planar=planar)
    system, rng = support.system, np.random.default_rng(1)
    x = rng.random(system.matrix.shape[1])
    wrench = rng.normal(size=support.wrench_size)
    gap = system.plain_matrix @ x - system.rhs_matrix @ wrench - system.plain_rhs_offset
    forces = system.force_matrix @ x + system.force_offset
    W = support.wrench_matrix
    moved = W.T @ support.inverse_mass @ (wrench + W @ forces) * support.mass
    np.testing.assert_allclose(gap[system.motion_rows], system.acceleration_matrix @ x - moved, atol=1e-9)
    clamp = support.contacts[0]
    count = len(clamp.auxiliary_rhs())
    own = clamp.columns.auxiliary @ x[: len(clamp.columns.names)] - np.array(clamp.auxiliary_rhs())
    np.testing.assert_allclose(gap[support.dimension : support.dimension + count], own, atol=1e-9)


@pytest.mark.parametrize("n", [3, 4, 5, 8])
def test_gauge_is_what_coplanar_rigid_clamps_leave_open(n):
    """n normal forces against three equations of equilibrium: n - 3 directions are open."""
    clamps = [RigidClamp(position=p, **parameters(RigidClamp)) for p in polygon(n)]
    support = Support(clamps, center_of_mass=[0, 0, 0.6])
    gauge = support.system.gauge
    assert gauge.shape[1] == max(n - 3, 0)
    np.testing.assert_allclose(support.wrench_matrix @ gauge[support.system.motion_rows], 0.0, atol=1e-12)
    np.testing.assert_allclose(gauge.T @ gauge, np.eye(gauge.shape[1]), atol=1e-12)


def test_three_feet_need_no_gauge():
    assert PLATFORM.system.gauge.shape[1] == 0
    assert feet(polygon(8)).system.gauge.shape[1] == 0


@pytest.mark.parametrize(
    "inertia",
    [2.0, [1.0, 2.0, 3.0], np.diag([1.0, 2.0, 3.0]), [[2.0, 0.1, 0.0], [0.1, 2.0, 0.0], [0.0, 0.0, 3.0]]],
    ids=str,
)
def test_inertia_may_be_a_number_principal_values_or_a_matrix(inertia):
    support = feet(polygon(3), inertia=inertia)
    np.testing.assert_allclose(support.inverse_mass[3:, 3:] @ support.inertia, np.eye(3), atol=1e-14)


def test_inertia_turned_there_and_back_is_accepted_in_spite_of_rounding():
    """Off-diagonal elements of 1e-16 that differ are symmetric for all purposes."""
    inertia = np.diag([3.0, 4.0, 5.0])
    for i in range(20):
        turn = Rotation.random(random_state=i).as_matrix()
        feet(polygon(3), inertia=turn @ inertia @ turn.T)
        feet(polygon(3), inertia=turn.T @ (turn @ inertia @ turn.T) @ turn)


BAD_SUPPORTS = [
    ("mass", {"mass": 0.0}),
    ("mass", {"mass": -1.0}),
    ("mass", {"mass": float("nan")}),
    ("mass", {"mass": True}),
    ("mass", {"mass": "60"}),
    ("center_of_mass", {"center_of_mass": [0, 0]}),
    ("center_of_mass", {"center_of_mass": [0, 0, float("inf")]}),
    ("inertia", {"inertia": [1.0, 2.0, -3.0]}),
    ("inertia", {"inertia": 0.0}),
    ("inertia", {"inertia": [[1.0, 0.5, 0], [0.2, 1.0, 0], [0, 0, 1.0]]}),
    ("inertia", {"inertia": [1.0, 2.0]}),
    ("inertia", {"inertia": [1.0, 2.0, float("nan")]}),
    ("gravity", {"gravity": [0, -9.81]}),
    ("gravity", {"gravity": 9.81}),
]


@pytest.mark.parametrize(("name", "options"), BAD_SUPPORTS, ids=str)
def test_bad_supports_are_refused_by_name(name, options):
    with pytest.raises(InputError, match=f"^{name}: "):
        Support([binding(UnilateralContact)], **options)


def test_a_support_needs_contacts_of_one_dimension():
    with pytest.raises(InputError, match="at least one contact"):
        Support([])
    with pytest.raises(InputError, match=r"^contacts\[1\]: expected a contact, got str"):
        Support([binding(UnilateralContact), "foot"])
    with pytest.raises(InputError, match=r"^contacts\[1\]: planar and spatial"):
        Support([binding(UnilateralContact), binding(UnilateralContact, planar=True)])


BAD_LOADS = [
    ("force", Load(force=[1.0, 2.0])),
    ("force", Load(force=[1.0, 2.0, float("nan")])),
    ("moment", Load(moment=5.0)),
    ("moment", Load(moment=[0, 0, float("inf")])),
    ("point", Load(force=[0, 0, 1.0], point=[0.0])),
]


@pytest.mark.parametrize(("name", "load"), BAD_LOADS, ids=str)
def test_bad_loads_are_refused_with_their_number(name, load):
    with pytest.raises(InputError, match=rf"^load\[1\]\.{name}: "):
        PLATFORM.wrench([Load(force=[0.0, 0.0, 0.0]), load])


def test_a_load_without_force_and_moment_is_refused():
    for options in ({}, {"point": [0, 0, 1.0]}):
        with pytest.raises(InputError, match=r"^force: missing"):
            Load(**options)


def test_a_single_load_needs_no_list():
    load = Load(force=[1.0, 2.0, 3.0], point=[0.1, 0.2, 0.3])
    np.testing.assert_array_equal(PLATFORM.wrench(load), PLATFORM.wrench([load]))


@pytest.mark.parametrize(
    ("loads", "message"), [(3.0, "loads: expected a Load"), ([[1, 2, 3]], r"load\[0\]: expected")]
)
def test_what_is_no_load_is_refused(loads, message):
    with pytest.raises(InputError, match=message):
        PLATFORM.wrench(loads)


def test_huge_numbers_are_refused():
    with pytest.raises(InputError, match=r"^load\[0\]\.force: magnitudes above 1e\+12"):
        PLATFORM.wrench(Load(force=[1e13, 0, 0]))
    for name, options in (
        ("mass", {"mass": 1e13}),
        ("center_of_mass", {"center_of_mass": [0, 0, 1e13]}),
        ("gravity", {"gravity": [0, 0, -1e13]}),
    ):
        with pytest.raises(InputError, match=rf"^{name}: magnitudes above"):
            Support(PLATFORM.contacts, **{"mass": 60.0, **options})


@pytest.mark.parametrize("factor", [1e-6, 1.0, 1e9])
def test_the_conditioned_inertia_is_in_the_usual_range(factor):
    given = feet(polygon(3), inertia=factor * np.array([3.0, 4.0, 5.0]))
    conditioned, usual = given.conditioned, given.mass * given.length**2
    values = np.linalg.eigvalsh(conditioned.inertia)
    assert (conditioned is given) == (factor == 1)
    assert usual / INERTIA_RANGE * 0.999 <= values[0] <= values[-1] <= usual * INERTIA_RANGE * 1.001
    assert conditioned.conditioned.inertia_is_within(1.001 * INERTIA_RANGE)
    assert not given.inertia_is_within(1.0)
    refuse_impossible_inertia(conditioned)


def test_inertia_that_no_body_has():
    refuse_impossible_inertia(feet(polygon(3), inertia=[1.0, 1.0, 2.0]))
    with pytest.raises(InputError, match=r"^inertia: no body has these principal values .*\(1, 1, 25 kg"):
        refuse_impossible_inertia(feet(polygon(3), inertia=[1.0, 25.0, 1.0]))


def test_all_errors_share_one_root():
    assert issubclass(InputError, OcptipError)
    assert issubclass(InputError, ValueError)


@pytest.mark.parametrize("kind", CLAMPS, ids=kind_name)
def test_contacts_at_the_center_of_mass_are_possible(kind):
    support = Support([binding(kind)], mass=5.0)
    assert support.length == 1.0
    assert np.all(np.isfinite(support.system.matrix))
