"""The table `[tolerance]` and the names of presets."""

from __future__ import annotations

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.basics.toml import toml_text
from ocptip.standing.tolerance import SITE, WORKSHOP, Uncertainty
from ocptip.task_files.tables.tolerance import load_tolerance


def read(folder, text):
    path = folder / "a.toml"
    path.write_text(f"[tolerance]\n{text}\n[other]\nkey = 1\n")
    return load_tolerance(f"{path}")


def test_a_preset_and_what_differs_from_it(tmp_path):
    assert load_tolerance("site") is SITE
    found = read(tmp_path, 'preset = "workshop"\ntilt_deg = 2\nmasses = 0.1\npayload_mass = 0\ndelay_ms = 5')
    assert (found.base_mass, found.arm_mass, found.payload_mass) == (0.1, 0.1, 0.0)
    assert found.tilt == pytest.approx(np.radians(2))
    assert found.delay == pytest.approx(0.005)
    assert (found.friction, found.damping) == (WORKSHOP.friction, WORKSHOP.damping)


def test_without_preset_all_else_is_certain(tmp_path):
    found = read(tmp_path, "base_mass = [1, 2]\ncenter_of_mass = [0, 0.01, 0]\npush = 3")
    assert found.given == ("base_mass", "center_of_mass", "push")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("tilt = 1", "a.toml: tolerance.tilt: unknown key; did you mean 'tilt_deg'?"),
        ("tilt_deg = 60", "a.toml: tolerance.tilt_deg: must be at most"),
        ("masses = 1.5", "a.toml: tolerance.masses: must be >= 0 and below 1"),
        ("masses = 0.1\narm_mass = 2", "a.toml: tolerance.arm_mass: must be >= 0 and below 1"),
        ('preset = "shop"', "a.toml: tolerance.preset: expected one of none, workshop, site"),
        ("delay_ms = -1", "a.toml: tolerance.delay_ms: must be >= 0"),
    ],
)
def test_mistakes_are_named(tmp_path, text, message):
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    assert f"{caught.value}".startswith(message)


@pytest.mark.parametrize("one", [WORKSHOP, SITE, Uncertainty(base_mass=[1, 2.5], payload_center=[0, 0.1, 0])])
def test_tables_are_read_back(tmp_path, one):
    found = read(tmp_path, toml_text(one.to_table()))
    assert found.to_dict().keys() == one.to_dict().keys()
    for name, value in one.to_dict().items():
        assert found.to_dict()[name] == pytest.approx(value, rel=1e-14)


def test_neither_a_preset_nor_a_file():
    with pytest.raises(InputError, match=r"^expected none, workshop, site or a TOML file, got 'shop'"):
        load_tolerance("shop")
