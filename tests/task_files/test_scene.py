"""Scene files: what they mean, and that every mistake in one is named in one line."""

from __future__ import annotations

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.binding import Binding
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve
from ocptip.contact.support import Load, Support
from ocptip.task_files.scene import read_scene

SCENE = """\
gravity = [0, 0, -9.81]
[base]
mass = 60.0
center_of_mass = [0, 0, 0.6]
[[contact]]
kind = "unilateral"
position = [0.35, 0, 0]
normal = [0, 0, 1]
friction = 0.5
facets = 8
[[contact]]
kind = "unilateral"
position = [-0.2, 0.3, 0]
friction = 0.6
[[contact]]
kind = "force-constant-half-rigid-clamp"
position = [-0.2, -0.3, 0]
friction_upper = 0.2
friction_lower = 0.3
clamp_force = 29.33
[[load]]
force = [100, 0, 0]
moment = [1, 2, 3]
point = [0, 0, 1.0]
[[load]]
moment = [0, 0, -3]
"""

PLANAR = """\
[base]
mass = 20
center_of_mass = [0.1, 0.4]
[[contact]]
kind = "unilateral"
position = [-0.3, 0]
friction = 0.5
[[contact]]
kind = "unilateral"
position = [0.35, 0]
friction = 0.5
[[load]]
force = [10, 0]
point = [0, 1.0]
[[load]]
moment = -12
"""


def read(tmp_path, text):
    path = tmp_path / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return read_scene(path)


def test_a_wrong_friction_is_named_where_it_stands(tmp_path):
    short = SCENE.replace("friction = 0.6\n", "").replace("mass = 60.0", "mass = 60.0\nfriction = -0.6")
    with pytest.raises(InputError, match=r": base\.friction: must be >= 0, got -0\.6$"):
        read(tmp_path, short)
    both = SCENE.replace("mass = 60.0", "mass = 60.0\nfriction = 0.4").replace(
        "friction = 0.6", "friction = -1"
    )
    with pytest.raises(InputError, match=r": contact\[2\]\.friction: must be >= 0, got -1$"):
        read(tmp_path, both)


def test_ordinary_contacts_need_no_kind_and_may_share_their_friction(tmp_path):
    short = SCENE.replace('kind = "unilateral"\n', "").replace("friction = 0.6\n", "")
    short = short.replace("mass = 60.0", "mass = 60.0\nfriction = 0.6")
    ours, full = read(tmp_path, short), read(tmp_path, SCENE)
    assert repr(ours.support.contacts) == repr(full.support.contacts)


def test_feet_are_ordinary_contacts_before_the_others(tmp_path):
    text = SCENE.replace("mass = 60.0", "mass = 60.0\nfriction = 0.4\nfeet = [[1, 2, 0], [-1, 0, 0]]")
    first, second, third, *_ = read(tmp_path, text).support.contacts
    assert isinstance(first, UnilateralContact)
    assert first.position.tolist() == [1, 2, 0]
    assert (first.friction, second.friction, third.friction) == (0.4, 0.4, 0.5)
    planar = PLANAR.replace("mass = 20", "mass = 20\nfriction = 0.4\nfeet = [[-1, 0]]")
    foot = read(tmp_path, planar).support.contacts[0]
    assert foot.normal.tolist() == [0, 1]


def test_scene_is_the_support_and_wrench_it_describes(tmp_path):
    scene = read(tmp_path, SCENE)
    first, second, clamp = scene.support.contacts
    assert (first.friction, first.facets, second.friction) == (0.5, 8, 0.6)
    assert (clamp.friction_upper, clamp.friction_lower, clamp.clamp_force) == (0.2, 0.3, 29.33)
    assert scene.support.mass == 60.0
    assert not scene.planar
    # 100 N, 0.4 m above the centre of mass
    np.testing.assert_allclose(scene.wrench, [100, 0, -60 * 9.81, 1, 2 + 100 * 0.4, 0], atol=1e-12)


