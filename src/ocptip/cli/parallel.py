"""`ocptip parallel`: mobility of a parallel robot, what its equations cost, their C code, other formats."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ocptip.cli.command import MOVES, STANDS, _print, _refuse

if TYPE_CHECKING:
    from ocptip.parallel.analysis.mobility import Mobility
    from ocptip.parallel.analysis.singularity import Singularity
    from ocptip.parallel.code.codegen import CFiles
    from ocptip.parallel.code.lean import LeanFunction
    from ocptip.parallel.description.robot_description import RobotDescription

_FORMS = ("S", "X", "Z", "A", "AA")
_SUFFIXES = {"c": (".c",), "urdf": (".urdf",), "mjcf": (".xml", ".mjcf")}
_FORCES = {"S": "tau_s", "X": "tau_s", "Z": "tau_z", "A": "tau_a", "AA": "tau_a"}


def add_parser(commands: Any) -> None:
    """Add `parallel` to the commands of the parser. Loads no numerics."""
    parallel = commands.add_parser(
        "parallel",
        help="mobility, cost and C code of a parallel robot's inverse dynamics; URDF, MJCF",
        description="Checks a parallel robot's mobility, counts the operations of its inverse dynamics and "
        "writes them as C code. Writes the robot for other programs.",
        epilog="exit code: 0 the robot moves as described, 1 it does not, 2 bad input",
    )
    parallel.add_argument(
        "robot", metavar="NAME|FILE.toml", help="3RRR, 3RPR, Delta, 4PRRR or 6UPS, or a robot file"
    )
    parallel.add_argument("--json", action="store_true", help="print JSON instead of the table")
    parallel.add_argument("--c", metavar="FILE", help="write C source, and a header beside it")
    parallel.add_argument("--urdf", metavar="FILE", help="write the robot as URDF (a tree, loops cut)")
    parallel.add_argument("--mjcf", metavar="FILE", help="write the robot as a MuJoCo model with its loops")
    parallel.add_argument(
        "--dynpar",
        type=int,
        choices=(1, 2, 3),
        default=3,
        help="inertia parameters: 1 about the centre of mass, 2 about the frames' origins, 3 base parameters "
        "(default)",
    )
    parallel.add_argument(
        "--form",
        choices=_FORMS,
        default="A",
        help="accelerations and forces: S s'' and tau_s, X z'' and tau_s, Z z'' and tau_z, A s'' and motor "
        "forces (default), AA q_a'' and motor forces",
    )
    parallel.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Check, count, write and print; returns the exit code."""
    from ocptip.basics.errors import InputError, OcptipError

    try:
        _check_targets(options)
        description = read_robot(options.robot)
        try:
            report = examine(description, form=options.form, dynpar=options.dynpar)
        except InputError as error:
            raise InputError(f"{Path(options.robot).name}: {error}") from None
        asked = {"urdf": options.urdf, "mjcf": options.mjcf}
        models = [report.model(which, path) for which, path in asked.items() if path is not None]
        if options.c is not None:
            report = report.with_code(options.c)
        report = report.with_models(models)
    except InputError as error:
        return _refuse(f"{error}")
    except OcptipError as error:
        return _refuse(f"computation failed: {error}")
    except OSError as error:
        return _refuse(f"{error.filename or options.robot}: {error.strerror or error}")
    _print(report.to_json() if options.json else report.to_text())
    return STANDS if report.mobility.consistent else MOVES


