"""Where the base should stand: optimal placement at rest (chapter 4)."""

from ocptip.placement.evaluate import Evaluator
from ocptip.placement.for_motion import MotionPlacement, MotionPlacementResult, place_for_motion, placed_robot
from ocptip.placement.place import place
from ocptip.placement.power import HoldingPower, TorqueCost
from ocptip.placement.problem import (
    GripperTask,
    PlacementLimits,
    PlacementProblem,
    ProcessLoad,
    Weights,
    sampled_loads,
)
from ocptip.placement.result import Margin, NoPlacementError, Placement, PlacementResult, judge
from ocptip.placement.scan import Scan, scan
from ocptip.placement.terrain import Patch, custom_terrain, plane

__all__ = [
    "Evaluator",
    "GripperTask",
    "HoldingPower",
    "Margin",
    "MotionPlacement",
    "MotionPlacementResult",
    "NoPlacementError",
    "Patch",
    "Placement",
    "PlacementLimits",
    "PlacementProblem",
    "PlacementResult",
    "ProcessLoad",
    "Scan",
    "TorqueCost",
    "Weights",
    "custom_terrain",
    "judge",
    "place",
    "place_for_motion",
    "placed_robot",
    "plane",
    "sampled_loads",
    "scan",
]
