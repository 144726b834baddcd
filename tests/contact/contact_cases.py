"""Bindings, supports and wrenches shared by the tests of the contact core."""

import numpy as np
from scipy.optimize import nnls

from ocptip.contact.bindings.binding import Binding
from ocptip.contact.bindings.clamps import (
    ForceConstantHalfRigidClamp,
    ForceConstantTwoSidedClamp,
    ForceVariableHalfRigidClamp,
    ForceVariableTwoSidedClamp,
    RigidClamp,
)
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.states import ContactStates
from ocptip.contact.support import Support

KINDS = (
    UnilateralContact,
    RigidClamp,
    ForceVariableHalfRigidClamp,
    ForceVariableTwoSidedClamp,
    ForceConstantHalfRigidClamp,
    ForceConstantTwoSidedClamp,
)
CLAMPS = KINDS[1:]
TWO_SIDED = (ForceVariableTwoSidedClamp, ForceConstantTwoSidedClamp)
GRAVITY = 9.81


def kind_name(kind: type[Binding]) -> str:
    return kind.kind


def parameters(kind: type[Binding]) -> dict[str, float]:
    """Moderate physical parameters; upper and lower jaw differ."""
    if kind is UnilateralContact:
        return {"friction": 0.6}
    values = {"friction_upper": 0.7, "friction_lower": 0.4}
    if kind is not RigidClamp:
        values["clamp_force"] = 120.0
    if kind in TWO_SIDED:
        values["lever_ratio"] = 1.8
    return values


def binding(kind: type[Binding], *, planar: bool = False, **changes) -> Binding:
    """One contact at the origin, normal up, with moderate parameters unless changed."""
    place = {"position": [0.0, 0.0], "normal": [0.0, 1.0]} if planar else {"position": [0.0, 0.0, 0.0]}
    return kind(**{**place, **parameters(kind), **changes})


def feet(positions, *, facets=8, friction=0.5, **options) -> Support:
    """A 60 kg base on ordinary contacts, normals up, in space or in the plane."""
    positions = np.asarray(positions, dtype=float)
    d = positions.shape[1]
    up = np.eye(d)[-1]
    contacts = [UnilateralContact(position=p, normal=up, friction=friction, facets=facets) for p in positions]
    options.setdefault("center_of_mass", 0.6 * up)
    options.setdefault("inertia", [3.0, 4.0, 5.0] if d == 3 else 4.0)
    return Support(contacts, **{"mass": 60.0, **options})


def polygon(n: int, radius: float = 0.35) -> np.ndarray:
    """(n, 3) feet on a circle, as in the standing-platform benchmark."""
    angles = 2 * np.pi * np.arange(n) / n + np.pi / n
    return radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(n)])


def platform_loads(rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 6) loads of the standing-platform benchmark: standing through sliding to tipping."""
    loads = []
    for _ in range(count):
        level = rng.uniform(0, 1)
        lateral = rng.normal(size=2) * 250 * level
        vertical = -60 * GRAVITY + rng.normal() * 150 * level
        loads.append(np.r_[lateral, vertical, rng.normal(size=3) * [90, 90, 60] * level])
    return np.array(loads)


def mixed(kind: type[Binding], *, planar: bool = False, facets: int = 6, n_clamps: int = 1) -> Support:
    """Three feet (two in the plane), the first `n_clamps` of them of the given kind, slightly tilted."""
    if planar:
        places, normals = [[-0.4, 0.0], [0.3, 0.05]], [[0.1, 1.0], [-0.05, 1.0]]
    else:
        places = [[0.4, 0.0, 0.0], [-0.2, 0.35, 0.05], [-0.25, -0.3, 0.0]]
        normals = [[0.1, 0.0, 1.0], [0.0, -0.1, 1.0], [0.05, 0.05, 1.0]]
    kinds = [kind] * n_clamps + [UnilateralContact] * (len(places) - n_clamps)
    contacts = [
        k(position=p, normal=q, facets=facets, **parameters(k))
        for k, p, q in zip(kinds, places, normals, strict=True)
    ]
    up = np.eye(2 if planar else 3)[-1]
    inertia = 4.0 if planar else [3.0, 4.0, 5.0]
    return Support(contacts, mass=60.0, center_of_mass=0.6 * up, inertia=inertia)


def disturbed_weight(rng: np.random.Generator, support: Support, count: int, force=200.0, moment=80.0):
    """(count, 6) or (count, 3): the weight plus random forces and moments."""
    d, size = support.dimension, support.wrench_size
    noise = np.hstack([rng.normal(size=(count, d)) * force, rng.normal(size=(count, size - d)) * moment])
    return support.weight + rng.uniform(0, 1, (count, 1)) * noise


def represents(columns, subset, offset, auxiliary_rhs, force, acceleration=None, tolerance=1e-9) -> bool:
    """Whether non-negative coefficients of a mode's variables give this force (and acceleration)."""
    rows = [columns.force[:, subset], columns.auxiliary[:, subset]]
    right = [force - offset, np.asarray(auxiliary_rhs, dtype=float)]
    if acceleration is not None:
        rows.append(columns.acceleration[:, subset])
        right.append(acceleration)
    right = np.concatenate(right)
    unit = max(1.0, np.max(np.abs(right)))
    _, distance = nnls(np.vstack(rows), right / unit)
    return distance <= tolerance


def corners_of_polygon(contact: Binding) -> np.ndarray:
    """(S, d-1) corners of the pyramid's cross-section whose true cone has radius 1: spec section 2."""
    if contact.planar:
        return np.array([[1.0], [-1.0]])
    S = contact.facets
    c = np.cos(np.pi / S)
    angles = 2 * np.pi * (np.arange(S) + 0.5) / S
    return 2.0 / (1.0 + c) * np.column_stack([np.cos(angles), np.sin(angles)])


def assert_valid(states: ContactStates) -> None:
    """All states are solved and obey the laws by the check that knows nothing of the solver."""
    assert states.solved.all(), [states.status(i) for i in np.flatnonzero(~states.solved)[:3]]
    assert np.max(states.law_violation()) < 1e-8
    assert np.max(states.residual) < 1e-9
