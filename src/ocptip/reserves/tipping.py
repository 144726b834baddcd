"""Tip-over index GN: how far the base is from a rotation about a tipping axis.

A contact's normal margin is the distance of its normal force from the end of its force set at which it lets
go. About every potential tipping axis these margins have a moment sum M_i; when the smallest one vanishes,
the base tips. Source: thesis M, (4.5) to (4.11). There the axes are edges of a polygon, here they are
computed for contacts in any position. Off a plane, where tangential forces also act about the axes, M_i is
the largest moment that can be added about the axis (`tip_moments`); on a plane the two are the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import clarabel
import numpy as np
import scipy  # subpackages load on first use

from ocptip.basics.errors import InputError, SolverError, positive_number
from ocptip.contact.resting import solve_resting
from ocptip.contact.states import ContactStates
from ocptip.contact.support import Support
from ocptip.numerics.cone_program import quiet_settings, solve_cones
from ocptip.reserves.force_sets import ForceSets
from ocptip.reserves.tip_moments import GEOMETRY_TOLERANCE, AddableMoments, find_axes

_ROUNDING = 1e-11
REFERENCE_SHARE = 0.1
"""Reference moment M0 as a share of the largest moment sum without load (source: about 1/10)."""


def moment_at(index: float, reference: float | None) -> float:
    """Minimum moment about a tipping axis, N m, that gives this index: the inverse of `TipOver.ratio`.

    Negative where the base tips: so much is missing. An index above 1 that counts the acceleration of what
    lifts does not tell.

    Args:
        index: GN = M0 / (M0 + M), above 1 it is 1 - M / M0.
        reference: M0, N m; None where nothing tips.
    """
    if not reference or index <= 0:
        return 0.0
    return reference * (1 / index - 1 if index < 1 else 1 - index)


class TipOver:
    """Tip-over index of a support; finds the potential tipping axes once.

    A line through two contacts is a potential tipping axis if a rotation about it lifts at least one contact,
    drives none into the ground and moves none along its normal that cannot: rigid and force-variable clamps
    must lie on it (or move in their tangent plane). A force-constant two-sided clamp yields in both
    directions, so that it may move in either.

    Contacts on one line (or a single one; in the plane all at one point) transmit no moment about it: nothing
    resists such a rotation, whatever the contact models. `free_rotation` is then True and the tip ratio 1 for
    every state. Without any axis (for example three rigid clamps) the base cannot tip: tip ratio 0.

    Args:
        support: the base on its contacts.
        reference_moment: M0 > 0, N m; default a tenth of the largest min_i M_i that normal forces with the
            sum of the weight can have (preloads of clamps not counted). On a horizontal plane that is
            a tenth of the weight times the radius of the circle inscribed in the support polygon.

    Attributes:
        axes: the potential tipping axes, coinciding ones merged.
        free_rotation: True if nothing resists a rotation.
        reference_moment: M0, N m; None where no moment sum is needed.

    Raises:
        InputError: M0 not positive, or no M0 given where gravity is zero.
    """

    def __init__(self, support: Support, reference_moment: float | None = None) -> None:
        self.support = support
        self._sets = ForceSets(support)
        self.free_rotation, self.axes = find_axes(support, self._sets)
        n, needed = support.n_contacts, bool(self.axes) and not self.free_rotation
        self.lifts = np.array([axis.lift for axis in self.axes]).reshape(-1, n)
        if reference_moment is not None:
            self.reference_moment = positive_number("reference_moment", reference_moment)
        elif needed:
            self.reference_moment = REFERENCE_SHARE * self._largest_moment()
        else:
            self.reference_moment = None

    @cached_property
    def on_plane(self) -> bool:
        """Whether all contacts lie on one plane (planar: line) with its normal."""
        support = self.support
        normals = support.frames[:, :, 0]
        centred = support.arms - support.arms.mean(axis=0)
        level = np.abs(centred @ normals[0]) <= GEOMETRY_TOLERANCE * support.length
        parallel = np.linalg.norm(normals - normals[0], axis=1) <= GEOMETRY_TOLERANCE
        return bool(np.all(level) and np.all(parallel))

    @property
    def edges(self) -> list[list[int]]:
        """Contacts, from 1, of each tipping axis."""
        return [axis.numbers for axis in self.axes]

    @cached_property
    def pairs(self) -> np.ndarray:
        """(1 + axes, 2) contacts, from 1, of the tipping axes; the first row is that of none."""
        return np.array([(0, 0), *self.edges])

    @property
    def on_polygon(self) -> bool:
        """Whether contacts are ordinary ones on one plane; the axes are the edges of their polygon."""
        return bool(self.axes) and not self.free_rotation and self._sets.ordinary and self.on_plane

    @cached_property
    def addable_moments(self) -> AddableMoments:
        """The moments M_i of contacts in general position."""
        return AddableMoments(self.support, self._sets, self.axes)

    @cached_property
    def affine_moments(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Moments M_i as slope (axes, 6) times wrench plus offset (axes,), or None if they are not affine.

        With all contacts on one plane only the normal forces act about a tipping axis, so that in
        equilibrium M_i follows from the wrench alone, whatever the number of contacts. The formula goes on
        smoothly where the base would tip (M_i < 0), which `evaluate` cannot.
        """
        if self.support.dimension != 3 or self.free_rotation or not self.axes or not self.on_plane:
            return None
        return self.addable_moments.slope, self.addable_moments.offset

    def ratio(self, moments: np.ndarray) -> np.ndarray:
        """GN (...) of minimum moments (...), N m, where the accelerations of the contacts are not known.

        M0 / (M0 + M), and where the base tips, M < 0, 1 - M / M0, instead of the lift acceleration (4.11).
        """
        reference = self.reference_moment or 1.0
        return reference / (reference + np.maximum(moments, 0.0)) - np.minimum(moments, 0.0) / reference

    def evaluate(self, states: ContactStates) -> TipOverReserve:
        """Tip-over indices of states of this support.

        Raises:
            InputError: the states belong to another support.
        """
        if states.support is not self.support:
            raise InputError("states: belong to another support")
        upwards, downwards = self._sets.distances(states.contact_forces[:, :, 0])
        count, slopes = len(states), None
        if self.axes and not self.free_rotation and not self.on_plane:
            moments, slopes = self._in_general_position(states)
        else:
            ups, downs = np.maximum(self.lifts, 0), np.maximum(-self.lifts, 0)
            moments = _product(upwards, ups) + _product(downwards, downs)
        nearest = np.full(count, -1)
        if self.free_rotation:
            ratio = np.ones(count)
            nearest[:] = 0 if self.axes else -1
        elif self.axes and self.reference_moment is not None:
            nearest = np.argmin(moments, axis=1)
            smallest = np.maximum(moments[np.arange(count), nearest], 0.0)
            ratio = self.reference_moment / (self.reference_moment + smallest)
        else:
            ratio = np.zeros(count)
        speeds = np.abs(states.contact_accelerations[:, :, 0])
        lifting = np.where(np.max(speeds, axis=1) > states.rest_limit, np.argmax(speeds, axis=1), -1)
        largest = np.where(lifting >= 0, np.max(speeds, axis=1), 0.0)
        ratio = np.where(lifting >= 0, 1.0, ratio)
        ratio = np.where(states.solved, ratio, np.nan)
        return TipOverReserve(
            tip_ratio=ratio,
            lift_acceleration=np.where(states.solved, largest, np.nan),
            moments=moments,
            nearest_axis=nearest,
            normal_reserves=np.minimum(upwards, downwards),
            lifting_contact=lifting,
            states=states,
            tip_over=self,
            slopes=slopes,
        )

    def moments_of(self, wrenches: np.ndarray, normal_forces: np.ndarray) -> np.ndarray:
        """(N, axes) N m that can be added to wrenches (N, w), negative where the base tips.

        Args:
            wrenches: N and N m about the centre of mass.
            normal_forces: (N, n), N, see `AddableMoments.addable`.
        """
        addable = self.addable_moments
        if self.on_plane:
            return wrenches @ addable.slope.T + addable.offset
        return addable(wrenches, normal_forces)[0]

    def _in_general_position(self, states: ContactStates) -> tuple[np.ndarray, np.ndarray]:
        """Moments (N, axes) and derivatives (N, axes, 6) with respect to what the contact forces balance.

        Where the base moves, the forces are those of this one solution: the affine moments are taken.
        """
        addable, solved = self.addable_moments, states.solved
        W = self.support.wrench_matrix
        flat = states.contact_forces.reshape(len(states), W.shape[1])
        balanced = np.where(solved[:, None], -flat @ W.T, np.nan)
        moments = balanced @ addable.slope.T + addable.offset
        slopes = np.broadcast_to(addable.slope, (len(states), *addable.slope.shape)).copy()
        still = solved & states.persistent
        # Only a base at rest leaves its forces open; the moment that can be added is a maximum over them.
        moments[still], slopes[still] = addable(balanced[still], states.contact_forces[still, :, 0])
        return moments, slopes

    def _largest_moment(self) -> float:
        """Largest min_i M_i of normal forces >= 0 whose sum is the weight, N m (linear program)."""
        weight = self.support.mass * float(np.linalg.norm(self.support.gravity))
        if weight == 0:
            raise InputError(
                "reference_moment: gravity is zero, so that the weight gives no reference; pass M0 > 0 in N m"
            )
        value = largest_least(np.abs(self.lifts))
        if value is None:
            raise SolverError("reference moment: its linear program was not solved")
        return weight * value


