"""Contact solvers of other projects behind one interface, for comparison with ours.

Every peer solves one problem: a rigid base with inverse mass matrix `inverse_mass` (6, 6) on n ordinary
unilateral contacts, M qdd = h + W lam, contact accelerations a = W' qdd. `W` is (6, 3n) with the columns n,
t1, t2 per contact, `friction` (n,), `wrench` (6,) about the centre of mass.

* Pinocchio's PGS and ADMM solve for Coulomb's true cone and ignore the number of facets: their accelerations
  differ from those with a pyramid by the pyramid's error wherever a contact slips.
* Drake's Lemke solvers get the same Stewart-Trinkle LCP as our Lemke baselines, in newtons and with q divided
  by max |q|. Their tolerances are absolute: with accelerations in m/s^2 and q as it comes ("-raw") they fail,
  or report success wrongly, in most cases.

Peers that are not installed report `available() == False`. `seconds` is the time of the solver's own call,
without building the problem.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Protocol

import numpy as np

from studies.baselines.contact_lcp import StewartTrinkleContactProblem
from studies.baselines.lemke import solve_lcp


@dataclass(frozen=True)
class PeerAnswer:
    """What a peer returned.

    Attributes:
        forces: (n, 3) contact forces [N], contact axes n, t1, t2; NaN where the peer returned none.
        acceleration: (6,) base acceleration computed from these forces [m/s^2; rad/s^2].
        converged: Whether the peer reported success. Not verified: some report success and are wrong.
        iterations: Iterations or pivots; -1 where the peer does not tell.
        seconds: Time of the solver's call.
    """

    forces: np.ndarray
    acceleration: np.ndarray
    converged: bool
    iterations: int
    seconds: float


class Peer(Protocol):
    """A solver to compare with."""

    name: str

    def available(self) -> bool:
        """Whether the peer's package can be imported here."""

    def solve(
        self, W: np.ndarray, inverse_mass: np.ndarray, friction: np.ndarray, facets: int, wrench: np.ndarray
    ) -> PeerAnswer:
        """Contact forces and base acceleration."""


class _Pinocchio:
    """Common part of Pinocchio's two solvers (pin >= 4.1), Coulomb's cone without associated dilation."""

    name: str

    def __init__(self, tolerance: float, max_iterations: int) -> None:
        self.tolerance = tolerance
        self.max_iterations = max_iterations

    def available(self) -> bool:
        if find_spec("pinocchio") is None:
            return False
        import pinocchio as pin

        return hasattr(pin, "PGSConstraintSolver")

    def solve(
        self, W: np.ndarray, inverse_mass: np.ndarray, friction: np.ndarray, facets: int, wrench: np.ndarray
    ) -> PeerAnswer:
        import pinocchio as pin

        n = len(friction)
        # Pinocchio's contact axes are t1, t2, n. The model only carries the constraints: the problem itself
        # is given by the matrix and the vector below.
        order = np.array([3 * k + axis for k in range(n) for axis in (1, 2, 0)])
        J = W[:, order].T
        # Accelerations are multiplied by a reference mass, so that the absolute tolerances are in newtons and
        # do not depend on the base's mass; the wrench's size is divided out for the same reason.
        mass = 3 * n / np.trace(J @ inverse_mass @ J.T)
        G = mass * J @ inverse_mass @ J.T
        free = mass * J @ inverse_mass @ wrench
        size = max(np.max(np.abs(free)), np.finfo(float).tiny)

        model = pin.Model()
        model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
        models, datas = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
        for mu in friction:
            contact = pin.PointContactConstraintModel(model, 1, pin.SE3.Identity())
            contact.setFriction(float(mu))
            models.append(pin.ConstraintModel(contact))
            datas.append(pin.ConstraintData(contact.createData()))

        solver, settings, result = self._solver(pin, 3 * n)
        settings.max_iterations = self.max_iterations
        settings.absolute_feasibility_tol = self.tolerance
        settings.absolute_complementarity_tol = self.tolerance
        settings.relative_feasibility_tol = 0.0
        settings.relative_complementarity_tol = 0.0
        # A new operator for each solve: ADMM leaves its damping in the operator that it is given.
        operator = pin.DelassusOperatorDense((G + G.T) / 2.0)
        right = free / size
        start = time.perf_counter()
        converged = solver.solve(operator, right, models, datas, settings, result)
        seconds = time.perf_counter() - start

        stacked = size * np.asarray(result.retrieveConstraintImpulses())
        forces = stacked.reshape(n, 3)[:, [2, 0, 1]]
        acceleration = inverse_mass @ (wrench + W @ forces.ravel())
        return PeerAnswer(forces, acceleration, bool(converged), int(result.iterations), seconds)


