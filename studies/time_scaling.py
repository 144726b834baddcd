"""Planned and printed motions, faster and slower: when is a contact lost, and for how long?

The experiment of the source scales all times of a motion by tau (below 1: faster) and watches the contacts
(7.4). Here the same is computed for the best plans and the printed motions of the eight cases, on both sets
of base data. Then come the source's observations about its own plans (5.9), each computed from motions: how
long they take with large and small triangle, with and without clamp, and whether they raise or lower the arm.

At every tau the exact motion goes through `prove`, and once more cell by cell (0.5 ms) for the time in which
a contact is lost. That is the time in which the contacts cannot hold the base at rest; what the base does
once it has left them is not computed. Drives are not limited here; a column tells what they can do.

There is one tau* between standing and losing a contact: at the same point of the path, the load on the base
is that of the arm at rest plus that of its motion over tau^2, and the loads that the contacts can bear form
a convex set. If the base stands with the arm at rest anywhere on the path, it stands at every tau above one
at which it stands. The study checks both.

    python studies/time_scaling.py --out results [--plans results/plans] [--cases A B] [--step 0.01]

`--plans DIR`: plans as DIR/A-effective/plan.json, as `plan_cases.py` writes them; missing ones are left out.
Writes OUT/time_scaling.json, .md and .png.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import os
import platform
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from contact_robustness import table
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ocptip.contact.pyramid import radius_error
from ocptip.errors import InputError, OcptipError
from ocptip.motion import (
    ArmMotion,
    MotionCase,
    MotionSamples,
    StandingRobot,
    experiment_robot,
    load_motion,
    motion_case,
    motion_cases,
    motion_origin,
    prove,
)
from ocptip.motion.output import atomic_file, plain, versions
from ocptip.motion.proof import INSIDE
from ocptip.motion.robot import BASES
from ocptip.robots import ArmModel, link_frames

FASTEST, SLOWEST = 0.90, 1.10
SEARCHED = (0.05, 20.0)  # tau* is sought between these
CELL = 5e-4  # s
FACETS = 12  # of the friction pyramids
TOLERANCE = 1e-4  # of tau*
LIMIT = 0.9  # of GN and GT in the plans
KINDS = {"ours": "ours", "printed": "printed motion"}
SHOWN = (0.90, 0.92, 0.94, 0.95, 0.96, 0.98, 1.00, 1.02, 1.05, 1.10)  # columns of the tables
COLORS, TOP = {"ours": "#0072b2", "printed": "#d55e00"}, 1.55  # of the figure
PLANS = Path(__file__).parent / "results" / "plans"
INTERRUPTION = 0.030  # s: longest interruption of a contact that the source saw at tau = 1 (figure 7.8)

DURATION_TRENDS = {
    "large": (
        "Without clamp, motions on the large triangle take less time than on the small one.",
        (("A", "B"), ("D", "E"), ("G", "H")),
    ),
    "clamp": (
        "On the small triangle, motions take less time with the clamp than without.",
        (("C", "B"), ("F", "E")),
    ),
    "arm": (
        "FP1W2F takes less time than the other arms.",
        (("A", "D"), ("A", "G"), ("B", "E"), ("B", "H"), ("C", "F")),
    ),
}
"""Statements of 5.9 about durations, each with pairs of cases: the first takes less time than the second."""

SHORTER = 0.01  # share by which a duration has to be shorter
HEIGHT_TRENDS = {
    "raised": ("On the small triangle the arm is raised during the motion.", "BCEFH"),
    "lowered": ("In case A it is lowered, which lends potential energy to the motion.", "A"),
    "level": ("In cases D and G it is neither raised nor lowered.", "DG"),
}
CHANGED = 0.010  # m, by which the centre of mass has to be raised or lowered
LIFTING_JOINT = {"W1P1P2W2": 3}  # that raises the arm according to the source; otherwise 2


@dataclass(frozen=True)
class Scaled:
    """A motion at one time scaling.

    Attributes:
        tau: all times are multiplied by it.
        stands: every contact persists at every instant looked at, and every state is solved.
        GN, GT: worst, by `prove`; above 1 they contain the acceleration of a contact, m/s^2.
        GN_time, GT_time: when, s.
        lost_s, longest_s: total and longest time in which the base does not stand, s; 0 if that is so only at
            the ends of intervals between events.
        lifted_s, slid_s: longest time in which each contact lifts off, or slides, s.
        unsolved: instants without a verified state (counted as lost).
        torque_ratio, speed_ratio, acceleration_ratio: largest, relative to the drives' limits.
    """

    tau: float
    stands: bool
    GN: float
    GT: float
    GN_time: float
    GT_time: float
    lost_s: float
    longest_s: float
    lifted_s: tuple[float, ...]
    slid_s: tuple[float, ...]
    unsolved: int
    torque_ratio: float
    speed_ratio: float
    acceleration_ratio: float


# --- one motion at many time scalings -----------------------------------------------------------------------


def cells(motion: ArmMotion) -> tuple[np.ndarray, np.ndarray]:
    """Middles (N,), s, of cells that fill the motion, with their widths (N,), s.

    Both ends of every interval between events are among them, with width 0.
    """
    times, widths = [], []
    for left, right in motion.intervals:
        n = max(1, math.ceil((right - left) / CELL))
        width = (right - left) / n
        middles = left + width * (np.arange(n) + 0.5)
        side = min(INSIDE, 0.25 * width)
        times += [[left + side], middles, [right - side]]
        widths += [[0.0], np.full(n, width), [0.0]]
    return np.concatenate(times), np.concatenate(widths)


def longest_run(marked: np.ndarray, widths: np.ndarray) -> float:
    """The largest sum of widths (N,) over a run of successive marked ones ((N,), bool)."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]]).astype(int)))
    return float(max((widths[begin:end].sum() for begin, end in ends.reshape(-1, 2)), default=0.0))


