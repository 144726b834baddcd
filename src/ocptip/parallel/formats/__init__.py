"""Parallel robots from and to URDF and MJCF."""
