"""Platforms whose free coordinates determine the others, and legs that spin, against MuJoCo's equations."""

import re
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest

import ocptip
from ocptip.basics.errors import InputError, SolverError
from ocptip.parallel.analysis.mobility import stacked_closures
from ocptip.parallel.mjcf import to_mjcf
from ocptip.parallel.robot import ParallelRobot, base_wrench
from ocptip.parallel.simulation import simulate
from ocptip.task_files.parallel import read_parallel_robot
from tests.oracles.parallel_routes.forces import forces_by
from tests.quick import some

ROBOTS = Path(ocptip.__file__).parent / "examples" / "robots"
MECHANISMS = {  # mobility, redundant closures
    "five_bar": (2, 3),
    "rps3": (3, 0),
    "prs3": (3, 0),
    "tricept": (3, 0),
    "exechon": (3, 2),
    "sps6": (6, 0),
}
_ROBOTS: dict[str, ParallelRobot] = {}


def robot_of(name: str) -> ParallelRobot:
    if name not in _ROBOTS:
        _ROBOTS[name] = ParallelRobot(read_parallel_robot(ROBOTS / f"{name}.toml"))
    return _ROBOTS[name]


def text_of(name: str) -> str:
    return (ROBOTS / f"{name}.toml").read_text()


def state_of(robot: ParallelRobot, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    z = robot.description.home + rng.uniform(-0.05, 0.05, robot.m)
    return z, *rng.uniform(-0.5, 0.5, (2, robot.m))


class MuJoCo:
    """Mass matrix, bias forces and closures of MuJoCo, the closures as hard constraints."""

    def __init__(self, robot: ParallelRobot) -> None:
        self.robot, self.model = robot, mujoco.MjModel.from_xml_string(to_mjcf(robot))
        self.model.opt.jacobian = 0  # dense
        self.data = mujoco.MjData(self.model)
        index = self.model.joint
        self.order = [
            int(index(f"leg{i + 1}_joint{j + 1}").qposadr[0])
            for i, leg in enumerate(robot.kinematics.legs)
            for j in range(leg.n)
        ]
        actuated = robot.description.actuated
        self.motors = [int(index(f"leg{i + 1}_joint{j + 1}").dofadr[0]) for i, j in actuated]
        self.S = np.eye(self.model.nv)[:, self.motors]

    def joints(self, per_leg) -> np.ndarray:
        values = np.zeros(self.model.nv)
        values[self.order] = np.concatenate(per_leg)
        return values

    def equations(self, q, v):
        """M, bias, J at a state."""
        self.data.qpos[:], self.data.qvel[:] = q, v
        mujoco.mj_forward(self.model, self.data)
        M = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, M)
        J = self.data.efc_J.reshape(-1, self.model.nv).copy()
        return M, self.data.qfrc_bias - self.data.qfrc_passive, J

    def motor_forces(self, q, v, a) -> tuple[np.ndarray, float]:
        """Forces of motors, and what they and the closures leave unbalanced."""
        M, bias, J = self.equations(q, v)
        idle = [leg.idle_motions(x) for leg, x in zip(self.robot.kinematics.legs, self.split(q), strict=True)]
        free = [
            self.joints(self.split_column(i, own[:, k]))
            for i, own in enumerate(idle)
            for k in range(own.shape[1])
        ]
        free = np.array(free).T.reshape(self.model.nv, -1)
        matrix, right = np.hstack([self.S, J.T, -M @ free]), M @ a + bias
        found = np.linalg.lstsq(matrix, right, rcond=1e-11)[0]
        return found[: len(self.motors)], np.abs(matrix @ found - right).max() / np.abs(right).max()

    def accelerations(self, q, v, motors) -> np.ndarray:
        """Accelerations of all joints."""
        M, bias, J = self.equations(q, v)
        h = 1e-5
        drift = (self.equations(q + h * v, v)[2] - self.equations(q - h * v, v)[2]) @ v / (2 * h)
        rows = len(J)
        matrix = np.block([[M, J.T], [J, np.zeros((rows, rows))]])
        right = np.concatenate([self.S @ motors - bias, -drift])
        return np.linalg.lstsq(matrix, right, rcond=1e-11)[0][: self.model.nv]

    def simulate(self, q, v, motors, duration, step):
        """Runge-Kutta on all joints; joint positions at the end."""
        for _ in range(round(duration / step)):
            k1 = v, self.accelerations(q, v, motors)
            k2 = v + step / 2 * k1[1], self.accelerations(q + step / 2 * k1[0], v + step / 2 * k1[1], motors)
            k3 = v + step / 2 * k2[1], self.accelerations(q + step / 2 * k2[0], v + step / 2 * k2[1], motors)
            k4 = v + step * k3[1], self.accelerations(q + step * k3[0], v + step * k3[1], motors)
            parts = [(a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)]
            q, v = q + step * parts[0], v + step * parts[1]
        return q

    def split(self, q):
        counts = np.cumsum([leg.n for leg in self.robot.kinematics.legs])[:-1]
        return np.split(q[self.order], counts)

    def split_column(self, leg, column):
        return [column if i == leg else np.zeros(one.n) for i, one in enumerate(self.robot.kinematics.legs)]


