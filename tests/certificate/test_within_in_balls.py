"""What is proved within tolerances, of random arms: below ball arithmetic of worlds drawn at random.

Late joints, overshoots of one and several steps, all masses, centres, the payload's box, pushes, tilt and
pace at once.
"""

from itertools import pairwise

import numpy as np
import pytest

from ocptip.certificate.trusted.late import Late
from ocptip.certificate.trusted.within import Within
from tests.certificate.test_arm_forms import _random_arm

flint = pytest.importorskip("flint")
from tests.oracles import world_in_balls as worlds  # noqa: E402

_WIDTH = flint.arb("1e-60")


def _random_model(rng):
    arm = _random_arm(rng)
    if rng.random() < 0.5:
        arm |= {key: rng.uniform(-20, 20, 6) for key in ("process_in_base", "process_on_link")}
    held = None
    if rng.random() < 0.7:
        axes = arm["mount_rotation"].T
        inertia = 0.001 * np.eye(3)
        held = {
            "mass": 0.5 * arm["masses"][-1],
            "center": rng.uniform(-0.1, 0.1, 3),
            "inertia": inertia,
            "axes": axes,
        }
    gravity = 9.81 * np.array([0.1, -0.05, -1.0])
    base = {"mass": rng.uniform(5, 50), "center_of_mass": rng.uniform(-0.2, 0.2, 3), "gravity": gravity}
    return {"arm": arm, "payload": held, "base": base}


def _random_motion(n, rng):
    """Pieces of cubic angles, at rest first and last; some joints go on smoothly at some events."""
    ends = np.concatenate([[0.0], np.cumsum(rng.uniform(0.004, 0.03, 4))])
    times = [[0.0, 0.0], *([a, b] for a, b in pairwise(ends)), [ends[-1], ends[-1]]]
    q, v = rng.uniform(-3, 3, n), np.zeros(n)
    angles, a = [np.column_stack([q, np.zeros((n, 3))])], np.zeros(n)
    for start, end in times[1:-1]:
        a = np.where(rng.random(n) < 0.6, rng.uniform(-15, 15, n), a)
        j = np.where(rng.random(n) < 0.4, rng.uniform(-200, 200, n), 0.0)
        h = 0.5 * (end - start)
        # about the start: q + v x + a/2 x^2 + j/6 x^3 with x = h (1 + u)
        cubic = np.polynomial.Polynomial([h, h])
        rows = []
        for k in range(n):
            p = np.polynomial.Polynomial([q[k], v[k], a[k] / 2, j[k] / 6])(cubic)
            rows.append(np.pad(p.coef, (0, 4 - len(p.coef))))
        angles.append(np.array(rows))
        T = end - start
        q, v, a = q + v * T + a * T**2 / 2 + j * T**3 / 6, v + a * T + j * T**2 / 2, a + j * T
    angles.append(np.column_stack([q, np.zeros((n, 3))]))
    return {"times": np.array(times).tolist(), "angles": np.array(angles).tolist()}


def _random_tolerance(rng):
    def some(most):
        return float(rng.uniform(0, most)) if rng.random() < 0.7 else 0.0

    return {
        **{"friction": some(0.3), "arm_mass": some(0.2), "payload_mass": some(0.3), "speed": some(0.1)},
        **{"tilt": some(0.2), "delay": some(0.02), "overshoot": some(1.0)},
        **{"extra_mass": some(1.0), "push": some(30.0), "base_push": some(30.0)},
        "center_of_mass": [some(0.05) for _ in range(3)],
        "payload_center": [some(0.05) for _ in range(3)],
        "base_mass": [-some(0.2), some(0.2)],
    }


def check_random_arms(arms, intervals, worlds_each, seed):
    """Raise AssertionError unless all is enclosed; of each arm the least room per size."""
    rng, nearest = np.random.default_rng(seed), []
    for _ in range(arms):
        model, tolerance = _random_model(rng), _random_tolerance(rng)
        motion = _random_motion(len(model["arm"]["armature"]), rng)
        within, joints = Within(model, tolerance), worlds.LateJoints(motion, tolerance)
        late = Late(motion, tolerance["delay"] * (1 + tolerance["speed"]), tolerance["overshoot"])
        starts = rng.uniform(0, late.end, intervals)
        ends = starts + rng.uniform(1e-4, 0.005, intervals)
        scale = np.array([1.0] * 3 + [3.0] * 3)
        h = rng.normal(size=(3, 6)) * scale
        bounds, sizes = np.full((3, intervals), np.inf), np.zeros((3, intervals))
        for rows in late.rows(starts, ends, rng.random((intervals, late.joints)) < 0.5):
            terms = within.terms(rows)
            most = np.broadcast_to(h[:, :, None], (3, 6, len(rows.interval)))
            least = within.least(terms, most, np.zeros((2, 3, len(rows.interval))))
            assert np.all(within.least(terms, most, np.zeros((2, 3, len(rows.interval))), False) <= least)
            # each is a bound by itself: where signs of many terms are in doubt the box is the closer one
            least = np.maximum(least, terms.in_box(most, np.zeros((2, 3, len(rows.interval)))))
            for row in range(3):
                np.minimum.at(bounds[row], rows.interval, least[row])
                np.maximum.at(sizes[row], rows.interval, np.abs(h[row]) @ terms.size)
        near = np.inf
        for k in range(intervals):
            bound, large = bounds[:, k], sizes[:, k]
            for _ in range(worlds_each):
                t = float(rng.choice([starts[k], ends[k], rng.uniform(starts[k], ends[k])]))
                state = joints.state(joints.draw(t, rng))
                world = worlds.random_world(model, tolerance, rng, ends=0.8)
                wrench = worlds.loads(model, world, state)[1]
                for row in range(3):
                    value = sum(
                        (flint.arb(float(x)) * w for x, w in zip(h[row], wrench, strict=True)), flint.arb(0)
                    )
                    assert not value + _WIDTH < flint.arb(float(bound[row])), (model, motion, tolerance, t)
                    near = min(near, (float(value.mid()) - bound[row]) / large[row])
        nearest.append(near)
    return nearest


def test_random_worlds_have_no_less_than_is_proved():
    nearest = check_random_arms(arms=3, intervals=3, worlds_each=4, seed=3)
    assert min(nearest) < 0.3


@pytest.mark.slow
def test_a_thousand_intervals_within_tolerances():
    nearest = check_random_arms(arms=100, intervals=10, worlds_each=5, seed=4)
    assert min(nearest) < 0.05