def lost(samples: MotionSamples) -> np.ndarray:
    """(N,) True where a contact is lost, or where that is not known."""
    return ~(samples.states.persistent & samples.slip.solved & (samples.tip.GN < 1) & (samples.slip.GT < 1))


def moving(samples: MotionSamples) -> tuple[np.ndarray, np.ndarray]:
    """(N, contacts) True where a contact lifts off (or yields along its normal); where it slides."""
    accelerations, rest = samples.states.contact_accelerations, samples.states.rest_limit[:, None]
    lifts = np.abs(accelerations[:, :, 0]) > rest
    return lifts, ~lifts & (np.max(np.abs(accelerations[:, :, 1:]), axis=2) > rest)


def scaled(robot: StandingRobot, motion: ArmMotion, tau: float) -> Scaled:
    """Worst values and lost contacts of a motion with all times multiplied by tau."""
    motion = motion.time_scaled(tau)
    worst = prove(robot, motion).worst
    times, widths = cells(motion)
    samples = robot.samples(motion, times)
    gone, (lifts, slides) = lost(samples), moving(samples)
    GN, GT = worst["GN"], worst["GT"]
    return Scaled(
        tau=tau,
        stands=bool(not gone.any() and GN.value < 1 and GT.value < 1),
        GN=GN.value,
        GT=GT.value,
        GN_time=GN.time,
        GT_time=GT.time,
        lost_s=float(widths @ gone),
        longest_s=longest_run(gone, widths),
        lifted_s=tuple(longest_run(column, widths) for column in lifts.T),
        slid_s=tuple(longest_run(column, widths) for column in slides.T),
        unsolved=int(np.sum(~(samples.states.solved & samples.slip.solved))),
        **{name: worst[name].value for name in ("torque_ratio", "speed_ratio", "acceleration_ratio")},
    )


