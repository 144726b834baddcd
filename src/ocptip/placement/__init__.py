"""Where the base should stand: optimal placement at rest.

Equation numbers such as (4.21) are those of thesis M, chapter 4 (docs/bibliography.md).
"""

from ocptip.placement.for_path import place_for_path
from ocptip.placement.place import place
from ocptip.placement.problem import GripperTask, PlacementLimits, PlacementProblem, ProcessLoad, Weights
from ocptip.placement.result import NoPlacementError
from ocptip.placement.scan import scan
from ocptip.placement.terrain import custom_terrain, plane, rough_ground

__all__ = [
    "GripperTask",
    "NoPlacementError",
    "PlacementLimits",
    "PlacementProblem",
    "ProcessLoad",
    "Weights",
    "custom_terrain",
    "place",
    "place_for_path",
    "plane",
    "rough_ground",
    "scan",
]
