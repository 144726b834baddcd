"""What the tests of workers let them do."""

import os
import signal
import time
from pathlib import Path


def dies(times: int, folder: str, answer: int) -> int:
    """The answer; the first `times` processes that are asked die without a word."""
    for k in range(times):
        try:
            (Path(folder) / f"{answer}-{k}").touch(exist_ok=False)
        except FileExistsError:
            continue
        os.kill(os.getpid(), signal.SIGKILL)
    return answer


def slow(answer: int) -> int:
    """The answer, after a while."""
    time.sleep(0.3)
    return answer


def refuses(text: str) -> None:
    """Raises."""
    raise ValueError(text)


def threads() -> str | None:
    """Of linear algebra, as the environment says."""
    return os.getenv("OMP_NUM_THREADS")
