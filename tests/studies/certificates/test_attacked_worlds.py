"""The attack on proofs: its margins against the slip optimum, what it finds and what it does not let pass."""

import copy
import json
from dataclasses import replace

import numpy as np
import pytest

from ocptip.certificate.describe import model_data
from ocptip.certificate.find import certify
from ocptip.motion.check import check_motion
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import Uncertainty
from studies.certificates import worlds as study
from studies.certificates.margins import ContactMargins
from studies.certificates.new_motions import feet as ordinary
from studies.certificates.new_motions import on_base, swing
from tests.quick import some

pytestmark = pytest.mark.slow

PUSHED = Uncertainty(center_of_mass=(0.02, 0.02, 0.1), base_push=40.0, base_mass=0.05)


@pytest.fixture(scope="module")
def proved():
    places = [(0.3, 0.25, 0.0), (0.3, -0.25, 0.0), (-0.3, 0.0, 0.0)]
    task = on_base("B", ordinary(places, 0.8), 40.0, [0.0, 0.0, 0.4])
    near = replace(task, goal=np.append(task.goal[:2], task.start[2:]))  # two joints move: few intervals
    motion, limits = swing(near), Limits(tolerance=PUSHED, clearance=0.0)
    found = certify(task.robot, motion, limits, check_motion(task.robot, motion, limits).worst)
    assert found.certified, found.undecided
    return task.robot, motion, found.data


def test_contact_margins_are_zero_at_the_slip_optimum(proved):
    robot, motion, _ = proved
    margins = ContactMargins(model_data(robot), 1.0)
    wrenches = robot.loads(*motion.states(np.linspace(0.05, motion.end - 0.05, 5)))[1]
    states = robot.contact_states(wrenches)
    GT = robot.slip.evaluate(states, derivatives=False).GT
    own = np.sort(wrenches @ margins.axes.T + margins.added, axis=1)
    slope, offset = robot.tip_over.affine_moments
    assert np.allclose(own, np.sort(wrenches @ slope.T + offset, axis=1))
    for wrench, share in zip(wrenches, GT, strict=True):
        assert margins.inside(wrench, share)[0] == pytest.approx(0.0, abs=1e-6)
        assert margins.inside(wrench, 0.9 * share)[0] < -1e-6


def test_no_world_is_worse_than_proved_and_the_attack_comes_near(proved):
    attack = study.Attack(proved[2], 300, 1)
    row = attack.run() | {"weight": attack.weight}
    assert study.holds(row)
    assert row["moment_found"] <= row["moment_sampled"]
    assert row["moment_found"] - row["moment_proved"] < 0.1 * row["moment_proved"]
    assert 0.9 * row["GT_proved"] < row["GT_found"] <= row["GT_proved"]


@pytest.mark.parametrize("key", some(1, ["base_push", "center_of_mass"]))
def test_a_wider_uncertainty_than_the_proof_is_found(proved, key):
    data = copy.deepcopy(proved[2])
    data["tolerance"][key] = (1.5 * np.array(data["tolerance"][key])).tolist()
    attack = study.Attack(data, 300, 1)
    assert not study.holds(attack.run() | {"weight": attack.weight})


def test_late_joints_are_where_the_motion_has_them(proved):
    _, motion, data = proved
    late = study.LateMotion(data["motion"], data["tolerance"] | {"delay": 0.01, "overshoot": 0.85})
    rng = np.random.default_rng(0)
    drawn = late.draw(400, rng)
    for own in (drawn, late.moved(drawn, 0.5, rng)):
        assert np.all((own.late >= 0) & (own.late <= late.delay))
        at = late.events[np.maximum(own.event, 0)]
        reach = own.times[:, None] - at
        assert np.all((own.event < 0) | ((reach >= -1e-12) & (reach <= late.delay + 1e-12)))
        q, qd, _ = late.states(own)
        T = np.where(own.event >= 0, at, np.clip(own.times[:, None] - own.late, 0, motion.end))
        for joint in range(late.n):
            expected = motion.states(T[:, joint])
            assert np.allclose(q[:, joint], expected[0][:, joint], atol=1e-6)
            assert np.allclose(qd[:, joint], expected[1][:, joint], atol=1e-4)


@pytest.mark.slow
def test_finished_rows_and_certificates_are_kept(tmp_path, monkeypatch, proved, capsys):
    robot, motion, _ = proved
    monkeypatch.setattr(study, "committed", lambda: iter([("one", robot, motion, PUSHED)]))
    monkeypatch.setattr(study, "new_motions", lambda: iter([]))
    asked = ["--out", str(tmp_path), "--worlds", "200"]
    assert study.main(asked) == 0
    assert "1 proofs attacked; worlds worse than proved: none." in capsys.readouterr().out
    before = json.loads((tmp_path / "attacked_worlds.json").read_text())
    monkeypatch.setattr(study, "proved", None)  # nobody calls it
    assert study.main(asked) == 0
    assert json.loads((tmp_path / "attacked_worlds.json").read_text()) == before
    assert study.main([*asked, "--seed", "2"]) == 0
    assert len(json.loads((tmp_path / "attacked_worlds.json").read_text())["rows"]) == 2
