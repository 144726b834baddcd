"""One motion in the CSV dialects of public recorders and programs, written as these write it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

NAMES = ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "j[6]"]
EPOCH = 1653666006.02841
TIMES = 0.01 * np.arange(101)
GOALS = np.array([0.5, -0.7, 0.9, -1.1, 1.3, -0.2])


def truth(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and speeds (N, 6), rad and rad/s: from rest to rest within a second."""
    s = np.clip(times, 0, 1)[:, None]
    return GOALS * s**3 * (10 - 15 * s + 6 * s**2), GOALS * 30 * s**2 * (1 - s) ** 2


Q, V = truth(TIMES)
INDEX = range(6)


def table(header: list[str], rows: list[list], separator: str = ",") -> str:
    """A file's text; numbers with six digits."""
    cells = [[cell if isinstance(cell, str) else f"{cell:.6f}" for cell in row] for row in rows]
    return "\n".join(separator.join(row) for row in [header, *cells]) + "\n"


def plain(times: list, extra: Callable[[int], list] = lambda k: []) -> list[list]:
    """Rows of times, positions, and more."""
    return [
        [*t, *Q[k], *extra(k)] if isinstance(t, list) else [t, *Q[k], *extra(k)] for k, t in enumerate(times)
    ]


def speeds(k: int) -> list:
    """The speeds of a row."""
    return list(V[k])


NUMBERED = ["time_s", *(f"q{j + 1}_rad" for j in INDEX)]
STAMPS = [divmod(round((t + EPOCH) * 1e9), 10**9) for t in TIMES]
RTDE = ["timestamp", *(f"actual_q_{j}" for j in INDEX), *(f"actual_qd_{j}" for j in INDEX)]


def rostopic(order: list[int]) -> str:
    """`rostopic echo -p`: names in cells, in an order of their own."""
    fields = [f"field.{word}{j}" for word in ("name", "position", "velocity", "effort") for j in INDEX]
    header = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id", *fields]
    rows = [
        [f"{(t + EPOCH) * 1e9:.0f}", str(k), f"{(t + EPOCH) * 1e9:.0f}", "", *(NAMES[j] for j in order),
         *Q[k, order], *V[k, order], *np.zeros(6)]
        for k, t in enumerate(TIMES)
    ]  # fmt: skip
    return table(header, rows)


def plotjuggler() -> str:
    """Joints and a sensor in lines of their own; names in alphabetical order."""
    order = sorted(INDEX, key=lambda j: NAMES[j])
    names = [f"/joint_states/{NAMES[j]}/{word}" for j in order for word in ("effort", "position", "velocity")]
    header = ["__time", "/joint_states/header/stamp", *names, "/fts/wrench/force/x"]
    rows = []
    for k, t in enumerate(TIMES):
        cells = [value for j in order for value in (0.0, Q[k, j], V[k, j])]
        rows.append([t + EPOCH, t + EPOCH, *cells, ""])
        rows.append([t + EPOCH + 0.004, "", *[""] * 18, -247.884208])
    return table(header, rows)


def long() -> str:
    """A line per joint and time."""
    rows = [[t, NAMES[j], Q[k, j], V[k, j]] for k, t in enumerate(TIMES) for j in INDEX]
    return table(["time", "joint", "position", "velocity"], rows)


