"""Kinds of bad input over all commands: one line on stderr with file and key, exit code 2, no traceback.

Each row is one kind. Files are the examples with one thing changed. Kinds that have their own module: URDFs
(`test_bad_urdfs`), options of one command (`test_cli_*`), keys of placement files (`task_files`).
"""

import json
import re
import shutil

import pytest

from ocptip.api import plan
from ocptip.cli.main import main
from ocptip.cli.place import place
from ocptip.cli.poses_and_closed_chains import parallel
from tests.places import EXAMPLES

FLOOR = 'kind = "floor"\nheight = 0.75'
PLAN = [  # what becomes of ur5_cart.toml: old, new, message after the file's name
    ('name = "UR5 on a cart"', "name = 5", "name: expected a text, got 5"),
    ("gravity = [0.0, 0.0, -9.81]", "gravity = [0, 0, -9.81, 0]", "gravity: expected 3 numbers, got 4"),
    ("mass = 35.0", "mass = -35.0", "base.mass: must be > 0"),
    ("mass = 35.0", "mass = '35 kg'", "base.mass: expected a number, got '35 kg'"),
    ("mass = 35.0", "mass = 35.0\nmas = 1", "base.mas: unknown key; did you mean 'mass'?"),
    ("friction = 0.6", "friction = -0.6", "contact[1].friction: must be >= 0"),
    ("facets = 12", "facets = 2", "contact[1].facets: must be"),
    ('kind = "unilateral"', 'kind = "suction"', "contact[1].kind: "),
    (
        "position = [0.25, 0.20, 0.0]",
        "position = [0.25, 0.20]",
        "contact[2].position: expected 2 numbers like contact[1], got 3",
    ),
    ('"ur5.urdf"', '"ur6.urdf"', "arm.urdf: "),
    ('tool_frame = "tool0"', 'tool_frame = "tool9"', "arm.tool_frame: no 'tool9'; candidates"),
    ("mount_position = [0.0, 0.0, 0.75]", "mount_position = [0.0, nan, 0.75]", "arm.mount_position: "),
    ("acceleration_deg_s2 = 800.0", "acceleration_deg_s2 = 0", "arm.limits.acceleration_deg_s2: "),
    ("acceleration_deg_s2 = 800.0", "acceleration_deg_s2 = [1, 2]", "arm.limits.acceleration_deg_s2: "),
    (
        "acceleration_deg_s2 = 800.0",
        "acceleration_deg_s2 = {elbow = 3}",
        "arm.limits.acceleration_deg_s2.elbow: no such joint",
    ),
    ("acceleration_deg_s2 = 800.0", "force_N = 3", "arm.limits.force_N: "),
    ("sphere_radius = [0.0, 0.06", "sphere_radius = [-0.1, 0.06", "arm.sphere_radius: "),
    ('kind = "estimated"', 'kind = "hydraulic"', "motors.kind: expected one of"),
    ("regeneration = 0.0", "regeneration = 1.5", "motors.regeneration: "),
    ('kind = "floor"', 'kind = "flor"', "obstacle[1].kind: expected one of"),
    ("height = 0.75", "height = 'low'", "obstacle[1].height: expected a number"),
    ('kind = "floor"\nheight', 'kind = "wall"\nnormal = [0, 0, 0]\nheight', "obstacle[1].normal: "),
    (
        FLOOR,
        'kind = "pillar"\npoint = [1, 0, 0]\nradius = 0',
        "obstacle[1].radius: ",
    ),
    (FLOOR, 'kind = "box"\nsize = [1, 1, 0]', "obstacle[1]"),
    (FLOOR, 'kind = "cylinder"\nradius = 1', "obstacle[1].length: missing"),
    (FLOOR, 'kind = "sphere"\nradius = -1', "obstacle[1].radius: must be > 0"),
    (FLOOR, 'kind = "mesh"\nfile = "no.stl"', "obstacle[1].file: "),
    (FLOOR, 'kind = "mesh"\nfile = "ur5.urdf"', "obstacle[1].file: "),
    ("[arm]", "[payload]\n[arm]", "payload.mass: missing"),
    ("[arm]", "[payload]\nmass = -1\n[arm]", "payload.mass: must be >= 0"),
    ("[arm]", "[payload]\nmass = 1\nbox = [1, 1]\n[arm]", "payload.box: expected 3 numbers, got 2"),
    ("[arm]", "[payload]\nmass = 1\ninertia = [1, 1, 9]\n[arm]", "payload.inertia: "),
    ("[arm]", "[payload]\nmass = 1\nbox = [1,1,1]\ninertia = [1,1,1]\n[arm]", "payload"),
    ("[arm]", "[payload]\nmass = 1\nshape = {kind = 'cone'}\n[arm]", "payload.shape.kind: expected one of"),
    ("[arm]", "[payload]\nmass = 1\nshape = {kind = 'sphere'}\n[arm]", "payload.shape.radius: missing"),
    ("[[contact]]", "[base.shape]\nkind = 'box'\nsize = 3\n[[contact]]", "base.shape.size: expected"),
    ("rpy_deg = [180, 0, 0]", "rpy_deg = [180, 0]", "motion.start_pose.rpy_deg: expected 3 numbers, got 2"),
    ("position = [0.30, 0.50, 0.90]", "position = [3.0, 0.5, 0.9]", "motion.start_pose: "),
    ("start_pose = {", "start_deg = [0, 0, 0, 0, 0, 0]\nstart_pose = {", "motion.start_deg: "),
    ('"elbow_joint"]', '"knee_joint"]', "motion.optimised: "),
    ("commands = 3", "commands = 0", "motion.commands: must be a whole number >= 1"),
    ("commands = 3", "commands = 2.5", "motion.commands: must be a whole number"),
    ("commands = 3", "objective = 'speed'", "motion.objective: expected energy, time or both"),
    ("commands = 3", "objective = 'both'", "motion.objective: both needs price_per_second"),
    ("commands = 3", "objective = 'time'\nprice_per_second = 3", "motion.price_per_second: belongs to"),
    ("commands = 3", "max_duration = -1", "motion.max_duration: must be > 0"),
    ("commands = 3", "duration = 1\nmax_duration = 2", "motion.duration: "),
    ("commands = 3", "controller = 'cubic'", "motion.controller: unknown key"),
    ("GN = 0.9", "GN = 0", "limits.GN: must be above 0 and at most 1"),
    ("GT = 0.9", "GT = inf", "limits.GT: must be finite"),
    ("clearance = 0.01", "clearance = -0.01", "limits.clearance: must be >= 0"),
    ("clearance = 0.01", "torque_ratio = 0", "limits.torque_ratio: must be > 0"),
    ("[limits]", "[tolerance]\nfriction = 2\n[limits]", "tolerance.friction: must be >= 0 and below 1"),
    ("[limits]", "[tolerance]\ntilt = 1\n[limits]", "tolerance.tilt: unknown key; did you mean 'tilt_deg'?"),
    ("[limits]", "[tolerance]\ntilt_deg = -1\n[limits]", "tolerance.tilt_deg: must be >= 0, got -1\n"),
    (
        "[limits]",
        "[tolerance]\ntilt_deg = 95\n[limits]",
        "tolerance.tilt_deg: must be at most 45 degrees, got 95",
    ),
    (
        "[limits]",
        "[tolerance]\ndelay_ms = 2e3\n[limits]",
        "tolerance.delay_ms: must be at most 1000 ms, got 2000",
    ),
    (
        "[limits]",
        "[stops]\nbrake_torque_min_Nm = 100\n[limits]",
        "stops.brake_torque_min_Nm: joint 4: the minimum, 100, is above the maximum, 56, 2 times",
    ),
    (
        "clearance = 0.01",
        "foot_force = 5",
        "limits.foot_force: is about compliant feet; these have no stiffness",
    ),
    ("[limits]", "[limits", "broken TOML"),
]
PLACE = [  # of place_ur5_wall.toml
    ("[[terrain]]", "[[terrain]]\nslope_deg = 3", "terrain[1].slope_deg: unknown key"),
    ("y = [-1.5, 1.5]", "y = [1.5, -1.5]", "terrain[1].y: the first bound must not be above the second"),
    ("force = [-120.0, 0.0, 0.0]", "force = -120.0", "task[1].load[1].force: expected a list of 3 numbers"),
    ('orientation = "axis"', 'orientation = "axes"', "task[1].orientation: expected one of"),
    ("torque_ratio = 0.8", "torque_ratio = 0", "limits.torque_ratio: "),
    ("base_clearance = 0.02", "base_clearance = nan", "limits.base_clearance: must be finite"),
    ("condition = 25.0", "condition = 0.5", "limits.condition: must be > 1"),
    ("GE = 0.2", "GE = -0.2", "weights.GE: must be >= 0"),
    ("[weights]", "[tolerance]\nfriction = -0.1\n[weights]", "tolerance.friction: must be >= 0 and below 1"),
    ("[weights]", "[tolerance]\nbase_mass = 'some'\n[weights]", "tolerance.base_mass: "),
    (
        "[weights]",
        "[tolerance]\ncenter_of_mass = 0.1\n[weights]",
        "tolerance.center_of_mass: expected a list of 3",
    ),
    ('kind = "pillar"', 'kind = "tree"', "obstacle[2].kind: expected one of"),
    ("[weights]", "[motion]\n[weights]", "is a motion task (ocptip plan), not a placement task"),
]
STAND = [  # of tripod_with_arm.toml
    ("mass = 25.0", "", "base.mass: missing"),
    ("inertia = [0.9, 0.9, 1.3]", "inertia = [0.9, 0.9, 9.3]", "base.inertia: "),
    ("normal = [0, 0, 1]", "normal = [0, 0, 0]", "contact[1].normal: "),
    ("friction = 0.6", "friction = 5000", "contact[1].friction: "),
    ("force = [-18.0, 6.0, -101.0]", "force = [1e300, 0, 0]", "load[1].force: magnitudes above 1e+12"),
    ("point = [0.22, -0.05, 0.55]", "pont = [0.22, -0.05, 0.55]", "load[1].pont: unknown key; did you mean"),
    ("moment = [0.0, 0.0, 4.0]", "", "load[3]"),
    ("[[load]]", "[load]", "broken TOML"),
]
ROBOT = [  # of planar_3rrr.toml, for parallel
    ('joint = "revolute", d = "l1"', 'joint = "hinge", d = "l1"', "table.RRR.rows[2].joint: "),
    ('table = "RRR"', 'table = "RRP"', "leg[1].table: "),
    ("mass = 2.0", "mass = -2.0", "platform.mass: must be"),
    ('free = ["x", "y", "phi3"]', 'free = ["x", "x", "phi3"]', "free: "),
    ('"3*pi/2"', '"3*pie/2"', "leg[1].base_rotation[1]: '3*pie/2' is neither"),
    ("l2 = 0.6", "l2 = nan", "parameters.l2: "),
]
PLATFORM = [  # of flight_simulator.toml, for rate
    ('unit = "m"', 'unit = "inch"', "unit: expected one of"),
    ("position = [0.0, 0.0, 0.393075688879]", "position = [0.0, 0.0]", "home.position: expected 3 numbers"),
    ("half_axes = [0.5, 0.5, 0.3]", "half_axes = [0.5, 0.5, 0.0]", "operation_ellipsoid.half_axes: "),
    ("base = [", "basis = [", "basis: unknown key; did you mean 'base'?"),
]
FILES = {
    "plan": ("tasks/ur5_cart.toml", PLAN),
    "place": ("tasks/place_ur5_wall.toml", PLACE),
    "stand": ("scenes/tripod_with_arm.toml", STAND),
    "parallel": ("robots/planar_3rrr.toml", ROBOT),
    "rate": ("platforms/flight_simulator.toml", PLATFORM),
}
KINDS = [(command, *row) for command, (_, rows) in FILES.items() for row in rows]

