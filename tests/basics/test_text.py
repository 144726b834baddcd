"""Numbers as people read them."""

import math

import pytest

from ocptip.basics.text import numbered, with_error


@pytest.mark.parametrize(
    ("value", "half", "text"),
    [
        (0.208174, 0.0045123, "0.2082 +- 0.0045 kg"),
        (-0.010764, 0.0085, "-0.0108 +- 0.0085 kg"),
        (1503.2, 320.0, "1500 +- 320 kg"),
        (-1e-9, 0.1, "0.00 +- 0.10 kg"),
        (2.34567, math.inf, "2.346 kg"),
        (2.34567, 0.0, "2.346 kg"),
    ],
)
def test_values_have_the_digits_of_their_errors(value, half, text):
    assert with_error(value, half, "kg") == text


@pytest.mark.parametrize(
    ("numbers", "text"),
    [
        ([3], "link 3"),
        ([1, 2], "links 1, 2"),
        ([1, 2, 3, 5], "links 1 to 3, 5"),
        ([2, 4, 5, 6], "links 2, 4 to 6"),
    ],
)
def test_numbered_things_are_named_in_runs(numbers, text):
    assert numbered("link", numbers) == text
