"""Parallel robots as URDF (looked at by Pinocchio) and as MuJoCo models (simulated by MuJoCo)."""

from __future__ import annotations

import dataclasses
import json
import xml.etree.ElementTree as ET
from functools import cache

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from ocptip.basics.errors import InputError
from ocptip.basics.write import file_target
from ocptip.cli.main import main
from ocptip.cli.poses_and_closed_chains import parallel as command
from ocptip.parallel.description.branched import BranchedLeg, LegEnd
from ocptip.parallel.description.platform import BodyInertia
from ocptip.parallel.description.ready_made import delta, prrr4, rpr3, rrr3, ups6
from ocptip.parallel.export import to_urdf
from ocptip.parallel.mjcf import to_mjcf
from ocptip.parallel.robot import ParallelRobot
from ocptip.parallel.simulation import simulate
from tests.oracles.parallel_urdf.reader import urdf_cuts, urdf_home
from tests.parallel.parallel_examples import five_axes, prr3, redundant_leg, vertical_delta
from tests.parallel.parallel_twin import random_robot, relative, rod_delta
from tests.quick import some

ROBOTS = {
    "3RRR": rrr3,
    "3RPR": rpr3,
    "Delta": delta,
    "4PRRR": prrr4,
    "6UPS": ups6,
    "rods": rod_delta,
    "3T2R": lambda: five_axes(coupling_mass=True),
}
every_robot = pytest.mark.parametrize("name", list(ROBOTS))


@cache
def robot(name: str) -> ParallelRobot:
    return ParallelRobot(ROBOTS[name]())


# --- URDF ----------------------------------------------------------------------------------------


def configuration(model, q):
    """Pinocchio's positions from ours per leg."""
    result = pin.neutral(model)
    for i, values in enumerate(q, start=1):
        for j, value in enumerate(values, start=1):
            joint = model.joints[model.getJointId(f"leg{i}_joint{j}")]
            put = value if joint.nq == 1 else [np.cos(value), np.sin(value)]
            result[joint.idx_q : joint.idx_q + joint.nq] = put
    return result


def frames(model, q):
    data = model.createData()
    pin.framesForwardKinematics(model, data, configuration(model, q))
    return {f.name: data.oMf[i] for i, f in enumerate(model.frames)}


@every_robot
def test_urdf_has_all_frames_and_masses(name):
    ours = robot(name)
    model = pin.buildModelFromXML(to_urdf(ours))
    rng = np.random.default_rng(0)
    q = [rng.uniform(-2, 2, leg.n) for leg in ours.kinematics.legs]
    found = frames(model, q)
    for i, leg in enumerate(ours.kinematics.legs):
        rotations, origins = leg.frames(q[i])
        for k, (R, p) in enumerate(zip(rotations, origins, strict=True)):
            np.testing.assert_allclose(found[f"leg{i + 1}_link{k + 1}"].rotation, R, atol=1e-13)
            np.testing.assert_allclose(found[f"leg{i + 1}_link{k + 1}"].translation, p, atol=1e-13)
    assert pin.computeTotalMass(model) == pytest.approx(ours.description.moving_mass, rel=1e-13)


@every_robot
def test_urdf_closes_where_the_robot_does(name):
    ours = robot(name)
    text = to_urdf(ours)
    model = pin.buildModelFromXML(text)
    z = ours.description.home + 0.01
    found = frames(model, ours.ik(z).q)
    r, R = ours.kinematics.pose(z)
    np.testing.assert_allclose(found["platform"].rotation, R, atol=1e-10)
    np.testing.assert_allclose(found["platform"].translation, r, atol=1e-10)
    cuts = [line.split()[2:5:2] for line in text.splitlines() if "<!-- cut: " in line]
    for a, b in cuts:
        np.testing.assert_allclose(found[a].homogeneous, found[b].homogeneous, atol=1e-10)
    assert len(cuts) == sum(len(leg.couplings) for leg in ours.kinematics.legs) - 1


