"""The command line: what it prints, its exit codes, and that nothing ends in a traceback."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import ocptip
from ocptip.basics.write import MARK
from ocptip.cli.main import main
from ocptip.contact import pivoting, verdict
from ocptip.contact.solver import solve, solve_many
from ocptip.contact.verdict import stability
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver
from ocptip.task_files.scene import read_scene
from tests.quick import some

ISSUE_SCENE = """\
[base]
mass = 60.0
center_of_mass = [0, 0, 0.6]
[[contact]]
kind = "unilateral"
position = [0.35, 0, 0]
friction = 0.5
[[contact]]
kind = "unilateral"
position = [-0.2, 0.3, 0]
friction = 0.5
[[contact]]
kind = "unilateral"
position = [-0.2, -0.3, 0]
friction = 0.5
[[load]]
force = [40, 0, 0]
point = [0, 0, 1.0]
"""

CHIMNEY_SCENE = """\
[base]
mass = 20
center_of_mass = [0, 0]
[[contact]]
kind = "unilateral"
position = [-0.3, 0]
normal = [1, 0]
friction = 0.9
[[contact]]
kind = "unilateral"
position = [0.3, 0]
normal = [-1, 0]
friction = 0.9
"""

POINT_CONTACT = """\
[[contact]]
kind = "unilateral"
position = [0, 0, 0]
friction = 0.5
"""

PLANAR_SCENE = """\
[base]
mass = 20
center_of_mass = [0.1, 0.4]
[[contact]]
kind = "unilateral"
position = [-0.3, 0]
friction = 0.5
[[contact]]
kind = "unilateral"
position = [0.35, 0]
friction = 0.5
"""


@pytest.fixture
def scene_file(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(ISSUE_SCENE)
    return path


def run(*arguments, **environment):
    """The command in a process of its own; without its progress, which a slow machine adds."""
    code = "import sys; from ocptip.cli.main import main; sys.exit(main())"
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=120,
        env={**os.environ, **environment},
        check=False,
    )
    done.stderr = re.sub(r"^ocptip \w+: .* \(\d+ s\)\n", "", done.stderr, flags=re.MULTILINE)
    return done


def stand_json(capsys, *arguments):
    code = main(["stand", *map(str, arguments), "--json"])

    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    return code, json.loads(capsys.readouterr().out, parse_constant=refuse)


def test_json_has_the_promised_keys(capsys, scene_file):
    code, result = stand_json(capsys, scene_file)
    assert code == 0
    assert result["persistent"] is True
    assert result["solved"] is True
    assert result["status"] == "solved"
    assert result["stability"] == "strong"
    assert result["modes"] == ["stick"] * 3
    assert result["kinds"] == ["unilateral"] * 3
    assert np.array(result["forces"]).shape == (3, 3)
    assert np.array(result["acceleration"]).shape == (6,)
    assert 0 < result["GN"] < 1
    assert 0 < result["GT"] < 1
    assert result["redistribution"] in ("tangential", "full")
    assert len(result["normal_forces"]) == len(result["forces"])
    assert result["residual"] < 1e-9
    assert isinstance(result["pivots"], int)
    assert set(result["versions"]) >= {"ocptip", "numpy", "scipy", "llvmlite", "clarabel"}
    assert result["versions"]["ocptip"] == ocptip.__version__


def test_json_numbers_are_those_of_the_library(capsys, scene_file):
    _, result = stand_json(capsys, scene_file)
    scene = read_scene(scene_file)
    states = solve_many(scene.support, scene.wrench[None])
    tip, slip = TipOver(scene.support).evaluate(states), Slip(scene.support).evaluate(states)
    assert result["forces"] == states.forces[0].tolist()
    assert result["acceleration"] == states.acceleration[0].tolist()
    assert (result["GN"], result["GT"]) == (tip.GN[0], slip.GT[0])
    axis = tip.tip_over.axes[tip.nearest_axis[0]]
    assert result["tipping_axis"]["contacts"] == [k + 1 for k in axis.contacts]
    assert result["tipping_axis"]["moment_reserve"] == tip.moments[0].min()
    # statics: the forces carry weight and load
    np.testing.assert_allclose(np.sum(result["forces"], axis=0), [-40, 0, 60 * 9.81], atol=1e-9)


def test_moment_reserve_by_hand(capsys, scene_file):
    # Weight 588.6 N, load 40 N at 1 m. About the axis through contacts 1 and 2 (and, mirrored, 1 and 3):
    # distance of a line through (0.35, 0) and (-0.2, 0.3) from (40 / 588.6, 0) times the weight.
    _, result = stand_json(capsys, scene_file)
    weight = 60 * 9.81
    expected = weight * (0.35 - 40 / weight) * 0.3 / math.hypot(0.55, 0.3)
    assert result["tipping_axis"]["moment_reserve"] == pytest.approx(expected, rel=1e-9)


def test_table_says_the_same_as_json(capsys, scene_file):
    _, result = stand_json(capsys, scene_file)
    assert main(["stand", str(scene_file)]) == 0
    text = capsys.readouterr().out
    assert text.splitlines()[0] == "scene.toml   STABLE."
    rows = [line for line in text.splitlines() if "unilateral" in line]
    for number, (row, force, share) in enumerate(
        zip(rows, result["forces"], result["friction_used"], strict=True), 1
    ):
        assert row.split()[0] == str(number)
        assert f"{force[2]:.4g} N" in row
        assert f"{100 * share:.0f} %" in row
    assert f"Friction used   {100 * result['GT']:.3g} %" in text
    assert "stability" not in text
    assert main(["stand", str(scene_file), "-v"]) == 0
    text = capsys.readouterr().out
    assert f"{result['GN']:.3g} (" in text
    assert f"{result['GT']:.3g} (" in text
    assert f"stability    strong: {result['stability_explanation']}" in text
    low, high = sorted(result["tipping_axis"]["contacts"])
    assert (
        f"{result['tipping_axis']['moment_reserve']:.4g} N m (axis through contacts {low} and {high})" in text
    )
    assert text.isascii()


def test_not_standing_is_exit_code_1_and_says_what_moves(capsys, scenes):
    assert main(["stand", str(scenes / "pushed_cart.toml")]) == 1
    text = capsys.readouterr().out
    assert text.splitlines()[0] == "pushed_cart.toml   NOT STABLE. Contacts 3 and 4 lift off."
    assert "acceleration" in text
    code, result = stand_json(capsys, scenes / "pushed_cart.toml")
    assert code == 1
    assert (result["persistent"], result["stability"]) == (False, "none")
    assert result["GN"] > 1
    assert np.linalg.norm(result["acceleration"]) > 0.1


def test_a_base_on_a_point_has_no_reserve(capsys, tmp_path):
    path = tmp_path / "point.toml"
    path.write_text(CHIMNEY_SCENE.split("[[contact]]")[0].replace("[0, 0]", "[0, 0, 1]") + POINT_CONTACT)
    code, result = stand_json(capsys, path)
    assert (code, result["persistent"], result["without_reserve"], result["GN"]) == (0, True, "tips", 1)
    main(["stand", str(path)])
    text = " ".join(capsys.readouterr().out.split())
    assert text.startswith("point.toml IN BALANCE WITHOUT ANY MARGIN. Any push tips it.")
    assert "STABLE" not in text
    assert "Under exactly this load; there is no margin." in text


def test_a_base_at_the_slip_force_has_no_reserve(capsys, tmp_path):
    path = tmp_path / "plane.toml"
    for force, expected in ((98.1, "slips"), (98.0, None)):
        path.write_text(PLANAR_SCENE + f"[[load]]\nforce = [{force}, 0]\npoint = [0, 0]\n")
        code, result = stand_json(capsys, path)
        assert (code, result["without_reserve"]) == (0, expected)


@pytest.mark.parametrize("inertia", [1e-12, 1e12])
def test_a_motion_beyond_the_resolution_is_said(capsys, scenes, tmp_path, inertia):
    path = tmp_path / "scene.toml"
    text = (scenes / "pushed_cart.toml").read_text()
    path.write_text(re.sub("inertia = .*", f"inertia = {[inertia] * 3}", text))
    assert main(["stand", str(path)]) == 1
    text = capsys.readouterr().out
    assert text.startswith("scene.toml   NOT STABLE. It moves, but how is beyond the numerical resolution")
    assert "none: No admissible contact forces" in text


def test_an_unexpected_error_is_exit_code_3_in_one_line(capsys, scene_file, monkeypatch):
    def broken(*_):
        raise TypeError("first line\nsecond line")

    monkeypatch.setattr("ocptip.api.stand.stability", broken)
    monkeypatch.delenv("OCPTIP_DEBUG", raising=False)
    assert main(["stand", str(scene_file)]) == 3
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("ocptip: internal error: TypeError: first line second line; please report it")
    assert err.count("\n") == 1
    monkeypatch.setenv("OCPTIP_DEBUG", "1")
    assert main(["stand", str(scene_file)]) == 3
    assert "Traceback" in capsys.readouterr().err


def test_sliding_is_named(capsys, scene_file):
    scene_file.write_text(ISSUE_SCENE.replace("0.5\n", "0.05\n").replace("[40, 0, 0]", "[60, 0, 0]"))
    code, result = stand_json(capsys, scene_file)
    assert (code, result["modes"]) == (1, ["slide"] * 3)
    main(["stand", str(scene_file)])
    assert capsys.readouterr().out.splitlines()[0].endswith("NOT STABLE. Contacts 1, 2 and 3 slide.")


ALL_FACETS = (4, 6, 8, 12, 16, 24, 32, 64)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("share", "counts"),
    [
        (0.999, (4, 6, 64)),
        (1.001, (4, 64)),
        *(pytest.param(share, ALL_FACETS, marks=pytest.mark.slow) for share in (0.97, 0.999, 1.001, 1.03)),
    ],
)
def test_the_answer_does_not_depend_on_facets(capsys, scene_file, share, counts):
    """A push near the friction force: four faces are 13 % nearer, their edges 17 % farther."""
    push = share * 0.53 * 60 * 9.81
    load = f"[{push / 2**0.5:.6f}, {push / 2**0.5:.6f}, 0]"
    remarks = set()
    for facets in counts:
        text = ISSUE_SCENE.replace("friction = 0.5", f"friction = 0.53\nfacets = {facets}")
        text = text.replace("[40, 0, 0]", load).replace("0, 0, 1.0", "0, 0, 0.0")
        scene_file.write_text(text.replace("0, 0, 0.6", "0, 0, 0.05"))
        code, result = stand_json(capsys, scene_file)
        stands = share < 1
        assert (code, result["persistent"]) == ((0, True) if stands else (1, False))
        assert result["stability"] == ("strong" if stands else "none")
        main(["stand", str(scene_file)])
        text = capsys.readouterr().out
        assert text.startswith("scene.toml   STABLE." if stands else "scene.toml   NOT STABLE")
        assert (result["remark"] or "") in text
        if stands:
            assert result["GT"] == pytest.approx(share, rel=1e-4)
            np.testing.assert_allclose(
                np.sum(result["forces"], axis=0), [-push / 2**0.5] * 2 + [588.6], rtol=1e-6
            )
            assert result["modes"] == ["stick"] * 3
        else:
            assert result["GT"] > 1
        remarks |= {result["remark"]}
        assert (result["remark"] is None) == ("between friction" not in result["stability_explanation"])
    assert len(remarks) == 2  # the case lies between pyramid and cone for some facets


def test_a_clamp_beyond_its_cone_does_not_hold(capsys, scene_file):
    """Pyramids of four faces would hold 4 % more than the friction, along their edges."""
    push = 1.04 * 0.53 * 60 * 9.81
    text = ISSUE_SCENE.replace("friction = 0.5", "friction = 0.53\nfacets = 4").replace(
        "0, 0, 1.0", "0, 0, 0.0"
    )
    text = text.replace("[40, 0, 0]", f"[{push / 2**0.5:.6f}, {push / 2**0.5:.6f}, 0]")
    text = text.replace("0, 0, 0.6", "0, 0, 0.05").replace('"unilateral"', '"rigid-clamp"', 1)
    scene_file.write_text(text.replace("friction = 0.53", "friction_upper = 0.53\nfriction_lower = 0.53", 1))
    code, result = stand_json(capsys, scene_file)
    assert (code, result["persistent"], result["stability"]) == (1, False, "none")
    assert result["modes"] == ["stick"] * 3
    assert result["GT"] == pytest.approx(1.04, rel=1e-6)
    assert "reaching beyond Coulomb's cones" in result["remark"]


def test_two_solutions_are_not_called_sure(capsys, tmp_path):
    """Feet that face each other: jammed, or sliding down."""
    path = tmp_path / "chimney.toml"
    path.write_text(CHIMNEY_SCENE)
    code, result = stand_json(capsys, path)
    assert (code, result["persistent"], result["stability"]) == (1, False, "weak")
    assert set(result["counterexample"]) != {"stick"}
    main(["stand", str(path)])
    headline = capsys.readouterr().out.splitlines()[0]
    assert headline.startswith("chimney.toml   NOT SURE. One solution of the contact laws is stable")


def test_a_search_cut_short_leaves_the_word_to_the_solver(capsys, scene_file, monkeypatch):
    def undecided(support, wrench):
        return dataclasses.replace(stability(support, wrench), verdict="weak", decided=False)

    monkeypatch.setattr("ocptip.api.stand.stability", undecided)
    assert main(["stand", str(scene_file)]) == 0
    assert "STABLE in this solution. Others are possible" in capsys.readouterr().out
    scene_file.write_text(ISSUE_SCENE.replace("[40, 0, 0]", "[400, 0, 0]"))
    assert main(["stand", str(scene_file)]) == 1
    assert "scene.toml   NOT SURE" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["tripod_with_arm", "rover_on_slope", "clamped_tripod"])
def test_standing_example_scenes_stand(capsys, scenes, name):
    code, result = stand_json(capsys, scenes / f"{name}.toml")
    assert (code, result["persistent"]) == (0, True)
    assert result["stability"] in ("strong", "weak")
    assert result["GN"] < 1
    assert result["GT"] < 1


def test_the_clamp_holds_more_than_the_weight(capsys, scenes, tmp_path):
    _, result = stand_json(capsys, scenes / "clamped_tripod.toml")
    clamp = result["forces"][2][2]
    assert -29.33 < clamp < 0
    assert result["normal_reserves"][2] == pytest.approx(clamp + 29.33)
    text = (scenes / "clamped_tripod.toml").read_text()
    free = tmp_path / "free.toml"
    text = re.sub('"force-const.*?"', '"unilateral"', text).replace("friction_upper", "friction")
    free.write_text(re.sub("(friction_lower|clamp_force).*\n", "", text))
    assert stand_json(capsys, free)[0] == 1


def test_planar_scene(capsys, tmp_path):
    path = tmp_path / "planar.toml"
    path.write_text(PLANAR_SCENE)
    code, result = stand_json(capsys, path)
    assert code == 0
    assert np.array(result["forces"]).shape == (2, 2)
    assert len(result["acceleration"]) == 3
    main(["stand", str(path)])
    assert "position x, y [m]" in capsys.readouterr().out


def test_an_unsolved_state_is_honest(capsys, scene_file, monkeypatch):
    def unsolved(support, wrench):
        states = solve(support, wrench).states
        values = {field.name: getattr(states, field.name) for field in dataclasses.fields(states)}
        unknown = {
            name: np.full_like(value, np.nan)
            for name, value in values.items()
            if isinstance(value, np.ndarray) and value.dtype == float and name != "wrenches"
        }
        unknown |= {"solved": np.array([False]), "status_codes": np.array([pivoting.RAY])}
        unknown |= {"subsets": np.full_like(states.subsets, -1), "residual": np.array([np.inf])}
        return dataclasses.replace(states, **unknown)[0]

    monkeypatch.setattr(verdict, "solve", unsolved)
    code, result = stand_json(capsys, scene_file)
    assert code == 1
    assert (result["solved"], result["persistent"]) == (False, False)
    assert "no solution: " in result["status"]
    assert result["forces"] == [[None] * 3] * 3
    assert result["residual"] is None
    assert result["GT"] is None
    target = scene_file.with_suffix(".png")
    assert main(["stand", str(scene_file), "--plot", str(target)]) == 1
    assert "NO ANSWER. No solution: " in capsys.readouterr().out
    assert target.stat().st_size > 10_000


def test_gn_reference_moment(capsys, scene_file):
    _, result = stand_json(capsys, scene_file, "--gn-reference", 10)
    reserve = result["tipping_axis"]["moment_reserve"]
    assert result["GN"] == pytest.approx(10 / (10 + reserve))
    best = "0.09: the best at rest without load"
    for options in ([], ["--gn-reference", "10"]):  # which holds for the support's own moment
        main(["stand", str(scene_file), "-v", *options])
        assert (best in capsys.readouterr().out) == (not options)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["nowhere.toml"], "nowhere.toml: no such file"),
        (["{scene}", "--gn-reference", "0"], "--gn-reference: must be > 0"),
        (["{scene}", "--gn-reference", "nan"], "--gn-reference: must be finite"),
        (["{scene}", "--plot", "{dir}/missing/stand.png"], "--plot: no such directory: {dir}/missing"),
        (["{scene}", "--plot", "{dir}/stand.txt"], "--plot: expected a file name ending in .png, .pdf, .svg"),
        (["{scene}", "--plot", "{dir}/stand"], "--plot: expected a file name ending in"),
        (["{weightless}"], "--gn-reference: gravity is zero"),
        (["{bad}"], "bad.toml: contact[1].friction: must be >= 0, got -0.5"),
    ],
)
def test_bad_input_is_exit_code_2_in_one_line(capsys, scene_file, tmp_path, arguments, expected):
    bad = tmp_path / "bad.toml"
    bad.write_text(ISSUE_SCENE.replace("friction = 0.5", "friction = -0.5", 1))
    weightless = tmp_path / "weightless.toml"
    weightless.write_text("gravity = [0, 0, 0]\n" + ISSUE_SCENE)
    names = {"scene": scene_file, "dir": tmp_path, "bad": bad, "weightless": weightless}
    assert main(["stand", *(a.format(**names) for a in arguments)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"ocptip: {expected.format(**names)}")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    "arguments", [["--json"], ["stand"], ["fall"], ["stand", "a", "b"], ["stand", "a", "--gn-reference", "x"]]
)
def test_wrong_command_line_is_one_line(capsys, arguments):
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("ocptip: ")
    assert err.count("\n") == 1


@pytest.mark.slow
def test_plot_replaces_a_file_only_when_complete(capsys, scene_file, tmp_path, monkeypatch):
    from matplotlib.figure import Figure

    target = tmp_path / "stand.png"
    target.write_text("old")

    def full_disk(self, stream, **_):
        stream.write(b"half")
        raise OSError(28, "No space left on device", None)

    with monkeypatch.context() as patch:
        patch.setattr(Figure, "savefig", full_disk)
        assert main(["stand", str(scene_file), "--plot", str(target), "--overwrite"]) == 2
    assert capsys.readouterr().err == f"ocptip: {target}: No space left on device\n"
    assert target.read_text() == "old"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["scene.toml", "stand.png"]
    assert main(["stand", str(scene_file), "--plot", str(target), "--overwrite"]) == 0
    assert target.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("suffix", "start"), some(1, [(".PNG", b"\x89PNG"), (".pdf", b"%PDF"), (".svg", b"<?xml")])
)
def test_plot_formats(scene_file, tmp_path, suffix, start):
    target = tmp_path / f"stand{suffix}"
    assert main(["stand", str(scene_file), "--plot", str(target)]) == 0
    assert target.read_bytes().startswith(start)
    assert MARK.encode() in target.read_bytes()  # so that it may be replaced


def test_process_exit_codes(scenes, tmp_path):
    falls = run("stand", scenes / "pushed_cart.toml", "--json")
    assert (falls.returncode, falls.stderr) == (1, "")
    assert json.loads(falls.stdout)["persistent"] is False
    broken = tmp_path / "broken.toml"
    broken.write_text("[base\n")
    refused = run("stand", broken)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert re.fullmatch(r"ocptip: broken\.toml: broken TOML: .*line 1.*\n", refused.stderr)


@pytest.mark.slow
def test_names_outside_of_ascii_survive_any_terminal(tmp_path):
    path = tmp_path / "übung.toml"
    path.write_text(ISSUE_SCENE)
    result = run("stand", path, PYTHONIOENCODING="ascii", LC_ALL="C", PYTHONUTF8="0")
    assert (result.returncode, result.stderr) == (0, "")
    assert "bung.toml   STABLE" in result.stdout


def test_closed_pipe_is_no_error(scene_file):
    read_end, write_end = os.pipe()
    os.close(read_end)
    code = "import sys; from ocptip.cli.main import main; sys.exit(main())"
    result = subprocess.run(
        [sys.executable, "-c", code, "stand", str(scene_file)],
        stdout=write_end,
        stderr=subprocess.PIPE,
        check=False,
    )
    os.close(write_end)
    assert result.returncode == 0
    assert result.stderr == b""


def test_version(capsys):
    with pytest.raises(SystemExit) as caught:
        main(["--version"])
    assert caught.value.code == 0
    assert capsys.readouterr().out == f"ocptip {ocptip.__version__}\n"


def test_every_public_name_exists():
    for name in ocptip.__all__:
        assert getattr(ocptip, name) is not None
        assert name in dir(ocptip)
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = ocptip.nonsense


def commands(text):
    """The fenced one-line shell commands of the README."""
    return re.findall(r"```bash\n(.*?)\n```", text, flags=re.DOTALL)


def test_readme_commands_are_one_line_each_and_ci_runs_them(root):
    readme = (root / "README.md").read_text(encoding="utf-8")
    job, tests = commands(readme)[:2]
    assert "\n" not in job + tests
    assert job.startswith("python3 -m venv .venv && ")
    assert job.endswith("/ocptip plan A")
    assert tests.startswith("python3 -m venv .venv && ")
    assert tests.endswith(".venv/bin/pytest -q -n auto --dist worksteal")
    ci = (root / ".ci" / "run").read_text(encoding="utf-8")
    assert "README.md" in ci  # it reads the commands from there
    assert "set -euo pipefail" in ci
    assert os.access(root / ".ci" / "run", os.X_OK)


def printed_plan(root, page):
    """The lines of what `plan A` prints, as a page has them."""
    text = (root / page).read_text(encoding="utf-8")
    return re.search(r"```text\n(A   .*?)\n```", text, flags=re.DOTALL)[1].splitlines()


def test_readme_shows_a_plan(root):
    """As the page of the command line does."""
    lines = printed_plan(root, "README.md")
    assert lines == printed_plan(root, "docs/commands.md")
    assert lines[0] == "A   PROVED for 'workshop' uncertainty (default)"
    assert re.match(r"Motion  \d\.\d{3} s   \d+(\.\d)? J \(-\d+ % vs reference\)", lines[1])
    assert (root / "docs" / "motion.gif").read_bytes().startswith(b"GIF8")


@pytest.mark.slow
def test_docs_show_the_plan_that_the_command_prints(root, tmp_path, monkeypatch, capsys):
    """Verdict and words are the same, numbers nearly: the optimum differs by rounding on other processors."""
    monkeypatch.chdir(tmp_path)
    assert main(["plan", "A", "--no-figures"]) == 0
    shown, printed = printed_plan(root, "docs/commands.md"), capsys.readouterr().out.splitlines()
    number = r"\d+(?:\.\d+)?(?:e\d)?"
    last = next(k for k, line in enumerate(shown) if line.startswith("Files"))
    for line, other in zip(shown[:last], printed[:last], strict=True):
        assert re.sub(number, "#", line).split() == re.sub(number, "#", other).split()
        values, others = ([float(x) for x in re.findall(number, text)] for text in (line, other))
        assert values == pytest.approx(others, rel=0.05)


def test_docs_show_what_stand_prints(root, scenes, capsys):
    """Verdict and layout; with four wheels the forces are one choice of many and may differ."""
    page = (root / "docs" / "commands.md").read_text(encoding="utf-8")
    shown = re.search(r"```text\n(rover_on_slope.*?)\n```", page, flags=re.DOTALL)[1].splitlines()
    main(["stand", str(scenes / "rover_on_slope.toml")])
    printed = capsys.readouterr().out.splitlines()
    assert shown[:4] == printed[:4]
    for line in ("Min foot force", "contact", "      4  unilateral"):
        assert any(text.startswith(line) for text in shown)
        assert any(text.startswith(line) for text in printed)
    assert (root / "docs" / "stand.png").read_bytes().startswith(b"\x89PNG")


def test_docs_list_every_binding_and_its_keys(root):
    from ocptip.contact.bindings.binding import Binding

    readme = (root / "docs" / "scenes.md").read_text(encoding="utf-8")
    for kind, cls in Binding.registry.items():
        if cls.__module__.startswith("ocptip."):
            assert f"`{kind}`" in readme
            for key in cls.parameter_names():
                assert f"`{key}`" in readme, key


def test_feet_that_give(capsys):
    file = "src/ocptip/examples/scenes/cart_on_rubber.toml"
    assert main(["stand", file]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "feet compressed by 0.424 mm to 1.06 mm; forces are those of their springs on level ground" in text
    assert main(["stand", file, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    pressed = -2e5 * np.array(data["foot_motions"])[:, 0]
    assert np.allclose(pressed, data["normal_forces"])
    assert data["redistribution"] == "tangential"


@pytest.mark.slow
def test_a_terminated_command_ends_its_processes_and_says_so(tmp_path):
    command = [
        sys.executable,
        "-m",
        "ocptip",
        "plan",
        "F",
        "--out",
        "plan",
    ]  # takes long: it has an uncertainty
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as process:
        time.sleep(2.0)
        process.terminate()
        try:
            _, said = process.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            process.kill()  # else the block would wait for it
            raise
    # CPython ends as if killed where the signal came within an exec, as those of imported dataclasses
    assert process.returncode in (130, -signal.SIGINT)
    assert any(line.startswith("ocptip: interrupted") for line in said.splitlines())
    assert not (tmp_path / "plan").exists()
