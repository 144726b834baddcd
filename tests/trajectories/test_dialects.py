"""Dialects of CSV files: read rightly, or refused with what would make them clear."""

from types import SimpleNamespace

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.measured.recording import read_recording
from ocptip.trajectories.read import load_motion
from tests.quick import some
from tests.trajectories.dialects import COARSE, DIALECTS, NAMES, TIMES, UNCLEAR, Q, V, truth

ROBOT = SimpleNamespace(names=NAMES, units=["rad"] * 6, sensor=SimpleNamespace(name="sensor"))


@pytest.mark.parametrize("dialect", some(2, sorted(DIALECTS, key=lambda name: name not in COARSE)))
def test_the_motion_of_every_dialect(tmp_path, dialect):
    path = tmp_path / "m.csv"
    path.write_text(DIALECTS[dialect], encoding="utf-8")
    motion = load_motion(path, NAMES, ["rad"] * 6, unit="rad")
    times = np.linspace(0, 1, 201)
    off = 5e-3 if dialect in COARSE else 1e-4
    assert motion.end == pytest.approx(1.0, abs=2e-3)
    np.testing.assert_allclose(motion.states(times)[0], truth(times)[0], atol=off)


@pytest.mark.parametrize("dialect", DIALECTS)
def test_the_recording_of_every_dialect(tmp_path, dialect):
    path = tmp_path / "r.csv"
    path.write_text(DIALECTS[dialect], encoding="utf-8")
    recording = read_recording(path, ROBOT, unit="rad")
    begin = 960.949 if dialect in ("rtde", "rtde with commas") else 0.0
    np.testing.assert_allclose(recording.times - begin, TIMES, atol=2e-3 if dialect in COARSE else 2e-6)
    for signal in recording.of("angles"):
        np.testing.assert_allclose(signal.values, Q[:, signal.index], atol=1e-6)
    for signal in recording.of("speeds"):
        np.testing.assert_allclose(signal.values, V[:, signal.index], atol=1e-6)
    assert len(recording.of("angles")) == 6
    assert recording.gaps == ()


@pytest.mark.parametrize("dialect", UNCLEAR)
def test_what_may_mean_two_things_is_refused(tmp_path, dialect):
    path = tmp_path / "m.csv"
    text, message = UNCLEAR[dialect]
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message) as caught:
        load_motion(path, NAMES, ["rad"] * 6, unit="rad")
    assert caught.value.file == "m.csv"
    assert "\n" not in str(caught.value)


def test_columns_that_a_user_names(tmp_path):
    path = tmp_path / "m.csv"
    rows = [f"{t:.3f},{','.join(f'{v:.6f}' for v in Q[k])}" for k, t in enumerate(TIMES)]
    path.write_text("\n".join(rows))
    by_number = {"time_s": 1, **{f"q{j + 1}_rad": j + 2 for j in range(6)}}
    motion = load_motion(path, NAMES, columns=by_number)
    np.testing.assert_allclose(motion.goal, Q[-1], atol=1e-5)
    path.write_text("when,a,b,c,d,e,f\n" + "\n".join(rows))
    named = {"time_s": "when", **{f"q{j + 1}_rad": letter for j, letter in enumerate("fbcdea")}}
    swapped = load_motion(path, NAMES, columns=named)
    np.testing.assert_allclose(swapped.goal, Q[-1, [5, 1, 2, 3, 4, 0]], atol=1e-5)
    recording = read_recording(path, ROBOT, columns=named)
    np.testing.assert_allclose(recording.of("angles")[0].values, Q[:, 5], atol=1e-6)
    for wrong, message in (
        ({"time_s": "whem"}, "no column 'whem'; did you mean 'when'"),
        ({"t": 9}, "1 to 7"),
    ):
        with pytest.raises(InputError, match=message):
            load_motion(path, NAMES, columns=wrong)


