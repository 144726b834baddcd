"""Motions on compliant feet, against a simulation of the rigid bodies that linearises nothing."""

import json
from dataclasses import replace

import numpy as np
import pytest

from ocptip.contact.bindings.clamps import RigidClamp
from ocptip.motion.check import check_motion
from ocptip.published.tasks import experiment_task
from ocptip.standing.elastic import feet as on_feet
from ocptip.standing.elastic import springs as on_springs
from ocptip.standing.elastic.feet import on_its_feet, softest_feet
from ocptip.standing.elastic.springs import Ride, Simulation
from ocptip.standing.elastic.steps import Modes
from ocptip.standing.instants import Instants
from ocptip.standing.limit_kinds.elastic import FootForceLimit, FootLiftLimit, JumpFootForceLimit
from ocptip.standing.limit_kinds.rows import NodeSlopes
from ocptip.standing.limits import Limits
from ocptip.standing.parts import Part
from ocptip.standing.simulation.replay import Simulator
from ocptip.standing.simulation.replay import compared as compared_replay
from ocptip.standing.tolerance import overshoot_of
from ocptip.trajectories.trajectory import Trajectory
from studies.elastic_feet.rigid_bodies import FeetSimulation
from tests.places import ROOT
from tests.quick import some


def softened(robot, stiffness, **damping):
    """The same robot on feet of this stiffness."""
    own = robot.support
    feet = [replace(c, stiffness=stiffness, **damping) for c in own.contacts]
    return robot.varied(support=own.varied(feet))


def plan_of(case):
    """Robot and verified motion of a published case."""
    path = ROOT / f"studies/results/plans/{case}-effective/plan.json"
    return experiment_task(case).robot, Trajectory.from_dict(json.loads(path.read_text()))


def simulated(robot, motion, step):
    foot = robot.support.contacts[0]
    delay = on_its_feet_delay(robot, motion)
    stiffness = foot.spring().stiffness
    return FeetSimulation(robot, motion, stiffness[0], stiffness[1], delay).run(step)


def on_its_feet_delay(robot, motion):
    """Damping over stiffness, s."""
    start = motion.start[None]
    return Modes.of(robot.support.elastic, robot.inertia(start, 0 * start)[0][0]).delays[0]


def compared(robot, motion, step):
    """Our forces and gaps and the simulation's, at its instants."""
    theirs, ours = simulated(robot, motion, step), on_its_feet(robot, motion).course
    kept = theirs.times < ours.times[-1]
    forces, gaps = (
        np.stack([np.interp(theirs.times[kept], ours.times, x) for x in values.T], axis=1)
        for values in (ours.forces[:, :, 0], ours.gaps)
    )
    return forces, theirs.forces[kept], gaps, theirs.gaps[kept]


def test_inertia_is_that_of_other_rigid_bodies():
    robot, motion = plan_of("A")
    simulation = FeetSimulation(robot, motion, 1e6, 1e6, 1e-3)
    q, qd, _ = (x[0] for x in motion.states(np.array([0.31])))
    y = np.array([*robot.support.center_of_mass, 1, 0, 0, 0, *np.zeros(6)])
    inertia, turning = (x[0] for x in robot.inertia(q[None], qd[None]))
    M, bias = simulation.inertia_and_bias(y, q, qd)
    assert np.allclose(inertia, M[:, :6], atol=1e-7)
    for axis in range(3):
        slopes = []
        for size in (1e-4, -1e-4):
            y[10:] = size * np.eye(3)[axis]
            slopes.append(simulation.inertia_and_bias(y, q, qd)[1])
        assert np.allclose((slopes[0] - slopes[1]) / 2e-4, turning[:, axis], atol=1e-6)
    wrench = robot.loads(q[None], qd[None], 0 * qd[None])[1][0]
    assert np.allclose(bias, -wrench, atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "stiffness", "ratio", "step"), some(1, [("A", 1e5, 0.05, 1e-3), ("A", 1e6, 0.2, 1e-3)])
)
def test_forces_are_those_of_a_simulation(case, stiffness, ratio, step):
    """Feet lift in all these."""
    robot, motion = plan_of(case)
    forces, expected, gaps, lifted = compared(softened(robot, stiffness, damping_ratio=ratio), motion, step)
    assert np.sqrt(np.mean((forces - expected) ** 2)) < 0.5  # N
    assert forces.max() == pytest.approx(expected.max(), rel=0.01)
    assert gaps.max() == pytest.approx(lifted.max(), rel=0.03)
    assert lifted.max() > 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("case", ["A", "B", "G"])
