"""Wheels with a drive or a brake: laws, statics by hand, and programs that know nothing of modes."""

import clarabel
import numpy as np
import pytest
from scipy.optimize import linprog

from ocptip.basics.errors import InputError
from ocptip.cli.main import main
from ocptip.contact import DrivenWheel, FreeWheel
from ocptip.contact.resting import solve_resting
from ocptip.contact.solver import solve, solve_many
from ocptip.contact.support import Support
from ocptip.contact.verdict import stability
from ocptip.numerics.cone_program import USABLE, quiet_settings, solve_cones
from ocptip.reserves.friction_needed import friction_needed, missing_force
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver
from ocptip.standing.at_rest.drive_envelope import largest_manoeuvres
from ocptip.standing.at_rest.manoeuvres import Manoeuvres
from tests.quick import some
from tests.standing.test_base_motion import carried

G, FRICTION, TORQUE, RADIUS = 9.81, 0.6, 2.0, 0.1
FORCE = TORQUE / RADIUS  # N, along, of each
FOUR = [0.3, 0.2, 0], [0.3, -0.2, 0], [-0.3, -0.2, 0], [-0.3, 0.2, 0]
THREE = [0.4, 0, 0], [-0.3, -0.2, 0], [-0.3, 0.2, 0]


def driven(place, **more):
    return DrivenWheel(
        **{"position": place, "friction": FRICTION, "torque": TORQUE, "radius": RADIUS, **more}
    )


def on(contacts, **more):
    return Support(contacts, **{"mass": 50.0, "center_of_mass": [0, 0, 0.4], "inertia": [3, 4, 5], **more})


def tricycle(**more):
    """Driven in front, free wheels behind."""
    return on([driven(THREE[0]), *(FreeWheel(position=own, friction=FRICTION) for own in THREE[1:])], **more)


def pushed(base, x=0.0, y=0.0):
    """Weight, and a load at the centre of mass."""
    return base.weight + np.r_[x, y, 0, 0, 0, 0]


def test_the_automaton_closes():
    automaton = driven([0, 0, 0]).automaton
    assert (len(automaton.names), automaton.closedness) == (33, "neutral")
    assert sum(automaton.redundant) == 6


@pytest.mark.parametrize("sign", [1, -1])
def test_a_tricycle_rolls_where_its_drive_is_too_weak(sign):
    base = tricycle()
    held, rolls = (
        solve(base, pushed(base, 0.99 * sign * FORCE)),
        solve(base, pushed(base, sign * (FORCE + 5))),
    )
    assert held.persistent
    assert rolls.modes == ["roll"] * 3
    np.testing.assert_allclose(rolls.acceleration, [sign * 5 / 50, 0, 0, 0, 0, 0], atol=1e-10)
    assert rolls.contact_forces[0, 1] == pytest.approx(-sign * FORCE)
    assert missing_force(base, pushed(base, sign * (FORCE + 12))) == pytest.approx(12.0, rel=1e-6)
    assert np.isinf(friction_needed(base, pushed(base, sign * (FORCE + 12))))
    assert stability(base, pushed(base, sign * (FORCE + 12))).verdict == "none"


def test_where_little_presses_friction_limits_the_drive():
    # The front wheel of a tricycle with its centre far behind bears m g 0.02 / 0.7: it slides first.
    base = tricycle(center_of_mass=[-0.28, 0, 0.0])
    bears = 50 * G * 0.02 / 0.7
    slope = driven([0, 0, 0])._slope
    assert slope * bears < FORCE
    assert solve(base, pushed(base, 0.99 * slope * bears)).persistent
    slid = solve(base, pushed(base, 1.05 * slope * bears))
    assert slid.modes == ["slide", "roll", "roll"]
    assert slid.acceleration[0] == pytest.approx(0.05 * slope * bears / 50, rel=1e-3)


