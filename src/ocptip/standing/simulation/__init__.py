"""A robot on its base as a model for rigid-body simulators, and its motion replayed in one."""
