"""Random supports and wrenches, seeded, for the robustness studies and the tests.

Two to eight contacts, coplanar or not, 4 to 16 facets, friction 0.05 to 1.5, any mixture of bindings,
wrenches of 1e-9 N to 1e6 N, and exactly degenerate cases: pure weight on regular polygons, no load at
all, wrenches that put the resultant exactly on a contact or on a tipping axis, exactly on the friction
pyramid, equal and opposite normals.
"""

from __future__ import annotations

import numpy as np

from ocptip.contact.bindings.binding import Binding
from ocptip.contact.bindings.clamps import (
    ForceConstantHalfRigidClamp,
    ForceConstantTwoSidedClamp,
    ForceVariableHalfRigidClamp,
    ForceVariableTwoSidedClamp,
    RigidClamp,
)
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support

CLAMPS = (
    RigidClamp,
    ForceVariableHalfRigidClamp,
    ForceVariableTwoSidedClamp,
    ForceConstantHalfRigidClamp,
    ForceConstantTwoSidedClamp,
)


def random_binding(
    rng: np.random.Generator, binding: type[Binding], position: np.ndarray, normal: np.ndarray, facets: int
) -> Binding:
    """A binding of the given class with random parameters."""
    place = {"position": position, "normal": normal, "facets": facets}
    if binding is UnilateralContact:
        return UnilateralContact(friction=friction(rng), **place)
    jaws = {"friction_upper": friction(rng), "friction_lower": friction(rng)}
    if binding is RigidClamp:
        return RigidClamp(**jaws, **place)
    force = {"clamp_force": float(10 ** rng.uniform(0, 4))}
    if binding in (ForceVariableTwoSidedClamp, ForceConstantTwoSidedClamp):
        force["lever_ratio"] = float(10 ** rng.uniform(-0.7, 0.7))
    return binding(**jaws, **force, **place)


def friction(rng: np.random.Generator) -> float:
    """Random Coulomb coefficient, 0.05 to 1.5."""
    return float(np.exp(rng.uniform(np.log(0.05), np.log(1.5))))


def random_support(
    rng: np.random.Generator, *, clamps: bool = True, planar: bool = False, n: int | None = None
) -> Support:
    """A support with 2 to 8 contacts; `clamps=False` for ordinary contacts only."""
    n = int(rng.integers(2, 9)) if n is None else n
    facets = int(rng.integers(4, 17))
    d = 2 if planar else 3
    layout = rng.choice(["polygon", "plane", "space"])
    up = np.eye(d)[-1]
    if layout == "polygon":
        angles = 2 * np.pi * np.arange(n) / n + (0.0 if rng.random() < 0.5 else np.pi / n)
        positions = np.zeros((n, d))
        positions[:, 0] = 0.35 * np.cos(angles)
        if not planar:
            positions[:, 1] = 0.35 * np.sin(angles)
        normals = np.tile(up, (n, 1))
    elif layout == "plane":
        positions = rng.uniform(-0.5, 0.5, (n, d))
        positions[:, -1] = 0.0
        normals = np.tile(up, (n, 1))
    else:
        positions = rng.uniform(-0.5, 0.5, (n, d))
        normals = up + rng.normal(size=(n, d)) * rng.uniform(0.05, 1.0)
        if rng.random() < 0.1:
            normals[1] = -normals[0]
    share = 0.0 if not clamps else rng.choice([0.0, 0.3, 1.0])
    contacts = [
        random_binding(
            rng,
            CLAMPS[rng.integers(len(CLAMPS))] if rng.random() < share else UnilateralContact,
            p,
            q,
            facets,
        )
        for p, q in zip(positions, normals, strict=True)
    ]
    center = np.zeros(d)
    center[-1] = 0.6
    inertia = float(rng.uniform(1, 6)) if planar else rng.uniform(1, 6, 3) + 2.0
    return Support(contacts, mass=60.0, center_of_mass=center, inertia=inertia)


def random_wrenches(rng: np.random.Generator, support: Support, count: int) -> np.ndarray:
    """`count` wrenches on a support, a third of them exactly degenerate."""
    d, size = support.dimension, support.wrench_size
    wrenches = np.empty((count, size))
    for i in range(count):
        case = rng.random()
        if case < 0.45:
            level = rng.uniform(0, 1)
            h = (
                support.weight
                + np.concatenate([rng.normal(size=d) * 200, rng.normal(size=size - d) * 90]) * level
            )
        elif case < 0.65:
            h = rng.normal(size=size) * 10 ** rng.uniform(-9, 6)
        elif case < 0.70:
            h = np.zeros(size)
        elif case < 0.80:
            h = support.weight * 10 ** rng.uniform(-9, 3)
        elif case < 0.90:
            h = _through(support, support.weight[:d], _point(rng, support))
        else:
            k = int(rng.integers(support.n_contacts))
            columns = support.contacts[k].columns.force
            force = support.frames[k] @ columns[:, int(rng.integers(columns.shape[1]))]
            h = -_through(support, force * 10 ** rng.uniform(-9, 5), support.contacts[k].position)
        wrenches[i] = h
    return wrenches


def _point(rng: np.random.Generator, support: Support) -> np.ndarray:
    """A contact, or the middle between two contacts (on a tipping axis)."""
    i, j = rng.integers(support.n_contacts, size=2)
    return 0.5 * (support.contacts[i].position + support.contacts[j].position)


def _through(support: Support, force: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Wrench of a force acting at a point, about the centre of mass."""
    arm = point - support.center_of_mass
    if support.dimension == 3:
        return np.concatenate([force, np.cross(arm, force)])
    return np.array([force[0], force[1], arm[0] * force[1] - arm[1] * force[0]])
