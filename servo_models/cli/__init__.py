"""The command line: one file = one sub-command.

Nothing is computed here, and nothing heavy is imported before a command runs.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import sys
import traceback
from collections.abc import Sequence
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from servo_models.cli.console import disarmed
from servo_models.cli.options import described
from servo_models.errors import UserError, did_you_mean

COMMANDS = (
    *("list", "explain", "explore", "new", "simulate", "figures", "check", "identify", "diagnose"),
    *("rehearse", "survey", "compare", "sample", "export", "import", "blind", "build", "validate"),
)
EXIT_FAILED = 2  # exit code of a command that could not run
READ_ENOUGH = 141  # exit status of a program whose reader is gone, as shells tell SIGPIPE
INTERRUPTED = 130  # exit status that typer gives Ctrl-C, without a message
USAGE_ERROR: Any = typer.BadParameter.__mro__[2]
"""Base class of all errors of the command line, which typer does not export."""


class Commands(TyperGroup):
    """Sub-commands; a wrong name gets the same message as any other wrong name."""

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        command = super().get_command(ctx, cmd_name)
        if command is None and not ctx.resilient_parsing:
            raise UserError(
                f"unknown command '{cmd_name}'; {did_you_mean(cmd_name, self.commands)}"
            )
        return command


app = typer.Typer(
    name="servo-models",
    cls=Commands,
    help="Identified actuator models: simulate, fit and diagnose them, build FMUs of them.",
    epilog="Exit codes: 0 all is well; 1 it ran and something is not: out of tolerance, a gap,"
    " a fit not converged, warnings; 2 it could not run.",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        print(f"servo-models {version('servo-models')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Options of the command itself."""


for command in COMMANDS:
    module = {"list": "list_", "import": "import_"}.get(command, command)
    function = getattr(importlib.import_module(f"{__name__}.{module}"), module)
    app.command(name=command)(described(command, function))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit code; ``arguments`` defaults to the process's."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # print whatever the locale
    with disarmed():
        return _run(words)


def _run(words: list[str]) -> int:
    try:
        code = app(
            args=words or ["--help"],
            prog_name="servo-models",
            standalone_mode=False,
        )
        sys.stdout.flush()
    except (BrokenPipeError, SystemExit):  # click makes the second of the first; a signal in their
        # place would end us for a child that is gone, too
        return _end_without_a_word()
    except (UserError, USAGE_ERROR) as error:
        return _complain(error)
    except (KeyboardInterrupt, typer.Abort) as error:
        if not isinstance(error.__cause__, EOFError):  # which typer takes for Ctrl-C
            return _complain("interrupted")
        traceback.print_exc()
        return EXIT_FAILED
    except Exception:  # a crash must not look like 'not within tolerance'
        traceback.print_exc()
        return EXIT_FAILED
    return _complain("interrupted") if code == INTERRUPTED else int(code or 0)


def _end_without_a_word() -> int:
    """The reader of what is printed has seen enough: what is left to print goes nowhere."""
    with contextlib.suppress(OSError, ValueError):  # a stream without a file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return READ_ENOUGH


def _complain(error: object) -> int:
    message = getattr(error, "format_message", lambda: str(error))()
    print(f"servo-models: {' '.join(message.split())}", file=sys.stderr)
    return EXIT_FAILED
