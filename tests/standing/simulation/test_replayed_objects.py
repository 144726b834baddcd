"""Objects that only contacts hold, as free bodies in MuJoCo: they stay within their margins."""

import json

import mujoco
import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.cli.main import main
from ocptip.motion.files.plan_files import write_plan
from ocptip.retiming.retime import retime
from ocptip.robots.payload import Payload
from ocptip.robots.simulators import SENSOR
from ocptip.standing.objects import Object, cup
from ocptip.standing.parts import Part
from ocptip.standing.simulation.mjcf import to_mjcf
from ocptip.standing.simulation.objects import predicted_objects
from ocptip.standing.simulation.replay import PrescribedModel, Simulator
from ocptip.standing.simulation.world import World
from ocptip.task_files.motion import load_task
from ocptip.task_files.path import load_path
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from tests.pictures.plan_stand_in import plan_of
from tests.places import EXAMPLES

TASK = load_task(EXAMPLES / "tasks" / "ur5_cart.toml")  # the gripper points down
UP = {"rotation": np.diag([1.0, -1.0, -1.0]), "position": (0.1, 0.0, -0.05)}  # z of the object is up
TALL = Object.box("tall", 0.5, (0.06, 0.06, 0.18), friction=0.9, **UP)
LOW = Object.box("low", 0.5, (0.1, 0.1, 0.03), friction=0.2, **UP)
TOP = Object.cylinder("top", 0.1, (0.03, 0.04), friction=0.5, on="low", position=(0.01, 0.0, 0.0))
HANGING = Object(
    name="hanging", mass=0.3, inertia=(1e-4, 1e-4, 1e-4), contacts=cup((0, 0, 0), 0.05, 6.0, 0.5),
    center_of_mass=(0.0, 0.0, 0.02), position=(0.1, 0.0, 0.02),
)  # fmt: skip
CRATE = Object.box("crate", 2.0, (0.2, 0.2, 0.3), friction=0.5, on="base", position=(-0.1, 0.0, 0.5))


def swing(acceleration: float) -> Trajectory:
    """The gripper swings about the vertical; the other joints rest."""
    rest = [(RampCommand(angle, 1.0, 1.0),) for angle in TASK.start[1:]]
    return Trajectory.from_profiles(TASK.start, [(RampCommand(0.5, 2.0, acceleration),), *rest])


def speed_at_limit(part: Part) -> float:
    """The factor on the speed of a motion up to which no object loses a contact."""
    kept, lost = 0.2, 3.0
    for _ in range(10):
        speed = np.sqrt(kept * lost)
        holds = all(predicted_objects([part.time_scaled(1 / speed)]).values())
        kept, lost = (speed, lost) if holds else (kept, speed)
    return kept


@pytest.mark.slow
@pytest.mark.parametrize(
    ("objects", "lifts"),
    [([TALL], True), ([LOW, TOP], False), ([HANGING], False)],
    ids=["tips", "slides", "cup"],
)
def test_objects_stay_within_their_margins_and_not_at_a_fifth_more_acceleration(objects, lifts):
    part = Part(TASK.robot.carrying(objects), swing(4.0))
    limit, simulator = speed_at_limit(part), Simulator([part])
    within, beyond = (simulator.run(World(speed=limit * np.sqrt(share))) for share in (0.95, 1.2))
    for moved in within.objects.values():
        assert moved.lift < 0.05e-3
        assert moved.slide < 0.5e-3
    assert within.stands
    assert not beyond.stands
    assert not beyond.falls
    first = beyond.objects[objects[0].name]
    assert first.lift > 0.05e-3 if lifts else first.slide > 0.5e-3


@pytest.mark.slow
def test_glasses_stay_on_a_tray_with_their_timing_and_not_with_that_of_the_robot_alone():
    task = load_task(EXAMPLES / "tasks" / "ur5_waiter.toml")
    path = load_path(EXAMPLES / "paths" / "ur5_waiter.toml", task).paths[0].path
    for timed, kept in ((task.robot, True), (task.robot.varied(objects=()), False)):
        found = retime(timed, path, task.limits)
        assert found.check.verified
        part = Part(task.robot, found.motion)
        assert set(predicted_objects([part]).values()) == {kept}
        assert {own.stays for own in Simulator([part]).run().objects.values()} == {kept}


