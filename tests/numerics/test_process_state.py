"""State of the whole process is put back, whatever happens inside."""

from __future__ import annotations

import os

import casadi as cs
import pytest

from ocptip.numerics.fork_server import environment
from ocptip.parallel.code.tidy import expressions_as_written


def failing(context):
    with context:
        raise ZeroDivisionError


def test_expressions_as_written_until_an_error():
    x = cs.SX.sym("x")
    with expressions_as_written():
        assert str(x - x) == "(x-x)"
    assert str(x - x) == "0"
    with pytest.raises(ZeroDivisionError):
        failing(expressions_as_written())
    assert str(x - x) == "0"


def test_environment_is_what_it_was(monkeypatch):
    monkeypatch.setenv("OCPTIP_SET", "old")
    monkeypatch.delenv("OCPTIP_UNSET", raising=False)
    values = {"OCPTIP_SET": "new", "OCPTIP_UNSET": "new"}
    with environment(values):
        assert {name: os.environ.get(name) for name in values} == values
    with pytest.raises(ZeroDivisionError):
        failing(environment(values))
    assert os.environ["OCPTIP_SET"] == "old"
    assert "OCPTIP_UNSET" not in os.environ