@pytest.mark.parametrize(("stiffness", "step"), [(1e6, 2e-4), (1e7, 1e-4)])
@pytest.mark.parametrize("ratio", [0.05, 0.2])
def test_forces_of_plans_are_those_of_a_simulation(case, stiffness, ratio, step):
    robot, motion = plan_of(case)
    if (case, stiffness) == ("B", 1e6):
        pytest.skip("it falls, or nearly")
    forces, expected, gaps, lifted = compared(softened(robot, stiffness, damping_ratio=ratio), motion, step)
    assert np.sqrt(np.mean((forces - expected) ** 2)) < 1.5
    assert forces.max() == pytest.approx(expected.max(), rel=0.02)
    assert gaps.max() == pytest.approx(lifted.max(), rel=0.02)


def test_plan_b_falls_from_soft_feet():
    robot, motion = plan_of("B")
    found = on_its_feet(softened(robot, 1e5, damping_ratio=0.2), motion)
    assert found.falls
    assert found.lift >= on_springs.FALLEN
    assert "a foot moves by more than 20 mm at 0." in found.lines()[0]


@pytest.mark.slow
def test_steps_are_fine_enough(monkeypatch):
    robot, motion = plan_of("G")
    soft = softened(robot, 1e6)
    elastic, start = soft.support.elastic, motion.start[None]
    modes = Modes.of(elastic, soft.inertia(start, 0 * start)[0][0])

    def least():
        """Normal force, N, of the linear theory, and height, m, of feet that only push."""
        ride = Ride(soft, motion)
        pulling = Simulation(ride, elastic, modes, one_sided=False).run()
        return pulling.forces[:, :, 0].min(), Simulation(ride, elastic, modes).run().gaps.max()

    usual = least()
    monkeypatch.setattr(on_springs, "LONGEST", 0.002)
    monkeypatch.setattr(on_springs, "PER_PERIOD", 60)
    finer = least()
    assert usual[0] == pytest.approx(finer[0], abs=0.05)  # N, of 60
    assert usual[1] == pytest.approx(finer[1], rel=0.01)


def test_it_starts_at_rest_and_ends_at_rest():
    robot, motion = plan_of("A")
    soft = softened(robot, 1e6)
    course = on_its_feet(soft, motion).course
    ends = [soft.loads(q[None], 0 * q[None], 0 * q[None])[1] for q in (motion.start, motion.goal)]
    for at, wrench in zip((0, -1), ends, strict=True):
        expected = soft.support.elastic.share(wrench).forces[0, :, 0]
        assert np.allclose(course.forces[at, :, 0], expected, atol=0.6)  # the base leans by a hair
    assert course.times[0] == 0
    assert course.times[-1] > motion.end + 0.15


def test_damping_is_what_was_asked_for():
    robot, motion = plan_of("A")
    found = on_its_feet(softened(robot, 3e5, damping_ratio=0.07), motion)
    assert found.damping == pytest.approx(0.07, rel=1e-3)
    delay = on_its_feet_delay(softened(robot, 3e5, damping_ratio=0.07), motion)
    same = on_its_feet(softened(robot, 3e5, damping=3e5 * delay), motion)
    assert same.damping == pytest.approx(0.07, rel=1e-3)
    assert same.lift == pytest.approx(found.lift)


