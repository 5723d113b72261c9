"""What each rule of the search is worth: withheld cases diagnosed without it.

    python benchmarks/ablation.py CASES --out FOLDER             # every rule, resumable
    python benchmarks/ablation.py CASES --out FOLDER --only swap,pairs
    python benchmarks/ablation.py CASES --out FOLDER --table     # what was found, as Markdown

CASES is a folder that ``python -m servo_models.withheld.generator`` has made.  A rule is taken out
by replacing its function, or by a value of its constant at which it does nothing.  The file
``FOLDER/NAME.jsonl`` has the answers without rule NAME, ``FOLDER/all.jsonl`` those with all rules.

In the table a rule *acts* in a case where the answer differs in any number.  A case is *right* as
``servo_models.withheld.score.good`` says; it is *lost* where it is right with the rule alone, and
*gained* where it is right without it alone.  Seconds are of the processor, over those with all
rules on the same cases.  Lines are those of the functions that would go.
"""

from __future__ import annotations

import argparse
import inspect
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a process a processor is all there is

from golden import dealt, read_answers, right  # noqa: E402  # after the threads are limited

from servo_models.diagnosis import verdict  # noqa: E402
from servo_models.diagnosis.search import (  # noqa: E402
    fitting,
    grid_search,
    joint_fits,
    screening,
    selection,
)

Change = tuple[Any, str, Any]
"""A module or class, a name in it, and what stands there in its place."""