def largest_least(rows: np.ndarray) -> float | None:
    """The largest min_i (A x)_i over x >= 0 with sum 1, of A (m, n) >= 0; None if the solver fails.

    Clarabel finds which rows and columns take part, their equations the value to rounding; it counts where a
    mean of rows shows that no x gives more. Where too many take part HiGHS decides, whose import takes longer
    than a verdict.
    """
    m, n = rows.shape
    unit = float(np.max(rows))
    if unit == 0:
        return 0.0
    A = rows / unit
    program = np.block([[np.ones((1, n)), 0.0], [-A, np.ones((m, 1))], [-np.eye(n), np.zeros((n, 1))]])
    cost, b = np.r_[np.zeros(n), -1.0], np.r_[1.0, np.zeros(m + n)]
    cones = [clarabel.ZeroConeT(1), clarabel.NonnegativeConeT(m + n)]
    solution = solve_cones(cost, program, b, cones, quiet_settings(1e-10))
    x, y = np.array(solution.x[:n]), np.array(solution.z[1 : m + 1])
    # The interior-point solution only suggests the active rows and columns. Their square system gives the
    # value to rounding, and the two bounds prove it; another share is tried if the guess was wrong.
    for share in (1e-6, 1e-8, 1e-4):
        taking, holding = x > share, y > share
        if not (taking.any() and holding.any()):
            continue
        low, mixed = _game(A[np.ix_(holding, taking)])
        _, weighed = _game(-A[np.ix_(holding, taking)].T)
        least, most = np.min(A[:, taking] @ mixed), np.max(weighed @ A[holding])
        if min(np.min(mixed), np.min(weighed)) > -_ROUNDING and most - least < _ROUNDING:
            return unit * low
    result = scipy.optimize.linprog(
        np.r_[np.zeros(n), -1.0],
        A_ub=program[1 : m + 1],
        b_ub=np.zeros(m),
        A_eq=program[:1],
        b_eq=[1.0],
        bounds=[(0, None)] * (n + 1),
        method="highs",
    )
    return unit * float(result.x[-1]) if result.success else None


