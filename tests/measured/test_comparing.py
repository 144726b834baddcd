"""What is found in recordings, by name, and what is not found where nothing is."""

from dataclasses import replace

import numpy as np
import pytest

from ocptip.basics.errors import InputError, InputWarning
from ocptip.measured.compare import LEVEL, compare
from ocptip.measured.comparison import foot_forces
from ocptip.measured.contact_losses import ContactLoss
from ocptip.measured.prediction import Elasticity, Predictor
from ocptip.measured.recording import ANGLE, POWER, Recording, Signal, doubt_turns
from ocptip.measured.signals import clipped
from ocptip.robots.process import ProcessWrench
from ocptip.trajectories.trajectory import Trajectory
from tests.measured.machines import changed, heavier, predictor, recorded, values_of
from tests.quick import some


def names(found):
    return [one.name for one in found.findings]


@pytest.mark.parametrize("seed", some(1, range(3)))
def test_nothing_is_found_where_nothing_is(seed):
    found = compare(recorded(seed), predictor())
    assert found.agrees
    assert found.clock == pytest.approx(0.1234567, abs=2 * found.clock_error)
    assert found.clock_error < 1e-5
    assert found.energy is not None
    assert found.gripper is not None
    assert found.energy[0] == pytest.approx(found.energy[1], rel=1e-2)
    assert np.nanmax(found.gripper) < 2e-3
    assert {"gripper", "base", "shifts", "speeds"} == set(found.unrecorded)
    for one in found.signals:
        assert one.left == pytest.approx(one.rms, rel=0.05)


@pytest.mark.slow
def test_normal_forces_stand_beside_those_of_the_plan():
    """Of three rigid feet: force and moment balance of the base about them, by hand."""
    recording, base = recorded(0), predictor().robot.support
    state = predictor().state(recording.times - 0.1234567, np.zeros(6), np.zeros(25))
    wrench = predictor().robot.loads(state.q, state.qd, state.qdd)[
        1
    ]  # with the weight, about the base's centre
    rows = np.array([[1.0, arm[1], -arm[0]] for arm in base.arms]).T
    loads = -wrench[:, 2:5]
    heights = base.arms[0, 2]
    loads[:, 1] -= heights * wrench[:, 1]
    loads[:, 2] += heights * wrench[:, 0]
    expected = np.linalg.solve(rows, loads.T).T
    rng = np.random.default_rng(1)
    feet = [
        Signal(f"normal{k + 1}", "feet", k, expected[:, k] + 0.2 * rng.normal(size=len(expected)))
        for k in range(3)
    ]
    found = compare(replace(recording, signals=(*recording.signals, *feet)), predictor())
    assert found.agrees
    signals = {one.name: one for one in found.signals if one.kind == "feet"}
    assert list(signals) == ["normal1", "normal2", "normal3"]
    for k, one in enumerate(signals.values()):
        assert one.rms == pytest.approx(0.2, rel=0.1)
        np.testing.assert_allclose(one.predicted[100:-100], expected[100:-100, k], atol=0.3)
    strange = Signal("normal4", "feet", 3, expected[:, 0])
    with pytest.raises(InputError, match="normal4: the robot has 3 contacts"):
        foot_forces(
            replace(recording, signals=(strange,)), predictor(), state, recording.times, np.array(True)
        )


@pytest.mark.parametrize("link", some(1, [2, 1, 3, 5]))
def test_a_mass_is_found_with_its_size(link):
    found = compare(recorded(link, robot=heavier(link, 1.05)), predictor())
    (one,) = found.findings
    assert f"mass of link {link}" in (one.name, *one.rivals)
    if link > 1:  # the mass of the first one is a constant force, as a shifted signal is
        assert one.name == f"mass of link {link}"
        assert one.value == pytest.approx(5, abs=2 * one.interval)


def test_a_late_joint_is_found_and_does_not_look_like_masses():
    found = compare(recorded(0, delays={1: 4e-3}), predictor())
    assert names(found) == [f"delay of {predictor().robot.names[1]}"]
    assert found.findings[0].value == pytest.approx(4.0, abs=2 * found.findings[0].interval)


def test_a_late_sensor_is_found():
    found = compare(recorded(0, late={"sensor": 4e-3}), predictor())
    assert names(found) == ["delay of force-torque sensor"]
    assert found.findings[0].value == pytest.approx(4.0, abs=2 * found.findings[0].interval)


