"""`ocptip drive` and `ocptip.drive`: manoeuvres, files, parameters for navigation, refusals."""

import csv
import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest

import ocptip
from ocptip.api.chart import halton_postures
from ocptip.cli.layout import headline_of
from ocptip.cli.main import main
from ocptip.cli.verify.drive import DriveReport
from ocptip.contact.verdict import equilibrium
from ocptip.pictures.load_chart import envelope_figure
from ocptip.standing.at_rest.stow_pose import StowSearch
from ocptip.standing.limits import Limits
from tests.places import EXAMPLES
from tests.quick import some

G = 9.81
TASK = EXAMPLES / "tasks/ur5_cart.toml"


@pytest.fixture(scope="module")
def envelope():
    return ocptip.drive(TASK, directions=8, speed=1.2, turning=0.6)


def holds(envelope, motion):
    """Whether contact forces exist; with much friction the contact laws may also have a motion."""
    robot, still = envelope.robot, np.zeros((1, len(envelope.q)))
    wrench = robot.loads(envelope.q[None], still, still, base_motion=motion)[1][0]
    return equilibrium(robot.support, wrench).stands


def test_manoeuvres_end_where_stand_changes(envelope):
    v, w = 1.2, 0.6
    d, speed = (
        envelope.to_dict()["manoeuvres"][key]["nominal"]["largest"]
        for key in ("stop_right", "stop_speed_left")
    )
    a, bend = envelope.stop_deceleration, w / v
    for share, expected in ((1 - 1e-4, True), (1 + 1e-4, False)):
        x = share * d
        motion = ocptip.BaseMotion([-x, -v * w, 0], [0, 0, -w], [0, 0, x * w / v])
        assert holds(envelope, motion) == expected
        u = share * speed
        motion = ocptip.BaseMotion([-a, bend * u**2, 0], [0, 0, bend * u], [0, 0, -a * bend])
        assert holds(envelope, motion) == expected


def test_a_base_that_tips_at_rest_has_no_envelope(capsys, tmp_path):
    out = tmp_path / "drive"
    assert main(["drive", str(TASK), "--payload", "200", "--no-figures", "--out", str(out)]) == 1
    text = " ".join(capsys.readouterr().out.split())
    assert "NOT STABLE AT REST, THE BASE MUST NOT DRIVE, AND THE ARM CANNOT REST THERE" in text
    assert "reverse" not in text
    assert not (out / "nav2.yaml").exists()
    data = json.loads((out / "drive.json").read_text(encoding="utf-8"))
    assert not data["stands"]
    assert any("to hold the arm" in reason for reason in data["broken"])


def test_an_arm_that_cannot_rest_is_said_beside_the_envelope(capsys, tmp_path):
    line = ["drive", str(TASK), "--posture", "0,0,0,0,0,0", "--payload", "7", "--no-figures"]
    assert main([*line, "--tolerance", "none", "--out", str(tmp_path / "drive")]) == 1
    assert "DRIVE ENVELOPE, BUT THE ARM CANNOT REST THERE" in " ".join(capsys.readouterr().out.split())


def test_slopes_help_or_harm(envelope):
    level, down, up = (envelope.limit(key) for key in ("brake", "brake_downhill", "brake_uphill"))
    assert down < level < up


def test_parameters_say_that_slopes_leave_less(envelope):
    ways = ("downhill", "uphill", "across_left", "across_right")
    least = min(envelope.limit(f"brake_{way}") for way in ways)
    down = float(envelope.ground.split(": ")[1].split()[0])
    assert 0 <= least - down <= 2e-3
    assert f"# {envelope.ground}\n" in envelope.to_yaml()
    assert replace(envelope, given=replace(envelope.given, slope=0.0)).ground == "on level ground"


def test_parameters_for_navigation_hold_together(envelope):
    navigation = envelope.navigation
    (v, _, w), (x, y, al) = navigation["max_velocity"], navigation["max_accel"]
    assert (v, y) == (1.2, 0.0)
    assert x < envelope.limit("accelerate")
    found = [
        holds(envelope, ocptip.BaseMotion([f * a, f * v * s * w, 0], [0, 0, f * s * w], [0, 0, f * t * al]))
        for f in (0.999, 1.001)
        for a in (x, navigation["max_decel"][0])
        for s in (-1, 1)
        for t in (-1, 1)
    ]
    assert all(found[:8])  # of the nominal model, and all within the uncertainty
    sideways = ocptip.drive(TASK, directions=8, speed=1.2, holonomic=True).navigation
    assert 0 < sideways["max_accel"][1] < envelope.limit("left")


