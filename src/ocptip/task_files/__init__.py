"""Readers of users' TOML files, one file per kind of table."""
