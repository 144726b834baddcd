"""Performance indices of arms and Stewart-Gough platforms: how well a pose transmits motion.

Arms (`rate_arm`, `index_values`) and platforms (`rate_platform`) have one entry point each for all indices of
a pose; the modules hold the single indices, their forms for optimisers, and designs that are optimal in them.
"""

from ocptip.indices.arms.axes import arm_from_spears, arm_pose
from ocptip.indices.arms.design import best_arm_pose, isotropic_axes, workspace_index
from ocptip.indices.arms.distance import SingularityDistance, singularity_distance
from ocptip.indices.arms.operation import OperationIndices, operation_indices
from ocptip.indices.arms.rate import ArmRating, rate_arm
from ocptip.indices.arms.symbolic import (
    SymbolicArm,
    dm_2_constraint,
    dm_inf_constraint,
    index_expression,
    index_function,
    inv_cdn_oe_constraint,
    manipulability_constraint,
    pi_oe_constraint,
)
from ocptip.indices.arms.values import ARM_INDICES, index_values
from ocptip.indices.designs.isotropic_families import isotropic_u1, isotropic_u2
from ocptip.indices.designs.optimal_platforms import OptimalPlatform, ctn_optimal_main, ctn_optimal_special
from ocptip.indices.designs.optimal_search import search_optimal
from ocptip.indices.designs.platform_search import best_pose, quality_index
from ocptip.indices.encodings import ConstraintBlock, isotropy_surrogate, psd_constraint, ratio_constraint
from ocptip.indices.entry import IndexEntry
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.controllability import ControlNumber, control_number
from ocptip.indices.platforms.flight_simulator import FlightSimulator
from ocptip.indices.platforms.isotropy import platform_conditioning
from ocptip.indices.platforms.planar import PlanarPlatformPose, optimal_planar_pose
from ocptip.indices.platforms.platform import PlatformPose, StewartPlatform
from ocptip.indices.platforms.rate import rate_platform
from ocptip.indices.platforms.reviewed import best_complex, rigidity_rate
from ocptip.indices.platforms.symbolic import SymbolicPlatform
from ocptip.indices.platforms.workspace import control_numbers, workspace_statistics

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
    "PlatformPose",
    "SingularityDistance",
    "StewartPlatform",
    "SymbolicArm",
    "SymbolicPlatform",
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
    "rigidity_rate",
    "search_optimal",
    "singularity_distance",
    "workspace_index",
    "workspace_statistics",
]
