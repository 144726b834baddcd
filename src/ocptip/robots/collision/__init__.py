"""Collision geometry as convex solids: shapes, reading of URDF files, pairs, distances with derivatives."""
