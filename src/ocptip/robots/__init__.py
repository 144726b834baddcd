"""Serial arms: models, URDF files, kinematics, dynamics, drives and collision geometry."""
