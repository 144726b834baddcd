"""The studio of closed chains: its answers, and its page in process and in a browser where there is one."""

import time

import numpy as np
import pytest

import ocptip
from ocptip.basics.errors import InputError
from ocptip.cli.main import main
from ocptip.parallel.robot import ParallelRobot
from ocptip.task_files.parallel import read_robot
from studies.pictures.browser import CHROMIUM, browser_page
from tests.places import EXAMPLES

pytest.importorskip("viser")
from ocptip.pictures.browser.bodies import LINK
from ocptip.pictures.browser.chain_studio import _ORANGE, _RED, chain_page

DELTA = EXAMPLES / "tasks/delta_cart.toml"
PLANAR = EXAMPLES / "robots/planar_3rrr.toml"


@pytest.fixture(scope="module")
def delta():
    return ocptip.studio(DELTA)


@pytest.fixture
def page(delta):
    poses = delta._poses
    with chain_page(delta.robot, delta.standing, poses.ends, poses.actions("nowhere")) as found:
        assert found.idle.wait(60)
        yield found


def ranged(low, high, folder):
    """A planar robot whose first joint of the second leg has a range."""
    text = PLANAR.read_text(encoding="utf-8")
    row = text.index('joint = "revolute"')
    end = text.index("}", row) if "{" in text[:row].splitlines()[-1] else text.index("\n", row)
    path = folder / "robot.toml"
    path.write_text(f"{text[:end]}, range = [{low}, {high}] {text[end:]}", encoding="utf-8")
    return ParallelRobot(read_robot(str(path)))


def test_answers_are_those_of_the_robot(delta):
    z = np.array([0.05, -0.1, -0.52])
    found = delta.answer(z)
    joints = delta.robot.ik(z).q
    assert np.allclose(found.motors, [joints[leg][0] for leg in range(3)])
    assert found.singularity.platform == pytest.approx(delta.robot.singularity(z).platform)
    assert not found.beyond
    assert "smallest singular value" in repr(found)
    with pytest.raises(InputError, match="reach"):
        delta.answer([0.0, 0.0, -3.0])
    with pytest.raises(InputError, match="z"):
        delta.answer([0.0, 0.0])


def test_joints_beyond_their_range_are_named(tmp_path):
    free = ParallelRobot(read_robot(str(PLANAR)))
    home = float(free.ik(free.description.home).q[0][0])
    robot = ranged(home - 0.5, home + 0.1, tmp_path)
    found = ocptip.studio(robot).answer()
    first = found.joints[0]
    assert first.left == pytest.approx(0.1 / 0.3)
    assert not found.beyond
    beyond = ocptip.studio(ranged(home + 0.2, home + 0.5, tmp_path)).answer()
    assert beyond.joints[0].left == pytest.approx(-0.2 / 0.15)
    assert any("leg 1 joint 1" in text for text in beyond.beyond)


@pytest.mark.parametrize(("ahead", "color"), [(1.0, LINK), (0.02, _ORANGE), (-0.2, _RED)])
def test_a_leg_near_its_limit_has_another_colour(tmp_path, ahead, color):
    free = ParallelRobot(read_robot(str(PLANAR)))
    home = float(free.ik(free.description.home).q[0][0])
    robot = ranged(home - 2.0, home + ahead, tmp_path)
    with chain_page(robot, None, {"start": robot.description.home}, None) as page:
        assert page.idle.wait(60)
        assert tuple(np.asarray(page._nodes[0].colors).tolist()) == color
        assert ("OUT OF RANGE" in page.verdict.content) == (ahead < 0)


def test_the_page_shows_margins_at_rest(delta, page):
    z = np.array([0.1, 0.05, -0.45])
    page.set_posture(z)
    assert page.idle.wait(60)
    assert np.allclose(page.answered.z, z)
    expected = ocptip.stand(delta.standing, z, uncertainty="none")
    assert f"{expected.nearest_axis['moment_reserve']:.3g} N m" in page.verdict.content
    page.sliders["q2"].value = page.sliders["q2"].max
    assert page.idle.wait(60)
    assert "tipping margin" in page.verdict.content


@pytest.mark.slow
def test_poses_are_kept(delta, tmp_path):
    poses = ocptip.studio(DELTA)._poses
    goal = poses.task.goal + 0.01
    poses.keep("goal", goal)
    found = ocptip.load_task(poses.save(tmp_path / "here"))
    assert np.allclose(found.goal, goal)
    assert np.allclose(found.start, poses.task.start)


def test_a_workspace_is_drawn(page):
    page.workspace()
    names = list(page.server.scene._handle_from_node_name)
    assert "/closed chain/workspace" in names
    assert "/closed chain/singular poses" in names
    assert not page.message.content


def test_refusals(capsys):
    assert main(["studio", "no-such-robot.toml"]) == 2
    assert "no-such-robot" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium")
def test_a_person_moves_the_platform(page):
    with browser_page(f"http://localhost:{page.server.get_port()}") as shown:
        shown.wait_for("document.body.innerText.includes('conditioning')")
        before = shown.text()
        shown.enter("x [m]", 0.1)
        shown.wait_for(f"document.body.innerText !== {before!r}")
        deadline = time.monotonic() + 60
        while page.answered.z[0] != pytest.approx(0.1) and time.monotonic() < deadline:
            time.sleep(0.1)
        assert page.answered.z[0] == pytest.approx(0.1)
        assert not shown.errors