def test_scene_equals_the_same_support_in_python(tmp_path):
    text = SCENE.replace("force-constant-half-rigid-clamp", "unilateral")
    text = text.replace("friction_upper = 0.2\nfriction_lower = 0.3\nclamp_force = 29.33", "friction = 0.5")
    scene = read(tmp_path, text)
    feet = [
        UnilateralContact(position=p, friction=mu)
        for p, mu in (([0.35, 0, 0], 0.5), ([-0.2, 0.3, 0], 0.6), ([-0.2, -0.3, 0], 0.5))
    ]
    support = Support(feet, mass=60, center_of_mass=[0, 0, 0.6])
    loads = [Load(force=[100, 0, 0], moment=[1, 2, 3], point=[0, 0, 1]), Load(moment=[0, 0, -3])]
    wrench = support.wrench(loads)
    np.testing.assert_array_equal(scene.wrench, wrench)
    np.testing.assert_array_equal(solve(scene.support, scene.wrench).forces, solve(support, wrench).forces)


def test_positions_of_two_numbers_make_a_planar_scene(tmp_path):
    scene = read(tmp_path, PLANAR)
    assert scene.planar
    np.testing.assert_allclose(scene.wrench, [10, -20 * 9.81, -10 * 0.6 - 12])
    np.testing.assert_array_equal(scene.support.contacts[0].normal, [0, 1])


@pytest.mark.parametrize(
    ("inertia", "expected"),
    [
        ("[1, 2, 3]", np.diag([1.0, 2, 3])),
        ("[[2, 0.1, 0], [0.1, 2, 0], [0, 0, 3]]", None),
        ("[2, 0.1, 0, 2, 0, 3]", None),  # xx, xy, xz, yy, yz, zz, as a payload's
    ],
)
def test_inertia_as_principal_values_six_numbers_or_matrix(tmp_path, inertia, expected):
    scene = read(tmp_path, SCENE.replace("mass = 60.0", f"mass = 60.0\ninertia = {inertia}"))
    if expected is None:
        expected = np.array([[2, 0.1, 0], [0.1, 2, 0], [0, 0, 3]])
    np.testing.assert_array_equal(scene.support.inertia, expected)


def test_a_new_binding_can_be_used_in_a_scene_at_once(tmp_path):
    try:

        class Magnet(UnilateralContact):
            kind = "magnetic-sole"

        text = SCENE.replace('kind = "unilateral"', 'kind = "magnetic-sole"', 1)
        assert isinstance(read(tmp_path, text).support.contacts[0], Magnet)
    finally:
        Binding.registry.pop("magnetic-sole", None)


def test_example_scenes_are_readable(scenes):
    names = sorted(path.name for path in scenes.glob("*.toml"))
    assert len(names) >= 4
    for name in names:
        assert read_scene(scenes / name).name == name


