"""Cycles: planned, checked, written, read back; the ways through postures; what parts a trajectory."""

import dataclasses
import itertools
import json
import re

import numpy as np
import pytest
from hypothesis import given, seed
from hypothesis import strategies as st

import ocptip
from ocptip import load_task
from ocptip.basics.errors import InputError, PlanningError
from ocptip.basics.interrupts import TimeIsUpError
from ocptip.certificate.checks import certified, certified_cycle
from ocptip.certificate.result import Undecided
from ocptip.certificate.trusted.checker import check_certificate
from ocptip.cli.main import main
from ocptip.motion import plan as planning
from ocptip.motion.check import check_motion
from ocptip.motion.cycles.check import check_cycle, cycle_check, parts_of
from ocptip.motion.cycles.choices import CANDIDATES, best_sequences, layers_of, likely_sequences
from ocptip.motion.files.execution import execute
from ocptip.motion.files.plan_files import drives_of, samples_joined, task_samples, write_plan
from ocptip.motion.files.source import TASK
from ocptip.motion.motion_plan import MotionPlan
from ocptip.motion.plan import plan_motion
from ocptip.motion.tolerated import robustness, tolerated
from ocptip.numerics import time_limit
from ocptip.pictures.plan import _ground, moment_at
from ocptip.pictures.plan_curves import PlanCurves, seen_plan
from ocptip.standing.tolerance import Uncertainty
from ocptip.task_files.cycle import load_cycle
from ocptip.trajectories.controllers import CONTROLLERS
from ocptip.trajectories.read import load_motion
from ocptip.trajectories.trajectory import Trajectory
from tests.motion.cycles.cycle_files import CYCLE, written
from tests.quick import examples, some


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    """A planned cycle; its first segment with two starts, one after the other."""
    task = load_cycle(written(tmp_path_factory.mktemp("cycle")))
    return plan_motion(task, starts=1, jobs=1, prove=certified)


def test_a_plan_is_verified_segment_by_segment(plan):
    assert plan.verified
    assert plan.complete
    out, back = plan.parts
    np.testing.assert_allclose(back.motion.start, out.motion.goal, atol=1e-12)
    np.testing.assert_allclose(back.motion.goal, out.motion.start, atol=1e-12)
    for part, segment, own in zip(plan.parts, plan.task.segments, plan.checked.segments, strict=True):
        again = check_motion(segment.task.robot, part.motion, segment.task.limits)
        assert (again.energy, again.duration) == (own.energy, own.duration)
    assert plan.checked.begins == (0.0, pytest.approx(out.duration + 0.3))
    assert plan.duration == pytest.approx(out.duration + 0.3 + back.duration)
    with_load = {name: back.task.robot.samples(back.motion, np.array([0.2])).torques for name in ("loaded",)}
    bare = out.task.robot.samples(back.motion, np.array([0.2])).torques
    assert np.abs(with_load["loaded"] - bare).max() > 1


def test_the_rest_costs_what_motors_at_rest_take(plan):
    out = plan.task.segments[0]
    q = plan.parts[0].motion.goal
    resting = Trajectory.from_points(np.array([0.0, 0.3]), np.stack([q, q]), np.zeros((2, out.task.robot.n)))
    assert plan.checked.rest_energies == (pytest.approx(out.task.robot.energy(resting)), 0.0)
    assert plan.energy == pytest.approx(sum(p.energy for p in plan.parts) + plan.checked.rest_energies[0])


def test_the_worst_of_all_is_the_worst_of_its_segment(plan):
    for name, worst in plan.check.worst.items():
        rows = [own.worst[name] for own in plan.checked.segments]
        most = max(range(2), key=lambda k: rows[k].excess)
        assert worst.value == rows[most].value
        assert worst.detail.endswith(f"segment {plan.checked.names[most]}")
        if np.isfinite(worst.time):
            assert worst.time == pytest.approx(plan.checked.begins[most] + rows[most].time)
    least = min(own.contacts.force.value for own in plan.checked.segments)
    assert plan.check.contacts.force.value == least


