"""`python -m ocptip`: the command line."""

import sys

try:
    from ocptip.cli.main import main
except KeyboardInterrupt:
    print("ocptip: interrupted", file=sys.stderr)
    sys.exit(130)

sys.exit(main())
