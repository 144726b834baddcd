"""`ocptip parallel`: mobility of a parallel robot, what its equations cost, their C code, other formats."""

from __future__ import annotations

import math
import sys
from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import casadi as cs
import numpy as np

from ocptip import pictures
from ocptip.basics.errors import InputError, SolverError, naming
from ocptip.basics.text import ratio, table
from ocptip.basics.write import file_target, versions, write_text
from ocptip.cli.command import Report
from ocptip.cli.layout import named
from ocptip.cli.poses_and_closed_chains.arm_code import arm_code, count_table, is_arm
from ocptip.cli.terminal import Progress
from ocptip.parallel.analysis.assembly_modes import AssemblyModes
from ocptip.parallel.analysis.mobility import Mobility
from ocptip.parallel.analysis.singularity import Singularity
from ocptip.parallel.analysis.workspace import LENGTHS, Workspace, workspace
from ocptip.parallel.code.codegen import write_c
from ocptip.parallel.code.lean import LeanFunction, lean_function
from ocptip.parallel.code.texts import latex_text, matlab_text
from ocptip.parallel.description.robot_description import REVOLUTE, RobotDescription
from ocptip.parallel.dynamics.base_parameters import NumericBaseParameters, numeric_base_parameters
from ocptip.parallel.export import to_urdf
from ocptip.parallel.minimal_form import joint_functions
from ocptip.parallel.mjcf import to_mjcf
from ocptip.parallel.robot import ParallelRobot
from ocptip.task_files.parallel import read_robot

_SUFFIXES = {
    "urdf": (".urdf",),
    "mjcf": (".xml", ".mjcf"),
    "c": (".c",),
    "matlab": (".m",),
    "latex": (".tex",),
    "plot": (".png", ".pdf", ".svg"),
}
_FORCES = {"S": "tau_s", "X": "tau_s", "Z": "tau_z", "A": "tau_a", "AA": "tau_a"}


def run(options: Namespace) -> Report:
    """Examine the robot, and make the files that are asked for."""
    files = targets(options)
    if is_arm(options.robot):
        return arm_code(options, files.get("c"))
    description = read_robot(options.robot)
    with naming(Path(options.robot).name):
        report = examine(description, form=options.form, dynpar=options.dynpar)
        if options.range:
            description = with_ranges(description, options.range)
        if options.workspace:
            report.workspace = find_workspace(description, options)
            report.figure = files.get("plot")
        if options.modes is not None:
            report.modes = all_modes(description, options.modes)
    report.add_files(files)
    return report


