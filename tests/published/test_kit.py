"""Arms of the modular kit that were never built."""

from itertools import product

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.numerics.inertia import union
from ocptip.published.arms import arm_by_name, arm_names, codes, described, load_arm, published_data
from ocptip.task_files.tables.arm import arm_of_file
from tests.robots.pinocchio_twin import twin
from tests.robots.test_dynamics import TOLERANCE, worst_difference

ARMS = published_data("arms")["arms"]


def test_names_are_four_connections():
    assert codes("W1P1P2W2") == ("W1", "P1", "P2", "W2")
    assert codes("FSF") == codes("FPW2F") == codes("FSFSF") == codes("") == ()


@pytest.mark.parametrize("name", arm_names())
def test_the_arms_that_were_built_come_out_of_their_own_connections(name):
    found = described(name, ARMS)
    axes = (np.array(one["A0"])[:, :, 2] for one in (found, ARMS[name]))  # zero angles may be others
    np.testing.assert_array_equal(*axes)
    for key in ("r_QQ", "r_QM_own", "r_QA", "r_QK2", "r_QK1", "m_A_g", "m_K2_g", "m_K1_g"):
        np.testing.assert_array_equal(found[key], ARMS[name][key], err_msg=key)
    for key in ("theta_M2_gmm2", "theta_M1_gmm2"):
        np.testing.assert_array_equal(found[key], ARMS[name][key], err_msg=key)


def test_every_sequence_is_an_arm_or_refused_in_one_line():
    refused = []
    for name in map("".join, product(("F", "S", "P1", "P2", "W1", "W2"), repeat=4)):
        try:
            described(name, ARMS)
        except InputError as error:
            refused.append((name, str(error)))
    assert 6**4 - len(refused) == 26 * 7  # two connections of 90 mm modules, two with the 70 mm module
    assert all(name in said and "\n" not in said for name, said in refused)


@pytest.mark.parametrize("name", ["P2W2P1W1", "FSW1F", "W2FFS"])
def test_axes_stand_as_their_letters_say(name):
    arm = load_arm(name)
    for code, turn, way in zip(codes(name), arm.rotations[1:], arm.offsets, strict=False):
        axis = turn[:, 2]
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) > 0
        if code[0] == "P":
            np.testing.assert_allclose(axis, [0, 0, -1 if code == "P1" else 1], atol=1e-12)
        elif code[0] == "W":  # skew and square; W1 and W2 on either side
            np.testing.assert_allclose(axis, [0, 1, 0], atol=1e-12)
            assert np.sign(way[0]) == (1 if code == "W1" else -1)
        else:  # axes that meet
            assert abs(np.cross([0, 0, 1], axis) @ way) < 1e-12


def test_mirrored_and_turned_links_weigh_and_spin_the_same():
    built, other = load_arm("W1P1P2W2"), load_arm("W2P2P1W1")
    np.testing.assert_array_equal(built.masses, other.masses)
    principal = np.linalg.eigvalsh(built.inertias), np.linalg.eigvalsh(other.inertias)
    np.testing.assert_allclose(*principal, atol=1e-15)
    np.testing.assert_allclose(other.centres[0], built.centres[0] * [-1, 1, 1], atol=1e-15)


def test_their_dynamics_are_those_of_pinocchio():
    arm = load_arm("P2W2P1W1")
    assert worst_difference(arm, twin(arm), seed=1) < TOLERANCE


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("FSFP1", "no adapter for F between modules 3 and 4; there are F before S, P1, P2, W1, W2"),
        ("SFP2W2", "no adapter for S between modules 1 and 2"),
        ("FP1W2W2", "module 4 would have to be turned round"),
        ("FPW2F", "other sequences of four connections F, S, P1, P2, W1, W2"),
    ],
)
def test_what_the_kit_does_not_have_is_refused(name, said):
    with pytest.raises(InputError, match=said):
        load_arm(name)


def test_rate_knows_them():
    assert arm_by_name("w1 fp2 w1").name == "W1FP2W1"


PARTS = """
[arm]
name = "W1FP2W1"
mount_position = [0, 0, 0.1]
[[arm.links."joint 2".part]]
mass = 3.0
position = [0.0, 0.1, 0.0]
rpy_deg = [0, 0, 90]
center_of_mass = [0.02, 0, 0]
inertia = [0.01, 0.02, 0.025]
[[arm.links."joint 2".part]]
mass = 1.0
position = [0.0, 0.3, 0.05]
"""


def test_links_are_made_of_parts(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(PARTS)
    arm = arm_of_file(path)
    first = 3.0, np.array([0, 0.12, 0]), np.diag([0.02, 0.01, 0.025])
    mass, centre, inertia = union(first, (1.0, np.array([0, 0.3, 0.05]), np.zeros((3, 3))))
    assert arm.masses[1] == pytest.approx(mass)
    np.testing.assert_allclose(arm.centres[1], centre, atol=1e-15)
    np.testing.assert_allclose(arm.inertias[1], inertia, atol=1e-15)
    np.testing.assert_array_equal(arm.masses[2:], load_arm("W1FP2W1").masses[2:])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("mass = 3.0", "mass = 0.0", r"part\[1\]\.mass: must be > 0"),
        ("inertia = [0.01, 0.02, 0.025]", "inertia = [0.01, 0.02, 0.1]", "inertia: no body"),
        ("position = [0.0, 0.3, 0.05]", "where = [0.0, 0.3, 0.05]", "where"),
        (
            '[[arm.links."joint 2".part]]\nmass = 3.0',
            '[arm.links."joint 2"]\nmass = 2.0\n[[arm.links."joint 2".part]]\nmass = 3.0',
            "follows from the parts",
        ),
    ],
)
def test_parts_that_cannot_be_are_refused(tmp_path, old, new, said):
    path = tmp_path / "arm.toml"
    path.write_text(PARTS.replace(old, new))
    with pytest.raises(InputError, match=said):
        arm_of_file(path)
