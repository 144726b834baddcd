"""Files that can be read but are hardly meant: one warning each; and files for another command."""

import re
import shutil
import warnings
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from ocptip.basics.errors import InputError, InputWarning
from ocptip.task_files.motion import load_task
from ocptip.task_files.parallel import read_parallel_robot
from ocptip.task_files.placement import load_placement
from ocptip.task_files.platform_points import read_platform
from ocptip.task_files.scene import read_scene
from ocptip.task_files.template import task_template
from tests.places import EXAMPLES
from tests.quick import some

TASKS = EXAMPLES / "tasks"
CART, DELTA, WALL = TASKS / "ur5_cart.toml", TASKS / "delta_cart.toml", TASKS / "place_ur5_wall.toml"
ROVER = EXAMPLES / "scenes" / "rover_on_slope.toml"
START = re.compile(r"start_pose = .*\ngoal_pose = .*")


def changed(tmp_path, source, *pairs, more=""):
    """A copy of an example with some texts replaced (each there once), the arm's file beside it."""
    text = source.read_text(encoding="utf-8")
    for old, new in pairs:
        found = re.findall(old, text)
        assert len(found) == 1, (old, found)
        text = re.sub(old, new, text)
    shutil.copy(TASKS / "ur5.urdf", tmp_path)
    path = tmp_path / source.name
    path.write_text(text + more, encoding="utf-8")
    return path


ELBOW = "-90, 80, -80, -90, 0]"
SAME = (START.pattern, f"start_deg = [20, {ELBOW}\ngoal_deg = [20, {ELBOW}")
RADIANS = "-1.6, 1.4, -1.4, -1.57, 0.0]"
ANGLES = (START.pattern, f"start_deg = [0.5, {RADIANS}\ngoal_deg = [-0.5, {RADIANS}")
HALF_TURN = "\nangle_min_deg = -6.28\nangle_max_deg = 6.28"
LIMITS = ("acceleration_deg_s2 = 800.0", f"acceleration_deg_s2 = 800.0{HALF_TURN}")
FAR = (r"mount_position = \[0.0, 0.0, 0.75\]", "mount_position = [0.0, 0.0, 75]")
TOOL = (r"rpy_deg = \[0, 90, 0\]", "rpy_deg = [0, 1.5708, 0]")
WHEEL = (r"position = \[0.40, 0.33, 0.0\]", "position = [80, 66, 0.0]")
IN_MM = (r"position = \[0.40, 0.33, 0.0\]", "position = [400, 330, 0.0]")
LIGHT, HEAVY = ("mass = 35.0", "mass = 4.0"), ("mass = 1.0 ", "mass = 7.0 ")


@pytest.mark.parametrize(
    ("read", "source", "change", "said"),
    [
        (load_task, CART, ANGLES, "motion.start_deg, motion.goal_deg: no angle is above 1.6 degrees"),
        (load_task, CART, SAME, "motion: start and goal are the same"),
        (load_task, CART, LIGHT, "base.mass: 4 kg is less than a quarter of the arm's 16.99 kg"),
        (load_task, DELTA, HEAVY, "base.mass: 6 kg is less than the payload's 7 kg"),
        (
            load_placement,
            WALL,
            TOOL,
            r"task\[1\].rpy_deg: no angle is above 1.571 degrees; are they radians\?",
        ),
        (read_scene, ROVER, WHEEL, r"contact\[1\].position: 80 m is far"),
    ],
)
def test_what_is_hardly_meant_is_warned_of(tmp_path, read, source, change, said):
    path = changed(tmp_path, source, change)
    with pytest.warns(InputWarning, match=said) as found:
        read(path)
    assert len(found) == 1
    assert str(found[0].message).startswith(f"{source.name}: ")


def test_feet_in_millimetres_are_refused(tmp_path):
    path = changed(tmp_path, ROVER, IN_MM)
    with pytest.raises(
        InputError, match=r"contact\[1\].position: 400 m is too far for a robot; .* not in mm"
    ):
        read_scene(path)


