"""A three-joint arm in a plane, and boxes that its straight motion would hit."""

from __future__ import annotations

from pathlib import Path

from ocptip.motion.task import MotionTask
from ocptip.task_files.motion import load_task

LINK = """
<link name="{name}"><inertial><origin xyz="{middle} 0 0"/><mass value="2"/>
<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="{middle} 0 0"/>
<geometry><box size="{length} 0.06 0.06"/></geometry></collision></link>
<joint name="j{number}" type="revolute"><parent link="{before}"/><child link="{name}"/>
<origin xyz="{at} 0 0"/><axis xyz="0 0 1"/>
<limit lower="-2.9" upper="2.9" effort="80" velocity="2"/></joint>"""
WALL = 'kind = "box"\nsize = [0.3, 0.02, 0.3]\nposition = [0.75, 0.0, 0.5]\n'
"""A thin wall in front of the arm, out of its reach only when it is folded."""


def task_file(folder: Path, walls: tuple[str, ...] = (WALL,), more: str = "", limits: str = "") -> Path:
    """The task: from the right of the wall to its left; straight, the arm goes through the wall."""
    links, before, at = "", "base", 0.0
    for number, length in enumerate((0.4, 0.35, 0.2), 1):
        link = {"name": f"link{number}", "length": length - 0.08, "middle": length / 2}
        links += LINK.format(number=number, before=before, at=at, **link)
        before, at = f"link{number}", length
    (folder / "arm.urdf").write_text(f'<robot name="three"><link name="base"/>{links}</robot>')
    text = f"""name = "three joints"
[base]
mass = 150.0
center_of_mass = [0.0, 0.0, 0.2]
feet = [[0.3, 0.3, 0.0], [0.3, -0.3, 0.0], [-0.3, -0.3, 0.0], [-0.3, 0.3, 0.0]]
friction = 0.6
[arm]
urdf = "arm.urdf"
mount_position = [0.0, 0.0, 0.5]
[arm.limits]
acceleration_deg_s2 = 300.0
[motors]
kind = "estimated"
[motion]
start_deg = [-45.0, 10.0, 10.0]
goal_deg = [45.0, -10.0, -10.0]
{more}[tolerance]
preset = "none"
[limits]
clearance = 0.005
{limits}"""
    text += "".join(f"[[obstacle]]\n{wall}" for wall in walls)
    path = folder / "task.toml"
    path.write_text(text)
    return path


def task_among(folder: Path, *walls: str, limits: str = "") -> MotionTask:
    """The task among these walls, or the usual one."""
    return load_task(task_file(folder, walls or (WALL,), limits=limits))
