"""`python -m ocptip`: the command line."""

import sys

from ocptip.cli.main import main

sys.exit(main())
