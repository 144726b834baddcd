"""The `ocptip` command: one file per command."""
