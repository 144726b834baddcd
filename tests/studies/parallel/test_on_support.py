"""The study of parallel robots on a cart: what it writes, and that its durations are the edge."""

import json

import numpy as np
import pytest

from ocptip.contact.solver import solve_many
from ocptip.task_files.scene import read_scene
from studies.parallel import on_support as study


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Folder and data of a small run."""
    out = tmp_path_factory.mktemp("parallel_on_support")
    assert study.main(["--out", str(out), "--samples", "9", "--directions", "2", "--limit", "0.8"]) == 0
    return out, json.loads((out / "parallel_on_support.json").read_text())


@pytest.mark.slow
def test_durations_are_on_the_limit(small):
    out, data = small
    assert [result["case"] for result in data["results"]] == ["delta", "hexapod"]
    for result in data["results"]:
        for row in result["directions"]:
            assert max(row["GN"], row["GT"]) == pytest.approx(0.8, abs=1e-4)
            assert row["bound_by"] == ("tip-over" if row["GN"] > row["GT"] else "slip")
    assert (out / "parallel_on_support.png").read_bytes().startswith(b"\x89PNG")
    assert "| bound by |" in (out / "parallel_on_support.md").read_text()


@pytest.mark.slow
def test_faster_than_that_is_not_allowed_and_slower_is(small):
    _, data = small
    case = study.cases()[0]
    found = study.wrenches(case, 0.0, 9)
    duration = data["results"][0]["directions"][0]["duration_s"]
    assert study.allowed(case, found.at(1.001 * duration), 0.8)
    assert not study.allowed(case, found.at(0.999 * duration), 0.8)
    assert not np.all(solve_many(case.robot.support, found.at(0.5 * duration)).persistent)


@pytest.mark.slow
def test_scaling_of_the_wrench_is_exact():
    case = study.cases()[1]
    found = study.wrenches(case, 0.7, 5)
    T, tau = 0.4, np.linspace(0, 1, 5)
    z, zd, zdd = case.path(tau, 0.7)
    slow = case.robot.samples_of(T * tau, z, zd / T, zdd / T**2)
    np.testing.assert_allclose(found.at(T), slow.wrenches, atol=1e-9)
    np.testing.assert_allclose(found.motors(T), slow.torques, atol=1e-8)


@pytest.mark.parametrize("path", [study.pick_and_place, study.sway])
def test_paths_are_smooth_and_start_and_end_at_rest(path):
    tau = np.linspace(0, 1, 2001)
    z, zd, zdd = path(tau, 0.3)
    np.testing.assert_allclose(np.gradient(z, tau, axis=0)[1:-1], zd[1:-1], atol=1e-4)
    np.testing.assert_allclose(np.gradient(zd, tau, axis=0)[1:-1], zdd[1:-1], atol=1e-3)
    assert np.abs(zd[[0, -1]]).max() < 1e-12
    assert np.abs(zdd[[0, -1]]).max() < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("name", ["delta", "hexapod"])
def test_scenes_can_be_read_and_stand(small, name):
    out, _ = small
    scene = read_scene(out / f"parallel_on_support_{name}.toml")
    states = solve_many(scene.support, scene.wrench[None])
    assert states.persistent[0]


def test_options_are_checked(tmp_path):
    with pytest.raises(SystemExit):
        study.main(["--out", str(tmp_path), "--samples", "2"])
