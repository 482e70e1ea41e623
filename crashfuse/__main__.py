"""``python -m crashfuse`` is the command line."""

import sys

from crashfuse.cli import main

sys.exit(main())
