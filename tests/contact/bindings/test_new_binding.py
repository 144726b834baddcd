"""A seventh and an eighth binding: one class each, and everything works with them."""

import itertools
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from ocptip.contact.bindings.automaton import Mode
from ocptip.contact.bindings.binding import Binding, ForcePiece, PoolVariable
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve, solve_many
from ocptip.contact.support import Support
from ocptip.contact.verdict import equilibrium, stability
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver
from ocptip.task_files.scene import read_scene
from tests.contact.contact_cases import CLAMPS, disturbed_weight, feet, kind_name, parameters, polygon

GRAVITY = 9.81


@dataclass(frozen=True, kw_only=True, eq=False)
class FrictionlessContact(Binding):
    """A contact on ice: pushes, but holds nothing tangentially. Needs no parameters."""

    kind: ClassVar[str] = "frictionless"

    def check_parameters(self):
        pass

    @property
    def directions(self):
        """Unit vectors of the tangential accelerations, in the order of their neighbourhood."""
        if self.planar:
            return np.array([[0.0, 1.0], [0.0, -1.0]])
        return np.array([[0, 1, 0], [0, 0, 1], [0, -1, 0], [0, 0, -1]], dtype=float)

    def pool(self):
        n = np.eye(self.dimension)[0]
        motion = [PoolVariable(f"g{i}", acceleration=a) for i, a in enumerate(self.directions)]
        return [PoolVariable("gn", acceleration=n), PoolVariable("ln", force=n), *motion]

    def modes(self):
        count = len(self.directions)
        sectors = [(f"g{i}",) for i in range(2)]
        if not self.planar:
            sectors = [(f"g{i}", f"g{(i + 1) % count}") for i in range(count)]
        return [
            Mode(name, (normal, *sector))
            for normal, name in (("ln", "slide"), ("gn", "separate"))
            for sector in sectors
        ]

    def force_pieces(self):
        return [ForcePiece(0.0, np.inf, 0.0, 0.0)]


@dataclass(frozen=True, kw_only=True, eq=False)
class MagneticFoot(UnilateralContact):
    """An ordinary contact with a magnet that pulls the base down with a constant force."""

    kind: ClassVar[str] = "magnetic-foot"

    adhesion: float

    def force_offset(self):
        return -self.adhesion * np.eye(self.dimension)[0]

    def force_pieces(self):
        return [ForcePiece(-self.adhesion, np.inf, self.friction * self.adhesion, self.friction)]


# A class registers itself where it is defined, that is when pytest collects this file. The tests of the
# other files must not see the two kinds, in whatever order they run.
KINDS = {kind: Binding.registry.pop(kind) for kind in ("frictionless", "magnetic-foot")}


@pytest.fixture(scope="module", autouse=True)
def kinds_registered():
    Binding.registry.update(KINDS)
    yield
    for kind in KINDS:
        del Binding.registry[kind]


def on_ice(n=3, **options):
    contacts = [FrictionlessContact(position=p) for p in polygon(n)]
    return Support(contacts, mass=60.0, center_of_mass=[0, 0, 0.6], inertia=[3, 4, 5], **options)


def on_magnets(n=3, adhesion=200.0, friction=0.5, facets=32):
    contacts = [
        MagneticFoot(position=p, friction=friction, adhesion=adhesion, facets=facets) for p in polygon(n)
    ]
    return Support(contacts, mass=60.0, center_of_mass=[0, 0, 0.6], inertia=[3, 4, 5])


def test_new_kinds_are_registered():
    assert Binding.registry["frictionless"] is FrictionlessContact
    assert Binding.registry["magnetic-foot"] is MagneticFoot


def test_automaton_of_the_frictionless_contact_is_derived():
    spatial = FrictionlessContact(position=[0, 0, 0]).automaton
    planar = FrictionlessContact(position=[0, 0], normal=[0, 1]).automaton
    assert (len(spatial.names), spatial.closedness) == (8, "strong")
    assert (len(planar.names), planar.closedness) == (4, "strong")


