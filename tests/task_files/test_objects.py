"""Tables [[object]]: what they say, what is refused, and what `ocptip.stand` answers about them."""

import re
from functools import cache

import numpy as np
import pytest

import ocptip
from ocptip.basics.errors import InputError
from ocptip.cli.verify.stand import StandReport
from ocptip.robots.base_motion import BaseMotion
from ocptip.task_files.motion import load_task
from ocptip.trajectories.ramps import RampCommand
from tests.places import EXAMPLES

UR5 = EXAMPLES / "tasks" / "ur5_cart.toml"
LEVEL = {
    "0.50, 0.90], rpy_deg = [180, 0, 0]": "0.50, 0.95], rpy_deg = [0, 0, 0]",
    "rpy_deg = [180, 0, -90]": "rpy_deg = [0, 0, -90]",
    'urdf = "ur5.urdf"': f'urdf = "{EXAMPLES / "tasks" / "ur5.urdf"}"',
}
TRAY = """
[[object]]
name = "plate"
mass = 0.5
friction = 0.4
box = [0.16, 0.16, 0.03]
position = [0.0, 0.0, 0.02]

[[object]]
name = "cup"
on = "plate"
mass = 0.2
friction = 0.3
cylinder = [0.03, 0.08]

[[object]]
name = "crate"
on = "base"
mass = 3.0
friction = 0.5
inertia = [0.1, 0.1, 0.05]
center_of_mass = [0.0, 0.0, 0.3]
contacts = [[0.1, 0.1, 0.0], [-0.1, 0.1, 0.0], [-0.1, -0.1, 0.0], [0.1, -0.1, 0.0]]
"""


def written(folder, objects=TRAY):
    text = UR5.read_text()
    for old, new in LEVEL.items():
        assert old in text
        text = text.replace(old, new)
    path = folder / "task.toml"
    path.write_text(text + objects)
    return path


@pytest.fixture(scope="module")
def task(tmp_path_factory):
    return load_task(written(tmp_path_factory.mktemp("objects")), ocptip.Uncertainty(friction=0.2, tilt=0.01))


def test_objects_of_a_file_load_the_arm_and_the_base(task):
    robot = task.robot
    assert [own.name for own in robot.interfaces] == ["base", "plate", "cup", "crate"]
    assert robot.payload.mass == pytest.approx(0.7)
    assert robot.support.mass == pytest.approx(38.0)
    np.testing.assert_allclose(robot.interfaces[2].support.center_of_mass, [0, 0, 0.02 + 0.03 + 0.04])
    assert any("collisions are not checked" in note for note in robot.notes)


def test_stand_gives_margins_of_each_interface_and_names_the_critical_one(task):
    found = ocptip.stand(task, "start")
    assert found.stable
    data = found.to_dict()
    assert list(data["objects"]) == ["plate", "cup", "crate"]
    assert data["critical"] == "base"
    weight = 9.81 * 0.7 * 0.08  # of plate and cup, half an edge from the nearest edge
    assert data["objects"]["plate"]["tipping_axis"]["moment_reserve"] == pytest.approx(weight, rel=1e-6)
    # Tilted by 0.01 rad, the height of both centres of mass over the plate's contacts counts.
    high = 9.81 * (0.5 * 0.015 + 0.2 * 0.07) * np.sin(0.01)
    within = found.objects[0].within
    reference = found.objects[0].tip.tip_over.reference_moment
    assert within.tipping_margin(reference) == pytest.approx(weight * np.cos(0.01) - high, rel=1e-4)
    np.testing.assert_allclose(within.GT, np.tan(0.01) / (0.8 * 0.4), rtol=1e-3)
    text = StandReport(found).to_text()
    assert re.search(r"^cup +\S+ N m", text, re.MULTILINE)
    assert "<- critical" in text


def test_an_object_that_slides_in_a_tilted_gripper_makes_the_answer_no(task):
    q = task.start.copy()
    q[3] += 0.5  # the tray leans by 29 degrees; friction holds 22
    found = ocptip.stand(task, q)
    assert not found.stable
    assert found.stable_itself
    assert [own.stable_itself for own in found.objects] == [False, False, True]
    assert "BUT plate, cup ARE NOT STABLE" in StandReport(found).headline