def first_loss(robot: StandingRobot, motion: ArmMotion, found: Scaled) -> dict:
    """Which contacts are the first to be lost, at a scaling that just does not stand."""
    motion = motion.time_scaled(found.tau)
    if found.GN >= 1 or found.GT >= 1:
        time = found.GN_time if found.GN >= 1 else found.GT_time
    else:
        times, _ = cells(motion)
        time = float(times[np.argmax(lost(robot.samples(motion, times)))])
    samples = robot.samples(motion, np.array([time]))
    lifts, slides = (mask[0] for mask in moving(samples))
    usage = samples.slip.usage[0]
    if not (lifts.any() or slides.any()) and np.isfinite(usage).any():  # beyond the cone only
        slides = usage > np.nanmax(usage) - 1e-3
    which = lifts if lifts.any() else slides
    kind = "lift-off" if lifts.any() else "slip" if slides.any() else "unknown"
    return {"kind": kind, "contacts": [int(k) + 1 for k in np.flatnonzero(which)], "time_s": time}


def critical(values: dict[float, Scaled], at: Callable[[float], Scaled]) -> tuple[float, float] | None:
    """The tau at which a contact is first lost when the motion becomes faster: (lost, stands), or None.

    Args:
        values: results so far, not empty; those of the search are added.
        at: computes one.

    Returns:
        The two are `TOLERANCE` apart or less; None if there is no change of state between the `SEARCHED`.
    """

    def computed(tau: float) -> Scaled:
        if tau not in values:
            values[tau] = at(tau)
        return values[tau]

    low, high = min(values), max(values)
    while values[low].stands and low > SEARCHED[0]:
        low = max(0.85 * low, SEARCHED[0])
        computed(low)
    while not values[high].stands and high < SEARCHED[1]:
        high = min(high / 0.85, SEARCHED[1])
        computed(high)
    falling = [tau for tau, one in values.items() if not one.stands]
    if not falling or max(falling) == max(values):
        return None
    low = max(falling)
    high = min(tau for tau in values if tau > low)
    while high - low > TOLERANCE:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if computed(middle).stands else (middle, high)
    return low, high


def rests_anywhere(robot: StandingRobot, motion: ArmMotion) -> bool:
    """Whether the base stands if the arm rests anywhere on the path of the motion."""
    q = motion.states(cells(motion)[0])[0]
    return bool(np.all(robot.contact_states(robot.loads(q, 0 * q, 0 * q)[1]).persistent))


def row_of(case: MotionCase, base: str, kind: str, motion: ArmMotion, taus: Sequence[float]) -> dict:
    """All about one motion: reserves against tau, tau*, first loss, heights."""
    robot = experiment_robot(case, base, facets=FACETS)
    values = {tau: scaled(robot, motion, tau) for tau in taus}
    bracket = critical(values, lambda tau: scaled(robot, motion, tau))
    order = [values[tau].stands for tau in sorted(values)]
    unscaled = values[1.0]
    return {
        "case": case.name,
        "base": base,
        "motion": kind,
        "arm": case.arm,
        "triangle_m": case.triangle_side,
        "clamp": case.clamped,
        "duration_s": motion.end,
        "energy_J": robot.energy(motion),
        "tau_star": bracket[1] if bracket else None,
        "tau_lost": bracket[0] if bracket else None,
        "first_loss": first_loss(robot, motion, values[bracket[0]]) if bracket else None,
        "monotone": order == sorted(order),
        "rests_anywhere": rests_anywhere(robot, motion),
        "tau_drives": max(unscaled.speed_ratio, math.sqrt(unscaled.acceleration_ratio)),
        **heights(robot.arm, motion, LIFTING_JOINT.get(case.arm, 2)),
        "taus": [asdict(values[tau]) for tau in taus],
    }


# --- heights ------------------------------------------------------------------------------------------------