@pytest.mark.slow
def test_stiffer_feet_lift_less_but_jumps_still_lift_them():
    """What overshoots is a share of the jump, whatever the stiffness; the height goes with its inverse."""
    robot, motion = plan_of("A")
    lifts = [on_its_feet(softened(robot, k), motion).lift for k in (1e6, 1e7, 1e8)]
    assert lifts[0] / lifts[1] == pytest.approx(10, rel=0.1)
    assert lifts[1] / lifts[2] == pytest.approx(10, rel=0.1)


@pytest.mark.parametrize("lift", [0.0, 3e-4, 0.02])
@pytest.mark.parametrize("damping", [0.05, 1.0])
def test_feet_of_a_motion_that_lifts_one_are_pressed_more(lift, damping):
    """By the force that the lift takes of a spring, at instants and after acceleration steps alike."""
    robot = softened(experiment_task("A").robot, 1e5)
    asked = Limits(damping=damping)
    more = FootLiftLimit(robot, asked, (0,)).tightened(asked, lift)
    unit = robot.mass * 9.81 / 3
    added = np.clip(1e5 * lift, 0.05 * unit, 0.2 * unit)
    assert more.foot_force == pytest.approx(added, rel=1e-6)
    assert more.jump_foot_force == pytest.approx(added if asked.overshoot > 0 else 0.0, rel=1e-6)


def test_a_check_is_not_verified_where_a_foot_lifts():
    robot, motion = plan_of("A")
    assert check_motion(robot, motion).verified
    assert check_motion(robot, motion).feet is None
    soft = softened(robot, 1e6)
    checked = check_motion(soft, motion)
    assert not checked.verified
    lift = checked.worst["foot_lift_m"]
    assert checked.violations == (lift,)
    assert (lift.detail, lift.limit) == ("contact 1", 0)
    assert checked.feet.lift == lift.value == pytest.approx(6.8e-5, rel=0.02)
    allowed = check_motion(soft, motion, Limits(foot_lift=1e-4))
    assert allowed.verified
    data = json.loads(json.dumps(allowed.to_dict()["feet"]))
    assert data["lift_m"] == lift.value
    assert data["frequency_Hz"] == pytest.approx(23.3, rel=0.01)
    assert data["lifts"][0]["contact"] == 1


def test_lines_say_what_is_known():
    robot, motion = plan_of("A")
    lines = on_its_feet(softened(robot, 1e6), motion).lines()
    assert lines[0].startswith("contact 1 lifts by 0.068 mm (0.031 s); 1 other lift")
    assert lines[1] == "lowest natural frequency 23.3 Hz, damping 5 %"
    slow = on_its_feet(softened(robot, 1e6), motion.time_scaled(2.0)).lines()
    assert slow[0].startswith("minimum normal force ")


@pytest.mark.parametrize("kind", [FootForceLimit, JumpFootForceLimit])
def test_rows_of_foot_forces_are_the_springs_and_their_slopes(kind):
    robot, motion = plan_of("A")
    soft = softened(robot, 2e5)
    limit = kind(soft, Limits(damping=0.2), (0, 1, 2))
    at = Instants.of_states(soft, *motion.states(np.linspace(0.1, 1.2, 7)))
    shared = soft.support.elastic.share(at.wrenches)
    assert shared.pressing.all()
    assert np.allclose(limit.forces(at), shared.forces[:, :, 0])
    columns = type("Columns", (), {"wrench": slice(0, 6), "wrenches": (slice(0, 6),)})()
    slopes = np.broadcast_to(np.eye(6), (7, 6, 6))
    node = NodeSlopes(columns, np.empty((7, 0)), np.empty((7, 0, 6)), at.wrenches, slopes)
    rows = limit.rows(node, np.ones((7, 3), dtype=bool))
    assert np.allclose(limit.jacobian(rows).reshape(7, 3, 6) * limit.unit, shared.maps[:, :, 0])
    assert np.allclose(rows.values.reshape(7, 3) * limit.unit, shared.forces[:, :, 0])


