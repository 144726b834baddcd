"""Serial arms: models, kinematics, dynamics, drives and collision spheres."""

from ocptip.robots.geometry import Pillar, Wall
from ocptip.robots.model import ArmModel
from ocptip.robots.motors import DCMotors, PowerMaps
from ocptip.robots.payload import Payload
from ocptip.robots.urdf import arm_from_urdf

__all__ = [
    "ArmModel",
    "DCMotors",
    "Payload",
    "Pillar",
    "PowerMaps",
    "Wall",
    "arm_from_urdf",
]
