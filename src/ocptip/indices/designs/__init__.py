"""Platforms that are optimal in an index."""