def test_a_block_on_two_driven_axles_slides_across_and_rolls_along():
    base = on([driven(place) for place in FOUR], center_of_mass=[0, 0, 0.0])
    along = Slip(base).evaluate(solve_resting(base, np.array([pushed(base, 60.0), pushed(base, 0, 200.0)])))
    assert pytest.approx([60 / (4 * FORCE), 200 / (FRICTION * 50 * G)], rel=1e-6) == along.GT
    assert stability(base, pushed(base, 4 * FORCE + 10)).verdict == "none"
    assert missing_force(base, pushed(base, 4 * FORCE + 10)) == pytest.approx(10.0, rel=1e-6)
    three = on([driven(place) for place in THREE], center_of_mass=[0, 0, 0.0])
    found = solve(three, pushed(three, 3 * FORCE + 10))
    assert found.modes == ["roll"] * 3
    np.testing.assert_allclose(found.acceleration, [10 / 50, 0, 0, 0, 0, 0], atol=1e-10)
    h, W = 1e-4, pushed(base, 55.0, 60.0) + np.r_[0, 0, 0, 0, 0, 4.0]
    ends = [Slip(base).evaluate(solve_resting(base, W + sign * h * np.eye(6))).GT for sign in (1, -1)]
    slopes = Slip(base).evaluate(solve_resting(base, W[None])).gradient[0]
    np.testing.assert_allclose(slopes, (ends[0] - ends[1]) / (2 * h), atol=1e-6)


def test_the_drive_envelope_ends_at_the_drive():
    base = on([driven(place) for place in FOUR], center_of_mass=[0, 0, 0.1], mass=49.0)
    around = np.array([[-1.0, 0, 0], [0, 1.0, 0]])
    found = largest_manoeuvres(carried(base), np.zeros(1), Manoeuvres.accelerations(around, base.gravity))
    assert found.slip == pytest.approx([4 * FORCE / 50, FRICTION * G], rel=1e-6)


