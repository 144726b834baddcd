"""An example task for an arm: its base, and a motion near zero, clear of all, that the drives hold at rest.

The base is that of the URDF if it has one, else one that carries the arm.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.numerics.inertia import ROUNDED, why_impossible
from ocptip.robots.collision.gaps import CLEARANCE, Collisions, random_postures, usual_clearance
from ocptip.robots.collision.model import ShapeCollisions
from ocptip.robots.collision.shapes import ArmGeometry
from ocptip.robots.dynamics import STANDARD_GRAVITY, evaluate_dynamics
from ocptip.robots.geometry import floor
from ocptip.robots.model import ArmModel
from ocptip.robots.urdf.file import UrdfFile
from ocptip.robots.urdf.ground_contacts import GroundContact, ground_contacts, inside
from ocptip.robots.urdf.resting import resting_body, resting_links

PLURALS = {"wheel": "wheels", "rocker": "rockers", "caster": "casters", "foot": "feet"}

_SHARE = 0.5
"""Links that rest are a base if they weigh at least this share of the arm; lighter ones are its foot."""

_PART, _WIDE_FOOT = 0.01, 0.15
"""A base has two links and more of at least this share of its mass, or reaches so far, m, to all sides of its
middle; another single link is the foot of the arm."""

_HEAVIER, _LEAST_MASS = 3.0, 80.0
"""Mass of an invented base: a multiple of that of the arm, and a minimum, kg."""

_WIDE, _LEAST_HALF = 0.25, np.array([0.3, 0.25])
"""Feet of an invented base are this share of the arm's reach from its middle, and at least so far, m."""

_CENTRED = 0.2
"""The centre of mass of a base keeps this share of the distance of the feet's middle from their edges."""

_HEIGHT = 0.5
"""m, of an invented base."""


@dataclass(frozen=True, eq=False)
class ExampleBase:
    """A base whose origin is on the ground below the origin of the arm's base link.

    Attributes:
        mass: kg.
        center_of_mass: (3,), m.
        inertia: (3, 3), kg m^2, about the centre of mass; None: of an invented base, or one that no body has.
        contacts: points on the ground, from the origin.
        height: m, of the base link's frame.
        of_urdf: mass, centre of mass and inertia are those of the URDF's links that rest.
        contacts_of_urdf: contacts and height follow from the URDF's geometry.
        foot_mass, foot_center: kg, and (3,) m, of resting links that an invented base has to contain.
    """

    mass: float
    center_of_mass: np.ndarray
    inertia: np.ndarray | None
    contacts: tuple[GroundContact, ...]
    height: float
    of_urdf: bool
    contacts_of_urdf: bool
    foot_mass: float = 0.0
    foot_center: np.ndarray = field(default_factory=lambda: np.zeros(3))

    @property
    def feet(self) -> np.ndarray:
        """(k, 3), m, positions of the contacts."""
        return np.array([contact.position for contact in self.contacts])

    @property
    def source(self) -> str:
        """Where the numbers come from, one sentence."""
        if not self.of_urdf:
            return "mass, centre of mass, feet and height are invented, for the URDF has no base"
        kinds = Counter("rocker" if contact.pivot else contact.kind for contact in self.contacts)
        contacts = " and ".join(f"{n} {kind if n == 1 else PLURALS[kind]}" for kind, n in kinds.items())
        shown = "of its geometry" if self.contacts_of_urdf else "that are invented, for no solid shows them"
        body = "mass, centre of mass and inertia are those of the URDF's links that rest"
        rockers = "".join(
            f"; {name} lets two wheels rock: one contact at its pivot stands for both"
            if pivot
            else f"; {name} moves in the URDF and counts as fixed"
            for name, pivot in dict.fromkeys(
                (contact.rocker, contact.pivot) for contact in self.contacts if contact.rocker
            )
        )
        return f"{body}; it stands on {contacts} {shown}{rockers}"


