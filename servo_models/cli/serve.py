"""The page of ``explore``, served to this machine alone, with buttons that run commands.

A request names a command, and may bring a log with its description.  No part of a request is ever
a path: files in the folder of the session have the names that stand here.
"""

from __future__ import annotations

import hmac
import json
import os
import re
import secrets
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from dataclasses import replace
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Literal

from servo_models.catalogue import all_actuators
from servo_models.core.workers import python
from servo_models.data.scaffold import draft
from servo_models.data.schema import Column, Table, read_toml
from servo_models.errors import UserError
from servo_models.files import check_writable, largest_input, write_whole
from servo_models.report.html import page
from servo_models.report.result import Report
from servo_models.report.sections import Section

LOOPBACK = "127.0.0.1"
OUTPUTS: dict[str, tuple[str, ...]] = {
    "check": (),
    "identify": ("--report", "fit.html", "--out", "PARAMS.toml"),
    "diagnose": ("--report", "gap.html", "--json", "gap.json", "--out", "GAP.toml"),
}
"""What each command writes, beside what it prints."""
DROPPED_LOG, DROPPED = "dropped.csv", "dropped.toml"
LARGEST_DESCRIPTION = 1 << 20  # bytes
RUN = "from servo_models.cli import main; sys.exit(main())"
MOST_LINES = 12  # of progress that are shown
SILENCE = 30.0  # time [s] after which a connection that says nothing is closed
TYPES = {".html": "text/html", ".json": "application/json"}
HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
}


class _Signal(Table):
    column: Column
    unit: str


class _Log(Table):
    file: Literal["dropped.csv"]
    name: str
    time: _Signal
    inputs: dict[str, _Signal]
    outputs: dict[str, _Signal]


class _Dropped(Table):
    """All that the description of a dropped log may hold, so that it names no other file."""

    actuator: str
    variant: str
    logs: list[_Log]


class Server(ThreadingHTTPServer):
    """Serves a page and runs one command at a time, in a process of its own.

    Attributes:
        url: of the page, with the token.
        state: the last command, its progress and exit code, and all files that are served.

    Args:
        page: HTML.
        folder: where everything is saved; it is made.
        description: that commands run on, None where a log has to be dropped first.
        options: of every command.

    Example:
        >>> with Server(page, Path("mine_explored"), Path("mine.toml")) as server:
        ...     server.serve_forever()
    """

    def __init__(
        self, page: str, folder: Path, description: Path | None, options: Sequence[str] = ()
    ) -> None:
        self.page, self.folder, self.options = page, folder.absolute(), options
        self.description = description and description.absolute()
        self.largest_log = largest_input.get()
        self.token = secrets.token_urlsafe(32)
        self.state: dict[str, Any] = {"command": "", "running": False, "lines": [], "files": []}
        self._lock = threading.Lock()
        self._job: subprocess.Popen[str] | None = None
        check_writable(self.folder / DROPPED_LOG)
        super().__init__((LOOPBACK, 0), _Handler)
        self.host = f"{LOOPBACK}:{self.server_port}"
        self.url = f"http://{self.host}/{self.token}/"

    def server_close(self) -> None:
        super().server_close()
        if self._job:
            self._job.kill()
            self._job.wait()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print what is wrong here, and nothing where a client has left before its answer."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)

    def do(self, name: str, content: bytes) -> None:
        """Run a command, on the dropped log if ``content`` describes it; or ``log``, ``stop``.

        Raises:
            UserError: a command runs, there is no log, or ``content`` names other files.
        """
        with self._lock:
            if name == "stop":
                self._stop()
            elif self.state["running"]:
                raise UserError("a command is running: wait until it ends, or stop it")
            elif name == "log":
                write_whole(self.folder / DROPPED_LOG, content)
            else:
                self._begin(name, self._dropped(content) if content else self.description)

    def _stop(self) -> None:
        """Let a job tell its best so far; asked a second time, end it."""
        if not (self._job and self.state["running"]):
            return
        if self.state["stopped"] or os.name == "nt":  # which has no Ctrl-C for one process
            self._job.kill()
        else:
            self._job.send_signal(signal.SIGINT)
        self.state["stopped"] = True

    def _dropped(self, content: bytes) -> Path:
        path = self.folder / DROPPED
        write_whole(path, content)
        if (name := read_toml(path).read(_Dropped).actuator) not in all_actuators():
            raise UserError(
                f"'{name}' is a file of your own: save the description beside it, and diagnose that"
            )
        return path

    def _begin(self, command: str, description: Path | None) -> None:
        if description is None:
            raise UserError("drop a CSV, choose what its columns are, and press 'show' first")
        names = [*OUTPUTS[command][1::2], f"{command}.txt"]
        for name in names:
            (self.folder / name).unlink(missing_ok=True)
        words = [command, str(description), *OUTPUTS[command], *self.options]
        with (self.folder / names[-1]).open("wb") as file:
            self._job = subprocess.Popen(
                python(RUN, *words),
                cwd=self.folder,
                env={**os.environ, "PYTHONUTF8": "1", "SERVO_MODELS_PROGRESS": "lines"},
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.PIPE,
                encoding="utf-8",
                errors="replace",
                start_new_session=True,  # Ctrl-C is for the server, which then ends the job
            )
        self.state = {
            **{"command": command, "running": True, "stopped": False, "code": None, "lines": []},
            "files": [name for name in self.state["files"] if name not in names],
        }
        threading.Thread(target=self._follow, args=(self._job, names), daemon=True).start()

    def _follow(self, job: subprocess.Popen[str], names: list[str]) -> None:
        for line in job.stderr or ():
            self.state["lines"] = [*self.state["lines"], line.rstrip()][-MOST_LINES:]
        self.state["code"] = job.wait()
        self.state["files"] += [name for name in names if (self.folder / name).is_file()]
        self.state["running"] = False