def balance_of(base: Support, wrench: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns of all forces and of a factor on what is across in a load, and what they have to give."""
    arm = -np.array(base.center_of_mass)
    force = np.r_[wrench[:2], 0]
    turn = (wrench[3:] - np.cross(arm, wrench[:3]))[2]
    across = np.r_[force, np.array([0, 0, turn]) + np.cross(arm, force)]
    return np.column_stack([base.wrench_matrix, across]), across - wrench


def pyramids_hold(base: Support, wrench: np.ndarray) -> bool:
    """Whether forces in the solver's pyramids balance a load, by a linear program."""
    n, size = base.n_contacts, 3 * base.n_contacts + 1
    rows, limits = [], []
    for k, own in enumerate(base.contacts):
        normal, along, across = np.eye(size)[3 * k : 3 * k + 3]
        free = isinstance(own, FreeWheel)
        slope = own.friction if free else own._slope
        faces = [across, -across] + ([] if free else [along, -along])
        rows += [-normal, *(face - slope * normal for face in faces), along, -along]
        limits += [0.0] * (1 + len(faces)) + [0.0 if free else FORCE] * 2
    bounds = [(None, None)] * (3 * n) + [(0.0, 1.0)]
    cost = np.append(np.zeros(3 * n), -1.0)
    found = linprog(cost, np.array(rows), limits, *balance_of(base, wrench), bounds, method="highs")
    return found.status == 0 and found.x[-1] > 1 - 1e-9


def largest(base: Support, wrench: np.ndarray) -> float:
    """Largest factor on what is across in a load, by a cone program; -1: normal forces do not hold it."""
    size, weight = 3 * base.n_contacts + 1, np.linalg.norm(base.weight)
    columns, load = balance_of(base, wrench)
    columns[:, -1] /= weight
    rows, limits, cones = [columns], [load / weight], [clarabel.ZeroConeT(6)]
    for k, own in enumerate(base.contacts):
        normal, along, across = np.eye(size)[3 * k : 3 * k + 3]
        most = 0.0 if isinstance(own, FreeWheel) else FORCE / weight
        rows += [-np.array([FRICTION * normal, along, across]), np.array([along, -along])]
        limits += [np.zeros(3), np.full(2, most)]
        cones += [clarabel.SecondOrderConeT(3), clarabel.NonnegativeConeT(2)]
    cost = np.append(np.zeros(size - 1), -1.0)
    found = solve_cones(cost, np.vstack(rows), np.concatenate(limits), cones, quiet_settings(1e-12))
    return float(found.x[-1]) if str(found.status) in USABLE else -1.0


@pytest.mark.parametrize("count", [60, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", some(1, ["tricycle", "four"]))
def test_random_states_are_those_of_linear_programs(kind, count):
    rng = np.random.default_rng(1)
    base = tricycle(center_of_mass=[0.05, 0.02, 0.4])
    if kind == "four":
        free = [FreeWheel(position=place, friction=FRICTION) for place in FOUR[2:]]
        base = on([driven(place) for place in FOUR[:2]] + free)
    wrenches = base.weight + rng.normal(size=(count, 6)) * [25, 120, 150, 30, 30, 25]
    states = solve_many(base, wrenches)
    assert states.solved.all()
    assert np.nanmax(states.law_violation()) < 1e-9
    holds = np.array([pyramids_hold(base, own) for own in wrenches])
    assert not np.any(states.persistent & ~holds)
    if kind == "tricycle":  # forces are unique: what can stand does
        np.testing.assert_array_equal(states.persistent, holds)
        assert 0.1 * count < np.sum(states.persistent) < 0.9 * count
    resting = solve_resting(base, wrenches)
    used = Slip(base).evaluate(resting, derivatives=False)
    factors = np.array([largest(base, own) for own in wrenches])
    np.testing.assert_allclose(used.GT[resting.persistent], 1 / factors[resting.persistent], rtol=1e-6)
    assert np.sum(resting.persistent) > 0.1 * count
    assert np.all(factors[~resting.persistent] < 1 + 1e-6)


def test_a_block_that_brakes_loads_its_axles_and_a_tricycle_its_wheels_as_by_hand():
    """About the front axle remains m g l / 2 - m a h; wheels of a tricycle balance by moments."""
    length, height, a = 0.6, 0.4, 4.0
    base = on([driven(place, torque=50.0) if k < 2 else driven(place) for k, place in enumerate(FOUR)])
    states = solve_resting(base, pushed(base, 50 * a)[None])
    moments = TipOver(base).evaluate(states).moments[0]
    assert moments.min() == pytest.approx(50 * (G * length / 2 - a * height), rel=1e-9)
    tip = largest_manoeuvres(
        carried(on([driven(place, torque=1e3) for place in FOUR], mass=49.0)), np.zeros(1),
        Manoeuvres.accelerations(np.array([[-1.0, 0, 0]]), base.gravity),
    ).tip[0]  # fmt: skip
    assert tip == pytest.approx(G * length / (2 * height), rel=1e-9)
    three = tricycle(center_of_mass=[0.05, 0.02, 0.4])
    push = 15.0
    forces = solve(three, pushed(three, push)).contact_forces[:, 0]
    front = (50 * G * (0.05 + 0.3) + push * 0.4) / 0.7
    left = ((50 * G - front) * 0.2 + 50 * G * 0.02) / 0.4
    np.testing.assert_allclose(forces, [front, 50 * G - front - left, left], rtol=1e-9)


def test_stand_says_that_it_rolls_and_what_is_missing(tmp_path, capsys):
    kinds = "".join(
        f'[[contact]]\nkind = "driven-wheel"\nposition = {list(place)}\nfriction = 0.6\n'
        f"torque = {TORQUE}\nradius = {RADIUS}\n"
        for place in THREE
    )
    base = "[base]\nmass = 50.0\ncenter_of_mass = [0, 0, 0.0]\n"
    scene = tmp_path / "rolls.toml"
    for force, code in ((59.0, 0), (72.0, 1)):
        load = f"[[load]]\nforce = [{force}, 0.0, 0.0]\npoint = [0, 0, 0]\n"
        scene.write_text(base + load + kinds, encoding="utf-8")
        assert main(["stand", str(scene)]) == code
    out = capsys.readouterr().out
    assert "NOT STABLE. Contacts 1, 2 and 3 roll." in out
    assert "12 N of tangential force are missing" in out


def test_what_is_no_driven_wheel_is_refused():
    with pytest.raises(InputError, match="torque: must be > 0"):
        DrivenWheel(position=[0, 0, 0], friction=0.5, torque=0.0, radius=0.1)
    with pytest.raises(InputError, match="stiffness: not for a driven-wheel"):
        driven([0, 0, 0], stiffness=1e5)
    with pytest.raises(InputError, match="driven-wheel: for spatial supports"):
        DrivenWheel(position=[0, 0], normal=[0, 1], friction=0.5, torque=1.0, radius=0.1)
    steps = on([driven(FOUR[0]), driven(FOUR[1]), driven(FOUR[2]), driven([-0.3, 0.2, 0.1])])
    with pytest.raises(InputError, match="need contacts on one plane"):
        Slip(steps).evaluate(solve_many(steps, steps.weight[None]))
