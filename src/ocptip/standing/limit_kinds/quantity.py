"""What a limit is about in several scenarios: a quantity of the contacts, a function of the wrench.

A limit is a quantity in a scenario with a bound. The scenarios are in `nominal`, `jumps`, `stops` and
`elastic`: they say which wrenches there are. A quantity says how bad these are, with derivatives.
Its badness is a number per row of a program, the greater the worse.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from ocptip.standing.footing import Footing
from ocptip.standing.instants import Loaded
from ocptip.standing.stops.by_brakes import BrakeCheck, Closing
from ocptip.standing.within.worst_case import WorstCase, WorstDeviations


class ContactQuantity(ABC):
    """One quantity of a base on its contacts with the number that a limit asks for.

    Args:
        footing: the base or an object on its contacts.
        number: asked for.
        smooth: rows may be of a smooth function that is on the safe side, where the exact one takes long.

    Attributes:
        name, symbol: in words, and in results.
        at_steps: field of `Limits` for the loads after acceleration steps.
        width: number of rows at a node.
        unit: of rows.
        affine: rows are affine in the wrench.
        least: within an uncertainty rows have a lower bound, else an upper one.
        in_results: field of `WithinTolerance`.
    """

    name = symbol = at_steps = in_results = ""
    width, unit, affine, least = 1, 1.0, False, False

    def __init__(self, footing: Footing, number: float, smooth: bool = False) -> None:
        self.footing, self.number, self.smooth = footing, number, smooth

    # --- what happens -------------------------------------------------------------------------------------

    @abstractmethod
    def measure(self, loaded: Loaded) -> np.ndarray:
        """(N,) values for reports; those below the maximum may be upper bounds."""

    @abstractmethod
    def kept(self, loaded: Loaded) -> bool:
        """At all instants."""

    @abstractmethod
    def refusals(self, loaded: Loaded) -> list[str]:
        """Why the mechanism cannot rest so (a single instant), with numbers."""

    def largest(self, loaded: Loaded) -> np.ndarray:
        """(P,) the same of many loads, of which the contact solver sees few."""
        return self.measure(loaded)

    def measure_still(self, loaded: Loaded) -> np.ndarray:
        """(N,) values under loads that come before anything moves."""
        return self.measure(loaded)

    def detail(self, loaded: Loaded) -> str:
        """Further words on a single instant."""
        return ""

    def path_excess(self, loaded: Loaded) -> float:
        """By how much a path, taken at rest, misses the limit, with some margin; in about its units."""
        return -np.inf

    def half_spaces(self) -> np.ndarray | None:
        """Rows a (m, 6): the limit is kept under wrenches w with a . w <= 0; None: there are no such."""
        return None

    # --- rows of a program --------------------------------------------------------------------------------

    @abstractmethod
    def badness(self, loaded: Loaded) -> np.ndarray:
        """(N, width) as rows of programs have it."""

    @abstractmethod
    def exact(self, loaded: Loaded) -> np.ndarray:
        """(P, width) where it matters, by the contact solver."""

    @abstractmethod
    def exact_rows(self, loaded: Loaded) -> tuple[np.ndarray, np.ndarray]:
        """Badness (P, width) in units of rows, and its slopes (P, width, 6) over the wrench."""

    @abstractmethod
    def uses(self, badness: np.ndarray) -> np.ndarray:
        """(N, width): use of the limit, 1 at the limit, more beyond."""

    def near(self, badness: np.ndarray, share: float) -> np.ndarray:
        """(N, width) True where rows take part, which are asked for from a use `share` on."""
        return ~(self.uses(badness) < share)

    @abstractmethod
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of the rows of a node, (width,) each."""

    @abstractmethod
    def worst(self) -> np.ndarray:
        """(width,): badness in units of rows, at most."""

    @abstractmethod
    def rows(
        self, wrenches: np.ndarray, i: np.ndarray, k: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Values (R,), slopes (R, 6) and second derivatives, if any, of rows k under wrenches i."""

    # --- within an uncertainty: states s (N, 3 n) at the worst deviations ----------------------------------

    @abstractmethod
    def smooth_within(self, cases: WorstCase) -> tuple[WorstCase, float]:
        """A smooth substitute of the worst case for programs, and the bound of its values."""

    @abstractmethod
    def within(
        self, cases: WorstCase, s: np.ndarray, k: np.ndarray, theta: np.ndarray | None = None
    ) -> WorstDeviations:
        """Rows k (N,) of states at the worst deviations, or at given ones (N, size)."""

    @abstractmethod
    def worst_of_options(
        self, cases: WorstCase, options: np.ndarray, acting: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Badness (D, width) with the worst options of joints, see `worst_options`, and their numbers."""

    @abstractmethod
    def worst_within(self, cases: WorstCase, s: np.ndarray, k: np.ndarray, late: np.ndarray) -> np.ndarray:
        """(P, size) deviations that are worst for rows (P,) in states (P, 3 n), with delays of joints."""

    @abstractmethod
    def uses_within(self, cases: WorstCase, s: np.ndarray, bound: float) -> np.ndarray:
        """(N, width) estimated use of the limit, 1 at the limit, more beyond."""

    @abstractmethod
    def kept_within(self, cases: WorstCase, s: np.ndarray, bound: float) -> bool:
        """In all states, as programs see it."""

    @abstractmethod
    def rests_within(self, cases: WorstCase, s: np.ndarray) -> bool:
        """Whether the limit is kept in a state (1, 3 n) at rest."""

    @abstractmethod
    def lost_words(self, value: float, of: str = "") -> str:
        """A value beyond the limit in words: a margin and its limit, or that something tips or slips.

        Args:
            value: GN or GT.
            of: the object that it is about; empty: the base.
        """

    @abstractmethod
    def worst_at_rest(self, cases: WorstCase, s: np.ndarray) -> tuple[float, np.ndarray]:
        """GN or GT in a state (1, 3 n) at rest, and the deviations (size,) there."""

    def path_excess_within(self, cases: WorstCase, s: np.ndarray) -> float:
        """See `path_excess`."""
        return -np.inf

    # --- stops by brakes ----------------------------------------------------------------------------------

    @abstractmethod
    def brake_torques(self, check: BrakeCheck, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """(N, width, n) of the brakes on the joints, at which each row is worst; 0 for joints at rest."""

    @abstractmethod
    def brake_badness(
        self, check: BrakeCheck, closing: Closing, q: np.ndarray, qd: np.ndarray, share: float
    ) -> np.ndarray:
        """(N, width) when brakes close; exact above about `share` of the limit."""
