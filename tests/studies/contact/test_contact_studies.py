"""Every study runs with tiny options, writes what it promises, and its yardsticks see what they should."""

from __future__ import annotations

import dataclasses
import json
import sys

import numpy as np
import pytest

from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Support
from ocptip.contact.verdict import Equilibrium
from studies.contact import general_position, linear_programs, peers, random_problems, reserve_timing
from studies.contact import problems as contact_problems
from studies.contact import robustness as contact_robustness
from studies.contact import solvers as contact_solvers
from studies.contact import timing as contact_timing
from studies.contact import verdicts as contact_verdicts
from studies.contact import yardstick as contact_yardstick
from studies.contact.random_supports import random_support, random_wrenches


@pytest.fixture(scope="module")
def robustness(tmp_path_factory):
    """Folder, data and printed table of a small run."""
    out = tmp_path_factory.mktemp("robustness")
    assert contact_robustness.main(["--out", str(out), "--loads", "6", "--feet", "3", "4"]) == 0
    return out, json.loads((out / "contact_robustness.json").read_text())


@pytest.mark.slow
def test_robustness_study_counts_every_problem(robustness):
    _, data = robustness
    for r in data["results"]:
        assert r["solved"] + r["failed"] + r["wrong"] == r["problems"]
        assert sum(r["failures"].values()) == r["failed"]
    ours = [r for r in data["results"] if r["solver"] == "ocptip"]
    assert {r["case"] for r in ours} >= {"circle_3_feet_4_facets", "degenerate_8_feet_12_facets", "random"}
    assert all(r["failed"] == r["wrong"] == 0 and r["worst_violation"] < 1e-9 for r in ours)
    textbook = [r for r in data["results"] if r["solver"].endswith("textbook")]
    assert sum(r["failed"] for r in textbook) > 0
    timed = [r for r in data["results"] if r["case"].startswith("circle")]
    assert all(r["microseconds"] > 0 for r in timed)
    assert data["versions"]["numpy"] == np.__version__
    assert data["options"]["seed"] == 0


