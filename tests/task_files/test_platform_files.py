import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError
from ocptip.task_files.platform_points import read_platform

POINTS = [[100.0, 0, 0], [50, 80, 0], [-50, 80, 0], [-100, 0, 0], [-50, -80, 0], [50, -80, 0]]
MINIMAL = {"base": POINTS, "platform": POINTS}


def test_reads_a_file(tmp_path):
    text = f"""
name = "table"
unit = "mm"
base = {POINTS}
platform = {POINTS}

[home]
position = [0, 0, 300]
rotation_deg = [0, 0, 30]

[operation_ellipsoid]
center = [0, 0, 50]
half_axes = [20, 30, 40]
axes_deg = [0, 90, 0]
"""
    path = tmp_path / "table.toml"
    path.write_text(text)
    content = read_platform(path)
    assert content.platform.name == "table"
    np.testing.assert_allclose(content.platform.base, np.array(POINTS) / 1000)
    np.testing.assert_allclose(content.position, [0, 0, 0.3])
    np.testing.assert_allclose(content.rotation, Rotation.from_euler("z", np.pi / 6).as_matrix())
    np.testing.assert_allclose(content.ellipsoid.half_axes, [0.02, 0.03, 0.04])
    np.testing.assert_allclose(content.ellipsoid.center, [0, 0, 0.05])
    np.testing.assert_allclose(content.ellipsoid.axes[:, 2], [1, 0, 0], atol=1e-15)


def test_defaults():
    content = read_platform(MINIMAL, name="here")
    assert content.platform.name == "here"
    assert content.ellipsoid is None
    np.testing.assert_array_equal(content.platform.base, POINTS)
    np.testing.assert_array_equal(content.position, 0)
    np.testing.assert_array_equal(content.rotation, np.eye(3))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"unit": "inch"}, "p.toml: unit: expected one of m, mm, got 'inch'"),
        ({"unit": []}, "p.toml: unit: expected one of"),
        ({"bases": 1}, "p.toml: bases: unknown key; did you mean 'base'? known: name, unit"),
        ({"name": 3}, "p.toml: name: expected a text"),
        ({"base": POINTS[:5]}, "p.toml: platform: needs one anchor for each of the 5 base anchors"),
        ({"base": "x"}, "p.toml: base: expected a number, got 'x'"),
        ({"home": 3}, "p.toml: home: expected a table"),
        ({"home": {"pose": 1}}, "p.toml: home.pose: unknown key"),
        ({"home": {"positon": 1}}, "p.toml: home.positon: unknown key; did you mean 'position'?"),
        ({"home": {"position": [1, 2]}}, "p.toml: home.position: expected 3 numbers, got 2"),
        ({"home": {"rotation_deg": [0, np.nan, 0]}}, "p.toml: home.rotation_deg: must be finite, got nan"),
        ({"operation_ellipsoid": {}}, "p.toml: operation_ellipsoid.half_axes: missing"),
        (
            {"operation_ellipsoid": {"half_axes": [1, 1, 0]}},
            "p.toml: operation_ellipsoid.half_axes: all must",
        ),
    ],
)
def test_broken_content_is_refused_with_file_and_key(change, message):
    with pytest.raises(InputError) as error:
        read_platform(MINIMAL | change, name="p.toml")
    assert str(error.value).startswith(message)


def test_missing_anchors_are_named():
    with pytest.raises(InputError, match="platform: platform: missing"):
        read_platform({"base": POINTS})


def test_unreadable_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_platform(tmp_path / "none.toml")
    with pytest.raises(InputError, match="is a folder; expected a file"):
        read_platform(tmp_path)
    broken = tmp_path / "broken.toml"
    broken.write_text("base = [")
    with pytest.raises(InputError, match=r"broken\.toml: broken TOML"):
        read_platform(broken)
    broken.write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="not a text file"):
        read_platform(broken)
