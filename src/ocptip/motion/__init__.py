"""Motion by velocity ramps of an arm or a parallel robot: servo law, printed cases, planning, proof."""

from ocptip.motion.check import MotionProof, Worst, prove
from ocptip.motion.output import joint_trajectory, plan_to_dict, sample_motion, write_motion_csv, write_plan
from ocptip.motion.plan import MotionPlan, StartResult, plan_motion
from ocptip.motion.task import MotionTask, refusals, require_plannable

__all__ = [
    "MotionPlan",
    "MotionProof",
    "MotionTask",
    "StartResult",
    "Worst",
    "joint_trajectory",
    "plan_motion",
    "plan_to_dict",
    "prove",
    "refusals",
    "require_plannable",
    "sample_motion",
    "write_motion_csv",
    "write_plan",
]
