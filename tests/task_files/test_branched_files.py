"""Files of robots whose legs branch: the Delta with its parallelograms, and what is refused."""

from __future__ import annotations

import json
import tomllib

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.cli.main import main
from ocptip.parallel.description.branched import BranchedLeg
from ocptip.parallel.description.ready_made import delta
from ocptip.parallel.robot import ParallelRobot
from ocptip.task_files.parallel import read_parallel_robot
from tests.oracles.parallel_routes.forces import forces_by
from tests.parallel.parallel_twin import relative, rod_delta
from tests.quick import some

NAME = "delta_parallelograms.toml"


@pytest.fixture(scope="module")
def text(root):
    return (root / "src/ocptip/examples/robots" / NAME).read_text()


@pytest.fixture(scope="module")
def robots(root):
    """The file's robot, the same built in Python, and with one rod for two."""
    described = read_parallel_robot(root / "src/ocptip/examples/robots" / NAME), rod_delta(), delta()
    return tuple(ParallelRobot(one) for one in described)


def random_state(seed):
    rng = np.random.default_rng(seed)
    z = np.array([0.0, 0.0, -0.45]) + rng.uniform(-0.08, 0.08, 3)
    return z, rng.uniform(-1, 1, 3), rng.uniform(-5, 5, 3)


@pytest.mark.parametrize("seed", some(2, range(4)))
def test_file_is_the_built_delta_and_the_lumped_one(robots, seed):
    z, zd, zdd = random_state(seed)
    read, built, lumped = (robot.inverse_dynamics(z, zd, zdd) for robot in robots)
    assert relative(read.motors, built.motors) < 1e-12
    assert relative(read.motors, lumped.motors) < 1e-12
    s = robots[0].kinematics.quasi(z, zd, zdd)[0]
    forward = [robot.forward_dynamics(z, s, read.motors) for robot in robots]
    assert relative(forward[0], forward[1]) < 1e-12
    assert relative(forward[0], forward[2]) < 1e-11


def inner_loop(text: str) -> dict:
    """The second rod ends on a bar that the first rod's foot carries: a loop within the leg, one end."""
    data = tomllib.loads(text)
    table = data["table"]["arm_and_rods"]
    table["rows"][7:] = [{"joint": "fixed", "d": "l2"}, {"joint": "fixed", "after": 5, "r": 0.12}]
    table |= {"loops": [[8, 9]], "viscous": [0.2, 0, 0, 0, 0, 0.1]}
    for leg in data["leg"]:
        leg["guess"] = leg["guess"][:7]
        leg["ends"] = leg["ends"][:1]
    return data


def test_inner_loops(text, robots):
    """Fixed rows in the middle, a loop, friction per joint: still the lumped Delta, plus friction."""
    description = read_parallel_robot(inner_loop(text))
    leg = description.legs[0]
    assert isinstance(leg, BranchedLeg)
    assert leg.loops == ((7, 8),)
    assert (leg.n_joints, len(leg.rows), len(leg.ends)) == (7, 9, 1)
    robot = ParallelRobot(description)
    z, zd, zdd = random_state(9)
    forces, lumped = robot.inverse_dynamics(z, zd, zdd), robots[2].inverse_dynamics(z, zd, zdd)
    assert relative(forces.motors, forces_by("multipliers", robot, z, zd, zdd).motors) < 1e-10
    power = 0.0
    for qd in robot.passive(z, zd, zdd).qd:
        power += 0.2 * qd[0] ** 2 + 0.1 * qd[5] ** 2
    assert (forces.generalized - lumped.generalized) @ zd == pytest.approx(power, rel=1e-10)


