"""``python -m servo_models`` is the command ``servo-models``."""

import os
import sys

if __name__ == "__main__":
    if sys.path[0] == os.getcwd() != os.path.dirname(os.path.dirname(__file__)):
        del sys.path[0]  # modules that lie in the current folder came with somebody's data
    from servo_models.cli import main

    sys.exit(main())