@dataclass
class ParallelReport(Report):
    """The report of `ocptip parallel` on a robot.

    Attributes:
        description: the robot.
        mobility: its degrees of freedom.
        home: singularity measures of the home pose; None if the mobility is not that of the description.
        functions: forces and Jacobian as generated; empty if there are none.
        without_code: why there are none.
        base_parameters: of the whole robot, with DynPar 3: its parameters belong to single legs, and further
            ones of equal legs cannot be separated from those of the platform. None if not asked for or not
            available.
        models: files in other formats with their texts.
        joints: functions that give the joints which the others want from z, in closed form or by Newton's
            method; none, see `without_joints`.
        without_joints: why there is none.
        code: where the functions go as C source; None for nowhere.
        modes: all assembly modes; None if not asked for.
        workspace: poses of a grid; None if not asked for.
        figure: where its picture goes.
    """

    description: RobotDescription
    mobility: Mobility
    home: Singularity | None
    functions: tuple[LeanFunction, ...]
    without_code: str
    base_parameters: tuple[str, ...] | None = None
    joints: tuple[cs.Function, ...] = ()
    without_joints: str = ""
    models: list[tuple[Path, str]] = field(default_factory=list)
    code: Path | None = None
    modes: AssemblyModes | None = None
    workspace: Workspace | None = None
    figure: Path | None = None

    @property
    def good(self) -> bool:
        """True if the mobility is that of the description."""
        return self.mobility.consistent

    def add_files(self, targets: Mapping[str, Path]) -> None:
        """Say which files to write; InputError if a format cannot hold the robot or there is no code."""
        for option, make in (("urdf", to_urdf), ("mjcf", to_mjcf)):
            if option in targets:
                with naming(f"--{option}"):
                    self.models.append((targets[option], make(self.description)))
        self.code = targets.get("c")
        for option in ("c", "matlab", "latex"):
            if option in targets and not self.functions:
                raise InputError(f"--{option}: no code for {self.description.name}: {self.without_code}")
        if path := targets.get("matlab"):
            self.models.append((path, matlab_text([*self.functions, *self.joints], path.stem)))
        if path := targets.get("latex"):
            self.models.append((path, latex_text([*self.functions, *self.joints])))

    def write(self) -> Iterator[Path]:
        """Write the C code with its header, then the other formats."""
        if self.code:
            files = write_c([*self.functions, *self.joints], self.code)
            yield from (files.source, files.header)
        if self.figure and self.workspace:
            yield pictures.workspace.save_workspace(self.workspace, self.figure)
        for path, text in self.models:
            write_text(path, text)
            yield path

    def to_dict(self) -> dict[str, Any]:
        """Mobility, home pose, operations, files."""
        robot = self.description
        forces = self.functions[0] if self.functions else None
        return {
            "robot": robot.name,
            "legs": len(robot.legs),
            "coordinates": list(robot.platform.coordinates),
            "dependent": list(robot.platform.dependent_coordinates),
            "actuated": [[leg + 1, joint + 1] for leg, joint in robot.actuated],
            "mobility": self.mobility.to_dict(),
            "home_pose": None if self.home is None else self.home.to_dict(),
            "form": forces.form if forces else None,
            "dynpar": forces.dynpar if forces else None,
            "inertia_parameters": list(forces.inertia_names) if forces else None,
            "base_parameters": None if self.base_parameters is None else list(self.base_parameters),
            "rank": None if self.base_parameters is None else len(self.base_parameters),
            "operations": {f.function.name(): f.count.to_dict() for f in self.functions},
            "without_code": self.without_code or None,
            "joints_from_z": bool(self.joints),
            "assembly_modes": None if self.modes is None else self.modes.to_dict(),
            "workspace": None if self.workspace is None else self.workspace.to_dict(),
            "written": self.written,
            "versions": versions(),
        }

    def to_text(self) -> str:
        """Mobility, home pose, operations, files."""
        robot, mobility = self.description, self.mobility
        moves = "mobility as in its file" if mobility.consistent else "MOBILITY NOT AS IN ITS FILE"
        lines = [f"{robot.name}: {len(robot.legs)} legs, {moves}."]
        lines += [f"  {problem}" for problem in mobility.problems]
        motors = ", ".join(f"{leg + 1}.{joint + 1}" for leg, joint in robot.actuated)
        coordinates = ", ".join(robot.platform.coordinates)
        along = ", ".join(robot.platform.dependent_coordinates)
        follow = f"; dependent: {along}" if along else ""
        idle = f", and {mobility.idle} idle freedoms" if mobility.idle else ""
        rows = [
            ("mobility", f"{mobility.dof} ({mobility.coordinates} coordinates described)"),
            ("platform", f"{mobility.platform_dof} degrees of freedom; z = {coordinates}{follow}"),
            ("within legs", f"{mobility.internal_dof} motions with the platform at rest{idle}"),
            ("redundant closures", f"{mobility.over_constraints}"),
            ("actuated joints", f"{len(robot.actuated)} (leg.joint): {motors}"),
        ]
        if self.home is not None:
            kinds = ", ".join(self.home.kinds) or "regular"
            rows.append(("home pose", f"{kinds}; smallest singular values {_measures(self.home)}"))
        if self.functions:
            names = self.functions[0].inertia_names
            rows.append(("inertia parameters", f"{len(names)}: {', '.join(names)}"))
            rows += self._rank_row(len(names))
        lines += ["", *named(rows), ""]
        counted = count_table((_title(one), one.count) for one in self.functions)
        lines += counted if self.functions else [f"no code: {self.without_code}"]
        if self.functions and not self.joints:
            lines.append(f"no code for the joints q that these functions want: {self.without_joints}")
        if len(self.joints) > 1:
            lines.append(
                "joints q for these functions: by Newton's method from those of the instant before, at first "
                "from home_joints"
            )
        if self.modes:
            lines += ["", *_mode_table(self.modes, robot)]
        if self.workspace:
            lines += ["", *_workspace_lines(self.workspace)]
        if self.written:
            lines += ["", f"wrote {' and '.join(map(str, self.written))}"]
        return "\n".join(lines)

    def _rank_row(self, count: int) -> list[tuple[str, str]]:
        """Whether the columns of the whole robot's regressor are independent, DynPar 3 only."""
        if self.base_parameters is None:
            return []
        rank = len(self.base_parameters)
        if rank == count:
            return [("rank", f"{rank}: independent in the whole robot")]
        base = f"base parameters: {', '.join(self.base_parameters)}"
        return [("rank", f"{rank} of {count}: dependent in the whole robot, whose {base}")]


