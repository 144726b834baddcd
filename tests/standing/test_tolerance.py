"""Tolerances as data: what is refused, what is said, presets."""

from __future__ import annotations

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.standing.tolerance import NONE, PRESETS, SITE, WORKSHOP, Uncertainty


def test_presets_are_those_of_the_documentation():
    assert list(PRESETS) == ["none", "workshop", "site"]
    assert NONE.given == ()
    assert f"{NONE}" == "none"
    assert NONE.overshoot == 0
    assert f"{WORKSHOP}" == (
        "base mass +-5 %, friction -20 %, floor tilt 0.5 deg, arm masses +-5 %, payload +-5 %, 0.1 kg more "
        "at the TCP, joints delayed by up to 10 ms, 3 % faster or slower, "
        "acceleration steps overshoot at 5 % damping"
    )
    assert SITE.push == SITE.base_push == 20
    assert np.degrees(SITE.tilt) == pytest.approx(1.5)
    assert set(SITE.given) - set(WORKSHOP.given) == {"push", "base_push"}


def test_overshoot_is_that_of_a_damped_oscillation():
    """The step response 1 - exp(-z w t) (cos + z / root sin) is largest half a period after the step."""
    zeta = 0.05
    root = np.sqrt(1 - zeta**2)
    t = np.linspace(0, 4, 400001)
    response = 1 - np.exp(-zeta * t) * (np.cos(root * t) + zeta / root * np.sin(root * t))
    assert Uncertainty(damping=zeta).overshoot == pytest.approx(response.max() - 1, abs=1e-9)
    assert Uncertainty(damping=0.0).overshoot == 1


def test_only_and_require_only():
    assert WORKSHOP.only("friction", "tilt").given == ("friction", "tilt")
    with pytest.raises(InputError, match=r"^tolerance\.tilt: not checked here; there are friction$"):
        Uncertainty(friction=0.1, tilt=0.1).require_only("friction", where="here")


def test_plain_data_holds_what_is_uncertain():
    data = Uncertainty(base_mass=[9.0, 11.0], center_of_mass=[0.01, 0, 0], damping=0.0).to_dict()
    assert data == {"base_mass": [9.0, 11.0], "center_of_mass": [0.01, 0.0, 0.0], "damping": 0.0}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tilt": 1.0}, "tilt: must be at most 45 degrees, got 57.2958 degrees"),
        ({"tilt": -0.1}, "tilt: must be >= 0"),
        ({"speed": 1.0}, r"speed: must be >= 0 and below 1, got 1\.0"),
        ({"damping": 1.0}, r"damping: must be >= 0 and below 1, got 1\.0"),
        ({"extra_mass": float("nan")}, "extra_mass: "),
        ({"payload_center": [0, 0, -1]}, "payload_center: half sides must be >= 0"),
    ],
)
def test_broken_tolerances_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        Uncertainty(**options)
