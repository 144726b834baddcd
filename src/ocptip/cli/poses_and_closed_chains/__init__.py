"""Commands about indices of poses and parallel robots."""
