"""Figures of a plan: curves carry the right numbers, labels have units, nothing is cut off or covered."""

from __future__ import annotations

import dataclasses
import os
import re
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.colors import to_hex
from PIL import Image

from ocptip.basics.write import write_files
from ocptip.motion.files.output import sample_motion
from ocptip.motion.margins import FRICTION, TIPPING, motion_margins
from ocptip.motion.summary import TITLES, at_text
from ocptip.pictures import plan as motion_plots
from ocptip.pictures import plan_curves, style
from ocptip.pictures.frame import new_figure
from ocptip.pictures.plan import plan_figures, plan_pngs
from ocptip.pictures.plan_curves import PlanCurves
from ocptip.pictures.sketch import SKETCH, view_of
from ocptip.published.tasks import experiment_task
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import WORKSHOP
from ocptip.trajectories.trajectory import Trajectory
from tests.pictures.plan_stand_in import plan_of, stand_in_plan
from tests.quick import some
from tests.standing.elastic.test_drives import geared
from tests.standing.elastic.test_feet import softened

NAMES = ["motion", "ground", "drives"]


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


def panel(figure, label):
    """The axes whose vertical one is called so."""
    return next(ax for ax in figure.axes if ax.get_ylabel().startswith(label))


def legend(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_curves_are_the_samples(clamped):
    plan, samples, figures = clamped
    assert list(figures) == NAMES
    limits = plan.task.robot.arm.limits
    for figure, gid, values in (
        ("motion", "angle-2", np.rad2deg(samples.angles[:, 1])),
        ("motion", "share-2", 100 * samples.speeds[:, 1] / limits.speed[1]),
        ("drives", "share-2", 100 * samples.torques[:, 1] / limits.torque[1]),
        ("drives", "power", samples.powers.sum(axis=1)),
        ("ground", "tipping", np.maximum(samples.tip.moments.min(axis=1), 0)),
        ("ground", "friction", 100 * samples.slip.GT),
        ("ground", "normal-3", samples.states.contact_forces[:, 2, 0]),
        ("ground", "use-1", 100 * samples.slip.usage[:, 0]),
    ):
        x, y = curve(figures[figure], gid)
        np.testing.assert_array_equal(x[1:-1], samples.times)  # first and last: the rests before and after
        np.testing.assert_allclose(y[1:-1], values, err_msg=gid, atol=1e-9)


def test_speed_of_the_tcp_is_that_of_its_places(clamped):
    plan, _, figures = clamped
    x, speed = curve(figures["motion"], "tcp-speed")
    times = np.linspace(0.1, 0.9, 7) * plan.motion.end
    ahead, behind = (plan.task.robot.tool(plan.motion.states(times + h)[0]) for h in (1e-6, -1e-6))
    np.testing.assert_allclose(
        np.interp(times, x, speed), np.linalg.norm(ahead - behind, axis=1) / 2e-6, rtol=0.01
    )


def test_curves_have_the_rests_before_and_after(clamped):
    """There torques may be at their worst, which the check names."""
    plan, _, figures = clamped
    robot = plan.task.robot
    still = np.zeros((1, robot.n))
    for q, end in ((plan.motion.start, 0), (plan.motion.goal, -1)):
        torques = robot.samples_of(np.zeros(1), q[None], still, still).torques[0]
        for j, torque in enumerate(100 * torques / robot.limits.torque, 1):
            np.testing.assert_allclose(curve(figures["drives"], f"share-{j}")[1][end], torque)


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


def test_sketches_have_the_forces_of_the_contacts(free):
    """Which hold the load at that instant; the arrows of a sketch are in proportion to them."""
    plan, samples, figures = free
    curves = PlanCurves(plan, samples)
    k = len(samples.times) // 3
    forces = curves.forces_at(samples.times[k])
    assert forces.sum(axis=0) == pytest.approx(-samples.wrenches[k, :3], rel=1e-6, abs=1e-6)
    arrows = [own for ax in figures["motion"].axes for own in ax.collections if own.get_gid() == "forces"]
    known = np.vstack([curves.forces_at(0.0), curves.forces_at(plan.motion.end)])
    drawn = np.vstack([np.column_stack([own.U, own.V]) for own in (arrows[0], arrows[-1])])
    view = np.linalg.lstsq(known, drawn, rcond=None)[0]  # one view and scale
    assert known @ view == pytest.approx(drawn, abs=1e-9)
    assert np.ptp(drawn, axis=0).max() > 0.01


def test_least_distances_carry_the_names_of_their_pairs(free):
    plan, samples, figures = free
    collision = plan.task.robot.collision
    names = np.array([str(label) for label in collision.labels])
    gaps = collision.gaps(samples.angles)
    nearest = names[np.argmin(gaps, axis=1)]
    (ax,) = [ax for ax in figures["motion"].axes if ax.get_ylabel() == "clearance [mm]"]
    shown = [line for line in ax.lines if str(line.get_gid()).startswith("clearance-")]
    labels = [line.get_label().removeprefix("between ") for line in shown]
    assert labels == sorted(set(nearest), key=lambda n: -np.sum(nearest == n))
    for line, label in zip(shown, labels, strict=True):
        own = nearest == label
        np.testing.assert_allclose(line.get_ydata()[1:-1][own], 1e3 * gaps.min(axis=1)[own])
    assert all(np.isfinite([line.get_ydata() for line in shown]).any(axis=0))
    _, y = curve(figures["motion"], "clearance_m-nominal")
    assert y[0] == pytest.approx(1e3 * gaps.min(), rel=1e-3)
    assert ax.get_title("left").startswith(f"Clearance: minimum {y[0]:.3g} mm @")


def test_energy_ends_at_that_of_the_check_and_the_reference_is_dotted(clamped):
    plan, _, figures = clamped
    _, y = curve(figures["drives"], "energy")
    assert y[-1] == pytest.approx(plan.energy, rel=1e-5)
    x, y = curve(figures["drives"], "energy-reference")
    assert x[-1] == plan.task.reference.end
    assert y[-1] == pytest.approx(plan.task.robot.energy(plan.task.reference), rel=1e-5)
    for name, gid in (("ground", "tipping-reference"), ("ground", "friction-reference")):
        (line,) = figures[name].findobj(lambda artist, gid=gid: artist.get_gid() == gid)
        assert line.is_dashed()


@pytest.mark.slow
def test_without_reference_none_is_drawn():
    _, _, figures = drawn("C", reference=False)
    for figure in figures.values():
        assert not figure.findobj(lambda artist: str(artist.get_gid()).endswith("reference"))
        assert not any("reference" in legend(ax) for ax in figure.axes if ax.get_legend())


def test_worst_instants_are_marked_as_the_table_of_the_plan_has_them(clamped):
    plan, _, figures = clamped
    rows = {row.name: row for row in motion_margins(plan.task.robot, plan.check)}
    for name, scale in ((TIPPING, 1.0), (FRICTION, 100.0)):
        x, y = curve(figures["ground"], f"{name}-nominal")
        assert (x[0], y[0]) == (rows[name].nominal.time, scale * rows[name].nominal.value)
        titles = " ".join(ax.get_title("left") for ax in figures["ground"].axes)
        assert f"{TITLES[name]}: " in titles
        assert at_text(rows[name], rows[name].nominal) in titles


@pytest.mark.slow
def test_the_worst_case_is_dashed_and_its_minimum_is_that_of_the_check():
    task = experiment_task("A", "effective")
    limits = Limits(tolerance=WORKSHOP)
    motion = task.reference.time_scaled(3.0)
    plan = plan_of(dataclasses.replace(task, limits=limits, reference=None), motion)
    figure = plan_figures(plan)["ground"]
    (row,) = [row for row in motion_margins(task.robot, plan.check) if row.name == TIPPING]
    x, y = curve(figure, "tipping-worst-case")
    assert min(y) == pytest.approx(row.worst_case.value, rel=0.01)
    assert x[np.argmin(y)] == pytest.approx(row.worst_case.time, abs=0.02)
    times, nominal = curve(figure, "tipping")
    assert (y <= np.interp(x, times, nominal) + 0.2).all()
    assert f"worst case {at_text(row, row.worst_case)}" in panel(figure, "tipping").get_title("left")
    assert "worst case, at its worst" not in legend(panel(figure, "tipping"))  # it has a curve
    assert "worst case, at its worst" in legend(panel(figure, "friction"))
    assert figure.get_suptitle().splitlines()[0].endswith(": what the ground feels")
    assert figure.get_suptitle().splitlines()[1].startswith("CHECKED at samples for 'workshop' uncertainty")


@pytest.mark.slow
def test_limits_are_those_of_the_task():
    plan, _, figures = drawn("C", limits=Limits(GN=0.95, GT=0.8, torque_ratio=0.6))
    moment = plan.task.robot.tip_over.reference_moment * (1 / 0.95 - 1)
    for ax, value, label in (
        (panel(figures["ground"], "tipping"), moment, f"limit {moment:.3g} N m"),
        (panel(figures["ground"], "friction"), 80.0, "limit 80 %"),
        (panel(figures["drives"], "torque"), 60.0, "limit 60 %"),
    ):
        lines = ax.findobj(lambda artist: artist.get_gid() == "limit")
        assert lines[0].get_ydata()[0] == pytest.approx(value)
        assert label in legend(ax)
    largest = plan.task.robot.arm.limits.torque[1]
    assert f"joint 2, limit {largest:.3g} N m" in legend(panel(figures["drives"], "torque"))


def test_clamp_force_is_the_least_normal_force_of_its_contact(clamped, free):
    assert "3: lets go at -29.33 N" in legend(panel(clamped[2]["ground"], "normal"))
    assert "1, 2: lets go at 0 N" in legend(panel(clamped[2]["ground"], "normal"))
    assert legend(panel(free[2]["ground"], "normal"))[-1] == "lets go at 0 N"


def test_sketches_stand_on_all_feet_and_end_at_the_gripper(clamped):
    plan, _, figures = clamped
    robot = plan.task.robot
    for figure in figures.values():
        sketches = [ax for ax in figure.axes if ax.get_gid() == SKETCH]
        assert sketches
        for ax in sketches:
            feet = [line for line in ax.lines if str(line.get_gid()).startswith("foot-")]
            assert len(feet) == len(robot.support.contacts)
    (points,) = robot.sticks(plan.motion.start)
    np.testing.assert_allclose(points[-1], robot.tool(plan.motion.start[None])[0])
    np.testing.assert_allclose(points[0], robot.arm.mount_position)
    ax = next(ax for ax in figures["motion"].axes if ax.get_title() == "start")
    (body,) = [line for line in ax.lines if line.get_gid() == "body-1"]
    axes = view_of(np.asarray(PlanCurves.of(plan).tcp))
    np.testing.assert_allclose(body.get_xydata(), points @ axes.T, atol=1e-9)


def check_style(name, figure):
    """Axes have units, legends what is drawn, curves the colours of the one table."""
    colors = {quantity.color for quantity in style.QUANTITIES}
    colors |= {*style.MEMBERS, style.LIMIT_COLOR, style.NOTE, "#7a7a7a"}
    for ax in figure.axes:
        if ax.get_gid() == SKETCH:
            continue
        assert re.search(r"\[.+\]$", ax.get_ylabel()), (name, ax.get_ylabel())
        below = [own.get_xlabel() for own in [ax, *ax.get_shared_x_axes().get_siblings(ax)]]
        assert any(re.search(r"\[.+\]", label) for label in below), name
        assert ax.get_title("left"), name
        lines = [line for line in ax.lines if len(line.get_xdata())]
        assert {to_hex(line.get_color()) for line in lines} <= colors, name
        labels = {line.get_label() for line in lines if not line.get_label().startswith("_")}
        assert set(legend(ax) if ax.get_legend() else ()) == labels, name


def check_texts(name, figure):
    """All texts are inside the figure, none covers another, legends cover no curve and squeeze no panel."""
    figure.draw_without_rendering()
    texts = [figure._suptitle]
    for ax in figure.axes:
        texts += [ax.title, ax._left_title, ax.xaxis.label, ax.yaxis.label]
        if ax.get_legend() is not None:
            texts += ax.get_legend().get_texts()
            assert ax.get_legend().get_window_extent().x0 >= ax.get_window_extent().x1 - 1
    wide = max(ax.get_window_extent().width for ax in figure.axes)
    assert wide > 0.55 * figure.bbox.width, name
    boxes = [(text.get_text(), text.get_window_extent()) for text in texts if text.get_text()]
    for i, (first, a) in enumerate(boxes):
        assert min(a.x0, a.y0) >= -1, (name, first)
        assert a.x1 <= figure.bbox.x1 + 1, (name, first)
        assert a.y1 <= figure.bbox.y1 + 1, (name, first)
        for second, b in boxes[:i]:
            assert not a.overlaps(b), (name, first, second)


@pytest.mark.parametrize("case", some(1, ["clamped", "free"]))
def test_axes_have_units_legends_what_is_drawn_and_no_text_is_covered(case, request):
    for name, figure in request.getfixturevalue(case)[2].items():
        check_style(name, figure)
        check_texts(name, figure)


def test_quantities_and_members_have_colours_of_their_own():
    colors = [*(quantity.color for quantity in style.QUANTITIES), *style.MEMBERS]
    assert len(set(colors)) == len(colors)


@pytest.mark.slow
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
        n=9,
        tip_over=robot.tip_over,
        interfaces=(robot,),
        sticks=lambda q: robot.sticks(plan.motion.start),
        tool=lambda q: np.zeros((len(q), 3)),
        limits=unlimited,
        support=robot.support,
    )
    task = SimpleNamespace(**{**vars(plan.task), "robot": wide_robot})
    figures = plan_figures(SimpleNamespace(**{**vars(plan), "task": task}), samples)
    assert [text.get_text() for text in panel(figures["drives"], "torque").texts] == [
        "no joint has such a limit"
    ]
    angles, clearance = (panel(figures["motion"], word) for word in ("angle", "clearance"))
    assert "1: shoulder_lift_joint_0" in legend(angles)
    styles = {(line.get_color(), str(line._dash_pattern)) for line in angles.lines[:9]}
    assert len(styles) == 9 > len(style.MEMBERS)
    assert [text.get_text() for text in clearance.texts] == ["collision not checked"]
    for name, figure in figures.items():
        check_texts(name, figure)


