"""The study of jumps and S-curves: its tasks, its tables from rows, and that it goes on."""

import json

import pytest

from studies.s_curves import run as study


def row(case, variant, energy, **more):
    feet = [{"stiffness": 1e6, "force_N": 3.0, "lift_mm": 0.0, "falls": False}]
    return {
        "case": case,
        "variant": variant,
        "energy_J": energy,
        "duration_s": 1.5,
        "cpu_s": 2.0,
        "feet": feet,
        **more,
    }


def test_variants_differ_in_what_they_are_named_for():
    tasks = {variant: study.task_of("A", variant) for variant in study.VARIANTS}
    assert [task.rise_times[:1] for task in tasks.values()] == [(), (), (0.02,), (0.05,), (0.1,)]
    assert [task.limits.overshoot > 0 for task in tasks.values()] == [False, True, False, False, False]
    assert study.task_of(study.CART, "carried").limits.overshoot == pytest.approx(0.8545, abs=1e-4)


def test_tables_say_what_was_not_run():
    rows = [row("A", "ramps", 100.0, jump_GN=2.5), row("A", "S 50 ms", 102.0), row("B", "carried", None)]
    text = study.markdown(rows, {"starts": 4, "seed": 0}, "now")
    assert "| A | 100.0, 1.500 (1.000) | - | - | 102.0, 1.500 (1.020) | - |" in text
    assert "| B | - | no plan | - | - | - |" in text
    assert "| S 50 ms | 1 | 1.020 | 1.000 | 1.000 |" in text
    assert "| A | 3.0 | - | - | 3.0 | - |" in text


def test_bases_with_clamps_have_no_feet_that_give():
    plain, clamped = (study.task_of(case, "ramps") for case in "AC")
    assert study.on_feet(plain.robot, 1e6).support.elastic is not None
    assert study.on_feet(clamped.robot, 1e6) is None


def test_finished_rows_are_kept(tmp_path, monkeypatch):
    asked = []

    def planned(case, variant, starts, seed):
        asked.append(variant)
        return row(case, variant, 100.0)

    monkeypatch.setattr(study, "row_of", planned)
    arguments = ["--out", str(tmp_path), "--cases", "A", "--starts", "2"]
    assert study.main([*arguments, "--limit", "-1"]) == 0
    assert asked == []
    assert study.main(arguments) == study.main(arguments) == 0
    assert asked == list(study.VARIANTS)
    assert len(json.loads((tmp_path / "s_curves.json").read_text())["rows"]) == 5
    assert (tmp_path / "s_curves.md").read_text().startswith("# Jumps")
