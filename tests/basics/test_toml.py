"""The cursor that reads tables: values, and where each complaint says it stands."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocptip.basics import schema
from ocptip.basics.errors import InputError
from ocptip.basics.schema import Keys
from ocptip.basics.toml import Table


def table(data, keys, file="f.toml"):
    return Table(data, file, keys if isinstance(keys, Keys) else Keys("test", "A table.", keys))


def refusal(function, *arguments, **options):
    with pytest.raises(InputError) as caught:
        function(*arguments, **options)
    return str(caught.value)


@pytest.mark.parametrize(
    ("error", "parts"),
    [
        (InputError("mass: must be > 0"), ("", "mass", "must be > 0")),
        (InputError("ends[1].row: there is no row 3"), ("", "ends[1].row", "there is no row 3")),
        (InputError("joint 1: too fast: much"), ("", "", "joint 1: too fast: much")),
        (InputError("no path at all"), ("", "", "no path at all")),
        (InputError("mass: 'mass: 3' is none", ""), ("", "", "mass: 'mass: 3' is none")),
        (InputError("missing", "base.mass", "a.toml"), ("a.toml", "base.mass", "missing")),
    ],
)
def test_errors_have_file_path_and_text(error, parts):
    for one in (error, pickle.loads(pickle.dumps(error))):
        assert (one.file, one.path, one.text) == parts
        assert str(one) == ": ".join(part for part in parts if part)


VALUES = {
    "mass": schema.number("Mass.", "kg", bound="> 0"),
    "turn_deg": schema.number("Turn.", "deg"),
    "late_ms": schema.number("Delay.", "ms"),
    "p": schema.vector("Position.", "m", 3),
    "v": schema.per_joint("Speed."),
    "w": schema.per_joint("Speed."),
    "n": schema.direction("Normal."),
    "m": schema.array("Rows.", "m", (None, 2)),
    "name": schema.text("Name."),
    "on": schema.flag("On."),
    "k": schema.whole("Count.", least=1),
    "ks": schema.wholes("Counts.", least=1),
    "kind": schema.choice("Kind.", "abc"),
    "absent": schema.number("A number.", otherwise="nothing"),
    "usual": schema.vector("Angles.", "deg", 2, default=[0, 180]),
}


def test_values():
    data = table(
        {
            "mass": 2,
            "turn_deg": 90,
            "late_ms": 10,
            "p": [1, 2, 3],
            "v": 0.5,
            "w": [1, 2],
            "n": [0, 0, 2],
            "name": "x",
            "on": True,
            "k": 3,
            "ks": [1, 2],
            "m": [[1, 2], [3, 4]],
            "kind": "b",
        },
        VALUES,
    )
    assert (data["mass"], data["late_ms"]) == (2.0, 0.01)
    assert data["turn_deg"] == pytest.approx(np.pi / 2)
    np.testing.assert_array_equal(data["p"], [1, 2, 3])
    np.testing.assert_array_equal(data.get("v", size=2), [0.5, 0.5])
    np.testing.assert_array_equal(data.get("w", size=2), [1, 2])
    np.testing.assert_array_equal(data["n"], [0, 0, 1])
    np.testing.assert_array_equal(data["m"], [[1, 2], [3, 4]])
    assert (data["name"], data["on"], data["k"]) == ("x", True, 3)
    assert (data.get("ks", size=2), data["kind"]) == ([1, 2], "b")
    assert data.given("mass", "absent") == {"mass": 2.0}
    assert (data["absent"], data.get("absent", 7)) == (None, 7)
    np.testing.assert_allclose(data["usual"], [0, np.pi])
    data.close()


def test_keys_that_nobody_declared_cannot_be_read():
    with pytest.raises(KeyError, match="'length' is not declared in 'test'"):
        table({"length": 1}, VALUES)["length"]


@pytest.mark.parametrize(
    ("data", "known"),
    [
        ({"kind": "box", "size": 1}, {"kind", "size"}),
        ({"kind": "sphere", "radius": 1}, {"kind", "radius"}),
        ({"radius": 1}, {"kind", "radius"}),
        ({"kind": 3}, {"kind", "radius"}),
    ],
)
def test_a_key_decides_which_others_there_are(data, known):
    variants = {
        "box": Keys("box", "A box.", {"size": schema.number("Size.")}),
        "sphere": Keys("sphere", "A sphere.", {"radius": schema.number("Radius.")}),
    }
    kind = {"kind": schema.choice("Kind.", variants, default="sphere")}
    solid = Keys("solid", "A solid.", kind, by="kind", variants=variants, usual="sphere")
    assert set(solid.of(data).keys) == known


TURN = Rotation.from_euler("xyz", [10, 20, 30], degrees=True)


@pytest.mark.parametrize(
    ("form", "value"),
    [
        ("rpy_deg", [10, 20, 30]),
        ("quaternion", TURN.as_quat().round(5).tolist()),
        ("rotation_vector_deg", np.rad2deg(TURN.as_rotvec()).tolist()),
        ("rotation", TURN.as_matrix().tolist()),
    ],
)
@pytest.mark.parametrize("prefix", ["", "mount_"])
def test_four_forms_of_an_orientation(prefix, form, value):
    data = table({prefix + form: value}, schema.rotation("Axes", prefix))
    np.testing.assert_allclose(data.rotation(prefix), TURN.as_matrix(), atol=2e-5)
    data.close()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (
            {"quaternion": [0, 0, 0, 0]},
            "f.toml: quaternion: must have length 1 (x, y, z, w), got [0, 0, 0, 0]",
        ),
        ({"quaternion": [0, 0, 1]}, "f.toml: quaternion: expected 4 numbers, got 3"),
        ({"rotation": [[1, 0], [0, 1]]}, "f.toml: rotation: expected shape 3 x 3, got 2 x 2"),
        (
            {"rotation": [[1, 0], [0]]},
            "f.toml: rotation: expected lists of the same length, got [[1, 0], [0]]",
        ),
        (
            {"rpy_deg": [0, 0, 0], "quaternion": [0, 0, 0, 1]},
            "f.toml: rpy_deg: expected either rpy_deg, quaternion, rotation_vector_deg or rotation, "
            "got rpy_deg and quaternion",
        ),
        (
            {},
            "f.toml: rpy_deg: expected either rpy_deg, quaternion, rotation_vector_deg or rotation, got none",
        ),
    ],
)
def test_wrong_orientations(data, message):
    def read():
        with table(data, schema.rotation("Axes")) as cursor:
            cursor.rotation()

    assert refusal(read) == message


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"angles_deg": 1}, "f.toml: angles_deg: unknown key; expected either at_deg or at_pose"),
        ({}, "f.toml: at_deg: expected either at_deg or at_pose, got none"),
        ({"at_deg": 1, "at_pose": 2, "x": 3}, "f.toml: at_deg: expected either at_deg or at_pose, got .*"),
    ],
)
def test_an_unknown_key_instead_of_alternatives_is_named(data, message):
    ends = {name: schema.number(f"The {name}.", default=0.0) for name in ("at_deg", "at_pose")}
    point = table(data, Keys("waypoint", "A waypoint.", ends, one_of=[("at_deg", "at_pose")]))
    with pytest.raises(InputError, match=f"^{message}$"):
        point.one_of("at_deg")


def test_a_misspelled_required_key_is_unknown_not_missing():
    keys = Keys("base", "A base.", {"mass": schema.number("Mass.")})
    base = table({"base": {"mas": 3}}, {"base": schema.table(keys)}).table("base")
    assert np.isnan(base["mass"])
    assert refusal(base.close) == "f.toml: base.mas: unknown key; did you mean 'mass'? known: mass"
    assert [str(c) for c in base.complaints()][1:] == ["f.toml: base.mass: missing"]


def test_a_misspelled_variant_is_suggested_though_the_usual_one_is_read():
    kinds = {
        name: Keys(name, "A robot.", {name: schema.table(Keys(f"{name} table", "A."))})
        for name in ("arm", "robot")
    }
    data = table({"robots": {}}, Keys("task", "A task.", by=("arm", "robot"), variants=kinds, usual="arm"))
    message = "f.toml: robots: unknown key; did you mean 'robot'? known: arm"
    assert refusal(data.close, early=True) == message


def test_all_complaints_are_at_hand():
    part = Keys("part", "A part.", {"x": schema.number("Place.")})
    data = table({"a": 1, "part": [{"x": 1}, {"y": 2}]}, {"part": schema.tables(part)})
    for own in data.tables("part"):
        own.get("x")
    assert [c.path for c in data.complaints()] == ["a", "part[2].y", "part[2].x"]


def test_keys_above_the_first_table():
    keys = {
        "gravity": schema.number("Gravity.", otherwise="9.81"),
        "base": schema.table(Keys("base", "A base.")),
    }
    data = table({"base": {"gravity": 3}}, keys)
    data.close(early=True)
    base = data.table("base")
    message = "f.toml: base.gravity: unknown key; 'gravity' belongs above the first table"
    assert refusal(base.close) == message


def body(mass, center):
    raise InputError(f"{mass}: no such thing as {center}")


@pytest.mark.parametrize(
    ("library", "message"),
    [
        ("mass", "f.toml: arm.mass: no such thing as 1"),
        ("arm", "f.toml: arm.name: no such thing as 1"),
        ("links[2].mass", "f.toml: arm: links[2].mass: no such thing as 1"),
        ("two words", "f.toml: arm: two words: no such thing as 1"),
    ],
)
def test_errors_of_library_functions_get_a_place(library, message):
    keys = Keys("arm", "An arm.", {"mass": schema.number("Mass."), "name": schema.text("Name.")})
    arm = table({"arm": {"mass": 2.0, "name": "x"}}, {"arm": schema.table(keys)}).table("arm")

    def read():
        with arm.at(arm="name"):
            body(library, 1)

    assert refusal(read) == message


def test_placed_errors_stay_and_those_of_other_files_are_quoted():
    keys = Keys("robot", "A robot.", {"parallel": schema.file("Robot.")})
    data = table({"robot": {"parallel": "r.toml"}}, {"robot": schema.table(keys)})
    robot = data.table("robot")

    def read(error):
        with data, robot.at("parallel"):
            raise error

    assert refusal(read, data.error("missing", "home")) == "f.toml: home: missing"
    other = InputError("must be > 0", "leg[1].mass", "r.toml")
    assert refusal(read, other) == "f.toml: robot.parallel: r.toml: leg[1].mass: must be > 0"


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        (schema.number("A."), [1], "expected a single number, got [1]"),
        (schema.number("A."), 10**400, "number too large"),
        (schema.number("A.", bound=">= 0"), -1, "must be >= 0, got -1"),
        (schema.number("A.", bound="> 0"), 0, "must be > 0, got 0"),
        (schema.vector("A."), 3, "expected a list of 2 numbers, got 3"),
        (schema.wholes("A.", least=0), [1.5], "must be a whole number >= 0 and <= 2, got 1.5"),
        (schema.wholes("A.", least=0), 1, "expected a list of whole numbers, got 1"),
        (schema.flag("A."), 0, "expected true or false, got 0"),
        (schema.text("A."), " ", "expected a text, got ' '"),
        (schema.choice("A.", ("ab", "c")), "aab", "expected one of ab, c, got 'aab'; did you mean 'ab'?"),
        (schema.numbers("A."), [[1], [1, 2]], "expected lists of the same length, got [[1], [1, 2]]"),
        (schema.folders("A."), [1], "expected folders, got [1]"),
    ],
)
def test_wrong_values(key, value, text):
    assert refusal(table({"key": value}, {"key": key}).get, "key", size=2) == f"f.toml: key: {text}"


def test_wrong_tables():
    below = Keys("below", "A table.")
    data = table({"one": 3, "several": {}}, {"one": schema.table(below), "several": schema.tables(below)})
    assert refusal(data.table, "one") == "f.toml: one: expected a table [one], got 3"
    message = "f.toml: several: expected tables in double brackets, [[several]], got {}"
    assert refusal(data.tables, "several") == message


def test_huge_integers_are_no_toml(tmp_path):
    path = tmp_path / "huge.toml"
    path.write_text("a = 1" + "0" * 5000)
    assert refusal(Table.read, path, Keys("file", "A file.")).startswith("huge.toml: broken TOML: ")
