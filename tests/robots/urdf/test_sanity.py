"""Inertia in URDFs that no arm can have: refused with the link's name and what accepts it, or warned of."""

import re
import warnings

import numpy as np
import pytest

from ocptip.basics.errors import InputError, InputWarning
from ocptip.published.arms import arm_by_name
from ocptip.robots.payload import Payload
from ocptip.robots.urdf.arm import arm_from_urdf
from ocptip.robots.urdf.sanity import doubt_arm, doubt_speeds, refuse_impossible_links
from tests.places import UR5

NAMES = {"base_link": "base_link", "tool_frame": "tool0"}
UPPER = '<mass value="8.393"/>'


def changed(tmp_path, *pairs):
    text = UR5.read_text(encoding="utf-8")
    for old, new in pairs:
        assert re.search(old, text)
        text = re.sub(old, new, text)
    path = tmp_path / "arm.urdf"
    path.write_text(text, encoding="utf-8")
    return path


MASSLESS = (UPPER, '<mass value="0"/>')
POINT = (rf"{UPPER}\s*<inertia[^>]*/>", f'{UPPER}<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/>')
NEGATIVE = (rf'{UPPER}\s*<inertia ixx="', f'{UPPER}<inertia ixx="-')
LONG = (
    rf"{UPPER}\s*<inertia[^>]*/>",
    f'{UPPER}<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.25"/>',
)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (MASSLESS, "moves, but has no mass"),
        (POINT, "has a mass, but no moments of inertia"),
        (NEGATIVE, r"no body has these principal values .* none may be negative"),
        (LONG, r"no body has these principal values .*\(0.1, 0.1, 0.25 kg m\^2\)"),
    ],
)
def test_a_link_that_cannot_be_is_refused_until_it_is_accepted(tmp_path, change, reason):
    path = changed(tmp_path, change)
    with pytest.raises(InputError, match=rf"^link 'upper_arm_link': {reason}") as said:
        arm_from_urdf(path, **NAMES)
    assert str(said.value).endswith('if that is meant: accept_inertia = ["upper_arm_link"]')
    for accepted in (["upper_arm_link"], ["wrist_1_link", "upper_arm_link"], True):
        assert arm_from_urdf(path, **NAMES, accept_inertia=accepted).n == 6
    with pytest.raises(InputError, match="upper_arm_link"):
        arm_from_urdf(path, **NAMES, accept_inertia=["forearm_link"])


def test_all_such_links_are_named_at_once_and_a_wrong_name_is_refused(tmp_path):
    path = changed(tmp_path, MASSLESS, ('<mass value="1.219"/>', '<mass value="0"/>'))  # of two wrists
    with pytest.raises(InputError) as said:
        arm_from_urdf(path, **NAMES)
    assert str(said.value).count("has no mass") == 3
    with pytest.raises(
        InputError, match=r"accept_inertia: no moving link 'upper_arm'; .* did you mean 'upper_arm_link'"
    ):
        arm_from_urdf(UR5, **NAMES, accept_inertia=["upper_arm"])


def test_a_model_without_any_mass_is_called_that(tmp_path):
    path = changed(tmp_path, (r'<mass value="[\d.]+"/>', '<mass value="0"/>'))
    with pytest.raises(InputError, match=r"^no link that moves has a mass"):
        arm_from_urdf(path, **NAMES)


def test_massless_frames_and_rounded_moments_are_fine(tmp_path):
    # tool0 has no mass and moves with wrist_3_link; two digits may miss the triangle inequality by a percent
    rounded = (LONG[0], LONG[1].replace('"0.25"', '"0.201"'))
    assert arm_from_urdf(changed(tmp_path, rounded), **NAMES).masses[1] == 8.393


def test_arms_that_are_not_out_of_a_urdf_are_taken_as_they_are():
    arm = arm_by_name("FP1W2F")  # halves of modules with rotors folded in
    assert np.linalg.eigvalsh(arm.inertias).min() < 0
    with pytest.raises(InputError, match="link '0'"):
        refuse_impossible_links(arm, [[str(k)] for k in range(6)])


def test_masses_that_no_arm_has_are_warned_of(tmp_path):
    two = changed(tmp_path, (r'<mass value="[\d.]+"/>', '<mass value="0.1"/>'))
    with pytest.warns(InputWarning, match=r"0.6 kg of moving links on a chain of .* less than any known arm"):
        arm_from_urdf(two, **NAMES)
    grams = changed(tmp_path, (r'<mass value="([\d.]+)"/>', r'<mass value="\g<1>e3"/>'))
    with pytest.warns(InputWarning, match="are they grams"):
        arm_from_urdf(grams, **NAMES)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        doubt_arm(arm_by_name("IRB2000"))  # no masses at all: nothing to judge
    light = arm_from_urdf(UR5, **NAMES)
    length = np.linalg.norm(light.offsets, axis=1).sum()
    assert light.masses.sum() / length ** np.array([3, 2]) == pytest.approx([10, 12], rel=0.01)
    doubt_arm(light.with_payload(Payload(1e5)))  # what it holds is not judged


def test_an_arm_of_two_kilogram_links_and_two_and_a_half_metres(tmp_path):
    # twice the size of the UR5, 12 kg
    def doubled(match):
        return f'xyz="{" ".join(str(2.1 * float(x)) for x in match[1].split())}"'

    path = changed(tmp_path, (r'<mass value="[\d.]+"/>', '<mass value="2"/>'))
    text = path.read_text(encoding="utf-8")
    joints = re.sub(r'(?<=<origin )xyz="([^"]+)"', doubled, text)
    path.write_text(joints, encoding="utf-8")
    with pytest.warns(InputWarning, match="12 kg of moving links on a chain of 2.5"):
        arm_from_urdf(path, **NAMES)


def test_millimetres_are_warned_of(tmp_path):
    def times_thousand(match):
        return f'xyz="{" ".join(str(1e3 * float(x)) for x in match[1].split())}"'

    path = tmp_path / "mm.urdf"
    text = UR5.read_text(encoding="utf-8")
    path.write_text(re.sub(r'(?<=<origin )xyz="([^"]+)"', times_thousand, text), encoding="utf-8")
    with pytest.warns(InputWarning, match="are these millimetres"):
        arm_from_urdf(path, **NAMES)


def test_speeds_that_are_no_limits_are_warned_of():
    """Files that know none have 1000 rad/s, with which plans throw the arm about."""
    arm = arm_from_urdf(UR5, **NAMES)
    doubt_speeds(arm)
    speeds = np.where(np.arange(6) < 2, 1000.0, arm.limits.speed)
    fast = "shoulder_pan_joint, shoulder_lift_joint may turn"
    with pytest.warns(InputWarning, match=rf"{fast} with up to 5.73e\+04 deg/s, which no real joint does"):
        doubt_speeds(arm.with_limits(speed=speeds))
