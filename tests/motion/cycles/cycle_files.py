"""A task file of a cycle: a modular arm on three feet swings out, and back with a load."""

from __future__ import annotations

from tests.motion.test_task import FEET

CYCLE = (
    'name = "swing"\n'
    + FEET
    + """\
[arm]
name = "FP1W2F"
mount_position = [0, 0, 0]
[payload.part]
mass = 1.0
[[obstacle]]
kind = "floor"
height = -0.14
[motion]
start_deg = [-40, 35, -18, 45, -37, 180]
optimised = [1, 2]
commands = 2
[[segment]]
name = "out"
goal_deg = [20, 30, -8, 45, -18, 150]
dwell = 0.3
[[segment]]
name = "back"
payload = "part"
goal = "start"
"""
)


def written(folder, text=CYCLE, name="swing.toml"):
    """The file."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path
