"""From random starts to exact motions: smooth programs, order of events, exact program."""
