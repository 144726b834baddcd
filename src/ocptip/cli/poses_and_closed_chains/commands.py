"""What can be typed under `poses and closed chains`: the commands and their arguments."""

from __future__ import annotations

from ocptip.cli.arguments import BASE_LINK, TOOL_FRAME, argument, group, is_index, is_range
from ocptip.cli.command import Command

COMMANDS = (
    Command(
        "rate",
        "performance indices of a pose of an arm, a platform or a parallel robot",
        "Prints the performance indices of a pose: value, range, meaning.",
        "0 a regular pose, 1 a singular one (--along, --workspace: one of the poses, or none is reached)",
        (
            argument(
                "robot",
                "ROBOT",
                "FP1W2F, FSFS, W1P1P2W2, IRB2000, a URDF, 3RRR, 3RPR, Delta, 4PRRR, 6UPS, or a .toml with "
                "[arm], a platform or a parallel robot",
            ),
            argument(
                "pose",
                "POSE",
                "arm: joint angles, degrees; platform: x y z in m and rotation vector in degrees; parallel "
                "robot: its coordinates, m and degrees (default: home pose)",
                nargs="*",
                type=float,
            ),
            group(
                "many poses",
                argument(
                    "--along",
                    "MOTION.csv",
                    "rate every row (columns q1_deg, q2_m, ... as in plans; platforms: position and rotation "
                    "vector, q1_m to q6_deg)",
                ),
                argument(
                    "--workspace",
                    "NAME=LOW:HIGH",
                    "rate a grid over one to three coordinates, the others as in POSE: coordinates of a "
                    "parallel robot (x=-0.3:0.3 phi1=-40:40), else x y z of the TCP or platform, m, and "
                    "rx ry rz, a rotation vector in base axes relative to POSE, degrees",
                    nargs="+",
                    accepts=is_range,
                ),
                argument("--cells", "N", "cells of the grid per coordinate (default: 40)", type=int),
                argument(
                    "--range",
                    ("JOINT", "LOW", "HIGH"),
                    "range of a joint in all legs of a parallel robot (degrees, m)",
                    nargs=3,
                    type=float,
                    action="append",
                ),
                argument(
                    "--index",
                    "NAME",
                    "rate these indices only, such as dm_2 ctn",
                    nargs="+",
                    accepts=is_index,
                ),
                argument(
                    "--plot",
                    "FILE",
                    "draw the indices into a .png, .pdf or .svg file; with --along also an animation of the "
                    "bodies: .gif, .html, or .mp4",
                ),
            ),
            group(
                "what is rated",
                argument("--rates", "W", "joint rates of a motion to rate, any unit", nargs="+", type=float),
                argument(
                    "--ellipsoid",
                    ("A", "B", "C"),
                    "half-axes of the operation ellipsoid along the axes of the TCP or platform frame, m "
                    "(default for arms: sphere of 0.1)",
                    nargs=3,
                    type=float,
                ),
                argument(
                    "--center", ("X", "Y", "Z"), "its centre in that frame, m (0 0 0)", nargs=3, type=float
                ),
                argument(
                    "--payload",
                    "KG",
                    "mass at the TCP for the indices that weigh masses, kg; or KG X Y Z with its position in "
                    "the TCP frame, m",
                    nargs="+",
                    type=float,
                ),
            ),
            group(
                "URDF",
                BASE_LINK,
                TOOL_FRAME,
                argument(
                    "--lock",
                    "JOINT=DEG",
                    "lock a joint, or several (finger_*), at this angle (prismatic: JOINT=0.2m); repeatable",
                    action="append",
                    default=[],
                ),
            ),
        ),
        files=("plot",),
    ),
    Command(
        "parallel",
        "mobility, assembly modes, workspace and code of a parallel robot",
        "Checks the mobility of a parallel robot, counts the operations of its inverse dynamics and writes "
        "them as C code (also of a serial arm). Writes URDF and MJCF.",
        "0 the robot moves as its description says, 1 it does not",
        (
            argument(
                "robot",
                "NAME|FILE",
                "3RRR, 3RPR, Delta, 4PRRR or 6UPS, or a robot file; an arm (code only): FP1W2F, FSFS, "
                "W1P1P2W2, a URDF, or a .toml with [arm]",
            ),
            group(
                "kinematics",
                argument(
                    "--modes",
                    "QA",
                    "all assembly modes for these motor positions (degrees, m; default: home pose)",
                    nargs="*",
                    type=float,
                ),
                argument(
                    "--workspace",
                    "NAME=LOW:HIGH",
                    "reachable poses over one to three coordinates (x=-0.3:0.3 phi1=-40:40; m, degrees)",
                    nargs="+",
                    accepts=is_range,
                ),
                argument(
                    "--at", "Z", "other coordinates (m, degrees; default: home pose)", nargs="+", type=float
                ),
                argument("--cells", "N", "cells per coordinate (default: 40)", type=int, default=40),
                argument(
                    "--range",
                    ("JOINT", "LOW", "HIGH"),
                    "range of a joint in all legs, also unactuated (degrees, m); files give it per row",
                    nargs=3,
                    type=float,
                    action="append",
                ),
                argument("--plot", "FILE", "draw the workspace into a .png, .pdf or .svg file"),
            ),
            group(
                "code and models",
                argument("--c", "FILE", "write C source (also MEX and S-function), and a header beside it"),
                argument("--matlab", "FILE", "write a Matlab file, text that needs no compiler"),
                argument("--latex", "FILE", "write the equations as LaTeX (.tex)"),
                argument("--urdf", "FILE", "write the robot as URDF (a tree, loops cut)"),
                argument("--mjcf", "FILE", "write the robot as a MuJoCo model with its loops"),
                argument(
                    "--dynpar",
                    None,
                    "inertia parameters: 1 about centres of mass, 2 about frame origins, 3 base parameters "
                    "(default)",
                    type=int,
                    choices=(1, 2, 3),
                ),
                argument(
                    "--form",
                    None,
                    "accelerations and forces: S s'' and tau_s, X z'' and tau_s, Z z'' and tau_z, A s'' and "
                    "motor forces (default), AA q_a'' and motor forces",
                    choices=("S", "X", "Z", "A", "AA"),
                ),
            ),
        ),
        files=("c", "matlab", "latex", "urdf", "mjcf", "plot"),
    ),
)
