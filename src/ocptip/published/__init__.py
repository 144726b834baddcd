"""The published modular arms, their eight cases with printed solutions, and an arm known by its axes."""