@pytest.mark.parametrize("name", MECHANISMS)
def test_mobility_and_motion(name):
    robot, (dof, surplus) = robot_of(name), MECHANISMS[name]
    mobility = robot.mobility()
    assert (mobility.dof, mobility.platform_dof, mobility.internal_dof) == (dof, dof, 0)
    assert mobility.over_constraints == surplus
    assert mobility.gap > 1e6
    z, zd, zdd = state_of(robot, 1)
    h = 1e-4
    path = [robot.passive(z + t * zd + t * t / 2 * zdd, zd + t * zdd, zdd) for t in (-h, 0, h)]
    for leg, (before, now, after) in enumerate(zip(*(p.q for p in path), strict=True)):
        held = robot.kinematics.legs[leg].idle_motions(now)
        off = np.eye(len(now)) - held @ held.T  # idle freedoms have no position of their own
        np.testing.assert_allclose(off @ (after - before) / (2 * h), off @ path[1].qd[leg], atol=1e-6)
        slope = (path[2].qd[leg] - path[0].qd[leg]) / (2 * h)
        np.testing.assert_allclose(off @ slope, off @ path[1].qdd[leg], atol=1e-5)


@pytest.mark.parametrize("name", some(2, MECHANISMS))
def test_motor_forces_by_every_route_and_mujoco(name):
    robot = robot_of(name)
    twin = MuJoCo(robot)
    for seed in range(2):
        z, zd, zdd = state_of(robot, seed)
        own = robot.inverse_dynamics(z, zd, zdd)
        for route in ("constraints", "multipliers", *(() if name == "sps6" else ("tree",))):
            other = forces_by(route, robot, z, zd, zdd)
            np.testing.assert_allclose(other.motors, own.motors, rtol=1e-9, atol=1e-9)
            assert other.residual < 1e-9
        rates = robot.passive(z, zd, zdd)
        motors, residual = twin.motor_forces(*map(twin.joints, (rates.q, rates.qd, rates.qdd)))
        assert residual < 1e-9
        np.testing.assert_allclose(motors, own.motors, rtol=1e-8, atol=1e-8)
        s, sd = robot.kinematics.quasi(z, zd, zdd)
        np.testing.assert_allclose(robot.forward_dynamics(z, s, own.motors), sd, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("name", some(2, MECHANISMS))
def test_simulation_agrees_with_mujoco(name):
    robot = robot_of(name)
    twin = MuJoCo(robot)
    z, zd, _ = state_of(robot, 5)
    motors = robot.inverse_dynamics(z, 0 * zd, 0 * zd).motors * 1.05
    s = robot.kinematics.quasi(z, zd, zd)[0]
    ours = simulate(robot, z, s, duration=0.03, step=0.0025, motors=motors)
    start = robot.passive(z, zd, 0 * zd)
    end = twin.simulate(twin.joints(start.q), twin.joints(start.qd), motors, 0.03, 0.0025)
    assert np.abs(ours.z[-1] - z).max() > 0.005
    expected = twin.joints(robot.ik(ours.z[-1], start.q).q)
    np.testing.assert_allclose(end[twin.motors], expected[twin.motors], atol=1e-8)


@pytest.mark.parametrize("seed", some(1, [0, 1]))
def test_poses_from_joints_and_from_motors(seed):
    """Forward kinematics lead back; joints given with z belong to one platform pose."""
    for name in MECHANISMS:
        robot = robot_of(name)
        z = state_of(robot, seed)[0]
        found = robot.ik(z)
        assert found.assembly == "home"
        assert found.residual < 1e-10
        motors = [found.q[leg][joint] for leg, joint in robot.description.actuated]
        np.testing.assert_allclose(robot.fk(motors).z, z, atol=1e-9)
        r, R = robot.kinematics.pose(z, found.q)
        for leg, joints in zip(robot.kinematics.legs, found.q, strict=True):
            assert np.abs(leg.residual(joints, r, R)).max() < 1e-9


@pytest.mark.slow
def test_five_bar_is_singular_where_its_distal_links_align():
    """At (0, 0.15) the elbows are at (-0.35, 0.15) and (0.35, 0.15): all distal links in one line."""
    robot = robot_of("five_bar")
    assert robot.singularity([0.0, 0.15]).kinds == ("platform (type II)",)
    (crossing,) = robot.crossings(np.linspace(robot.description.home, [0.0, 0.05], 6))
    assert crossing.kinds == ("platform (type II)",)
    np.testing.assert_allclose(crossing.z, [0.0, 0.15], atol=1e-8)
    with pytest.raises(SolverError, match=r"platform \(type II\): the motors do not hold the rotation about"):
        robot.inverse_dynamics([0.0, 0.15], [0, 0], [0, 0])
    reach = np.sqrt(0.6**2 - 0.15**2)  # arms stretched
    assert robot.singularity([0.0, reach - 1e-8]).determined < 2e-3
    with pytest.raises(InputError, match=r"do not close at z = \[0.0, 0.6\] with any searched phi3"):
        robot.ik([0.0, 0.6])


@pytest.mark.slow
def test_constraint_singularity():
    """Hinges that point to the centre, vertical legs: the three forces meet, a fourth freedom is there."""
    text = text_of("rps3").replace('alpha = "pi/2" }, # tangential', 'gamma = "pi/2", alpha = "pi/2" },')
    text = re.sub(r"base_position = (.*)", r"base_position = \1\ncoupling = \1", text)
    text = re.sub(r"base_rotation = (.*)\ncoupling = .*", r"base_rotation = \1", text)
    text = text.replace("guess = [0.3, 0.63]", "guess = [0.0, 0.6]")
    robot = ParallelRobot(read_parallel_robot(tomllib.loads(text)), check=False)
    home = robot.description.home
    q = [leg.home for leg in robot.kinematics.legs]
    found = robot.singularity(home, q)
    assert found.held < 1e-9
    assert "constraint" in found.kinds
    matrix = stacked_closures(robot.kinematics.legs, q, robot.kinematics.pose(home, q)[1])
    assert matrix.shape[1] - np.linalg.matrix_rank(matrix, tol=1e-9) == 4
    with pytest.raises(SolverError, match=r"singular pose .* constraint"):
        robot.forward_dynamics(home, np.zeros(3), np.zeros(3), q)


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("rps3", '["x", "y", "phi3"]', '["x", "phi3"]', "leg 1, 2, 3 does not allow all of z, phi1, phi2"),
        ("rps3", '["x", "y", "phi3"]', '["x", "y", "z"]', "dependent: z cannot be both free and dependent"),
        (
            "rps3",
            '["x", "y", "phi3"]',
            '["y", "x", "phi3"]',
            r"dependent: expected the order \['x', 'y', 'phi3'\]",
        ),
        (
            "rps3",
            "home = [0.6",
            "dependent_home = [1.0]\nhome = [0.6",
            "dependent_home: expected 3 numbers, got 1",
        ),
        (
            "five_bar",
            "home = [0.0, 0.4]",
            "home = [0.0, 0.9]",
            "do not reach their coupling points: error 0.3 m",
        ),
        (
            "five_bar",
            "actuated = [1]",
            "actuated = [1]\nredundant = [2]",
            "redundant: a platform with dependent",
        ),
        ("sps6", "idle = 1", "", "a leg that spins about itself says `idle = 1`"),
        ("sps6", "idle = 1", "idle = -1", r"leg\[1\].idle: must be a whole number >= 0, got -1"),
        ("sps6", "actuated = [4]", "actuated = [3]", "the idle freedom of leg 1 moves its motor"),
        ("rps3", "free = [", 'free = ["x"]\n#', "dependent: x cannot be both|home: expected"),
    ],
)
def test_refusals(name, old, new, message):
    assert old in text_of(name)
    with pytest.raises(InputError, match=message) as error:
        ParallelRobot(read_parallel_robot(tomllib.loads(text_of(name).replace(old, new))))
    assert "\n" not in str(error.value)


