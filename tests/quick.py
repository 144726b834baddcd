"""Arguments with which `ocptip plan` is quick."""

ONE_START = ("--starts", "1", "--jobs", "1", "--tolerance", "none", "--no-figures")
"""One start in this process, as described: no tolerance."""
