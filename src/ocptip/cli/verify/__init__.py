"""Commands that check a base, a robot or a motion."""
