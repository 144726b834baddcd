"""Wheels with a drive or a brake: laws, statics by hand, and linear programs that know nothing of modes."""

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
from ocptip.reserves.friction_needed import friction_needed, missing_force
from ocptip.reserves.slip import Slip
from ocptip.standing.at_rest.drive_envelope import Manoeuvres, largest_manoeuvres
from tests.quick import some
from tests.standing.test_base_motion import carried

G, FRICTION, TORQUE, RADIUS = 9.81, 0.6, 2.0, 0.1
FORCE = TORQUE / RADIUS  # N, along, of each
FOUR = [0.3, 0.2, 0], [0.3, -0.2, 0], [-0.3, -0.2, 0], [-0.3, 0.2, 0]
THREE = [0.4, 0, 0], [-0.3, -0.2, 0], [-0.3, 0.2, 0]
FACES = 256  # of the cones of the linear programs: radii are off by less than 8e-5


def driven(place, **more):
    return DrivenWheel(position=place, friction=FRICTION, torque=TORQUE, radius=RADIUS, **more)


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


def largest(base: Support, wrench: np.ndarray, pyramid: bool) -> float:
    """Largest factor on what is across in a load, by a linear program; -1: normal forces do not hold it.

    With faces of the solver's pyramids (the factor is at most 1), or nearly cones.
    """
    n, size = base.n_contacts, 3 * base.n_contacts + 1
    rows, limits = [], []
    for k, own in enumerate(base.contacts):
        normal, along, across = np.eye(size)[3 * k : 3 * k + 3]
        free = isinstance(own, FreeWheel)
        angles = 2 * np.pi * np.arange(FACES) / FACES
        if pyramid or free:
            slope = own.friction if free else own._slope
            faces = [across, -across] + ([] if free else [along, -along])
        else:
            slope, faces = own.friction, [np.cos(a) * along + np.sin(a) * across for a in angles]
        most = 0.0 if free else FORCE
        rows += [-normal, *(face - slope * normal for face in faces), along, -along]
        limits += [0.0] * (1 + len(faces)) + [most, most]
    arm = -np.array(base.center_of_mass)
    force = np.r_[wrench[:2], 0]
    turn = (wrench[3:] - np.cross(arm, wrench[:3]))[2]
    across = np.r_[force, np.array([0, 0, turn]) + np.cross(arm, force)]
    balance = np.column_stack([base.wrench_matrix, across])
    cost = np.append(np.zeros(3 * n), -1.0)
    bounds = [(None, None)] * (3 * n) + [(0.0, 1.0 if pyramid else 1e3)]
    found = linprog(cost, np.array(rows), limits, balance, across - wrench, bounds, method="highs")
    return float(found.x[-1]) if found.status == 0 else -1.0


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
    factors = np.array([largest(base, own, True) for own in wrenches])
    assert not np.any(states.persistent & (factors < 1 - 1e-7))
    if kind == "tricycle":  # forces are unique: what can stand does
        np.testing.assert_array_equal(states.persistent, factors > 1 - 1e-9)
        assert 0.1 * count < np.sum(states.persistent) < 0.9 * count
    resting = solve_resting(base, wrenches)
    used = Slip(base).evaluate(resting, derivatives=False)
    factors = np.array([largest(base, own, False) for own in wrenches])
    stands = resting.persistent & (factors < 1e3)
    np.testing.assert_allclose(used.GT[stands], 1 / factors[stands], rtol=2e-4)
    assert np.sum(stands) > 0.1 * count
    assert np.all(factors[~resting.persistent] < 1 + 1e-3)


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
