"""Stops of a motion, begun at any instant: their rules, worst values and safe shares of the planned speed."""