def example_base(file: UrdfFile, arm: ArmModel) -> ExampleBase:
    """The base for an arm: that of its URDF, or one that carries it.

    A URDF has a base if its links that rest have wheels, or are driven over the ground by joints, or are
    several of some mass that stand by themselves.

    Args:
        file: the URDF.
        arm: read from it, not mounted.
    """
    carried = float(arm.masses.sum())
    mass, centre, inertia = resting_body(file.path, arm)
    try:
        contacts = ground_contacts(file, arm, centre)
    except InputError:  # that the geometry cannot be read is said where collisions are
        contacts = []
    half = np.maximum(_LEAST_HALF, np.round(_WIDE * arm.reach * np.array([1.0, 0.8]), 2))
    invented = tuple(
        GroundContact("foot", np.array([x, y, 0.0]), "invented")
        for x, y in half * [[1, 1], [1, -1], [-1, -1], [-1, 1]]
    )
    parts = sum(file.masses.get(link, 0.0) > _PART * mass for link in resting_links(file, arm))
    drives = any(contact.kind != "foot" for contact in contacts) or arm.base_link != file.root
    spread = parts > 1 or (contacts and _spread(contacts) > _WIDE_FOOT)
    feet = np.array([contact.position for contact in contacts])
    stands = mass >= _SHARE * carried and spread
    stands = stands and (not contacts or inside(feet, centre[None])[0] >= _CENTRED * _spread(contacts))
    if not mass or not (stands or (drives and arm.base_link == file.standing)):
        heavy = max(_LEAST_MASS, 10 * np.round(_HEAVIER * carried / 10), np.ceil(mass))
        middle = np.array([0.0, 0.0, 0.3])
        high = centre + np.array([0.0, 0.0, _HEIGHT]) if mass else np.zeros(3)
        return ExampleBase(heavy, middle, None, invented, _HEIGHT, False, False, mass, high)
    height = -float(contacts[0].position[2]) if contacts else _HEIGHT
    lifted = tuple(replace(foot, position=foot.position * [1.0, 1.0, 0.0]) for foot in contacts)
    about = None if why_impossible(inertia, ROUNDED * np.abs(inertia).max()) else inertia
    return ExampleBase(
        mass, centre + np.array([0.0, 0.0, height]), about, lifted or invented, height, True, bool(contacts)
    )


def _spread(contacts: Sequence[GroundContact]) -> float:
    """m, from the middle of the contacts to their nearest edge."""
    feet = np.array([contact.position for contact in contacts])
    return float(inside(feet, feet.mean(axis=0)[None])[0])


TURN, SLIDE = np.deg2rad(30), 0.1
"""How far joints move at most in the example, rad and m."""

_CLEARANCES = (0.03, 0.01, 0.003, 0.0)
"""m: the first that some motion keeps counts. Some arms have links that are always within 10 mm."""

_TORQUE = 0.7
"""Share of the torque limits that gravity may need in the example."""

_INSIDE = 0.4
"""The centre of all masses keeps this share of the distance from the middle of the feet to their edges."""

_INSET = 2e-5
"""rad or m, from the limits of joints: the file has six digits."""

_SHARES = ((1.0, 0.5), (0.25, 0.1))
"""Shares of these steps; the smaller ones are for arms whose links overlap almost everywhere."""

_POSTURES, _STARTS, _STEPS = 300, 50, 16


@dataclass(frozen=True)
class ExampleMotion:
    """Two postures between which a straight motion of all joints is possible.

    Attributes:
        start, goal: (n,), rad or m.
        clear: m, by how much the straight motion is known to be clear of all; None: it was not checked;
            negative: the search has no clear motion.
        usual: m, the clearance that counts where none is given.
        nearest: the pair of links because of which it is below the default; empty: it is not.
    """

    start: np.ndarray
    goal: np.ndarray
    clear: float | None
    usual: float = CLEARANCE
    nearest: str = ""

    @property
    def source(self) -> str:
        """What is known about collisions of the example, one sentence."""
        if self.clear is None:
            return "start and goal are an example, not checked for collisions"
        if not np.isfinite(self.clear):
            return "start and goal are an example; no two solids can collide that do not always touch"
        if self.clear < 0:
            return "start and goal are an example in which links overlap: the search has no clear one"
        return f"start and goal are an example {1e3 * self.clear:.0f} mm clear of arm and ground"


