"""Bases that drive in MuJoCo, on wheels with hinges."""
