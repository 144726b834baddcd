"""Readers of users' TOML files, one module per kind of file; `tables` has what several kinds share.

What is missing, unknown or cannot be used is an `InputError`, one line that names file, key and value.
"""
