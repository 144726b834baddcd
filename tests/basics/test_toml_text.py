"""TOML that is written is read back as the same data."""

import datetime
import math
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.toml import toml_text, toml_value
from tests.quick import examples

TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
VALUES = st.recursive(
    TEXTS
    | st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False)
    | st.dates()
    | st.times(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS, inner, max_size=3),
    max_leaves=12,
)


@examples(200, derandomize=True)
@given(st.dictionaries(TEXTS, VALUES, max_size=4))
def test_what_is_written_is_read_back(data):
    assert tomllib.loads(toml_text(data)) == data


def test_keys_of_a_table_come_before_the_tables_below_it():
    data = {"base": {"shape": [{"kind": "box"}, {"kind": "mesh", "at": {"x": 1}}], "mass": 3.0}, "name": "a"}
    assert toml_text(data) == (
        'name = "a"\n\n[base]\nmass = 3.0\n\n[[base.shape]]\nkind = "box"\n\n[[base.shape]]\nkind = "mesh"\n'
        "\n[base.shape.at]\nx = 1\n"
    )


def test_numbers_that_are_none_and_values_without_a_form():
    assert toml_value(math.inf) == "inf"
    assert math.isnan(tomllib.loads(f"x = {toml_value(math.nan)}")["x"])
    assert toml_value(datetime.datetime(2026, 11, 22, 9, 30)) == "2026-11-22T09:30:00"
    with pytest.raises(TypeError, match="no form for None"):
        toml_text({"x": None})
