"""Bags of ROS 1 (`.bag`) and ROS 2 (folders, `.db3`, `.mcap`), read and written through `rosbags`.

The extra `bags` installs it. A message of another type that holds a joint trajectory (`DisplayTrajectory`,
the goal of an action) counts as that.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.read import NO_SPACE, only_inside, parse_yaml, read_text, require_readable
from ocptip.basics.text import did_you_mean, some
from ocptip.trajectories.bag_types import (
    TRAJECTORY,
    fields_to_trajectory,
    messages_inside,
    rosbags_package,
    store_of,
)
from ocptip.trajectories.csv_text import TextTable

JOINT_STATE = "sensor_msgs/msg/JointState"
WRENCH = "geometry_msgs/msg/WrenchStamped"
FLOAT = "std_msgs/msg/Float64"
TWISTS = ("geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/Twist", "nav_msgs/msg/Odometry")
_HOLDER = "message that holds a JointTrajectory"
"""Stands for all types that are defined in a bag and have a joint trajectory inside."""

MOST_MESSAGES = 2_000_000
"""Messages that are read: 30 minutes at 1 kHz."""

_MOST_BYTES = 2**44  # a bag with camera images is large, but only the wanted topics are loaded
_METADATA = "metadata.yaml"
_FIELDS = ("position", "velocity", "effort")
_AXES = [(part, axis) for part in ("force", "torque") for axis in "xyz"]
_BEGIN = 10**9  # ns: stamp of the first message written; ROS takes a stamp of 0 for "not set"


def is_bag(path: str | os.PathLike[str]) -> bool:
    """Whether a file or folder is a bag, by its ending or its metadata."""
    path = Path(path)
    return path.suffix.lower() in (".bag", ".db3", ".mcap") or (path / _METADATA).is_file()


def refuse_of_other_files(bag: bool, topics: Sequence[str], columns: Mapping[str, str | int] | None) -> None:
    """Refuse topics of a file that is no bag, and columns of one that is."""
    if topics and not bag:
        raise InputError("topic: only for bags (.bag, .db3, .mcap, or a folder with metadata.yaml)", "")
    if columns and bag:
        raise InputError("columns: not for bags, whose messages name their fields", "")


def motion_in_bag(
    path: str | os.PathLike[str], names: Sequence[str] | None, topic: str | None = None
) -> dict[str, Any] | TextTable:
    """The joint trajectory in a bag, as its message in plain data, or the samples of its joint states.

    Args:
        path: of the bag.
        names: of the robot's joints: of joint states only messages with all of them count.
        topic: to be read, `/NAME` or, of several trajectories, `/NAME#2`. None: the only topic of joint
            trajectories, or else the only one of joint states, or else of messages that hold a trajectory.

    Raises:
        InputError: it cannot be read, or it is unclear which message is meant; names the bag.
    """
    name, _, number = (topic or "").partition("#")
    with _opened(path) as bag:
        kinds = (TRAJECTORY, JOINT_STATE, _HOLDER)
        chosen = bag.named(name, kinds) if name else bag.only(kinds)
        messages = list(bag.messages([chosen]))
        if bag.kind(chosen) != JOINT_STATE:
            return _plain(_one([m for *_, m in messages], [t for _, t, _ in messages], chosen, number))
        joints = set(names or ())
        kept = [one for one in messages if joints <= set(one[2].name)]
        if not kept:
            there = sorted({name for *_, message in messages for name in message.name})
            raise InputError(f"topic {chosen}: no message has {some(sorted(joints))}; joints: {some(there)}")
        table = _table(kept)
        full = [k for k in range(len(table.header)) if all(table.texts(k))]
        rows = [[row[k] for k in full] for row in table.rows]
        return TextTable([table.header[k] for k in full], rows, table.lines)


def recording_in_bag(path: str | os.PathLike[str], topics: Sequence[str] = ()) -> TextTable:
    """Samples of joint states, and of the wrenches whose topic is named.

    A wrench may be that of a wrist, so that none is read unless it is named.

    Args:
        path: of the bag.
        topics: of joint states and wrenches; joint states: by default the only topic that has them.

    Raises:
        InputError: see :func:`motion_in_bag`.
    """
    with _opened(path) as bag:
        chosen = [bag.named(name, (JOINT_STATE, WRENCH)) for name in topics]
        if not any(bag.topics[name] == JOINT_STATE for name in chosen):
            chosen.append(bag.only((JOINT_STATE,)))
        wrenches = [name for name in chosen if bag.topics[name] == WRENCH]
        if len(wrenches) > 1:
            raise InputError(f"topic: {some(wrenches)} are wrenches; name that of the sensor in the base")
        others = [name for name, kind in bag.topics.items() if kind == WRENCH and name not in chosen]
        return _table(list(bag.messages(chosen)), others)


def twists_in_bag(path: str | os.PathLike[str], topic: str | None = None) -> TextTable:
    """Velocities of a base: commands, or odometry.

    Args:
        path: of the bag.
        topic: of one of `TWISTS`; None: the only topic of the first of these types that is there.

    Raises:
        InputError: see :func:`motion_in_bag`.
    """
    with _opened(path) as bag:
        chosen = bag.named(topic, TWISTS) if topic else bag.only(TWISTS)
        return _table(list(bag.messages([chosen])))


def write_bag(
    path: str | os.PathLike[str],
    trajectory: Mapping[str, Any],
    times: np.ndarray,
    joints: Mapping[str, np.ndarray],
    columns: Mapping[str, np.ndarray],
) -> None:
    """Write a bag of ROS 2 (MCAP): a joint trajectory, joint states, and numbers over time.

    Topics: `/joint_trajectory` once, `/joint_states`, and `/ocptip/NAME` (`std_msgs/Float64`) per column.
    Stamps count from 1 s.

    Args:
        path: of the folder, which must not exist.
        trajectory: message in plain data.
        times: (N,), s.
        joints: `position`, `velocity`, `effort`, (N, n) each, rad, m, N m, N.
        columns: values (N,) by name.

    Raises:
        InputError: the folder exists, or nothing can be written there.
    """
    path = Path(path)
    require_new(path)
    rosbags = rosbags_package()
    store, types = rosbags.store, rosbags.store.types
    header_type, stamp_type = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]

    def header(time: int) -> Any:
        return header_type(stamp=stamp_type(*divmod(time, 10**9)), frame_id="")

    stamps = [_BEGIN + round(1e9 * time) for time in times.tolist()]
    names = list(trajectory["joint_names"])
    try:
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".ocptip-") as scratch:
            unfinished = Path(scratch) / path.name  # a bag is complete, or not there
            with rosbags.writer(unfinished, version=9, storage_plugin=rosbags.mcap) as bag:

                def add(topic: str, kind: str, messages: Sequence[tuple[int, Any]]) -> None:
                    connection = bag.add_connection(topic, kind, typestore=store)
                    for time, message in messages:
                        bag.write(connection, time, store.serialize_cdr(message, kind))

                points = [_point(types, point) for point in trajectory["points"]]
                message = types[TRAJECTORY](header=header(0), joint_names=names, points=points)
                add("/joint_trajectory", TRAJECTORY, [(_BEGIN, message)])
                rows = (np.ascontiguousarray(joints[field], dtype=float) for field in _FIELDS)
                states = zip(*rows, stamps, strict=True)
                state = types[JOINT_STATE]
                add("/joint_states", JOINT_STATE, [(t, state(header(t), names, *v)) for *v, t in states])
                for name, values in columns.items():
                    numbers = zip(stamps, map(types[FLOAT], values.tolist()), strict=True)
                    add(f"/ocptip/{name}", FLOAT, list(numbers))
            os.rename(unfinished, path)
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror or error}", "", str(path)) from None


def require_new(path: str | os.PathLike[str]) -> None:
    """Refuse, before anything is computed, a folder of a bag that exists or that cannot be made.

    Raises:
        InputError: it exists, its parent does not, or `rosbags` is missing.
    """
    path = Path(path)
    if path.exists() or path.is_symlink():
        raise InputError("exists; bags are not replaced, name a new folder", "", str(path))
    if not path.parent.is_dir():
        raise InputError(f"no such directory: {path.parent}", "", str(path))
    rosbags_package()


@dataclass(frozen=True, eq=False)
class _Bag:
    """An open bag.

    Attributes:
        reader: of `rosbags`.
        decode: by id of a connection, a message out of its bytes and type.
        topics: types by name, of topics that have messages of one type.
        inner_fields: fields to the joint trajectory inside the messages of a topic, by its name.
    """

    reader: Any
    decode: dict[int, Callable[[bytes, str], Any]]
    topics: dict[str, str]
    inner_fields: dict[str, tuple[str, ...]]

    def kind(self, name: str) -> str:
        """What the messages of a topic are read as."""
        return _HOLDER if name in self.inner_fields else self.topics[name]

    def named(self, name: str, kinds: Sequence[str]) -> str:
        """A topic that is named; InputError if it is not there or has another type."""
        if name not in self.topics:
            known = did_you_mean(name, self.topics) or f"; topics: {self._list()}"
            raise InputError(f"topic: no {name!r}{known}")
        if self.kind(name) not in kinds:
            wanted = " or ".join(map(_short, kinds))
            raise InputError(f"topic {name}: is {_short(self.topics[name])}, expected {wanted}")
        return name

    def only(self, kinds: Sequence[str]) -> str:
        """The only topic of the first of these types that any topic has."""
        for kind in kinds:
            there = [name for name in self.topics if self.kind(name) == kind]
            if len(there) > 1:
                raise InputError(f"topic: {some(there)} are of type {_short(kind)}; name one by --topic")
            if there:
                return there[0]
        wanted = " or ".join(map(_short, kinds))
        raise InputError(f"has no topic of type {wanted}; topics: {self._list()}")

    def messages(self, topics: Sequence[str]) -> Iterator[tuple[str, int, Any]]:
        """Topic, time in ns and message; stamps are the times where all messages have one."""
        connections = [one for one in self.reader.connections if one.topic in topics]
        read = []
        for number, (connection, time, raw) in enumerate(self.reader.messages(connections)):
            if number >= MOST_MESSAGES:
                raise InputError(f"has more than {MOST_MESSAGES:,} messages on {some(topics)}")
            message = self.decode[connection.id](raw, connection.msgtype)
            fields = messages_inside(message, self.inner_fields.get(connection.topic, ()))
            read += [(connection.topic, time, one) for one in fields]
        stamps = [_stamp_of(message) for *_, message in read]
        if all(stamps):
            read = [(topic, stamp, m) for (topic, _, m), stamp in zip(read, stamps, strict=True)]
        yield from sorted(read, key=lambda one: one[1])

    def _list(self) -> str:
        return some([f"{name} ({_short(kind)})" for name, kind in self.topics.items()]) or "none"


@contextmanager
def _opened(path: str | os.PathLike[str]) -> Iterator[_Bag]:
    """A bag whose files are regular and inside its folder; every refusal names it."""
    path = Path(path)
    try:
        _require_regular(path)
        rosbags = rosbags_package()
        old = path.suffix.lower() == ".bag"
        with (rosbags.reader1 if old else rosbags.reader)(path) as reader:
            usual = rosbags.store1() if old else rosbags.store
            kinds: dict[str, set[str]] = {}
            decode, inner_fields = {}, {}
            for one in reader.connections:
                if one.msgcount:
                    kinds.setdefault(one.topic, set()).add(one.msgtype)
                    store = store_of(one, usual)
                    decode[one.id] = store.deserialize_ros1 if old else store.deserialize_cdr
                    known = one.msgtype in store.fielddefs
                    if known and (result := fields_to_trajectory(store.fielddefs, one.msgtype, set())):
                        inner_fields[one.topic] = result
            topics = {name: min(types) for name, types in kinds.items() if len(types) == 1}
            yield _Bag(reader, decode, topics, inner_fields)
    except InputError as error:
        raise error if error.file else InputError(error.text, error.path, path.name) from None
    except MemoryError:
        raise
    except Exception as error:  # whatever a decoder makes of a file that is damaged, or made to harm
        if isinstance(error, OSError) and error.errno in NO_SPACE:
            raise
        raise InputError(f"broken bag: {type(error).__name__}: {error}", "", path.name) from None


def _require_regular(path: Path) -> None:
    """Refuse pipes, devices, links out of a bag's folder, and metadata that are too deep or too large."""
    if not path.is_dir():
        require_readable(path, _MOST_BYTES)
        return
    with only_inside(path):
        parse_yaml(read_text(path / _METADATA))
        for file in sorted(path.iterdir()):
            if file.suffix.lower() in (".db3", ".mcap", ".zstd"):
                require_readable(file, _MOST_BYTES)


