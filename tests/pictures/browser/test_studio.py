"""The studio: its answers against `stand`, its page in process, and in a browser where there is one."""

import json

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

import ocptip
from ocptip.basics.errors import InputError
from ocptip.robots.base_motion import BaseMotion
from ocptip.robots.payload import Payload
from ocptip.robots.process import ProcessWrench
from ocptip.standing.at_rest.directions import tilted
from ocptip.standing.at_rest.load_cases import RestLoads, contact_test
from ocptip.standing.parts import Part
from ocptip.standing.tolerance import with_friction
from ocptip.trajectories.trajectory import Trajectory
from studies.pictures.browser import CHROMIUM, browser_page
from tests.places import EXAMPLES

pytest.importorskip("viser")
from ocptip.pictures.browser import sliders
from ocptip.pictures.browser.sliders import Actions
from ocptip.pictures.browser.studio import studio_page
from ocptip.pictures.browser.view import mover

TASK, CART = EXAMPLES / "tasks/kit_arm.toml", EXAMPLES / "tasks/ur5_cart.toml"


@pytest.fixture(scope="module")
def studio():
    return ocptip.studio(TASK)


def moment_of(found):
    return found.nearest_axis["moment_reserve"]


@pytest.mark.parametrize("payload", [0.0, 2.5])
def test_margins_and_torques_are_those_of_stand(studio, payload):
    """The payload, the push and the tilt are part of the robot there, not terms of a sum."""
    robot = studio.task.robot
    q, down = studio.conditions.q + 0.1, robot.support.gravity
    push, tilt = np.array([0.0, 8.0, 0.0]), np.radians(1.5)
    held = Payload(payload, robot.payload.center_of_mass) if payload else None
    arm = robot.arm.with_payload(held).with_process(ProcessWrench(push, np.zeros(3), "base"))
    support = robot.support.varied(
        with_friction(robot.support.contacts, 0.8), gravity=tilted(down, np.array([1.0, 0, 0]), tilt)
    )
    other = robot.varied(arm=arm, support=support, reference_moment=robot.tip_over.reference_moment)
    expected = ocptip.stand(other, q, uncertainty="none")
    found = studio.answer(q=q, payload=payload, friction=0.8, tilt=tilt, push=8.0, towards=np.pi / 2)
    assert found.margins.tipping_moment == pytest.approx(moment_of(expected), rel=1e-9)
    assert float(found.margins.GT) == pytest.approx(expected.slip.GT[0], rel=1e-6)
    assert found.stable == expected.stable
    assert found.margins.normal_forces == pytest.approx(expected.normal_forces, rel=1e-9)
    torques = expected.posture.instant.torques[0]
    assert found.torque_used == pytest.approx(np.abs(torques) / robot.limits.torque, rel=1e-9)


def test_the_worst_case_is_that_of_stand(studio):
    """With a payload, a push, less friction and a tilted floor; of an accelerated base nearly."""
    robot = studio.task.robot
    q, down, push, tilt = studio.conditions.q, robot.support.gravity, np.array([0.0, 5.0, 0.0]), 0.02
    arm = robot.arm.with_payload(Payload(1.5, robot.payload.center_of_mass if robot.payload else np.zeros(3)))
    support = robot.support.varied(
        with_friction(robot.support.contacts, 0.8), gravity=tilted(down, np.array([1.0, 0, 0]), tilt)
    )
    other = robot.varied(
        arm=arm.with_process(ProcessWrench(push, np.zeros(3), "base")),
        support=support,
        reference_moment=robot.tip_over.reference_moment,
    )
    expected = ocptip.stand(other, q, uncertainty="workshop").within
    assert studio.study.limits.tolerance.given
    found = studio.worst(payload=1.5, friction=0.8, tilt=tilt, push=5.0, towards=np.pi / 2)
    margin = expected.tipping_margin(robot.tip_over.reference_moment)
    assert found.tipping_moment == pytest.approx(margin, rel=1e-9)
    assert pytest.approx(expected.GT, rel=1e-6) == found.GT
    assert found.tipping_moment < studio.answer(payload=1.5, friction=0.8, tilt=tilt).margins.tipping_moment
    motion = BaseMotion((0.4, -0.3, 0.0))
    moving = ocptip.stand(studio.task, "start", uncertainty="workshop", base_motion=motion).within
    expected = moving.tipping_margin(robot.tip_over.reference_moment)
    assert studio.worst(acceleration=(0.4, -0.3)).tipping_moment == pytest.approx(expected, rel=1e-3)


