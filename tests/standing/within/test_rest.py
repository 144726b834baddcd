"""What a base at rest tolerates: brute force inside the tolerance, figures of the specification, words."""

import json
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.cli.main import main
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Load, Support
from ocptip.published.tasks import experiment_task
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver
from ocptip.standing.tolerance import WORKSHOP, Uncertainty
from ocptip.standing.within.rest import scene_within
from tests.quick import examples, some

FEET = [[0.4, 0.3, 0.0], [-0.4, 0.35, 0.0], [0.0, -0.5, 0.0]]
HANGING = Load(force=[0.0, 0.0, -60.0], point=[0.1, 0.05, 0.9])
PULL = Load(force=[25.0, -10.0, 0.0], moment=[1.0, 2.0, 0.5], point=[0.0, 0.1, 0.5])


def support_of(mass=20.0, center=(0.02, 0.01, 0.4), friction=0.6, gravity=(0.0, 0.0, -9.81)):
    contacts = [UnilateralContact(position=place, friction=friction) for place in FEET]
    return Support(contacts, mass=mass, center_of_mass=center, gravity=gravity)


def reserves(support, loads, moment):
    states = solve_many(support, support.wrench(loads)[None])
    GT = Slip(support).evaluate(states, derivatives=False).GT[0]
    return float(TipOver(support, moment).evaluate(states).GN[0]), float(GT)


def ratio(support, moment):
    return float(TipOver(support).ratio(np.array(moment)))


def tilted(angle, turn):
    side = np.array([np.cos(turn), np.sin(turn), 0.0])
    return 9.81 * (np.cos(angle) * np.array([0, 0, -1.0]) + np.sin(angle) * side)


@pytest.mark.slow
@examples(3)
@given(seed=st.integers(0, 10**6))
def test_nothing_inside_is_worse(seed):
    rng = np.random.default_rng(seed)
    tolerance = Uncertainty(
        tilt=rng.uniform(0, 0.05),
        base_mass=rng.uniform(0, 0.1),
        center_of_mass=rng.uniform(0, 0.06, 3),
        friction=rng.uniform(0, 0.2),
        base_push=rng.uniform(0, 40),
    )
    support, loads = support_of(), [HANGING, PULL]
    moment = TipOver(support).reference_moment
    found = scene_within(support, loads, tolerance)
    worst = np.zeros(2)
    for k in range(60):
        ends = 1.0 if k % 2 else rng.uniform(0, 1)
        sign = np.sign(rng.normal(size=4))
        gravity = tilted(ends * tolerance.tilt, rng.uniform(0, 2 * np.pi))
        push = rng.normal(size=3)
        push *= ends * tolerance.base_push / np.linalg.norm(push)
        other = support_of(
            20.0 * (1 + ends * sign[0] * tolerance.base_mass),
            support.center_of_mass + ends * sign[1:] * np.asarray(tolerance.center_of_mass),
            0.6 * (1 - ends * tolerance.friction),
            gravity,
        )
        hanging = Load(force=60.0 / 9.81 * gravity, point=HANGING.point)
        pushed = Load(force=push, point=other.center_of_mass)
        worst = np.maximum(worst, reserves(other, [hanging, PULL, pushed], moment))
    assert worst[0] - 1e-9 <= found.GN
    assert worst[1] - 1e-9 <= found.GT


@pytest.mark.parametrize(
    ("center", "half", "stands"), some(2, [(0.5, 0.2, False), (0.5, 0.0, True), (0.7, 0.0, False)])
)
def test_a_push_at_an_uncertain_centre_acts_where_the_centre_is(center, half, stands):
    """100 N at 0.7 m above the feet are 70 N m; the weight bears 20 . 9.81 . 0.3 = 58.86 N m."""
    feet = [[x, y, 0.0] for x in (-0.3, 0.3) for y in (-0.3, 0.3)]
    contacts = [UnilateralContact(position=place, friction=2.0) for place in feet]
    support = Support(contacts, mass=20.0, center_of_mass=[0.0, 0.0, center])
    found = scene_within(support, [], Uncertainty(center_of_mass=(0.0, 0.0, half), base_push=100.0))
    assert found.stands is stands
    weight, height = 20 * 9.81 * 0.3, center + half
    # about an edge the push acts across the line to the centre of mass
    least = weight - 100 * np.hypot(0.3, height)
    assert pytest.approx(ratio(support, least), rel=1e-9) == found.GN


