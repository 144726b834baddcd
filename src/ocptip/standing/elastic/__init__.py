"""Feet and gears that give: a base on springs, simulated along a motion."""
