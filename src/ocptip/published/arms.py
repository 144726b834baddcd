"""The modular arms, assembled from drive modules, adapters and cables (6.9 to 6.12).

The data files (`data/arms.json`, `data/powercube_modules.json`, `data/cases.json`) are in millimetres, grams
and degrees; they are converted here, once.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.text import did_you_mean
from ocptip.indices.arms.axes import arm_from_spears
from ocptip.numerics.inertia import parallel_axis
from ocptip.robots.geometry import never_part
from ocptip.robots.inverse.inverse_kinematics import solve_inverse_kinematics
from ocptip.robots.model import ArmModel, JointLimits, SphereSet
from ocptip.robots.motors import PowerMaps

_CODE = re.compile(r"F|S|P1|P2|W1|W2")
_PLACES = ("modules 1 and 2", "modules 2 and 3", "modules 3 and 4", "module 4 and the wrist")
_ROWS = ("r_QQ", "r_QM_own", "r_QM_next_from_Qk", "r_QA", "r_QK2", "r_QK1")
_REST = ("m_A_g", "m_K2_g", "m_K1_g", "theta_M2_gmm2", "theta_M1_gmm2")
_OTHER = {"W1": "W2", "W2": "W1", "P1": "P2", "P2": "P1"}
_WORDS = {"S'": "S after F", "F'": "F before S"}
_MIRROR, _TURN = np.diag([-1.0, 1.0, 1.0]), np.diag([1.0, -1.0, -1.0])
_HALF = (45.2, 45.2, 45.2, 35.2)  # mm: Q to the middle of a half of modules 1 to 4
_COVER, _ADAPTER, _CABLE, _WRIST = (77.0, 77.0, 77.0, 60.0), 50.0, 15.0, 60.0  # mm, radii


def codes(name: str) -> tuple[str, ...]:
    """The four connections of a sequence, () where `name` is none."""
    result = tuple(_CODE.findall(name))
    return result if "".join(result) == name and len(result) == 4 else ()


def described(name: str, arms: dict[str, Any]) -> dict[str, Any]:
    """The entry that an arm would have in `data/arms.json`, composed of the entries of the arms that were
    built.

    Args:
        name: axis sequence.
        arms: those that were built, by name.

    Raises:
        InputError: a connection for which the kit has no adapter; the message says where, and which it has.
    """
    sequence = codes(name)
    forms, links = _forms(sequence), []
    for place, form in enumerate(forms):
        known = _known(place, arms)
        if form not in known or (form == "S'" and sequence[place - 1 : place] != ("F",)):
            there = ", ".join(sorted(_WORDS.get(one, one) for one in known))
            raise InputError(
                f"arm: {name}: the kit has no adapter for {sequence[place]} between {_PLACES[place]}; "
                f"there are {there}"
            )
        links.append(known[form])
    if (forms[2][0] == "W") != (forms[3] == "F"):
        raise InputError(
            f"arm: {name}: module 4 would have to be turned round; before the wrist, F goes with W1 or W2 "
            "between modules 3 and 4, all others with P1, P2 or F"
        )
    whole = arms["FP1W2F"]
    links += [_link(whole, 4), _link(whole, 5)]
    out: dict[str, Any] = {key: [link[key] for link in links] for key in (*_ROWS, *_REST)}
    out["A0"] = [whole["A0"][0], *(link["A0"] for link in links[:5])]
    return out | {
        "phi_max_exceptions_deg": {},
        "spheres": _spheres(out) | {"5": whole["spheres"]["5"]},
        "refined_r_QQ": {},
    }


def _forms(sequence: tuple[str, ...]) -> list[str]:
    """Connections, with a prime where they are oblique."""
    following = (*sequence[1:], "")
    return [
        code + "'" * (code == "S" or (code == "F" and after == "S"))
        for code, after in zip(sequence, following, strict=True)
    ]


def _known(place: int, arms: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Links that connect modules at this place, 0 to 3, by form."""
    table: dict[str, dict[str, Any]] = {}
    for axis_number in (place, *({0, 1} - {place} if place < 2 else ())):
        for name, arm in arms.items():
            table.setdefault(_forms(codes(name))[axis_number], _link(arm, axis_number))
    for form, link in list(table.items()):
        if form in _OTHER:
            table.setdefault(_OTHER[form], _mirrored(link) if form[0] == "W" else _turned(link))
    return table


def _link(arm: dict[str, Any], i: int) -> dict[str, Any]:
    link = {key: arm[key][i] for key in (*_ROWS, *_REST)}
    return link | {"A0": arm["A0"][min(i + 1, 5)]}


