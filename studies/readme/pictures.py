"""The figures of plans, scenes, placements, timings and charts in the docs, as the commands draw them.

    python -m studies.readme.pictures --out docs

Takes about three minutes; the moving picture of the README has a script of its own (`animation.py`).
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from ocptip.cli.main import main as ocptip
from studies.common import EXAMPLES

CHART = ["--most", "30", "--levels", "0", "5", "10", "15", "20"]  # as in docs/how-to/load-charts.md
PLAN = ("motion", "ground", "drives")


def stacked(paths: list[Path], out: Path) -> None:
    """Pictures below each other, in the width of the first."""
    pictures = [Image.open(path).convert("RGB") for path in paths]
    wide = pictures[0].width
    rows = [np.asarray(one.resize((wide, round(one.height * wide / one.width)))) for one in pictures]
    Image.fromarray(np.vstack(rows)).save(out)


def draw(out: Path) -> None:
    """All of them."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        tasks, paths = EXAMPLES / "tasks", EXAMPLES / "paths"
        for arguments in (
            ["plan", "B", "--out", f"{folder / 'plan'}"],
            ["place", f"{tasks / 'place_ur5_wall.toml'}", "--out", f"{folder / 'place'}"],
            ["retime", f"{paths / 'ur5_sweep.json'}", "--task", f"{tasks / 'ur5_cart.toml'}",
             "--tolerance", "none", "--out", f"{folder / 'retime'}"],
            ["chart", f"{tasks / 'ur5_cart.toml'}", *CHART, "--out", f"{folder / 'chart'}"],
            ["stand", f"{EXAMPLES / 'scenes' / 'rover_on_slope.toml'}", "--plot", f"{folder / 'stand.png'}"],
        ):  # fmt: skip
            if ocptip(arguments):
                raise SystemExit(f"ocptip {' '.join(arguments)}: not as the docs say")
        for name in PLAN:
            shutil.copy(folder / "plan" / f"{name}.png", out / f"plan-{name}.png")
        shutil.copy(folder / "chart" / "chart.png", out / "chart.png")
        shutil.copy(folder / "stand.png", out / "stand.png")
        shutil.copy(folder / "retime" / "phase_plane.png", out / "retiming.png")
        stacked([folder / "place" / f"{name}.png" for name in ("placement", "map")], out / "place.png")


def main(argv: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the pictures")
    draw(parser.parse_args(argv).out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
