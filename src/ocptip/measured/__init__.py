"""Measured signals against predicted ones."""
