"""Motion of an arm by velocity ramps: servo law and its inverse, printed cases, the check of a motion."""

from ocptip.motion.cases import MotionCase, PrintedTime, motion_case, motion_cases
from ocptip.motion.passive import ArmMotion, earliest_end, passive_command
from ocptip.motion.proof import MotionLimits, MotionProof, Worst, prove
from ocptip.motion.ramps import (
    JointRamps,
    RampCommand,
    ServoRamp,
    phase_violations,
    phases_to_commands,
    servo_ramp,
)
from ocptip.motion.robot import MotionSamples, StandingRobot, experiment_robot

__all__ = [
    "ArmMotion",
    "JointRamps",
    "MotionCase",
    "MotionLimits",
    "MotionProof",
    "MotionSamples",
    "PrintedTime",
    "RampCommand",
    "ServoRamp",
    "StandingRobot",
    "Worst",
    "earliest_end",
    "experiment_robot",
    "motion_case",
    "motion_cases",
    "passive_command",
    "phase_violations",
    "phases_to_commands",
    "prove",
    "servo_ramp",
]