class PinocchioPGS(_Pinocchio):
    """Projected Gauss-Seidel."""

    name = "pinocchio-pgs"

    def __init__(self, tolerance: float = 1e-9, max_iterations: int = 20_000) -> None:
        super().__init__(tolerance, max_iterations)

    @staticmethod
    def _solver(pin, size: int):
        return pin.PGSConstraintSolver(size), pin.PGSSolverSettings(), pin.PGSSolverResult()


class PinocchioADMM(_Pinocchio):
    """Alternating direction method of multipliers."""

    name = "pinocchio-admm"

    def __init__(self, tolerance: float = 1e-9, max_iterations: int = 5_000) -> None:
        super().__init__(tolerance, max_iterations)

    @staticmethod
    def _solver(pin, size: int):
        return pin.ADMMConstraintSolver(size), pin.ADMMSolverSettings(), pin.ADMMSolverResult()


class _Drake:
    """Common part of Drake's LCP solvers, on the Stewart-Trinkle LCP.

    Args:
        scaled: All in newtons and q divided by max |q|; False: accelerations in m/s^2 and q as it comes.
    """

    name: str

    def __init__(self, scaled: bool = True) -> None:
        self.scaled = scaled
        self.name = type(self).name if scaled else f"{type(self).name}-raw"

    def available(self) -> bool:
        return find_spec("pydrake") is not None

    def solve(
        self, W: np.ndarray, inverse_mass: np.ndarray, friction: np.ndarray, facets: int, wrench: np.ndarray
    ) -> PeerAnswer:
        from pydrake import solvers

        problem = StewartTrinkleContactProblem(W, inverse_mass, friction, facets)
        M, q = problem.lcp_matrix(), problem.q(wrench)
        # newtons per unit of each unknown: the last ones, slip accelerations, are in newtons or in m/s^2
        unit = np.ones(len(q))
        if self.scaled:
            unit *= max(np.max(np.abs(q)), np.finfo(float).tiny)
            q = q / unit
        else:
            accelerations = np.arange(len(q)) < len(q) - problem.contacts  # rows of M z + q
            unit[~accelerations] = problem.reference_mass
            row_unit = np.where(accelerations, problem.reference_mass, 1.0)
            M, q = M * unit / row_unit[:, None], q / row_unit
        program = solvers.MathematicalProgram()
        z = program.NewContinuousVariables(len(q))
        program.AddLinearComplementarityConstraint(M, q, z)
        solver = self._solver(solvers)
        start = time.perf_counter()
        result = solver.Solve(program, None, None)
        seconds = time.perf_counter() - start
        values = unit * np.asarray(result.GetSolution(z), dtype=float)
        if np.all(np.isfinite(values)):
            forces, acceleration = problem.recover(values, wrench)
        else:
            forces, acceleration = np.full((len(friction), 3), np.nan), np.full(6, np.nan)
        return PeerAnswer(forces, acceleration, bool(result.is_success()), -1, seconds)


class DrakeMoby(_Drake):
    """Moby's Lemke solver; regularises where the plain method fails, so a success need not be a solution."""

    name = "drake-moby"

    @staticmethod
    def _solver(solvers):
        return solvers.MobyLcpSolver()


class DrakeUnrevisedLemke(_Drake):
    """Lemke's method on an unrevised tableau."""

    name = "drake-unrevised"

    @staticmethod
    def _solver(solvers):
        return solvers.UnrevisedLemkeSolver()


class ConventionalLemke:
    """Our own compiled Lemke solver on the Stewart-Trinkle LCP, in the same interface."""

    def __init__(self, rule: str = "lexicographic") -> None:
        self.rule = rule
        self.name = f"lemke-{rule}"

    def available(self) -> bool:
        return True

    def solve(
        self, W: np.ndarray, inverse_mass: np.ndarray, friction: np.ndarray, facets: int, wrench: np.ndarray
    ) -> PeerAnswer:
        problem = StewartTrinkleContactProblem(W, inverse_mass, friction, facets)
        M, q = problem.lcp_matrix(), problem.q(wrench)
        start = time.perf_counter()
        answer = solve_lcp(M, q, self.rule)
        seconds = time.perf_counter() - start
        forces, acceleration = problem.recover(answer.z, wrench)
        return PeerAnswer(forces, acceleration, answer.solved, answer.pivots, seconds)


PEERS: tuple[Peer, ...] = (
    PinocchioPGS(),
    PinocchioADMM(),
    DrakeMoby(),
    DrakeMoby(scaled=False),
    DrakeUnrevisedLemke(),
    DrakeUnrevisedLemke(scaled=False),
    *(ConventionalLemke(rule) for rule in ("textbook", "lexicographic", "largest-pivot")),
)


def available_peers() -> list[Peer]:
    """The peers that can run here."""
    return [peer for peer in PEERS if peer.available()]