def heights(arm: ArmModel, motion: ArmMotion, joint: int) -> dict:
    """How far a motion raises and lowers the arm, against the straight line of its joint angles.

    Compared is the height at the same angle of joint 1, about which the arm turns from start to goal: of the
    centre of mass of the arm, and of the end of the link that `joint` (from 1) turns. z points up.

    Returns:
        raised_m, lowered_m: largest heights above and below the straight line, centre of mass, >= 0.
        raised_at, lowered_at: when, as shares of the duration.
        link_raised_m, link_lowered_m: end of the link.
        lowered_J: potential energy of `lowered_m`.
    """
    times = cells(motion)[0]
    q = motion.states(times)[0]
    way = motion.goal - motion.start
    share = np.clip((q[:, 0] - motion.start[0]) / way[0], 0, 1)
    straight = motion.start + share[:, None] * way
    mass, link = (
        a - b for a, b in zip(arm_heights(arm, q, joint), arm_heights(arm, straight, joint), strict=True)
    )
    return {
        "raised_m": float(max(0.0, mass.max())),
        "raised_at": float(times[np.argmax(mass)] / motion.end),
        "lowered_m": float(max(0.0, -mass.min())),
        "lowered_at": float(times[np.argmin(mass)] / motion.end),
        "lowered_J": float(np.sum(arm.masses) * 9.81 * max(0.0, -mass.min())),
        "link_raised_m": float(max(0.0, link.max())),
        "link_lowered_m": float(max(0.0, -link.min())),
    }


def arm_heights(arm: ArmModel, q: np.ndarray, joint: int) -> tuple[np.ndarray, np.ndarray]:
    """Heights (N,), m, base axes: of the arm's centre of mass; of the end of the link that `joint` turns."""
    frames, n = link_frames(arm, q), arm.n
    centres = frames.origins[:, :n] + np.einsum("tkij,kj->tki", frames.rotations[:, :n], arm.centres)
    return centres[:, :, 2] @ arm.masses / np.sum(arm.masses), frames.origins[:, joint, 2]


# --- trends -------------------------------------------------------------------------------------------------


def trends(rows: Sequence[dict]) -> list[dict]:
    """The statements of 5.9, each for our plans on either base and for the printed motions.

    `found`, `not_found`: pairs of cases, or cases; the others are missing among the rows.
    """
    found = []
    for source in sources(rows):
        mine = {r["case"]: r for r in rows if (r["motion"], r["base"]) == source}
        label = {"motion": source[0], "base": source[1] if source[0] == "ours" else None}
        for key, (text, pairs) in DURATION_TRENDS.items():
            ratios = {
                f"{a}<{b}": mine[a]["duration_s"] / mine[b]["duration_s"]
                for a, b in pairs
                if a in mine and b in mine
            }
            found.append(_trend(key, text, label, ratios, lambda ratio: ratio < 1 - SHORTER))
        for key, (text, cases) in HEIGHT_TRENDS.items():
            values = {c: (mine[c]["raised_m"], mine[c]["lowered_m"]) for c in cases if c in mine}
            found.append(_trend(key, text, label, values, HOLDS[key]))
    return found


HOLDS: dict[str, Callable[[tuple[float, float]], bool]] = {
    "raised": lambda v: v[0] >= CHANGED and v[0] > v[1],
    "lowered": lambda v: v[1] >= CHANGED and v[1] > v[0],
    "level": lambda v: max(v) < CHANGED,
}
"""By trend, whether (raised, lowered), m, are what it says."""


def sources(rows: Sequence[dict]) -> list[tuple[str, str]]:
    """Motion and base of what the trends are about; the printed motions are the same on either base."""
    known = {(r["motion"], r["base"]): None for r in rows}
    printed = next(iter(key for key in known if key[0] == "printed"), None)
    return [key for key in known if key[0] == "ours" or key == printed]


def _trend(key: str, text: str, label: dict, values: dict, holds: Callable[..., bool]) -> dict:
    return {
        "trend": key,
        "text": text,
        **label,
        "values": values,
        "found": [name for name, value in values.items() if holds(value)],
        "not_found": [name for name, value in values.items() if not holds(value)],
    }


# --- what is written ----------------------------------------------------------------------------------------


