"""URDF files: their checks, and the arm, resting links, solids and ground contacts that they hold."""
