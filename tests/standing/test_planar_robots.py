"""A planar robot is a spatial one whose contacts stand twice, side by side: same verdicts and margins.

So planar robots need nothing of their own in plans and placements.
"""

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.clamps import ForceConstantHalfRigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Support
from ocptip.contact.verdict import stability
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver
from ocptip.robots.model import ArmModel, JointLimits
from ocptip.robots.motors import DCMotors
from ocptip.standing.arm import Robot

WIDE = 50.0  # m, half the distance of both rows: wide enough that the base cannot tip sideways


def contact(kind, x, height, lean, *, spatial):
    """The contact, or both of its pair, each with half of the preload."""
    normal = np.array([np.sin(lean), np.cos(lean)])
    parameters = (
        {"friction": 0.6} if kind is UnilateralContact else {"friction_upper": 0.6, "friction_lower": 0.4}
    )
    if kind is ForceConstantHalfRigidClamp:
        parameters["clamp_force"] = 20.0 if spatial else 40.0
    if not spatial:
        return [kind(position=(x, height), normal=normal, **parameters)]
    places = [(x, side * WIDE, height) for side in (1, -1)]
    at = {"normal": (normal[0], 0.0, normal[1]), "tangent": (normal[1], 0.0, -normal[0]), "facets": 32}
    return [kind(position=place, **at, **parameters) for place in places]


def both(rng, kinds):
    """The same base in the plane and in space."""
    places = [
        (x, 0.1 * rng.normal(), 0.2 * rng.normal()) for x in np.sort(rng.uniform(-0.5, 0.5, len(kinds)))
    ]
    found = []
    for spatial in (False, True):
        contacts = [
            c for kind, at in zip(kinds, places, strict=True) for c in contact(kind, *at, spatial=spatial)
        ]
        centre = (0.05, 0.0, 0.3) if spatial else (0.05, 0.3)
        found.append(
            Support(contacts, mass=20.0, center_of_mass=centre, inertia=[1.0] * 3 if spatial else 1.0)
        )
    return found


def lifted(wrenches):
    """Planar wrenches (fx, fz, moment from x to z) in space: that moment turns about -y."""
    fx, fz, moment = wrenches.T
    zero = np.zeros(len(wrenches))
    return np.column_stack([fx, zero, fz, zero, -moment, zero])


@pytest.mark.parametrize(
    "kinds",
    [(UnilateralContact, ForceConstantHalfRigidClamp), (UnilateralContact, UnilateralContact)],
)
def test_two_rows_are_the_plane(kinds):
    rng, stable = np.random.default_rng(5), []
    for _ in range(2):
        planar, spatial = both(rng, kinds)
        wrenches = planar.weight + rng.normal(size=(8, 3)) * [60, 60, 40]
        flat, deep = solve_many(planar, wrenches), solve_many(spatial, lifted(wrenches))
        rest = np.flatnonzero(flat.persistent & deep.persistent)
        one, other = flat.select(rest), deep.select(rest)
        assert np.allclose(TipOver(planar).evaluate(one).GN, TipOver(spatial).evaluate(other).GN, atol=1e-9)
        GT = [Slip(s, "full").evaluate(x).GT for s, x in ((planar, one), (spatial, other))]
        assert np.allclose(*GT, atol=1e-5)
        stable += flat.persistent.tolist()
        differ = flat.persistent != deep.persistent  # pyramids: as near to the limit as their facets are flat
        assert np.all(Slip(planar, "full").evaluate(flat.select(np.flatnonzero(differ))).GT > 0.98)
        for w in wrenches[~differ][:3] if set(kinds) == {UnilateralContact} else ():
            assert stability(planar, w).strong == stability(spatial, lifted(w[None])[0]).strong
    assert 3 < sum(stable) < len(stable) - 3


LENGTHS, MASSES, CENTRES, INERTIAS = (0.5, 0.4), (8.0, 5.0), (0.25, 0.2), (0.17, 0.07)
HEIGHT, G = 0.5, 9.81


