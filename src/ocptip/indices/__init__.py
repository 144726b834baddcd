"""Performance indices of arms and Stewart-Gough platforms: how well a pose transmits motion.

Arms (`rate_arm`, `index_values`) and platforms (`rate_platform`) have one entry point each for all indices of
a pose; the modules hold the single indices.

Equation numbers such as (4.14), and [Naw07], are those of G. Nawratil's thesis, TU Wien 2007
(docs/bibliography.md).
"""

from ocptip.indices.arms.distance import singularity_distance
from ocptip.indices.arms.operation import operation_indices
from ocptip.indices.arms.symbolic import index_function
from ocptip.indices.arms.values import index_values, rate_arm
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.controllability import control_number
from ocptip.indices.platforms.platform import StewartPlatform
from ocptip.indices.platforms.reviewed import rate_platform

__all__ = [
    "OperationEllipsoid",
    "StewartPlatform",
    "control_number",
    "index_function",
    "index_values",
    "operation_indices",
    "rate_arm",
    "rate_platform",
    "singularity_distance",
]
