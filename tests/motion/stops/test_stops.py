"""Stops of motions: brakes against Pinocchio and all combinations of torques; verdicts, files, commands."""

import json
import re
from contextlib import nullcontext, suppress
from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from ocptip.api import plan as planning
from ocptip.basics.errors import InputError, PlanningError
from ocptip.certificate.result import Certificate
from ocptip.certificate.trusted.checker import Verdict
from ocptip.cli.main import main
from ocptip.cli.options import with_cancel
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.motion.check import check_motion
from ocptip.motion.multi_start import plan_segment
from ocptip.motion.objective import TIME
from ocptip.motion.plan import plan_motion
from ocptip.motion.stops.check import check_stops
from ocptip.motion.stops.rules import StopRules
from ocptip.motion.stops.tables import StoppedPath
from ocptip.motion.summary import CheckedMotion
from ocptip.motion.task import MotionTask, refusals
from ocptip.motion.violations import statement
from ocptip.published.tasks import experiment_task
from ocptip.robots.braking import gravity_torques
from ocptip.robots.motors import DCMotors
from ocptip.robots.payload import Payload
from ocptip.robots.urdf.arm import arm_from_urdf
from ocptip.standing.arm import Robot
from ocptip.standing.elastic.feet import softest_feet
from ocptip.standing.limits import Limits
from ocptip.standing.stops.along_path import PathStops
from ocptip.standing.stops.by_brakes import BrakeCheck, Brakes
from ocptip.task_files.motion import load_task
from tests.places import UR5
from tests.robots.pinocchio_twin import dynamics, twin


@pytest.fixture(scope="module")
def task():
    return experiment_task("A", "effective")


@pytest.fixture(scope="module")
def ur5(task):
    """A UR5 on the base of case A, ten times as heavy."""
    arm = arm_from_urdf(UR5).mounted([0.0, 0.0, 0.1])
    own = task.robot.support
    support = type(own)(own.contacts, mass=200.0, center_of_mass=own.center_of_mass, gravity=own.gravity)
    return Robot(arm, support, task.robot.motors)


def looked_at(task, kinds="both", rules=None):
    rules = rules or StopRules()
    limits = rules.asked(task.limits)
    checked = check_motion(task.robot, task.reference, limits)
    return checked, check_stops(task.robot, task.reference, limits, rules, checked, kinds)


def test_wrenches_at_the_brakes_closing_are_those_of_pinocchio(ur5):
    """Accelerations from Pinocchio's mass matrix, for every combination of torques."""
    rng = np.random.default_rng(1)
    q, qd = rng.uniform(-1.5, 1.5, (2, 4, 6))
    qd[1, 2:4] = 0.0  # two joints rest already
    low, high = 0.5 * ur5.limits.torque, 1.5 * ur5.limits.torque
    check = BrakeCheck(ur5, Brakes(tuple(low), tuple(high)))
    wrenches, torques = check._wrenches(q, qd, np.zeros(4))
    model, support = twin(ur5.arm), ur5.support
    nothing = support.gravity, np.zeros(3), np.zeros(3), support.center_of_mass

    def exact(q, qd, torque):
        moving = qd != 0
        still = dynamics(model, q, qd, np.zeros(6), *nothing)[0]
        M = np.column_stack([dynamics(model, q, qd, e, *nothing)[0] - still for e in np.eye(6)])
        qdd = np.zeros(6)
        rhs = (-np.sign(qd) * torque - still)[moving]
        qdd[moving] = np.linalg.solve(M[np.ix_(moving, moving)], rhs)
        return dynamics(model, q, qd, qdd, *nothing)[1] + support.weight

    slope, offset = ur5.tip_over.affine_moments
    for i in range(4):
        for s in range(3):
            expected = exact(q[i], qd[i], torques[i, s])
            np.testing.assert_allclose(wrenches[i, s], expected, atol=2e-3 * np.abs(expected).max())
        everything = [
            exact(q[i], qd[i], np.where(ends, high, low)) for ends in product((False, True), repeat=6)
        ]
        least = np.min(np.array(everything) @ slope.T + offset)
        assert np.min(slope @ wrenches[i, 0] + offset) == pytest.approx(least, rel=2e-3)


