"""The results of `ocptip.plan`, `ocptip.stand` and `ocptip.drive`."""
