"""The part of Clarabel that ocptip uses; its compiled module describes no types."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix

__version__: str

class ZeroConeT:
    def __init__(self, dim: int) -> None: ...

class NonnegativeConeT:
    def __init__(self, dim: int) -> None: ...

class SecondOrderConeT:
    def __init__(self, dim: int) -> None: ...

class PSDTriangleConeT:
    def __init__(self, dim: int) -> None: ...

class SolverStatus:
    Solved: SolverStatus
    AlmostSolved: SolverStatus

class DefaultSettings:
    verbose: bool
    presolve_enable: bool
    equilibrate_enable: bool
    max_threads: int
    tol_feas: float
    tol_gap_abs: float
    tol_gap_rel: float

class DefaultSolution:
    x: list[float]
    z: list[float]
    status: Any
    obj_val_dual: float
    r_prim: float
    r_dual: float

class DefaultSolver:
    def __init__(
        self,
        P: csc_matrix,
        q: np.ndarray,
        A: csc_matrix,
        b: np.ndarray,
        cones: Sequence[ZeroConeT | NonnegativeConeT | SecondOrderConeT | PSDTriangleConeT],
        settings: DefaultSettings,
    ) -> None: ...
    def update(self, *, A: np.ndarray, b: np.ndarray) -> None: ...
    def solve(self) -> DefaultSolution: ...
