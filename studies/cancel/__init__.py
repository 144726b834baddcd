"""Cancelled trajectories in MuJoCo against the verdicts of `check --stops cancel`."""