DIALECTS = {
    "rtde": table(RTDE, plain([t + 960.949 for t in TIMES], speeds), " "),
    "rtde with commas": table(RTDE, plain([t + 960.949 for t in TIMES], speeds)),
    "rtde with set points": table(
        [*RTDE[:7], *(f"actual_TCP_pose_{j}" for j in INDEX)], plain(list(TIMES), lambda k: [0.0] * 6)
    ),
    "rostopic": rostopic(list(INDEX)),
    "rostopic in another order": rostopic([2, 1, 0, 3, 4, 5]),
    "sec and nanosec": table(
        ["header.stamp.sec", "header.stamp.nanosec", *(f"position.{name}" for name in NAMES)],
        plain([[str(s), str(ns)] for s, ns in STAMPS]),
    ),
    "secs and nsecs": table(["secs", "nsecs", *NAMES], plain([[str(s), str(ns)] for s, ns in STAMPS])),
    "plotjuggler": plotjuggler(),
    "franka": table(
        ["time", "success_rate", *(f"q[{j}]" for j in INDEX), *(f"dq[{j}]" for j in INDEX)],
        plain([[t, 1.0] for t in TIMES], speeds),
    ),
    "german": table(NUMBERED, plain(list(TIMES)), ";").replace(".", ","),
    "byte order mark": "\ufeff" + table(NUMBERED, plain(list(TIMES))),
    "tabs": table(NUMBERED, plain(list(TIMES)), "\t"),
    "long": long(),
    "pos and vel": table(
        ["timestamp", *(f"{n}_pos" for n in NAMES), *(f"{n}_vel" for n in NAMES)], plain(list(TIMES), speeds)
    ),
    "savetxt": "# a motion\n# " + table(NUMBERED, plain(list(TIMES))),
    "counted from 1": table(
        ["time", *(f"q{j + 1}" for j in INDEX), *(f"qd{j + 1}" for j in INDEX), "x", "R_x"],
        plain(list(TIMES), lambda k: [*V[k], 0.0, 0.0]),
    ),
    "counted from 0": table(["time", *(f"q{j}" for j in INDEX)], plain(list(TIMES))),
    "position[0]": table(["t", *(f"joint_states.position[{j}]" for j in INDEX)], plain(list(TIMES))),
    "position[1]": table(["t", *(f"position[{j + 1}]" for j in INDEX)], plain(list(TIMES))),
    "position[name]": table(["t", *(f"/joint_states/position[{name}]" for name in NAMES[:5]), "j[6]"],
        plain(list(TIMES))),
    "dates": table(
        ["time", *NAMES], plain([f"2024-07-14T11:09:{18 + t:09.6f}" for t in TIMES])
    ),
    "epoch": table(["time", *NAMES], plain([t + EPOCH for t in TIMES])),
    "epoch in ms": table(["timestamp", *NAMES], plain([f"{(EPOCH + t) * 1e3:.0f}" for t in TIMES])),
    "epoch in us": table(["timestamp", *NAMES], plain([f"{(EPOCH + t) * 1e6:.0f}" for t in TIMES])),
    "epoch in ns": table(["timestamp", *NAMES], plain([f"{(EPOCH + t) * 1e9:.0f}" for t in TIMES])),
    "commas at the end": table(NUMBERED, plain(list(TIMES))).replace("\n", ",\n"),
    "capital": table(["Time", *NAMES], plain(list(TIMES))),
}  # fmt: skip

COARSE = {"epoch in ms"}
"""Dialects whose times are rounded to ms."""

UNCLEAR = {
    "no header": (
        table(["0.0", *["0.0"] * 6], plain(list(TIMES[1:]))),
        "line 1: expected names of columns, got numbers; .*--columns",
    ),
    "from 0 or 1": (
        table(["time", *(f"q[{j}]" for j in range(1, 6))], [[t, *Q[k, 1:]] for k, t in enumerate(TIMES)]),
        "are joints counted from 0 or from 1",
    ),
    "points and commas": (
        table(NUMBERED, plain(list(TIMES)), ";").replace(".", ",", 60),
        "has a decimal point, line .* has decimal commas",
    ),
    "commas only": (
        table(NUMBERED, plain(list(TIMES))).replace(".", ","),
        "line 2: expected 7 values as in the header, got 14",
    ),
    "two clocks": (
        table(["time", "t", *NAMES], plain([[t, t] for t in TIMES])),
        "expected one column time_s",
    ),
    "two names": (
        table(["t", *(f"{a}_q_{j}" for a in ("actual", "measured") for j in INDEX)],
              plain(list(TIMES), lambda k: list(Q[k]))),
        "actual_q_0 and measured_q_0 are the same quantity",
    ),
    "two signs": (
        "time_s;a,q1_rad\n0;1,2\n1;2,3\n",
        "semicolons or commas may part its columns",
    ),
    "joints change": (
        rostopic(list(INDEX)).replace(f"{NAMES[0]},{NAMES[1]}", f"{NAMES[1]},{NAMES[0]}", 5),
        "expected one order of joints",
    ),
    "joint twice": (
        long().replace(f"0.000000,{NAMES[1]}", f"0.000000,{NAMES[0]}", 1),
        "line 3: shoulder_pan_joint again, at the same time",
    ),
    "a hole": (
        table(NUMBERED, plain(list(TIMES))).replace("0.010000,0.0", "0.010000,,0.0", 0).replace(
            f"{TIMES[50]:.6f},{Q[50, 0]:.6f}", f"{TIMES[50]:.6f},"
        ),
        "line 52, q1_rad: expected a number, got ''",
    ),
    "date and number": (
        table(["time", *NAMES], plain(["2024-07-14T11:09:18.0", *TIMES[1:].tolist()])),
        "line 3, time: expected a date like 2024-07-14T11:09:18.0, got '0.010000'",
    ),
}  # fmt: skip
