"""What of a base moves, in words; contacts on a line or at a point give the reason."""

import numpy as np
import pytest

from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.resting import what_moves
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Support


def state(positions, center):
    contacts = [UnilateralContact(position=p, friction=0.5) for p in positions]
    support = Support(contacts, mass=10.0, center_of_mass=center)
    found = solve_many(support, support.wrench()[None])[0]
    return support, found


def test_contacts_are_grouped_by_what_they_do():
    support, _ = state([[1, 0, 0], [0, 1, 0], [-1, -1, 0]], [0, 0, 0.3])
    assert what_moves(support, ["slide", "stick", "separate"]) == "contact 1 slides; contact 3 lifts off"
    assert what_moves(support, ["slide", "slide", "slide"]) == "contacts 1, 2 and 3 slide"


@pytest.mark.parametrize(
    ("positions", "said"),
    [
        ([[0, 0, 0]], "contact 1 is the only one"),
        ([[0.1, 0, 0], [0.1, 0, 0]], "contacts 1 and 2 are at one point"),
        ([[0.2, 0, 0], [-0.2, 0, 0]], "contacts 1 and 2 are on one line"),
        ([[0.2, 0.1, 0], [-0.2, -0.1, 0], [0.4, 0.2, 0]], "contacts 1, 2 and 3 are on one line"),
    ],
)
def test_contacts_without_area_are_the_reason(positions, said):
    support, found = state(positions, np.mean(positions, axis=0) + np.array([0, 0.05, 0.3]))
    assert found.solved
    assert not found.persistent
    assert set(found.modes) == {"stick"}
    assert what_moves(support, found.modes) == f"{said}, about which nothing keeps it from tipping"
