"""Makes the picture of docs/how-to/studio.md: the page of the studio in a headless Chromium.

python -m studies.pictures.studio_picture docs/studio.png

Prints the time of an answer to a changed posture, payload, floor and push: margins, robustness, worst case.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

import ocptip
from ocptip.api.studio import Studio
from ocptip.pictures.browser.studio import Actions, studio_page
from studies.pictures.browser import browser_page

TASK = Path(__file__).parents[2] / "src/ocptip/examples/tasks/ur5_cart.toml"
_CLOSE = "document.querySelector('[class*=Notification-close]')?.click()"


def print_times(studio: Studio, count: int = 100) -> None:
    """Median and maximum of random changes."""
    rng, q, found = np.random.default_rng(0), studio.conditions.q, []
    for _ in range(count + 1):
        change = {"q": q + 0.2 * rng.standard_normal(len(q)), "tilt": rng.uniform(0, 0.03)}
        change |= {"payload": rng.uniform(0, 5), "push": rng.uniform(0, 20), "towards": rng.uniform(0, 6)}
        times = [time.perf_counter()]
        for ask in (studio.answer, studio.robustness, studio.worst):
            ask(**change)
            times.append(time.perf_counter())
        found.append(1e3 * np.diff(times))
    for name, values in zip(("margins", "robustness", "worst case"), np.transpose(found[1:]), strict=True):
        print(f"{name}: median {np.median(values):.0f} ms, maximum {values.max():.0f} ms of {count} changes")


def main(path: Path) -> None:
    """Type a payload and a push into the page, and take its picture."""
    studio = ocptip.studio(TASK)
    print_times(studio)
    ends = {"start": studio.task.start, "goal": studio.task.goal}
    actions = Actions(lambda which, q: which, lambda: ("", ()))
    with studio_page(studio.task.name, studio.study, studio.conditions, ends, actions) as page:
        page.idle.wait(60)
        with browser_page(f"http://localhost:{page.server.get_port()}") as shown:
            shown.wait_for("document.body.innerText.includes('further push')")
            shown.enter("payload [kg]", 5.0)
            shown.enter("push at the TCP [N]", 30.0)
            page.idle.wait(60)
            shown.run(_CLOSE)
            time.sleep(3.0)  # the picture fades in
            shown.run("document.querySelectorAll('*').forEach(one => { one.scrollTop = 0 })")
            shown.picture(path)
        print(page.answered)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
