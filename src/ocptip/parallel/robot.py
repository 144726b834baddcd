"""A parallel robot: kinematics, dynamics, mobility and singularities in one object."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, SolverError, finite_array
from ocptip.basics.frozen import MadeOf
from ocptip.numerics.vectors import cross
from ocptip.parallel.analysis.assembly_modes import AssemblyModes, assembly_modes
from ocptip.parallel.analysis.crossings import Crossing, crossings
from ocptip.parallel.analysis.mobility import Mobility, mobility, require_mobility
from ocptip.parallel.analysis.singularity import Singularity, require_regular, singularity
from ocptip.parallel.code.codegen import CFiles, write_c
from ocptip.parallel.code.complete import complete_function
from ocptip.parallel.code.lean import LeanFunction, lean_function
from ocptip.parallel.description.robot_description import RobotDescription
from ocptip.parallel.dynamics.base_parameters import (
    LegBaseParameters,
    NumericBaseParameters,
    leg_base_parameters,
    numeric_base_parameters,
)
from ocptip.parallel.dynamics.reactions import JointReactions, joint_reactions
from ocptip.parallel.dynamics.terms import (
    DynamicTerms,
    InverseDynamics,
    converted,
    motor_drift,
    needs_complete_legs,
    platform_terms,
    quasi_terms,
    regressor,
)
from ocptip.parallel.kinematics.platform import (
    ForwardPose,
    JointPositions,
    JointRates,
    Kinematics,
    RobotMotion,
)

Joints = Sequence[np.ndarray] | None
"""Joint positions per leg; None: from the inverse kinematics."""

_BALANCE = 1e-7


class ParallelRobot(MadeOf):
    """A parallel robot with the mobility of its description.

    Platform coordinates z hold the free ones of x, y, z, phi1, phi2, phi3 (m, rad), then the redundant
    joints. Joint values are optional everywhere: without them the inverse kinematics finds those of the
    home assembly; what needs them refuses a pose where it cannot (SolverError).

    Args:
        description: legs, platform, motors.
        check: refuse a robot whose mobility differs from the description. False only to examine such a robot.

    Raises:
        InputError: the legs do not reach the home pose, or the mobility differs; the message says it.
    """

    def __init__(self, description: RobotDescription, *, check: bool = True) -> None:
        if not isinstance(description, RobotDescription):
            raise InputError(f"description: expected a RobotDescription, got {type(description).__name__}")
        self.description = description
        self.kinematics = Kinematics(description)
        self._mobility = (require_mobility if check else mobility)(self.kinematics)
        self._complete = needs_complete_legs(self.kinematics)

    @property
    def m(self) -> int:
        """Number of coordinates."""
        return self.description.m

    @property
    def complete_legs(self) -> bool:
        """True if the dynamics use all joints, False if only those up to the coupling points."""
        return self._complete

    def mobility(self) -> Mobility:
        """Degrees of freedom, counted when the robot was made."""
        return self._mobility

    def ik(self, z: ArrayLike, guess: Joints = None) -> JointPositions:
        """All joint positions at a pose; see :meth:`Kinematics.joints`."""
        return self.kinematics.joints(z, guess)

    def fk(self, qa: ArrayLike, guess: ArrayLike | None = None) -> ForwardPose:
        """Platform pose from motor positions; see :meth:`Kinematics.forward`."""
        return self.kinematics.forward(qa, guess)

    def assembly_modes(self, qa: ArrayLike) -> AssemblyModes:
        """All platform poses for motor positions; see :func:`assembly_modes`."""
        return assembly_modes(self.kinematics, qa)

    def passive(self, z: ArrayLike, zd: ArrayLike, zdd: ArrayLike, guess: Joints = None) -> JointRates:
        """Positions, speeds and accelerations of all joints.

        Args:
            z, zd, zdd: (m,) coordinates and their time derivatives.
            guess: joint positions nearby, per leg.
        """
        z, s, sd = self._state(z, zd, zdd)
        result = self.kinematics.joints(z, guess)
        motion = self.kinematics.motion(z, s, result.q, complete=True)
        legs = motion.legs
        qdd = tuple(leg.Jq @ sd + leg.drift for leg in legs)
        return JointRates(result.q, tuple(leg.qd for leg in legs), qdd, result.residual)

    def jacobian(self, z: ArrayLike, q: Joints = None) -> np.ndarray:
        """J_a (n_a, m): q_a' = J_a s'."""
        z = self.kinematics.coordinates("z", z)
        return self.kinematics.actuated_jacobian(self.motion(z, np.zeros(self.m), q))

    def singularity(self, z: ArrayLike, q: Joints = None) -> Singularity:
        """Measures of both types and of the Euler angles at a pose."""
        z = self.kinematics.coordinates("z", z)
        joints = self._joints(z, q, anywhere=True)
        return singularity(self.kinematics, z, joints, complete=self._complete)

    def motion(self, z: ArrayLike, s: ArrayLike, q: Joints = None) -> RobotMotion:
        """Rates of all joints that the dynamics use, at coordinates z and quasi-velocities s."""
        z, s = self.kinematics.coordinates("z", z), self.kinematics.coordinates("s", s)
        return self.kinematics.motion(z, s, self._joints(z, q), complete=self._complete)

    def terms(
        self,
        z: ArrayLike,
        zd: ArrayLike,
        q: Joints = None,
        *,
        form: str = "S",
        wrench: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> DynamicTerms:
        """Mass matrix, Coriolis and gravity forces in one of the forms of :class:`DynamicTerms`.

        Args:
            z, zd: (m,).
            q: joint positions per leg: all, or up to the coupling points where those suffice.
            form: S, X, Z, A or AA.
            wrench: (6,) external force and moment on the platform about its origin, world axes; a part of c,
                with a minus sign.
            gravity: (3,), m/s^2, world axes; default the robot's.

        Raises:
            SolverError: singular pose, with its type.
            InputError: wrong shapes, unknown form, pose out of reach.
        """
        z, zd = self.kinematics.coordinates("z", z), self.kinematics.coordinates("zd", zd)
        s = self.kinematics.rate_matrices(z, zd)[0] @ zd
        motion = self._regular_motion(z, s, q)
        terms = self._quasi_terms(motion, wrench, gravity)
        return converted(
            terms,
            form,
            rates=self.kinematics.rate_matrices(z, zd),
            zd=zd,
            jacobian=self.kinematics.actuated_jacobian(motion),
            motor_drift=motor_drift(self.description.actuated, motion),
        )

    def mass_matrix(self, z: ArrayLike, q: Joints = None, *, form: str = "S") -> np.ndarray:
        """M at a pose."""
        return self.terms(z, np.zeros(self.m), q, form=form).M

    def inverse_dynamics(
        self,
        z: ArrayLike,
        zd: ArrayLike,
        zdd: ArrayLike,
        q: Joints = None,
        *,
        rates: Literal["euler", "quasi"] = "euler",
        wrench: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> InverseDynamics:
        """Motor forces of a motion.

        Args:
            z: (m,) coordinates.
            zd, zdd: (m,) their derivatives, or s' and s'' if `rates` is "quasi".
            q: joint positions per leg.
            rates: what zd and zdd are.
            wrench: (6,) external force and moment on the platform about its origin, world axes.
            gravity: (3,), m/s^2, world axes; default the robot's.

        Raises:
            SolverError: singular pose, or motors that cannot balance the forces.
            InputError: wrong shapes, unknown names, pose out of reach.
        """
        if rates not in ("euler", "quasi"):
            raise InputError(f"rates: must be 'euler' or 'quasi', got {rates!r}")
        z, s, sd = self._state(z, zd, zdd, rates)
        motion = self._regular_motion(z, s, q)
        tau = self._quasi_terms(motion, wrench, gravity).force(sd)
        return self._distributed(self.kinematics.actuated_jacobian(motion), tau)

    def forward_dynamics(
        self,
        z: ArrayLike,
        s: ArrayLike,
        motors: ArrayLike,
        q: Joints = None,
        *,
        wrench: ArrayLike | None = None,
    ) -> np.ndarray:
        """Quasi-accelerations s'' (m,) under motor forces.

        Args:
            z: (m,) coordinates.
            s: (m,) quasi-velocities.
            motors: (n_a,) motor forces.
            q: joint positions per leg.
            wrench: (6,) external force and moment on the platform about its origin, world axes.

        Raises:
            SolverError: singular leg, or a mass matrix that is not positive definite.
        """
        z, s = self.kinematics.coordinates("z", z), self.kinematics.coordinates("s", s)
        tau_a = finite_array("motors", motors, (len(self.description.actuated),))
        motion = self._regular_motion(z, s, q, legs_only=True)
        terms = self._quasi_terms(motion, wrench, None)
        right = self.kinematics.actuated_jacobian(motion).T @ tau_a - terms.c - terms.g
        try:
            factor = np.linalg.cholesky(terms.M)
        except np.linalg.LinAlgError:
            smallest = np.linalg.eigvalsh(terms.M)[0]
            raise SolverError(
                f"forward dynamics: the mass matrix is not positive definite (eigenvalue {smallest:.2g})"
            ) from None
        return np.linalg.solve(factor.T, np.linalg.solve(factor, right))

    def joint_reactions(
        self,
        z: ArrayLike,
        zd: ArrayLike,
        zdd: ArrayLike,
        q: Joints = None,
        *,
        wrench: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> JointReactions:
        """Forces and moments in all joints and at the leg ends; arguments as :meth:`inverse_dynamics`."""
        z, s, sd = self._state(z, zd, zdd)
        motion = self._regular_motion(z, s, q, complete=True)
        result = joint_reactions(self.kinematics, motion, sd, self._gravity(gravity), _wrench(wrench))
        _require_balance(result.residual, "motors and closures")
        return result

    def energy(self, z: ArrayLike, s: ArrayLike, q: Joints = None) -> tuple[float, float]:
        """Kinetic and potential energy, J; drives included, friction not."""
        motion = self.motion(z, s, q)
        body, g = self.description.platform.inertia, self.description.gravity
        kinetic = 0.5 * motion.s @ self._quasi_terms(motion, None, None).M @ motion.s
        potential = -g @ (body.mass * motion.r + motion.R @ body.first_moment)
        for leg, part in zip(self.kinematics.legs, motion.legs, strict=True):
            potential += leg.dynamics(leg.padded(part.q), np.zeros(leg.n), g)[-1][1]
            potential -= g @ leg.origin * sum(b.mass for b in leg.leg.bodies)
        return float(kinetic), float(potential)

    def regressor(self, z: ArrayLike, zd: ArrayLike, zdd: ArrayLike, q: Joints = None) -> np.ndarray:
        """W (m, 10 bodies) with tau_s = W `description.inertia_vector`; see :func:`regressor`."""
        z, s, sd = self._state(z, zd, zdd)
        motion = self._regular_motion(z, s, q, legs_only=True)
        return regressor(self.kinematics, motion, sd, self.description.gravity)

    def crossings(self, path: ArrayLike) -> tuple[Crossing, ...]:
        """Singular poses on a path (N, m), also between its samples; see :func:`crossings`."""
        return crossings(self.kinematics, path)

    def lean(self, outputs: Sequence[str] = ("tau",), **options: Any) -> LeanFunction:
        """Generated function: :func:`~ocptip.parallel.code.lean.lean_function`, or `complete_function`
        of :mod:`ocptip.parallel.code.complete` where joints behind the coupling points take part, with the
        base parameters of the whole robot as DynPar 3."""
        if self.complete_legs:
            if options.get("dynpar") == 3 and options.get("base") is None:
                options = {**options, "base": self.base_parameters("numeric")}
            return complete_function(self, outputs, **options)
        return lean_function(self.description, outputs, **options)

    def codegen(
        self, path: str | os.PathLike[str], outputs: Sequence[str] = ("tau",), **options: Any
    ) -> CFiles:
        """Write the motor forces (form "A"), or what the options ask for, as C source with a header."""

        return write_c(self.lean(outputs, **{"form": "A", **options}), path)

    def base_parameters(
        self, how: Literal["leg", "numeric"] = "leg", **options: Any
    ) -> LegBaseParameters | NumericBaseParameters:
        """Base parameters: leg-wise closed form, or of the whole robot by QR."""
        if how not in ("leg", "numeric"):
            raise InputError(f"how: must be 'leg' or 'numeric', got {how!r}")
        make = leg_base_parameters if how == "leg" else numeric_base_parameters
        return make(self.description, **options)

    def _state(
        self, z: ArrayLike, zd: ArrayLike, zdd: ArrayLike, rates: str = "euler"
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """z, s', s''."""
        check = self.kinematics.coordinates
        z, zd, zdd = check("z", z), check("zd", zd), check("zdd", zdd)
        return (z, *self.kinematics.quasi(z, zd, zdd)) if rates == "euler" else (z, zd, zdd)

    def _joints(
        self, z: np.ndarray, q: Joints, *, complete: bool | None = None, anywhere: bool = False
    ) -> tuple[np.ndarray, ...]:
        """Joint positions that are given, or of the home assembly (`anywhere`: of any)."""
        complete = self._complete if complete is None else complete
        if q is None:
            result = self.kinematics.joints(z) if complete else self.kinematics.point_joints(z)
            if result.searched and not anywhere:
                legs = ", ".join(str(leg + 1) for leg in result.searched)
                raise SolverError(
                    f"{self.description.name}: leg {legs} cannot be followed on the straight line from home "
                    f"to {np.round(z, 6).tolist()}: a singular pose or the end of its reach lies between; "
                    "give joint positions `q` of the assembly that is meant"
                )
            return result.q
        legs = self.kinematics.legs
        if len(q) != len(legs):
            raise InputError(f"q: expected one array per leg, {len(legs)}, got {len(q)}")
        joints = []
        for i, (leg, values) in enumerate(zip(legs, q, strict=True)):
            sizes = (leg.n,) if complete else (leg.n, leg.point)
            array = finite_array(f"q[{i + 1}]", values, (None,))
            if len(array) not in sizes:
                wanted = " or ".join(str(size) for size in sizes)
                raise InputError(f"q[{i + 1}]: expected {wanted} numbers, got {len(array)}")
            joints.append(array if complete else array[: leg.point])
        return tuple(joints)

    def _distributed(self, jacobian: np.ndarray, tau_s: np.ndarray) -> InverseDynamics:
        """Solve J_a' tau_a = tau_s; the smallest forces if there are more motors than coordinates."""
        square = jacobian.shape[0] == jacobian.shape[1]
        if square:
            motors = np.linalg.solve(jacobian.T, tau_s)
        else:
            motors = np.linalg.lstsq(jacobian.T, tau_s, rcond=None)[0]
        residual = np.abs(jacobian.T @ motors - tau_s).max() / max(np.abs(tau_s).max(), 1e-300)
        _require_balance(residual, f"{len(motors)} motors")
        return InverseDynamics(motors, tau_s, float(residual))

    def _regular_motion(
        self, z: np.ndarray, s: np.ndarray, q: Joints, *, complete: bool = False, legs_only: bool = False
    ) -> RobotMotion:
        """Rates of the joints that the dynamics use, or of all (`complete`); singular poses are refused."""
        complete = complete or self._complete
        joints = self._joints(z, q, complete=complete)
        require_regular(self.kinematics, z, joints, complete=complete, legs_only=legs_only)
        return self.kinematics.motion(z, s, joints, complete=complete)

    def _quasi_terms(
        self, motion: RobotMotion, wrench: ArrayLike | None, gravity: ArrayLike | None
    ) -> DynamicTerms:
        terms = quasi_terms(self.kinematics, motion, self._gravity(gravity))
        if wrench is None:
            return terms
        return DynamicTerms("S", terms.M, terms.c - motion.T.T @ _wrench(wrench), terms.g)

    def _gravity(self, gravity: ArrayLike | None) -> np.ndarray:
        return self.description.gravity if gravity is None else finite_array("gravity", gravity, (3,))


