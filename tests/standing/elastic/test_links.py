"""A link that bends is a joint more at its root, across it, with the link's stiffness and a drive that rests.

Compared with a beam of finite elements, which bends everywhere.
"""

import re

import numpy as np
import pytest
from scipy.linalg import eigh

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.robots.gears import Gears
from ocptip.robots.model import ArmModel, JointLimits
from ocptip.robots.motors import DCMotors
from ocptip.robots.payload import Payload
from ocptip.standing.arm import Robot
from ocptip.standing.elastic.drives import on_its_drives
from ocptip.standing.elastic.springs import Ride, Simulation
from ocptip.task_files.motion import load_task
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from tests.places import ROOT

LENGTH, EI, RATIO, G = 1.0, 400.0, 0.05, 9.81  # m, N m^2, damping, m/s^2: 8 mm sag under 3 kg
ELEMENTS = 12


def bending(mass, load):
    """A turning axis with a beam that bends sideways and downwards, and a load at its tip."""
    across = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # axis along y
    own, hub, stiff = mass * LENGTH**2 / 12, 1e-5 * np.eye(3), 3 * EI / LENGTH
    arm = ArmModel(
        "beam", ("turn", "sway", "sag"), np.array([np.eye(3), np.eye(3), across]),
        np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [LENGTH, 0.0, 0.0]]), np.array([0.1, 0.1, mass]),
        np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [LENGTH / 2, 0.0, 0.0]]),
        np.array([hub, hub, np.diag([1e-3, own, own])]), JointLimits.unlimited(3),
    ).with_gears(Gears([np.inf, stiff, stiff], damping_ratio=RATIO)).with_payload(Payload(load))  # fmt: skip
    corners = [(0.8, 0.8, 0), (-0.8, 0.8, 0), (-0.8, -0.8, 0), (0.8, -0.8, 0)]
    feet = [UnilateralContact(position=place, friction=0.8) for place in corners]
    motors = DCMotors(*(value * np.ones(3) for value in (1.0, 0.0, 0.0, 0.0)))
    return Robot(arm, Support(feet, mass=200.0, center_of_mass=(0, 0, 0.3)), motors)


def beam(mass, load):
    """Mass and stiffness matrix of an Euler-Bernoulli beam with clamped root, and its motion with the root.

    Deflections and slopes of the nodes behind the root.
    """
    size, count = LENGTH / ELEMENTS, 2 * ELEMENTS + 2
    M, K = np.zeros((count, count)), np.zeros((count, count))
    s = size
    stiffness = EI / s**3 * np.array(
        [[12, 6 * s, -12, 6 * s], [6 * s, 4 * s**2, -6 * s, 2 * s**2],
         [-12, -6 * s, 12, -6 * s], [6 * s, 2 * s**2, -6 * s, 4 * s**2]]
    )  # fmt: skip
    inertia = mass / ELEMENTS / 420 * np.array(
        [[156, 22 * s, 54, -13 * s], [22 * s, 4 * s**2, 13 * s, -3 * s**2],
         [54, 13 * s, 156, -22 * s], [-13 * s, -3 * s**2, -22 * s, 4 * s**2]]
    )  # fmt: skip
    for k in range(ELEMENTS):
        at = slice(2 * k, 2 * k + 4)
        M[at, at] += inertia
        K[at, at] += stiffness
    M[-2, -2] += load
    places = np.arange(1, ELEMENTS + 1) * size
    turned = np.column_stack([places, np.ones(ELEMENTS)]).ravel()
    return M[2:, 2:], K[2:, 2:], turned


def simulated(mass, load, motion, times):
    """Tip's distance (T,), m, from where the turning root would have it: modes of the beam, step by step."""
    M, K, turned = beam(mass, load)
    squares, shapes = eigh(M, K)  # largest first mode last: 1 / omega^2
    omegas, shapes = 1 / np.sqrt(squares[::-1][:4]), shapes[:, ::-1][:, :4]
    shapes = shapes / np.sqrt(np.einsum("ik,ij,jk->k", shapes, M, shapes))
    pushes = shapes.T @ M @ turned
    step = times[1] - times[0]
    alphas = motion.states(times[:-1] + step / 2)[2][:, 0]
    tips = np.zeros(len(times))
    for omega, push, tip in zip(omegas, pushes, shapes[-2], strict=True):
        zeta = RATIO * omega / omegas[0]
        damped = omega * np.sqrt(1 - zeta**2) if zeta < 1 else omega
        decay, c, s = np.exp(-zeta * omega * step), np.cos(damped * step), np.sin(damped * step)
        x = v = 0.0
        for i, alpha in enumerate(alphas):
            rest = -push * alpha / omega**2
            y = x - rest
            b = (v + zeta * omega * y) / damped
            x = rest + decay * (y * c + b * s)
            v = decay * ((b * damped - zeta * omega * y) * c - (y * damped + zeta * omega * b) * s)
            tips[i + 1] += tip * x
    return tips


