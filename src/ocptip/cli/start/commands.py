"""What can be typed under `start`: the commands and their arguments."""

from __future__ import annotations

from ocptip.cli.arguments import BASE_LINK, TOOL_FRAME, argument
from ocptip.cli.command import Command

COMMANDS = (
    Command(
        "init",
        "write a task file for the arm of a URDF",
        "Writes a task file with all that the URDF tells. Fill in the lines marked #>, then plan.",
        "0 written",
        (
            argument("robot", "ROBOT.urdf", "the robot; also a xacro file or a MuJoCo model"),
            BASE_LINK,
            TOOL_FRAME,
            argument("--xacro", "NAME:=VALUE", "arguments of a xacro file", nargs="+", default=[]),
            argument("--joint-limits", "YAML", "joint_limits.yaml of MoveIt"),
            argument("--srdf", "SRDF", "SRDF of MoveIt: pairs that may touch, named states"),
            argument("--package-dirs", "DIR", "folders with ROS packages, for meshes", nargs="+", default=[]),
            argument("--out", "FILE", "the task file (default: ROBOT.toml)"),
            argument("--overwrite", None, "replace the task file, filled in or not", action="store_true"),
        ),
    ),
    Command(
        "examples",
        "copy the example files into a folder",
        "Copies scenes, tasks, platforms and robots. Never replaces a file that differs.",
        "0 all of them are there",
        (argument("directory", "DIR", "the folder; created if it does not exist"),),
    ),
    Command(
        "schema",
        "print the JSON Schema of all files, for editors",
        "Prints the keys of all files as a JSON Schema: ocptip schema > task.schema.json.",
        "0 printed",
        (argument("--page", None, "print them as a page for people instead", action="store_true"),),
    ),
    Command(
        "view",
        "show a plan, a scene or a placement in 3D in a browser",
        "Shows robot, base, obstacles, contact forces, friction cones, the nearest tipping axis and the "
        "zero-moment point (needs: pip install 'ocptip[view]').",
        "0 shown or written",
        (
            argument("what", "PLAN_DIR|SCENE.toml|PLACE_DIR", "folder of a plan or a placement, or a scene"),
            argument("second", "PLAN_DIR", "a second plan, shown beside the first as a ghost", nargs="?"),
            argument("--html", "FILE", "write one self-contained page (default: serve it locally)"),
            argument("--movie", "FILE", "write an animation of one or two plans: .gif, or .mp4"),
            argument("--task", "TASK.toml", "task file of a placement"),
        ),
        files=("html", "movie"),
    ),
    Command(
        "studio",
        "try postures, payloads, floors and pushes with sliders, in a browser",
        "Shows the arm of a task at rest with sliders for joints, TCP, payload, friction, tilt, push and base"
        " acceleration. Margins, forces and robustness follow. Saves poses as start or goal, plans, plays. "
        "Of a parallel robot sliders move the platform (needs: pip install 'ocptip[view]').",
        "0 shown",
        (
            argument("task", "A..H|TASK.toml|ROBOT", "a published case, a task file, or a parallel robot"),
            argument("--out", "DIR", "folder for saved poses and the plan (default: ocptip-studio-NAME)"),
            argument("--overwrite", None, "replace files that ocptip did not write", action="store_true"),
        ),
    ),
    Command(
        "completion",
        "print a script that completes commands and files in a shell",
        "Prints a completion script (needs: pip install 'ocptip[completion]'). For bash: "
        'eval "$(ocptip completion bash)"',
        "0 printed",
        (argument("shell", None, "the shell", choices=("bash", "zsh", "tcsh")),),
    ),
)