KINDS = "KINDS"  # stands for all kinds that are known when the test runs: other tests define some
BASE = "[base]\nmass = 60.0\ncenter_of_mass = [0, 0, 0.6]\n"
BAD = [  # what to replace in SCENE, by what, and how the message starts
    ("mass = 60.0", "mass = -60.0", "base.mass: must be > 0, got -60.0"),
    ("mass = 60.0", "mass = 0", "base.mass: must be > 0"),
    ("mass = 60.0", 'mass = "60"', "base.mass: expected a number, got '60'"),
    ("mass = 60.0", "mass = true", "base.mass: expected a number, got true"),
    ("mass = 60.0", "mass = [60.0]", "base.mass: expected a single number"),
    ("mass = 60.0", "mass = nan", "base.mass: must be finite, got nan"),
    ("mass = 60.0", "mass = 1" + "0" * 400, "base.mass: number too large"),
    ("mass = 60.0", "mass = 1e300", "base.mass: magnitudes above 1e+12 (SI units) are refused, got 1e+300"),
    ("mass = 60.0", "mass = 1e-300", "base.mass: must be at least 1e-12 kg, got 1e-300"),
    ("mass = 60.0\n", "", "base.mass: missing"),
    ("[0, 0, 0.6]", "[0, 0.6]", "base.center_of_mass: expected 3 numbers, got 2"),
    ("mass = 60.0", "mas = 60.0", "base.mas: unknown key; did you mean 'mass'?"),
    ("mass = 60.0", "mass = 60.0\ninertia = [1, true, 1]", "base.inertia: expected a number"),
    ("mass = 60.0", "mass = 60.0\ninertia = [1, -1, 1]", "base.inertia: must be symmetric"),
    ("mass = 60.0", "mass = 60.0\ninertia = [1, 1]", "base.inertia: expected shape 3"),
    ("mass = 60.0", "mass = 60.0\ninertia = [1, 1, 25]", "base.inertia: no body has these principal values"),
    (
        "mass = 60.0",
        "mass = 60.0\ninertia = [1e-200, 1, 1]",
        "base.inertia: principal values (1e-200, 1, 1 kg",
    ),
    ("mass = 60.0", "mass = 60.0\ninertia = [[1], [1, 2]]", "base.inertia: expected"),
    (BASE, "", "base: missing table [base]"),
    (BASE, "base = 3\n", "base: expected a table"),
    ("[base]", "[foo]\na = 1\n[base]", "foo: unknown key; known: name, gravity, base, contact, load"),
    ("[0, 0, -9.81]", "-9.81", "gravity: expected a list of 3 numbers"),
    (
        "mass = 60.0",
        "mass = 60.0\ngravity = [0, 0, -1]",
        "base.gravity: unknown key; 'gravity' belongs above",
    ),
    (
        "friction = 0.5",
        "friction = 1e-9",
        "contact[1].friction: must be 0 (none) or at least 1e-06, got 1e-09",
    ),
    ("friction = 0.6", "friction = -0.5", "contact[2].friction: must be >= 0, got -0.5"),
    ("friction = 0.6", "friction = 1e8", "contact[2].friction: must be <= 1000 (rubber has 1 to 2"),
    ("friction_upper = 0.2", "friction_upper = 1001", "contact[3].friction_upper: must be <= 1000"),
    ("friction = 0.6\n", "", "contact[2].friction: missing (needed by unilateral)"),
    ("friction_upper = 0.2", "friction_upper = -1", "contact[3].friction_upper: must be > 0"),
    ("facets = 8", "facets = 2", "contact[1].facets: must be an integer from 3 to 256, got 2"),
    ("facets = 8", "facets = 8.5", "contact[1].facets: must be an integer from 3 to 256"),
    ("normal = [0, 0, 1]", "normal = [0, 0, 0]", "contact[1].normal: must not be zero"),
    ("normal = [0, 0, 1]", "normal = [0, 1]", "contact[1].normal: expected shape 3"),
    ("position = [0.35, 0, 0]", "position = [0.35, 0, 0, 0]", "contact[1].position: expected 2 or 3"),
    ("position = [0.35, 0, 0]", "position = [[0.35, 0, 0]]", "contact[1].position: expected shape"),
    ("position = [0.35, 0, 0]", "position = 3", "contact[1].position: expected"),
    ("position = [0.35, 0, 0]", "position = {x = 3}", "contact[1].position: expected a number"),
    (
        "position = [-0.2, 0.3, 0]",
        "position = [-0.2, 0]",
        "contact[2].position: expected 3 numbers like contact[1], got 2",
    ),
    ("position = [0.35, 0, 0]", "position = [0.35, 0]", "contact[1].position: has 2 numbers, normal has 3"),
    (
        '"unilateral"',
        '"unilatral"',
        f"contact[1].kind: expected one of {KINDS}, got 'unilatral'; did you mean 'unilateral'?",
    ),
    ("friction = 0.6", "clamp_force = 0.6", "contact[2].clamp_force: unknown key"),
    ("[[contact]]", "[contact]", ""),
    ("moment = [0, 0, -3]\n", "", "load[2].force: missing"),
    ("mass = 60.0", "mass = = 60.0", "broken TOML: Invalid value (at line 3, column 8)"),
    ("mass = 60.0", "mass = 60.0\nmass = 60.0", "broken TOML: "),
]


