"""Kernels that Python runs give what machine code gives."""

import warnings

import numpy as np
import pytest

from ocptip.contact.solver import solve_many
from ocptip.numerics.jit.compiled import Kernel, interpreted
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver
from studies.contact.random_supports import random_support, random_wrenches
from tests.quick import some


def answers(support, wrenches):
    states = solve_many(support, wrenches)
    slip = Slip(support).evaluate(states, derivatives=False)
    return states.solved, states.persistent, states.forces, TipOver(support).evaluate(states).GN, slip.GT


@pytest.mark.parametrize("seed", some(2, range(6)))
def test_the_same_to_the_last_bit(seed, monkeypatch):
    rng = np.random.default_rng(seed)
    support = random_support(rng, n=int(rng.integers(2, 6)))
    wrenches = random_wrenches(rng, support, 3)
    compiled = answers(support, wrenches)
    monkeypatch.setattr(Kernel, "_for_types", None)  # whoever asks for it fails
    with interpreted(), warnings.catch_warnings():
        warnings.simplefilter("error")
        own = answers(support, wrenches)
    for one, other in zip(own, compiled, strict=True):
        np.testing.assert_array_equal(one, other)
