"""Requirements for pipelines: text, values, exit codes, JUnit."""

from __future__ import annotations

import json
from xml.etree import ElementTree

import numpy as np
import pytest

import ocptip
from ocptip.api.inputs.requirements import UNITS, read_requirements
from ocptip.basics.errors import InputError
from ocptip.cli.main import main
from tests.places import EXAMPLES

SCENE = EXAMPLES / "scenes" / "rover_on_slope.toml"


@pytest.fixture(scope="module")
def rover():
    return ocptip.stand(SCENE)


def value_of(found, text):
    (outcome,) = found.require(text)
    return outcome.value


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("tilt 5 deg", "expected NAME >= NUMBER UNIT"),
        ("titl >= 5 deg", "did you mean 'tilt'"),
        ("tilt <= 5 deg", "expected >=, got <="),
        ("friction used >= 80 %", "expected <=, got >="),
        ("tilt >= 5", "expected the unit deg, got none"),
        ("tilt >= 0.1 rad", "expected the unit deg, got rad"),
        ("tilt >= nan deg", "must be finite"),
        ("push >= -3 N", "must be finite and >= 0"),
        ("push >= 1..2 N", "expected a number"),
    ],
)
def test_texts_that_are_refused(text, message):
    with pytest.raises(InputError, match=message):
        read_requirements(text)


def test_every_quantity_is_read_as_it_prints_itself():
    text = ", ".join(f"{name.upper()} {sign} 2.5e1{unit}" for name, (unit, sign) in UNITS.items())
    wanted = read_requirements(text)
    assert [one.name for one in wanted] == list(UNITS)
    assert read_requirements("; ".join(map(str, wanted))) == wanted


@pytest.mark.parametrize(
    ("friction", "text", "value"),
    [
        (3.0, "base push >= 300 N", 40 * 9.81 * 0.2 / 0.29**0.5),
        (0.2, "tilt >= 30 deg", np.degrees(np.arctan(0.2))),
    ],
)
def test_values_of_a_block_are_those_of_statics(tmp_path, friction, text, value):
    """It tips over its nearer edge (0.2 m / 0.5 m), or it slips.

    The worst push also lifts: it is perpendicular to the line from the edge to the centre of mass.
    """
    scene = tmp_path / "scene.toml"
    feet = "[[0.3, 0.2, 0], [0.3, -0.2, 0], [-0.3, 0.2, 0], [-0.3, -0.2, 0]]"
    base = f"[base]\nmass = 40\ncenter_of_mass = [0, 0, 0.5]\nfriction = {friction}\n"
    scene.write_text(f"{base}feet = {feet}\n")
    outcome, easy = ocptip.stand(scene).require(f"{text}, tilt >= 5 deg")
    assert outcome.value == pytest.approx(value, rel=4e-3)
    assert (outcome.met, easy.met) == (False, True)
    assert easy.value == pytest.approx(np.degrees(np.arctan(min(0.4, friction))), rel=4e-3)


def test_deviations_have_the_value_at_which_a_contact_is_lost(tmp_path):
    scene = tmp_path / "scene.toml"
    feet = "[[0.3, 0.2, 0], [0.3, -0.2, 0], [-0.3, 0.2, 0], [-0.3, -0.2, 0]]"
    scene.write_text(f"[base]\nmass = 40\ncenter_of_mass = [0, 0, 0.5]\nfriction = 3\nfeet = {feet}\n")
    push, less = ocptip.stand(scene).require("base push >= 10 N, friction loss >= 20 %")
    assert push.value == pytest.approx(40 * 9.81 * 0.2 / 0.29**0.5, rel=4e-3)
    assert (less.at_least, less.value) == (True, 99.9)


def test_margins_of_a_scene(rover):
    axis = rover.nearest_axis["moment_reserve"]
    assert value_of(rover, "tipping margin >= 1 N m") == axis
    assert value_of(rover, "foot force >= 1 N") == pytest.approx(rover.normal_reserves.min())
    used = rover.slip.GT[0]
    met, broken = rover.require(f"friction used <= {101 * used} %, friction used <= {99 * used} %")
    assert (met.met, broken.met) == (True, False)


def test_margins_within_an_uncertainty_are_those_of_the_worst_case(rover):
    worst = ocptip.stand(SCENE, uncertainty="workshop")
    for text in ("tipping margin >= 1 N m", "friction used <= 1 %"):
        (outcome,) = worst.require(text)
        assert outcome.note.startswith("worst case")
        gain = (value_of(rover, text) - outcome.value) * (1 if ">=" in text else -1)
        assert gain > 0


def test_quantities_of_arms_need_one(rover):
    for text in ("additional payload >= 1 kg", "push >= 1 N"):
        with pytest.raises(InputError, match="needs an arm"):
            rover.require(text)
    with pytest.raises(InputError, match="not of a base at rest"):
        rover.require("overspeed >= 1 %")


def test_command_writes_junit_and_fails(tmp_path, capsys):
    report = tmp_path / "report.xml"
    for bound, code in ((1, 0), (300, 1)):
        asked = ["stand", f"{SCENE}", "--require", f"foot force >= {bound} N", "--junit", f"{report}"]
        assert main([*asked, "--json"]) == code
        (outcome,) = json.loads(capsys.readouterr().out)["requirements"]
        assert outcome["met"] is (code == 0)
        suite = ElementTree.parse(report).getroot()
        assert (suite.get("tests"), suite.get("failures")) == ("2", f"{code}")
        assert [case.find("failure") is not None for case in suite.iter("testcase")] == [False, code == 1]
    (tmp_path / "mine.xml").write_text("<mine/>")
    assert main([*asked[:-1], f"{tmp_path / 'mine.xml'}"]) == 2
    assert (tmp_path / "mine.xml").read_text() == "<mine/>"


def test_a_base_that_tips_meets_no_deviation(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(
        "[base]\nmass = 10.0\ncenter_of_mass = [0.0, 0.0, 1.0]\nfriction = 0.5\n"
        "feet = [[0.1, 0.1, 0.0], [0.1, -0.1, 0.0], [-0.1, 0.0, 0.0]]\n"
        "[[load]]\nforce = [100.0, 0.0, 0.0]\npoint = [0.0, 0.0, 1.0]\n"
    )
    (outcome,) = ocptip.stand(scene).require("tilt >= 1 deg")
    assert (outcome.value, outcome.met) == (0.0, False)