@examples(5)
@given(seed=st.integers(0, 10**6))
def test_all_corners_at_once_have_no_less_moment_than_the_worst(seed):
    """Every corner of mass and centre, tilts around, the worst push of each: moments by vectors alone."""
    rng = np.random.default_rng(seed)
    tolerance = Uncertainty(
        tilt=rng.uniform(0, 0.05),
        base_mass=rng.uniform(0, 0.3),
        center_of_mass=rng.uniform(0, 0.1, 3),
        base_push=rng.uniform(0, 20),
    )
    support = support_of()
    least, feet = np.inf, np.array(FEET)
    for more, *signs in product((-1, 1), repeat=4):
        mass = 20.0 * (1 + more * tolerance.base_mass)
        center = support.center_of_mass + np.array(signs) * tolerance.center_of_mass
        weights = mass * np.array([tilted(tolerance.tilt, turn) for turn in np.linspace(0, 2 * np.pi, 120)])
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            edge = (feet[j] - feet[i]) / np.linalg.norm(feet[j] - feet[i])
            lift = edge @ np.cross(feet[k] - feet[i], [0.0, 0.0, 1.0])  # of the third foot's force
            arm = np.cross(edge, center - feet[i])  # moment about the edge per force at the centre
            moments = -np.sign(lift) * weights @ arm - tolerance.base_push * np.linalg.norm(arm)
            least = min(least, moments.min())
    found = scene_within(support, [], tolerance)
    assert ratio(support, least) - 1e-9 <= found.GN
    assert pytest.approx(ratio(support, least), rel=1e-3) == found.GN


def test_the_worst_is_attained():
    tolerance = Uncertainty(tilt=0.03, base_mass=0.08, center_of_mass=(0.01, 0.0, 0.0), friction=0.1)
    support, loads = support_of(), [HANGING, PULL]
    moment = TipOver(support).reference_moment
    found = scene_within(support, loads, tolerance)
    best = np.zeros(2)
    for turn in np.linspace(0, 2 * np.pi, 37):
        for mass in (0.92, 1.08):
            for shift in (-0.01, 0.01):
                gravity = tilted(0.03, turn)
                other = support_of(20.0 * mass, (0.02 + shift, 0.01, 0.4), 0.54, gravity)
                hanging = Load(force=60.0 / 9.81 * gravity, point=HANGING.point)
                best = np.maximum(best, reserves(other, [hanging, PULL], moment))
    assert np.array([found.GN, found.GT]) == pytest.approx(best, rel=5e-3)


@pytest.mark.parametrize(("case", "degrees"), some(1, [("B", 2.05), ("A", 9.1), ("H", 0.45)]))
def test_tilts_at_rest_are_those_of_statics_by_hand(case, degrees):
    """Effective base, figures of the specification; the arm's weight as a load at its centre of mass."""
    task = experiment_task(case, "effective")
    robot = task.robot
    least = 90.0
    for q in (task.start, task.goal):
        wrench = robot.loads(q[None], 0 * q[None], 0 * q[None])[1][0] - robot.support.weight
        arm = np.array([-wrench[4], wrench[3], 0.0]) / wrench[2]
        # moments of a vertical force say nothing of its height: found from a tilted base
        turned = robot.varied(
            support=robot.support.varied(gravity=[9.81, 0.0, 0.0]),
            reference_moment=robot.tip_over.reference_moment,
        )
        sideways = turned.loads(q[None], 0 * q[None], 0 * q[None])[1][0] - turned.support.weight
        arm[2] = sideways[4] / sideways[0]
        load = Load(force=wrench[:3], point=robot.support.center_of_mass + arm)
        found = scene_within(robot.support, [load], Uncertainty(tilt=np.radians(12.0)))
        assert not found.stands
        least = min(least, float(found.reason.rsplit("floor tilt ", 1)[1].split()[0]))
    assert least == pytest.approx(degrees, abs=0.06 if degrees > 3 else 0.012)


