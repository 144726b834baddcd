"""The search for placements: starts, nonlinear program, refinement."""