@pytest.mark.parametrize(("old", "new", "expected"), BAD)
def test_bad_scene_is_refused_in_one_line_with_the_key(tmp_path, old, new, expected):
    assert old in SCENE
    with pytest.raises(InputError) as caught:
        read(tmp_path, SCENE.replace(old, new, 1))
    message = str(caught.value)
    assert message.startswith(f"scene.toml: {expected}".replace(KINDS, ", ".join(sorted(Binding.registry))))
    assert "\n" not in message


def test_no_contact():
    base = {"mass": 1.0, "center_of_mass": [0, 0, 1]}
    with pytest.raises(
        InputError, match=r"^scene: base.feet: missing \(where it stands, m; or \[\[contact\]\]\)$"
    ):
        read_scene({"base": base})
    with pytest.raises(InputError, match=r"contact: expected tables in double brackets, \[\[contact\]\]"):
        read_scene({"base": base, "contact": {"kind": "unilateral"}})


def test_planar_scene_refuses_spatial_loads(tmp_path):
    with pytest.raises(InputError, match=r"load\[1\]\.force: expected 2 numbers, got 3"):
        read(tmp_path, PLANAR.replace("force = [10, 0]", "force = [10, 0, 0]"))
    with pytest.raises(InputError, match=r"load\[2\]\.moment: expected a single number"):
        read(tmp_path, PLANAR.replace("moment = -12", "moment = [0, 0, -12]"))


def test_files_that_are_no_scene(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.toml: no such file"):
        read_scene(tmp_path / "nowhere.toml")
    with pytest.raises(InputError, match=r"is a folder; expected a file"):
        read_scene(tmp_path)
    (tmp_path / "latin.toml").write_bytes(b"# gr\xfc\xdfe")
    with pytest.raises(InputError, match=r"latin\.toml: not a text file in UTF-8"):
        read_scene(tmp_path / "latin.toml")
    (tmp_path / "deep.toml").write_text("a = " + "[" * 100_000)
    with pytest.raises(InputError, match=r"deep\.toml: broken TOML"):
        read_scene(tmp_path / "deep.toml")


RUBBER = {
    "mass": 40.0, "center_of_mass": [0, 0, 0.4], "friction": 0.7, "stiffness": 2e5, "damping_ratio": 0.1,
    "feet": [[0.3, 0.2, 0], [0.3, -0.2, 0], [-0.3, -0.2, 0]],
}  # fmt: skip


def test_stiffness_of_the_base_is_that_of_clamps_beside_feet():
    clamp = {"kind": "rigid-clamp", "position": [-0.3, 0.2, 0], "friction_upper": 1, "friction_lower": 1}
    both = [clamp, {**clamp, "stiffness": 4e6, "position": [-0.3, 0.4, 0]}]
    contacts = read_scene({"base": RUBBER, "contact": both}).support.contacts
    assert [contact.stiffness for contact in contacts[3:]] == [2e5, 4e6]


def test_stiffness_of_all_feet_and_of_one():
    contact = {"position": [-0.3, 0.2, 0], "stiffness": 4e5, "tangential_stiffness": 1e5, "damping": 80.0}
    feet = read_scene({"base": RUBBER, "contact": [contact]}).support.contacts
    assert [(f.stiffness, f.damping_ratio, f.damping) for f in feet[:3]] == [(2e5, 0.1, None)] * 3
    assert (feet[3].stiffness, feet[3].tangential_stiffness) == (4e5, 1e5)
    assert (feet[3].damping_ratio, feet[3].damping) == (None, 80.0)


@pytest.mark.parametrize(
    ("contact", "words"),
    [
        ({"stiffness": -1}, r"contact\[1\].stiffness: must be > 0"),
        ({"damping": 1, "damping_ratio": 0.1}, r"contact\[1\].damping: give either damping or damping_ratio"),
        ({"stifness": 1e5}, "contact.*stifness: unknown key.*stiffness"),
    ],
)
def test_springs_that_are_refused(contact, words):
    with pytest.raises(InputError, match=words):
        read_scene({"base": RUBBER, "contact": [{"position": [-0.3, 0.2, 0], **contact}]})
