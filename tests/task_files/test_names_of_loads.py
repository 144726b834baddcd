"""Names of loads that are keys of a load, too, are refused before anything is read from them."""

import pytest

import ocptip
from ocptip.basics.errors import InputError
from tests.places import EXAMPLES


@pytest.mark.parametrize("name", ["mass", "box"])
def test_a_load_is_not_named_like_a_key(tmp_path, name):
    text = (EXAMPLES / "tasks" / "ur5_pick_and_place.toml").read_text(encoding="utf-8")
    known = text.split("[payload.")[1].split("]")[0]
    text = text.replace(f"[payload.{known}", f"[payload.{name}").replace(f'"{known}"', f'"{name}"')
    text = text.replace("ur5.urdf", str(EXAMPLES / "tasks" / "ur5.urdf").replace("\\", "/"))
    file = tmp_path / "task.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=rf"payload\.{name}: '{name}' is a key of \[payload\]"):
        ocptip.load_task(file)
