"""Parallel robots whose legs have closed forms: their programs are enclosed, and their motions certified."""

import copy
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.certificate.describe import model_data
from ocptip.certificate.find import certify
from ocptip.certificate.trusted.checker import check_certificate, digest
from ocptip.certificate.trusted.described import Checker, Intervals
from ocptip.certificate.trusted.forms import Form
from ocptip.certificate.trusted.program import arc, inverse, root
from ocptip.motion.check import check_motion
from ocptip.parallel.description.ready_made import delta, ups6
from ocptip.parallel.robot import ParallelRobot
from ocptip.robots.payload import Payload
from ocptip.standing.limits import Limits
from ocptip.standing.platform import PlatformLimits, StandingParallelRobot
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from tests.quick import some
from tests.standing.test_standing_platform import TURNED, cart, dc_motors, hexapod_limits

flint = pytest.importorskip("flint")
from tests.oracles import arm_in_balls as balls  # noqa: E402
from tests.oracles.numeric_platform import numeric_loads  # noqa: E402

_WIDTH = flint.arb("1e-70")
_bends = st.lists(st.floats(-0.2, 0.2).map(lambda x: x if abs(x) > 1e-60 else 0.0), min_size=1, max_size=5)
_places = st.sampled_from([-1.0, -0.7, 0.0, 0.3, 1.0])
_sides = st.sampled_from([-1.0, 0.0, 1.0])


def _form(middle, bends, radius):
    return Form.of(*(np.array([x]) for x in (middle, *bends)), radius=np.array([radius]))


def _inside(form, value, s):
    middle = balls.polynomial(form.c[:, 0], flint.arb(s))
    return abs(value - middle) <= flint.arb(float(form.r[0])) + _WIDTH


@given(st.floats(1.5, 20) | st.floats(-20, -1.5), _bends, _places, _sides, st.sampled_from([0.0, 1e-9, 0.01]))
def test_inverses_and_roots_enclose(middle, bends, s, side, radius):
    x = _form(middle, bends, radius)
    value = balls.polynomial([middle, *bends], flint.arb(s)) + flint.arb(side * radius)
    assert np.isfinite(inverse(x).r[0])
    assert _inside(inverse(x), 1 / value, s)
    if middle > 0:
        assert _inside(root(x), value.sqrt(), s)
    else:
        assert not np.isfinite(root(x).r[0])


@given(st.floats(-20, 20), _bends, st.floats(1.5, 20) | st.floats(-20, -1.5), _bends, _places, _sides)
def test_angles_enclose_up_to_turns(y, ys, x, xs, s, side):
    angle = arc(_form(y, ys, 1e-9), _form(x, xs, 1e-9))
    if not np.isfinite(angle.r[0]):
        assert np.hypot(x, y) < 3  # they do not come near zero
        return
    up, along = (balls.polynomial(c, flint.arb(s)) + flint.arb(side * 1e-9) for c in ([y, *ys], [x, *xs]))
    middle, radius = balls.polynomial(angle.c[:, 0], flint.arb(s)), flint.arb(float(angle.r[0])) + _WIDTH
    turned = along * middle.cos() + up * middle.sin(), up * middle.cos() - along * middle.sin()
    assert abs(flint.arb.atan2(turned[1], turned[0])) <= radius


def test_what_is_near_zero_is_not_known():
    zero = _form(0.0, [0.1], 0.0)
    for found in (inverse(zero), root(zero), arc(zero, zero), inverse(_form(0.1, [0.2], 0.0))):
        assert found.r[0] == np.inf


# --- robots -------------------------------------------------------------------------------------------------

_MOTORS = {"motors": dc_motors(3)}
_PLACE = {"position": (0.05, -0.02, 0.9), "rotation": TURNED}


def _delta():
    limits = PlatformLimits(speed=1.0, acceleration=5.0, motor_force=20.0, motor_speed=20.0, singularity=0.1)
    robot = ParallelRobot(delta().with_payload(Payload(1.0)))
    return StandingParallelRobot(robot, cart(), dc_motors(3), limits, **_PLACE)


def _hexapod():
    return StandingParallelRobot(ParallelRobot(ups6()), cart(), dc_motors(6), hexapod_limits(), **_PLACE)


