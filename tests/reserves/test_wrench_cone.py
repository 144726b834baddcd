"""Half spaces of wrenches that are held, against the slip reserve itself."""

from __future__ import annotations

import numpy as np
import pytest

from ocptip.contact.bindings.clamps import ForceConstantHalfRigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Support
from ocptip.reserves.slip import Slip
from ocptip.reserves.wrench_cone import TOLERANCE

SHARE = 0.8


def feet(count: int, *, tilt: float = 0.0, friction: float = 0.5) -> Support:
    angles = 2 * np.pi * (np.arange(count) + 0.3) / count
    contacts = [
        UnilateralContact(
            position=[0.3 * np.cos(a), 0.2 * np.sin(a), -0.4],
            normal=[tilt * np.cos(a), tilt * np.sin(a), 1.0],
            friction=friction * (1 + 0.2 * k),
        )
        for k, a in enumerate(angles)
    ]
    return Support(contacts, mass=50.0)


@pytest.mark.parametrize(("count", "tilt"), [(3, 0.0), (4, 0.0), (5, 0.0), (4, -0.2)])
def test_inside_and_nearly_all(count, tilt):
    support = feet(count, tilt=tilt)
    slip = Slip(support)
    rows = slip.half_spaces(SHARE)
    rng = np.random.default_rng(count)
    loads = rng.normal(size=(300, 6)) * [120, 120, 50, 30, 30, 40] + support.weight
    states = solve_many(support, loads)
    reserve = slip.evaluate(states, derivatives=False)
    known = reserve.solved & states.persistent  # of several solutions the solver's may be one that slides
    inside = np.max(loads @ rows.T, axis=1) <= 0
    assert 30 < np.sum(inside[known]) < np.sum(known) - 10
    assert np.max(reserve.GT[known & inside]) <= SHARE * (1 + 1e-7)
    surely = known & (reserve.GT <= SHARE * (1 - TOLERANCE) * (1 - 1e-6))
    assert np.all(inside[surely])


def test_none_where_the_set_is_no_cone():
    ordinary = [UnilateralContact(position=[x, 0.2, 0.0], friction=0.5) for x in (-0.2, 0.2)]
    clamp = ForceConstantHalfRigidClamp(
        position=[0.0, -0.2, 0.0], friction_upper=0.4, friction_lower=0.4, clamp_force=50.0
    )
    assert Slip(Support([*ordinary, clamp], mass=10.0)).half_spaces(SHARE) is None
    assert Slip(feet(4), "tangential").half_spaces(SHARE) is None
    assert Slip(Support(ordinary, mass=10.0)).half_spaces(SHARE) is None