@pytest.mark.parametrize(
    ("change", "doubted", "refused"),
    [
        (FAR, "75 m is far", "cannot reach"),
        (LIMITS, "arm.limits.angle_min_deg, arm.limits.angle_max_deg: no angle", "only beyond joint limits"),
    ],
)
def test_a_wrong_unit_is_told_where_it_makes_the_file_impossible(tmp_path, change, doubted, refused):
    path = changed(tmp_path, CART, change)
    with pytest.warns(InputWarning, match=doubted), pytest.raises(InputError, match=refused):
        load_task(path)


def test_a_clamped_base_may_be_light(tmp_path):
    payload = "\n[payload]\nmass = 7.0\n"  # the base has 6.582 kg, and a clamp
    path = changed(tmp_path, TASKS / "place_incline.toml", more=payload)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert load_placement(path).problem.robot.masses["payload"] == 7.0


PAYLOAD = """
[payload]
mass = 2.5
center_of_mass = [0.0, 0.01, 0.08]
"""


def test_a_payload_in_a_file(tmp_path):
    box = load_task(changed(tmp_path, CART, more=PAYLOAD + "box = [0.1, 0.2, 0.3]\n")).robot
    assert box.masses["payload"] == 2.5
    np.testing.assert_allclose(np.diag(box.payload.inertia), 2.5 / 12 * np.array([0.13, 0.10, 0.05]))
    np.testing.assert_array_equal(box.payload.center_of_mass, [0, 0.01, 0.08])
    six = PAYLOAD + "inertia = [0.1, 0.01, 0.02, 0.2, 0.03, 0.25]\n"
    matrix = PAYLOAD + "inertia = [[0.1, 0.01, 0.02], [0.01, 0.2, 0.03], [0.02, 0.03, 0.25]]\n"
    held = [load_placement(changed(tmp_path, WALL, more=m)).problem.robot.payload for m in (six, matrix)]
    np.testing.assert_array_equal(held[0].inertia, held[1].inertia)
    assert load_task(changed(tmp_path, CART, more=PAYLOAD)).robot.payload.is_point


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("[payload]\n", "payload.mass: missing"),
        ("[payload]\nmass = -1\n", "payload.mass: must be >= 0, got -1"),
        ("[payload]\nmas = 1\n", "payload.mas: unknown key; did you mean 'mass'"),
        ("[payload]\nmass = 1\nbox = [1, 1]\n", "payload.box: expected 3 numbers, got 2"),
        ("[payload]\nmass = 1\nbox = [1, 1, -1]\n", "payload.box: dimensions must be > 0"),
        (
            "[payload]\nmass = 1\nbox = [1, 1, 1]\ninertia = [1, 1, 1]\n",
            "expected either inertia or box, got",
        ),
        ("[payload]\nmass = 1\ninertia = [1, 1]\n", "payload.inertia: expected shape 3 x 3"),
        ("[payload]\nmass = 1\ninertia = [1, 1, 3]\n", "payload.inertia: no body has these"),
        ("[payload]\nmass = 1\ncenter_of_mass = [0, 0]\n", "payload.center_of_mass: expected 3 numbers"),
        ("payload = 1\n", "unknown key"),
    ],
)
def test_a_payload_that_cannot_be_is_refused(tmp_path, more, said):
    for source, read in ((CART, load_task), (DELTA, load_task), (WALL, load_placement)):
        text = re.sub(r"\[payload\][^\[]*", "", source.read_text(encoding="utf-8"))
        path = changed(tmp_path, source)
        path.write_text(text + "\n" + more, encoding="utf-8")
        with pytest.raises(InputError, match=said):
            read(path)


def test_accepted_inertia_in_a_file(tmp_path):
    key = (r'tool_frame = "tool0"', 'tool_frame = "tool0"\naccept_inertia = ')
    path = changed(tmp_path, CART, (key[0], key[1] + '["forearm_link"]'))
    urdf = tmp_path / "ur5.urdf"
    urdf.write_text(urdf.read_text(encoding="utf-8").replace('mass value="2.275"', 'mass value="0"'))
    load_task(path)
    with pytest.raises(InputError, match=r"arm\.urdf: link 'forearm_link': moves, but has no mass"):
        load_task(path.with_name(changed_back(path)))
    for bad in ("1", '["forearm"]'):
        with pytest.raises(InputError, match=r"arm\.accept_inertia"):
            load_task(changed(tmp_path, CART, (key[0], key[1] + bad)))


