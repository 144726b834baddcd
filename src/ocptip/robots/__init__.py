"""Serial arms: models, kinematics, dynamics, drives and collision spheres."""