def markdown(data: dict) -> str:
    """Tables and sentences."""
    rows = data["rows"]
    lines = ["# Time scaling: faster and slower motions", "", *NOTES.splitlines(), ""]
    for base in data["options"]["bases"]:
        mine = [r for r in rows if r["base"] == base]
        lines += [f"## First loss of a contact, {base} base", "", *table(*_losses(mine)), ""]
        lines += [f"## Worst GN / GT against tau, {base} base", "", *table(*_reserves(mine)), ""]
    lines += ["## What the experiment saw (7.4)", "", *_experiment(rows), ""]
    lines += ["## Trends of the source's plans (5.9)", "", *_trends(data), ""]
    software = ", ".join(f"{package} {number}" for package, number in data["versions"].items())
    return "\n".join([*lines, f"{software}; {data['machine']['architecture']}."]) + "\n"


NOTES = f"""\
- *tau*: factor of all times, below 1 is faster. *tau\\**: the fastest that keeps all contacts, within
  {TOLERANCE:g}; *first loss*: what happens just below it, at contacts K1 to K3.
- *lost at 0.95, 0.90*: longest time without a break in which the contacts cannot hold the base at rest; what
  the base does then is not computed. Cells of {1000 * CELL:g} ms; "<" means less than one cell.
- *drives*: the smallest tau at which speeds and accelerations are within the drives' limits. Anything faster
  exists in computation only.
- GN and GT are the worst of the exact motion; above 1 they contain the acceleration of a contact. GT refers
  to the friction cones; slip begins at the edge of pyramids of {FACETS} facets, at a GT between
  {1 - radius_error(FACETS):.3f} and {1 + radius_error(FACETS):.3f}."""


def _losses(rows: Sequence[dict]) -> tuple[list[str], list[list[str]]]:
    head = ["case", "arm", "triangle, clamp", "motion", "duration [s]", "GN", "GT", "tau\\*",
            "first loss", "lost at 0.95 [ms]", "lost at 0.90 [ms]", "drives"]  # fmt: skip
    lines = []
    for r in rows:
        loss, at = r["first_loss"], by_tau(r)
        star = "none" if loss is None else f"{r['tau_star']:.4f}"
        lines.append([
            r["case"], r["arm"], f"{1000 * r['triangle_m']:.0f} mm{', clamp' if r['clamp'] else ''}",
            KINDS[r["motion"]], f"{r['duration_s']:.3f}", f"{at[1.0]['GN']:.3f}", f"{at[1.0]['GT']:.3f}",
            star if r["monotone"] else f"{star} (not the only one)",
            "" if loss is None else f"{loss['kind']} {' '.join(f'K{k}' for k in loss['contacts'])}",
            *(_milliseconds(at[tau], at[tau]["longest_s"]) for tau in (0.95, 0.90)),
            f"{r['tau_drives']:.3f}",
        ])  # fmt: skip
    return head, lines


def by_tau(row: dict) -> dict[float, dict]:
    """The results of a row by tau."""
    return {one["tau"]: one for one in row["taus"]}


def _milliseconds(one: dict, seconds: float) -> str:
    if one["stands"] or seconds:
        return f"{1000 * seconds:.1f}" if seconds else "0"
    return f"< {1000 * CELL:g}"


def _reserves(rows: Sequence[dict]) -> tuple[list[str], list[list[str]]]:
    taus = [tau for tau in by_tau(rows[0]) if tau in SHOWN]
    lines = []
    for r in rows:
        texts = [f"{one['GN']:.2f} / {one['GT']:.2f}" for tau, one in by_tau(r).items() if tau in taus]
        lines.append([f"{r['case']}, {KINDS[r['motion']]}", *texts])
    return ["case, motion", *(f"{tau:.2f}" for tau in taus)], lines


