"""The picture of a kind of contact shows every mode, every exchange and the set of forces."""

import numpy as np
import pytest

from ocptip.contact.bindings.clamps import ForceConstantTwoSidedClamp, RigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.pictures.bindings import binding_figure

AT = {"position": (0, 0), "normal": (0, 1)}
JAWS = {"friction_upper": 0.5, "friction_lower": 0.3}
BINDINGS = [
    UnilateralContact(**AT, friction=0.5),
    RigidClamp(**AT, **JAWS),
    ForceConstantTwoSidedClamp(**AT, **JAWS, clamp_force=60.0, lever_ratio=1.5),
]


@pytest.mark.parametrize("binding", BINDINGS, ids=lambda b: b.kind)
def test_modes_are_apart_and_joined_as_the_automaton_says(binding):
    figure = binding_figure(binding, 200.0)
    boxes = [text for text in figure.axes[1].texts if text.get_text()]
    assert len(boxes) == len(binding.automaton.names)
    places = np.array([box.get_position() for box in boxes])
    distances = np.linalg.norm(places[:, None] - places, axis=2) + 10 * np.eye(len(places))
    assert distances.min() > 0.1
    lines = {frozenset(map(tuple, np.round(line.get_xydata(), 6))) for line in figure.axes[1].lines}
    exchanges = {frozenset((i, int(j))) for i, after in enumerate(binding.automaton.successor) for j in after}
    drawn = {frozenset(map(tuple, np.round(places[list(pair)], 6))) for pair in exchanges}
    assert drawn <= lines


def test_forces_are_those_at_which_the_contact_rests():
    figure = binding_figure(BINDINGS[0], 200.0)
    (piece,) = figure.axes[0].patches
    assert piece.get_path().contains_points([[40, 100], [60, 100], [0, -10]]).tolist() == [True, False, False]