def _mirrored(link: dict[str, Any]) -> dict[str, Any]:
    """The mirror image of a link, x to -x; its modules are symmetric to that plane."""
    rows = {key: (_MIRROR @ np.array(link[key], dtype=float)).tolist() for key in _ROWS}
    rows |= {key: (_MIRROR @ np.array(link[key]) @ _MIRROR).tolist() for key in _REST if "theta" in key}
    return link | rows | {"A0": (_MIRROR @ np.array(link["A0"]) @ _MIRROR).tolist()}


def _turned(link: dict[str, Any]) -> dict[str, Any]:
    """A link of parallel axes whose next module is upside down, fastened in the same place."""
    x, y, z = link["r_QQ"]
    a, b, c = link["r_QM_next_from_Qk"]
    turned = {"r_QQ": [x, y, 2 * _HALF[0] - z], "r_QM_next_from_Qk": [a, b, -c]}
    return link | turned | {"A0": (np.array(link["A0"]) @ _TURN).tolist()}


def _spheres(rows: dict[str, Any]) -> dict[str, Any]:
    """Spheres that cover modules, adapters and cables of links 1 to 4, as those of (B.25) do."""
    spheres: dict[str, Any] = {"B": {"centres_from_Q1_mm": [[0, 0, -_HALF[0]]], "R_mm": [_COVER[0]]}}
    for i in range(4):
        to_next, axis = np.array(rows["r_QQ"][i], dtype=float), np.array(rows["A0"][i + 1])[:, 2]
        parts = [((0.0, 0.0, _HALF[i]), _COVER[i]), (rows["r_QA"][i], _ADAPTER)]
        if i < 3:
            parts.append((to_next - _HALF[i + 1] * axis, _COVER[i + 1]))
        else:
            parts.append((to_next + rows["r_QM_next_from_Qk"][i], _WRIST))
        cables = ((rows[f"r_QK{k}"][i], rows[f"m_K{k}_g"][i]) for k in (1, 2))
        parts += [(point, _CABLE) for point, mass in cables if mass]
        spheres[str(i + 1)] = {
            "link": i + 1,
            "centres_from_Q_mm": [list(map(float, point)) for point, _ in parts],
            "R_mm": [radius for _, radius in parts],
        }
    return spheres


_GRAM, _MM, _GRAM_MM2 = 1e-3, 1e-3, 1e-9

# Which of the eight branches the experiment used ((5.41) is missing in the text at hand): the one nearest to
# these angles, in degrees. Joints 1 to 3 follow from tables E.1 and E.2 and single the branch out but for the
# wrist of FP1W2F. There joint 4 hardly turns (otherwise its passive ramps would cruise); of the two pairs
# left this one keeps joint 4 farther from its limits. FSFS: joint 4 turns by 253.1 degrees, as the cruise of
# its passive ramp says.
_START_BRANCH = {
    "FP1W2F": (-90.1, 35.1, -17.8, 45.0, -37.1, 179.9),
    "FSFS": (-90.6, 98.7, 108.8, -132.3, -42.9, 12.8),
    "W1P1P2W2": (-72.5, 17.4, -28.8, -133.8, 0.0, 107.5),
}
_GOAL_BRANCH = {
    "FP1W2F": (89.9, 30.2, -8.1, 44.7, 18.3, 0.2),
    "FSFS": (37.0, 101.9, 50.7, 120.9, 99.7, -33.1),
    "W1P1P2W2": (107.2, -20.2, -72.5, -58.5, 16.1, -84.0),
}


def arm_names() -> tuple[str, ...]:
    """Names of the arms that :func:`load_arm` knows."""
    return tuple(published_data("arms")["arms"])


