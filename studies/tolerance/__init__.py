"""What a tolerance costs, and whether plans keep it."""
