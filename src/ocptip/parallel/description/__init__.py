"""Descriptions of parallel robots: legs as tables, platform, motors, frames; ready-made robots."""
