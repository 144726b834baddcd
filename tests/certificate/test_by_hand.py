"""The interval that docs/explanation/proof-by-hand.md works by hand."""

import numpy as np
import pytest

from ocptip.certificate.trusted.described import Checker, Intervals
from ocptip.certificate.trusted.forms import linear
from ocptip.certificate.trusted.sharing import Sharing

BASE, MASS, G = 3.0, 2.0, 9.81


def _model():
    """A mass on a slide along x at a height of 0.5 m; feet at x = 0 (two) and x = 0.4 m."""
    along_x = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]  # z of the slide is x of the base
    return {
        "arm": {
            "rotations": [along_x],
            "offsets": [[0.0] * 3],
            "masses": [MASS],
            "centres": [[0.0] * 3],
            "inertias": [np.zeros((3, 3)).tolist()],
            "slides": [1.0],
            "armature": [0.0],
            "ratios": [[1.0]],
            "shift": [0.0],
            "mount_position": [0.2, 0.0, 0.5],
            "mount_rotation": np.eye(3).tolist(),
        },
        "payload": None,
        "base": {
            "mass": BASE,
            "center_of_mass": [0.1, 0.0, 0.0],
            "gravity": [0.0, 0.0, -G],
            "reference_moment": 0.49,
        },
        "contacts": {
            "positions": [[0.0, 0.3, 0.0], [0.0, -0.3, 0.0], [0.4, 0.0, 0.0]],
            "frames": [[[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]] * 3,
            "sets": [[[0.0, None, 0.0, 0.5]]] * 3,
        },
        "limits": {
            "angle_min": [None],
            "angle_max": [None],
            "speed": [1.0],
            "acceleration": [6.0],
            "torque": [100.0],
        },
        "bodies": [],
        "pairs": [],
    }


def test_the_moment_about_the_rear_line():
    motion = {"times": [[0.0, 0.02]], "angles": [[[3e-4, 6e-4, 3e-4]]]}
    at = Intervals(motion, np.array([0]), np.array([-1.0]), np.array([1.0]))
    np.testing.assert_allclose(at.qdd.c[0], 6.0, rtol=1e-12)
    for bound, kept in ((0.3612, True), (0.3610, False)):
        checker = Checker(_model(), {"GN": bound, "GT": 0.9, "torque_ratio": 1.0})
        wrench = checker.loads(at).wrench
        moments = checker.contacts.axes @ wrench.c[:3, :, 0].T
        rear = np.argmin(np.abs(moments[:, 0] - 0.872886))
        np.testing.assert_allclose(moments[rear], [0.872886, 0.011772, 0.005886], atol=1e-12)
        np.testing.assert_array_less(wrench.r, 1e-10)
        low, high = linear(checker.contacts.axes, wrench).range
        assert low[rear, 0] == pytest.approx(0.867, abs=1e-11)
        assert high[rear, 0] == pytest.approx(0.890544, abs=1e-11)
        forces = np.zeros((2, 1, 3, 3, 1))
        margins = checker.margins(at, checker.loads(at), forces, lambda i, p: np.empty((0, 3)))
        assert (margins["tip-over"][0] >= 0) == kept
        assert margins["contacts"][0] == -np.inf  # no forces were named


def test_the_same_moment_within_a_tolerance():
    none = dict.fromkeys(
        ("friction", "payload_mass", "delay", "overshoot", "extra_mass", "push", "base_push"), 0.0
    )
    boxes = {key: [0.0] * 3 for key in ("center_of_mass", "payload_center")}
    own = {"base_mass": [-0.05, 0.05], "arm_mass": 0.05, "speed": 0.03, "tilt": 0.01}
    motion = {"times": [[0.0, 0.0], [0.0, 0.02], [0.02, 0.02]]}
    motion["angles"] = [[[0.0, 0.0, 0.0]], [[3e-4, 6e-4, 3e-4]], [[1.2e-3, 0.0, 0.0]]]
    sharing = Sharing(_model(), motion, none | boxes | own, {"GN_worst_case": 0.8, "GT_worst_case": 0.9})
    [rows] = sharing.late.rows(np.array([0.0]), np.array([0.02]))
    least = sharing.moments(sharing.terms(rows))
    b_g, b_x_g = (2.85 * 0.1 + 2.1 * 0.2) * G, 2.1 * 0.5 * G
    assert b_g * np.cos(0.01) - b_x_g * np.sin(0.01) == pytest.approx(6.8127, abs=1e-4)
    assert pytest.approx(6.6837, abs=1e-4) == 2.1 * 0.5 * 6 * 1.03**2
    np.testing.assert_allclose(least, 0.1290, atol=1e-4)
    assert 0.49 / (0.49 + least[0]) == pytest.approx(0.7916, abs=2e-4)