def targets(options: Namespace) -> dict[str, Path]:
    """Files that are asked for, by option; InputError before anything is computed if they cannot be."""
    results = {}
    for option in _SUFFIXES:
        if (path := getattr(options, option)) is None:
            continue
        try:
            results[option] = file_target(path, _SUFFIXES[option])
        except InputError as error:
            raise InputError(f"--{option}: {str(error).removeprefix('path: ')}") from None
        if option in ("c", "matlab") and not results[option].stem.isidentifier():
            kind = _SUFFIXES[option][0]
            raise InputError(f"--{option}: expected a file NAME{kind} with NAME an identifier, got {path!r}")
    return results


def examine(
    description: RobotDescription, *, form: str | None = None, dynpar: int | None = None
) -> ParallelReport:
    """Mobility, and if it is that of the description the generated functions, see :func:`lean_function`.

    Args:
        description: the robot.
        form, dynpar: default A and 3; given, they are refused where there is no such code.
    """
    try:
        robot = ParallelRobot(description, check=False)
        mobility = robot.mobility()
        home = robot.singularity(description.home) if mobility.consistent else None
    except InputError as error:
        raise InputError(f"home: {str(error).removeprefix('home: ').removeprefix('pose: ')}") from None
    if home is None:
        return ParallelReport(description, mobility, None, (), "the mobility is not as in the robot's file")
    try:
        functions, base = _functions(robot, form or "A", dynpar or 3)
    except InputError as error:
        why = str(error).removeprefix(f"{description.name}: ").removeprefix("generated code: ")
        if form or dynpar:
            raise InputError(f"{'--form' if form else '--dynpar'}: {why}") from None
        return ParallelReport(description, mobility, home, (), why)
    try:
        joints, why = joint_functions(robot), ""
    except InputError as error:
        joints, why = (), str(error).removeprefix(f"{description.name}: generated code: ")
    return ParallelReport(description, mobility, home, functions, "", base, joints, why)


def _functions(
    robot: ParallelRobot, form: str, dynpar: int
) -> tuple[tuple[LeanFunction, ...], tuple[str, ...] | None]:
    """Motor forces and Jacobian, and the names of the base parameters of the whole robot with DynPar 3.

    Robots whose joints behind the coupling points take part have motor forces from z' and z''.

    Raises:
        InputError: there is no code; says why.
    """
    description = robot.description
    if robot.complete_legs:
        base = _base_parameters(description) if dynpar == 3 else None
        options = {"form": form, "dynpar": 2 if dynpar == 3 and base is None else dynpar, "base": base}
        functions = robot.lean(name="tau_a", **options), robot.lean(("J_a",), name="jacobian", **options)
        return functions, None if base is None else base.names
    functions = (
        lean_function(description, form=form, dynpar=dynpar, name=_FORCES[form]),
        lean_function(description, ("J_a",), form="S", dynpar=dynpar, name="jacobian"),
    )
    base = _base_parameters(description) if dynpar == 3 else None
    return functions, None if base is None else base.names


def with_ranges(description: RobotDescription, given: Sequence[Sequence[float]]) -> RobotDescription:
    """The robot with ranges of joints (number, lowest, highest), degrees or m, of all legs."""
    ranges = {}
    for number, low, high in given:
        joint = int(number) - 1
        rows = [leg.joint_rows[joint] for leg in description.legs if 0 <= joint < leg.n_joints]
        if not rows or number % 1:
            raise InputError(f"--range: no leg has a joint {number:g}")
        scale = math.radians(1.0) if rows[0].sigma == REVOLUTE else 1.0
        ranges[joint] = (scale * low, scale * high)
    with naming("--range"):
        return description.with_joint_ranges(ranges)


def find_workspace(description: RobotDescription, options: Namespace) -> Workspace:
    """The grid that `--workspace NAME=LOW:HIGH ...`, `--at` and `--cells` ask for; degrees and m."""
    robot, ranges = ParallelRobot(description), grid_ranges(options.workspace)
    indices = None
    if options.at is not None:
        names = description.platform.coordinates
        if len(options.at) != len(names):
            raise InputError(f"--at: expected {', '.join(names)}, got {len(options.at)} numbers")
        indices = np.where([name.startswith("phi") for name in names], np.radians(options.at), options.at)
    with Progress(sys.stderr, "computing the poses ...", what="poses") as progress:
        return workspace(robot, ranges, at=indices, cells=options.cells, progress=progress)


