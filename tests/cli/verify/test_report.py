"""The document of a task, and its file."""

import json
import re
import shlex
from html import unescape

import pytest

from ocptip.api.report import SPEEDS, margins_by_speed
from ocptip.cli.main import main
from ocptip.motion.check import check_motion
from ocptip.motion.files.plan_files import write_plan
from ocptip.motion.tolerated import robustness
from ocptip.published.tasks import experiment_task
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import NONE
from ocptip.task_files.motion import load_task
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from tests.motion.cycles.cycle_files import planned
from tests.pictures.plan_stand_in import plan_of
from tests.places import EXAMPLES

pytestmark = pytest.mark.usefixtures("few_tilts")
TASK = str(EXAMPLES / "tasks" / "ur5_cart.toml")


@pytest.fixture
def cases(tmp_path):
    file = tmp_path / "cases.toml"
    file.write_text("tilt_deg = [0, 40]\npush_N = [0]\npayload_kg = [0]\n")
    return str(file)


def test_page_of_a_task_stands_alone_and_lists_its_cases(tmp_path, capsys, cases):
    out = tmp_path / "report.html"
    about = ["--serial", "SN <7>", "--author", "J. Doe"]
    assert main(["report", TASK, "--cases", cases, "--out", str(out), *about]) == 1
    said = capsys.readouterr().out
    head = "cart: STABLE at rest; 2 of 4 load cases NOT STABLE. 2 of 4 load cases are stable"
    assert head in " ".join(said.split())
    assert "not stable: start +0 kg 40 deg 0 N" in said
    page = out.read_text(encoding="utf-8")
    assert not re.search(r"(src|href)=['\"](?!data:)", page)
    table = page[page.index("<h2>Load cases") : page.index("<h2>Tilt by direction")]
    assert re.findall("<td[^>]*>(yes|NO)<", table) == ["NO", "NO", "yes", "yes"]  # the worst first
    assert page.count("<figure") == 5  # machine, tilts, three charts
    for words in (
        "SN&nbsp;&lt;7&gt;",
        "J.&nbsp;Doe",
        "claims no conformity",
        "Tilt by direction",
        "40&nbsp;deg",
        "ocptip report ur5_cart.toml",
    ):
        assert words in page
    assert "Motion</h2>" not in page  # there is none
    tests = unescape(page[page.index("<h2>Which table") :]).replace("\xa0", " ")
    assert "Drive envelope" not in tests
    assert "if the base drives: ocptip drive ur5_cart.toml --posture goal" in tests
    assert "Tilt by direction; Load cases<" in tests  # robustness is of motions
    assert "not in this document" in tests  # nor stops


