"""What is proved of functionals of the wrench against the worst worlds that an independent model has.

Every quantity at its worst at once, one after the other, from many corners: so each product of two of them
counts, such as a push at the base times the place of the base's centre of mass.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.certificate.describe import model_data, tolerance_data
from ocptip.certificate.trusted.late import Late
from ocptip.certificate.trusted.within import Within
from ocptip.robots.payload import Payload
from ocptip.standing.tolerance import Uncertainty
from tests.certificate.test_find import _swing
from tests.certificate.test_within_in_balls import _random_model, _random_motion
from tests.oracles.worlds import ArmOnBase
from tests.quick import THOROUGH, examples

KINDS = {
    "base_mass": [-0.2, 0.15],
    "center_of_mass": [0.1, 0.05, 0.2],
    "arm_mass": 0.2,
    "payload_mass": 0.3,
    "payload_center": [0.1, 0.05, 0.08],
    "extra_mass": 1.0,
    "speed": 0.1,
    "tilt": 0.1,
    "push": 30.0,
    "base_push": 60.0,
    "drive_speed": 0.1,
}
NONE = {**dict.fromkeys(KINDS, 0.0), **dict.fromkeys(("center_of_mass", "payload_center"), [0.0] * 3)}
NONE |= {"base_mass": [0.0, 0.0], "delay": 0.0, "overshoot": 0.0, "friction": 0.0}
PAIRS = [(a, b) for k, a in enumerate(KINDS) for b in list(KINDS)[k + 1 :]]


def driving(model, motion, rng):
    """The same on a base whose velocities are random polynomials."""
    ends, size = np.array(motion["times"]), rng.uniform(0.0, [0.8, 0.3, 1.5])
    cubics = [
        np.polynomial.Polynomial(row * [1, 4, 20, 50]) for row in size[:, None] * rng.normal(size=(3, 4))
    ]
    rows = []
    for a, b in ends:
        u = np.polynomial.Polynomial([0.5 * (a + b), 0.5 * (b - a)])
        rows.append([np.pad(own(u).coef, (0, 4 - len(own(u).coef))).tolist() for own in cubics])
    half = rng.normal(size=(3, 3))
    base = {**model["base"], "inertia": half @ half.T}
    return {**model, "base": base}, {**motion, "base_velocities": rows}


def attacked(model, motion, tolerance, rng, functionals=3, starts=8):
    """Proved bounds, least values in worlds, and sizes of functionals at an instant of a random motion."""
    within = Within(model, tolerance, motion)
    late = Late(motion, 0.0, 0.0)
    t = rng.uniform(0, motion["times"][-1][1])
    [rows] = late.rows(np.array([t - 1e-7]), np.array([t + 1e-7]))
    h = rng.normal(size=(functionals, 6)) * [1, 1, 1, 3, 3, 3]
    terms = within.terms(rows)
    proved = within.least(terms, h[:, :, None], np.zeros((2, functionals, 1)))[:, 0]
    sizes = np.abs(h) @ terms.size[:, 0]
    own = ArmOnBase(model, tolerance)
    state = [np.repeat(form.c[0].T, functionals * starts, axis=0) for form in (rows.q, rows.qd, rows.qdd)]
    n, acting = len(model["arm"]["armature"]), np.zeros(12)
    for k, key in enumerate(("process_in_base", "process_on_link")):
        acting[6 * k : 6 * k + 6] = own.arm.get(key, np.zeros(6))
    every = np.repeat(h, starts, axis=0)
    worlds = own.corners(len(every), rng)
    joints, base = [x[:, :n] for x in state], [x[:, n:] for x in state[1:]]
    moved = own.driven(*joints, *base) if "base_velocities" in motion else own.moved(*joints)
    acts = np.tile(acting, (len(every), 1))
    _, values = own.least(every, worlds, moved, acts)
    inside = np.sum(every * own.wrench(own.inside(len(every), rng), moved, acts), axis=1)
    found = np.minimum(values, inside).reshape(functionals, starts).min(axis=1)
    return proved, found, sizes


SOME_PAIRS = [pytest.param(pair, marks=[pytest.mark.slow] if k % 12 else []) for k, pair in enumerate(PAIRS)]


@pytest.mark.parametrize("pair", SOME_PAIRS, ids=[f"{a} x {b}" for a, b in PAIRS])
def test_each_product_of_two_quantities_is_covered(pair):
    rng = np.random.default_rng(PAIRS.index(pair))
    tolerance = {**NONE, **{name: KINDS[name] for name in pair}}
    model = _random_model(rng)
    while model["payload"] is None:
        model = _random_model(rng)
    motion = _random_motion(len(model["arm"]["armature"]), rng)
    if "drive_speed" in pair or rng.random() < 0.3:
        model, motion = driving(model, motion, rng)
    for _ in range(2 if THOROUGH else 1):
        proved, found, sizes = attacked(model, motion, tolerance, rng)
        assert np.all(found >= proved - 1e-9 * sizes), pair
        # The attack is strong: products of a shift of 0.1 m and a tilt of 0.1 rad leave up to 5 %.
        assert np.all(found - proved <= 0.05 * sizes), pair


@pytest.mark.slow
@examples(10, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1))
def test_all_products_at_once_are_covered(seed):
    rng = np.random.default_rng(seed)
    model = _random_model(rng)
    motion = _random_motion(len(model["arm"]["armature"]), rng)
    if rng.random() < 0.5:
        model, motion = driving(model, motion, rng)
    share = {name: rng.uniform(0, 1) for name in KINDS}
    tolerance = {**NONE, **{name: (share[name] * np.array(KINDS[name])).tolist() for name in KINDS}}
    proved, found, sizes = attacked(model, motion, tolerance, rng)
    assert np.all(found >= proved - 1e-9 * sizes)
    assert np.all(found - proved <= 0.05 * sizes)


def test_the_independent_model_is_that_of_the_robot():
    task, motion = _swing("B")
    robot = task.robot.varied(arm=task.robot.arm.with_payload(Payload(0.4, [0.02, 0.0, 0.05])))
    own = ArmOnBase(model_data(robot), tolerance_data(Uncertainty(), robot.support))
    states = motion.states(np.linspace(0.01, motion.end - 0.01, 7))
    found = own.wrench(own.nominal(7), own.moved(*states), np.zeros((7, 12)))
    assert np.allclose(found, robot.loads(*states)[1], rtol=1e-10, atol=1e-10)
