"""The study of time scaling: tau* and lost times against formulas of their own, heights, files, refusals."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import block_diag
from scipy.optimize import linprog

from ocptip.motion.check import check_motion
from ocptip.published.cases import motion_case
from ocptip.published.tasks import experiment_robot
from ocptip.robots.dynamics import evaluate_dynamics
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from studies.time_scaling import losses
from studies.time_scaling import run as time_scaling
from studies.time_scaling import trends as time_scaling_trends
from tests.quick import some


def printed(case, base):
    """Robot and printed motion."""
    case = motion_case(case)
    robot = experiment_robot(case, base)
    return robot, case.reference_motion(robot.arm.limits.speed, robot.arm.limits.acceleration)


def bracket(robot, motion, taus=(0.9, 1.0)):
    """Results by tau, and the two tau around the first loss."""
    values = {tau: losses.scaled(robot, motion, tau) for tau in taus}
    return values, losses.critical(values, lambda tau: losses.scaled(robot, motion, tau))


def tipping(robot, motion, times):
    """Moments about the tipping axes (N, axes) of the arm at rest, and what its motion adds at tau = 1."""
    q, qd, qdd = motion.states(times)
    slope, offset = robot.tip_over.affine_moments
    rest, moving = (robot.loads(q, f * qd, f * qdd)[1] @ slope.T + offset for f in (0.0, 1.0))
    return rest, moving - rest


# --- one motion ---------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("case", some(1, ["B", "C", "F"]))
def test_lift_off_begins_where_the_moments_say(case):
    """Moments are affine in 1/tau^2: tau* = largest sqrt(-moving/rest), without any contact solver."""
    robot, motion = printed(case, "effective")
    rest, moving = tipping(robot, motion, losses.cells(motion)[0])
    assert rest.min() > 0
    exact = math.sqrt(np.max(-moving / rest))
    values, (low, high) = bracket(robot, motion)
    assert 0 < high - low <= losses.TOLERANCE
    assert low - 1e-5 <= exact <= high + 1e-5
    assert values[high].stands
    assert values[high].GN < 1 <= values[low].GN
    loss = losses.first_loss(robot, motion, values[low])
    axis = int(np.argmin(np.min(rest + moving / low**2, axis=0)))
    assert loss["kind"] == "lift-off"
    assert loss["contacts"] == (np.flatnonzero(robot.tip_over.axes[axis].lift) + 1).tolist()


def forces_can_hold(support, wrench, facets, friction):
    """Whether forces inside pyramids with many facets balance a wrench, by a linear program of its own."""
    angles = 2 * np.pi * np.arange(facets) / facets
    rows = np.column_stack([np.full(facets, -friction), np.cos(angles), np.sin(angles)])
    inside = block_diag(*[rows] * support.n_contacts)
    normal = [(0, None), (None, None), (None, None)] * support.n_contacts
    found = linprog(
        np.zeros(inside.shape[1]), A_ub=inside, b_ub=np.zeros(len(inside)), A_eq=support.wrench_matrix,
        b_eq=-wrench, bounds=normal, options={"primal_feasibility_tolerance": 1e-9},
    )  # fmt: skip
    assert found.status in (0, 2)
    return found.status == 0


@pytest.mark.slow
def test_slip_begins_where_no_forces_hold_the_base():
    """The printed motion of A slips before it tips: on true cones, between pyramids inside and outside."""
    robot, motion = printed("A", "printed")
    values, (low, high) = bracket(robot, motion, (0.6, 0.7))
    loss = losses.first_loss(robot, motion, values[low])
    assert loss["kind"] == "slip"
    q, qd, qdd = (x[0] for x in motion.states([loss["time_s"] / low]))
    friction, facets = robot.support.contacts[0].friction, 720
    within = friction * math.cos(math.pi / facets)  # of pyramids inside the cones, with corners on them
    wrenches = [robot.loads(q[None], qd[None] / t, qdd[None] / t**2)[1][0] for t in (low, high)]
    assert not forces_can_hold(robot.support, wrenches[0], facets, friction)
    assert forces_can_hold(robot.support, wrenches[1], facets, within)


def test_scaled_motion_is_the_checked_one():
    robot, motion = printed("B", "effective")
    one, worst = losses.scaled(robot, motion, 1.0), check_motion(robot, motion).worst
    assert (one.GN, one.GT, one.torque_ratio) == tuple(
        pytest.approx(worst[name].value, rel=1e-9) for name in ("GN", "GT", "torque_ratio")
    )
    assert one.stands
    assert one.lost_s == one.longest_s == max(one.lifted_s) == max(one.slid_s) == one.unsolved == 0
    fast = losses.scaled(robot, motion, 0.8)
    assert fast.speed_ratio == pytest.approx(one.speed_ratio / 0.8)
    assert fast.acceleration_ratio == pytest.approx(one.acceleration_ratio / 0.64)


def test_lost_time_is_that_of_negative_moments():
    robot, motion = printed("B", "effective")
    fast = losses.scaled(robot, motion, 0.9)
    times = np.linspace(0, motion.end, 20_001)
    times = (times[1:] + times[:-1]) / 2
    rest, moving = tipping(robot, motion, times)
    falls = np.min(rest + moving / 0.81, axis=1) < 0
    widths = np.full(len(times), 0.9 * motion.end / len(times))
    assert fast.lost_s == pytest.approx(widths @ falls, abs=4 * losses.CELL)
    longest = losses.longest_run(falls, widths)
    assert longest > 0.03
    assert fast.longest_s == pytest.approx(longest, abs=2 * losses.CELL)
    assert max(fast.lifted_s) == pytest.approx(fast.longest_s) == pytest.approx(fast.lost_s)
    assert not fast.stands


def test_cells_fill_the_motion():
    motion = printed("G", "printed")[1]
    times, widths = losses.cells(motion)
    assert widths.sum() == pytest.approx(motion.end)
    assert widths.max() <= losses.CELL
    assert np.all(np.diff(times) > 0)
    for event in motion.event_times[1:-1]:
        near = np.sort(np.abs(times - event))[:2]
        assert near.max() < 2e-7
    assert np.sum(widths == 0) == 2 * len(motion.intervals)


@given(st.lists(st.tuples(st.booleans(), st.floats(0, 10)), max_size=30))
def test_longest_run(entries):
    best = run = 0.0
    for marked, width in entries:
        run = run + width if marked else 0.0
        best = max(best, run)
    marked, widths = np.array([e[0] for e in entries], bool), np.array([e[1] for e in entries], float)
    assert losses.longest_run(marked, widths) == pytest.approx(best, abs=1e-12)


class Fake:
    """A result that only knows whether it stands."""

    def __init__(self, stands):
        self.stands = stands


@pytest.mark.parametrize("star", [0.21, 0.93, 1.0, 1.37])
def test_critical_scaling_is_found_beyond_the_grid(star):
    def at(tau):
        return Fake(tau > star)

    values = {tau: at(tau) for tau in (0.9, 1.0, 1.1)}
    low, high = losses.critical(values, at)
    assert low <= star < high <= low + losses.TOLERANCE
    assert {low, high} <= set(values)


def test_first_of_several_critical_scalings():
    """From slow to fast the first loss counts, whatever happens beyond it."""

    def at(tau):
        return Fake(tau > 1.04 or 0.93 < tau < 0.97)

    values = {tau: at(tau) for tau in np.linspace(0.9, 1.1, 21).tolist()}
    low, high = losses.critical(values, at)
    assert low <= 1.04 < high


@pytest.mark.parametrize("stands", [True, False])
def test_no_critical_scaling(stands):
    assert losses.critical({1.0: Fake(stands)}, lambda _: Fake(stands)) is None


def test_rest_on_the_path():
    robot, motion = printed("B", "effective")
    assert losses.rests_anywhere(robot, motion)
    tall = experiment_robot(motion_case("H"), "effective")
    stretched = Trajectory.from_profiles(
        np.zeros(6), [[RampCommand(x, 1.0, 1.0)] for x in (0.1, np.pi / 2, 0.0, 0.0, 0.0, 0.0)]
    )
    rest, _ = tipping(tall, stretched, losses.cells(stretched)[0])
    assert rest.min() < 0
    assert not losses.rests_anywhere(tall, stretched)


# --- heights ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", some(1, ["A", "D", "G"]))
def test_heights_are_potential_energy(case):
    """Torques of the arm at rest are the derivative of weight times height of the centre of mass."""
    arm = experiment_robot(motion_case(case), "printed").arm
    rng = np.random.default_rng(3)
    q = rng.uniform(-2, 2, 6)
    rest = evaluate_dynamics(arm, q[None], np.zeros((1, 6)), np.zeros((1, 6)), gravity=[0, 0, -9.81])
    h = 1e-6
    up, down = (time_scaling_trends.arm_heights(arm, q + s * h * np.eye(6), 2)[0] for s in (1, -1))
    slope = np.sum(arm.masses) * 9.81 * (up - down) / (2 * h)
    np.testing.assert_allclose(slope, rest.torque[0], atol=1e-7)


def test_straight_motion_is_neither_raised_nor_lowered():
    case = motion_case("E")
    way = case.goal - case.start
    commands = [[RampCommand(g, abs(w), 2 * abs(w))] for g, w in zip(case.goal, way, strict=True)]
    motion = Trajectory.from_profiles(case.start, commands)
    arm = experiment_robot(case, "printed").arm
    found = time_scaling_trends.heights(arm, motion, 2)
    assert max(abs(found[key]) for key in found if key.endswith("_m")) < 1e-12


def test_bent_motion_is_raised_by_what_its_joint_does():
    """Joint 2 alone leaves the line: the end of its link rises by length times cosine."""
    case = motion_case("A")
    arm = experiment_robot(case, "printed").arm
    goal = case.start + np.eye(6)[0]
    bend = [RampCommand(case.start[1] - 0.3, 0.6, 4.0), RampCommand(case.start[1], 0.6, 4.0)]
    others = [[RampCommand(g, 0.5, 2.0)] for g in goal]
    motion = Trajectory.from_profiles(case.start, [others[0], bend, *others[2:]])
    lowest = motion.joints[1].pieces.angle_ranges[0, 0]
    length = np.hypot(*arm.offsets[1][:2])
    tilt = np.arctan2(*arm.offsets[1][:2])
    expected = length * (np.cos(lowest - tilt) - np.cos(case.start[1] - tilt))
    found = time_scaling_trends.heights(arm, motion, 2)
    assert expected > 0.02
    assert found["link_raised_m"] == pytest.approx(expected, rel=1e-3)
    assert found["raised_m"] > 0
    assert found["lowered_m"] == found["link_lowered_m"] == found["lowered_J"] == 0


# --- the study ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def plans(tmp_path_factory):
    """A folder with one plan: the printed motion of C a little slower, so that it is not the printed one."""
    folder = tmp_path_factory.mktemp("plans")
    robot, motion = printed("C", "effective")
    motion = motion.time_scaled(1.02)
    data = {**motion.to_dict(), "case": "C", "base": "effective", "energy_J": robot.energy(motion)}
    path = folder / "C-effective" / "plan.json"
    path.parent.mkdir()
    path.write_text(json.dumps(data))
    return folder


@pytest.fixture(scope="module")
def study(plans, tmp_path_factory):
    """Folder and data of a small run: B and C on the effective base, a plan for C only."""
    out = tmp_path_factory.mktemp("scaling") / "new"
    call = ["--out", str(out), "--plans", str(plans), "--cases", "C", "B", "--bases", "effective"]
    assert time_scaling.main([*call, "--step", "0.05"]) == 0
    return out, json.loads((out / "time_scaling.json").read_text())


@pytest.mark.slow
def test_study_writes_all_or_nothing_else(study):
    out, data = study
    assert sorted(p.name for p in out.iterdir()) == [f"time_scaling.{x}" for x in ("json", "md", "png")]
    assert (out / "time_scaling.png").read_bytes().startswith(b"\x89PNG")
    assert data["versions"]["numpy"] == np.__version__
    assert data["options"] == {"cases": ["B", "C"], "bases": ["effective"], "step": 0.05, "cell_s": 5e-4}
    assert [(r["case"], r["motion"]) for r in data["rows"]] == [
        ("B", "printed"),
        ("C", "ours"),
        ("C", "printed"),
    ]
    for r in data["rows"]:
        assert [one["tau"] for one in r["taus"]] == [0.9, 0.95, 1.0, 1.05, 1.1]
        assert r["monotone"]
        assert r["rests_anywhere"]


@pytest.mark.slow
def test_slower_plan_has_as_much_more_headroom(study):
    _, data = study
    _, ours, printed = data["rows"]
    assert ours["tau_star"] * 1.02 == pytest.approx(printed["tau_star"], abs=2e-4)
    assert ours["duration_s"] == pytest.approx(1.02 * printed["duration_s"])
    assert ours["tau_drives"] < printed["tau_drives"]
    assert ours["raised_m"] == pytest.approx(printed["raised_m"], abs=1e-6)


@pytest.mark.slow
def test_study_tells_what_it_found(study):
    """5 % faster separates the contacts of B and C, as in the experiment; a clamp saves time."""
    out, data = study
    text = (out / "time_scaling.md").read_text()
    for row, found in (("| B | printed motion", "yes"), ("| C | printed motion", "yes")):
        lines = [line for line in text.split("## What")[1].splitlines() if line.startswith(row)]
        assert lines[0].split("|")[-2].strip() == found
    assert "| C | FP1W2F | 300 mm, clamp | ours | 2.168 |" in text
    clamp = [t for t in data["trends"] if t["trend"] == "clamp"]
    assert [(t["motion"], t["found"], t["not_found"]) for t in clamp] == [
        ("printed", ["C<B"], []),
        ("ours", [], []),
    ]
    assert clamp[0]["values"] == {"C<B": pytest.approx(2.126 / 2.408, abs=1e-3)}
    assert "- printed motion: found in C<B (0.883)." in text
    assert "At tau = 1 contacts are lost here in: none." in text


def test_printed_motions_show_the_trends_of_the_source():
    """All that 5.9 says about the printed motions' durations and about raising and lowering."""
    rows = []
    for case in map(motion_case, "ABCDEFGH"):
        robot, motion = printed(case.name, "printed")
        heights = time_scaling_trends.heights(robot.arm, motion, 3 if case.arm == "W1P1P2W2" else 2)
        rows.append(
            {"case": case.name, "base": "printed", "motion": "printed", "duration_s": motion.end, **heights}
        )
    found = {t["trend"]: t for t in time_scaling_trends.trends(rows)}
    for key in ("large", "clamp", "arm", "raised", "lowered"):
        assert found[key]["not_found"] == []
    assert found["raised"]["found"] == list("BCEFH")
    assert found["level"]["found"] == ["D"]
    assert found["level"]["values"]["G"] == pytest.approx((0.0, 0.010), abs=1e-3)


