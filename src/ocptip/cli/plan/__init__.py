"""Commands that make motions."""
