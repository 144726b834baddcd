"""Largest payloads at rest: by hand, against `ocptip.stand` and Pinocchio one by one, and how they change."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import ocptip
from ocptip.api.inputs.postures import RestingPosture, rests_of
from ocptip.contact.support import Support
from ocptip.reserves.slip import Slip
from ocptip.robots.collision.gaps import random_postures
from ocptip.robots.payload import Payload
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.largest_level import largest_levels_kept
from ocptip.standing.at_rest.raised import RaisedPayload
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import NONE, PRESETS, Uncertainty
from ocptip.standing.within.torques import maximum_torques
from ocptip.task_files.cycle import read_task
from tests.places import EXAMPLES
from tests.quick import examples, some
from tests.robots.pinocchio_twin import dynamics, twin

GRAVITY = 9.81
URDF = """<robot name="crane"><link name="foot"><inertial><mass value="20"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="jib"><inertial><origin xyz="0.4 0 0"/><mass value="3"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="hook"/>
<joint name="slew" type="revolute"><parent link="foot"/><child link="jib"/><origin xyz="0 0 0.5"/>
<axis xyz="0 {y} {z}"/><limit lower="-3" upper="3" velocity="1" effort="60"/></joint>
<joint name="end" type="fixed"><parent link="jib"/><child link="hook"/><origin xyz="0.9 0 0"/></joint>
</robot>"""
FEET = np.array([[0.4, 0.0, 0.0], [-0.3, 0.3, 0.0], [-0.3, -0.3, 0.0]])


def crane(y, z):
    return Robot.from_urdf(URDF.format(y=y, z=z), contacts=FEET, friction=0.5, reference_moment=30.0)


@pytest.fixture(scope="module")
def kit():
    return rests_of(read_task(EXAMPLES / "tasks/kit_arm.toml", NONE))["start"]


def loaded(robot, mass):
    centre = np.zeros(3) if robot.payload is None else robot.payload.center_of_mass
    return robot.varied(arm=robot.arm.with_payload(Payload(mass, centre)))


def test_tipping_by_hand_with_one_slewing_joint():
    """Moments of all weights about each edge of the triangle keep M0 (1 / GN - 1)."""
    turns = np.linspace(-3, 3, 40)[:, None]
    found = largest_levels_kept(RaisedPayload(crane(0, 1)), Limits(GN=0.8), turns, 100.0)
    need = 30.0 * (1 / 0.8 - 1)
    for turn, mass, limit in zip(turns[:, 0], found.levels, found.limits, strict=True):
        out = np.array([np.cos(turn), np.sin(turn), 0.0])
        allowed = {"largest payload tried": 100.0}
        for i, j in ((0, 1), (0, 2), (1, 2)):
            edge = FEET[j] - FEET[i]
            inwards = np.array([-edge[1], edge[0], 0.0]) / np.linalg.norm(edge)
            inwards *= np.sign(inwards @ (FEET.mean(axis=0) - FEET[i]))
            dead = 20 * inwards @ (0 - FEET[i]) + 3 * inwards @ (0.4 * out - FEET[i])
            lever = inwards @ (0.9 * out - FEET[i])
            if lever < 0:
                allowed[f"tipping about contacts {i + 1} and {j + 1}"] = (dead - need / GRAVITY) / -lever
        assert mass == pytest.approx(min(allowed.values()), rel=1e-9)
        assert found.names[limit] == min(allowed, key=allowed.get)


def test_the_torque_by_hand_with_one_luffing_joint():
    turns = np.linspace(-1.5, 1.5, 21)[:, None]
    found = largest_levels_kept(RaisedPayload(crane(-1, 0)), Limits(GN=1.0, torque_ratio=0.5), turns, 1e3)
    by_torque = (0.5 * 60 / (GRAVITY * np.cos(turns[:, 0])) - 3 * 0.4) / 0.9
    own = [found.names[k] == "torque of slew" for k in found.limits]
    assert sum(own) > 5
    np.testing.assert_allclose(found.levels[own], by_torque[own], rtol=1e-9)
    assert (found.levels <= by_torque * (1 + 1e-9)).all()


@pytest.mark.slow
def test_torques_of_pinocchio_are_at_their_limits(kit):
    robot, _, limits = kit
    q = random_postures(robot.arm, 12)
    found = largest_levels_kept(RaisedPayload(robot), replace(limits, tolerance=NONE), q, 50.0)
    checked = 0
    for posture, mass, limit in zip(q, found.levels, found.limits, strict=True):
        if found.names[limit].startswith("torque"):
            arm, still = loaded(robot, mass).arm, np.zeros(robot.n)
            support, none = robot.support, np.zeros(3)
            load = dynamics(
                twin(arm), posture, still, still, support.gravity, none, none, support.center_of_mass
            )
            use = np.abs(load[0]) / robot.limits.torque
            assert use.max() == pytest.approx(limits.torque_ratio, rel=1e-9)
            assert found.names[limit] == f"torque of {robot.names[int(np.argmax(use))]}"
            checked += 1
    assert checked > 4


@pytest.mark.parametrize(
    ("name", "count"), some(1, [("none", 5), ("workshop", 3), ("none", 20), ("workshop", 20), ("site", 20)])
)
def test_limits_are_kept_just_below_and_broken_just_above(kit, name, count):
    """One by one with `ocptip.stand`, whose worst case is computed in another way."""
    robot, _, limits = kit
    if name == "site":  # of that the light tripod holds too little
        robot = robot.varied(support=heavier(robot.support, 6.0))
    limits = replace(limits, tolerance=PRESETS[name])
    q = random_postures(robot.arm, count)
    found = largest_levels_kept(RaisedPayload(robot), limits, q, 60.0)
    assert found.kept_at_zero.sum() > count // 2
    assert len(set(found.limits)) > 1
    for k in np.flatnonzero(found.kept_at_zero & (found.levels < 60.0)):
        uses = []
        for factor in (1 - 1e-6, 1 + 1e-6):
            own = loaded(robot, factor * found.levels[k])
            posture = RestingPosture.of("robot", "given", own, q[k], limits)
            state = ocptip.stand(posture, uncertainty=limits.tolerance)
            torques = np.abs(posture.instant.torques[0]) / robot.limits.torque
            use = [state.tip.GN[0] / limits.GN, state.slip.GT[0] / limits.GT, torques.max()]
            if state.within:
                use += [state.within.GN / limits.GN_worst_case, state.within.GT / limits.GT_worst_case]
                still, none = np.zeros((1, robot.n)), np.empty((1, 0))
                most = maximum_torques(own, limits.tolerance, q[k][None], still, still, none)
                use.append(np.max(most / robot.limits.torque))
            uses.append(max(use))
        assert uses[0] <= 1
        if found.names[found.limits[k]] == "friction":  # a share of the friction is not counted
            assert uses[1] > 0.97
        else:
            assert uses[1] > 1


def heavier(support, factor):
    return Support(
        support.contacts,
        mass=factor * support.mass,
        center_of_mass=support.center_of_mass,
        gravity=support.gravity,
    )


@pytest.mark.slow
@examples(10)
@given(lighter=st.floats(0.3, 0.98), tilt=st.floats(0.0, 0.05), share=st.floats(0.0, 0.1))
def test_a_lighter_base_never_holds_more(lighter, tilt, share):
    robot, _, limits = rests_of(read_task(EXAMPLES / "tasks/kit_arm.toml", NONE))["start"]
    limits = replace(limits, tolerance=Uncertainty(tilt=tilt, payload_mass=share, arm_mass=share))
    q = random_postures(robot.arm, 20)
    masses = [
        largest_levels_kept(
            RaisedPayload(robot.varied(support=heavier(robot.support, f))), limits, q, 50.0
        ).levels
        for f in (1.0, lighter)
    ]
    assert (masses[1] <= masses[0] + 1e-9).all()
    assert (masses[1] < masses[0] - 1e-6).any()


@pytest.mark.slow
def test_facets_of_the_friction_cone_are_near_what_bisection_finds(kit, monkeypatch):
    robot, _, limits = kit
    contacts = [replace(contact, friction=0.12) for contact in robot.support.contacts]
    robot = robot.varied(support=heavier(robot.support, 10.0).varied(contacts))
    limits = replace(limits, tolerance=Uncertainty(tilt=0.08, push=15.0, payload_mass=0.1))
    q = random_postures(robot.arm, 6)
    by_facets = largest_levels_kept(RaisedPayload(robot), limits, q, 8.0)
    monkeypatch.setattr(Slip, "half_spaces", lambda *_: None)
    exact = largest_levels_kept(RaisedPayload(robot), limits, q, 8.0)
    slips = [found.names[k] == "friction" for found in (by_facets, exact) for k in found.limits]
    assert any(slips)
    assert (by_facets.levels <= exact.levels + 1e-6).all()


def test_postures_that_break_a_limit_without_payload_hold_nothing():
    found = largest_levels_kept(RaisedPayload(crane(0, 1)), Limits(GN=0.12), np.array([[0.0], [1.0]]), 10.0)
    assert not found.kept_at_zero.any()
    assert (found.levels == 0).all()


def test_without_postures_there_is_nothing_to_hold():
    found = largest_levels_kept(RaisedPayload(crane(0, 1)), Limits(), np.empty((0, 1)), 10.0)
    assert len(found.levels) == 0