def test_rows_beside_clamps_begin_where_jaws_yield():
    """The clamp of case C counts from its preload; a rigid one has no row."""
    robot, motion = plan_of("C")
    soft = softened(robot, 2e5)
    at = Instants.of_states(soft, *motion.states(np.linspace(0.1, 1.2, 7)))
    normal = soft.support.elastic.share(at.wrenches).forces[:, :, 0]
    limit = FootForceLimit(soft, Limits(), (0, 1, 2))
    pressing = normal > [0, 0, -29.33]
    assert np.allclose(limit.forces(at)[pressing], (normal + np.array([0, 0, 29.33]))[pressing])
    assert limit.detail(lambda _: at, 0.1) == f"contact {np.argmin(limit.forces(at)[0]) + 1}"
    jaws = {"position": soft.support.contacts[0].position, "friction_upper": 1, "friction_lower": 1}
    held = soft.support.varied([RigidClamp(**jaws, stiffness=2e5), *soft.support.contacts[1:]])
    limit = FootForceLimit(soft.varied(support=held), Limits(), (0, 1, 2))
    assert limit.width == 2
    assert limit.detail(lambda _: at, 0.1) in ("contact 2", "contact 3")


def replayed(robot, motion):
    """What the library and MuJoCo say about a motion."""
    parts = (Part(robot, motion),)
    replay = Simulator(parts).run()
    return on_its_feet(robot, motion), replay, compared_replay(parts, replay)


@pytest.mark.slow
def test_feet_beside_a_clamp_swing_as_in_another_simulator():
    robot, motion = plan_of("C")
    soft = softened(robot, 1e6)
    course, replay, beside = replayed(soft, motion.time_scaled(1.6))
    assert course.lines()[0].startswith("minimum normal force 3.33 N (contact 2")
    assert replay.stands
    assert beside.stands
    assert beside.rms < 0.4  # N
    assert replay.forces[:, 2].min() == pytest.approx(course.least[2].value, abs=0.1)
    assert course.least[2].value < -5


@pytest.mark.slow
def test_a_jaw_yields_at_its_force():
    """Feet of 1e5 N/m rock the base of case C so that its clamp lets go at 0.42 s for the first time."""
    robot, motion = plan_of("C")
    found, replay, beside = replayed(softened(robot, 1e5), motion)
    course = found.course
    first = min((lift for lift in found.lifts if lift.contact == 3), key=lambda lift: lift.begin)
    lifted = (replay.times < 0.6) & (replay.heights[:, 2] > 0.2e-3)
    assert found.least[2].value == -29.33 == pytest.approx(np.median(replay.forces[lifted, 2]), abs=0.5)
    assert not beside.stands
    assert first.begin == pytest.approx(replay.times[lifted][0], abs=0.02)
    assert first.height == pytest.approx(replay.heights[lifted, 2].max(), rel=0.3)
    before = (replay.times > 0) & (replay.times < first.begin)
    forces = np.interp(replay.times[before], course.times, course.forces[:, 2, 0])
    assert np.sqrt(np.mean((forces - replay.forces[before, 2]) ** 2)) < 2.5  # N, of 91 to -29


def test_one_jump_overshoots_by_the_rule():
    """Before the second event the most that a foot loses is its jump times 1 + kappa, mode by mode."""
    robot, motion = plan_of("A")
    soft = softened(robot, 1e8, damping_ratio=0.05)
    second = motion.event_times[1]
    course = on_its_feet(soft, motion).course
    early = (course.times > 0) & (course.times < second)
    start = soft.support.elastic.share(Instants.at_rest(soft, motion.start[None]).wrenches).forces[0, :, 0]
    jumped = Instants.of_states(soft, *motion.states(np.array([2e-7])))
    change = soft.support.elastic.share(jumped.wrenches).forces[0, :, 0] - start
    k = int(np.argmin(change))
    bound = start[k] + (1 + overshoot_of(0.05)) * change[k]
    least = course.forces[early, k, 0].min()
    assert bound - 1 <= least <= start[k] + 1.3 * change[k]


