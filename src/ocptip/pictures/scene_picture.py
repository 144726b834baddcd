"""The numbers of one state of a scene as they are drawn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ocptip.basics.text import percent, quantity, without_noise
from ocptip.contact.states import ContactStates
from ocptip.reserves.force_sets import ForceSets, force_scale
from ocptip.reserves.slip import SlipReserve
from ocptip.reserves.tipping import TipOverReserve
from ocptip.task_files.scene import Scene

_ROUNDING = 1e-9  # of the friction used
_SCALES = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)


@dataclass(frozen=True)
class DrawnLoad:
    """A load: force (d,), N, its moment (3,), planar (), N m, and where the force acts (d,), m; base axes."""

    force: np.ndarray
    moment: np.ndarray
    point: np.ndarray


@dataclass(frozen=True)
class ScenePicture:
    """The numbers of one state as they are drawn; forces in N, rounding noise set to zero."""

    scene: Scene
    states: ContactStates
    tip: TipOverReserve
    slip: SlipReserve
    index: int

    @cached_property
    def positions(self) -> np.ndarray:
        """(n, d) contact points, m."""
        return np.array([c.position for c in self.scene.support.contacts])

    @cached_property
    def contact_forces(self) -> np.ndarray:
        """(n, d) in contact axes, as the friction optimum distributes them; those of the contact solver where
        it failed.
        """
        normal, tangential = self.slip.normal_forces[self.index], self.slip.tangential_forces[self.index]
        spread = np.column_stack([normal, tangential])
        return without_noise(
            spread if np.all(np.isfinite(spread)) else self.states.contact_forces[self.index]
        )

    @property
    def normal_forces(self) -> np.ndarray:
        """(n,) NaN where there is no answer."""
        return self.contact_forces[:, 0]

    @cached_property
    def forces(self) -> np.ndarray:
        """(n, d) in base axes; zero where there is no answer."""
        return np.nan_to_num(np.einsum("kij,kj->ki", self.scene.support.frames, self.contact_forces))

    @cached_property
    def tangential(self) -> np.ndarray:
        """(n, d) tangential forces in base axes."""
        frames = self.scene.support.frames
        return np.nan_to_num(np.einsum("kij,kj->ki", frames[:, :, 1:], self.contact_forces[:, 1:]))

    @cached_property
    def limits(self) -> np.ndarray:
        """(n,) largest tangential force that each contact can bear at its normal force."""
        if not np.all(np.isfinite(self.normal_forces)):
            return np.zeros(len(self.positions))
        scale = force_scale(self.states)[[self.index]]
        return ForceSets(self.scene.support).limits(self.normal_forces[None], scale).value[0]

    @cached_property
    def modes(self) -> list[str]:
        return self.states.modes(self.index)

    @cached_property
    def usage(self) -> np.ndarray:
        """(n,) share of the friction limit that is used; NaN for contacts without load."""
        return np.asarray(self.slip.usage[self.index], dtype=float)

    @cached_property
    def axes(self) -> Sequence[Any]:
        """The potential tipping axes."""
        return self.tip.tip_over.axes

    @property
    def nearest(self) -> int:
        """Index of the nearest tipping axis, -1 for none."""
        return int(self.tip.nearest_axis[self.index])

    @cached_property
    def loads(self) -> list[DrawnLoad]:
        """The loads; what they leave out is zero."""
        zero = np.zeros(self.scene.support.dimension)
        no_moment = 0.0 if self.scene.planar else zero

        def known(value: Any, otherwise: Any) -> np.ndarray:
            return np.asarray(otherwise if value is None else value, dtype=float)

        return [
            DrawnLoad(known(load.force, zero), known(load.moment, no_moment), known(load.point, zero))
            for load in self.scene.loads
        ]

    @cached_property
    def span(self) -> float:
        """Largest extent of contacts, centre of mass and points of load, m."""
        support = self.scene.support
        loads = [load.point for load in self.loads if np.any(load.force)]
        points = np.vstack([self.positions, support.center_of_mass, *loads])
        return max(float(np.max(np.ptp(points, axis=0))), support.length)

    @property
    def weight(self) -> np.ndarray:
        """(d,) weight of the base."""
        return self.scene.support.mass * self.scene.support.gravity

    @cached_property
    def newton_per_metre(self) -> float:
        """Scale of the force arrows: the largest is about half as long as the span."""
        forces = [self.weight, *(load.force for load in self.loads), *self.forces]
        return nice((longest(np.array(forces, dtype=float)) or 1.0) / (0.5 * self.span))

    @property
    def title(self) -> str:
        """Verdict and margins."""
        state = self.states[self.index]
        verdict = "STABLE" if state.persistent else ("NOT STABLE" if state.solved else "NO ANSWER")
        texts = ", ".join(margin_texts(self.tip, self.slip, self.index))
        return f"{self.scene.name}: {verdict}    {texts}".rstrip()

    def axis_name(self, index: int) -> str:
        """Tipping axis as "1-2"."""
        return "-".join(str(k + 1) for k in sorted(set(self.axes[index].contacts)))

    def nearest_text(self) -> str:
        """Legend text of the nearest tipping axis."""
        moment = float(self.tip.moments[self.index][self.nearest])
        return f"nearest tipping axis {self.axis_name(self.nearest)}: {quantity(moment, 'N m', 3)}"

    def contact_text(self, k: int) -> str:
        """Number, what it does unless it rests, normal force and friction used of contact k."""
        first = f"contact {k + 1}" + ("" if self.modes[k] == "stick" else f": {self.modes[k]}")
        used = f", {percent(self.usage[k])} used" if math.isfinite(self.usage[k]) else ""
        return f"{first}\n{quantity(self.normal_forces[k], 'N', 3)}{used}"


def margin_texts(tip: TipOverReserve, slip: SlipReserve, k: int) -> list[str]:
    """Tipping margin and friction used in state k, as far as it has them."""
    GT, texts = float(slip.GT[k]), []
    GT = 0.0 if GT < _ROUNDING else GT
    if (nearest := int(tip.nearest_axis[k])) >= 0:
        texts.append(f"tipping margin {quantity(max(float(tip.moments[k, nearest]), 0.0), 'N m', 3)}")
    if math.isfinite(GT):  # rounded to 100 %, a value below could contradict the verdict
        used = quantity(100 * GT, "%", 3 if GT < 0.9995 else 6)
        texts.append(f"friction used {used}" if GT < 1 else "slips")
    return texts


def nice(value: float) -> float:
    """The next round number that is not smaller."""
    decade = 10.0 ** math.floor(math.log10(value))
    return next(step * decade for step in _SCALES if step * decade >= value * (1 - 1e-12))


def longest(vectors: np.ndarray) -> float:
    return float(np.max(np.linalg.norm(vectors, axis=1), initial=0.0))