@pytest.mark.slow
def test_files_are_pictures_and_complete(tmp_path, monkeypatch, free):
    plan, samples, _ = free
    monkeypatch.setattr(motion_plots, "FIGURES", {n: motion_plots.FIGURES[n] for n in ("ground", "drives")})
    files = plan_pngs(plan, samples)
    paths = write_files(tmp_path / "out", files)
    assert [path.name for path in paths] == ["ground.png", "drives.png"]
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
            write_files(tmp_path / "out", files)
    assert caught.value.filename == str(paths[0])
    assert paths[0].read_bytes() == before
    assert len(list((tmp_path / "out").iterdir())) == 2


@pytest.mark.slow
@pytest.mark.parametrize("feet", some(1, [False, True]))
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


@pytest.mark.slow
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


def test_joints_in_m_and_in_degrees_have_an_axis_each():
    angles = np.array([[0.1, 0.5], [0.2, 1.0]])
    seen = SimpleNamespace(
        times=np.array([0.0, 1.0]), joint_names=["1: lift", "2: turn"], units=["m", "deg"],
        scales=np.array([1.0, 180 / np.pi]), samples=SimpleNamespace(angles=angles),
        events=np.empty(0), plan=SimpleNamespace(),
    )  # fmt: skip
    figure = new_figure(6.0, 3.0)
    motion_plots._angles(figure.subplots(), seen)
    metres, degrees = (panel(figure, f"coordinate [{unit}]") for unit in ("m", "deg"))
    assert metres is not degrees
    assert curve(metres, "angle-1")[1] == pytest.approx(angles[:, 0])
    assert curve(degrees, "angle-2")[1] == pytest.approx(np.degrees(angles[:, 1]))
    assert metres.get_ylim()[1] < 1 < degrees.get_ylim()[1]
    labels = [text.get_text() for text in metres.get_legend().get_texts()]
    assert labels == ["1: lift [m]", "2: turn [deg]"]
