"""Numbers as people read them."""

import math

import pytest

from ocptip.basics.text import with_error


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
