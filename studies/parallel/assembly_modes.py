"""Assembly modes of random hexapods, against Groebner bases.

    python -m studies.parallel.assembly_modes [--robots N] [--flat] [--msolve PROGRAM]

Every hexapod has whole-numbered joints and squared leg lengths. The reference writes its kinematics in
another way (rotation matrix and position: 12 unknowns, 27 equations over the rational numbers), and msolve
(Berthomieu, Eder, Safey El Din, 2021) isolates all its real solutions exactly; without the program only our
counts are shown.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import tempfile
import time
from collections import Counter
from fractions import Fraction
from pathlib import Path

import numpy as np

from ocptip.parallel.analysis.assembly_modes import assembly_modes
from ocptip.parallel.description.platform import BodyInertia
from ocptip.parallel.description.ready_made import make_robot
from ocptip.parallel.robot import ParallelRobot

_SIZE = 100
_UNKNOWNS = [*(f"R{i}{j}" for i in range(3) for j in range(3)), "x", "y", "z"]
_TURNS = ((0, 1, 2), (1, 2, 0), (2, 0, 1))


def random_hexapod(seed: int, flat: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Base and platform joints (6, 3), squared leg lengths (6,), whole numbers, and a pose near by (6,)."""
    rng = np.random.default_rng(seed)
    base, platform = rng.integers(-_SIZE, _SIZE + 1, (2, 6, 3)) * [1, 1, 0 if flat else 1]
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    R, r = Q * np.linalg.det(Q), rng.integers(-_SIZE, _SIZE + 1, 3)
    squares = np.rint(np.sum((r + platform @ R.T - base) ** 2, axis=1)).astype(int)
    return base, platform, squares, np.concatenate([r, _angles(R)])


def _angles(R: np.ndarray) -> np.ndarray:
    """Angles of the convention xyz."""
    return np.array(
        [np.arctan2(-R[1, 2], R[2, 2]), np.arcsin(np.clip(R[0, 2], -1, 1)), np.arctan2(-R[0, 1], R[0, 0])]
    )


def equations(base: np.ndarray, platform: np.ndarray, squares: np.ndarray) -> str:
    """The system in msolve's format."""
    product = "{}*{}".format
    lines = []
    for a in range(3):
        for b in range(a, 3):
            one = "-1" if a == b else ""
            for pairs in (
                [(3 * a + k, 3 * b + k) for k in range(3)],
                [(3 * k + a, 3 * k + b) for k in range(3)],
            ):
                terms = [
                    f"R{i // 3}{i % 3}^2" if i == j else product(_UNKNOWNS[i], _UNKNOWNS[j]) for i, j in pairs
                ]
                lines.append("+".join(terms) + one)
    for i, j, k in _TURNS:
        for a, b, c in _TURNS:
            lines.append(f"R{i}{a}*R{j}{b}-R{i}{b}*R{j}{a}-R{k}{c}")
    for c, k, square in zip(base.tolist(), platform.tolist(), squares.tolist(), strict=True):
        terms = ["x^2", "y^2", "z^2", str(sum(v * v for v in (*c, *k)) - square)]
        for i, name in enumerate("xyz"):
            terms.append(f"{-2 * c[i]}*{name}")
            for j in range(3):
                terms += [f"{2 * k[j]}*{name}*R{i}{j}", f"{-2 * c[i] * k[j]}*R{i}{j}"]
        lines.append("+".join(t for t in terms if not t.startswith("0*")))
    return ",".join(_UNKNOWNS) + "\n0\n" + ",\n".join(lines).replace("+-", "-") + "\n"


def exact_solutions(program: str, text: str) -> np.ndarray:
    """(N, 12) real solutions, middles of the intervals that msolve proves to hold one each."""
    with tempfile.TemporaryDirectory() as folder:
        source, result = Path(folder) / "system.ms", Path(folder) / "solutions.ms"
        source.write_text(text)
        subprocess.run([program, "-f", str(source), "-o", str(result)], check=True, capture_output=True)
        out = result.read_text().strip().rstrip(":")
    values = _numbers(out)
    if values[0] != 0:
        raise ValueError(f"msolve: expected finitely many solutions, got {out[:60]}")
    boxes = values[1][1]
    return np.array(
        [[float((Fraction(low) + Fraction(high)) / 2) for low, high in box] for box in boxes]
    ).reshape(-1, 12)


def _numbers(text: str) -> list:
    """msolve's nested lists; quotients by powers of two become texts of fractions."""
    quoted = re.sub(r"(-?\d+) / 2\^(\d+)", lambda m: f'"{m[1]}/{2 ** int(m[2])}"', text)
    return json.loads(quoted)


def main() -> None:
    """Print counts, agreement and times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=100)
    parser.add_argument("--msolve", help="the program; none: only our own counts")
    parser.add_argument("--flat", action="store_true", help="all joints of a body in one plane")
    options = parser.parse_args()
    counts, seconds, theirs, same, gap = Counter(), [], [], 0, 0.0
    body, plate = BodyInertia.about_center(1.0), BodyInertia.about_center(1.0)
    for seed in range(options.robots):
        base, platform, squares, home = random_hexapod(seed, options.flat)
        robot = make_robot(
            "6UPS", base_angles=np.zeros(6), base_positions=base / _SIZE, coupling_points=platform / _SIZE,
            bodies=(body,) * 3, platform=plate, home=[*home[:3] / _SIZE, *home[3:]],
        )  # fmt: skip
        found = assembly_modes(ParallelRobot(robot).kinematics, np.sqrt(squares) / _SIZE)
        counts[len(found.modes)] += 1
        seconds.append(found.seconds)
        if not found.complete or not all(mode.certified for mode in found.modes):
            print(f"seed {seed}: {found.regular} of {found.paths} paths, {found.singular} singular")
        if options.msolve:
            start = time.perf_counter()
            exact = exact_solutions(options.msolve, equations(base, platform, squares))
            theirs.append(time.perf_counter() - start)
            ours = np.array([[*m.rotation.ravel(), *m.position] for m in found.modes]).reshape(-1, 12)
            same += len(exact) == len(ours)
            exact[:, 9:] /= _SIZE
            gap = max([gap, *(np.abs(ours - one).max(axis=1).min() for one in exact if len(ours))])
    print("real modes: hexapods  " + ", ".join(f"{k}: {counts[k]}" for k in sorted(counts)))
    print(f"CPU seconds per hexapod: median {np.median(seconds):.2f}, largest {max(seconds):.2f}")
    if options.msolve:
        print(f"as many as msolve: {same} of {options.robots}; largest distance to its solutions {gap:.1e}")
        print(f"msolve, seconds: median {np.median(theirs):.2f}, largest {max(theirs):.2f}")


if __name__ == "__main__":
    main()
