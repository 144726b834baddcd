"""How fast may a Delta or a hexapod on a three-footed cart move before the cart tips or slips?

    python -m studies.parallel.on_support --out FOLDER
        [--samples 81] [--directions 12] [--limit 0.9]

A rest-to-rest motion of fixed shape (the Delta picks and places, the hexapod sways and tilts) is run in
several directions. The wrench on the cart is that of rest plus a part that goes with one over the square of
the duration, so that one pass of inverse dynamics gives every duration. The shortest duration keeps GN and GT
below the limit and every foot sticking, at all samples.

Writes parallel_on_support.json, .md and .png, and per robot a scene of the worst instant of the slowest
direction, for `ocptip stand`.
"""

from __future__ import annotations

import argparse
import platform
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ocptip.basics.write import versions, write_json, write_text
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.parallel.description.ready_made import delta, ups6
from ocptip.parallel.robot import ParallelRobot
from ocptip.reserves.tipping import TipOver
from ocptip.robots.motors import DCMotors
from ocptip.robots.payload import Payload
from ocptip.standing.platform import PlatformLimits, StandingParallelRobot
from studies.common import table

_NAME = "parallel_on_support"
_BISECTIONS = 40


@dataclass(frozen=True)
class Case:
    """A robot on a cart with its motion.

    Attributes:
        name: for files and titles.
        robot: on its place on the cart.
        path: of normalised time (N,) in 0..1 and direction (rad): z and its two derivatives, (N, m) each.
    """

    name: str
    robot: StandingParallelRobot
    path: Callable[[np.ndarray, float], tuple[np.ndarray, np.ndarray, np.ndarray]]


def cart(*, height: float, mass: float) -> Support:
    """Three rubber feet on a circle of 0.3 m; the centre of mass at `height`, m."""
    angles = np.deg2rad([90.0, 210.0, 330.0])
    feet = [
        UnilateralContact(position=(0.3 * np.cos(a), 0.3 * np.sin(a), 0.0), friction=0.4, facets=12)
        for a in angles
    ]
    return Support(feet, mass=mass, center_of_mass=(0.0, 0.0, height))