class _Handler(BaseHTTPRequestHandler):
    server: Server
    timeout = SILENCE
    server_version, sys_version = "servo-models", ""

    def parse_request(self) -> bool:
        """Refuse whoever does not know the address; ``name`` is what stands after its token."""
        if not super().parse_request():
            return False
        _, token, self.name = [*self.path.split("/", 2), "", ""][:3]
        known = hmac.compare_digest(token.encode(), self.server.token.encode())
        if known and self.headers.get_all("Host") == [self.server.host]:
            return True
        self.send_error(HTTPStatus.FORBIDDEN, "this is not the address that was printed")
        return False

    def do_GET(self) -> None:
        if not self.name:
            self._send(HTTPStatus.OK, self.server.page.encode(), ".html")
        elif self.name == "job":
            self._send(HTTPStatus.OK, json.dumps(self.server.state).encode(), ".json")
        elif self.name in self.server.state["files"]:
            file = self.server.folder / self.name
            self._send(HTTPStatus.OK, file.read_bytes(), file.suffix)
        else:
            self.send_error(HTTPStatus.NOT_FOUND, "no such page")

    def do_POST(self) -> None:
        most = self.server.largest_log if self.name == "log" else LARGEST_DESCRIPTION
        length = self.headers.get("Content-Length", "")
        if self.headers.get_all("Origin") != [f"http://{self.server.host}"]:
            self.send_error(HTTPStatus.FORBIDDEN, "another page asks")
        elif self.name not in {*OUTPUTS, "log", "stop"}:
            self.send_error(HTTPStatus.NOT_FOUND, "no such command")
        elif not re.fullmatch("[0-9]{1,18}", length):
            self.send_error(HTTPStatus.LENGTH_REQUIRED, "no Content-Length")
        elif int(length) > most:
            self.send_error(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"over {most >> 20} MB: cut it")
        elif len(content := self.rfile.read(int(length))) < int(length):
            self.send_error(HTTPStatus.BAD_REQUEST, "it did not arrive whole: try again")
        else:
            try:
                self.server.do(self.name, content)
                self._send(HTTPStatus.OK, json.dumps(self.server.state).encode(), ".json")
            except UserError as error:
                self.send_error(HTTPStatus.BAD_REQUEST, str(error))

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        self._send(code, json.dumps({"error": message}).encode(), ".json")

    def _send(self, status: int, content: bytes, suffix: str) -> None:
        policy = "" if suffix == ".html" else "default-src 'none'; "  # a page has its own in it
        self.send_response(status)
        self.send_header("Content-Security-Policy", f"{policy}frame-ancestors 'none'")
        self.send_header("Content-Type", f"{TYPES.get(suffix, 'text/plain')}; charset=utf-8")
        self.send_header("Content-Length", str(len(content)))
        for header in HEADERS.items():
            self.send_header(*header)
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Print nothing: the line of a request has the token in it."""


def served(
    report: Report, file: Path, folder: Path, actuator: str | None = None, trust: bool = False
) -> Server:
    """Return a server of what ``explored(file, actuator, trust)`` has returned, see ``Server``."""
    (panel,) = report.panels
    description = file if file.suffix.lower() == ".toml" else None
    if panel.description[0] and not description:  # a log: its draft stands in another folder here
        description = folder / panel.description[0]
        write_whole(description, draft(file, actuator).text(folder).encode())
    asking = replace(report, sections=(Section("", live=replace(panel, served=True)),))
    return Server(page(asking), folder, description, ["--trust"] if trust else [])
