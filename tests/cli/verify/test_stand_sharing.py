"""What `stand` reports where rigid feet share a load in several ways: equal compliance, the best sharing."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from ocptip.cli.main import main
from ocptip.task_files.scene import read_scene
from tests.reserves.test_mixed_friction import least_use

_WHEELS, _FRICTION = [(0.0013, 0.18738), (0.0013, -0.18738)], 0.6
_PLACES = np.array(_WHEELS + [(x, y) for x in (0.168, -0.212) for y in (0.118, -0.118)])
_LOADS = """
[[load]]
force = [20.0, 5.0, 0.0]
point = [0.3, 0.1, 0.8]
[[load]]
moment = [0.0, 0.0, 4.0]
"""


def _scene(tmp_path, base="", loads=_LOADS, friction=(_FRICTION, 0.0)):
    """Two drive wheels amid four casters."""
    rows = [
        f"[[contact]]\nposition = [{x}, {y}, 0.0]\nfriction = {friction[0] if k < 2 else friction[1]}\n"
        for k, (x, y) in enumerate(_PLACES)
    ]
    path = tmp_path / "scene.toml"
    start = f"[base]\nmass = 122.3\ncenter_of_mass = [-0.03, 0.0, 0.35]\n{base}\n"
    path.write_text(start + "".join(rows) + loads)
    return path


def _stand(capsys, path):
    code = main(["stand", str(path), "--json"])
    data = json.loads(capsys.readouterr().out)
    main(["stand", str(path)])
    headline, below = capsys.readouterr().out.split("\n", 1)
    return code, data, headline + "\n" + " ".join(below.split())


def _equal_springs(wrench):
    """Normal forces of least squares in balance, and the least use of the wheels' friction with them.

    Wheels share the tangential load but for forces along the line through both, of which there is one.
    """
    x, y = _PLACES.T - np.array([[-0.03], [0.0]])
    height = -0.35
    across = (
        wrench[3] + height * wrench[1],
        wrench[4] - height * wrench[0],
    )  # about the ground below the centre
    A = np.array([np.ones(6), y, -x])
    normal = np.linalg.pinv(A) @ -np.array([wrench[2], *across])
    B = np.array([[1, 0, 1, 0], [0, 1, 0, 1], [-y[0], x[0], -y[1], x[1]]])
    forces = np.linalg.pinv(B) @ -wrench[[0, 1, 5]]

    def use(z):
        shared = (forces + z * np.array([0, 1, 0, -1])).reshape(2, 2)
        return np.max(np.linalg.norm(shared, axis=1) / (_FRICTION * normal[:2]))

    return normal, minimize_scalar(use, bounds=(-200, 200), method="bounded", options={"xatol": 1e-9}).fun


def test_wheels_amid_casters(capsys, tmp_path):
    path = _scene(tmp_path)
    scene = read_scene(path)
    code, data, text = _stand(capsys, path)
    assert (code, data["persistent"], data["stability"]) == (1, False, "weak")
    assert data["GT"] == pytest.approx(least_use(scene.support, scene.wrench), abs=1e-6)
    normal, use = _equal_springs(scene.wrench)
    np.testing.assert_allclose(data["normal_forces"], normal, rtol=1e-9)
    assert data["equal_compliance"]["GT"] == pytest.approx(use, abs=1e-6)
    assert data["equal_compliance"]["lifts"] == []
    assert data["equal_compliance"]["stands"]
    assert max(data["friction_used"]) == pytest.approx(use, abs=1e-6)
    assert max(used or 0.0 for used in data["best_sharing"]["friction_used"]) == pytest.approx(
        data["GT"], abs=1e-6
    )
    assert "NOT SURE. Equally compliant feet are stable, rigid ones may move" in text.splitlines()[0]
    assert "in the solution that moves" in text


def test_declared_springs_decide_what_rigid_contacts_leave_open(capsys, tmp_path):
    path = _scene(tmp_path, "stiffness = 2e5")
    code, data, text = _stand(capsys, path)
    normal, use = _equal_springs(read_scene(path).wrench)
    assert (code, data["persistent"], data["stability"]) == (0, True, "weak")
    np.testing.assert_allclose(data["normal_forces"], normal, rtol=1e-9)
    assert data["GT"] == pytest.approx(use, abs=1e-6)
    assert data["equal_compliance"] is None
    assert "STABLE on its compliant feet" in text.splitlines()[0]


def test_declared_springs_that_slip_do_not_stand(capsys, tmp_path):
    """Wheels that carry a third of the weight hold less than all of it would."""
    loads = "[[load]]\nforce = [420.0, 0.0, 0.0]\npoint = [0.0, 0.0, 0.02]\n"
    path = _scene(tmp_path, "stiffness = 2e5", loads)
    scene = read_scene(path)
    assert least_use(scene.support, scene.wrench) < 1
    assert _equal_springs(scene.wrench)[1] > 1
    code, data, text = _stand(capsys, path)
    assert (code, data["persistent"]) == (1, False)
    assert data["GT"] > 1
    assert "NOT SURE" in text.splitlines()[0]
    rigid = _stand(capsys, _scene(tmp_path, "", loads))
    assert rigid[1]["GT"] < 1
    assert not rigid[1]["equal_compliance"]["stands"]
    headline = " ".join(rigid[2].split())
    assert "with equally compliant feet the friction is not enough (contact " in headline
    assert f" would need {100 * _equal_springs(scene.wrench)[1]:.0f} % of it)" in headline


def test_the_headline_says_that_an_equally_compliant_foot_lifts(capsys, tmp_path):
    loads = "[[load]]\nmoment = [0.0, 180.0, 0.0]\n"
    path = _scene(tmp_path, "", loads, (0.6, 0.6))
    code, data, text = _stand(capsys, path)
    normal, _ = _equal_springs(read_scene(path).wrench)
    assert normal.min() < 0
    assert data["stability"] == "strong"
    assert (code, data["persistent"]) == (0, True)
    lifted = [k + 1 for k in np.flatnonzero(normal < 0)]
    assert data["equal_compliance"]["lifts"] == lifted
    names = " and ".join(map(str, lifted))
    assert f"with equally compliant feet contacts {names} lift" in text.splitlines()[0]


def test_above_one_the_friction_needed_is_a_number_of_its_own(capsys, tmp_path):
    """240 N against 0.3 of the weight of 50 kg; the force acts low, so that nothing tips."""
    feet = "".join(
        f"[[contact]]\nposition = [{x}, {y}, 0]\nfriction = 0.3\n"
        for x, y in ((0.3, 0.2), (0.3, -0.2), (-0.3, 0))
    )
    path = tmp_path / "slides.toml"
    load = "[[load]]\nforce = [240, 0, 0]\npoint = [0, 0, 0.1]\n"
    path.write_text("[base]\nmass = 50\ncenter_of_mass = [0, 0, 0.3]\n" + feet + load)
    _, data, text = _stand(capsys, path)
    assert data["GT"] > 2.5
    assert data["GT"] == pytest.approx(data["slip_ratio"] + data["slide_acceleration_m_s2"])
    assert data["slide_acceleration_m_s2"] == pytest.approx(data["acceleration"][0])
    assert data["GN"] == data["tip_ratio"]
    assert data["lift_acceleration_m_s2"] == 0
    assert data["friction_needed"] == pytest.approx(240 / (0.3 * abs(data["wrench"][2])), abs=1e-6)
    assert data["friction_missing_N"] == pytest.approx(240 - 0.3 * abs(data["wrench"][2]), abs=1e-4)
    assert "Friction used 163 %: 92.8 N of tangential force are missing" in text
    path.write_text(path.read_text().replace("240", "24"))
    _, data, text = _stand(capsys, path)
    assert data["friction_needed"] == pytest.approx(data["GT"], abs=1e-7)
    assert "missing" not in text
    path.write_text(path.read_text().replace("friction = 0.3", "friction = 0"))
    assert _stand(capsys, path)[1]["friction_needed"] is None
