"""Names and units of recordings, and what is refused."""

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.measured.contact_losses import contact_loss
from ocptip.measured.recording import MOST, read_recording
from tests.measured.machines import predictor


def read(tmp_path, header, rows=60, text=None, **options):
    path = tmp_path / "r.csv"
    columns = header.split(",")
    lines = [header] + [
        ",".join([f"{k / 100}"] + [f"{k + c}" for c in range(1, len(columns))]) for k in range(rows)
    ]
    path.write_text("\n".join(lines) if text is None else text)
    return read_recording(path, predictor().robot, **options)


@pytest.mark.parametrize(
    ("title", "name", "kind", "index", "scale"),
    [
        ("q2_deg", "q2", "angles", 1, np.pi / 180),
        ("q2 [rad]", "q2", "angles", 1, 1.0),
        ("joint 3_position_deg", "q3", "angles", 2, np.pi / 180),
        ("qd1_deg_s", "qd1", "speeds", 0, np.pi / 180),
        ("tau6_Nm", "tau6", "torques", 5, 1.0),
        ("joint 1_effort", "tau1", "torques", 0, 1.0),
        ("fx", "fx", "sensor", 0, 1.0),
        ("sensor_mz_Nm", "mz", "sensor", 5, 1.0),
        ("total_power_W", "power", "power", 0, 1.0),
        ("power_kW", "power", "power", 0, 1e3),
        ("power3_W", "power3", "power", 3, 1.0),
        ("gripper_y_mm", "gripper_y", "gripper", 1, 1e-3),
        ("base_yaw_deg", "base_yaw", "base", 5, np.pi / 180),
        ("dy3 (mm)", "dy3", "shifts", 5, 1e-3),
    ],
)
def test_known_names(tmp_path, title, name, kind, index, scale):
    (signal,) = read(tmp_path, f"time_s,{title}").signals
    assert (signal.name, signal.kind, signal.index) == (name, kind, index)
    assert signal.values == pytest.approx(scale * (np.arange(60) + 1))


def test_power_of_voltage_and_current(tmp_path):
    found = read(tmp_path, "t,voltage_V,current_mA,something")
    (power,) = found.signals
    k = np.arange(60)
    assert power.name == "power"
    assert power.values == pytest.approx((k + 1) * (k + 2) * 1e-3)
    assert found.unknown == ("something",)
    assert found.period == pytest.approx(0.01)


def test_samples_may_be_missing_and_times_may_be_twice(tmp_path):
    rows = [f"{k / 100},{k}" for k in range(60)]
    rows[10] = "0.1,"
    rows[11] = "0.11,nan"
    rows.insert(21, "0.2,77")
    found = read(tmp_path, "", text="\n".join(["time_s,q1_deg", *rows]))
    (q,) = found.signals
    assert np.isnan(q.values).sum() == 2
    assert len(found.times) == 60
    assert q.values[20] == pytest.approx(np.radians(77))


@pytest.mark.slow
def test_long_recordings_are_thinned(tmp_path):
    found = read(tmp_path, "time_s,q1_deg", rows=2 * MOST + 1)
    assert found.thinned == 3
    assert len(found.times) <= MOST


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("time_s,q1", "q1 says neither degrees nor radians"),
        ("time_s,q1_m", "q1_m: expected degrees or radians"),
        ("time_s,q1_deg,q1_rad", "q1_rad is q1, which is there already"),
        ("time_s,q9_deg,abc", "no known quantity among"),
        ("q1_deg,q2_deg", "time_s"),
    ],
)
def test_bad_headers(tmp_path, header, message):
    with pytest.raises(InputError, match=message) as error:
        read(tmp_path, header)
    assert error.value.file == "r.csv"


def test_bad_lines(tmp_path):
    rows = [f"{k / 100},{k}" for k in range(60)]
    with pytest.raises(InputError, match="line 12, q1_deg: expected a number, got 'x'"):
        read(tmp_path, "", text="\n".join(["time_s,q1_deg", *rows[:10], "0.1,x", *rows[11:]]))
    with pytest.raises(InputError, match="line 12: time_s does not increase"):
        read(tmp_path, "", text="\n".join(["time_s,q1_deg", *rows[:10], "0.01,1", *rows[11:]]))
    with pytest.raises(InputError, match="line 12: expected 2 values"):
        read(tmp_path, "", text="\n".join(["time_s,q1_deg", *rows[:10], "0.1", *rows[11:]]))
    with pytest.raises(InputError, match="at least 50 samples"):
        read(tmp_path, "time_s,q1_deg", rows=10)
    assert read(tmp_path, "time_s,q1", unit="deg").signals[0].values[0] == pytest.approx(np.radians(1))


@pytest.mark.slow
def test_switches_keep_all_samples_of_the_file(tmp_path):
    rate, count = 2000.0, 4 * MOST
    lines = ["time_s,q1_deg,contact1,contact2_V,contact3,contact9"]
    for k in range(count):
        opened = 2000 <= k < 2014 or 5000 <= k < 5100  # 7 and 50 ms
        lines.append(f"{k / rate},{k / 100},{int(not opened)},{4.8 if k % 7 else 4.9},0,1")
    found = read(tmp_path, "", text="\n".join(lines))
    assert found.thinned == 4
    assert [s.name for s in found.signals] == ["q1"]
    assert found.unknown == ("contact9",)  # the robot has three
    first, second, third = found.contact_losses
    assert (first.contact, first.count) == (1, 2)
    assert first.longest == pytest.approx(0.05)
    assert first.total == pytest.approx(0.057)
    assert first.at == pytest.approx(2.5)
    assert (second.contact, second.count, second.longest) == (2, 0, 0.0)
    assert not third.ever_closed


def test_missing_samples_of_a_switch_are_no_interruption():
    times = np.arange(10) / 10
    values = np.array([1, 1, np.nan, 1, 0, np.nan, 0, 1, 1, 0.0])
    loss = contact_loss(2, times, values)
    assert (loss.contact, loss.count) == (2, 2)
    assert loss.longest == pytest.approx(0.3)  # from 0.4 to 0.7 s
    assert loss.total == pytest.approx(0.4)  # the last one lasts until the end
    assert loss.after(0.15).at == pytest.approx(0.25)
