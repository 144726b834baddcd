"""Places ranked by planned cycles; the example, from file to a plan that `check` accepts."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

from ocptip.basics.errors import InputError, PlanningError
from ocptip.cli.main import main
from ocptip.motion.objective import ENERGY, TIME
from ocptip.placement import for_cycle
from tests.places import EXAMPLES


def stand_in(energy, duration, objective=ENERGY):
    return SimpleNamespace(
        verified=True,
        energy=energy,
        duration=duration,
        interrupted=False,
        task=SimpleNamespace(objective=objective),
    )


@pytest.mark.parametrize(("objective", "order"), [(ENERGY, [1, 0, 2]), (TIME, [0, 1, 2])])
def test_ranked_by_objective_and_refusals_last(monkeypatch, objective, order):
    places = tuple(SimpleNamespace(number=k) for k in range(3))
    plans = [stand_in(30.0, 1.0, objective), stand_in(20.0, 2.0, objective), PlanningError("segment 2: no")]

    def plan(task, **how):
        found = plans[task.number]
        if isinstance(found, Exception):
            raise found
        return found

    static, problem = (
        SimpleNamespace(places=places, placements=places, problem=None),
        SimpleNamespace(if_alike=None),
    )
    monkeypatch.setattr(for_cycle, "place", lambda *a, **k: static)
    monkeypatch.setattr(for_cycle, "plan_motion", plan)
    proved = []
    monkeypatch.setattr(for_cycle, "proved", lambda one, prove: proved.append(one) or one)
    said = []
    found = for_cycle.place_for_cycle(problem, lambda placement: placement, progress=said.append)
    assert proved == [found.best.plan]  # certificates of what is kept only
    assert [one.placement.number for one in found.ranked] == order
    assert found.ranked[-1].refusal == "segment 2: no"
    assert found.ranked[-1].cost == np.inf
    assert not found.ranked[-1].verified
    assert len(said) == 4


def test_numbers_are_refused():
    with pytest.raises(InputError, match="candidates"):
        for_cycle.place_for_cycle(None, None, candidates=0)


@pytest.mark.slow
def test_example_from_file_to_checked_plan(tmp_path, capsys):
    file, out = str(EXAMPLES / "tasks/cell_ur5.toml"), tmp_path / "cell"
    how = ["--places", "2", "--starts", "1", "--jobs", "2", "--tolerance", "none", "--out", str(out)]
    assert main(["cell", file, *how]) == 0
    text = capsys.readouterr().out
    assert f"ocptip view {out / 'plan'}" in text
    data = json.loads((out / "cell.json").read_text())
    costs = [place["cost"] for place in data["places"] if place["verified"]]
    assert costs
    assert costs == sorted(costs)
    plan = json.loads((out / "plan/plan.json").read_text())
    assert plan["verified"]
    assert plan["energy_J"] == pytest.approx(data["places"][0]["energy_J"], rel=1e-6)
    assert main(["check", str(out / "plan")]) == 0


@pytest.mark.slow
def test_a_pose_out_of_reach_is_named(tmp_path, capsys):
    text = (EXAMPLES / "tasks/cell_ur5.toml").read_text(encoding="utf-8")
    (tmp_path / "ur5.urdf").write_bytes((EXAMPLES / "tasks/ur5.urdf").read_bytes())
    (tmp_path / "far.toml").write_text(text.replace("[0.92, 0.0, 1.10]", "[0.92, 0.0, 2.90]"))
    assert main(["cell", str(tmp_path / "far.toml"), "--out", str(tmp_path / "cell")]) == 1
    assert "segment 1 (carry)" in capsys.readouterr().out
