"""Pictures: the drawn artists carry the right numbers, and no two labels cover each other."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from matplotlib.colors import to_hex
from PIL import Image

from ocptip.basics.errors import InputError
from ocptip.contact.solver import solve_many
from ocptip.contact.support import Load
from ocptip.pictures.scene import NEAREST, draw_scene, plot_scene
from ocptip.pictures.style import BROKEN
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver
from ocptip.task_files.scene import Scene, read_scene
from tests.quick import some

EXAMPLES = ["tripod_with_arm", "rover_on_slope", "clamped_tripod", "pushed_cart"]

PLANAR = {
    "base": {"mass": 20.0, "center_of_mass": [0.1, 0.4]},
    "contact": [
        {"kind": "unilateral", "position": [-0.3, 0.0], "friction": 0.5},
        {
            "kind": "force-constant-half-rigid-clamp",
            "position": [0.35, 0.05],
            "normal": [-0.2, 1.0],
            "friction_upper": 0.3,
            "friction_lower": 0.3,
            "clamp_force": 80.0,
        },
    ],
    "load": [{"force": [30.0, -20.0], "point": [0.2, 0.7]}, {"moment": -12.0}],
}


def evaluate(scene):
    states = solve_many(scene.support, scene.wrench[None])
    return states, TipOver(scene.support).evaluate(states), Slip(scene.support).evaluate(states)


def artists(figure, gid):
    return figure.findobj(lambda artist: artist.get_gid() == gid)


def texts(figure):
    return [text.get_text() for text in figure.texts]


def scale_of(ax):
    """N per metre, from the panel's title."""
    number = ax.get_title().split("0.1 m = ")[1].split(" N")[0]
    return 10 * float(number)


@pytest.mark.parametrize("name", some(1, EXAMPLES))
def test_top_view_shows_the_forces_of_the_slip_reserve(scenes, name):
    scene = read_scene(scenes / f"{name}.toml")
    states, tip, slip = evaluate(scene)
    figure = draw_scene(scene, states, tip, slip)
    top, space = figure.axes
    scale = scale_of(top)
    (arrows,) = artists(figure, "tangential")
    frames = scene.support.frames[:, :, 1:]
    expected = np.einsum("kij,kj->ki", frames, slip.tangential_forces[0])
    drawn = scale * np.column_stack([arrows.U, arrows.V])
    np.testing.assert_allclose(drawn, expected[:, :2], atol=1e-6 * np.abs(expected).max() + 1e-9)
    for k, contact in enumerate(scene.support.contacts):
        (label,) = artists(figure, f"contact-{k + 1}")
        assert label.get_text().startswith(f"contact {k + 1}")
        force = slip.normal_forces[0, k]
        assert f"{force if abs(force) > 1e-9 else 0.0:.3g} N" in label.get_text()
        (disc,) = artists(figure, f"limit-{k + 1}")
        radius = np.max(np.linalg.norm(disc.get_xy() - contact.position[:2], axis=1))
        used = slip.usage[0, k]
        if np.isfinite(used) and used > 1e-6:
            length = np.linalg.norm(slip.tangential_forces[0, k])
            assert radius * scale == pytest.approx(length / used, rel=1e-6)
    assert top.get_xlabel() == "x [m]"
    assert space.get_zlabel() == "z [m]"


def test_nearest_tipping_axis_is_highlighted_with_its_moment(scenes):
    scene = read_scene(scenes / "tripod_with_arm.toml")
    states, tip, slip = evaluate(scene)
    figure = draw_scene(scene, states, tip, slip)
    i = tip.nearest_axis[0]
    contacts = sorted(tip.tip_over.axes[i].contacts)
    (line,) = artists(figure, f"axis-{contacts[0] + 1}-{contacts[1] + 1}")
    assert line.get_color() == NEAREST
    ends = np.column_stack(line.get_data())
    a, b = (scene.support.contacts[k].position[:2] for k in contacts)
    along = (b - a) / np.linalg.norm(b - a)
    for end in ends:  # on the line through both contacts
        across = end - a - along * (along @ (end - a))
        np.testing.assert_allclose(across, 0, atol=1e-12)
    entries = [t.get_text() for t in figure.axes[0].get_legend().get_texts()]
    name = f"{contacts[0] + 1}-{contacts[1] + 1}"
    assert f"nearest tipping axis {name}: {tip.moments[0, i]:.3g} N m" in entries


