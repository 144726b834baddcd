"""The narrowest feet and the lightest base, by hand and against the worst case just beside them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import ocptip
from ocptip.cli.main import main
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.design import MOST, Design
from ocptip.standing.within.rest import scene_within
from tests.places import EXAMPLES

PUSHED = EXAMPLES / "scenes" / "pushed_cart.toml"


def test_a_pushed_cart_needs_the_lever_of_its_push(capsys):
    assert main(["stand", str(PUSHED), "--design", "--json"]) == 1
    design = json.loads(capsys.readouterr().out)["design"]
    assert design["feet"] == pytest.approx(260 * 1.0 / (40 * 9.81 * 0.3), rel=3e-3)
    assert design["size_m"] == pytest.approx([0.6 * design["feet"], 0.5 * design["feet"]])
    assert design["base_mass_kg"] == pytest.approx(260 * 1.0 / (9.81 * 0.3), rel=3e-3)
    assert main(["stand", str(PUSHED)]) == 1
    assert "--design: how wide or heavy the base must be" in capsys.readouterr().out
    texts = Design(2.21, (1.33, 1.1), 88.4).lines(ocptip.read_scene(PUSHED).support)
    assert texts[0] == "feet: 221 % of the present width keep the limits, 1.33 x 1.1 m"
    assert texts[1] == "base mass: 88.4 kg keep the limits, 48.4 kg more at its centre of mass"


def test_what_slides_is_helped_by_mass_alone():
    found = ocptip.stand(PUSHED)
    smooth = [replace(contact, friction=0.3) for contact in found.scene.support.contacts]
    scene = replace(found.scene, support=found.scene.support.varied(smooth))
    design = ocptip.stand(scene).smallest_design
    assert (design.feet, design.size_m) == (None, None)
    assert design.base_mass_kg == pytest.approx(260 / (0.3 * 9.81), rel=3e-3)


def test_within_an_uncertainty_the_answer_is_on_the_safe_side():
    found = ocptip.stand(
        EXAMPLES / "scenes" / "tripod_with_arm.toml", uncertainty=Uncertainty(base_mass=0.05, friction=0.2)
    )
    design, scene = found.smallest_design, found.scene
    middle = np.mean([contact.position for contact in scene.support.contacts], axis=0)
    for factor, stands in ((1.0, True), (0.99, False)):
        feet = [
            replace(c, position=middle + factor * design.feet * (c.position - middle))
            for c in scene.support.contacts
        ]
        within = scene_within(scene.support.varied(feet), scene.loads, found.tolerance)
        assert within.stands == stands
    assert design.base_mass_kg == pytest.approx(scene.support.mass / MOST)  # the load alone presses all feet