def test_the_same_as_json_and_as_pdf(tmp_path, capsys, monkeypatch, cases):
    monkeypatch.setattr("ocptip.api.report.KINDS", ())  # no charts
    out = tmp_path / "report.pdf"
    assert main(["report", TASK, "--cases", cases, "--out", str(out), "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert [case["stands"] for case in data["load_cases"]] == [True, False, True, False]
    assert set(data["least_tilt_deg"]) == {"start", "goal"}
    assert out.read_bytes().startswith(b"%PDF")


def stand_in(folder):
    """A plan of a single motion."""
    task = experiment_task("A")
    write_plan(folder / "A", plan_of(task, task.reference))
    return folder / "A"


@pytest.mark.slow
def test_objects_have_their_margins_in_the_report_of_a_plan_alone(tmp_path, capsys, cases):
    table = (
        '[[object]]\nname = "low"\nmass = 0.5\nfriction = 0.2\nbox = [0.1, 0.1, 0.03]\nrpy_deg = [180, 0, 0]'
    )
    for name in ("ur5.urdf", "ur5_cart.toml"):
        text = (EXAMPLES / "tasks" / name).read_text(encoding="utf-8")
        (tmp_path / name).write_text(f"{text}{table}\n" if name.endswith("toml") else text, encoding="utf-8")
    task = load_task(tmp_path / "ur5_cart.toml", NONE)
    rest = [(RampCommand(angle, 1.0, 1.0),) for angle in task.start[1:]]
    motion = Trajectory.from_profiles(task.start, [(RampCommand(task.start[0] + 0.005, 1.0, 0.5),), *rest])
    write_plan(tmp_path / "plan", plan_of(task, motion))
    page = tmp_path / "page.html"
    assert main(["report", str(tmp_path / "plan"), "--out", str(page), "--cases", cases]) in (0, 1)
    text = unescape(page.read_text(encoding="utf-8")).replace("\xa0", " ")
    assert "<td>low</td><td>0.5 kg" in text
    assert "Friction used, low" in text
    assert "For the controller (rad/s^2): constraints: {decelerate_on_cancel: true, " in text
    assert "load cases are of the base alone" in text
    assert main(["report", str(tmp_path / "ur5_cart.toml"), "--out", str(page), "--overwrite"]) == 2
    assert "object: report does not take objects (low)" in capsys.readouterr().err


@pytest.mark.slow
def test_a_task_of_a_cycle_has_load_cases_by_segment(tmp_path, capsys, cases):
    task = str(EXAMPLES / "tasks" / "ur5_pick_and_place.toml")
    assert main(["report", task, "--cases", cases, "--out", str(tmp_path / "c.html"), "--json"]) == 1
    rows = json.loads(capsys.readouterr().out)["load_cases"]
    names = [f"{name}: {end}" for name in ("reach", "carry", "return") for end in ("start", "goal")]
    assert [row["pose"] for row in rows[::2]] == names
    grasped, lifted = rows[2], rows[4]  # in one posture, before and after it is taken
    assert sum(lifted["GN"] != row["GN"] for row in (grasped, rows[0])) == 2


@pytest.mark.slow
@pytest.mark.parametrize("made", [stand_in, pytest.param(planned, marks=pytest.mark.slow)])
def test_every_number_is_that_of_the_commands_printed_in_it(made, tmp_path, monkeypatch, capsys):
    folder = made(tmp_path)
    monkeypatch.setattr("ocptip.api.report.CHART_POSTURES", 200)
    (tmp_path / "cases.toml").write_text("tilt_deg = [0, 1]\npayload_kg = [0]\n")
    monkeypatch.chdir(tmp_path)
    assert main(["report", folder.name, "--cases", "cases.toml", "--out", "first.html"]) in (0, 1)
    page = (tmp_path / "first.html").read_text(encoding="utf-8")
    report, *checks = (shlex.split(unescape(typed))[1:] for typed in re.findall("<code>(.*?)</code>", page))
    if made is planned:
        main([*report, "--out", "again.html"])
        assert (tmp_path / "again.html").read_text(encoding="utf-8") == page
    capsys.readouterr()
    for typed in checks:
        main([*typed, "-v"])
    said = " ".join(capsys.readouterr().out.split())
    motion = page[page.index("<h2>Motion") : page.index("<h2>Load cases")].replace("&nbsp;", " ")
    found = re.findall(r"<li>(.*?)</li>", motion) + re.findall(r"<tr>(<td>.*?)</tr>", motion)
    assert len(found) > 15
    assert "<h2>Cancels</h2>" in page
    assert re.search("of the acceleration limits", page[page.index("<h2>Cancels") :])
    lines = [" ".join(unescape(re.sub("<.*?>", " ", one)).split()) for one in found]
    lines = [re.sub("^(out|back): ", "", line) for line in lines]  # segments have headings in the terminal
    assert [line for line in lines if line not in said] == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([TASK, "--out", "report.txt"], "--out: path: expected a file NAME.html or NAME.pdf"),
        ([str(EXAMPLES / "tasks" / "delta_cart.toml")], "is of a parallel robot; report is about arms"),
    ],
)
def test_what_it_cannot_be_about_is_refused(tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert main(["report", *arguments]) == 2
    assert words in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_margins_by_speed_are_those_of_the_scaled_motion():
    """Of a check of the motion with other times; a contact is lost beyond the speed that robustness has."""
    task = experiment_task("A", limits=Limits(tolerance=NONE))
    moments, friction = margins_by_speed(task.robot, task.reference)
    for k in (0, 9):
        checked = check_motion(task.robot, task.reference.time_scaled(1 / SPEEDS[k]), task.limits)
        assert moments[k] == pytest.approx(max(checked.contacts.moment.value, 0.0), rel=0.02)
        assert friction[k] == pytest.approx(checked.worst["GT"].value, rel=0.02)
    faster = next(one for one in robustness(task, task.reference) if one.quantity == "faster")
    lost = 1 + faster.value / 100
    assert ((moments > 0) & (friction < 1) == (lost > SPEEDS)).all()
    assert SPEEDS[0] < lost < SPEEDS[-1]