@pytest.mark.slow
def test_line_of_action_on_the_ground_agrees_with_the_moment_reserve(scenes):
    """On a plane, moment margin = total normal force times distance of the resultant from the axis."""
    scene = read_scene(scenes / "tripod_with_arm.toml")
    states, tip, slip = evaluate(scene)
    figure = draw_scene(scene, states, tip, slip)
    (mark,) = artists(figure, "weight and loads meet the ground")
    point = np.array([mark.get_xdata()[0], mark.get_ydata()[0]])
    axis = tip.tip_over.axes[tip.nearest_axis[0]]
    a, b = (scene.support.contacts[k].position[:2] for k in axis.contacts)
    d = (b - a) / np.linalg.norm(b - a)
    distance = abs(d[0] * (point - a)[1] - d[1] * (point - a)[0])
    assert -scene.wrench[2] * distance == pytest.approx(tip.moments[0, tip.nearest_axis[0]], rel=1e-9)


def test_loads_and_weight_are_labelled_with_their_size(scenes):
    scene = read_scene(scenes / "tripod_with_arm.toml")
    shown = texts(draw_scene(scene, *evaluate(scene)))
    weight = scene.support.mass * np.linalg.norm(scene.support.gravity)
    assert f"weight {weight:.3g} N" in shown
    first, second, third = scene.loads
    assert f"load 1: {np.linalg.norm(first.force):.3g} N" in shown
    assert f"load 2: {np.linalg.norm(second.force):.3g} N" in shown
    assert f"load 3: {np.linalg.norm(third.moment):.3g} N m" in shown


def test_planar_forces_cones_and_bars():
    scene = read_scene(PLANAR)
    states, tip, slip = evaluate(scene)
    figure = draw_scene(scene, states, tip, slip)
    left, right = figure.axes
    scale = scale_of(left)
    for k in range(2):
        (arrow,) = artists(figure, f"force-{k + 1}")
        normal, tangential = slip.normal_forces[0, k], slip.tangential_forces[0, k].reshape(-1)
        force = scene.support.frames[k] @ [normal, *tangential]
        np.testing.assert_allclose(scale * np.array([arrow.U[0], arrow.V[0]]), force, rtol=1e-9, atol=1e-9)
        (cone,) = artists(figure, f"cone-{k + 1}")
        tip_of_arrow = scene.support.contacts[k].position + force / scale
        inside = cone.get_path().contains_point(tip_of_arrow, radius=1e-9)
        assert inside == bool(slip.usage[0, k] < 1)
    assert [bar.get_height() for bar in right.patches] == pytest.approx(list(100 * slip.usage[0]))
    assert len(artists(figure, "nearest")) == 1


@pytest.mark.slow
def test_title_carries_verdict_and_reserves(scenes):
    scene = read_scene(scenes / "pushed_cart.toml")
    states, tip, slip = evaluate(scene)
    title = draw_scene(scene, states, tip, slip).get_suptitle()
    used = f"friction used {100 * slip.GT[0]:.3g} %"
    assert title == f"pushed_cart.toml: NOT STABLE    tipping margin 0 N m, {used}"
    figure = draw_scene(scene, states, tip, slip)
    assert to_hex(figure._suptitle.get_color()) == BROKEN


@pytest.mark.parametrize("name", some(2, [*EXAMPLES, "planar"]))
def test_labels_do_not_cover_each_other(scenes, name):
    scene = read_scene(PLANAR) if name == "planar" else read_scene(scenes / f"{name}.toml")
    figure = draw_scene(scene, *evaluate(scene))
    figure.draw_without_rendering()
    boxes = [(t.get_text(), t.get_window_extent()) for t in figure.texts]
    legends = [
        (f"legend {i}", ax.get_legend().get_window_extent())
        for i, ax in enumerate(figure.axes)
        if ax.get_legend()
    ]
    boxes += legends
    for i, (first, a) in enumerate(boxes):
        for second, b in boxes[:i]:
            assert not a.overlaps(b), (first, second)
        assert a.x0 >= 0, first
        assert a.x1 <= figure.bbox.x1, first
        assert a.y0 >= 0, first


