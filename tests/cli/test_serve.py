"""The served page: what a stranger may not do, and commands from a click to their reports."""

from __future__ import annotations

import json
import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import pytest

from servo_models.cli.serve import Server, served
from servo_models.identification.live import explored
from tests.support.browser import chromium, ready
from tests.support.sources import ROOT

Capture = pytest.CaptureFixture[str]
GIMBAL = ROOT / "examples" / "gimbal" / "gimbal.toml"
STEPS = ROOT / "examples" / "two_csv_files" / "steps.csv"
DESCRIPTION = """\
actuator = "sg90"
variant = "measured"

[[logs]]
file = "dropped.csv"
name = "steps"
time = { column = "time_ms", unit = "ms" }
inputs.pulse_width = { column = "pulse_us", unit = "us" }
outputs.angle = { column = "angle_deg", unit = "deg" }
"""


@contextmanager
def running(made: Server) -> Iterator[Server]:
    with made:
        threading.Thread(target=made.serve_forever, args=(0.02,), daemon=True).start()
        try:
            yield made
        finally:
            made.shutdown()


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    with running(Server("<!DOCTYPE html>", tmp_path / "saved", GIMBAL)) as made:
        yield made


def ask(
    server: Server, name: str, content: bytes | None = None, path: str = "", **headers: str
) -> tuple[int, bytes, dict[str, str]]:
    """Status, content and headers of an answer: a POST where there is ``content``."""
    told = {"Host": server.host, **({} if content is None else {"Origin": f"http://{server.host}"})}
    told |= {key.replace("_", "-"): value for key, value in headers.items()}
    link = HTTPConnection("127.0.0.1", server.server_port, timeout=60)
    method = "GET" if content is None else "POST"
    link.request(method, path or f"/{server.token}/{name}", content, told)
    answer = link.getresponse()
    return answer.status, answer.read(), dict(answer.getheaders())


def ended(server: Server) -> dict[str, Any]:
    while (state := json.loads(ask(server, "job")[1]))["running"]:
        time.sleep(0.1)
    return dict(state)


def test_only_who_knows_the_address_is_answered(server: Server) -> None:
    status, content, headers = ask(server, "")
    assert (status, content) == (200, b"<!DOCTYPE html>")
    assert "Access-Control-Allow-Origin" not in headers
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    wrong = f"{server.token[:-1]}{'A' if server.token[-1] != 'A' else 'B'}"
    for path in ("/", "/job", f"/{wrong}/", f"/{server.token[:-1]}/", "//", f"/{wrong}/job"):
        assert ask(server, "", path=path)[0] == 403, path
        assert ask(server, "", b"", path=path)[0] == 403, path
    for host in ("evil.example", f"evil.example:{server.server_port}", "127.0.0.1"):
        assert ask(server, "", Host=host)[0] == 403, host
    status, _, headers = ask(server, "", Host="evil.example")
    assert "default-src 'none'" in headers["Content-Security-Policy"]


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "", "http://127.0.0.1:1"])
def test_another_page_starts_nothing(server: Server, origin: str) -> None:
    assert ask(server, "check", b"", Origin=origin)[0] == 403
    assert not server.state["command"]


@pytest.mark.parametrize(
    "name",
    [
        "../gimbal.toml",
        "%2e%2e/gimbal.toml",
        "..%2fgimbal.toml",
        "/etc/passwd",
        "dropped.csv",
        "secret.txt",
        "check.txt",
        "check.txt?",
        "./secret.txt",
    ],
)
def test_no_file_is_served_that_no_command_wrote(server: Server, name: str) -> None:
    (server.folder / "secret.txt").write_text("secret")
    (server.folder / "check.txt").write_text("of another session")
    (server.folder.parent / "gimbal.toml").write_text("secret")
    assert ask(server, name)[0] == 404
    assert ask(server, name, b"x")[0] == 404
    assert not (server.folder / "dropped.csv").exists()


def test_what_is_too_large_or_cut_is_not_saved(tmp_path: Path, server: Server) -> None:
    server.largest_log = 100
    assert ask(server, "log", b"0" * 101)[0] == 413
    assert ask(server, "check", b"", Content_Length="1" * 12)[0] == 413
    for length in ("-1", "x", "", "1e3"):
        assert ask(server, "log", b"", Content_Length=length)[0] == 411, length
    assert not (server.folder / "dropped.csv").exists()
    assert ask(server, "log", b"0" * 100)[0] == 200
    assert (server.folder / "dropped.csv").read_bytes() == b"0" * 100


HEAD = "{method} /{token}/{name} HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n"
LEAVES = {
    "in the first line": "GET /{token}",
    "in the head": HEAD,
    "before the body": HEAD + "Content-Length: 9\r\n\r\n",
    "in the body": HEAD + "Content-Length: 9\r\n\r\nt,u",
    "before the answer": HEAD + "\r\n",
}


