"""Excitation motions: verified, periodic, and they tell all base parameters."""

import numpy as np
import pytest

from ocptip.cli.main import main
from ocptip.measured.excitation import excite
from ocptip.measured.links import identify_links
from ocptip.measured.prediction import Predictor
from ocptip.motion.check import check_motion
from ocptip.task_files.motion import load_task
from tests.measured.test_links import recorded
from tests.places import ROOT

UR5 = ROOT / "src/ocptip/examples/tasks/ur5_cart.toml"


@pytest.fixture(scope="module")
def found():
    return excite(load_task(UR5), steps=8)


def test_it_stands_and_ends_where_it_began(found):
    task = load_task(UR5)
    assert check_motion(task.robot, found.motion, task.limits, step=0.02).verified
    np.testing.assert_allclose(found.motion.goal, found.motion.start, atol=1e-12)
    np.testing.assert_allclose(found.motion.start, task.start, atol=1e-12)
    q, qd, qdd = found.motion.states(np.array([0.0, 1.2345, found.motion.end]))
    assert np.abs(qd[[0, 2]]).max() < 1e-9
    step = 1e-4
    near = found.motion.states(np.array([1.2345 - step, 1.2345 + step]))
    np.testing.assert_allclose((near[0][1] - near[0][0]) / (2 * step), qd[1], atol=1e-5)
    np.testing.assert_allclose((near[1][1] - near[1][0]) / (2 * step), qdd[1], atol=1e-4)
    assert q.shape == (3, 6)


def test_it_is_better_conditioned_than_random_motions(found):
    assert found.condition < 0.1 * found.random


@pytest.mark.slow
def test_it_tells_all_base_parameters(found):
    predictor = Predictor(load_task(UR5).robot, found.motion)
    assert identify_links(recorded(predictor, 0), predictor).estimate.seen.all()


@pytest.mark.slow
def test_the_command_writes_a_motion_that_check_reads(found, tmp_path, capsys):
    out = tmp_path / "excite.csv"
    assert main(["identify", "motion", str(UR5), "--out", str(out)]) == 0
    assert "CHECKED at samples" in capsys.readouterr().out
    assert main(["check", str(out), "--task", str(UR5), "--tolerance", "none"]) == 0
