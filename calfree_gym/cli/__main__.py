"""`python -m calfree_gym.cli` is `calfree`."""

import sys

from calfree_gym.cli.command import main

sys.exit(main())
