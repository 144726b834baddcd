"""A standing arm within an uncertainty: its deviations, the worst of them, what is tolerable at rest."""