def test_stronger_brakes_load_the_base_more(task):
    found = []
    for torque in (20.0, 100.0):
        brakes = np.full(6, torque)
        found.append(looked_at(task, "brakes", StopRules(brake_min=brakes, brake_max=brakes))[1])
    values = [one.worst["brakes"] for one in found]
    assert values[0]["GN"] < values[1]["GN"]
    assert values[0]["longest_stop_s"] > values[1]["longest_stop_s"]
    assert not found[1].verified
    assert any(violation.scenario == "stop by brakes" for violation in found[1].violations)
    assert found[1].speeds["brakes"].min() == 0.0


def test_wider_intervals_are_never_better(task):
    middle = np.array([20.0, 30.0, 20.0, 10.0, 5.0, 2.0])
    narrow = looked_at(task, "brakes", StopRules(brake_min=middle, brake_max=middle))[1]
    wide = looked_at(task, "brakes", StopRules(brake_min=0.8 * middle, brake_max=1.3 * middle))[1]
    assert wide.worst["brakes"]["GN"] >= narrow.worst["brakes"]["GN"] - 1e-9
    assert wide.worst["brakes"]["longest_stop_s"] >= narrow.worst["brakes"]["longest_stop_s"]


def test_a_delay_lets_the_arm_fall_first(task):
    at_once, late = (looked_at(task, "brakes", StopRules(delay=d))[1] for d in ((0.0, 0.0), (0.0, 0.05)))
    more = late.worst["brakes"]["longest_stop_s"] - at_once.worst["brakes"]["longest_stop_s"]
    assert more > 0.045


def test_tables_tell_where_a_stop_is_safe(task):
    checked, stops = looked_at(task, "path")
    assert checked.verified
    assert stops.verified
    np.testing.assert_allclose(stops.speeds["path"], 1.0)
    binding = experiment_task("C", "effective")
    checked, stops = looked_at(binding, "path")
    assert not checked.verified
    assert not stops.verified
    assert stops.speeds["path"].min() < 0.9
    assert stops.speeds["path"].max() == 1.0
    assert stops.worst["path"]["GN"] == checked.worst["GN_stop"].value > 0.9
    data = stops.to_dict()
    assert [row["time_s"] for row in data["safe_speed_by_time"]] == stops.times.tolist()
    assert json.loads(json.dumps(data, allow_nan=False)) == data


@pytest.mark.slow
def test_half_spaces_of_slip_do_not_change_what_is_safe(task, monkeypatch):
    """On four feet, whose friction decides."""
    feet = [
        UnilateralContact(position=[x, y, 0.0], friction=0.6) for x in (-0.25, 0.25) for y in (-0.25, 0.25)
    ]
    robot = task.robot.varied(support=task.robot.support.varied(feet))
    limits = Limits(stops=PathStops(0.9, 0.2))
    path = StoppedPath(robot, task.reference, limits)
    safe = path.safe_speeds()
    assert robot.slip.half_spaces(0.2) is not None
    monkeypatch.setattr(robot.slip, "half_spaces", lambda GT: None)
    np.testing.assert_array_equal(safe, path.safe_speeds())
    assert safe.min() < 0.9
    assert safe.max() == 1.0


@pytest.mark.slow
def test_gentle_stops_are_safe_where_hard_ones_are_not():
    task = experiment_task("C", "effective")
    hard, gentle = (looked_at(task, "path", StopRules(time=time))[1] for time in (0.0, 2.0))
    assert not hard.verified
    assert gentle.worst["path"]["GN"] < hard.worst["path"]["GN"]
    assert gentle.worst["path"]["longest_stop_s"] > hard.worst["path"]["longest_stop_s"]


