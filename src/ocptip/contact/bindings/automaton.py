"""Mode automata: which element of a pool replaces a leaving one.

A contact model lists the *admissible subsets* of its pool of non-negative scalars, each subset a contact
mode. The list is closed if every facet of a subset (the subset minus one element) belongs to exactly two
subsets: then each (subset, leaving element) has exactly one successor, and a complementary pivoting method
ruled by the automaton can never be led into an undefined mode. If redundant subsets (which can never be
non-negative, but cost no rank) are needed for that, the list is *neutrally* closed, otherwise *strongly*
closed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ocptip.basics.errors import BindingDefinitionError


@dataclass(frozen=True)
class Mode:
    """One admissible subset of the pool of a contact model.

    Attributes:
        name: what the contact does, e.g. "stick", "slide", "separate".
        elements: names of the pool variables that may be positive in this mode.
        redundant: True for a subset that only closes the list and can never be non-negative.
    """

    name: str
    elements: tuple[str, ...]
    redundant: bool = False


@dataclass(frozen=True)
class Automaton:
    """Transition tables over subsets of a pool.

    Attributes:
        names: mode name of each subset.
        subsets: (n_subsets, size) pool indices of each subset.
        successor: (n_subsets, size) the neighbouring subset when the element in this place leaves.
        entering: (n_subsets, size) pool index of the element that enters then.
        redundant: (n_subsets,) True where the subset only closes the list.
        closedness: "strong", or "neutral" if redundant subsets are needed.
    """

    names: tuple[str, ...]
    subsets: np.ndarray
    successor: np.ndarray
    entering: np.ndarray
    redundant: np.ndarray
    closedness: str


@lru_cache(maxsize=1024)
def build_automaton(kind: str, pool: tuple[str, ...], modes: tuple[Mode, ...]) -> Automaton:
    """Derive the automaton of a mode list and check that the list is closed.

    Args:
        kind: name of the contact model, for messages.
        pool: names of the pool variables; subsets are stored as indices into it.
        modes: the admissible (and redundant) subsets.

    Raises:
        BindingDefinitionError: unknown or repeated elements, subsets of different size, repeated
            subsets, or a facet that is not shared by exactly two subsets.
    """
    index = {name: i for i, name in enumerate(pool)}
    if len(index) != len(pool):
        raise BindingDefinitionError(f"{kind}: the pool has repeated names")
    if not modes:
        raise BindingDefinitionError(f"{kind}: no modes")
    size = len(modes[0].elements)
    seen: dict[frozenset[str], int] = {}
    for i, mode in enumerate(modes):
        unknown = [e for e in mode.elements if e not in index]
        if unknown:
            raise BindingDefinitionError(f"{kind}: mode {mode.name!r} uses {unknown}, not in the pool")
        key = frozenset(mode.elements)
        if len(key) != size or len(mode.elements) != size:
            raise BindingDefinitionError(f"{kind}: mode {mode.name!r} needs {size} different elements")
        if key in seen:
            raise BindingDefinitionError(f"{kind}: subset {sorted(key)} is listed twice")
        seen[key] = i

    facets: dict[frozenset[str], list[int]] = {}
    for key, i in seen.items():
        for element in key:
            facets.setdefault(key - {element}, []).append(i)
    open_facets = [(sorted(f), len(owners)) for f, owners in facets.items() if len(owners) != 2]
    if open_facets:
        facet, count = open_facets[0]
        raise BindingDefinitionError(
            f"{kind}: the mode list is not closed: {len(open_facets)} facets are not shared by exactly two "
            f"subsets, e.g. {facet} by {count}"
        )

    n = len(modes)
    subsets = np.array([[index[e] for e in mode.elements] for mode in modes], dtype=np.int64)
    successor = np.empty((n, size), dtype=np.int64)
    entering = np.empty((n, size), dtype=np.int64)
    for i, mode in enumerate(modes):
        for place, element in enumerate(mode.elements):
            facet = frozenset(mode.elements) - {element}
            first, second = facets[facet]
            other = second if first == i else first
            (new,) = set(modes[other].elements) - facet
            successor[i, place] = other
            entering[i, place] = index[new]
    redundant = np.array([mode.redundant for mode in modes])
    return Automaton(
        names=tuple(mode.name for mode in modes),
        subsets=subsets,
        successor=successor,
        entering=entering,
        redundant=redundant,
        closedness="neutral" if redundant.any() else "strong",
    )
