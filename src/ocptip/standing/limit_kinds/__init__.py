"""Kinds of limits of a standing mechanism: one class each, for programs, checks and reports alike."""