def _experiment(rows: Sequence[dict]) -> Iterator[str]:
    """Does every motion stand at tau = 1, and do 5 % less time separate contacts in B and C?"""
    yield (
        f"The source saw no contact open for more than {1000 * INTERRUPTION:.0f} ms at tau = 1 in any case, "
        "and called the contacts of B and C separated at tau = 0.95."
    )
    yield ""
    falling = [f"{r['case']} ({who(r)})" for r in rows if not by_tau(r)[1.0]["stands"]]
    yield f"At tau = 1 contacts are lost here in: {', '.join(falling) or 'none'}."
    if any(r["case"] in "BC" for r in rows):
        yield f"Longest lift-off of a contact; *found*: above {1000 * INTERRUPTION:.0f} ms at 0.95."
        yield ""
        lines = []
        for r in rows:
            if r["case"] in "BC":
                lifted = [max(by_tau(r)[tau]["lifted_s"]) for tau in (1.0, 0.95, 0.90)]
                found = "yes" if lifted[1] > INTERRUPTION else "shorter" if lifted[1] else "no"
                lines.append([r["case"], who(r), *(f"{1000 * x:.1f}" for x in lifted), found])
        yield from table(
            ["case", "motion", *(f"at {tau} [ms]" for tau in ("1.00", "0.95", "0.90")), "found"], lines
        )
    several = [f"{r['case']} ({who(r)})" for r in rows if not r["monotone"]]
    unsolved = sum(one["unsolved"] for r in rows for one in r["taus"])
    unable = [f"{r['case']} ({who(r)})" for r in rows if not r["rests_anywhere"]]
    yield ""
    yield (
        "Motions that lose a contact at some tau and keep all at a smaller one: "
        f"{', '.join(several) or 'none'}. "
        f"Paths on which the arm cannot rest everywhere: {', '.join(unable) or 'none'}. "
        f"Instants without a verified contact state: {unsolved}."
    )


def who(r: dict) -> str:
    """Whose motion, and on which base if that matters; of a row or a trend."""
    return KINDS[r["motion"]] + (f", {r['base']} base" if r["base"] else "")


def _trends(data: dict) -> Iterator[str]:
    """Per statement a line for each source of motions; then durations and heights."""
    for key, (text, _) in (DURATION_TRENDS | HEIGHT_TRENDS).items():
        mine = [t for t in data["trends"] if t["trend"] == key and t["values"]]
        yield from [f"*{text}*", ""] if mine else []
        for t in mine:
            words = {"found": t["found"], "not found": t["not_found"]}
            texts = {k: ", ".join(f"{x} ({_value(t['values'][x])})" for x in xs) for k, xs in words.items()}
            said = "; ".join(f"{k} in {text}" for k, text in texts.items() if text)
            yield f"- {who(t)}: {said}."
        yield from [""] if mine else []
    yield (
        f"In brackets ratios of durations (found: below {1 - SHORTER:g}), or by how many millimetres the "
        "centre of mass is raised and lowered against the straight line of the joint angles, at the same "
        f"angle of joint 1 (found: by {1000 * CHANGED:.0f} mm or more, and more than the other way)."
    )
    yield ""
    wanted = sources(data["rows"])
    chosen = sorted((r for r in data["rows"] if (r["motion"], r["base"]) in wanted), key=lambda r: r["case"])
    head = ["case", "motion", "duration [s]", "energy [J]", "raised [mm]", "at [%]", "lowered [mm]", "at [%]",
            "lowered [J]", "link end raised [mm]", "lowered [mm]"]  # fmt: skip
    lines = []
    for r in chosen:
        ways = [(1000 * r[f"{way}_m"], 100 * r[f"{way}_at"]) for way in ("raised", "lowered")]
        lines.append([
            r["case"], who(r if r["motion"] == "ours" else {**r, "base": None}),
            f"{r['duration_s']:.3f}", f"{r['energy_J']:.1f}",
            *(f"{x:.0f}" for way in ways for x in way), f"{r['lowered_J']:.1f}",
            f"{1000 * r['link_raised_m']:.0f}", f"{1000 * r['link_lowered_m']:.0f}",
        ])  # fmt: skip
    yield from table(head, lines)
    yield ""
    yield (
        "*at*: share of the duration at which it is so. *link*: the one that joint 2, of W1P1P2W2 joint 3, "
        "turns, about which the source saw the arms rise."
    )


