"""The assembled arms against the printed numbers."""

import json
from importlib.resources import files

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.published.arms import arm_names, assemble_links, experiment_poses, load_arm

ARMS = json.loads((files("ocptip.published") / "data" / "arms.json").read_text(encoding="utf-8"))["arms"]


def test_names():
    assert arm_names() == ("FP1W2F", "FSFS", "W1P1P2W2")


@pytest.mark.parametrize("name", arm_names())
def test_centres_of_mass_are_the_printed_ones(name):
    links = assemble_links(name)
    off = np.abs(links.centres * 1e3 - ARMS[name]["r_QS_printed"])
    assert off.max() < 0.21  # mm
    assert name != "FSFS" or off.max() == pytest.approx(0.2055, abs=5e-5)  # the others stay below 0.2
    assert np.median(off) < 0.05


def test_masses_of_the_industrial_arm():
    # Module, adapter, cables; link 3 with a second cable, link 4 with the wrist's first part.
    expected = [
        3409 + 160 + 250,
        3409 + 356 + 250,
        3409 + 106 + 250 + 250,
        1833 + 62 + 283,
        1502 + 125 + 57,
        0,
    ]
    np.testing.assert_allclose(assemble_links("FP1W2F").masses, np.array(expected) / 1000)


@pytest.mark.parametrize("name", arm_names())
def test_inertias_are_symmetric_and_keep_the_split_rotor(name):
    inertias = assemble_links(name).inertias
    np.testing.assert_allclose(inertias, inertias.transpose(0, 2, 1), atol=1e-18)
    assert np.linalg.eigvalsh(inertias).min() < 0


def test_steiner_terms_of_a_link_by_hand():
    # Link 5 of FSFS: the wrist's second part and two cables.
    parts = [(1.502, [0, 10.5, 0]), (0.125, [0, 48.3, -95.0]), (0.057, [0, 48.3, 65.0])]
    mass = sum(m for m, _ in parts)
    centre = sum(m * np.array(p) for m, p in parts) / mass
    inertia = np.diag([3318.0, 1946.0, 2331.0]) * 1e-6
    for m, p in parts:
        x, y, z = (np.array(p) - centre) * 1e-3
        tensor = [
            [y * y + z * z, -x * y, -x * z],
            [-x * y, x * x + z * z, -y * z],
            [-x * z, -y * z, x * x + y * y],
        ]
        inertia += m * np.array(tensor)
    np.testing.assert_allclose(assemble_links("FSFS").inertias[4], inertia, atol=1e-12)


def test_limits_are_si_and_hold_the_exception():
    limits = load_arm("FP1W2F").limits
    np.testing.assert_allclose(np.rad2deg(limits.angle_max), [160, 160, 137, 160, 100, 1080])
    np.testing.assert_allclose(np.rad2deg(limits.angle_min), [-160, -160, -160, -160, -100, -1080])
    np.testing.assert_allclose(np.rad2deg(limits.speed), [150, 150, 150, 135, 216, 340])
    np.testing.assert_allclose(limits.torque, [50, 50, 50, 19, 8, 2])
    np.testing.assert_allclose(np.rad2deg(load_arm("FSFS").limits.angle_max[2]), 160)


def test_poses():
    start, goal = experiment_poses()
    np.testing.assert_allclose(start.position, [0, -0.3, 0.12])
    np.testing.assert_allclose(
        goal.rotation[:, 2], [0, np.sin(np.deg2rad(70)), -np.cos(np.deg2rad(70))], atol=1e-12
    )


def test_printed_geometry_differs_by_half_a_tenth_of_a_millimetre():
    gap = load_arm("FP1W2F").offsets - load_arm("FP1W2F", geometry="printed").offsets
    np.testing.assert_allclose(np.abs(gap).sum(), 5e-5)
    np.testing.assert_array_equal(load_arm("FSFS").offsets, load_arm("FSFS", geometry="printed").offsets)


def test_unknown_names_list_the_known():
    with pytest.raises(
        InputError, match=r"no arm 'FPW2F'; there are FP1W2F, FSFS, W1P1P2W2 and .*; did you mean 'FP1W2F'\?"
    ):
        load_arm("FPW2F")
    with pytest.raises(InputError, match="geometry: must be 'refined' or 'printed', got 'exact'"):
        load_arm("FSFS", geometry="exact")
