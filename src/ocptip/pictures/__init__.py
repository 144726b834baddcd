"""Figures of scenes, plans and placements; the only part that imports matplotlib."""