@pytest.mark.slow
def test_friction_elasticity_and_zeros_together():
    plan = predictor()
    springs = Elasticity(1e-4 * (np.arange(6) == 2), np.full(6, 0.08), np.full(6, True))
    recording = recorded(5, elastic=springs)
    state = plan.state(recording.times - 0.1234567, np.zeros(6), np.zeros(25))
    tau = values_of(recording, "tau2") + 2.0 * np.sign(state.qd[:, 1]) + 1.5 * state.qd[:, 1]
    torques = state.torques.copy()
    torques[:, 1] += 2.0 * np.sign(state.qd[:, 1]) + 1.5 * state.qd[:, 1]
    more = (plan.power(replace(state, torques=torques)) - plan.power(state)).sum(axis=1)
    recording = changed(recording, "power", values_of(recording, "power") + more)  # drives bear it
    recording = changed(recording, "tau2", tau)
    recording = changed(recording, "fx", values_of(recording, "fx") + 3.0)
    found = {one.name: one for one in compare(recording, plan).findings}
    joints = plan.robot.names
    expected = {
        f"Coulomb friction of {joints[1]}": 2.0,
        f"viscous friction of {joints[1]}": 1.5,
        f"elasticity of {joints[2]}": np.degrees(1e-4) * 1e3,
        "fx shifted": 3.0,
    }
    assert set(found) == set(expected)
    for name, value in expected.items():
        assert found[name].value == pytest.approx(value, abs=2 * found[name].interval), name


def test_a_plateau_that_is_expected_is_not_clipped():
    """The power of a drive at standby, without noise; beside a jump of it either side is expected."""
    predicted = np.where(np.arange(400) % 100 < 50, 5.0, 5.0 + np.arange(400) / 40)
    drive = Signal("power4", POWER, 4, np.roll(predicted, 1) + 1e-14)
    assert not clipped(drive, predicted, 1e-4).any()
    cut = replace(drive, values=np.minimum(predicted, 12.0))
    assert clipped(cut, predicted, 1e-4).sum() > 0.9 * (predicted > 12).sum() > 50


def test_angles_in_the_wrong_unit_are_warned_of():
    plan, recording = predictor(), recorded(0)
    wrong = [
        replace(one, values=np.radians(one.values)) if one.kind == ANGLE else one for one in recording.signals
    ]
    with pytest.warns(InputWarning, match=r"0\.017 times those of the plan; are they radians"):
        doubt_turns(replace(recording, signals=tuple(wrong)), plan.robot, plan.motion)
    doubt_turns(recording, plan.robot, plan.motion)


def test_signals_that_are_no_good_are_named():
    recording = recorded(7)
    force, tau = values_of(recording, "fy"), values_of(recording, "tau3")
    tau[100:180] = np.nan
    recording = changed(recording, "fy", np.clip(force, -np.inf, 0.8 * force.max()))
    recording = changed(recording, "tau3", tau)
    recording = changed(recording, "mx", np.zeros(len(tau)))
    without = Recording(recording.times, tuple(s for s in recording.signals if s.name != "q4"))
    found = {one.name: one.text for one in compare(without, predictor()).findings}
    assert set(found) == {"fy clipped", "tau3 missing", "mx dead", "q4 missing"}
    assert "80 of" in found["tau3 missing"]


def test_a_noisy_signal_is_named():
    recording, rng = recorded(7), np.random.default_rng(0)
    tau = values_of(recording, "tau3")
    noisy = changed(recording, "tau3", tau + rng.normal(size=len(tau)))
    assert names(compare(noisy, predictor())) == ["tau3 noisy"]


@pytest.mark.slow
def test_a_common_delay_is_one_of_the_clock_or_a_finding():
    recording = recorded(0, clock=0.004)
    assert compare(recording, predictor()).agrees
    found = compare(recording, predictor(), same_clock=True)
    assert names(found) == ["delay of all signals"]
    assert found.findings[0].value == pytest.approx(4.0, abs=2 * found.findings[0].interval)
    assert compare(recorded(0, clock=0.0), predictor(), same_clock=True).agrees


@pytest.mark.slow
def test_loads_alone_have_a_clock_too():
    recording = recorded(3, robot=heavier(3, 1.05))
    own = Recording(recording.times, tuple(s for s in recording.signals if s.kind == "sensor"))
    found = compare(own, predictor())
    assert found.clock == pytest.approx(0.1234567, abs=2e-4)
    assert "mass of link 3" in names(found) or "mass of link 3" in found.findings[0].rivals
    assert found.gripper is None
    assert found.energy is None