@cache
def load_arm(name: str, *, geometry: str = "refined") -> ArmModel:
    """An arm of the modular kit, mounted with Q_1 in the base origin; move it with `ArmModel.mounted`.

    Args:
        name: one of the experiment's arms FP1W2F (industrial, spherical wrist), FSFS (skew axes) or W1P1P2W2
            (three parallel axes), or another sequence of connections, see `described`: those come with
            other spheres.
        geometry: "refined" (one length per arm corrected by 0.05 mm so that the inverse kinematics reproduces
            the printed motions to 0.001 degrees) or "printed" (0.015 degrees).

    Raises:
        InputError: unknown arm or geometry, or an adapter that there is not; the message lists the known.
    """
    if geometry not in ("refined", "printed"):
        raise InputError(f"geometry: must be 'refined' or 'printed', got {geometry!r}")
    data = _description(name)
    offsets = np.array(data["r_QQ"], dtype=float)
    if geometry == "refined":
        for key, value in data["refined_r_QQ"].items():
            if key != "why":
                link, axis = _link_and_axis(key)
                offsets[link - 1, axis] = value
    links = assemble_links(name)
    arm = ArmModel(
        name=name,
        joint_names=tuple(f"joint {i}" for i in range(1, 7)),
        rotations=np.array([_orthonormal(matrix) for matrix in data["A0"]]),
        offsets=offsets * _MM,
        masses=links.masses,
        centres=links.centres,
        inertias=links.inertias,
        limits=_limits(data["phi_max_exceptions_deg"]),
    )
    sets = tuple(
        SphereSet(
            label,
            spheres.get("link", 0),
            np.array(spheres["centres_from_Q_mm" if "link" in spheres else "centres_from_Q1_mm"]) * _MM,
            np.array(spheres["R_mm"]) * _MM,
        )
        for label, spheres in data["spheres"].items()
    )
    if name not in arm_names():
        note = "arm: of the modular kit, never built: links of the arms that were, spheres that cover modules"
        arm = replace(arm.with_spheres(sets), notes=(note,))
        return arm.with_spheres(sets, excluded_pairs=never_part(arm))
    floor = tuple(data["floor_bodies"])
    only_floor = {label for label in floor if label.endswith("floor")}
    return replace(
        arm,
        sphere_sets=sets,
        collision_pairs=tuple((first, second) for first, second in data["self_collision_pairs"]),
        floor_sets=floor,
        obstacle_sets=tuple(s.name for s in sets if s.link > 0 and s.name not in only_floor),
    )


@cache
def _description(name: str) -> dict:
    """The entry of an arm, in the form of `data/arms.json`."""
    arms = published_data("arms")["arms"]
    if name in arms:
        return arms[name]
    if not codes(name):
        hint = did_you_mean(str(name).upper(), arms)
        raise InputError(
            f"arm: no arm {name!r}; there are {', '.join(arms)} and other sequences of four connections "
            f"F, S, P1, P2, W1, W2{hint}"
        )
    return described(name, arms)


@dataclass(frozen=True, eq=False)
class Links:
    """Mass properties of the six links.

    Attributes:
        masses: (6,), kg (6.9).
        centres: (6, 3), m: Q_i to S_i in frame i (6.10).
        inertias: (6, 3, 3), kg m^2, about S_i, axes of frame i (6.11, 6.12).
    """

    masses: np.ndarray
    centres: np.ndarray
    inertias: np.ndarray


def assemble_links(name: str) -> Links:
    """Mass properties of an arm's links from their parts.

    A link is the second half of its module (which carries the module's mass), the adapter, the first half of
    the next module, and cables as point masses on both. Module halves may have a negative axial inertia, the
    inertias of the adapters are not known and taken as zero.
    """
    tables = published_data("arms")
    data = _description(name)
    masses, centres, inertias = [], [], []
    for i in range(6):
        next_origin = np.array(data["r_QQ"][i], dtype=float)
        # Both cables are measured from Q_i (text of (B.20)), unlike in (6.10).
        parts = (
            (tables["m_M2_g"][i], data["r_QM_own"][i]),
            (tables["m_M1_g"][i], next_origin + data["r_QM_next_from_Qk"][i]),
            (data["m_A_g"][i], data["r_QA"][i]),
            (data["m_K2_g"][i], data["r_QK2"][i]),
            (data["m_K1_g"][i], data["r_QK1"][i]),
        )
        mass = np.array([m for m, _ in parts]) * _GRAM
        points = np.array([point for _, point in parts], dtype=float) * _MM
        total = mass.sum()
        centre = mass @ points / total if total else np.zeros(3)
        inertia = np.array(data["theta_M2_gmm2"][i]) + np.array(data["theta_M1_gmm2"][i])
        steiner = sum(parallel_axis(m, point - centre) for m, point in zip(mass, points, strict=True))
        masses.append(total)
        centres.append(centre)
        inertias.append(inertia * _GRAM_MM2 + steiner)
    return Links(np.array(masses), np.array(centres), np.array(inertias))


@dataclass(frozen=True, eq=False)
class GripperPose:
    """A pose of the gripper relative to Q_1.

    Attributes:
        position: (3,), m, Q_1 to G, base axes.
        rotation: (3, 3), gripper to base axes.
    """

    position: np.ndarray
    rotation: np.ndarray


