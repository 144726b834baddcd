"""Supports and finite differences shared by the tests of the reserves."""

import numpy as np

from ocptip.contact.bindings.clamps import (
    ForceConstantHalfRigidClamp,
    ForceConstantTwoSidedClamp,
    ForceVariableHalfRigidClamp,
    ForceVariableTwoSidedClamp,
    RigidClamp,
)
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Support

MASS, RADIUS, HEIGHT, FRICTION = 60.0, 0.35, 0.6, 0.5
GRAVITY = 9.81
CLAMPS = (
    RigidClamp,
    ForceVariableHalfRigidClamp,
    ForceVariableTwoSidedClamp,
    ForceConstantHalfRigidClamp,
    ForceConstantTwoSidedClamp,
)


def corners(n, radius=RADIUS, turn=0.0):
    """(n, 3) corners of a regular polygon on the floor."""
    angles = turn + 2 * np.pi * np.arange(n) / n
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.zeros(n)])


def feet(positions, facets=12, friction=FRICTION, center=(0.0, 0.0, HEIGHT), **options):
    """Ordinary contacts on the floor under a base of 60 kg."""
    contacts = [UnilateralContact(position=p, friction=friction, facets=facets) for p in positions]
    return Support(contacts, mass=MASS, center_of_mass=center, inertia=[3.0, 4.0, 5.0], **options)


def clamp(kind, position, facets=8, **options):
    """A clamp with moderate parameters."""
    parameters = {"friction_upper": 0.5, "friction_lower": 0.4}
    if kind is not RigidClamp:
        parameters["clamp_force"] = 150.0
    if kind in (ForceVariableTwoSidedClamp, ForceConstantTwoSidedClamp):
        parameters["lever_ratio"] = 1.3
    return kind(position=position, facets=facets, **parameters, **options)


def clamped(kind, n=4, facets=8):
    """A base on n corners, the first two of them clamped."""
    places = corners(n)
    contacts = [clamp(kind, p, facets) for p in places[:2]]
    contacts += [UnilateralContact(position=p, friction=FRICTION, facets=facets) for p in places[2:]]
    return Support(contacts, mass=MASS, center_of_mass=[0.0, 0.0, HEIGHT], inertia=[3.0, 4.0, 5.0])


def wrenches(rng, support, count, force=100.0, moment=40.0):
    """Weight plus random forces and moments."""
    d, size = support.dimension, support.wrench_size
    noise = np.hstack([rng.normal(size=(count, d)) * force, rng.normal(size=(count, size - d)) * moment])
    return support.weight + noise


def differences(support, at, value, step=1e-3):
    """Central differences (N, 6) of value(states) and where the modes do not change (N,)."""
    base = solve_many(support, at, warm_start=False)
    result, same = np.zeros(at.shape), np.ones(len(at), dtype=bool)
    for j in range(at.shape[1]):
        shift = np.zeros(at.shape[1])
        shift[j] = step
        ahead, behind = (solve_many(support, at + sign * shift, warm_start=False) for sign in (1, -1))
        result[:, j] = (value(ahead) - value(behind)) / (2 * step)
        for states in (ahead, behind):
            same &= np.all(states.subsets == base.subsets, axis=1)
    return result, same


def relative_errors(gradient, reference, floor=1e-6):
    """(N,) largest component error relative to the largest component."""
    scale = np.maximum(np.max(np.abs(reference), axis=1), floor)
    return np.max(np.abs(gradient - reference), axis=1) / scale
