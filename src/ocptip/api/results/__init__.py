"""The results of `ocptip.stand` and `ocptip.drive`."""
