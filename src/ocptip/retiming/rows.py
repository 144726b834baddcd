"""The limits of a robot along a path, as half planes of u = d2s/dt2 and x = (ds/dt)^2.

With q(s), speeds are q' sqrt(x), accelerations q' u + q'' x; torques and the wrench on the base are affine in
(u, x). So are the rows of most limits; of the others the rows are tangents at given (u, x), which bound their
convex sets from outside.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ocptip.basics.text import joint_words
from ocptip.retiming.whole_body import BaseLimits, BasePath
from ocptip.standing.instants import Instants, NodeColumns
from ocptip.standing.limit_kinds.kinds import AccelerationLimit, FurtherLimit, SpeedLimit, limits_of
from ocptip.standing.limit_kinds.limit import ORDINARY, Limit
from ocptip.standing.limit_kinds.rows import NodeSlopes
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.stops.along_path import Affine, affine_loads
from ocptip.trajectories.path import JointPath, PathTiming

FASTEST = 1e6  # 1/s^2: x is never greater: a path takes at least a millisecond
NEAR = 0.995  # of a limit: where its tangents are taken
_SLOWEST = 1e-3  # of the mean of x: tangents of sqrt(x) are taken there, or where it is faster
_FLAT = 1e-9  # of further quantities in their units: they do not change with the speed


@dataclass(frozen=True, eq=False)
class PathClock:
    """When places of a path are passed: what acts over time is taken then.

    Attributes:
        timing: of the path, of a round before.
        shift: s, by which it is passed later; before the start it is time 0.
        fixed: s, of all places instead; None: as the timing says.
    """

    timing: PathTiming
    shift: float = 0.0
    fixed: float | None = None

    def times(self, s: np.ndarray) -> np.ndarray:
        """(P,) s, at places (P,)."""
        if self.fixed is not None:
            return np.full(len(s), self.fixed)
        return np.maximum(self.timing.passes(s)[0] + self.shift, 0.0)

    def pace(self, s: np.ndarray) -> np.ndarray:
        """(P,), 1/s: ds/dt there, not below a small share of its mean."""
        return np.sqrt(np.maximum(self.timing.passes(s)[1] ** 2, _SLOWEST * np.mean(self.timing.x)))


@dataclass(frozen=True, eq=False)
class Places:
    """P places of a path, with their loads.

    Attributes:
        robot: whose.
        s: (P,).
        q, dq, ddq: (P, n), the path and its derivatives over s.
        clock: gives the times of what acts there; without one they are s.
        base: on its path, where that is part of the path.
    """

    robot: StandingMechanism
    s: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray
    clock: PathClock | None = None
    base: BasePath | None = None

    @classmethod
    def of(
        cls,
        robot: StandingMechanism,
        path: JointPath,
        s: np.ndarray,
        left: np.ndarray,
        clock: PathClock | None = None,
    ) -> Places:
        """At s (P,); where `left` (P,) is True, with the derivatives before them."""
        before, after = path.at(s, side="left"), path.at(s)
        parts = [np.where(left[:, None], a, b) for a, b in zip(before, after, strict=True)]
        more = path.joints - robot.n
        pose, d, dd = (part[:, :more] for part in parts)
        q, dq, ddq = (part[:, more:] for part in parts)
        return cls(robot, s, q, dq, ddq, clock, BasePath(pose, d, dd) if more else None)

    def __len__(self) -> int:
        return len(self.s)

    def some(self, rows: np.ndarray) -> Places:
        """Some of them."""
        parts = {name: getattr(self, name)[rows] for name in ("s", "q", "dq", "ddq")}
        return replace(self, **parts, base=self.base and self.base.some(rows))

    @cached_property
    def times(self) -> np.ndarray:
        """(P,), of what acts."""
        return self.s if self.clock is None else self.clock.times(self.s)

    def acting(self, u: np.ndarray, x: np.ndarray) -> np.ndarray:
        """(P, k): what acts, see `StandingMechanism.acting`, at path accelerations u and squared speeds x."""
        return self._process if self.base is None else self.base.rows(u, x)

    @cached_property
    def _process(self) -> np.ndarray:
        return self.robot.acting(self.times)

    @cached_property
    def _in_states(self) -> np.ndarray:
        """What acts in the states of `affine_loads`."""
        if self.base is None:
            return self._process
        one, none = np.ones(len(self)), np.zeros(len(self))
        return np.stack([self.base.rows(u, x) for u, x in ((one, none), (none, one), (none, none))])

    @cached_property
    def loads(self) -> tuple[Affine, ...]:
        """Torques, then the wrenches on each interface."""
        return affine_loads(self.robot, self.q, self.dq, self.ddq, self._in_states, self._pace)

    @property
    def _pace(self) -> np.ndarray | None:
        """(P,), 1/s: ds/dt at which Coriolis forces of a base that turns are taken; None: there are none."""
        if self.clock is None:
            return None
        driving = self.robot.acts.split(self._process)[1]
        return self.clock.pace(self.s) if driving is not None and driving.turns else None

    @cached_property
    def caps(self) -> np.ndarray:
        """(P,), 1/s^2: maximum x that limits of speeds allow."""
        robot, further_limits = self.robot, self.robot.further_limits
        pace = 1 / np.maximum(np.max(np.abs(self.dq) / robot.limits.speed, axis=1), FASTEST**-0.5)
        if further_limits.count:  # affine in the speeds
            rest = robot.further(self.q, np.zeros_like(self.dq))
            rates = robot.further(self.q, self.dq) - rest
            for rate, margin in ((rates, further_limits.upper - rest), (-rates, rest - further_limits.lower)):
                share = np.divide(
                    margin, rate, out=np.full_like(rate, np.inf), where=rate > _FLAT * further_limits.units
                )
                pace = np.minimum(pace, np.maximum(np.min(share, axis=1), 0.0))
        return pace**2

    def instants(self, u: np.ndarray, x: np.ndarray) -> Instants:
        """The instants at the points with path accelerations u and squared path speeds x, (P,) each."""
        acting, u, x = self.acting(u, x), u[:, None], x[:, None]
        torque, wrench = (part[0] * u + part[1] * x + part[2] for part in self.loads[:2])
        qd, qdd = self.dq * np.sqrt(x), self.dq * u + self.ddq * x
        return Instants(self.robot, self.q, torque, wrench, self.robot.further(self.q, qd), qd, qdd, acting)

    def slopes(self, instants: Instants, u: np.ndarray, x: np.ndarray) -> NodeSlopes:
        """Over (u, x), of the state, of torques and wrenches; those of all else are 0."""
        n, count = self.q.shape[1], len(self)
        speeds = np.maximum(x, 1e-12)[:, None]
        still = np.zeros_like(instants.process)
        acting = (still, still) if self.base is None else self.base.slopes(speeds[:, 0])
        of_u = np.hstack([np.zeros((count, 2 * n)), self.dq, acting[0]])
        of_x = np.hstack([np.zeros((count, n)), self.dq / (2 * np.sqrt(speeds)), self.ddq, acting[1]])
        power, none = np.zeros((count, 1)), np.zeros_like(instants.further)
        carried = [speeds.wrenches for speeds in instants.interfaces[1:]]
        y = np.hstack([power, instants.torques, instants.wrenches, instants.further, *carried])
        parts = [
            np.hstack(
                [power, *(load[k] for load in self.loads[:2]), none, *(load[k] for load in self.loads[2:])]
            )
            for k in range(2)
        ]
        columns = NodeColumns(instants.torques.shape[1], instants.further.shape[1], len(instants.interfaces))
        return NodeSlopes(columns, instants.s, np.stack([of_u, of_x], axis=2), y, np.stack(parts, axis=2))


@dataclass(frozen=True, eq=False)
class HalfPlanes:
    """Rows alpha u + beta x <= gamma, (P, L) each.

    Attributes:
        names: (L,) of the limits.
    """

    names: tuple[str, ...]
    alpha: np.ndarray
    beta: np.ndarray
    gamma: np.ndarray

    @classmethod
    def joined(cls, parts: Iterable[HalfPlanes]) -> HalfPlanes:
        """All rows of several."""
        every = list(parts)
        if len(every) == 1:  # with objects a copy takes as long as what it copies
            return every[0]
        blocks = (
            np.hstack([getattr(planes, name) for planes in every]) for name in ("alpha", "beta", "gamma")
        )
        return cls(tuple(name for planes in every for name in planes.names), *blocks)


@dataclass(frozen=True, eq=False)
class Tangents:
    """Rows alpha u + beta x <= gamma, (R,) each, that hold at places (R,).

    Attributes:
        names: (R,) of the limits.
    """

    places: np.ndarray
    names: list[str]
    alpha: np.ndarray
    beta: np.ndarray
    gamma: np.ndarray


class TimingLimits:
    """The limits of a robot that are a matter of timing.

    Args:
        robot: whose.
        asked: the task's numbers.
        base: limits of a base whose path is part of the path.

    Attributes:
        curved: limits of which there are only tangents.
        later: names of limits that a check sees, but no timing: at acceleration steps and in stops.
    """

    def __init__(self, robot: StandingMechanism, asked: Limits, base: BaseLimits | None = None) -> None:
        self.robot = robot
        self.asked, self.base = asked, base
        self._affine: list[Limit] = []
        self._cones: list[tuple[str, int, np.ndarray]] = []
        self.curved: list[Limit] = []
        self.later: list[str] = []
        masses = [robot.mass, *(interface.support.mass for interface in robot.interfaces[1:])]
        self._units = np.array(masses) * (float(np.linalg.norm(robot.support.gravity)) or 1.0)
        for limit in limits_of(robot, asked):
            if limit.of_place or not limit.width or isinstance(limit, FurtherLimit):
                continue
            if ORDINARY not in limit.node_kinds:
                self.later.append(limit.name)
            elif (rows := limit.half_spaces()) is not None:
                self._cones.append((limit.name, limit.interface, rows))
            else:
                (self._affine if limit.affine else self.curved).append(limit)

    def half_planes(self, places: Places) -> HalfPlanes:
        """All rows but the caps of x and the tangents."""
        robot, names, blocks = self.robot, [], []
        acceleration = robot.limits.acceleration
        known = np.isfinite(acceleration)
        rates = [part[:, known] / acceleration[known] for part in (places.dq, places.ddq)]
        names += [AccelerationLimit.name] * (2 * int(known.sum()))
        blocks += [
            np.stack([*rates, np.ones_like(rates[0])]),
            np.stack([*(-rate for rate in rates), np.ones_like(rates[0])]),
        ]
        wrenches = places.loads[1:]
        if places.base is not None and self.base is not None:
            of_base, block = places.base.half_planes(self.base, wrenches[0])
            names += of_base
            blocks.append(block)
        # Cones of objects have ten thousand rows, which take longer to copy than to compute.
        begin = sum(block.shape[2] for block in blocks)
        names += [name for name, _, rows in self._cones for _ in rows]
        end = begin + sum(len(rows) for *_, rows in self._cones)
        others = self._affine_rows(places)
        names += [limit.name for limit, block in others for _ in range(block.shape[2])]
        planes = np.empty((3, len(places), len(names)))
        np.concatenate(blocks, axis=2, out=planes[:, :, :begin])
        if others:
            np.concatenate([block for _, block in others], axis=2, out=planes[:, :, end:])
        for _, interface, rows in self._cones:
            end, scaled = begin + len(rows), rows.T / self._units[interface]
            for part, weights, out in zip(
                wrenches[interface], (scaled, scaled, -scaled), planes, strict=True
            ):
                np.matmul(part, weights, out=out[:, begin:end])
            begin = end
        return HalfPlanes(tuple(names), *planes)

    def _affine_rows(self, places: Places) -> list[tuple[Limit, np.ndarray]]:
        if not self._affine:
            return []
        still, every = np.zeros(len(places)), len(places)
        slopes = places.slopes(places.instants(still, still), still, still)
        masks = [np.ones((every, limit.width), dtype=bool) for limit in self._affine]
        return [
            (limit, _both_sides(limit, limit.rows(slopes, mask), every))
            for limit, mask in zip(self._affine, masks, strict=True)
        ]

    def tangents(self, places: Places, u: np.ndarray, x: np.ndarray) -> Tangents:
        """Tangents of the curved limits, where their use is near 1 or more, at u and x (P,)."""
        instants = places.instants(u, x)
        slopes = places.slopes(instants, u, x)
        results: list[tuple[np.ndarray, str, np.ndarray]] = []
        for limit in self.curved:
            mask = limit.near(instants, NEAR)
            if not mask.any():
                continue
            rows = limit.chosen(instants).rows(slopes, mask)
            lower, upper = limit.bounds_of(rows)
            on = limit.jacobian(rows)
            here = rows.values - on[:, 0] * u[rows.nodes] - on[:, 1] * x[rows.nodes]
            for sign, bound in ((1.0, upper), (-1.0, -lower)):
                some = np.isfinite(bound)
                block = np.stack([sign * on[:, 0], sign * on[:, 1], bound - sign * here])[:, some]
                results.append((rows.nodes[some], limit.name, block))
        if not results:
            return Tangents(np.empty(0, dtype=int), [], *np.empty((3, 0)))
        names = [name for nodes, name, _ in results for _ in nodes]
        return Tangents(
            np.concatenate([f[0] for f in results]), names, *np.concatenate([f[2] for f in results], axis=1)
        )

    def why_not_at_rest(self, places: Places) -> tuple[str, list[str]] | None:
        """The first place at which the robot cannot rest, in words, and why; None: it can everywhere."""
        kinds: Sequence[Limit] = limits_of(self.robot, self.asked)
        kinds = [limit for limit in kinds if not limit.of_place and limit.name != SpeedLimit.name]
        for k in range(len(places)):
            resting = Instants.at_rest(self.robot, places.q[k : k + 1], places.times[k : k + 1])
            if reasons := [reason for limit in kinds for reason in limit.refusals(resting)]:
                when = "" if places.clock is None else f", passed at {places.times[k]:.3f} s"
                joints = joint_words(self.robot.names, self.robot.units, places.q[k])
                return f"s = {places.s[k]:.4f}{when}, {joints}", reasons
        return None


def _both_sides(limit: Limit, rows, count: int) -> np.ndarray:
    """(3, P, L) of all rows of an affine limit at P places."""
    lower, upper = limit.bounds()
    on, values = limit.jacobian(rows).reshape(count, limit.width, 2), rows.values.reshape(count, limit.width)
    sides = []
    for sign, bound in ((1.0, upper), (-1.0, -lower)):
        some = np.isfinite(bound)
        sides.append(
            np.stack([sign * on[:, some, 0], sign * on[:, some, 1], (bound - sign * values)[:, some]])
        )
    return np.concatenate(sides, axis=2)
