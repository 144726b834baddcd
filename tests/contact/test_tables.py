"""What compiled code reads of a system is what the system holds."""

import numpy as np
import pytest

from ocptip.contact.tables import right_hand_sides, unpacked
from tests.contact.contact_cases import KINDS, disturbed_weight, feet, kind_name, mixed, polygon

NAMES = (
    "matrix", "extent", "first_column", "row_start", "subsets", "subset_start", "successor", "entering",
    "start_count", "start_first", "start_subset", "start_inverse", "block_start", "lifts", "gauge",
    "plain_matrix", "force_columns", "force_offset", "acceleration_columns",
)  # fmt: skip


@pytest.mark.parametrize("kind", KINDS, ids=kind_name)
@pytest.mark.parametrize("planar", [False, True], ids=["spatial", "planar"])
def test_tables_hold_the_system(kind, planar):
    support = mixed(kind, planar=planar)
    system, d = support.system, support.dimension
    read = dict(zip(NAMES, unpacked(*system.tables), strict=True))
    for name in NAMES:
        if hasattr(system, name) and name != "force_offset":
            own = getattr(system, name)
            own = own.T if name in ("matrix", "plain_matrix") else own
            np.testing.assert_array_equal(read[name], own, err_msg=name)
    np.testing.assert_array_equal(read["force_offset"].ravel(), system.force_offset)
    for k, (start, contact) in enumerate(zip(system.first_column, support.contacts, strict=True)):
        own = slice(start, start + len(contact.columns.names))
        rows = slice(d * k, d * k + d)
        np.testing.assert_array_equal(read["force_columns"][own], system.force_matrix[rows, own].T)
        np.testing.assert_allclose(
            read["acceleration_columns"][own] * support.mass, system.acceleration_matrix[rows, own].T
        )
    for column, (begin, end) in zip(read["matrix"], read["extent"], strict=True):
        assert np.all(column[:begin] == 0)
        assert np.all(column[end:] == 0)
        assert column[begin] != 0
        assert column[end - 1] != 0


@pytest.mark.parametrize("support", [mixed(KINDS[1]), feet(polygon(4))], ids=["clamps", "feet"])
def test_right_hand_sides(support):
    system = support.system
    for wrench in disturbed_weight(np.random.default_rng(2), support, 5):
        rhs, plain, hint = right_hand_sides(*system.tables, wrench)
        np.testing.assert_allclose(rhs, system.rhs(wrench[None])[0], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(plain - rhs, system.plain_rhs_offset - system.rhs_offset, atol=1e-10)
        np.testing.assert_allclose(hint, system.hint_matrix @ wrench, rtol=1e-12, atol=1e-9)