@pytest.mark.parametrize("asked", [("GET", ""), ("GET", "job"), ("POST", "log"), ("POST", "no")])
@pytest.mark.parametrize("left", LEAVES)
@pytest.mark.parametrize("rudely", [True, False])
def test_a_client_that_leaves_midway_is_not_worth_a_word(
    left: str, asked: tuple[str, str], rudely: bool, tmp_path: Path, capsys: Capture
) -> None:
    with running(Server("x" * 30_000_000, tmp_path / "saved", GIMBAL)) as server:
        server.daemon_threads = False  # so that the end waits for every answer
        words = dict(zip(("method", "name"), asked), token=server.token, host=server.host)
        with socket.create_connection(("127.0.0.1", server.server_port)) as link:
            if rudely:  # a reset, which fails whoever writes or reads
                link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            link.sendall(LEAVES[left].format(**words).encode())
            if left == "before the answer":
                link.recv(1)
        assert ask(server, "job")[0] == 200
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("dropped.csv", "../gimbal/log.csv"),
        ("dropped.csv", "/etc/passwd"),
        ('"sg90"', '"gimbal.py"'),
        ('"sg90"', '"/tmp/x.fmu"'),
        ("variant", 'params = "x.toml"\nvariant'),
        ("name =", 'table = "x"\nname ='),
        ("name =", 'repeat = [{ file = "a.csv" }]\nname ='),
        ('"us" }', '"us", table = "x" }'),
        ("[[logs]]", "[elements]\n[[logs]]"),
        ("[[logs]]", "[[logs"),
    ],
)
def test_a_description_names_no_file_but_the_dropped_one(
    server: Server, old: str, new: str
) -> None:
    assert old in DESCRIPTION
    status, content, _ = ask(server, "check", DESCRIPTION.replace(old, new).encode())
    assert (status, bool(json.loads(content)["error"])) == (400, True)
    assert not server.state["command"]


def test_a_diagnosis_of_a_dropped_log_is_stopped_and_saved(server: Server) -> None:
    assert ask(server, "log", STEPS.read_bytes())[0] == 200
    assert ask(server, "diagnose", DESCRIPTION.encode())[0] == 200
    while not server.state["lines"] and server.state["running"]:
        time.sleep(0.02)
    assert ask(server, "stop", b"")[0] == 200
    state = ended(server)
    assert state["code"] in (0, 1), state
    assert state["files"] == ["gap.html", "gap.json", "GAP.toml", "diagnose.txt"]
    page = ask(server, "gap.html")
    assert b"script-src &#39;sha256-" in page[1]
    assert page[2]["Content-Type"].startswith("text/html")
    assert json.loads(ask(server, "gap.json")[1])["logs"][0]["name"] == "steps"


def test_a_check_of_the_gimbal_is_served(server: Server) -> None:
    assert ask(server, "check", b"")[0] == 200
    assert ask(server, "diagnose", b"")[0] == 400
    assert ask(server, "log", b"1,2")[0] == 400
    state = ended(server)
    assert (state["command"], state["code"], state["files"]) == ("check", 0, ["check.txt"])
    status, content, headers = ask(server, "check.txt")
    assert (status, headers["Content-Type"]) == (200, "text/plain; charset=utf-8")
    assert b"reading" in content
    assert {it.name for it in server.folder.iterdir()} == {"check.txt"}
    assert not (GIMBAL.parent / "check.txt").exists()


def test_a_command_that_is_stopped_twice_ends(server: Server) -> None:
    assert ask(server, "diagnose", b"")[0] == 200
    while json.loads(ask(server, "stop", b"")[1])["running"]:
        time.sleep(0.1)
    state = ended(server)
    assert state["stopped"]
    assert "gap.html" not in state["files"]
    assert ask(server, "stop", b"")[0] == 200


def test_the_end_of_the_server_is_that_of_its_command(tmp_path: Path) -> None:
    with Server("", tmp_path / "saved", GIMBAL) as made:
        made.do("diagnose", b"")
        job = made._job
    assert job
    assert job.returncode is not None


def test_a_click_leads_to_a_report(tmp_path: Path) -> None:
    wrong: list[str] = []
    made = served(explored(str(GIMBAL)), GIMBAL, tmp_path / "saved")
    with running(made), chromium() as browser:
        page = browser.new_page()
        page.on("pageerror", lambda it: wrong.append(str(it)))
        page.on("console", lambda it: wrong.append(it.text))
        page.goto(made.url)
        ready(page)
        page.get_by_role("button", name="Identify").click()
        page.get_by_role("link", name="fit.html").wait_for(timeout=60_000)
        page.goto(f"{made.url}fit.html")
        ready(page)
    assert not wrong
