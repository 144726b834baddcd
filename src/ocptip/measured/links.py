"""Inertia and friction of an arm from recorded torques, and the wrench on its base where that is recorded.

Loads are linear in ten parameters of each link, but only some combinations of these have an influence: the
base parameters, from a rank-revealing factorisation of the regressor at random states. They are estimated
with their covariance, beside dry and viscous friction of each joint. Of all links with these base parameters
those are taken that lie next to what was described and can exist: a cone program on their pseudo-inertias
(see `numerics.inertia.pseudo_inertia`), weighted by the covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import clarabel
import numpy as np
from scipy import linalg

from ocptip.basics.errors import InputError, SolverError, positive_number
from ocptip.measured.clocks import AROUND
from ocptip.measured.estimate import Estimate, Ran, estimate
from ocptip.measured.parameters import (
    NAMES,
    PER_BODY,
    body_of,
    link_parameters,
    on_sensor,
    parameters_of,
    process_loads,
    pseudo_of,
    regressors,
)
from ocptip.measured.prediction import Predictor
from ocptip.measured.recording import TORQUE, WRENCH, Recording
from ocptip.numerics.cone_program import USABLE, quiet_settings, solve_cones, triangle
from ocptip.numerics.threads import one_thread
from ocptip.numerics.vectors import skew
from ocptip.reserves.tipping import TipMap
from ocptip.robots.dynamics import mass_sensitivities
from ocptip.robots.model import ArmModel
from ocptip.robots.motors import DCMotors, Motors

_STATES, _SEED = 60, 0  # random states at which the rank is found
_RANK = 1e-9  # share of the first pivot
_RESTS = 1e-3  # share of its greatest speed below which a joint rests
_PULL = 1.0  # a relative change of 1 costs as much as one standard error: what is not told stays as described
_LEAST = 0.1  # mass of a link that is no body (see `robots.bodies`), over that described
_THIN = 1e-6  # least second moment of a link along any axis, over its mass, (0.1 m)^2
_SMALL = 0.01  # of the mean mass of links: change of a lighter one that counts as relative 1
_LENGTH = 0.1  # m
_INSTANTS = 0.01  # s: between instants at which a tolerance is looked at


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """Which combinations of parameters (K,) have an influence.

    Attributes:
        independent: (p,) numbers of parameters, one for each combination.
        combinations: (p, K): base parameters per parameter; 1 at the independent one.
    """

    independent: np.ndarray
    combinations: np.ndarray

    def names(self, parameters: Sequence[str]) -> list[str]:
        """In words, such as "Izz2 + 0.425 mx3"; small shares are left out."""
        results = []
        for first, row in zip(self.independent, self.combinations, strict=True):
            others = [k for k in np.argsort(-np.abs(row)) if k != first and abs(row[k]) > 1e-9]
            shares = (("+-"[int(row[k] < 0)], f"{abs(row[k]):.3g} ", parameters[int(k)]) for k in others)
            parts = [f"{sign} {'' if share == '1 ' else share}{name}" for sign, share, name in shares]
            results.append(" ".join([parameters[int(first)], *parts]))
        return results


def base_parameters(columns: np.ndarray) -> BaseParameters:
    """By QR factorisation with column pivoting of a regressor (rows, K) at many states."""
    size = np.linalg.norm(columns, axis=0)
    scale = np.where(size > _RANK * size.max(), size, np.inf)
    upper, order = map(np.asarray, linalg.qr(columns / scale, mode="r", pivoting=True))
    pivots = np.abs(np.diag(upper))
    rank = int(np.sum(pivots > _RANK * pivots[0]))
    first = order[:rank]
    combinations = np.zeros((rank, columns.shape[1]))
    combinations[:, first] = np.eye(rank)
    rest = linalg.solve_triangular(upper[:rank, :rank], upper[:rank, rank:])
    rest[np.abs(rest) < 1e-8] = 0.0
    others = scale[order[rank:]]
    combinations[:, order[rank:]] = rest * np.where(np.isfinite(others), others, 0.0) / scale[first, None]
    by_number = np.argsort(first)
    return BaseParameters(first[by_number], combinations[by_number])


@dataclass(frozen=True, eq=False)
class Identified:
    """An arm as it was recorded.

    Attributes:
        arm: with links that can exist, with its nominal payload.
        coulomb, viscous: (n,) friction, N m (N) and N m s/rad (N s/m); nan of joints that did not move.
        basis: the base parameters of links, then rotors where the arm has some.
        names: of them.
        estimate: of the base parameters (p,), then `coulomb` and `viscous`.
        described: (p,) base parameters of the nominal arm.
        moved: how far that has moved the base parameters, in standard errors (root of the quadratic form).
        condition: of the scaled covariance of what is seen.
    """

    arm: ArmModel
    coulomb: np.ndarray
    viscous: np.ndarray
    basis: BaseParameters
    names: tuple[str, ...]
    estimate: Estimate
    described: np.ndarray
    moved: float
    condition: float

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units."""
        identified = self.estimate
        return {
            "base_parameters": list(self.names),
            "values": identified.values.tolist(),
            "described": self.described.tolist(),
            "confidence_95": identified.half.tolist(),
            "covariance": identified.covariance.tolist(),
            "seen": identified.seen.tolist(),
            "coulomb": self.coulomb.tolist(),
            "viscous": self.viscous.tolist(),
            "residuals": dict(identified.residuals),
            "delays_s": dict(identified.delays),
            "residuals_by_signal": {
                f"{kind}[{number + 1}]": {"rms": rms, "plain_least_squares": plain}
                for kind, number, rms, plain in identified.signals
            },
            "away_from_plain_least_squares": identified.away.tolist(),
            "low_pass": {kind: vars(low_pass) for kind, low_pass in identified.low_passes.items()},
            "moved_by_existence": self.moved,
            "condition": self.condition,
        }

    def to_tables(self, motors: Motors) -> dict[str, Any]:
        """Tables of a task file: `[arm.links]`, and `[motors]` with the friction if they are DC motors."""
        bare = self.arm.with_payload(None)
        links = {}
        for k, name in enumerate(bare.chain_names):
            places = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
            tables = {
                "mass": float(bare.masses[k]),
                "center_of_mass": bare.centres[k].tolist(),
                "inertia": [float(bare.inertias[k][place]) for place in places],
            }
            links[name] = tables | ({"armature": float(bare.armature[k])} if bare.armature.any() else {})
        data: dict[str, Any] = {"arm": {"links": links}}
        if isinstance(motors, DCMotors):
            keys = ("motor_constant", "coulomb", "viscous", "standby")
            drives = {key: getattr(motors, key).copy() for key in keys}
            for key, values in (("coulomb", self.coulomb), ("viscous", self.viscous)):
                drives[key] = np.where(np.isfinite(values), np.maximum(values, 0.0), drives[key])
            data["motors"] = {
                "kind": "dc", **{key: values.tolist() for key, values in drives.items()},
                "regeneration": motors.regeneration,
            }  # fmt: skip
        return data


