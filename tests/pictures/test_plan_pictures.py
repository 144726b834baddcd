"""Figures of a plan: curves carry the right numbers, labels have units, nothing is cut off or covered."""

from __future__ import annotations

import dataclasses
import os
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from ocptip.motion.output import sample_motion
from ocptip.pictures import plan as motion_plots
from ocptip.pictures import plan_curves
from ocptip.pictures.frame import COLORS
from ocptip.pictures.plan import draw_plan, plan_figures
from ocptip.pictures.plan_curves import PlanCurves
from ocptip.standing.limits import Limits
from ocptip.trajectories.trajectory import Trajectory
from tests.pictures.plan_stand_in import plan_of, stand_in_plan
from tests.standing.elastic.test_drives import geared
from tests.standing.elastic.test_feet import softened

NAMES = ["plan", "angles", "speeds", "torques", "power", "reserves", "normal_forces", "friction", "clearance"]


def drawn(name, **options):
    """Samples and figures of a case's stand-in."""
    plan = stand_in_plan(name, **options)
    samples = sample_motion(plan.task.robot, plan.motion)
    return plan, samples, plan_figures(plan, samples)


@pytest.fixture(scope="module")
def clamped():
    return drawn("C", factor=1.05)


@pytest.fixture(scope="module")
def free():
    return drawn("A")


def curve(figure, gid):
    """x and y of the only line of that name."""
    (line,) = figure.findobj(lambda artist: artist.get_gid() == gid)
    return np.asarray(line.get_xdata(), dtype=float), np.asarray(line.get_ydata(), dtype=float)


