"""`python -m barchan.cli` is the `barchan` command."""

import sys

from barchan.cli import main

sys.exit(main())