@pytest.mark.slow
def test_command(capsys, root, tmp_path):
    path = str(root / "src/ocptip/examples/robots" / NAME)
    assert main(["parallel", path, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["mobility"]["dof"] == 3
    assert report["home_pose"]["singular"] == []
    assert "leg 1 is branched or has closed loops" in report["without_code"]
    assert main(["parallel", path, "--c", str(tmp_path / "x.c")]) == 2
    assert "--c: no code for Delta with parallelograms" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_unsupported_parts_name_the_leg(robots):
    robot = robots[0]
    state = random_state(0)
    assert robot.crossings(np.array([state[0], state[0] + 0.01])) == ()
    with pytest.raises(InputError, match="generated code: leg 1 is branched"):
        robot.lean()


BAD = [
    ("row = 5", "row = 10", r"leg\[1\].ends\[1\].row: there is no row 10, only 9"),
    ("row = 5", "row = '5'", r"leg\[1\].ends\[1\].row: must be a whole number >= 1, got '5'"),
    ("row = 5", "rows = 5", r"leg\[1\].ends\[1\].rows: unknown key; did you mean 'row'"),
    ("[0.15, 0.06, 0.0]", "[0.15, 0.06]", r"leg\[1\].ends\[1\].coupling: expected 3 entries, got 2"),
    ("[0.15, -0.06, 0.0]", "[0.15, 'low', 0.0]", r"leg\[1\].ends\[2\].coupling\[2\]: 'low' is neither"),
    ('[["x", "-pi"],', '[["u", "-pi"],', r"leg\[1\].ends\[1\].end_rotation\[1\]: the axis must be"),
    ("guess = [1.85, ", "guess = [", r"leg\[1\].guess: expected 9 numbers, got 8"),
    (
        "guess = [1.85, 2.04, 0.0, 0.0, 3.9, 2.04, 0.0, 0.0, 3.9]",
        "guess = 2",
        r"leg\[1\].guess: expected a l",
    ),
    ("actuated = [1]", "actuated = [10]", r"leg\[1\].actuated: must be a whole number >= 1 and <= 9, got 10"),
    ("actuated = [1]", "branch = [1]\nactuated = [1]", r"leg\[1\].branch: a leg with ends has none"),
    ("actuated = [1]", "viscous = 2\nactuated = [1]", r"leg\[1\].viscous: expected a list"),
    ("rows = [", "joints_to_coupling = 3\nrows = [", r"table.arm_and_rods.joints_to_coupling: not for legs"),
    ("rows = [", "loops = [[3, 10]]\nrows = [", r"table.arm_and_rods.loops\[1\]: there is no row 10, only 9"),
    ("rows = [", "loops = 3\nrows = [", "table.arm_and_rods.loops: expected shape n x 2"),
    (
        "after = 1, b = 0.06",
        "after = 2, b = 0.06",
        r"table.arm_and_rods.rows\[2\].after: must be a whole number >= 0 and <= 1, got 2",
    ),
    ("after = 1, b = 0.06", "afer = 1, b = 0.06", r"rows\[2\].afer: unknown key; did you mean 'after'"),
    ("mass = 0.8", "mass = -0.8", r"table.arm_and_rods.bodies\[1\].mass: must be >= 0"),
    ("[[leg.ends]]", "[[leg.end]]", r"leg\[1\].end: unknown key; did you mean 'ends'"),
]


@pytest.mark.parametrize(("old", "new", "message"), BAD)
def test_bad_files_name_file_leg_and_key(tmp_path, text, old, new, message):
    assert old in text
    path = tmp_path / "bad.toml"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=f"bad.toml: .*{message}|bad.toml: {message}"):
        read_parallel_robot(path)


def test_a_serial_leg_cannot_use_a_branching_table(text):
    data = tomllib.loads(text)
    del data["leg"][1]["ends"]
    with pytest.raises(InputError, match=r"rows\[2\].after: for branched legs"):
        read_parallel_robot(data)
    data["leg"][1]["ends"] = 3
    with pytest.raises(
        InputError, match=r"leg\[2\].ends: expected tables in double brackets, \[\[leg.ends\]\], got 3"
    ):
        read_parallel_robot(data)
    data["leg"][1]["ends"] = []
    with pytest.raises(InputError, match=r"leg\[2\].ends: a leg needs at least one end"):
        read_parallel_robot(data)
