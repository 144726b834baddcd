"""README and docs: Python blocks and command lines run; names (those in docstrings, too) and links exist."""

from __future__ import annotations

import importlib
import json
import re
import runpy
import shlex
import subprocess
import sys
import warnings

import pytest
import yaml

from ocptip.cli.main import main
from tests.places import EXAMPLES, ROOT

PAGES = [
    ROOT / "README.md",
    ROOT / "studies" / "README.md",
    *sorted(p for p in (ROOT / "docs").rglob("*.md") if "results" not in p.parts),
]
SOURCES = [path for folder in ("src", "studies", "tests") for path in (ROOT / folder).rglob("*.py")]
TEXTS = {str(page.relative_to(ROOT)): page.read_text(encoding="utf-8") for page in PAGES}
BLOCKS = {
    f"{name}-{number}": code
    for name, text in TEXTS.items()
    for number, code in enumerate(re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL), 1)
}
SLOW = ("ocptip.plan(", "plan_motion(", "place(", "ocptip.check(", "ocptip.drive(", "ocptip.chart(")
"""Calls that take seconds."""
SLOW_COMMANDS = ("ocptip parallel", "--workspace")
"""Commands that do; tests/cli looks at what they print."""
COMMANDS = sorted({
    line.split("#")[0].strip()
    for text in TEXTS.values()
    for line in re.findall(r"^    (ocptip .*)$", text, flags=re.MULTILINE)
})  # fmt: skip
USAGES = sorted({
    (command, option)
    for text in TEXTS.values()
    for command, options in re.findall(r"`ocptip (\w+) ([^`]*)`", text)
    for option in re.findall(r"--[\w-]+", options)
})  # fmt: skip
SCRIPTS = sorted({name for text in TEXTS.values() for name in re.findall(r"-m (studies\.[\w.]+)", text)})
LINKS = [
    pytest.param(name, link, id=f"{name}-{link}")
    for name, text in TEXTS.items()
    for link in sorted(set(re.findall(r"\]\(([^)]+)\)", text)))
    if "://" not in link
]
NAMES = sorted({
    name
    for text in (*TEXTS.values(), *(path.read_text(encoding="utf-8") for path in SOURCES))
    for name in re.findall(r"(?:`|pydoc )((?:ocptip|studies)\.[\w.]*\w)", text)
})  # fmt: skip
PACKAGES = [
    "ocptip",
    *(f"ocptip.{path.parent.name}" for path in (ROOT / "src" / "ocptip").glob("*/__init__.py")),
]
FILES = sorted({
    name for text in TEXTS.values() for name in re.findall(r"`((?:src|studies|tests|docs)/[\w./-]*)`", text)
})  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the examples as `ocptip examples ex` copies them."""
    (tmp_path / "src").symlink_to(ROOT / "src")
    for name in ("ex", "examples"):
        (tmp_path / name).symlink_to(EXAMPLES)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", BLOCKS)
def test_imports_of_python_block(name):
    lines = re.findall(r"^(?:import|from) .*$", BLOCKS[name], flags=re.MULTILINE)
    exec("\n".join(lines), {})


@pytest.mark.parametrize(
    "code",
    [
        pytest.param(code, id=name, marks=pytest.mark.slow if any(call in code for call in SLOW) else ())
        for name, code in BLOCKS.items()
        if not name.startswith("docs/python.md")  # these are one script, see tests/api
    ],
)
def test_python_block_runs(folder, code, capfd):
    """As a script, as a reader would run it; those that may start processes in a process of their own."""
    (folder / "example.py").write_text(code.replace("samples=2000", "samples=100"), encoding="utf-8")
    if not any(call in code for call in SLOW):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            runpy.run_path("example.py", run_name="__main__")
        assert capfd.readouterr().err == ""
        return
    done = subprocess.run(
        [sys.executable, "-W", "error", "example.py"], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    "command",
    [
        pytest.param(line, marks=pytest.mark.slow if any(part in line for part in SLOW_COMMANDS) else ())
        for line in COMMANDS
    ],
)
def test_command_runs(folder, capsys, command):
    assert main(shlex.split(command)[1:]) == 0
    assert capsys.readouterr().out


@pytest.mark.parametrize(("command", "option"), USAGES)
def test_option_exists(capsys, command, option):
    with pytest.raises(SystemExit):
        main([command, "--help"])
    assert option in capsys.readouterr().out


@pytest.mark.parametrize("name", SCRIPTS)
def test_study_has_a_script_of_this_name(name):
    assert callable(importlib.import_module(name).main)


def test_page_of_the_studies_lists_all_scripts():
    listed = re.findall(r"^\| `([\w.]+)` \|", TEXTS["studies/README.md"], flags=re.MULTILINE)
    folder = ROOT / "studies"
    scripts = [path for path in folder.glob("*/*.py") if '"__main__"' in path.read_text(encoding="utf-8")]
    assert sorted(listed) == sorted(".".join(p.relative_to(folder).with_suffix("").parts) for p in scripts)


@pytest.mark.parametrize("name", NAMES)
def test_name_exists(name):
    """Of a module, of something in a module, or of something in that."""
    *parts, last = name.split(".")
    try:
        importlib.import_module(name)
    except ModuleNotFoundError:
        try:
            owner = importlib.import_module(".".join(parts))
        except ModuleNotFoundError:
            owner = getattr(importlib.import_module(".".join(parts[:-1])), parts[-1])
        assert hasattr(owner, last), name


@pytest.mark.parametrize("package", PACKAGES)
def test_what_a_package_exports_is_documented(package):
    """So that the public surface stays what README and docs explain."""
    for name in getattr(importlib.import_module(package), "__all__", ()):
        if not name.startswith("__"):
            assert any(re.search(rf"\b{name}\b", text) for text in TEXTS.values()), name


@pytest.mark.parametrize(("name", "link"), LINKS)
def test_link_leads_somewhere(name, link):
    file, _, anchor = link.partition("#")
    target = (ROOT / name).parent / file if file else ROOT / name
    assert target.exists()
    if anchor:
        heads = re.findall(r"^#+ (.*)$", target.read_text(encoding="utf-8"), flags=re.MULTILINE)
        assert anchor in [re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads]


@pytest.mark.parametrize("name", FILES)
def test_file_exists(name):
    assert (ROOT / name).exists()


def test_the_goal_for_ros_2_has_the_numbers_of_the_file(tmp_path):
    """The commands are read by the shell; the first one runs, the goal is read as `ros2` reads it."""
    text = TEXTS["docs/how-to/controller-files.md"]
    (block,) = re.findall(r"```bash\n(.*?send_goal.*?)```", text, flags=re.DOTALL)
    subprocess.run(["bash", "-n"], input=block, text=True, check=True)
    sent = shlex.split(block.split("\n", 1)[1].replace("\\\n", " "))
    assert sent[:3] == ["ros2", "action", "send_goal"]
    assert sent[-4:] == [
        "/joint_trajectory_controller/follow_joint_trajectory",
        "control_msgs/action/FollowJointTrajectory",
        "<",
        "goal.yaml",
    ]
    moments = [{"sec": 0, "nanosec": 0}, {"sec": 1, "nanosec": 500_000_000}]
    places = [[0.0, 1.0], [1e-5, 2.0]]
    points = {
        "joint_names": ["joint_1", "joint_2"],
        "points": [
            {"positions": at, "velocities": [0.0, 0.0], "time_from_start": moment}
            for at, moment in zip(places, moments, strict=True)
        ],
    }
    (tmp_path / "plan").mkdir()
    (tmp_path / "plan" / "trajectory.json").write_text(json.dumps(points), encoding="utf-8")
    first = block.splitlines()[0].replace("python3", shlex.quote(sys.executable))
    subprocess.run(["bash", "-c", first], cwd=tmp_path, check=True)
    goal = yaml.safe_load((tmp_path / "goal.yaml").read_text(encoding="utf-8"))
    assert goal == {"trajectory": points}
    assert goal["trajectory"]["points"][1]["positions"][0] == 1e-5  # JSON read as YAML has text here
