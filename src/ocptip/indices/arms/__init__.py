"""Indices of serial arms."""
