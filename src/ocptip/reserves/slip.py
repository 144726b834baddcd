"""Friction utilisation GT: the smallest share of the friction limits with which the contacts hold the base.

The solver's basic solution puts forces on edges of the friction pyramid, which says nothing about the margin.
Therefore the forces are redistributed so that the largest usage |tangential force| / limit becomes as small
as possible while the equation of motion (4.13) holds with the accelerations of the state. Source: thesis M,
section 4.3, (4.12) to (4.18).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.laws import carries
from ocptip.contact.bindings.pyramid import radius_error
from ocptip.contact.resting import solve_resting
from ocptip.contact.states import ContactStates
from ocptip.contact.support import Support
from ocptip.reserves.force_sets import LOAD_TOLERANCE, ForceSets, FreeForces, force_scale, force_units
from ocptip.reserves.fractional import NEGLIGIBLE_LIMIT, minimise_fraction
from ocptip.reserves.minimax import GAP_TOLERANCE, ZERO_USAGE, minimise_usage
from ocptip.reserves.optimality import ForceRange, forces_of, lengths
from ocptip.reserves.planar import usage_map
from ocptip.reserves.wheel_forces import WheelForces
from ocptip.reserves.wrench_cone import ConeMap, wrench_half_spaces

Redistribution = Literal["tangential", "full"]

LARGEST_SQUEEZE = 10.0
"""Bound of the normal forces in a full redistribution, relative to the largest force or limit."""

UNSOLVED = 10.0
"""GT in programs where it is not known."""

_RANK_TOLERANCE = 1e-9
_CHUNK = 10_000  # wrenches that half spaces are multiplied with at once
_FIRST, _LEAST = 16, 1e-3  # of `Slip.greatest`: wrenches tried first, smallest GT that matters
_SHARE, _LEVEL = 0.95, 0.98  # share of the greatest that matters; ratio of the levels of half spaces


@dataclass(frozen=True, eq=False)
class SlipReserve:
    """Friction utilisation of N states; NaN where the contact state or the redistribution is not solved.

    Attributes:
        slip_ratio: (N,) smallest largest usage of the friction limits (4.12); 0 without a loaded contact; at
            least 1 where what slides is loaded but without friction, or nothing but unloaded contacts (a base
            that falls between walls).
        slide_acceleration: (N,) maximum tangential acceleration of a loaded contact, m/s^2 (of any contact
            where only unloaded ones move): how fast it slides beyond the limit; 0 where no contact slides.
        tangential_forces: (N, n, d - 1) redistributed, in contact axes (t1, t2), N.
        normal_forces: (N, n) N; those of the contact state unless redistributed in full.
        usage: (N, n) |tangential force| / limit; 0 for loaded contacts without friction, which need none; NaN
            for contacts that carry no load.
        gradient: (N, 6) derivative of GT with respect to the wrench (1 per N, N m); None if not asked for.
            Zero for a slip ratio of zero, which is a kink.
        solved: (N,) True where the optimum is proved.
        residual: (N,) the larger of the relative error of the equation of motion and the gap between the
            ratio and its lower bound (full: the estimated distance from the optimum).
        status: N sentences.
    """

    slip_ratio: np.ndarray
    slide_acceleration: np.ndarray
    tangential_forces: np.ndarray
    normal_forces: np.ndarray
    usage: np.ndarray
    gradient: np.ndarray | None
    solved: np.ndarray
    residual: np.ndarray
    status: tuple[str, ...]

    @cached_property
    def GT(self) -> np.ndarray:
        """(N,) slip ratio, below 1 where nothing slides, plus the value of the slide acceleration.

        The sum is by analogy with (4.11); thesis M has no such part. It only orders states.
        """
        return self.slip_ratio + self.slide_acceleration

    @property
    def forces(self) -> np.ndarray:
        """(N, n, d), N: normal, then tangential; zero where there is no solution."""
        return np.nan_to_num(np.concatenate([self.normal_forces[:, :, None], self.tangential_forces], axis=2))

    def for_program(self) -> tuple[np.ndarray, np.ndarray]:
        """(N,) GT, large where it is not known, and its gradient (N, 6), zero where there is none."""
        assert self.gradient is not None  # it was asked for
        return known(self.GT), np.nan_to_num(self.gradient)


def known(GT: np.ndarray) -> np.ndarray:
    """GT, a large number where it is not known."""
    return np.where(np.isfinite(GT), GT, UNSOLVED)


class Slip:
    """Friction utilisation of a support.

    Contacts take part that can carry a tangential force: those with a limit above zero at their normal force.
    For ordinary contacts these are the loaded ones, as in thesis M; a preloaded clamp takes part even if the
    solver happens to put no force on it.

    Args:
        support: the base on its contacts.
        redistribution: "tangential" keeps the normal forces of the state, as thesis M does. "full" also
            redistributes the normal forces (which are one choice of many with four or more feet, or where
            normals differ), within the convex piece of the force set in which the state's normal force lies.
            It never gives a larger ratio. Where a contact slides or lifts, sliding friction is bound to the
            normal force, and "full" is the same as "tangential". Where contacts can squeeze each other
            without limit, their normal forces end at LARGEST_SQUEEZE times the largest force or limit of the
            state, and the status says so. Default: "tangential" where normal forces are unique (three feet on
            a plane, or compliant feet), else "full".

    Attributes:
        redistribution: the one in use.
    """

    def __init__(self, support: Support, redistribution: Redistribution | None = None) -> None:
        if redistribution is not None and redistribution not in get_args(Redistribution):
            raise InputError(
                f"redistribution: expected one of {get_args(Redistribution)}, got {redistribution!r}"
            )
        self.support = support
        self._sets = ForceSets(support)
        self._free = FreeForces(support, self._sets)
        self._maps: dict[float, SlipMap] = {}
        self._cones: dict[float, np.ndarray | None] = {}
        if redistribution is None:
            _, basis, _ = self._free.basis(np.ones(support.n_contacts, dtype=bool), True)
            redistribution = "full" if np.any(basis[:, 0]) and not support.elastic else "tangential"
        self.redistribution: Redistribution = redistribution

    def evaluate(
        self,
        states: ContactStates,
        derivatives: bool = True,
        *,
        least: float = 0.0,
        only_maximum: bool = False,
    ) -> SlipReserve:
        """Friction utilisation of states of this support.

        A full redistribution takes a cone program per state. Forces that keep the state's normal forces are
        feasible, so that their usage is an upper bound, which costs a hundredth of that.

        Args:
            states: of this support.
            derivatives: whether gradients are wanted.
            least: where the upper bound of GT is at most this, the bound is given.
            only_maximum: the same where it is at most 95 % of the maximum of all states, and of 1.

        Raises:
            InputError: the states belong to another support.
        """
        if states.support is not self.support:
            raise InputError("states: belong to another support")
        work = _Work(states, self._sets)
        self._redistribute_tangential(work)
        raised = work.escapes & (work.ratio < 1.0)
        work.ratio[raised], work.pull[raised] = 1.0, 0.0
        if self._sets.held:
            WheelForces(self.support, self._sets).redistribute(work)
        elif self.redistribution == "full":
            self._share_where_it_decides(work, least, only_maximum, derivatives)
        return self._result(work, derivatives)

    def half_spaces(self, GT: float) -> np.ndarray | None:
        """Rows a (m, 6): GT is kept under wrenches w on the base with a . w <= 0, see `wrench_cone`.

        None where that set is no such cone: with contacts other than ordinary ones, or normal forces that
        are not redistributed although they could be.
        """
        _, basis, _ = self._free.basis(np.ones(self.support.n_contacts, dtype=bool), True)
        unique = not np.any(basis[:, 0])
        if not self._sets.ordinary or not (unique or self.redistribution == "full"):
            return None
        if GT not in self._cones:
            self._cones[GT] = wrench_half_spaces(self.support, GT * self._sets.friction)
        return self._cones[GT]

    def above(self, wrenches: np.ndarray, least: float) -> np.ndarray:
        """GT (N,) under wrenches (N, 6) on the base; `least` where half spaces tell that it is no more.

        NaN where it is not known.
        """
        rows, GT = self.half_spaces(least), np.full(len(wrenches), least)
        todo = np.arange(len(wrenches)) if rows is None else np.flatnonzero(_beyond(rows, wrenches) > 0)
        GT[todo] = np.maximum(self._of(wrenches[todo], least=least), least)
        return GT

    def greatest(
        self, *wrenches: np.ndarray, values: Callable[[np.ndarray], np.ndarray] | None = None
    ) -> np.ndarray:
        """GT (N,) under wrenches (N, 6), exact near its maximum; NaN where it is not known.

        Values of at most 95 % of the maximum, and of 1, may be replaced by one number between both.

        Args:
            wrenches: of one array or several, that count together: half spaces are evaluated for each.
            values: of the states at indices (k,), one for each; default: GT under the first wrenches.
        """
        values = values or (lambda some: self._of(wrenches[0][some], only_maximum=True))
        every = np.arange(len(wrenches[0]))
        if len(every) <= _FIRST or (rows := self.half_spaces(1.0)) is None:
            return values(every)
        order = np.argsort(-np.max([_beyond(rows, wrench) for wrench in wrenches], axis=0))
        first, others, result = order[:_FIRST], order[_FIRST:], np.empty(len(every))
        result[first] = values(first)
        result[others] = level = self.level_below(float(np.max(known(result[first]))))
        if (rows := self.half_spaces(level)) is not None:
            others = others[np.any([_beyond(rows, wrench[others]) > 0 for wrench in wrenches], axis=0)]
        result[others] = values(others)
        return result

    @staticmethod
    def level_below(maximum: float) -> float:
        """GT that is at most 95 % of a maximum, and of 1, and below which states matter less.

        One of few numbers, so that half spaces are computed once for several maxima.
        """
        return min(_LEVEL ** np.ceil(np.log(_SHARE * max(maximum, _LEAST)) / np.log(_LEVEL)), _SHARE)

    def _of(self, wrenches: np.ndarray, **decides: Any) -> np.ndarray:
        if not len(wrenches):
            return np.empty(0)
        return self.evaluate(solve_resting(self.support, wrenches), derivatives=False, **decides).GT

    @property
    def sure(self) -> float:
        """GT up to which contacts hold for sure; as pyramids they may let go before round cones do."""
        contacts = self.support.contacts if self._sets.ordinary else ()
        return min((1 - radius_error(contact.facets) for contact in contacts), default=1.0)

    def within(self, GT: float) -> tuple[ConeMap | SlipMap, float]:
        """A smooth function of the wrench for programs, and a bound of it below which GT is at most this.

        Of contacts whose normal forces are redistributed it is how near the cone of `half_spaces` is.
        """
        most = min(GT, self.sure)
        rows = self.half_spaces(most) if self.redistribution == "full" else None
        if rows is None:
            slip_map = self.map(
                most if self._sets.ordinary else np.inf
            )  # of clamps smooth only while they hold
            return slip_map, most if slip_map.smooth else GT
        weight = self.support.mass * float(np.linalg.norm(self.support.gravity))
        return ConeMap(rows, max(float(np.mean(self._sets.friction)), 0.1) * weight), 1.0

    def map(self, up_to: float) -> SlipMap:
        """GT as a smooth function of the wrench, as far as it is at most `up_to`."""
        if up_to not in self._maps:
            self._maps[up_to] = SlipMap(self, up_to)
        return self._maps[up_to]

    def _redistribute_tangential(self, work: _Work) -> None:
        todo = np.flatnonzero(work.carries.any(axis=1))
        for rows, picked, basis, J in self._free.groups(todo, work.carries, with_normals=False):
            picks, Q = (rows[:, None], picked), basis[:, :, 1:]
            limits, slope = work.limits.value[picks], work.limits.slope[picks]
            optimum = minimise_usage(work.forces[picks][:, :, 1:], Q, limits, J)
            work.forces[(*picks, slice(1, None))] = optimum.forces
            work.pull[(*picks, slice(1, None))] = optimum.pull
            work.pull[(*picks, 0)] = -optimum.usage[:, None] * lengths(optimum.pull) * slope
            work.usage[picks] = lengths(work.forces[picks][:, :, 1:]) / limits
            work.ratio[rows], work.gap[rows] = optimum.usage, optimum.gap
            for row, solved, status in zip(rows, optimum.solved, optimum.status, strict=True):
                work.status[row] = "solved" if solved else f"not proved, an upper bound (Clarabel: {status})"

    def _share_where_it_decides(self, work: _Work, least: float, only_maximum: bool, exact: bool) -> None:
        """In full, the states with the largest upper bounds first."""
        certified = work.gap <= GAP_TOLERANCE * np.maximum(1.0, work.ratio)
        bound = np.where(certified, work.ratio, np.inf)
        todo = np.flatnonzero((bound > max(least, ZERO_USAGE)) & work.states.persistent)
        if not only_maximum:
            self._redistribute_full(work, todo, exact)
            return
        moving = work.states.solved & ~work.states.persistent
        maximum = np.max((work.ratio + work.slide)[moving], initial=0.0)
        todo, count = todo[np.argsort(-bound[todo], kind="stable")], _FIRST
        while len(todo):
            self._redistribute_full(work, np.sort(todo[:count]), exact)
            maximum = max(maximum, np.max(work.ratio[todo[:count]]))
            todo, count = todo[count:], 2 * count
            todo = todo[bound[todo] > _SHARE * min(maximum, 1.0)]

    def _redistribute_full(self, work: _Work, todo: np.ndarray, exact: bool) -> None:
        for rows, picked, basis, balances in self._free.groups(todo, work.carries, with_normals=True):
            picks, unit, Q = (rows[:, None], picked), work.scale[rows][:, None], basis[:, :, 1:]
            grip = self._sets.grip[picked]
            units = unit[:, :, None] * force_units(grip, basis.shape[2])
            limits, forces = work.limits, work.forces[picks] / units
            normals = ForceRange(
                normal=forces[:, :, 0],
                per_z=basis[:, :, 0],
                radius=limits.radius[picks] / unit / grip,
                slope=limits.slope[picks] / grip,
                lower=np.maximum(limits.normal_min[picks] / unit, -LARGEST_SQUEEZE),
                upper=np.minimum(limits.normal_max[picks] / unit, LARGEST_SQUEEZE),
            )
            optimum = minimise_fraction(forces[:, :, 1:], Q, normals, balances, exact)
            new_normals, new_limits = normals.normals(optimum.z), normals.limits(optimum.z)
            tangential = forces[:, :, 1:] + forces_of(Q, optimum.z)
            work.forces[picks] = np.concatenate([new_normals[:, :, None], tangential], axis=2) * units
            known = np.isfinite(optimum.gap)
            work.pull[rows[known]] = 0.0
            work.pull[rows[known, None], picked[known]] = (
                np.concatenate([optimum.normal_pull[:, :, None], optimum.pull], axis=2) / units
            )[known]
            loaded = new_limits > NEGLIGIBLE_LIMIT * np.max(new_limits, axis=1, keepdims=True)
            used = lengths(tangential) / np.where(loaded, new_limits, 1.0)
            # Forces on contacts with hardly any load are known to rounding of the larger ones.
            used = np.where(known[:, None], np.minimum(used, optimum.usage[:, None]), used)
            work.usage[picks] = np.where(loaded, used, np.nan)
            work.ratio[rows], work.gap[rows] = optimum.usage, optimum.gap
            squeezed = np.any(np.abs(new_normals) > 0.99 * LARGEST_SQUEEZE, axis=1)
            for i, row in enumerate(rows):
                if not known[i] or optimum.gap[i] > GAP_TOLERANCE * max(1.0, optimum.usage[i]):
                    work.status[row] = f"not proved, an upper bound (Clarabel: {optimum.status[i]})"
                elif squeezed[i]:
                    work.status[row] = "solved; contacts squeeze each other up to the bound of normal forces"

    def _result(self, work: _Work, derivatives: bool) -> SlipReserve:
        states = work.states
        solved = states.solved & (work.gap <= GAP_TOLERANCE * np.maximum(1.0, work.ratio))
        change = (work.forces - work.start).reshape(len(states), self._free.matrix.shape[1])
        residual = np.max(np.abs(change @ self._free.matrix.T), axis=1) / work.scale
        sliding = np.flatnonzero(work.slide)
        unknown = np.where(states.solved, 0.0, np.nan)
        gradient = None
        if derivatives:
            gradient = work.slopes + np.einsum("sic,sicw->sw", work.pull, states.force_maps)
            if len(sliding):
                fastest = work.fastest[sliding]
                direction = states.contact_accelerations[sliding, fastest, 1:] / work.slide[sliding, None]
                maps = states.select(sliding).acceleration_maps[np.arange(len(sliding)), fastest, 1:]
                gradient[sliding] += np.einsum("sc,scw->sw", direction, maps)
        return SlipReserve(
            slip_ratio=work.ratio + unknown,
            slide_acceleration=work.slide + unknown,
            tangential_forces=work.forces[:, :, 1:] + unknown[:, None, None],
            normal_forces=work.forces[:, :, 0] + unknown[:, None],
            usage=work.usage,
            gradient=gradient,
            solved=solved,
            residual=np.maximum(residual, work.gap) + unknown,
            status=tuple(work.status),
        )


class SlipMap:
    """GT as a function of the wrench for nonlinear programs: smooth also where the base slides.

    Where three contacts on a plane stand, feet or clamps whose forces are one piece, at most one of them
    without friction, and GT is at most `up_to`, values are GT. Beyond, and where a clamp lets go, they are
    the usage of friction that standing would need, as long as all limits and loads of casters are positive.
    Elsewhere, and of all other supports, they are GT as
    :class:`Slip` has it, a large number where unknown, second derivatives then zero.

    Args:
        slip: of the support.
        up_to: GT that matters.
    """

    def __init__(self, slip: Slip, up_to: float) -> None:
        self._slip, self._smooth = slip, None
        support, sets = slip.support, slip._sets
        if slip.redistribution == "full" or not sets.single_pieces or support.elastic:
            return
        picked, _, J = slip._free.basis(np.ones(support.n_contacts, dtype=bool), False)
        if J is None or len(picked) < support.n_contacts or up_to > slip.sure:
            return
        rough = ~sets.frictionless
        carrying = support.wrench_matrix * carries(support.contacts).ravel()
        forces = -np.linalg.pinv(carrying).reshape(support.n_contacts, 3, 6)
        if np.max(np.abs(support.wrench_matrix @ forces.reshape(-1, 6) + np.eye(6))) > _RANK_TOLERANCE:
            return
        loads = np.einsum("ikr,ikw->rw", J, forces[rough, 1:])
        limits, packed = sets.friction[:, None] * forces[:, 0], np.ascontiguousarray
        self._smooth = packed(loads), packed(limits[rough]), packed(sets.radius[rough]), packed(J)
        self._casters = forces[~rough, 0], sets.lower[~rough]

    @property
    def smooth(self) -> bool:
        """Whether there are three such contacts."""
        return self._smooth is not None

    def __call__(
        self, wrenches: np.ndarray, derivatives: bool = True
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Values (N,), slopes (N, 6) and second derivatives (N, 6, 6) at wrenches (N, 6)."""
        if self._smooth is not None:
            values, slopes, bends = usage_map(wrenches, *self._smooth, derivatives)
            loads, least = self._casters
            lifted = np.any(wrenches @ loads.T < least, axis=1)
            values[lifted], slopes[lifted], bends[lifted] = np.nan, 0.0, 0.0
        else:
            count = len(wrenches)
            values, slopes, bends = np.full(count, np.nan), np.zeros((count, 6)), np.zeros((count, 6, 6))
        others = np.flatnonzero(np.isnan(values))
        if len(others):
            reserve = self._slip.evaluate(solve_resting(self._slip.support, wrenches[others]), derivatives)
            values[others] = known(reserve.GT)
            if derivatives:
                slopes[others] = reserve.for_program()[1]
        return values, slopes, bends


