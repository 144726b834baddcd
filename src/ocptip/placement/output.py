"""The file of a placement: placement.json. It appears complete or not at all.

Inside the library: SI units and rad; in the file lengths in m, and angles in degrees as their keys say.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ocptip.basics.write import plain, versions, write_json
from ocptip.placement.result import NoPlacementError, PlacementResult

PLACEMENT = "placement.json"


def result_to_dict(name: str, result: PlacementResult) -> dict[str, Any]:
    """Return a result as plain data for strict JSON; what is not finite is None.

    `best` and `alternatives` hold placements, see `Placement.to_dict`; `starts` what became of each.

    Args:
        name: of the task.
        result: from `place`.
    """
    assumed = list(result.best.problem.robot.notes)
    return {
        "task": name,
        "found": True,
        **result.to_dict(),
        "assumed": assumed,
        "versions": plain(versions()),
    }


def refusal_to_dict(name: str, error: NoPlacementError) -> dict[str, Any]:
    """Return why there is no placement: `reason`, and `nearest`, the one of minimum violation."""
    return {"task": name, "found": False, **error.to_dict(), "versions": plain(versions())}


def write_placement(directory: str | os.PathLike[str], data: Mapping[str, Any]) -> Path:
    """Write placement.json; a file of the same name is replaced.

    Args:
        directory: made if it does not exist; the one above it must.
        data: from :func:`result_to_dict` or :func:`refusal_to_dict`.

    Raises:
        OSError: the file or the directory cannot be written; names it.
    """
    directory = Path(directory)
    directory.mkdir(exist_ok=True)
    write_json(directory / PLACEMENT, data)
    return directory / PLACEMENT
