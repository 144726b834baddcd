"""Mode automata: closedness of every binding's list, published counts, and what a bad list is told."""

import numpy as np
import pytest

from ocptip.basics.errors import BindingDefinitionError
from ocptip.contact.bindings.automaton import Mode, build_automaton
from ocptip.contact.bindings.binding import PoolVariable
from ocptip.contact.bindings.clamps import ForceVariableTwoSidedClamp, RigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact, stick_triples
from tests.contact.contact_cases import KINDS, binding, kind_name
from tests.quick import some

PLANAR_COUNTS = (5, 6, 10, 12, 8, 16)
COUNTS_6 = (22, 32, 44, 70, 38, 82)
COUNTS_12 = (46, 68, 92, 148, 80, 172)
STRONGLY_CLOSED = (UnilateralContact, RigidClamp, ForceVariableTwoSidedClamp)
RING = (Mode("stick", ("a", "b")), Mode("slide", ("b", "c")), Mode("separate", ("c", "a")))


def assert_sound(automaton):
    """Every leaving element has one successor, and going there and back leads home."""
    n, size = automaton.subsets.shape
    sets = [frozenset(s) for s in automaton.subsets.tolist()]
    assert len(set(sets)) == n
    assert all(len(s) == size for s in sets)
    for i in range(n):
        for place in range(size):
            leaving, j = automaton.subsets[i, place], automaton.successor[i, place]
            entering = automaton.entering[i, place]
            assert j != i
            assert sets[j] == sets[i] - {leaving} | {entering}
            back = int(np.flatnonzero(automaton.subsets[j] == entering)[0])
            assert automaton.successor[j, back] == i
            assert automaton.entering[j, back] == leaving


@pytest.mark.parametrize("kind", some(3, KINDS), ids=kind_name)
def test_automaton_is_closed_for_every_number_of_facets(kind):
    for facets in range(3, 33):
        assert_sound(binding(kind, facets=facets).automaton)


@pytest.mark.parametrize("kind", KINDS, ids=kind_name)
def test_planar_automaton_is_closed(kind):
    assert_sound(binding(kind, planar=True).automaton)


@pytest.mark.parametrize("kind", KINDS, ids=kind_name)
@pytest.mark.parametrize("place", [{"planar": True}, {"facets": 3}, {"facets": 12}], ids=str)
def test_closedness_is_as_published(kind, place):
    automaton = binding(kind, **place).automaton
    strong = kind in STRONGLY_CLOSED
    assert automaton.closedness == ("strong" if strong else "neutral")
    assert automaton.redundant.any() == (not strong)


@pytest.mark.parametrize(("kind", "count"), list(zip(KINDS, PLANAR_COUNTS, strict=True)))
def test_planar_counts_are_the_published_ones(kind, count):
    assert len(binding(kind, planar=True).automaton.names) == count


@pytest.mark.parametrize(("kind", "six", "twelve"), list(zip(KINDS, COUNTS_6, COUNTS_12, strict=True)))
def test_spatial_counts_are_the_published_ones(kind, six, twelve):
    assert len(binding(kind, facets=6).automaton.names) == six
    assert len(binding(kind, facets=12).automaton.names) == twelve


def test_ordinary_contact_has_4s_minus_2_modes():
    for facets in range(3, 33):
        names = binding(UnilateralContact, facets=facets).automaton.names
        assert len(names) == 4 * facets - 2
        assert (names.count("stick"), names.count("slide")) == (facets - 2, 2 * facets)
        assert names.count("separate") == facets


@pytest.mark.parametrize("kind", KINDS, ids=kind_name)
def test_all_variables_of_the_pool_are_used(kind):
    for place in ({"planar": True}, {"facets": 5}):
        contact = binding(kind, **place)
        assert set(contact.automaton.subsets.ravel()) == set(range(len(contact.pool())))


def test_stick_triples_triangulate_the_pyramid():
    for facets in range(3, 33):
        triples = [sorted(int(name[1:]) for name in triple) for triple in stick_triples(facets)]
        corners = np.exp(2j * np.pi * np.arange(facets) / facets)
        areas = []
        for a, b, c in triples:
            u, v = corners[b - 1] - corners[a - 1], corners[c - 1] - corners[a - 1]
            areas.append(0.5 * (u.conjugate() * v).imag)
        assert len(triples) == facets - 2
        assert min(areas) > 0
        assert sum(areas) == pytest.approx(0.5 * facets * np.sin(2 * np.pi / facets))


def test_smallest_closed_list():
    automaton = build_automaton("ring", ("a", "b", "c"), RING)
    assert_sound(automaton)
    assert automaton.closedness == "strong"


def test_open_list_is_reported_with_the_open_facet():
    with pytest.raises(BindingDefinitionError, match=r"ring: .*not closed: 2 facets.*\['a'\] by 1") as error:
        build_automaton("ring", ("a", "b", "c"), RING[:2])
    assert "two" in str(error.value)


def test_facet_with_three_owners_is_reported():
    star = (*RING, Mode("stick", ("a", "d")), Mode("stick", ("d", "b")))
    with pytest.raises(BindingDefinitionError, match=r"not closed.*by 3"):
        build_automaton("star", ("a", "b", "c", "d"), star)


@pytest.mark.parametrize(
    ("pool", "modes", "message"),
    [
        (("a", "b"), RING, r"bad: mode 'slide' uses \['c'\], not in the pool"),
        (("a", "b", "c"), (*RING[:2], Mode("separate", ("c",))), r"'separate' needs 2 different elements"),
        (("a", "b", "c"), (*RING[:2], Mode("separate", ("c", "c"))), r"'separate' needs 2 different"),
        (("a", "b", "c"), (*RING, Mode("again", ("b", "a"))), r"subset \['a', 'b'\] is listed twice"),
        (("a", "b", "b"), RING, r"bad: the pool has repeated names"),
        (("a", "b", "c"), (), r"bad: no modes"),
    ],
)
def test_bad_list_is_reported_with_what_is_wrong(pool, modes, message):
    with pytest.raises(BindingDefinitionError, match=message):
        build_automaton("bad", pool, modes)


@pytest.mark.parametrize("missing", range(14))
def test_a_missing_mode_never_goes_unnoticed(missing):
    contact = binding(UnilateralContact, facets=4)
    modes = contact.modes()
    del modes[missing]
    with pytest.raises(BindingDefinitionError, match="not closed"):
        build_automaton("unilateral", tuple(v.name for v in contact.pool()), tuple(modes))


def test_subsets_that_do_not_fit_the_number_of_equations_are_reported():
    class TooFew(UnilateralContact):
        def pool(self):
            return [PoolVariable(name) for name in "abc"]

        def modes(self):
            return list(RING)

    with pytest.raises(BindingDefinitionError, match=r"subsets have 2 elements, but there are 3 \+ 0"):
        _ = TooFew(position=[0, 0, 0], friction=0.5).columns
