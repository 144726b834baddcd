"""Times of the reserves: median microseconds per state for GN and GT with derivative, 3 to 8 feet.

    python -m studies.contact.reserve_timing [--states 1000] [--repeats 7] [--facets 12] [--seed 0]

Feet at the corners of a regular polygon, weight plus random forces and moments, of which roughly three in
four are held. The states are solved beforehand; the derivatives of the contact forces (`force_maps`), which
both reserves need, are listed on their own and are part of the columns with derivative.
"""

from __future__ import annotations

import argparse
import platform
import time
from collections.abc import Callable

import clarabel
import numpy as np

from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve_many
from ocptip.contact.states import ContactStates
from ocptip.contact.support import Support
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver

FULL_SHARE = 5  # the full redistribution is slower: a fifth of the states


def polygon(n: int, facets: int) -> Support:
    """A base of 60 kg, its centre of mass 0.6 m above the floor, on n feet 0.35 m from the middle."""
    angles = 2 * np.pi * np.arange(n) / n
    contacts = [
        UnilateralContact(position=(0.35 * np.cos(a), 0.35 * np.sin(a), 0), friction=0.5, facets=facets)
        for a in angles
    ]
    return Support(contacts, mass=60.0, center_of_mass=(0, 0, 0.6), inertia=(3.0, 4.0, 5.0))


def solved_states(support: Support, count: int, seed: int) -> ContactStates:
    """States under the weight and random wrenches."""
    rng = np.random.default_rng(seed)
    noise = np.hstack([rng.normal(size=(count, 3)) * 100, rng.normal(size=(count, 3)) * 40])
    states = solve_many(support, support.weight + noise)
    return states


def median_time(function: Callable[[], object], count: int, repeats: int) -> float:
    """Median time of `function` per state, microseconds."""
    function()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return float(np.median(times)) / count * 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--states", type=int, default=1000)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--facets", type=int, default=12)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    print(f"seed {options.seed}, {options.states} states, S = {options.facets}, {platform.machine()}")
    print(f"Python {platform.python_version()}, numpy {np.__version__}, clarabel {clarabel.__version__}")
    print("microseconds per state (d: with derivative), median of repeats")
    print("feet  held  force maps     GN   GN d     GT   GT d   GT one state d   GT full d  largest residual")
    for n in (3, 4, 6, 8):
        support = polygon(n, options.facets)
        states = solved_states(support, options.states, options.seed)
        few = solved_states(support, max(1, options.states // FULL_SHARE), options.seed)
        one = solved_states(support, 1, options.seed)
        tip_over, slip, full = TipOver(support), Slip(support, "tangential"), Slip(support, "full")

        def per_state(function: Callable[[ContactStates], object], batch: ContactStates = states) -> float:
            # a fresh copy each time: states keep what they have computed once
            return median_time(lambda: function(batch.select(slice(None))), len(batch), options.repeats)

        times = [
            per_state(lambda batch: batch.force_maps),
            per_state(tip_over.evaluate),
            per_state(lambda batch: tip_over.evaluate(batch).gradient),  # noqa: B023
            per_state(lambda batch: slip.evaluate(batch, derivatives=False)),  # noqa: B023
            per_state(slip.evaluate),
            per_state(slip.evaluate, one),
            per_state(full.evaluate, few),
        ]
        residual = max(np.max(slip.evaluate(states).residual), np.max(full.evaluate(few).residual))
        widths = (11.1, 6.2, 6.1, 6.1, 6.1, 16.0, 11.0)
        columns = " ".join(f"{value:{width}f}" for value, width in zip(times, widths, strict=True))
        print(f"{n:4d} {np.mean(states.persistent):5.0%} {columns} {residual:17.1e}")


if __name__ == "__main__":
    main()
