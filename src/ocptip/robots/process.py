"""The process wrench on the gripper while the arm moves: a force and a moment (2.45)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, bounded_array
from ocptip.basics.frozen import settle

AXES = ("tool", "base", "world")
TIME, SHARE, PATH = "time", "share", "path"
NOWHERE = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class ProcessWrench:
    """The wrench that acts on the gripper, at rest and in motion, before, during and after it.

    The base rests: axes of the world are those of the base, also where a tolerance tilts the floor.

    Attributes:
        force: (3,), N, on the gripper, at the TCP, G; (K, 3) if it varies.
        moment: (3,) or (K, 3), N m, on the gripper.
        axes: "tool": of the gripper, it turns with it; "base" or "world".
        over: what it varies with: "time", s since the motion begins; "share" of the motion's duration, 0 to
            1; "path", m, that the TCP has covered; empty: it is constant.
        knots: (K,), increasing, of that; linear between, constant before and after.

    Raises:
        InputError: naming what cannot be used.
    """

    force: ArrayLike = NOWHERE
    moment: ArrayLike = NOWHERE
    axes: str = "tool"
    over: str = ""
    knots: ArrayLike = ()

    def __post_init__(self) -> None:
        if self.over not in ("", TIME, SHARE, PATH):
            raise InputError(f"over: expected {TIME}, {SHARE}, {PATH} or nothing, got {self.over!r}")
        knots = bounded_array("knots", self.knots, (None,))
        if bool(len(knots)) != self.varies or np.any(np.diff(knots) <= 0):
            raise InputError(
                f"knots: must increase, and be there if the process varies, got {knots.tolist()}"
            )
        shape = (len(knots), 3) if self.varies else (3,)
        arrays = {name: bounded_array(name, getattr(self, name), shape) for name in ("force", "moment")}
        settle(self, **arrays, knots=knots)
        if self.axes not in AXES:
            raise InputError(f"axes: expected one of {', '.join(AXES)}, got {self.axes!r}")

    @property
    def varies(self) -> bool:
        """Whether it is another at other instants."""
        return self.over != ""

    @property
    def wrench(self) -> np.ndarray:
        """(6,): force, then moment, in its axes.

        Raises:
            InputError: it varies. So all that does not follow it from instant to instant refuses it.
        """
        if self.varies:
            raise InputError(
                f"process: varies over {self.over}; plans for stops by brakes, and placements, need one that "
                "does not"
            )
        return np.concatenate([self.force, self.moment])

    @property
    def turns_with_tool(self) -> bool:
        """Whether it is given in the axes of the gripper, not in those of the base."""
        return self.axes == "tool"

    def at(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces and moments (N, 3), in its axes, where what it varies with has these values (N,)."""
        force, moment = (
            np.stack(
                [np.interp(values, np.asarray(self.knots), column) for column in np.transpose(rows)], axis=1
            )
            for rows in (self.force, self.moment)
        )
        return force, moment

    def slopes(self, values: np.ndarray) -> np.ndarray:
        """(N, 6): slopes of force and moment over what it varies with; at knots those after them."""
        rows, knots = np.hstack([self.force, self.moment]), np.asarray(self.knots)
        steps = np.diff(rows, axis=0) / np.diff(knots)[:, None]
        still = np.zeros((1, 6))
        return np.vstack([still, steps, still])[np.searchsorted(knots, values, side="right")]

    def between(self, first: float, last: float) -> ProcessWrench:
        """This process, if it varies, but constant before `first` and after `last`."""
        knots = np.asarray(self.knots)
        instants = np.unique([first, *knots[(knots > first) & (knots < last)], last])
        return replace(self, knots=instants, **dict(zip(("force", "moment"), self.at(instants), strict=True)))

    def at_pace(self, factor: float) -> ProcessWrench:
        """The same with all times multiplied by a factor > 0, if it varies over time."""
        return replace(self, knots=factor * np.asarray(self.knots)) if self.over == TIME else self

    def resting(self, share: float) -> ProcessWrench | None:
        """The constant one before (0) or after (1) a motion whose duration and length are not known.

        None: what acts then depends on these.
        """
        if share and self.over != SHARE:
            return None
        force, moment = self.at(np.array([share]))
        return ProcessWrench(force[0], moment[0], self.axes)

    def over_time(self, times: np.ndarray, values: np.ndarray) -> ProcessWrench:
        """The same over time, if what it varies with goes through values (T,), not falling, at times (T,), s.

        Between these times it is taken to go straight.
        """
        columns = np.interp(np.asarray(self.knots), values, times)
        instants = np.unique(np.concatenate([times, columns]))
        force, moment = self.at(np.interp(instants, times, values))
        return ProcessWrench(force, moment, self.axes, TIME, instants)

    def seen_from(self, rotation: np.ndarray) -> ProcessWrench:
        """This process for a base frame to which `rotation` (3, 3) maps the axes of the present one."""
        if self.turns_with_tool:
            return self
        return replace(self, force=self.force @ rotation.T, moment=self.moment @ rotation.T)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        varying = {"over": self.over, "knots": list(np.asarray(self.knots))} if self.varies else {}
        return {"force_N": self.force, "moment_Nm": self.moment, "axes": self.axes, **varying}

    def __str__(self) -> str:
        """In words."""
        on = f"on the gripper, in axes of the {self.axes}"
        if self.varies:
            peaks = [np.max(np.linalg.norm(rows, axis=1)) for rows in (self.force, self.moment)]
            return f"up to {peaks[0]:.4g} N and {peaks[1]:.4g} N m {on}, over {self.over}"
        parts = [("N", np.asarray(self.force)), ("N m", np.asarray(self.moment))]
        words = [f"({', '.join(f'{x:.4g}' for x in v)}) {unit}" for unit, v in parts if np.any(v)]
        return f"{' and '.join(words) or 'nothing'} {on}, all the time"
