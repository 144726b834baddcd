"""The maps of table 6.1 from samples with noise; where samples are, and where not."""

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.basics.toml import Table
from ocptip.cli.main import main
from ocptip.measured.power_maps import fit_power_map, motors_of, samples_by_joint
from ocptip.published.arms import load_arm, modular_motors
from ocptip.task_files.motion import TASK
from ocptip.task_files.tables.motors import power_maps


def samples(seed, joint, count=200, noise=2.0):
    """Torques within the joint's limits, speeds of both signs, powers of table 6.1 with noise."""
    limits, rng = load_arm("FP1W2F").limits, np.random.default_rng(seed)
    torque = limits.torque[joint] * rng.uniform(-1, 1, count)
    speed = limits.speed[joint] * rng.uniform(-1, 1, count)
    return torque, speed, power(joint, torque, speed) + noise * rng.normal(size=count)


def power(joint, torque, speed):
    full = np.zeros((len(torque), 6))
    t, w = full.copy(), full.copy()
    t[:, joint], w[:, joint] = torque, speed
    return modular_motors().power(t, w)[:, joint]


@pytest.mark.parametrize("joint", range(6))
def test_table_6_1_is_found_within_a_percent_of_its_range(joint):
    limits = load_arm("FP1W2F").limits
    torques, speeds = (0.95 * x[joint] * np.linspace(-1, 1, 16) for x in (limits.torque, limits.speed))
    grid = [g.ravel() for g in np.meshgrid(torques, speeds)]
    true = power(joint, *grid)
    size = float(np.ptp(true))
    found = fit_power_map(*samples(joint, joint, count=2000, noise=0.01 * size))
    seen = motors_of([found]).power(grid[0][:, None], grid[1][:, None])[:, 0]
    assert np.abs(seen - true).max() < 0.01 * size
    assert found.noise == pytest.approx(0.01 * size, rel=0.15)


def test_errors_are_as_large_as_they_say():
    at = np.array([5.0, -20.0, 0.0]), np.array([0.5, 0.2, -0.4])
    true, away = power(0, *at), []
    for seed in range(60):
        found = fit_power_map(*samples(seed, 0))
        map_ = motors_of([found]).power(at[0][:, None], at[1][:, None])[:, 0]
        away.append((map_ - true) / found.error(*at))
    assert np.std(away) == pytest.approx(1.0, abs=0.15)


def test_what_is_beyond_the_samples_is_told():
    found = fit_power_map(*samples(0, 0))
    limit = load_arm("FP1W2F").limits
    torque, speed = limit.torque[0], limit.speed[0]
    out = found.outside(
        np.array([0.0, 2 * torque, 0.0, -0.5 * torque]), speed * np.array([0.5, 0.5, 1.5, -0.5])
    )
    assert out.tolist() == [False, True, True, False]
    assert 0.8 < found.covered <= 1.0


def test_samples_that_tell_no_map_are_refused():
    torque, speed, watts = samples(0, 0)
    with pytest.raises(InputError, match="four torques and three speeds"):
        fit_power_map(torque, np.where(speed > 0, 0.5, 0.2), watts)
    with pytest.raises(InputError, match="more than 12 samples"):
        fit_power_map(torque[:12], speed[:12], watts[:12])
    with pytest.raises(InputError, match="no torque or no speed"):
        fit_power_map(torque, 0 * speed, watts)
    with pytest.raises(InputError, match="column 'watt'"):
        samples_by_joint(["torque_Nm", "speed_rad_s", "watt"], np.zeros((3, 3)))
    with pytest.raises(InputError, match="one column of speed_deg_s or"):
        samples_by_joint(["torque_Nm", "power_W"], np.zeros((3, 2)))


def test_the_command_writes_motors_that_task_files_read(tmp_path, capsys):
    rows = ["joint,torque_Nm,speed_rad_s,power_W"]
    for joint in range(6):
        rows += [f"{joint + 1},{t},{w},{p}" for t, w, p in zip(*samples(joint, joint), strict=True)]
    file, out = tmp_path / "samples.csv", tmp_path / "motors.toml"
    file.write_text("\n".join(rows))
    assert main(["identify", "power", str(file), "--out", str(out)]) == 0
    assert "left over" in capsys.readouterr().out
    with Table.read(out, TASK) as data:
        data.close(early=True)
        table = data.table("motors")
        assert table["kind"] == "map"
        motors = power_maps(table, 6)
    torque, speed = np.full((1, 6), 2.0), np.full((1, 6), -0.3)
    np.testing.assert_allclose(motors.power(torque, speed), modular_motors().power(torque, speed), atol=2.0)
    file.write_text("\n".join(rows[:1] + rows[201:]))
    assert main(["identify", "power", str(file)]) == 2
    assert "samples.csv: column joint: expected 1 to 6, got 2, 3" in capsys.readouterr().err
    assert main(["identify", "payload", str(file)]) == 2
    assert "needs PLAN_DIR" in capsys.readouterr().err
