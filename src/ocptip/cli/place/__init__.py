"""Commands that find base placements."""