def _one(messages: Sequence[Any], times: Sequence[int], topic: str, number: str) -> Any:
    """The trajectory that is meant of those of a topic."""
    if not number and len(messages) == 1:
        return messages[0]
    if number.isdecimal() and 1 <= int(number) <= len(messages):
        return messages[int(number) - 1]
    seconds = [f"{1e-9 * (time - times[0]):.3f}" for time in times]
    raise InputError(
        f"topic {topic}: has {len(messages)} trajectories, at {some(seconds)} s; "
        f"name one by --topic {topic}#1 to {topic}#{len(messages)}"
    )


def _stamp_of(message: Any) -> int:
    """Time in ns of a message, 0 where it has none."""
    if message.__msgtype__ == TWISTS[1]:
        return 0
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def _short(kind: str) -> str:
    """A type without its package."""
    return kind.rpartition("/")[2]


def _plain(message: Any) -> dict[str, Any]:
    """A joint trajectory as JSON would hold it."""
    fields = ("positions", "velocities", "accelerations")
    return {
        "joint_names": list(message.joint_names),
        "points": [
            {
                **{field: getattr(point, field).tolist() for field in fields},
                "time_from_start": {
                    "sec": point.time_from_start.sec,
                    "nanosec": point.time_from_start.nanosec,
                },
            }
            for point in message.points
        ],
    }


