"""Types of messages in bags, by the package `rosbags`: those of the ROS distributions, or of the bag itself.

Messages have the types of the distributions unless a bag brings other definitions along. Those are used:
`rosbags` parses them and makes Python classes of them. Its grammar allows nothing but names and numbers
there; constants, which may be texts, are left out before.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

from ocptip.basics.errors import InputError

TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"


@dataclass(frozen=True)
class Rosbags:
    """The parts of the package rosbags that are used."""

    reader: Any
    reader1: Any
    writer: Any
    mcap: Any
    store: Any
    store1: Callable[[], Any]
    empty: Callable[[], Any]
    unreadable: type[Exception]
    parsers: Mapping[str, Callable[..., dict[str, Any]]]


@cache
def rosbags_package() -> Rosbags:
    """The package, loaded once: making its classes of messages takes half a second."""
    try:
        from rosbags import rosbag1, rosbag2, typesys
    except ImportError:
        raise InputError("bags need the package rosbags: pip install 'ocptip[bags]'", "") from None

    made, stores = typesys.get_typestore, typesys.Stores
    store1 = cache(partial(made, stores.ROS1_NOETIC))  # made only where a bag of ROS 1 is read
    idl = typesys.get_types_from_idl
    parsers = {"MSG": typesys.get_types_from_msg, "IDL": lambda text, _: _of_idl(idl, text)}
    store, empty, mcap = made(stores.ROS2_HUMBLE), partial(made, stores.EMPTY), rosbag2.StoragePlugin.MCAP
    readers = rosbag2.Reader, rosbag1.Reader
    return Rosbags(*readers, rosbag2.Writer, mcap, store, store1, empty, typesys.TypesysError, parsers)


def _of_idl(parse: Callable[[str], dict[str, Any]], text: str) -> dict[str, Any]:
    """Types of definitions in IDL, each below a line of "=" and its name."""
    parts = text.split(f"{'=' * 80}\n")[1:] or [text]
    results = [parse(part.split("\n", 1)[1] if part.startswith("IDL: ") else part) for part in parts]
    return {name: types_here for types in results for name, types_here in types.items()}


def store_of(connection: Any, usual: Any) -> Any:
    """The types of a connection: the usual ones where the bag has no others that can be read."""
    rosbags, form = rosbags_package(), connection.msgdef.format.name
    if form not in rosbags.parsers:
        return usual
    store = rosbags.empty()
    try:
        result = rosbags.parsers[form](connection.msgdef.data, connection.msgtype)
        if all(
            _fields(usual.fielddefs.get(name)) == _fields(type_here) for name, type_here in result.items()
        ):
            return usual
        store.register({name: ([], fields) for name, (_, fields) in result.items()})
    except rosbags.unreadable:
        return usual  # of a topic that is not wanted this must not matter
    return store


def _fields(definition: Any) -> Any:
    """Names and types of the fields of a type, in their order; None: there is no such type."""
    return None if definition is None else [(name.lower(), kind) for name, kind in definition[1]]


def fields_to_trajectory(types: Mapping[str, Any], kind: str, seen: set[str]) -> tuple[str, ...]:
    """The fields that lead from a type to a joint trajectory inside; empty: there is none.

    Types that have been `seen` lead to none.
    """
    seen.add(kind)
    for name, (form, of) in types[kind][1]:
        inner: Any = of if isinstance(of, str) else of[0][1] if form > 2 else None
        if inner == TRAJECTORY:
            return (name,)
        unseen = isinstance(inner, str) and inner in types.keys() - seen
        if unseen and (further := fields_to_trajectory(types, inner, seen)):
            return (name, *further)
    return ()


def messages_inside(message: Any, path: Sequence[str]) -> list[Any]:
    """What the fields of a message lead to; lists of messages have several."""
    results = [message]
    for field in path:
        values = [getattr(item, field) for item in results]
        results = [one for value in values for one in (value if isinstance(value, list) else [value])]
    return results
