"""Motion by velocity ramps of an arm or a parallel robot: servo law, printed cases, planning, checked."""

from ocptip.motion.check import MotionCheck, Worst, check_motion
from ocptip.motion.output import joint_trajectory, plan_to_dict, sample_motion, write_motion_csv, write_plan
from ocptip.motion.plan import MotionPlan, StartResult, plan_motion
from ocptip.motion.task import MotionTask, refusals, require_plannable

__all__ = [
    "MotionCheck",
    "MotionPlan",
    "MotionTask",
    "StartResult",
    "Worst",
    "check_motion",
    "joint_trajectory",
    "plan_motion",
    "plan_to_dict",
    "refusals",
    "require_plannable",
    "sample_motion",
    "write_motion_csv",
    "write_plan",
]
