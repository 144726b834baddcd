"""Collision geometry as convex solids: shapes, pairs, distances with derivatives."""