def test_urdf_energy_is_the_robots():
    """Kinetic energy of the tree at closed rates: every inertia is where it belongs."""
    ours, z, zd, _ = random_robot("6UPS", 2)
    rates = ours.passive(z, zd, np.zeros(6))
    model = pin.buildModelFromXML(to_urdf(ours))
    v = np.zeros(model.nv)
    for i, values in enumerate(rates.qd, start=1):
        for j, value in enumerate(values, start=1):
            v[model.joints[model.getJointId(f"leg{i}_joint{j}")].idx_v] = value
    energy = pin.computeKineticEnergy(model, model.createData(), configuration(model, rates.q), v)
    s = ours.kinematics.quasi(z, zd, np.zeros(6))[0]
    assert energy == pytest.approx(ours.energy(z, s, rates.q)[0], rel=1e-11)


def test_urdf_cuts_and_home():
    assert [cut.leg for cut in urdf_cuts(delta())] == ["leg2_link5", "leg3_link5"]
    home = urdf_home(robot("Delta"))
    assert home["leg3_joint1"] == pytest.approx(robot("Delta").kinematics.legs[2].home[0])
    with pytest.raises(InputError, match="leg 1: branches or has loops; only chains can be read"):
        urdf_cuts(robot("rods"))


# --- MuJoCo --------------------------------------------------------------------------------------


@cache
def model_of(name: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(to_mjcf(robot(name)))


def put(model, data, q, qd=None):
    """Joint positions and rates per leg."""
    for i, values in enumerate(q, start=1):
        for j, value in enumerate(values, start=1):
            joint = model.joint(f"leg{i}_joint{j}")
            data.qpos[joint.qposadr[0]] = value
            data.qvel[joint.dofadr[0]] = 0.0 if qd is None else qd[i - 1][j - 1]


def platform_jacobian(model, data):
    J = np.zeros((6, model.nv))
    mujoco.mj_jacBody(model, data, J[:3], J[3:], model.body("platform").id)
    return J


@every_robot
def test_mujoco_starts_closed_at_home(name):
    ours, model = robot(name), model_of(name)
    data = mujoco.MjData(model)
    start = data.qpos.copy()
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    np.testing.assert_allclose(data.qpos, start, atol=1e-15)
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos[: data.ne]).max() < 1e-9
    r, R = ours.kinematics.pose(ours.description.home)
    np.testing.assert_allclose(data.body("platform").xpos, r, atol=1e-9)
    np.testing.assert_allclose(data.body("platform").xmat.reshape(3, 3), R, atol=1e-9)
    assert model.body("world").subtreemass[0] == pytest.approx(ours.description.moving_mass, rel=1e-12)
    assert model.nq == sum(leg.n for leg in ours.kinematics.legs)
    assert model.nu == len(ours.description.actuated)


@every_robot
def test_mujoco_accelerations(name):
    """Under random motor forces: within 1e-3 of the platform's, and 2e-4 of what the cut tree would do."""
    ours, model = robot(name), model_of(name)
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    for _ in range(3):
        z = ours.description.home + rng.uniform(-0.02, 0.02, ours.m)
        motors = rng.uniform(-5, 5, model.nu)
        q = ours.ik(z).q
        put(model, data, q)
        data.ctrl[:] = motors
        mujoco.mj_forward(model, data)
        assert np.abs(data.efc_pos[: data.ne]).max() < 1e-9
        rest = np.zeros(ours.m)
        expected = ours.motion(z, rest).T @ ours.forward_dynamics(z, rest, motors)
        found = platform_jacobian(model, data) @ data.qacc
        assert relative(found, expected) < 1e-3
        assert np.abs(found - expected).max() < 2e-4 * np.abs(data.qacc_smooth).max()


