"""`python -m ocptip`: the command line."""

import sys

try:
    from ocptip.cli.main import main
except KeyboardInterrupt:
    sys.stderr.write("ocptip: interrupted\n")
    sys.exit(130)

sys.exit(main())