def test_keyframes_have_objects_in_their_places_as_fast_as_what_carries_them():
    robot = TASK.robot.carrying([TOP, LOW, HANGING, CRATE])
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot, swing(4.0)))
    assert model.body_mass.sum() == pytest.approx(robot.mass)
    data = mujoco.MjData(model)
    feet = [
        k
        for k in range(model.ngeom)
        if model.geom(k).name.startswith("object ") and "foot" in model.geom(k).name
    ]
    assert len(feet) == 4 + 8 + 8 + 4
    for key in range(0, model.nkey, 4):
        mujoco.mj_resetDataKeyframe(model, data, key)
        mujoco.mj_forward(model, data)
        for k in feet:
            foot, floor = (model.geom(k).name.replace("foot", what) for what in ("foot", "ground"))
            np.testing.assert_allclose(data.sensor(f"{foot}_place").data, [0, 0, -SENSOR], atol=1e-9)
            jacobians = np.zeros((2, 3, model.nv))
            point = data.site(floor).xpos
            for jacobian, body in zip(
                jacobians, (model.geom(k).bodyid, model.site(floor).bodyid), strict=True
            ):
                mujoco.mj_jac(model, data, jacobian, None, point, body[0])
            np.testing.assert_allclose((jacobians[0] - jacobians[1]) @ data.qvel, 0.0, atol=1e-9)


@pytest.mark.slow
def test_objects_have_their_own_masses_and_centres_in_a_world():
    robot = TASK.robot.carrying([TALL, CRATE])
    model = PrescribedModel(robot, swing(1.0), 4e-4)
    masses = (1.0,) * (1 + robot.arm.links) + (1.1, 0.8)
    shift = (3e-3, -2e-3, 1e-3)
    there = model.compiled(World(masses=masses, shifts=(shift, (0.0, 0.0, 0.0))), None)
    back = model.compiled(World(), None)
    for name, factor, moved in (("tall", 1.1, TALL.rotation.T @ shift), ("crate", 0.8, np.zeros(3))):
        own, nominal = there.body(f"object {name}"), back.body(f"object {name}")
        assert own.mass[0] == pytest.approx(factor * nominal.mass[0])
        np.testing.assert_allclose(own.inertia, factor * nominal.inertia)
        np.testing.assert_allclose(own.ipos - nominal.ipos, moved, atol=1e-12)


@pytest.mark.parametrize("payload", [None, Payload(0.7), Payload.box(0.7, (0.1, 0.2, 0.1))])
def test_a_robot_without_its_objects_is_what_it_was(payload):
    robot = TASK.robot.varied(arm=TASK.robot.arm.with_payload(payload))
    bare = robot.carrying([LOW, TOP, CRATE]).without_objects()
    assert not bare.objects
    np.testing.assert_allclose(bare.support.center_of_mass, robot.support.center_of_mass, atol=1e-12)
    np.testing.assert_allclose(bare.support.inertia, robot.support.inertia, atol=1e-12)
    if payload is None:
        assert bare.payload is None
    else:
        assert bare.payload.mass == pytest.approx(0.7)
        np.testing.assert_allclose(bare.payload.inertia, payload.inertia, atol=1e-12)


@pytest.mark.slow
def test_simulate_reports_objects_and_export_writes_them(tmp_path, capsys):
    written = tmp_path / "waiter"
    table = (
        '[[object]]\nname = "low"\nmass = 0.5\nfriction = 0.2\n'
        "box = [0.1, 0.1, 0.03]\nrpy_deg = [180, 0, 0]\n"
    )
    for name in ("ur5.urdf", "ur5_cart.toml"):
        text = (EXAMPLES / "tasks" / name).read_text()
        (tmp_path / name).write_text(text + table if name.endswith("toml") else text)
    write_plan(written, plan_of(load_task(tmp_path / "ur5_cart.toml"), swing(1.0)))
    assert main(["simulate", str(written), "--step", "0.0003"]) == 0
    assert "No foot and no object gets" in capsys.readouterr().out
    assert main(["simulate", str(written), "--friction", "0.25", "--step", "0.0003", "--json"]) == 1
    data = json.loads(capsys.readouterr().out)["objects"]["low"]
    assert data["slide_m"] > 0.5e-3
    assert not data["stands"]
    assert not data["library"]["stands"]
    assert main(["export", str(written), "--mjcf", str(tmp_path / "a.xml")]) == 0
    assert "object low" in (tmp_path / "a.xml").read_text()
    assert main(["export", str(written), "--urdf", str(tmp_path / "a.urdf")]) == 2
    assert "export does not take objects (low)" in capsys.readouterr().err
    assert main(["simulate", str(written), "--stiffness", "1e5"]) == 2
    assert "stiff feet, not of compliant" in capsys.readouterr().err


def test_objects_on_compliant_feet_are_refused():
    soft = TASK.robot.carrying([LOW])
    with pytest.raises(InputError, match="simulations with objects are of stiff feet"):
        to_mjcf(World(stiffness=1e5).robot(soft))
