"""servo-models explore"""

from __future__ import annotations

from pathlib import Path

from servo_models.cli.options import check_outputs


def explore(
    what: str | None = None,
    out: Path | None = None,
    actuator: str | None = None,
    show: bool = True,
    serve: bool = False,
    trust: bool = False,
) -> None:
    """Write a page that simulates in a browser, and open it.

    With a description or a log it shows the measurement beside the model: move
    parameters until they meet.  A CSV may be dropped on the page.  The page is
    one file; nothing leaves the machine.

    Examples:

    servo-models explore sg90

    servo-models explore mine.toml --serve

    servo-models explore log.csv --actuator smart_servo --out mine.html
    """
    import webbrowser
    from contextlib import suppress

    from servo_models.cli.console import progress
    from servo_models.files import scratch, write_whole
    from servo_models.identification.live import explored
    from servo_models.report.html import page

    if not serve:
        path = out or Path("explore.html")
        check_outputs((path, ".html"))
        with progress(f"writing {path}"):
            write_whole(path, page(explored(what, actuator, trust)).encode())
        print(f"wrote '{path}'")
        if show:
            webbrowser.open(path.resolve().as_uri())
        return
    from servo_models.cli.serve import served

    file = Path(what or "all")
    folder = out or file.with_name(f"{file.stem}_explored")
    with progress(f"simulating {file}"):
        report = explored(what, actuator, trust)
    with served(report, file, folder, actuator, trust) as server, scratch() as place:
        print(f"serving {server.url} until Ctrl-C", flush=True)
        if show:  # by a file that is ours alone: every user sees the words of a command
            link = place / "open.html"
            link.write_text(f'<meta http-equiv="refresh" content="0; url={server.url}">', "utf-8")
            webbrowser.open(link.as_uri())
        with suppress(KeyboardInterrupt):
            server.serve_forever()
    print(f"saved in '{folder}'")
