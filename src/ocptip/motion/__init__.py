"""Motion of an arm by velocity ramps: servo law and its inverse, passive joints, the printed cases."""

from ocptip.motion.cases import GripperPose, MotionCase, PrintedTime, motion_case, motion_cases
from ocptip.motion.passive import ArmMotion, earliest_end, passive_command
from ocptip.motion.ramps import (
    JointRamps,
    RampCommand,
    ServoRamp,
    phase_violations,
    phases_to_commands,
    servo_ramp,
)

__all__ = [
    "ArmMotion",
    "GripperPose",
    "JointRamps",
    "MotionCase",
    "PrintedTime",
    "RampCommand",
    "ServoRamp",
    "earliest_end",
    "motion_case",
    "motion_cases",
    "passive_command",
    "phase_violations",
    "phases_to_commands",
    "servo_ramp",
]
