"""Feet and elastic joints: a base on springs, simulated along a motion."""
