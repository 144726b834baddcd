"""Wheels that roll freely: laws, statics by hand, margins, and what does not know them."""

import dataclasses
import json

import numpy as np
import pytest

import ocptip
from ocptip.cli.main import main
from ocptip.contact import FreeWheel, UnilateralContact
from ocptip.contact.solver import solve, solve_many
from ocptip.contact.support import Support
from ocptip.contact.verdict import equilibrium, stability
from ocptip.reserves.force_sets import ForceSets
from ocptip.reserves.friction_needed import friction_needed, missing_force
from ocptip.reserves.slip import Slip
from ocptip.standing.at_rest.drive_envelope import largest_manoeuvres
from ocptip.standing.at_rest.manoeuvres import Manoeuvres
from tests.standing.test_base_motion import carried

G = 9.81
PLACES = [0.3, 0.2, 0], [0.3, -0.2, 0], [-0.3, -0.2, 0], [-0.3, 0.2, 0]


def wheels(count=4, friction=0.6, **more):
    """Of four contacts the last ones are free wheels, the others braked: ordinary contacts."""
    kinds = [UnilateralContact] * (4 - count) + [FreeWheel] * count
    contacts = [kind(position=place, friction=friction) for kind, place in zip(kinds, PLACES, strict=True)]
    return Support(contacts, **{"mass": 50.0, "center_of_mass": [0, 0, 0.4], "inertia": [3, 4, 5], **more})


def test_the_automaton_closes():
    automaton = FreeWheel(position=[0, 0, 0], friction=0.5).automaton
    assert (len(automaton.names), automaton.closedness) == (10, "strong")


def test_a_base_on_free_wheels_rolls_and_grips_across():
    base = wheels()
    assert solve(base, base.weight).persistent
    across = solve(base, base.weight + np.r_[0, 200.0, 0, 0, 0, 0])
    assert across.persistent
    pushed = solve(base, base.weight + np.r_[12.0, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(pushed.acceleration, [12 / 50, 0, 0, 0, 0, 0], atol=1e-10)
    assert pushed.modes == ["roll"] * 4
    np.testing.assert_allclose(pushed.contact_forces[:, 1], 0.0, atol=1e-12)
    low = wheels(center_of_mass=[0, 0, 0.1])
    slid = solve(low, low.weight + np.r_[0, 0.6 * 50 * G + 50.0, 0, 0, 0, 0])
    assert slid.acceleration[1] == pytest.approx(1.0)
    assert slid.modes == ["slide"] * 4


def test_random_states_obey_the_laws():
    rng, base = np.random.default_rng(0), wheels(2)
    sizes = [100, 300, 200, 40, 60, 60]
    states = solve_many(base, base.weight + rng.normal(size=(60, 6)) * sizes)
    assert states.solved.mean() > 0.95
    assert np.nanmax(states.law_violation()) < 1e-7
    assert 10 < np.count_nonzero(states.persistent) < 50
    tilted = wheels(2, center_of_mass=[0.05, 0.02, 0.4])  # and rollers at 45 degrees
    front, rear = tilted.contacts[:2], tilted.contacts[2:]
    tangents = [*front, *(dataclasses.replace(contact, tangent=[1, 1, 0]) for contact in rear)]
    assert np.nanmax(solve_many(tilted.varied(tangents), states.wrenches).law_violation()) < 1e-7


def test_the_missing_force_is_what_pulls_along():
    base = wheels()
    load = base.weight + np.r_[12.0, 30.0, 0, 0, 0, 0]
    assert missing_force(base, load) == pytest.approx(12.0, rel=1e-7)
    assert not equilibrium(base, load).stands
    assert stability(base, load).verdict == "none"
    assert missing_force(base, base.weight) == pytest.approx(0.0, abs=1e-6)
    braked = wheels(2)
    assert equilibrium(braked, load).stands
    assert missing_force(braked, load) == pytest.approx(0.0, abs=1e-6)
    assert np.isinf(friction_needed(base, load))
    assert friction_needed(braked, load) < 1


def test_friction_used_is_that_of_braked_wheels_along_and_of_all_across():
    base = wheels(2)  # the front ones are braked; loads act at the height of the ground
    slip = Slip(base)
    loads = np.zeros((3, 6))
    loads[0, 0] = loads[1, 1] = 60.0
    arms = np.array([0, 0, -0.4])
    loads[:, 3:] = np.cross(arms, loads[:, :3])
    found = slip.evaluate(slip_states(base, loads), derivatives=False)
    front, total = 25 * G, 50 * G
    assert found.GT[:2] == pytest.approx([60 / (0.6 * front), 60 / (0.6 * total)], rel=1e-6)
    np.testing.assert_allclose(found.tangential_forces[:, 2:, 0], 0.0, atol=1e-9)


def slip_states(base, loads):
    from ocptip.contact.resting import solve_resting

    return solve_resting(base, base.weight + loads)


def test_envelope_of_a_base_with_braked_front_wheels():
    base = wheels(2, friction=0.5, center_of_mass=[0, 0, 0.3], mass=49.0)
    around = np.array([[-1.0, 0, 0], [0, 1.0, 0]])
    found = largest_manoeuvres(carried(base), np.zeros(1), Manoeuvres.accelerations(around, base.gravity))
    # Front wheels bear m (g / 2 + a h / l) while it brakes; across all grip.
    brake = 0.5 * G / 2 / (1 - 0.5 * 0.3 / 0.6)
    assert found.slip == pytest.approx([brake, 0.5 * G], rel=1e-7)


def test_stand_says_that_it_rolls_and_what_is_missing(tmp_path, capsys):
    kinds = "".join(
        f'[[contact]]\nkind = "free-wheel"\nposition = {list(place)}\nfriction = 0.6\n' for place in PLACES
    )
    base = "[base]\nmass = 50.0\ncenter_of_mass = [0, 0, 0.4]\n"
    load = "[[load]]\nforce = [12.0, 0.0, 0.0]\npoint = [0, 0, 0.4]\n"
    scene = tmp_path / "rolls.toml"
    scene.write_text(base + load + kinds, encoding="utf-8")
    assert main(["stand", str(scene)]) == 1
    out = capsys.readouterr().out
    assert "NOT STABLE. Contacts 1, 2, 3 and 4 roll." in out
    assert "12 N of tangential force are missing" in out
    assert main(["stand", str(scene), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["friction_missing_N"] == pytest.approx(12.0, rel=1e-6)


def test_what_does_not_know_wheels_refuses_them():
    assert not ForceSets(wheels(1)).ordinary
    with pytest.raises(ocptip.InputError, match="free-wheel: for spatial supports"):
        FreeWheel(position=[0, 0], normal=[0, 1], friction=0.5)
