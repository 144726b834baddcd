"""A standing arm within a tolerance: its deviations, the worst of them, what is tolerable at rest."""
