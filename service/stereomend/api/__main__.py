"""`python -m stereomend.api`: a server whose settings are all in the environment.

Worker processes import the main module again unless it is called `__main__`, so this one stays small.
"""

import sys

from stereomend.api.server import serve
from stereomend.errors import ConfigurationError
from stereomend.settings import load_settings

if __name__ == "__main__":
    try:
        serve(load_settings())
    except ConfigurationError as error:
        print(f"stereomend: {error}", file=sys.stderr)
        sys.exit(2)
