"""The script that plays a command on an actuator and logs it: two functions are left to fill in."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import PurePath

from servo_models.core.plant import Wire
from servo_models.data.log import Log
from servo_models.data.tables import header

TEXT = '''"""Play {table}: fill in send and read, then run this with the name of the log.

{entries}
"""

import csv
import sys
import time

SETTLE = {settle:g}  # seconds for which the first value is held before the log begins


def send(value):
    """Give the actuator a command: {command}."""
    raise NotImplementedError


def read():
    """Return what is measured now: {readings}."""
    raise NotImplementedError


def play(log):
    with open("{table}", newline="") as file:
        rows = [tuple(map(float, row)) for row in list(csv.reader(file))[1:]]
    lines = []
    send(rows[0][1])
    time.sleep(SETTLE)
    begin = time.perf_counter()
    for due, value in rows:
        time.sleep(max(0.0, due - (time.perf_counter() - begin)))
        stamp = time.perf_counter() - begin
        measured = read()
        send(value)
        lines.append([f"{{stamp:.6f}}", value, *measured])
    with open(log, "w", newline="") as file:
        csv.writer(file).writerows([{headers!r}, *lines])


if __name__ == "__main__":
    play(sys.argv[1])
'''


def script_of(table: str) -> str:
    """Return the name of the script that plays a table."""
    return str(PurePath(table).with_suffix(".py"))


def constants_of(log: Log) -> str:
    """Return what a log holds constant as a line of its description."""
    values = (
        f"{json.dumps(name) if '.' in name else name} = {value:.6g}"
        for name, value in log.constants.items()
    )
    return f"constants = {{ {', '.join(values)} }}"


def script(table: str, command: Wire, outputs: Sequence[Wire], logs: Sequence[Log]) -> str:
    """Return the script that plays a table of times and a command.

    Each row is measured, then its command is sent, as a log has it: a command holds from its row
    on.  All is in the units of the headings.

    Args:
        table: its file, in the folder in which the script is run.
        command: the input that is played.
        outputs: what is measured.
        logs: those to be, for each of which the script is run once.
    """
    kinds = {"inputs": [command], "outputs": outputs}
    columns = [
        f'{kind}.{wire.name} = {{ column = "{header(wire)}", unit = "{wire.unit}" }}'
        for kind, wires in kinds.items()
        for wire in wires
    ]
    entries = []
    for number, log in enumerate(logs, 1):
        file = f"{PurePath(table).stem}_log_{number}.csv"
        lines = ["[[logs]]", f'file = "{file}"', 'time = "time [s]"', *columns]
        lines += [f'settle = "{log.settle:g} s"'] if log.settle else []
        lines += [constants_of(log)] if log.constants else []
        entries.append("\n".join(lines))
    return TEXT.format(
        table=table,
        entries="\n\n".join(["What the description gets for its logs:", *entries]),
        settle=max(log.settle for log in logs),
        command=header(command),
        readings=", ".join(map(header, outputs)),
        headers=["time [s]", *map(header, [command, *outputs])],
    )