def interleaved(joints: float, sensor: float, shift: float = 0.0) -> tuple[str, np.ndarray, np.ndarray]:
    """Joints and a sensor at rates of their own, Hz, in one table; with the times of both."""
    own, other = np.arange(0, 1, 1 / joints), np.arange(0, 1, 1 / sensor) + shift
    lines = [(t, f"{t:.6f},{','.join(f'{v:.9f}' for v in truth(np.array([t]))[0][0])},") for t in own]
    lines += [(t, f"{t:.6f},,,,,,,{10 * np.sin(5 * t):.9f}") for t in other]
    header = ",".join(["time_s", *(f"q{j + 1}_rad" for j in range(6)), "fz_N"])
    return "\n".join([header, *(line for _, line in sorted(lines))]), own, other


@pytest.mark.parametrize(("joints", "sensor"), [(100.0, 500.0), (100.0, 100.0), (125.0, 1000.0)])
def test_signals_with_rates_of_their_own(tmp_path, joints, sensor):
    path = tmp_path / "r.csv"
    text, own, _ = interleaved(joints, sensor, shift=0.0005)
    path.write_text(text)
    recording = read_recording(path, ROBOT)
    np.testing.assert_allclose(recording.times, own, atol=1e-6)
    assert all(np.isfinite(signal.values).all() for signal in recording.of("angles"))
    (force,) = recording.of("sensor")
    expected = np.sin(5 * own) * 10
    inside = (own > 1 / sensor) & (own < 1 - 2 / sensor)
    np.testing.assert_allclose(force.values[inside], expected[inside], atol=10 * 25 / 8 / sensor**2 * 1.01)
    assert np.isfinite(force.values).mean() > 0.95
    assert recording.gaps == ()
    assert recording.rates == (f"fz: {sensor:g} Hz, interpolated at the instants of q1 ({joints:g} Hz)",)


def test_a_slower_signal_keeps_its_samples(tmp_path):
    path = tmp_path / "r.csv"
    text, own, other = interleaved(500.0, 50.0)
    path.write_text(text)
    recording = read_recording(path, ROBOT)
    (force,) = recording.of("sensor")
    there = np.isfinite(force.values)
    assert there.sum() == len(other)
    np.testing.assert_allclose(recording.times[there], other, atol=2e-3)
    assert "50 Hz, kept at the nearest of the instants of q1 (500 Hz)" in recording.rates[0]
    np.testing.assert_allclose(recording.times, own, atol=1e-6)


def test_a_block_missing_of_one_signal_is_not_filled(tmp_path):
    path = tmp_path / "r.csv"
    text, own, _ = interleaved(100.0, 500.0)
    lines = text.splitlines()
    kept = [line for line in lines[1:] if not (line.count(",,") and 0.4 < float(line.split(",")[0]) < 0.6)]
    path.write_text("\n".join([lines[0], *kept]))
    (force,) = read_recording(path, ROBOT).of("sensor")
    missing = np.isnan(force.values)
    np.testing.assert_array_equal(missing[(own > 0.405) & (own < 0.595)], True)
    assert not missing[(own < 0.39) | ((own > 0.61) & (own < 0.98))].any()


def test_cells_missing_at_random_are_missing_samples(tmp_path):
    """No clock of its own: 30 % of the cells of one joint, and 60 % of another's."""
    rng = np.random.default_rng(1)
    path = tmp_path / "r.csv"
    rows = []
    for k, t in enumerate(TIMES):
        cells = [f"{v:.6f}" for v in Q[k]]
        for joint, share in ((2, 0.3), (4, 0.6)):
            if rng.random() < share:
                cells[joint] = ""
        rows.append(",".join([f"{t:.3f}", *cells]))
    path.write_text("\n".join([",".join(["time_s", *(f"q{j + 1}_rad" for j in range(6))]), *rows]))
    recording = read_recording(path, ROBOT)
    assert len(recording.times) == len(TIMES)
    assert recording.rates == ()
    shares = [np.isnan(signal.values).mean() for signal in recording.of("angles")]
    assert [share > 0 for share in shares] == [False, False, True, False, True, False]
