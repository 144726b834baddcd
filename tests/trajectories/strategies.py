"""Random commands and phases for the tests of velocity ramps; seeds are hypothesis' own."""

from __future__ import annotations

from hypothesis import strategies as st

from ocptip.trajectories.ramps import RampCommand


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    """Floats of a closed range, without subnormal ones."""
    return st.floats(low, high, allow_subnormal=False)


def angles() -> st.SearchStrategy[float]:
    """Angles in whole microradians, rad."""
    return st.integers(-3_000_000, 3_000_000).map(lambda number: number / 1e6)


commands = st.lists(
    st.builds(RampCommand, angles(), numbers(0.2, 4.0), numbers(0.5, 12.0)), min_size=1, max_size=4
)


@st.composite
def phases(draw: st.DrawFn) -> tuple[list[float], list[float], list[float]]:
    """Signed peaks, ramp and brake durations, cruises that satisfy the conditions of `phase_violations`."""
    n = draw(st.integers(1, 4))
    peaks, ramps, cruises = [], [], []
    w_a = 0.0
    for _ in range(n):
        usable = numbers(0.05, 4.0).flatmap(lambda w: st.sampled_from([w, -w]))
        w = draw(usable.filter(lambda w, w_a=w_a: abs(w - w_a) > 0.02))
        slows_down = w * w_a > 0 and abs(w) < abs(w_a)
        peaks.append(w)
        ramps.append(draw(numbers(0.02, 2.0)))
        cruises.append(draw(numbers(0.01, 2.0) if slows_down else st.one_of(st.just(0.0), numbers(0.0, 2.0))))
        w_a = w
    before = peaks[-2] if n > 1 else 0.0
    ramps.append(abs(peaks[-1]) * ramps[-1] / abs(peaks[-1] - before))
    return peaks, ramps, cruises