@pytest.mark.parametrize("name", ["3RRR", "Delta", "6UPS"])
def test_mujoco_mass_matrix(name):
    """Kinetic energy at closed rates: the shares of the platform add up to it."""
    ours, model = robot(name), model_of(name)
    data, rng = mujoco.MjData(model), np.random.default_rng(2)
    z, zd = ours.description.home + 0.01, rng.uniform(-1, 1, ours.m)
    rates = ours.passive(z, zd, np.zeros(ours.m))
    put(model, data, rates.q, rates.qd)
    mujoco.mj_forward(model, data)
    momentum = np.zeros(model.nv)
    mujoco.mj_mulM(model, data, momentum, data.qvel)
    s = ours.kinematics.quasi(z, zd, np.zeros(ours.m))[0]
    assert 0.5 * momentum @ data.qvel == pytest.approx(ours.energy(z, s, rates.q)[0], rel=1e-11)


@pytest.mark.parametrize("name", some(1, ["3RRR", "Delta", "6UPS"]))
def test_mujoco_moves_as_we_do(name):
    """50 ms with motors off from 1 m/s on, in (first-order) steps of 0.1 ms: within 0.1 % of the way."""
    ours, model = robot(name), mujoco.MjModel.from_xml_string(to_mjcf(robot(name)))
    data, home = mujoco.MjData(model), ours.description.home
    zd = np.array([1.0, 0.5, -0.7, 2.0, 1.0, -1.0])[: ours.m]
    rates = ours.passive(home, zd, np.zeros(ours.m))
    put(model, data, rates.q, rates.qd)
    model.opt.timestep = 1e-4
    for _ in range(500):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    s = ours.kinematics.quasi(home, zd, np.zeros(ours.m))[0]
    r, R = ours.kinematics.pose(simulate(ours, home, s, duration=0.05, step=0.005).z[-1])
    moved = np.abs(r - ours.kinematics.pose(home)[0]).max()
    assert moved > 0.04
    assert np.abs(data.body("platform").xpos - r).max() < 1e-3 * moved
    assert np.abs(data.body("platform").xmat.reshape(3, 3) - R).max() < 1e-4


def test_joint_terms_and_motors():
    base = ups6()
    leg = dataclasses.replace(base.legs[1], drive_inertia=(0, 0, 0.7), viscous=(0.1,), coulomb=(0, 0.2))
    description = dataclasses.replace(base, legs=(base.legs[0], leg, *base.legs[2:]))
    model = mujoco.MjModel.from_xml_string(to_mjcf(description))
    joints = [model.joint(f"leg2_joint{j}") for j in (1, 2, 3)]
    at = [joint.dofadr[0] for joint in joints]
    np.testing.assert_allclose(model.dof_armature[at], [0, 0, 0.7])
    np.testing.assert_allclose(model.dof_damping[at], [0.1, 0, 0])
    np.testing.assert_allclose(model.dof_frictionloss[at], [0, 0.2, 0])
    assert model.actuator("motor2").trnid[0] == joints[2].id
    dynamics = {j.get("name"): j.find("dynamics") for j in ET.fromstring(to_urdf(description)).iter("joint")}
    assert dynamics["leg2_joint1"].get("damping") == "0.1"
    assert dynamics["leg2_joint2"].get("friction") == "0.2"


def free_ends():
    """Rods on ball joints: the second end of every leg turns freely, the platform hangs on the first."""
    base = rod_delta()
    rows = (*base.legs[0].rows[:7], dataclasses.replace(base.legs[0].rows[7], sigma=2))
    legs = [
        BranchedLeg(
            rows,
            leg.parents[:8],
            (leg.ends[0], LegEnd(7, leg.ends[1].coupling)),
            leg.bodies[:7],
            base_rotation=leg.base_rotation,
            base_position=leg.base_position,
            guess=leg.guess[:7],
        )
        for leg in base.legs
    ]
    return dataclasses.replace(base, legs=tuple(legs))