def test_broken_limits_name_their_segment(plan):
    tight = load_task(plan.task, GN=0.05)
    found = check_cycle(tight, plan.motion)
    assert not found.whole.verified
    assert any("segment out" in v.detail for v in found.whole.violations)
    assert any("segment back" in v.detail for v in found.whole.violations)
    cut = dataclasses.replace(plan.motion, parts=(plan.motion.parts[0],) * 2)
    found = check_cycle(plan.task, cut)
    assert any(v.detail.startswith("segment 2 (back) starts") for v in found.whole.violations)
    with pytest.raises(InputError, match="has 2 segments, swing has 1"):
        check_cycle(dataclasses.replace(plan.task, segments=plan.task.segments[:1]), plan.motion)


@pytest.mark.parametrize("controller", some(1, [*CONTROLLERS, "ramps"]))
def test_what_is_written_is_what_was_checked(plan, tmp_path, controller):
    executions = None
    if controller != "ramps":
        rise = 0.02 if controller == "quintic" else 0.0
        executions = [
            execute(p.task.robot, p.motion.with_rise_times(rise), p.task.limits, controller)
            for p in plan.parts
        ]
    paths = write_plan(tmp_path / "out", plan, executions=executions, effort=True)
    assert {"plan.json", "motion.csv", "trajectory.json", "task.toml"} <= {path.name for path in paths}
    task = load_cycle(tmp_path / "out" / TASK)
    data = json.loads((tmp_path / "out" / "plan.json").read_text())
    assert data["verified"]
    points = load_motion(tmp_path / "out" / "trajectory.json", task.robot.names, task.robot.units)
    for motion in (load_motion(tmp_path / "out" / "plan.json", several=True), parts_of(task, points)):
        found = check_cycle(task, motion).whole
        assert found.verified == data["verified"]
        for name, worst in data["worst"].items():
            rounding = 1e-5 if name in ("speed_ratio", "acceleration_ratio") else 1e-6
            assert found.worst[name].value == pytest.approx(worst["value"], abs=rounding), name
        assert found.energy == pytest.approx(data["energy_J"], rel=2e-4)
    efforts = json.loads((tmp_path / "out" / "trajectory.json").read_text())["points"]
    second = [
        p["effort"]
        for p, t in zip(efforts, points.points.times, strict=True)
        if t > data["segments"][1]["begin_s"]
    ]
    robot = task.segments[1].task.robot
    np.testing.assert_allclose(
        second[-1], robot.loads(points.goal[None], *np.zeros((2, 1, 6)))[0][0], atol=1e-4
    )


@pytest.mark.slow
def test_the_command_says_it_and_reads_it(plan, tmp_path, monkeypatch, capsys):
    path = written(tmp_path)
    monkeypatch.setattr("ocptip.api.plan.plan_motion", lambda task, **_: dataclasses.replace(plan, task=task))
    call = ["plan", str(path), "--tolerance", "none", "--out", str(tmp_path / "out")]
    code = main([*call, "--controller", "cubic", "--time-scale", "0.5"])
    out = capsys.readouterr().out
    assert code == 0
    head = "swing   PROVED for the nominal model only (no uncertainty)\n"
    assert out.startswith(f"{head}Motion  {plan.duration:.3f} s   {plan.energy:.4g} J")
    table = [line for line in out.splitlines() if line.startswith(("1 out", "2 back", "in all"))]
    assert [row.split()[2:4] for row in table[:2]] == [["nothing", table[0].split()[3]], ["1", "kg"]]
    assert "0.3 s, " in table[0]
    assert "Times x 0.5" in out
    assert "executed by cubics between points; all numbers are of that motion" in " ".join(out.split())
    assert (tmp_path / "out" / "ground.png").stat().st_size > 10_000
    assert main(["check", str(tmp_path / "out")]) == 0
    assert table[1] in capsys.readouterr().out
    assert (
        main(
            [
                "check",
                str(tmp_path / "out" / "trajectory.json"),
                "--task",
                str(path),
                "--tolerance",
                "none",
                "--json",
            ]
        )
        == 0
    )
    data = json.loads(capsys.readouterr().out)
    assert [row["name"] for row in data["segments"]] == ["out", "back"]
    assert (
        main(
            [
                "check",
                str(tmp_path / "out" / "motion.csv"),
                "--task",
                str(path),
                "--tolerance",
                "none",
                "--gn",
                "0.05",
            ]
        )
        == 1
    )
    assert "segment back" in capsys.readouterr().out