POINT = {"positions": [0.1] * 6, "velocities": [0.0] * 6, "time_from_start": {"sec": 0, "nanosec": 0}}
LATER = POINT | {"time_from_start": {"sec": 1, "nanosec": 0}}
NAMES = [f"joint {k}" for k in range(1, 7)]
HEAD = "time_s," + ",".join(f"q{k}_deg" for k in range(1, 7))
COMMANDS = {"start": [0.0] * 6, "commands": [[{"phi_e": 9.0, "speed": 9.0, "acceleration": 90.0}]] * 6}


def trajectory(*points, **more) -> str:
    return json.dumps({"joint_names": NAMES, "points": points} | more)


def ramps(**more) -> str:
    return json.dumps(COMMANDS | more)


def one_ramp(**more) -> str:
    return ramps(commands=[[COMMANDS["commands"][0][0] | more], *COMMANDS["commands"][1:]])


MOTIONS = [  # for check: name and content of the file, message after the name
    ("m.json", "", "is empty"),
    ("m.json", "[1, 2]", ""),
    ("m.json", "{}", ""),
    ("m.json", "[" * 100_000, "broken JSON"),
    ("m.json", ramps(start=[0] * 5), ""),
    ("m.json", ramps(start=["x"] * 6), "start"),
    ("m.json", ramps(start=[float("nan")] * 6), "start"),
    ("m.json", ramps(commands=3), "commands"),
    ("m.json", ramps(commands=[3] * 6), "commands: expected one list of commands per joint"),
    ("m.json", one_ramp(speed=-9.0), "joint 1, command 1: speed: "),
    ("m.json", one_ramp(acceleration=0), "joint 1, command 1: acceleration: "),
    ("m.json", one_ramp(phi_e=None), "joint 1, command 1: phi_e: "),
    ("m.json", one_ramp(jerk=3), "joint 1, command 1: expected exactly the keys"),
    ("t.json", trajectory(), ""),
    ("t.json", trajectory(POINT), ""),
    ("t.json", trajectory(POINT, POINT), "times: must increase"),
    ("t.json", trajectory(POINT, LATER, joint_names=NAMES[:5]), "joint_names: expected joint 1, joint 2"),
    ("t.json", trajectory(POINT, LATER, joint_names=3), "joint_names: expected a list of names, got 3"),
    ("t.json", trajectory(POINT, LATER, points=3), "points: expected"),
    ("t.json", trajectory(POINT, 3), "points[2]"),
    ("t.json", trajectory(POINT, LATER | {"positions": [1.0]}), "points[2].positions: expected 6 numbers"),
    ("t.json", trajectory(POINT, LATER | {"positions": ["a"] * 6}), "points[2].positions: "),
    ("t.json", trajectory(POINT, LATER | {"velocities": [1.0] * 6}), "speeds: joint 1 moves with"),
    ("t.json", trajectory(POINT, LATER | {"velocities": 3}), "points[2].velocities: "),
    ("t.json", trajectory(POINT, LATER | {"accelerations": [1.0]}), "points[1].accelerations: "),
    (
        "t.json",
        trajectory(POINT, LATER | {"time_from_start": 1.0}),
        "points[2].time_from_start: expected sec",
    ),
    ("t.json", trajectory(POINT, LATER | {"positions": [1e300] * 6}), "positions: magnitudes above"),
    ("t.yaml", "joint_names: [a\n", "broken YAML"),
    ("t.yaml", "- 1\n", ""),
    ("m.csv", "", "is empty; expected profile commands"),
    ("m.csv", HEAD, "times: at least two samples are needed"),
    ("m.csv", "a,b\n1,2\n", ""),
    ("m.csv", HEAD.replace("q3_deg", "q9_deg") + "\n0,0,0,0,0,0,0\n", ""),
    ("m.csv", HEAD.replace("deg", "m") + "\n0,0,0,0,0,0,0\n1,0,0,0,0,0,0\n", ""),
    ("m.csv", HEAD + "\n0,0,0,0,0,0\n", "line 2"),
    ("m.csv", HEAD + "\n0,0,0,0,0,0,x\n1,0,0,0,0,0,0\n", "line 2"),
    ("m.csv", HEAD + "\n0,0,0,0,0,0,0\n0,1,1,1,1,1,1\n", "line 3: time_s 0 again"),
    ("m.csv", HEAD + "\n0,0,0,0,0,0,0\nnan,1,1,1,1,1,1\n", ""),
    ("m.csv", HEAD.replace("q6_deg", "q5_deg") + "\n0,0,0,0,0,0,0\n", ""),
    ("m.txt", "hello", ""),
]