def test_a_base_that_moved_is_found():
    recording = recorded(1)
    contacts = np.array([c.position for c in predictor().robot.support.contacts])
    middle = contacts[:, :2].mean(axis=0)
    late = recording.times > 1.0
    angle, shift = 2e-3 * late, np.array([3e-4, -2e-4])
    rng = np.random.default_rng(2)
    signals = []
    for name, k, axis in (("dx3", 2, 0), ("dy3", 2, 1), ("dy2", 1, 1)):
        x, y = contacts[k, :2] - middle
        c, s = np.cos(angle), np.sin(angle)
        turned = np.stack([c * x - s * y - x, s * x + c * y - y])
        values = turned[axis] + shift[axis] * late + 1e-5 * rng.normal(size=len(late))
        signals.append(Signal(name, "shifts", 2 * k + axis, values))
    found = compare(Recording(recording.times, recording.signals + tuple(signals)), predictor())
    assert set(names(found)) == {"base shifted (x)", "base shifted (y)", "base turned (yaw)"}
    assert found.base is not None
    assert found.base.changes == pytest.approx([3e-4, -2e-4, 2e-3], abs=2e-5)
    still = [replace(s, values=1e-5 * rng.normal(size=len(late))) for s in signals]
    assert compare(Recording(recording.times, recording.signals + tuple(still)), predictor()).agrees


def test_a_contact_that_was_open_is_found_above_30_ms():
    losses = tuple(ContactLoss(k, 3, t, 0.9, 2 * t, True) for k, t in ((1, 0.029), (2, 0.045)))
    recording = replace(recorded(1), contact_losses=(*losses, ContactLoss(3, 1, 2.0, 0.0, 2.0, False)))
    found = compare(recording, predictor())
    assert names(found) == ["contact 2 lost", "contact 3 never closed"]
    assert found.findings[0].value == pytest.approx(45)
    assert found.contact_losses[1].at == pytest.approx(0.9 - found.clock)


@pytest.mark.slow
def test_a_process_that_varies_is_no_fault():
    """Its share in torques and sensor is that of a force at the TCP; left out it is found."""
    plan = predictor()
    force, moment = np.array([[0, 0, 0], [-9.0, 5.0, 12.0], [0, 0, 0]]), np.zeros((3, 3))
    process = ProcessWrench(force, moment, "base", "share", [0.2, 0.5, 0.9])
    robot = plan.robot.varied(arm=plan.robot.arm.with_process(process))
    own, times = Predictor(robot, plan.motion), np.linspace(-0.1, plan.motion.end + 0.1, 50)
    none = np.zeros(6), np.zeros(25)
    push = process.at(times / plan.motion.end)[0]
    with_it, without = own.state(times, *none), plan.state(times, *none)
    place, slopes = plan.gripper(without.q)
    own_torques = -np.einsum("nij,ni->nj", slopes, push)
    np.testing.assert_allclose(with_it.torques - without.torques, own_torques, atol=1e-9)
    sensor = plan.robot.sensor
    both = np.stack([push, np.cross(place - sensor.position, push)], axis=1) @ sensor.rotation
    np.testing.assert_allclose(with_it.wrenches - without.wrenches, both.reshape(-1, 6), atol=1e-9)
    recording = recorded(0, robot=robot)
    assert compare(recording, own).agrees
    assert not compare(recording, plan).agrees


@pytest.mark.slow
def test_points_are_no_jumps():
    """Accelerations jump a little at each point of a motion of points, which are nearer than samples."""
    plan = predictor()
    times = np.append(np.arange(0.0, plan.motion.end, 4e-3), plan.motion.end)
    q, qd, _ = plan.motion.states(times)
    qd[[0, -1]] = 0.0
    nominal = Predictor(plan.robot, Trajectory.from_points(times, q, qd))
    assert len(nominal.motion.event_times) > 100
    assert len(nominal.jumps) < 0.3 * len(nominal.motion.event_times)
    assert compare(recorded(0, nominal=nominal), nominal).agrees
    heavy = recorded(1, robot=heavier(3, 1.05), nominal=nominal)
    assert names(compare(heavy, nominal)) == ["mass of link 3"]


@pytest.mark.parametrize("every", [8, 80])
def test_too_few_samples_of_loads_are_refused(every):
    """Of 80 all are beside jumps; with 8 chance was taken for causes in one of three recordings."""
    recording = recorded(0)
    few = slice(None, None, every)
    signals = tuple(replace(s, values=s.values[few]) for s in recording.signals)
    with pytest.raises(InputError, match=r"away from acceleration steps are too few for .* causes"):
        compare(Recording(recording.times[few], signals), predictor())


def test_another_motion_is_refused():
    rng = np.random.default_rng(0)
    recording = recorded(0)
    walk = tuple(replace(s, values=rng.normal(size=len(s.values))) for s in recording.signals)
    with pytest.raises(InputError, match="no signal follows"):
        compare(Recording(recording.times, walk), predictor())


def test_the_level_is_one():
    with pytest.raises(InputError, match="level"):
        compare(recorded(0), predictor(), level=0.0)
    assert LEVEL == 1e-3
