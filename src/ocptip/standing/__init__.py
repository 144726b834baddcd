"""A mechanism on a base that only stands: arms and parallel robots alike, at rest and in motion."""