@pytest.mark.parametrize("option", ["--duration", "--max-duration"])
def test_durations_belong_to_segments(tmp_path, capsys, option):
    assert main(["plan", str(written(tmp_path)), option, "3"]) == 2
    assert f"{option}: of a cycle belongs to its [[segment]]s" in capsys.readouterr().err


def test_a_cycle_that_was_cut_short_says_so(plan, tmp_path, monkeypatch, capsys, without_robustness):
    options = {"seconds": plan.seconds, "interrupted": True, "options": plan.options}
    first = MotionPlan.of_cycle(plan.task, plan.parts[:1], **options)
    monkeypatch.setattr(
        "ocptip.api.plan.plan_motion", lambda task, **_: dataclasses.replace(first, task=task)
    )
    out_dir = tmp_path / "out"
    plain = ("--tolerance", "none", "--no-figures")
    assert main(["plan", str(written(tmp_path)), "--out", str(out_dir), *plain]) == 1
    out = capsys.readouterr().out
    assert out.startswith("swing   INCOMPLETE (1 of 2 segments)")
    assert "without a plan: back; no trajectory.json" in out
    assert "Next    plan again with more --seconds\n" in out
    assert not (out_dir / "trajectory.json").exists()
    data = json.loads((out_dir / "plan.json").read_text())
    assert (data["verified"], data["certified"], data["missing"]) == (False, False, ["back"])


