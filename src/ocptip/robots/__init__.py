"""Serial arms: models, kinematics, dynamics, drives and collision spheres."""

from ocptip.robots.batch import BatchFunction
from ocptip.robots.closed_form import branches_within_limits, closed_form_branches, closed_form_family
from ocptip.robots.collision import CollisionModel, GapLabel, Pillar, Wall, floor, spheres_along_links
from ocptip.robots.dynamics import (
    STANDARD_GRAVITY,
    Dynamics,
    dynamics_batch,
    evaluate_dynamics,
    inverse_dynamics,
)
from ocptip.robots.inverse_kinematics import InverseKinematics, pose_residuals, solve_inverse_kinematics
from ocptip.robots.kinematics import (
    LinkFrames,
    forward_kinematics,
    gripper_kinematics,
    gripper_pose,
    jacobian,
    link_frames,
)
from ocptip.robots.model import ArmModel, JointLimits, SphereSet
from ocptip.robots.modular import (
    GripperPose,
    Links,
    arm_names,
    assemble_links,
    experiment_poses,
    load_arm,
    start_and_goal,
)
from ocptip.robots.motors import DCMotors, Motors, PowerMaps
from ocptip.robots.point import PointFunction
from ocptip.robots.urdf import arm_from_pinocchio, arm_from_urdf

__all__ = [
    "STANDARD_GRAVITY",
    "ArmModel",
    "BatchFunction",
    "CollisionModel",
    "DCMotors",
    "Dynamics",
    "GapLabel",
    "GripperPose",
    "InverseKinematics",
    "JointLimits",
    "LinkFrames",
    "Links",
    "Motors",
    "Pillar",
    "PointFunction",
    "PowerMaps",
    "SphereSet",
    "Wall",
    "arm_from_pinocchio",
    "arm_from_urdf",
    "arm_names",
    "assemble_links",
    "branches_within_limits",
    "closed_form_branches",
    "closed_form_family",
    "dynamics_batch",
    "evaluate_dynamics",
    "experiment_poses",
    "floor",
    "forward_kinematics",
    "gripper_kinematics",
    "gripper_pose",
    "inverse_dynamics",
    "jacobian",
    "link_frames",
    "load_arm",
    "pose_residuals",
    "solve_inverse_kinematics",
    "spheres_along_links",
    "start_and_goal",
]
