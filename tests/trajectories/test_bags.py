"""Bags of ROS 1 and 2: what the package `rosbags` wrote is read as the same motion or recording."""

from __future__ import annotations

import os
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rosbags")
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ocptip.basics.errors import InputError
from ocptip.measured.recording import read_recording
from ocptip.trajectories.bags import JOINT_STATE, TRAJECTORY, WRENCH, recording_in_bag, write_bag
from ocptip.trajectories.read import load_motion
from ocptip.trajectories.trajectory import Trajectory
from tests.quick import some

NAMES = ["shoulder", "elbow"]
KINDS = ("mcap", "sqlite3", "ros1")
TIMES = np.linspace(0.0, 1.0, 101)
POINTS = np.array([[0.0, 0.0], [0.3, -0.2], [0.5, -0.6]])
ARM = SimpleNamespace(names=NAMES, units=("rad", "m"), sensor=SimpleNamespace(name="sensor"))


def swing(times):
    """(N, 2): rests at both ends."""
    s = 10 * times**3 - 15 * times**4 + 6 * times**5
    return np.column_stack([0.5 * s, -0.2 * s])


def speeds(times):
    s = 30 * times**2 - 60 * times**3 + 30 * times**4
    return np.column_stack([0.5 * s, -0.2 * s])


class Bag:
    """Writes messages."""

    def __init__(self, writer, old):
        self.store = get_typestore(Stores.ROS1_NOETIC if old else Stores.ROS2_HUMBLE)
        self.writer, self.old, self.topics, self.count = writer, old, {}, 0

    def header(self, stamp):
        time = self.store.types["builtin_interfaces/msg/Time"](*divmod(round(1e9 * stamp), 10**9))
        self.count += 1
        header = self.store.types["std_msgs/msg/Header"]
        return header(self.count, time, "") if self.old else header(time, "")

    def add(self, topic, kind, logged, message):
        if topic not in self.topics:
            self.topics[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        raw = (self.store.serialize_ros1 if self.old else self.store.serialize_cdr)(message, kind)
        self.writer.write(self.topics[topic], round(1e9 * logged), raw)

    def state(self, logged, positions, stamp=0.0, names=NAMES, topic="/joint_states", **more):
        fields = [np.array(x, dtype=float) for x in (positions, more.get("velocity", []), [])]
        kind = self.store.types[JOINT_STATE]
        self.add(topic, JOINT_STATE, logged, kind(self.header(stamp), list(names), *fields))

    def trajectory(self, logged, times, positions, topic="/goal"):
        types, empty = self.store.types, np.zeros(0)
        point, duration = (
            types["trajectory_msgs/msg/JointTrajectoryPoint"],
            types["builtin_interfaces/msg/Duration"],
        )
        rows = []
        for t, q in zip(times, positions, strict=True):
            rows.append(
                point(np.asarray(q), np.zeros(2), empty, empty, duration(*divmod(round(1e9 * t), 10**9)))
            )
        self.add(topic, TRAJECTORY, logged, types[TRAJECTORY](self.header(0.0), NAMES, rows))

    def wrench(self, logged, values, topic="/sensor/wrench"):
        types = self.store.types
        parts = [types["geometry_msgs/msg/Vector3"](*values[k : k + 3]) for k in (0, 3)]
        wrench = types["geometry_msgs/msg/Wrench"](*parts)
        self.add(topic, WRENCH, logged, types[WRENCH](self.header(logged), wrench))


@contextmanager
def bag(path, kind="mcap"):
    """A bag that is being written."""
    if kind == "ros1":
        with Writer1(path) as writer:
            yield Bag(writer, True)
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        with Writer(path, version=9, storage_plugin=plugin) as writer:
            yield Bag(writer, False)


ROBOT, DISPLAY = "moveit_msgs/msg/RobotTrajectory", "moveit_msgs/msg/DisplayTrajectory"
DEFINED = {
    ROBOT: "trajectory_msgs/JointTrajectory joint_trajectory\nstring note\n",
    DISPLAY: "string model_id\nmoveit_msgs/RobotTrajectory[] trajectory\nfloat64 class\n",
}
NEWER = "std_msgs/Header header\nuint8 quality\nstring[] name\n" + "".join(
    f"float64[] {field}\n" for field in ("position", "velocity", "effort")
)


def defined(own, definitions):
    """Further types, or others instead of those of the distribution, in the store of a bag."""
    found = {}
    for kind, text in definitions.items():
        found |= get_types_from_msg(text, kind)
    store = get_typestore(Stores.EMPTY)
    store.register({name: one for name, one in own.store.fielddefs.items() if name not in found} | found)
    own.store = store


def display(own, logged, parts):
    """A message with several trajectories inside: times and positions of each."""
    types, robots = own.store.types, []
    for times, positions in parts:
        kept = []
        own.add, add = (lambda topic, kind, logged, message, kept=kept: kept.append(message)), own.add
        own.trajectory(logged, times, positions)
        own.add = add
        robots.append(types[ROBOT](kept[0], "x"))
    own.add("/display_planned_path", DISPLAY, logged, types[DISPLAY]("arm", robots, 1.5))


def file_of(folder, kind):
    return folder / ("run.bag" if kind == "ros1" else "run")


@pytest.mark.parametrize("kind", KINDS)
def test_joint_trajectory_is_read_as_its_points(tmp_path, kind):
    path = file_of(tmp_path, kind)
    with bag(path, kind) as own:
        own.trajectory(5.0, [0.0, 0.5, 1.5], POINTS)
    expected = Trajectory.from_points(np.array([0.0, 0.5, 1.5]), POINTS, np.zeros((3, 2)))
    times = np.linspace(0.0, 1.5, 31)
    for names, order in ((NAMES, [0, 1]), (NAMES[::-1], [1, 0])):
        motion = load_motion(path, names)
        np.testing.assert_allclose(motion.states(times)[0], expected.states(times)[0][:, order], atol=1e-14)
    single = path if kind == "ros1" else next(p for p in path.iterdir() if p.name != "metadata.yaml")
    assert load_motion(single, NAMES).end == expected.end  # a file alone, without its metadata


@pytest.mark.parametrize("kind", some(1, KINDS))
def test_joint_states_are_samples_in_si(tmp_path, kind):
    path = file_of(tmp_path, kind)
    with bag(path, kind) as own:
        for t, q in zip(TIMES, swing(TIMES), strict=True):
            own.state(1.7e9 + t, [9.0], names=["wheel"])  # of another publisher
            own.state(1.7e9 + t, q[::-1], names=NAMES[::-1])
    motion = load_motion(path, NAMES, ("rad", "m"))
    np.testing.assert_allclose(motion.states(TIMES)[0], swing(TIMES), atol=3e-6)  # a fit passes within 2e-6
    recording = read_recording(path, ARM)
    for signal, values in zip(recording.of("angles"), swing(TIMES).T, strict=True):
        np.testing.assert_allclose(signal.values, values, atol=1e-12)


def test_stamps_count_where_all_messages_have_one(tmp_path):
    rng = np.random.default_rng(0)
    for stamped in (True, False):
        path = tmp_path / f"run{stamped}"
        with bag(path) as own:
            for t, q in zip(TIMES, swing(TIMES), strict=True):
                late = t + (0.004 * rng.random() if stamped else 0.0)
                own.state(100 + late, q, stamp=50 + t if stamped else 0.0)
        np.testing.assert_allclose(read_recording(path, ARM).times, TIMES, atol=2e-9)


def test_wrenches_are_read_where_their_topic_is_named(tmp_path):
    path, load = tmp_path / "run", [1.0, 2.0, -30.0, 0.1, 0.2, 0.3]
    with bag(path) as own:
        for t, q in zip(TIMES, swing(TIMES), strict=True):
            own.state(10 + t, q, stamp=10 + t)
            own.wrench(10 + t, load)
            own.wrench(10 + t, [0.0] * 6, topic="/wrist/wrench")
    recording = read_recording(path, ARM, topics=["/sensor/wrench"])
    sensor = np.array([np.unique(signal.values) for signal in recording.of("sensor")]).ravel()
    np.testing.assert_array_equal(sensor, load)
    assert "/wrist/wrench" in recording.unknown
    assert read_recording(path, ARM).of("sensor") == []
    with pytest.raises(InputError, match="sensor in the base"):
        recording_in_bag(path, ["/sensor/wrench", "/wrist/wrench"])


@pytest.mark.parametrize("kind", some(1, KINDS))
def test_types_that_a_bag_defines_are_read_where_they_hold_a_trajectory(tmp_path, kind):
    path = file_of(tmp_path, kind)
    with bag(path, kind) as own:
        defined(own, DEFINED)
        display(own, 1.0, [([0.0, 0.5, 1.5], POINTS), ([0.0, 0.2, 0.9], 2 * POINTS)])
    with pytest.raises(InputError, match="topic /display_planned_path: has 2 trajectories"):
        load_motion(path, NAMES)
    for number, factor, end in ((1, 1, 1.5), (2, 2, 0.9)):
        motion = load_motion(path, NAMES, topic=f"/display_planned_path#{number}")
        np.testing.assert_allclose(motion.goal, factor * POINTS[-1])
        assert motion.end == pytest.approx(end)


@pytest.mark.parametrize("kind", some(1, KINDS))
def test_a_bag_is_read_by_its_own_definition_of_a_type(tmp_path, kind):
    path = file_of(tmp_path, kind)
    with bag(path, kind) as own:
        defined(own, {**DEFINED, JOINT_STATE: NEWER})
        display(own, 1.0, [([0.0, 0.5, 1.5], POINTS)])  # joint states go before what only holds a trajectory
        types = own.store.types
        for t, q in zip(TIMES, swing(TIMES), strict=True):
            fields = [np.array(x, dtype=float) for x in (q, [], [])]
            own.add("/joint_states", JOINT_STATE, t, types[JOINT_STATE](own.header(0.0), 7, NAMES, *fields))
    motion = load_motion(path, NAMES, ("rad", "m"))
    np.testing.assert_allclose(motion.states(TIMES)[0], swing(TIMES), atol=3e-6)
    assert load_motion(path, NAMES, topic="/display_planned_path").end == pytest.approx(1.5)


IDL = {
    JOINT_STATE: """
#include "std_msgs/msg/Header.idl"
module sensor_msgs {
  module msg {
    module JointState_Constants {
      const uint8 GOOD = 7;
    };
    @verbatim (language="comment", text=
      "This is a message that holds data to describe the state of a set of torque controlled joints.")
    struct JointState {
      std_msgs::msg::Header header;
      uint8 quality;
      sequence<string> name;
      sequence<double> position;
      @unit (value="rad/s")
      sequence<double> velocity;
      sequence<double> effort;
    };
  };
};
""",
    "std_msgs/msg/Header": """
#include "builtin_interfaces/msg/Time.idl"
module std_msgs {
  module msg {
    struct Header {
      builtin_interfaces::msg::Time stamp;
      string frame_id;
    };
  };
};
""",
    "builtin_interfaces/msg/Time": """
module builtin_interfaces {
  module msg {
    struct Time {
      int32 sec;
      uint32 nanosec;
    };
  };
};
""",
}


@pytest.mark.parametrize("kind", ["mcap", "sqlite3"])
def test_definitions_in_idl_are_those_of_the_messages(tmp_path, kind):
    """As ROS 2 records types that are made from IDL: each below a line of "=" and its name."""
    text = "".join(f"{'=' * 80}\nIDL: {name}{definition}" for name, definition in IDL.items())
    with bag(tmp_path / "run", kind) as own:
        defined(own, {JOINT_STATE: NEWER})
        how = {"msgdef": text, "rihs01": own.store.hash_rihs01(JOINT_STATE)}
        own.topics["/joint_states"] = own.writer.add_connection("/joint_states", JOINT_STATE, **how)
        state = own.store.types[JOINT_STATE]
        for t, q, v in zip(TIMES, swing(TIMES), speeds(TIMES), strict=True):
            fields = np.array(q), np.array(v), np.zeros(0)
            own.add("/joint_states", JOINT_STATE, t, state(own.header(0.0), 7, NAMES, *fields))
    assert b"IDL: sensor_msgs" in b"".join(p.read_bytes() for p in (tmp_path / "run").iterdir())
    table = recording_in_bag(tmp_path / "run")
    rows = np.array([[float(x) for x in row] for row in table.rows])
    columns = {name: rows[:, table.header.index(name)] for name in table.header}
    for joint, name in enumerate(NAMES):
        np.testing.assert_array_equal(columns[f"{name}.position"], swing(TIMES)[:, joint])
        np.testing.assert_array_equal(columns[f"{name}.velocity"], speeds(TIMES)[:, joint])


def test_definitions_that_cannot_be_read_matter_only_where_they_are_wanted(tmp_path):
    path = tmp_path / "run.bag"
    with bag(path, "ros1") as own:
        defined(own, {"a/msg/Odd": "string name_of_it\n"})
        own.add("/odd", "a/msg/Odd", 0.5, own.store.types["a/msg/Odd"]("x"))
        own.trajectory(5.0, [0.0, 0.5, 1.5], POINTS)
    data = path.read_bytes()
    assert data.count(b"string name_of_it") == 2  # at the connection and in the index
    path.write_bytes(data.replace(b"string name_of_it", b"st(ng) name_of_it"))
    assert load_motion(path, NAMES).end == pytest.approx(1.5)
    with pytest.raises(InputError, match="topic /odd: is Odd, expected JointTrajectory or JointState"):
        load_motion(path, NAMES, topic="/odd")


def test_one_of_several_trajectories_is_named(tmp_path):
    path = tmp_path / "run"
    with bag(path) as own:
        own.trajectory(1.0, [0.0, 1.0], POINTS[:2])
        own.trajectory(4.0, [0.0, 1.0], POINTS[1:])
        own.trajectory(4.0, [0.0, 1.0], POINTS[1:], topic="/other")
    with pytest.raises(InputError, match=r"/goal, /other .* name one by --topic"):
        load_motion(path, NAMES)
    with pytest.raises(InputError, match=r"2 trajectories, at 0.000, 3.000 s; .*/goal#1 to /goal#2"):
        load_motion(path, NAMES, topic="/goal")
    np.testing.assert_array_equal(load_motion(path, NAMES, topic="/goal#2").goal, POINTS[2])
    with pytest.raises(InputError, match="2 trajectories"):
        load_motion(path, NAMES, topic="/goal#3")


def test_written_bag_is_the_same_motion(tmp_path):
    path, columns = tmp_path / "out", {"GN": np.linspace(0.1, 0.4, 101)}
    points = [
        {
            "positions": q.tolist(),
            "velocities": [0.0, 0.0],
            "accelerations": [],
            "effort": [],
            "time_from_start": {"sec": k, "nanosec": 5 * 10**8},
        }
        for k, q in enumerate(POINTS, 0)
    ]
    points[0]["time_from_start"]["nanosec"] = 0
    joints = {"position": swing(TIMES), "velocity": speeds(TIMES), "effort": np.zeros((101, 2))}
    message = {"joint_names": NAMES, "points": points}
    write_bag(path, message, TIMES, joints, columns)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out"]
    assert sorted(p.name for p in path.iterdir()) == ["metadata.yaml", "out.mcap"]
    motion = load_motion(path, NAMES)
    np.testing.assert_array_equal(motion.points.angles, POINTS)
    np.testing.assert_array_equal(motion.points.times, [0.0, 1.5, 2.5])
    samples = load_motion(path, NAMES, ("rad", "m"), topic="/joint_states")
    np.testing.assert_allclose(samples.states(TIMES)[0], swing(TIMES), atol=3e-6)  # a fit passes within 2e-6
    with pytest.raises(InputError, match="exists; bags are not replaced"):
        write_bag(path, message, TIMES, joints, columns)


@pytest.mark.parametrize(
    ("topic", "message"),
    [
        ("/joint_state", r"did you mean '/joint_states'\?"),
        ("/sensor/wrench", "is WrenchStamped, expected JointTrajectory or JointState"),
        (None, "no message has elbow, wrist; joints: elbow, shoulder"),
    ],
)
def test_refusals_say_what_is_there(tmp_path, topic, message):
    path = tmp_path / "run"
    with bag(path) as own:
        own.state(1.0, [0.0, 0.0])
        own.wrench(1.0, [0.0] * 6)
    with pytest.raises(InputError, match=message) as caught:
        load_motion(path, ["elbow", "wrist"], topic=topic)
    assert caught.value.file == "run"


def test_names_and_numbers_must_be_as_many(tmp_path):
    with bag(tmp_path / "run") as own:
        own.state(1.0, [0.0, 0.0])
        own.state(2.0, [0.0])
    with pytest.raises(InputError, match="message 2: 2 names, but 1 numbers as position"):
        load_motion(tmp_path / "run", NAMES)


def test_topics_are_for_bags_and_columns_are_not(tmp_path):
    (tmp_path / "a.csv").write_text("time_s,q1_deg\n0,0\n1,0\n")
    with pytest.raises(InputError, match="topic: only for bags"):
        load_motion(tmp_path / "a.csv", topic="/joint_states")
    with bag(tmp_path / "run") as own:
        own.state(1.0, [0.0, 0.0])
    with pytest.raises(InputError, match="columns: not for bags"):
        load_motion(tmp_path / "run", columns={"q1_deg": 1})


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_cut_files_are_refused(tmp_path, kind, share):
    path = file_of(tmp_path, kind)
    with bag(path, kind) as own:
        for t, q in zip(TIMES, swing(TIMES), strict=True):
            own.state(t, q)
    file = path if kind == "ros1" else next(p for p in path.iterdir() if p.name != "metadata.yaml")
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    with pytest.raises(InputError, match=r"broken bag|has no topic"):
        load_motion(path, NAMES, ("rad", "m"))


def test_nothing_outside_the_folder_is_opened(tmp_path):
    with bag(tmp_path / "real") as own:
        own.trajectory(1.0, [0.0, 1.0], POINTS[:2])
    linked = tmp_path / "linked"
    linked.mkdir()
    (linked / "metadata.yaml").write_bytes((tmp_path / "real" / "metadata.yaml").read_bytes())
    (linked / "real.mcap").symlink_to(tmp_path / "real" / "real.mcap")
    with pytest.raises(InputError, match="symbolic link"):
        load_motion(linked, NAMES)
    (linked / "real.mcap").unlink()
    os.mkfifo(linked / "real.mcap")
    with pytest.raises(InputError, match="is a pipe"):
        load_motion(linked, NAMES)


def test_metadata_that_explode_are_refused(tmp_path):
    bomb = "a: &a [" + "1," * 9 + "1]\n" + "".join(f"b{k}: &b{k} [{'*a,' * 9}*a]\n" for k in range(1))
    bomb += "".join(f"c{k}: &c{k} [{f'*c{k - 1},' * 9 if k else '*b0,' * 9}1]\n" for k in range(9))
    (tmp_path / "metadata.yaml").write_text(bomb)
    with pytest.raises(InputError, match="aliases"):
        load_motion(tmp_path, NAMES)
