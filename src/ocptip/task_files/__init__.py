"""Readers of users' TOML files, one module per kind of file; `tables` has what several kinds share."""