def _game(A: np.ndarray) -> tuple[float, np.ndarray]:
    """Value t and x of A x = t, sum x = 1; by least squares where that has no or many solutions."""
    m, n = A.shape
    system = np.block([[A, -np.ones((m, 1))], [np.ones((1, n)), np.zeros((1, 1))]])
    right = np.r_[np.zeros(m), 1.0]
    try:
        *x, value = np.linalg.solve(system, right)
    # Degenerate games have several optimal mixtures; any of them has the right value.
    except np.linalg.LinAlgError:
        *x, value = np.linalg.lstsq(system, right, rcond=None)[0]
    return float(value), np.array(x)


@dataclass(frozen=True, eq=False)
class TipOverReserve:
    """Tip-over indices of N states; NaN where the contact state is not solved.

    Attributes:
        tip_ratio: (N,) M0 / (M0 + min_i M_i), 1 means tipping. Set to 1 where a contact lifts off: on a
            plane M_i vanishes there by itself, on contacts in any position a lift-off need not be a
            rotation about two contacts.
        lift_acceleration: (N,) maximum normal acceleration of a contact (4.10), m/s^2: how fast it lifts;
            0 where no contact does.
        moments: (N, axes) moment sums M_i of the normal margins about the axes, N m.
        nearest_axis: (N,) axis with the smallest moment sum, -1 for none.
        normal_reserves: (N, n) distance of the normal force from the nearer end of its set (4.7 to 4.9),
            N; infinite for contacts that cannot separate. `moments` use the end at which the contact lets
            go in that rotation.
        lifting_contact: (N,) contact with the largest normal acceleration, -1 for none.
        states: the states.
        tip_over: what they were evaluated with.
        slopes: (N, axes, 6) of `moments` with respect to the wrench that the contact forces balance; None on
            a plane, where the moments are sums of normal forces.
    """

    tip_ratio: np.ndarray
    lift_acceleration: np.ndarray
    moments: np.ndarray
    nearest_axis: np.ndarray
    normal_reserves: np.ndarray
    lifting_contact: np.ndarray
    states: ContactStates
    tip_over: TipOver
    slopes: np.ndarray | None = None

    @cached_property
    def GN(self) -> np.ndarray:
        """(N,) tip ratio, below 1 where nothing lifts, plus the value of the lift acceleration.

        Thesis M publishes this sum (4.11). It only orders states: 1.3 is a contact that lifts at 0.3 m/s^2.
        """
        return self.tip_ratio + self.lift_acceleration

    @cached_property
    def moment_gradients(self) -> np.ndarray:
        """(N, axes, 6) derivative of `moments` with respect to the wrench (N m per N, N m).

        Exact within the active basis, in which the moments are affine in the wrench.
        """
        if self.slopes is None:
            return _product(self._normal_maps, self.tip_over.lifts, axis=1)
        maps, W = self.states.force_maps, self.states.support.wrench_matrix
        balanced = -np.einsum("wf,sfv->swv", W, maps.reshape(len(maps), W.shape[1], maps.shape[3]))
        return self.slopes @ balanced

    @cached_property
    def margins(self) -> np.ndarray:
        """(N, axes) N m that can be added about the axes; where the base tips, negative: so much is missing.

        A base that tips is not in equilibrium: its normal forces, and so `moments`, belong to its motion.
        Missing is the couple that would have to be added to the load. A base that lifts only because it
        slides misses none.
        """
        margins, rows = np.maximum(self.moments, 0.0), np.flatnonzero(self.lifting_contact >= 0)
        if len(rows) and self.tip_over.axes and not self.tip_over.free_rotation:
            states = self.states.select(rows)
            moments = self.tip_over.moments_of(states.wrenches, states.contact_forces[:, :, 0])
            tips = np.min(moments, axis=1) < 0
            margins[rows[tips]] = moments[tips]
        return margins

    @cached_property
    def edge_distances(self) -> np.ndarray:
        """(N,) distance of the zero-moment point from the nearest edge of the support polygon, m.

        Moments of normal forces about the edges, divided by the sum of the forces; negative beyond the edge,
        where the base tips. NaN where contacts are not ordinary ones on one plane that bounds an area, or
        carry no load.
        """
        total = np.sum(self.states.contact_forces[:, :, 0], axis=1)
        smallest = np.min(self.margins, axis=1, initial=np.inf)
        if (tips := smallest < 0).any():  # contact forces are those of the motion: the load counts
            normal = self.states.support.frames[0, :, 0]
            total[tips] = -self.states.wrenches[tips, : len(normal)] @ normal
        known = self.tip_over.on_polygon & (total > 0)
        return np.divide(smallest, total, out=np.full(len(total), np.nan), where=known)

    @cached_property
    def gradient(self) -> np.ndarray:
        """(N, 6) derivative of GN with respect to the wrench (1 per N, N m)."""
        states, tip_over = self.states, self.tip_over
        gradient = np.where(states.solved, 0.0, np.nan)[:, None] * np.ones(states.support.wrench_size)
        if tip_over.axes and not tip_over.free_rotation:
            # GN = M0 / (M0 + M), so that dGN = -GN^2 / M0 dM while no contact lifts.
            slope = np.where(self.lifting_contact >= 0, 0.0, -(self.tip_ratio**2) / tip_over.reference_moment)
            gradient += slope[:, None] * self.moment_gradients[np.arange(len(states)), self.nearest_axis]
        moving = np.flatnonzero(self.lifting_contact >= 0)
        if len(moving):
            contact = self.lifting_contact[moving]
            sign = np.sign(states.contact_accelerations[moving, contact, 0])
            maps = states.select(moving).acceleration_maps[np.arange(len(moving)), contact, 0]
            gradient[moving] += sign[:, None] * maps
        return gradient

    @cached_property
    def _normal_maps(self) -> np.ndarray:
        return self.states.force_maps[:, :, 0, :]