RESTS = [RampCommand(0.0, 1.0, 1.0)]
MOTION = Trajectory.from_profiles([0.0, 0.0, 0.0], [[RampCommand(0.6, 1.2, 4.0)], RESTS, RESTS])


@pytest.mark.parametrize(
    ("mass", "load", "within"), [(0.01, 3.0, 0.002), (1.0, 3.0, 0.02), (2.0, 2.0, 0.045)]
)
def test_a_joint_at_the_root_is_the_first_bending_mode(mass, load, within):
    """Exact for a light beam; 4 % low in frequency where the beam is as heavy as its load."""
    robot = bending(mass, load)
    M, K, _ = beam(mass, load)
    first = np.sqrt(eigh(K, M, eigvals_only=True)[0]) / (2 * np.pi)
    found = on_its_drives(robot, MOTION)
    sway, sag = sorted(mode.least for mode in found.modes)[:2]
    assert sway == pytest.approx(first, rel=within)
    assert sag == pytest.approx(first, rel=within)


@pytest.mark.parametrize("hub", [0.0, 1e-5])
@pytest.mark.parametrize("thick", [0.0, 1e-3])
def test_points_and_thin_rods_bend_as_they_are(hub, thick):
    """No rotor is invented for a link without thickness: the frequency is that of a pendulum by hand."""
    robot, mass, load = bending(1.0, 3.0), 1.0, 3.0
    along = mass * LENGTH**2 / 12
    inertias = np.array([hub * np.eye(3), hub * np.eye(3), np.diag([thick, along, along])])
    bare = robot.arm.with_payload(None)
    arm = type(bare)(**{**vars(bare), "inertias": inertias})
    robot = robot.varied(arm=arm.with_payload(Payload(load)))
    about_root = mass * LENGTH**2 / 3 + load * LENGTH**2
    modes = sorted(mode.least for mode in on_its_drives(robot, MOTION).modes)
    sway_and_sag = np.sqrt(3 * EI / LENGTH / (about_root + np.array([hub, 0]))) / (2 * np.pi)
    assert modes == pytest.approx(sway_and_sag, rel=1e-8)


def test_the_file_of_the_docs_has_the_frequency_of_a_pendulum(tmp_path):
    page = (ROOT / "docs/how-to/elastic-joints.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"## Links that bend\n.*?```toml\n(.*?)```", page, flags=re.DOTALL)
    path = tmp_path / "task.toml"
    path.write_text(text, encoding="utf-8")
    (mode,) = on_its_drives(load_task(path).robot, MOTION).modes
    about_joint = 0.06 + 3.0 * 0.25**2 + 2.0 * 0.5**2  # kg m^2: the link and its load
    assert mode.least == pytest.approx(np.sqrt(2e4 / about_joint) / (2 * np.pi), rel=1e-6)
    light, parts = re.subn(r"mass = 0\.01 .*\ninertia = .*\n", "", text)
    assert parts == 1
    path.write_text(light.replace("[arm]", '[arm]\naccept_inertia = ["shoulder"]'), encoding="utf-8")
    with pytest.raises(InputError, match=r"motors: .* has no mass"):
        load_task(path)


@pytest.mark.parametrize(("mass", "load", "within"), [(0.01, 3.0, 0.005), (1.0, 3.0, 0.05)])
def test_a_motion_bends_it_as_a_beam(mass, load, within):
    robot = bending(mass, load)
    course = on_its_drives(robot, MOTION).course
    times = np.linspace(0.0, MOTION.end, 4001)
    theirs = simulated(mass, load, MOTION, times)
    ours = LENGTH * np.interp(times, course.times, course.bends[:, 0])
    assert np.max(np.abs(ours)) == pytest.approx(np.max(np.abs(theirs)), rel=within)
    assert np.sqrt(np.mean((ours - theirs) ** 2)) < 3 * within * np.max(np.abs(theirs))
    assert np.max(np.abs(theirs)) > 2e-3  # m


def test_a_load_sags_as_on_a_beam():
    robot = bending(0.01, 3.0)
    sags = Simulation(Ride(robot, MOTION), None, None).sags(np.zeros((1, 3)), np.zeros(1))[0, 6:]
    assert LENGTH * sags[1] == pytest.approx((3.0 + 0.01 * 3 / 8) * G * LENGTH**3 / (3 * EI), rel=2e-3)
    assert sags[0] == pytest.approx(0.0, abs=1e-9)