@pytest.mark.slow
def test_robustness_study_writes_table_and_figure(robustness):
    out, data = robustness
    text = (out / "contact_robustness.md").read_text()
    for name in {r["solver"] for r in data["results"]}:
        assert f"| {name} |" in text
    widths = {
        line.count("|") for line in text.split("## 4 facets: failed + wrong")[1].split("##")[0].split("\n")
    }
    assert widths == {0, 4}
    assert (out / "contact_robustness.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_robustness_study_keeps_finished_cases(robustness, monkeypatch, capsys):
    out, data = robustness
    monkeypatch.setattr(contact_robustness, "run_compiled", None)
    monkeypatch.setattr(contact_robustness, "run_peer", None)
    assert contact_robustness.main(["--out", str(out), "--loads", "6", "--feet", "3", "4"]) == 0
    assert json.loads((out / "contact_robustness.json").read_text()) == data
    assert capsys.readouterr().err == ""


def test_robustness_study_can_be_interrupted(tmp_path, monkeypatch, capsys):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(contact_robustness, "run_peer", stop)
    monkeypatch.setattr(contact_solvers.EXTERNAL[0], "available", lambda: True, raising=False)
    assert contact_robustness.main(["--out", str(tmp_path), "--loads", "2", "--feet", "3"]) == 130
    assert "start again" in capsys.readouterr().err
    assert len(list(tmp_path.glob("contact_robustness_cases/*.json"))) == 1


@pytest.mark.parametrize("options", [["--loads", "0"], ["--feet", "0"], []])
def test_robustness_study_refuses_bad_options(options, tmp_path, capsys):
    out = ["--out", str(tmp_path)] if options else []
    with pytest.raises(SystemExit) as stopped:
        contact_robustness.main([*out, *options])
    assert stopped.value.code == 2
    assert "--" in capsys.readouterr().err


def test_loads_are_those_of_the_published_generator():
    """Written out as in the findings that the study repeats: the draws of numpy's generator, one by one."""
    rng = np.random.default_rng(0)
    for wrench in contact_problems.random_loads(5, 0):
        level = rng.uniform(0, 1)
        expected = np.r_[
            rng.normal(size=2) * 250 * level,
            -60 * 9.81 + rng.normal() * 150 * level,
            rng.normal(size=3) * [90, 90, 60] * level,
        ]
        np.testing.assert_allclose(wrench, expected)


def test_pyramid_yardstick_accepts_solutions_and_sees_errors():
    support = contact_problems.platform_on(4, 8)
    wrenches = contact_problems.random_loads(50, 1)
    forces = solve_many(support, wrenches).contact_forces
    assert np.all(contact_yardstick.violation(support, wrenches, forces, True) >= 0)
    assert np.max(contact_yardstick.violation(support, wrenches, forces, False)) < 1e-12
    # forces that are missing, scaled up, or adhesive
    for wrong in (0 * forces, 1.001 * forces, forces - [1.0, 0.0, 0.0]):
        off = contact_yardstick.violation(support, wrenches, wrong, False)
        assert np.min(off) > contact_yardstick.WRONG
    assert np.all(~(contact_yardstick.violation(support, wrenches, np.nan * forces, False) <= 1e-6))


@pytest.mark.parametrize(
    ("force", "motion", "expected"),
    [
        ([100, 30, -40], [0, 0, 0], 0.0),  # inside the cone, at rest
        ([100, 30, -40], [0, -3, 4], 0.0),  # on the cone, slip opposed to friction
        ([0, 0, 0], [2, 1, -1], 0.0),  # separated
        ([100, 60, 0], [0, 0, 0], 0.10),  # outside the cone
        ([-10, 0, 0], [0, 0, 0], 0.10),  # adhesion
        ([50, 0, 0], [2, 0, 0], 0.20),  # pushes while it lifts off
        ([0, 0, 0], [-1, 0, 0], 0.10),  # penetrates
        ([100, 50, 0], [0, 0, -2], 0.10),  # friction across the slip
        ([100, 50, 0], [0, 2, 0], 0.20),  # friction along the slip
        ([100, 0, 0], [0, 1, 0], 0.05),  # slips without friction
    ],
)
def test_cone_yardstick(force, motion, expected):
    """Worked by hand: mass 10 kg, friction 0.5, violations as shares of 100 N."""
    contact = UnilateralContact(position=[0, 0, 0], friction=0.5)
    off = contact_yardstick.cone_violation(
        contact, np.array([force], dtype=float), np.array([motion], dtype=float), np.array([100.0]), 10.0
    )
    assert off[0] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("peer", peers.available_peers(), ids=lambda peer: peer.name)
def test_peers_hold_the_weight(peer):
    support = contact_problems.platform_on(3, 8)
    answer = peer.solve(*contact_solvers.arguments(support), support.weight)
    if answer.converged and not peer.name.endswith("raw"):
        np.testing.assert_allclose(answer.acceleration, 0.0, atol=1e-6)
        assert answer.forces[:, 0].sum() == pytest.approx(588.6, rel=1e-6)
    else:
        assert peer.name.endswith(("raw", "textbook"))


@pytest.mark.slow
def test_timing_study(tmp_path, capsys):
    options = ["--loads", "10", "--states", "40", "--unsorted", "50", "--rounds", "2", "--feet", "3"]
    assert contact_timing.main(["--out", str(tmp_path), *options]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert printed.out == (tmp_path / "contact_timing.md").read_text()
    data = json.loads((tmp_path / "contact_timing.json").read_text())
    (row,) = data["automaton"]
    assert row["ocptip"]["solved"] == 10
    assert row["ratio"] > 0
    assert row["best"] in row["conventional"]
    assert not any("textbook" in name for name in row["conventional"])
    assert [path["solved"] for path in data["many_states"]] == [40, 40]
    assert data["many_states"][0]["standing_share"] == 1.0
    assert data["many_states"][1]["standing_share"] < 1.0
    assert all(path["largest_violation"] < 1e-9 for path in data["many_states"])
    assert data["unsorted"]["standing"] == data["unsorted"]["states"] == 50
    assert data["unsorted"]["pivots_mean"]["any"] < data["unsorted"]["pivots_mean"]["neighbour"]
    assert data["unsorted"]["largest_violation"] < 1e-9
    assert all(reserve["certified"] == reserve["states"] for reserve in data["slip_reserve"])


@pytest.mark.slow
def test_random_problems(monkeypatch):
    monkeypatch.setattr(random_problems, "CHUNK", 5 * random_problems.WRENCHES)
    chunks = [random_problems.run_chunk(3, i) for i in range(2)]
    again = random_problems.run_chunk(3, 0)
    untimed = [{k: v for k, v in chunk.items() if k != "solve_seconds"} for chunk in (chunks[0], again)]
    assert untimed[0] == untimed[1]
    total = random_problems.summary(chunks, 3)
    assert total["problems"] == 200
    assert total["wrong_answers"] == total["failures"] == 0
    assert total["worst_residual"] < 1e-9
    assert sum(total["contacts"].values()) == 200
    assert json.loads(json.dumps(total)) == total


def test_random_problems_goes_on_where_it_stopped(tmp_path, monkeypatch, capsys):
    """With all chunks in the folder nothing is computed, only added up."""
    monkeypatch.setattr(random_problems, "CHUNK", random_problems.WRENCHES)
    path = tmp_path / "chunk_0_0000.json"
    path.write_text(json.dumps(random_problems.run_chunk(0, 0)))
    monkeypatch.setattr(random_problems, "run_chunk", None)
    monkeypatch.setattr(sys, "argv", ["random_problems.py", "--out", str(tmp_path), "--problems", "20"])
    random_problems.main()
    total = json.loads((tmp_path / "random_problems.json").read_text())
    assert total["problems"] == 20
    assert total["chunks_of_an_unknown_state_of_the_source"] == 1
    assert total["chunks_of_another_state_of_the_source"] == 0
    assert "wrong_answers: 0" in capsys.readouterr().out


def test_random_supports_are_reproducible_and_keep_their_promises():
    rng, same = np.random.default_rng(5), np.random.default_rng(5)
    for _ in range(20):
        support, twin = random_support(rng, clamps=False), random_support(same, clamps=False)
        assert 2 <= support.n_contacts <= 8
        assert all(contact.kind == "unilateral" for contact in support.contacts)
        np.testing.assert_array_equal(support.wrench_matrix, twin.wrench_matrix)
        wrenches = random_wrenches(rng, support, 3)
        np.testing.assert_array_equal(wrenches, random_wrenches(same, twin, 3))


def test_reserve_timing(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["reserve_timing.py", "--states", "10", "--repeats", "1"])
    reserve_timing.main()
    rows = [line for line in capsys.readouterr().out.splitlines() if "%" in line]
    assert [row.split()[0] for row in rows] == ["3", "4", "6", "8"]


@pytest.mark.slow
def test_verdicts_study_finds_no_contradiction(tmp_path, capsys):
    options = ["--stands", "1", "--checked", "4", "--feet", "4"]
    assert contact_verdicts.main(["--out", str(tmp_path), *options]) == 0
    data = json.loads((tmp_path / "contact_verdicts.json").read_text())
    assert capsys.readouterr().out == (tmp_path / "contact_verdicts.md").read_text()
    assert [row["layout"] for row in data["times"]] == ["circle", "scattered"]
    assert data["agreement"]["contradictions"] == 0


@pytest.mark.slow
def test_reserves_in_general_position_are_those_of_the_cone_program(tmp_path, capsys):
    options = ["--stands", "8", "--loads", "3", "--feet", "4", "5"]
    assert general_position.main(["--out", str(tmp_path), *options]) == 0
    assert capsys.readouterr().out == (tmp_path / "general_position.md").read_text()
    data = json.loads((tmp_path / "general_position.json").read_text())
    assert [row["feet"] for row in data["summary"]] == [4, 5, None]
    everything = data["summary"][-1]
    assert everything["states"] > 15
    assert everything["without_program"] == 0
    assert everything["largest_difference"] < 1e-7
    assert everything["ratio_min"] < 1 < everything["ratio_max"]
    assert (tmp_path / "general_position.png").read_bytes().startswith(b"\x89PNG")


def test_the_program_of_the_definition_knows_a_table():
    """300 N on a square table, side 0.8 m: half of its width times the weight turns it over."""
    places = np.array([[0.4, 0.4, 0], [-0.4, 0.4, 0], [-0.4, -0.4, 0], [0.4, -0.4, 0]])
    normals = np.tile([0.0, 0.0, 1.0], (4, 1))
    axes = general_position.axes_of(places, normals)
    assert len(axes) == 4
    weight = np.r_[0, 0, -300.0, 0, 0, 0]
    for _, e in axes:
        couple = general_position.largest_couple(places, normals, np.full(4, 0.5), weight, e)
        assert couple == pytest.approx(0.4 * 300)
    upwards = general_position.largest_couple(places, normals, np.full(4, 0.5), -weight, axes[0][1])
    assert np.isnan(upwards)


@pytest.mark.slow
def test_linear_programs_contradict_no_state_and_no_verdict(tmp_path, capsys):
    options = ["--problems", "300", "--enumerated", "12"]
    assert linear_programs.main(["--out", str(tmp_path), *options]) == 0
    assert capsys.readouterr().out == (tmp_path / "linear_programs.md").read_text()
    data = json.loads((tmp_path / "linear_programs.json").read_text())
    assert data["programs"]["different"] == data["enumeration"]["different"] == []
    counts = data["programs"]["counts"]
    assert counts["balanced"] + counts["unbalanced"] + counts.get("open", 0) == 300
    assert min(counts["balanced"], counts["unbalanced"], counts["stand"]) > 50
    assert counts["not solved"] == 0
    assert set(data["enumeration"]["counts"]) >= {"none", "strong"}


@pytest.mark.slow
def test_linear_programs_see_what_is_wrong(monkeypatch):
    """A verdict turned round, and a convex test that always holds, are found out."""
    stands = Equilibrium(True, 1.0, None, None, 1)
    monkeypatch.setattr(linear_programs, "equilibrium", lambda *_, **__: stands)
    part = linear_programs.against_programs(40, 0)
    assert len(part["different"]) == part["counts"]["unbalanced"] > 0
    honest = linear_programs.stability
    turned = {"strong": "weak", "weak": "none", "none": "strong"}
    monkeypatch.setattr(
        linear_programs,
        "stability",
        lambda *a: dataclasses.replace(verdict := honest(*a), verdict=turned[verdict.verdict]),
    )
    assert len(linear_programs.against_enumeration(4, 0)["different"]) == 4


def test_power_of_a_block_on_the_floor():
    """20 kg pushed with 150 N at friction 0.5: it slides with 51.9 N of net force; held at 90 N."""
    contacts = [UnilateralContact(position=[x, 0.0], normal=[0, 1], friction=0.5) for x in (-0.3, 0.3)]
    support = Support(contacts, mass=20.0, center_of_mass=[0.0, 0.0])
    pushed, held = (support.weight + np.array([push, 0.0, 0.0]) for push in (150.0, 90.0))
    slides = linear_programs.largest_power(support, pushed)
    net = 150 - 0.5 * 20 * 9.81
    free = (150**2 + (20 * 9.81) ** 2) / 20
    assert slides == pytest.approx([150 * net / 20 / free] * 2)
    assert linear_programs.largest_power(support, held) == pytest.approx([0, 0], abs=1e-9)
