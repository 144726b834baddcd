"""A plan as a bag: its trajectory and margins over time are those of the folder and of the check."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("rosbags")
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from ocptip.cli.main import main
from ocptip.trajectories.read import load_motion
from tests.motion.test_task import TWO_JOINTS, URDF

ONE = ["--starts", "1", "--jobs", "1", "--tolerance", "none", "--no-figures"]


def columns(path):
    """Numbers of the topics /ocptip/NAME by name."""
    store, found = get_typestore(Stores.ROS2_HUMBLE), {}
    with Reader(path) as reader:
        for connection, _, raw in reader.messages():
            if connection.topic.startswith("/ocptip/"):
                name = connection.topic.rpartition("/")[2]
                found.setdefault(name, []).append(store.deserialize_cdr(raw, connection.msgtype).data)
    return {name: np.array(values) for name, values in found.items()}


def test_plan_and_check_write_the_same_bag(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "two.urdf").write_text(TWO_JOINTS, encoding="utf-8")
    (tmp_path / "task.toml").write_text(URDF, encoding="utf-8")
    assert main(["plan", "task.toml", *ONE, "--out", "plan", "--bag", "planned"]) == 0
    assert "are in the bag planned" in " ".join(capsys.readouterr().out.split())
    assert main(["check", "plan", "--bag", "checked", "--json"]) == 0
    worst = json.loads(capsys.readouterr().out)["worst"]
    planned, checked = columns("planned"), columns("checked")
    assert planned.keys() == checked.keys() >= {"GN", "GT"}
    for name, values in planned.items():
        np.testing.assert_allclose(values, checked[name], rtol=1e-6, atol=1e-9)
    for name in ("GN", "GT"):
        assert np.nanmax(planned[name]) == pytest.approx(worst[name]["value"], rel=0.01)
    names, plan = ["hip", "knee"], load_motion("plan/trajectory.json", ["hip", "knee"])
    motion, times = load_motion("planned", names), np.linspace(0, plan.end, 101)
    np.testing.assert_allclose(motion.states(times)[0], plan.states(times)[0], atol=1e-6)
    assert main(["plan", "task.toml", *ONE, "--bag", "planned"]) == 2
    assert "--bag: planned: exists; bags are not replaced" in capsys.readouterr().err
    assert main(["plan", "task.toml", "A", *ONE, "--bag", "more"]) == 2
    assert "--bag: is for one task, got 2" in capsys.readouterr().err
