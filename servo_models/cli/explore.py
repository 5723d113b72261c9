"""servo-models explore"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from servo_models.cli.options import MadeBy, Trust, check_outputs, complete_actuator, file_option


def explore(
    what: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME | FILE]",
            help="An actuator, an effect, a description (.toml) or a log; default: all actuators.",
            autocompletion=complete_actuator,
        ),
    ] = None,
    out: Annotated[Path, file_option("The page that is written (.html).")] = Path("explore.html"),
    actuator: MadeBy = None,
    show: Annotated[bool, typer.Option(help="Open the page in a browser.")] = True,
    trust: Trust = False,
) -> None:
    """Write a page that simulates in a browser, and open it.

    With a description or a log it shows the measurement beside the model: move
    parameters until they meet.  A CSV may be dropped on the page.  The page is
    one file; nothing leaves the machine.

    Examples:

    servo-models explore sg90

    servo-models explore mine.toml

    servo-models explore log.csv --actuator smart_servo --out mine.html
    """
    import webbrowser

    from servo_models.cli.console import progress
    from servo_models.files import write_whole
    from servo_models.identification.live import explored
    from servo_models.report.html import page

    check_outputs((out, ".html"))
    with progress(f"writing {out}"):
        write_whole(out, page(explored(what, actuator, trust)).encode())
    print(f"wrote '{out}'")
    if show:
        webbrowser.open(out.resolve().as_uri())