def test_trends_that_do_not_hold_are_told():
    flat = {"raised_m": 0.004, "lowered_m": 0.012, "base": "effective", "motion": "ours"}
    durations = {"A": 2.0, "B": 2.005, "D": 3.0, "E": 2.0, "G": 1.0, "H": 1.5}
    rows = [{"case": case, "duration_s": s, **flat} for case, s in durations.items()]
    found = {t["trend"]: t for t in time_scaling_trends.trends(rows)}
    assert found["large"]["found"] == ["G<H"]
    assert found["large"]["not_found"] == ["A<B", "D<E"]
    assert found["clamp"]["found"] == found["clamp"]["not_found"] == []
    assert found["raised"]["not_found"] == ["B", "E", "H"]
    assert found["lowered"]["found"] == ["A"]
    assert found["level"]["not_found"] == ["D", "G"]
    assert found["large"]["base"] == "effective"


def spoil(change):
    def apply(path):
        path.write_text(json.dumps(change(json.loads(path.read_text()))))

    return apply


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda path: path.write_text("{"), "C-effective: plan.json: broken JSON"),
        (spoil(lambda d: {**d, "case": "B"}), "case is B, must be C"),
        (spoil(lambda d: {**d, "base": "printed"}), "base is printed, must be effective"),
        (spoil(lambda d: {**d, "start": [0.0, *d["start"][1:]]}), "start is not that of case C"),
        (spoil(lambda d: {**d, "start": d["start"][:5], "commands": d["commands"][:5]}), "start is not that"),
    ],
)
def test_plan_that_cannot_be_used_is_named(plans, tmp_path, capsys, change, complaint):
    copy = tmp_path / "plans" / "C-effective" / "plan.json"
    copy.parent.mkdir(parents=True)
    copy.write_bytes((plans / "C-effective" / "plan.json").read_bytes())
    change(copy)
    out = tmp_path / "out"
    call = ["--out", str(out), "--plans", str(tmp_path / "plans"), "--cases", "C", "--bases", "effective"]
    assert time_scaling.main(call) == 1
    said = capsys.readouterr()
    assert complaint in said.err
    assert said.out == ""
    assert not out.exists()


def test_interrupted_study_writes_nothing(plans, tmp_path, monkeypatch, capsys):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(time_scaling, "row_of", stop)
    assert time_scaling.main(["--out", str(tmp_path / "out"), "--plans", str(plans)]) == 130
    assert "nothing written" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "options", [["--step", "0.03"], ["--step", "0"], ["--plans", "no"], ["--cases", "Z"]]
)
def test_bad_options_are_refused(options, tmp_path, capsys):
    with pytest.raises(SystemExit) as stopped:
        time_scaling.main(["--out", str(tmp_path), *options])
    assert stopped.value.code == 2
    assert options[0] in capsys.readouterr().err
