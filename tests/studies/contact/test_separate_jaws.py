"""Clamps with jaws apart: what the study's cone program says of clamps that can be computed by hand."""

import numpy as np
import pytest

from ocptip.contact.bindings.clamps import ForceConstantHalfRigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from studies.contact.separate_jaws import CLAMPS, agrees, clamped, largest_push, pushes

LEVEL = np.array([0.0, 0, 1, 0, 0, 0])


@pytest.mark.parametrize("kind", CLAMPS)
def test_the_reduced_clamp_is_the_librarys(kind):
    support, load, place = clamped(kind)
    for push in pushes(support, place)[::7]:
        assert agrees(support, load, push, largest_push(support, load, push, 0.0))


def lifted(distance, friction=0.0):
    """A lever on a foot without friction and a clamp 1 m away, which is lifted there."""
    foot = UnilateralContact(position=(0, 0, 0), friction=friction)
    side = UnilateralContact(position=(0, 1, 0), friction=friction)
    clamp = ForceConstantHalfRigidClamp(
        position=(1, 0, 0), friction_upper=0.5, friction_lower=0.5, clamp_force=100.0
    )
    support = Support([foot, side, clamp], mass=1e-6, center_of_mass=(1, 0, 0))
    return largest_push(support, np.zeros(6), LEVEL, distance)


def test_a_lift_is_held_by_the_preload_whatever_the_distance():
    assert lifted(0.0) == pytest.approx(100.0, rel=1e-6)
    assert lifted(0.05) == pytest.approx(100.0, rel=1e-6)


def test_jaws_apart_hold_a_moment_that_their_middle_does_not():
    """Friction of each jaw times half their distance."""
    distance, force = 0.04, 100.0
    far = UnilateralContact(position=(-1, 0, 0), friction=0.0)
    clamp = ForceConstantHalfRigidClamp(
        position=(0, 0, 0), friction_upper=0.5, friction_lower=0.5, clamp_force=force
    )
    support = Support([far, clamp], mass=1e-6, center_of_mass=(0, 0, 0))
    tilt = np.array([0, 0, 0, 1.0, 0, 0])  # about the line through foot and clamp
    assert largest_push(support, np.zeros(6), tilt, 0.0) == pytest.approx(0.0, abs=1e-6)
    # both rub with 0.5 * 100 N, half the distance from the axis, in opposite directions
    held = largest_push(support, np.zeros(6), tilt, distance)
    assert held == pytest.approx(0.5 * force * distance, rel=1e-5)