def parameter_names(arm: ArmModel) -> list[str]:
    """Names of all parameters, (10 L,), and of the rotors."""
    rotors = [f"rotor{j + 1}" for j in range(arm.n)] if arm.armature.any() else []
    return [f"{name}{k + 1}" for k in range(arm.links) for name in NAMES] + rotors


def all_parameters(arm: ArmModel) -> np.ndarray:
    """(K,) of all links, and rotors where the arm has some."""
    return np.concatenate([link_parameters(arm), arm.armature if arm.armature.any() else []])


@one_thread
def identify_links(
    recording: Recording, predictor: Predictor, *, bandwidth: float | None = None
) -> Identified:
    """Find inertia and friction.

    The payload, and what else rests on the sensor, are nominal. Torques of a joint count while it moves: of
    one that rests, friction may be anything.

    Args:
        recording: with torques, and with a force-torque sensor if there is one between base and arm.
        predictor: of the nominal robot and the motion that was run.
        bandwidth: Hz, cutoff of the low-pass filter of the torques as far as it is known; infinite: nothing
            is filtered; None: it is searched. That of the sensor is always searched.

    Raises:
        InputError: no torques are recorded, or too few samples.
        SolverError: the cone program has no answer.
    """
    robot = predictor.robot
    if robot.arm.has_springs:
        raise InputError("arm.springs: links are identified without springs of joints only")
    bare, sensor, n, gravity = robot.arm.with_payload(None), robot.sensor, robot.n, robot.support.gravity
    torques, wrench = recording.of(TORQUE), recording.of(WRENCH)
    if not torques:
        raise InputError("recording: no torques (tau1, ...)")
    measured = {TORQUE: np.array([one.values for one in torques])}
    if wrench:
        measured[WRENCH] = np.array([one.values for one in wrench])
    which = {kind: [one.index for one in recording.of(kind)] for kind in measured}
    plate = parameters_of((sensor.mass, np.asarray(sensor.center_of_mass), np.zeros((3, 3))))
    held = link_parameters(robot.arm) - link_parameters(bare)

    def loads(
        kind: str, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, process: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(N, C) known loads and (N, C, K) columns of all parameters."""
        acting = process_loads(robot, q, process)
        if kind == WRENCH:
            seen = on_sensor(sensor, regressors(bare, gravity, q, qd, qdd)[1])[:, which[kind]]
            links, pushed = seen[:, :, PER_BODY:], on_sensor(sensor, acting[1])[:, which[kind], 0]
            known = links @ held + seen[:, :, :PER_BODY] @ plate + pushed
            rotors = np.zeros((*links.shape[:2], n if bare.armature.any() else 0))
            return known, np.concatenate([links, rotors], axis=2)
        columns = torque_columns(bare, gravity, q, qd, qdd)[:, which[kind]]
        return columns[:, :, : len(held)] @ held + acting[0][:, which[kind]], columns

    anywhere = *random_states(bare), np.zeros((_STATES, 6))
    seen = [np.vstack(list(loads(kind, *anywhere)[1])) for kind in measured]
    basis = base_parameters(np.vstack(seen))
    described = all_parameters(bare)
    p = len(basis.independent)

    def model(
        kind: str, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, process: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        known, columns = loads(kind, q, qd, qdd, process)
        friction = np.zeros((len(q), columns.shape[1], 2 * n))
        if kind == TORQUE:
            friction = friction_columns(qd)[:, which[kind]]
        all_columns = np.concatenate([columns[:, :, basis.independent], friction], axis=2)
        return known.T, all_columns.transpose(1, 0, 2)

    ran = Ran(recording, predictor)
    changes = ran.states()[2]

    def kept(kind: str, c: int, speeds: np.ndarray) -> np.ndarray:
        if kind != TORQUE:
            return np.ones(len(speeds), dtype=bool)
        speed = np.abs(speeds[:, which[kind][c]])
        turns = AROUND * recording.period * np.abs(changes[:, which[kind][c]])
        return speed > np.maximum(_RESTS * speed.max(), turns)

    first = np.concatenate([basis.combinations @ described, np.zeros(2 * n)])
    searched = {} if bandwidth == np.inf else {TORQUE: bandwidth, WRENCH: None}
    result = estimate(ran, measured, model, first, kept=kept, bandwidths=searched)
    friction = np.where(result.seen[p:], result.values[p:], np.nan)
    arm, moved = _existing(bare, basis, result)
    return Identified(
        arm.with_payload(robot.arm.payload), friction[:n], friction[n:], basis,
        tuple(basis.names(parameter_names(bare))), result, first[:p], moved, _condition(result, p),
    )  # fmt: skip


def mass_tolerance(identified: Identified, predictor: Predictor, sigmas: float) -> float | None:
    """Relative tolerance of the links' masses that covers what is not sure of the identified arm.

    At every instant of the motion, and about every tipping axis, links that are each off by this share move
    the moment by at least as much as two other deviations together: `sigmas` standard errors of the base
    parameters, and the distance of the links that exist from these.

    Args:
        found: of a recording of the motion.
        predictor: of the nominal robot and the motion.
        sigmas: standard errors.

    Returns:
        The share; None where no wrench was recorded: torques do not tell what the base feels.

    Raises:
        InputError: the contacts have no tipping axes, or not even links without mass are enough.
    """
    robot, motion = predictor.robot.varied(arm=identified.arm), predictor.motion
    sigmas = positive_number("sigmas", sigmas)
    if WRENCH not in identified.estimate.residuals:
        return None
    axes = TipMap(robot.tip_over)
    if not axes.count:
        raise InputError("tolerance: contacts without tipping axes")
    times, support = motion.both_sides(_INSTANTS), robot.support
    states = motion.states(times)
    wrenches = robot.loads(*states, robot.acting(times))[1]
    bare = robot.arm.with_payload(None)
    columns = regressors(bare, support.gravity, *states)[1][:, :, PER_BODY:]
    columns[:, 3:] -= skew(support.center_of_mass) @ columns[:, :3]
    rotors = np.zeros((*columns.shape[:2], robot.n if bare.armature.any() else 0))
    columns = np.concatenate([columns, rotors], axis=2)[:, :, identified.basis.independent]
    p, links = len(identified.names), bare.links
    about_axes = axes(wrenches)[1] @ columns  # (N, axes, p)
    covariance = identified.estimate.covariance[:p, :p]
    away = identified.basis.combinations @ all_parameters(bare) - identified.estimate.values[:p]
    unsure = sigmas * np.sqrt(np.einsum("nap,pq,naq->na", about_axes, covariance, about_axes)) + np.abs(
        about_axes @ away
    )
    given = *states, support.gravity, support.center_of_mass
    slopes = mass_sensitivities(bare.without_process)(*given, np.zeros(4 * links + 1))[1].reshape(
        len(about_axes), robot.n + 6, -1
    )
    moved = axes(wrenches)[1] @ slopes[:, robot.n :, :links]
    share = float(np.max(unsure / np.maximum(np.abs(moved).sum(axis=2), 1e-300)))
    if not share < 1:
        raise InputError(
            f"tolerance: the recording is too short or too noisy; links may be off by {share:.3g}"
        )
    return share


def torque_columns(
    arm: ArmModel, gravity: np.ndarray, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
) -> np.ndarray:
    """(N, n, K) of torques per parameter of `all_parameters`."""
    links = regressors(arm, gravity, q, qd, qdd)[0]
    return np.concatenate([links, qdd[:, None] * np.eye(arm.n)], axis=2) if arm.armature.any() else links


def friction_columns(qd: np.ndarray) -> np.ndarray:
    """(N, n, 2 n) of torques per dry and viscous friction."""
    joints = np.eye(qd.shape[1])
    return np.concatenate([np.sign(qd)[:, None] * joints, qd[:, None] * joints], axis=2)


def random_states(arm: ArmModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(60, n) joint values, speeds and accelerations that excite all identifiable parameters."""
    rng = np.random.default_rng(_SEED)
    q = rng.uniform(-np.pi, np.pi, (_STATES, arm.n))
    return q, rng.normal(size=q.shape), 3 * rng.normal(size=q.shape)


def _condition(result: Estimate, p: int) -> float:
    covariance = result.covariance[:p, :p][np.ix_(result.seen[:p], result.seen[:p])]
    if not covariance.size:
        return float("inf")
    size = np.sqrt(np.diag(covariance))
    return float(np.sqrt(np.linalg.cond(covariance / np.outer(size, size))))


def _exists(parameters: np.ndarray) -> bool:
    pseudo = pseudo_of(parameters) / _scaled()
    return bool(np.linalg.eigvalsh(pseudo)[0] >= _THIN * max(pseudo[3, 3], 1e-300))


def _scaled() -> np.ndarray:
    size = np.array([_LENGTH, _LENGTH, _LENGTH, 1.0])
    return np.outer(size, size)


def _existing(arm: ArmModel, basis: BaseParameters, result: Estimate) -> tuple[ArmModel, float]:
    """The arm with links that exist, and how far the base parameters moved for that."""
    p, described = len(basis.independent), all_parameters(arm)
    covariance = result.covariance[:p, :p]
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    weight = np.linalg.pinv(covariance / np.outer(size, size), rcond=1e-12, hermitian=True) / np.outer(
        size, size
    )
    roots, axes = np.linalg.eigh(0.5 * (weight + weight.T))
    root = np.sqrt(np.maximum(roots, 0.0))[:, None] * axes.T  # of the weight
    masses = np.maximum(arm.masses, _SMALL * arm.masses.mean())
    unit = np.concatenate([[1.0], np.full(3, _LENGTH), np.full(6, _LENGTH**2)])
    scale = np.concatenate([np.outer(masses, unit).ravel(), np.ones(len(described) - PER_BODY * arm.links)])
    wanted = root @ (result.values[:p] - basis.combinations @ described)
    slopes = root @ basis.combinations * scale
    change = scale * _program(arm, described, scale, slopes, wanted)
    values = described + change
    moved = float(np.linalg.norm(root @ (basis.combinations @ values - result.values[:p])))
    bodies = [body_of(values[k : k + PER_BODY]) for k in range(0, PER_BODY * arm.links, PER_BODY)]
    rotors = values[PER_BODY * arm.links :]
    return replace(
        arm,
        masses=np.array([mass for mass, _, _ in bodies]),
        centres=np.array([centre for _, centre, _ in bodies]),
        inertias=np.array([tensor for _, _, tensor in bodies]),
        armature=np.maximum(rotors, 0.0) if len(rotors) else arm.armature,
    ), moved


def _program(
    arm: ArmModel, described: np.ndarray, scale: np.ndarray, slopes: np.ndarray, wanted: np.ndarray
) -> np.ndarray:
    """(K,) relative changes with minimum |slopes x - wanted|^2 + pull |x|^2 of links that exist."""
    K, rows, right, cones = len(described), [], [], []
    for k in range(arm.links):
        block = slice(PER_BODY * k, PER_BODY * (k + 1))
        if not _exists(described[block]):  # split rotors: no body has them, see `robots.bodies`
            part = np.zeros((1, K))
            part[0, block.start] = -scale[block.start]
            rows.append(part)
            right.append((1 - _LEAST) * described[block][:1])
            cones.append(clarabel.NonnegativeConeT(1))
            continue
        mass = max(float(arm.masses[k]), 1e-12)
        units = [_cone(unit) / mass for unit in np.eye(PER_BODY)]
        part = np.zeros((10, K))
        part[:, block] = -np.array(units).T * scale[block]
        rows.append(part)
        right.append(_cone(described[block]) / mass)
        cones.append(clarabel.PSDTriangleConeT(4))
    rotors = K - PER_BODY * arm.links
    if rotors:
        part = np.zeros((rotors, K))
        part[:, -rotors:] = -np.diag(scale[-rotors:])
        rows.append(part)
        right.append(described[-rotors:])
        cones.append(clarabel.NonnegativeConeT(rotors))
    cost = slopes.T @ slopes + _PULL**2 * np.eye(K)
    gradient = -slopes.T @ wanted
    big = float(np.abs(cost).max())
    A, b = np.vstack(rows), np.concatenate(right)
    solution = solve_cones(gradient / big, A, b, cones, quiet_settings(), np.triu(cost / big))
    if str(solution.status) not in USABLE:
        raise SolverError(f"no physically consistent links fit the recording (Clarabel: {solution.status})")
    return np.array(solution.x)


def _cone(parameters: np.ndarray) -> np.ndarray:
    """(10,) triangle, as Clarabel takes it, of a pseudo-inertia that is to be positive definite."""
    pseudo = pseudo_of(parameters) / _scaled()
    return triangle(pseudo - _THIN * pseudo[3, 3] * np.eye(4))
