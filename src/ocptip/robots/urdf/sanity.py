"""Whether the inertia of an arm out of a file can be that of an arm."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from ocptip.basics.errors import FARTHEST, InputError, doubt, doubt_metres
from ocptip.basics.text import did_you_mean, some
from ocptip.numerics.inertia import ROUNDED, why_impossible
from ocptip.robots.model import ArmModel

LIGHTEST = 1.5
"""Minimum plausible mass of an arm per cubed length of its chain, kg/m^3: a Kinova j2s6 has 3.3, a UR10 5.3.
"""

HEAVIEST = 1500.0
"""Largest plausible mass per squared length of its chain, kg/m^2: an arm of a PR2 has 41, in grams 41000."""


FASTEST = 50.0
"""Largest plausible speed of a turning joint, rad/s; small servos reach 10."""


class ImpossibleLinksError(InputError):
    """Links that move have an inertia that no body has.

    Attributes:
        links: their names, each with the reason.
    """

    def __init__(self, links: Mapping[str, str]) -> None:
        self.links = dict(links)
        reasons = "; ".join(f"link {name!r}: {reason}" for name, reason in links.items())
        names = ", ".join(f'"{name}"' for name in links)
        super().__init__(f"{reasons}; if that is meant: accept_inertia = [{names}]")


def refuse_impossible_links(
    arm: ArmModel, links: Sequence[Sequence[str]], accepted: bool | Iterable[str] = ()
) -> None:
    """Refuse moving bodies without mass or moments of inertia, or with moments that no body has.

    Args:
        arm: whose bodies are checked; the first moves with its first joint, and so on.
        links: names of the links that each body consists of, the one behind the joint first.
        accepted: links that are not checked; True: all.

    Raises:
        ImpossibleLinksError: with all such links in one line, and what accepts them.
        InputError: an accepted name is no link, or no link has a mass.
    """
    if accepted is True:
        return
    chosen = set(accepted or ())
    known = [name for names in links for name in names]
    for name in sorted(chosen - set(known)):
        raise InputError(
            f"accept_inertia: no moving link {name!r}; there are {', '.join(known)}"
            f"{did_you_mean(name, known)}"
        )
    table = {}
    for names, mass, inertia in zip(links, arm.masses, arm.inertias, strict=True):
        reason = _why_not(mass, inertia)
        if reason and not chosen & set(names):
            table[names[0]] = reason
    if len(table) == arm.n and not arm.masses.any():
        raise InputError(
            "no link that moves has a mass: a model for display, not for planning; give its links "
            "<inertial> with mass and moments of inertia"
        )
    if table:
        raise ImpossibleLinksError(table)


def _why_not(mass: float, inertia: np.ndarray) -> str:
    if mass == 0:
        return "moves, but has no mass"
    largest = float(np.linalg.norm(inertia, 2))
    return why_impossible(inertia, ROUNDED * largest) if largest else "has a mass, but no moments of inertia"


def doubt_arm(arm: ArmModel) -> None:
    """Warn of an arm whose size or mass, without payload, no real arm has.

    Compared is the length of the chain from the first joint to the gripper: 17 kg and 1.19 m are a UR5,
    16.8 kg and 0.99 m a Panda, 28.7 kg and 1.75 m a UR10, 4.4 kg and 1.10 m a Kinova j2s6.
    """
    mass = float(np.sum(arm.with_payload(None).masses))
    length = float(np.sum(np.linalg.norm(arm.offsets, axis=1)))
    doubt_metres(f"arm {arm.name!r}: length of its chain", length)
    if not 0 < length <= FARTHEST or not mass:
        return
    what = f"arm {arm.name!r}: {mass:.4g} kg of moving links on a chain of {length:.3g} m"
    if mass < LIGHTEST * length**3:
        doubt(f"{what} are less than any known arm has; check the masses in the URDF")
    if mass > HEAVIEST * length**2:
        doubt(f"{what} are more than any known arm has; are they grams?")


def doubt_speeds(arm: ArmModel) -> None:
    """Warn of speed limits that no real joint reaches: files that know none have 1000 rad/s."""
    speeds = np.where(arm.prismatic | np.isinf(arm.limits.speed), 0.0, arm.limits.speed)
    if fast := [arm.joint_names[j] for j in np.flatnonzero(speeds > FASTEST)]:
        most = f"{some(fast)} may turn with up to {np.degrees(speeds.max()):.3g} deg/s"
        doubt(f"arm {arm.name!r}: {most}, which no real joint does; give speed_deg_s in [arm.limits]")