def test_an_accelerated_base_is_that_of_stand(studio):
    motion = BaseMotion((0.4, -0.3, 0.0))
    expected = ocptip.stand(studio.task, "start", uncertainty="none", base_motion=motion)
    found = studio.answer(acceleration=(0.4, -0.3))
    assert found.margins.tipping_moment == pytest.approx(moment_of(expected), rel=1e-9)


@pytest.mark.slow
def test_robustness_is_where_contacts_are_lost(studio):
    """Beyond each value a contact is lost, or a drive overloaded; below it none is."""
    found = studio.robustness()
    most = studio.answer(payload=found.held).torque_used.max()
    assert most == pytest.approx(studio.task.limits.torque_ratio)
    for share in (0.99, 1.01):
        assert studio.answer(payload=share * found.payload).stable == (share < 1)
        tilts = [
            studio.answer(tilt=share * found.tilt, downhill=2 * np.pi * k / 24).stable for k in range(24)
        ]
        assert all(tilts) == (share < 1)


def test_no_push_in_any_direction_loses_a_contact_below_the_reported_one(studio):
    robot, push = studio.task.robot, studio.robustness().push
    sides = np.random.default_rng(5).normal(size=(1000, 3))
    sides /= np.linalg.norm(sides, axis=1)[:, None]
    loads, keeps = RestLoads(robot, studio.conditions.q[None]), contact_test(robot)
    weight = loads.wrenches(robot.support.gravity)
    per_newton = np.hstack([sides, np.cross(loads.tool, sides)])
    assert keeps(weight + 0.995 * push * per_newton).all()
    assert not keeps(weight + 1.02 * push * per_newton).all()


def test_a_posture_for_the_tcp(studio):
    start = studio.conditions.q
    (place, turn), aside = studio.study.tcp(start), np.array([0.01, 0.0, 0.0])
    q, turned = studio.study.posture(place + aside, near=start)
    assert turned == 0
    assert np.allclose(studio.study.tcp(q)[0], place + aside, atol=1e-4)
    if studio.study.robot.n >= 6:
        assert np.allclose(studio.study.tcp(q)[1], turn, atol=1e-3)
    with pytest.raises(InputError, match="cannot be reached"):
        studio.study.posture(place + 900 * aside, near=start)


def test_where_the_orientation_cannot_be_kept_the_tcp_turns():
    study, start = ocptip.studio(CART).study, ocptip.studio(CART).conditions.q
    far = np.array([0.8, 0.0, study.tcp(start)[0][2]])
    q, turned = study.posture(far, near=start)
    place, rotation = study.tcp(q)
    assert np.allclose(place, far, atol=1e-4)
    assert turned == pytest.approx(Rotation.from_matrix(rotation.T @ study.tcp(start)[1]).magnitude())
    assert turned > 0.1


def test_poses_are_kept_and_saved(tmp_path):
    studio = ocptip.studio(TASK)
    goal = studio.task.goal + 0.05
    studio.keep("goal", goal)
    path = studio.save(tmp_path / "here")
    found = ocptip.load_task(path)
    assert np.allclose(found.goal, goal)
    assert np.allclose(found.start, studio.task.start)
    assert found.robot.mass == pytest.approx(studio.task.robot.mass)
    case = ocptip.studio("A")
    with pytest.raises(InputError, match="published case"):
        case.save(tmp_path / "there")


@pytest.mark.parametrize(
    ("changes", "said"),
    [({"weight": 1.0}, "no such condition"), ({"payload": -1.0}, "payload"), ({"tilt": np.nan}, "finite")],
)
def test_bad_conditions(studio, changes, said):
    with pytest.raises(InputError, match=said):
        studio.answer(**changes)


