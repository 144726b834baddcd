"""Where things lie."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = ROOT / "src" / "ocptip" / "examples"
RESULTS = ROOT / "studies" / "results"
UR5 = ROOT / "tests" / "robots" / "data" / "ur5.urdf"
