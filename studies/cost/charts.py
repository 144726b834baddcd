"""How many postures a second a load chart takes: drawn, kept, with all limits within `workshop`.

python -m studies.cost.charts
"""

from __future__ import annotations

import time
from pathlib import Path

import ocptip

TASKS = Path(ocptip.__file__).parent / "examples/tasks"
COUNT = 10_000


def main() -> None:
    """Print a line per task; the first chart compiles and is not counted."""
    for name in ("kit_arm", "ur5_cart"):
        task = ocptip.load_task(TASKS / f"{name}.toml", uncertainty="workshop")
        ocptip.chart(task, samples=100)
        begin, cpu = time.perf_counter(), time.process_time()
        found = ocptip.chart(task, samples=COUNT)
        wall, cpu = time.perf_counter() - begin, time.process_time() - cpu
        print(
            f"{name}: {COUNT / cpu:.0f} postures per second of CPU ({COUNT / wall:.0f} of wall time), "
            f"{len(found.q)} of {COUNT} keep the clearance"
        )


if __name__ == "__main__":
    main()
