"""CPU seconds, peak memory and cone programs on four wheels, by `python -m studies.cost.run`.

Each case runs `ocptip check`, or `ocptip retime` of waypoints, in a process of its own. Recordings are
seeded: smooth motions between random postures with structural vibrations and encoder noise. Machine code
and bytecode must be in caches, as of an installed package: the first runs are left out. Other processes on
the same cores can double CPU seconds: a loop of known work tells by how much.
"""

from __future__ import annotations

import io
import os
import resource
import subprocess
import sys
import tempfile
import time
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np

from ocptip.basics.write import versions
from ocptip.cli.main import main as ocptip_main
from ocptip.reserves.minimax import ConeBatch
from studies.common import EXAMPLES, RESULTS, software, table

CASES = {
    "57 s at 500 Hz": (57.0, 500.0),
    "57 s at 500 Hz, within workshop": (57.0, 500.0),
    "57 s at 125 Hz": (57.0, 125.0),
    "9.4 s at 125 Hz": (9.4, 125.0),
    "2 s of rest at 100 Hz": (2.0, 100.0),
}
RETIMED = "timing of 384 waypoints, within workshop"
WAYPOINTS = 384
LOOP = 10_000_000
NOISE = 2e-5  # rad
TASK = EXAMPLES / "tasks" / "ur5_cart.toml"
START = np.radians([65.0, -140.0, -55.0, 110.0, -95.0, 160.0])


def recording(duration: float, rate: float, rests: bool, seed: int = 0) -> str:
    """CSV of joint angles."""
    rng, times = np.random.default_rng(seed), np.arange(round(duration * rate) + 1) / rate
    legs = max(2, int(duration / 1.9))
    postures = START + rng.uniform(-0.25, 0.25, (legs + 1, 6)) * (not rests)
    postures[[0, -1]] = START
    leg = np.minimum((times * legs / duration).astype(int), legs - 1)
    share = np.clip((times - leg * duration / legs) / (0.85 * duration / legs), 0, 1)
    way = (10 * share**3 - 15 * share**4 + 6 * share**5)[:, None]
    angles = postures[leg] + (postures[leg + 1] - postures[leg]) * way
    if not rests:
        for frequency in (11.0, 17.0, 23.0):
            phase = 2 * np.pi * frequency * times[:, None] + rng.uniform(0, 6, 6)
            angles += 2e-4 * (10 / frequency) ** 2 * 4 * way * (1 - way) * np.sin(phase)
        angles += NOISE * rng.standard_normal(angles.shape)
    lines = ["time," + ",".join(f"q{joint}_rad" for joint in range(1, 7))]
    lines += [f"{t:.6f}," + ",".join(f"{q:.8f}" for q in row) for t, row in zip(times, angles, strict=True)]
    return "\n".join(lines) + "\n"


def waypoints() -> str:
    """TOML of a smooth path around the start posture."""
    s = np.linspace(0, 1, WAYPOINTS)[:, None]
    swing = np.array([40.0, 20.0, 24.0, 32.0, 28.0, 40.0])
    angles = np.degrees(START) + swing * np.sin(2 * np.pi * s * (1 + np.arange(6) % 3) / 1.5 + np.arange(6))
    return 'between = "spline"\n' + "".join(
        f"[[waypoint]]\nat_deg = [{', '.join(f'{q:.10f}' for q in row)}]\n" for row in angles
    )


def measured(name: str) -> str:
    """CPU seconds, peak memory, MB, and cone programs of one case, in a process of its own."""
    programs, solve = [0], ConeBatch.solve

    def counted(self: ConeBatch, A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        programs[0] += len(A)
        return solve(self, A, b)

    ConeBatch.solve = counted  # type: ignore[method-assign]
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()):
        path, within = Path(folder) / "recording.csv", "workshop" if "workshop" in name else "none"
        if name == RETIMED:
            path = path.with_name("waypoints.toml")
            path.write_text(waypoints())
            command = ["retime", str(path), "--out", str(path.with_name("timed"))]
        else:
            path.write_text(recording(*CASES[name], rests="rest" in name))
            command = ["check", str(path)]
        ocptip_main([*command, "--task", str(TASK), "--tolerance", within, "--json"])
    used = resource.getrusage(resource.RUSAGE_SELF)
    return f"{used.ru_utime + used.ru_stime:.1f} {used.ru_maxrss / 1024:.0f} {programs[0]}"


def main() -> None:
    """All cases; writes the table."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        bytecode = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": folder}
        for name in (next(reversed(CASES)), RETIMED, *CASES, RETIMED):
            before = loop()
            command = [sys.executable, "-m", "studies.cost.run", name]
            answer = subprocess.run(
                command, capture_output=True, text=True, check=True, env={**os.environ, **bytecode}
            ).stdout
            rows.append([name, *answer.split(), f"{0.5 * (before + loop()):.2f}"])
            print(*rows[-1])
    head = ["recording or path, six joints, four wheels", "CPU, s", "peak memory, MB", "cone programs"]
    head.append("loop, s")
    text = ["# Cost of checks and of retiming", "", software(versions()), ""]
    text += [f"Loop: CPU seconds of {LOOP / 1e6:.0f} million additions in Python before and after, mean."]
    text += ["About 0.5 on an idle core of this machine; other processes raise all seconds alike.", ""]
    (RESULTS / "cost.md").write_text("\n".join([*text, *table(head, rows[2:])]) + "\n")


def loop() -> float:
    """CPU seconds of work that is always the same."""
    began, total = time.process_time(), 0
    for k in range(LOOP):
        total += k
    return time.process_time() - began


if __name__ == "__main__":
    print(measured(sys.argv[1])) if sys.argv[1:] else main()
