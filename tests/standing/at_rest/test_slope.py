"""The largest slope of the floor, against angles by hand, and against the worst case of a tilt."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import ocptip
from ocptip.cli.main import main
from ocptip.contact.support import Load
from ocptip.robots.payload import Payload
from ocptip.standing.at_rest.slope import largest_slope, tilted_wrench
from ocptip.standing.footing import Footing
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.rest import scene_within
from ocptip.task_files.scene import read_scene
from tests.places import EXAMPLES
from tests.quick import some
from tests.reserves.reserve_scenes import HEIGHT, corners, feet


def slope_of(support, loads=()):
    found = largest_slope(Footing(support), support.gravity, tilted_wrench(support, loads))
    assert found is not None
    return found


@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_a_high_base_tips_and_a_smooth_one_slides(turn):
    places = corners(4, turn=turn)
    inner = np.linalg.norm(places[0] + places[1]) / 2
    tips, slides = slope_of(feet(places, friction=2.0)), slope_of(feet(places, friction=0.1))
    assert tips.angle == pytest.approx(np.arctan(inner / HEIGHT), abs=1e-4)
    assert tips.loss == "tips"
    outward = sum(places[k - 1] for k in tips.contacts)
    assert tips.downhill @ outward / np.linalg.norm(outward) == pytest.approx(1.0)
    assert slides.angle == pytest.approx(np.arctan(0.1), abs=1e-4)
    assert (slides.loss, slides.contacts) == ("slides", ())
    assert slides.tips == pytest.approx(tips.angle, abs=1e-4)
    assert tips.tips == tips.angle


def test_a_push_does_not_turn_with_the_floor_and_what_has_no_answer_has_none():
    support, push = feet(corners(4), friction=0.3), Load(force=[100.0, 0, 0], point=[0, 0, HEIGHT])
    weight = support.mass * 9.81
    found = slope_of(support, (push,))
    # Down the slope mg sin a + F = mu mg cos a, with the push along it.
    level = np.linspace(0, 0.3, 100_001)
    expected = level[np.argmin(np.abs(weight * np.sin(level) + 100 - 0.3 * weight * np.cos(level)))]
    assert found.angle == pytest.approx(expected, abs=2e-4)
    assert found.downhill[0] == pytest.approx(1.0, abs=1e-2)
    too_much = replace(push, force=[200.0, 0, 0])
    wrench = tilted_wrench(support, (too_much,))
    assert largest_slope(Footing(support), support.gravity, wrench) is None


@pytest.mark.parametrize("name", some(1, ["tripod_with_arm", "cart_on_rubber"]))
def test_the_slope_is_where_the_worst_case_of_a_tilt_begins_to_lose_a_contact(name):
    scene = read_scene(EXAMPLES / "scenes" / f"{name}.toml")
    angle = slope_of(scene.support, scene.loads).angle
    within = [
        scene_within(scene.support, scene.loads, Uncertainty(tilt=factor * angle)) for factor in (0.99, 1.02)
    ]
    assert [one.stands for one in within] == [True, False]


def test_stand_prints_slope_and_payload_and_the_drives_count_in_requirements(capsys):
    task = str(EXAMPLES / "tasks" / "ur5_cart.toml")
    require = "additional payload >= 3 kg, additional payload >= 25 kg"
    code = main(["stand", task, "--posture", "start", "--tolerance", "none", "--require", require, "--json"])
    found = json.loads(capsys.readouterr().out)
    light, heavy = found["requirements"]
    assert (code, light["met"], heavy["met"]) == (1, True, False)
    assert heavy["note"] == "beyond what is held, nominal; the drives hold no more"
    payload = found["largest_payload"]
    assert payload["limit"].startswith("torque of ")
    assert heavy["value"] == pytest.approx(payload["mass_kg"], rel=1e-6)  # the task holds nothing
    posture = ocptip.stand(task, "start", uncertainty="none")
    arm = posture.posture.robot.arm
    assert posture.largest_slope.loss == "tips"
    held = arm.with_payload(Payload(heavy["value"]))
    torques = posture.posture.robot.varied(arm=held).loads(posture.posture.q[None], *np.zeros((2, 1, 6)))[0]
    assert np.max(np.abs(torques) / arm.limits.torque) == pytest.approx(1.0)


@pytest.mark.slow
def test_casters_that_may_carry_everything_are_the_named_cause(capsys, tmp_path):
    angle = np.radians(0.01)
    text = f"gravity = [{9.81 * np.sin(angle)}, 0, {-9.81 * np.cos(angle)}]\n"
    text += "[base]\nmass = 90\ncenter_of_mass = [0, 0, 0.2]\n"
    wheels, casters = [(0, 0.2), (0, -0.2)], [(0.2, 0.1), (0.2, -0.1), (-0.2, -0.1), (-0.2, 0.1)]
    for friction, places in ((0.5, wheels), (0.0, casters)):
        text += "".join(f"[[contact]]\nposition = [{x}, {y}, 0]\nfriction = {friction}\n" for x, y in places)
    path = tmp_path / "casters.toml"
    path.write_text(text)
    assert main(["stand", str(path)]) == 1
    printed = " ".join(capsys.readouterr().out.split())
    assert "NOT SURE" in printed
    assert "Contacts 3, 4, 5 and 6 have no friction and may carry all load" in printed
    assert "then contacts 1 and 2 hold nothing" in printed
    path.write_text(text.replace("friction = ", "stiffness = 1e6\nfriction = "))
    assert main(["stand", str(path)]) == 0
    assert "STABLE on its compliant feet" in capsys.readouterr().out
