"""The cursor that reads tables: values, and where each complaint says it stands."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError
from ocptip.basics.toml import DEGREES, Table


def table(text_or_data, file="f.toml"):
    return Table(text_or_data, file)


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


def test_values():
    data = table(
        {
            "mass": 2,
            "turn_deg": 90,
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
        }
    )
    assert data.number("mass", bound="> 0") == 2.0
    assert data.number("turn_deg", scale=DEGREES) == pytest.approx(np.pi / 2)
    np.testing.assert_array_equal(data.vector("p", 3, scale=1e-3), np.array([1, 2, 3]) * 1e-3)
    np.testing.assert_array_equal(data.per_joint("v", 2), [0.5, 0.5])
    np.testing.assert_array_equal(data.per_joint("w", 2), [1, 2])
    np.testing.assert_array_equal(data.direction("n"), [0, 0, 1])
    np.testing.assert_array_equal(data.array("m", (None, 2)), [[1, 2], [3, 4]])
    assert (data.text("name"), data.flag("on"), data.whole("k", least=1)) == ("x", True, 3)
    assert (data.wholes("ks", least=1, most=2), data.choice("kind", "abc")) == ([1, 2], "b")
    assert data.numbers("mass", "absent") == {"mass": 2.0}
    assert (data.number("absent", None), data.text("nothing", "here")) == (None, "here")
    data.close()


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
    data = table({prefix + form: value})
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
        with table(data) as cursor:
            cursor.rotation()

    assert refusal(read) == message


def test_a_misspelled_required_key_is_unknown_not_missing():
    base = table({"base": {"mas": 3}}).table("base")
    assert np.isnan(base.number("mass"))
    assert refusal(base.close) == "f.toml: base.mas: unknown key; did you mean 'mass'? known: mass"
    assert [str(c) for c in base.complaints()][1:] == ["f.toml: base.mass: missing"]


def test_all_complaints_are_at_hand():
    data = table({"a": 1, "part": [{"x": 1}, {"y": 2}]})
    for part in data.tables("part"):
        part.number("x")
    assert [c.path for c in data.complaints()] == ["a", "part[2].y", "part[2].x"]


def test_keys_above_the_first_table():
    data = table({"base": {"gravity": 3}})
    data.close("gravity", "base")
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
    arm = table({"arm": {"mass": 2.0, "name": "x"}}).table("arm")

    def read():
        with arm.at(arm="name"):
            body(library, 1)

    assert refusal(read) == message


def test_placed_errors_stay_and_those_of_other_files_are_quoted():
    data = table({"robot": {"parallel": "r.toml"}})
    robot = data.table("robot")

    def read(error):
        with data, robot.at("parallel"):
            raise error

    assert refusal(read, data.error("missing", "home")) == "f.toml: home: missing"
    other = InputError("must be > 0", "leg[1].mass", "r.toml")
    assert refusal(read, other) == "f.toml: robot.parallel: r.toml: leg[1].mass: must be > 0"


@pytest.mark.parametrize(
    ("method", "value", "options", "text"),
    [
        ("number", [1], {}, "expected a single number, got [1]"),
        ("number", 10**400, {}, "number too large"),
        ("number", -1, {"bound": ">= 0"}, "must be >= 0, got -1"),
        ("number", 0, {"bound": "> 0"}, "must be > 0, got 0"),
        ("vector", 3, {"size": None}, "expected a list of numbers, got 3"),
        ("wholes", [1.5], {"least": 0, "most": 2}, "must be a whole number >= 0 and <= 2, got 1.5"),
        ("wholes", 1, {"least": 0, "most": 2}, "expected a list of whole numbers, got 1"),
        ("flag", 0, {}, "expected true or false, got 0"),
        ("text", " ", {}, "expected a text, got ' '"),
        ("choice", "aa", {"names": ("ab", "c")}, "expected one of ab, c, got 'aa'"),
        ("table", 3, {}, "expected a table [key], got 3"),
        ("tables", {}, {}, "expected tables in double brackets, [[key]], got {}"),
        ("raw_numbers", [[1], [1, 2]], {}, "expected lists of the same length, got [[1], [1, 2]]"),
    ],
)
def test_wrong_values(method, value, options, text):
    assert refusal(getattr(table({"key": value}), method), "key", **options).startswith(
        f"f.toml: key: {text}"
    )


def test_huge_integers_are_no_toml(tmp_path):
    path = tmp_path / "huge.toml"
    path.write_text("a = 1" + "0" * 5000)
    assert refusal(Table.read, path).startswith("huge.toml: broken TOML: ")