def _swing(robot):
    home = np.array(robot.robot.description.home)
    way = np.array([0.04, 0.03, -0.02, 0.05, -0.03, 0.04])[: robot.n]
    commands = [[RampCommand(a + w, 0.05, 0.2)] for a, w in zip(home, way, strict=True)]
    return Trajectory.from_profiles(home, commands)


@pytest.fixture(scope="module", params=some(1, [_delta, _hexapod]), ids=["delta", "hexapod"])
def certified(request):
    robot = request.param()
    motion, limits = _swing(robot), Limits(torque_ratio=10.0)
    checked = check_motion(robot, motion, limits)
    return robot, motion, checked, certify(robot, motion, limits, checked.worst)


def test_motions_of_parallel_robots_are_certified(certified):
    _, _, checked, found = certified
    assert checked.verified, checked.violations
    assert found.certified, (found.undecided, found.verdict.problems, found.sampled)
    for name in ("GN", "GT", "torque_ratio"):
        worst = checked.worst[name].value
        assert worst <= found.verdict.bounds[name] <= worst + 1e-3 * max(worst, 0.1)
    assert check_certificate(json.loads(json.dumps(found.data))) == found.verdict


def test_programs_are_what_the_numeric_robot_needs(certified):
    """Its inverse dynamics are other code: joints are searched, nothing is eliminated."""
    robot, motion, _, found = certified
    data = found.data["motion"]
    checker = Checker(model_data(robot), found.data["bounds"])
    times, rng = np.array(data["times"]), np.random.default_rng(0)
    piece = rng.integers(1, len(times) - 1, 12)
    u = rng.uniform(-0.9, 0.9, len(piece))
    at = Intervals(data, piece, u - 0.01, u + 0.01)
    loads = checker.loads(at)
    t = times[piece].mean(axis=1) + 0.5 * u * np.diff(times[piece], axis=1)[:, 0]
    torques, wrench = numeric_loads(robot, *motion.states(t))
    for form, value in ((loads.torques, torques), (loads.wrench, wrench)):
        low, high = form.range
        size = np.max(np.abs(value))
        assert np.all((low.T - 1e-8 * size <= value) & (value <= high.T + 1e-8 * size))
        assert np.max(high - low) < 0.2 * size


def _changes():
    def tighter(data):
        data["model"]["program"]["lower"][0] = 0.999

    def slower(data):
        n = len(data["model"]["limits"]["speed"])
        data["model"]["program"]["upper"][-n:] = [1e-3] * n

    def further(data):
        data["model"]["program"]["lower"] = data["model"]["program"]["lower"][1:]

    def forward(data):
        code = data["model"]["program"]["code"]
        next(row for row in code if row[0] == "MUL")[1] = len(code)

    def negative(data):
        next(row for row in data["model"]["program"]["code"] if row[0] == "ADD")[2] = -1

    def unknown(data):
        next(row for row in data["model"]["program"]["code"] if row[0] == "ADD")[0] = "POW"

    def endless(data):
        next(row for row in data["model"]["program"]["code"] if row[0] == "CONST")[1] = None

    def of_an_angle(data):
        code = data["model"]["program"]["code"]
        angle = next(k for k, row in enumerate(code) if row[0] == "ATAN2")
        next(row for row in code[angle:] if row[0] == "MUL")[1] = angle

    def an_angle(data):
        program = data["model"]["program"]
        angle = next(k for k, row in enumerate(program["code"]) if row[0] == "ATAN2")
        program["outputs"][0] = angle

    def fewer(data):
        data["model"]["program"]["outputs"].pop()

    def within(data):
        data["tolerance"] = {"tilt": 0.1}

    def lighter(data):
        data["model"]["base"]["mass"] *= 0.02

    def without(data):
        data["model"]["program"] = None

    own = (tighter, slower, further, forward, negative, unknown, endless, of_an_angle)
    return {f.__name__: f for f in (*own, an_angle, fewer, within, lighter, without)}


@pytest.mark.parametrize("change", _changes().values(), ids=_changes())
def test_other_programs_are_refused(certified, change):
    data = copy.deepcopy(dict(certified[3].data))
    change(data)
    data["sha256"] = {key: digest(data[key]) for key in ("model", "motion", "tolerance")}
    verdict = check_certificate(data)
    assert not verdict.holds
    assert verdict.problems
