"""Arms and loads that look odd and are meant: links and payloads without mass, joints held by 0 to 0."""

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.robots.urdf.arm import arm_from_urdf
from ocptip.task_files.motion import load_task
from tests.task_files.test_arm_files import ON_A_LIFT, SHORT

TABLE = """
[base]
mass = 60
center_of_mass = [0, 0, 0.2]
feet = [[0.4, 0.3, 0], [0.4, -0.3, 0], [-0.4, -0.3, 0], [-0.4, 0.3, 0]]
friction = 0.6
[arm]
dh = "standard"
mount_position = [0, 0, 0.5]
ACCEPTED
[[arm.joint]]
name = "turn"
d = 0.3
alpha_deg = -90
mass = 0
[[arm.joint]]
name = "lower"
a = 0.5
mass = 4
[arm.limits]
speed_deg_s = 90
torque_Nm = 100
[motors]
kind = "estimated"
[motion]
start_deg = [0, 0]
goal_deg = [40, 30]
"""
HELD = SHORT.replace("lift.urdf", "held.urdf")


def read(folder, text):
    path = folder / "task.toml"
    path.write_text(text, encoding="utf-8")
    return load_task(path)


@pytest.mark.parametrize("accepted", ["accept_inertia = true", 'accept_inertia = ["turn"]'])
def test_links_of_tables_may_have_no_mass(tmp_path, accepted):
    task = read(tmp_path, TABLE.replace("ACCEPTED", accepted))
    assert task.robot.arm.masses.tolist() == [0.0, 4.0]
    still = np.zeros((1, 2))
    torques, wrench = task.robot.loads(np.array([[0.3, 0.0]]), still, still)
    assert torques[0] == pytest.approx([0.0, -4 * 9.81 * 0.5], abs=0.02)  # the mass is at the end of the link
    assert wrench[0, 2] == pytest.approx(-64 * 9.81, rel=1e-3)


@pytest.mark.parametrize(
    ("accepted", "message"),
    [
        ("", r'joint\[1\]\.mass: must be > 0, got 0; if that is meant: accept_inertia = \["turn"\]'),
        ('accept_inertia = ["lower"]', r"joint\[1\]\.mass: must be > 0"),
        ('accept_inertia = ["trn", "turn"]', r"arm\.accept_inertia: no joint 'trn'; .* did you mean 'turn'"),
        ("accept_inertia = 3", r"arm\.accept_inertia: expected true or a list of links"),
    ],
)
def test_other_links_without_mass_are_refused(tmp_path, accepted, message):
    with pytest.raises(InputError, match=message):
        read(tmp_path, TABLE.replace("ACCEPTED", accepted))


def test_a_payload_of_nothing_is_none(tmp_path):
    text = TABLE.replace("ACCEPTED", "accept_inertia = true")
    assert read(tmp_path, text + "[payload]\nmass = 0\ncenter_of_mass = [0, 0, 0.1]\n").robot.payload is None
    with pytest.raises(InputError, match=r"payload\.centre: unknown key"):
        read(tmp_path, text + "[payload]\nmass = 0\ncentre = [0, 0, 0.1]\n")
    with pytest.raises(InputError, match=r"payload\.mass: must be >= 0"):
        read(tmp_path, text + "[payload]\nmass = -1\n")


def held(tmp_path, limits, *, velocity=2):
    """The arm on a lift whose first turning joint has limits of 0 to 0."""
    odd = f'<limit lower="0" upper="0" velocity="{velocity}" effort="80"/>'
    ordinary = '<limit lower="-3" upper="3" velocity="2" effort="80"/>'
    assert ordinary in ON_A_LIFT
    (tmp_path / "held.urdf").write_text(ON_A_LIFT.replace(ordinary, odd), encoding="utf-8")
    return HELD.replace("[motion]", f"[arm.limits]\n{limits}\n[motion]")


def test_a_joint_held_by_its_limits_is_freed_by_others(tmp_path):
    both = "angle_min_deg = { turn_1 = -90 }\nangle_max_deg = { turn_1 = 120 }"
    arm = read(tmp_path, held(tmp_path, both)).robot.arm
    k = arm.joint_names.index("turn_1")
    assert np.rad2deg([arm.limits.angle_min[k], arm.limits.angle_max[k]]) == pytest.approx([-90, 120])
    same = arm_from_urdf(tmp_path / "held.urdf", joint_ranges={"turn_1": (-1.0, 1.0)})
    assert same.joint_names == arm.joint_names
    locked = arm_from_urdf(tmp_path / "held.urdf")
    assert "turn_1" not in locked.joint_names
    assert any("others in [arm.limits], by name, free them" in note for note in locked.notes)


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (
            "angle_min_deg = { turn_1 = 9 }\nangle_max_deg = { turn_1 = 9 }",
            r"arm\.limits: turn_1: angle_min_deg 9 must be below",
        ),
        ("angle_min_deg = { turn_1 = -90 }", r"angle_min_deg\.turn_1: no such joint"),
    ],
)
def test_limits_that_free_nothing_are_refused(tmp_path, limits, message):
    with pytest.raises(InputError, match=message):
        read(tmp_path, held(tmp_path, limits))
