"""Performance indices of arms and Stewart-Gough platforms: how well a pose transmits motion.

Arms (`rate_arm`, `index_values`) and platforms (`rate_platform`) have one entry point each for all indices of
a pose; the modules hold the single indices, their forms for optimisers, and designs that are optimal in them.
"""

from ocptip.indices.arm_design import best_arm_pose, isotropic_axes, workspace_index
from ocptip.indices.arm_symbolic import (
    SymbolicArm,
    dm_2_constraint,
    dm_inf_constraint,
    index_expression,
    index_function,
    inv_cdn_oe_constraint,
    manipulability_constraint,
    pi_oe_constraint,
)
from ocptip.indices.arm_values import ARM_INDICES, index_values
from ocptip.indices.arms import arm_by_name, arm_from_spears, arm_pose, irb_2000
from ocptip.indices.controllability import ControlNumber, control_number
from ocptip.indices.distance import SingularityDistance, singularity_distance
from ocptip.indices.encodings import ConstraintBlock, isotropy_surrogate, psd_constraint, ratio_constraint
from ocptip.indices.entry import IndexEntry
from ocptip.indices.flight_simulator import FlightSimulator
from ocptip.indices.isotropic_families import isotropic_u1, isotropic_u2
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.operation import OperationIndices, operation_indices
from ocptip.indices.optimal_platforms import OptimalPlatform, ctn_optimal_main, ctn_optimal_special
from ocptip.indices.optimal_search import search_optimal
from ocptip.indices.planar_platforms import PlanarPlatformPose, optimal_planar_pose
from ocptip.indices.platform_files import PlatformFile, read_platform
from ocptip.indices.platform_isotropy import platform_conditioning
from ocptip.indices.platform_rating import rate_platform
from ocptip.indices.platform_reviewed import best_complex, rigidity_rate
from ocptip.indices.platform_search import best_pose, quality_index
from ocptip.indices.platform_symbolic import SymbolicPlatform
from ocptip.indices.platform_workspace import control_numbers, workspace_statistics
from ocptip.indices.platforms import PlatformPose, StewartPlatform
from ocptip.indices.rate import ArmRating, rate_arm

__all__ = [
    "ARM_INDICES",
    "ArmRating",
    "ConstraintBlock",
    "ControlNumber",
    "FlightSimulator",
    "IndexEntry",
    "OperationEllipsoid",
    "OperationIndices",
    "OptimalPlatform",
    "PlanarPlatformPose",
    "PlatformFile",
    "PlatformPose",
    "SingularityDistance",
    "StewartPlatform",
    "SymbolicArm",
    "SymbolicPlatform",
    "arm_by_name",
    "arm_from_spears",
    "arm_pose",
    "best_arm_pose",
    "best_complex",
    "best_pose",
    "control_number",
    "control_numbers",
    "ctn_optimal_main",
    "ctn_optimal_special",
    "dm_2_constraint",
    "dm_inf_constraint",
    "index_expression",
    "index_function",
    "index_values",
    "inv_cdn_oe_constraint",
    "irb_2000",
    "isotropic_axes",
    "isotropic_u1",
    "isotropic_u2",
    "isotropy_surrogate",
    "manipulability_constraint",
    "operation_indices",
    "optimal_planar_pose",
    "pi_oe_constraint",
    "platform_conditioning",
    "psd_constraint",
    "quality_index",
    "rate_arm",
    "rate_platform",
    "ratio_constraint",
    "read_platform",
    "rigidity_rate",
    "search_optimal",
    "singularity_distance",
    "workspace_index",
    "workspace_statistics",
]