def _point(types: Mapping[str, Any], point: Mapping[str, Any]) -> Any:
    duration = types["builtin_interfaces/msg/Duration"](**point["time_from_start"])
    fields = ("positions", "velocities", "accelerations", "effort")
    arrays = [np.array(point[field], dtype=float) for field in fields]
    return types["trajectory_msgs/msg/JointTrajectoryPoint"](*arrays, duration)


def _table(messages: Sequence[tuple[str, int, Any]], others: Sequence[str] = ()) -> TextTable:
    """One row per message, as a CSV file would have it; empty columns for topics that are not read."""
    samples, columns = [], dict[str, None]()
    for number, (topic, time, message) in enumerate(messages, 1):
        cells = _cells_of(message, f"topic {topic}, message {number}")
        columns |= dict.fromkeys(cells)
        samples.append((time, cells))
    begin = samples[0][0] if samples else 0
    rows = [[f"{1e-9 * (t - begin):.9f}", *(c.get(name, "") for name in columns)] for t, c in samples]
    rows = [[*row, *[""] * len(others)] for row in rows]
    return TextTable(["time_s", *columns, *others], rows, list(range(1, len(rows) + 1)))


def _cells_of(message: Any, where: str) -> dict[str, str]:
    """Titles and numbers of a message."""
    if message.__msgtype__ == WRENCH:
        return {f"{part}.{axis}": repr(getattr(getattr(message.wrench, part), axis)) for part, axis in _AXES}
    if message.__msgtype__ in TWISTS:
        while hasattr(message, "twist"):
            message = message.twist
        cells = {f"linear.{axis}": repr(getattr(message.linear, axis)) for axis in "xy"}
        return {**cells, "angular.z": repr(message.angular.z)}
    cells = {}
    for field in _FIELDS:
        values = getattr(message, field).tolist()
        if values and len(values) != len(message.name):
            raise InputError(f"{where}: {len(message.name)} names, but {len(values)} numbers as {field}")
        cells |= {f"{name}.{field}": repr(x) for name, x in zip(message.name, values, strict=bool(values))}
    return cells
