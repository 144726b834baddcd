"""The house: packages in floors, imports point down, no circles, readers in one place."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from studies.words.code import module
from tests.places import ROOT

SOURCE = ROOT / "src"
FLOORS = [
    "basics",
    "numerics",
    "contact",
    "reserves",
    "robots",
    "trajectories",
    "parallel",
    "indices",
    "standing",
    "motion",
    "certificate",
    "retiming",
    "measured",
    "placement",
    "published",
    "task_files",
    "pictures",
    "api",
    "cli",
    "__main__",
]
"""From the bottom up."""


def _modules() -> dict[str, Path]:
    found = {}
    for path in SOURCE.rglob("*.py"):
        parts = path.relative_to(SOURCE).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = _modules()


def _imports(name: str) -> Iterator[str]:
    """Modules of ocptip that a module imports, anywhere in it."""
    for node in module(MODULES[name]).imports:
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name}: relative import"
            if str(node.module).startswith("ocptip."):
                assert node.module in MODULES, f"{name}: there is no {node.module}"
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                yield from (m for m in (full if full in MODULES else node.module,) if m in MODULES)
        else:
            yield from (alias.name for alias in node.names if alias.name in MODULES)


@pytest.fixture(scope="module")
def arrows() -> dict[str, list[str]]:
    return {name: sorted(set(_imports(name)) - {name}) for name in MODULES}


def _floor(name: str) -> int:
    return FLOORS.index(name.split(".")[1])


def test_every_package_has_a_floor():
    assert {name.split(".")[1] for name in MODULES if "." in name} == set(FLOORS)
    assert [path.name for path in sorted((SOURCE / "ocptip").glob("*.py"))] == ["__init__.py", "__main__.py"]


def test_imports_point_down(arrows):
    for name in set(MODULES) - {"ocptip"}:
        for other in arrows[name]:
            assert other != "ocptip", f"{name}: only users import the root"
            assert _floor(other) <= _floor(name), f"{name} imports {other}, which is above it"


def test_no_circles(arrows):
    done: set[str] = set()

    def visit(name: str, way: tuple[str, ...]) -> None:
        assert name not in way, f"circle: {' -> '.join((*way[way.index(name) :], name))}"
        if name not in done:
            for other in arrows[name]:
                visit(other, (*way, name))
            done.add(name)

    for name in MODULES:
        visit(name, ())


def test_inside_package_inits_only_export_what_is_theirs(arrows):
    for name, path in MODULES.items():
        if path.name == "__init__.py" and name != "ocptip":
            assert all(other.startswith(name + ".") for other in arrows[name]), name


def test_imported_names_exist():
    """In tests and studies as well, those inside functions included: nothing imports what has moved away."""
    words = {name: set(re.findall(r"\w+", path.read_text("utf-8"))) for name, path in MODULES.items()}
    line = re.compile(r"^ *from (ocptip\.[\w.]+) import (?:\(([^)]*)\)|([^\n]*))", re.MULTILINE)
    for folder in ("src", "tests", "studies"):
        for path in (ROOT / folder).rglob("*.py"):
            for found in line.finditer(path.read_text(encoding="utf-8")):
                taken = re.sub("#.*", "", found[2] or found[3]).split(",")
                for name in (one.split()[0] for one in taken if one.strip()):
                    known = name in words.get(found[1], ()) or f"{found[1]}.{name}" in MODULES
                    assert known, f"{path}: no {name} in {found[1]}"


def test_only_pictures_draw():
    for name, path in MODULES.items():
        if re.search(r"^\s*(import|from) matplotlib", path.read_text(encoding="utf-8"), re.MULTILINE):
            assert name.startswith("ocptip.pictures."), name


def test_what_judges_certificates_takes_numpy_and_itself_alone(arrows):
    own = "ocptip.certificate.trusted"
    for name in (name for name in MODULES if name.startswith(f"{own}.")):
        assert all(other.startswith(own) for other in arrows[name]), name
        for node in module(MODULES[name]).imports:
            names = [alias.name for alias in node.names]
            taken = names if isinstance(node, ast.Import) else [str(node.module)]
            for other in taken:
                first = other.split(".")[0]
                assert first in {"numpy", "ocptip", *sys.stdlib_module_names}, f"{name} imports {other}"


def test_nothing_that_is_judged_computes_with_what_judges(arrows):
    """The sampled check and the trusted checker are independent witnesses."""
    trusted = "ocptip.certificate.trusted."
    users = {name for name in MODULES if any(other.startswith(trusted) for other in arrows[name])}
    outside = {name for name in users if not name.startswith("ocptip.certificate.")}
    assert outside == {"ocptip.cli.verify.certify"}  # which judges certificates of files


def test_core_prints_nothing():
    for name, path in MODULES.items():
        assert "print" not in module(path).calls or name.startswith("ocptip.cli."), name


def test_imports_inside_functions_are_few():
    """Each keeps the start of a command short, or is of a package that need not be there."""
    inside = set()
    for name, path in MODULES.items():
        for line in (one.lineno for one in module(path).imports):
            if any(first <= line <= last for first, last in module(path).functions):
                inside.add((name, line))
    assert len(inside) <= 24, sorted(inside)


def test_a_class_name_stands_for_one_class():
    named: dict[str, list[str]] = {}
    for name, path in MODULES.items():
        for one in module(path).classes:
            named.setdefault(one, []).append(name)
    twice = {name: modules for name, modules in named.items() if len(modules) > 1}
    assert not twice
