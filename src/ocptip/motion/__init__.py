"""Motions of an arm or a parallel robot that stands: what to plan, plans, checks, files."""

from ocptip.motion.check import check_motion
from ocptip.motion.plan import plan_motion
from ocptip.motion.plan_files import write_plan
from ocptip.motion.task import MotionTask, refusals

__all__ = [
    "MotionTask",
    "check_motion",
    "plan_motion",
    "refusals",
    "write_plan",
]
