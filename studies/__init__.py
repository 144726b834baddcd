"""Scripts that measure: one folder per study; run one by `python -m studies.FOLDER.SCRIPT --help`."""
