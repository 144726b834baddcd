"""Positions and velocities: chains, closures of legs, joint angles of a pose."""