def test_an_interrupt_keeps_the_segments_that_are_finished(plan, monkeypatch):
    calls = []

    def interrupted(task, **options):
        calls.append(options)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return plan.parts[0]

    monkeypatch.setattr(planning, "plan_segment", interrupted)
    found = plan_motion(plan.task, starts=4, jobs=1)
    assert (found.complete, found.interrupted, found.verified) == (False, True, False)
    assert found.parts == (plan.parts[0],)
    monkeypatch.setattr(planning, "plan_segment", lambda *_, **__: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        plan_motion(plan.task, starts=4, jobs=1)


def test_starts_go_on_where_the_first_ones_ended(plan, monkeypatch):
    calls = []

    def planned(task, **options):
        calls.append((options["first"], options["starts"]))
        return plan.parts[int(task.robot.payload is not None)]

    monkeypatch.setattr(planning, "plan_segment", planned)
    found = plan_motion(plan.task, starts=5, jobs=1)
    assert calls == [(0, 2), (0, 2), (2, 3), (2, 3)]
    assert not found.interrupted
    monkeypatch.setattr(
        planning, "plan_segment", lambda *_, **__: (_ for _ in ()).throw(PlanningError("no start stands"))
    )
    with pytest.raises(PlanningError, match=r"segment 1 \(out\): no start stands"):
        plan_motion(plan.task, starts=2, jobs=1)


@pytest.mark.parametrize(
    ("default", "cost", "calls"),
    [
        (1.5, 1.5, [(0, 0), (0, 1), (1, 1)]),  # what the last sequence promises cannot be the best
        (1.0, 1.05, [(0, 0), (0, 1), (1, 1), (0, 2), (1, 2)]),
        (1.1, 1.1, [(0, 0), (0, 1), (1, 1), (0, 2)]),  # nor with the cost of its first segment
    ],
)
def test_sequences_that_fail_or_cost_too_much_are_planned_no_further(plan, monkeypatch, default, cost, calls):
    middle = plan.motion.segments[0].goal + 1e-3 * np.arange(3)[:, None]
    layers, done = [plan.task.starts, middle, plan.task.starts], []

    def planned(task, **_):
        segment = int(task.robot.payload is not None)
        posture = int(np.argmin(np.abs(middle - (task.start if segment else task.goal)).max(axis=1)))
        done.append((segment, posture))
        if posture == 0:
            raise PlanningError("no start stands")
        part = plan.parts[segment]
        check = dataclasses.replace(part.check, energy=part.check.energy * (cost if posture == 2 else 1.0))
        return dataclasses.replace(part, check=check)

    def default_cost(segment, start, goal):
        number = int(segment.task.robot.payload is not None)
        posture = int(np.argmin(np.abs(middle - (start if number else goal)).max(axis=1)))
        return (default if posture == 2 else 1.0) * plan.parts[number].energy / segment.task.objective.size

    monkeypatch.setattr(planning, "plan_segment", planned)
    monkeypatch.setattr(planning, "layers_of", lambda _: layers)
    monkeypatch.setattr(planning, "likely_sequences", lambda *_: [(0, k, 0) for k in range(3)])
    monkeypatch.setattr(planning, "require_way_plannable", lambda *_: None)
    monkeypatch.setattr(planning, "leg_cost", default_cost)
    monkeypatch.setattr(planning, "rest_cost", lambda *_: 0.0)
    found = plan_motion(plan.task, starts=2, jobs=1)
    assert done == calls
    assert found.parts[0].energy == plan.parts[0].energy


@pytest.mark.parametrize(
    ("out", "back", "calls"),
    [
        (True, True, [("out", 0, 1), ("back", 0, 1), ("out", 1, 2), ("back", 1, 2)]),
        (False, True, [("out", 0, 1), ("back", 0, 1), ("out", 1, 2)]),
        (True, False, [("out", 0, 1), ("back", 0, 1), ("back", 1, 2)]),
    ],
)
def test_in_a_limited_time_every_segment_has_a_start_before_others_have_more(
    plan, monkeypatch, out, back, calls
):
    """The first segment gets half of the time, the second one what that leaves."""
    done, clock = [], [0.0]

    def planned(task, first, starts, **_):
        name = "back" if task.robot.payload is not None else "out"
        done.append((name, first, starts))
        if {"out": out, "back": back}[name]:
            clock[0] += 1.0
            return plan.parts[int(name == "back")]
        clock[0] += 50.0 if name == "out" else 90.0
        raise TimeIsUpError("no start had ended; give more seconds")

    monkeypatch.setattr(planning, "plan_segment", planned)
    monkeypatch.setattr(time_limit.time, "perf_counter", lambda: clock[0])
    budget = time_limit.TimeBudget(100.0)
    if not out:
        with pytest.raises(PlanningError, match=r"segment 1 \(out\): no start had ended; give more seconds"):
            plan_motion(plan.task, starts=3, jobs=1, budget=budget)
    else:
        found = plan_motion(plan.task, starts=3, jobs=1, budget=budget)
        assert found.complete == back
        missing = "segment 2 (back): no start had ended; give more seconds"
        assert found.options.get("time_is_up") == (None if back else missing)
        assert found.interrupted == (not back)
    assert done == calls


def test_a_cycle_without_a_plan_in_its_time_says_so_and_is_no_bad_input(tmp_path, capsys):
    assert main(["plan", str(written(tmp_path)), "--seconds", "0.001", "--jobs", "1"]) == 1
    out, err = capsys.readouterr()
    assert "swing: NO VERIFIED PLAN. the time was up while postures were compared" in out
    assert "interrupted" not in out + err


def test_a_posture_of_a_cycle_is_checked_while_the_base_drives(tmp_path, without_robustness):
    path = written(tmp_path, f"{CYCLE}\n[tolerance]\npush = 1.0\n")
    profile = "0.2 m, 0.1 m/s, 0.1 m/s^2"
    found = ocptip.check(path, "out", drive_profile=profile)
    segment = load_task(path).segments[0].task
    np.testing.assert_array_equal(found.motion.start, segment.goal)
    np.testing.assert_array_equal(found.motion.goal, segment.goal)
    assert found.task.robot.payload == segment.robot.payload
    with pytest.raises(InputError, match="of a posture: ocptip check NAME --task"):
        ocptip.plan(path, drive_profile=profile)


def test_what_cannot_be_planned_names_the_segment(tmp_path):
    path = written(tmp_path, CYCLE.replace("[20, 30, -8, 45, -18, 150]", "[20, 30, -8, 45, -18, 1500]"))
    with pytest.raises(InputError, match=r"swing: cannot be planned: segment 1 \(out\): goal: joint 6"):
        plan_motion(load_cycle(path), starts=1, jobs=1)


@seed(5)
@examples(60)
@given(st.data())
def test_best_ways_are_those_of_enumeration(data):
    sizes = data.draw(st.lists(st.integers(1, 3), min_size=2, max_size=5))
    closed = data.draw(st.booleans())
    if closed:
        sizes[-1] = sizes[0]
    costs = {
        (k, i, j): data.draw(st.sampled_from([np.inf, 1.0, 2.0, 3.5, 7.25]))
        for k in range(len(sizes) - 1)
        for i in range(sizes[k])
        for j in range(sizes[k + 1])
    }
    ways = [way for way in itertools.product(*map(range, sizes)) if not closed or way[0] == way[-1]]
    legs = {way: [costs[k, i, j] for k, (i, j) in enumerate(itertools.pairwise(way))] for way in ways}
    every = sorted((sum(own), way) for way, own in legs.items() if np.isfinite(own).all())
    found = best_sequences(sizes, lambda *leg: costs[leg], closed, 3)
    assert [cost for cost, _ in found] == [cost for cost, _ in every[:3]]
    assert all(entry in every for entry in found)


def test_the_way_through_postures_is_chosen_with_all_segments_in_view(plan):
    """A goal that is nearer to the start, but far from where the next segment goes, is not taken."""
    task = plan.task
    out, back = task.segments
    near, between = task.starts[0] + [0.3, 0, 0, 0, 0, 0], task.starts[0] + [0.9, 0, 0, 0, 0, 0]
    far = task.starts[0] + [2.0, 0, 0, 0, 0, 0]
    near[2] += 0.6
    segments = (
        dataclasses.replace(out, goals=np.array([near, between])),
        dataclasses.replace(back, goals=far[None], task=dataclasses.replace(back.task, goal=far)),
    )
    open_task = dataclasses.replace(task, segments=segments, closed=False)
    layers = layers_of(open_task)
    assert [len(layer) for layer in layers] == [1, 2, 1]
    best = likely_sequences(open_task, layers)[0]
    np.testing.assert_array_equal(layers[1][best[1]], between)
    assert likely_sequences(task, layers_of(task)) == [(0, 0, 0)]


@pytest.mark.slow
def test_of_many_postures_those_on_short_ways_are_looked_at(plan):
    out, back = plan.task.segments
    goals = plan.task.starts + np.linspace(0, 0.5, 40)[:, None] * np.array([1, 0, 0, 0, 0, 0])
    task = dataclasses.replace(plan.task, segments=(dataclasses.replace(out, goals=goals[::-1]), back))
    layers = layers_of(task)
    assert len(layers[1]) == CANDIDATES
    np.testing.assert_allclose(np.sort(layers[1][:, 0]), goals[:CANDIDATES, 0], atol=1e-12)


def test_a_recording_of_positions_is_parted_where_it_rests(plan, tmp_path):
    """Angles every 10 ms, as somebody else's robot writes them."""
    task, path = plan.task, tmp_path / "theirs.csv"
    write_plan(tmp_path / "out", plan)
    points = load_motion(tmp_path / "out" / "trajectory.json", task.robot.names, task.robot.units)
    times = np.append(np.arange(0.0, points.end, 0.01), points.end)
    rows = np.column_stack([times, np.degrees(points.states(times)[0])])
    lines = [",".join(["time", *task.robot.names]), *(",".join(f"{x:.4f}" for x in row) for row in rows)]
    path.write_text("\n".join(lines), encoding="utf-8")
    found = parts_of(task, load_motion(path, task.robot.names, task.robot.units, unit="deg", several=True))
    assert 0.1 < found.pauses[0] < 0.31
    np.testing.assert_allclose(found.segments[0].goal, plan.parts[0].motion.goal, atol=1e-5)
    checked = check_cycle(task, found).whole
    assert checked.verified, checked.violations
    assert checked.energy == pytest.approx(plan.energy, rel=0.01)


def test_standstills_that_are_not_clear_are_refused(plan):
    task = plan.task
    a, b = plan.parts[0].motion.start, plan.parts[0].motion.goal

    def through(*stops):
        times = np.arange(2.0 * len(stops))
        return Trajectory.from_points(times, np.repeat(stops, 2, axis=0), np.zeros((len(times), 6)))

    found = parts_of(task, through(a, 0.5 * (a + b), b, a))
    assert len(found.segments) == 2
    np.testing.assert_allclose(found.segments[0].goal, b)
    with pytest.raises(InputError, match="rests 0 times between its ends; 2 segments of swing need 1"):
        parts_of(task, through(a, b))
    with pytest.raises(InputError, match=r"which 1 of them .* is not clear \(several fit their goals\)"):
        parts_of(task, through(a, b, 0.5 * (a + b), b, a))
    twice = through(a, b, b + 1e-5, a)  # a joint creeps a little before the rest; the longer one counts
    points = dataclasses.replace(twice.points, times=np.array([0.0, 1, 2, 2.1, 2.2, 4, 5, 6]))
    found = parts_of(task, dataclasses.replace(twice, points=points))
    assert found.pauses == (pytest.approx(1.8), 1.0)
    with pytest.raises(InputError, match=r"is not clear \(none fits their goals\)"):
        parts_of(task, through(a, 0.5 * (a + b), 0.7 * a + 0.3 * b, a))


def test_the_least_of_what_segments_tolerate(plan):
    found = {one.quantity: one for one in robustness(plan.task, plan.motion)}
    rows = [
        {one.quantity: one for one in tolerated(s.task.robot, own)}
        for s, own in zip(plan.task.segments, plan.motion.segments, strict=True)
    ]
    for quantity, one in found.items():
        values = [row[quantity].value for row in rows]
        assert one.value == (max(values) if quantity in ("friction", "foot_stiffness") else min(values))
        assert one.at_most or re.match(r"segment \w+: ", one.how)


def test_figures_draw_the_limits_of_each_segment(plan):
    out, back = plan.task.segments
    own = dataclasses.replace(back.task, limits=dataclasses.replace(back.task.limits, GN=0.5))
    task = dataclasses.replace(plan.task, segments=(out, dataclasses.replace(back, task=own)))
    samples = samples_joined(task_samples(task, plan.motion))
    curves = PlanCurves(seen_plan(task, plan.motion, check_cycle(task, plan.motion)), samples)
    begin = plan.checked.begins[1]
    np.testing.assert_array_equal(curves.limit("GN"), np.where(samples.times < begin, 0.9, 0.5))
    lines = [line for ax in _ground(curves).axes for line in ax.lines if line.get_gid() == "limit"]
    moments = {float(moment_at(GN, task.robot.tip_over.reference_moment)) for GN in (0.5, 0.9)}
    assert {*lines[0].get_ydata()} == moments
    assert {*lines[1].get_ydata()} == {90.0}  # friction used, per cent


def test_samples_of_all_segments(plan):
    parts = task_samples(plan.task, plan.motion)
    whole = samples_joined(parts)
    assert np.all(np.diff(whole.times) >= -1e-12)
    assert whole.times[-1] == pytest.approx(plan.duration)
    assert len(whole.states) == len(whole.times) == len(whole.tip.GN)
    power = whole.powers.sum(axis=1)
    energy = 0.5 * np.diff(whole.times) @ (power[1:] + power[:-1])
    assert energy == pytest.approx(plan.energy, rel=5e-3)


@pytest.fixture(scope="module")
def proved(plan):
    return certified_cycle(plan.task, plan.motion, check_cycle(plan.task, plan.motion))


def test_every_segment_is_certified_with_what_it_holds(plan, proved):
    assert plan.check.certified  # plans come proved, checks do not
    assert not check_cycle(plan.task, plan.motion).whole.certified
    assert proved.whole.certified
    assert proved.whole.headline.startswith("PROVED")
    assert all(own.certified for own in proved.segments)
    data = proved.to_dict()
    assert data["certified"]
    assert [row["certified"] for row in data["segments"]] == [True, True]
    out, back = (own.certificate for own in proved.segments)
    whole = proved.whole.certificate
    assert whole.verdict.bounds["GN"] == max(out.verdict.bounds["GN"], back.verdict.bounds["GN"])
    assert whole.verdict.intervals == out.verdict.intervals + back.verdict.intervals
    for segment, own, motion in zip(plan.task.segments, (out, back), plan.motion.segments, strict=True):
        assert check_certificate(own.data).holds
        alone = certified(segment.task.robot, motion, check_motion(segment.task.robot, motion), None)
        assert alone.certificate.data["sha256"] == own.data["sha256"]
        ends = np.array(own.data["motion"]["angles"])[[0, -1]]  # at rest before and after it
        np.testing.assert_allclose(ends[:, :, 0], [motion.start, motion.goal], atol=1e-12)
        assert not np.any(ends[:, :, 1:])
    assert out.data["sha256"]["model"] != back.data["sha256"]["model"]  # the load


def test_a_segment_that_is_not_proved_leaves_the_cycle_verified(plan, proved):
    lacking = dataclasses.replace(
        proved.segments[1].certificate, kept=False, undecided=(Undecided(0.1, 0.2, "GN", 1e-3),)
    )
    segments = [proved.segments[0], dataclasses.replace(proved.segments[1], certificate=lacking)]
    found = cycle_check(plan.task, plan.motion, segments).whole
    assert found.verified
    assert not found.certified
    assert found.headline.startswith("CHECKED")
    assert found.certificate.undecided[0].start == pytest.approx(plan.checked.begins[1] + 0.1)
    tight = load_task(plan.task, GN=0.05)
    broken = check_cycle(tight, plan.motion)
    assert certified_cycle(tight, plan.motion, broken) is broken


def test_rests_outlast_delays(plan):
    """Joints that are late have come to rest before the next segment begins."""
    task, motion = load_task(plan.task, uncertainty=Uncertainty(delay=0.01, speed=0.02)), plan.motion
    at_once = [dataclasses.replace(s, dwell=0.0) for s in task.segments]
    assert [s.rest for s in at_once] == pytest.approx([0.0102] * 2, abs=2e-6)
    assert [s.rest for s in task.segments] == pytest.approx([0.3, 0.0102], abs=2e-6)
    assert [s.rest for s in plan.task.segments] == [0.3, 0.0]
    short = "segment {} rests for {} ms, joints are delayed by up to 10.2 ms"
    for pauses, closed, texts in (
        ((0.01, 0.0), False, [short.format("1 (out)", 10)]),
        ((0.02, 0.0), False, []),  # nothing comes after it
        ((0.02, 0.0), True, [short.format("2 (back)", 0)]),
        ((0.01, 0.009), True, [short.format("1 (out)", 10), short.format("2 (back)", 9)]),
    ):
        own = dataclasses.replace(task, closed=closed)
        hurried = cycle_check(own, dataclasses.replace(motion, pauses=pauses), plan.checked.segments).whole
        assert hurried.verified == (not texts)
        assert [broken.detail for broken in hurried.violations] == texts


@pytest.mark.slow
def test_within_a_tolerance_every_segment_is_certified(plan):
    known = Uncertainty(tilt=0.005, arm_mass=0.02, friction=0.1, speed=0.02, delay=0.01)
    task, motion = load_task(plan.task, uncertainty=known), plan.motion.time_scaled(1.5)
    motion = dataclasses.replace(motion, pauses=(motion.pauses[0], 0.011))
    found = certified_cycle(task, motion, check_cycle(task, motion))
    assert found.whole.headline.startswith("PROVED for ")
    bounds = found.whole.certificate.verdict.bounds
    for name, at in (("GN_worst_case", found.whole.within.tip), ("GT_worst_case", found.whole.within.slip)):
        every = [own.certificate.verdict.bounds[name] for own in found.segments]
        worst = [own.worst[name].value for own in found.segments]
        assert bounds[name] == max(every) < 1
        assert found.whole.worst[name].value == max(worst)
        k = int(np.argmax(worst))
        assert at.how.startswith(f"segment {task.segments[k].name}: ")
        own = found.segments[k].within
        own = own.tip if name == "GN_worst_case" else own.slip
        assert at.time == pytest.approx(found.begins[k] + own.time)
    for own in found.segments:
        assert check_certificate(own.certificate.data).tolerance["delay"] == 0.01


def test_commands_certify_cycles(plan, tmp_path, capsys):
    executions = [
        dataclasses.replace(own, check=certified(p.task.robot, p.motion, p.check, p.task.limits))
        for own, p in zip(drives_of(plan), plan.parts, strict=True)
    ]
    folder = tmp_path / "out"
    write_plan(folder, plan, executions=executions)
    data = json.loads((folder / "plan.json").read_text())
    assert data["certified"]
    assert [row["certified"] for row in data["segments"]] == [True, True]
    assert main(["certify", str(folder / "certificate-2.json")]) == 0
    assert main(["certify", str(folder / "trajectory.json")]) == 0
    assert "on swing   PROVED" in capsys.readouterr().out
    assert main(["certify", str(folder), "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["segments"]) == 2
    assert main(["certify", str(folder), "--gn", "0.05"]) == 1
    assert "LIMITS BROKEN" in capsys.readouterr().out
    assert main(["certify", str(folder), "--out", "c.json"]) == 2
    assert "--out: a cycle has a certificate per segment" in capsys.readouterr().err
