"""``python -m servo_models`` is the command ``servo-models``."""

import sys

from servo_models.cli import main

sys.exit(main())
