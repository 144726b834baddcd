"""Stewart-Gough platforms with control number 1: the families L_H and L_S and named members.

Each family has two shape parameters; the closed forms are evaluated and the result is checked: a member is
returned only if its control number is 1 up to rounding. Source: [Naw07] 7.3.1, 7.3.2, (7.35) to (7.82), and
its examples 6.4 and 7.3.3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ocptip.basics.errors import InputError, SolverError, number_from, whole_number
from ocptip.indices.platforms.controllability import ControlNumber, control_number
from ocptip.indices.platforms.platform import PlatformPose
from studies.indices.designs.isotropic_families import sign_triple
from studies.indices.designs.optimal_domains import main_roots, special_limit
from studies.indices.designs.symmetric_platforms import SymmetricPlatform

DEFECT = 1e-8
"""Members with a control number below 1 - DEFECT are refused: the closed form lost its digits."""


@dataclass(frozen=True, eq=False)
class OptimalPlatform:
    """A platform in a pose with control number 1.

    Attributes:
        family: "L_H" (equal legs) or "L_S" (first group in a plane).
        platform: the two groups of legs.
        control: the control number, with its evidence.
    """

    family: Literal["L_H", "L_S"]
    platform: SymmetricPlatform
    control: ControlNumber

    @property
    def pose(self) -> PlatformPose:
        """Base and platform anchors, x on the base, y on the platform."""
        return self.platform.pose()

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        pose = self.pose
        return {
            "family": self.family,
            "parameters": self.platform.to_dict(),
            "base": pose.base.tolist(),
            "platform": pose.platform.tolist(),
            "control_number": self.control.to_dict(),
        }


def ctn_optimal_main(
    t: float,
    r1: float,
    *,
    root: int = 1,
    branch: int = 1,
    phi1_sign: int = 1,
    mu: float = 0.0,
    g: int = 3,
) -> OptimalPlatform:
    """Member of the main family L_H: all legs of the same length |r1| sqrt(2 t^2 + 1) ([Naw07] 7.3.1).

    Args:
        t: shape, -1 < t < 1, not 0.
        r1: reach of the first group, not 0.
        root: 1 to 4, the roots b1; for t = +-1/2 only 1 and 2. `main_roots(t, r1)` lists the real ones.
        branch: 1 to 4: sign of the root in a2, b2 (+ + - -) and of r2 (+ - + -).
        phi1_sign: +1 or -1, sign of Phi1.
        mu: rotation of the second group against the first, rad; CTN does not depend on it.
        g: legs per group, >= 3.

    Raises:
        InputError: an argument outside of its range; the root is not real for this (t, r1).
        SolverError: the closed form has lost its digits (next to t = +-1/2 or to the domain's border).
    """
    t, r1, mu = number_from("t", t), number_from("r1", r1), number_from("mu", mu)
    g = whole_number("g", g, 3)
    root, branch = whole_number("root", root, 1, 4), whole_number("branch", branch, 1, 4)
    sign = _sign("phi1_sign", phi1_sign)
    roots = main_roots(t, r1)
    if root not in roots:
        real = ", ".join(map(str, roots)) or "none"
        raise InputError(f"root: root {root} is not real for t = {t}, r1 = {r1}; real roots: {real}")
    b1 = roots[root]
    candidates = []
    for cosine in _main_cosines(t, r1, b1):
        platform = _main_member(t, r1, b1, sign * math.acos(cosine), branch, mu, g)
        if platform is not None:
            candidates.append((platform, control_number(platform.pose())))
    return _verified("L_H", candidates, f"t = {t}, r1 = {r1}, root {root}")


def ctn_optimal_special(
    t: float,
    r1: float,
    *,
    signs: tuple[int, int, int] = (1, 1, 1),
    phi1_sign: int = 1,
    mu: float = 0.0,
    g: int = 3,
) -> OptimalPlatform:
    """Member of the special family L_S: the first group in a plane, the second on a cone ([Naw07] 7.3.2).

    Args:
        t: ratio r2 / r1, -1 < t < 1, not 0.
        r1: reach of the first group, 0 < |r1| <= special_limit(t).
        signs: of b1, of the inner root in b1, and of the root in a2.
        phi1_sign: +1 or -1, sign of Phi1.
        mu, g: as for :func:`ctn_optimal_main`.

    Raises:
        InputError: an argument outside of its range.
        SolverError: the closed form has lost its digits.
    """
    t, r1, mu = number_from("t", t), number_from("r1", r1), number_from("mu", mu)
    g = whole_number("g", g, 3)
    outer, inner, height = sign_triple(signs)
    limit = special_limit(t)
    if not 0.0 < abs(r1) <= limit * (1.0 + 1e-12):
        raise InputError(f"r1: expected 0 < |r1| <= {limit:.9g} for t = {t}, got {r1}")
    r2 = t * r1
    p, q = r1 * r1, r2 * r2
    square = p * p - q * q
    V = 12 * (p * p + 2 * p * q + 5 * q * q) * (p + 3 * q) ** 2
    V -= 9 * q * (p + q) * (-9 * q**3 + 17 * p * q * q + 13 * p * p * q + 3 * p**3)
    H3 = 21 * p**3 + 32 * p * p + 81 * p * p * q + 192 * p * q + 159 * p * q * q + 27 * q**3 + 288 * q * q
    H3 += inner * 8 * r1 * math.sqrt(max(V, 0.0))
    b1 = outer * r2 * math.sqrt(max((p + 3 * q) ** 3 * square * H3, 0.0))
    b1 /= math.sqrt(3.0) * (p + 3 * q) ** 3 * (3 * p - q)
    cosine = q * square * (3 * q + 32 + 21 * p) - 3 * b1 * b1 * (p + 3 * q) * (3 * p - q) ** 2
    cosine = _clipped(cosine / (-16.0 * math.sqrt(3.0) * r1 * q * square))
    if cosine is None:
        raise SolverError(f"t = {t}, r1 = {r1}: no real angle Phi1")
    half = height * r2 * math.sqrt(square)
    a2, b2 = ((b1 * (p + q) + s * half) / (-2.0 * (p - q)) for s in (1.0, -1.0))
    F = math.sqrt(3.0) * (b1 * (a2 - b2) ** 2 + q * (a2 + b1)) / (2.0 * r2 * (b2 - a2))
    phi1 = _sign("phi1_sign", phi1_sign) * math.acos(cosine)
    platform = SymmetricPlatform.from_parameters(
        a1=b1, b1=b1, r1=r1, phi1=phi1, F=F, a2=a2, b2=b2, r2=r2, phi2=0.0, mu=mu, g=g
    )
    return _verified("L_S", [(platform, control_number(platform.pose()))], f"t = {t}, r1 = {r1}")


def example_main(mu: float = 0.0, phi_sign: int = 1) -> OptimalPlatform:
    """K_M: the member of L_H at t = +-1/2, |r1| = (2/3) sqrt 6, isotropic for CDN_OE ([Naw07] 7.3.3)."""
    r, phi = 2.0 / 3.0 * math.sqrt(6.0), _sign("phi_sign", phi_sign) * math.pi / 2.0
    a1 = 2.0 / math.sqrt(3.0)
    platform = SymmetricPlatform.from_parameters(
        a1=a1, b1=0.0, r1=r, phi1=phi, F=1.0, a2=-a1, b2=0.0, r2=r, phi2=phi, mu=number_from("mu", mu)
    )
    return _verified("L_H", [(platform, control_number(platform.pose()))], "K_M")


def example_special() -> OptimalPlatform:
    """K_S: the member of L_S with equal legs, t = sqrt(3)/3."""
    a1, half = -math.sqrt(87.0) / 12.0, math.sqrt(15.0) / 6.0
    platform = SymmetricPlatform.from_parameters(
        a1=a1,
        b1=a1,
        r1=math.sqrt(10.0) / 2.0,
        phi1=-math.pi / 2.0,
        F=math.sqrt(2.0) * (math.sqrt(29.0) - math.sqrt(5.0)) / 8.0,
        a2=-a1 + half,
        b2=-a1 - half,
        r2=math.sqrt(30.0) / 6.0,
        phi2=0.0,
        mu=math.pi / 3.0,
    )
    return _verified("L_S", [(platform, control_number(platform.pose()))], "K_S")


def _main_member(
    t: float, r1: float, b1: float, phi1: float, branch: int, mu: float, g: int
) -> SymmetricPlatform | None:
    """Steps of the main case, [Naw07] 7.3.1."""
    a1 = math.sqrt(2.0) * t * r1 + b1
    d, total = a1 - b1, 2.0 * b1 + math.sqrt(2.0) * t * r1
    root = math.sqrt(6.0 * r1 * r1 - 3.0 * d * d) * (1.0 if branch <= 2 else -1.0)
    a2, b2 = -(3.0 * total + root) / 6.0, -(3.0 * total - root) / 6.0
    r2 = math.sqrt((4.0 * d * d + r1 * r1) / 3.0) * (1.0 if branch % 2 else -1.0)
    across = 2.0 * math.sqrt(3.0) * math.sin(phi1) * r1 * d
    along = r1 * (r1 * (2.0 * a1 - b2 - b1) + 2.0 * math.sqrt(3.0) * math.cos(phi1) * d)
    along -= 4.0 * d * d * (total + b2)
    phi2 = math.atan(across / along) if along != 0.0 else math.pi / 2.0
    denominator = r2 * math.sin(phi2) * (d * d + r1 * r1) * (a2 - b2)
    if denominator == 0.0:
        return None
    F = -r1 * math.sin(phi1) * ((a2 - b2) ** 2 + r2 * r2) * d / denominator
    return SymmetricPlatform.from_parameters(
        a1=a1, b1=b1, r1=r1, phi1=phi1, F=F, a2=a2, b2=b2, r2=r2, phi2=phi2, mu=mu, g=g
    )


def _main_cosines(t: float, r1: float, b1: float) -> list[float]:
    """The real ones of H- and H+ (7.46, 7.47)."""
    a1 = math.sqrt(2.0) * t * r1 + b1
    d, q = a1 - b1, r1 * r1
    W = -6 * q**4 - 8 * q**3 * (6 * b1 * b1 - 12 * a1 * b1 + 9 * a1 * a1 - 4)
    W += 24 * q * (2 * a1 * a1 + 5 * a1 * b1 - b1 * b1 + 12) * d**4
    W -= 3 * q * q * (33 * a1 * a1 - 78 * a1 * b1 + 33 * b1 * b1 - 64) * d * d
    W -= 16 * (12 * a1 * b1 + 3 * b1 * b1 - 8) * d**6
    lead = q * q + q * (11 * a1 - 5 * b1) * d - 4 * (2 * a1 + b1) * d**3
    divisor = -4.0 * math.sqrt(3.0) * r1 * (4 * d * d + q)
    root = math.sqrt(max(W, 0.0))
    cosines = [_clipped((lead - s * root) / divisor) for s in (1.0, -1.0)]
    return [cosine for cosine in cosines if cosine is not None]


def _clipped(cosine: float) -> float | None:
    """The cosine, rounding beyond +-1 removed; None if it is no cosine."""
    return None if not abs(cosine) <= 1.0 + 1e-7 else float(np.clip(cosine, -1.0, 1.0))


def _verified(
    family: Literal["L_H", "L_S"], candidates: list[tuple[SymmetricPlatform, ControlNumber]], where: str
) -> OptimalPlatform:
    if not candidates:
        raise SolverError(f"{family}, {where}: no real angle Phi1")
    platform, control = max(candidates, key=lambda item: item[1].value)
    if control.value < 1.0 - DEFECT:
        raise SolverError(f"{family}, {where}: the closed form gives CTN = {control.value:.9f}, not 1")
    return OptimalPlatform(family, platform, control)


def _sign(name: str, value: object) -> int:
    if value not in (1, -1):
        raise InputError(f"{name}: expected +1 or -1, got {value!r}")
    return int(value)