def grid_ranges(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Ranges, m and rad, of `--workspace NAME=LOW:HIGH ...`, m and degrees."""
    ranges = {}
    for text in texts:
        name, _, ends = text.partition("=")
        try:
            low, high = (float(value) for value in ends.split(":"))
        except ValueError:
            raise InputError(f"--workspace: expected NAME=LOW:HIGH, got {text!r}") from None
        scale = 1.0 if name in LENGTHS else math.radians(1.0)
        ranges[name] = (scale * low, scale * high)
    return ranges


def size_of_grid(names: Sequence[str], size: float) -> str:
    """Length, area, volume or size of a workspace, with its unit."""
    units = ["m" if name in LENGTHS else "rad" for name in names]
    what = {1: "length", 2: "area", 3: "volume"}[len(units)] if set(units) == {"m"} else "size"
    unit = " ".join(units).replace("m m m", "m^3").replace("m m", "m^2")
    return f"{what} {size:.4g} {unit}"


def _workspace_lines(result: Workspace) -> list[str]:
    cells = " x ".join(map(str, result.inside.shape))
    shares = {name: f"{name} {100 * share:.1f} %" for name, share in result.shares.items() if share}
    if beyond := shares.pop("beyond a singularity", ""):
        shares["inside"] += f" ({beyond})"
    size = size_of_grid(result.names, result.size)
    lines = [f"workspace over {', '.join(result.names)}: {size} ({cells} cells)"]
    inside = result.dexterity[result.inside]
    lines.append(f"  {', '.join(shares.values())}")
    if inside.size:
        lines.append(
            f"  dexterity {inside.min():.3f} to {inside.max():.3f} (0: singular, 1: motors at right angles)"
        )
    return lines


def all_modes(description: RobotDescription, motors: Sequence[float]) -> AssemblyModes:
    """All assembly modes for motor positions in degrees and m; none given: those of the home pose."""
    robot = ParallelRobot(description)
    rows = description.motor_rows
    if motors:
        if len(motors) != len(rows):
            raise InputError(f"--modes: expected {len(rows)} motor positions (degrees, m), got {len(motors)}")
        turns = [row.sigma == REVOLUTE for row in rows]
        return robot.assembly_modes(np.where(turns, np.radians(motors), motors))
    q = robot.ik(description.home).q
    return robot.assembly_modes([q[leg][joint] for leg, joint in description.actuated])


def _mode_table(modes: AssemblyModes, robot: RobotDescription) -> list[str]:
    names = [*robot.platform.coordinates, *robot.platform.dependent_coordinates]
    turns = [name.startswith("phi") for name in names]
    heads = [f"{name} (deg)" if turn else f"{name} (m)" for name, turn in zip(names, turns, strict=True)]
    rows = [["mode", *heads, "signs of home"]]
    for number, mode in enumerate(modes.modes, start=1):
        values = np.where(turns, np.degrees(mode.z), mode.z)
        home = "-" if mode.home_branches is None else "yes" if mode.home_branches else "no"
        rows.append([str(number), *(f"{round(v, 4) + 0.0:.4f}" for v in values), home])
    ends = f"{modes.paths} paths: {modes.regular} solutions, {modes.at_infinity} at infinity"
    lost = "" if modes.complete else f", {modes.singular} SINGULAR, MAYBE MORE MODES"
    far = f"; {modes.out_of_reach} real ones out of a leg's reach" if modes.out_of_reach else ""
    head = f"assembly modes: {len(modes.modes)} ({ends}{lost}{far})"
    return [head, *(table(rows, left=()) if modes.modes else [])]


def _base_parameters(description: RobotDescription) -> NumericBaseParameters | None:
    """Base parameters of the whole robot; None where too few poses can be reached."""
    try:
        return numeric_base_parameters(description)
    except SolverError:
        return None


def _measures(home: Singularity) -> str:
    parts = {"legs": home.legs.min(), "platform": home.platform, "angles": home.representation}
    parts |= {"constraint": home.held, "dependent": home.determined} if np.isfinite(home.held) else {}
    return ", ".join(f"{ratio(float(value))} ({name})" for name, value in parts.items())


def _title(one: LeanFunction) -> str:
    name = one.function.name()
    return f"{name} (form {one.form}, DynPar {one.dynpar})" if name != "jacobian" else "J_a"