class TipMap:
    """Moments of the normal margins about the tipping axes as functions of the wrench.

    Args:
        tip_over: of the support.

    Attributes:
        count: of the axes; 0 where nothing resists a rotation.
    """

    def __init__(self, tip_over: TipOver) -> None:
        self.count = 0 if tip_over.free_rotation else len(tip_over.axes)
        self._affine = tip_over.affine_moments if self.count else None
        self._tip_over = tip_over

    @property
    def affine(self) -> bool:
        """Whether the moments are affine in the wrench, or there are none."""
        return self.count == 0 or self._affine is not None

    def __call__(self, wrenches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Moments (N, axes), N m, and their derivatives (N, axes, 6) at wrenches (N, 6), N and N m."""
        if self.count == 0:
            return np.empty((len(wrenches), 0)), np.empty((len(wrenches), 0, 6))
        if self._affine is not None:
            slope, offset = self._affine
            return wrenches @ slope.T + offset, np.broadcast_to(slope, (len(wrenches), *slope.shape))
        if self._tip_over.on_plane:  # of a planar support: a line
            reserve = self._tip_over.evaluate(solve_resting(self._tip_over.support, wrenches))
            return reserve.moments, reserve.moment_gradients
        addable, normals = self._tip_over.addable_moments, None
        if addable.needs_states:
            normals = solve_resting(self._tip_over.support, wrenches).contact_forces[:, :, 0]
        return addable(wrenches, normals)

    def some(
        self, wrenches: np.ndarray, states: np.ndarray, axes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Moments (R,) about axes (R,) in states (R,), and their derivatives (R, 6)."""
        if self._affine is None:
            moments, slopes = self(wrenches)
            return moments[states, axes], slopes[states, axes]
        slope, offset = self._affine
        slopes = slope[axes]
        return np.einsum("rw,rw->r", slopes, wrenches[states]) + offset[axes], slopes


def _product(reserves: np.ndarray, lifts: np.ndarray, axis: int = -1) -> np.ndarray:
    """Sums over the contacts of margins (N, n, ...) times lifts (axes, n): (N, axes, ...).

    Contacts with no lift have infinite margins, which must not turn into NaN.
    """
    used = np.any(lifts != 0, axis=0)
    axis = axis % reserves.ndim
    kept = np.compress(used, reserves, axis=axis)
    return np.moveaxis(np.tensordot(kept, lifts[:, used], axes=(axis, 1)), -1, 1)