def _value(value: float | Sequence[float]) -> str:
    """A ratio, or heights in mm."""
    if isinstance(value, float):
        return f"{value:.3f}"
    up, down = (f"{1000 * x:.0f}" for x in value)
    return f"+{up} -{down}"


def draw(data: dict) -> bytes:
    """PNG: worst GN and GT against tau, one panel per base and case."""
    cases, bases = data["options"]["cases"], data["options"]["bases"]
    columns = min(4, len(cases))
    per_base = -(-len(cases) // columns)
    figure = Figure(figsize=(1.0 + 3.1 * columns, 0.9 + 2.6 * per_base * len(bases)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(per_base * len(bases), columns, squeeze=False, sharex=True, sharey=True)
    for b, base in enumerate(bases):
        block = axes[b * per_base : (b + 1) * per_base].ravel()
        for axis, case in zip(block, cases, strict=False):
            mine = [r for r in data["rows"] if (r["base"], r["case"]) == (base, case)]
            _panel(axis, f"{case}, {base} base", mine)
        for axis in block[len(cases) :]:
            axis.set_visible(False)
    figure.supxlabel("time scaling tau (below 1: faster)")
    figure.supylabel("worst GN, GT of the motion")
    style = {"color": "#444444", "lw": 1.6}
    handles = [Line2D([], [], color=COLORS[kind], lw=2.5, label=name) for kind, name in KINDS.items()]
    handles += [Line2D([], [], ls=ls, label=name, **style) for name, ls in (("GN", "-"), ("GT", "--"))]
    handles += [
        Line2D([], [], ls="", marker="v", color="#444444", label="tau*: first loss of a contact"),
        Line2D([], [], color="#8b0000", lw=0.9, label="1: loss"),
        Line2D([], [], color="#888888", lw=0.9, ls=":", label=f"{LIMIT}: limit of the plans"),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=columns, frameon=False)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=110)
    return stream.getvalue()


def _panel(axis: Axes, title: str, rows: Sequence[dict]) -> None:
    axis.set_title(title, fontsize=10)
    axis.axhspan(1, TOP, color="#f3e1e1", lw=0)
    axis.axhline(1, color="#8b0000", lw=0.9)
    axis.axhline(LIMIT, color="#888888", lw=0.9, ls=":")
    axis.axvline(1, color="#cccccc", lw=0.8)
    for height, r in zip((1.42, 1.26), sorted(rows, key=lambda r: r["motion"]), strict=False):
        color, taus = COLORS[r["motion"]], [one["tau"] for one in r["taus"]]
        for name, ls in (("GN", "-"), ("GT", "--")):
            axis.plot(taus, [one[name] for one in r["taus"]], ls, color=color, lw=1.6)
        star = r["tau_star"]
        if star and taus[0] <= star <= taus[-1]:
            axis.plot([star], [1], "v", color=color, ms=7, zorder=4)
        text = "none" if star is None else f"{star:.4f}"
        axis.text(SLOWEST - 0.004, height, f"tau* {text}", color=color, ha="right", va="center", fontsize=9)
    axis.set_xlim(FASTEST, SLOWEST)
    axis.set_ylim(0, TOP)
    axis.set_xticks([0.95, 1.0, 1.05])
    axis.set_yticks([0, 0.3, 0.6, 0.9, 1.0, 1.5], ["0", "0.3", "0.6", "0.9", "", "1.5"])


# --- plans, command line ------------------------------------------------------------------------------------


def read_plan(folder: Path, case: MotionCase, base: str) -> ArmMotion | None:
    """The plan of a case on a base, or None if there is none.

    Raises:
        InputError: it cannot be read, or belongs to another case or base.
    """
    path = folder / f"{case.name}-{base}" / "plan.json"
    if not path.exists():
        return None
    try:
        motion, origin = load_motion(path), motion_origin(path)
    except InputError as error:
        raise InputError(f"{path.parent.name}: {error}") from None
    for key, own in (("case", case.name), ("base", base)):
        if origin.get(key, own) != own:
            raise InputError(f"{path}: {key} is {origin[key]}, must be {own}")
    for name in ("start", "goal"):
        angles, own = getattr(motion, name), getattr(case, name)
        if angles.shape != own.shape or not np.allclose(angles, own, atol=1e-4):
            raise InputError(f"{path}: the motion's {name} is not that of case {case.name}")
    return motion


def progress(done: int, total: int, what: str) -> None:
    """A bar on a terminal, nothing elsewhere."""
    if sys.stderr.isatty():
        bar = "#" * (30 * done // total)
        print(f"\r\033[K[{bar:<30}] {done}/{total} {what}", end="", file=sys.stderr, flush=True)


def run(plans: Path, cases: Sequence[str], bases: Sequence[str], step: float) -> dict:
    """All results as plain data.

    Raises:
        InputError: a plan cannot be used.
    """
    steps = round((SLOWEST - FASTEST) / step)
    taus = [round(FASTEST + k * (SLOWEST - FASTEST) / steps, 9) for k in range(steps + 1)]
    todo = []
    for base in bases:
        for case in map(motion_case, cases):
            limits = experiment_robot(case, base, facets=FACETS).arm.limits
            printed = case.reference_motion(limits.speed, limits.acceleration)
            motions = {"ours": read_plan(plans, case, base), "printed": printed}
            todo += [(case, base, kind, motion) for kind, motion in motions.items() if motion]
    rows = []
    for done, (case, base, kind, motion) in enumerate(todo):
        progress(done, len(todo), f"{case.name}, {base} base, {KINDS[kind]}")
        rows.append(row_of(case, base, kind, motion, taus))
    progress(len(todo), len(todo), "\n")
    return plain({
        "versions": versions(),
        "machine": {"architecture": platform.machine(), "cores": os.cpu_count()},
        "options": {"cases": list(cases), "bases": list(bases), "step": step, "cell_s": CELL},
        "rows": rows,
        "trends": trends(rows),
    })  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    names = list(motion_cases())
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for results, tables and figure")
    parser.add_argument(
        "--plans", type=Path, default=PLANS, help="folder with A-effective/plan.json and so on"
    )
    parser.add_argument("--cases", nargs="+", choices=names, default=names)
    parser.add_argument("--bases", nargs="+", choices=list(BASES), default=list(BASES))
    parser.add_argument("--step", type=float, default=0.01, help="of tau; 0.05 must be a multiple of it")
    given = parser.parse_args(argv)
    if not (0.001 <= given.step <= 0.05 and abs(0.05 / given.step - round(0.05 / given.step)) < 1e-6):
        parser.error(f"--step must be 0.05 divided by a whole number, 0.001 or more, got {given.step:g}")
    if not given.plans.is_dir():
        parser.error(f"--plans: there is no folder {given.plans}")
    cases, bases = ([x for x in known if x in asked] for known, asked in
                    ((names, given.cases), (BASES, given.bases)))  # fmt: skip
    try:
        data = run(given.plans, cases, bases, given.step)
    except OcptipError as error:
        print(f"time_scaling: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nInterrupted; nothing written.", file=sys.stderr)
        return 130
    text = markdown(data)
    compact = json.dumps(data["rows"], separators=(",", ":"), allow_nan=False).replace("},{", "},\n{")
    head = json.dumps({**data, "rows": []}, indent=1, allow_nan=False)
    files = {
        "json": head.replace('"rows": []', f'"rows": {compact}').encode(),
        "md": text.encode(),
        "png": draw(data),
    }
    given.out.mkdir(parents=True, exist_ok=True)
    for suffix, content in files.items():
        with atomic_file(given.out / f"time_scaling.{suffix}") as stream:
            stream.write(content)
    print(text, end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
