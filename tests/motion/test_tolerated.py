"""What a motion tolerates: figures of the source, statics by hand, and the exact check on either side."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from ocptip.cli.layout import tolerated_lines
from ocptip.contact.support import Support
from ocptip.motion.check import check_motion
from ocptip.motion.summary import robustness_lines
from ocptip.motion.tolerated import Tolerated, robustness, tolerated
from ocptip.numerics.bisection import bisected
from ocptip.published.tasks import experiment_task
from ocptip.robots.kinematics import gripper_pose
from ocptip.robots.payload import Payload
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.load_cases import contact_test
from ocptip.standing.at_rest.loss_search import SLIPS_ALIKE, beyond
from ocptip.standing.limits import Limits
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from tests.quick import some

JUST = Limits(GN=1.0, GT=1.0, torque_ratio=1e6)


def at_rest(angles):
    return Trajectory.from_profiles(angles, [[RampCommand(phi, 1.0, 1.0)] for phi in angles])


def values(robot, motion):
    return {one.quantity: one for one in tolerated(robot, motion)}


@pytest.mark.parametrize(
    ("case", "degrees"),
    some(1, [("A", 9.1), ("H", 0.45), ("B", 2.05), ("D", 9.3), ("E", 1.65), ("G", 8.4)]),
)
def test_tilts_at_rest_are_those_of_statics_by_hand(case, degrees):
    """Effective base; figures of the specification, to two digits."""
    task = experiment_task(case, "effective")
    least = min(values(task.robot, at_rest(q))["tilt"].value for q in (task.start, task.goal))
    assert least == pytest.approx(degrees, abs=0.05 if degrees > 3 else 0.006)


@pytest.fixture(scope="module")
def task():
    return experiment_task("G", "effective")


@pytest.fixture(scope="module")
def found(task):
    return values(task.robot, task.reference)


def with_support(task, **changes):
    own = task.robot.support
    kept = {"mass": own.mass, "center_of_mass": own.center_of_mass, "gravity": own.gravity}
    contacts = changes.pop("contacts", own.contacts)
    support = Support(contacts, **{**kept, **changes})
    return Robot(task.robot.arm, support, task.robot.motors, redistribution=task.robot.slip.redistribution)


def stands(robot, motion):
    return check_motion(robot, motion, JUST).stands


def test_the_named_tilt_is_the_brink(task, found):
    direction = np.array([float(x) for x in found["tilt"].how.split("(")[1].split(")")[0].split(",")])
    direction /= np.linalg.norm(direction)
    down = np.array([0.0, 0.0, -9.81])

    def tilted(degrees):
        a = np.radians(degrees)
        return with_support(task, gravity=np.cos(a) * down + np.sin(a) * 9.81 * direction)

    assert stands(tilted(0.97 * found["tilt"].value), task.reference)
    assert not stands(tilted(1.03 * found["tilt"].value), task.reference)


def test_the_mass_is_the_brink(task, found):
    def heavier(mass):
        arm = task.robot.arm.with_payload(Payload(mass))
        return Robot(arm, task.robot.support, task.robot.motors)

    assert stands(heavier(0.98 * found["extra_mass"].value), task.reference)
    assert not stands(heavier(1.02 * found["extra_mass"].value), task.reference)


def test_with_the_mass_that_drives_move_a_torque_is_at_its_limit(task, found):
    arm = task.robot.arm.with_payload(Payload(found["extra_mass"].drives))
    heavy = Robot(arm, task.robot.support, task.robot.motors)
    torques, _ = heavy.loads(*task.reference.states(task.reference.both_sides(0.01)))
    assert np.max(np.abs(torques) / heavy.limits.torque) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.slow
def test_predictions_change_no_number(task, found, monkeypatch):
    def plain(*given):
        return bisected(*given[:5])

    monkeypatch.setattr("ocptip.motion.tolerated.bisected", plain)
    assert values(task.robot, task.reference) == found


def test_a_payload_is_held_already(task, found):
    part = 0.4 * found["extra_mass"].value
    arm = task.robot.arm.with_payload(Payload(part))
    more = values(Robot(arm, task.robot.support, task.robot.motors), task.reference)["extra_mass"]
    assert more.value + part == pytest.approx(found["extra_mass"].value, rel=5e-3)


def test_the_speed_is_the_brink(task, found):
    share = found["faster"].value / 100
    assert stands(task.robot, task.reference.time_scaled(1 / (1 + 0.98 * share)))
    assert not stands(task.robot, task.reference.time_scaled(1 / (1 + 1.02 * share)))


def test_the_friction_is_the_brink(task, found):
    def rougher(factor):
        contacts = [dataclasses.replace(c, friction=factor * c.friction) for c in task.robot.support.contacts]
        return with_support(task, contacts=contacts)

    assert stands(rougher(1.005 * found["friction"].value), task.reference)
    assert not stands(rougher(0.995 * found["friction"].value), task.reference)


@pytest.mark.slow
def test_no_direction_loses_a_contact_below_the_reported_push(task):
    robot, rest = task.robot, at_rest(task.start)
    weight = robot.samples(rest, [0.0]).wrenches[0]
    at = gripper_pose(robot.arm, task.start)[0] - robot.support.center_of_mass
    rng = np.random.default_rng(5)
    sides = rng.normal(size=(1000, 3))
    sides /= np.linalg.norm(sides, axis=1)[:, None]
    per_newton = np.hstack([sides, np.cross(at, sides)])
    push = values(robot, rest)["push"].value
    keeps = contact_test(robot)
    assert keeps(weight + 0.995 * push * per_newton).all()
    assert not keeps(weight + 1.05 * push * per_newton).all()


def test_a_push_at_rest_against_the_moment_about_an_edge(task):
    """Vertical push: tips where its moment about the nearest axis uses up what weight leaves."""
    rest = at_rest(task.start)
    robot = task.robot
    weight = robot.samples(rest, [0.0]).wrenches[0]
    at = gripper_pose(robot.arm, task.start)[0] - robot.support.center_of_mass
    push = values(robot, rest)["push"]
    side = np.array([float(x) for x in push.how.split("(")[1].split(")")[0].split(",")])
    side /= np.linalg.norm(side)

    def moments(force):
        wrench = weight + force * np.concatenate([side, np.cross(at, side)])
        normals = robot.contact_states(wrench[None]).contact_forces[0, :, 0]
        return robot.tip_over.evaluate(robot.contact_states(wrench[None])).GN[0], normals

    assert moments(0.99 * push.value)[0] < 1
    assert (
        moments(1.03 * push.value)[0] >= 1
        or robot.slip.evaluate(
            robot.contact_states(
                (weight + 1.03 * push.value * np.concatenate([side, np.cross(at, side)]))[None]
            )
        ).GT[0]
        >= 1
    )


def test_late_joints_are_the_brink(task, found):
    late = found["delay"]
    assert late.unit == "ms"
    names = late.how.split("delayed: ")[1].split(", tips")[0].split(", slips")[0].split(", ")
    joints = [task.robot.names.index(name) for name in names]

    def loads(delay):
        times = np.arange(0, task.reference.end + delay, 2e-4)
        now, then = task.reference.states(times), task.reference.states(times - delay)
        chosen = np.zeros(task.robot.n, dtype=bool)
        chosen[joints] = True
        states = [np.where(chosen, b, a) for a, b in zip(now, then, strict=True)]
        samples = task.robot.samples_of(times, *states)
        return max(samples.tip.GN.max(), samples.slip.GT.max())

    assert loads(1e-3 * 0.97 * late.value) < 1 + 1e-6
    assert loads(1e-3 * 1.1 * late.value + 3e-4) >= 1


def test_a_motion_that_falls_tolerates_nothing(task):
    faster = task.reference.time_scaled(0.6)
    assert not stands(task.robot, faster)
    found = values(task.robot, faster)
    for name in ("tilt", "extra_mass", "push", "faster"):
        assert found[name].value < 1e-3
        assert not found[name].at_most
    assert found["friction"].value == 1.0
    (line,) = tolerated_lines(list(found.values()))
    assert line.startswith("nothing: the nominal model loses a contact (")


def test_in_words(found):
    assert str(found["extra_mass"]).startswith(
        f"{found['extra_mass'].value:.3g} kg more at the TCP (tips about"
    )
    assert "faster" in str(found["faster"])
    data = found["tilt"].to_dict()
    assert set(data) == {"quantity", "value", "unit", "at_most", "time", "how"}


def test_parallel_robots_have_none():
    from ocptip.task_files.motion import load_task
    from tests.places import EXAMPLES

    task = load_task(EXAMPLES / "tasks" / "delta_cart.toml")
    assert robustness(task, at_rest(task.start)) == ()


def test_stiffness_of_feet_in_words():
    def words(value, at_most, how, *between):
        return str(Tolerated("foot_stiffness", value, "N/m", at_most, 0.5, how, *between))

    lifts = "contact 2 lifts"
    assert words(np.inf, False, lifts) == (
        "no compliant feet (contact 2 lifts on those of 1e7 N/m, 5 % damping, 0.500 s, and on softer ones)"
    )
    assert words(np.inf, False, lifts, (2.5e5, 4e6)) == (
        "compliant feet, of 2.5e5 N/m to 4e6 N/m only "
        "(contact 2 lifts on those of 1e7 N/m, 5 % damping, 0.500 s)"
    )
    assert words(1e4, True, "") == "compliant feet, of 1e4 N/m and more (5 % damping)"
    assert words(2.5e5, False, lifts) == (
        "compliant feet, of 2.5e5 N/m and more (contact 2 lifts on softer ones, 5 % damping, 0.500 s)"
    )


@pytest.mark.parametrize(
    ("segments", "value", "between", "short"),
    [
        ([(3e5, None), (2e4, None)], 3e5, None, "foot stiffness from 3e5 N/m"),
        ([(np.inf, (1.5e4, 1.8e6)), (1.4e6, None)], np.inf, (1.4e6, 1.8e6), "1.4e6 to 1.8e6 N/m"),
        ([(1.4e6, None), (np.inf, (1.5e4, 1.8e6))], np.inf, (1.4e6, 1.8e6), "1.4e6 to 1.8e6 N/m"),
        ([(2e6, None), (np.inf, (1.5e4, 1.8e6))], np.inf, None, "no foot stiffness is enough"),
        ([(np.inf, None), (1.4e6, None)], np.inf, None, "no foot stiffness is enough"),
        ([(np.inf, (1e5, 9e5)), (np.inf, (2e5, 3e6))], np.inf, (2e5, 9e5), "2e5 to 9e5 N/m"),
        ([(np.inf, None), (np.inf, None)], np.inf, None, "no foot stiffness is enough"),
    ],
)
def test_stiffness_of_feet_of_a_cycle_holds_in_every_segment(monkeypatch, segments, value, between, short):
    """A segment that needs soft feet and one that needs stiff ones: what both stand on."""
    results = iter([(Tolerated("foot_stiffness", v, "N/m", False, 0.5, "lifts", b),) for v, b in segments])
    monkeypatch.setattr("ocptip.motion.tolerated.tolerated", lambda *_: next(results))
    task = experiment_task("A", "effective")
    part = SimpleNamespace(task=task, name="carry")
    motion = SimpleNamespace(segments=[None, None], begins=[0.0, 1.5])
    [both] = robustness(SimpleNamespace(segments=[part, part]), motion)
    assert (both.value, both.between) == (value, between)
    assert both.short.endswith(short)


@pytest.mark.slow
def test_a_motion_that_needs_next_to_no_friction_says_so():
    """No time and no way of losing a contact, which nothing loses."""
    assert f"{Tolerated('friction', 0.00098, '', True, np.nan, '')}" == "friction x 0.00098 and less"
    task = experiment_task("A", "effective")
    feet = [dataclasses.replace(foot, friction=900.0) for foot in task.robot.support.contacts]
    robot = task.robot.varied(support=task.robot.support.varied(feet))
    [found] = [own for own in tolerated(robot, task.reference) if own.quantity == "friction"]
    assert found.at_most
    assert "nan" not in f"{found}"


def test_wrenches_beyond_half_spaces_are_those_of_all_products():
    """Boxes around neighbours spare most of them."""
    rng = np.random.default_rng(3)
    wrenches = np.cumsum(rng.normal(size=(1001, 6)), axis=0)
    rows = rng.normal(size=(40, 6))
    for share in (0.2, 0.9, 1.1):
        shifted = wrenches - share * 3 * np.array([0, 0, 1, 0, 0, 0]) * np.abs(wrenches).max()
        outside = np.max(shifted @ rows.T, axis=1)
        found = beyond(rows, shifted)
        np.testing.assert_array_equal(np.sort(found), np.flatnonzero(outside > 0))
        assert np.all(np.diff(outside[found]) <= 0)
    assert len(beyond(rows, np.zeros((5, 6)))) == 0


def test_the_short_lines_say_what_they_leave_out_and_where_the_search_ends():
    rows = [
        Tolerated("tilt", 3.84, "deg", False, 0.1, "downhill"),
        Tolerated("friction", 0.0, "", True, np.nan, ""),
        Tolerated("foot_stiffness", 2.3e5, "N/m", True, np.nan, ""),
    ]
    text = " ".join(" ".join(robustness_lines(rows)).split())
    assert text == (
        "Robust to (one at a time): tilt 3.84 deg | any friction foot stiffness from 2.3e5 N/m "
        "until a contact is lost; foot stiffness: on equal feet of it none lifts; "
        "not included: clearance, joint limits, torques"
    )
    held = Tolerated("extra_mass", 2.02, "kg", False, 0.1, "tips", drives=5.5)
    text = " ".join(" ".join(robustness_lines([*rows, held])).split())
    assert "payload +2.02 kg (drives +5.5 kg)" in text
    assert text.endswith("other torques")
    assert f"{held}" == "2.02 kg more at the TCP (tips, 0.100 s); the drives move 5.5 kg more"
    capped = robustness_lines([*rows, Tolerated("delay", 100.0, "ms", True, np.nan, "")])
    assert "delay >= 100 ms" in capped[1]
    assert capped[-3].endswith("until a contact is lost; >= : not searched further;")
    assert max(map(len, capped)) <= 80
    slips = dataclasses.replace(rows[0], how=SLIPS_ALIKE)
    both = robustness_lines([slips, rows[2], Tolerated("delay", 100.0, "ms", True, np.nan, "")])
    assert max(map(len, both)) <= 80
    lost = robustness_lines([dataclasses.replace(rows[0], value=0.0, how="tips about contacts 1 and 4 " * 3)])
    assert lost[0].startswith("Robust to nothing: ")
    assert max(map(len, lost)) <= 80


def test_what_is_lost_at_once_is_named():
    late = Tolerated("delay", 0.0, "ms", False, 0.5864, "delayed: joint1, joint3, slips")
    assert late.short == "delay 0 ms (slips at once, 0.586 s)"
    heavy = Tolerated("extra_mass", 0.0, "kg", False, 0.1, "contact 3 lifts on its springs", drives=2.0)
    assert heavy.short == "payload +0 kg (contact 3 lifts on its springs at once, 0.100 s)"
    assert Tolerated("delay", 0.0, "ms", True, np.nan, "").short == "delay >= 0 ms"