def test_base_on_level_ice_stands_without_lateral_load_and_slides_freely_with_it():
    ice = on_ice()
    assert solve(ice, ice.weight).persistent
    pushed = solve(ice, ice.weight + np.array([30.0, -12.0, 0, 0, 0, 0]))
    assert pushed.modes == ["slide"] * 3
    np.testing.assert_allclose(pushed.acceleration, [0.5, -0.2, 0, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(pushed.contact_forces[:, 1:], 0.0, atol=1e-10)


def test_block_on_an_icy_slope_in_the_plane_accelerates_by_g_sin():
    angle = np.radians(20)
    contacts = [FrictionlessContact(position=[x, 0.0], normal=[0, 1]) for x in (-0.5, 0.5)]
    gravity = GRAVITY * np.array([np.sin(angle), -np.cos(angle)])
    block = Support(contacts, mass=2.0, center_of_mass=[0.0, 0.2], gravity=gravity)
    state = solve(block, block.weight)
    np.testing.assert_allclose(state.acceleration, [GRAVITY * np.sin(angle), 0, 0], atol=1e-12)
    assert state.contact_forces[:, 0].sum() == pytest.approx(2.0 * GRAVITY * np.cos(angle))


def test_ice_is_the_limit_of_small_friction():
    ice, nearly, none = on_ice(), feet(polygon(3), friction=1e-6), feet(polygon(3), friction=0)
    loads = disturbed_weight(np.random.default_rng(1), ice, 50)
    frictionless, slippery = solve_many(ice, loads), solve_many(nearly, loads)
    assert frictionless.solved.all()
    np.testing.assert_allclose(frictionless.acceleration, slippery.acceleration, atol=1e-4)
    without = solve_many(none, loads)
    np.testing.assert_allclose(without.acceleration, frictionless.acceleration, atol=1e-10)
    np.testing.assert_allclose(without.contact_forces, frictionless.contact_forces, atol=1e-8)


@pytest.mark.parametrize("other", [UnilateralContact, MagneticFoot, *CLAMPS], ids=kind_name)
@pytest.mark.parametrize("planar", [True, False], ids=["planar", "spatial"])
def test_new_bindings_mix_with_all_others(other, planar):
    rng = np.random.default_rng(2)
    values = {"friction": 0.6, "adhesion": 80.0} if other is MagneticFoot else parameters(other)
    d = 2 if planar else 3
    up = np.eye(d)[-1]
    for _ in range(10):
        places = rng.uniform(-0.5, 0.5, (4, d))
        normals = up + 0.2 * rng.normal(size=(4, d))
        contacts = [
            FrictionlessContact(position=places[0], normal=normals[0]),
            MagneticFoot(position=places[1], normal=normals[1], friction=0.4, adhesion=100.0),
            other(position=places[2], normal=normals[2], **values),
            FrictionlessContact(position=places[3], normal=normals[3]),
        ]
        support = Support(contacts, mass=60.0, center_of_mass=0.6 * up)
        states = solve_many(support, disturbed_weight(rng, support, 30))
        assert states.solved.all()
        assert np.max(states.law_violation()) < 1e-8
        assert np.max(states.residual) < 1e-9


def test_magnets_hold_an_upward_pull_up_to_their_force():
    magnets = on_magnets()
    holds, weight = 3 * 200.0, 60 * GRAVITY
    for lift, stands in ((0.999, True), (1.001, False)):
        load = magnets.weight + np.array([0, 0, lift * (weight + holds), 0, 0, 0])
        state = solve(magnets, load)
        assert state.persistent == stands
        assert state.modes == (["stick"] if stands else ["separate"]) * 3
        assert equilibrium(magnets, load).stands == stands
        assert stability(magnets, load).verdict == ("strong" if stands else "none")


def test_magnets_add_to_the_friction_and_to_both_reserves():
    magnets, plain = on_magnets(), feet(polygon(3), facets=32)
    load = magnets.weight + np.array([150.0, 0, 0, 0, -90.0, 0])
    with_magnets, without = (solve_many(s, load[None]) for s in (magnets, plain))
    slip = Slip(magnets).evaluate(with_magnets)
    assert slip.GT[0] == pytest.approx(150.0 / (0.5 * (60 * GRAVITY + 3 * 200.0)), rel=1e-6)
    assert Slip(plain).evaluate(without).GT[0] == pytest.approx(150.0 / (0.5 * 60 * GRAVITY), rel=1e-6)
    tip = TipOver(magnets).evaluate(with_magnets).GN[0]
    assert 0.0 < tip < TipOver(plain).evaluate(without).GN[0] < 1.0


def test_reserves_on_ice():
    """Nothing can be held tangentially, but tipping is as on any floor."""
    ice, floor = on_ice(), feet(polygon(3))
    load = ice.weight + np.array([0, 0, 0, 20.0, -30.0, 0])
    states = solve_many(ice, load[None])
    reserve = TipOver(ice).evaluate(states)
    assert reserve.GN[0] == pytest.approx(TipOver(floor).evaluate(solve_many(floor, load[None])).GN[0])
    assert Slip(ice).evaluate(states).GT[0] == pytest.approx(0.0, abs=1e-9)


def test_stability_on_ice():
    ice = on_ice(4)
    assert stability(ice, ice.weight).verdict == "strong"
    assert stability(ice, ice.weight + np.array([10.0, 0, 0, 0, 0, 0])).verdict == "none"


def test_one_rubber_foot_holds_a_base_on_ice_laterally():
    contacts = [FrictionlessContact(position=p) for p in polygon(3)[:2]]
    contacts.append(UnilateralContact(position=polygon(3)[2], friction=0.5, facets=16))
    support = Support(contacts, mass=60.0, center_of_mass=[0, 0, 0.6])
    share = 60 * GRAVITY / 3  # normal force of the rubber foot
    for force, stands in ((0.45 * share, True), (0.55 * share, False)):
        arm = contacts[2].position - support.center_of_mass
        # the force acts at the rubber foot, so that no normal force changes
        load = support.weight + np.r_[force, 0, 0, np.cross(arm, [force, 0, 0])]
        states = solve_many(support, load[None])
        assert states.persistent[0] == stands
        assert stability(support, load).verdict == ("strong" if stands else "none")
        if stands:
            assert Slip(support).evaluate(states).GT[0] == pytest.approx(0.9, rel=1e-6)


SCENE = """
[base]
mass = 60.0
center_of_mass = [0, 0, 0.6]
"""
FOOT = """
[[contact]]
kind = "{kind}"
position = [{x}, {y}, 0]
{more}
"""


def scene_text(kind, more=""):
    return SCENE + "".join(FOOT.format(kind=kind, x=x, y=y, more=more) for x, y, _ in polygon(3))


def test_new_bindings_are_read_from_a_scene_file(tmp_path):
    path = tmp_path / "scene.toml"
    for kind, more, cls in (
        ("frictionless", "", FrictionlessContact),
        ("magnetic-foot", "friction = 0.5\nadhesion = 80.0", MagneticFoot),
    ):
        path.write_text(scene_text(kind, more))
        scene = read_scene(path)
        assert all(type(c) is cls for c in scene.support.contacts)
        assert solve(scene.support, scene.wrench).persistent


def test_derivatives_of_new_bindings_are_exact():
    support = on_magnets(facets=6)
    load = support.weight + np.array([80.0, 20.0, 300.0, 10.0, -5.0, 3.0])
    state = solve(support, load)
    step = 1e-3
    for j, sign in itertools.product(range(6), (1, -1)):
        moved = solve(support, load + sign * step * np.eye(6)[j])
        change = sign * step * state.force_map[:, :, j]
        np.testing.assert_allclose(moved.contact_forces, state.contact_forces + change, atol=1e-9)
