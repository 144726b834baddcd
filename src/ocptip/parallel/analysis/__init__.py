"""Mobility, singular poses and their crossings, which variables can be eliminated."""
