"""The `ocptip` command: a folder per group of the help, one file per command."""
