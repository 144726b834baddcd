"""What several functions take: given motions, postures, requirements."""
