"""`ocptip compare` as it is typed."""

import csv
import json

import numpy as np
import pytest

from ocptip.cli.main import main
from ocptip.measured.recording import gaps_of
from ocptip.motion.files.plan_files import write_plan
from ocptip.published.tasks import experiment_task
from tests.measured.machines import recorded
from tests.pictures.plan_stand_in import plan_of
from tests.quick import some
from tests.standing.simulation.test_replay import plan_of as committed


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plans") / "A"
    write_plan(folder, plan_of(experiment_task("A"), committed("A-effective")[1]))
    return folder


def write(path, recording):
    names = ["time_s", *(s.name + "_rad" * (s.kind == "angles") for s in recording.signals)]
    rows = np.column_stack([recording.times, *(s.values for s in recording.signals)])
    with path.open("w", newline="") as stream:
        csv.writer(stream).writerows([names, *rows.tolist()])
    return str(path)


def test_the_plans_own_samples_agree(written, capsys):
    assert main(["compare", str(written / "motion.csv"), str(written)]) == 0
    said = capsys.readouterr().out
    assert "A: AGREES with what was described (any finding by chance: 0.1 %)." in said
    assert "not recorded  pose of the base, shifts of contacts" in said


def test_findings_are_told_and_drawn(written, tmp_path, capsys):
    path = write(tmp_path / "r.csv", recorded(0, delays={1: 4e-3}))
    figure = tmp_path / "r.png"
    assert main(["compare", path, str(written), "--plot", str(figure)]) == 1
    said = capsys.readouterr().out
    assert "A: 1 finding" in said
    size = float(said.split("delay of joint 2: ")[1].split()[0])
    assert size == pytest.approx(4.0, abs=0.1)
    assert figure.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lost", "said"),
    some(
        2,
        [
            (slice(200, 340), ["samples missing: ", "(140 of {n} samples", "none between 0.398 and 0.68 s)"]),
            (slice(700, None), ["end of the motion missing", "no sample between 1.398 and "]),
            (slice(0, 150), ["begin of the motion missing", "and 0.3 s)"]),
            (slice(200, 201), ["(1 of {n} samples", "none between 0.398 and 0.402 s)"]),
        ],
    ),
)
def test_samples_that_are_missing_are_a_finding(written, tmp_path, capsys, lost, said):
    """Whole lines, not cells: nothing in the file but the times tells of them."""
    path = write(tmp_path / "r.csv", recorded(1))
    lines = (tmp_path / "r.csv").read_text().splitlines()
    rows = lines[1:]
    count = len(rows)
    del rows[lost]
    (tmp_path / "r.csv").write_text("\n".join([lines[0], *rows]))
    assert main(["compare", path, str(written)]) == 1
    out = capsys.readouterr().out
    assert "AGREES" not in out
    for text in said:
        assert text.format(n=count) in out


def test_a_sensor_with_a_rate_of_its_own(written, tmp_path, capsys):
    """Joints and torques at 100 Hz, the sensor at 500 Hz, in lines of their own: nothing is missing."""
    recording = recorded(1)
    sensor = [signal.kind == "sensor" for signal in recording.signals]
    names = ["time_s", *(s.name + "_rad" * (s.kind == "angles") for s in recording.signals)]
    lines = [",".join(names)]
    for k, time in enumerate(recording.times):
        cells = [f"{signal.values[k]:.9f}" for signal in recording.signals]
        for own in (False, True):
            if own or k % 5 == 0:
                row = [cell if mine == own else "" for cell, mine in zip(cells, sensor, strict=True)]
                lines.append(",".join([f"{time + (2.5e-4 if own else 0):.6f}", *row]))
    path = tmp_path / "r.csv"
    path.write_text("\n".join(lines))
    assert main(["compare", str(path), str(written)]) == 0
    out = capsys.readouterr().out
    assert "AGREES" in out
    assert "fx, fy, fz, mx, my, mz: 500 Hz, interpolated at the instants of q1 (100 Hz)" in out


def test_columns_without_any_number_are_missing(written, tmp_path, capsys):
    """Of a file in which only the sensor was recorded, with the columns of the joints: no internal error."""
    recording = recorded(1)
    names = ["time_s", *(s.name + "_rad" * (s.kind == "angles") for s in recording.signals)]
    lines = [",".join(names)]
    for k, time in enumerate(recording.times):
        cells = [f"{s.values[k]:.6f}" if s.kind == "sensor" else "" for s in recording.signals]
        lines.append(",".join([f"{time:.6f}", *cells]))
    path = tmp_path / "r.csv"
    path.write_text("\n".join(lines))
    assert main(["compare", str(path), str(written)]) == 1
    out = capsys.readouterr().out
    assert "q1 missing: 100 %" in out
    assert "AGREES" not in out


def test_columns_in_a_file(written, tmp_path, capsys):
    path = tmp_path / "r.csv"
    write(path, recorded(1))
    text = path.read_text()
    head, _, rows = text.partition("\n")
    path.write_text(rows)
    titles = head.strip().split(",")
    columns = tmp_path / "columns.toml"
    columns.write_text("[columns]\n" + "\n".join(f"{name} = {k}" for k, name in enumerate(titles, 1)))
    assert main(["compare", str(path), str(written), "--columns", str(columns)]) == 0
    assert "AGREES" in capsys.readouterr().out
    columns.write_text("[columns]\ntime_s = true\n")
    assert main(["compare", str(path), str(written), "--columns", str(columns)]) == 2
    assert "columns.time_s: expected the title or the number of a column" in capsys.readouterr().err


def test_clocks_that_jitter_have_no_gaps():
    rng = np.random.default_rng(0)
    times = np.cumsum(0.01 * rng.uniform(0.7, 1.3, 1000))
    assert gaps_of(times) == ()
    assert gaps_of(np.delete(times, slice(500, 510)))[0][2] == pytest.approx(10, abs=2)


def test_json(written, tmp_path, capsys):
    path = write(tmp_path / "r.csv", recorded(1))
    assert main(["compare", path, str(written), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["agrees"]
    assert data["findings"] == []
    assert len(data["signals"]) == 19
    assert data["energy"]["measured_J"] == pytest.approx(data["energy"]["predicted_J"], rel=0.01)


def test_bad_input_is_one_line(written, tmp_path, capsys):
    (tmp_path / "r.csv").write_text("time_s,abc\n" + "\n".join(f"{k},{k}" for k in range(60)))
    for arguments, said in (
        ([str(tmp_path / "none.csv"), str(written)], "none.csv"),
        ([str(tmp_path / "r.csv"), str(written)], "no known quantity among time_s, abc"),
        ([str(written / "motion.csv"), str(tmp_path)], "no folder of a plan"),
        ([str(written / "motion.csv"), str(written), "--level", "2"], "level: must be above 0"),
        ([str(written / "motion.csv"), str(written), "--plot", "x.bmp"], "--plot: expected a file name"),
    ):
        assert main(["compare", *arguments]) == 2
        lines = capsys.readouterr().err.strip().splitlines()
        assert len(lines) == 1
        assert said in lines[0]
