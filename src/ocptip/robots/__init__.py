"""Serial arms: models, kinematics, dynamics, drives and collision spheres."""

from ocptip.robots.dynamics import (
    STANDARD_GRAVITY,
    Dynamics,
    dynamics_batch,
    evaluate_dynamics,
    inverse_dynamics,
)
from ocptip.robots.geometry import CollisionModel, GapLabel, Pillar, Wall, floor, spheres_along_links
from ocptip.robots.inverse.closed_form import branches_within_limits, closed_form_branches, closed_form_family
from ocptip.robots.inverse.inverse_kinematics import (
    InverseKinematics,
    pose_residuals,
    solve_inverse_kinematics,
)
from ocptip.robots.kinematics import (
    LinkFrames,
    forward_kinematics,
    gripper_kinematics,
    gripper_pose,
    jacobian,
    link_frames,
)
from ocptip.robots.model import ArmModel, JointLimits, SphereSet
from ocptip.robots.motors import DCMotors, Motors, PowerMaps
from ocptip.robots.urdf import arm_from_pinocchio, arm_from_urdf

__all__ = [
    "STANDARD_GRAVITY",
    "ArmModel",
    "CollisionModel",
    "DCMotors",
    "Dynamics",
    "GapLabel",
    "InverseKinematics",
    "JointLimits",
    "LinkFrames",
    "Motors",
    "Pillar",
    "PowerMaps",
    "SphereSet",
    "Wall",
    "arm_from_pinocchio",
    "arm_from_urdf",
    "branches_within_limits",
    "closed_form_branches",
    "closed_form_family",
    "dynamics_batch",
    "evaluate_dynamics",
    "floor",
    "forward_kinematics",
    "gripper_kinematics",
    "gripper_pose",
    "inverse_dynamics",
    "jacobian",
    "link_frames",
    "pose_residuals",
    "solve_inverse_kinematics",
    "spheres_along_links",
]