def legend(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_curves_are_the_samples(clamped):
    plan, samples, figures = clamped
    assert list(figures) == NAMES
    limits = plan.task.robot.arm.limits
    for figure, gid, values in (
        ("plan", "angle-2", np.rad2deg(samples.angles[:, 1])),
        ("angles", "angle-6", np.rad2deg(samples.angles[:, 5])),
        ("speeds", "speed-1", np.rad2deg(samples.speeds[:, 0])),
        ("torques", "torque-2", samples.torques[:, 1]),
        ("power", "power-3", samples.powers[:, 2]),
        ("power", "power", samples.powers.sum(axis=1)),
        ("plan", "power", samples.powers.sum(axis=1)),
        ("reserves", "GN", samples.tip.GN),
        ("plan", "GT", samples.slip.GT),
        ("normal_forces", "normal-3", samples.states.contact_forces[:, 2, 0]),
        ("friction", "use-1", 100 * samples.slip.usage[:, 0]),
    ):
        x, y = curve(figures[figure], gid)
        np.testing.assert_array_equal(x[1:-1], samples.times)  # first and last: the rests before and after
        np.testing.assert_allclose(y[1:-1], values, err_msg=gid)
    speeds, torques = figures["plan"].axes[1:3]
    for ax, share in ((speeds, samples.speeds / limits.speed), (torques, samples.torques / limits.torque)):
        (line,) = ax.findobj(lambda artist: artist.get_gid() == "share-2")
        np.testing.assert_allclose(line.get_ydata()[1:-1], 100 * share[:, 1])


def test_curves_have_the_rests_before_and_after(clamped):
    """There torques may be at their worst, which the check names."""
    plan, _, figures = clamped
    robot = plan.task.robot
    still = np.zeros((1, robot.n))
    for q, end in ((plan.motion.start, 0), (plan.motion.goal, -1)):
        torques = robot.samples_of(np.zeros(1), q[None], still, still).torques[0]
        for j, torque in enumerate(torques, 1):
            np.testing.assert_allclose(curve(figures["torques"], f"torque-{j}")[1][end], torque)


def test_events_are_those_of_ramps(free):
    """Not the samples of a controller, of which there are many."""
    plan, samples, _ = free
    sampled = Trajectory.from_points(
        np.linspace(0, 1, 100), np.linspace(plan.motion.goal, plan.motion.start, 100)
    )
    motion = Trajectory.from_segments((sampled, plan.motion), (0.5, 0.0))
    curves = PlanCurves(SimpleNamespace(motion=motion), samples)
    np.testing.assert_allclose(curves.events, 1.5 + plan.motion.event_times)
    assert not len(PlanCurves(SimpleNamespace(motion=sampled), samples).events)


def test_least_distances_carry_the_names_of_their_pairs(free):
    plan, samples, figures = free
    collision = plan.task.robot.collision
    names = np.array([str(label) for label in collision.labels])
    gaps = collision.gaps(samples.angles)
    nearest = names[np.argmin(gaps, axis=1)]
    for figure in ("plan", "clearance"):
        (ax,) = [ax for ax in figures[figure].axes if ax.get_ylabel() == "distance [mm]"]
        shown = [
            line
            for line in ax.lines
            if str(line.get_gid()).startswith("clearance-") and len(line.get_xdata()) > 1
        ]
        assert [line.get_label() for line in shown] == sorted(
            set(nearest), key=lambda n: -np.sum(nearest == n)
        )
        for line in shown:
            own = nearest == line.get_label()
            np.testing.assert_allclose(line.get_ydata()[1:-1][own], 1e3 * gaps.min(axis=1)[own])
        assert all(np.isfinite([line.get_ydata() for line in shown]).any(axis=0))
        _, y = curve(figures[figure], "clearance-worst")
        assert y[0] == pytest.approx(1e3 * gaps.min(), rel=1e-3)
        assert ax.get_title("left").startswith(f"Minimum distance {y[0]:.3g} mm at ")


def test_energy_ends_at_that_of_the_check_and_the_reference_is_dashed(clamped):
    plan, _, figures = clamped
    for name in ("plan", "power"):
        x, y = curve(figures[name], "energy")
        assert y[-1] == pytest.approx(plan.energy, rel=1e-5)
        x, y = curve(figures[name], "energy-reference")
        assert x[-1] == plan.task.reference.end
        assert y[-1] == pytest.approx(plan.task.robot.energy(plan.task.reference), rel=1e-5)
    for gid in ("GN-reference", "GT-reference", "energy-reference"):
        figure = figures["power" if gid.startswith("energy") else "reserves"]
        (line,) = figure.findobj(lambda artist, gid=gid: artist.get_gid() == gid)
        assert line.is_dashed()


def test_without_reference_nothing_is_dashed_but_limits():
    _, _, figures = drawn("C", reference=False)
    assert not figures["plan"].findobj(lambda artist: str(artist.get_gid()).endswith("reference"))
    assert "reference" not in legend(figures["reserves"].axes[0])


def test_worst_instants_are_marked(clamped):
    plan, _, figures = clamped
    for name in ("GN", "GT"):
        worst = plan.check.worst[name]
        for figure in ("plan", "reserves"):
            x, y = curve(figures[figure], f"{name}-worst")
            assert (x[0], y[0]) == (worst.time, worst.value)
    assert f"at most {plan.check.worst['GN'].value:.3f}" in figures["reserves"].axes[0].get_title("left")


def test_limits_are_those_of_the_task():
    plan, _, figures = drawn("C", limits=Limits(GN=0.95, GT=0.8, torque_ratio=0.6))
    gn, gt = figures["reserves"].axes
    for ax, value in ((gn, 0.95), (gt, 0.8)):
        (line,) = ax.findobj(lambda artist: artist.get_gid() == "limit")
        assert line.get_ydata()[0] == value
    assert {"limit of GN 0.95", "limit of GT 0.8"} <= set(legend(figures["plan"].axes[4]))
    assert curve(figures["friction"], "limit")[1][0] == pytest.approx(80)
    largest = 0.6 * plan.task.robot.arm.limits.torque[1]
    assert legend(figures["torques"].axes[1])[1] == f"limit {largest:.4g} N m"


def test_clamp_force_is_the_least_normal_force_of_its_contact(clamped, free):
    assert "least (3): -29.33 N" in legend(clamped[2]["normal_forces"].axes[0])
    assert "least (1, 2): 0 N" in legend(clamped[2]["normal_forces"].axes[0])
    assert legend(free[2]["normal_forces"].axes[0])[-1] == "least: 0 N"


def test_every_panel_has_time_units_legend_and_events(clamped):
    plan, _, figures = clamped
    for name, figure in figures.items():
        assert plan.task.name in figure.get_suptitle()
        for ax in figure.axes:
            if ax.get_legend() is None:  # the right axis of power and energy
                assert ax.get_ylabel() == "energy [J]"
                continue
            assert ax.get_xlabel() == "time [s]", name
            assert ax.get_ylabel()[-1] in "])", name
            lines = [path.vertices[:, 0] for own in ax.collections for path in own.get_paths()]
            vertical = {x[0] for x in lines if len(x) == 2 and x[0] == x[1]}
            assert set(plan.motion.event_times) <= vertical


def check_texts(name, figure):
    """All texts are inside the figure, none covers another, legends cover no curve and squeeze no panel."""
    figure.draw_without_rendering()
    columns = figure.axes[0].get_subplotspec().get_gridspec().ncols
    assert columns * figure.axes[0].get_window_extent().width > 0.8 * figure.bbox.width, name
    texts = [figure._suptitle]
    for ax in figure.axes:
        texts += [ax._left_title, ax.xaxis.label, ax.yaxis.label]
        if ax.get_legend() is not None:
            texts += ax.get_legend().get_texts()
            assert ax.get_legend().get_window_extent().y0 >= ax.get_window_extent().y1 - 1
    boxes = [(text.get_text(), text.get_window_extent()) for text in texts if text.get_text()]
    for i, (first, a) in enumerate(boxes):
        assert min(a.x0, a.y0) >= 0, (name, first)
        assert a.x1 <= figure.bbox.x1, (name, first)
        assert a.y1 <= figure.bbox.y1, (name, first)
        for second, b in boxes[:i]:
            assert not a.overlaps(b), (name, first, second)


@pytest.mark.parametrize("case", ["clamped", "free"])
def test_no_text_is_cut_off_or_covered(case, request):
    for name, figure in request.getfixturevalue(case)[2].items():
        check_texts(name, figure)


def test_many_joints_without_limits_can_be_drawn(monkeypatch):
    """A robot from a URDF: nine joints with long names, no torque limits, four wheels, no obstacles."""
    monkeypatch.setattr(plan_curves, "_with_rests", lambda robot, motion, samples: samples)
    plan = stand_in_plan("C", reference=False)
    samples = sample_motion(plan.task.robot, plan.motion)
    nine = [0, 1, 2, 3, 4, 5, 0, 1, 2]
    wide = {
        name: getattr(samples, name)[:, nine]
        for name in ("angles", "speeds", "accelerations", "torques", "powers")
    }
    samples = dataclasses.replace(samples, **wide, clearances=np.full(len(samples.times), np.inf))
    robot, limits = plan.task.robot, plan.task.robot.arm.limits
    unlimited = SimpleNamespace(speed=limits.speed[nine], torque=np.full(9, np.inf))
    wide_robot = SimpleNamespace(
        names=tuple(f"shoulder_lift_joint_{j}" for j in range(9)),
        units=("rad",) * 9,
        motor_units=("N m",) * 9,
        limits=unlimited,
        support=robot.support,
    )
    task = SimpleNamespace(**{**vars(plan.task), "robot": wide_robot})
    figures = plan_figures(SimpleNamespace(**{**vars(plan), "task": task}), samples)
    assert "no limit" in figures["torques"].axes[0].get_title("left")
    assert len(figures["torques"].axes) == 9
    assert "1: shoulder_lift_joint_0" in legend(figures["angles"].axes[0])
    styles = {(line.get_color(), str(line._dash_pattern)) for line in figures["angles"].axes[0].lines[:9]}
    assert len(styles) == 9 > len(COLORS)
    assert [text.get_text() for text in figures["clearance"].axes[0].texts] == ["collision not checked"]
    for name, figure in figures.items():
        check_texts(name, figure)


def test_files_are_pictures_and_complete(tmp_path, monkeypatch, free):
    plan, samples, _ = free
    monkeypatch.setattr(
        motion_plots, "_FIGURES", {n: motion_plots._FIGURES[n] for n in ("angles", "friction")}
    )
    paths = draw_plan(tmp_path / "out", plan, samples)
    assert [path.name for path in paths] == ["angles.png", "friction.png"]
    for path in paths:
        with Image.open(path) as image:
            assert image.format == "PNG"
            pixels = np.asarray(image.convert("L"), dtype=float)
        assert min(pixels.shape) > 600
        assert pixels.std() > 10
    before = paths[0].read_bytes()

    def full_disk(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full_disk)
        with pytest.raises(OSError, match="No space") as caught:
            draw_plan(tmp_path / "out", plan, samples)
    assert caught.value.filename == str(paths[0])
    assert paths[0].read_bytes() == before
    assert len(list((tmp_path / "out").iterdir())) == 2


@pytest.mark.parametrize("feet", [False, True])
def test_vibration_and_forces_with_gears_that_give(feet):
    plan = stand_in_plan("A", reference=False)
    robot = geared(softened(plan.task.robot, 1e6) if feet else plan.task.robot)
    ringing = plan_of(SimpleNamespace(**{**vars(plan.task), "robot": robot}), plan.motion)
    figures = plan_figures(ringing)
    found = ringing.check.drives
    times, values = curve(figures["gears"], "vibration")
    assert values.max() == pytest.approx(1e3 * max(found.peak.value, found.after))
    assert times[-1] > plan.motion.end
    begins, forces = curve(figures["gears"], "force-3")
    instants, stiff = curve(figures["gears"], "stiff-3")
    goal = plan.motion.goal[None]
    rest = robot.contact_states(robot.loads(goal, 0 * goal, 0 * goal)[1]).contact_forces[0, 2, 0]
    assert forces[-1] == pytest.approx(rest, abs=0.5)
    moving = begins < plan.motion.end
    assert np.max(np.abs(np.interp(begins, instants, stiff) - forces)[moving]) > 5


def test_forces_and_gaps_of_feet_that_give():
    plan = stand_in_plan("A", reference=False)
    robot = softened(plan.task.robot, 1e6)
    soft = plan_of(SimpleNamespace(**{**vars(plan.task), "robot": robot}), plan.motion)
    figures = plan_figures(soft)
    assert list(figures) == [*NAMES, "feet"]
    found = soft.check.feet
    times, forces = curve(figures["feet"], "force-2")
    assert times[-1] > plan.motion.end
    at = np.searchsorted(found.course.times, times)
    np.testing.assert_array_equal(forces, found.course.forces[at, 1, 0])
    assert curve(figures["feet"], "gap-1")[1].max() <= 1e3 * found.lift


def test_titles_say_what_was_proved_and_what_holds_within_a_tolerance():
    plan = stand_in_plan("A")
    (title,) = {figure.get_suptitle() for figure in plan_figures(plan).values()}
    assert title.startswith("A: verified, ")
    worst = plan.check.worst | {
        f"{name}_worst_case": dataclasses.replace(plan.check.worst[name], value=0.75) for name in ("GN", "GT")
    }
    checked = dataclasses.replace(plan.check, worst=worst, certificate=SimpleNamespace(certified=True))
    figures = plan_figures(plan_of(plan.task, plan.motion, checked))
    assert "at the worst of the tolerance GN 0.750, GT 0.750" in figures["plan"].axes[4].get_title(loc="left")
    assert (
        figures["reserves"].axes[0].get_title(loc="left").endswith("at the worst of the tolerance GN 0.750")
    )
    assert figures["plan"].get_suptitle().startswith("A: certified, ")
