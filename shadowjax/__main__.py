"""`python -m shadowjax` is the command `shadowjax`."""

import sys

from shadowjax.cli import main

if __name__ == "__main__":
    sys.exit(main())