@pytest.mark.slow
def test_on_a_base_that_drives_objects_feel_it_and_their_uncertainty_is_not_checked(task):
    uncertain, braking = ocptip.Uncertainty(friction=0.2), BaseMotion((2.0, 0.0, 0.0))
    found = ocptip.stand(task.robot, task.start, uncertainty=uncertain, base_motion=braking)
    assert found.objects[2].slip.GT[0] == pytest.approx(2.0 / (0.5 * 9.81), rel=1e-6)
    assert "OBJECTS IN THE NOMINAL MODEL ONLY" in StandReport(found).headline
    assert found.within  # of the base only, so that the nominal model decides what is critical
    every = (found, *found.objects)
    assert found.critical is max(every, key=lambda own: max(own.tip.GN[0], own.slip.GT[0]))


@pytest.mark.slow
def test_the_headline_says_which_objects_are_unstable_nominally(task):
    uncertain, braking = ocptip.Uncertainty(friction=0.5), BaseMotion((5.0, 0.0, 0.0))
    found = ocptip.stand(task.robot, task.start, uncertainty=uncertain, base_motion=braking)
    nominal = [own.scene.name for own in found.objects if not own.nominally_stable]
    assert "crate" in nominal  # friction 0.5 holds 4.9 m/s^2
    assert found.nominally_stable
    assert not found.stable_itself
    headline = StandReport(found).headline
    assert f"AND {', '.join(nominal)} " in headline
    assert "NOT STABLE AT ALL" in headline
    assert re.search(r"^base .*NOT STABLE, worst case", StandReport(found).to_text(), re.MULTILINE)


def test_cups_have_the_data_of_their_makers(tmp_path):
    cups = "".join(
        f"[[object.cup]]\nposition = [{x}, 0.0, 0.0]\nradius = 0.02\n{what}\n"
        for x, what in ((0.05, "vacuum = 60e3"), (-0.05, "force = 50.0"))
    )
    robot = load_task(written(tmp_path, TRAY[: TRAY.index("[[object]]", 20)] + cups)).robot
    forces = [contact.clamp_force for contact in robot.interfaces[1].support.contacts]
    assert len(forces) == 8
    assert sum(forces) == pytest.approx(50 + 60e3 * np.pi * 0.02**2)
    with pytest.raises(InputError, match=r"object\[1\].cup\[1\].*force"):
        load_task(written(tmp_path, TRAY[: TRAY.index("[[object]]", 20)] + "[[object.cup]]\nradius = 0.02\n"))


@pytest.mark.parametrize(
    ("what", "call"),
    [
        ("chart", ocptip.chart),
        ("payload", lambda task: ocptip.drive(task, payload=1.0)),
        ("posture stow", lambda task: ocptip.drive(task, "stow")),
    ],
)
def test_what_takes_no_objects_says_so(what, call, task):
    with pytest.raises(InputError, match=rf"object: {what} does not take objects \(plate, cup, crate\)"):
        call(task)


@cache
def swing(start, goal):
    return ocptip.Trajectory.from_profiles(start, [(RampCommand(end, 1.0, 1.0),) for end in goal])


def test_what_takes_a_motion_but_no_objects_says_so(task):
    motion = swing(tuple(task.start), tuple(task.goal))
    for call in (
        lambda: ocptip.plan(task, sensitivities=True),
        lambda: ocptip.check(task, motion, design=True),
    ):
        with pytest.raises(InputError, match=r"object: .* does not take objects"):
            call()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('on = "plate"', 'on = "plat"', r"object: object 'cup': on: expected gripper, .* got 'plat'"),
        ("cylinder = [0.03, 0.08]", "", r"object\[2\].*inertia: missing"),
        (
            "cylinder = [0.03, 0.08]",
            "cylinder = [0.03, -1]",
            r"object\[2\].cylinder: radius and height must be > 0",
        ),
        ("mass = 3.0", "mass = -3.0", r"object\[3\].mass: "),
        ("friction = 0.4", "", r"object\[1\].*friction: missing"),
        (
            "position = [0.0, 0.0, 0.02]",
            "position = [0.0, -1e9, 0.02]",
            r"object\[1\].position: at most 1000 m",
        ),
        ('name = "cup"', 'name = "plate"', "the name occurs 2 times"),
    ],
)
def test_mistakes_name_their_table(old, new, message, tmp_path):
    assert old in TRAY
    with pytest.raises(InputError, match=message):
        load_task(written(tmp_path, TRAY.replace(old, new, 1)))