@pytest.mark.slow
@pytest.mark.parametrize("heavy", some(1, [False, True]))
def test_reverse_is_allowed_only_where_the_same_limits_hold_backwards(tmp_path, heavy):
    """The cart brakes unlike it accelerates, for its arm; one that is much heavier does alike."""
    file, text = tmp_path / "cart.toml", TASK.read_text(encoding="utf-8")
    text = text.replace("ur5.urdf", str(TASK.parent / "ur5.urdf"))
    file.write_text(text.replace("mass = 35.0 ", "mass = 1e4 ") if heavy else text)
    found = ocptip.drive(file, directions=4, speed=0.3, uncertainty="none")
    most, least, x, d = found.navigation.values()
    assert least[1:] == [-most[1], -most[2]]
    reversing = [
        holds(found, ocptip.BaseMotion([a, -0.3 * w, 0], [0, 0, w], [0, 0, 0.99 * s * x[2]]))
        for a in (-0.99 * d[0], -0.99 * x[0], 0.99 * d[0], 0.99 * x[0])
        for w in (0.99 * least[2], 0.99 * most[2])
        for s in (-1, 1)
    ]
    assert all(reversing) == heavy
    assert least[0] == (-0.3 if heavy else 0.0)
    assert ("reverse: as fast as forward" in found.to_yaml()) == heavy
    ahead = found.smoother.ahead
    assert ahead["max_accel"][0] != -ahead["max_decel"][0]  # the heavy one, too, has an arm
    assert x[0] >= 0.95 * ahead["max_accel"][0]


@pytest.mark.slow
@pytest.mark.parametrize(("share", "good"), [(0.99, True), (1.01, False)])
def test_a_check_of_the_same_braking_says_the_same(envelope, without_robustness, share, good):
    """Within an uncertainty whose acceleration steps overshoot; contacts alone count."""
    words = f"2 m, 1 m/s, {share * envelope.limit('brake')} m/s^2"
    task = ocptip.load_task(TASK, GN=0.9999, GT=0.9999)
    within = ocptip.check(task, "start", drive_profile=words).check.within
    assert (max(within.tip.value, within.slip.value) < 1) == good


@pytest.mark.slow
def test_parameters_for_navigation_hold_from_full_acceleration_to_full_braking(envelope):
    (x, _, _), (d, _, _) = (envelope.navigation[name] for name in ("max_accel", "max_decel"))
    times = np.array([0, 0.2, 0.2 + 0.2 * x / -d])
    speeds = np.array([[0, 0, 0], [0.2 * x, 0, 0], [0, 0, 0]])
    profile = ocptip.trajectories.drive_profile.DriveProfile.of_velocities(times, speeds)
    within = ocptip.check(TASK, "start", drive_profile=profile).check.within
    assert max(within.tip.value, within.slip.value) < 1


@pytest.mark.slow
def test_accelerations_that_end_swing_back():
    """With the arm to one side, the other side tips when an acceleration that it could stand ends."""
    damped, gentle = (ocptip.drive(TASK, uncertainty=ocptip.Uncertainty(damping=d)) for d in (0.05, 0.999999))
    more = damped.counting.overshoot
    raw = gentle.within.largest[:36]
    expected = np.minimum(raw / (1 + more), np.roll(raw, 18) / more)
    np.testing.assert_allclose(damped.within.largest[:36], expected, rtol=1e-6)


