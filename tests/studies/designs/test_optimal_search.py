import pytest

from ocptip.basics.errors import InputError
from studies.indices.designs.optimal_platforms import ctn_optimal_main, ctn_optimal_special
from studies.indices.designs.optimal_search import classify, search_optimal


@pytest.mark.slow
def test_random_starts_find_no_third_family():
    """Every regular solution belongs to L_H or L_S, and both are found."""
    search = search_optimal(20, seed=1)
    assert search.count("L_H") >= 3
    assert search.count("L_S") >= 3
    assert search.count("other") == 0
    assert len(search.found) + search.unsolved + search.singular == search.starts == 20
    for item in search.found:
        assert item.value > 1 - 1e-8
        assert item.defect < 1e-10


@pytest.mark.slow
def test_sixty_starts():
    search = search_optimal(60, seed=0)
    assert (search.count("L_H"), search.count("L_S"), search.count("other")) == (16, 21, 0)


def test_families_are_told_apart():
    assert classify(ctn_optimal_main(0.3, 1.0).platform) == "L_H"
    assert classify(ctn_optimal_special(0.5, 1.0).platform) == "L_S"
    assert classify(ctn_optimal_special(3**-0.5, 1.0).platform) == "L_S"  # all legs equal here, too
    stretched = ctn_optimal_main(0.3, 1.0).platform.parameters() | {"r2": 2.0}
    assert classify(type(ctn_optimal_main(0.3, 1.0).platform).from_parameters(**stretched)) == "other"


def test_starts_are_checked():
    with pytest.raises(InputError, match="starts: must be a whole number >= 1"):
        search_optimal(0)
