"""Conventional methods that the package's own solvers are compared with, in tests and studies only.

Nothing here is needed to use the package: ordinary Lemke pivoting with three ratio tests, two pairwise LCP
formulations of ordinary unilateral contacts, and the bounded Nelder-Mead method of the source's appendix D.
"""

from ocptip.baselines.contact_lcp import PairwiseContactProblem, StewartTrinkleContactProblem
from ocptip.baselines.lemke import LcpBatch, LcpSolution, solve_lcp, solve_lcp_many
from ocptip.baselines.nelder_mead import nelder_mead

__all__ = [
    "LcpBatch",
    "LcpSolution",
    "PairwiseContactProblem",
    "StewartTrinkleContactProblem",
    "nelder_mead",
    "solve_lcp",
    "solve_lcp_many",
]
