"""Timing of a given path: the fastest, or the cheapest, with which a robot stands and keeps its limits."""
