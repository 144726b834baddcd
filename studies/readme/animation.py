"""The moving picture of the README: a cart that tips under a third-party timing, and the same path retimed.

The UR5 on its cart (`examples/tasks/ur5_cart.toml`) moves 5 kg, its rated payload, along the path of
`examples/paths/ur5_sweep.toml`. Left it has the timing of toppra, which knows the limits of the joints only;
right that of `ocptip retime` within the 'workshop' uncertainty, which also knows the contacts. MuJoCo replays
both on a free base, the nominal model. Needs the packages `mujoco`, `toppra` and Pillow, and a way to render
without a screen (MUJOCO_GL=egl, or osmesa).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ocptip.basics.write import write_json
from ocptip.motion.check import check_motion
from ocptip.retiming.retime import retime
from ocptip.robots.bodies import real_bodies
from ocptip.robots.payload import Payload
from ocptip.standing.simulation.mjcf import STEP, joint_offsets, joint_order, to_mjcf
from ocptip.standing.simulation.replay import prescribed
from ocptip.standing.tolerance import WORKSHOP
from ocptip.task_files.cycle import read_task
from ocptip.task_files.path import load_path
from studies.common import EXAMPLES, machine

TASK, PATH = EXAMPLES / "tasks/ur5_cart.toml", EXAMPLES / "paths/ur5_sweep.toml"
BEFORE, AFTER = 0.3, 1.0  # s of rest before and after the motions that are shown
RATE, SLOWER = 20, 2.0  # frames per second; how much slower than real
WIDTH, HEIGHT = 380, 340  # pixels of one side
COLOURS = 112
PAYLOAD = Payload(5.0, (0.0, 0.0, 0.08))
BLUE, ORANGE, GREY, DARK = (
    [0.25, 0.45, 0.70, 1.0],
    [0.93, 0.55, 0.15, 1.0],
    [0.72, 0.74, 0.78, 1.0],
    [0.25, 0.27, 0.30, 1.0],
)
FLOOR, SKY = [0.78, 0.79, 0.80, 1.0], [0.97, 0.98, 1.0]
FALLS = 8.0  # deg: a tilt from which it is said
GOOD, BAD = (20, 120, 60), (190, 40, 30)


def furnished(robot: Any, motion: Any) -> Any:
    """The exported model with a cart and a floor to look at, which also stop what falls."""
    import mujoco

    spec = prescribed(to_mjcf(robot, motion), STEP)
    box, cylinder = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER
    base, centre = spec.body("base"), np.array(robot.support.center_of_mass)
    for geom in spec.geoms:
        if geom.type == mujoco.mjtGeom.mjGEOM_PLANE or geom.parent is base:
            geom.rgba = [0, 0, 0, 0]
        elif geom.type == mujoco.mjtGeom.mjGEOM_CAPSULE:
            geom.rgba, geom.size = (BLUE if geom.parent.name != "payload" else ORANGE), [0.045, 0, 0]
            geom.contype, geom.conaffinity = 1, 2
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=[4, 4, 0.1], rgba=FLOOR, contype=2, conaffinity=1
    )
    if (held := spec.body("payload")) is not None:
        held.add_geom(
            type=box, pos=held.ipos, size=[0.07, 0.07, 0.06], rgba=ORANGE, mass=0.0, contype=1, conaffinity=2
        )
    deck = {"contype": 1, "conaffinity": 2, "mass": 0.0}
    base.add_geom(type=box, pos=np.array([0, 0, 0.44]) - centre, size=[0.28, 0.20, 0.30], rgba=GREY, **deck)
    for contact in robot.support.contacts:
        turned = [np.sqrt(0.5), np.sqrt(0.5), 0, 0]
        at = np.add(contact.position, (0, 0, 0.07)) - centre
        base.add_geom(
            type=cylinder,
            pos=at,
            quat=turned,
            size=[0.07, 0.025, 0],
            rgba=DARK,
            mass=0.0,
            contype=0,
            conaffinity=0,
        )
    light = spec.worldbody.add_light(pos=[1.5, -1.0, 3.5], dir=[-0.4, 0.3, -1.0])
    light.castshadow, light.diffuse, light.specular = True, [0.45] * 3, [0.1] * 3
    spec.visual.headlight.ambient = [0.35, 0.35, 0.35]
    spec.visual.headlight.diffuse = [0.3, 0.3, 0.3]
    spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=SKY, rgb2=SKY, width=64, height=64,
    )  # fmt: skip
    spec.visual.quality.shadowsize = 4096
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 2 * WIDTH, 2 * HEIGHT
    return spec.compile()


def rolled(robot: Any, motion: Any, end: float) -> tuple[Any, Any, np.ndarray]:
    """Model, its states from `BEFORE` the motion to `end`, and their times."""
    import mujoco

    model, bodies = furnished(robot, motion), real_bodies(robot.arm)
    times = STEP * np.arange(int(np.ceil((BEFORE + end) / STEP)) + 1) - BEFORE
    speeds = np.where(
        ((times > 0) & (times < motion.end))[:, None], motion.states(np.clip(times, 0, motion.end))[1], 0.0
    )
    controls = np.diff(joint_order(robot, bodies, speeds), axis=0) / STEP
    data = mujoco.MjData(model)
    data.qpos[:3], data.qpos[3:7] = robot.support.center_of_mass, [1, 0, 0, 0]
    data.qpos[7:] = joint_order(robot, bodies, motion.start) + joint_offsets(robot, bodies)
    every = round(1 / (RATE * SLOWER) / STEP)
    states = []
    for k, control in enumerate(controls):
        if k % every == 0:
            states.append(np.concatenate([data.qpos, data.qvel]))
        data.ctrl[:] = control
        mujoco.mj_step(model, data)
    return model, np.array(states), times[:-1:every]


def tilt(states: np.ndarray) -> np.ndarray:
    """(T,) rad, of the base."""
    return 2 * np.arccos(np.clip(np.abs(states[:, 3]), 0, 1))


def pictures(model: Any, states: np.ndarray) -> Iterator[Image.Image]:
    """A picture of each state."""
    import mujoco

    camera, data = mujoco.MjvCamera(), mujoco.MjData(model)
    camera.lookat, camera.distance, camera.azimuth, camera.elevation = [0.05, -0.22, 0.60], 3.1, 140, -14
    with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
        for state in states:
            data.qpos[:], data.qvel[:] = state[: model.nq], state[model.nq :]
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera)
            yield Image.fromarray(renderer.render())


def captioned(frame: Image.Image, lines: tuple[str, str], colour: tuple[int, int, int]) -> Image.Image:
    """With what it is, and what becomes of it."""
    draw = ImageDraw.Draw(frame)
    draw.text((14, 10), lines[0], fill=(30, 30, 30), font=ImageFont.load_default(17))
    draw.text((14, 34), lines[1], fill=colour, font=ImageFont.load_default(18))
    draw.text((14, HEIGHT - 22), "MuJoCo, half speed", fill=(110, 110, 110), font=ImageFont.load_default(12))
    return frame


def main(arguments: list[str] | None = None) -> None:
    """Compute both motions, replay them, write the picture and what is in it."""
    from studies.retiming.toppra_timing import by_toppra  # toppra belongs to the extra "studies" only

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for motion.gif and motion.json")
    out: Path = parser.parse_args(arguments).out
    out.mkdir(parents=True, exist_ok=True)
    task = read_task(TASK)
    robot = task.robot.varied(arm=replace(task.robot.arm, payload=PAYLOAD))
    limits = replace(task.limits, tolerance=WORKSHOP)
    path = load_path(PATH, task).paths[0].path
    timed = retime(robot, path, limits)
    third, _ = by_toppra(robot, path, timed.motion.timing.s)
    nominal = check_motion(robot, third, task.limits)
    if nominal.stands or not timed.verified:
        raise SystemExit("the picture would be wrong: the cart stands, or the timing is not verified")
    end = max(third.end, timed.motion.end) + AFTER
    sides, tilts = [], []
    for motion in (third, timed.motion):
        model, states, times = rolled(robot, motion, end)
        sides.append([*pictures(model, states)])
        tilts.append(np.degrees(tilt(states)))
    frames = []
    for k, time in enumerate(times):
        fallen, still = tilts[0][k] > FALLS, time > timed.motion.end
        words = (
            (f"timed by toppra: {third.end:.2f} s", "the cart tips over" if fallen else ""),
            (
                f"the same path by ocptip: {timed.motion.end:.2f} s",
                "stable" if still else "",
            ),
        )
        both = Image.new("RGB", (2 * WIDTH, HEIGHT))
        for side, (frames_of, lines, colour) in enumerate(zip(sides, words, (BAD, GOOD), strict=True)):
            both.paste(captioned(frames_of[k], lines, colour), (side * WIDTH, 0))
        frames.append(both.quantize(COLOURS, dither=Image.Dither.NONE))
    frames[0].save(
        out / "motion.gif",
        save_all=True,
        append_images=frames[1:],
        duration=1000 // RATE,
        loop=0,
        optimize=True,
    )
    write_json(
        out / "motion.json",
        {
            "toppra": {"duration_s": third.end, "GN": nominal.worst["GN"].value, "tilt_deg": max(tilts[0])},
            "ocptip": {"duration_s": timed.motion.end, "verified": timed.verified, "tilt_deg": max(tilts[1])},
            **machine(),
        },
    )
    print(f"{out / 'motion.gif'}: {len(frames)} frames, {(out / 'motion.gif').stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
