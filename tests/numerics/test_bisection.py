"""Bisection with a prediction: the same as without, whatever the prediction is; fewer costly evaluations."""

import numpy as np
import pytest

from ocptip.numerics.bisection import bisected, border, borders

BORDER = 0.3217


def near(low, high):
    return high - low < 1e-3


@pytest.mark.parametrize(("predicted", "most"), [(BORDER, 2), (0.35, 13), (0.0, 13), (2.0, 13)])
@pytest.mark.parametrize(("without", "having", "sign"), [(0.0, 1.0, 1), (1.0, 0.0, -1)])
def test_a_prediction_changes_costs_only(predicted, most, without, having, sign):
    tried = []

    def find(value):
        tried.append(value)
        return f"at {value}" if sign * value > sign * BORDER else None

    def likely(value):
        return sign * value > sign * predicted

    plain = bisected(find, without, having, "at the end", near)
    tried.clear()
    assert bisected(find, without, having, "at the end", near, likely) == plain
    assert len(tried) <= most


def test_a_prediction_at_the_ends_is_right():
    """No result up to the last value, or one down to the first: only the other one is evaluated."""
    for edge in (-1.0, 2.0):

        def find(value, edge=edge):
            return value if value > edge else None

        assert bisected(find, 0.0, 1.0, 1.0, near, lambda v, b=edge: v > b) == bisected(
            find, 0.0, 1.0, 1.0, near
        )


@pytest.mark.parametrize(("inside", "outside", "sign"), [(0.0, 1.0, 1), (1.0, 0.0, -1)])
def test_borders_of_one_interval_and_of_many_are_the_same(inside, outside, sign):
    def kept(value):
        return sign * value <= sign * BORDER

    last, first = border(kept, inside, outside, lambda low, high: high - low <= 2.0**-10)
    assert kept(last)
    assert not kept(first)
    assert abs(first - last) == 2.0**-10
    ends = np.full(3, inside), np.full(3, outside)
    np.testing.assert_array_equal(borders(kept, *ends, 10), [[last] * 3, [first] * 3])
