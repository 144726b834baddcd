"""Kernels that are compiled before they are called."""

import pytest

from ocptip.motion.planner.kernels import ARGUMENTS
from ocptip.motion.planner.one_start import Search
from ocptip.published.tasks import experiment_task


@pytest.mark.slow
def test_kernels_are_prepared_for_the_arguments_that_a_search_gives_them():
    search = Search(experiment_task("A", "effective"))
    search.run(1, 0)
    several = {kernel.__name__ for kernel in ARGUMENTS if len(kernel.made) != 1}
    assert several == set()
