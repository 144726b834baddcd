"""Motions of an arm or a parallel robot that stands: what to plan, plans, checks, files."""