def test_contacts_on_a_wall_are_seen_from_the_front():
    wall = {
        "base": {"mass": 5.0, "center_of_mass": [0.1, 0.0, 0.0]},
        "contact": [
            {
                "kind": "rigid-clamp",
                "position": [0.0, y, z],
                "normal": [1.0, 0.0, 0.0],
                "friction_upper": 0.8,
                "friction_lower": 0.8,
            }
            for y, z in ((-0.2, 0.0), (0.2, 0.0), (0.0, 0.4))
        ],
    }
    scene = read_scene(wall)
    ax = draw_scene(scene, *evaluate(scene)).axes[0]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("y [m]", "z [m]")
    assert ax.get_title().startswith("seen along x")


@pytest.mark.parametrize("count", [1, 2])
def test_one_or_two_contacts_can_be_drawn(count):
    contacts = [{"kind": "unilateral", "position": [0.3 * k, 0, 0], "friction": 0.5} for k in range(count)]
    scene = read_scene(
        {"base": {"mass": 1.0, "center_of_mass": [0.15 * (count - 1), 0, 0.2]}, "contact": contacts}
    )
    states, tip, slip = evaluate(scene)
    assert len(draw_scene(scene, states, tip, slip).axes) == 2


def test_any_state_of_a_batch_can_be_drawn(scenes):
    scene = read_scene(scenes / "tripod_with_arm.toml")
    states = solve_many(scene.support, [scene.support.weight, scene.wrench])
    tip, slip = TipOver(scene.support).evaluate(states), Slip(scene.support).evaluate(states)
    figure = draw_scene(dataclasses.replace(scene, loads=()), states, tip, slip, index=0)
    assert f"tipping margin {tip.moments.min():.3g} N m" in figure.get_suptitle()
    assert not any(text.startswith("load") for text in texts(figure))


@pytest.mark.slow
def test_png_is_a_picture(scenes, tmp_path):
    scene = read_scene(scenes / "rover_on_slope.toml")
    states, tip, slip = evaluate(scene)
    plot_scene(scene, states, tip, slip, tmp_path / "stand.png")
    with Image.open(tmp_path / "stand.png") as image:
        assert image.format == "PNG"
        pixels = np.asarray(image.convert("RGB"), dtype=float)
    assert pixels.shape[0] > 800
    assert pixels.shape[1] > 1500
    assert pixels.std() > 10
    assert len(np.unique(pixels[::4, ::4].reshape(-1, 3), axis=0)) > 100
    assert (tmp_path / "stand.png").stat().st_mode & 0o044  # readable by others like any new file
    with pytest.raises(InputError, match=r"\.png, \.pdf or \.svg"):
        plot_scene(scene, states, tip, slip, tmp_path / "stand.gif")


@pytest.mark.slow
@pytest.mark.parametrize("name", some(1, [None, "tripod_with_arm", "pushed_cart"]))
def test_what_a_load_leaves_out_is_zero(scenes, name):
    """Loads without moment, point or force are drawn like those with zeros."""
    scene = read_scene(PLANAR) if name is None else read_scene(scenes / f"{name}.toml")
    size = 2 if scene.planar else 3
    force, point, zero = [4.0, -7.0, 3.0][:size], [0.1, 0.2, 0.3][:size], [0.0] * size
    short = [
        Load(force, point=point),
        Load(force),
        Load(moment=8.0 if scene.planar else [0.0, 0.0, 8.0]),
        Load(force=zero),
    ]
    no_moment = 0.0 if scene.planar else zero
    full = [Load(force, no_moment, point), Load(force, no_moment, zero)]
    full += [Load(zero, short[2].moment, zero), Load(zero, no_moment, zero)]
    seen = []
    for loads in (short, full):
        one = Scene(scene.name, scene.support, tuple(loads), scene.support.wrench(loads))
        figure = draw_scene(one, *evaluate(one))
        seen.append(sorted((t.get_text(), *np.round(t.get_position(), 9)) for t in figure.texts))
    assert seen[0] == seen[1]
    assert any(text.startswith("load 3: 8 N m") for text, *_ in seen[0])
