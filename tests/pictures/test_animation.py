"""Animations: frames, lengths of bodies, curves, and files that need nothing else."""

import shutil
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from ocptip.api.rate import rate_along
from ocptip.api.view import view
from ocptip.basics.errors import InputError
from ocptip.cli.main import main
from ocptip.motion.files.plan_files import write_plan
from ocptip.pictures import movie
from ocptip.pictures.animation import Moving, plan_times, save_animation
from ocptip.published.tasks import experiment_task
from ocptip.standing.parts import Part
from ocptip.task_files.motion import load_task
from ocptip.trajectories.trajectory import Trajectory
from tests.pictures.plan_stand_in import plan_of
from tests.places import EXAMPLES


@pytest.fixture
def few_frames(monkeypatch):
    monkeypatch.setattr(movie, "RATE", 1)
    monkeypatch.setattr(movie, "_HELD", 1)


def test_curves_and_forces_are_those_of_the_motion():
    task = experiment_task("A")
    parts = [Part(task.robot, task.reference)]
    times = np.array([0.3, 0.9])
    shown = Moving.of_plan("A", parts, times)
    seen = task.robot.samples(task.reference, times)
    assert shown.curves["tipping margin [N m]"] == pytest.approx(seen.tip.moments.min(axis=1))
    assert shown.curves["friction used [%]"] == pytest.approx(100 * seen.slip.GT)
    assert shown.ground.forces.sum(axis=1) == pytest.approx(-seen.wrenches[:, :3])
    assert shown.path == pytest.approx(seen.gripper[:, :3])
    for k in range(2):
        pair = set(task.robot.tip_over.axes[seen.tip.nearest_axis[k]].contacts)
        assert set(shown.ground.axes[k]) == pair


@pytest.mark.slow
def test_two_plans_side_by_side(tmp_path, few_frames, capsys):
    task = experiment_task("A")
    write_plan(tmp_path / "one", plan_of(task, task.reference))
    shutil.copytree(tmp_path / "one", tmp_path / "two")  # a second check would take a second
    file = tmp_path / "both.gif"
    assert main(["view", str(tmp_path / "one"), str(tmp_path / "two"), "--movie", str(file)]) == 0
    assert "both.gif" in capsys.readouterr().out
    with Image.open(file) as picture:
        assert picture.n_frames >= 3
        first = np.asarray(picture.convert("L")).astype(int)
        picture.seek(1)
        second = np.asarray(picture.convert("L")).astype(int)
    assert first.shape[1] == 800
    for half in (slice(0, 400), slice(400, 800)):  # both move
        assert np.abs(first[:, half] - second[:, half]).max() > 100
    file.write_bytes(b"a holiday")
    assert main(["view", str(tmp_path / "one"), "--movie", str(file)]) == 2


@pytest.mark.slow
def test_a_delta_moves_as_rigid_bodies(tmp_path, few_frames):
    task = load_task(EXAMPLES / "tasks/delta_cart.toml")
    speed, acceleration = 0.5 * task.robot.limits.speed, 0.5 * task.robot.limits.acceleration
    motion = Trajectory.ending_together(task.start, task.goal, [None] * task.robot.n, speed, acceleration)
    parts = (Part(task.robot, motion),)
    shown = Moving.of_plan("delta", parts, plan_times(parts))
    lengths = [[np.linalg.norm(np.diff(line, axis=0), axis=1) for line in frame] for frame in shown.bodies]
    moved = [np.concatenate([np.ravel(line) for line in frame]) for frame in shown.bodies]
    assert np.abs(moved[0] - moved[-1]).max() > 0.05
    for frame in lengths[1:]:
        assert np.concatenate(frame) == pytest.approx(np.concatenate(lengths[0]), abs=1e-9)

    page = save_animation([shown], tmp_path / "delta.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64") == 3
    assert "http" not in page


