"""The worst case of a scene within an uncertainty."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ocptip.standing.tolerance import Uncertainty
from ocptip.task_files.scene import Scene

if TYPE_CHECKING:
    from ocptip.standing.within.rest import WithinAtRest


def worst_of_scene(scene: Scene, tolerance: Uncertainty, reference: float | None = None) -> WithinAtRest:
    """The worst case of a scene within an uncertainty; the reference moment, N m, is that of GN."""
    from ocptip.standing.within.rest import scene_within  # loads CasADi, which other scenes do not need

    return scene_within(scene.support, scene.loads, tolerance, reference)
