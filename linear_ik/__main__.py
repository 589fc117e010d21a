"""`python -m linear_ik`, the command without its script."""

import sys

from linear_ik.cli import main

sys.exit(main())
