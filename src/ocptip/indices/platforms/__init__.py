"""Indices of Stewart-Gough and planar platforms."""