@pytest.fixture
def refusal(tmp_path, monkeypatch, capfd):
    """Runs a command that must refuse its input before it computes anything; returns the line."""

    def not_called(*_, **__):
        raise AssertionError("computed")

    for module, name in ((plan, "plan_motion"), (place, "place"), (parallel, "examine")):
        monkeypatch.setattr(module, name, not_called)
    monkeypatch.chdir(tmp_path)

    def run(*words: str) -> str:
        code = main(list(words))
        said, error = capfd.readouterr()
        assert (code, said) == (2, ""), error
        assert error.startswith("ocptip: ")
        assert error.count("\n") == 1
        assert "Traceback" not in error
        return error.removeprefix("ocptip: ")

    return run


@pytest.mark.parametrize(("command", "old", "new", "message"), KINDS, ids=range(len(KINDS)))
def test_files(refusal, tmp_path, command, old, new, message):
    file = EXAMPLES / FILES[command][0]
    if "urdf" in (text := file.read_text(encoding="utf-8")):
        shutil.copy(EXAMPLES / "tasks" / "ur5.urdf", tmp_path)
    text = re.sub(" +#.*", "", text)
    angles = re.sub("(start|goal)_pose = {.*}", r"\1_deg = [0, -90, 90, -90, -90, 0]", text)
    text = angles if old in angles else text  # poses have many postures, all of which are judged
    assert old in text
    (tmp_path / "bad.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
    assert refusal(command, "bad.toml").startswith(f"bad.toml: {message}")


@pytest.mark.parametrize(("name", "text", "message"), MOTIONS, ids=range(len(MOTIONS)))
def test_motions(refusal, tmp_path, name, text, message):
    (tmp_path / name).write_text(text, encoding="utf-8")
    assert refusal("check", name, "--case", "A").startswith(f"{name}: {message}")