def planar_arm():
    """Two links in the plane y = 0, joint axes along -y."""
    none = np.full(2, np.inf)
    return ArmModel(
        name="planar arm",
        joint_names=("shoulder", "elbow"),
        rotations=np.array([np.eye(3), np.eye(3)]),
        offsets=np.array([[LENGTHS[0], 0.0, 0.0], [LENGTHS[1], 0.0, 0.0]]),
        masses=np.array(MASSES),
        centres=np.array([[c, 0.0, 0.0] for c in CENTRES]),
        inertias=np.array([np.diag([0.01, i, i]) for i in INERTIAS]),
        limits=JointLimits(-3 * np.ones(2), 3 * np.ones(2), 2 * np.ones(2), none, 100 * np.ones(2)),
        mount_position=np.array([0.0, 0.0, HEIGHT]),
        mount_rotation=np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    )


def by_newton(q, qd, qdd, centre):
    """Planar wrench (N, 3) of the arm on its base about a point: momenta of the links, by hand."""
    wrench, root = np.zeros((len(q), 3)), np.tile([0.0, HEIGHT], (len(q), 1))
    at_root, angles, rates, turns = np.zeros((len(q), 2)), *(np.cumsum(x, axis=1) for x in (q, qd, qdd))
    for k in range(2):
        along = np.column_stack([np.cos(angles[:, k]), np.sin(angles[:, k])])
        across = np.column_stack([-along[:, 1], along[:, 0]])
        bent = turns[:, k, None] * across - rates[:, k, None] ** 2 * along
        arm = root + CENTRES[k] * along - centre
        force = -MASSES[k] * (at_root + CENTRES[k] * bent + [0.0, G])
        wrench[:, :2] += force
        wrench[:, 2] += arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0] - INERTIAS[k] * turns[:, k]
        root, at_root = root + LENGTHS[k] * along, at_root + LENGTHS[k] * bent
    return wrench


def test_a_planar_arm_on_two_rows_tips_as_in_the_plane():
    """Wrenches are those of Newton's law by hand, the index is that of a planar base under them."""
    rows = [(x, side * WIDE, 0.0) for x in (0.3, -0.3) for side in (1, -1)]
    feet = [UnilateralContact(position=place, friction=0.6) for place in rows]
    arm = planar_arm()
    robot = Robot(arm, Support(feet, mass=40.0, center_of_mass=(0, 0, 0.25)), DCMotors.estimated(arm))
    flat = [UnilateralContact(position=(x, 0.0), normal=(0, 1), friction=0.6) for x in (0.3, -0.3)]
    planar = Support(flat, mass=40.0, center_of_mass=(0.0, 0.25))
    rng = np.random.default_rng(2)
    q, qd, qdd = rng.uniform(-1, 2, (30, 2)), rng.normal(size=(30, 2)), 6 * rng.normal(size=(30, 2))
    _, wrenches = robot.loads(q, qd, qdd)
    by_hand = by_newton(q, qd, qdd, planar.center_of_mass) + planar.weight
    assert np.allclose(wrenches, lifted(by_hand), atol=1e-9)
    states = robot.contact_states(wrenches)
    inside = solve_many(planar, by_hand)
    rest = states.persistent & inside.persistent
    assert rest.sum() > 15
    reference = robot.tip_over.reference_moment
    ours, theirs = (
        tip.evaluate(own).GN[rest]
        for tip, own in ((robot.tip_over, states), (TipOver(planar, reference_moment=reference), inside))
    )
    assert np.allclose(ours, theirs, atol=1e-9)


def test_a_planar_base_of_an_arm_says_how_to_describe_it():
    planar = Support([UnilateralContact(position=(x, 0.0), normal=(0, 1), friction=0.6) for x in (0.3, -0.3)])
    with pytest.raises(InputError, match="each contact twice, far apart across the plane"):
        Robot(planar_arm(), planar, DCMotors.estimated(planar_arm()))