@pytest.fixture
def page(studio):
    ends = {"start": studio.task.start, "goal": studio.task.goal}
    actions = Actions(lambda which, q: f"{which} saved", lambda: ("", ()))
    with studio_page("arm", studio.study, studio.conditions, ends, actions) as found:
        assert found.idle.wait(60)
        yield found


@pytest.mark.slow
def test_sliders_of_the_page(studio, page):
    page.sliders["payload"].value = 2.0
    assert page.idle.wait(60)
    expected = studio.answer(payload=2.0)
    assert page.answered.margins.tipping_moment == pytest.approx(expected.margins.tipping_moment, rel=1e-9)
    assert dict(expected.lines)["tipping margin"] in page.verdict.content
    assert "further push" in page.robust.content
    worst = dict(studio.worst(payload=2.0).lines)
    assert worst["tipping margin"] in page.worst.content
    assert worst["tipping margin"] != dict(expected.lines)["tipping margin"]
    before = page.answered.conditions.q
    page.sliders["tcp_z"].value = page.sliders["tcp_z"].max
    page.idle.clear()
    assert page.idle.wait(60)
    assert "cannot be reached" in page.message.content
    assert np.allclose(page.answered.conditions.q, before)
    page.set_posture(studio.task.goal)
    assert page.idle.wait(60)
    assert np.allclose(page.answered.conditions.q, studio.task.goal)
    assert "cannot be reached" not in page.message.content


@pytest.mark.slow
def test_a_second_plan_plays_beside_the_first(studio, monkeypatch):
    """The second one as the arm of the page, the first as a ghost, until both have ended."""
    robot, start = studio.study.robot, studio.task.start
    limits, goals, frames = (robot.limits.speed, robot.limits.acceleration), [0.02, 0.01], []

    def planned():
        goal = start + goals.pop(0)
        motion = Trajectory.ending_together(start, goal, [None] * len(start), *limits)
        return "planned", (Part(robot, motion),)

    def counted(scene, root, act, size, ghost):
        show = mover(scene, root, act, size, ghost)
        return lambda k: (frames.append(act.seen.angles[k]), show(k))

    monkeypatch.setattr(sliders, "mover", counted)
    ends = {"start": start, "goal": studio.task.goal}
    with studio_page("arm", studio.study, studio.conditions, ends, Actions(lambda *_: "", planned)) as page:
        assert page.idle.wait(60)
        page.plan()
        page.play()
        assert frames == []
        page.plan()
        page.play()
        assert page.idle.wait(60)
        assert "tipping margin" in page.verdict.content
    assert np.allclose(frames[0], start)
    assert np.allclose(frames[-1], start + 0.02)


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium")
def test_a_person_types_and_drags_a_payload(studio, page, tmp_path):
    """The margins of what was typed, or dragged with the mouse, can be read; a push tips the base."""
    with browser_page(f"http://localhost:{page.server.get_port()}") as shown:
        shown.wait_for("document.body.innerText.includes('payload, contacts')")
        for payload, word in ((2.0, "STABLE"), (0.5, "STABLE")):
            shown.enter("payload [kg]", payload)
            margin = dict(studio.answer(payload=payload).lines)["tipping margin"]
            shown.wait_for(f"document.body.innerText.includes('{margin}')")
            assert word in shown.text()
        before = shown.text()
        shown.drag("payload [kg]", 0.8)
        shown.wait_for(f"document.body.innerText !== {json.dumps(before)}")
        assert page.idle.wait(60)
        payload = page.sliders["payload"].value
        assert 0.6 * page.sliders["payload"].max < payload <= page.sliders["payload"].max
        margin = dict(studio.answer(payload=payload).lines)["tipping margin"]
        shown.wait_for(f"document.body.innerText.includes('{margin}')")
        shown.picture(tmp_path / "studio.png")
        with Image.open(tmp_path / "studio.png") as picture:
            assert len(picture.convert("RGB").getcolors(1 << 20)) > 100
        shown.enter("payload [kg]", 0.5)
        shown.enter("push at the TCP [N]", 200)
        shown.wait_for("document.body.innerText.includes('TIPS')")
        assert not shown.errors
