"""The contact solvers that are compared: ours, conventional formulations, other libraries."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from ocptip.contact.solver import solve_many
from ocptip.contact.support import Support
from studies.baselines.contact_lcp import PairwiseContactProblem, StewartTrinkleContactProblem
from studies.baselines.lemke import RULES, solve_lcp_many
from studies.contact.peers import PEERS, ConventionalLemke, Peer
from studies.contact.problems import Case
from studies.contact.yardstick import Answers, Tally, judge

ROUNDS, SECONDS_PER_SOLVER = 7, 2.0


class Ours:
    """`ocptip.contact.solver.solve_many` without warm start: every problem from scratch."""

    name = "ocptip"

    def prepare(self, support: Support, wrenches: np.ndarray) -> Callable[[], object]:
        """The call that is timed."""
        support.system  # noqa: B018  (assembled once, as the matrices of the others)
        return lambda: solve_many(support, wrenches, warm_start=False)

    def read(self, states, support: Support, wrenches: np.ndarray) -> Answers:
        again = np.where(states.attempts == 1, "", "*").tolist()
        status = [states.status(i) + again[i] for i in range(len(states))]
        return Answers(states.contact_forces, states.solved, status, states.pivots)


class Conventional:
    """Lemke's method on a conventional formulation, compiled batch."""

    def __init__(self, label: str, formulation: type, rule: str) -> None:
        self.formulation, self.rule = formulation, rule
        self.name = f"{label} {rule}"

    def prepare(self, support: Support, wrenches: np.ndarray) -> Callable[[], object]:
        """The call that is timed: without building the matrix and without recovering the forces."""
        self.problem = self.formulation(*arguments(support))
        M, Q = self.problem.lcp_matrix(), self.problem.q(wrenches)
        return lambda: solve_lcp_many(M, Q, self.rule)

    def read(self, batch, support: Support, wrenches: np.ndarray) -> Answers:
        forces = [self.problem.recover(z, h)[0] for z, h in zip(batch.z, wrenches, strict=True)]
        return Answers(np.array(forces), batch.solved, batch.status.tolist(), batch.pivots)


COMPILED = (
    Ours(),
    *(Conventional("pairwise", PairwiseContactProblem, rule) for rule in RULES),
    *(Conventional("Stewart-Trinkle", StewartTrinkleContactProblem, rule) for rule in RULES),
)
EXTERNAL = tuple(peer for peer in PEERS if not isinstance(peer, ConventionalLemke))
SOLVERS = [solver.name for solver in (*COMPILED, *EXTERNAL)]


def arguments(support: Support) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Wrench matrix (6, 3n), inverse mass matrix (6, 6), friction (n,) and facets of a support."""
    friction = np.array([contact.friction for contact in support.contacts])
    return support.wrench_matrix, support.inverse_mass, friction, support.contacts[0].facets


def run_compiled(case: Case) -> list[Tally]:
    """Our solver and the baselines: answers of all problems, then times, interleaved."""
    tallies, calls = [], {}
    for solver in COMPILED:
        parts = []
        for support, wrenches in case.problems:
            call = solver.prepare(support, wrenches)
            parts.append(solver.read(call(), support, wrenches))
            calls[solver.name] = call
        tallies.append(judge(case, solver.name, parts, true_cone=False))
    if case.timed:
        times = {name: [] for name in calls}
        for _ in range(ROUNDS):
            for name, call in calls.items():
                if sum(times[name]) < SECONDS_PER_SOLVER:
                    start = time.perf_counter()
                    call()
                    times[name].append(time.perf_counter() - start)
        for tally in tallies:
            tally.microseconds = 1e6 * float(np.median(times[tally.solver])) / tally.problems
    return tallies


def run_peer(case: Case, peer: Peer) -> list[Tally]:
    """An external solver, one problem after the other; it times its own call."""
    parts, seconds = [], []
    for support, wrenches in case.problems:
        if not seconds:
            peer.solve(*arguments(support), wrenches[0])  # the first call also loads the library
        answers = [peer.solve(*arguments(support), wrench) for wrench in wrenches]
        seconds += [a.seconds for a in answers]
        parts.append(
            Answers(
                np.array([a.forces for a in answers]),
                np.array([a.converged for a in answers]),
                ["solved" if a.converged else "not converged" for a in answers],
                np.array([a.iterations for a in answers]),
            )
        )
    tally = judge(case, peer.name, parts, true_cone=peer.name.startswith("pinocchio"))
    if case.timed:
        tally.microseconds = 1e6 * float(np.mean(seconds))
        tally.microseconds_median = 1e6 * float(np.median(seconds))
    return [tally]