def changed_back(path) -> str:
    text = re.sub(r"accept_inertia = .*\n", "\n", path.read_text(encoding="utf-8"))
    path.with_name("back.toml").write_text(text, encoding="utf-8")
    return "back.toml"


@pytest.mark.parametrize(
    ("read", "path", "said"),
    [
        (read_scene, CART, r"is a motion task \(ocptip plan\), not a scene"),
        (read_scene, WALL, r"is a placement task \(ocptip place\), not a scene"),
        (load_task, ROVER, r"is a scene \(ocptip stand\), not a motion task"),
        (load_task, WALL, r"is a placement task \(ocptip place\), not a motion task"),
        (load_placement, DELTA, r"is a motion task \(ocptip plan\), not a placement task"),
        (load_placement, ROVER, r"is a scene \(ocptip stand\), not a placement task"),
        (
            read_parallel_robot,
            EXAMPLES / "platforms" / "flight_simulator.toml",
            r"is a platform \(ocptip rate\)",
        ),
        (read_platform, EXAMPLES / "robots" / "planar_3rrr.toml", r"is a parallel robot \(ocptip parallel\)"),
    ],
)
def test_a_file_for_another_command_says_which(read, path, said):
    with pytest.raises(InputError, match=rf"^{path.name}: {said}"):
        read(path)


def test_a_scene_may_have_a_name(tmp_path):
    assert read_scene(ROVER).name == "rover_on_slope.toml"
    path = tmp_path / "rover.toml"
    path.write_text('name = "rover"\n' + ROVER.read_text(encoding="utf-8"), encoding="utf-8")
    assert read_scene(path).name == "rover"


def heavy(tmp_path):
    """The UR5 on a chassis of 95 kg, both in one URDF; its links that rest have 95 kg."""
    tree = ET.parse(TASKS / "ur5.urdf")
    root = tree.getroot()
    chassis = ET.fromstring(
        '<link name="chassis"><inertial><mass value="95"/>'
        '<inertia ixx="9" ixy="0" ixz="0" iyy="9" iyz="0" izz="9"/></inertial></link>'
    )
    first = root.find("./joint/parent").get("link")
    names = {joint.find("child").get("link") for joint in root.iter("joint")}
    (top,) = {link.get("name") for link in root.iter("link")} - names
    assert first is not None
    root.append(chassis)
    root.append(
        ET.fromstring(
            f'<joint name="bolts" type="fixed"><parent link="chassis"/><child link="{top}"/></joint>'
        )
    )
    tree.write(tmp_path / "ur5.urdf")
    masses = {link.get("name"): float(link.find("inertial/mass").get("value")) for link in root.iter("link")
              if link.find("inertial/mass") is not None}  # fmt: skip
    return sum(masses.values())


@pytest.mark.parametrize(("load", "source"), some(1, [(load_task, CART), (load_placement, WALL)]))
def test_a_base_lighter_than_the_links_that_are_part_of_it_is_refused(tmp_path, load, source):
    path = changed(tmp_path, source)
    heavy(tmp_path)
    with pytest.raises(InputError, match=r"base\.mass: 35 kg is less than the 95 kg of those links") as error:
        load(path)
    assert "accept_mass = true" in str(error.value)
    assert "these links alone have mass = 95, center_of_mass = [" in str(error.value)
    text = path.read_text()
    path.write_text(re.sub(r"mass = 35\.0", "mass = 94.5", text, count=1))  # two digits
    load(path)
    path.write_text(text.replace("[base]", "[base]\naccept_mass = true", 1))
    load(path)


def test_marks_of_init_taken_away_leave_a_base_that_weighs_what_its_links_do(tmp_path):
    total = heavy(tmp_path)
    template = task_template(tmp_path / "ur5.urdf", tmp_path, base_link="base_link", tool_frame="tool0")
    resting = total - template.arm.masses.sum()
    assert template.arm.base_mass == pytest.approx(resting)
    assert resting == pytest.approx(95.0)
    path = tmp_path / "task.toml"
    path.write_text(template.text.replace("#> ", ""))
    assert load_task(path).robot.support.mass >= resting
    path.write_text(re.sub(r"mass = 95\b", "mass = 80.0", path.read_text()))
    with pytest.raises(InputError, match=r"base\.mass: 80 kg is less than the 95 kg"):
        load_task(path)
