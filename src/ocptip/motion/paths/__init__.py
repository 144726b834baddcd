"""Paths among obstacles: their search and their smoothing."""