@pytest.mark.slow
def test_indices_along_a_motion_of_a_closed_chain(tmp_path, few_frames):
    rows = ["time_s,q1_m,q2_m,q3_deg", "0,0,0,0", "0.1,0.02,0.01,5", "0.2,0.04,0.02,10"]
    (tmp_path / "motion.csv").write_text("\n".join(rows))
    found = rate_along("3RPR", tmp_path / "motion.csv")
    frames = found.bodies()
    anchors = np.array([[line[0] for line in frame[1:-1:3]] for frame in frames])
    assert np.allclose(anchors[0], anchors[-1])  # legs stay where they are on the base
    platform = [np.linalg.norm(np.diff(frame[-1], axis=0), axis=1) for frame in frames]
    assert np.allclose(platform[0], platform[-1])
    with Image.open(found.save(tmp_path / "rpr.gif")) as picture:
        assert picture.n_frames >= 2


@pytest.mark.parametrize(
    ("span", "speed", "count", "words"),
    [
        (0.02, 0.02, 21, "50 times slower"),
        (1.52, 1.0, 32, "in real time"),
        (7.0, 1.0, 141, "in real time"),
        (60.0, 10.0, 121, "10 times faster"),
    ],
)
def test_frames_have_the_time_between_them_that_files_play(span, speed, count, words):
    assert movie.speed_of(span) == pytest.approx(speed)
    assert words in movie.speed_text(movie.speed_of(span))
    times = movie.frame_times(span)
    assert len(times) == count
    assert times[-1] == span
    steps = np.diff(times) * movie.RATE / speed
    assert steps[:-1] == pytest.approx(1.0)
    assert 0 < steps[-1] <= 1.001


def test_an_mp4_is_decoded_with_all_frames(tmp_path):
    """Frames of known grey values."""
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    frames = [Image.new("L", (65, 48), 20 + 40 * k).convert("RGB") for k in range(5)]
    movie.write_movie(tmp_path / "a.mp4", frames, "a")
    assert imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "a.mp4"))[0] == 5 + movie._HELD
    exe = imageio_ffmpeg.get_ffmpeg_exe()
    decode = [
        exe,
        "-loglevel",
        "error",
        "-i",
        str(tmp_path / "a.mp4"),
        "-f",
        "rawvideo",
        "-pix_fmt",
        "gray",
        "-",
    ]
    content = np.frombuffer(subprocess.run(decode, capture_output=True, check=True).stdout, np.uint8)
    grey = content.reshape(-1, 48 * 64).mean(axis=1)
    about = subprocess.run([exe, "-i", str(tmp_path / "a.mp4")], capture_output=True, text=True).stderr
    assert f"{movie.RATE} fps" in about
    assert grey[:5] == pytest.approx([20 + 40 * k for k in range(5)], abs=4)


def test_refusals(tmp_path, monkeypatch, capsys):
    scene = EXAMPLES / "scenes/rover_on_slope.toml"
    with pytest.raises(InputError, match="stands still"):
        view(scene).save(tmp_path / "a.gif")
    assert main(["view", str(scene), "--movie", str(tmp_path / "a.avi")]) == 2
    assert "--movie" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    still = Moving("x", np.zeros(1), [[np.zeros((2, 3))]])
    with pytest.raises(InputError, match=r"ocptip\[video\]"):
        save_animation([still], tmp_path / "a.mp4")


def test_a_page_and_an_animation_in_one_call(tmp_path, monkeypatch, capsys):
    class Shown:
        name, html = "arm", ""

        def save(self, path):
            path.write_text("drawn")
            return path

    monkeypatch.setattr("ocptip.cli.start.view.view", lambda *_, **__: Shown())
    page, movie = tmp_path / "page.html", tmp_path / "movie.gif"
    assert main(["view", "plan", "--html", str(page), "--movie", str(movie)]) == 0
    assert page.exists()
    assert movie.exists()
    assert f"{page} (" in (out := capsys.readouterr().out)
    assert f"{movie} (" in out