def test_torques_that_do_not_fit_are_refused(task):
    with pytest.raises(InputError, match="brake_min: expected 6 torques, got 2"):
        StopRules(brake_min=np.ones(2)).brakes(task.robot)
    with pytest.raises(InputError, match="brake_max: must be >= the minimum"):
        StopRules(brake_min=np.ones(6), brake_max=0.5 * np.ones(6))
    with pytest.raises(InputError, match="delay: expected"):
        StopRules(delay=(0.2, 0.1))
    limits = replace(task.robot.limits, torque=np.full(6, np.inf))
    robot = Robot(replace(task.robot.arm, limits=limits), task.robot.support, task.robot.motors)
    with pytest.raises(InputError, match="joint 1 has no torque limit; give its brake's torque"):
        StopRules().brakes(robot)


STOPS = """
[stops]
brake_torque_min_Nm = [20, 30, 20, 10, 5, 2]
brake_torque_max_Nm = 40
brake_delay = [0.0, 0.02]
GN = 0.95
time = 0.2
"""


@pytest.fixture
def case_file(tmp_path):
    def write(text):
        path = tmp_path / "case.toml"
        path.write_text('case = "A"\nbase = "effective"\n' + text)
        return path

    return write


def test_files_have_rules_of_stops(case_file):
    task = load_task(case_file(STOPS))
    np.testing.assert_array_equal(task.stops.brake_min, [20, 30, 20, 10, 5, 2])
    np.testing.assert_array_equal(task.stops.brake_max, np.full(6, 40))
    assert (task.stops.delay, task.stops.GN, task.stops.GT, task.stops.time) == ((0.0, 0.02), 0.95, None, 0.2)
    assert task.limits.stops is None
    asked = load_task(case_file(STOPS + "safe = true\n"))
    assert (asked.limits.stops.GN, asked.limits.stops.GT, asked.limits.stops.time) == (0.95, 0.9, 0.2)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[stops]\nbrake_torque_min_Nm = [1, 2]", "stops.brake_torque_min_Nm: "),
        ("[stops]\nbrake_torque_max_Nm = 1", "stops.brake_torque_max_Nm: joint 1: the minimum, "),
        ("[stops]\nbrake_delay = [0.2, 0.1]", "stops.brake_delay: expected [minimum, maximum], s"),
        ("[stops]\nGN = 1.5", "stops.GN: must be above 0 and at most 1"),
        ("[stops]\ncancel_share = 0", "stops.cancel_share: "),
        (
            "[stops]\ncancel_deceleration_m_s2 = 1",
            "stops.cancel_deceleration_m_s2: no joint of the arm slides",
        ),
        ("[stops]\nbrake_torque = 3", "stops.brake_torque: unknown key"),
    ],
)
def test_bad_rules_are_one_line(case_file, text, said):
    with pytest.raises(InputError) as error:
        load_task(case_file(text))
    assert said in str(error.value)
    assert "\n" not in str(error.value)


PLAIN = ("--tolerance", "none")


@pytest.fixture
def motion_file(tmp_path, task):
    path = tmp_path / "plan.json"
    path.write_text(json.dumps({"case": "A", "base": "effective", **task.reference.to_dict()}))
    return path


