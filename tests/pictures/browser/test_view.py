"""Pages in three dimensions: small, whole, made quickly, and shown by a browser."""

import json
import re
import subprocess
import time
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from ocptip.api.view import view
from ocptip.basics.errors import OcptipError
from ocptip.cli.main import main
from ocptip.motion.files.plan_files import write_plan
from ocptip.parallel.analysis.workspace import workspace
from ocptip.pictures.browser import closed_chains
from ocptip.pictures.browser.bodies import HEAD, LINK
from ocptip.pictures.browser.view import motion_show, pose_show, to_html
from ocptip.pictures.scene_picture import margin_texts
from ocptip.placement.output import result_to_dict, write_placement
from ocptip.placement.place import place
from ocptip.published.tasks import experiment_task
from ocptip.robots.kinematics import gripper_pose, link_frames
from ocptip.robots.payload import Payload
from ocptip.standing.objects import Object
from ocptip.standing.parts import Part
from ocptip.task_files.motion import load_task
from ocptip.task_files.placement import load_placement
from ocptip.trajectories.trajectory import Trajectory
from studies.pictures.browser import CHROMIUM, browser_page
from tests.pictures.plan_stand_in import plan_of
from tests.places import EXAMPLES, ROOT

pytest.importorskip("viser")
ADDRESS = re.compile(r"""(?:src|href)\s*=\s*["']?(?:https?:)?//|fetch\(\s*["']https?://""")


def committed(case):
    """Robot and verified motion of a published case."""
    path = ROOT / f"studies/results/plans/{case}-effective/plan.json"
    return experiment_task(case).robot, Trajectory.from_dict(json.loads(path.read_text()))


def parts(case):
    return [Part(*committed(case))]


def swing(task):
    """One ramp per joint, which only has to be drawn."""
    limits = task.robot.limits
    none = [None] * task.robot.n
    return Trajectory.ending_together(
        task.start, task.goal, none, 0.8 * limits.speed, 0.4 * limits.acceleration
    )


@pytest.fixture(scope="module")
def page():
    return to_html(motion_show("A", parts("A")))


def test_page_is_small_and_whole(page):
    assert len(page.encode()) < 3_000_000
    assert not ADDRESS.search(page)
    assert "__VISER_EMBED_DATA__" in page


@pytest.mark.slow
def test_page_of_an_arm_with_solids_is_made_quickly():
    task = load_task(EXAMPLES / "tasks/ur5_cart.toml")
    motion = swing(task)
    task.robot.samples(motion, np.zeros(1))  # kernels are there
    began = time.process_time()
    found = to_html(motion_show("UR5", [Part(task.robot, motion)]))
    assert time.process_time() - began < 5.0
    assert len(found.encode()) < 3_000_000


class Node:
    """Records what is put on stage."""

    def __init__(self, name="", **given):
        self.__dict__.update(given, name=name)


class Recorder:
    """Takes the place of viser's server and scene."""

    def __init__(self):
        self.scene, self.nodes = self, {}

    def __getattr__(self, kind):
        def add(name, *values, **given):
            self.nodes[name] = Node(name, kind=kind, values=values, **given)
            return self.nodes[name]

        return add