@dataclass(frozen=True)
class ParallelReport:
    """What `ocptip parallel` knows about a robot.

    Attributes:
        description: the robot.
        mobility: its degrees of freedom.
        home: singularity measures of the home pose; None if the mobility is not as described.
        functions: forces and Jacobian as generated; empty if there are none.
        without_code: why there are none.
        written: the C files.
        models: files in other formats.
    """

    description: RobotDescription
    mobility: Mobility
    home: Singularity | None
    functions: tuple[LeanFunction, ...]
    without_code: str
    written: CFiles | None = None
    models: tuple[Path, ...] = ()

    def with_code(self, path: str) -> ParallelReport:
        """The same after writing the functions as C source.

        Raises:
            InputError: there are no functions, or path is not a C file.
            OSError: it cannot be written.
        """
        import dataclasses

        from ocptip.basics.errors import InputError
        from ocptip.parallel.code.codegen import write_c

        if not self.functions:
            raise InputError(f"--c: no code for {self.description.name}: {self.without_code}")
        return dataclasses.replace(self, written=write_c(self.functions, path))

    def with_models(self, models: Sequence[tuple[Path, str]]) -> ParallelReport:
        """The same after writing the robot in other formats.

        Args:
            models: as :meth:`model` makes them.

        Raises:
            OSError: one cannot be written.
        """
        import dataclasses

        from ocptip.basics.write import write_text

        for path, text in models:
            write_text(path, text)
        return dataclasses.replace(self, models=(*self.models, *(path for path, _ in models)))

    def model(self, which: str, path: str) -> tuple[Path, str]:
        """The robot in another format, and the file to write it to.

        Args:
            which: "urdf" or "mjcf".
            path: of the file.

        Raises:
            InputError: the format cannot hold the robot, or path does not fit.
        """
        from ocptip.basics.errors import InputError
        from ocptip.parallel.formats.export import export_target, to_mjcf, to_urdf

        make = {"urdf": to_urdf, "mjcf": to_mjcf}[which]
        try:
            return export_target(path, _SUFFIXES[which]), make(self.description)
        except InputError as error:
            raise InputError(f"--{which}: {error}") from None

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that were written."""
        code = (self.written.source, self.written.header) if self.written else ()
        return (*code, *self.models)

    def to_dict(self) -> dict[str, Any]:
        """Plain data; what is not finite becomes None."""
        from ocptip.basics.write import plain, versions

        robot = self.description
        forces = self.functions[0] if self.functions else None
        return plain(
            {
                "robot": robot.name,
                "legs": len(robot.legs),
                "coordinates": list(robot.platform.coordinates),
                "actuated": [[leg + 1, joint + 1] for leg, joint in robot.actuated],
                "mobility": self.mobility.to_dict(),
                "home_pose": None if self.home is None else self.home.to_dict(),
                "form": forces.form if forces else None,
                "dynpar": forces.dynpar if forces else None,
                "inertia_parameters": list(forces.inertia_names) if forces else None,
                "operations": {f.function.name(): f.count.to_dict() for f in self.functions},
                "without_code": self.without_code or None,
                "written": [str(path) for path in self.files],
                "versions": versions(),
            }
        )

    def to_json(self) -> str:
        """The same as JSON text."""
        return json.dumps(self.to_dict(), indent=2, allow_nan=False)

    def to_text(self) -> str:
        """The table for people. ASCII only, but for names."""
        robot, mobility = self.description, self.mobility
        moves = "moves as described" if mobility.consistent else "DOES NOT MOVE AS DESCRIBED"
        lines = [f"{robot.name}: {len(robot.legs)} legs, {moves}."]
        lines += [f"  {problem}" for problem in mobility.problems]
        motors = ", ".join(f"{leg + 1}.{joint + 1}" for leg, joint in robot.actuated)
        coordinates = ", ".join(robot.platform.coordinates)
        rows = [
            ("mobility", f"{mobility.dof} ({mobility.coordinates} coordinates described)"),
            ("platform", f"{mobility.platform_dof} degrees of freedom; z = {coordinates}"),
            ("within legs", f"{mobility.internal_dof} motions with the platform at rest"),
            ("redundant closures", f"{mobility.over_constraints}"),
            ("actuated joints", f"{len(robot.actuated)} (leg.joint): {motors}"),
        ]
        if self.home is not None:
            kinds = ", ".join(self.home.kinds) or "regular"
            rows.append(("home pose", f"{kinds}; smallest singular values {_measures(self.home)}"))
        if self.functions:
            names = self.functions[0].inertia_names
            rows.append(("inertia parameters", f"{len(names)}: {', '.join(names)}"))
        width = max(len(name) for name, _ in rows)
        lines += ["", *(f"{name:<{width}}  {text}" for name, text in rows), ""]
        lines += _count_table(self.functions) if self.functions else [f"no code: {self.without_code}"]
        if self.files:
            lines += ["", f"wrote {' and '.join(map(str, self.files))}"]
        return "\n".join(lines)


def _check_targets(options: argparse.Namespace) -> None:
    """Refuse files that could not be written, before anything is computed.

    Raises:
        InputError: another ending, a name that C does not allow, or no such folder; names the option.
    """
    from ocptip.basics.errors import InputError
    from ocptip.parallel.formats.export import export_target

    for option, suffixes in _SUFFIXES.items():
        path = getattr(options, option)
        if path is None:
            continue
        try:
            target = export_target(path, suffixes)
        except InputError as error:
            raise InputError(f"--{option}: {str(error).removeprefix('path: ')}") from None
        if option == "c" and not target.stem.isidentifier():
            raise InputError(f"--c: expected a file NAME.c with NAME an identifier, got {path!r}")


def read_robot(name: str) -> RobotDescription:
    """A ready-made robot by its name (upper or lower case), or the one of a file.

    Raises:
        InputError: neither, or a file with an error.
    """
    from ocptip.basics.errors import InputError
    from ocptip.parallel.description.ready_made import READY_MADE

    by_name = {known.lower(): make for known, make in READY_MADE.items()}
    if name.lower() in by_name:
        return by_name[name.lower()]()
    if not Path(name).suffix:
        raise InputError(f"{name}: expected one of {', '.join(READY_MADE)}, or a robot file NAME.toml")
    from ocptip.task_files.parallel import read_parallel_robot

    return read_parallel_robot(name)


def examine(description: RobotDescription, *, form: str = "A", dynpar: int = 3) -> ParallelReport:
    """Mobility, and if it is as described the generated functions.

    Args:
        description: the robot.
        form, dynpar: of the forces; see :func:`ocptip.parallel.code.lean.lean_function`.

    Raises:
        InputError: a leg does not reach the home pose.
    """
    from ocptip.basics.errors import InputError
    from ocptip.parallel.code.lean import lean_function
    from ocptip.parallel.robot import ParallelRobot

    try:
        robot = ParallelRobot(description, check=False)
        mobility = robot.mobility()
        home = robot.singularity(description.home) if mobility.consistent else None
    except InputError as error:
        raise InputError(f"home: {str(error).removeprefix('home: ').removeprefix('pose: ')}") from None
    if home is None:
        return ParallelReport(description, mobility, None, (), "the robot does not move as described")
    if not description.coupling_form:
        return ParallelReport(
            description,
            mobility,
            home,
            (),
            "generated code needs legs with as many joints up to the coupling point as there are free "
            f"translations, and motors on those joints, but {description.coupling_obstacle}",
        )
    functions = (
        lean_function(description, form=form, dynpar=dynpar, name=_FORCES[form]),
        lean_function(description, ("J_a",), form="S", dynpar=dynpar, name="jacobian"),
    )
    return ParallelReport(description, mobility, home, functions, "")


def _measures(home: Singularity) -> str:
    from ocptip.basics.text import ratio

    parts = {"legs": home.legs.min(), "platform": home.platform, "angles": home.representation}
    return ", ".join(f"{ratio(float(value))} ({name})" for name, value in parts.items())


def _count_table(functions: tuple[LeanFunction, ...]) -> list[str]:
    from ocptip.cli.stand import _aligned

    rows = [["operations", "+-", "x", "/", "sin cos", ":=", "weighted"]]
    for one in functions:
        count = one.count
        numbers = (count.additions, count.multiplications, count.divisions, count.trigonometric)
        title = f"{one.function.name()} (form {one.form}, DynPar {one.dynpar})"
        title = title if one.function.name() != "jacobian" else "J_a"
        rows.append([title, *map(str, numbers), str(count.assignments), str(count.weighted)])
    return _aligned(rows, left=(0,))
