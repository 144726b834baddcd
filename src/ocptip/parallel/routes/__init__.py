"""Three independent routes to the inverse dynamics, to check the minimal form against."""