def example_motion(arm: ArmModel, geometry: ArmGeometry | None, base: ExampleBase) -> ExampleMotion:
    """A motion that starts as near to zero as collisions, torques at rest and the base allow.

    Args:
        arm: not mounted.
        geometry: its collision geometry; None: collisions are not checked.
        base: on which it stands.
    """
    zero = np.clip(np.zeros(arm.n), *_limits(arm))
    mounted = replace(arm, geometry=geometry).mounted([0.0, 0.0, base.height], np.eye(3))
    collisions = Collisions(arm.n) if geometry is None else ShapeCollisions(mounted, [floor(0.0)])
    starts = _starts(arm, zero)
    gaps, held = collisions.least(starts), _held(mounted, base, starts)
    for shares, must_hold, clearance in product(_SHARES, (True, False), _CLEARANCES):
        for start in starts[(gaps >= clearance) & (held | (not must_hold))][:_STARTS]:
            goals = np.array(list(_goals(arm, start, shares)))
            for goal in goals[collisions.least(goals) >= clearance]:
                line = start + np.linspace(0.0, 1.0, 21)[:, None] * (goal - start)
                gap = float(collisions.least(line).min())
                if gap >= clearance and not (must_hold and not _held(mounted, base, line).all()):
                    usual, pair = usual_clearance(mounted, collisions)
                    near = "" if pair is None else str(pair)
                    return ExampleMotion(start, goal, None if geometry is None else gap, usual, near)
    return ExampleMotion(zero, next(_goals(arm, zero, _SHARES[0])), -1.0)


def _held(arm: ArmModel, base: ExampleBase, q: np.ndarray) -> np.ndarray:
    """(N,) True where drives hold the arm at rest and the centre of all masses is well above the feet."""
    rest = np.zeros_like(q)
    load = evaluate_dynamics(arm, q, rest, rest)
    strong = (np.abs(load.torque) <= _TORQUE * arm.limits.torque).all(axis=1)
    force, moment = load.wrench[:, :3], load.wrench[:, 3:]
    weight = np.maximum(-force[:, 2], 1e-9)
    carried = np.column_stack([moment[:, 1], -moment[:, 0]]) / weight[:, None]
    masses = weight / -STANDARD_GRAVITY[2]
    whole = (masses[:, None] * carried + base.mass * base.center_of_mass[:2]) / (masses + base.mass)[:, None]
    middle = base.feet[:, :2].mean(axis=0)
    return strong & (inside(base.feet, whole) >= _INSIDE * inside(base.feet, middle[None]))


def _starts(arm: ArmModel, zero: np.ndarray) -> np.ndarray:
    """Postures (N, n), zero first, then those nearest to it; in whole degrees and centimetres."""
    drawn = random_postures(arm, _POSTURES)[1:]
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    near = zero + np.multiply.outer([0.25, 0.5, 1.0], drawn - zero).reshape(-1, arm.n)
    postures = np.vstack([zero, near])
    far = np.abs(postures - zero) / np.maximum(high - low, 1e-9)
    unit = np.where(arm.prismatic, 0.01, np.deg2rad(1))
    rounded = np.round(postures[np.argsort(far.max(axis=1), kind="stable")] / unit) * unit
    return np.clip(rounded, *_limits(arm))


def _limits(arm: ArmModel) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest joint values (n,) of the example."""
    low, high = arm.limits.angle_min, arm.limits.angle_max
    inset = np.minimum(_INSET, 0.1 * (high - low))
    return low + inset, high - inset


def _goals(arm: ArmModel, start: np.ndarray, shares: Sequence[float]) -> Iterator[np.ndarray]:
    """Goals near a start, at shares of the full steps: all joints upwards within limits, then other
    directions.
    """
    low, high = _limits(arm)
    full = np.where(arm.prismatic, SLIDE, TURN)
    rng = np.random.default_rng(0)
    signs = [np.ones(arm.n), *rng.choice([-1.0, 1.0], (_STEPS, arm.n))]
    for share in shares:
        for sign in signs:
            step = share * sign * full
            there = start + step
            back = np.clip(start - step, low, high)
            yield np.where((there <= high) & (there >= low), there, back)
