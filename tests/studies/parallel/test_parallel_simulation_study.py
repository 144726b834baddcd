"""The study of simulated parallel robots: energy stays, and it stays only with that of the springs."""

import sys

import pytest

from studies.parallel import simulation


def _line(monkeypatch, capsys) -> list[str]:
    monkeypatch.setattr(sys, "argv", ["simulation", "five_bar", "--seconds", "0.05"])
    simulation.main()
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.startswith("robot ")
    assert len(lines) == 1
    return lines[0].split()


@pytest.mark.slow
def test_energy_of_bodies_and_springs_stays(monkeypatch, capsys):
    name, drift, way, cpu = _line(monkeypatch, capsys)
    assert name == "five_bar"
    assert float(drift) < 1e-8
    assert float(way) == pytest.approx(0.012, abs=0.001)  # it moves
    assert float(cpu) > 0
    monkeypatch.setattr(simulation.Springs, "energy", lambda springs, z: 0.0)
    assert float(_line(monkeypatch, capsys)[1]) > 0.1
