"""Motion by velocity ramps of an arm or a parallel robot: servo law, printed cases, planning, proof."""

from ocptip.motion.cases import MotionCase, PrintedTime, motion_case, motion_cases
from ocptip.motion.output import (
    joint_trajectory,
    plan_to_dict,
    sample_motion,
    write_motion_csv,
    write_plan,
)
from ocptip.motion.parallel_robot import PlatformLimits, StandingParallelRobot
from ocptip.motion.passive import ArmMotion, earliest_end, passive_command
from ocptip.motion.plan import MotionPlan, StartResult, plan_motion
from ocptip.motion.proof import MotionLimits, MotionProof, Worst, prove
from ocptip.motion.ramps import (
    JointRamps,
    RampCommand,
    ServoRamp,
    phase_violations,
    phases_to_commands,
    servo_ramp,
)
from ocptip.motion.robot import StandingRobot, experiment_robot
from ocptip.motion.sampled import SampledMotion, load_motion, motion_origin
from ocptip.motion.standing import FurtherLimits, MotionSamples, StandingMechanism
from ocptip.motion.task import MotionTask, experiment_task, refusals, require_plannable
from ocptip.motion.task_file import load_task

__all__ = [
    "ArmMotion",
    "FurtherLimits",
    "JointRamps",
    "MotionCase",
    "MotionLimits",
    "MotionPlan",
    "MotionProof",
    "MotionSamples",
    "MotionTask",
    "PlatformLimits",
    "PrintedTime",
    "RampCommand",
    "SampledMotion",
    "ServoRamp",
    "StandingMechanism",
    "StandingParallelRobot",
    "StandingRobot",
    "StartResult",
    "Worst",
    "earliest_end",
    "experiment_robot",
    "experiment_task",
    "joint_trajectory",
    "load_motion",
    "load_task",
    "motion_case",
    "motion_cases",
    "motion_origin",
    "passive_command",
    "phase_violations",
    "phases_to_commands",
    "plan_motion",
    "plan_to_dict",
    "prove",
    "refusals",
    "require_plannable",
    "sample_motion",
    "servo_ramp",
    "write_motion_csv",
    "write_plan",
]
