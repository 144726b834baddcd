"""Lean inverse dynamics of a serial arm: joint torques and the wrench on its base with few operations.

The recursion of :mod:`ocptip.robots.dynamics` with exact zeros and right angles, and with what a joint cannot
tell apart moved to the link before it (Gautier and Khalil): that leaves the torques and, as the first link
keeps all its parameters, the wrench on the base.
"""

from __future__ import annotations

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError
from ocptip.numerics.vectors import cross_terms as cross
from ocptip.parallel.code.tidy import tidy
from ocptip.parallel.description.frames import moved_inertia, rotation_angles
from ocptip.parallel.description.platform import BodyInertia
from ocptip.parallel.dynamics.base_parameters import regroup
from ocptip.parallel.symbolic.leg_dynamics import LegModel, chain_motion, efforts_and_base
from ocptip.parallel.symbolic.spatial_sx import Rotation, Turn, plus, turn, vector
from ocptip.robots.model import ArmModel


def lean_arm(model: ArmModel) -> cs.Function:
    """Function of an arm for generated code.

    In: `q`, `qd`, `qdd` (n,), rad (sliding joints m); `gravity` (3,), m/s^2, base axes. Out: `torque` (n,),
    N m (N), and `wrench` (6,), force and moment about the base frame's origin, base axes, of the arm on its
    base; both as :func:`ocptip.robots.dynamics.inverse_dynamics`. C code:
    :func:`ocptip.parallel.code.codegen.write_c`.

    Args:
        model: its payload is part of its last link.

    Raises:
        InputError: joints that follow others, springs of joints, or a process load.
    """
    if model.coupling is not None:
        raise InputError(f"{model.name}: joints follow others; lean code knows independent joints only")
    if model.process is not None:
        raise InputError(f"{model.name}: lean code knows no process load")
    if model.has_springs:
        raise InputError(f"{model.name}: lean code knows no springs of joints")
    q, qd, qdd = (cs.SX.sym(which, model.n) for which in ("q", "qd", "qdd"))
    gravity = cs.SX.sym("gravity", 3)
    chain = _chain(model, cs.vertsplit(q))
    motion = chain_motion(chain, cs.vertsplit(qd), cs.vertsplit(qdd), cs.vertsplit(gravity))
    efforts, (force, moment) = efforts_and_base(chain, motion)
    to_base = chain.rotation(0, 1)
    force, moment = to_base(force), to_base(moment)
    moment = plus(moment, cross(chain.origin, force))
    outputs = [cs.vertcat(*efforts), -cs.vertcat(*force, *moment)]
    inputs, names = [q, qd, qdd, gravity], ["q", "qd", "qdd", "gravity"]
    return tidy(cs.Function("arm", inputs, list(map(cs.densify, outputs)), names, ["torque", "wrench"]))


def _chain(model: ArmModel, q: list[cs.SX]) -> LegModel:
    fixed = [_elementary(rotation) for rotation in model.rotations]
    turns, slides = [], []
    for i, before in enumerate(fixed):
        prismatic = bool(model.prismatic[i])
        turns.append(Rotation(before.turns if prismatic else (*before.turns, turn(2, q[i]))))
        slides.append(before(vector([0.0, 0.0, q[i]])) if prismatic else vector(np.zeros(3)))
    mount = _elementary(model.mount_rotation)
    turns[0] = mount @ turns[0]
    segments = [vector(offset) for offset in model.offsets]
    for i in range(1, model.n):
        segments[i - 1] = plus(segments[i - 1], slides[i])
    zeros = [cs.SX(0.0)] * model.n
    return LegModel(
        q=q,
        revolute=[not prismatic for prismatic in model.prismatic],
        turns=turns,
        origin=plus(vector(model.mount_position), mount(slides[0])),
        segments=segments,
        inertia=[list(map(cs.SX, body)) for body in _grouped(model)],
        rotor=[cs.SX(value) for value in model.armature],
        viscous=zeros,
        coulomb=zeros,
        actuated=tuple(range(model.n)),
        axes=(0, 1, 2),
    )


def _grouped(model: ArmModel) -> np.ndarray:
    """(n, 10) XX .. M of the links about their frames; what joints 2.. cannot tell apart is moved inwards."""
    bodies = zip(model.masses, model.centres, model.inertias, strict=True)
    table = np.array([BodyInertia.about_center(*body, grouped=True).vector for body in bodies])

    def moved(i: int, body: np.ndarray) -> np.ndarray:
        frame = model.rotations[i], model.offsets[i - 1]
        return moved_inertia(BodyInertia.from_vector(body), frame).vector

    regroup(table, model.prismatic.tolist(), moved, last=1)
    table[np.abs(table) < 1e-14 * np.abs(table).max()] = 0.0
    return table


def _elementary(rotation: np.ndarray) -> Rotation:
    """A constant rotation as turns; right angles are exact."""
    turns: list[Turn] = [turn("xyz".index(axis), angle) for axis, angle in rotation_angles(rotation)]
    return Rotation(turns)
