"""Conventional methods that the package's own solvers are compared with, in tests and studies only.

Nothing here is needed to use the package: ordinary Lemke pivoting with three ratio tests, and two pairwise
LCP formulations of ordinary unilateral contacts.
"""

from ocptip.baselines.contact_lcp import PairwiseContactProblem, StewartTrinkleContactProblem
from ocptip.baselines.lemke import LcpBatch, LcpSolution, solve_lcp, solve_lcp_many

__all__ = [
    "LcpBatch",
    "LcpSolution",
    "PairwiseContactProblem",
    "StewartTrinkleContactProblem",
    "solve_lcp",
    "solve_lcp_many",
]
