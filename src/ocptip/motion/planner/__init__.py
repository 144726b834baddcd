"""From random starts to exact motions: smooth programs, order of switching times, exact program."""
