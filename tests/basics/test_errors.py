"""Places in front of refusals."""

import pytest

from ocptip.basics.errors import InputError, naming
from ocptip.basics.read import read_bytes


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("my.csv", "{folder}/my.csv: no such file"),
        ("joint 3", "joint 3: {folder}/my.csv: no such file"),
        ("other.csv", "other.csv: {folder}/my.csv: no such file"),
    ],
)
def test_a_file_is_named_once(tmp_path, place, message):
    with pytest.raises(InputError) as refused, naming(place):
        read_bytes(tmp_path / "my.csv")
    assert f"{refused.value}" == message.format(folder=tmp_path)


def test_what_has_no_file_has_its_place_in_front():
    with pytest.raises(InputError, match=r"^my.csv: mass: must be > 0$"), naming("my.csv"):
        raise InputError("mass: must be > 0")