def test_what_is_on_stage_is_what_the_check_says():
    robot, motion = committed("A")
    show, stage = motion_show("A", [Part(robot, motion)]), Recorder()
    frame = show.stage(stage)
    for k in (0, len(show.times) // 2, len(show.times) - 1):
        frame(k)
        seen = robot.samples(motion, show.times[k : k + 1])
        slip = seen.slip
        local = np.column_stack([slip.normal_forces[0], slip.tangential_forces[0]])
        forces = np.einsum("kij,kj->ki", robot.support.frames, local)
        ends = stage.nodes["/contact forces"].points
        arrows = np.array(ends[:, 1] - ends[:, 0], dtype=float)
        lengths, most = np.linalg.norm(arrows, axis=1), np.linalg.norm(forces, axis=1)
        share = most / most.max()
        shown = share * lengths.max() > HEAD * show.size + 1e-4  # of others there would be the head alone
        assert np.allclose(arrows[shown] / lengths.max(), forces[shown] / most.max(), atol=1e-3)
        assert np.allclose(arrows[~shown], arrows[np.argmax(most)])
        pair = robot.tip_over.axes[seen.tip.nearest_axis[0]].contacts
        places = np.array([robot.support.contacts[c].position for c in pair])
        assert np.allclose(stage.nodes["/nearest tipping axis"].points[0], places, atol=1e-6)
        normal = slip.normal_forces[0]
        centre = normal @ np.array([c.position for c in robot.support.contacts]) / normal.sum()
        assert np.allclose(stage.nodes["/zero-moment point"].position, centre)
        assert ", ".join(margin_texts(seen.tip, slip, 0)) in stage.nodes["/clock"].text
    tip = np.array(stage.nodes["/arm/6"].position)
    assert np.linalg.norm(tip) < robot.arm.reach
    cone = stage.nodes["/friction cones/1"].values[0]
    assert np.allclose(np.hypot(*cone[1:, :2].T), 0.2 * cone[1:, 2])  # friction


def test_the_panel_has_the_margins_and_follows_the_player(page):
    robot, motion = committed("A")
    show = motion_show("A", [Part(robot, motion)])
    panel, seen = show.panel, robot.samples(motion, show.times)
    assert panel.moments == pytest.approx(seen.tip.moments.min(axis=1))
    assert panel.forces.sum(axis=1) == pytest.approx(-seen.wrenches[:, 2])
    assert panel.worst == np.argmin(panel.moments)
    assert panel.stable.all()
    assert "STABLE" in panel.text(0)
    assert f"tipping margin <b>{panel.moments[5]:.3g} N m</b>" in panel.text(5)
    assert page.index("ocptip-panel") < page.rindex("</body>")
    lost = replace(panel, stable=~panel.stable)
    assert "A CONTACT IS LOST" in lost.html(0)


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium")
def test_the_player_jumps_to_the_minimum_margin(page, tmp_path):
    (tmp_path / "a.html").write_text(page, encoding="utf-8")
    panel = motion_show("A", parts("A")).panel
    time_shown = "Number(document.querySelector('[role=slider]')?.getAttribute('aria-valuenow') || 0)"
    with browser_page((tmp_path / "a.html").as_uri()) as shown:
        shown.wait_for(f"{time_shown} > 0")
        shown.run("document.querySelector('.ocptip-worst').click()")
        shown.wait_for(f"Math.abs({time_shown} - {panel.times[panel.worst]}) < 0.02")
        shown.wait_for(f"document.body.innerText.includes('{panel.moments[panel.worst]:.3g} N m')")
        assert not shown.errors


def test_a_cycle_is_one_show_with_what_each_segment_holds():
    robot, motion = committed("A")
    laden = robot.varied(arm=robot.arm.with_payload(Payload(0.3)))
    back = Part(robot, motion, "back", motion.end + 0.5)
    show = motion_show("A", [Part(laden, motion, "carry", 0.0, 0.5), back])
    stage = Recorder()
    frame = show.stage(stage)
    assert show.times[-1] == pytest.approx(2 * motion.end + 0.5)
    for at, own, local, name in (
        (0.5 * motion.end, laden, 0.5 * motion.end, "carry"),
        (motion.end + 0.25, laden, motion.end, "carry"),  # at rest, still laden
        (1.5 * motion.end + 0.5, robot, 0.5 * motion.end, "back"),
    ):
        k = int(np.abs(show.times - at).argmin())
        frame(k)
        local += show.times[k] - at if local < motion.end else 0.0
        tip = own.samples(motion, np.array([local])).tip
        assert f"A, {name}  tipping margin {tip.moments[0].min():.3g} N m" in stage.nodes["/clock"].text
        assert stage.nodes["/arm/6/payload 1"].visible == (own is laden)


def test_a_second_motion_is_a_ghost_with_a_clock_of_its_own():
    robot, motion = committed("A")
    slow = motion.time_scaled(1.5)
    show, stage = motion_show("A", [Part(robot, motion)], ("slow", [Part(robot, slow)])), Recorder()
    frame = show.stage(stage)
    assert show.times[-1] == pytest.approx(slow.end)
    k = int(np.abs(show.times - 0.6 * motion.end).argmin())
    frame(k)
    time = show.times[k : k + 1]
    for own, root, clock in ((motion, "", "/clock"), (slow, "/second", "/clock of the second")):
        seen = robot.samples(own, time)
        gripper = link_frames(robot.arm, seen.angles).origins[0, 5]
        assert np.allclose(stage.nodes[f"{root}/arm/6"].position, gripper)
        assert ", ".join(margin_texts(seen.tip, seen.slip, 0)) in stage.nodes[clock].text
    frame(len(show.times) - 1)  # the first has been at rest for a while
    still = robot.samples(motion, np.array([motion.end])).tip.moments[0].min()
    assert f"tipping margin {still:.3g} N m, friction used " in stage.nodes["/clock"].text


@pytest.mark.slow
def test_a_second_base_stands_where_it_is(tmp_path, capsys):
    """Two plans of `ocptip cell`: their files say where in the world each base stands."""
    task = experiment_task("A")
    places = {"one": ([1.0, 2.0, 0.0], [0.0, 0.0, 90.0]), "two": ([1.0, 3.0, 0.1], [0.0, 0.0, 180.0])}
    for name, (position, turn) in places.items():
        (tmp_path / name).mkdir()
        rotation = Rotation.from_euler("xyz", turn, degrees=True).as_matrix().tolist()
        base = {"base": {"position": position, "rotation": rotation}}
        (tmp_path / name / "cell.json").write_text(json.dumps({"places": [{"placement": base}]}))
        write_plan(tmp_path / name / "plan", plan_of(task, task.reference))
    show = view(tmp_path / "one/plan", tmp_path / "two/plan").show
    stage = Recorder()
    show.stage(stage)(0)
    second = stage.nodes["/second"]
    assert np.allclose(second.position, [1.0, 0.0, 0.1])  # its y is the first one's x
    assert np.allclose(Rotation.from_quat(np.roll(second.wxyz, -1)).as_rotvec(), [0, 0, np.pi / 2])
    assert any(name.startswith("/second/base") for name in stage.nodes)
    (tmp_path / "two/cell.json").write_text("{}")
    folders = [str(tmp_path / name / "plan") for name in places]
    assert main(["view", *folders, "--html", str(tmp_path / "c.html")]) == 2
    assert "cell.json: is not what `ocptip cell` wrote" in capsys.readouterr().err


def test_payload_base_and_solids_are_there():
    task = load_task(EXAMPLES / "tasks/ur5_cart.toml")
    stage = Recorder()
    robot = task.robot.varied(arm=task.robot.arm.with_payload(Payload(2.0)))
    pose_show("UR5", robot, task.start).stage(stage)(0)
    assert any("/payload" in name for name in stage.nodes)
    assert any(name.startswith("/base") for name in stage.nodes)
    arm = [node for name, node in stage.nodes.items() if name.startswith("/arm")]
    assert sum(node.kind != "add_frame" for node in arm) > 5


def test_objects_are_where_they_stand_and_the_ball_is_of_the_payload_alone():
    task = load_task(EXAMPLES / "tasks/ur5_cart.toml")
    up = {"rotation": np.diag([1.0, -1.0, -1.0]), "position": (0.1, 0.0, -0.05)}
    on_gripper = Object.box("low", 0.5, (0.1, 0.06, 0.03), friction=0.2, **up)
    top = Object.cylinder("top", 0.1, (0.03, 0.04), friction=0.5, on="low")
    crate = Object.box("crate", 2.0, (0.2, 0.1, 0.3), friction=0.5, on="base", position=(-0.1, 0.0, 0.5))
    robot, stage = task.robot.carrying([on_gripper, top, crate]), Recorder()
    pose_show("UR5", robot, task.start).stage(stage)(0)
    assert not any("/payload" in name for name in stage.nodes)
    links = robot.arm.links
    last, (tcp, turn) = stage.nodes[f"/arm/{links}"], gripper_pose(robot.arm, task.start)
    for name, height, root in (
        ("low", 0.03, f"/arm/{links}"),
        ("top", 0.04, f"/arm/{links}"),
        ("crate", 0.3, "/arm"),
    ):
        vertices = stage.nodes[f"{root}/object 0.{name}"].values[0].astype(float)
        if root != "/arm":
            frame = np.roll(np.array(last.wxyz), -1)
            vertices = vertices @ Rotation.from_quat(frame).as_matrix().T + last.position
            vertices = (vertices - tcp) @ turn @ up["rotation"]  # object axes, z up
        assert np.ptp(vertices, axis=0)[2] == pytest.approx(height, abs=1e-6)
    arm, low, _, box = robot.sticks(task.start)
    np.testing.assert_allclose(arm[-1], tcp)
    assert low.min(axis=0)[2] == pytest.approx(tcp[2] + 0.05, abs=1e-6)
    np.testing.assert_allclose(box[0], box[-1])
    np.testing.assert_allclose([box.min(axis=0), box.max(axis=0)], [[-0.2, -0.05, 0.5], [0.0, 0.05, 0.8]])


@pytest.mark.slow
def test_view_of_a_plan_folder(tmp_path, capsys):
    task = experiment_task("A")
    write_plan(tmp_path / "A", plan_of(task, task.reference))
    assert main(["view", str(tmp_path / "A"), "--html", str(tmp_path / "a.html")]) == 0
    assert capsys.readouterr().out.startswith("A: ")
    assert (tmp_path / "a.html").stat().st_size < 3_000_000


def test_view_of_two_plans(tmp_path, capsys):
    task = experiment_task("A")
    for name, factor in (("one", 1.0), ("two", 1.2)):
        write_plan(tmp_path / name, plan_of(task, task.reference.time_scaled(factor)))
    folders = [str(tmp_path / "one"), str(tmp_path / "two")]
    assert main(["view", *folders, "--html", str(tmp_path / "b.html"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["bytes"] < 3_000_000
    scene = str(EXAMPLES / "scenes/rover_on_slope.toml")
    assert main(["view", scene, folders[0], "--html", str(tmp_path / "c.html")]) == 2
    assert "is shown alone" in capsys.readouterr().err


def test_view_of_a_scene(tmp_path, capsys):
    scene = EXAMPLES / "scenes/rover_on_slope.toml"
    assert main(["view", str(scene), "--html", str(tmp_path / "s.html"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 1


@pytest.mark.slow
def test_view_of_a_placement(tmp_path, capsys):
    path = EXAMPLES / "tasks/place_incline.toml"
    result = place(load_placement(path).problem, starts=1, samples=100)
    write_placement(tmp_path, result_to_dict("incline", result))
    assert main(["view", str(tmp_path), "--task", str(path), "--html", str(tmp_path / "p.html")]) == 0
    assert (tmp_path / "p.html").is_file()
    assert main(["view", str(tmp_path), "--html", str(tmp_path / "p.html")]) == 2
    assert "name its task file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere.toml"], "nowhere.toml"),
        (["scenes/rover_on_slope.toml", "--task", "x.toml"], "--task: belongs to the folder of a placement"),
        (["scenes/rover_on_slope.toml", "--html", "no/such/place.html"], "--html: no such directory"),
    ],
)
def test_refusals(arguments, said, capsys, monkeypatch):
    monkeypatch.chdir(EXAMPLES)
    assert main(["view", *arguments]) == 2
    assert said in capsys.readouterr().err


def test_without_viser(capsys, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "viser", None)
    assert main(["view", str(EXAMPLES / "scenes/rover_on_slope.toml")]) == 2
    assert "pip install 'ocptip[view]'" in capsys.readouterr().err


def test_planar_scenes_are_drawn_elsewhere(tmp_path, capsys):
    feet = "".join(
        f'[[contact]]\nkind = "unilateral"\nposition = [{x}, 0]\nfriction = 0.5\n' for x in (-0.3, 0.3)
    )
    path = tmp_path / "plane.toml"
    path.write_text(f"[base]\nmass = 20\ncenter_of_mass = [0, 0.4]\n{feet}")
    assert main(["view", str(path), "--html", str(tmp_path / "p.html")]) == 2
    assert "ocptip stand --plot draws it" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium")
def test_browser_shows_the_page(page, tmp_path):
    """Without any network; the robot is there, and the console has no error."""
    path, picture = tmp_path / "a.html", tmp_path / "a.png"
    path.write_text(page, encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    options += ["--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={tmp_path / 'profile'}"]
    options += ["--enable-logging=stderr", "--v=0", "--window-size=1000,700", "--virtual-time-budget=6000"]
    done = subprocess.run(
        [CHROMIUM, *options, f"--screenshot={picture}", path.as_uri()],
        capture_output=True, text=True, timeout=300, check=True,
    )  # fmt: skip
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    assert any("Embedded data loaded" in line for line in console)
    assert not [line for line in console if "ERROR:CONSOLE" in line or "Uncaught" in line]
    pixels = np.asarray(Image.open(picture).convert("RGB")).astype(int)[:640, 320:]
    shown = pixels[(pixels[:, :, 2] > pixels[:, :, 0] + 40) & (pixels[:, :, 2] > 60)]
    assert len(shown) > 1000  # links are blue
    assert LINK[2] > LINK[0]
    assert pixels.std() > 10


@pytest.mark.slow
def test_a_closed_chain_in_its_workspace(tmp_path):
    """Dots of the edge part poses that the joints reach from others; the page has legs and dots."""
    task = load_task(EXAMPLES / "tasks/delta_cart.toml")
    robot = task.robot
    names, q = robot.names, task.start
    found = workspace(
        robot.robot, {name: (at - 0.9, at + 0.9) for name, at in zip(names, q, strict=True)}, cells=12
    )
    faces = closed_chains.boundary(found)
    dots = closed_chains.middles(found, faces, np.zeros(3))
    step = found.values[0][1] - found.values[0][0]
    for dot, axis in list(zip(dots, faces[:, 0], strict=True))[:: len(dots) // 12]:
        sides = [dot + sign * 0.5 * step * np.eye(3)[axis] for sign in (-1, 1)]
        assert sorted(reached(robot.robot, side) for side in sides) == [False, True]
    signs = closed_chains.sign_changes(found)
    for axis, *cell in signs.tolist():
        other = np.array(cell) + np.eye(3, dtype=int)[axis]
        assert found.dexterity[tuple(cell)] * found.dexterity[tuple(other)] < 0
    assert len(signs)
    folder = tmp_path / "delta"
    write_plan(folder, plan_of(task, swing(task)))
    page = tmp_path / "delta.html"
    assert main(["view", str(folder), "--html", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    assert "red dots" in text
    assert len(text) < 3e6
    assert not ADDRESS.search(text)


def reached(robot, z):
    try:
        robot.kinematics.joints(z)
    except OcptipError:
        return False
    return True
