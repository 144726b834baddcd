"""Trajectories: velocity profiles, points, timed paths; no robot on a base needed."""
