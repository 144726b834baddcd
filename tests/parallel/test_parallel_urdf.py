"""Parallel robots out of URDF trees with cut joints, against Pinocchio and the robots they came from."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

from ocptip.basics.errors import InputError
from ocptip.parallel.description.frames import PlatformCoordinates
from ocptip.parallel.description.ready_made import READY_MADE, delta, rpr3, rrr3, ups6
from ocptip.parallel.export import to_urdf
from ocptip.parallel.kinematics.closed_form import leg_type
from ocptip.parallel.kinematics.closures import LegClosure
from ocptip.parallel.robot import ParallelRobot
from tests.oracles.parallel_routes.tree import leg_newton_euler
from tests.oracles.parallel_urdf.legs import Cut
from tests.oracles.parallel_urdf.reader import convert_parallel_urdf, urdf_cuts, urdf_home
from tests.parallel.parallel_examples import five_axes, redundant_leg
from tests.parallel.parallel_twin import relative
from tests.quick import some


def motor_names(description):
    return [f"leg{leg + 1}_joint{joint + 1}" for leg, joint in description.actuated]


def read_back(description, folder, text=None, **changes):
    """Write a robot as URDF and read it again."""
    path = folder / "robot.urdf"
    path.write_text(to_urdf(description) if text is None else text)
    options = {
        "platform": "platform",
        "cuts": urdf_cuts(description),
        "actuated": motor_names(description),
        "home": urdf_home(description),
        "gravity": description.gravity,
    }
    return convert_parallel_urdf(path, **{**options, **changes})


def states(description, count=3, seed=0):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        z = description.home + rng.uniform(-0.03, 0.03, description.m)
        yield z, rng.uniform(-1, 1, description.m), rng.uniform(-5, 5, description.m)


def assert_same_forces(description, other, tolerance=1e-9):
    robots = ParallelRobot(description), ParallelRobot(other)
    for z, zd, zdd in states(description):
        forces = [robot.inverse_dynamics(z, zd, zdd).motors for robot in robots]
        assert relative(forces[1], forces[0]) < tolerance


@pytest.mark.parametrize("name", some(2, list(READY_MADE)))
def test_exported_robots_come_back(name, tmp_path):
    """The same rows, so the same closed forms and generated code; the same joint positions and forces."""
    robot = READY_MADE[name]()
    found = read_back(robot, tmp_path)
    again = found.description
    assert again.platform.mask == robot.platform.mask
    assert again.actuated == robot.actuated
    assert [leg_type(leg) for leg in again.legs] == [leg_type(leg) for leg in robot.legs]
    assert again.coupling_form
    np.testing.assert_allclose(again.home, robot.home, atol=1e-12)
    assert_same_forces(robot, again)
    q, q_again = (ParallelRobot(one).ik(robot.home).q for one in (robot, again))
    np.testing.assert_allclose(np.concatenate(q_again), np.concatenate(q), atol=1e-10)
    assert found.joints[1][0] == "leg2_joint1"


@pytest.mark.parametrize(
    ("make", "options"),
    [
        (
            lambda: five_axes(coupling_mass=True),
            {"free": ("x", "y", "z", "phi1", "phi2"), "convention": "zyx"},
        ),
        (redundant_leg, {"redundant": ["leg1_joint1"]}),
    ],
)
def test_general_robots_come_back(make, options, tmp_path):
    """Two rotations have to be named; coupling bodies with mass; a redundant joint."""
    robot = make()
    again = read_back(robot, tmp_path, **options).description
    np.testing.assert_allclose(again.home, robot.home, atol=1e-12)
    assert_same_forces(robot, again)


def test_tilting_platforms_need_their_coordinates_named(tmp_path):
    with pytest.raises(InputError, match=r"free: the platform has 5 degrees .* name the free ones"):
        read_back(five_axes(), tmp_path)


# --- random trees --------------------------------------------------------------------------------


def random_tree(rng, legs=3, joints=6):
    """URDF text of a robot whose legs close in a random home pose, the cuts, and the home positions."""
    root = ET.Element("robot", name="random")
    ET.SubElement(root, "link", name="base")
    home = {}
    for i in range(legs):
        before = "base"
        for k in range(joints):
            link = f"l{i}_{k}"
            _link(root, link, rng)
            home[f"j{i}_{k}"] = rng.uniform(-1, 1)
            _joint(root, f"j{i}_{k}", before, link, rng)
            before = link
            if rng.random() < 0.3:
                before = f"{link}_extra"
                _link(root, before, rng)
                _joint(root, f"f{i}_{k}", link, before, rng, kind="fixed")
        _link(root, f"end{i}", rng)
        _joint(root, f"e{i}", before, f"end{i}", rng, kind="fixed")
    model = pin.buildModelFromXML(ET.tostring(root, encoding="unicode"))
    q = configuration(model, home)
    for i in range(1, legs):
        at = link_frame(model, q, "end0").inverse() * link_frame(model, q, f"end{i}")
        ET.SubElement(root, "link", name=f"on{i}")
        _joint(root, f"p{i}", "end0", f"on{i}", rng, kind="fixed", at=at)
    return ET.tostring(root, encoding="unicode"), [(f"end{i}", f"on{i}") for i in range(1, legs)], home


def _link(root, name, rng):
    link = ET.SubElement(root, "link", name=name)
    if rng.random() < 0.3:
        return
    made = ET.SubElement(link, "inertial")
    ET.SubElement(made, "origin", xyz=_text(rng.uniform(-1, 1, 3)), rpy=_text(rng.uniform(-1, 1, 3)))
    ET.SubElement(made, "mass", value=repr(rng.uniform(0.5, 2)))
    ixx, iyy, izz = rng.uniform(1.0, 1.9, 3)
    ET.SubElement(
        made, "inertia", ixx=repr(ixx), iyy=repr(iyy), izz=repr(izz), ixy="0.1", ixz="-0.2", iyz="0.05"
    )


def _joint(root, name, parent, child, rng, kind=None, at=None):
    """A random joint; every other one special: axes that are parallel, coincide or intersect."""
    kind = kind or rng.choice(["revolute", "continuous", "prismatic"], p=[0.5, 0.3, 0.2])
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    xyz = rng.uniform(-0.5, 0.5, 3) * (rng.random() > 0.3)
    rpy = rng.uniform(-3, 3, 3) * (rng.random() > 0.4)
    axis = rng.choice([-1.0, 0.0, 1.0], 3) if rng.random() < 0.5 else rng.uniform(-1, 1, 3)
    axis = axis if axis.any() else np.array([0.0, 0.0, -1.0])
    if at is not None:
        xyz, rpy = at.translation, pin.rpy.matrixToRpy(at.rotation)
    ET.SubElement(joint, "origin", xyz=_text(xyz), rpy=_text(rpy))
    ET.SubElement(joint, "axis", xyz=_text(axis / np.linalg.norm(axis)))
    if kind in ("revolute", "prismatic"):
        ET.SubElement(joint, "limit", lower="-9", upper="9", effort="9", velocity="9")


def _text(values):
    return " ".join(repr(float(v)) for v in values)


def configuration(model, values):
    """Pinocchio's joint positions from those by name."""
    q = pin.neutral(model)
    for name, value in values.items():
        joint = model.joints[model.getJointId(name)]
        q[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else [np.cos(value), np.sin(value)]
    return q


def link_frame(model, q, name):
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[model.getFrameId(name, pin.FrameType.BODY)]


@pytest.mark.parametrize("seed", some(1, range(8)))
def test_links_are_where_pinocchio_has_them(seed, tmp_path):
    rng = np.random.default_rng(seed)
    text, cuts, home = random_tree(rng)
    path = tmp_path / "tree.urdf"
    path.write_text(text)
    coordinates = ("x", "y", "z", "phi1", "phi2", "phi3")
    found = convert_parallel_urdf(
        path, platform="end0", cuts=cuts, actuated=["j0_0", "j2_1"], home=home, free=coordinates
    )
    legs = [LegClosure(i, leg) for i, leg in enumerate(found.description.legs)]
    r, R = PlatformCoordinates(found.description.platform).pose(found.description.home)
    for leg in legs:
        assert np.abs(leg.residual(np.array(leg.leg.guess), r, R)).max() < 1e-12
    model = pin.buildModelFromUrdf(str(path))
    for _ in range(3):
        values = {name: rng.uniform(-3, 3) for names in found.joints for name in names}
        q = configuration(model, values)
        frames = [
            leg.frames(np.array([values[name] for name in names]))
            for leg, names in zip(legs, found.joints, strict=True)
        ]
        for name, place in found.links.items():
            R, p = np.eye(3), np.zeros(3)
            if place.leg >= 0:
                R, p = frames[place.leg][0][place.row], frames[place.leg][1][place.row]
            expected = link_frame(model, q, name)
            np.testing.assert_allclose(R @ place.rotation, expected.rotation, atol=1e-12)
            np.testing.assert_allclose(p + R @ place.position, expected.translation, atol=1e-12)
        _compare_forces(found, legs, model, q, values, rng)


def _compare_forces(found, legs, model, q, values, rng):
    """Joint forces of the tree by Pinocchio and by leg; bodies on the platform's side of cuts are welded."""
    rates = {name: rng.uniform(-1, 1, 2) for name in values}
    v, a = np.zeros((2, model.nv))
    for name, (rate, acceleration) in rates.items():
        at = model.joints[model.getJointId(name)].idx_v
        v[at], a[at] = rate, acceleration
    torque = pin.rnea(model, model.createData(), q, v, a)
    for i, (leg, names) in enumerate(zip(legs, found.joints, strict=True)):
        position, state = np.array([values[n] for n in names]), np.array([rates[n] for n in names]).T
        last = names[-1]
        ours = leg_newton_euler(leg, position, *state, found.description.gravity)
        theirs = torque - _without(model, last, q, v, a)
        expected = [theirs[model.joints[model.getJointId(n)].idx_v] for n in names]
        assert relative(ours, expected) < 1e-11, i


def _without(model, joint, q, v, a):
    """The part of the forces that the body behind one joint, which is the platform's now, needs."""
    lone = model.copy()
    for k in range(lone.njoints):
        if lone.names[k] != joint:
            lone.inertias[k] = pin.Inertia.Zero()
    return pin.rnea(lone, lone.createData(), q, v, a)


@pytest.mark.slow
def test_platform_gets_all_that_is_rigid_with_it(tmp_path):
    """Mass and centre of mass of a random tree in its home pose."""
    text, cuts, home = random_tree(np.random.default_rng(3))
    path = tmp_path / "tree.urdf"
    path.write_text(text)
    found = convert_parallel_urdf(
        path,
        platform="end0",
        cuts=cuts,
        actuated=["j0_0"],
        home=home,
        free=("x", "y", "z", "phi1", "phi2", "phi3"),
    )
    model = pin.buildModelFromUrdf(str(path))
    q = configuration(model, home)
    data = model.createData()
    center = pin.centerOfMass(model, data, q)
    moment = np.zeros(3)
    mass = found.description.platform.inertia.mass
    R, p = link_frame(model, q, "end0").rotation, link_frame(model, q, "end0").translation
    moment += mass * p + R @ found.description.platform.inertia.first_moment
    for i, leg in enumerate(found.description.legs):
        closure = LegClosure(i, leg)
        rotations, origins = closure.frames(np.array([home[name] for name in found.joints[i]]))
        for body, turn, origin in zip(leg.bodies, rotations, origins, strict=False):
            mass += body.mass
            moment += body.mass * origin + turn @ body.first_moment
    assert mass == pytest.approx(data.mass[0], rel=1e-13)
    np.testing.assert_allclose(moment / mass, center, atol=1e-12)


# --- cut joints ----------------------------------------------------------------------------------


def shortened(description, leg, count, at):
    """URDF of a robot whose leg (from 1) ends before its coupling joints, in a frame `tip`."""
    root = ET.fromstring(to_urdf(description))
    gone = {f"leg{leg}_link{k}" for k in range(count + 1, len(description.legs[leg - 1].rows) + 1)}
    for element in list(root):
        child = element.find("child")
        if element.get("name") in gone or (child is not None and child.get("link") in gone):
            root.remove(element)
    ET.SubElement(root, "link", name="tip")
    joint = ET.SubElement(root, "joint", name="tip_mount", type="fixed")
    ET.SubElement(joint, "parent", link=f"leg{leg}_link{count}")
    ET.SubElement(joint, "child", link="tip")
    ET.SubElement(joint, "origin", xyz=_text(at), rpy="0 0 0")
    return ET.tostring(root, encoding="unicode")


@pytest.mark.parametrize(
    ("make", "count", "at", "kind"),
    some(
        1,
        [
            (rrr3, 2, (0.6, 0, 0), "revolute"),
            (delta, 3, (0.5, 0, 0), "universal"),
            (ups6, 3, (0, 0, 0), "spherical"),
        ],
    ),
)
def test_kinds_of_cuts(make, count, at, kind, tmp_path):
    robot = make()
    text = shortened(robot, 2, count, at)
    home = {n: v for n, v in urdf_home(robot).items() if f'name="{n}"' in text}
    cuts = [Cut("tip", "platform_leg2", kind), *urdf_cuts(robot)[1:]]
    found = read_back(robot, tmp_path, text, cuts=cuts, home=home)
    assert found.joints[1][-1] == f"cut1 {kind} {len(found.joints[1]) - count}"
    assert found.description.platform.mask == robot.platform.mask
    assert found.description.coupling_form
    assert_same_forces(robot, found.description)


def test_raised_and_turned_platform_links(tmp_path):
    """A planar robot above z = 0 with an oblique platform link: the platform frame moves in the platform."""
    robot = rrr3()
    root = ET.fromstring(to_urdf(robot))
    for mount in root.iter("joint"):
        if mount.find("parent").get("link") == "base":
            x, y, _ = mount.find("origin").get("xyz").split()
            mount.find("origin").set("xyz", f"{x} {y} 0.25")
        if mount.get("name") == "platform_mount":
            mount.find("child").set("link", "plate")
    ET.SubElement(root, "link", name="plate")
    joint = ET.SubElement(root, "joint", name="oblique", type="fixed")
    ET.SubElement(joint, "parent", link="plate")
    ET.SubElement(joint, "child", link="tilted")
    ET.SubElement(joint, "origin", xyz="0 0 0.1", rpy="0.3 -0.2 0.1")
    ET.SubElement(root, "link", name="tilted")
    for link in root.iter("parent"):
        if link.get("link") == "platform":
            link.set("link", "plate")
    # The inertia goes to the new link, too.
    old = next(link for link in root.iter("link") if link.get("name") == "platform")
    new = next(link for link in root.iter("link") if link.get("name") == "plate")
    new.append(old.find("inertial"))
    root.remove(old)
    found = read_back(robot, tmp_path, ET.tostring(root, encoding="unicode"), platform="tilted")
    again = found.description
    assert again.platform.coordinates == ("x", "y", "phi3")
    R, p = found.platform
    turn = pin.rpy.rpyToMatrix(0.3, -0.2, 0.1)
    np.testing.assert_allclose(R, turn.T, atol=1e-12)
    np.testing.assert_allclose(turn @ p, [0, 0, -0.35], atol=1e-12)
    assert_same_forces(robot, again)


def test_few_digits(tmp_path):
    """Right angles with four decimals: a planar robot moves only with a coarser `snap`."""
    robot = rpr3()
    text = to_urdf(robot).replace("1.5707963267948966", "1.5708")
    assert text.count("1.5708") >= 6
    found = read_back(robot, tmp_path, text, snap=1e-5).description
    assert [leg_type(leg) for leg in found.legs] == ["RPR"] * 3
    assert_same_forces(robot, found, 1e-4)
    with pytest.raises(InputError, match=r"does not reach it|mobility"):
        ParallelRobot(read_back(robot, tmp_path, text, free=("x", "y", "phi3")).description)


def test_friction_and_names(tmp_path):
    text = to_urdf(rrr3()).replace(
        '<axis xyz="0 0 1" />', '<axis xyz="0 0 1" /><dynamics damping="0.3" friction="0.2" />', 1
    )
    found = read_back(rrr3(), tmp_path, text, name="mine", free=("x", "y", "phi3"))
    assert found.description.name == "mine"
    assert found.description.legs[0].viscous == (0.3, 0.0, 0.0)
    assert found.description.legs[0].coulomb == (0.2, 0.0, 0.0)
    assert found.links["base"].leg == -1


def test_gap_in_mm(tmp_path):
    home = urdf_home(rrr3())
    home["leg2_joint1"] += 0.01
    with pytest.raises(InputError, match="convention: must be one of"):
        read_back(rrr3(), tmp_path, convention="xxy")
    with pytest.raises(InputError, match=r"cuts\[1\].* are 7 mm and 0.573 deg apart"):
        read_back(rrr3(), tmp_path, home=home)


def test_small_gaps_are_closed(tmp_path):
    home = {name: round(value, 5) for name, value in urdf_home(ups6()).items()}
    found = read_back(ups6(), tmp_path, home=home)
    assert np.abs(found.description.home - ups6().home).max() < 1e-4
    assert ParallelRobot(found.description).ik(found.description.home).residual < 1e-13