def test_text_files_and_json(tmp_path, capsys):
    folder = tmp_path / "drive"
    arguments = ["drive", str(TASK), "--directions", "8", "--out", str(folder), "--slope", "3"]
    assert main(arguments) == 0
    text = capsys.readouterr().out
    assert headline_of(text).endswith("uncertainty (default).")  # all that --quiet prints
    for part in (
        "DRIVE ENVELOPE, arm at rest",
        "brake downhill, 3 deg",
        "worst case",
        "max_decel -",
    ):
        assert part in text
    names = {path.name for path in folder.iterdir()}
    assert names == {"drive.json", "drive.csv", "drive.png", "nav2.yaml", "SHA256SUMS"}
    data = json.loads((folder / "drive.json").read_text(encoding="utf-8"))
    assert [one["direction_deg"] for one in data["directions"]] == pytest.approx([45.0 * k for k in range(8)])
    assert data["directions"][4]["within"]["largest"] == pytest.approx(
        data["manoeuvres"]["brake"]["within"]["largest"]
    )
    assert data["directions"][4]["nominal"]["tips_about_contacts"] == [1, 2]
    rows = list(csv.DictReader(io.StringIO((folder / "drive.csv").read_text(encoding="utf-8"))))
    assert len(rows) == 8 + len(data["manoeuvres"])
    assert float(rows[4]["within_largest"]) == data["directions"][4]["within"]["largest"]
    lines = (folder / "nav2.yaml").read_text(encoding="utf-8").splitlines()
    assert "overshoot by 85.4 %" in lines[3]
    assert " % of the limits of single manoeuvres: all hold at once" in lines[1]
    k = lines.index("velocity_smoother:")
    count = len(data["directions"])
    lifts = [one["within"]["first_contact_lifts_at"] for one in data["directions"]]
    least = int(np.argmin(lifts))
    told = next(line for line in lines[:k] if line.startswith("# first contact: lifts at "))
    assert 0 <= lifts[least] - float(told.split()[5]) < 1e-3
    assert f"at {360 / count * least:.0f} deg, worst case, if equally compliant" in told
    assert any(line.startswith("# start: posture 1 of ") for line in lines[:k])
    assert lines[k + 1] == "  ros__parameters:"
    given = [float(value) for value in lines[k + 4].split("[")[1].rstrip("]").split(",")]
    assert all(
        0 <= exact - shown < 1e-3 for exact, shown in zip(data["navigation"]["max_accel"], given, strict=True)
    )
    assert main([*arguments, "--json", "--no-figures", "--payload", "5", "--tolerance", "none"]) == 0
    heavier = json.loads(capsys.readouterr().out)
    assert heavier["payload"]["mass"] == 5.0
    assert "within" not in heavier["directions"][0]
    assert not np.isclose(
        heavier["directions"][0]["nominal"]["tips_at"], data["directions"][0]["nominal"]["tips_at"]
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    some(
        2,
        [
            (["--speed", "0"], "--speed: must be > 0"),
            (["--slope", "50"], "--slope: must be below 45 degrees, got 50 degrees"),
            (["--directions", "2"], "--directions: must be a whole number >= 4"),
            (["--payload", "-1"], "--payload: must be > 0"),
            (["--posture", "strat"], "did you mean 'start'?"),
        ],
    ),
)
def test_mistakes_are_named(tmp_path, capsys, arguments, message):
    assert main(["drive", str(TASK), *arguments, "--out", str(tmp_path / "x")]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_a_stow_pose_is_clear_of_collisions_and_better_than_what_was_drawn():
    few = {"uncertainty": "none", "samples": 150}
    start, found = (ocptip.drive(TASK, posture, **few) for posture in (None, "stow"))
    assert "in its stow pose" in found.name
    assert found.worst_direction[0] > 1.3 * start.worst_direction[0]
    search, limits = StowSearch(found.robot, Limits()), Limits()
    drawn = halton_postures(found.robot, limits, 150, 0)
    value = search.accelerations(found.q[None])[0]
    assert value > np.max(search.accelerations(drawn[search.free(drawn)]))
    assert found.robot.collision.least(found.q[None])[0] >= limits.clearance
    # The closed form is that of all directions; its friction cones are pyramids from inside.
    assert 0.98 * found.worst_direction[0] <= value <= found.worst_direction[0] * (1 + 1e-9)


def test_parallel_robots_are_refused():
    with pytest.raises(ocptip.InputError, match="drive envelopes are for arms"):
        ocptip.drive(EXAMPLES / "tasks/delta_cart.toml")


@pytest.mark.slow
def test_objects_on_the_deck_and_on_a_tray_limit_how_hard_the_base_drives():
    """A crate tips at half its width over the height of its centre, a glass on a level tray slides."""
    task = ocptip.load_task(EXAMPLES / "tasks/ur5_waiter.toml")
    crate = ocptip.Object.box(
        "crate", 3.0, (0.2, 0.2, 0.6), friction=0.5, on="base", position=(-0.1, 0.0, 0.75)
    )
    robot = task.robot.without_objects().carrying([*task.robot.objects[:1], crate])
    task = replace(task, robot=robot)
    found = ocptip.drive(task, uncertainty="none", directions=4)
    glass, box = found.objects.values()
    np.testing.assert_allclose(box.nominal.largest[:4], G * 0.1 / 0.3, rtol=1e-6)
    np.testing.assert_allclose(box.nominal.slip[:4], box.nominal.tip[:4])
    np.testing.assert_allclose(glass.nominal.largest[:4], 0.3 * G, rtol=1e-5)
    assert np.all(glass.nominal.slip[:4] < glass.nominal.tip[:4])
    assert found.limit("brake") == pytest.approx(min(0.3 * G, found.nominal.largest[5]), rel=1e-5)
    assert 0 < found.stop_deceleration < 0.8 * found.limit("brake")  # the base also turns
    assert found.worst_direction[0] <= 0.3 * G * (1 + 1e-6)
    assert -found.navigation["max_decel"][0] <= found.limit("brake")
    assert set(found.to_dict()["objects"]) == {"glass_left", "crate"}
    rows = list(csv.DictReader(io.StringIO(found.contents(figures=False)["drive.csv"].decode())))
    assert [row["object"] for row in rows[:: len(rows) // 3]] == ["", "glass_left", "crate"]
    last = [row for row in rows if row["object"] == "crate" and row["manoeuvre"] == "direction"]
    assert [float(row["nominal_largest"]) for row in last] == box.nominal.largest[:4].tolist()
    objects = {name: own.worst for name, own in found.objects.items()}
    figure = envelope_figure("", "", found.angles, found.nominal, None, np.eye(3), objects)
    drawn = {line.get_label(): line.get_ydata() for line in figure.axes[0].lines}
    np.testing.assert_allclose(drawn["glass_left tips or slides"], 0.3 * G, rtol=1e-5)
    text = DriveReport(found, None, False).to_text()
    assert re.search(r"^brake +m/s\^2 +2\.943 \(glass_left slides\)", text, re.MULTILINE)
    assert "objects, nominal" in text
    assert max(map(len, text.splitlines())) <= 80

    tolerance = ocptip.Uncertainty(friction=0.1, payload_mass=0.2)
    within = ocptip.drive(task, uncertainty=tolerance, directions=4).objects["glass_left"].within
    np.testing.assert_allclose(within.largest[:4], 0.9 * 0.3 * G, rtol=1e-5)
