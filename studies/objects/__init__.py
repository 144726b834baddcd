"""Objects on trays, in stacks and on cups, against independent programs."""