@pytest.mark.slow
def test_the_least_stiffness_is_where_a_foot_begins_to_lift():
    robot, motion = plan_of("B")
    slow = motion.time_scaled(1.5)
    found = softest_feet(robot, slow)
    assert 1e4 < found.least < 1e7
    above, below = (on_its_feet(softened(robot, f * found.least), slow) for f in (1.05, 0.9))
    assert above.lift == 0
    assert below.lift > 0
    assert softest_feet(robot, motion).least == np.inf
    assert softest_feet(*plan_of("C")) is None  # a clamp
    gentle = softest_feet(plan_of("A")[0], plan_of("A")[1].time_scaled(10.0))
    assert (gentle.least, gentle.lost) == (on_feet.SOFTEST, None)


@pytest.mark.slow
def test_feet_that_hold_only_if_they_are_soft_enough():
    """A jump lifts a foot on stiff ones, and on soft ones; in between the next jump comes before it does."""
    robot, motion = plan_of("E")
    motion = motion.time_scaled(1.1)
    found = softest_feet(robot, motion)
    assert found.least == np.inf
    assert found.lost.value < 0
    least, most = found.between
    for holds, stiffnesses in ((True, (1.05 * least, 0.95 * most)), (False, (0.8 * least, 1.2 * most))):
        for stiffness in stiffnesses:
            assert (not on_its_feet(softened(robot, stiffness), motion).lifts) == holds


@pytest.mark.parametrize(
    ("held", "found"),
    [
        ((4.0, 7.0), (1e4, None)),
        ((5.3, 7.0), (10**5.3, None)),
        ((5.3, 6.2), (np.inf, (10**5.3, 10**6.2))),
        ((4.0, 4.2), (np.inf, (1e4, 10**4.2))),
        ((8.0, 9.0), (np.inf, None)),
    ],
)
def test_ranges_of_stiffness_are_bisected(held, found):
    def lifted(exponent, whether=False):
        inside = held[0] - 1e-9 <= exponent <= held[1] + 1e-9
        return None if inside else on_feet.Margin(-0.5 if whether else -1.0, exponent, (1,))

    exponents = np.arange(7.0, 3.9, -0.5).tolist()
    own = on_feet._range(lifted, exponents)
    assert own.least == pytest.approx(found[0], rel=0.05)
    assert own.between == (None if found[1] is None else pytest.approx(found[1], rel=0.05))
    assert (own.lost is None) == (held[0] == 4.0 and held[1] == 7.0)
    assert own.lost is None or own.lost.value == -1.0  # what is said is the least force


def test_a_course_may_end_where_a_foot_pulls():
    robot, motion = plan_of("A")
    soft = softened(robot, 1e7)
    elastic, start = soft.support.elastic, motion.start[None]
    modes = Modes.of(elastic, soft.inertia(start, 0 * start)[0][0])
    for own in (motion, motion.time_scaled(10.0)):
        simulation = Simulation(Ride(soft, own), elastic, modes, one_sided=False)
        whole, part = simulation.run(), simulation.run(to_first_pull=True)
        pulls = np.min(whole.forces[:, :, 0]) < 0
        assert pulls == (own is motion) == (len(part.times) < len(whole.times))
        assert (np.min(part.forces[:, :, 0]) < 0) == pulls
        np.testing.assert_array_equal(part.forces, whole.forces[: len(part.times)])


def test_feet_that_give_too_far_do_not_hold():
    """A heavy robot on soft feet sinks by 20 mm and more without lifting any."""
    robot, motion = plan_of("A")
    slow, heavy = motion.time_scaled(10.0), robot.varied(support=robot.support.varied(mass=100.0))
    found = softest_feet(heavy, slow)
    assert found.least > on_feet.SOFTEST
    assert found.lost.value >= 0


def test_what_is_not_computed_is_said():
    robot, motion = plan_of("A")
    assert softened(robot, 1e6).notes == robot.notes == ()
    own = robot.support
    castors = [replace(c, friction=0.0, stiffness=1e6) for c in own.contacts]
    rolling = robot.varied(support=own.varied(castors))
    assert rolling.notes == ("how the base swings on compliant feet is not computed for this arm",)
    assert on_its_feet(rolling, motion) is None