def base_wrench(
    robot: ParallelRobot,
    z: ArrayLike,
    zd: ArrayLike,
    zdd: ArrayLike,
    *,
    gravity: ArrayLike | None = None,
    load: ArrayLike | None = None,
    q: Joints = None,
) -> np.ndarray:
    """Wrench (6,) of a robot on what it is mounted on, about its world origin, world axes.

    Newton and Euler for all bodies together: what the base gives is what moves and carries them, however
    motors and legs share the forces. The spin of motor rotors is neglected, as for serial arms.

    Args:
        robot: the robot.
        z, zd, zdd: (m,).
        gravity: (3,), m/s^2, world axes; default the robot's.
        load: (6,) external force and moment on the platform about its origin.
        q: joint positions per leg.
    """
    check = robot.kinematics.coordinates
    z, zd, zdd = check("z", z), check("zd", zd), check("zdd", zdd)
    g = robot.description.gravity if gravity is None else finite_array("gravity", gravity, (3,))
    s, sd = robot.kinematics.quasi(z, zd, zdd)
    motion = robot.motion(z, s, q)
    M, c, weight = platform_terms(robot.description.platform.inertia, motion.R, motion.t[3:], g)
    needed = _moved(M @ (motion.T @ sd + motion.T_drift) + c + weight - _wrench(load), motion.r)
    for leg, part in zip(robot.kinematics.legs, motion.legs, strict=True):
        *_, momentum, carried, _ = leg.dynamics(leg.padded(part.q), leg.padded(part.qd), g)
        needed += _moved(momentum @ leg.padded(part.Jq @ sd + part.drift) + carried, leg.origin)
    return -needed


def _moved(wrench: np.ndarray, point: np.ndarray) -> np.ndarray:
    """A wrench about `point` as one about the origin."""
    return np.concatenate([wrench[:3], wrench[3:] + cross(point, wrench[:3])])


def _wrench(value: ArrayLike | None) -> np.ndarray:
    return np.zeros(6) if value is None else finite_array("wrench", value, (6,))


def _require_balance(residual: float, what: str) -> None:
    if not residual < _BALANCE:
        raise SolverError(
            f"inverse dynamics: {what} leave {residual:.2g} of the forces unbalanced (relative)"
        )