def step(tau: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Smooth step 0 to 1 of fifth degree with its two derivatives."""
    p = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
    return p(tau), p.deriv()(tau), p.deriv(2)(tau)


def bump(tau: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Smooth bump 0 to 1 to 0, at rest at both ends, with its two derivatives."""
    p = 64 * np.polynomial.Polynomial([0, 1, -1]) ** 3
    return p(tau), p.deriv()(tau), p.deriv(2)(tau)


def pick_and_place(tau: np.ndarray, direction: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Delta: 0.3 m across, lifted by 0.05 m on the way."""
    c, s = np.cos(direction), np.sin(direction)
    across, up = step(tau), bump(tau)
    rows = [np.column_stack([c * 0.3 * a, s * 0.3 * a, 0.05 * b]) for a, b in zip(across, up, strict=True)]
    return rows[0] + [-0.15 * c, -0.15 * s, -0.5], rows[1], rows[2]


def sway(tau: np.ndarray, direction: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Hexapod: 0.1 m aside and back, tilted by 10 degrees about the axis across."""
    c, s = np.cos(direction), np.sin(direction)
    shape = np.array([0.1 * c, 0.1 * s, 0.0, -np.deg2rad(10) * s, np.deg2rad(10) * c, 0.0])
    rows = [np.outer(b, shape) for b in bump(tau)]
    return rows[0] + [0, 0, 0.6, 0, 0, 0], rows[1], rows[2]


def cases() -> list[Case]:
    """Delta under a portal with 1 kg of payload, hexapod on a low table."""
    result = []
    for name, description, height, mass, place, path in (
        ("delta", delta().with_payload(Payload(1.0)), 0.35, 30.0, 0.9, pick_and_place),
        ("hexapod", ups6(), 0.2, 30.0, 0.3, sway),
    ):
        support = cart(height=height, mass=mass)
        robot = ParallelRobot(description)
        standing = StandingParallelRobot(
            robot,
            support,
            DCMotors(np.ones(robot.m), *np.zeros((3, robot.m))),  # power is not asked for
            PlatformLimits(),
            position=(0.0, 0.0, place),
            reference_moment=TipOver(support).reference_moment,
        )
        result.append(Case(name, standing, path))
    return result


@dataclass(frozen=True)
class Wrenches:
    """Wrench on the cart (N, 6) at duration T: `rest` + `moving` / T^2, the cart's weight included; motor
    forces likewise."""

    rest: np.ndarray
    moving: np.ndarray
    motors_rest: np.ndarray
    motors_moving: np.ndarray

    def at(self, duration: float) -> np.ndarray:
        """(N, 6)."""
        return self.rest + self.moving / duration**2

    def motors(self, duration: float) -> np.ndarray:
        """(N, n_a)."""
        return self.motors_rest + self.motors_moving / duration**2


def wrenches(case: Case, direction: float, samples: int) -> Wrenches:
    """One pass of inverse dynamics at rest and one at a duration of 1 s."""
    tau = np.linspace(0.0, 1.0, samples)
    z, zd, zdd = case.path(tau, direction)
    still = case.robot.samples_of(tau, z, 0 * z, 0 * z)
    moving = case.robot.samples_of(tau, z, zd, zdd)
    return Wrenches(
        still.wrenches, moving.wrenches - still.wrenches, still.torques, moving.torques - still.torques
    )


def reserves(case: Case, total: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """GN, GT and whether the cart stands, of total wrenches (N, 6)."""
    states = case.robot.contact_states(total)
    tip = case.robot.tip_over.evaluate(states)
    slip = case.robot.slip.evaluate(states, derivatives=False)
    return tip.GN, slip.GT, states.persistent


def allowed(case: Case, total: np.ndarray, limit: float) -> bool:
    """Whether all states stand with both reserves below the limit."""
    GN, GT, stands = reserves(case, total)
    return bool(np.all(stands)) and max(GN.max(), GT.max()) < limit


def shortest_duration(case: Case, found: Wrenches, limit: float) -> float:
    """Smallest duration at which the motion is allowed, s, by bisection to six digits."""
    fast, slow = 0.02, 0.04
    while not allowed(case, found.at(slow), limit):
        fast, slow = slow, 2 * slow
        if slow > 100:
            raise SystemExit(f"{case.name}: not allowed even at rest")
    for _ in range(_BISECTIONS):
        middle = 0.5 * (fast + slow)
        if allowed(case, found.at(middle), limit):
            slow = middle
        else:
            fast = middle
        if slow - fast < 1e-6 * slow:
            break
    return slow


def scene_text(case: Case, wrench: np.ndarray, title: str) -> str:
    """A scene file of the cart under one wrench of the robot about the cart's centre of mass."""
    support = case.robot.support
    com = ", ".join(repr(float(v)) for v in support.center_of_mass)
    lines = [f"# {title}", "[base]", f"mass = {support.mass!r}", f"center_of_mass = [{com}]"]
    for contact in support.contacts:
        position = ", ".join(repr(float(v)) for v in contact.position)
        lines += [
            "",
            "[[contact]]",
            'kind = "unilateral"',
            f"position = [{position}]",
            f"friction = {contact.friction!r}",
            f"facets = {contact.facets}",
        ]
    force, moment = (", ".join(repr(float(v)) for v in part) for part in (wrench[:3], wrench[3:]))
    lines += ["", "[[load]]", f"force = [{force}]", f"moment = [{moment}]", f"point = [{com}]"]
    return "\n".join(lines) + "\n"


def run(case: Case, samples: int, directions: int, limit: float, out: Path) -> dict[str, object]:
    """Shortest duration in every direction; writes the scene of the worst instant."""
    rows, profile = [], None
    for number in range(directions):
        direction = 2 * np.pi * number / directions
        found = wrenches(case, direction, samples)
        duration = shortest_duration(case, found, limit)
        GN, GT, _ = reserves(case, found.at(duration))
        rows.append(
            {
                "direction_deg": round(float(np.rad2deg(direction)), 6),
                "duration_s": duration,
                "GN": float(GN.max()),
                "GT": float(GT.max()),
                "bound_by": "tip-over" if GN.max() > GT.max() else "slip",
                "largest_motor": float(np.abs(found.motors(duration)).max()),
            }
        )
        if profile is None or duration > profile["duration"]:
            worst = int(np.argmax(np.maximum(GN, GT)))
            profile = {"duration": duration, "GN": GN, "GT": GT}
            title = (
                f"{case.name} on its cart, direction {np.rad2deg(direction):.0f} deg, T = {duration:.4f} s"
            )
            text = scene_text(case, found.at(duration)[worst] - case.robot.support.weight, title)
    (out / f"{_NAME}_{case.name}.toml").write_text(text, encoding="utf-8")
    return {
        "robot": case.robot.robot.description.name,
        "case": case.name,
        "directions": rows,
        "slowest": {name: np.asarray(value).tolist() for name, value in profile.items()},
    }


def markdown(results: list[dict], limit: float, samples: int) -> str:
    """The results in Markdown."""
    lines = [
        "# Parallel robots on a three-footed cart: shortest durations",
        "",
        f"GN and GT below {limit} at {samples} samples; written by `studies/parallel/on_support.py`.",
    ]
    for result in results:
        rows = [
            [
                f"{row['direction_deg']:.0f}",
                f"{row['duration_s']:.4f}",
                *(f"{row[name]:.3f}" for name in ("GN", "GT")),
                row["bound_by"],
                f"{row['largest_motor']:.1f}",
            ]
            for row in result["directions"]
        ]
        head = ["direction [deg]", "duration [s]", "GN", "GT", "bound by", "largest motor force"]
        lines += ["", f"## {result['case']}", "", *table(head, rows, left=0)]
    return "\n".join(lines) + "\n"


def plot(results: list[dict], limit: float, target: Path) -> None:
    """Reserves over the slowest motion, and durations over the direction."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure = pyplot.figure(figsize=(9, 3.2 * len(results)))
    for row, result in enumerate(results):
        left = figure.add_subplot(len(results), 2, 2 * row + 1)
        slowest = result["slowest"]
        times = np.linspace(0, slowest["duration"], len(slowest["GN"]))
        left.plot(times, slowest["GN"], label="GN (tip-over)")
        left.plot(times, slowest["GT"], label="GT (slip)")
        left.axhline(limit, color="0.4", linestyle=":", label="limit")
        left.set(
            xlabel="time [s]", ylabel="reserve", title=f"{result['case']}, slowest direction", ylim=(0, 1)
        )
        left.legend()
        right = figure.add_subplot(len(results), 2, 2 * row + 2, projection="polar")
        rows = [*result["directions"], result["directions"][0]]
        right.plot(
            np.deg2rad([r["direction_deg"] for r in rows]), [r["duration_s"] for r in rows], marker="."
        )
        right.set_title("shortest duration [s] over direction", fontsize=10)
        right.set_rmin(0)
    figure.tight_layout()
    figure.savefig(target, dpi=120)
    pyplot.close(figure)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--samples", type=int, default=81)
    parser.add_argument("--directions", type=int, default=12)
    parser.add_argument("--limit", type=float, default=0.9)
    options = parser.parse_args(arguments)
    if options.samples < 3 or options.directions < 1 or not 0 < options.limit <= 1:
        parser.error("--samples must be at least 3, --directions at least 1 and --limit in (0, 1]")
    options.out.mkdir(parents=True, exist_ok=True)
    results = [run(case, options.samples, options.directions, options.limit, options.out) for case in cases()]
    text = markdown(results, options.limit, options.samples)
    data = {
        "options": {
            "samples": options.samples,
            "directions": options.directions,
            "limit": options.limit,
        },
        "versions": {**versions(("numpy",)), "machine": platform.machine()},
        "results": results,
    }
    write_json(options.out / f"{_NAME}.json", data, indent=1)
    write_text(options.out / f"{_NAME}.md", text)
    plot(results, options.limit, options.out / f"{_NAME}.png")
    print(text, end="")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