def test_home_need_not_be_exact():
    text = text_of("rps3").replace("home = [0.6", "dependent_home = [0.0, 0.02, 0.1]\nhome = [0.6")
    near = ParallelRobot(read_parallel_robot(tomllib.loads(text)))
    z, zd, zdd = state_of(near, 3)
    expected = robot_of("rps3").inverse_dynamics(z, zd, zdd).motors
    np.testing.assert_allclose(near.inverse_dynamics(z, zd, zdd).motors, expected, rtol=1e-9)


def test_what_is_not_possible_yet_is_said():
    robot = robot_of("tricept")
    with pytest.raises(InputError, match="q: the joint positions do not close"):
        robot.inverse_dynamics([0.1, 0, 0.7], [0] * 3, [0] * 3, robot.ik([0.0, 0, 0.7]).q)


def test_standing_on_a_base():
    """Force on the base against the second difference of the centre of mass."""
    for name in ("tricept", "sps6"):
        robot = robot_of(name)
        z, zd, zdd = state_of(robot, 2)
        h = 1e-4

        def momentum(t, robot=robot, z=z, zd=zd, zdd=zdd):
            at, rate = z + t * zd + t * t / 2 * zdd, zd + t * zdd
            return base_wrench(robot, at, rate, zdd, gravity=np.zeros(3))[:3], center(robot, at)

        force = momentum(0.0)[0]
        slopes = (momentum(h)[1] - 2 * momentum(0.0)[1] + momentum(-h)[1]) / h**2
        np.testing.assert_allclose(-force, slopes, atol=1e-4 * np.abs(force).max() + 1e-5)


def center(robot: ParallelRobot, z: np.ndarray) -> np.ndarray:
    """(3,) sum of mass times centre of mass, kg m."""
    q = robot.ik(z).q
    r, R = robot.kinematics.pose(z, q)
    body = robot.description.platform.inertia
    total = body.mass * r + R @ body.first_moment
    for leg, joints in zip(robot.kinematics.legs, q, strict=True):
        turns, origins = leg.frames(joints)
        for k, one in enumerate(leg.leg.bodies):
            total = total + one.mass * origins[k] + turns[k] @ one.first_moment
    return total
