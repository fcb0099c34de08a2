"""What others send is at most a line each in the terminal, and not a line for each of many."""

from __future__ import annotations

import logging
import socket
import time
from pathlib import Path

import pytest
from ispom_app.features.agents.faults import MOST, WITHIN_S, OneLine
from ispom_app.features.agents.http import PATH, serve_beside_page
from ispom_app.views.web.access import Access

from tests.app.helpers import started, wait_for

TOKEN = "a-token-of-the-test"


def test_a_hundred_malformed_requests_leave_a_few_lines(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    session = started(tmp_path, "double:7", autoplay=False)
    beside = serve_beside_page(session, 0, Access(frozenset(), token=TOKEN))
    try:
        wait_for(lambda: beside.server.started, "the server")
        address = ("127.0.0.1", int(beside.address.split(":")[2].split("/")[0]))
        head = f"POST {PATH}?token={TOKEN} HTTP/1.1\r\nHost: {address[0]}:{address[1]}\r\n"
        head += "Content-Type: application/json\r\nAccept: application/json, text/event-stream\r\n"
        bodies = (
            f"{head}Content-Length: 99999\r\n\r\n[",  # ends in the middle
            f"{head}Content-Length: abc\r\n\r\n[",
            f"{head}Content-Length: 8\r\n\r\nnot json",
            "\0 no request\r\n\r\n",
        )
        for i in range(100):
            with socket.create_connection(address, timeout=20) as connection:
                connection.sendall(bodies[i % len(bodies)].encode())
                if i % len(bodies):
                    connection.recv(100)
        wait_for(lambda: not beside.server.server_state.connections, "the end of all connections")
    finally:
        beside.end()
        session.close(5.0)
    lines = [line for line in capfd.readouterr().err.splitlines() if "An agent can ask at" not in line]
    assert 1 <= len(lines) <= MOST and all(line.startswith("agents: ") for line in lines), lines


def test_lines_that_were_left_out_are_counted() -> None:
    lines = list[str]()
    handler, now = OneLine(lines.append), time.time()

    def log(at_s: float, fault: Exception | None = None) -> None:
        info = None if fault is None else (type(fault), fault, None)
        record = logging.LogRecord("mcp", logging.ERROR, __file__, 1, "it\nfailed", None, info)
        record.created = now + at_s
        handler.handle(record)

    for _ in range(MOST + 5):
        log(0.0)
    assert lines == ["agents: it failed"] * MOST
    log(WITHIN_S, ValueError("two\nlines"))
    assert lines[MOST:] == ["agents: 5 more such lines are left out", "agents: it failed: ValueError two lines"]