def test_refusals_name_the_quantity_and_how_much_of_it_is_possible():
    support, loads = support_of(), [HANGING, PULL]
    found = scene_within(support, loads, Uncertainty(base_push=200.0, base_mass=0.05))
    assert not found.stands
    assert found.reason.startswith("push of 200 N at the base alone is too much, possible is push of ")
    most = float(found.reason.split("push of ")[2].split()[0])
    assert scene_within(support, loads, Uncertainty(base_push=0.98 * most)).stands
    assert not scene_within(support, loads, Uncertainty(base_push=1.02 * most)).stands
    assert "push of 200 N at the base towards" in found.GN_worst
    fallen = scene_within(support, [Load(force=[500.0, 0, 0], point=[0, 0, 1.0])], Uncertainty(tilt=0.01))
    assert fallen.reason == "it is not stable in the nominal model"


def test_what_a_scene_cannot_have_is_said():
    found = scene_within(support_of(), [HANGING], WORKSHOP)
    assert found.stands
    assert found.ignored == (
        "arm masses +-5 %", "payload +-5 %", "0.1 kg more at the TCP", "joints delayed by up to 10 ms",
        "3 % faster or slower", "acceleration steps overshoot at 5 % damping",
    )  # fmt: skip
    assert found.to_dict()["stands"] is True
    assert "not included at rest: arm masses" in found.lines(None)[-1]


def test_scenes_without_tilt_are_refused():
    planar = Support(
        [UnilateralContact(position=[x, 0.0], normal=[0.0, 1.0], friction=0.5) for x in (-0.3, 0.3)],
        mass=5.0,
        center_of_mass=[0.0, 0.4],
    )
    with pytest.raises(InputError, match="only for spatial scenes"):
        scene_within(planar, [], Uncertainty(tilt=0.01))
    with pytest.raises(InputError, match="without gravity"):
        scene_within(support_of(gravity=(0.0, 0.0, 0.0)), [], Uncertainty(tilt=0.01), 10.0)


SCENE = """
[base]
mass = 20.0
center_of_mass = [0.0, 0.0, 0.4]
feet = [[0.4, 0.3, 0.0], [-0.4, 0.35, 0.0], [0.0, -0.5, 0.0]]
friction = 0.6
"""


@pytest.mark.slow
def test_the_command_judges_the_worst_of_a_tolerance(tmp_path, capsys):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE + "[tolerance]\ntilt_deg = 1.0\n")
    assert main(["stand", str(path)]) == 0
    assert "floor tilt 1 deg: no contact is lost" in capsys.readouterr().out
    assert main(["stand", str(path), "--tolerance", "none"]) == 0
    assert "tilt" not in capsys.readouterr().out
    path.write_text(SCENE + "[tolerance]\nbase_push = 400.0\n")
    assert main(["stand", str(path)]) == 1
    text = " ".join(capsys.readouterr().out.split())
    assert "STABLE NOMINALLY" in text
    assert "NOT WITHIN ITS UNCERTAINTY" in text
    assert "A CONTACT IS LOST: push of 400 N at the base alone is too much, possible is push of" in text
    assert main(["stand", str(path), "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert (data["persistent"], data["within"]["stands"]) == (True, False)
    assert main(["stand", str(path), "--tolerance", "nowhere"]) == 2
    assert "--tolerance: " in capsys.readouterr().err