def test_the_command_says_what_was_looked_at(capsys, motion_file, without_robustness):
    assert main(["check", str(motion_file), "-v", *PLAIN, "--stops", "path"]) == 0
    text = capsys.readouterr().out
    assert "GN in stops on the path" in text
    assert "stops by brakes when power is off (category 0): not checked" in " ".join(text.split())
    assert "largest safe share of the planned speed" in text
    words = r"along the path \(category 1 and 2\), in the nominal model: tipping margin >= ([\d.]+) N m"
    margin = re.search(words, " ".join(text.split()))
    assert float(margin[1]) > 0
    assert [line for line in text.splitlines()[1:] if len(line) > 80] == []
    assert main(["check", str(motion_file), *PLAIN, "--stops", "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert data["verified"]
    assert not data["stops"]["verified"]
    assert {"path", "brakes"} == set(data["stops"]["worst"])
    assert "0.5 to 2 times the torque limits, a guess" in " ".join(data["stops"]["assumed"])
    assert main(["check", str(motion_file), *PLAIN]) == 0
    assert "Stops" not in capsys.readouterr().out


@pytest.mark.slow
def test_plans_that_may_be_stopped_at_any_instant():
    """Case G: the best plan without stops loses a contact in one; the price of the other."""
    task = experiment_task("G", "effective")
    asked = replace(task, limits=StopRules().asked(task.limits))
    plain, safe = plan_motion(task, starts=2, jobs=1), plan_motion(asked, starts=2, jobs=1)
    assert not check_motion(task.robot, plain.motion, asked.limits).verified
    assert safe.verified
    assert 1.0 < safe.energy / plain.energy < 1.1
    assert max(safe.check.worst[name].value for name in ("GN_stop", "GT_stop")) <= 0.9 + 1e-9


def on_a_heavy_base(task, mass):
    own = task.robot.support
    support = type(own)(own.contacts, mass=mass, center_of_mass=own.center_of_mass, gravity=own.gravity)
    return replace(task, robot=task.robot.varied(support=support))


def of_a_lucky_start(task, most):
    """A plan of one start below so much energy. With brakes a third is verified; which ones is rounding."""
    for first in (8, 7, 3, 5, 4, 2):
        with suppress(PlanningError):
            plan = plan_segment(task, starts=1, seed=0, first=first, workers=nullcontext())
            if plan.energy < most:
                return plan
    raise AssertionError(f"none of six starts was verified below {most} J")


@pytest.mark.slow
def test_plans_that_may_be_stopped_by_brakes():
    """Case A on a base of 70 kg: stops of the cheapest plan slip, those of the plan for stops do not."""
    task = on_a_heavy_base(experiment_task("A", "effective"), 70.0)
    least = np.array([1.7, 17.0, 7.6, 1.7, 1.7, 1.7])
    rules = StopRules(brake_min=least, brake_max=1.25 * least)
    limits = rules.safe(task.limits, task.robot)
    assert limits.stops is not None  # both, where torques are given
    limits = rules.safe(task.limits, task.robot, "brakes")
    cheapest = plan_motion(task, starts=1, jobs=1)
    before = check_motion(task.robot, cheapest.motion, limits)
    assert not before.verified
    assert before.stands
    assert any(violation.name == "GT_brakes" for violation in before.violations)
    plan = of_a_lucky_start(replace(task, limits=limits), 1.05 * cheapest.energy)
    assert plan.verified
    assert plan.check.worst["GT_brakes"].value <= 0.9
    assert 0.99 * cheapest.energy < plan.energy < 1.05 * cheapest.energy
    finer = BrakeCheck(task.robot, limits.brakes).stops(
        *plan.motion.states(np.linspace(0, plan.duration, 301))[:2]
    )
    assert max(np.max(finer.GN), np.max(finer.GT)) <= 0.9 + 5e-3
    stops = check_stops(task.robot, plan.motion, limits, rules, plan.check, "brakes")
    assert stops.verified
    assert stops.speeds["brakes"].min() == 1.0


@pytest.mark.slow
def test_stops_by_brakes_that_the_cheapest_plan_breaks_clearly():
    """On 60 kg: which joints turn which way together decides, and starts are chosen by that."""
    task = on_a_heavy_base(experiment_task("A", "effective"), 60.0)
    least = np.array([1.4, 13.95, 6.27, 1.4, 1.4, 1.4])
    limits = StopRules(brake_min=least, brake_max=1.25 * least).safe(task.limits, task.robot, "brakes")
    plan = of_a_lucky_start(replace(task, limits=limits), 200.0)
    assert plan.verified
    assert plan.energy < 200.0  # the cheapest without has 185.6 J and 1.2


def test_brakes_too_strong_for_any_motion_are_refused_before_planning(task, capsys):
    limits = StopRules().safe(task.limits, task.robot, "brakes")
    asked = replace(task, limits=limits)
    with pytest.raises(InputError, match=r"as soon as the motion has begun.* GN is .*, must be <= 0\.9"):
        plan_motion(asked, starts=1, jobs=1)
    must = task.start != task.goal
    GN, GT, ways = BrakeCheck(task.robot, limits.brakes).gentlest(task.start, must)
    assert np.all(ways[must] != 0)
    rng = np.random.default_rng(0)
    some = rng.choice([-1.0, 1.0], (40, 6)) * 1e-4
    found = BrakeCheck(task.robot, limits.brakes).stops(np.tile(task.start, (40, 1)), some)
    assert min(np.maximum(found.GN, found.GT).min(), max(GN, GT)) > 0.9
    heavy = on_a_heavy_base(task, 60.0)
    weak = Brakes((1.4, 13.9, 6.3, 1.4, 1.4, 1.4), (1.8, 17.4, 7.8, 1.8, 1.8, 1.8))
    GN, GT, ways = BrakeCheck(heavy.robot, weak).gentlest(task.start, must)
    kept = BrakeCheck(heavy.robot, weak).stops(task.start[None], 1e-3 * ways[None])
    assert max(GN, GT, kept.GN[0], kept.GT[0]) <= 0.9
    assert refusals(replace(heavy, limits=replace(limits, brakes=weak))) == ()
    gentle = replace(limits, brakes=replace(limits.brakes, delay=(0.0, 0.01)))
    assert refusals(replace(task, limits=gentle)) == ()  # nothing is said of them
    assert main(["plan", "A", "--stop-safe", "brakes", "--tolerance", "none"]) == 2
    assert "weaker brakes" in capsys.readouterr().err


def test_a_cancel_is_a_third_scenario(capsys, motion_file, without_robustness):
    """A gentle one is safe in case A's printed motion."""
    arguments = ["check", str(motion_file), *PLAIN, "--stops", "cancel"]
    assert main([*arguments, "--json", "--deceleration", "300,100%"]) == 2
    assert "--deceleration: expected numbers, a share such as 46%, or stopj(4)" in capsys.readouterr().err
    assert main([*arguments, "--deceleration", "300,200"]) == 2
    assert "--deceleration: expected 1 or 6 numbers, got 2" in capsys.readouterr().err
    assert main([*arguments, "--deceleration", "30%", "--reaction", "8", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)["stops"]
    worst, safe = data["worst"]["cancel"], data["decelerations"]
    assert data["kinds"] == "cancel"
    assert worst["reaction_s"] == 0.008
    assert worst["deceleration"] == [0.3 * full for full in safe["full_deceleration"]]
    assert worst["tipping_margin_Nm"] > 0 < worst["foot_force_N"]
    assert safe["minimum_safe_share"] <= 0.3 <= safe["maximum_safe_share"]
    assert safe["levels"][0]["share"] == 1.0
    assert safe["ros2_control"].startswith("constraints: {decelerate_on_cancel: true, ")


@pytest.mark.slow
def test_a_cancel_that_takes_too_long_breaks_limits_of_stops(capsys, motion_file):
    arguments = ["check", str(motion_file), *PLAIN, "--stops", "cancel"]
    assert main([*arguments, "--deceleration", "4%"]) == 1
    text = " ".join(capsys.readouterr().out.split())
    assert "LIMITS BROKEN in stops; the motion itself is PROVED for the nominal model only" in text
    assert "s, must be <= 2 s" in text


def test_the_headline_keeps_what_is_proved_of_the_motion_beside_its_stops(task):
    checked = check_motion(task.robot, task.reference, task.limits)
    proof = Certificate({}, Verdict(True, (), {}, 1), kept=True)
    proved = replace(checked, certificate=proof)
    word = "PROVED for the nominal model only (no uncertainty)"
    assert proved.headline == word
    worst = {**checked.worst, "GN_stop": checked.worst["GN"]}
    kept = replace(proved, worst=worst, certificate=replace(proof, sampled=("GN_stop",)))
    assert (kept.headline, kept.certified, kept.unproved) == (word, False, "")
    broken = replace(
        kept, verified=False, violations=(replace(checked.worst["GN"], name="GN_stop", value=1.2),)
    )
    assert broken.headline == f"LIMITS BROKEN in stops; the motion itself is {word}"
    both = replace(broken, violations=(*broken.violations, checked.worst["GN"]))
    assert both.headline == "LIMITS BROKEN"
    unproved = replace(kept, certificate=replace(proof, sampled=("GN_stop", "GT")))
    assert unproved.headline.startswith("CHECKED at samples")
    stops = SimpleNamespace(verified=True, violations=(), kinds="path", slips_alike=False)
    whole = SimpleNamespace(whole=proved)
    motion = CheckedMotion(task=task, checked=whole, stops={"": stops})
    assert motion.headline == f"{word}; stops CHECKED at samples"
    stops.slips_alike = True
    assert motion.headline.endswith(
        "; stops CHECKED at samples, BUT equally compliant feet may slip in stops"
    )
    stops.verified, stops.unknown = False, (checked.worst["GN"],)
    assert motion.headline == (
        f"NOT KNOWN in stops by brakes (give brake torques); the motion itself is {word}"
    )
    stops.violations = (statement("a drive needs 105 % of its torque limit in a cancel begun at 0.1 s"),)
    assert motion.headline == f"LIMITS BROKEN in stops; the motion itself is {word}"


def test_cancels_of_parallel_robots_are_refused(task):
    """Nothing would be checked, which must not read as safe."""
    with pytest.raises(InputError, match="cancels are not computed for parallel robots"):
        check_stops(SimpleNamespace(arm=None), task.reference, task.limits, StopRules(), None, "cancel")


@pytest.mark.slow
def test_plans_for_cancels_keep_the_contacts_in_them(task):
    """Of case A: the fastest plan without tips when it is cancelled at the acceleration limits."""
    fast = replace(task, objective=TIME)
    limits = StopRules().safe(task.limits, task.robot, "cancel")
    plain = plan_motion(fast, starts=1, jobs=1)
    broken = check_motion(task.robot, plain.motion, limits).worst["GN_cancel"]
    plan = plan_motion(replace(fast, limits=limits), starts=1, jobs=1)
    assert broken.value > 1
    assert plan.check.verified
    assert plan.check.worst["GN_cancel"].value <= 0.9
    assert check_stops(task.robot, plan.motion, limits, StopRules(), plan.check, "cancel").verified


def test_files_have_the_deceleration_of_a_cancel(case_file, task):
    text = '[stops]\nsafe = "cancel"\ncancel_deceleration_deg_s2 = {"joint 1" = 90}\n'
    found = load_task(case_file(text + "cancel_share = 0.5\ncancel_reaction = 0.01\n"))
    rates = 0.5 * np.array([np.pi / 2, *task.robot.limits.acceleration[1:]])
    np.testing.assert_allclose(found.limits.cancel.decelerations, rates)
    assert (found.limits.cancel.reaction, found.limits.brakes, found.limits.stops) == (0.01, None, None)
    path = case_file("")
    path.write_text(found.source.text("A", found.limits, found.objective))
    again = load_task(path).limits.cancel
    np.testing.assert_allclose(again.decelerations, rates)
    assert replace(again, decelerations=()) == replace(found.limits.cancel, decelerations=())


@pytest.mark.slow
def test_stopj_is_checked_and_not_planned_for(capsys, motion_file, case_file):
    arguments = ["check", str(motion_file), *PLAIN, "--stops", "cancel", "--json", "--deceleration"]
    for text, rate in (("stopj", 4.0), ("stopj(1.5)", 1.5)):
        assert main([*arguments, text]) in (0, 1)
        data = json.loads(capsys.readouterr().out)
        assert data["stops"]["worst"]["cancel"]["deceleration"] == [rate] * 6
        assert data["stops"]["decelerations"]["together"]
        assert "urscript" in data["stops"]["decelerations"]
        proof = data["certificate"]
        assert not any("cancel" in name for name in proof["bounds"])
    assert main([*arguments, "stopj(x)"]) == 2
    assert "got 'stopj(x)'" in capsys.readouterr().err
    found = load_task(case_file('[stops]\nsafe = "cancel"\ncancel_stopj = 3\ncancel_share = 0.5\n'))
    assert found.limits.cancel.together
    path = case_file("")
    path.write_text(found.source.text("A", found.limits, found.objective))
    assert load_task(path).limits.cancel == found.limits.cancel
    assert main(["plan", str(path)]) == 2
    assert "stopj is checked, not planned for" in capsys.readouterr().err
    path.write_text('case = "A"\n[stops]\ncancel_stopj = 3\ncancel_deceleration_deg_s2 = 90\n')
    with pytest.raises(InputError, match="not beside cancel_stopj"):
        load_task(path)


def test_a_typed_deceleration_replaces_that_of_a_file_that_asks_for_cancels(case_file):
    text = '[stops]\nsafe = "cancel"\ncancel_deceleration_deg_s2 = 90\ncancel_longest = 3\n'
    task = load_task(case_file(text))
    typed = with_cancel(task, SimpleNamespace(deceleration="stopj(2)", reaction=5.0)).limits.cancel
    assert typed == replace(task.limits.cancel, decelerations=(2.0,) * 6, together=True, reaction=0.005)
    typed = with_cancel(task, SimpleNamespace(deceleration="45", reaction=None)).limits.cancel
    np.testing.assert_allclose(typed.decelerations, np.pi / 4)
    assert typed.longest == 3
    plain = load_task(case_file(text.replace('safe = "cancel"\n', "")))
    assert with_cancel(plain, SimpleNamespace(deceleration="45", reaction=None)).limits.cancel is None


def test_no_plan_for_stops_says_what_is_wrong_with_the_one_without(monkeypatch, capsys, task):
    def found(task, **_):
        if task.limits.stoppable:
            raise PlanningError("none of 1 starts gave a motion")
        plan = SimpleNamespace(motion=task.reference, energy=210.8, duration=task.reference.end)
        return plan

    monkeypatch.setattr(planning, "plan_motion", found)
    assert main(["plan", "C", "--stop-safe", "path", "--tolerance", "none", "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert data["without_stops"]["energy_J"] == 210.8
    assert any("tip_over_index_stop is" in sentence for sentence in data["without_stops"]["violations"])
    assert main(["plan", "C", "--stop-safe", "path", "--tolerance", "none"]) == 1
    assert "the plan without stops, 210.8 J" in capsys.readouterr().out


def test_rules_of_brakes_come_back_from_a_plans_task(tmp_path):
    path = tmp_path / "task.toml"
    path.write_text(
        'case = "A"\n[stops]\nsafe = "brakes"\nbrake_torque_min_Nm = 3\nbrake_delay = [0, 0.01]\n'
    )
    task = load_task(path)
    assert task.limits.stops is None
    assert task.limits.brakes.least == (3.0,) * 6
    path.write_text(task.source.text("A", task.limits, task.objective))
    assert load_task(path).limits == task.limits
    path.write_text('case = "A"\n[stops]\nsafe = true\n')
    assert load_task(path).limits.brakes is None
    path.write_text('case = "A"\n[stops]\nsafe = "breaks"\n')
    with pytest.raises(InputError, match=r"safe.*expected one of path, brakes, both"):
        load_task(path)


ONE_JOINT = """<robot name="one"><link name="base"/>
<link name="l"><inertial><origin xyz="0.4 0 0.1"/><mass value="4"/>
<inertia ixx="0.01" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><parent link="base"/><child link="l"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="2" effort="30"/></joint></robot>"""


def test_arms_of_one_joint_are_planned_for_stops_of_both_kinds(tmp_path, task):
    """About the vertical axis: the brakes' greatest moment on the base is their greatest torque."""
    (tmp_path / "one.urdf").write_text(ONE_JOINT)
    arm = arm_from_urdf(tmp_path / "one.urdf", tool_frame="l").mounted([0.0, 0.0, 0.3])
    arm = replace(arm, limits=replace(arm.limits, acceleration=np.array([5.0])))
    robot = Robot(arm, on_a_heavy_base(task, 60.0).robot.support, DCMotors.estimated(arm))
    rules = StopRules(brake_min=np.array([8.0]), brake_max=np.array([14.0]), delay=(0.0, 0.02))
    limits = rules.safe(Limits(), robot, "both")
    ends = np.array([-1.0]), np.array([1.0])
    asked = MotionTask("one joint", robot, *ends, limits, (0,), stops=rules)
    plan = plan_motion(asked, starts=1, jobs=1)
    found = check_stops(robot, plan.motion, limits, rules, plan.check)
    assert plan.verified
    assert found.verified
    assert found.worst["brakes"]["brake_torques"] in ([8.0], [14.0], [0.0])
    inertia = 0.05 + 4 * 0.4**2
    fastest = np.max(np.abs(plan.motion.states(np.linspace(0, plan.motion.end, 400))[1]))
    assert found.worst["brakes"]["longest_stop_s"] == pytest.approx(0.02 + inertia * fastest / 8.0, rel=0.06)
    softest_feet(robot, plan.motion)  # small motions of the base under one joint


def test_gravity_torques_are_the_maximum_of_all_postures():
    """Against Pinocchio at many random postures, which come close to the maximum and never exceed it."""
    arm = arm_from_urdf(UR5).with_payload(Payload(3.0, [0.05, 0.0, 0.1]))
    gravity = np.array([1.0, -2.0, -9.5])
    found = gravity_torques(arm, gravity)
    model = twin(arm)
    model.gravity.linear = gravity
    data, rng = model.createData(), np.random.default_rng(0)
    most = np.zeros(6)
    for q in rng.uniform(arm.limits.angle_min, arm.limits.angle_max, (20_000, 6)):
        most = np.maximum(most, np.abs(pin.computeGeneralizedGravity(model, data, q)))
    assert np.all(most <= found + 1e-9)
    assert np.all(most >= 0.95 * found)
    limited = replace(arm, limits=replace(arm.limits, angle_min=np.full(6, -0.3), angle_max=np.full(6, 0.2)))
    narrow = gravity_torques(limited, gravity)
    most = np.zeros(6)
    for q in rng.uniform(-0.3, 0.2, (20_000, 6)):
        most = np.maximum(most, np.abs(pin.computeGeneralizedGravity(model, data, q)))
    assert np.all((most <= narrow + 1e-9) & (most >= 0.9 * narrow))


def weak(task, share):
    """The task with torque limits of a share of what gravity asks."""
    limits = replace(task.robot.limits, torque=np.maximum(share * task.robot.gravity_torques(), 10.0))
    return replace(task, robot=task.robot.varied(arm=replace(task.robot.arm, limits=limits)))


@pytest.mark.slow
def test_guessed_brakes_hold_the_arm(task):
    """Half of a torque limit of 1.1 times what gravity asks would drop it."""
    own = weak(task, 1.1)
    least, greatest = StopRules().brakes(own.robot)
    holds = own.robot.gravity_torques()
    assert holds.max() > 20
    np.testing.assert_allclose(least, np.maximum(0.5 * own.robot.limits.torque, 1.3 * holds))
    np.testing.assert_allclose(greatest, 2 * own.robot.limits.torque)
    _, stops = looked_at(own, "brakes")
    assert stops.worst["brakes"]["longest_stop_s"] is not None
    assert any("at least 1.3 times what gravity asks" in line for line in stops.assumed)
    _, dropped = looked_at(own, "brakes", StopRules(brake_min=0.5 * own.robot.limits.torque))
    assert dropped.worst["brakes"]["longest_stop_s"] > 2 * stops.worst["brakes"]["longest_stop_s"]
    assert any(own.detail.startswith("the arm drops: at ") for own in dropped.unknown)
    assert not any("drops" in own.detail for own in stops.unknown)
    capped = StopRules(brake_max=0.6 * own.robot.limits.torque).brakes(own.robot)
    assert np.all(capped[0] <= capped[1])


def test_without_torque_limits_category_0_is_not_judged(task):
    limits = replace(task.robot.limits, torque=np.full(6, np.inf))
    own = replace(task, robot=task.robot.varied(arm=replace(task.robot.arm, limits=limits)))
    _, stops = looked_at(own, "brakes")
    assert not stops.verified
    assert "brakes" not in stops.worst
    assert "brakes" not in stops.speeds
    assert stops.unknown[0].detail.startswith(
        "stops by brakes (category 0) not checked: no brake data, and joint 1 has no torque"
    )
    _, given = looked_at(own, "brakes", StopRules(brake_min=np.full(6, 60.0), brake_max=np.full(6, 70.0)))
    assert "brakes" in given.worst