def _beyond(rows: np.ndarray, wrenches: np.ndarray) -> np.ndarray:
    """(N,) largest a . w of rows a (m, 6) for wrenches w (N, 6); in pieces that fit into memory."""
    parts = np.array_split(wrenches, 1 + len(wrenches) // _CHUNK)
    return np.concatenate([np.max(part @ rows.T, axis=1) for part in parts])


class _Work:
    """Forces and multipliers of N states while they are redistributed; all contacts, contact axes."""

    def __init__(self, states: ContactStates, sets: ForceSets) -> None:
        self.states = states
        solved = states.solved
        self.start = np.where(solved[:, None, None], states.contact_forces, 0.0)
        self.forces = self.start.copy()
        self.scale = np.where(solved, force_scale(states), 1.0)
        self.limits = sets.limits(self.start[:, :, 0], self.scale)
        self.scale = np.maximum(self.scale, np.max(self.limits.value, axis=1))
        self.carries = solved[:, None] & (self.limits.value > LOAD_TOLERANCE * self.scale[:, None])
        loaded = np.abs(self.start[:, :, 0]) > LOAD_TOLERANCE * self.scale[:, None]
        on_ice = solved[:, None] & loaded & sets.frictionless
        speeds = lengths(states.contact_accelerations[:, :, 1:])
        slides = np.where(self.carries | on_ice, speeds, 0.0)
        lifts = np.max(np.abs(states.contact_accelerations[:, :, 0]), axis=1)
        moves = np.maximum(np.max(slides, axis=1), lifts)
        falls = solved & ~states.persistent & (moves <= states.rest_limit)
        slides[falls] = speeds[falls]
        self.fastest, largest = np.argmax(slides, axis=1), np.max(slides, axis=1)
        self.slide = np.where(largest > states.rest_limit, largest, 0.0)
        self.escapes = falls | np.any(on_ice & (slides > states.rest_limit[:, None]), axis=1)
        count = len(states)
        self.ratio, self.gap = np.zeros(count), np.zeros(count)
        self.usage = np.where(on_ice, 0.0, np.nan)
        self.pull, self.slopes = np.zeros_like(self.forces), np.zeros_like(states.wrenches)
        self.status = [
            "no loaded contact" if solved[s] else f"no contact state: {states.status(s)}"
            for s in range(count)
        ]
