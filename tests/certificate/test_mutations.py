"""Certificates with anything changed, and digests made anew: accepted only if what they claim is still so."""

import copy

import numpy as np
import pytest

from ocptip.certificate.trusted.checker import check_certificate, digest
from tests.certificate.test_hostile import _certificate, _judged_within, _within
from tests.certificate.test_within import _by_hand

pytest.importorskip("flint")
from tests.oracles.claims import falsehood
from tests.quick import some

HUGE = 2000
_NUMBERS = {
    "a little more": lambda x: x * (1 + 1e-6),
    "a little less": lambda x: x * (1 - 1e-6),
    "added": lambda x: x + 1e-6,
    "more": lambda x: x * 1.1,
    "less": lambda x: x * 0.9,
    "other sign": lambda x: -x,
    "none of it": lambda x: 0.0,
    "one": lambda x: 1.0,
    "tiny": lambda x: 1e-300,
    "large": lambda x: 1e9,
    "not a number": lambda x: float("nan"),
    "infinite": lambda x: float("inf"),
    "endless": lambda x: 10**400,
    "imaginary": lambda x: 1j,
}
_ANYTHING = {
    "null": lambda x: None,
    "text": lambda x: "1.0",
    "true": lambda x: True,
    "a list": lambda x: [x],
    "a long list": lambda x: [x] * HUGE,
    "an object": lambda x: {"x": x},
    "nothing": lambda x: [],
}
_LISTS = {
    "turned round": lambda x: x[::-1],
    "one more": lambda x: [*x, *x[-1:]],
    "one less": lambda x: x[:-1],
    "twice": lambda x: [*x, *x],
}


def _places(data, way=()):
    """Ways to all parts of a certificate, leaves and branches, but for digests."""
    if way and way[0] == "sha256":
        return
    if way:
        yield way
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        yield from _places(value, (*way, key))


def _at(data, way):
    for key in way:
        data = data[key]
    return data


def _changed(data, rng):
    """One change, and in words what it is."""
    places = list(_places(data))
    way = places[rng.integers(len(places))]
    value, holder = _at(data, way), _at(data, way[:-1])
    ways = dict(_ANYTHING) | {"removed": None}
    if isinstance(value, int | float) and not isinstance(value, bool):
        ways = {**_NUMBERS, **ways} if rng.random() < 0.3 else _NUMBERS
    elif isinstance(value, list):
        ways |= _LISTS
    name = str(rng.choice(list(ways)))
    if name == "removed":
        del holder[way[-1]]
    else:
        holder[way[-1]] = ways[name](value)
    return f"{'.'.join(map(str, way))}: {name}"


def _late():
    """A mass that moves while joints are late and what acts on it varies, beside a ball."""
    data = _within([1.0, -1.0], 0.003, delay=0.01, arm_mass=0.05, friction=0.1)
    rest, force = [0.0] * 6, [-0.5, 0.2, 0.5, 0.0, 0.1, 0.0]
    process = {"process_times": [0.002, 0.004, 0.009], "process_in_base": [rest, force, rest]}
    data["model"]["arm"] |= {**process, "process_on_link": [rest] * 3}
    data["bounds"] |= {"clearance_worst_case": 0.04, "point_speed_ratio_worst_case": 0.9}
    late = {"directions": [*data["cover"][0]["directions"], [0, 2, 0.0, 1.0, 0.0, 0.0]]}
    data["cover"] = [copy.deepcopy({**part, **late}) for part in data["cover"]]
    end = data["motion"]["times"][-1][0] + 0.01 + 2e-9
    _judged_within(data, [0.0, 0.006, 0.012, end], 0.5)
    data["model"]["decelerations_on_cancel"] = [1.5]
    cancels = {"GN_cancel_worst_case": 0.5, "GT_cancel_worst_case": 0.9, "angle_margin_cancel": 1.0}
    data["bounds"] |= cancels
    named = {key: rows[:1] * 4 for key, rows in data["cover_within"].items() if key in ("forces", "weights")}
    data["cover_cancel_within"] = {"trees": ["."] * 4, **named}
    return copy.deepcopy(data)


def _originals():
    moving = _within([1.0, -1.0], 0.003)
    moving["tolerance"], moving["cover_within"] = None, None
    del moving["bounds"]["GT_worst_case"]
    return _certificate(), moving, _by_hand(), _late()


def judged(data):
    """With digests of what it says."""
    try:
        data["sha256"] = {key: digest(data[key]) for key in ("model", "motion", "tolerance")}
    except (TypeError, ValueError, KeyError, OverflowError):
        data["sha256"] = {}
    return check_certificate(data)


def broken(count, seed, samples=6):
    """Of so many changes those that are accepted though not so, in words; and how many are accepted."""
    rng, found, accepted = np.random.default_rng(seed), [], 0
    originals = _originals()
    for number in range(count):
        data = copy.deepcopy(originals[number % len(originals)])
        words = _changed(data, rng)
        verdict = judged(data)
        if verdict.holds:
            accepted += 1
            if why := falsehood(data, rng, samples):
                found.append(f"{words}: {why}")
        else:
            assert verdict.problems, words
    return found, accepted


@pytest.mark.parametrize("number", some(1, range(4)))
def test_originals_hold(number):
    data = _originals()[number]
    assert judged(data).holds, judged(data).problems
    assert falsehood(data, np.random.default_rng(number), 20) is None


def test_the_oracle_finds_what_is_not_so():
    data = _by_hand()
    for key, value in (("GN_worst_case", 0.05), ("GT_worst_case", 0.001), ("clearance", 0.2)):
        wrong = copy.deepcopy(data)
        wrong["bounds"][key] = value
        assert falsehood(wrong, np.random.default_rng(0), 30) is not None, key


@pytest.mark.slow
def test_what_is_accepted_is_so():
    found, accepted = broken(60, seed=0, samples=4)
    assert not found
    assert accepted >= 15


@pytest.mark.slow
def test_what_is_accepted_of_two_thousand_is_so():
    found, accepted = broken(2000, seed=1, samples=20)
    assert not found
    assert accepted >= 200
