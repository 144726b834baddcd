"""Forward dynamics of an arm whose drives are off and whose joints brake with dry friction until they rest.

A joint that moves is braked with a torque of given size against its motion; a joint that rests is held as
long as no more than that torque is needed, otherwise it moves on. Time stepping with the brakes' torques
implicit: at the end of each step speeds and torques obey the law of dry friction exactly, so that joints come
to rest one by one. Between these instants the method is of second order in the step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as cs
import numpy as np

from ocptip.numerics.batch import BatchFunction
from ocptip.numerics.jit.compiled import compiled
from ocptip.robots.dynamics import dynamics_batch, inverse_dynamics
from ocptip.robots.inverse.joint_angles import search_box
from ocptip.robots.kinematics import chain
from ocptip.robots.model import ArmModel

STEPS = 20  # in the time that the joint needs that brakes longest by itself
SHORTEST_STEP, LONGEST_STEP = 2e-4, 4e-3  # s
LONGEST = 2.0  # s: who does not rest by then does not rest
_COARSER = 60  # after so many steps they are twice as long
_SWEEPS, _CLOSE = 500, 1e-12
_DIRECT = 5  # of the sweeps solve for the joints that are held, too
# Share of the largest inertia that every joint gets, so that those of links without mass stop, too.
_MASSLESS = 1e-8
_ASCENTS, _PASSES = 24, 6  # of the search for the largest gravity torques: starts per joint, rounds


@dataclass(frozen=True, eq=False)
class MotionTerms:
    """Terms of N states: torques are inertia qdd + bias, the base wrench is per_acceleration qdd + rest.

    Attributes:
        inertia: (N, n, n), kg m^2.
        bias: (N, n), N m.
        per_acceleration: (N, 6, n).
        rest: (N, 6), N and N m; without the weight of the base.
    """

    inertia: np.ndarray
    bias: np.ndarray
    per_acceleration: np.ndarray
    rest: np.ndarray


@dataclass(frozen=True, eq=False)
class Braked:
    """How N arms come to rest: K states each; those that rest stay where they are.

    Attributes:
        times: (K,), s since the drives went off.
        angles, speeds: (K, N, n), rad and rad/s.
        torques: (K, N, n), N m, that moves at each state: of brakes on joints in motion, else 0.
        rests: (N,), s until everything rests; infinite where it does not.
    """

    times: np.ndarray
    angles: np.ndarray
    speeds: np.ndarray
    torques: np.ndarray
    rests: np.ndarray


@lru_cache(maxsize=16)
def _terms_function(model: ArmModel) -> BatchFunction:
    n = model.n
    q, qd, qdd = (cs.SX.sym(name, n) for name in ("q", "qd", "qdd"))
    gravity, about, process = (cs.SX.sym(name, k) for name, k in (("g", 3), ("about", 3), ("process", 6)))
    force = moment = cs.SX.zeros(3)
    if model.process is not None and model.process.varies:
        turn = chain(model, q)[0][-1] if model.process.turns_with_tool else cs.SX.eye(3)
        model, (force, moment) = model.with_process(None), (turn @ part for part in cs.vertsplit(process, 3))
    torque, wrench = inverse_dynamics(model)(q, qd, qdd, gravity, force, moment, about)
    still = [cs.substitute(part, qdd, cs.SX.zeros(n)) for part in (torque, wrench)]
    inertia = cs.jacobian(torque, qdd)
    inertia += _MASSLESS * cs.mmax(cs.diag(inertia)) * cs.DM.eye(n)
    parts = inertia, still[0], cs.jacobian(wrench, qdd), still[1]
    return BatchFunction(cs.Function("braking", [q, qd, gravity, about, process], parts))


def terms(
    model: ArmModel,
    q: np.ndarray,
    qd: np.ndarray,
    gravity: np.ndarray,
    about: np.ndarray,
    process: np.ndarray | None = None,
) -> MotionTerms:
    """Terms at angles and speeds (N, n) each; gravity and the point of the wrench's moment in base axes.

    A process that varies needs its values, (N, 6) in its axes.
    """
    acting = np.zeros(6)
    if model.process is not None and model.process.varies:
        acting = model.process.wrench if process is None else process
    inertia, bias, per_acceleration, rest = _terms_function(model)(q, qd, gravity, about, acting)
    n = model.n  # of one joint a matrix is a column: its second axis is put back
    return MotionTerms(inertia.reshape(-1, n, n), bias, per_acceleration.reshape(-1, 6, n), rest)


def brake(
    model: ArmModel,
    q: np.ndarray,
    qd: np.ndarray,
    gravity: np.ndarray,
    torque: np.ndarray,
    *,
    delay: np.ndarray | float = 0.0,
    step: float | None = None,
    process: np.ndarray | None = None,
) -> Braked:
    """Let N arms brake from angles q and speeds qd, (N, n) each.

    Args:
        model: the arm.
        q, qd: where and how fast.
        gravity: (3,), m/s^2, base axes.
        torque: (N, n), N m, >= 0: of the brakes.
        delay: (N,) or one number, s: until then nothing brakes and nothing drives.
        step: s; default by the time that the joints need.
        process: (N, 6) in its axes, what one that varies is while the arm brakes.
    """
    count = len(q)
    q, qd, before = q.astype(float), qd.astype(float), qd.astype(float)
    torque, delay = np.broadcast_to(torque, q.shape), np.broadcast_to(delay, count)
    if step is None:
        result = terms(model, q, 0 * qd, gravity, np.zeros(3), process)
        inertia = np.diagonal(result.inertia, axis1=1, axis2=2)
        alone = np.max(np.abs(qd) * inertia / torque, initial=0.0)
        step = float(np.clip(alone / STEPS, SHORTEST_STEP, LONGEST_STEP))
    history, rests, about = [], np.where(np.any(qd != 0, axis=1), np.inf, 0.0), np.zeros(3)
    times, now = [], 0.0
    while now < LONGEST:
        if times and len(times) % _COARSER == 0:
            step = min(2 * step, max(step, LONGEST_STEP))
        times.append(now)
        closed = np.clip((now + step - delay) / step, 0.0, 1.0)[:, None]  # share of the step with brakes
        holding = closed > 0
        history.append((q, qd, np.where((now >= delay)[:, None], -np.sign(qd) * torque, 0.0)))
        going = np.flatnonzero(~np.isfinite(rests))
        if not len(going):
            break
        # Terms at the middle of the step, with speeds extrapolated to it, make the method second order; a
        # speed that would change its sign counts as 0.
        old, ahead = qd[going], 1.5 * qd[going] - 0.5 * before[going]
        ahead = np.where(ahead * old > 0, ahead, 0.0)
        acting = None if process is None else process[going]
        dynamics_there = terms(model, q[going] + 0.5 * step * old, ahead, gravity, about, acting)
        new = old.copy()
        moved = np.empty_like(new)
        inertia, bias = (
            np.ascontiguousarray(dynamics_there.inertia),
            np.ascontiguousarray(dynamics_there.bias),
        )
        _slow_down(inertia, bias, closed[going] * torque[going], step, new, moved)
        before, q, qd = qd.copy(), q.copy(), qd.copy()
        q[going] += moved
        qd[going] = new
        done = going[np.all(new == 0, axis=1) & holding[going, 0]]
        rests[done] = now = now + step
    q, qd, qdd = (np.array(parts) for parts in zip(*history, strict=True))
    return Braked(np.array(times), q, qd, qdd, rests)


def gravity_torques(model: ArmModel, gravity: np.ndarray) -> np.ndarray:
    """(n,) N m (sliding joints: N): the maximum torque that gravity asks of each joint in any posture.

    Postures within the joint limits count, sliding joints without limits within a metre. Coordinate ascent
    from random postures: over one angle a gravity torque is a constant and a sine, whose peak three values
    give. Candidates are evaluated before one is taken, so that coupled joints do no harm.

    Args:
        model: the arm with its payload; its process does not count.
        gravity: (3,), m/s^2, base axes.
    """
    n, model = model.n, model.with_process(None)
    low, high = search_box(model)
    random = np.random.default_rng(0).random((_ASCENTS, n))
    q = np.tile(low + random * (high - low), (n, 1))
    row, joint = np.arange(len(q)), np.repeat(np.arange(n), _ASCENTS)

    def sizes(moved: int, value: np.ndarray | float) -> np.ndarray:
        """Signed torques (N,) with one angle replaced."""
        postures = q.copy()
        postures[:, moved] = value
        still = np.zeros_like(postures)
        return dynamics_batch(model)(postures, still, still, gravity, *np.zeros((3, 3)))[0][row, joint]

    for _ in range(_PASSES):
        for k in range(n):
            # Three values give constant and amplitude of the sine, hence the angle of its peak.
            middle, plus, minus = (sizes(k, angle) for angle in (0.0, np.pi / 2, -np.pi / 2))
            peak = np.arctan2((plus - minus) / 2, middle - (plus + minus) / 2)
            turns = np.stack([peak + 2 * np.pi * t for t in (-1, -0.5, 0, 0.5, 1)])
            ends = np.stack([q[:, k], np.full(len(q), low[k]), np.full(len(q), high[k])])
            tried = np.clip(np.concatenate([ends, turns]), low[k], high[k])
            best = np.argmax([np.abs(sizes(k, value)) for value in tried], axis=0)
            q[:, k] = tried[best, row]
    return np.abs(sizes(0, q[:, 0])).reshape(n, _ASCENTS).max(axis=1)


@compiled
def _slow_down(inertia, bias, torque, step, speeds, moved):
    """Speeds after a step, and displacements; brakes stop each joint that they can hold (projected
    Gauss-Seidel).
    """
    count, n = speeds.shape
    brakes, speed, full = np.empty(n), np.empty(n), np.empty(n)
    inverse, both = np.empty((n, n)), np.empty((n, 2 * n))
    for i in range(count):
        for j in range(n):
            for k in range(n):
                both[j, k], both[j, n + k] = inertia[i, j, k], 0.0
            both[j, n + j] = 1.0
        _solve(both, n, 2 * n)
        for j in range(n):
            for k in range(n):
                inverse[j, k] = both[j, n + k]
        for j in range(n):
            brakes[j] = -np.sign(speeds[i, j]) * torque[i, j]
        scale = 1e-6
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += inverse[j, k] * (brakes[k] - bias[i, k])
            full[j] = speed[j] = speeds[i, j] + step * total
            scale = max(scale, abs(speeds[i, j]))
        for sweep in range(_SWEEPS):
            largest = 0.0
            for j in range(n):
                # The brake torque that stops joint j by itself, cut to what the brake can give.
                wanted = brakes[j] - speed[j] / (step * inverse[j, j])
                wanted = min(max(wanted, -torque[i, j]), torque[i, j])
                change = wanted - brakes[j]
                if change != 0.0:
                    brakes[j] = wanted
                    for k in range(n):
                        shift = step * inverse[k, j] * change
                        speed[k] += shift
                        largest = max(largest, abs(shift))
            if largest <= _CLOSE * scale:
                break
            # Gauss-Seidel converges slowly where joints are strongly coupled; a direct solve of the held ones
            # helps.
            if sweep < _DIRECT:
                _hold(inverse, step, torque[i], brakes, speed, both)
        for j in range(n):
            old = speeds[i, j]
            if abs(brakes[j]) < torque[i, j]:
                moved[i, j] = 0.5 * step * old
                if old * full[j] < 0.0:
                    moved[i, j] *= old / (old - full[j])  # it rests before the step's end
                speeds[i, j] = 0.0
            else:
                moved[i, j] = 0.5 * step * (old + speed[j])
                speeds[i, j] = speed[j]


@compiled
def _hold(inverse, step, torque, brakes, speed, both):
    """Brakes that do not slip bring their joints to rest at once, as far as they can; `both`: to work in."""
    n, count = len(brakes), 0
    held = np.empty(n, dtype=np.int64)
    for j in range(n):
        if abs(brakes[j]) < torque[j]:
            held[count] = j
            count += 1
    for a in range(count):
        for b in range(count):
            both[a, b] = step * inverse[held[a], held[b]]
        both[a, count] = -speed[held[a]]
    _solve(both, count, count + 1)
    for a in range(count):
        j = held[a]
        change = min(max(brakes[j] + both[a, count], -torque[j]), torque[j]) - brakes[j]
        brakes[j] += change
        for k in range(n):
            speed[k] += step * inverse[k, j] * change


@compiled
def _solve(both, n, columns):
    """Gauss-Jordan elimination in n rows: columns from n on become the solution (definite matrix)."""
    for j in range(n):
        for k in range(j + 1, columns):
            both[j, k] /= both[j, j]
        for i in range(n):
            if i != j and both[i, j] != 0.0:
                for k in range(j + 1, columns):
                    both[i, k] -= both[i, j] * both[j, k]
