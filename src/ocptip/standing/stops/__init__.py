"""Stops out of a motion: along its path, or by brakes joint by joint."""