def experiment_poses() -> tuple[GripperPose, GripperPose]:
    """Start and goal of the eight cases, recovered from three arms; roll about z_6 is a choice (x_6 = x)."""
    poses = published_data("cases")["gripper_poses_recovered"]
    start, goal = (
        GripperPose(np.array(poses[key]["r_Q1G_mm"]) * _MM, _orthonormal(poses[key]["A_B6"]))
        for key in ("start", "end")
    )
    return start, goal


def start_and_goal(name: str, *, geometry: str = "refined") -> tuple[np.ndarray, np.ndarray]:
    """Joint angles (6,), (6,), rad, of an arm at the experiment's start and goal poses.

    Raises:
        InputError: unknown arm or geometry.
    """
    model = load_arm(name, geometry=geometry)
    angles = []
    for pose, branch in zip(experiment_poses(), (_START_BRANCH, _GOAL_BRANCH), strict=True):
        solutions = solve_inverse_kinematics(model, pose.position, pose.rotation)
        angles.append(solutions.nearest(np.deg2rad(branch[name])))
    return angles[0], angles[1]


@cache
def published_data(name: str) -> dict:
    """A data file of the package, as it stands there."""
    return json.loads((files("ocptip.published") / "data" / f"{name}.json").read_text(encoding="utf-8"))


def module_data() -> dict:
    """The raw table of the drive modules (`data/powercube_modules.json`), units in its keys."""
    return published_data("powercube_modules")


def modular_motors(*, torque_reading: str = "load") -> PowerMaps:
    """The power maps of the six drive modules, table 6.1.

    Args:
        torque_reading: see `PowerMaps`.
    """
    table = module_data()["power_map"]
    coefficients = np.array([table["c"][f"c{k}"] for k in range(1, 13)]).T
    return PowerMaps(coefficients, table["U_V"], torque_reading)


def _limits(angle_max_exceptions: dict[str, float]) -> JointLimits:
    table = module_data()["joint_limits"]
    angle_max = np.array(table["phi_max_deg"], dtype=float)
    for joint, value in angle_max_exceptions.items():
        angle_max[int(joint) - 1] = value
    return JointLimits(
        angle_min=np.deg2rad(table["phi_min_deg"]),
        angle_max=np.deg2rad(angle_max),
        speed=np.deg2rad(table["phidot_lim_deg_s"]),
        acceleration=np.deg2rad(table["phiddot_lim_deg_s2"]),
        torque=np.array(table["torque_max_Nm"], dtype=float),
    )


def _link_and_axis(key: str) -> tuple[int, int]:
    """'r_QQ[3].y' as (3, 1)."""
    return int(key[key.index("[") + 1 : key.index("]")]), "xyz".index(key[-1])


def _orthonormal(matrix: list[list[float]]) -> np.ndarray:
    """The nearest rotation: the table's sines and cosines are rounded to 16 digits."""
    u, _, vt = np.linalg.svd(np.array(matrix, dtype=float))
    rotation = u @ vt
    rotation[np.abs(rotation) < 1e-15] = 0.0
    return rotation


AXES_ONLY_ARMS = ("IRB2000",)
"""Arms known by their axes alone: no masses, no collision spheres, no drives."""


@cache
def irb_2000() -> ArmModel:
    """The ABB IRB 2000 by its axes ([Naw07] 3.5); z vertical, x forward; gripper z on axis 6, x vertical."""
    data = published_data("irb_2000")
    upright = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # (u, v, w) to (x, y, z)
    axes = [[*axis["direction"], *(np.array(axis["moment_mm"]) * 1e-3)] for axis in data["axes"]]
    spears = np.array(axes, dtype=float)
    lower, upper = np.radians(data["angle_min_deg"]), np.radians(data["angle_max_deg"])
    none = np.full(len(spears), np.inf)
    return arm_from_spears(
        data["name"],
        np.hstack([spears[:, :3] @ upright.T, spears[:, 3:] @ upright.T]),
        tool_position=upright @ np.array(data["tool_position_mm"]) * 1e-3,
        tool_rotation=upright,
        limits=JointLimits(lower, upper, none, none, none),
    )


def known_arms() -> tuple[str, ...]:
    """Names for :func:`arm_by_name`."""
    return (*arm_names(), *AXES_ONLY_ARMS)


def arm_by_name(name: str) -> ArmModel:
    """A built-in arm: those of `ocptip.published.arms.load_arm` and the arms known by their axes alone.

    Raises:
        InputError: unknown name; the message lists the known.
    """
    wanted = name.upper().replace(" ", "").replace("_", "")
    if wanted in AXES_ONLY_ARMS:
        return irb_2000()
    if wanted in arm_names() or codes(wanted):
        return load_arm(wanted)
    raise InputError(f"arm: no arm {name!r}; there are {', '.join(known_arms())}")
