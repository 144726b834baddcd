"""Motions as such: velocity ramps, whole arms, samples; no robot on a base needed."""
