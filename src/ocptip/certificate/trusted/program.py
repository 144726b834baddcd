"""Programs of arithmetic over intervals of time, in Taylor forms: parallel robots with legs of closed form.

What a serial arm needs follows from its masses and lengths by a recursion that stands here (`arm`). Of a
parallel robot a certificate holds, instead, the instructions that compute motor forces, the wrench on the
base, distances from singular poses and motor speeds out of the platform's coordinates, speeds and
accelerations. That these are the robot's is not seen here: they are a part of the model. What would divide by
zero, or take the root of what is not positive, somewhere in an interval, proves nothing there.

Angles of "ATAN2" are known up to whole turns, so that they go on smoothly beyond pi: only sums, differences
and their cosines and sines may be taken.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ocptip.certificate.trusted.forms import Form, U, cos_sin, polynomial
from ocptip.certificate.trusted.plain import numbers, require

_INVERSE = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])  # of 1 / (1 + y)
_ROOT = np.array([1.0, 1 / 2, -1 / 8, 1 / 16, -5 / 128, 7 / 256])  # of the root of 1 + y
_NEXT = 21 / 1024  # the next one; those after it are smaller
_OF_ANGLES = ("ADD", "SUB", "NEG", "TWICE")
_ARC = np.array([0.0, 1.0, 0.0, -1 / 3, 0.0, 1 / 5])  # of the arc tangent

_UNKNOWN = np.errstate(invalid="ignore", over="ignore", divide="ignore")  # what is not a number is not known


def require_program(program: Mapping[str, Any], joints: int) -> None:
    """Raise MalformedError unless every instruction is known and takes what was computed before it.

    Instructions are [name, number, number]: the numbers say which results, counted from 0, are taken, but for
    "INPUT" (which input) and "CONST" (which value).
    """
    require(set(program) == {"code", "outputs", "lower", "upper"}, "program: others are expected")
    angles: set[int] = set()
    for k, row in enumerate(program["code"]):
        require(len(row) == 3 and (row[0] in _TAKES or row[0] in ("INPUT", "CONST")), f"program: {row!r}")
        if row[0] == "CONST":
            numbers("program", row[1], ())
            continue
        count, most = (1, 3 * joints) if row[0] == "INPUT" else (_TAKES[row[0]][0], k)
        program_row = row[1 : 1 + count]
        require(
            all(type(x) is int and 0 <= x < most for x in program_row),
            f"program: {row!r} takes what is not there",
        )
        turns = row[0] != "INPUT" and bool(angles.intersection(program_row))
        require(not turns or row[0] in (*_OF_ANGLES, "SIN", "COS"), f"program: {row!r} takes an angle")
        if row[0] == "ATAN2" or (turns and row[0] in _OF_ANGLES):
            angles.add(k)
    size, further, outputs = len(program["code"]), len(program["lower"]), program["outputs"]
    good = all(type(x) is int and 0 <= x < size and x not in angles for x in outputs)
    require(good and len(outputs) == joints + 6 + further, "program: other outputs are expected")
    for key in ("lower", "upper"):
        numbers(f"program {key}", [0.0 if x is None else x for x in program[key]], (further,))


@_UNKNOWN
def run(program: Mapping[str, Any], inputs: Sequence[Form]) -> list[Form]:
    """Outputs (N,) of a program for inputs (N,)."""
    forms: list[Form] = []
    one = np.ones(inputs[0].r.shape)
    for name, *numbers_ in program["code"]:
        if name == "INPUT":
            forms.append(inputs[numbers_[0]])
        elif name == "CONST":
            forms.append(Form.of(numbers_[0] * one))
        else:
            count, compute = _TAKES[name]
            forms.append(compute(*(forms[k] for k in numbers_[:count])))
    return [forms[k] for k in program["outputs"]]


@_UNKNOWN
def inverse(x: Form) -> Form:
    """1 / x."""
    y, small = _relative(x)
    size = y.size + y.r
    series = _series(_INVERSE, y, size**6 / (1 - size))
    return _where(small, series * (1 / x.c[0]))


@_UNKNOWN
def root(x: Form) -> Form:
    """Square root."""
    y, small = _relative(x)
    size = y.size + y.r
    series = _series(_ROOT, y, _NEXT * size**6 / (1 - size))
    return _where(small & (x.c[0] > 0), series * np.sqrt(x.c[0]))


@_UNKNOWN
def arc(y: Form, x: Form) -> Form:
    """Angle of (x, y), up to whole turns."""
    x0, y0 = x.c[0], y.c[0]
    w = (y * x0 - x * y0) * inverse(x * x0 + y * y0)  # tangent of the angle from the middle one
    size, middle = w.size + w.r, np.arctan2(y0, x0)  # of the machine's library, right to a few last places
    angle = _series(_ARC, w, size**7 / 7) + Form.of(middle, radius=U * np.abs(middle))
    return _where(size < 1, angle)


def _relative(x: Form) -> tuple[Form, np.ndarray]:
    """By how much x differs from its middle, relative to that, and where that is less than 1."""
    rest = Form(x.c.copy(), x.r)
    rest.c[0] = 0.0
    y = rest * (1 / x.c[0])
    return y, y.size + y.r < 1


def _series(c: np.ndarray, y: Form, rest: np.ndarray) -> Form:
    value = polynomial(np.multiply.outer(c, np.ones(y.r.shape)), y)
    return Form(value.c, (value.r + rest) * (1 + U))


def _where(good: np.ndarray, x: Form) -> Form:
    """x where that is so; elsewhere nothing is known."""
    return Form(np.where(good, x.c, 0.0), np.where(good, x.r, np.inf))


def _least(a: Form, b: Form) -> Form:
    """The lesser of both; where either may be it, an interval."""
    ahead, behind = (b - a).range
    (low, high), (other, end) = a.range, b.range
    ends = np.minimum(low, other), np.minimum(high, end)
    middle = 0.5 * (ends[0] + ends[1])
    both = Form.of(middle, radius=(0.5 * (ends[1] - ends[0]) + U * np.abs(middle)) * (1 + U))
    first, second = ahead >= 0, behind <= 0
    return Form(
        np.where(first, a.c, np.where(second, b.c, both.c)),
        np.where(first, a.r, np.where(second, b.r, both.r)),
    )


def _cosine_of_arc(x: Form) -> Form:
    return root(-(x * x) + 1.0)


_TAKES: dict[str, tuple[int, Callable[..., Form]]] = {
    "ADD": (2, lambda a, b: a + b),
    "SUB": (2, lambda a, b: a - b),
    "MUL": (2, lambda a, b: a * b),
    "DIV": (2, lambda a, b: a * inverse(b)),
    "NEG": (1, lambda a: -a),
    "SQ": (1, lambda a: a * a),
    "TWICE": (1, lambda a: a * 2.0),
    "INV": (1, inverse),
    "SQRT": (1, root),
    "SIN": (1, lambda a: cos_sin(a)[1]),
    "COS": (1, lambda a: cos_sin(a)[0]),
    "ATAN2": (2, arc),
    "ASIN": (1, lambda a: arc(a, _cosine_of_arc(a))),
    "ACOS": (1, lambda a: arc(_cosine_of_arc(a), a)),
    "FMIN": (2, _least),
    "FMAX": (2, lambda a, b: -_least(-a, -b)),
}
