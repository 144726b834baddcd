"""`ocptip certify`."""

import json
import re

import pytest

from ocptip.cli.main import main
from tests.places import ROOT
from tests.quick import ONE_START

PLAIN = ("--tolerance", "none")
PLAN = str(ROOT / "studies" / "results" / "plans" / "B-effective" / "plan.json")


@pytest.fixture(scope="module")
def certificate(tmp_path_factory):
    path = tmp_path_factory.mktemp("certificate") / "c.json"
    assert main(["certify", PLAN, *PLAIN, "--out", str(path)]) == 0
    return path


def test_it_says_what_is_proved(certificate, capsys):
    assert main(["certify", PLAN, *PLAIN]) == 0
    out = capsys.readouterr().out
    assert out.startswith("plan.json on B   PROVED for the nominal model only (no uncertainty)\n")
    assert "Tipping margin  0." in out  # the table that plan prints
    assert "at every instant tipping margin >= 0.18" in " ".join(out.split())
    assert all(len(line) <= 80 for line in out.splitlines())
    assert main(["certify", PLAN, *PLAIN, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["certified"]
    assert data["certificate"]["bounds"]["GN"] < 0.9


def test_a_certificate_is_judged_from_its_data_alone(certificate, capsys, tmp_path):
    assert main(["certify", str(certificate)]) == 0
    head, _, _, tipping, friction, *_ = capsys.readouterr().out.splitlines()
    assert head == "c.json   PROVED for the nominal model only (no uncertainty)"
    assert tipping.startswith("Tipping margin  >= 0.18")
    assert friction.startswith("Friction used   <= 61.")
    assert main(["certify", str(certificate)]) == 0
    out = capsys.readouterr().out
    assert out.endswith("\nPlanes  1 (floors and walls)\n")
    assert main(["certify", str(certificate), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    unit = json.loads(certificate.read_text(encoding="utf-8"))["model"]["base"]["reference_moment"]
    assert found["planes"] == 1
    assert found["moments"]["GN"] == pytest.approx(unit * (1 / found["bounds"]["GN"] - 1))
    (proved,) = re.findall(r"Tipping margin  >= (\S+) N m", out)
    assert float(proved) <= found["moments"]["GN"] < 1.01 * float(proved)
    data = json.loads(certificate.read_text(encoding="utf-8"))
    data["bounds"]["GN"] = 0.89
    other = tmp_path / "other.json"
    other.write_text(json.dumps(data), encoding="utf-8")
    assert main(["certify", str(other)]) == 1
    out = capsys.readouterr().out
    assert out.startswith("other.json   PROOF DOES NOT HOLD\n  tip-over: not proved near 1.43")
    assert main(["certify", str(other), "--json"]) == 1
    assert not json.loads(capsys.readouterr().out)["holds"]


def test_a_motion_beyond_its_limits_is_not_certified(capsys):
    assert main(["certify", PLAN, *PLAIN, "--gn", "0.85"]) == 1
    out = capsys.readouterr().out
    assert "LIMITS BROKEN" in out
    assert "Broken  tipping margin is " in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["missing.json"], "missing.json"),
        ([PLAN, *PLAIN, "--out", "no/such/folder/c.json"], "no/such/folder"),
        (["CERTIFICATE", "--out", "c.json"], "--out"),
        ([PLAN, "--case", "B", "--task", "t.toml"], "--task"),
    ],
)
def test_bad_input_is_one_line(arguments, words, certificate, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    given = [str(certificate) if text == "CERTIFICATE" else text for text in arguments]
    try:
        code = main(["certify", *given])
    except SystemExit as stop:
        code = stop.code
    err = capsys.readouterr().err
    assert code == 2
    assert words in err


def test_plans_hold_their_certificate(tmp_path, capsys):
    out = tmp_path / "plan"
    assert main(["plan", "A", *ONE_START, "--out", str(out)]) == 0
    assert "A   PROVED" in capsys.readouterr().out
    plan = json.loads((out / "plan.json").read_text(encoding="utf-8"))
    assert plan["certified"]
    assert main(["certify", str(out / "certificate.json")]) == 0
    assert main(["certify", str(out)]) == 0
    assert "proved" in capsys.readouterr().out.lower()


def test_a_rise_time_as_typed_is_certified(capsys):
    plan = str(ROOT / "studies" / "results" / "plans" / "A-effective" / "plan.json")
    bounds = []
    for more in ([], ["--rise-time", "0.05"]):
        assert main(["certify", plan, *PLAIN, "--json", *more]) == 0
        data = json.loads(capsys.readouterr().out)
        bounds.append((data["certificate"]["bounds"]["GT"], data["duration_s"]))
    assert bounds[0] != bounds[1]


def test_samples_that_have_to_be_fitted_are_not_certified(capsys, tmp_path):
    rows = "\n".join(f"{0.05 * k:.3f}," + ",".join("0.123" for _ in range(6)) for k in range(20))
    path = tmp_path / "m.csv"
    path.write_text("t," + ",".join(f"q{k}_deg" for k in range(1, 7)) + "\n" + rows + "\n", encoding="utf-8")
    assert main(["certify", str(path), "--case", "A"]) == 2
    assert "m.csv: its samples do not say the accelerations exactly" in capsys.readouterr().err


def test_check_says_who_judges_certificates(certificate, capsys):
    assert main(["check", str(certificate)]) == 2
    assert "is a certificate; ocptip certify checks it" in capsys.readouterr().err
