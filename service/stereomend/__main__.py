"""`python -m stereomend` is the command `stereomend`."""

import sys

from stereomend.cli import main

if __name__ == "__main__":
    sys.exit(main())