@pytest.mark.parametrize("make", [free_ends, redundant_leg, vertical_delta])
def test_other_kinds_of_closures(make):
    """Ball joints at ends are `connect`s; robots that do not move as described can be looked at, too."""
    text = to_mjcf(make())
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos[: data.ne]).max() < 1e-9
    assert ("<connect" in text) == (make is free_ends)
    assert "platform_leg2" in to_urdf(make())


def test_what_the_formats_cannot_hold():
    with pytest.raises(InputError, match="leg1_link1: MuJoCo cannot simulate this body"):
        to_mjcf(prr3())
    base = rrr3()
    heavy = BodyInertia(0.0, np.array([1.0, 0, 0]), grouped=True)
    leg = dataclasses.replace(base.legs[1], bodies=(base.legs[1].bodies[0], heavy))
    with pytest.raises(InputError, match="leg 2, body 2: URDF needs mass"):
        to_urdf(dataclasses.replace(base, legs=(base.legs[0], leg, base.legs[2])))
    with pytest.raises(InputError, match="robot: expected a ParallelRobot or RobotDescription, got str"):
        to_urdf("3RRR")
    light = dataclasses.replace(base, platform=dataclasses.replace(base.platform, inertia=BodyInertia()))
    with pytest.raises(InputError, match=r"leg1_link3: MuJoCo cannot .* \(mass 0 kg"):
        to_mjcf(light)


def test_sketch_and_texts_are_plain():
    text = to_mjcf(robot("Delta"))
    assert text.isascii()
    geoms = ET.fromstring(text).findall(".//worldbody//geom")
    assert len(geoms) >= 12
    model = model_of("Delta")
    assert not model.geom_contype.any()
    assert not model.geom_conaffinity.any()
    assert ET.fromstring(to_urdf(robot("Delta"))).findall(".//visual//cylinder")


# --- files and command ---------------------------------------------------------------------------


def test_targets_are_checked(tmp_path):
    assert file_target(tmp_path / "robot.urdf", (".urdf",)) == tmp_path / "robot.urdf"
    with pytest.raises(InputError, match=r"path: expected a file NAME.xml or NAME.mjcf, got .*robot.txt"):
        file_target(tmp_path / "robot.txt", (".xml", ".mjcf"))
    with pytest.raises(InputError, match=r"the folder .* does not exist"):
        file_target(tmp_path / "none" / "robot.urdf", (".urdf",))


@pytest.mark.slow
def test_command_writes_models(capsys, root, tmp_path):
    urdf, mjcf = tmp_path / "delta.urdf", tmp_path / "delta.xml"
    example = str(root / "src/ocptip/examples/robots" / "delta_parallelograms.toml")
    assert main(["parallel", example, "--urdf", str(urdf), "--mjcf", str(mjcf), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["written"] == [str(urdf), str(mjcf)]
    assert pin.buildModelFromUrdf(str(urdf)).nv == 27
    assert mujoco.MjModel.from_xml_path(str(mjcf)).nv == 27
    assert main(["parallel", "3rrr", "--mjcf", str(mjcf), "--c", str(tmp_path / "x.c")]) == 0
    assert f"wrote {tmp_path / 'x.c'} and {tmp_path / 'x.h'} and {mjcf}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--urdf", "robot.xml"], "--urdf: expected a file NAME.urdf, got 'robot.xml'"),
        (["--mjcf", "nowhere/robot.xml"], "--mjcf: the folder 'nowhere' does not exist"),
    ],
)
def test_command_refuses(capsys, arguments, message):
    assert main(["parallel", "3RRR", *arguments]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_command_names_what_cannot_be_exported(capsys, monkeypatch, tmp_path):
    """And writes nothing, the other files neither."""
    monkeypatch.setattr(command, "read_robot", lambda name: prr3())
    files = [
        "--c",
        str(tmp_path / "x.c"),
        "--urdf",
        str(tmp_path / "x.urdf"),
        "--mjcf",
        str(tmp_path / "x.xml"),
    ]
    assert main(["parallel", "3PRR", *files]) == 2
    assert "--mjcf: leg1_link1: MuJoCo cannot simulate this body" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
